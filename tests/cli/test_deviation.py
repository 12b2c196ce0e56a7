"""`quadmesh deviation`: words, JSON, CSV and PLY, in this process and by a daemon."""

import json
import math
import struct

import pytest

from conftest import write_torus


@pytest.fixture(params=["here", "there"])
def where(request):
    """The options that ask this process or a daemon."""
    if request.param == "here":
        return []
    return ["--server", request.getfixturevalue("server")]


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
    assert "no/such/folder cannot be written" in done.stderr


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
