"""The example scripts: a layout drawn from a sketch, and one cut out of quads."""
import json
import pathlib
import subprocess
import sys

import shapes

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "clients" / "examples"


def run(name, *words):
    return subprocess.run([sys.executable, EXAMPLES / name, *map(str, words)], capture_output=True, text=True,
                          timeout=120, check=False)


def write_obj(path, vertices, faces):
    lines = ["v %r %r %r" % tuple(vertex) for vertex in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def box_of_quads(n):
    """A cube of n x n quads a side; its eight corners are irregular."""
    corner = {}
    faces = []
    for axis in range(3):
        for level in (0, n):
            for i in range(n):
                for j in range(n):
                    quad = []
                    for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)):
                        place = [0, 0, 0]
                        place[axis], place[axis - 2], place[axis - 1] = level, a, b
                        quad.append(corner.setdefault(tuple(place), len(corner)))
                    faces.append(quad if level else quad[::-1])
    return [[x / n for x in place] for place in corner], faces


def test_a_sketch_becomes_a_layout(daemon, tmp_path):
    """Eight corners and twelve edges on a cube of triangles, drawn round; one goes through a place of its own."""
    vertices, quads = box_of_quads(6)
    surface = write_obj(tmp_path / "box.obj", vertices, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    names = {f"{x}{y}{z}": [x * 1.0, y * 1.0, z * 1.02] for x in (0, 1) for y in (0, 1) for z in (0, 1)}
    curves = [[a, b] for a in names for b in names if a < b and sum(p != q for p, q in zip(a, b)) == 1]
    curves[0].append([0.2, 0.0, 0.5])
    sketch = tmp_path / "sketch.json"
    sketch.write_text(json.dumps({"nodes": names, "curves": curves}))
    done = run("draw_layout.py", surface, sketch, tmp_path / "layout.json", "--server", daemon.url)
    assert done.returncode == 0, done.stderr
    layout = json.loads((tmp_path / "layout.json").read_text())
    assert len(layout["nodes"]) == 8 and len(layout["curves"]) == 12 and len(layout["patches"]) == 6
    for curve in layout["curves"]:
        assert curve["points"][0] == layout["nodes"][curve["from"]]
        assert all(min(min(abs(x), abs(x - 1)) for x in point) < 1e-4 for point in curve["points"])
    bent = layout["curves"][0]["points"]
    assert min(abs(x - 0.2) + abs(y) + abs(z - 0.5) for x, y, z in bent) < 0.02

    sketch.write_text(json.dumps({"nodes": names, "curves": curves[1:]}))
    done = run("draw_layout.py", surface, sketch, tmp_path / "open.json", "--server", daemon.url)
    assert done.returncode == 0 and "6 sides" in done.stderr, done.stderr


def test_quads_become_a_layout(tmp_path, client):
    vertices, quads = box_of_quads(5)
    done = run("layout_of_quads.py", write_obj(tmp_path / "box.obj", vertices, quads), tmp_path / "layout.json")
    assert done.returncode == 0, done.stderr
    layout = json.loads((tmp_path / "layout.json").read_text())
    assert len(layout["nodes"]) == 8 and [len(curve["points"]) for curve in layout["curves"]] == [6] * 12
    mesh = client.upload((vertices, quads))["id"]
    found = client.post("/v1/layouts", json={"mesh": mesh, **layout}).json()
    assert len(found["patches"]) == 6 and found["issues"] == []

    done = run("layout_of_quads.py", write_obj(tmp_path / "open.obj", vertices, quads[1:]), tmp_path / "layout.json")
    assert done.returncode != 0 and "not closed" in done.stderr
    plate = shapes.saddle(2)
    done = run("layout_of_quads.py", write_obj(tmp_path / "plate.obj", *plate), tmp_path / "layout.json")
    assert done.returncode != 0 and "not closed" in done.stderr
