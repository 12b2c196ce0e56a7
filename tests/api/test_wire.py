"""Requests that no well-behaved client sends, byte by byte, and many clients at the same time."""
import json
import socket

import pytest

import shapes
from conftest import PATIENCE, SLOW, check_problem, together

HEALTH = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"


def talk(daemon, *parts):
    """Everything that the daemon says to these bytes until it closes, or until it has been silent for a while."""
    said = b""
    with socket.create_connection(("127.0.0.1", daemon.port), timeout=2) as wire:
        try:
            for part in parts:
                wire.sendall(part)
            while block := wire.recv(65536):
                said += block
        except (TimeoutError, ConnectionResetError, BrokenPipeError):
            pass
    return said


def request(method, path, *headers, body=b""):
    lines = [f"{method} {path} HTTP/1.1", "Host: localhost", *headers]
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + body


def check_refused_and_closed(said, status):
    """One reply, and nothing after it was taken for a request."""
    assert said.startswith(f"HTTP/1.1 {status} ".encode()), said
    assert said.count(b"HTTP/1.1 ") == 1, said
    assert b"\r\nConnection: close\r\n" in said, said


def test_two_ways_to_tell_the_length_are_refused(daemon):
    for headers in (["Content-Length: 5", "Transfer-Encoding: chunked"],
                    ["Content-Length: 5", "Content-Length: 6"],
                    ["Transfer-Encoding: chunked", "Transfer-Encoding: chunked"],
                    ["Transfer-Encoding: gzip"]):
        said = talk(daemon, request("POST", "/v1/jobs", *headers, body=b"0\r\n\r\n" + HEALTH))
        check_refused_and_closed(said, 400)


def test_a_request_has_one_host(daemon):
    for hosts in ("", "Host: localhost\r\nHost: 127.0.0.1\r\n"):
        said = talk(daemon, f"GET /healthz HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n".encode())
        check_refused_and_closed(said, 400)
    assert talk(daemon, b"GET /healthz HTTP/1.0\r\n\r\n").startswith(b"HTTP/1.1 200 ")


def test_the_body_of_a_refused_request_is_not_the_next_request(daemon):
    for method, path, status in (("POST", "/nowhere", 404), ("DELETE", "/nowhere", 404), ("PATCH", "/v1/jobs", 405)):
        said = talk(daemon, request(method, path, f"Content-Length: {len(HEALTH)}", body=HEALTH))
        check_refused_and_closed(said, status)


def test_a_body_without_end_is_cut_off(make_daemon):
    running = make_daemon("--max-body", 4096)
    block = b"10000\r\n" + b"v" * 65536 + b"\r\n"
    with socket.create_connection(("127.0.0.1", running.port), timeout=PATIENCE) as wire:
        wire.sendall(request("POST", "/v1/meshes", "Transfer-Encoding: chunked"))
        with pytest.raises((ConnectionResetError, BrokenPipeError)):
            for _ in range(1024):
                wire.sendall(block)
    assert not any((running.folder / "data/incoming").iterdir())
    little = request("POST", "/v1/meshes", "Transfer-Encoding: chunked", body=block + b"0\r\n\r\n")
    assert talk(running, little).startswith(b"HTTP/1.1 413 ")


def test_the_best_of_the_accepted_types_is_sent(client, spheres):
    a, b = spheres
    body = {"type": "hausdorff", "a": a, "b": b, "tolerance": 1e-3}
    for accept, expected in (("application/json, application/x-ndjson;q=0.5", "application/json"),
                             ("application/json;q=0.1, application/x-ndjson", "application/x-ndjson"),
                             ("text/event-stream, */*;q=0.1", "text/event-stream"),
                             ("application/*", "application/json"), ("", "application/json")):
        reply = client.post("/v1/jobs", json=body, headers={"Accept": accept})
        assert reply.headers["content-type"] == expected, accept
    for method, path in (("POST", "/v1/jobs"), ("GET", "/v1/meshes"), ("GET", "/v1/info")):
        reply = client.request(method, path, headers={"Accept": "image/png, application/json;q=0"})
        check_problem(reply, 406, "not_acceptable")


def test_what_a_reply_hangs_on_is_told(client, spheres):
    several, one = client.get(f"/v1/meshes/{spheres[0]}/vertices"), client.get(f"/v1/meshes/{spheres[0]}")
    assert several.headers["vary"] == "Accept" and "vary" not in one.headers
    assert client.get("/v1/jobs/j_1/result").headers["vary"] == "Accept"


def test_the_same_bytes_at_the_same_time_make_one_mesh(daemon):
    content = shapes.ply_little(shapes.rough(60, seed=77))

    def upload(_):
        with daemon.client() as own:
            return own.post("/v1/meshes", params={"name": "twin"}, content=content)

    replies = together(8, upload)
    assert sorted(reply.status_code for reply in replies) == [200] * 7 + [201]
    assert len({reply.json()["id"] for reply in replies}) == 1


def test_a_refused_upload_takes_nothing_from_a_good_one(make_daemon):
    """The same bytes come with a wrong and with the right format, again and again at the same time."""
    running = make_daemon()
    content = shapes.ply_little(shapes.rough(20, seed=78))

    def upload(place):
        with running.client() as own:
            return own.post("/v1/meshes", params={"format": ("ply", "stl")[place % 2]}, content=content).status_code

    for _ in range(10):
        statuses = together(8, upload)
        assert set(statuses[1::2]) == {422} and sorted(statuses[0::2])[:3] == [200] * 3
    running.stop()
    running.start()
    with running.client() as client:
        (mesh,) = client.get("/v1/meshes").json()["meshes"]
        assert client.hausdorff(mesh["id"], mesh["id"])["state"] == "succeeded"


def test_one_idempotency_key_at_the_same_time_makes_one_job(daemon, slow_pair):
    a, b = slow_pair

    def start(_):
        with daemon.client() as own:
            return own.post("/v1/jobs", headers={"Idempotency-Key": "all at once"},
                            json={"type": "hausdorff", "a": a, "b": b, **SLOW})

    replies = together(8, start)
    assert {reply.status_code for reply in replies} == {202}
    (job_id,) = {reply.json()["id"] for reply in replies}
    with daemon.client() as own:
        assert own.delete(f"/v1/jobs/{job_id}").status_code == 202
        assert own.wait(job_id)["state"] == "canceled"


def test_a_full_queue_still_gives_the_answers_that_it_has(make_daemon, slow_files):
    running = make_daemon("--queue", 1, "--workers", 1, "--grace", 0)
    with running.client() as client:
        a, b = (client.upload(content)["id"] for content in slow_files)
        cheap = {"tolerance": 10.0}
        assert client.hausdorff(a, b, **cheap)["state"] == "succeeded"
        jobs = [client.start(a, b, headers={"Cache-Control": "no-cache"}, **SLOW)]
        while client.get(f"/v1/jobs/{jobs[0]['id']}").json()["state"] == "queued":
            pass
        jobs.append(client.start(a, b, headers={"Cache-Control": "no-cache"}, **SLOW))
        refused = client.post("/v1/jobs", json={"type": "hausdorff", "a": a, "b": b, "threshold": 1.0})
        check_problem(refused, 429, "too_many_jobs")
        assert client.hausdorff(a, b, **cheap)["cached"] is True


def test_all_unfinished_jobs_come_back_after_a_kill(make_daemon, slow_files):
    """The one that runs and the ones that wait are together more than the queue may hold."""
    running = make_daemon("--queue", 2, "--workers", 1)
    with running.client() as client:
        a, b = (client.upload(content)["id"] for content in slow_files)
        jobs = [client.start(a, b, **SLOW)]
        while client.get(f"/v1/jobs/{jobs[0]['id']}").json()["state"] == "queued":
            pass
        jobs += [client.start(a, b, tolerance=tolerance) for tolerance in (5.0, 6.0)]
    running.process.kill()
    running.process.wait(PATIENCE)
    running.start()
    with running.client() as client:
        assert client.delete(f"/v1/jobs/{jobs[0]['id']}").status_code == 202
        for before in jobs:
            after = client.wait(before["id"])
            assert after["created"] == before["created"]
        assert after["state"] == "succeeded"


def test_a_reader_of_an_earlier_run_gets_the_whole_new_one(client, spheres):
    a, b = spheres
    job_id = client.hausdorff(a, b, tolerance=1e-4)["id"]
    events = client.events(job_id)
    assert client.events(job_id, after=len(events)) == []
    assert client.events(job_id, after=len(events) + 1) == events


def test_a_stream_that_somebody_else_asked_for_too_goes_on(daemon, client, slow_pair):
    """Two POSTs with one key own the job together; the leaving of one does not end it."""
    a, b = slow_pair
    body = json.dumps({"type": "hausdorff", "a": a, "b": b, "direction": "a_to_b", **SLOW})
    headers = {"Accept": "application/x-ndjson", "Idempotency-Key": "shared", "Content-Type": "application/json"}
    with daemon.client() as own, own.stream("POST", "/v1/jobs", content=body, headers=headers) as stays:
        lines = stays.iter_lines()
        next(lines)
        with daemon.client() as other, other.stream("POST", "/v1/jobs", content=body, headers=headers) as leaves:
            next(leaves.iter_lines())
            path = leaves.headers["location"]
        for _ in range(8):
            next(lines)
        assert client.get(path).json()["state"] == "running"
    assert client.get(path, headers={"Prefer": "wait=40"}).json()["state"] == "canceled"
