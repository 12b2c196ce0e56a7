"""Where surfaces meet and how far they are apart: known pairs, definitions, bounds, and all pairs as rows."""
import math
import random
import struct
import time

import pytest

import shapes
from conftest import SLOW, WAIT, check_problem

FLOOR = ([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)], [(0, 1, 2, 3)])
# A wall of two quads through the middle of the floor, the second above it.
WALL = ([(1, -1, -1), (1, 3, -1), (1, 3, 1), (1, -1, 1), (1, 3, 2), (1, -1, 2)], [(0, 1, 2, 3), (3, 2, 4, 5)])


def ask(client, kind, headers=(), **fields):
    reply = client.post("/v1/jobs", json={"type": kind, **fields}, headers={"Prefer": WAIT, **dict(headers)})
    assert reply.status_code == 200, reply.text
    job = reply.json()
    assert job["state"] == "succeeded", job
    return job


@pytest.fixture(scope="module")
def pair(daemon):
    with daemon.client() as made:
        return made.upload(FLOOR, name="floor")["id"], made.upload(WALL, name="wall")["id"]


def grid(columns, rows, at):
    vertices = [at(i, j) for i in range(columns + 1) for j in range(rows + 1)]
    corner = lambda i, j: i * (rows + 1) + j
    faces = [(corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1))
             for i in range(columns) for j in range(rows)]
    return vertices, faces


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_wall_meets_the_floor(client, pair, quads):
    job = ask(client, "collision", a=pair[0], b=pair[1], quads=quads)
    assert job["request"]["mode"] == "all" and job["request"]["limit"] == 1000
    result = job["result"]
    assert result["collides"] is True and result["count"] == 1 and result["quads"] == quads
    (found,) = result["pairs"]
    assert found["faces"] == [0, 0]
    assert found["contact"] == ("segment" if quads == "triangles" else "point")
    for point in found["points"]:
        assert point[0] == pytest.approx(1) and point[2] == pytest.approx(0, abs=1e-5) and 0 <= point[1] <= 2
    assert ("gap" in result) == (quads == "bilinear")


@pytest.mark.parametrize("mode", ["first", "any"])
def test_one_pair_is_enough(client, pair, mode):
    result = ask(client, "collision", a=pair[0], b=pair[1], mode=mode)["result"]
    assert result["count"] == 1 and result["mode"] == mode and result["pairs"][0]["faces"] == [0, 0]


def test_all_pairs_come_as_rows(client):
    """Two grids crossing at a right angle along x = 0.5: each face of the column meets its neighbours' too."""
    flat = client.upload(grid(1, 40, lambda i, j: (i, j, 0)))["id"]
    upright = client.upload(grid(1, 40, lambda i, j: (0.5, j, i - 0.5)))["id"]
    job = ask(client, "collision", a=flat, b=upright, limit=5)
    expected = [[i, j] for i in range(40) for j in range(max(i - 1, 0), min(i + 2, 40))]
    result = job["result"]
    assert result["count"] == len(expected)
    assert [row["faces"] for row in result["pairs"]] == expected[:5] and "all_pairs" not in result
    path = f"/v1/jobs/{job['id']}/result"
    whole = client.get(path)
    assert whole.json()["all_pairs"] == expected and whole.json()["count"] == len(expected)
    rows = client.get(path, headers={"Accept": "application/octet-stream"}).content
    assert struct.unpack(f"<{2 * len(expected)}d", rows) == tuple(float(x) for row in expected for x in row)
    text = client.get(path, headers={"Accept": "text/csv"}).text
    assert text == "face_a,face_b\n" + "".join(f"{a},{b}\n" for a, b in expected)


def test_none_is_an_answer_too(client, pair):
    far = client.upload(([(9, 9, 9), (10, 9, 9), (9, 10, 9)], [(0, 1, 2)]))["id"]
    job = ask(client, "collision", a=pair[0], b=far)
    assert job["result"]["collides"] is False and job["result"]["count"] == 0 and job["result"]["pairs"] == []
    path = f"/v1/jobs/{job['id']}/result"
    assert client.get(path, headers={"Accept": "text/csv"}).text == "face_a,face_b\n"
    assert client.get(path).json()["all_pairs"] == []


FOLDS = {
    # name: (mesh, pairs)
    "a flat grid": (grid(4, 4, lambda i, j: (i, j, 0)), 0),
    "folded by a right angle": (([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1, 2), (1, 0, 3)]), 0),
    "folded down in its plane": (([(0, 0, 0), (2, 0, 0), (0, 2, 0), (1, 1, 0)], [(0, 1, 2), (1, 0, 3)]), 1),
    "through a neighbour at a corner": (
        ([(0, 0, 0), (2, 0, 0), (0, 2, 0), (1, 0.5, -1), (1, 0.5, 1)], [(0, 1, 2), (0, 3, 4)]), 1),
    "touching a neighbour's neighbour": (
        ([(0, 0, 0), (2, 0, 0), (0, 2, 0), (0.5, 0.5, 0), (0.5, 0.5, 1), (1, 1, 1)], [(0, 1, 2), (3, 4, 5)]), 1),
    "the same triangle twice": (([(0, 0, 0), (2, 0, 0), (0, 2, 0)], [(0, 1, 2), (2, 1, 0)]), 1),
    "a segment twice": (([(0, 0, 0), (2, 0, 0), (1, 0, 0)], [(0, 1, 2), (2, 1, 0)]), 0),
    "a quad folded over its own diagonal": (
        ([(0, 0, 0), (2, 0, 0), (1, 1, 0), (2, 0.5, 0)], [(0, 1, 2, 3)]), 0),
    "not welded": (
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(0, 1, 2), (3, 5, 4)]), 1),
}


@pytest.mark.parametrize("name", FOLDS)
def test_what_counts_as_self_collision(client, name):
    mesh, pairs = FOLDS[name]
    result = ask(client, "self_collision", mesh=client.upload(mesh)["id"])["result"]
    assert result["count"] == pairs and result["collides"] is (pairs > 0)
    assert [row["faces"] for row in result["pairs"]] == [[0, 1]] * pairs


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_mesh_against_itself_as_two(client, quads):
    """Neighbours have an edge or a corner in common, which is a contact of two meshes; each contact has its points."""
    mesh = client.upload(shapes.rough(2, seed=1), name="both")["id"]
    result = ask(client, "collision", a=mesh, b=mesh, quads=quads)["result"]
    assert result["count"] == 16  # of four quads around one vertex, each with each, and with itself
    for pair in result["pairs"]:
        assert all(isinstance(number, float | int) for point in pair["points"] for number in point)


def test_incremental_is_a_full_run_while_nothing_has_moved(client, pair):
    job = ask(client, "self_collision", mesh=pair[1], incremental=True)
    assert job["request"]["incremental"] is True and job["result"]["incremental"] is False
    assert job["result"]["count"] == 0


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_least_distance(client, pair, quads):
    above = client.upload(([(0, 0, 0.5), (1, 0, 0.75), (1, 1, 1), (0, 1, 0.75)], [(0, 1, 2, 3)]))["id"]
    job = ask(client, "distance", a=pair[0], b=above, quads=quads, tolerance=1e-9, tolerance_unit="absolute")
    result = job["result"]
    assert result["lower"] <= 0.5 <= result["upper"] and result["converged"] is True
    assert result["upper"] - result["lower"] <= 1e-9
    assert result["lower_relative"] == pytest.approx(0.5 / math.sqrt(8))
    assert result["collides"] is False and result["quads"] == quads
    start, end = result["witness"]["from"], result["witness"]["to"]
    assert start["mesh"] == "a" and start["id"] == pair[0] and end["mesh"] == "b" and end["id"] == above
    assert start["point"] == pytest.approx([0, 0, 0], abs=1e-6) and end["point"] == pytest.approx([0, 0, 0.5], abs=1e-6)


def test_surfaces_that_meet_are_at_distance_zero(client, pair):
    result = ask(client, "distance", a=pair[0], b=pair[1])["result"]
    assert result["lower"] == 0 and result["upper"] == 0 and result["collides"] is True
    assert result["witness"]["from"]["point"] == pytest.approx(result["witness"]["to"]["point"])


@pytest.mark.parametrize("fields, pointer", [
    ({"mode": "some"}, "/mode"),
    ({"limit": -1}, "/limit"),
    ({"limit": 1e9}, "/limit"),
    ({"tolerance": 0}, "/tolerance"),
    ({"incremental": True}, "/incremental"),
    ({"accelerator": "grid"}, "/accelerator"),
])
def test_bad_fields_are_named(client, pair, fields, pointer):
    reply = client.post("/v1/jobs", json={"type": "collision", "a": pair[0], "b": pair[1], **fields})
    problem = check_problem(reply, 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == pointer


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_incremental_after_deformations_is_a_full_run(client, request, quads):
    # A sheet whose rows are drawn through one another step by step.
    chance = random.Random(7)
    vertices, faces = shapes.saddle(12)
    mesh = client.upload(shapes.obj((vertices, faces)), name=request.node.name, format="obj")["id"]
    fields = {"mesh": mesh, "quads": quads, "tolerance": 1e-6, "tolerance_unit": "absolute"}
    ask(client, "self_collision", **fields)
    found = 0
    for _ in range(6):
        moved = chance.sample(range(len(vertices)), 5)
        places = [[x + chance.uniform(-0.5, 0.5) for x in vertices[i]] for i in moved]
        reply = client.patch(f"/v1/meshes/{mesh}/vertices", json={"indices": moved, "positions": places})
        assert reply.status_code == 200, reply.text
        some = ask(client, "self_collision", incremental=True, **fields)["result"]
        every = ask(client, "self_collision", **fields)["result"]
        assert some["incremental"] is True and every["incremental"] is False
        assert [pair["faces"] for pair in some["pairs"]] == [pair["faces"] for pair in every["pairs"]]
        found += some["count"]
    assert found > 0


def test_incremental_while_another_job_holds_the_mesh(client, slow_files):
    """A revision that is made beside the one in use knows the pairs, too."""
    mesh, other = (client.upload(content, name="held")["id"] for content in slow_files)
    ask(client, "self_collision", mesh=mesh)
    running = client.start(mesh, other, **SLOW)
    while client.get(f"/v1/jobs/{running['id']}").json()["state"] == "queued":
        time.sleep(0.01)
    reply = client.patch(f"/v1/meshes/{mesh}/vertices", json={"indices": [3], "positions": [[0.5, 0.5, 0.5]]})
    assert reply.status_code == 200, reply.text
    some = ask(client, "self_collision", mesh=mesh, incremental=True)["result"]
    assert client.delete(f"/v1/jobs/{running['id']}").status_code == 202
    every = ask(client, "self_collision", mesh=mesh)["result"]
    assert some["incremental"] is True and every["incremental"] is False
    assert some["count"] == every["count"] > 0 and some["pairs"] == every["pairs"]


def relation(client, a, b, **fields):
    job = client.post("/v1/jobs", json={"type": "collision", "a": a, "b": b, "solid": True, **fields},
                      headers={"Prefer": WAIT}).json()
    assert job["state"] == "succeeded", job
    return job["result"]


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_solids_are_told_apart(client, quads):
    cube, small, far, through = (client.upload(shapes.cube(side, (at, at, at)))["id"]
                                 for side, at in ((1, 0), (0.5, 0.25), (1, 3), (1, 0.75)))
    assert relation(client, small, cube, quads=quads)["relation"] == "a_inside_b"
    assert relation(client, cube, small, quads=quads)["relation"] == "b_inside_a"
    assert relation(client, cube, far, quads=quads)["relation"] == "apart"
    found = relation(client, cube, through, quads=quads, penetration=True)
    assert found["relation"] == "meeting" and found["collides"] is True
    for name, other in (("a_in_b", cube), ("b_in_a", through)):
        depth = found["penetration"][name]
        assert depth["lower"] <= 0.25 <= depth["upper"] <= depth["lower"] + 1e-5
        assert depth["witness"]["from"]["id"] == other
    deep = relation(client, small, cube, quads=quads, penetration=True)["penetration"]
    assert deep["a_in_b"]["lower"] <= 0.25 <= deep["a_in_b"]["upper"] and deep["b_in_a"]["upper"] == 0
    vertices, faces = shapes.cube(0.5)
    for fields in ({"solid": True}, {"penetration": True}):
        job = client.post("/v1/jobs", json={"type": "collision", "a": client.upload((vertices, faces[:-1]))["id"], "b": cube,
                                            **fields}, headers={"Prefer": WAIT}).json()
        assert job["problem"]["code"] == "not_closed" and "mesh A" in job["problem"]["detail"]


def test_contacts_have_normals(client):
    floor = client.upload(([(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)], [(0, 1, 2, 3)]))["id"]
    wall = client.upload(([(1, -1, -1), (1, 3, -1), (1, 3, 1), (1, -1, 1)], [(0, 1, 2, 3)]))["id"]
    for quads in ("triangles", "bilinear"):
        job = client.post("/v1/jobs", json={"type": "collision", "a": floor, "b": wall, "quads": quads},
                          headers={"Prefer": WAIT}).json()
        for pair in job["result"]["pairs"]:
            assert pair["normals"][0] == pytest.approx([0, 0, 1]) and pair["normals"][1] == pytest.approx([1, 0, 0])


def test_a_clearance_has_a_verdict(client):
    a, b = (client.upload(shapes.cube(1, (at, 0, 0)))["id"] for at in (0, 3))
    for limit, verdict in ((1, "above"), (2.5, "below"), (None, None)):
        for name in ("limit", "threshold"):
            job = client.post("/v1/jobs", json={"type": "distance", "a": a, "b": b, name: limit}, headers={"Prefer": WAIT}).json()
            assert job["result"]["verdict"] == verdict
            assert job["result"]["lower"] <= 2 <= job["result"]["upper"]
            assert job["request"].get("limit") == limit
    problem = client.post("/v1/jobs", json={"type": "distance", "a": a, "b": b, "limit": -1}).json()
    assert problem["errors"][0]["pointer"] == "/limit"
