"""`quadmesh heatmap`: triangles with distances, as PLY and CSV, in this process and by a daemon."""

import json
import struct

import pytest


@pytest.fixture
def pair(tmp_path):
    """A coarse square over a tent, whose ridge is nearest between the square's corners."""
    square, tent = tmp_path / "square.obj", tmp_path / "tent.obj"
    square.write_text("v 0 0 1\nv 2 0 1\nv 2 2 1\nv 0 2 1\nf 1 2 3 4\n")
    tent.write_text("v 0 0 0\nv 1 0 0.5\nv 2 0 0\nv 2 2 0\nv 1 2 0.5\nv 0 2 0\nf 1 2 5 6\nf 2 3 4 5\n")
    return square, tent


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_triangles_go_to_files(quadmesh, pair, tmp_path, where, quads):
    done = quadmesh("heatmap", *pair, "-o", "map.ply", "--csv", "map.csv", "--error", "0.01", "--quads", quads, "--json", *where)
    assert (done.returncode, done.stderr) == (0, "")
    result = json.loads(done.stdout)
    assert result["accurate"] is True and result["error"] <= 0.01 == result["requested_error"] and "triangles" not in result
    head, body = (tmp_path / "map.ply").read_bytes().split(b"end_header\n")
    assert b"property double quality" in head and b"element face %d\n" % result["count"] in head
    corners = list(struct.iter_unpack("<4d", body[: 96 * result["count"]]))
    faces = list(struct.iter_unpack("<B4Id", body[96 * result["count"]:]))
    assert len(corners) == 3 * result["count"] and [f[1] for f in faces] == list(range(0, len(corners), 3))
    assert max(f[5] for f in faces) == result["error"]
    ridge = [d for x, _, _, d in corners if abs(x - 1) < 1e-9]
    assert ridge and all(abs(d - 0.5) <= result["error"] + 1e-9 for d in ridge)
    header, *rows = (tmp_path / "map.csv").read_text().splitlines()
    assert header.startswith("x0,y0,z0,distance0,") and header.endswith(",face,error") and len(rows) == result["count"]
    assert [float(x) for x in rows[0].split(",")[:4]] == list(corners[0])
    assert quadmesh("info", "map.ply").returncode == 0


def test_words_and_limits(quadmesh, pair, where):
    done = quadmesh("heatmap", *pair, *where)
    assert done.returncode == 0 and "of what is interpolated" in done.stdout
    done = quadmesh("heatmap", *pair, "--error", "1e-9", "--pieces", "4", *where)
    assert done.returncode == 3 and "stopped" in done.stdout
    assert quadmesh("heatmap", *pair, "--error", "0").returncode == 2


def test_a_mesh_that_is_moved(quadmesh, pair, tmp_path, where):
    """The square is raised by 2 before: the ridge of the tent is then 2.5 away."""
    (tmp_path / "pose.json").write_text("[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,2,1]")
    done = quadmesh("heatmap", *pair, "--csv", "map.csv", "--error", "0.01", "--transform", "pose.json", *where)
    assert (done.returncode, done.stderr) == (0, "")
    rows = [[float(x) for x in line.split(",")] for line in (tmp_path / "map.csv").read_text().splitlines()[1:]]
    assert all(row[2] == row[6] == row[10] == 3 for row in rows)
    ridge = [row[4 * k + 3] for row in rows for k in range(3) if abs(row[4 * k] - 1) < 1e-9]
    assert ridge and all(abs(distance - 2.5) <= 0.01 + 1e-9 for distance in ridge)
