"""Layouts and quads that mean harm: what comes of them is an answer or a problem that says why, in time, and the daemon stays up."""
import math
import random
import time

import pytest

import shapes
from conftest import PATIENCE, WAIT

SECONDS = 5  # the deadline of each request
SLACK = PATIENCE / 2  # for what looks at its deadline seldom, in a build that is slow
CODES = {400: {"invalid_field"}, 409: {"limit_reached"}, 413: None, 422: None, 504: {"deadline_exceeded"}}


# ---- surfaces ----


def grid(columns, rows, at, wrap_u=False, wrap_v=False, turned=False):
    """Quads over a function of u and v from 0 to 1. Turned: the end of u joins its start with v reversed."""
    width = columns + (not wrap_u)

    def number(i, j):
        if wrap_u and i == columns:
            i, j = 0, rows - j if turned else j
        return (j % rows if wrap_v else j) * width + i

    points = [at(i / columns, j / rows) for j in range(rows + (not wrap_v)) for i in range(width)]
    faces = [tuple(number(i + x, j + y) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
             for j in range(rows) for i in range(columns)]
    return points, faces


def on_ring(u, across, up, turn):
    radius = 1 + across * math.cos(turn) - up * math.sin(turn)
    return (radius * math.cos(2 * math.pi * u), radius * math.sin(2 * math.pi * u),
            across * math.sin(turn) + up * math.cos(turn))


def moebius(columns=16, rows=4):
    return grid(columns, rows, lambda u, v: on_ring(u, 0.8 * (v - 0.5), 0, math.pi * u), True, False, True)


def klein(columns=12, rows=8):
    return grid(columns, rows, lambda u, v: on_ring(u, 0.4 * math.sin(2 * math.pi * v), 0.4 * math.sin(4 * math.pi * v),
                                                    math.pi * u), True, True, True)


def torus(scale=1.0):
    return grid(12, 6, lambda u, v: tuple(scale * x for x in on_ring(
        u, 0.4 * math.cos(2 * math.pi * v), 0.4 * math.sin(2 * math.pi * v), 0)), True, True)


def folded():
    return grid(10, 8, lambda u, v: (abs(u - 0.4), v, 0))


def book(leaves=12):
    """Leaves that share the edge of their spine."""
    points, faces = [(0, 0, k / 4) for k in range(5)], []
    for leaf in range(leaves):
        angle, first = 2 * math.pi * leaf / leaves, len(points)
        points += [(math.cos(angle), math.sin(angle), k / 4) for k in range(5)]
        faces += [(k, k + 1, first + k + 1, first + k) for k in range(4)]
    return points, faces


SURFACES = {
    "moebius": moebius,
    "klein": klein,
    "folded": folded,
    "book": book,
    "twice": lambda: (torus()[0], torus()[1] * 2),
    "point": lambda: ([(1.0, 1.0, 1.0)] * len(torus()[0]), torus()[1]),
    "tiny": lambda: torus(1e-160),
    "huge": lambda: torus(1e150),
}


# ---- what is checked ----


def check_answer(client, reply, began, made):
    """An answer, or a problem with words, in time."""
    assert time.monotonic() - began < SECONDS + SLACK
    if reply.status_code not in made:
        problem = reply.json()
        assert reply.status_code in CODES and problem["status"] == reply.status_code, reply.text
        assert problem["detail"], problem
        if reply.status_code == 400:
            assert problem["errors"][0]["pointer"], problem
    assert client.get("/readyz").status_code == 200
    return reply.status_code in made


def make_layout(client, body):
    began = time.monotonic()
    reply = client.post("/v1/layouts", json=body)
    return reply.json() if check_answer(client, reply, began, (201,)) else None


def run_job(client, body):
    began = time.monotonic()
    reply = client.post("/v1/jobs", headers={"Prefer": WAIT}, json={**body, "deadline_ms": 1000 * SECONDS})
    if not check_answer(client, reply, began, (200, 202)):
        return
    job = reply.json()
    assert job["state"] in ("succeeded", "failed", "stopped"), job
    if job["state"] == "failed":
        assert job["problem"]["detail"], job


def reconstruct(client, layout):
    began = time.monotonic()
    reply = client.post("/v1/reconstructions", json={"layout": layout["id"], "deadline_ms": 1000 * SECONDS})
    if check_answer(client, reply, began, (201,)):
        run_job(client, {"type": "reconstruction_step", "reconstruction": reply.json()["id"], "steps": 2, "max_quads": 2000})


@pytest.mark.parametrize("name", SURFACES)
def test_quads_that_mean_harm(client, name):
    began = time.monotonic()
    reply = client.post_mesh(SURFACES[name](), name=name)
    if not check_answer(client, reply, began, (200, 201)):
        return
    mesh = reply.json()["id"]
    sound = client.upload(torus())["id"]
    limit = {"deadline_ms": 1000 * SECONDS}
    for body in ({"mesh": mesh, "quads": mesh}, {"mesh": mesh, "quads": mesh, "patches": 20, "crease_angle": 30},
                 {"mesh": sound, "quads": mesh}, {"mesh": mesh, "quads": sound},
                 {"mesh": mesh, "auto": True, "quad_count": 200}):
        layout = make_layout(client, {**body, **limit})
        if layout:
            reconstruct(client, layout)
    run_job(client, {"type": "remesh", "mesh": mesh, "quads": 300})


# ---- drawings ----


def place(u, v):
    return list(on_ring(u, 0.4 * math.cos(2 * math.pi * v), 0.4 * math.sin(2 * math.pi * v), 0))


def way(a, b, pieces=6):
    return [place(a[0] + (b[0] - a[0]) * k / pieces, a[1] + (b[1] - a[1]) * k / pieces) for k in range(pieces + 1)]


def drawing(columns=4, rows=3):
    """A whole layout of the torus."""
    curves = []

    def add(i, j, x, y):
        curves.append({"id": len(curves), "from": j * columns + i,
                       "to": (j + y) % rows * columns + (i + x) % columns,
                       "points": way((i / columns, j / rows), ((i + x) / columns, (j + y) / rows))})
        curve = curves[-1]
        for end, node in ((0, curve["from"]), (-1, curve["to"])):
            curve["points"][end] = nodes[node]

    nodes = [place(i / columns, j / rows) for j in range(rows) for i in range(columns)]
    for x, y in ((1, 0), (0, 1)):
        for j in range(rows):
            for i in range(columns):
                add(i, j, x, y)
    across = columns * rows
    patches = [[j * columns + i, across + j * columns + (i + 1) % columns, (j + 1) % rows * columns + i, across + j * columns + i]
               for j in range(rows) for i in range(columns)]
    return {"nodes": nodes, "curves": curves, "patches": patches}


def move_node(body, node, position):
    body["nodes"][node] = position
    for curve in body["curves"]:
        for end, at in ((0, curve["from"]), (-1, curve["to"])):
            if at == node:
                curve["points"][end] = position


def scribble(body, count, chance):
    """Curves from node to node across everything."""
    for k in range(count):
        a, b = chance.sample(range(len(body["nodes"])), 2)
        body["curves"].append({"id": 1000 + k, "from": a, "to": b, "points": [
            body["nodes"][a], place(chance.random(), chance.random()), body["nodes"][b]]})


def lose(body, count, chance):
    for _ in range(count):
        body["curves"].pop(chance.randrange(len(body["curves"])))


def add_junction(body, chance):
    at = chance.choice(body["curves"][:24])["points"][3]
    body["nodes"].append(at)
    body["curves"].append({"id": 5000 + len(body["nodes"]), "from": len(body["nodes"]) - 1, "to": 0,
                           "points": [at, body["nodes"][0]]})


DRAWINGS = {
    "a node at 1e160": lambda body, chance: move_node(body, 3, [1e160, 0, 0]),
    "all at 1e160": lambda body, chance: [move_node(body, k, [1e160 * k, 1e160, -1e160]) for k in range(12)],
    "a point at 1e308": lambda body, chance: body["curves"][2]["points"].insert(2, [1e308, -1e308, 1e308]),
    "a point at 1e30": lambda body, chance: body["curves"][2]["points"].insert(2, [1e30, 0, 0]),
    "equal nodes": lambda body, chance: move_node(body, 3, body["nodes"][4]),
    "all nodes equal": lambda body, chance: [move_node(body, k, body["nodes"][0]) for k in range(1, 12)],
    "a patch twice": lambda body, chance: body["patches"].append(body["patches"][0]),
    "a side twice": lambda body, chance: body["patches"].append([0, 0, 0, 0]),
    "there and back": lambda body, chance: body["patches"].append([0, 0, 1, 1]),
    "curves that lie on others": lambda body, chance: body["curves"].extend(
        {**curve, "id": 100 + k} for k, curve in enumerate(body["curves"][:])),
    "a repeated id": lambda body, chance: body["curves"].append(dict(body["curves"][0])),
    "the greatest id": lambda body, chance: body["curves"][5].update(id=4294967295),
    "an id of a half": lambda body, chance: body["curves"][5].update(id=0.5),
    "lost curves": lambda body, chance: lose(body, 7, chance),
    "few curves": lambda body, chance: lose(body, 20, chance),
    "junctions": lambda body, chance: [add_junction(body, chance) for _ in range(9)],
    "a scribble": lambda body, chance: scribble(body, 60, chance),
    "thousands of curves": lambda body, chance: scribble(body, 3000, chance),
    "a long curve": lambda body, chance: body["curves"][1].update(
        points=[body["curves"][1]["points"][0]] + [place(chance.random(), chance.random()) for _ in range(20000)] +
        [body["curves"][1]["points"][-1]]),
    "a flower": lambda body, chance: body["curves"].extend(
        {"id": 100 + k, "from": 0, "to": 0, "points": way((0, 0), (chance.random() / 3, chance.random() / 3)) +
         way((chance.random() / 3, 0.2), (0, 0))[:-1] + [body["nodes"][0]]} for k in range(200)),
}


@pytest.mark.parametrize("finds", [False, True], ids=["patches given", "patches found"])
@pytest.mark.parametrize("name", DRAWINGS)
def test_drawings_that_mean_harm(client, name, finds):
    mesh = client.upload(torus())["id"]
    body = {"mesh": mesh, **drawing()}
    DRAWINGS[name](body, random.Random(1))
    if finds:
        body.pop("patches")
    layout = make_layout(client, body)
    if layout:
        reconstruct(client, layout)


def test_the_sound_drawing_is_whole(client):
    layout = make_layout(client, {"mesh": client.upload(torus())["id"], **drawing()})
    assert layout and len(layout["patches"]) == 12 and layout["issues"] == []
    reconstruct(client, layout)
