"""Many jobs in one request: every line answered once, in the order of completion, in bounded memory."""
import json
import signal
import socket
import threading
import time

import pytest

import shapes
from conftest import PATIENCE, SLOW, WAIT, check_problem


def run(client, lines, **options):
    body = lines if isinstance(lines, (bytes, str)) else "\n".join(json.dumps(line) for line in lines)
    reply = client.post("/v1/batches", content=body, headers={"Content-Type": "application/x-ndjson"}, **options)
    assert reply.status_code == 200, reply.text
    assert reply.headers["content-type"] == "application/x-ndjson"
    assert reply.headers["x-accel-buffering"] == "no"
    return [json.loads(line) for line in reply.text.splitlines()]


def by_line(answers):
    answers = {answer["line"]: answer for answer in answers if "line" in answer}
    return [answers[line] for line in sorted(answers)]


def test_each_line_is_answered_with_its_key(client, spheres):
    a, b = spheres
    hausdorff = {"type": "hausdorff", "a": a, "b": b, "tolerance": 0.01}
    lines = [{"key": "first", **hausdorff}, {"key": 2, "type": "project", "mesh": a, "points": [[0, 0, 3]]},
             {"type": "deviation", "a": a, "b": b, "pieces": 0, "tolerance": 0.1, "key": 'q"\u00e4'}, {**hausdorff, "key": None, "direction": "a_to_b"},
             {"type": "project", "mesh": a, "points": []}]
    answers = by_line(run(client, lines))
    assert [answer["key"] for answer in answers] == ["first", 2, 'q"\u00e4', None, None]
    assert [answer["line"] for answer in answers] == [1, 2, 3, 4, 5]
    assert all(answer["state"] == "succeeded" and set(answer) <= {"key", "line", "state", "result", "cached"}
               for answer in answers)
    for line, answer in zip(lines[:2], answers):
        line.pop("key")
        alone = client.post("/v1/jobs", json=line, headers={"Prefer": WAIT}).json()["result"]
        for key in ("lower", "upper", "points"):
            assert answer["result"].get(key) == alone.get(key)


def test_a_faulty_line_leaves_the_others_alone(client, spheres):
    good = json.dumps({"key": "good", "type": "project", "mesh": spheres[0], "points": [[1, 2, 3]]})
    lines = [good, "nonsense", "", "   \r", '{"key":"x","type":"project","mesh":"m_none","points":[]}',
             '{"key":[1],"type":"project","mesh":"%s","points":[]}' % spheres[0], '{"key":"y","type":"nothing"}',
             "[]", "\u00ff" * 3, '{"key":"%s"}' % ("k" * 300), good.replace("[[1", "[[" * 40), good + "\r"]
    answers = by_line(run(client, "\n".join(lines)))
    assert [answer["line"] for answer in answers] == [1, 2, 5, 6, 7, 8, 9, 10, 11, 12]
    assert [answer["state"] for answer in answers] == ["succeeded"] + 8 * ["failed"] + ["succeeded"]
    codes = [answer["problem"]["code"] for answer in answers if "problem" in answer]
    assert codes == ["malformed_json", "mesh_not_found", "invalid_field", "invalid_field", "invalid_field",
                     "malformed_json", "invalid_field", "malformed_json"]
    assert [answer["key"] for answer in answers[2:5]] == ["x", None, "y"]
    assert run(client, b"") == run(client, b"\n\n \n") == []


def test_a_line_may_be_as_long_as_a_body_and_no_longer(client, spheres):
    head = '{"type":"project","mesh":"%s","points":[[0,0,1]' % spheres[0]
    fits = head + " " * (2**20 - len(head) - 2) + "]}"
    assert len(fits) == 2**20
    answers = by_line(run(client, "\n".join((fits, fits[:-2] + " ]}", head + "]}"))))
    assert [answer["state"] for answer in answers] == ["succeeded", "failed", "succeeded"]
    assert answers[1]["problem"]["code"] == "too_large"


def test_answers_come_in_the_order_of_completion(make_daemon, slow_files):
    running = make_daemon("--workers", 2)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
        point = client.upload(b"0 0 0\n1 1 1\n", format="xyz")["id"]
        lines = [{"key": "slow", "type": "hausdorff", "a": slow[0], "b": slow[1], "deadline_ms": 1500, **SLOW}]
        lines += [{"key": k, "type": "project", "mesh": point, "points": [[k, 0, 0]]} for k in range(50)]
        answers = [answer for answer in run(client, lines) if "line" in answer]  # and no heartbeats
        assert answers[-1]["key"] == "slow"
        assert sorted(answer["line"] for answer in answers) == list(range(1, 52))
        assert answers[-1]["result"]["stopped_by"] == "deadline"


def test_what_was_answered_before_is_not_computed_again(client, spheres):
    question = {"type": "hausdorff", "a": spheres[0], "b": spheres[1], "tolerance": 0.015625}
    result = client.hausdorff(*spheres, tolerance=0.015625)["result"]
    (answer,) = run(client, [question])
    assert answer["cached"] is True and answer["result"] == result


def test_jobs_of_a_batch_are_not_listed(make_daemon):
    running = make_daemon()
    with running.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        assert len(run(client, [{"type": "project", "mesh": mesh, "points": [[k, 0, 0]]} for k in range(200)])) == 200
        assert client.get("/v1/jobs").json() == {"jobs": [], "next": None}
        info = client.get("/v1/info").json()
        assert (info["queued"], info["running"]) == (0, 0)


def resident(running):
    for line in open(f"/proc/{running.process.pid}/status"):
        if line.startswith("VmRSS"):
            return int(line.split()[1]) * 1024
    raise AssertionError("no VmRSS")


@pytest.mark.bounds_memory
def test_memory_does_not_grow_with_the_lines(make_daemon, monkeypatch):
    """A reader that takes nothing for a while, and 30,000 answers of a kilobyte."""
    # Sanitized builds would keep what is freed.
    monkeypatch.setenv("ASAN_OPTIONS", "quarantine_size_mb=1:thread_local_quarantine_size_kb=64")
    running = make_daemon("--log-level", "error")
    with running.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        run(client, [{"type": "project", "mesh": mesh, "points": [[1, 2, 3]]}] * 100)
    line = json.dumps({"type": "project", "mesh": mesh, "points": [[0.1 * k, 0.2, 3] for k in range(4)]}) + "\n"
    count = 30_000
    body = line.encode() * count
    before = resident(running)
    with socket.create_connection(("127.0.0.1", running.port), timeout=PATIENCE) as wire:
        wire.sendall(b"POST /v1/batches HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: %d\r\n\r\n"
                     % len(body) + body)
        time.sleep(1.0)
        assert resident(running) < before + (32 << 20)
        received, answered = b"", 0
        while piece := wire.recv(1 << 20):
            answered += piece.count(b'"succeeded"')
            received = received[-100:] + piece
        assert received.endswith(b"0\r\n\r\n")
    # Pieces of the stream may cut a word in two.
    assert count - 200 < answered <= count
    assert resident(running) < before + (64 << 20)


def test_a_client_that_leaves_ends_its_batch(make_daemon, slow_files):
    running = make_daemon("--heartbeat", 1)
    client = running.client()
    a, b = (client.upload(content)["id"] for content in slow_files)
    lines = [{"type": "project", "mesh": a, "points": []}] + [{"type": "hausdorff", "a": a, "b": b, **SLOW}] * 20
    with running.client() as own, own.stream("POST", "/v1/batches", content="\n".join(map(json.dumps, lines))) as reply:
        next(reply.iter_lines())
        end = time.monotonic() + PATIENCE
        while client.get("/v1/info").json()["running"] == 0:
            assert time.monotonic() < end, "no line of the batch starts"
            time.sleep(0.01)
    end = time.monotonic() + PATIENCE
    while (info := client.get("/v1/info").json())["running"] or info["queued"]:
        assert time.monotonic() < end, info
        time.sleep(0.05)


def test_the_end_of_the_daemon_cuts_a_batch_visibly(make_daemon, slow_files):
    running = make_daemon("--workers", 1, "--grace", 0)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
    line = json.dumps({"key": 1, "type": "hausdorff", "a": slow[0], "b": slow[1], **SLOW}) + "\n"
    received = []

    def read():
        with socket.create_connection(("127.0.0.1", running.port), timeout=PATIENCE) as wire:
            wire.sendall(b"POST /v1/batches HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n" % (8 * len(line))
                         + 8 * line.encode())
            while piece := wire.recv(1 << 16):
                received.append(piece)

    reader = threading.Thread(target=read)
    reader.start()
    with running.client() as client:
        while client.get("/v1/info").json()["running"] == 0:
            time.sleep(0.01)
    assert running.stop(signal.SIGTERM) == 0
    reader.join(PATIENCE)
    text = b"".join(received)
    assert text.startswith(b"HTTP/1.1 200 ") and b'"unavailable"' in text and not text.endswith(b"0\r\n\r\n")


def test_a_batch_of_another_type_is_refused(client):
    check_problem(client.post("/v1/batches", content=b"{}", headers={"Content-Type": "text/csv"}), 415,
                  "unsupported_media_type")
    check_problem(client.post("/v1/batches", content=b"{}", headers={"Accept": "application/json"}), 406,
                  "not_acceptable")
