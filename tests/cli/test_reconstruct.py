"""`quadmesh reconstruct`: files in, a mesh and a picture out, and what it says when something is wrong."""
import json
import math
import struct
import zlib

import pytest


def on_plate(x, y):
    return [x, y, 0.2 * math.sin(3 * x) * math.cos(2 * y)]


@pytest.fixture
def surface(tmp_path):
    """A wavy plate of 30 x 30 quads over [0, 1] squared."""
    n = 30
    lines = ["v {!r} {!r} {!r}".format(*on_plate(i / n, j / n)) for j in range(n + 1) for i in range(n + 1)]
    lines += ["f {} {} {} {}".format(k + 1, k + 2, k + n + 3, k + n + 2)
              for j in range(n) for k in range(j * (n + 1), j * (n + 1) + n)]
    path = tmp_path / "plate.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def write_layout(path, change=None):
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    lines = []
    for k, (a, b) in enumerate([(0, 1), (1, 2), (2, 3), (3, 0)]):
        (x, y), (v, w) = corners[a], corners[b]
        lines.append({"id": k, "from": a, "to": b,
                      "points": [on_plate(x + (v - x) * t / 10, y + (w - y) * t / 10) for t in range(11)]})
    path.write_text(json.dumps({"nodes": [on_plate(*c) for c in corners], "curves": lines, **(change or {})}))
    return path


@pytest.fixture
def layout(tmp_path):
    return write_layout(tmp_path / "layout.json")


def test_a_mesh_and_its_picture(quadmesh, surface, layout, tmp_path):
    done = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--quads", 300, "--picture", "out.png")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith("out.obj: 256 quads in 1 patches; 100.00 % of the surface")
    rows = (tmp_path / "out.obj").read_text().splitlines()
    assert sum(row.startswith("f ") for row in rows) == 256 and sum(row.startswith("v ") for row in rows) == 289
    picture = (tmp_path / "out.png").read_bytes()
    assert picture[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", picture[16:24])
    size = struct.unpack(">I", picture[33:37])[0]
    pixels = zlib.decompress(picture[41:41 + size])
    assert len(pixels) == height * (1 + 3 * width)
    assert len(set(pixels[1:1 + 3 * width])) == 1 and len(set(pixels)) > 20  # white on top, shades within


def test_goals_and_exit_status(quadmesh, surface, layout):
    done = quadmesh("reconstruct", surface, layout, "-o", "out.ply", "--hausdorff", "2e-3", "--json")
    steps = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0 and steps[-1]["hausdorff"]["upper_relative"] <= 2e-3
    assert steps[-2]["hausdorff"]["upper_relative"] > 2e-3
    done = quadmesh("reconstruct", surface, layout, "-o", "out.ply", "--hausdorff", "1e-9", "--quads", 20)
    assert done.returncode == 3 and "stopped by max_quads" in done.stdout
    done = quadmesh("reconstruct", surface, layout, "-o", "out.ply", "--steps", 3, "--no-measure", "--json")
    steps = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(steps) == 3 and steps[0]["hausdorff"] is None


@pytest.mark.parametrize("form", [(), ("--json",)])
def test_standard_output_holds_the_mesh_alone(quadmesh, surface, layout, tmp_path, form):
    assert quadmesh("reconstruct", surface, layout, "-o", "out.ply", "--steps", 3).returncode == 0
    done = quadmesh("reconstruct", surface, layout, "-o", "-", "--steps", 3, *form, text=False)
    assert done.returncode == 0 and done.stdout == (tmp_path / "out.ply").read_bytes()
    assert len(done.stderr.splitlines()) >= 3


def test_threads_do_not_change_the_mesh(quadmesh, surface, layout, tmp_path):
    for threads in (1, 3):
        done = quadmesh("reconstruct", surface, layout, "-o", f"{threads}.ply", "--quads", 1100, "--threads", threads)
        assert done.returncode == 0
    assert (tmp_path / "1.ply").read_bytes() == (tmp_path / "3.ply").read_bytes()


@pytest.mark.parametrize("change, words", [
    ({"curves": [{"id": 0, "from": 0, "to": 9, "points": [[0, 0, 0], [1, 1, 1]]}]}, "curves/0/to must be an index"),
    ({"nodes": "none"}, "nodes must hold"),
    ({"patches": [[0, 1, 2]]}, "patches/0 must hold the ids of four curves"),
    ({"patches": []}, "no patch"),
    ({"colour": 1}, "colour is not a field of this request"),
])
def test_bad_layouts_are_told_of(quadmesh, surface, tmp_path, change, words):
    path = write_layout(tmp_path / "bad.json", change)
    done = quadmesh("reconstruct", surface, path, "-o", "out.obj")
    assert done.returncode == 1 and words in done.stderr and "bad.json" in done.stderr
    assert not (tmp_path / "out.obj").exists()
    done = quadmesh("reconstruct", surface, path, "-o", "out.obj", "--json")
    assert done.returncode == 1 and words in json.loads(done.stdout)["detail"]


def test_bad_files_and_usage(quadmesh, surface, layout, tmp_path):
    (tmp_path / "broken.json").write_text('{"nodes": [')
    done = quadmesh("reconstruct", surface, "broken.json", "-o", "out.obj")
    assert done.returncode == 1 and "cannot be read" in done.stderr
    assert quadmesh("reconstruct", surface, "nowhere.json", "-o", "out.obj").returncode == 1
    assert quadmesh("reconstruct", "nowhere.obj", layout, "-o", "out.obj").returncode == 1
    done = quadmesh("reconstruct", surface, layout, "-o", "no/such/folder.obj")
    assert done.returncode == 1 and "cannot be written" in done.stderr and done.stdout == ""
    done = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--picture", "no/such/picture.png")
    assert done.returncode == 1 and "picture.png: cannot be written" in done.stderr and done.stdout == ""
    assert not (tmp_path / "out.obj").exists()
    for arguments in ((surface, layout), (surface, "-o", "x"), (surface, layout, "-o", "x", "--quads", "0"),
                      (surface, layout, "-o", "x", "--quads", "1.5"), (surface, layout, "-o", "x", "--edge", "-1"),
                      (surface, layout, "-o", "x", "--colour")):
        assert quadmesh("reconstruct", *arguments).returncode == 2, arguments
    assert quadmesh("reconstruct", "--help").returncode == 0
