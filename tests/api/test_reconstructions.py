"""Reconstructions: a layout on a mesh or a point set becomes a quad mesh, step by step."""
import math
import os
import random
import signal
import threading
import time

import httpx
import pytest

import shapes
from conftest import IS_SHARED, WAIT, check_problem, ndjson
from test_layouts import PLACES, curve, edit, on_saddle, saddle_layout, saddle, stroke  # noqa: F401 (saddle is a fixture)


KILLS = 60 if os.environ.get("QM_TEST_LONG", "0") != "0" else 12


def points(count, seed):
    chance = random.Random(seed)
    rows = (on_saddle(chance.uniform(-1, 1), chance.uniform(-1, 1)) for _ in range(count))
    return "".join("%.9f %.9f %.9f\n" % tuple(row) for row in rows).encode()


def start(client, mesh, **options):
    layout = client.post("/v1/layouts", json={"mesh": mesh, **saddle_layout()}).json()
    reply = client.post("/v1/reconstructions", json={"layout": layout["id"], **options})
    assert reply.status_code == 201, reply.text
    assert reply.headers["location"] == "/v1/reconstructions/" + reply.json()["id"]
    return reply.json()


def refine(client, reconstruction, **fields):
    reply = client.post("/v1/jobs", headers={"Prefer": WAIT},
                        json={"type": "reconstruction_step", "reconstruction": reconstruction["id"], **fields})
    assert reply.status_code == 200, reply.text
    return reply.json()


def test_a_mesh_becomes_quads(client, saddle):
    made = start(client, saddle)
    assert made["quads"] == 2 and made["patch_count"] == 2 and made["step_count"] == 0
    assert made["coverage"]["uncovered_samples"] == 0
    job = refine(client, made, until={"max_quads": 512})
    result = job["result"]
    assert job["state"] == "succeeded" and result["stopped_by"] == "max_quads" and 0.95 * 512 <= result["quads"] <= 512
    bounds = [step["hausdorff"] for step in result["steps"]]
    assert all(b["lower"] <= b["upper"] for b in bounds)
    assert bounds[-1]["upper_relative"] < 2e-3
    assert all(later["upper"] < sooner["upper"] for sooner, later in zip(bounds, bounds[2:]))

    mesh = client.get("/v1/meshes/" + result["mesh"]).json()
    assert mesh["faces"] == {"triangles": 0, "quads": result["quads"], "polygons": 0}
    assert mesh["irregular_vertices"] == 0 and mesh["manifold"] and mesh["components"] == 1
    distance = client.hausdorff(saddle, result["mesh"], tolerance=1e-4)["result"]
    assert distance["lower"] <= bounds[-1]["upper"] and bounds[-1]["lower"] <= distance["upper"]

    now = client.get("/v1/reconstructions/" + made["id"]).json()
    assert now["mesh"] == result["mesh"] and now["quads"] == result["quads"] and now["steps"] == result["steps"]
    patches = client.get(f"/v1/reconstructions/{made['id']}/patches").json()
    assert sum(p["columns"] * p["rows"] for p in patches["patches"]) == patches["quads"] == result["quads"]
    first = patches["patches"][0]
    assert [p["first_face"] for p in patches["patches"]] == [0, first["columns"] * first["rows"]]
    found = client.get(f"/v1/meshes/{result['mesh']}/patches").json()
    # No node is irregular, and found by a search the two would be one; but they are known.
    assert found["patch_count"] == 2
    assert [(p["rows"], p["columns"]) for p in found["patches"]] == [(p["rows"], p["columns"]) for p in patches["patches"]]
    # So are they in the texture coordinates: each has its vertices to itself.
    textured = client.get(f"/v1/meshes/{result['mesh']}/content?format=ply&uv=patches").content
    apart = sum((p["rows"] + 1) * (p["columns"] + 1) for p in patches["patches"])
    assert f"element vertex {apart}\n".encode() in textured and b"property float s\n" in textured
    content = client.get(f"/v1/meshes/{result['mesh']}/content?format=obj").content
    assert client.upload(content, format="obj")["patches"] == 1


def test_vertices_move_at_the_end(client, saddle):
    plain = refine(client, start(client, saddle), until={"max_quads": 512})["result"]
    made = start(client, saddle)
    result = refine(client, made, until={"max_quads": 512}, settle=True)["result"]
    assert "settled" not in plain and result["quads"] == plain["quads"] and result["mesh"] != plain["mesh"]
    assert [step["hausdorff"] for step in result["steps"]] == [step["hausdorff"] for step in plain["steps"]]
    told, before = result["settled"], plain["steps"][-1]["hausdorff"]
    assert told["kept"] and told["quality"]["folded_quads"] == 0
    assert max(told["from_surface"]["upper"], told["from_quads"]["upper"]) == told["hausdorff"]["upper"] <= 1.25 * before["upper"]
    distance = client.hausdorff(saddle, result["mesh"], tolerance=1e-4)["result"]
    assert distance["lower"] <= told["hausdorff"]["upper"] and told["hausdorff"]["lower"] <= distance["upper"]
    now = client.get("/v1/reconstructions/" + made["id"]).json()
    assert now["mesh"] == result["mesh"] and now["step_count"] == result["step_count"]
    # The next steps start from the vertices before: the same mesh comes of them, settled or not.
    assert client.get(f"/v1/meshes/{result['mesh']}/patches").json()["patch_count"] == 2
    further = [refine(client, of, until={"max_quads": 2100})["result"]["mesh"]
               for of in (made, start(client, saddle)) if of is made or refine(client, of, until={"max_quads": 512})]
    assert further[0] == further[1]


def test_what_is_complete_is_settled(client, saddle):
    made = start(client, saddle)
    plain = refine(client, made, until={"max_quads": 512}, measure=False)["result"]
    result = refine(client, made, until={"max_quads": 512}, settle=True)["result"]
    assert result["steps"] == [] and result["step_count"] == 0 and result["settled"]["kept"]
    assert result["mesh"] != plain["mesh"] and result["quads"] == plain["quads"]
    now = client.get("/v1/reconstructions/" + made["id"]).json()
    assert now["mesh"] == result["mesh"] and now["steps"] == plain["steps"]


def test_what_cannot_be_settled_is_told(client, saddle):
    kept = start(client, saddle, pull_curves=False)
    reply = client.post("/v1/jobs", json={"type": "reconstruction_step", "reconstruction": kept["id"], "settle": True})
    assert check_problem(reply, 400, "invalid_field")["errors"][0]["pointer"] == "/settle"
    made = start(client, client.upload(points(4000, 3), format="xyz")["id"])
    job = refine(client, made, until={"max_quads": 512}, settle=True)
    assert job["state"] == "failed" and job["problem"]["code"] == "invalid_field" and "point set" in job["problem"]["detail"]
    assert client.get("/v1/reconstructions/" + made["id"]).json()["step_count"] == 0


def subtract(a, b):
    return [x - y for x, y in zip(a, b)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def corner_sines(quad):
    """Sines at the corners, seen along the normal of the quad."""
    normal = cross(subtract(quad[2], quad[0]), subtract(quad[3], quad[1]))
    for k in range(4):
        on, back = subtract(quad[(k + 1) % 4], quad[k]), subtract(quad[k - 1], quad[k])
        yield sum(map(math.prod, zip(cross(on, back), normal))) / (math.hypot(*on) * math.hypot(*back) * math.hypot(*normal))


def test_the_shape_of_the_quads_is_told(client, saddle):
    made = start(client, saddle)
    result = refine(client, made, until={"max_quads": 128}, measure=False)["result"]
    quality = result["steps"][-1]["quality"]
    text = client.get(f"/v1/meshes/{result['mesh']}/content?format=off").text.split()
    vertices, faces = int(text[1]), int(text[2])
    places = [[float(x) for x in text[4 + 3 * i:7 + 3 * i]] for i in range(vertices)]
    rows = [[int(x) for x in text[5 + 3 * vertices + 5 * i:9 + 3 * vertices + 5 * i]] for i in range(faces)]
    quads = [[places[i] for i in row] for row in rows]
    assert quality["folded_quads"] == 0 and quality["turned_quads"] == 0
    assert quality["least_jacobian"] == pytest.approx(min(sine for quad in quads for sine in corner_sines(quad)))
    ratios = []
    for quad in quads:
        lengths = [math.dist(quad[k], quad[k - 1]) for k in range(4)]
        ratios.append(max(lengths) / min(lengths))
    assert quality["max_edge_ratio"] == pytest.approx(max(ratios))
    assert quality["mean_edge_ratio"] == pytest.approx(sum(ratios) / len(ratios))
    assert 0 < quality["mean_warp"] < quality["max_warp"] < 0.1
    assert 0 < quality["mean_angle_deviation_deg"] < quality["max_angle_deviation_deg"] < 40


def test_a_point_set_becomes_quads(client):
    cloud = client.upload(points(6000, seed=3), format="xyz", name="cloud.xyz")["id"]
    made = start(client, cloud)
    assert client.get("/v1/meshes/" + made["mesh"]).json()["name"] == "cloud.xyz, 2 quads"
    steps = refine(client, made, until={"hausdorff_relative": 0.003})["result"]
    assert steps["stopped_by"] == "hausdorff"
    last = steps["steps"][-1]
    assert last["hausdorff"]["upper_relative"] <= 0.003
    assert last["mesh_to_points"]["upper"] >= last["mesh_to_points"]["lower"] > 0
    assert last["uncovered_points"] == 0


def test_what_is_not_drawn_does_not_keep_a_goal_away(client):
    """One of the two patches alone: points beyond its boundary are counted, and the distance is measured from the others."""
    cloud = client.upload(points(6000, seed=11), format="xyz")["id"]
    whole = saddle_layout()
    first = whole["patches"][0]
    half = {**whole, "curves": [line for line in whole["curves"] if line["id"] in first], "patches": [first]}
    layout = client.post("/v1/layouts", json={"mesh": cloud, **half}).json()
    assert len(layout["patches"]) == 1
    made = client.post("/v1/reconstructions", json={"layout": layout["id"]}).json()
    done = refine(client, made, until={"hausdorff_relative": 0.003, "max_quads": 5000})["result"]
    last = done["steps"][-1]
    assert done["stopped_by"] == "hausdorff" and last["covered"]["upper_relative"] <= 0.003
    assert last["hausdorff"]["upper_relative"] > 0.2
    assert last["uncovered_points"] + last["beyond_points"] == pytest.approx(3000, rel=0.1)
    assert last["beyond_points"] > 0


def test_strokes_over_points_become_quads(client):
    """All by the window: five strokes over a point set, a goal of distance, a stroke that moves one border."""
    cloud = client.upload(points(20000, seed=12), format="xyz")["id"]
    layout = client.post("/v1/layouts", json={"mesh": cloud}).json()
    inside = [(0.8 * x, 0.8 * y) for x, y in PLACES]
    for a, b in [(0, 2), (2, 3), (3, 5), (5, 0), (1, 4)]:
        layout = edit(client, layout, "strokes", **stroke(curve(inside[a], inside[b], 40)))
    assert layout["complete"] and len(layout["patches"]) == 2
    made = client.post("/v1/reconstructions", json={"layout": layout["id"]}).json()
    done = refine(client, made, until={"hausdorff_relative": 2e-3, "max_quads": 20000})["result"]
    last = done["steps"][-1]
    assert done["stopped_by"] == "hausdorff" and last["covered"]["upper_relative"] <= 2e-3
    assert last["quality"]["folded_quads"] == last["quality"]["turned_quads"] == 0
    assert all(abs(z - x * y) < 0.01 for x, y, z in places(client, done["mesh"]))
    rim = next(line for line in layout["curves"] if all(x < -0.7 for x, _, _ in line["points"]))
    ends = [tuple(rim["points"][k][:2]) for k in (0, -1)]
    bent = [(x - 0.1 * math.sin(math.pi * k / 40), y) for k, (x, y, _) in enumerate(curve(*ends, 40))]
    layout = edit(client, layout, f"curves/{rim['id']}/redraw", **stroke([on_saddle(*place) for place in bent]))
    now = client.put(f"/v1/reconstructions/{made['id']}/layout", json={"layout": layout["id"]}).json()
    assert now["redone_patches"] == 1 and now["quads"] == done["quads"]
    assert min(x for x, _, _ in places(client, now["mesh"])) < -0.88


def test_steps_are_streamed(client, saddle):
    made = start(client, saddle)
    request = {"type": "reconstruction_step", "reconstruction": made["id"], "steps": 4}
    reply = client.post("/v1/jobs", json=request, headers={"Accept": "application/x-ndjson"})
    events = ndjson(reply.text)
    assert [event["event"] for event in events] == ["step"] * 4 + ["result"]
    assert [event["seq"] for event in events] == [1, 2, 3, 4, 5]
    assert [event["quads"] for event in events[:-1]] == sorted(event["quads"] for event in events[:-1])
    assert events[-1]["result"]["stopped_by"] == "steps"
    # Asked again it goes on: such a job is never answered from one before.
    again = refine(client, made, steps=1, measure=False)
    assert "cached" not in again and again["result"]["quads"] > events[-1]["result"]["quads"]
    assert again["result"]["steps"][0]["hausdorff"] is None


def test_goals_of_edge_length_and_limits(client, saddle):
    made = start(client, saddle)
    result = refine(client, made, until={"edge_length": 0.3}, measure=False)["result"]
    assert result["stopped_by"] == "edge_length"
    assert result["steps"][-1]["longest_edge"] <= 0.3 < result["steps"][-2]["longest_edge"]
    # Nothing fits any more: no step, the same mesh.
    none = refine(client, made, until={"max_quads": result["quads"]})["result"]
    assert none["steps"] == [] and none["mesh"] == result["mesh"] and none["quads"] == result["quads"]


def test_the_content_is_redirected(client, saddle):
    made = start(client, saddle)
    reply = client.get(f"/v1/reconstructions/{made['id']}/mesh", params={"format": "off"})
    assert reply.status_code == 307
    assert reply.headers["location"] == f"/v1/meshes/{made['mesh']}/content?format=off"
    check_problem(client.get(f"/v1/reconstructions/{made['id']}/mesh?format=AAA"), 400, "invalid_parameter")
    body = client.get(f"/v1/reconstructions/{made['id']}/mesh?format=off", follow_redirects=True)
    assert body.text.startswith("OFF")


def test_a_canceled_job_keeps_the_last_whole_step(client, saddle):
    made = start(client, saddle)
    request = {"type": "reconstruction_step", "reconstruction": made["id"], "until": {"max_quads": 4000000},
               "measure": False}
    job = client.post("/v1/jobs", json=request).json()
    end = time.monotonic() + 60
    while not any(event["event"] == "step" for event in stream_so_far(client, job)):
        assert time.monotonic() < end
    busy = client.post("/v1/jobs", headers={"Prefer": WAIT},
                       json={"type": "reconstruction_step", "reconstruction": made["id"], "steps": 1}).json()
    assert client.delete("/v1/jobs/" + job["id"]).status_code in (202, 409)
    ended = client.wait(job["id"])
    assert ended["state"] in ("canceled", "succeeded")
    if busy["state"] == "failed":
        assert busy["problem"]["code"] == "conflict"
    now = client.get("/v1/reconstructions/" + made["id"]).json()
    mesh = client.get("/v1/meshes/" + now["mesh"]).json()
    assert mesh["faces"]["quads"] == now["quads"] >= ended["result"]["quads"]
    assert ended["result"]["steps"][-1]["quads"] == ended["result"]["quads"]


def test_a_rebuild_can_be_left(make_daemon):
    """After a restart the first job takes all earlier steps again; it ends when it is canceled or late meanwhile."""
    running = make_daemon()
    with running.client() as client:
        made = start(client, client.upload(shapes.saddle(24))["id"])
        refine(client, made, until={"max_quads": 8000}, measure=False)
        before = client.get(f"/v1/reconstructions/{made['id']}").json()
    running.stop()
    running.start()
    with running.client() as client:
        request = {"type": "reconstruction_step", "reconstruction": made["id"], "steps": 1, "measure": False}
        late = refine(client, made, steps=1, measure=False, deadline_ms=20)
        assert late["state"] == "failed" and late["problem"]["code"] == "deadline_exceeded", late
        job = client.post("/v1/jobs", json=request).json()
        client.wait_until_running(job["id"])
        assert client.delete(f"/v1/jobs/{job['id']}").status_code == 202
        ended = client.wait(job["id"])
        assert ended["state"] == "canceled" and "before its first step" in ended["problem"]["detail"], ended
        assert client.get(f"/v1/reconstructions/{made['id']}").json() == before
        after = refine(client, made, steps=1, measure=False)
        assert after["state"] == "succeeded" and after["result"]["quads"] > before["quads"]


def test_a_reconstruction_ends_at_its_deadline_and_is_not_stored(client):
    mesh = client.upload(points(60000, 5), format="xyz")["id"]
    layout = client.post("/v1/layouts", json={"mesh": mesh, **saddle_layout()}).json()["id"]
    for deadline in (1, 20):
        late = client.post("/v1/reconstructions", json={"layout": layout, "deadline_ms": deadline})
        assert f" {deadline} ms" in check_problem(late, 504, "deadline_exceeded")["detail"]
    assert client.get("/v1/reconstructions", params={"mesh": mesh}).json()["reconstructions"] == []
    for deadline in (0, -1, "1", None):
        problem = check_problem(client.post("/v1/reconstructions", json={"layout": layout, "deadline_ms": deadline}), 400, "invalid_field")
        assert problem["errors"][0]["pointer"] == "/deadline_ms"
    made = client.post("/v1/reconstructions", json={"layout": layout, "deadline_ms": 1e7})
    assert made.status_code == 201
    refine(client, made.json(), steps=1, measure=False)


def test_going_over_to_an_edited_layout_ends_at_its_deadline(make_daemon):
    running = make_daemon()
    with running.client() as client:
        made = start(client, client.upload(shapes.saddle(24))["id"])
        refine(client, made, until={"max_quads": 8000}, measure=False)
        bend(client, made["layout"])
        before = client.get(f"/v1/reconstructions/{made['id']}").json()
    running.stop()
    running.start()
    with running.client() as client:
        path, layout = f"/v1/reconstructions/{made['id']}", {"layout": made["layout"]}
        late = client.put(f"{path}/layout", json=layout, params={"deadline_ms": 20})
        assert "20 ms" in check_problem(late, 504, "deadline_exceeded")["detail"]
        check_problem(client.put(f"{path}/layout", json=layout, params={"deadline_ms": 0}), 400, "invalid_parameter")
        assert client.get(path).json() == before
        done = client.put(f"{path}/layout", json=layout, params={"deadline_ms": 600000})
        assert done.status_code == 200 and done.json()["redone_patches"] == 1


def stream_so_far(client, job):
    with client.stream("GET", f"/v1/jobs/{job['id']}/events",
                       headers={"Accept": "application/x-ndjson"}) as reply:
        for line in reply.iter_lines():
            return ndjson(line)
    return []


def check_alike_after_a_kill(make_daemon, begin, limits):
    """Refines to a first limit of quads, and to a second one: the same mesh whether the daemon is killed between them or not."""
    meshes = []
    for is_killed in (False, True):
        running = make_daemon()
        with running.client() as client:
            made = begin(client)
            refine(client, made, until={"max_quads": limits[0]}, measure=False)
        if is_killed:
            running.stop(signal.SIGKILL)
            running.start()
        with running.client() as client:
            result = refine(client, made, until={"max_quads": limits[1]}, measure=False)["result"]
            meshes.append(client.get(f"/v1/meshes/{result['mesh']}/content?format=ply").content)
    assert meshes[0] == meshes[1]


def test_steps_go_on_after_a_kill_to_the_same_bits(make_daemon):
    check_alike_after_a_kill(make_daemon, lambda client: start(client, client.upload(shapes.saddle(24))["id"]), (600, 3000))


def listed_meshes(client):
    return {mesh["id"] for mesh in client.get("/v1/meshes?limit=1000").json()["meshes"]}


def kill_during(running, work, is_due):
    """Kills the daemon once is_due while another thread works; work ends with its connection."""
    def run():
        with running.client() as client:
            try:
                work(client)
            except httpx.TransportError:
                pass
    thread = threading.Thread(target=run)
    with running.client() as client:
        thread.start()
        end = time.monotonic() + 60
        while not is_due(client):
            assert time.monotonic() < end
    running.stop(signal.SIGKILL)
    thread.join()
    running.start()


def moments(chance, has_begun):
    """When to kill: by turns up to 10 ms after the start, and as soon as something is there to be read."""
    due = time.monotonic() + chance.uniform(0, 0.01)
    return has_begun if chance.random() < 0.5 else lambda client: time.monotonic() > due


def test_a_step_is_taken_once_whenever_the_daemon_is_killed(make_daemon):
    """The job is unfinished and the reconstruction as before, or both are done."""
    seed = int(os.environ.get("QM_TEST_SEED", "1"))
    chance = random.Random(seed)
    running = make_daemon()
    with running.client() as client:
        source = client.upload(shapes.saddle(24))["id"]
    kept = {source}
    for k in range(KILLS):
        with running.client() as client:
            made = start(client, source)
        jobs, path = [], "/v1/reconstructions/" + made["id"]
        request = {"type": "reconstruction_step", "reconstruction": made["id"], "steps": 3, "measure": False}
        kill_during(running, lambda client: jobs.append(client.post("/v1/jobs", json=request).json()["id"]),
                    moments(chance, lambda client: jobs and client.get(path).json()["step_count"] > 0))
        with running.client() as client:
            listed = client.get("/v1/jobs?reconstruction=" + made["id"]).json()["jobs"]
            assert len(listed) == 1 or not jobs, (seed, k)
            for job in listed:
                ended = client.wait(job["id"])
                assert ended["state"] == "succeeded" and ended["result"]["step_count"] == 3, (seed, k, ended)
            now = client.get(path).json()
            assert now["step_count"] == 3 * len(listed), (seed, k, now)
            assert not listed or now["mesh"] == ended["result"]["mesh"], (seed, k, now)
            kept |= {made["mesh"], now["mesh"]}
            assert listed_meshes(client) == kept, (seed, k)


def test_a_reconstruction_comes_with_its_mesh_or_not_at_all(make_daemon):
    seed = int(os.environ.get("QM_TEST_SEED", "2"))
    chance = random.Random(seed)
    running = make_daemon()
    with running.client() as client:
        source = client.upload(shapes.saddle(24))["id"]
    for k in range(KILLS):
        with running.client() as client:
            before = len(listed_meshes(client))
        kill_during(running, lambda client: start(client, source),
                    moments(chance, lambda client: len(listed_meshes(client)) > before))
        with running.client() as client:
            made = client.get("/v1/reconstructions?limit=1000").json()["reconstructions"]
            assert listed_meshes(client) == {source} | {one["mesh"] for one in made}, (seed, k)


def bend(client, layout_id):
    """Replaces curve 0, which bounds the first patch alone."""
    line = [on_saddle(-1 + k / 8, -1 + 0.05 * k * (8 - k) / 16) for k in range(9)]
    return edit(client, {"id": layout_id}, "curves/0/redraw", points=line)


def test_an_edit_redoes_only_what_it_touches(client, saddle):
    made = start(client, saddle)
    quads = refine(client, made, until={"max_quads": 512}, measure=False)["result"]["quads"]
    bend(client, made["layout"])
    reply = client.put(f"/v1/reconstructions/{made['id']}/layout", json={"layout": made["layout"]})
    assert reply.status_code == 200, reply.text
    now = reply.json()
    assert now["redone_patches"] == 1 and now["quads"] == quads and now["step_count"] == len(now["steps"]) and now["revision"] == 2
    assert now["mesh"] != made["mesh"]
    again = client.put(f"/v1/reconstructions/{made['id']}/layout", json={"layout": made["layout"]}).json()
    assert again["redone_patches"] == 0
    assert refine(client, made, steps=1, measure=False)["result"]["quads"] > 512
    check_problem(client.put(f"/v1/reconstructions/{made['id']}/layout", json={"layout": "l_none"}), 404,
                  "layout_not_found")
    check_problem(client.put("/v1/reconstructions/r_none/layout", json={"layout": made["layout"]}), 404,
                  "reconstruction_not_found")
    client.delete(f"/v1/layouts/{made['layout']}/curves/1")
    client.delete(f"/v1/layouts/{made['layout']}/curves/0")
    check_problem(client.put(f"/v1/reconstructions/{made['id']}/layout", json={"layout": made["layout"]}), 422,
                  "invalid_layout")


def test_edits_survive_a_kill(make_daemon):
    meshes = []
    for is_killed in (False, True):
        running = make_daemon()
        with running.client() as client:
            made = start(client, client.upload(shapes.saddle(24))["id"])
            refine(client, made, until={"max_quads": 300}, measure=False)
            bend(client, made["layout"])
            client.put(f"/v1/reconstructions/{made['id']}/layout", json={"layout": made["layout"]})
        if is_killed:
            running.stop(signal.SIGKILL)
            running.start()
        with running.client() as client:
            result = refine(client, made, until={"max_quads": 1100}, measure=False)["result"]
            meshes.append(client.get(f"/v1/meshes/{result['mesh']}/content?format=ply").content)
    assert meshes[0] == meshes[1]


def test_bad_requests_are_refused(client, saddle):
    check_problem(client.post("/v1/reconstructions", json={}), 400, "invalid_field")
    check_problem(client.post("/v1/reconstructions", json={"layout": "l_none"}), 404, "layout_not_found")
    empty = client.post("/v1/layouts", json={"mesh": saddle}).json()
    problem = check_problem(client.post("/v1/reconstructions", json={"layout": empty["id"]}), 422, "invalid_layout")
    assert "no patch" in problem["detail"]
    made = start(client, saddle)
    layout = {"layout": made["layout"]}
    check_problem(client.post("/v1/reconstructions", json={**layout, "cover_share": 0}), 400, "invalid_field")
    check_problem(client.post("/v1/reconstructions", json={**layout, "source": "m_none"}), 404, "mesh_not_found")
    # A surface that the layout does not lie on.
    far = client.upload(shapes.cube(origin=(50, 50, 50)))["id"]
    problem = check_problem(client.post("/v1/reconstructions", json={**layout, "source": far}), 422, "invalid_layout")
    assert "outside its box" in problem["detail"]
    check_problem(client.get("/v1/reconstructions/r_none"), 404, "reconstruction_not_found")
    for fields in ({"steps": 0}, {"until": {"max_quads": 0}}, {"until": {"quads": 7}}, {"until": 7},
                   {"quads": "bilinear"}, {"measure": 1}):
        reply = client.post("/v1/jobs", json={"type": "reconstruction_step", "reconstruction": made["id"], **fields})
        check_problem(reply, 400, "invalid_field")
    reply = client.post("/v1/jobs", json={"type": "reconstruction_step", "reconstruction": "r_none"})
    check_problem(reply, 404, "reconstruction_not_found")
    assert client.delete("/v1/reconstructions/" + made["id"]).status_code == 204
    check_problem(client.get("/v1/reconstructions/" + made["id"]), 404, "reconstruction_not_found")


def places(client, mesh):
    """The vertices of a mesh."""
    text = client.get(f"/v1/meshes/{mesh}/content?format=obj").text
    return [[float(x) for x in line.split()[1:4]] for line in text.splitlines() if line.startswith("v ")]


def with_normals(rows, sign):
    """A PLY file of points on the saddle with its normals, times a sign drawn for each."""
    lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
    lines += [f"property double {name}" for name in ("x", "y", "z", "nx", "ny", "nz")] + ["end_header"]
    for row in rows:
        x, y, _ = map(float, row.split())
        side = sign()
        lines.append(f"{row} {-side * y!r} {-side * x!r} {side}")
    return ("\n".join(lines) + "\n").encode()


def upward(client, mesh):
    """How many quads of a mesh look up."""
    vertices, count = places(client, mesh), 0
    text = client.get(f"/v1/meshes/{mesh}/content?format=obj").text
    for a, b, c, d in ([int(word) - 1 for word in line.split()[1:]] for line in text.splitlines() if line[:2] == "f "):
        first, second = subtract(vertices[c], vertices[a]), subtract(vertices[d], vertices[b])
        count += cross(first, second)[2] > 0
    return count


def test_normals_tell_the_side_unless_they_are_wrong(client):
    rows = points(5000, seed=9).decode().splitlines()
    chance = random.Random(10)
    found = {}
    for name, sign in (("up", lambda: 1), ("down", lambda: -1), ("wrong", lambda: chance.choice((1, -1)))):
        mesh = client.upload(with_normals(rows, sign), format="ply")
        assert mesh["kind"] == "points" and mesh["has_normals"] and mesh["disc_radius"] > 0
        found[name] = refine(client, start(client, mesh["id"]), until={"max_quads": 200}, measure=False)["result"]["mesh"]
    plain = client.upload("\n".join(rows).encode(), format="xyz")
    assert not plain["has_normals"]
    found["none"] = refine(client, start(client, plain["id"]), until={"max_quads": 200}, measure=False)["result"]["mesh"]
    quads = client.get("/v1/meshes/" + found["up"]).json()["faces"]["quads"]
    assert 190 <= quads <= 200 and upward(client, found["up"]) == quads and upward(client, found["down"]) == 0
    assert places(client, found["wrong"]) == places(client, found["none"])


def test_a_hole_over_a_whole_patch_is_named(client):
    rows = [row for row in points(6000, seed=7).decode().splitlines() if float(row.split()[0]) < -0.02]
    layout = client.post("/v1/layouts", json={"mesh": client.upload("\n".join(rows).encode(), format="xyz")["id"],
                                              **saddle_layout()}).json()
    problem = check_problem(client.post("/v1/reconstructions", json={"layout": layout["id"]}), 422, "invalid_layout")
    assert "patch 1 (curves 1, 2, 3, 6)" in problem["detail"]


@pytest.mark.parametrize("spoil", ["hole", "twice", "outliers", "apart"])
def test_point_sets_made_worse(client, spoil):
    rows = points(6000, seed=5).decode().splitlines()
    chance = random.Random(6)
    if spoil == "hole":
        rows = [row for row in rows if not (abs(float(row.split()[0]) - 0.5) < 0.15)]
    if spoil == "twice":
        rows = rows[:3000] * 2
    if spoil == "outliers":
        rows += ["%f %f %f" % tuple(chance.uniform(-2, 2) for _ in range(3)) for _ in range(60)]
    if spoil == "apart":
        rows += ["%f %f 30" % (chance.random(), chance.random()) for _ in range(2000)]
    made = start(client, client.upload("\n".join(rows).encode(), format="xyz")["id"])
    result = refine(client, made, until={"max_quads": 512})["result"]
    mesh = client.get("/v1/meshes/" + result["mesh"]).json()
    assert 0.95 * 512 <= mesh["faces"]["quads"] <= 512
    assert all(math.isfinite(x) and abs(x) < 1.2 for place in places(client, result["mesh"]) for x in place)
    if spoil == "hole":
        assert any(step["holes_filled"] > 0 for step in result["steps"])
    if spoil in ("outliers", "apart"):
        assert made["coverage"]["uncovered_samples"] > 0


def test_what_the_mesh_does_not_show_is_told(client, saddle):
    assert start(client, saddle)["warnings"] == []
    made = client.post("/v1/layouts", json={"mesh": saddle, **saddle_layout()}).json()
    kept = client.post("/v1/layouts", json={"mesh": saddle, "nodes": made["nodes"], "curves": made["curves"],
                                            "patches": made["patches"][:1]}).json()
    warnings = client.post("/v1/reconstructions", json={"layout": kept["id"]}).json()["warnings"]
    assert [w["kind"] for w in warnings] == ["uncovered"] and 0.3 < warnings[0]["share"] < 0.7


def test_layouts_elsewhere_are_refused(client, saddle):
    drawn = saddle_layout()
    for shift, scale, words in ((40, 1, "outside its box"), (0, 1000, "in another unit")):
        far = {"nodes": [[scale * p[0] + shift, *(scale * x for x in p[1:])] for p in drawn["nodes"]],
               "curves": [{**c, "points": [[scale * p[0] + shift, *(scale * x for x in p[1:])] for p in c["points"]]}
                          for c in drawn["curves"]]}
        layout = client.post("/v1/layouts", json={"mesh": saddle, **far}).json()
        problem = check_problem(client.post("/v1/reconstructions", json={"layout": layout["id"]}), 422, "invalid_layout")
        assert words in problem["detail"]


def test_a_limit_that_allows_no_step_fails_and_no_goal_is_the_default(client, saddle):
    made = start(client, saddle)
    job = refine(client, made, until={"max_quads": 2})
    assert job["state"] == "failed" and "no step fits into the limit of 2 quads" in job["problem"]["detail"]
    result = refine(client, made, measure=False)["result"]
    assert result["stopped_by"] == "max_quads" and 9500 < result["quads"] <= 10000


def noisy_points(sigma):
    chance = random.Random(11)
    rows = (on_saddle(chance.uniform(-1, 1), chance.uniform(-1, 1)) for _ in range(6000))
    return "".join("%.9f %.9f %.9f\n" % (x, y, z + chance.gauss(0, sigma)) for x, y, z in rows).encode()


def off_saddle(client, mesh):
    """The root mean square of the vertices' heights over the saddle."""
    rows = client.get(f"/v1/meshes/{mesh}/content?format=obj").text.splitlines()
    heights = [float(r[3]) - on_saddle(float(r[1]), float(r[2]))[2] for r in map(str.split, rows) if r and r[0] == "v"]
    return math.sqrt(sum(height ** 2 for height in heights) / len(heights))


def test_noise_is_fitted_and_told(client):
    mesh = client.upload(noisy_points(0.015), format="xyz")["id"]
    off = {}
    for noise in ("automatic", 0.005, 0):
        made = start(client, mesh, **({} if noise == "automatic" else {"noise": noise}))
        told = {w["kind"]: w for w in made["warnings"]}
        assert made["noise"] == noise and ("noise" in told) == (noise != 0) and "estimated_normals" in told
        off[noise] = off_saddle(client, refine(client, made, until={"max_quads": 400})["result"]["mesh"])
    assert off["automatic"] < 0.2 * 0.015 and off[0.005] < 0.2 * 0.015 and off[0] > 1.5 * off["automatic"]
    layout = client.post("/v1/layouts", json={"mesh": mesh, **saddle_layout()}).json()["id"]
    for wrong in (-0.1, 0.11, "much", None, True, [0.1]):
        problem = check_problem(client.post("/v1/reconstructions", json={"layout": layout, "noise": wrong}), 400,
                                "invalid_field")
        assert problem["errors"][0]["pointer"] == "/noise"


# What is fitted does not depend on the store.
@pytest.mark.parametrize("noise", ["automatic"] if IS_SHARED else ["automatic", 0.004, 0])
def test_noise_is_fitted_alike_after_a_kill(make_daemon, noise):
    check_alike_after_a_kill(
        make_daemon, lambda client: start(client, client.upload(noisy_points(0.015), format="xyz")["id"], noise=noise), (64, 256))
