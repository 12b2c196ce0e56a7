"""`quadmesh reconstruct`: files in, a mesh and a picture out, and what it says when something is wrong."""
import json
import math
import os
import random
import re
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


def read_png(data):
    """Width and lines of a PNG of 8-bit RGB, by the letter of W3C's recommendation (filters of section 9.2)."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, parts = 8, {}
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        assert zlib.crc32(kind + body) == struct.unpack(">I", data[at + 8 + size:at + 12 + size])[0]
        parts[kind] = parts.get(kind, b"") + body
        at += 12 + size
    width, height, depth, colour, *others = struct.unpack(">IIBBBBB", parts[b"IHDR"])
    assert (depth, colour, others) == (8, 2, [0, 0, 0]) and parts[b"IEND"] == b""
    stream, size, above, lines = zlib.decompress(parts[b"IDAT"]), 3 * width, bytes(3 * width), []
    assert len(stream) == height * (1 + size)
    for y in range(height):
        line = bytearray(stream[y * (1 + size) + 1:(y + 1) * (1 + size)])
        for i in range(size):
            a, b, c = (line[i - 3], above[i], above[i - 3]) if i >= 3 else (0, above[i], 0)
            paeth = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
            line[i] = (line[i] + (0, a, b, (a + b) // 2, paeth)[stream[y * (1 + size)]]) & 255
        lines.append(bytes(line))
        above = line
    return width, lines


def test_a_mesh_and_its_picture(quadmesh, surface, layout, tmp_path):
    done = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--quads", 300, "--picture", "out.png")
    assert done.returncode == 0, done.stderr
    told = re.match(r"out.obj: (\d+) quads in 1 patches; 100.00 % of the surface", done.stdout.splitlines()[-1])
    assert told and 285 <= int(told[1]) <= 300
    rows = (tmp_path / "out.obj").read_text().splitlines()
    faces, vertices = (sum(row.startswith(kind) for row in rows) for kind in ("f ", "v "))
    assert faces == int(told[1]) and vertices in [(n + 1) * (faces // n + 1) for n in range(1, faces + 1) if faces % n == 0]
    width, lines = read_png((tmp_path / "out.png").read_bytes())
    assert (width, len(lines)) == (1000, 800)
    assert set(lines[0]) == {255} and len(set(b"".join(lines))) > 20  # white on top, shades within


def test_no_libspng_is_a_problem_only_where_a_picture_is_written(quadmesh, surface, layout, tmp_path):
    (tmp_path / "libspng.so.0").write_bytes(b"")
    without = os.environ | {"LD_LIBRARY_PATH": str(tmp_path)}
    words = ["reconstruct", surface, layout, "-o", "out.obj", "--quads", 300]
    assert quadmesh(*words, env=without).returncode == 0
    done = quadmesh(*words, "--picture", "out.png", env=without)
    assert done.returncode == 2 and "out.png: cannot be written: Can not access a needed shared library" in done.stderr
    assert not (tmp_path / "out.png").exists()


def test_goals_and_exit_status(quadmesh, surface, layout):
    done = quadmesh("reconstruct", surface, layout, "-o", "out.ply", "--hausdorff", "2e-3", "--json")
    *steps, result = [json.loads(line) for line in done.stdout.splitlines()]
    assert result["mesh"] == "out.ply" and result["stopped_by"] == "hausdorff" and result["warnings"] == []
    assert (result["quads"], result["step_count"]) == (steps[-1]["quads"], len(steps))
    assert done.returncode == 0 and steps[-1]["hausdorff"]["upper_relative"] <= 2e-3
    assert steps[-2]["hausdorff"]["upper_relative"] > 2e-3
    done = quadmesh("reconstruct", surface, layout, "-o", "out.ply", "--hausdorff", "1e-9", "--quads", 20)
    assert done.returncode == 3 and "stopped by max_quads" in done.stdout
    done = quadmesh("reconstruct", surface, layout, "-o", "out.ply", "--steps", 3, "--no-measure", "--json")
    *steps, result = [json.loads(line) for line in done.stdout.splitlines()]
    assert result["stopped_by"] == "steps"
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
    ({"nodes": "none"}, "nodes must be an array of"),
    ({"patches": [[0, 1, 2]]}, "patches/0 must be an array of the ids of four curves"),
    ({"patches": []}, "no patch"),
    ({"colour": 1}, "colour is not a field of this request"),
])
def test_bad_layouts_are_told_of(quadmesh, surface, tmp_path, change, words):
    path = write_layout(tmp_path / "bad.json", change)
    done = quadmesh("reconstruct", surface, path, "-o", "out.obj")
    assert done.returncode == 2 and words in done.stderr and "bad.json" in done.stderr
    assert not (tmp_path / "out.obj").exists()
    done = quadmesh("reconstruct", surface, path, "-o", "out.obj", "--json")
    assert done.returncode == 2 and words in json.loads(done.stdout)["detail"]


def test_bad_files_and_usage(quadmesh, surface, layout, tmp_path):
    (tmp_path / "broken.json").write_text('{"nodes": [')
    done = quadmesh("reconstruct", surface, "broken.json", "-o", "out.obj")
    assert done.returncode == 2 and "cannot be read" in done.stderr
    assert quadmesh("reconstruct", surface, "nowhere.json", "-o", "out.obj").returncode == 2
    assert quadmesh("reconstruct", "nowhere.obj", layout, "-o", "out.obj").returncode == 2
    done = quadmesh("reconstruct", surface, layout, "-o", "no/such/folder.obj")
    assert done.returncode == 2 and "cannot be written" in done.stderr and done.stdout == ""
    done = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--picture", "no/such/picture.png")
    assert done.returncode == 2 and "picture.png: cannot be written" in done.stderr and done.stdout == ""
    assert not (tmp_path / "out.obj").exists()
    for arguments in ((surface, layout), (surface, "-o", "x"), (surface, layout, "-o", "x", "--quads", "0"),
                      (surface, layout, "-o", "x", "--quads", "1.5"), (surface, layout, "-o", "x", "--edge", "-1"),
                      (surface, layout, "-o", "x", "--colour")):
        assert quadmesh("reconstruct", *arguments).returncode == 2, arguments
    assert quadmesh("reconstruct", "--help").returncode == 0


def test_limits_that_allow_no_step_and_the_default(quadmesh, surface, layout):
    done = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--quads", 1)
    assert done.returncode == 2 and "no step fits into the limit of 1 quads: the mesh has 1" in done.stderr
    done = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--no-measure", "--json")
    result = json.loads(done.stdout.splitlines()[-1])
    assert done.returncode == 0 and result["stopped_by"] == "max_quads" and 5000 < result["quads"] <= 10000


def moved(scale, shift):
    """The layout of write_layout in another place or unit."""
    def move(p):
        return [scale * p[0] + shift, *(scale * x for x in p[1:])]
    def change(path):
        drawn = json.loads(write_layout(path).read_text())
        drawn["nodes"] = [move(p) for p in drawn["nodes"]]
        for curve in drawn["curves"]:
            curve["points"] = [move(p) for p in curve["points"]]
        path.write_text(json.dumps(drawn))
        return path
    return change


@pytest.mark.parametrize("change, words", [
    (moved(1000, 0), "times as large as the surface: is it in another unit?"),
    (moved(0.001, 0.5), "and not on it: is it in another unit?"),
    (moved(1, 40), "diagonals of the surface outside its box"),
])
def test_layouts_elsewhere_or_in_another_unit_are_told_of(quadmesh, surface, tmp_path, change, words):
    done = quadmesh("reconstruct", surface, change(tmp_path / "far.json"), "-o", "out.obj")
    assert done.returncode == 2 and words in done.stderr and "far.json" in done.stderr


def test_cells_without_a_patch_are_told_of(quadmesh, surface, tmp_path):
    """A triangle of curves beside the four of a patch: the cell has three sides."""
    path = write_layout(tmp_path / "lost.json")
    drawn = json.loads(path.read_text())
    drawn["nodes"].append(on_plate(1.2, 0.5))
    for k, (a, b) in enumerate([(1, 4), (4, 2)]):
        drawn["curves"].append({"id": 4 + k, "from": a, "to": b, "points": [drawn["nodes"][a], drawn["nodes"][b]]})
    path.write_text(json.dumps(drawn))
    done = quadmesh("reconstruct", surface, path, "-o", "out.obj", "--quads", 100)
    assert done.returncode == 0 and "has 3 sides, not four" in done.stderr


def test_vertices_move_at_the_end(quadmesh, surface, layout, tmp_path):
    def run(*words):
        done = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--quads", "100", *words, "--json")
        assert done.returncode == 0, done.stderr
        return [json.loads(line) for line in done.stdout.splitlines()], (tmp_path / "out.obj").read_text().splitlines()

    lines, drawn = run("--no-settle")
    settled, moved = run()
    assert run("--settle")[1] == moved
    assert [line for line in drawn if line[0] == "f"] == [line for line in moved if line[0] == "f"] and drawn != moved
    assert "settled" not in lines[-1] and len(settled) == len(lines) and settled[-1]["quads"] == lines[-1]["quads"]
    told = settled[-1]["settled"]
    assert told["kept"] is True and told["quality"]["folded_quads"] == 0 and told["quality"]["least_jacobian"] > 0.3
    again = json.loads(quadmesh("hausdorff", surface, "out.obj", "--json").stdout)
    assert again["lower_relative"] <= told["hausdorff"]["upper_relative"]
    assert max(told["from_surface"]["upper"], told["from_quads"]["upper"]) == told["hausdorff"]["upper"]
    assert told["hausdorff"]["upper_relative"] <= 1.25 * lines[-2]["hausdorff"]["upper_relative"]
    assert "settled" not in run("--keep-curves")[0][-1]
    for other in ("--keep-curves", "--no-settle"):
        both = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--settle", other)
        assert both.returncode == 2 and other in both.stderr


def test_marks_stay_at_the_end(quadmesh, surface, layout, tmp_path):
    drawn = json.loads(layout.read_text())
    for curve in drawn["curves"][:2]:
        curve["mark"] = "fixed"
    layout.write_text(json.dumps(drawn))

    def vertices(quads, *words):
        done = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--quads", quads, *words)
        assert done.returncode == 0, done.stderr
        return [line for line in (tmp_path / "out.obj").read_text().splitlines() if line.startswith("v ")]

    def is_fixed(line):
        x, y = map(float, line.split()[1:3])
        return abs(y) < 1e-12 or abs(x - 1) < 1e-12

    # Of the greater number a coarse mesh is settled first.
    for quads in "100", "4000":
        before, after = vertices(quads, "--no-settle"), vertices(quads)
        assert before != after and sum(map(is_fixed, before)) > 12
        assert all(a == b for a, b in zip(before, after) if is_fixed(a))


def test_texture_coordinates_of_its_patches(quadmesh, surface, layout, tmp_path):
    run = quadmesh("reconstruct", surface, layout, "-o", "out.obj", "--quads", "200", "--uv", "--json")
    assert run.returncode == 0, run.stderr
    lines = (tmp_path / "out.obj").read_text().splitlines()
    uv = [tuple(map(float, line.split()[1:])) for line in lines if line.startswith("vt ")]
    faces = [[tuple(map(int, corner.split("/"))) for corner in line.split()[1:]] for line in lines if line.startswith("f ")]
    # One patch: a square of square cells.
    assert len(uv) == sum(line.startswith("v ") for line in lines) == len({t for face in faces for _, t in face})
    for face in faces:
        (a, b), (c, d) = uv[face[0][1] - 1], uv[face[2][1] - 1]
        assert c - a == pytest.approx(d - b) and c > a


def add_noise(path, sigma):
    """The plate's rows of points with noise along z, and no faces."""
    chance = random.Random(7)
    rows = (on_plate(chance.random(), chance.random()) for _ in range(8000))
    path.write_text("".join("{!r} {!r} {!r}\n".format(x, y, z + chance.gauss(0, sigma)) for x, y, z in rows))
    return path


def off_plate(path):
    """The root mean square of the vertices' distances from the plate, along z."""
    rows = [tuple(map(float, line.split()[1:4])) for line in path.read_text().splitlines() if line.startswith("v ")]
    return math.sqrt(sum((z - on_plate(x, y)[2]) ** 2 for x, y, z in rows) / len(rows))


def test_noise_is_found_given_or_kept(quadmesh, layout, tmp_path):
    points = add_noise(tmp_path / "points.xyz", 0.006)

    def run(*words):
        done = quadmesh("reconstruct", points, layout, "-o", "out.obj", "--quads", "400", "--no-measure", "--json", *words)
        assert done.returncode == 0, done.stderr
        return ({w["kind"]: w for w in json.loads(done.stdout.splitlines()[-1])["warnings"]}, off_plate(tmp_path / "out.obj"),
                done.stderr)

    found, off_found, _ = run()
    assert 0.003 < found["noise"]["share"] < 0.0055  # 0.006 of a diagonal of 1.45
    assert "estimated_normals" in found and off_found < 0.2 * 0.006
    given, off_given, _ = run("--noise", "0.004")
    assert given["noise"]["share"] == pytest.approx(0.004) and off_given < 0.2 * 0.006
    kept, off_kept, _ = run("--noise", "0")
    assert "noise" not in kept and off_kept > 1.5 * off_found
    for wrong in ("-1", "0.2", "much", "", "nan", "0.01x"):
        done = quadmesh("reconstruct", points, layout, "-o", "out.obj", "--noise", wrong)
        assert done.returncode == 2 and "--noise" in done.stderr
