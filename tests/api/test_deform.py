"""Moving the vertices of a mesh: revisions, tags, answers by revision, and what a sudden end leaves."""
import array
import math
import re
import signal
import threading

import pytest

import shapes
from conftest import WAIT, check_problem

PLANE = ([(x, y, 0.0) for y in range(5) for x in range(5)],
         [(5 * y + x, 5 * y + x + 1, 5 * y + x + 6, 5 * y + x + 5) for y in range(4) for x in range(4)])


@pytest.fixture
def plane(client, request):
    """A square of 4 x 4 quads in z = 0, a mesh of its own for each test."""
    return client.upload(shapes.obj(PLANE), name=request.node.name, format="obj")["id"]


def deform(client, mesh, body, **options):
    send = {"content": body} if isinstance(body, bytes) else {"json": body}
    return client.patch(f"/v1/meshes/{mesh}/vertices", **send, **options)


def distance(client, mesh, point, **headers):
    reply = client.post("/v1/jobs", json={"type": "project", "mesh": mesh, "points": [point]},
                        headers={"Prefer": WAIT, **headers})
    assert reply.status_code == 200, reply.text
    return reply.json()["result"]["points"][0]["distance"]


def raised(z):
    return array.array("d", [c for x, y, _ in PLANE[0] for c in (x, y, z)]).tobytes()


def test_some_vertices_move(client, plane):
    assert distance(client, plane, [2, 2, 3]) == 3
    reply = deform(client, plane, {"indices": [12], "positions": [[2, 2, 1]]})
    assert reply.status_code == 200, reply.text
    answer = reply.json()
    assert answer["revision"] == 1 and 0 < answer["updated_nodes"] < 30 and answer["refit_ms"] >= 0
    assert distance(client, plane, [2, 2, 3]) == 2
    facts = client.get(f"/v1/meshes/{plane}").json()
    assert facts["revision"] == 1
    assert facts["bounding_box"]["max"] == [4, 4, 1]
    assert facts["bounding_box"]["diagonal"] == pytest.approx(math.sqrt(33))
    assert facts["patches"] == 1


@pytest.mark.parametrize("dtype", ["f64", "f32"])
def test_all_vertices_move_by_rows_of_numbers(client, plane, dtype):
    body = raised(0.5)
    if dtype == "f32":
        body = array.array("f", array.array("d", body)).tobytes()
    reply = deform(client, plane, body, params={"dtype": dtype}, headers={"Content-Type": "application/octet-stream"})
    assert reply.json()["revision"] == 1, reply.text
    assert distance(client, plane, [2, 2, 3]) == 2.5


def test_all_vertices_move_by_json(client, plane):
    rows = [[x, y, -1] for x, y, _ in PLANE[0]]
    assert deform(client, plane, {"positions": rows}).json()["revision"] == 1
    assert deform(client, plane, {"positions": [[x, y, -2] for x, y, _ in rows]}).json()["revision"] == 2
    assert distance(client, plane, [2, 2, 0]) == 2


@pytest.mark.parametrize("accelerator", ["boxes", "tetra", "grid"])
def test_every_accelerator_follows(client, plane, accelerator):
    deform(client, plane, {"indices": [0, 24], "positions": [[-3, -3, 2], [9, 9, -4]]})
    job = client.post("/v1/jobs", json={"type": "project", "mesh": plane, "points": [[-3, -3, 2], [9, 9, -4], [2, 2, 1]],
                                        "accelerator": accelerator}, headers={"Prefer": WAIT}).json()
    assert [foot["distance"] for foot in job["result"]["points"]] == pytest.approx([0, 0, 1], abs=1e-12)


def test_questions_of_shape_come_before_those_of_nearest_points(client, plane):
    """Collisions use the present revision; a later request for nearest points gets them on that revision."""
    for z in (1.0, 2.0):
        assert deform(client, plane, {"indices": [12], "positions": [[2, 2, z]]}).status_code == 200
        for question in ({"type": "self_collision", "mesh": plane}, {"type": "distance", "a": plane, "b": plane}):
            reply = client.post("/v1/jobs", json=question, headers={"Prefer": WAIT})
            assert reply.json()["state"] == "succeeded", reply.text
        assert client.get(f"/v1/meshes/{plane}/patches").status_code == 200
        assert distance(client, plane, [2, 2, 3]) == pytest.approx(3 - z, abs=1e-12)


def test_the_file_has_the_new_places(client, plane):
    deform(client, plane, {"indices": [12], "positions": [[2, 2, 0.125]]})
    text = client.get(f"/v1/meshes/{plane}/content", params={"format": "obj"}).text
    assert "v 2 2 0.125" in text


def test_answers_are_kept_by_revision(client, plane):
    ask = {"type": "hausdorff", "a": plane, "b": plane, "tolerance": 1e-6}

    def cached():
        return client.post("/v1/jobs", json=ask, headers={"Prefer": WAIT}).json().get("cached", False)

    assert not cached() and cached()
    deform(client, plane, {"indices": [12], "positions": [[2, 2, 1]]})
    assert not cached() and cached()


def test_tags_guard_a_revision(client, plane):
    first = client.get(f"/v1/meshes/{plane}").headers["ETag"]
    move = {"indices": [12], "positions": [[2, 2, 1]]}
    second = deform(client, plane, move, headers={"If-Match": first}).headers["ETag"]
    assert second != first
    assert client.get(f"/v1/meshes/{plane}").headers["ETag"] == second
    check_problem(deform(client, plane, move, headers={"If-Match": first}), 412, "precondition_failed")
    assert client.get(f"/v1/meshes/{plane}").json()["revision"] == 1
    assert deform(client, plane, move, headers={"If-Match": "*"}).json()["revision"] == 2


def revision_of(tag):
    return int(re.match(r'"[0-9a-f]{64}-(\d+)', tag).group(1))


def test_a_tag_is_that_of_the_body_that_comes_with_it(daemon, client, plane):
    """The height of the plane gives the revision, while one client moves the plane and others read it."""
    ended = threading.Event()

    def move():
        with daemon.client() as own:
            for revision in range(1, 120):
                assert deform(own, plane, raised(float(revision))).json()["revision"] == revision
        ended.set()

    mover = threading.Thread(target=move)
    mover.start()
    seen = set()
    while not ended.is_set():
        reply = client.get(f"/v1/meshes/{plane}/vertices")
        assert array.array("d", reply.content)[2] == revision_of(reply.headers["etag"])
        seen.add(reply.headers["etag"])
        reply = client.get(f"/v1/meshes/{plane}/content", params={"format": "off"})
        assert float(reply.text.splitlines()[2].split()[2]) == revision_of(reply.headers["etag"])
    mover.join()
    assert len(seen) > 1


def test_where_the_vertices_are(client, plane):
    path = f"/v1/meshes/{plane}/vertices"
    rows = [[x, y, 0.1 + x / 3] for x, y, _ in PLANE[0]]
    assert client.get(path).content == raised(0.0)
    assert deform(client, plane, {"positions": rows}).status_code == 200
    replies = {name: client.get(path, headers={"Accept": name})
               for name in ("application/octet-stream", "text/csv", "application/json")}
    for name, reply in replies.items():
        assert reply.headers["content-type"] == name
        known = client.get(path, headers={"Accept": name, "If-None-Match": reply.headers["etag"]})
        assert known.status_code == 304 and revision_of(known.headers["etag"]) == 1
    assert len({reply.headers["etag"] for reply in replies.values()}) == 3
    binary, csv, as_json = replies.values()
    assert binary.content == array.array("d", [c for row in rows for c in row]).tobytes()
    assert csv.text.splitlines()[0] == "x,y,z"
    assert [[float(c) for c in line.split(",")] for line in csv.text.splitlines()[1:]] == rows
    assert as_json.json() == {"positions": rows}
    # What was read can be sent back.
    assert deform(client, plane, as_json.json()).json()["revision"] == 2
    assert client.get(path).content == binary.content
    check_problem(client.get("/v1/meshes/m_none/vertices"), 404, "mesh_not_found")
    check_problem(client.get(path, headers={"Accept": "image/png"}), 406, "not_acceptable")
    check_problem(client.get(path, headers={"If-Match": '"other"'}), 412, "precondition_failed")


def test_vertices_come_in_blocks(client):
    points = [(k / 7, -k, k * k) for k in range(20000)]
    mesh = client.upload("".join(f"{x!r} {y} {z}\n" for x, y, z in points).encode(), format="xyz")["id"]
    path = f"/v1/meshes/{mesh}/vertices"
    assert client.get(path).content == array.array("d", [c for point in points for c in point]).tobytes()
    assert client.get(path, headers={"Accept": "application/json"}).json()["positions"] == [list(p) for p in points]
    assert len(client.get(path, headers={"Accept": "text/csv"}).text.splitlines()) == 20001


def test_a_deformed_mesh_leaves_the_content_index(client, plane, request):
    content, name = shapes.obj(PLANE), request.node.name
    assert client.upload(content, name=name, format="obj")["id"] == plane
    deform(client, plane, {"indices": [0], "positions": [[0, 0, 1]]})
    other = client.upload(content, name=name, format="obj")
    assert other["id"] != plane and other["revision"] == 0


def test_a_running_job_keeps_its_revision(make_daemon):
    daemon = make_daemon()
    with daemon.client() as client:
        rough = client.upload(shapes.obj(shapes.rough(150, seed=1, height=0.5)), name="rough", format="obj")["id"]
        other = client.upload(shapes.obj(shapes.rough(150, seed=2, height=0.5)), name="other", format="obj")["id"]
        ask = {"type": "hausdorff", "a": rough, "b": other, "tolerance": 1e-13, "bounds": "matching", "detach": True}
        job = client.post("/v1/jobs", json=ask).json()["id"]
        client.wait_until_running(job)
        vertices = shapes.rough(150, seed=1, height=0.5)[0]
        moved = array.array("d", [c + 5 for p in vertices for c in p]).tobytes()
        assert deform(client, rough, moved, headers={"Content-Type": "application/octet-stream"}).status_code == 200
        client.delete(f"/v1/jobs/{job}")
        result = client.wait(job)
        if result.get("result"):
            assert result["result"]["lower"] < 2
        after = client.post("/v1/jobs", json={"type": "hausdorff", "a": rough, "b": other, "tolerance": 1e-3},
                            headers={"Prefer": WAIT}).json()
        assert after["result"]["lower"] > 4


def test_revisions_survive_a_sudden_end(make_daemon):
    daemon = make_daemon()
    with daemon.client() as client:
        mesh = client.upload(shapes.obj(PLANE), name="plane", format="obj")["id"]
        for z in (1, 2, 3):
            assert deform(client, mesh, {"indices": [12], "positions": [[2, 2, z]]}).json()["revision"] == z
        tag = client.get(f"/v1/meshes/{mesh}").headers["ETag"]
    daemon.stop(signal.SIGKILL)
    daemon.start()
    with daemon.client() as client:
        facts = client.get(f"/v1/meshes/{mesh}")
        assert facts.json()["revision"] == 3 and facts.headers["ETag"] == tag
        assert distance(client, mesh, [2, 2, 5]) == pytest.approx(2, abs=1e-12)
        assert deform(client, mesh, {"indices": [12], "positions": [[2, 2, 4]]}).json()["revision"] == 4
        assert distance(client, mesh, [2, 2, 5]) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("body, status, code, pointer", [
    ({}, 400, "invalid_field", "/positions"),
    ({"positions": [[0, 0]]}, 400, "invalid_field", "/positions/0"),
    ({"positions": [[0, 0, "x"]]}, 400, "invalid_field", "/positions/0/2"),
    ({"positions": [[0, 0, 0]], "indices": [-1]}, 400, "invalid_field", "/indices/0"),
    ({"positions": [[0, 0, 0]], "indices": [0.5]}, 400, "invalid_field", "/indices/0"),
    ({"positions": [[0, 0, 0]], "indices": [0, 1]}, 400, "invalid_field", "/positions"),
    ({"positions": [[0, 0, 0]], "faces": []}, 400, "invalid_field", "/faces"),
    ({"positions": [[0, 0, 0], [1, 1, 1]], "indices": [3, 25]}, 422, "index_out_of_range", "/indices/1"),
    ({"positions": [[0, 0, 0]]}, 400, "malformed_body", None),
    (b"1234567", 400, "malformed_body", None),
    (b"", 400, "malformed_body", None),
    (b"\x00" * 24, 400, "malformed_body", None),
    (raised(math.inf), 422, "not_finite", None),
], ids=range(13))
def test_bad_bodies_are_refused(client, plane, body, status, code, pointer):
    headers = {"Content-Type": "application/octet-stream"} if isinstance(body, bytes) else {}
    problem = deform(client, plane, body, headers=headers)
    check_problem(problem, status, code)
    if pointer:
        assert problem.json()["errors"][0]["pointer"] == pointer
    assert client.get(f"/v1/meshes/{plane}").json()["revision"] == 0


def test_other_faults(client, plane):
    check_problem(deform(client, "m_none", {"positions": []}), 404, "mesh_not_found")
    check_problem(deform(client, plane, b"v 0 0 0", headers={"Content-Type": "text/plain"}), 415)
    check_problem(deform(client, plane, b"[", headers={"Content-Type": "application/json"}), 400, "malformed_json")
    check_problem(deform(client, plane, raised(0), params={"dtype": "f16"}), 400, "invalid_parameter")


def test_an_empty_body_is_refused_before_the_revision(client, plane):
    check_problem(client.patch(f"/v1/meshes/{plane}/vertices", headers={"If-Match": '"none"'}), 400, "malformed_body")


def test_point_sets_move_too(client):
    mesh = client.upload(b"0 0 0\n1 0 0\n0 4 0\n", name="moving points", format="xyz")["id"]
    assert deform(client, mesh, {"indices": [2], "positions": [[0, 3, 0]]}).json()["revision"] == 1
    assert distance(client, mesh, [0, 3, 0]) == 0
