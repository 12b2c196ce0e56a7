"""The job `remesh`: a surface becomes a mesh of quads of its own, with its proven distance."""
import concurrent.futures
import json
import math
import random
import signal
import time

import pytest

import shapes
from conftest import WAIT, check_problem, ndjson

LONG = {"quads": 200000}  # takes seconds on the torus


def torus(columns=80, rows=40, minor=0.3):
    """Quads on the torus of radii 1 and minor."""
    points, faces = [], []
    for i in range(columns):
        for j in range(rows):
            u, v = 2 * math.pi * i / columns, 2 * math.pi * j / rows
            ring = 1 + minor * math.cos(v)
            points.append((ring * math.cos(u), ring * math.sin(u), minor * math.sin(v)))
            faces.append([x % columns * rows + y % rows for x, y in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))])
    return points, faces


@pytest.fixture(scope="module")
def surface(daemon):
    with daemon.client() as made:
        return made.upload(torus(), name="torus", unit="mm")["id"]


def remesh(client, mesh, **fields):
    reply = client.post("/v1/jobs", headers={"Prefer": WAIT}, json={"type": "remesh", "mesh": mesh, **fields})
    assert reply.status_code == 200, reply.text
    return reply.json()


def test_quads_of_a_surface(client, surface):
    job = remesh(client, surface, quads=600, labels=["try"])
    result = job["result"]
    assert job["state"] == "succeeded" and job["request"]["quads"] == 600 and job["request"]["mesh"] == surface
    mesh = client.get("/v1/meshes/" + result["mesh"]).json()
    assert mesh["faces"] == {"triangles": 0, "quads": result["quads"], "polygons": 0}
    assert mesh["name"] == f"torus, {result['quads']} quads" and mesh["unit"] == "mm"
    assert mesh["euler_number"] == 0 and mesh["watertight"] and mesh["irregular_vertices"] == result["irregular_vertices"]
    assert 450 < result["quads"] < 750 and result["folded"] == 0 and result["components"] == 1
    assert 0 < result["least_scaled_jacobian"] <= 1 and "patches" not in result and "reached" not in result
    # Both ways the bounds hold what another job measures, and the greater way is the distance.
    for way, direction in (("from_surface", "a_to_b"), ("from_quads", "b_to_a"), ("hausdorff", "two_sided")):
        again = client.hausdorff(surface, result["mesh"], direction=direction)["result"]
        assert result[way]["lower"] <= again["upper"] and again["lower"] <= result[way]["upper"], way
        assert result[way]["upper_relative"] - result[way]["lower_relative"] <= 1e-6
    assert result["hausdorff"]["upper"] == max(result[way]["upper"] for way in ("from_surface", "from_quads"))
    listed = client.get("/v1/jobs", params={"type": "remesh", "mesh": surface, "label": "try"}).json()["jobs"]
    assert [one["id"] for one in listed] == [job["id"]] and listed[0]["result"] == result


def test_the_same_request_makes_the_same_mesh(client, surface):
    first, second = (remesh(client, surface, quads=300, threads=threads)["result"] for threads in (1, 2))
    assert second["mesh"] == first["mesh"]
    # It is made again, not told from memory: also when it was deleted.
    assert client.delete("/v1/meshes/" + first["mesh"]).status_code == 204
    third = remesh(client, surface, quads=300)
    assert "cached" not in third and third["result"]["mesh"] != first["mesh"]
    assert client.get("/v1/meshes/" + third["result"]["mesh"]).json()["faces"]["quads"] == first["quads"]


def test_a_distance_is_reached_or_told_as_out_of_reach(client, surface):
    result = remesh(client, surface, quads=300, distance=0.004)["result"]
    assert result["reached"] and result["hausdorff"]["upper_relative"] <= 0.004 and result["rounds"] > 1
    for most in (400, 2000):
        far = remesh(client, surface, quads=most, distance=1e-6, semi_regular=True)["result"]
        assert not far["reached"] and far["quads"] <= most and far["patches"] > 0
        check_patches(client, far)


def test_where_patches_come_from(client, surface):
    """Of a layout where there are enough quads for its curves, else of coarse quads that are divided."""
    for quads, origin in ((1000, "division"), (5000, "layout")):
        result = remesh(client, surface, quads=quads, semi_regular=True)["result"]
        assert result["patches_from"] == origin and result["folded"] == 0 and result["least_scaled_jacobian"] > 0.7
        check_patches(client, result)


def test_a_distance_takes_few_quads_in_patches_too(client, surface):
    for distance in (0.02, 0.004):
        plain = remesh(client, surface, distance=distance)["result"]
        result = remesh(client, surface, distance=distance, semi_regular=True)["result"]
        assert result["reached"] and result["hausdorff"]["upper_relative"] <= distance and result["folded"] == 0
        assert result["quads"] <= 2 * plain["quads"]
        check_patches(client, result)


def sieve(seed, holes, size):
    """The sphere of a gridded cube, in triangles, without what lies within discs of chance."""
    chance = random.Random(seed)
    points, faces = shapes.gridded_cube(24)

    def unit(p):
        return [x / math.hypot(*p) for x in p]

    points = [unit(p) for p in points]
    discs = [(unit([chance.gauss(0, 1) for _ in range(3)]), size * chance.uniform(0.3, 1)) for _ in range(holes)]
    kept = []
    for a, b, c, d in faces:
        middle = [(points[a][k] + points[c][k]) / 2 for k in range(3)]
        if all(math.dist(middle, at) > reach for at, reach in discs):
            kept += [(a, b, c), (a, c, d)]
    used = sorted({v for face in kept for v in face})
    number = {v: i for i, v in enumerate(used)}
    return [points[v] for v in used], [tuple(number[v] for v in face) for face in kept]


def check_patches(client, result):
    patches = client.get(f"/v1/meshes/{result['mesh']}/patches").json()
    assert patches["patch_count"] == result["patches"]
    assert sum(patch["rows"] * patch["columns"] for patch in patches["patches"]) == result["quads"]


@pytest.mark.parametrize("seed, holes, size", [(2, 60, 0.15), (5, 60, 0.15), (6, 30, 0.25), (8, 40, 0.2)])
def test_surfaces_that_have_no_good_layout(client, seed, holes, size):
    """Holes near each other leave no room for patches between them."""
    mesh = client.upload(sieve(seed, holes, size))["id"]
    result = remesh(client, mesh, quads=1500, semi_regular=True)["result"]
    assert result["folded"] == 0 and 1350 <= result["quads"] <= 1575 and result["patches_from"] in ("layout", "division", "quads")
    check_patches(client, result)
    plain = remesh(client, mesh, quads=1500)["result"]
    assert result["hausdorff"]["upper"] <= 3 * plain["hausdorff"]["upper"]


def test_a_distance_from_a_surface_that_has_no_good_layout(client):
    mesh = client.upload(sieve(4, 30, 0.25))["id"]
    result = remesh(client, mesh, distance=0.03, quads=500, semi_regular=True)["result"]
    assert result["reached"] and result["hausdorff"]["upper_relative"] <= 0.03 and result["folded"] == 0
    assert result["quads"] <= 500
    check_patches(client, result)


def test_where_the_surface_was_moved_to(client, surface):
    shift = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]
    moved = remesh(client, {"mesh": surface, "transform": shift}, quads=300)["result"]
    box = client.get("/v1/meshes/" + moved["mesh"]).json()["bounding_box"]
    assert box["min"][0] > 3.5 and box["max"][0] < 6.5


def test_stages_are_streamed(client, surface):
    request = {"type": "remesh", "mesh": surface, "quads": 400, "semi_regular": True}
    events = ndjson(client.post("/v1/jobs", json=request, headers={"Accept": "application/x-ndjson"}).text)
    assert [event["seq"] for event in events] == list(range(1, len(events) + 1))
    stages = [event["stage"] for event in events[:-1]]
    assert stages[:3] == ["quads", "measure", "layout"] and stages[-1] == "measure" and "fill" in stages
    assert all(event["event"] == "stage" and event["quads"] > 0 for event in events[:-1])
    times = [event["elapsed_ms"] for event in events[:-1]]
    assert times == sorted(times)
    told = [event["hausdorff"] for event in events[:-1] if "hausdorff" in event]
    assert all(0 < bounds["lower"] <= bounds["upper"] for bounds in told)
    assert events[-1]["event"] == "result" and events[-1]["result"]["patches"] > 0


@pytest.mark.parametrize("fields, pointer", [
    ({"quads": 0}, "/quads"), ({"quads": 1000001}, "/quads"), ({"quads": 1.5}, "/quads"), ({"quads": "bilinear"}, "/quads"),
    ({"distance": 0}, "/distance"), ({"distance": "1"}, "/distance"), ({"crease_angle": -1}, "/crease_angle"),
    ({"crease_angle": 180.5}, "/crease_angle"), ({"semi_regular": 1}, "/semi_regular"), ({"nonsense": 1}, "/nonsense"),
    ({"mesh": "m_none!"}, "/mesh"), ({"gap": 1e-3}, "/gap")])
def test_faults_of_the_request_are_named(client, surface, fields, pointer):
    body = {"type": "remesh", "mesh": surface, **fields}
    problem = check_problem(client.post("/v1/jobs", json=body), 400, "invalid_field")
    assert [error["pointer"] for error in problem["errors"]] == [pointer]


def test_what_is_no_surface_fails(client):
    check_problem(client.post("/v1/jobs", json={"type": "remesh", "mesh": "m_2222222222222222222a"}), 404, "mesh_not_found")
    chance = random.Random(4)
    cases = {"fill space": [[chance.random() for _ in range(3)] for _ in range(50)],
             "too few": [[1, 2, 3]] * 40 + [[chance.random() for _ in range(3)] for _ in range(8)],
             "along lines": [[i, 2 * i, 3 * i] for i in range(60)]}
    for words, points in cases.items():
        cloud = client.upload(shapes.xyz((points, [])), format="xyz")["id"]
        for semi_regular in (False, True):
            job = remesh(client, cloud, semi_regular=semi_regular)
            assert job["state"] == "failed" and job["problem"]["code"] == "empty_mesh" and "result" not in job
            assert words in job["problem"]["detail"]


def test_quads_of_points(client):
    points = [p for p in torus(90, 40)[0] if math.dist(p, (1.3, 0, 0)) > 0.32]
    cloud = client.upload(shapes.xyz((points + [(0, 0, 1), (3, 1, 2)], [])), format="xyz", name="points")["id"]
    for fields in ({"quads": 900}, {"quads": 2000, "semi_regular": True}):
        result = remesh(client, cloud, **fields)["result"]
        mesh = client.get("/v1/meshes/" + result["mesh"]).json()
        assert mesh["euler_number"] == 0 and mesh["watertight"] and result["folded"] == 0
        told = result["points"]
        assert told["used"] == len(points) and told["outliers"] == 2 and told["noise_relative"] == 0 and told["normals"] == "estimated"
        assert told["holes_filled"] == 1 and 0 < told["filled_share"] < 0.01 and told["borders"] == 0
        # The distance told is that of the points, of which two are far; the quads are near their surface.
        assert result["from_surface"]["lower"] > 1 and told["hausdorff"]["upper_relative"] < 0.01
        again = client.hausdorff(cloud, result["mesh"])["result"]
        assert result["hausdorff"]["lower"] <= again["upper"] and again["lower"] <= result["hausdorff"]["upper"]
    events = ndjson(client.post("/v1/jobs", headers={"Accept": "application/x-ndjson"}, json={"type": "remesh", "mesh": cloud, "quads": 900}).text)
    assert [event["stage"] for event in events if event["event"] == "stage"] == ["surface", "quads", "measure"]


@pytest.mark.parametrize("fields", [{"quads": 100000}, {"quads": 20000, "semi_regular": True}])
def test_a_job_can_be_canceled_at_any_time(client, surface, fields):
    before = len(client.get("/v1/meshes", params={"limit": 1000}).json()["meshes"])
    for pause in (0, 0.1, 0.4, 0.9):
        job = client.post("/v1/jobs", json={"type": "remesh", "mesh": surface, **fields}).json()
        client.wait_until_running(job["id"])
        time.sleep(pause)
        assert client.delete("/v1/jobs/" + job["id"]).status_code == 202
        ended = client.wait(job["id"])
        assert ended["state"] == "canceled" and "result" not in ended and ended["problem"]["code"] == "conflict"
    assert len(client.get("/v1/meshes", params={"limit": 1000}).json()["meshes"]) == before


def test_a_reader_that_leaves_cancels_it(client, surface):
    request = {"type": "remesh", "mesh": surface, **LONG}
    with client.stream("POST", "/v1/jobs", json=request, headers={"Accept": "application/x-ndjson"}) as reply:
        place = reply.headers["location"]
        assert json.loads(next(reply.iter_lines()))["stage"] == "quads"
    assert client.wait(place.rsplit("/", 1)[1])["state"] == "canceled"


def test_whoever_polls_sees_the_stage(client, surface):
    job = client.post("/v1/jobs", json={"type": "remesh", "mesh": surface, **LONG}).json()
    shown = client.wait_for_progress(job["id"])
    assert shown["state"] == "running"
    assert shown["progress"]["stage"] == "quads" and shown["progress"]["quads"] == LONG["quads"]
    client.delete("/v1/jobs/" + job["id"])
    assert client.wait(job["id"])["progress"]["stage"] == "quads"


def test_a_deadline_ends_it(client, surface):
    job = remesh(client, surface, deadline_ms=150, **LONG)
    assert job["state"] == "failed" and job["problem"]["code"] == "deadline_exceeded"


def test_the_limit_of_the_daemon_ends_it(make_daemon):
    running = make_daemon("--max-job-seconds", 1)
    with running.client() as client:
        job = remesh(client, client.upload(torus())["id"], **LONG)
        assert job["state"] == "failed" and job["problem"]["code"] == "deadline_exceeded"


def test_it_shares_the_memory(make_daemon):
    running = make_daemon("--memory-budget", 24 << 20)
    with running.client() as client:
        mesh = client.upload(torus())["id"]
        job = remesh(client, mesh, **LONG)
        assert job["state"] == "failed" and job["problem"]["code"] == "out_of_memory"
        assert remesh(client, mesh, quads=200)["state"] == "succeeded"


def test_its_mesh_is_within_the_quota(make_daemon):
    running = make_daemon("--max-data-bytes", 3 << 17)
    with running.client() as client:
        mesh = client.upload(torus(40, 20))["id"]
        job = remesh(client, mesh, quads=10000)
        assert job["state"] == "failed" and job["problem"]["code"] == "storage_full"
        assert remesh(client, mesh, quads=200)["state"] == "succeeded"


def test_lines_of_a_batch_and_jobs_side_by_side(client, surface):
    lines = [{"key": n, "type": "remesh", "mesh": surface, "quads": n} for n in (250, 350, 250)]
    reply = client.post("/v1/batches", content="".join(json.dumps(line) + "\n" for line in lines),
                        headers={"Content-Type": "application/x-ndjson"})
    answers = [json.loads(line) for line in reply.text.splitlines() if "key" in json.loads(line)]
    assert sorted(answer["key"] for answer in answers) == [250, 250, 350]
    made = {answer["key"]: answer["result"]["mesh"] for answer in answers}
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        jobs = list(pool.map(lambda n: remesh(client, surface, quads=n)["result"], (250, 350, 250, 350)))
    assert [job["mesh"] for job in jobs] == [made[250], made[350], made[250], made[350]]
    for mesh in made.values():
        assert client.get(f"/v1/meshes/{mesh}/content?format=obj").status_code == 200


def test_a_daemon_that_is_killed_makes_it_again(make_daemon):
    running = make_daemon()
    with running.client() as client:
        mesh = client.upload(torus())["id"]
        done = remesh(client, mesh, quads=300)
        job = client.post("/v1/jobs", json={"type": "remesh", "mesh": mesh, "quads": 12000}).json()
        client.wait_until_running(job["id"])
        time.sleep(0.2)
    running.stop(signal.SIGKILL)
    running.start()
    with running.client() as client:
        ended = client.wait(job["id"])
        assert ended["state"] == "succeeded"
        assert client.get("/v1/meshes/" + ended["result"]["mesh"]).json()["faces"]["quads"] == ended["result"]["quads"]
        events = client.events(job["id"])
        assert events[-1]["event"] == "result" and any(event["event"] == "server_restart" for event in events)
        # What had ended before is as it was, with its mesh.
        assert client.get("/v1/jobs/" + done["id"]).json() == done
        assert client.get("/v1/meshes/" + done["result"]["mesh"]).status_code == 200
