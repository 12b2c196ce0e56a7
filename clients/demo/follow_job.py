#!/usr/bin/env python3
"""Follows the events of a job through the end of the daemons that it asks.

follow_job.py URL... JOB

Asks the first daemon for the events; when its stream breaks off, the next one for those after the last that it has seen.
Prints a line for each, and checks that bounds of one run of the job never move the wrong way. Exit status 1 when there is
no proven end.
"""
import http.client
import itertools
import json
import sys
import time
import urllib.parse

PATIENCE_S = 120.0
RUN = 10**9  # the first number of each run of a job, but for one


def events_of(url, job, seq):
    """The events after a number, as they come; ends when the connection does."""
    place = urllib.parse.urlsplit(url)
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=PATIENCE_S)
    connection.request("GET", f"/v1/jobs/{job}/events?after={seq}", headers={"Accept": "application/x-ndjson"})
    reply = connection.getresponse()
    while reply.status == 200 and (line := reply.readline()):
        yield json.loads(line)


def check(event, bounds):
    """Bounds never widen within a run; returns the new ones."""
    run = (event["seq"] - 1) // RUN
    lower, upper = event["lower"], event["upper"]
    last_run, last_lower, last_upper = bounds
    if run == last_run and (lower < last_lower or (last_upper is not None and (upper is None or upper > last_upper))):
        sys.exit(f"event {event['seq']} moves a bound the wrong way")
    return run, lower, upper


def main(urls, job):
    seq, bounds, end = 0, (-1, 0.0, None), time.monotonic() + PATIENCE_S
    for url in itertools.cycle(urls):
        try:
            for event in events_of(url, job, seq):
                seq = event["seq"]
                if event["event"] == "heartbeat":
                    continue
                told = event["result"] if event["event"] == "result" else event
                if "lower" in told:
                    bounds = check(dict(told, seq=seq), bounds)
                    print(f"   {url} seq {seq}: {told['lower']!r} <= h <= {told['upper']!r}", flush=True)
                else:
                    print(f"   {url} seq {seq}: {event['event']}, {event.get('detail', '')}", flush=True)
                if event["event"] in ("result", "error"):
                    sys.exit(0 if event["event"] == "result" and told["converged"] else "the job did not converge")
        except (OSError, http.client.HTTPException) as fault:
            print(f"   {url} is gone ({type(fault).__name__}), the next one is asked for what follows seq {seq}", flush=True)
        if time.monotonic() > end:
            sys.exit("no end within the time")
        time.sleep(0.2)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(sys.argv[1:-1], sys.argv[-1])
