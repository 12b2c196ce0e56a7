#!/usr/bin/env python3
"""Reads the events of a Hausdorff job from standard input, checks them and tells the result.

check_stream.py [--distance "1 - cos(pi/100)"]

Exit status 1 when the stream has no result, when bounds move the wrong way, when they did not converge, or
when they do not hold the distance that is known.
"""
import argparse
import json
import math
import sys

KNOWN = {"1 - cos(pi/100)": 1.0 - math.cos(math.pi / 100.0)}


def check_order(events):
    """Lower bounds never fall, upper bounds never rise, seq counts from 1."""
    lower, upper = 0.0, math.inf
    for place, event in enumerate(events, start=1):
        if event["seq"] != place:
            sys.exit(f"event {place} has seq {event['seq']}")
        bounds = event["result"] if event["event"] == "result" else event
        # An upper bound that is not known yet comes as null.
        new_upper = math.inf if bounds["upper"] is None else bounds["upper"]
        if bounds["lower"] < lower or new_upper > upper or bounds["lower"] > new_upper:
            sys.exit(f"event {place} moves a bound the wrong way")
        lower, upper = bounds["lower"], new_upper


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--distance", choices=KNOWN)
    wanted = parser.parse_args().distance
    events = [json.loads(line) for line in sys.stdin]
    events = [event for event in events if event["event"] != "heartbeat"]
    if not events or events[-1]["event"] != "result":
        sys.exit("the stream ended without a result")
    check_order(events)
    result = events[-1]["result"]
    lower, upper = result["lower"], result["upper"]
    print(f"  {lower!r} <= h <= {upper!r}")
    print(f"  {result['iterations']} iterations, {result['elapsed_ms']:.1f} ms of search")
    if not result["converged"]:
        sys.exit("the bounds did not converge")
    if wanted:
        if not lower <= KNOWN[wanted] <= upper:
            sys.exit(f"the bounds do not hold {wanted} = {KNOWN[wanted]!r}")
        print(f"  {wanted} = {KNOWN[wanted]!r} lies within")


if __name__ == "__main__":
    main()
