"""Tools and edits of layouts beyond single strokes: rings, tubes, links, fills, mirrors, chords, nodes."""
import math

import pytest

import shapes
from conftest import check_problem
from eye import Sketcher, line, look
from test_layouts import PLACES, curve, on_saddle, saddle_layout


@pytest.fixture(scope="module")
def ball(daemon):
    """A sphere, whose rings are circles."""
    with daemon.client() as made:
        return made.upload(shapes.triangles(closed_ball(24, 48)), name="ball")["id"]


def closed_ball(parallels, meridians):
    """A unit sphere with its poles, of quads and triangles as quads that are cut."""
    places = [(0.0, 0.0, 1.0)]
    for i in range(1, parallels):
        for k in range(meridians):
            t, p = math.pi * i / parallels, 2 * math.pi * k / meridians
            places.append((math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t)))
    places.append((0.0, 0.0, -1.0))
    at = lambda i, k: 1 + (i - 1) * meridians + k % meridians
    faces = [(0, at(1, k), at(1, k + 1)) for k in range(meridians)]
    for i in range(1, parallels - 1):
        for k in range(meridians):
            faces += [(at(i, k), at(i + 1, k), at(i + 1, k + 1)), (at(i, k), at(i + 1, k + 1), at(i, k + 1))]
    faces += [(len(places) - 1, at(parallels - 1, k + 1), at(parallels - 1, k)) for k in range(meridians)]
    return places, faces


@pytest.fixture(scope="module")
def saddle(daemon):
    with daemon.client() as made:
        return made.upload(shapes.saddle(24), name="saddle to sketch on")["id"]


def begin(client, mesh, **given):
    reply = client.post("/v1/layouts", json={"mesh": mesh, **given})
    assert reply.status_code == 201, reply.text
    return Sketcher(client, reply.json())


def degrees(layout):
    found = [0] * len(layout["nodes"])
    for each in layout["curves"]:
        found[each["from"]] += 1
        found[each["to"]] += 1
    return found


def check_undo(client, sketch, before):
    back = client.post(f"/v1/layouts/{sketch.layout['id']}/undo").json()
    assert back["curves"] == before["curves"] and back["nodes"] == before["nodes"] and back["patches"] == before["patches"]
    again = client.post(f"/v1/layouts/{sketch.layout['id']}/redo").json()
    assert again["curves"] == sketch.layout["curves"]


def test_rings_make_tubes_and_caps(client, ball):
    s = begin(client, ball)
    upper = s.ring((1, 0, 0), (0.6, -0.7, 0.3), (0.6, 0.7, 0.3))
    assert len(s.layout["curves"]) == 4 and len(s.layout["patches"]) == 2 and s.layout["complete"]
    assert set(degrees(s.layout)) == {2}
    lengths = [sum(map(math.dist, c["points"], c["points"][1:])) for c in s.layout["curves"]]
    assert max(lengths) <= 1.001 * min(lengths)
    lower = s.ring((1, 0, 0), (0.6, -0.7, -0.3), (0.6, 0.7, -0.3))
    assert [issue["kind"] for issue in s.layout["issues"]] == ["apart"] and not s.layout["complete"]
    before = s.layout
    s.tube(upper, lower)
    assert s.layout["complete"] and len(s.layout["patches"]) == 6 and set(degrees(s.layout)) == {3}
    check_undo(client, s, before)
    for each in s.layout["curves"]:
        assert all(0.98 < math.hypot(*row) < 1.0001 for row in each["points"])
    reply = client.post(f"/v1/layouts/{s.layout['id']}/tubes", json={"first": upper, "second": upper})
    assert "belong to no rings" in check_problem(reply, 422, "invalid_layout")["detail"]


def test_a_click_draws_the_shortest_ring(client, ball):
    """Every plane along the normal of a ball cuts a great circle."""
    s = begin(client, ball)
    s.ring((0, 0.3, 1), (0.1, 0.2, 0.97))
    length = sum(sum(map(math.dist, c["points"], c["points"][1:])) for c in s.layout["curves"])
    assert 0.99 * 2 * math.pi < length < 2 * math.pi
    assert s.layout["stroke"]["points"] == 1 and s.layout["complete"]


def test_rings_cut_what_they_meet_and_do_not_close_on_open_meshes(client, ball, saddle):
    s = begin(client, ball)
    s.ring((1, 0, 0), (0.9, -0.7, 0), (0.9, 0.7, 0))
    s.ring((1, 0, 0), (0.9, 0, -0.7), (0.9, 0, 0.7))
    s.ring((0, 1, 0), (0, 0.9, -0.7), (0, 0.9, 0.7))
    assert len([d for d in degrees(s.layout) if d == 4]) == 6
    open_one = begin(client, saddle)
    body = look((0, 0, 1), [(0.1, 0.1, 0)])
    reply = client.post(f"/v1/layouts/{open_one.layout['id']}/rings", json=body)
    assert "in a closed curve" in check_problem(reply, 422, "invalid_layout")["detail"]


def test_eight_triangles_are_filled_all_at_once(client, ball):
    """Three great circles: the octants have three sides, of which each gets a node in its middle."""
    s = begin(client, ball)
    s.ring((1, 0, 0), (0.9, -0.7, 0), (0.9, 0.7, 0))
    s.ring((1, 0, 0), (0.9, 0, -0.7), (0.9, 0, 0.7))
    s.ring((0, 1, 0), (0, 0.9, -0.7), (0, 0.9, 0.7))
    nodes = [k for k, d in enumerate(degrees(s.layout)) if d == 2]
    while nodes:  # first nodes and quarters of the circles that nothing meets
        first, second = [c["id"] for c in s.layout["curves"] if nodes[0] in (c["from"], c["to"])]
        s.edit("curves/merge", first=first, second=second)
        nodes = [k for k, d in enumerate(degrees(s.layout)) if d == 2]
    assert [issue.get("sides") for issue in s.layout["issues"]] == [3] * 8, s.layout["issues"]
    before = s.layout
    assert s.edit("fill")["filled_cells"] == 8
    assert s.layout["complete"] and len(s.layout["patches"]) == 24 and len(s.layout["nodes"]) == 6 + 12 + 8
    check_undo(client, s, before)
    reply = client.post(f"/v1/layouts/{s.layout['id']}/fill", json={})
    assert "no closed cell" in check_problem(reply, 422, "invalid_layout")["detail"]


def test_a_curve_that_ends_inside_a_side_goes_on_across(client, saddle):
    """The T-junction is told, and a fill resolves it through the patches beyond."""
    whole = saddle_layout()
    del whole["patches"]
    s = begin(client, saddle, **whole)
    whole_line = line((-1, 0.2, -0.2), (0, 0.2, 0))
    body = look((0, 0, 1), [on_saddle(0.95 * x, y) for x, y, _ in whole_line], distance=6)
    s.edit("strokes", **body, snap=0.12)
    assert [issue["sides"] for issue in s.layout["issues"]] == [5]
    assert s.edit("fill")["filled_cells"] == 1
    assert s.layout["complete"] and len(s.layout["patches"]) == 4


def test_one_cell_is_filled_by_a_place_in_it(client, saddle):
    whole = saddle_layout()
    del whole["patches"]
    whole["curves"] = whole["curves"][:6]  # one cell of six sides
    s = begin(client, saddle, **whole)
    assert [issue["sides"] for issue in s.layout["issues"]] == [6]
    reply = client.post(f"/v1/layouts/{s.layout['id']}/fill", json={"point": on_saddle(1.0, 1.0)})
    assert reply.status_code == 200 and reply.json()["complete"], reply.text
    assert len(reply.json()["patches"]) == 2
    reply = client.post(f"/v1/layouts/{s.layout['id']}/fill", json={"point": on_saddle(0.5, 0.1)})
    assert "four sides already" in check_problem(reply, 422, "invalid_layout")["detail"]


def test_chords_are_split_through_their_patches(client, saddle):
    s = begin(client, saddle, **saddle_layout())
    before = s.layout
    s.edit("curves/6/split-chord")  # between the patches: through both, to the boundary
    assert s.layout["complete"] and len(s.layout["patches"]) == 4
    check_undo(client, s, before)
    s.edit("curves/0/split-chord", parts=3)
    assert s.layout["complete"] and len(s.layout["patches"]) == 8
    for each in s.layout["curves"]:
        for x, y, z in each["points"]:
            assert math.isclose(z, x * y, abs_tol=3e-3)
    path = f"/v1/layouts/{s.layout['id']}/curves/0/split-chord"
    for parts in (1, 17, 2.5, "many"):
        problem = check_problem(client.post(path, json={"parts": parts}), 400, "invalid_field")
        assert problem["errors"][0]["pointer"] == "/parts"


def test_nodes_move_with_their_curves(client, saddle):
    s = begin(client, saddle, **saddle_layout())
    before = s.layout
    s.edit("nodes/1/move", point=on_saddle(0.2, -0.9))
    node = s.layout["nodes"][1]
    assert math.dist(node, on_saddle(0.2, -0.9)) < 5e-3 and s.layout["complete"]
    assert s.layout["changed"] == {"added_curves": [], "changed_curves": [0, 1, 6], "removed_curves": []}
    for each in s.layout["curves"]:
        for end, place in (("from", 0), ("to", -1)):
            assert each["points"][place] == s.layout["nodes"][each[end]]
        for x, y, z in each["points"]:
            assert math.isclose(z, x * y, abs_tol=3e-3)
    check_undo(client, s, before)
    s.edit("nodes/1/move", **look((0, 0, 1), [on_saddle(-0.1, -0.8)], distance=6))
    assert math.dist(s.layout["nodes"][1], on_saddle(-0.1, -0.8)) < 5e-3
    path = f"/v1/layouts/{s.layout['id']}/nodes/"
    for name in ("6", "x1", "-1", "4294967296"):
        check_problem(client.post(path + name + "/move", json={"point": [0, 0, 0]}), 404, "node_not_found")
    check_problem(client.post(path + "1/move", json={"point": [0, 0]}), 400, "invalid_field")


def test_curves_are_bent_between_their_nodes(client, saddle):
    s = begin(client, saddle, **saddle_layout())
    ends = s.layout["curves"][6]["points"]
    s.edit("curves/6/slide", **{"from": on_saddle(0, 0), "to": on_saddle(0.3, 0.1)})
    points = s.layout["curves"][6]["points"]
    assert points[0] == ends[0] and points[-1] == ends[-1] and s.layout["complete"]
    assert min(math.dist(row, on_saddle(0.3, 0.1)) for row in points) < 2e-2
    s.edit("curves/6/slide", **look((0, 0, 1), [on_saddle(0.3, 0.1), on_saddle(-0.2, 0)], distance=6))
    assert min(row[0] for row in s.layout["curves"][6]["points"]) < -0.15
    reply = client.post(f"/v1/layouts/{s.layout['id']}/curves/6/slide",
                        json={"from": on_saddle(0, 1), "to": on_saddle(0.3, 1)})
    assert "by its end" in check_problem(reply, 422, "invalid_layout")["detail"]


def test_merged_nodes_close_a_patch(client, saddle):
    s = begin(client, saddle, **saddle_layout())
    before = s.layout
    s.edit("nodes/merge", first=0, second=4)  # opposite corners of the first patch
    assert len(s.layout["nodes"]) == 5 and len(s.layout["curves"]) == 5
    check_undo(client, s, before)
    path = f"/v1/layouts/{s.layout['id']}/nodes/merge"
    assert "itself" in check_problem(client.post(path, json={"first": 1, "second": 1}), 422, "invalid_layout")["detail"]
    assert "no node 9" in check_problem(client.post(path, json={"first": 1, "second": 9}), 422, "invalid_layout")["detail"]
    check_problem(client.post(path, json={"first": 1}), 400, "invalid_field")


def test_links_join_nodes_along_the_surface(client, saddle):
    whole = saddle_layout()
    del whole["patches"]
    s = begin(client, saddle, **whole)
    s.link(on_saddle(*PLACES[0]), on_saddle(*PLACES[4]))
    assert sorted(issue["sides"] for issue in s.layout["issues"]) == [3, 3]
    drawn = s.layout["curves"][-1]["points"]
    assert all(math.isclose(z, x * y, abs_tol=3e-3) for x, y, z in drawn) and len(drawn) > 8
    path = f"/v1/layouts/{s.layout['id']}/links"
    check_problem(client.post(path, json={"first": 2, "second": 2}), 422, "invalid_layout")


def test_strokes_are_mirrored_and_halves_replaced(client, saddle):
    plane = {"point": [0, 0, 0], "normal": [1, 1, 0]}  # of the saddle z = x y, which it maps onto itself
    s = begin(client, saddle)
    body = look((0, 0, 1), [row for row in curve((0.3, 0.5), (0.8, 0.5))], distance=6)
    s.edit("strokes", **body, mirror=plane)
    assert len(s.layout["curves"]) == 2
    images = {tuple(round(value, 2) for value in node) for node in s.layout["nodes"]}
    assert {(-0.5, -0.3), (-0.5, -0.8)} <= {image[:2] for image in images}
    # Drawn over the plane, and back: one side is the image of the other.
    t = begin(client, saddle)
    t.edit("strokes", **look((0, 0, 1), curve((0.6, 0.4), (-0.5, -0.2)), distance=6))
    t.edit("mirror", **plane)
    assert len(t.layout["curves"]) == 1 and len(t.layout["nodes"]) == 2
    (x, y, _), (v, w, _) = t.layout["nodes"]
    assert math.isclose(x, -w, abs_tol=0.02) and math.isclose(y, -v, abs_tol=0.02)
    path = f"/v1/layouts/{t.layout['id']}/mirror"
    check_problem(client.post(path, json={"point": [0, 0, 0], "normal": [0, 0, 0]}), 400, "invalid_field")
    reply = client.post(path, json={"point": [5, 5, 0], "normal": [1, 1, 0]})
    assert "no curve lies on the side" in check_problem(reply, 422, "invalid_layout")["detail"]


def test_a_closed_stroke_is_cut_into_four(client, saddle):
    s = begin(client, saddle)
    circle = [on_saddle(0.5 * math.cos(a), 0.5 * math.sin(a)) for a in (2 * math.pi * k / 40 for k in range(41))]
    s.edit("strokes", **look((0, 0, 1), circle, distance=6))
    assert len(s.layout["curves"]) == 4 and len(s.layout["patches"]) == 1 and s.layout["complete"]


@pytest.mark.parametrize("change, pointer", [({"points": []}, "/points"), ({"mirror": 3}, "/mirror"),
                                             ({"mirror": {"point": [0, 0, 0]}}, "/normal"), ({"more": 1}, "/more"),
                                             ({"view": [1]}, "/view")])
def test_malformed_rings_are_refused_with_their_place(client, ball, change, pointer):
    s = begin(client, ball)
    body = {**look((0, 0, 1), [(0, 0, 1)]), **change}
    problem = check_problem(client.post(f"/v1/layouts/{s.layout['id']}/rings", json=body), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == pointer, problem
