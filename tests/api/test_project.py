"""The nearest points that the daemon finds: as a job, and as a stream of rows."""
import array
import math
import os
import random
import socket
import struct
import time

import httpx
import pytest

import shapes
from conftest import PATIENCE, WAIT, check_problem, ndjson

BINARY = "application/octet-stream"
ROW = struct.Struct("<7d")


def floats(points):
    return array.array("d", [x for point in points for x in point]).tobytes()


def cloud(count, seed):
    chance = random.Random(seed)
    return [tuple(chance.uniform(-2, 2) for _ in range(3)) for _ in range(count)]


def project(client, mesh, body, **options):
    return client.post(f"/v1/meshes/{mesh}/project", content=body, **options)


def rows(reply):
    assert reply.status_code == 200, reply.text
    assert reply.headers["content-type"] == BINARY
    return list(ROW.iter_unpack(reply.content))


def ask(client, mesh, points, **fields):
    reply = client.post("/v1/jobs", json={"type": "project", "mesh": mesh, "points": points, **fields},
                        headers={"Prefer": WAIT})
    assert reply.status_code == 200, reply.text
    return reply.json()


def as_row(foot):
    return (foot["distance"], *foot["point"], foot["face"], *foot["uv"])


@pytest.fixture
def square(client):
    """The square [0, 2]^2 in the plane z = 0, of one quad, after a triangle far away."""
    mesh = ([(9, 9, 9), (9, 8, 9), (8, 9, 9), (0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)], [(0, 1, 2), (3, 4, 5, 6)])
    return client.upload(mesh, name="square")["id"]


# ---- the job ----


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_job_finds_feet(client, square, quads):
    job = ask(client, square, [[1, 0.5, 3], [3, 1, 0], [0, 0, 0]], quads=quads)
    assert job["type"] == "project" and job["state"] == "succeeded"
    assert job["request"] == {"type": "project", "mesh": square, "quads": quads, "point_count": 3}
    result = job["result"]
    assert result["quads"] == quads and result["point_count"] == 3
    over, beside, on = result["points"]
    assert over["distance"] == pytest.approx(3, abs=1e-12)
    assert over["point"] == pytest.approx([1, 0.5, 0], abs=1e-12)
    assert over["uv"] == pytest.approx([0.5, 0.25], abs=1e-12)
    assert over["face"] == 1
    assert over["distance_relative"] == pytest.approx(3 / math.sqrt(3 * 81), rel=1e-12)
    assert beside["distance"] == pytest.approx(1, abs=1e-12)
    assert beside["point"] == pytest.approx([2, 1, 0], abs=1e-12)
    assert on["distance"] == pytest.approx(0, abs=1e-12)
    assert over["patch"] == beside["patch"] == 1


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_each_accelerator_finds_the_same_feet(client, spheres, quads):
    points = cloud(300, seed=3)
    feet = ask(client, spheres[0], points, quads=quads)["result"]["points"]
    for accelerator in ("boxes", "tetra", "grid"):
        job = ask(client, spheres[0], points, quads=quads, accelerator=accelerator)
        assert job["request"]["engine"] == {"accelerator": accelerator}
        assert job["result"]["points"] == feet
        answer = project(client, spheres[0], floats(points), params={"quads": quads, "accelerator": accelerator})
        assert rows(answer) == [as_row(foot) for foot in feet]


def test_faces_count_as_in_the_file(client):
    # The pentagon is a fan of three triangles inside; the triangle after it is face 1 all the same.
    mesh = ([(0, 0, 0), (2, 0, 0), (3, 1, 0), (1, 2, 0), (0, 1, 0), (8, 0, 5), (9, 0, 5), (8, 1, 5)],
            [(0, 1, 2, 3, 4), (5, 6, 7)])
    mesh_id = client.upload(shapes.obj(mesh), format="obj")["id"]
    feet = ask(client, mesh_id, [[1, 1, 1], [8, 0, 7]])["result"]["points"]
    assert [foot["face"] for foot in feet] == [0, 1]


def test_a_point_set_has_feet(client):
    mesh_id = client.upload(b"0 0 0\n1 0 0\n0 4 0\n", format="xyz")["id"]
    foot = ask(client, mesh_id, [[0, 3, 0]])["result"]["points"][0]
    assert (foot["distance"], foot["point"], foot["face"]) == (1, [0, 4, 0], 2)


def test_no_points_are_no_fault(client, square):
    result = ask(client, square, [])["result"]
    assert result["points"] == [] and result["point_count"] == 0


def test_the_answer_is_kept(client, square):
    first = ask(client, square, [[1, 1, 1], [4, 5, 6]])
    again = ask(client, square, [[1, 1, 1], [4, 5, 6]])
    other = ask(client, square, [[1, 1, 1], [4, 5, 6.5]])
    assert again["cached"] is True and again["id"] == first["id"] and again["result"] == first["result"]
    assert "cached" not in other and other["result"] != first["result"]


def test_a_job_streams_its_result(client, square):
    reply = client.post("/v1/jobs", json={"type": "project", "mesh": square, "points": [[1, 1, 7]]},
                        headers={"Accept": "application/x-ndjson"})
    events = ndjson(reply.text)
    assert [event["event"] for event in events] == ["result"]
    assert events[0]["result"]["points"][0]["distance"] == pytest.approx(7, abs=1e-12)


def test_a_job_survives_a_restart(make_daemon):
    daemon = make_daemon()
    with daemon.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        done = ask(client, mesh, [[5, 0.5, 0.5]])
    daemon.stop(9)
    daemon.start()
    with daemon.client() as client:
        assert client.get(f"/v1/jobs/{done['id']}").json() == done
        assert ask(client, mesh, [[5, 0.5, 0.5]])["cached"] is True


@pytest.mark.parametrize("points, pointer", [
    ("[[0,0,0],[1,2,1e999]]", "/points/1/2"),
    ("[[0,0,0],[1,2]]", "/points/1"),
    ("[[0,0,0,0]]", "/points/0"),
    ("[[0,null,0]]", "/points/0/1"),
    ('[[0,0,"1"]]', "/points/0/2"),
    ("[0,0,0]", "/points/0"),
    ('"0 0 0"', "/points"),
    ("null", "/points"),
])
def test_a_bad_point_is_pointed_at(client, square, points, pointer):
    body = f'{{"type":"project","mesh":"{square}","points":{points}}}'
    problem = check_problem(client.post("/v1/jobs", content=body), 400, "invalid_field")
    assert [error["pointer"] for error in problem["errors"]] == [pointer]


def test_fields_belong_to_their_kind(client, square):
    body = {"type": "project", "a": square, "tolerance": 1, "points": []}
    problem = check_problem(client.post("/v1/jobs", json=body), 400, "invalid_field")
    assert {error["pointer"] for error in problem["errors"]} == {"/a", "/tolerance", "/mesh"}
    body = {"type": "hausdorff", "a": square, "b": square, "points": []}
    problem = check_problem(client.post("/v1/jobs", json=body), 400, "invalid_field")
    assert [error["pointer"] for error in problem["errors"]] == ["/points"]


def test_a_job_names_its_mesh(client):
    problem = check_problem(client.post("/v1/jobs", json={"type": "project", "mesh": "m_no", "points": []}), 404,
                            "mesh_not_found")
    assert problem["errors"][0]["pointer"] == "/mesh"


def test_pages_of_large_jobs_end_early(client, square):
    points = cloud(15000, seed=5)
    made = [ask(client, square, [[i, 0, 0], *points])["id"] for i in range(5)]
    seen, cursor, pages = [], None, 0
    while pages == 0 or cursor:
        reply = client.get("/v1/jobs", params={"limit": 1000, **({"cursor": cursor} if cursor else {})})
        assert len(reply.content) < 12e6
        seen += [job["id"] for job in reply.json()["jobs"]]
        cursor, pages = reply.json()["next"], pages + 1
    assert pages > 1 and len(seen) == len(set(seen)) and set(made) <= set(seen)


def test_info_lists_what_there_is(client):
    info = client.get("/v1/info").json()
    assert {"hausdorff", "project"} <= set(info["jobs"])
    assert info["kernel"] in ("portable", "avx2", "avx512")
    assert info["accelerators"] == ["auto", "boxes", "tetra", "grid"]


# ---- the stream ----


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_the_stream_says_what_the_job_says(client, spheres, quads):
    points = cloud(1000, seed=1)
    feet = ask(client, spheres[0], points, quads=quads)["result"]["points"]
    reply = project(client, spheres[0], floats(points), params={"quads": quads})
    assert int(reply.headers["content-length"]) == 1000 * ROW.size
    assert rows(reply) == [as_row(foot) for foot in feet]
    assert rows(project(client, spheres[0], floats(points), params={"quads": quads, "threads": 2})) == rows(reply)


def test_rows_keep_the_order_of_the_input(client, square):
    points = [(x % 7 / 4, x % 5 / 4, x) for x in range(2000)]
    for foot, point in zip(rows(project(client, square, floats(points), params={"order": "input"})), points):
        assert foot[0] <= point[2] + 1e-9
        if point[2] < 5:
            assert foot[1:4] == pytest.approx((*point[:2], 0), abs=1e-9)


def test_single_precision_is_taken(client, square):
    reply = project(client, square, struct.pack("<6f", 1, 0.5, 3, 3, 1, 0), params={"dtype": "f32"})
    first, second = rows(reply)
    assert first == pytest.approx((3, 1, 0.5, 0, 1, 0.5, 0.25), abs=1e-12)
    assert second[:4] == pytest.approx((1, 2, 1, 0), abs=1e-12)


def test_other_types_say_the_same(client, spheres):
    points = cloud(500, seed=2)
    binary = rows(project(client, spheres[0], floats(points)))
    reply = project(client, spheres[0], floats(points), headers={"Accept": "text/csv"})
    assert reply.headers["content-type"] == "text/csv"
    head, *lines = reply.text.splitlines()
    assert head == "distance,x,y,z,face,u,v"
    assert [tuple(map(float, line.split(","))) for line in lines] == binary
    reply = project(client, spheres[0], floats(points), headers={"Accept": "application/json"})
    assert [as_row(foot) for foot in reply.json()["points"]] == binary
    check_problem(project(client, spheres[0], b"", headers={"Accept": "text/html"}), 406, "not_acceptable")


def test_an_empty_body_has_an_empty_answer(client, square):
    assert rows(project(client, square, b"")) == []
    assert project(client, square, b"", headers={"Accept": "text/csv"}).text == "distance,x,y,z,face,u,v\n"
    assert project(client, square, b"", headers={"Accept": "application/json"}).json() == {"points": []}


@pytest.mark.parametrize("size, dtype", [(1, "f64"), (23, "f64"), (25, "f64"), (12, "f64"), (13, "f32"), (8, "f32")])
def test_half_a_point_is_refused(client, square, size, dtype):
    problem = check_problem(project(client, square, b"\0" * size, params={"dtype": dtype}), 400, "malformed_body")
    assert f"{size} bytes" in problem["detail"]


@pytest.mark.parametrize("parameters", [{"dtype": "f16"}, {"accelerator": "octree"}, {"dtype": ""}, {"quads": "flat"}, {"order": "hilbert"},
                                        {"threads": "0"}, {"threads": "1.5"}, {"threads": "257"}, {"threads": ""}])
def test_bad_parameters_are_refused(client, square, parameters):
    check_problem(project(client, square, b"", params=parameters), 400, "invalid_parameter")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("row", [0, 70000])
def test_a_row_that_is_no_point_is_named(client, square, row, bad):
    numbers = array.array("d", [0.0] * (3 * row + 6))
    numbers[3 * row + 1] = bad
    problem = check_problem(project(client, square, numbers.tobytes()), 422, "not_finite")
    assert f"point {row} " in problem["detail"]
    assert problem["errors"][0]["offset"] == 24 * row + 8


@pytest.mark.parametrize("row", [0, 70000])
def test_a_point_out_of_scale_is_named(client, square, row):
    numbers = array.array("d", [0.0] * (3 * row) + [0.0, 1e200, 0.0])
    problem = check_problem(project(client, square, numbers.tobytes()), 422, "scale_out_of_range")
    assert f"point {row} " in problem["detail"]


def test_other_bodies_and_meshes_are_refused(client, square):
    check_problem(project(client, square, b"{}", headers={"Content-Type": "application/json"}), 415)
    check_problem(project(client, "m_no", b""), 404, "mesh_not_found")
    check_problem(client.get(f"/v1/meshes/{square}/project"), 405)


@pytest.fixture
def frees_at_once(monkeypatch):
    """The sanitizer keeps freed memory for a while, which is not to be taken for the daemon's."""
    monkeypatch.setenv("ASAN_OPTIONS", os.environ.get("ASAN_OPTIONS", "") + ":quarantine_size_mb=1")


def memory_of(daemon):
    """The most memory that the process has held so far, in bytes."""
    with open(f"/proc/{daemon.process.pid}/status") as status:
        return next(1024 * int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def blob_files(daemon):
    return os.listdir(daemon.folder / "data" / "incoming")


def wait_for_no_files(daemon):
    end = time.monotonic() + PATIENCE
    while blob_files(daemon):
        assert time.monotonic() < end, "the points are still there"
        time.sleep(0.02)


@pytest.mark.bounds_memory
def test_a_million_points_take_no_memory(frees_at_once, make_daemon):
    daemon = make_daemon()
    with daemon.client() as client:
        mesh = client.upload(shapes.sphere())["id"]
        part = floats(cloud(10000, seed=3))
        first = project(client, mesh, 20 * part)  # three blocks: what there is of buffers is there now
        before = memory_of(daemon)
        reply = project(client, mesh, 100 * part)
        assert len(reply.content) == 10**6 * ROW.size
        assert reply.content == 5 * first.content
        assert memory_of(daemon) - before < 24e6
    wait_for_no_files(daemon)


def request_head(mesh, size):
    return (f"POST /v1/meshes/{mesh}/project HTTP/1.1\r\nHost: localhost\r\nContent-Length: {size}\r\n"
            f"Content-Type: {BINARY}\r\n\r\n").encode()


@pytest.mark.parametrize("when", ["sending", "reading"])
def test_a_client_may_leave(make_daemon, when):
    daemon = make_daemon("--idle-timeout", "2")  # the library sees so that nothing more will be sent
    with daemon.client() as client:
        mesh = client.upload(shapes.sphere())["id"]
        body = 20 * floats(cloud(10000, seed=4))
        with socket.create_connection(("127.0.0.1", daemon.port), timeout=PATIENCE) as raw:
            raw.sendall(request_head(mesh, len(body)))
            raw.sendall(body[: len(body) // 2])
            if when == "reading":
                raw.sendall(body[len(body) // 2:])
                assert raw.recv(4096).startswith(b"HTTP/1.1 200 OK")
        wait_for_no_files(daemon)
    with daemon.client() as client:  # the first one's connection was idle for too long meanwhile
        assert len(rows(project(client, mesh, body[:2400]))) == 100


@pytest.mark.bounds_memory
def test_a_slow_reader_holds_one_block(frees_at_once, make_daemon):
    daemon = make_daemon("--idle-timeout", 600)  # the last reader waits for the others
    with daemon.client() as client:
        mesh = client.upload(shapes.sphere())["id"]
        body = 50 * floats(cloud(10000, seed=6))
        project(client, mesh, body[: len(body) // 5])
        before = memory_of(daemon)
        readers = [socket.create_connection(("127.0.0.1", daemon.port), timeout=PATIENCE) for _ in range(4)]
        for raw in readers:
            raw.sendall(request_head(mesh, len(body)))
            raw.sendall(body)
        time.sleep(1.0)
        # Others are served all the same, and four answers of 28 MB each are not in memory.
        assert len(rows(project(client, mesh, body[:2400]))) == 100
        assert memory_of(daemon) - before < 80e6
        for raw in readers:
            with raw, raw.makefile("rb") as answer:
                while answer.readline().strip():
                    pass
                assert len(answer.read(500000 * ROW.size)) == 500000 * ROW.size
    wait_for_no_files(daemon)


def test_streams_are_counted(make_daemon):
    daemon = make_daemon("--streams", "1")
    with daemon.client() as client:
        mesh = client.upload(shapes.sphere())["id"]
        body = 50 * floats(cloud(10000, seed=6))
        with socket.create_connection(("127.0.0.1", daemon.port), timeout=PATIENCE) as raw:
            raw.sendall(request_head(mesh, len(body)))
            raw.sendall(body)
            assert raw.recv(4096).startswith(b"HTTP/1.1 200 OK")
            reply = project(client, mesh, body)
            check_problem(reply, 503, "unavailable")
            assert reply.headers["retry-after"] == "1"
            # What is answered in one block takes no place.
            assert project(client, mesh, floats([(0, 0, 0)])).status_code == 200


def test_a_stop_cuts_the_stream(make_daemon):
    daemon = make_daemon()
    with daemon.client() as client:
        mesh = client.upload(shapes.sphere())["id"]
        body = 200 * floats(cloud(10000, seed=6))
        with client.stream("POST", f"/v1/meshes/{mesh}/project", content=body) as reply:
            assert reply.status_code == 200
            assert daemon.stop() == 0
            with pytest.raises(httpx.RemoteProtocolError):
                reply.read()


# ---- a mesh that is moved ----


def test_a_mesh_that_is_moved(client, square):
    """A quarter turn about z and a shift: the same as the job of the posed mesh, and as a copy of it."""
    transform = [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 0, 0.5, 1]
    points = cloud(300, 7)
    text = ",".join(map(repr, map(float, transform)))
    found = rows(project(client, square, floats(points), params={"transform": text}))
    job = ask(client, {"mesh": square, "transform": transform}, [list(point) for point in points])
    assert found == [as_row(foot) for foot in job["result"]["points"]]
    copy = client.post(f"/v1/meshes/{square}/copies", json={"transform": transform}).json()["id"]
    assert found == rows(project(client, copy, floats(points))) != rows(project(client, square, floats(points)))
    identity = ",".join(str(int(i % 5 == 0)) for i in range(16))
    assert rows(project(client, square, floats(points), params={"transform": identity})) == rows(project(client, square, floats(points)))


@pytest.mark.parametrize("transform", ["", "1", "1," * 16, ",".join(["0"] * 16), ",".join(["1"] * 17), ",".join(["nan"] * 16),
                                       "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1x", "1,0,0,0,0,1,0,0,0,0,1,0,1e999,0,0,1",
                                       "1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1"])
def test_transforms_that_move_nothing_well(client, square, transform):
    problem = check_problem(project(client, square, floats([(0, 0, 0)]), params={"transform": transform}), 400, "invalid_parameter")
    assert "transform" in problem["detail"]
