"""Layouts: given whole or stroke by stroke, edited, undone, and still there after a kill."""
import json
import math
import signal
import socket
import time

import pytest

import shapes
from conftest import PATIENCE, check_problem

# A quad over [-1, 1] squared on the saddle, cut in two by the curve from node 1 to node 4.
PLACES = [(-1, -1), (0, -1), (1, -1), (1, 1), (0, 1), (-1, 1)]
ENDS = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 4)]
PATCHES = [[0, 6, 4, 5], [1, 2, 3, 6]]


def on_saddle(x, y):
    return [x, y, x * y]


def curve(a, b, pieces=8):
    (x, y), (v, w) = a, b
    return [on_saddle(x + (v - x) * k / pieces, y + (w - y) * k / pieces) for k in range(pieces + 1)]


def saddle_layout():
    return {"nodes": [on_saddle(*place) for place in PLACES],
            "curves": [{"id": k, "from": a, "to": b, "points": curve(PLACES[a], PLACES[b])}
                       for k, (a, b) in enumerate(ENDS)],
            "patches": PATCHES}


@pytest.fixture(scope="module")
def saddle(daemon):
    with daemon.client() as made:
        return made.upload(shapes.saddle(24), name="saddle")["id"]


@pytest.fixture
def layout(client, saddle):
    reply = client.post("/v1/layouts", json={"mesh": saddle, **saddle_layout()})
    assert reply.status_code == 201, reply.text
    assert reply.headers["location"] == "/v1/layouts/" + reply.json()["id"]
    return reply.json()


def sides(layout):
    return sorted(sorted(patch) for patch in layout["patches"])


def edit(client, layout, path, **fields):
    reply = client.post(f"/v1/layouts/{layout['id']}/{path}", json=fields)
    assert reply.status_code == 200, reply.text
    return reply.json()


def camera(distance=6.0, width=800, height=600):
    """An eye above the origin."""
    near, far, half = 1.0, 20.0, 0.5
    aspect = width / height
    return {"view": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -distance, 1],
            "projection": [near / (half * aspect), 0, 0, 0, 0, near / half, 0, 0,
                           0, 0, -(far + near) / (far - near), -1, 0, 0, -2 * far * near / (far - near), 0],
            "viewport": [0, 0, width, height]}


def window(point, distance=6.0, width=800, height=600):
    x, y, z = point
    depth = distance - z
    return [width / 2 * (1 + x / depth * 2 * height / width), height / 2 * (1 - y / depth * 2)]


def stroke(points):
    return {"points": [window(point) for point in points], **camera()}


def test_a_whole_layout(client, layout, saddle):
    assert layout["mesh"] == saddle and layout["revision"] == 0
    assert layout["patches"] == PATCHES and layout["issues"] == [] and layout["complete"]
    assert not layout["can_undo"] and not layout["can_redo"]
    assert client.get("/v1/layouts/" + layout["id"]).json() == layout


def test_patches_are_found_when_none_are_named(client, saddle):
    whole = saddle_layout()
    del whole["patches"]
    reply = client.post("/v1/layouts", json={"mesh": saddle, **whole})
    assert reply.status_code == 201
    assert sides(reply.json()) == sorted(sorted(patch) for patch in PATCHES)


def test_lists_have_pages(client, saddle):
    for _ in range(3):
        client.post("/v1/layouts", json={"mesh": saddle})
    page = client.get("/v1/layouts", params={"limit": 2}).json()
    assert len(page["layouts"]) == 2 and page["next"]
    rest = client.get("/v1/layouts", params={"limit": 2, "cursor": page["next"]}).json()
    assert rest["layouts"][0]["id"] not in [one["id"] for one in page["layouts"]]
    assert "curves" not in page["layouts"][0]


def test_a_layout_drawn_stroke_by_stroke(client, saddle):
    layout = client.post("/v1/layouts", json={"mesh": saddle}).json()
    assert layout["curves"] == []
    inside = [(0.9 * x, 0.9 * y) for x, y in PLACES]
    for count, (a, b) in enumerate([(0, 2), (2, 3), (3, 5), (5, 0)], 1):
        layout = edit(client, layout, "strokes", **stroke(curve(inside[a], inside[b])))
        assert layout["stroke"]["missed_points"] == 0
        assert len(layout["curves"]) == count and layout["revision"] == count
        assert layout["changed"]["added_curves"] == [layout["stroke"]["curve"]]
    assert len(layout["nodes"]) == 4 and len(layout["patches"]) == 1 and layout["complete"]
    for row in layout["curves"][0]["points"]:
        assert math.isclose(row[2], row[0] * row[1], abs_tol=2e-3), row
    # A stroke across splits the two curves that it begins and ends on.
    layout = edit(client, layout, "strokes", **stroke(curve(inside[1], inside[4])))
    assert len(layout["curves"]) == 7 and len(layout["patches"]) == 2 and layout["issues"] == []


def test_the_same_stroke_gives_the_same_curve(client, saddle):
    line = stroke(curve((-0.5, -0.3), (0.6, 0.2), 20))
    drawn = []
    for _ in range(2):
        layout = client.post("/v1/layouts", json={"mesh": saddle}).json()
        drawn.append(edit(client, layout, "strokes", **line)["curves"])
    assert drawn[0] == drawn[1]


def test_strokes_that_go_on_are_joined(client, saddle):
    layout = client.post("/v1/layouts", json={"mesh": saddle}).json()
    layout = edit(client, layout, "strokes", **stroke(curve((-0.8, 0), (0, 0))))
    first = layout["stroke"]["curve"]
    layout = edit(client, layout, "strokes", **stroke(curve((0.01, 0), (0.8, 0.1))))
    assert layout["stroke"]["curve"] == first and len(layout["curves"]) == 1
    assert layout["changed"] == {"added_curves": [], "changed_curves": [first], "removed_curves": []}
    kinds = [issue["kind"] for issue in layout["issues"]]
    assert kinds.count("dangling_end") == 2


def test_a_stroke_beside_the_surface_is_refused(client, layout):
    beside = {**camera(), "points": [[1, 1], [2, 2], [3, 3]]}
    problem = check_problem(client.post(f"/v1/layouts/{layout['id']}/strokes", json=beside), 422, "invalid_layout")
    assert "meets the surface at 0" in problem["detail"]
    flat = stroke(curve((0, 0), (1, 0))) | {"projection": [0] * 16}
    check_problem(client.post(f"/v1/layouts/{layout['id']}/strokes", json=flat), 422, "invalid_layout")
    assert client.get("/v1/layouts/" + layout["id"]).json() == layout


def test_edits_are_undone_and_redone(client, layout):
    split = edit(client, layout, "curves/6/split", point=[0, 0.1, 0])
    assert split["changed"] == {"added_curves": [7], "changed_curves": [6], "removed_curves": []}
    assert [issue["sides"] for issue in split["issues"]] == [5, 5]
    merged = edit(client, split, "curves/merge", first=6, second=7)
    assert sides(merged) == sides(layout) and merged["revision"] == 2 and merged["complete"]
    gone = client.delete(f"/v1/layouts/{layout['id']}/curves/6").json()
    assert gone["changed"]["removed_curves"] == [6] and gone["issues"][0]["sides"] == 6

    for revision in (2, 1, 0):
        back = client.post(f"/v1/layouts/{layout['id']}/undo").json()
        assert back["revision"] == revision and back["can_redo"]
    assert back["curves"] == layout["curves"] and not back["can_undo"]
    check_problem(client.post(f"/v1/layouts/{layout['id']}/undo"), 409, "conflict")
    assert client.post(f"/v1/layouts/{layout['id']}/redo").json()["curves"] == split["curves"]
    # An edit takes the place of what was undone.
    other = edit(client, layout, "curves/5/redraw", points=curve(PLACES[5], PLACES[0], 3))
    assert other["revision"] == 2 and not other["can_redo"]
    assert len(other["curves"][5]["points"]) == 4
    check_problem(client.post(f"/v1/layouts/{layout['id']}/redo"), 409, "conflict")


def test_a_curve_is_redrawn_by_a_stroke_from_either_end(client, layout):
    first, last = (layout["nodes"][layout["curves"][6][end]][:2] for end in ("from", "to"))
    inside = [(0.9 * x, 0.9 * y) for x, y in (first, last)]
    middle = (0.3, 0.0)
    line = curve(inside[0], middle) + curve(middle, inside[1])[1:]
    for drawn in (line, line[::-1]):
        edited = edit(client, layout, "curves/6/redraw", **stroke(drawn))
        client.post(f"/v1/layouts/{layout['id']}/undo")
        assert edited["changed"] == {"added_curves": [], "changed_curves": [6], "removed_curves": []}
        assert edited["stroke"] == {"curve": 6, "points": len(drawn), "missed_points": 0}
        points = edited["curves"][6]["points"]
        assert points[0][:2] == first and points[-1][:2] == last
        assert math.dist(points[1][:2], first) < math.dist(points[1][:2], last)
        assert max(row[0] for row in points) > 0.25 and edited["complete"]


def test_an_end_is_snapped(client, saddle):
    whole = saddle_layout()
    whole["nodes"].append(on_saddle(0.1, 0.8))
    whole["curves"][6] = {"id": 6, "from": 1, "to": 6, "points": curve(PLACES[1], (0.1, 0.8))}
    del whole["patches"]
    layout = client.post("/v1/layouts", json={"mesh": saddle, **whole}).json()
    assert not layout["complete"]
    far = {"end": "to", "point": [0, 0, 5], "radius": 0.1}
    check_problem(client.post(f"/v1/layouts/{layout['id']}/curves/6/snap", json=far), 422, "invalid_layout")
    layout = edit(client, layout, "curves/6/snap", end="to", point=on_saddle(0, 1), radius=0.1)
    assert layout["complete"] and len(layout["nodes"]) == 6 and len(layout["patches"]) == 2


@pytest.mark.parametrize("change, pointer", [
    (lambda body: body.pop("mesh"), "/mesh"),
    (lambda body: body.update(more=1), "/more"),
    (lambda body: body.update({"n" * 39 + "\u00e9~/": 1}), "/" + "n" * 39 + "??~0~1"),
    (lambda body: body["nodes"].append([1, 2]), "/nodes/6"),
    (lambda body: body["curves"][2].update({"from": 17}), "/curves/2/from"),
    (lambda body: body["curves"][3].update(id=2), "/curves/3/id"),
    (lambda body: body["curves"][1]["points"].clear(), "/curves/1/points"),
    (lambda body: body["curves"][1]["points"].reverse(), "/curves/1/points"),
    (lambda body: body["patches"].append([0, 6, 4]), "/patches/2"),
    (lambda body: body["patches"].append([0, 1, 2, 3]), "/patches/2"),
])
def test_malformed_layouts_are_refused_with_their_place(client, saddle, change, pointer):
    body = {"mesh": saddle, **json.loads(json.dumps(saddle_layout()))}
    change(body)
    problem = check_problem(client.post("/v1/layouts", json=body), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == pointer, problem


def test_impossible_layouts_are_refused_by_name(client, saddle):
    body = {"mesh": saddle, **saddle_layout()}
    body["curves"].append({"id": 7, "from": 0, "to": 2, "points": [on_saddle(-1, -1), on_saddle(0.1, 0.3),
                                                                  on_saddle(1, -1)]})
    problem = check_problem(client.post("/v1/layouts", json=body), 422, "invalid_layout")
    assert "curves 6 and 7 cross" in problem["detail"]
    body = {"mesh": saddle, **saddle_layout()}
    bends = ((0, -1), (0.3, 0.5), (0.3, 0), (-0.2, 0.4), (0, 1))
    body["curves"][6]["points"] = sum((curve(*ends)[:-1] for ends in zip(bends, bends[1:])), []) + [on_saddle(0, 1)]
    problem = check_problem(client.post("/v1/layouts", json=body), 422, "invalid_layout")
    assert "curve 6 crosses itself" in problem["detail"]
    body = {"mesh": saddle, **saddle_layout()}
    body["curves"][1]["points"] = [body["nodes"][1]] * 2
    body["curves"][1]["to"] = 1
    body["patches"] = []
    problem = check_problem(client.post("/v1/layouts", json=body), 422, "invalid_layout")
    assert "curve 1 has no length" in problem["detail"]
    check_problem(client.post("/v1/layouts", json={"mesh": "m_none"}), 404, "mesh_not_found")


def test_what_is_not_there_is_not_found(client, layout):
    check_problem(client.get("/v1/layouts/l_none"), 404, "layout_not_found")
    check_problem(client.delete("/v1/layouts/l_none"), 404, "layout_not_found")
    check_problem(client.post("/v1/layouts/l_none/undo"), 404, "layout_not_found")
    path = f"/v1/layouts/{layout['id']}/curves/"
    for name in ("99", "x1", "4294967296", "-1"):
        check_problem(client.delete(path + name), 404, "curve_not_found")
    check_problem(client.post(path + "6/split", json={"point": [0, 0]}), 400, "invalid_field")
    problem = check_problem(client.post(path + "6/split", json={"point": on_saddle(0, 1)}), 422, "invalid_layout")
    assert "curve 6" in problem["detail"]
    assert client.delete("/v1/layouts/" + layout["id"]).status_code == 204
    check_problem(client.get("/v1/layouts/" + layout["id"]), 404, "layout_not_found")


def test_every_answered_revision_survives_a_kill(make_daemon):
    running = make_daemon()
    with running.client() as client:
        mesh = client.upload(shapes.saddle(24))["id"]
        layout = client.post("/v1/layouts", json={"mesh": mesh, **saddle_layout()}).json()
        split = edit(client, layout, "curves/6/split", point=[0, 0.1, 0])
    running.stop(signal.SIGKILL)
    running.start()
    with running.client() as client:
        again = client.get("/v1/layouts/" + layout["id"]).json()
        assert again["curves"] == split["curves"] and again["issues"] == split["issues"]
        assert edit(client, layout, "curves/merge", first=6, second=7)["changed"]["removed_curves"] == [7]
        assert client.post(f"/v1/layouts/{layout['id']}/undo").json()["curves"] == split["curves"]
        assert client.post(f"/v1/layouts/{layout['id']}/undo").json()["curves"] == layout["curves"]


def test_a_word_in_place_of_a_curve_is_a_resource_of_its_own(client):
    assert client.options("/v1/layouts/l_none/curves/merge").headers["Allow"] == "POST, OPTIONS"
    assert client.options("/v1/layouts/l_none/curves/3").headers["Allow"] == "DELETE, OPTIONS"


def test_a_layout_is_made_of_the_quads_of_a_mesh(client):
    plane = client.upload(shapes.saddle(12), name="quads")["id"]
    reply = client.post("/v1/layouts", json={"mesh": plane, "quads": plane})
    assert reply.status_code == 201, reply.text
    made = reply.json()
    assert made["complete"] and made["issues"] == [] and made["mesh"] == plane
    assert len(made["nodes"]) == 4 and len(made["curves"]) == 4 and len(made["patches"]) == 1
    assert client.get(f"/v1/layouts/{made['id']}").json() == made
    divided = client.post("/v1/layouts", json={"mesh": plane, "quads": plane, "patches": 8, "crease_angle": 40}).json()
    assert 4 <= len(divided["patches"]) <= 8
    reply = client.post("/v1/reconstructions", json={"layout": made["id"]})
    assert reply.status_code == 201, reply.text


@pytest.mark.parametrize("change, pointer", [({"patches": 0}, "/patches"), ({"patches": [[0, 1, 2, 3]]}, "/patches"),
                                             ({"crease_angle": 181}, "/crease_angle"), ({"quads": 7}, "/quads"),
                                             ({"nodes": []}, "/nodes")])
def test_bad_requests_for_layouts_of_quads_name_the_place(client, saddle, change, pointer):
    reply = client.post("/v1/layouts", json={"mesh": saddle, "quads": saddle, **change})
    check_problem(reply, 400, "invalid_field")
    assert pointer in reply.text


def test_triangles_and_unknown_meshes_give_no_layout(client, saddle):
    triangles = client.upload(shapes.triangles(shapes.saddle(4)), name="triangles")["id"]
    reply = client.post("/v1/layouts", json={"mesh": saddle, "quads": triangles})
    check_problem(reply, 422, "invalid_layout")
    assert "are triangles" in reply.json()["detail"]
    reply = client.post("/v1/layouts", json={"mesh": saddle, "quads": "m_unknown"})
    assert reply.status_code in (400, 404)


def test_a_layout_is_made_of_a_surface_alone(client):
    box = client.upload(shapes.triangles(shapes.cube()), name="a surface alone")["id"]
    reply = client.post("/v1/layouts", json={"mesh": box, "auto": True, "quad_count": 600})
    assert reply.status_code == 201, reply.text
    made = reply.json()
    assert made["complete"] and made["mesh"] == box and len(made["patches"]) == 6 and len(made["curves"]) == 12
    assert client.get(f"/v1/layouts/{made['id']}").json() == made
    without = client.post("/v1/layouts", json={"mesh": box, "auto": True, "quad_count": 600, "crease_angle": 0}).json()
    assert len(without["patches"]) >= 6
    more = client.post("/v1/layouts", json={"mesh": box, "auto": True, "quad_count": 600, "patches": 40}).json()
    assert 20 <= len(more["patches"]) <= 40
    assert client.post("/v1/reconstructions", json={"layout": made["id"]}).status_code == 201


@pytest.mark.parametrize("change, pointer", [({"auto": False}, "/auto"), ({"auto": "yes"}, "/auto"), ({"quad_count": 0}, "/quad_count"),
                                             ({"quad_count": 1e8}, "/quad_count"), ({"quad_count": "many"}, "/quad_count"),
                                             ({"patches": 0.5}, "/patches"), ({"crease_angle": -1}, "/crease_angle"),
                                             ({"quads": "m_any"}, "/quads"), ({"curves": []}, "/curves")])
def test_bad_requests_for_automatic_layouts_name_the_place(client, saddle, change, pointer):
    reply = client.post("/v1/layouts", json={"mesh": saddle, "auto": True, **change})
    check_problem(reply, 400, "invalid_field")
    assert pointer in reply.text


def test_a_layout_that_is_made_ends_at_its_deadline(client):
    mesh = client.upload(shapes.sphere(0.25))["id"]
    before = len(client.get("/v1/layouts", params={"mesh": mesh}).json()["layouts"])
    for deadline in (1, 50, 400):
        reply = client.post("/v1/layouts", json={"mesh": mesh, "auto": True, "quad_count": 100000, "deadline_ms": deadline})
        assert f" {deadline} ms" in check_problem(reply, 504, "deadline_exceeded")["detail"]
    assert len(client.get("/v1/layouts", params={"mesh": mesh}).json()["layouts"]) == before
    for deadline in (0, -1, "1"):
        problem = check_problem(client.post("/v1/layouts", json={"mesh": mesh, "auto": True, "deadline_ms": deadline}), 400)
        assert problem["errors"][0]["pointer"] == "/deadline_ms"
    made = client.post("/v1/layouts", json={"mesh": mesh, "auto": True, "quad_count": 300, "deadline_ms": 1e7})
    assert made.status_code == 201


def test_a_layout_is_not_made_for_a_client_that_has_left(make_daemon):
    running = make_daemon()
    with running.client() as client:
        mesh = client.upload(shapes.sphere(0.25))["id"]
        body = json.dumps({"mesh": mesh, "auto": True, "quad_count": 100000}).encode()
        with socket.create_connection(("127.0.0.1", running.port)) as left:
            left.sendall(b"POST /v1/layouts HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nContent-Type: application/json\r\n"
                         b"Content-Length: %d\r\n\r\n%s" % (running.port, len(body), body))
            time.sleep(0.3)
        ended = 'quadmeshd_request_seconds_count{method="POST",route="/v1/layouts",status="503"} 1'
        end = time.monotonic() + PATIENCE
        while ended not in client.get("/metrics").text:
            assert time.monotonic() < end, "it goes on without its client"
            time.sleep(0.05)
        assert client.get("/v1/layouts", params={"mesh": mesh}).json()["layouts"] == []


def test_the_daemon_limits_the_time_for_a_layout(make_daemon):
    running = make_daemon("--max-job-seconds", 1)
    with running.client() as client:
        mesh = client.upload(shapes.sphere(0.25))["id"]
        reply = client.post("/v1/layouts", json={"mesh": mesh, "auto": True, "quad_count": 100000, "deadline_ms": 1e6})
        assert "1 s" in check_problem(reply, 504, "deadline_exceeded")["detail"]


def test_points_that_are_no_surface_give_no_automatic_layout(client):
    points = client.upload(b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n", name="points.xyz")["id"]
    reply = client.post("/v1/layouts", json={"mesh": points, "auto": True})
    check_problem(reply, 422, "empty_mesh")
    assert "too few for a surface" in reply.json()["detail"]


def test_a_point_set_gives_an_automatic_layout_and_quads_on_it(client):
    points = client.upload(shapes.xyz(shapes.sphere(0.03)), name="points.xyz")["id"]
    layout = client.post("/v1/layouts", json={"mesh": points, "auto": True, "quad_count": 600}).json()
    assert layout["issues"] == [] and layout["mesh"] == points
    for curve in layout["curves"]:
        for x, y, z in curve["points"]:
            assert abs(math.hypot(x, y, z) - 1) < 0.01
    made = client.post("/v1/reconstructions", json={"layout": layout["id"]})
    assert made.status_code == 201, made.text
