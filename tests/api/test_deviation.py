"""How far one surface lies from another: intervals of known values, and the distances at the vertices."""
import array
import math
import struct
import time

import pytest

import shapes
from conftest import MET_CODES, SLOW, WAIT, check_problem, ndjson

FLOOR = ([(-5, -5, 0), (6, -5, 0), (6, 6, 0), (-5, 6, 0)], [(0, 1, 2, 3)])
RAMP = ([(0, 0, 1), (1, 0, 2), (1, 1, 2), (0, 1, 1)], [(0, 1, 2, 3)])


def ask(client, a, b, headers=(), **fields):
    reply = client.post("/v1/jobs", json={"type": "deviation", "a": a, "b": b, **fields},
                        headers={"Prefer": WAIT, **dict(headers)})
    assert reply.status_code == 200, reply.text
    return reply.json()


@pytest.fixture(scope="module")
def pair(daemon):
    with daemon.client() as made:
        return made.upload(RAMP, name="ramp")["id"], made.upload(FLOOR, name="floor")["id"]


def check_interval(interval, value, width):
    assert interval["lower"] <= value <= interval["upper"], interval
    assert interval["upper"] - interval["lower"] <= width, interval
    if "lower_relative" in interval:
        assert interval["lower_relative"] <= interval["lower"] / math.sqrt(3) * (1 + 1e-15)
        assert interval["upper_relative"] >= interval["upper"] / math.sqrt(3) * (1 - 1e-15)


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_ramp_over_a_floor(client, pair, quads):
    job = ask(client, *pair, quads=quads, percentiles=[100, 25], bins=4)
    assert job["type"] == "deviation" and job["state"] == "succeeded"
    assert job["request"]["percentiles"] == [100, 25] and job["request"]["accuracy"] == 0.01
    result = job["result"]
    assert result["over"] == "area" and result["accurate"] is True
    check_interval(result["size"], math.sqrt(2), 1e-9)
    check_interval(result["mean"], 1.5, 1e-6)
    check_interval(result["rms"], math.sqrt(7 / 3), 1e-6)
    check_interval(result["max"], 2, 1e-5)
    assert [row["percent"] for row in result["percentiles"]] == [100, 25]
    check_interval(result["percentiles"][0], 2, 1e-5)
    check_interval(result["percentiles"][1], 1.25, 1e-5)
    histogram = result["histogram"]
    assert histogram["bin_width"] == pytest.approx(0.5, abs=1e-5)
    for (low, high), share in zip(histogram["shares"], [0, 0, 0.5, 0.5], strict=True):
        assert low - 1e-4 <= share <= high + 1e-4 and high - low < 1e-4
    assert result["vertex_count"] == 4


def test_point_sets_are_counted(client, pair):
    points = client.upload(b"0 0 1\n0 1 2\n1 0 6\n", format="xyz")["id"]
    result = ask(client, points, pair[1])["result"]
    assert result["over"] == "points" and result["size"] == {"lower": 3, "upper": 3}
    check_interval({k: v for k, v in result["mean"].items() if "_" not in k}, 3, 1e-9)


def test_more_pieces_close_in(client, spheres):
    last = None
    for pieces in (0, 30000, 90000):
        mean = ask(client, *spheres, pieces=pieces, tolerance=1e-4, percentiles=[], bins=0)["result"]["mean"]
        if last:
            assert mean["upper"] - mean["lower"] < last["upper"] - last["lower"]
            assert mean["lower"] <= last["upper"] and last["lower"] <= mean["upper"]
        last = mean


def test_vertices_are_read_from_the_result(client, spheres):
    job = ask(client, *spheres, pieces=0, tolerance=1e-3)
    assert "vertex_distances" not in job["result"]
    path = f"/v1/jobs/{job['id']}/result"
    whole = client.get(path).json()
    distances = whole.pop("vertex_distances")
    assert whole == job["result"] and len(distances) == whole["vertex_count"]
    reply = client.get(path, headers={"Accept": "application/octet-stream"})
    assert int(reply.headers["content-length"]) == 8 * len(distances)
    assert array.array("d", reply.content).tolist() == distances
    head, *lines = client.get(path, headers={"Accept": "text/csv"}).text.splitlines()
    assert head == "vertex,distance"
    assert [line.split(",")[0] for line in lines] == [str(i) for i in range(len(distances))]
    assert [float(line.split(",")[1]) for line in lines] == distances
    assert max(distances) <= job["result"]["max"]["upper"] + 1e-12
    # They are what a projection of the vertices finds.
    points = [x for vertex in shapes.sphere()[0] for x in vertex]
    rows = client.post(f"/v1/meshes/{spheres[1]}/project", content=array.array("d", points).tobytes())
    assert [row[0] for row in struct.iter_unpack("<7d", rows.content)] == distances


def test_events_leave_the_vertices_out(client, spheres):
    reply = client.post("/v1/jobs", headers={"Accept": "application/x-ndjson", "Cache-Control": "no-cache"},
                        json={"type": "deviation", "a": spheres[0], "b": spheres[1], "pieces": 0, "tolerance": 1e-3})
    events = ndjson(reply.text)
    assert {event["event"] for event in events[:-1]} <= {"bounds"} and events[-1]["event"] == "result"
    assert "vertex_distances" not in events[-1]["result"] and len(reply.text) < 50000


def test_every_result_can_be_read(client, pair):
    done = client.hausdorff(*pair, tolerance=1e-3)
    path = f"/v1/jobs/{done['id']}/result"
    assert client.get(path).json() == done["result"]
    check_problem(client.get(path, headers={"Accept": "text/csv"}), 406, "not_acceptable")
    check_problem(client.get("/v1/jobs/j_none/result"), 404, "job_not_found")


def test_there_is_no_result_before_the_end(client, slow_pair):
    job = client.start(*slow_pair, **SLOW, headers={"Cache-Control": "no-cache"}, detach=True)
    check_problem(client.get(f"/v1/jobs/{job['id']}/result"), 409, "conflict")
    client.delete(f"/v1/jobs/{job['id']}")


def test_results_survive_a_restart(make_daemon):
    daemon = make_daemon()
    with daemon.client() as client:
        a, b = client.upload(RAMP)["id"], client.upload(FLOOR)["id"]
        done = ask(client, a, b)
        before = client.get(f"/v1/jobs/{done['id']}/result").text
    daemon.stop(9)
    daemon.start()
    with daemon.client() as client:
        assert client.get(f"/v1/jobs/{done['id']}/result").text == before
        assert ask(client, a, b)["cached"] is True
        # The meshes are no longer needed.
        client.delete(f"/v1/meshes/{a}")
        assert client.get(f"/v1/jobs/{done['id']}/result").text == before


def check_canceled(client, job):
    """Whatever was known when a job was canceled: intervals for everything, and distances or none at all."""
    assert job["state"] == "canceled", job
    result = job["result"]
    assert result["accurate"] is False
    for interval in (result["mean"], result["rms"], *result["percentiles"]):
        assert 0 <= interval["lower"] <= interval["upper"] <= result["max"]["upper"] * (1 + 1e-9)
    assert all(0 <= low <= high <= 1 for low, high in result["histogram"]["shares"])
    path = f"/v1/jobs/{job['id']}/result"
    whole = client.get(path)
    assert whole.status_code == 200 and len(whole.json().get("vertex_distances", [])) == result["vertex_count"]
    numbers = client.get(path, headers={"Accept": "application/octet-stream"})
    if result["vertex_count"] == 0:
        check_problem(numbers, 406, "not_acceptable")
    else:
        assert len(numbers.content) == 8 * result["vertex_count"]
    return result


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_canceled_job_keeps_its_intervals(client, slow_pair, quads):
    """However early it is canceled: at first they are those of the boxes."""
    whole = None
    for wait in (0, 0.02, 0.1, 0.3, 1, 2):
        job = client.post("/v1/jobs", json={"type": "deviation", "a": slow_pair[0], "b": slow_pair[1], "quads": quads,
                                            "accuracy": 1e-9, "pieces": 10000000}).json()
        while client.get(f"/v1/jobs/{job['id']}").json()["state"] == "queued":
            time.sleep(0.005)
        time.sleep(wait)
        reply = client.delete(f"/v1/jobs/{job['id']}")
        assert reply.status_code == 202, reply.text
        result = check_canceled(client, client.wait(job["id"]))
        # All of them hold for one distance.
        whole = whole or result
        for name in ("mean", "rms", "max"):
            assert result[name]["lower"] <= whole[name]["upper"] and whole[name]["lower"] <= result[name]["upper"]


def test_a_deadline_leaves_intervals(client, slow_pair):
    reply = client.post("/v1/jobs", json={"type": "deviation", "a": slow_pair[0], "b": slow_pair[1], "accuracy": 1e-9,
                                          "pieces": 10000000, "deadline_ms": 300}, headers={"Prefer": "wait=60"})
    done = reply.json()
    assert done["state"] == "succeeded" and done["result"]["accurate"] is False
    assert done["result"]["mean"]["lower"] <= done["result"]["mean"]["upper"] <= done["result"]["max"]["upper"]


@pytest.mark.parametrize("field, value, pointer", [
    ("accuracy", 0, "/accuracy"),
    ("accuracy", "1", "/accuracy"),
    ("pieces", -1, "/pieces"),
    ("pieces", 1.5, "/pieces"),
    ("pieces", 1e8, "/pieces"),
    ("bins", 20000, "/bins"),
    ("percentiles", [50, 0], "/percentiles/1"),
    ("percentiles", [101], "/percentiles/0"),
    ("percentiles", ["50"], "/percentiles/0"),
    ("percentiles", 50, "/percentiles"),
    ("percentiles", [1] * 65, "/percentiles"),
    ("threshold", 1, "/threshold"),
    ("direction", "a_to_b", "/direction"),
    ("mesh", "m_1", "/mesh"),
    ("accelerator", "grid", "/accelerator"),
])
def test_bad_fields_are_pointed_at(client, pair, field, value, pointer):
    body = {"type": "deviation", "a": pair[0], "b": pair[1], field: value}
    problem = check_problem(client.post("/v1/jobs", json=body), 400, "invalid_field")
    assert [error["pointer"] for error in problem["errors"]] == [pointer]


def test_a_sign_is_proven(client):
    small = client.upload(shapes.cube(0.8, (0.1, 0.1, 0.1)), name="small")["id"]
    cube = client.upload(shapes.cube(), name="cube")["id"]
    for sign, turn in (("outside", 1), ("inside", -1), ("normal", 1)):
        bands = [sorted((-0.11 * turn, -0.09 * turn)), [None, 0] if turn > 0 else [0, None]]
        job = ask(client, small, cube, sign=sign, bands=bands)
        assert job["request"]["sign"] == sign and job["request"]["bands"] == bands
        signed = job["result"]["signed"]
        assert signed["sign"] == sign and signed["proven"] is (sign != "normal")
        check_interval(signed["mean"], -0.1 * turn, 1e-9)
        assert signed["inside"]["max"]["lower"] <= 0.1 <= signed["inside"]["max"]["upper"]
        check_interval(signed["inside"]["size"], 6 * 0.64, 1e-9)
        assert signed["outside"]["max"]["upper"] == 0 and "witness" not in signed["outside"]
        assert signed["inside"]["witness"]["from"]["mesh"] == "a" and signed["inside"]["witness"]["to"]["id"] == cube
        for band, ends in zip(signed["bands"], bands, strict=True):
            assert [band["from"], band["to"]] == ends
            assert band["lower"] > 1 - 1e-9 and band["upper"] == 1
    assert "signed" not in ask(client, small, cube)["result"]


def test_a_sign_needs_a_solid(client, pair):
    vertices, faces = shapes.cube()
    small = client.upload(shapes.cube(0.8, (0.1, 0.1, 0.1)), name="small")["id"]
    turned = [faces[0][::-1], *faces[1:]]
    more, others = shapes.cube(1, (0.5, 0.5, 0.5))
    crossing = (vertices + more, faces + [tuple(8 + i for i in face) for face in others])
    for mesh, words in (((vertices, faces[:-1]), "4 boundary edges"), ((vertices, turned), "not consistently oriented"),
                        (crossing, "meets itself")):
        target = client.upload(mesh)["id"]
        for _ in range(2):  # the second time from what is known of the mesh
            job = ask(client, small, target, sign="outside")
            assert job["state"] == "failed" and job["problem"]["code"] == "not_closed" and job["problem"]["status"] == 422
            assert words in job["problem"]["detail"] and "mesh B" in job["problem"]["detail"]
            assert 'the sign "normal" needs no solid, but has no proof' in job["problem"]["detail"]
            MET_CODES.add(job["problem"]["code"])
    points = client.upload(b"0 0 1\n0 1 2\n", format="xyz")["id"]
    for sign in ("outside", "normal"):
        assert ask(client, small, points, sign=sign)["problem"]["code"] == "not_closed"
    for kind in ("deviation", "comparison"):
        body = {"type": kind, "a": pair[0], "b": pair[1]}
        problem = check_problem(client.post("/v1/jobs", json={**body, "bands": [[0, 1]]}), 400, "invalid_field")
        assert problem["errors"][0]["pointer"] == "/bands"
        problem = check_problem(client.post("/v1/jobs", json={**body, "regions": True}), 400, "invalid_field")
        assert problem["errors"][0]["pointer"] == "/regions"


def test_a_solid_is_forgotten_when_it_moves(client):
    small = client.upload(shapes.cube(0.8, (0.1, 0.1, 0.1)), name="small")["id"]
    cube = client.upload(shapes.cube(), name="moving")["id"]
    assert ask(client, small, cube, sign="outside")["result"]["signed"]["inside"]["max"]["lower"] > 0
    reply = client.patch(f"/v1/meshes/{cube}/vertices", json={"indices": [0], "positions": [[0.5, 0.4, 1.5]]})
    assert reply.status_code == 200, reply.text
    assert ask(client, small, cube, sign="outside")["problem"]["code"] == "not_closed"


@pytest.mark.parametrize("field, value, pointer", [
    ("sign", "left", "/sign"),
    ("bands", [[0, 1], [1, 0]], "/bands/1"),
    ("bands", [[0, 1, 2]], "/bands/0"),
    ("bands", [["0", 1]], "/bands/0"),
    ("bands", [[0, 1]] * 65, "/bands"),
])
def test_bad_signs_are_pointed_at(client, pair, field, value, pointer):
    body = {"type": "deviation", "a": pair[0], "b": pair[1], field: value}
    problem = check_problem(client.post("/v1/jobs", json=body), 400, "invalid_field")
    assert problem["errors"][0]["pointer"].startswith(pointer)


def test_regions_beyond_a_limit(client):
    floor = client.upload(FLOOR)["id"]
    plates = [([(x, y, z) for x in (at, at + 1) for y in (0, 1)], [(0, 2, 3, 1)]) for at, z in ((0, 0.1), (2, 0.3), (4, 0.2))]
    a = client.upload(([p for vertices, _ in plates for p in vertices], [tuple(4 * i + k for k in (0, 2, 3, 1)) for i in range(3)]))["id"]
    job = ask(client, a, floor, limit=0.15, regions=True)
    assert job["request"]["limit"] == 0.15 and job["request"]["regions"] is True
    result = job["result"]
    assert result["verdict"] == "above" and result["region_count"] == 2
    for region, height, face in zip(result["regions"], (0.3, 0.2), (1, 2), strict=True):
        assert region["surely"] is True and region["parts"] == 1 and region["faces"] == [face] and region["face_count"] == 1
        assert region["max"]["lower"] <= height <= region["max"]["upper"] and region["witness"]["from"]["face"] == face
        check_interval(region["area"], 1, 1e-9)
        assert region["centroid"] == pytest.approx([2 * face + 0.5, 0.5, height], abs=1e-6)
        assert all(region["box"]["min"][k] <= region["centroid"][k] <= region["box"]["max"][k] for k in range(3))
    result = ask(client, a, floor, limit=0.5, regions=True)["result"]
    assert result["verdict"] == "below" and result["regions"] == [] and result["region_count"] == 0
    result = ask(client, a, floor, limit=0.5)["result"]
    assert result["verdict"] == "below" and "regions" not in result
    points = client.upload(b"0 0 1\n0 1 2\n", format="xyz")["id"]
    assert ask(client, points, floor, limit=0.5, regions=True)["problem"]["code"] == "unsupported_feature"
