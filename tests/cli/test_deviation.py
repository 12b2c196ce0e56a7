"""`quadmesh deviation`: words, JSON, CSV and PLY, in this process and by a daemon."""

import json
import math
import random
import struct
from fractions import Fraction

import pytest

from conftest import write_torus


@pytest.fixture
def ramp(tmp_path):
    """A square over the middle of `floor` that rises from 1 to 2."""
    path = tmp_path / "ramp.obj"
    path.write_text("v 0 0 1\nv 1 0 2\nv 1 1 2\nv 0 1 1\nf 1 2 3 4\n")
    return path


@pytest.fixture
def floor(tmp_path):
    path = tmp_path / "floor.obj"
    path.write_text("v -5 -5 0\nv 6 -5 0\nv 6 6 0\nv -5 6 0\nf 1 2 3 4\n")
    return path


@pytest.fixture
def tori(tmp_path):
    return (
        write_torus(tmp_path / "torus_a.obj", 60, 30, 0.3),
        write_torus(tmp_path / "torus_b.obj", 61, 31, 0.31, 0.37),
    )


def holds(interval, value, width=1e-6):
    return interval["lower"] <= value <= interval["upper"] and interval["upper"] - interval["lower"] <= width


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_ramp_has_known_moments(quadmesh, ramp, floor, where, quads):
    done = quadmesh("deviation", ramp, floor, "--json", "--quads", quads, "--percentiles", "10,50", "--bins", "2",
                    *where)
    assert (done.returncode, done.stderr) == (0, "")
    result = json.loads(done.stdout)
    assert result["over"] == "area" and result["accurate"] is True and result["quads"] == quads
    assert holds(result["mean"], 1.5)
    assert holds(result["rms"], math.sqrt(7 / 3))
    assert holds(result["max"], 2, 1e-5)
    assert [row["percent"] for row in result["percentiles"]] == [10, 50]
    assert holds(result["percentiles"][0], 1.1) and holds(result["percentiles"][1], 1.5)
    assert result["vertex_count"] == 4 and "vertex_distances" not in result
    assert len(result["histogram"]["shares"]) == 2
    assert result["histogram"]["shares"][0][1] < 0.01


def test_words_for_people(quadmesh, ramp, floor, where):
    done = quadmesh("deviation", ramp, floor, "--percentiles", "50", *where)
    assert (done.returncode, done.stderr) == (0, "")
    head, *lines = done.stdout.splitlines()
    assert head == "Deviation of A from B over its area, quads as triangles"
    words = {line.split()[0]: line for line in lines}
    assert {"mean", "rms", "max", "50", "search"} <= set(words)
    low, high = (float(words["mean"].split()[i]) for i in (1, 3))
    assert low <= 1.5 <= high


def test_vertices_go_to_a_file(quadmesh, ramp, floor, tmp_path, where):
    done = quadmesh("deviation", ramp, floor, "--csv", "out.csv", *where)
    assert done.returncode == 0
    head, *lines = (tmp_path / "out.csv").read_text().splitlines()
    assert head == "vertex,distance"
    assert [line.split(",")[0] for line in lines] == ["0", "1", "2", "3"]
    assert [float(line.split(",")[1]) for line in lines] == pytest.approx([1, 2, 2, 1], abs=1e-12)


def test_a_mesh_is_painted(quadmesh, ramp, floor, tmp_path, where):
    done = quadmesh("deviation", ramp, floor, "--ply", "out.ply", *where)
    assert done.returncode == 0
    head, body = (tmp_path / "out.ply").read_bytes().split(b"end_header\n")
    assert b"element vertex 4\n" in head and b"element face 1\n" in head and b"property double quality\n" in head
    vertices = list(struct.iter_unpack("<3d3Bd", body[: 4 * 35]))
    assert [v[:3] for v in vertices] == [(0, 0, 1), (1, 0, 2), (1, 1, 2), (0, 1, 1)]
    assert [v[6] for v in vertices] == pytest.approx([1, 2, 2, 1], abs=1e-12)
    assert vertices[0][3:6] == vertices[3][3:6] != vertices[1][3:6]
    assert vertices[1][3] > 200 and vertices[1][4] > 200 > vertices[1][5]  # the greatest is yellow
    assert struct.unpack("<B4I", body[4 * 35:]) == (4, 0, 1, 2, 3)
    # What was written is a mesh that can be read again.
    assert quadmesh("info", "out.ply").returncode == 0


def test_a_daemon_says_the_same(quadmesh, tori, server):
    # One thread: the upper end of the maximum limits the others, and depends on how threads share a search.
    options = ["--json", "--pieces", "1000", "--tolerance", "1e-3", "--threads", "1"]
    here = json.loads(quadmesh("deviation", *tori, *options).stdout)
    there = json.loads(quadmesh("deviation", *tori, *options, "--server", server).stdout)
    assert set(here) == set(there)
    for name in ("mean", "rms", "percentiles", "histogram", "size", "pieces"):
        assert here[name] == there[name]


def test_running_out_of_pieces_is_told(quadmesh, tori, where):
    done = quadmesh("deviation", *tori, "--pieces", "0", "--tolerance", "1e-2", *where)
    assert done.returncode == 3
    assert "stopped  before the accuracy was reached" in done.stdout


def test_a_bad_file_names_its_line(quadmesh, ramp, tmp_path, where):
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 nan\n")
    done = quadmesh("deviation", ramp, "bad.obj", "--csv", "out.csv", *where)
    assert (done.returncode, done.stdout) == (2, "")
    assert "bad.obj:2: " in done.stderr
    assert not (tmp_path / "out.csv").exists()


def test_a_file_that_cannot_be_written(quadmesh, ramp, floor, where):
    done = quadmesh("deviation", ramp, floor, "--csv", "no/such/folder", *where)
    assert done.returncode == 2
    assert "no/such/folder: cannot be written: No such file or directory" in done.stderr


@pytest.mark.parametrize(
    "options",
    [
        ["a"],
        ["a", "b", "c"],
        ["a", "b", "--accuracy", "0"],
        ["a", "b", "--tolerance", "x"],
        ["a", "b", "--pieces", "1.5"],
        ["a", "b", "--pieces", "1e8"],
        ["a", "b", "--bins", "-1"],
        ["a", "b", "--percentiles", "0"],
        ["a", "b", "--percentiles", "101"],
        ["a", "b", "--percentiles", "50,"],
        ["a", "b", "--percentiles", "50;60"],
        ["a", "b", "--percentiles", ""],
        ["a", "b", "--quads", "flat"],
        ["a", "b", "--what"],
    ],
)
def test_wrong_usage(quadmesh, options):
    done = quadmesh("deviation", *options)
    assert (done.returncode, done.stdout) == (2, "")
    assert "usage:" in done.stderr


def test_help(quadmesh):
    done = quadmesh("deviation", "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert "usage:" in done.stdout


# ---- signs ----


def turn(a, b, c, d):
    """The sign of (b - a) x (c - a) . (d - a), in fractions."""
    u, v, w = ([y - x for x, y in zip(a, p)] for p in (b, c, d))
    value = (w[0] * (u[1] * v[2] - u[2] * v[1]) + w[1] * (u[2] * v[0] - u[0] * v[2]) + w[2] * (u[0] * v[1] - u[1] * v[0]))
    return (value > 0) - (value < 0)


def is_inside(vertices, faces, p):
    """Parity of the triangles that a segment from p to a far point crosses, in fractions; that point is in no plane with an edge
    and p, or another one is tried."""
    for attempt in range(100):
        far = tuple(Fraction(1000 + 7919 * (attempt + 1) * k, 3) for k in (1, 2, 5))
        crossings = 0
        for a, b, c in (tuple(vertices[i] for i in face) for face in faces):
            sides = [turn(a, b, c, p), turn(a, b, c, far)]
            around = [turn(p, far, x, y) for x, y in ((a, b), (b, c), (c, a))]
            if 0 in around or sides[1] == 0:
                break
            if sides[0] == 0:
                continue  # in the plane of the triangle, off it: the segment leaves at once
            crossings += sides[0] != sides[1] and len(set(around)) == 1
        else:
            return crossings % 2 == 1
    raise AssertionError("no direction is generic")


def spiked(count):
    """A pyramid that is a thin spike over each side of a flat base: nearest faces at its tip face away from points beside it."""
    ring = [(Fraction(round(100 * math.cos(2 * math.pi * i / count)), 1000),
             Fraction(round(100 * math.sin(2 * math.pi * i / count)), 1000), Fraction(0)) for i in range(count)]
    vertices = ring + [(Fraction(3, 2), Fraction(1, 4), Fraction(2)), (Fraction(0), Fraction(0), Fraction(-1, 100))]
    faces = [(i, (i + 1) % count, count) for i in range(count)] + [((i + 1) % count, i, count + 1) for i in range(count)]
    return vertices, faces


def wall():
    """A wall of a thousandth, whose two sides are near to every point of it."""
    size = (Fraction(1), Fraction(1, 1024), Fraction(1))
    vertices = [tuple(s * (i >> k & 1) for k, s in enumerate(size)) for i in range(8)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return vertices, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]


def write_obj(path, vertices, faces):
    lines = [f"v {float(x)!r} {float(y)!r} {float(z)!r}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("shape", [spiked(5), spiked(12), wall()], ids=["spike", "cone", "wall"])
def test_points_are_on_the_side_that_fractions_say(quadmesh, tmp_path, shape):
    seed = 7
    draw = random.Random(seed)
    vertices, faces = shape
    vertices = [tuple(Fraction(float(x)) for x in p) for p in vertices]
    points = []
    while len(points) < 150:
        a, b, c = (vertices[i] for i in draw.choice(faces))
        u, v = sorted((draw.random(), draw.random()))
        shift = draw.choice((1e-2, 1e-4, 1e-6))
        # Beside a face, and in every third case beside one of its edges or corners.
        if draw.random() < 0.33:
            u, v = draw.choice(((0, v), (u, 1), (0, 0), (1, 1)))
        points.append(tuple(float(x * u + y * (v - u) + z * (1 - v)) + draw.uniform(-shift, shift)
                            for x, y, z in zip(a, b, c)))
    truth = [is_inside(vertices, faces, tuple(map(Fraction, p))) for p in points]
    assert 10 < sum(truth) < 140, seed
    target = write_obj(tmp_path / "target.obj", vertices, faces)
    for name, wanted in (("in", True), ("out", False)):
        some = [p for p, inside in zip(points, truth) if inside is wanted]
        (tmp_path / f"{name}.xyz").write_text("".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in some))
        done = quadmesh("deviation", tmp_path / f"{name}.xyz", target, "--json", "--sign", "outside")
        assert done.returncode == 0, done.stderr
        signed = json.loads(done.stdout)["signed"]
        there, other = ("inside", "outside") if wanted else ("outside", "inside")
        assert signed["proven"] is True
        assert signed[there]["size"]["upper"] >= len(some) * (1 - 1e-9), seed
        assert signed[there]["size"]["lower"] >= len(some) - 0.5, seed
        assert signed[other]["size"]["upper"] < 0.5, seed


def test_signs_in_words_and_bands(quadmesh, tmp_path, where):
    vertices, faces = wall()
    target = write_obj(tmp_path / "wall.obj", vertices, faces)
    above = write_obj(tmp_path / "above.obj", [(0, 0, 2), (1, 0, 2), (1, 0, 3)], [(0, 1, 2)])
    done = quadmesh("deviation", above, target, "--sign", "outside", "--bands", "-0.5:1.5,1.5:,:0", *where)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert "signed, positive outside" in lines
    assert [line for line in lines if line.startswith("  from -inf to 0: ")] and "  inside   0 to 0" in lines
    done = quadmesh("deviation", above, above, "--sign", "outside", *where)
    assert done.returncode == 2 and "3 boundary edges" in done.stderr and "mesh B" in done.stderr
    done = quadmesh("deviation", above, above, "--sign", "normal", *where)
    assert done.returncode == 0 and "not proven" in done.stdout


@pytest.mark.parametrize("bands", ["1:0", "1", "x:1", "0:1,", ""])
def test_bands_in_the_wrong_form(quadmesh, ramp, floor, bands):
    done = quadmesh("deviation", ramp, floor, "--sign", "normal", "--bands", bands)
    assert done.returncode == 2 and "--bands" in done.stderr


def test_regions_in_words(quadmesh, ramp, floor, where):
    done = quadmesh("deviation", ramp, floor, "--limit", "1.5", "--regions", *where)
    assert (done.returncode, done.stderr) == (1, "")
    assert "verdict  above the limit" in done.stdout and "1 region of A is or may be beyond it" in done.stdout
    line = next(line for line in done.stdout.splitlines() if line.startswith("  surely"))
    low, high = (float(word.rstrip(",")) for word in line.split("area ")[1].split()[0:3:2])
    assert low <= math.sqrt(2) / 2 <= high and high - low < 0.02
    assert quadmesh("deviation", ramp, floor, "--limit", "2.5", *where).returncode == 0
