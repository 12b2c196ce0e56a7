"""Alignment: a motion that is known, found again; and poses: a moved mesh wherever a job names one, and kept as a copy."""
import math
import random

import pytest

from conftest import WAIT, check_problem

IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def lump(columns=24, rows=16):
    """A closed surface without a symmetry, of quads."""
    def at(i, j):
        a, b = 2 * math.pi * i / columns, math.pi * (0.02 + 0.96 * j / rows)
        r = 1 + 0.3 * math.sin(b) * math.cos(a + 0.4) + 0.2 * math.cos(3 * b) + 0.15 * math.sin(2 * a) * math.sin(b) ** 2
        return (1.6 * r * math.sin(b) * math.cos(a), r * math.sin(b) * math.sin(a), 0.8 * r * math.cos(b))

    vertices = [at(i, j) for i in range(columns) for j in range(rows + 1)]
    corner = lambda i, j: (i % columns) * (rows + 1) + j
    faces = [(corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1))
             for i in range(columns) for j in range(rows)]
    return vertices, faces


def motion(seed, reach=5.0, scale=1.0):
    """A random turn and shift, column by column."""
    draw = random.Random(seed)
    q = [draw.gauss(0, 1) for _ in range(4)]
    w, x, y, z = (c / math.sqrt(sum(c * c for c in q)) for c in q)
    columns = [(1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
               (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
               (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))]
    shift = [draw.uniform(-reach, reach) for _ in range(3)]
    return [n for column in columns for n in (*(scale * c for c in column), 0)] + [*shift, 1]


def move(m, p):
    return tuple(m[k] * p[0] + m[4 + k] * p[1] + m[8 + k] * p[2] + m[12 + k] for k in range(3))


def moved(mesh, m):
    return [move(m, p) for p in mesh[0]], mesh[1]


def error(mesh, at, transform):
    """How far the transform leaves the vertices of a mesh from their places."""
    return max(math.dist(move(transform, p), q) for p, q in zip(mesh[0], at[0]))


def ask(client, kind, headers=(), **fields):
    reply = client.post("/v1/jobs", json={"type": kind, **fields}, headers={"Prefer": WAIT, **dict(headers)})
    assert reply.status_code == 200, reply.text
    job = reply.json()
    assert job["state"] == "succeeded", job
    return job


@pytest.fixture(scope="module")
def part(daemon):
    with daemon.client() as made:
        return made.upload(lump(), name="part")["id"]


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_motion_is_found(client, part, quads):
    shape = lump()
    scan = moved(shape, motion(1))
    job = ask(client, "alignment", a=client.upload(scan)["id"], b=part, quads=quads, samples=1000)
    result = job["result"]
    assert error(scan, shape, result["transform"]) < 1e-9
    assert result["rms"] < 1e-9 and result["hausdorff"]["upper"] < 1e-5 and result["hausdorff"]["converged"]
    assert result["floor"] < 1e-12 and result["scale"] == 1 and result["mirrored"] is False and result["converged"]
    assert result["certainty"]["runner_up_rms"] > 0.01
    assert job["request"]["fit"] == "least_squares" and job["request"]["start"] == "principal"
    assert job["request"]["motion"] == "rigid" and job["request"]["samples"] == 1000
    assert "trim" not in job["request"] and "landmarks" not in job["request"]


def test_scale_landmarks_and_mirror_images(client, part):
    shape = lump()
    m = motion(2, scale=0.25)
    small = moved(shape, m)
    a = client.upload(small)["id"]
    result = ask(client, "alignment", a=a, b=part, motion="rigid_scale", samples=1000)["result"]
    assert error(small, shape, result["transform"]) < 1e-8 and result["scale"] == pytest.approx(4)
    assert result["floor"] is None
    pairs = [[small[0][i], shape[0][i]] for i in (3, 100, 250)]
    job = ask(client, "alignment", a=a, b=part, motion="rigid_scale", start="landmarks", landmarks=pairs, samples=1000)
    assert error(small, shape, job["result"]["transform"]) < 1e-8
    assert job["result"]["certainty"]["runner_up_rms"] is None
    assert len(job["request"]["landmarks"]) == 3
    image = [(-x, y, z) for x, y, z in shape[0]], shape[1]
    b = client.upload(image)["id"]
    assert ask(client, "alignment", a=b, b=part, samples=1000)["result"]["rms"] > 0.005
    result = ask(client, "alignment", a=b, b=part, mirror=True, samples=1000)["result"]
    assert result["mirrored"] is True and error(image, shape, result["transform"]) < 1e-9


def test_min_max_reaches_the_floor(client):
    box = lambda s: ([(s * x, 2 * s * y, 3 * s * z) for x in (0, 1) for y in (0, 1) for z in (0, 1)],
                     [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    a, b = client.upload(box(1.0))["id"], client.upload(box(1.2))["id"]
    result = ask(client, "alignment", a=a, b=b, fit="min_max", samples=1000)["result"]
    truth = 0.1 * math.sqrt(14)
    assert result["floor"] == pytest.approx(truth, rel=1e-12) and result["floor"] <= truth
    assert truth * (1 - 1e-12) <= result["hausdorff"]["upper"] <= truth * 1.01
    assert result["rounds"] >= 1


def test_a_pose_is_the_moved_mesh(client, part):
    """Of each kind: the mesh with its pose answers as an upload of the moved file does, to the last bit."""
    shape, m = lump(), motion(3, reach=0.1)
    other = client.upload(moved(shape, motion(4, reach=0.1)), name="other")["id"]
    fixed = client.upload(moved(shape, m), name="moved")["id"]
    posed = {"mesh": part, "transform": m}
    for kind, fields in [("hausdorff", {}), ("hausdorff", {"quads": "bilinear"}), ("deviation", {"bins": 5}),
                         ("distance", {}), ("collision", {"limit": 3})]:
        expected = ask(client, kind, a=fixed, b=other, **fields)["result"]
        job = ask(client, kind, a=posed, b=other, **fields)
        assert job["request"]["a"] == posed
        got = job["result"]
        for name in ("lower", "upper", "count", "mean", "max"):
            if name in expected:
                assert got[name] == expected[name], (kind, name)
        back = ask(client, kind, a=other, b=posed, **fields)
        assert back["request"]["b"] == posed
    assert ask(client, "self_collision", mesh=posed)["result"]["count"] == 0
    foot = ask(client, "project", mesh=posed, points=[[0, 0, 9]])["result"]["points"][0]
    assert foot == ask(client, "project", mesh=fixed, points=[[0, 0, 9]])["result"]["points"][0]


def test_a_pose_is_part_of_the_question(client, part):
    m = motion(5)
    first = ask(client, "hausdorff", a={"mesh": part, "transform": m}, b=part)
    again = ask(client, "hausdorff", a={"mesh": part, "transform": m}, b=part)
    assert again["id"] == first["id"] and again["cached"] is True
    here = ask(client, "hausdorff", a=part, b=part)
    assert here["result"]["upper"] == 0 and here["id"] != first["id"] and first["result"]["lower"] > 0
    # The map that moves nothing is no other question, and a mesh is at no distance from itself at one place.
    still = ask(client, "hausdorff", a={"mesh": part, "transform": IDENTITY}, b=part)
    assert still["id"] == here["id"] and still["request"]["a"] == part
    both = ask(client, "hausdorff", a={"mesh": part, "transform": m}, b={"mesh": part, "transform": m})
    assert both["result"]["upper"] == 0


def test_an_alignment_is_a_pose(client, part):
    scan = moved(lump(), motion(6))
    a = client.upload(scan)["id"]
    result = ask(client, "alignment", a=a, b=part, samples=1000)["result"]
    left = ask(client, "hausdorff", a={"mesh": a, "transform": result["transform"]}, b=part)["result"]
    assert left["lower"] <= result["hausdorff"]["upper"] and result["hausdorff"]["lower"] <= left["upper"]
    posed = {"mesh": part, "transform": motion(7)}
    result = ask(client, "alignment", a=a, b=posed, samples=1000)["result"]
    assert error(scan, moved(lump(), motion(7)), result["transform"]) < 1e-9


def test_a_pose_follows_the_revision(client):
    mesh = ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    a, b = client.upload(mesh, name="follows")["id"], client.upload(mesh, name="stays")["id"]
    up = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1]
    question = dict(a={"mesh": a, "transform": up}, b=b)
    assert ask(client, "hausdorff", **question)["result"]["upper"] == pytest.approx(1, abs=1e-5)
    reply = client.patch(f"/v1/meshes/{a}/vertices", json={"positions": [[0, 0, 1], [1, 0, 1], [0, 1, 1]]})
    assert reply.status_code == 200
    assert ask(client, "hausdorff", **question)["result"]["upper"] == pytest.approx(2, abs=1e-5)
    assert client.delete(f"/v1/meshes/{a}").status_code == 204
    check_problem(client.post("/v1/jobs", json={"type": "hausdorff", **question}), 404, "mesh_not_found")


@pytest.mark.parametrize("transform, place", [
    ([1] * 15, "/a/transform"), ("x", "/a/transform"), (None, "/a/transform"),
    ([*IDENTITY[:5], None, *IDENTITY[6:]], "/a/transform/5"),
    ([*IDENTITY[:5], "1", *IDENTITY[6:]], "/a/transform/5"),
    ([*IDENTITY[:3], 0.5, *IDENTITY[4:]], "/a/transform"),
    ([*IDENTITY[:15], 2], "/a/transform"),
    ([*IDENTITY[:5], 0, *IDENTITY[6:]], "/a/transform"),
    ([1, 2, 3, 0, 2, 4, 6, 0, 0, 0, 1, 0, 0, 0, 0, 1], "/a/transform"),
])
def test_a_transform_that_cannot_be_is_refused_with_its_place(client, part, transform, place):
    reply = client.post("/v1/jobs", json={"type": "hausdorff", "a": {"mesh": part, "transform": transform}, "b": part})
    problem = check_problem(reply, 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == place, problem


def test_numbers_that_json_does_not_have(client, part):
    for number in ("NaN", "1e999", "-Infinity"):
        body = '{"type":"hausdorff","a":{"mesh":"%s","transform":[%s%s]},"b":"%s"}' % (part, number, ",0" * 15, part)
        reply = client.post("/v1/jobs", content=body, headers={"Content-Type": "application/json"})
        check_problem(reply, 400)


@pytest.mark.parametrize("a, place", [
    ({"mesh": "m_x"}, "/a/transform"), ({"transform": IDENTITY}, "/a/mesh"), ({}, "/a/mesh"), (7, "/a"), ([], "/a"),
    ({"mesh": 7, "transform": IDENTITY}, "/a/mesh"), ({"mesh": "m_x", "transform": IDENTITY, "scale": 2}, "/a"),
])
def test_a_pose_that_is_none(client, part, a, place):
    problem = check_problem(client.post("/v1/jobs", json={"type": "distance", "a": a, "b": part}), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == place, problem


def test_a_mesh_that_overflows_when_it_is_moved(client, part):
    huge = [1e308, 0, 0, 0, 0, 1e308, 0, 0, 0, 0, 1e308, 0, 0, 0, 0, 1]
    job = client.post("/v1/jobs", json={"type": "hausdorff", "a": {"mesh": part, "transform": huge}, "b": part},
                      headers={"Prefer": WAIT}).json()
    assert job["state"] == "failed" and job["problem"]["code"] == "not_finite"
    assert client.get("/v1/info").status_code == 200


@pytest.mark.parametrize("fields, place", [
    ({"fit": "best"}, "/fit"), ({"start": "random"}, "/start"), ({"motion": "affine"}, "/motion"),
    ({"trim": 0.95}, "/trim"), ({"trim": -1}, "/trim"), ({"max_distance": 0}, "/max_distance"),
    ({"mirror": 1}, "/mirror"), ({"samples": 5}, "/samples"), ({"landmarks": [[[0, 0, 0]]]}, "/landmarks/0"),
    ({"landmarks": [[[0, 0, 0], [0, 0]]]}, "/landmarks/0/1"), ({"landmarks": [[[0, 0, 0], [0, 0, 0]]] * 33}, "/landmarks"),
    ({"threshold": 1}, "/threshold"),
])
def test_fields_that_cannot_be(client, part, fields, place):
    reply = client.post("/v1/jobs", json={"type": "alignment", "a": part, "b": part, **fields})
    assert check_problem(reply, 400, "invalid_field")["errors"][0]["pointer"] == place


@pytest.mark.parametrize("fields, place", [
    ({"start": "landmarks"}, "/landmarks"), ({"start": "landmarks", "landmarks": [[[0, 0, 0], [0, 0, 0]]] * 2}, "/landmarks"),
    ({"motion": "rigid_scale", "direction": "a_to_b"}, "/direction"), ({"fit": "min_max", "trim": 0.1}, "/trim"),
    ({"fit": "min_max", "max_distance": 1}, "/max_distance"),
])
def test_fields_that_do_not_go_together(client, part, fields, place):
    reply = client.post("/v1/jobs", json={"type": "alignment", "a": part, "b": part, **fields})
    assert check_problem(reply, 400, "invalid_field")["errors"][0]["pointer"] == place


def test_landmarks_on_a_line(client, part):
    """Which only the engine sees."""
    line = [[[x, 0, 0], [x, 0, 0]] for x in range(3)]
    job = client.post("/v1/jobs", json={"type": "alignment", "a": part, "b": part, "start": "landmarks", "landmarks": line},
                      headers={"Prefer": WAIT}).json()
    assert job["state"] == "failed" and "one line" in job["problem"]["detail"]


# ---- copies ----

def test_a_copy_is_a_mesh_of_its_own(client, part):
    shape, m = lump(), motion(8)
    reply = client.post(f"/v1/meshes/{part}/copies", json={"transform": m})
    assert reply.status_code == 201, reply.text
    copy = reply.json()
    assert reply.headers["Location"] == f"/v1/meshes/{copy['id']}" and reply.headers["ETag"]
    assert copy["name"] == "part" and copy["kind"] == "quads" and copy["format"] == "ply"
    assert copy["faces"] == client.get(f"/v1/meshes/{part}").json()["faces"]
    rows = client.get(f"/v1/meshes/{copy['id']}/vertices", headers={"Accept": "application/json"}).json()["positions"]
    assert [tuple(row) for row in rows] == [pytest.approx(p, abs=1e-14) for p in moved(shape, m)[0]]
    # The very bits of the pose.
    both = ask(client, "hausdorff", a={"mesh": part, "transform": m}, b=copy["id"])
    assert both["result"]["upper"] == 0
    again = client.post(f"/v1/meshes/{part}/copies", json={"transform": m})
    assert again.status_code == 200 and again.json()["id"] == copy["id"]
    named = client.post(f"/v1/meshes/{part}/copies", json={"transform": m, "name": "turned"})
    assert named.status_code == 201 and named.json()["name"] == "turned"
    assert client.delete(f"/v1/meshes/{copy['id']}").status_code == 204
    assert client.get(f"/v1/meshes/{part}").status_code == 200


def test_a_copy_of_points(client):
    points = client.upload(b"0 0 0\n1 0 0\n0 2 0\n", name="points.xyz")["id"]
    copy = client.post(f"/v1/meshes/{points}/copies", json={"transform": [*IDENTITY[:12], 1, 2, 3, 1]}).json()
    assert copy["kind"] == "points" and copy["bounding_box"]["min"] == [1, 2, 3]


@pytest.mark.parametrize("body, place", [
    ({}, "/transform"), ({"transform": [0] * 16}, "/transform"), ({"transform": [1, 2]}, "/transform"),
    ({"transform": IDENTITY, "name": 7}, "/name"), ({"transform": IDENTITY, "ttl": 7}, "/ttl"),
    ({"transform": [*IDENTITY[:9], True, *IDENTITY[10:]]}, "/transform/9"),
])
def test_a_copy_that_cannot_be(client, part, body, place):
    problem = check_problem(client.post(f"/v1/meshes/{part}/copies", json=body), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == place, problem


def test_other_faults_of_copies(client, part):
    check_problem(client.post("/v1/meshes/m_none/copies", json={"transform": IDENTITY}), 404, "mesh_not_found")
    check_problem(client.post(f"/v1/meshes/{part}/copies", json={"transform": IDENTITY, "name": "\x07"}), 400)
    huge = [1e308, 0, 0, 0, 0, 1e308, 0, 0, 0, 0, 1e308, 0, 0, 0, 0, 1]
    check_problem(client.post(f"/v1/meshes/{part}/copies", json={"transform": huge}), 422, "not_finite")
