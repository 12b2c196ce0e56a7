"""Streams of bounds: order, framing, resuming, several readers, hanging up."""
import itertools
import json
import threading
import time

import pytest

import shapes
from conftest import PATIENCE, SLOW, SLOW_DISTANCE, check_bounds, check_problem, ndjson

NDJSON = {"Accept": "application/x-ndjson"}
SSE = {"Accept": "text/event-stream"}
FRESH = {"Cache-Control": "no-cache"}


def read_sse(text):
    """The messages of an event stream as (id, event, object); comments are left out."""
    messages = []
    for block in text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if line and not line.startswith(":"))
        if fields:
            messages.append((int(fields["id"]), fields["event"], json.loads(fields["data"])))
    return messages


def request_for(pair, **more):
    return {"type": "hausdorff", "a": pair[0], "b": pair[1], **more}


@pytest.mark.parametrize("reading", ["triangles", "bilinear"])
@pytest.mark.parametrize("direction", ["two_sided", "a_to_b", "b_to_a"])
def test_bounds_only_ever_close_in(client, spheres, reading, direction):
    request = request_for(spheres, quads=reading, direction=direction, tolerance=1e-9)
    reply = client.post("/v1/jobs", json=request, headers={**NDJSON, **FRESH})
    assert reply.status_code == 200
    assert reply.headers["content-type"] == "application/x-ndjson"
    assert reply.headers["x-accel-buffering"] == "no" and "no-store" in reply.headers["cache-control"]
    events = ndjson(reply.text)
    job = client.get(reply.headers["location"]).json()
    check_bounds(events, job["result"])
    assert events[0]["seq"] == 1
    for event in events[:-1]:
        assert event["event"] == "bounds"
        assert event["lower"] <= shapes.SPHERE_DISTANCE * (1 + 1e-15)
        assert event["upper"] is None or event["upper"] >= shapes.SPHERE_DISTANCE
        assert {"elapsed_ms", "gap_relative", "iterations", "queue"} <= set(event)
    times = [event["elapsed_ms"] for event in events[:-1]]
    assert times == sorted(times)


def test_every_halving_is_told(client, spheres):
    reply = client.post("/v1/jobs", json=request_for(spheres, tolerance=1e-9), headers={**NDJSON, **FRESH})
    gaps = [event["upper"] - event["lower"] for event in ndjson(reply.text)[:-1] if event["upper"] is not None]
    # Bounds may jump by more than a half between two events; there must be some events in between.
    assert len(gaps) >= 3, gaps
    assert gaps == sorted(gaps, reverse=True)


def test_sse_tells_the_same(client, spheres):
    job = client.hausdorff(*spheres, tolerance=1e-7)
    url = f"/v1/jobs/{job['id']}/events"
    reply = client.get(url, headers=SSE)
    assert reply.headers["content-type"].split(";")[0] == "text/event-stream"
    messages = read_sse(reply.text)
    assert [message[2] for message in messages] == client.events(job["id"])
    for number, name, event in messages:
        assert number == event["seq"] and name == event["event"]
    check_bounds([message[2] for message in messages], job["result"])


def test_sse_answers_a_post_too(client, spheres):
    reply = client.post("/v1/jobs", json=request_for(spheres, tolerance=1e-7), headers={**SSE, **FRESH})
    messages = read_sse(reply.text)
    assert reply.status_code == 200 and messages[-1][1] == "result"


@pytest.mark.parametrize("resume", ["after", "Last-Event-ID"])
@pytest.mark.parametrize("accept", [NDJSON, SSE], ids=["ndjson", "sse"])
def test_a_reader_resumes_where_it_was(client, spheres, resume, accept):
    job = client.hausdorff(*spheres, tolerance=1e-8)
    events = client.events(job["id"])
    assert len(events) > 3
    for seen in (0, 2, len(events) - 1, len(events)):
        query = {"after": seen} if resume == "after" else {}
        headers = {**accept, **({} if query else {"Last-Event-ID": str(seen)})}
        reply = client.get(f"/v1/jobs/{job['id']}/events", params=query, headers=headers)
        assert reply.status_code == 200
        rest = ndjson(reply.text) if accept is NDJSON else [message[2] for message in read_sse(reply.text)]
        assert rest == events[seen:]


@pytest.mark.parametrize("after", ["-1", "many", "1.5", "", "99999999999999999999999"])
def test_bad_places_are_refused(client, spheres, after):
    job = client.hausdorff(*spheres)
    check_problem(client.get(f"/v1/jobs/{job['id']}/events", params={"after": after}), 400)


def test_events_of_an_unknown_job(client):
    check_problem(client.get("/v1/jobs/j_none/events"), 404, "job_not_found")


def test_many_readers_hear_the_same(client, daemon, slow_pair):
    job = client.start(*slow_pair, deadline_ms=1500, **SLOW)
    heard = [None] * 6

    def listen(place):
        time.sleep(0.1 * place)
        with daemon.client() as own:
            heard[place] = own.events(job["id"])

    threads = [threading.Thread(target=listen, args=(place,)) for place in range(len(heard))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    result = client.wait(job["id"])["result"]
    check_bounds(heard[0], result)
    assert all(events == heard[0] for events in heard)


def test_events_come_while_the_search_runs(client, slow_pair):
    """More of them than the gap is halved in that time: they also come by the clock."""
    with client.stream("POST", "/v1/jobs", json=request_for(slow_pair, **SLOW), headers={**NDJSON, **FRESH}) as reply:
        lines = reply.iter_lines()
        bounds = [event for event in map(json.loads, itertools.islice(lines, 12)) if event["event"] == "bounds"]
        assert client.get(reply.headers["location"]).json()["state"] == "running"
    assert len(bounds) >= 10
    gaps = [event["upper"] - event["lower"] for event in bounds if event["upper"] is not None]
    assert gaps[-1] > gaps[0] / 2 ** (len(gaps) - 1), gaps


def test_heartbeats(client, make_daemon, slow_files):
    """A heat map has no bounds to report."""
    with make_daemon("--heartbeat", 2).client() as own:
        pair = [own.upload(content)["id"] for content in slow_files]
        quiet = own.post("/v1/jobs", json={"type": "heatmap", "a": pair[0], "b": pair[1], "error": 1e-12,
                                           "engine": {"pieces": 10000000}}).json()
        beats = []
        for accept in (NDJSON, SSE):
            with own.stream("GET", f"/v1/jobs/{quiet['id']}/events", headers=accept) as reply:
                start = time.monotonic()
                line = next(line for line in reply.iter_lines() if line)
                beats.append((time.monotonic() - start, line))
        own.delete(f"/v1/jobs/{quiet['id']}")
    assert json.loads(beats[0][1]) == {"event": "heartbeat", "seq": 0}
    assert beats[1][1].startswith(":")
    for seconds, _ in beats:
        assert 1.5 < seconds


def wait_for_state(client, job_id, states):
    end = time.monotonic() + PATIENCE
    while True:
        state = client.get(f"/v1/jobs/{job_id}").json()["state"]
        if state in states:
            return state
        assert time.monotonic() < end, state
        time.sleep(0.05)


def open_and_leave(daemon, request, wait_for_event=True):
    """Streams a job, hangs up after its first event, and returns the job's id."""
    with daemon.client() as own:
        with own.stream("POST", "/v1/jobs", json=request, headers={**NDJSON, **FRESH}) as reply:
            if wait_for_event:
                next(reply.iter_lines())
            return reply.headers["location"].rsplit("/", 1)[1]


def test_hanging_up_cancels(client, daemon, slow_pair):
    job_id = open_and_leave(daemon, request_for(slow_pair, **SLOW))
    assert wait_for_state(client, job_id, ["canceled", "succeeded"]) == "canceled"
    result = client.get(f"/v1/jobs/{job_id}").json()["result"]
    assert result["lower"] <= SLOW_DISTANCE <= result["upper"]


def test_a_detached_job_goes_on(client, daemon, slow_pair):
    job_id = open_and_leave(daemon, request_for(slow_pair, detach=True, deadline_ms=2500, **SLOW))
    assert wait_for_state(client, job_id, ["canceled", "succeeded"]) == "succeeded"


def test_a_reader_that_leaves_cancels_nothing(client, slow_pair):
    job = client.start(*slow_pair, deadline_ms=2600, **SLOW)
    with client.stream("GET", f"/v1/jobs/{job['id']}/events", headers=NDJSON) as reply:
        next(reply.iter_lines())
    assert client.wait(job["id"])["state"] == "succeeded"


def test_too_many_streams_are_refused(make_daemon, slow_files):
    with make_daemon("--streams", 1).client() as client:
        pair = [client.upload(content)["id"] for content in slow_files]
        job = client.start(*pair, **SLOW)
        with client.stream("GET", f"/v1/jobs/{job['id']}/events", headers=NDJSON) as reply:
            # An iterator that is dropped closes the connection.
            lines = reply.iter_lines()
            next(lines)
            with make_second_client(client) as other:
                refused = other.get(f"/v1/jobs/{job['id']}/events", headers=NDJSON)
                assert int(refused.headers["retry-after"]) > 0
                check_problem(refused, 503)
                assert other.get("/healthz").status_code == 200
        assert client.delete(f"/v1/jobs/{job['id']}").status_code == 202


def make_second_client(client):
    return type(client)(base_url=client.base_url, timeout=client.timeout)
