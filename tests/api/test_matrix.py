"""The distances of all pairs of a set of meshes: intervals of known values, few searches, and sets that do not fit in memory."""
import hashlib
import json
import math
import struct
import time

import pytest

import shapes
from conftest import PATIENCE, WAIT, check_problem, gauge, ndjson

SHIFTS = [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 0), (8, 8, 8), (9, 8, 8)]


def ask(client, meshes, headers=(), **fields):
    reply = client.post("/v1/jobs", json={"type": "matrix", "meshes": meshes, **fields},
                        headers={"Prefer": WAIT, **dict(headers)})
    assert reply.status_code == 200, reply.text
    return reply.json()


def rows_of(client, job):
    return client.get(f"/v1/jobs/{job['id']}/result").json()["pairs"]


@pytest.fixture(scope="module")
def boxes(daemon):
    """Unit boxes that are moved: the distance of two is the length of the way between them."""
    with daemon.client() as client:
        return [client.upload(shapes.cube(origin=shift), name=f"box {i}")["id"] for i, shift in enumerate(SHIFTS)]


@pytest.fixture(scope="module")
def many(daemon):
    """Meshes whose pairs take some seconds together."""
    with daemon.client() as client:
        return [client.upload(shapes.rough(24, seed), name="rough")["id"] for seed in range(70)]


def check_rows(rows, shifts):
    pairs = [(a, b) for a in range(len(shifts)) for b in range(a + 1, len(shifts))]
    assert [(a, b) for a, b, _, _ in rows] == pairs
    for a, b, lower, upper in rows:
        distance = math.dist(shifts[a], shifts[b])
        assert lower <= distance * (1 + 1e-15) and distance <= upper * (1 + 1e-15), (a, b, lower, upper)


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_all_pairs(client, boxes, quads):
    job = ask(client, boxes, quads=quads, gap=1e-4, gap_unit="absolute")
    assert job["type"] == "matrix" and job["state"] == "succeeded"
    assert job["request"] == {"type": "matrix", "quads": quads, "mesh_count": 6, "want": "all", "gap": 1e-4,
                              "gap_unit": "absolute"}
    result = job["result"]
    assert result["meshes"] == boxes and result["pair_count"] == 15 and "pairs" not in result
    assert result["converged"] is True and result["stopped_by"] == "converged" and result["open"] == 0
    assert result["searched_pairs"] + result["bounded_pairs"] == 15 and result["bounded_pairs"] >= 1
    rows = rows_of(client, job)
    check_rows(rows, SHIFTS)
    assert all(upper - lower <= 1e-4 for *_, lower, upper in rows)
    assert rows[2][2:] == [0, 0]  # the same mesh twice, as boxes 0 and 3 have one content
    assert boxes[0] != boxes[3]


def test_nearest(client, boxes):
    result = ask(client, boxes, want={"nearest": 2})["result"]
    assert result["want"] == {"nearest": 2} and result["open"] == 0
    lists = result["nearest"]
    assert [[entry["mesh"] for entry in one] for one in lists[:2]] == [[3, 1], [0, 3]]
    assert lists[4][0]["mesh"] == 5 and lists[4][0]["place"] == "proven"
    assert lists[4][1]["mesh"] == 2
    for one in lists:
        for entry in one:
            assert entry["lower"] <= entry["upper"] and entry["place"] in ("proven", "tied")
    # More than there are: all others.
    assert len(ask(client, boxes[:3], want={"nearest": 100})["result"]["nearest"][0]) == 2


def test_within(client, boxes):
    job = ask(client, boxes, want={"within": 2.5})
    assert job["result"]["verdicts"] == {"within": 7, "beyond": 8, "undecided": 0}
    check_rows(rows_of(client, job), SHIFTS)
    assert job["result"]["searched_pairs"] < 15
    # Every box is far from every other one: their own boxes say so.
    result = ask(client, [boxes[0], boxes[4]], want={"within": 7})["result"]
    assert result["searches"] == 0 and result["verdicts"]["beyond"] == 1


def test_as_csv_and_binary(client, boxes):
    job = ask(client, boxes)
    rows, path = rows_of(client, job), f"/v1/jobs/{job['id']}/result"
    for reply in (client.get(path, headers={"Accept": "text/csv"}), client.get(path, params={"format": "csv"})):
        assert reply.headers["content-type"].startswith("text/csv")
        header, *lines = reply.text.splitlines()
        assert header == "a,b,lower,upper"
        assert [[float(word) for word in line.split(",")] for line in lines] == rows
    reply = client.get(path, params={"format": "binary"})
    assert reply.headers["content-type"] == "application/octet-stream"
    assert [list(row) for row in struct.iter_unpack("<4d", reply.content)] == rows
    assert client.get(path, params={"format": "json"}, headers={"Accept": "text/csv"}).json()["pairs"] == rows
    check_problem(client.get(path, params={"format": "xml"}), 400, "invalid_parameter")


def test_the_answer_is_kept_and_found(client, boxes):
    first, second = ask(client, boxes, want={"nearest": 1}), ask(client, boxes, want={"nearest": 1})
    assert second["cached"] is True and second["id"] == first["id"]
    assert rows_of(client, second) == rows_of(client, first)
    assert first["id"] in [job["id"] for job in client.get("/v1/jobs", params={"mesh": boxes[5]}).json()["jobs"]]
    assert first["id"] in [job["id"] for job in client.get("/v1/jobs", params={"type": "matrix"}).json()["jobs"]]


def test_a_deformed_mesh_asks_anew(client):
    ids = [client.upload(shapes.cube(origin=(i, 0, 0)), name="moves")["id"] for i in range(3)]
    first = ask(client, ids)
    vertices = [(x + 16, y, z) for x, y, z in shapes.cube()[0]]
    assert client.patch(f"/v1/meshes/{ids[0]}/vertices", json={"positions": vertices}).status_code == 200
    second = ask(client, ids)
    assert second["id"] != first["id"]
    check_rows(rows_of(client, second), [(16, 0, 0), (1, 0, 0), (2, 0, 0)])


@pytest.mark.parametrize("fields, pointer", [
    ({"meshes": []}, "/meshes"),
    ({"meshes": ["m_a"]}, "/meshes"),
    ({"meshes": ["m_a"] * 1001}, "/meshes"),
    ({"meshes": "m_a"}, "/meshes"),
    ({"meshes": ["m_a", 7]}, "/meshes/1"),
    ({"meshes": ["m_a", ""]}, "/meshes/1"),
    ({"meshes": ["m_a", "m b"]}, "/meshes/1"),
    ({"meshes": ["m_a", "x" * 40]}, "/meshes/1"),
    ({}, "/meshes"),
    ({"meshes": ["m_a", "m_b"], "want": "some"}, "/want"),
    ({"meshes": ["m_a", "m_b"], "want": {}}, "/want"),
    ({"meshes": ["m_a", "m_b"], "want": {"nearest": 0}}, "/want"),
    ({"meshes": ["m_a", "m_b"], "want": {"nearest": 1.5}}, "/want"),
    ({"meshes": ["m_a", "m_b"], "want": {"nearest": 101}}, "/want"),
    ({"meshes": ["m_a", "m_b"], "want": {"within": -1}}, "/want"),
    ({"meshes": ["m_a", "m_b"], "want": {"within": None}}, "/want"),
    ({"meshes": ["m_a", "m_b"], "want": {"nearest": 1, "within": 1}}, "/want"),
    ({"meshes": ["m_a", "m_b"], "want": {"farthest": 1}}, "/want"),
    ({"meshes": ["m_a", "m_b"], "measure": "mean"}, "/measure"),
    ({"meshes": ["m_a", "m_b"], "gap": 0}, "/gap"),
    ({"meshes": ["m_a", "m_b"], "a": "m_a"}, "/a"),
])
def test_wrong_requests(client, fields, pointer):
    problem = check_problem(client.post("/v1/jobs", json={"type": "matrix", **fields}), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == pointer


def test_a_mesh_that_is_missing_is_named(client, boxes):
    problem = check_problem(client.post("/v1/jobs", json={"type": "matrix", "meshes": [*boxes, "m_none"]}), 404,
                            "mesh_not_found")
    assert problem["errors"][0]["pointer"] == "/meshes/6"


def test_meshes_by_the_hash_of_their_file(client):
    data = [shapes.obj(shapes.cube(origin=(shift, 0, 0))) for shift in (0.125, 3.125, 7.125)]
    ids = [client.upload(text, name="by hash")["id"] for text in data]
    names = ["sha256:" + hashlib.sha256(text).hexdigest() for text in data]
    job = ask(client, [names[0], ids[1], names[2]])
    assert job["result"]["meshes"] == ids
    check_rows(rows_of(client, job), [(0, 0, 0), (3, 0, 0), (7, 0, 0)])
    missing = "sha256:" + "0" * 64
    problem = check_problem(client.post("/v1/jobs", json={"type": "matrix", "meshes": [*names, missing]}), 404,
                            "mesh_not_found")
    assert problem["errors"][0]["pointer"] == "/meshes/3"


def test_moved_meshes(client):
    mesh, shifts = client.upload(shapes.cube(), name="moved in a set")["id"], [(0, 0, 0), (0, 3, 0), (0, 3, 0), (7, 0, 0)]
    at = [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *shift, 1] for shift in shifts]
    named = [mesh, *({"mesh": mesh, "transform": transform} for transform in at[1:])]
    job = ask(client, named)
    assert job["result"]["meshes"] == named
    rows = rows_of(client, job)
    check_rows(rows, shifts)
    assert rows[3][2:] == [0, 0]  # the same mesh at the same place twice
    again = ask(client, [{"mesh": mesh, "transform": at[0]}, *named[1:]])
    assert rows_of(client, again) == rows
    at[3][5] = 0
    problem = check_problem(client.post("/v1/jobs", json={"type": "matrix", "meshes": named}), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == "/meshes/3/transform"
    at[3][5] = "1"
    problem = check_problem(client.post("/v1/jobs", json={"type": "matrix", "meshes": named}), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == "/meshes/3/transform/5"


def test_meshes_of_different_units_are_refused(client):
    ids = [client.upload(shapes.cube(origin=(shift, 5, 0)), name="in a unit")["id"] for shift in range(4)]
    for mesh, unit in ((ids[1], "mm"), (ids[3], "m")):
        assert client.patch(f"/v1/meshes/{mesh}", json={"unit": unit}).status_code == 200
    problem = check_problem(client.post("/v1/jobs", json={"type": "matrix", "meshes": ids}), 422, "units_differ")
    assert problem["errors"][0]["pointer"] == "/meshes/3"
    assert ask(client, ids[:3])["state"] == "succeeded"


def test_sizes_beyond_precision_have_their_boxes(client):
    tiny, huge, other = (client.upload(shapes.cube(side=side))["id"] for side in (1e-200, 1e200, 2e200))
    job = ask(client, [tiny, huge, other])
    for a, b, lower, upper in rows_of(client, job):
        assert 0 < lower < upper
    check = ask(client, [tiny, tiny])
    assert rows_of(client, check) == [[0, 1, 0, 0]]


@pytest.mark.parametrize("gap", [1e308, 5e-324])
@pytest.mark.parametrize("kind", ["matrix", "distance", "hausdorff"])
def test_a_gap_of_any_size(client, kind, gap):
    """A share of a diagonal may be no number above 0: the nearest double that is one stands for it."""
    ids = [client.upload(shapes.cube(side=side, origin=(x, 0, 0)))["id"] for x, side in ((0, 0.25), (3, 0.25))]
    ids += [client.upload(shapes.cube(side=1e9, origin=(x, 0, 0)))["id"] for x in (0, 3e9)]
    for pair in (ids[:2], ids[2:]):
        named = {"meshes": pair} if kind == "matrix" else dict(zip("ab", pair))
        reply = client.post("/v1/jobs", json={"type": kind, **named, "gap": gap}, headers={"Prefer": WAIT})
        result = reply.json()["result"]
        assert result["gap"] > 0
        if kind != "matrix":
            assert result["lower"] <= result["upper"] < math.inf


def test_points_and_surfaces(client):
    points = [client.upload(b"%d 0 0\n%d 1 0\n%d 0 3\n" % (x, x, x), format="xyz")["id"] for x in range(3)]
    rows = rows_of(client, ask(client, points))
    check_rows(rows, [(x, 0, 0) for x in range(3)])


def test_events_and_cancelation(client, many):
    request = {"type": "matrix", "meshes": many, "gap": 1e-12, "threads": 1, "quads": "bilinear"}
    with client.stream("POST", "/v1/jobs", json=request, headers={"Accept": "application/x-ndjson"}) as reply:
        for line in reply.iter_lines():
            event = json.loads(line)
            if event["event"] == "pairs" or event["event"] in ("result", "error"):
                break
        assert event["event"] == "pairs", event
        assert 0 < event["searched_pairs"] <= event["pair_count"] == 2415 and len(event["pairs"]) >= 1
        job = client.get("/v1/jobs", params={"type": "matrix", "state": "running"}).json()["jobs"][0]
        assert client.delete(f"/v1/jobs/{job['id']}").status_code == 202
    ended = client.wait(job["id"])
    assert ended["state"] == "canceled" and ended["result"]["stopped_by"] == "canceled"
    rows = rows_of(client, ended)
    assert len(rows) == 2415 and all(lower <= upper for *_, lower, upper in rows)
    for a, b, lower, upper in event["pairs"]:
        at = [row for row in rows if row[:2] == [a, b]][0]
        assert lower <= at[2] and at[3] <= upper  # from one event to the next they only come closer


def test_a_deadline_keeps_the_intervals(client, many):
    fields = {"gap": 1e-12, "deadline_ms": 200, "threads": 1, "quads": "bilinear"}
    job = ask(client, many, **fields)
    assert job["state"] == "succeeded" and job["result"]["stopped_by"] == "deadline", job
    assert job["result"]["open"] > 0 and job["result"]["converged"] is False
    assert len(rows_of(client, job)) == 2415
    assert ask(client, many, **fields)["id"] != job["id"]


def test_a_set_that_does_not_fit_in_memory(make_daemon):
    running = make_daemon("--memory-budget", 16 * 2**20)
    with running.client() as client:
        ids = []
        vertices, faces = shapes.sphere(parallels=60, meridians=120)
        for i in range(12):
            ids.append(client.upload(([(x + i, y, z) for x, y, z in vertices], faces), name=f"{i}")["id"])
        all_bytes = sum(client.get(f"/v1/meshes/{id}").json()["memory_bytes"] for id in ids)
        assert all_bytes > 16 * 2**20 / 1.5, all_bytes
        assert gauge(client, "meshes_loaded") < 12
        job = ask(client, ids, want={"nearest": 1}, gap=1e-3)
        assert job["state"] == "succeeded", job
        for a, b, lower, upper in rows_of(client, job):
            assert lower <= abs(a - b) + 1e-9 and abs(a - b) <= upper + 1e-9
        for place, one in enumerate(job["result"]["nearest"]):
            assert abs(one[0]["mesh"] - place) == 1


def test_lines_of_a_batch(client, boxes):
    lines = [json.dumps({"key": 1, "type": "matrix", "meshes": boxes[:3], "want": {"nearest": 1}}),
             json.dumps({"key": 2, "type": "matrix", "meshes": ["m_none", boxes[0]]})]
    reply = client.post("/v1/batches", content="\n".join(lines), headers={"Content-Type": "application/x-ndjson"})
    answers = {line["key"]: line for line in map(json.loads, reply.text.splitlines()) if "key" in line}
    assert answers[1]["state"] == "succeeded" and answers[1]["result"]["nearest"][0][0]["mesh"] == 1
    assert answers[2]["problem"]["code"] == "mesh_not_found"


def test_an_unfinished_matrix_runs_again_after_a_kill(make_daemon):
    running = make_daemon()
    with running.client() as client:
        ids = [client.upload(shapes.rough(24, seed))["id"] for seed in range(10)]
        reply = client.post("/v1/jobs", json={"type": "matrix", "meshes": ids, "gap": 1e-9})
        assert reply.status_code == 202
    running.process.kill()
    running.process.wait()
    running.start()
    with running.client() as client:
        job = client.wait(reply.json()["id"])
        assert job["state"] == "succeeded" and len(rows_of(client, job)) == 45
