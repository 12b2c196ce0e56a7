"""Edits of layouts on both sides of a plane of symmetry, and edits that end at their deadline."""
import math
import time

import pytest

import shapes
from conftest import check_problem
from test_layouts import camera, edit, window

PLANE = {"point": [0, 0, 0], "normal": [1, 0, 0]}
QUERY = "0,0,0,1,0,0"


def bowl(x, y):
    return [x, y, 0.3 * (x * x + y * y)]


def line(a, b, pieces=8):
    return [bowl(*(p + (q - p) * k / pieces for p, q in zip(a, b))) for k in range(pieces + 1)]


@pytest.fixture(scope="module")
def dish(daemon):
    n = 24
    vertices = [bowl(2 * i / n - 1, 2 * j / n - 1) for j in range(n + 1) for i in range(n + 1)]
    faces = [(k, k + 1, k + n + 2, k + n + 1) for j in range(n) for k in range(j * (n + 1), j * (n + 1) + n)]
    lines = ["v %.12g %.12g %.12g" % tuple(v) for v in vertices] + ["f %d %d %d %d" % tuple(k + 1 for k in f) for f in faces]
    with daemon.client() as made:
        return made.upload("\n".join(lines).encode(), name="dish", format="obj")["id"]


@pytest.fixture
def layout(client, dish):
    """Four patches in a row along x, symmetric about x = 0: nodes 0 to 4 below, 5 to 9 above."""
    xs, ys = (-0.8, -0.4, 0, 0.4, 0.8), (-0.5, 0.5)
    places = [(x, y) for y in ys for x in xs]
    ends = [(k, k + 1) for row in (0, 5) for k in range(row, row + 4)] + [(k, k + 5) for k in range(5)]
    reply = client.post("/v1/layouts", json={
        "mesh": dish, "nodes": [bowl(*p) for p in places],
        "curves": [{"id": i, "from": a, "to": b, "points": line(places[a], places[b])} for i, (a, b) in enumerate(ends)]})
    assert reply.status_code == 201 and len(reply.json()["patches"]) == 4, reply.text
    return reply.json()


def off(point, points):
    """The distance of a point from a polyline."""
    best = math.inf
    for a, b in zip(points, points[1:]):
        way = [q - p for p, q in zip(a, b)]
        share = sum(x * (p - q) for x, p, q in zip(way, point, a)) / sum(x * x for x in way)
        best = min(best, math.dist(point, [p + x * min(1, max(0, share)) for p, x in zip(a, way)]))
    return best


def check_symmetric(layout, mirrored=True, tolerance=4e-3):
    """Each curve has an image: one that runs along it both ways."""
    assert layout["mirrored"] is mirrored
    for curve in layout["curves"]:
        image = [[-x, y, z] for x, y, z in curve["points"]]
        assert any(max(off(p, other["points"]) for p in image) < tolerance and max(off(p, image) for p in other["points"]) < tolerance
                   for other in layout["curves"]), curve


def node_at(layout, x, y):
    return min(range(len(layout["nodes"])), key=lambda k: math.dist(layout["nodes"][k], bowl(x, y)))


def curve_at(layout, x, y):
    return min(layout["curves"], key=lambda curve: min(math.dist(p, bowl(x, y)) for p in curve["points"]))["id"]


def test_nodes_move_and_curves_bend_on_both_sides(client, layout):
    moved = edit(client, layout, f"nodes/{node_at(layout, 0.4, 0.5)}/move", point=bowl(0.5, 0.6), mirror=PLANE)
    check_symmetric(moved)
    assert math.dist(moved["nodes"][node_at(moved, -0.5, 0.6)], bowl(-0.5, 0.6)) < 1e-3
    bent = edit(client, moved, f"curves/{curve_at(moved, -0.8, 0)}/slide", **{"from": bowl(-0.8, 0)}, to=bowl(-0.7, 0), mirror=PLANE)
    check_symmetric(bent)
    assert len(bent["changed"]["changed_curves"]) == 2
    drawn = edit(client, bent, f"nodes/{node_at(bent, 0.8, -0.5)}/move", **camera(), points=[window(bowl(0.85, -0.55))], mirror=PLANE)
    check_symmetric(drawn)
    assert math.dist(drawn["nodes"][node_at(drawn, -0.85, -0.55)], bowl(-0.85, -0.55)) < 5e-3


def test_what_lies_on_the_plane_stays_there(client, layout):
    moved = edit(client, layout, f"nodes/{node_at(layout, 0, 0.5)}/move", point=bowl(0.1, 0.7), mirror=PLANE)
    check_symmetric(moved)
    assert abs(moved["nodes"][node_at(moved, 0, 0.7)][0]) < 1e-3
    gone = client.delete(f"/v1/layouts/{layout['id']}/curves/{curve_at(moved, 0, 0)}", params={"mirror": QUERY}).json()
    check_symmetric(gone)
    assert len(gone["curves"]) == 12


def test_cuts_merges_deletions_and_marks_on_both_sides(client, layout):
    now = edit(client, layout, f"curves/{curve_at(layout, 0.8, 0)}/split", point=bowl(0.8, 0.1), mirror=PLANE)
    check_symmetric(now)
    assert len(now["curves"]) == 15
    parts = [curve_at(now, 0.8, y) for y in (-0.3, 0.4)]
    now = edit(client, now, "curves/merge", first=parts[0], second=parts[1], mirror=PLANE)
    check_symmetric(now)
    assert len(now["curves"]) == 13
    now = edit(client, now, f"curves/{curve_at(now, 0.4, 0)}/split-chord", parts=2, mirror=PLANE)
    check_symmetric(now)  # the chord goes through the plane: it is cut once
    assert len(now["patches"]) == 8
    now = edit(client, now, "marks", curves=[curve_at(now, 0.8, 0.25)], mark="sharp", mirror=PLANE)
    assert sum(curve.get("mark") == "sharp" for curve in now["curves"]) == 2 and now["mirrored"]
    now = edit(client, now, f"curves/{curve_at(now, 0.6, 0.5)}/split-chord", parts=2, mirror=PLANE)
    check_symmetric(now)
    assert len(now["patches"]) == 12
    gone = client.delete(f"/v1/layouts/{layout['id']}/curves/{curve_at(now, 0.6, 0.25)}", params={"mirror": QUERY}).json()
    check_symmetric(gone)
    assert len(gone["curves"]) == len(now["curves"]) - 2
    merged = edit(client, gone, "nodes/merge", first=node_at(gone, 0.8, 0.5), second=node_at(gone, 0.8, 0), mirror=PLANE)
    check_symmetric(merged)
    line_ = [bowl(0.4 + 0.05 * math.sin(math.pi * t / 8), -0.5 + 0.5 * t / 8) for t in range(9)]
    redrawn = edit(client, merged, f"curves/{curve_at(merged, 0.4, -0.25)}/redraw", points=line_, mirror=PLANE)
    check_symmetric(redrawn)


def test_links_on_both_sides(client, layout):
    linked = edit(client, layout, "links", first=node_at(layout, 0.4, -0.5), second=node_at(layout, 0.8, 0.5), mirror=PLANE)
    check_symmetric(linked)
    assert len(linked["curves"]) == 15


def test_without_an_image_one_side_is_edited(client, layout):
    alone = edit(client, layout, "curves", points=[bowl(0.8, 0.5), bowl(0.9, 0.8)])
    moved = edit(client, alone, f"nodes/{node_at(alone, 0.9, 0.8)}/move", point=bowl(0.95, 0.9), mirror=PLANE)
    assert moved["mirrored"] is False
    assert math.dist(moved["nodes"][node_at(moved, 0.95, 0.9)], bowl(0.95, 0.9)) < 1e-3


def test_images_are_suggested_and_taken(client, layout):
    path = f"/v1/layouts/{layout['id']}"
    assert all(one["kind"] != "image" for one in client.get(f"{path}/suggestions", params={"mirror": QUERY}).json()["suggestions"])
    now = edit(client, layout, "curves", points=line((0.4, 0.5), (0.4, 0.9)))
    now = edit(client, now, "curves", points=line((0.4, 0.9), (0.8, 0.5)), mark="fixed")
    for count in (2, 1):
        found = client.get(f"{path}/suggestions", params={"mirror": QUERY}).json()["suggestions"]
        assert [one["kind"] for one in found] == ["image"] * count and all(one["detail"] for one in found)
        assert client.get(f"{path}/suggestions").json()["suggestions"] != found
        one = found[0]
        assert one["points"][0] in now["nodes"]
        now = edit(client, now, "curves", **{name: one[name] for name in ("points", "mark") if name in one}, snap=1e-4)
    check_symmetric({**now, "mirrored": True})
    assert sum(curve.get("mark") == "fixed" for curve in now["curves"]) == 2
    assert all(one["kind"] != "image" for one in client.get(f"{path}/suggestions", params={"mirror": QUERY}).json()["suggestions"])
    check_problem(client.get(f"{path}/suggestions", params={"mirror": "1,2"}), 400, "invalid_parameter")


@pytest.mark.parametrize("mirror, pointer", [
    (1, "/mirror"), ({"point": [0, 0, 0]}, "/normal"), ({"point": [0, 0], "normal": [1, 0, 0]}, "/point"),
    ({"point": [0, 0, 0], "normal": [0, 0, 0]}, "/normal"), ({**PLANE, "side": 1}, "/side")])
def test_bad_planes_name_the_place(client, layout, mirror, pointer):
    for path, body in [("nodes/0/move", {"point": bowl(0, 0)}), ("curves/0/split", {"point": bowl(0, 0)}),
                       ("curves/merge", {"first": 0, "second": 1}), ("marks", {"curves": [0], "mark": "sharp"})]:
        reply = client.post(f"/v1/layouts/{layout['id']}/{path}", json={**body, "mirror": mirror})
        check_problem(reply, 400, "invalid_field")
        assert reply.json()["errors"][0]["pointer"] == pointer
    for query in ("", "0,0,0,1,0", "0,0,0,0,0,0", "0,0,0,1,0,x", "0,0,0,1,0,0,", "0,0,0,1,0,nan"):
        check_problem(client.delete(f"/v1/layouts/{layout['id']}/curves/0", params={"mirror": query}), 400, "invalid_parameter")
    assert client.get(f"/v1/layouts/{layout['id']}").json()["revision"] == 0


def bean(n=24):
    """A closed surface with one plane of symmetry, x = 0: a cube's grid on a sphere that is dented."""
    vertices, faces = shapes.gridded_cube(n)
    moved = []
    for x, y, z in vertices:
        length = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        size = 1 + 0.5 * math.exp(-6 * ((x * x) ** 2 + (y - 0.8) ** 2 + (z - 0.5) ** 2)) + 0.3 * z * y
        moved.append([1.3 * size * x, size * y, 0.8 * size * z])
    return shapes.obj((moved, faces))


@pytest.mark.parametrize("symmetry", ["found", PLANE, {"point": [0, 1, 2], "normal": [-2, 0, 0]}])
def test_automatic_layouts_are_symmetric(client, symmetry):
    mesh = client.upload(bean(), name="bean", format="obj")["id"]
    reply = client.post("/v1/layouts", json={"mesh": mesh, "auto": True, "quad_count": 1200, "symmetry": symmetry})
    assert reply.status_code == 201, reply.text
    layout = reply.json()
    assert layout["complete"], layout["issues"]
    check_symmetric({**layout, "mirrored": True}, tolerance=0.02)
    on_plane = [curve for curve in layout["curves"] if all(abs(p[0]) < 0.01 for p in curve["points"])]
    assert sum(math.dist(a, b) for curve in on_plane for a, b in zip(curve["points"], curve["points"][1:])) > 5
    assert not any("mark" in curve for curve in on_plane)
    made = client.post("/v1/reconstructions", json={"layout": layout["id"]})
    assert made.status_code == 201, made.text


def test_what_has_no_plane_of_symmetry_is_told(client, dish):
    crooked = b"v 0 0 0\nv 1 0 0\nv 0 1.7 0\nv 0.2 0.3 2.9\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    mesh = client.upload(crooked, name="crooked", format="obj")["id"]
    reply = client.post("/v1/layouts", json={"mesh": mesh, "auto": True, "symmetry": "found"})
    assert "not its own mirror image" in check_problem(reply, 422, "invalid_layout")["detail"]
    away = {"point": [9, 0, 0], "normal": [1, 0, 0]}
    reply = client.post("/v1/layouts", json={"mesh": mesh, "auto": True, "symmetry": away})
    assert "no part of the surface" in check_problem(reply, 422, "invalid_layout")["detail"]
    for wrong in ("x", 1, {"point": [0, 0, 0]}, {"point": [0, 0, 0], "normal": [0, 0, 0]}):
        reply = client.post("/v1/layouts", json={"mesh": mesh, "auto": True, "symmetry": wrong})
        assert check_problem(reply, 400, "invalid_field")["errors"][0]["pointer"] == "/symmetry"
    reply = client.post("/v1/layouts", json={"mesh": mesh, "quads": dish, "symmetry": "found"})
    check_problem(reply, 400, "invalid_field")


def test_an_edit_ends_at_its_deadline_and_changes_nothing(client):
    """Features of a field of small cubes: about 9,000 curves."""
    vertices, faces = [], []
    for k in range(729):
        base = [3.0 * (k % 9), 3.0 * (k // 9 % 9), 3.0 * (k // 81)]
        first = len(vertices)
        vertices += [[base[0] + x, base[1] + y, base[2] + z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
        faces += [tuple(first + i for i in f) for f in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))]
    lines = ["v %g %g %g" % tuple(v) for v in vertices] + ["f %d %d %d %d" % tuple(i + 1 for i in f) for f in faces]
    mesh = client.upload("\n".join(lines).encode(), name="cubes", format="obj")["id"]
    layout = client.post("/v1/layouts", json={"mesh": mesh}).json()
    path = f"/v1/layouts/{layout['id']}"
    begin = time.monotonic()
    late = client.post(f"{path}/features", json={"shortest": 0.1}, params={"deadline_ms": 1})
    assert "1 ms" in check_problem(late, 504, "deadline_exceeded")["detail"] and time.monotonic() - begin < 30
    assert client.get(path).json() == layout
    for deadline in ("0", "-1", "x", "inf", ""):
        check_problem(client.post(f"{path}/features", json={}, params={"deadline_ms": deadline}), 400, "invalid_parameter")
        check_problem(client.get(f"{path}/suggestions", params={"deadline_ms": deadline}), 400, "invalid_parameter")
    done = client.post(f"{path}/features", json={"shortest": 0.1}, params={"deadline_ms": 600000})
    assert done.status_code == 200 and done.json()["added_features"] == 729 * 12
    check_problem(client.get(f"{path}/suggestions", params={"deadline_ms": 1}), 504, "deadline_exceeded")
