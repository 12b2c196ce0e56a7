"""POST /v1/compare: two files in, one answer out, nothing kept."""
import gzip
import json
import math
import pathlib
import socket
import subprocess
import time

import pytest

import shapes
from conftest import PATIENCE, check_problem, gauge, together


def compare(client, a, b, options=None, **more):
    files = {"a": ("a.ply", a), "b": ("b.ply", b)}
    if options is not None:
        files["options"] = (None, options if isinstance(options, (str, bytes)) else json.dumps(options))
    return client.post("/v1/compare", files=files, **more)


@pytest.fixture(scope="module")
def pair():
    return shapes.ply_little(shapes.cube()), shapes.ply_little(shapes.cube(origin=(1, 0, 0)))


@pytest.fixture(scope="module")
def slow():
    return tuple(shapes.ply_little(shapes.rough(150, seed)) for seed in (1, 2))


def is_empty(client):
    return client.get("/v1/meshes").json()["meshes"] == [] and client.get("/v1/jobs").json()["jobs"] == []


def test_the_distance_of_two_files(make_daemon, pair):
    running = make_daemon()
    with running.client() as client:
        reply = compare(client, *pair)
        assert reply.status_code == 200 and reply.headers["content-type"] == "application/json"
        distance = reply.json()["symmetric"]["hausdorff"]
        assert distance["lower"] <= 1 <= distance["upper"]
        witness = compare(client, *pair, options={"type": "hausdorff"}).json()["witness"]
        assert "id" not in witness["from"] and witness["from"]["mesh"] in ("a", "b")
        assert is_empty(client)
        folder = pathlib.Path(running.folder) / "data"
        assert not any(path.is_file() for name in ("blobs", "incoming", "results") for path in (folder / name).rglob("*"))
        assert gauge(client, "meshes_loaded") == 0


@pytest.mark.parametrize("options, check", [
    ({"type": "deviation", "quads": "bilinear"}, lambda r: r["mean"]["lower"] <= 0.5 <= r["mean"]["upper"]),
    ({"type": "distance"}, lambda r: r["lower"] == r["upper"] == 0 and r["collides"]),
    ({"type": "collision"}, lambda r: r["collides"] is True),
    ({"type": "hausdorff", "limit": 3}, lambda r: r["verdict"] == "below"),
    (" {\n} ", lambda r: r["gap"] == pytest.approx(1e-6 * math.sqrt(3))),
    ({"gap": 0.01, "gap_unit": "absolute", "limits": [0.5]}, lambda r: r["gap"] == 0.01 and len(r["symmetric"]["f_score"]) == 1),
], ids=["deviation", "distance", "collision", "hausdorff", "blanks", "limits"])
def test_kinds_and_options(client, pair, options, check):
    reply = compare(client, *pair, options=options)
    assert reply.status_code == 200, reply.text
    assert check(reply.json()), reply.text


def test_formats_by_name_type_and_content(client, pair):
    cube = shapes.cube()
    obj = shapes.obj(cube) if hasattr(shapes, "obj") else "".join(
        [*(f"v {x} {y} {z}\n" for x, y, z in cube[0]),
         *("f " + " ".join(str(i + 1) for i in face) + "\n" for face in cube[1])]).encode()
    for b in (("b.obj", obj), ("b", obj, "model/obj"), ("b.obj.gz", gzip.compress(obj)), ("noname", pair[0])):
        reply = client.post("/v1/compare", files={"a": ("a.ply", pair[0]), "b": b})
        assert reply.status_code == 200 and reply.json()["symmetric"]["hausdorff"]["upper"] == 0, reply.text


@pytest.mark.parametrize("files, pointer", [
    ({"a": b"x"}, "/b"),
    ({"b": b"x"}, "/a"),
    ({"a": b"x", "b": b"x", "c": b"x"}, "/c"),
    ([("a", b"x"), ("b", b"x"), ("a", b"x")], "/a"),
    ([("a", b"x"), ("b", b"x"), ("options", b"[]")], "/options"),
    ([("a", b"x"), ("b", b"x"), ("options", b"")], "/options"),
    ([("a", b"x"), ("b", b"x"), ("options", b"{}\0")], "/options"),
    ([("a", b"x"), ("b", b"x"), ("options", b'{"a": "m_a"}')], "/a"),
    ([("a", b"x"), ("b", b"x"), ("options", b'{"type": "matrix"}')], "/type"),
    ([("a", b"x"), ("b", b"x"), ("options", b'{"type": "self_collision"}')], "/type"),
    ([("a", b"x"), ("b", b"x"), ("options", b'{"type": "none"}')], "/type"),
    ([("a", b"x"), ("b", b"x"), ("options", b'{"gap": 0}')], "/gap"),
])
def test_wrong_parts(client, files, pointer):
    problem = check_problem(client.post("/v1/compare", files=files), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == pointer


def test_options_that_are_no_json(client, pair):
    problem = check_problem(compare(client, *pair, options='{"type": '), 400, "malformed_json")
    assert problem["errors"][0]["offset"] == 8


@pytest.mark.parametrize("body", [b"", b"--x", b"--x\r\n", b"--x\r\nContent-Disposition: form-data; name=a\r\n\r\nz",
                                  b"no boundary", b"--x--junk"])
def test_bodies_that_are_cut(client, body):
    reply = client.post("/v1/compare", content=body, headers={"Content-Type": "multipart/form-data; boundary=x"})
    if body == b"--x--junk":
        check_problem(reply, 400, "invalid_field")  # without any part
    else:
        assert "offset" in check_problem(reply, 400, "malformed_body")["errors"][0]


@pytest.mark.parametrize("media", ["application/json", "multipart/form-data", "multipart/mixed; boundary=x", "text/plain"])
def test_other_types(client, media):
    check_problem(client.post("/v1/compare", content=b"--x--", headers={"Content-Type": media}), 415,
                  "unsupported_media_type")


def test_files_that_cannot_be_read(client, pair):
    problem = check_problem(compare(client, pair[0], b"ply\nformat ascii 1.0\nelement vertex x\n"), 422)
    assert problem["detail"].startswith("b: ")
    problem = check_problem(compare(client, b"ply\nformat ascii 1.0\nelement vertex x\n", pair[0]), 422)
    assert problem["detail"].startswith("a: ") and problem["errors"][0]["line"] == 3
    check_problem(compare(client, pair[0], b""), 422)
    tiny, huge = (shapes.ply_little(shapes.cube(side=side)) for side in (1e-200, 1e200))
    check_problem(compare(client, tiny, huge), 422, "scale_out_of_range")


def test_a_body_that_is_too_large(make_daemon, pair):
    with make_daemon("--max-body", 4096).client() as client:
        assert compare(client, *pair).status_code == 200
        check_problem(compare(client, pair[0], b"x" * 5000), 413, "too_large")
        # The length is not told before.
        chunks = iter([b"--x\r\n" + b"y" * 3000, b"y" * 3000])
        check_problem(client.post("/v1/compare", content=chunks,
                                  headers={"Content-Type": "multipart/form-data; boundary=x"}), 413, "too_large")


def test_many_at_the_same_time(client, pair):
    replies = together(8, lambda i: compare(client, *pair, options={"gap": 10.0 ** -(i + 2)}))
    assert [reply.status_code for reply in replies] == [200] * 8


def test_a_deadline(client, slow):
    reply = compare(client, *slow, options={"type": "hausdorff", "deadline_ms": 1, "gap": 1e-12, "quads": "bilinear", "threads": 1})
    assert reply.status_code == 200 and reply.json()["stopped_by"] in ("deadline", "converged", "precision")
    reply = compare(client, *slow, options={"type": "distance", "deadline_ms": 1e-6})
    check_problem(reply, 504, "deadline_exceeded")


def test_a_client_that_leaves_ends_the_job(make_daemon):
    with make_daemon("--workers", 1).client() as client:
        heap = shapes.ply_little(shapes.rough(220, 7, 0.4)), shapes.ply_little(shapes.rough(219, 8, 0.4))
        options = {"type": "deviation", "accuracy": 1e-9, "pieces": 10_000_000, "threads": 1}
        body = b"".join(b"--x\r\nContent-Disposition: form-data; name=\"%s\"\r\n\r\n%s\r\n" % part
                        for part in ((b"a", heap[0]), (b"b", heap[1]), (b"options", json.dumps(options).encode()))) + b"--x--"
        host = client.base_url.host, client.base_url.port
        with socket.create_connection(host) as left:
            left.sendall(b"POST /v1/compare HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nContent-Type: multipart/form-data; boundary=x\r\n"
                         b"Content-Length: %d\r\n\r\n%s" % (host[1], len(body), body))
            end = time.monotonic() + PATIENCE
            while client.get("/v1/info").json()["running"] == 0:
                assert time.monotonic() < end, "the job does not start"
                time.sleep(0.01)
        end = time.monotonic() + PATIENCE
        while client.get("/v1/info").json()["running"] > 0:
            assert time.monotonic() < end, "the job goes on without its client"
            time.sleep(0.05)


def test_as_curl_sends_it(client, pair, tmp_path):
    for name, bytes_ in zip("ab", pair):
        (tmp_path / f"{name}.ply").write_bytes(bytes_)
    done = subprocess.run(["curl", "-sS", "-F", "a=@a.ply", "-F", "b=@b.ply", "-F", 'options={"type":"hausdorff","quads":"bilinear"}',
                           f"{str(client.base_url).rstrip(chr(47))}/v1/compare"], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE)
    assert json.loads(done.stdout)["upper"] >= 1, done.stderr
