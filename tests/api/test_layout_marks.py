"""Layouts: curves along features, marks of curves and nodes, and reconstructions that keep them."""
import math

import pytest

import shapes
from conftest import WAIT, check_problem
from test_layouts import edit, stroke


def cube(n=6):
    """In triangles, as OBJ."""
    return shapes.obj(shapes.triangles(shapes.gridded_cube(n)))


@pytest.fixture(scope="module")
def box(daemon):
    with daemon.client() as made:
        return made.upload(cube(), name="box", format="obj")["id"]


@pytest.fixture
def featured(client, box):
    reply = client.post("/v1/layouts", json={"mesh": box, "features": {"angle_deg": 40}})
    assert reply.status_code == 201, reply.text
    return reply.json()


def marks(layout):
    return {curve["id"]: curve.get("mark", "smooth") for curve in layout["curves"]}


def test_a_box_is_drawn_by_its_features(featured):
    assert len(featured["curves"]) == 12 and set(marks(featured).values()) == {"sharp"}
    assert featured["corners"] == list(range(8)) and len(featured["patches"]) == 6 and featured["complete"]


def test_features_are_added_to_what_is_drawn(client, box):
    layout = client.post("/v1/layouts", json={"mesh": box}).json()
    assert "corners" not in layout
    layout = edit(client, layout, "strokes", **stroke([(-0.5, 0.3, 1), (0, 0, 1), (0.5, -0.3, 1)]))
    layout = edit(client, layout, "features")
    assert layout["added_features"] == 12 and len(layout["curves"]) == 13
    again = edit(client, layout, "features", angle_deg=30, shortest=0.1, snap=0.01)
    assert again["added_features"] == 0 and again["curves"] == layout["curves"]
    undone = edit(client, layout, "undo")
    undone = edit(client, undone, "undo")
    assert len(undone["curves"]) == 1


def test_features_of_longer_than_the_longest_are_none(client, box):
    layout = client.post("/v1/layouts", json={"mesh": box, "features": {"shortest": 100}}).json()
    assert layout["curves"] == [] and layout["patches"] == []


def test_a_point_set_has_no_features(client):
    cloud = client.upload(b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n", name="cloud", format="xyz")["id"]
    reply = client.post("/v1/layouts", json={"mesh": cloud, "features": {}})
    check_problem(reply, 422, "invalid_layout")
    assert "point set" in reply.json()["detail"]


def test_marks_are_edits(client, featured):
    layout = edit(client, featured, "marks", curves=[0, 3], mark="fixed", nodes=[1], corner=False)
    assert [marks(layout)[k] for k in (0, 1, 3)] == ["fixed", "sharp", "fixed"]
    assert layout["corners"] == [0, 2, 3, 4, 5, 6, 7] and layout["revision"] == 1
    assert layout["changed"] == {"added_curves": [], "changed_curves": [0, 3], "removed_curves": []}
    assert layout["complete"] and len(layout["patches"]) == 6
    assert client.get("/v1/layouts/" + layout["id"]).json()["curves"] == layout["curves"]
    undone = edit(client, layout, "undo")
    assert undone["curves"] == featured["curves"] and undone["corners"] == featured["corners"]
    redone = edit(client, layout, "redo")
    assert redone["curves"] == layout["curves"] and redone["corners"] == layout["corners"]
    smooth = edit(client, layout, "marks", curves=list(range(12)), mark="smooth", nodes=list(range(8)), corner=False)
    assert "corners" not in smooth and not any("mark" in curve for curve in smooth["curves"])


def test_marks_stay_through_edits_and_forbid_what_they_forbid(client, featured):
    curve = featured["curves"][0]
    a, b = curve["points"][0], curve["points"][-1]
    layout = edit(client, featured, "curves/0/split", point=[(x + y) / 2 for x, y in zip(a, b)])
    parts = {0, layout["changed"]["added_curves"][0]}
    assert all(marks(layout)[k] == "sharp" for k in parts)
    layout = edit(client, layout, "curves/merge", first=min(parts), second=max(parts))
    assert marks(layout)[0] == "sharp" and len(layout["curves"]) == 12
    path = f"/v1/layouts/{layout['id']}"
    moved = client.post(f"{path}/nodes/0/move", json={"point": [0.5, 0.5, 1]})
    check_problem(moved, 422, "invalid_layout")
    assert "node 0 is a corner" in moved.json()["detail"]
    layout = edit(client, layout, "marks", curves=[0], mark="fixed", nodes=list(range(8)), corner=False)
    slid = client.post(f"{path}/curves/0/slide", json={"from": [(x + y) / 2 for x, y in zip(a, b)], "to": [0.5, 0.5, 1]})
    check_problem(slid, 422, "invalid_layout")
    assert "curve 0 is fixed" in slid.json()["detail"]


@pytest.mark.parametrize("body, pointer", [
    ({}, "/curves"), ({"curves": [0]}, "/mark"), ({"mark": "sharp"}, "/curves"), ({"curves": [], "mark": "sharp"}, "/curves"),
    ({"curves": [0], "mark": "blunt"}, "/mark"), ({"curves": [-1], "mark": "sharp"}, "/curves/0"),
    ({"curves": [0, "1"], "mark": "sharp"}, "/curves/1"), ({"nodes": [0]}, "/corner"), ({"nodes": [0], "corner": 1}, "/corner"),
    ({"nodes": 0, "corner": True}, "/nodes"), ({"curves": [0], "mark": "sharp", "corner": True}, "/corner")])
def test_bad_marks_name_the_place(client, featured, body, pointer):
    reply = client.post(f"/v1/layouts/{featured['id']}/marks", json=body)
    check_problem(reply, 400, "invalid_field")
    assert reply.json()["errors"][0]["pointer"] == pointer


def test_marks_of_what_is_not_there_are_refused(client, featured):
    path = f"/v1/layouts/{featured['id']}/marks"
    for body, words in [({"curves": [0, 99], "mark": "sharp"}, "99"), ({"nodes": [8], "corner": True}, "no node 8")]:
        reply = client.post(path, json=body)
        check_problem(reply, 422, "invalid_layout")
        assert words in reply.json()["detail"]
    assert client.get(f"/v1/layouts/{featured['id']}").json()["revision"] == 0


@pytest.mark.parametrize("body, pointer", [
    ({"features": 1}, "/features"), ({"features": {"angle_deg": 0}}, "/features/angle_deg"),
    ({"features": {"angle_deg": 181}}, "/features/angle_deg"), ({"features": {"shortest": -1}}, "/features/shortest"),
    ({"features": {"snap": "far"}}, "/features/snap"), ({"features": {}, "patches": []}, "/patches"),
    ({"corners": [0]}, "/corners/0"), ({"corners": 0}, "/corners"),
    ({"auto": True, "features": {}, "crease_angle": 3}, "/crease_angle"), ({"auto": True, "features": {"angle_deg": -1}}, "/features/angle_deg"),
    ({"nodes": [[0, 0, 0], [1, 0, 0]], "curves": [{"id": 0, "from": 0, "to": 1, "points": [[0, 0, 0], [1, 0, 0]], "mark": 1}]},
     "/curves/0/mark")])
def test_bad_features_and_layouts_name_the_place(client, box, body, pointer):
    reply = client.post("/v1/layouts", json={"mesh": box, **body})
    check_problem(reply, 400, "invalid_field")
    assert reply.json()["errors"][0]["pointer"] == pointer


def test_a_given_layout_keeps_its_marks(client, featured, box):
    whole = {name: featured[name] for name in ("nodes", "corners", "curves", "patches")}
    layout = client.post("/v1/layouts", json={"mesh": box, **whole}).json()
    assert {name: layout[name] for name in whole} == whole


def test_features_of_an_automatic_layout(client, box):
    old = client.post("/v1/layouts", json={"mesh": box, "auto": True, "quad_count": 300, "crease_angle": 30}).json()
    new = client.post("/v1/layouts", json={"mesh": box, "auto": True, "quad_count": 300, "features": {"angle_deg": 30}}).json()
    assert old["curves"] == new["curves"] and len(old["patches"]) >= 6
    # What lies along the edges is sharp, and on them; their ends are corners. So are the quads in the sides of the box.
    sharp = [curve for curve in new["curves"] if curve.get("mark") == "sharp"]
    on_edges = [curve for curve in new["curves"] if all(sum(abs(x) == 1 for x in p) >= 2 for p in curve["points"])]
    assert sharp == on_edges and len(sharp) >= 12
    assert sorted(new["nodes"][k] for k in new["corners"]) == sorted([x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
    assert count_off(quads_of(client, new)) == 0


def vertices_of(client, layout, **fields):
    """Of the quads that a reconstruction ends with, and its job."""
    made = client.post("/v1/reconstructions", json={"layout": layout["id"]})
    assert made.status_code == 201, made.text
    job = client.post("/v1/jobs", headers={"Prefer": WAIT},
                      json={"type": "reconstruction_step", "reconstruction": made.json()["id"], "until": {"max_quads": 1500},
                            "measure": False, **fields}).json()
    assert job["state"] == "succeeded", job
    mesh = client.get("/v1/reconstructions/" + made.json()["id"]).json()["mesh"]
    content = client.get(f"/v1/meshes/{mesh}/content", params={"format": "obj"}).text
    rows = [line.split() for line in content.splitlines()]
    vertices = [[float(x) for x in row[1:4]] for row in rows if row[:1] == ["v"]]
    return vertices, rows, job


def quads_of(client, layout):
    vertices, rows, _ = vertices_of(client, layout)
    return [[vertices[int(k.split("/")[0]) - 1] for k in row[1:]] for row in rows if row[:1] == ["f"]]


def count_off(quads):
    """Quads that do not lie in one side of the box."""
    return sum(not any(all(abs(p[k] - end) < 1e-9 for p in quad) for k in range(3) for end in (-1, 1)) for quad in quads)


def test_strokes_snap_to_features(client, box):
    layout = client.post("/v1/layouts", json={"mesh": box}).json()
    along = stroke([(-0.7, 0.96, 1), (0, 0.98, 1), (0.7, 0.95, 1)])
    snapped = edit(client, layout, "strokes", features={"reach": 0.1, "angle_deg": 30}, **along)
    assert marks(snapped) == {0: "sharp"}
    assert all(point[1] == 1 and point[2] == 1 for point in snapped["curves"][0]["points"])
    free = edit(client, snapped, "undo")
    free = edit(client, free, "strokes", **along)
    assert marks(free) == {0: "smooth"} and all(point[1] < 0.99 for point in free["curves"][0]["points"])
    path = f"/v1/layouts/{layout['id']}"
    for body, pointer in [({"features": 1}, "/features"), ({"features": {"reach": 0}}, "/features/reach"),
                          ({"features": {"angle_deg": 200}}, "/features/angle_deg")]:
        reply = client.post(f"{path}/strokes", json={**along, **body})
        check_problem(reply, 400, "invalid_field")
        assert reply.json()["errors"][0]["pointer"] == pointer
    check_problem(client.post(f"{path}/rings", json={**along, "features": {}}), 400, "invalid_field")


def test_sharp_curves_stay_sharp(client, box, featured):
    def shaken(point, k):
        return [x + 0.012 * math.sin(7.0 * k + 3.0 * axis + sum(point)) for axis, x in enumerate(point)]

    nodes = [shaken(point, k) for k, point in enumerate(featured["nodes"])]
    curves = []
    for curve in featured["curves"]:
        a, b = curve["points"][0], curve["points"][-1]
        inner = [shaken([x + (y - x) * k / 12 for x, y in zip(a, b)], k) for k in range(1, 12)]
        curves.append({**curve, "points": [nodes[curve["from"]], *inner, nodes[curve["to"]]]})
    sharp = client.post("/v1/layouts", json={"mesh": box, "nodes": nodes, "curves": curves}).json()
    assert len(sharp["patches"]) == 6, sharp["issues"]
    assert count_off(quads_of(client, sharp)) == 0
    smooth = edit(client, sharp, "marks", curves=[curve["id"] for curve in curves], mark="smooth")
    assert count_off(quads_of(client, smooth)) > 0


# ---- suggestions ----

def suggestions(client, layout):
    reply = client.get(f"/v1/layouts/{layout['id']}/suggestions")
    assert reply.status_code == 200, reply.text
    return reply.json()["suggestions"]


def accept(client, layout, one):
    return edit(client, layout, "curves", points=one["points"], snap=1e-6, **({"mark": one["mark"]} if "mark" in one else {}))


def test_features_are_suggested_first(client, box):
    layout = client.post("/v1/layouts", json={"mesh": box}).json()
    for left in range(12, 0, -1):
        found = suggestions(client, layout)
        assert len(found) == left and {(one["kind"], one["mark"]) for one in found} == {("feature", "sharp")}
        layout = accept(client, layout, found[0])
    assert len(layout["patches"]) == 6 and layout["complete"] and suggestions(client, layout) == []


def test_ends_parts_and_wide_cells_get_curves(client, box):
    layout = client.post("/v1/layouts", json={"mesh": box, "features": {}}).json()
    # A curve into one side of the box ends there.
    layout = edit(client, layout, "curves", points=[[1, 0, 1], [0.5, 0.1, 1], [0, 0, 1]])
    found = suggestions(client, layout)
    assert [one["kind"] for one in found] == ["end"] and "no other curve begins" in found[0]["detail"]
    assert all(abs(point[2] - 1) < 1e-9 for point in found[0]["points"])
    layout = accept(client, layout, found[0])
    assert not any(issue["kind"] == "dangling_end" for issue in layout["issues"])
    # A closed curve inside another side lies apart.
    ring = [[0.4 * math.cos(k * math.pi / 12), 0.4 * math.sin(k * math.pi / 12), -1] for k in range(25)]
    layout = edit(client, layout, "curves", points=[*ring[:-1], ring[0]])
    assert any(issue["kind"] == "apart" for issue in layout["issues"])
    found = suggestions(client, layout)
    joins = [one for one in found if one["kind"] == "join"]
    assert len(joins) == 1 and all(abs(point[2] + 1) < 1e-9 for point in joins[0]["points"])
    layout = accept(client, layout, joins[0])
    assert not any(issue["kind"] == "apart" for issue in layout["issues"])


def test_a_wide_cell_is_divided(client, box):
    layout = client.post("/v1/layouts", json={"mesh": box, "features": {}}).json()
    top = [curve["id"] for curve in layout["curves"] if all(point[2] == 1 for point in curve["points"])]
    for curve, place in zip(top, [next(one["points"] for one in layout["curves"] if one["id"] == curve) for curve in top]):
        layout = edit(client, layout, f"curves/{curve}/split", point=[(x + y) / 2 for x, y in zip(place[0], place[-1])])
    assert sorted(issue["sides"] for issue in layout["issues"]) == [5, 5, 5, 5, 8]
    found = suggestions(client, layout)
    assert [one["kind"] for one in found] == ["divide"] and "cell of 8 sides" in found[0]["detail"]
    assert all(abs(point[2] - 1) < 1e-9 for point in found[0]["points"])
    layout = accept(client, layout, found[0])
    assert sorted(issue["sides"] for issue in layout["issues"]) == [5, 5, 5, 5, 6]
    assert suggestions(client, layout) == []


def test_a_bad_curve_names_the_place(client, featured):
    path = f"/v1/layouts/{featured['id']}/curves"
    for body, pointer in [({}, "/points"), ({"points": [[0, 0, 1]]}, "/points"), ({"points": [[0, 0, 1], [0, 0]]}, "/points/1"),
                          ({"points": [[0, 0, 1], [0, 1, 1]], "mark": "no"}, "/mark"), ({"points": [[0, 0, 1], [0, 1, 1]], "snap": -1}, "/snap")]:
        reply = client.post(path, json=body)
        check_problem(reply, 400, "invalid_field")
        assert reply.json()["errors"][0]["pointer"] == pointer
    check_problem(client.get("/v1/layouts/l_none/suggestions"), 404, "layout_not_found")


def test_planes_of_symmetry_are_found(client, box):
    layout = client.post("/v1/layouts", json={"mesh": box}).json()
    planes = client.get(f"/v1/layouts/{layout['id']}/symmetry").json()["planes"]
    assert len(planes) == 3
    for plane in planes:
        assert abs(sum(x * x for x in plane["normal"]) - 1) < 1e-9
        assert abs(sum(x * y for x, y in zip(plane["point"], plane["normal"]))) < 1e-2
        assert 0 <= plane["distance"]["lower"] <= plane["distance"]["upper"] <= 0.04
    mirror = {name: planes[0][name] for name in ("point", "normal")}
    drawn = edit(client, layout, "strokes", mirror=mirror, **stroke([(0.3, 0.7, 1), (0.6, 0.5, 1)]))
    assert len(drawn["curves"]) in (1, 2)  # one where the stroke and its image are joined
    tilted = b"v 0 0 0\nv 3 0.2 0\nv 0.4 2 0.1\nv 0.3 0.1 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    other = client.post("/v1/layouts", json={"mesh": client.upload(tilted, name="tilted", format="obj")["id"]}).json()
    assert client.get(f"/v1/layouts/{other['id']}/symmetry").json() == {"planes": []}


def test_settling_keeps_marks(client, box, featured):
    """One edge is drawn as a bow on its face, and fixed; the others stay sharp."""
    nodes, bowed = featured["nodes"], featured["curves"][0]
    a, b = bowed["points"][0], bowed["points"][-1]
    along = next(k for k in range(3) if a[k] != b[k])
    across = next(k for k in range(3) if k != along)

    def bow(t):
        point = [x + (y - x) * t for x, y in zip(a, b)]
        point[across] *= 1 - 0.2 * math.sin(math.pi * t)
        return point

    points = [a, *[bow(k / 12) for k in range(1, 12)], b]
    curves = [{**curve, "points": points, "mark": "fixed"} if curve is bowed else curve for curve in featured["curves"]]
    layout = client.post("/v1/layouts", json={"mesh": box, "nodes": nodes, "corners": featured["corners"], "curves": curves}).json()
    assert len(layout["patches"]) == 6, layout["issues"]
    before, _, _ = vertices_of(client, layout)
    after, _, job = vertices_of(client, layout, settle=True)
    assert job["result"]["settled"]["kept"] and before != after and len(before) == len(after)

    def on_bow(p):
        return min(math.dist(p, bow(k / 600)) for k in range(601)) < 0.01

    held = [k for k, p in enumerate(before) if on_bow(p)]
    assert len(held) > 8 and all(before[k] == after[k] for k in held)
    assert all(before[k] == after[k] for k, p in enumerate(before) if all(abs(x) == 1 for x in p))
    sharp = [k for k, p in enumerate(before) if k not in held and sum(abs(x) == 1 for x in p) == 2]
    assert len(sharp) > 50
    assert all(sum(abs(abs(x) - 1) < 1e-9 for x in after[k]) >= 2 for k in sharp)
