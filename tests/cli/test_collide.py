"""`quadmesh collide`, `self-collide`, `distance`: words, JSON, CSV and exit status, in this process and by a daemon."""

import json

import pytest

from conftest import write_torus


@pytest.fixture
def wall(tmp_path):
    """Through the middle of `square`."""
    path = tmp_path / "wall.obj"
    path.write_text("v 1 -1 -1\nv 1 3 -1\nv 1 3 1\nv 1 -1 1\nf 1 2 3 4\n")
    return path


@pytest.fixture
def fold(tmp_path):
    """Two triangles over one edge, one on the other."""
    path = tmp_path / "fold.obj"
    path.write_text("v 0 0 0\nv 2 0 0\nv 0 2 0\nv 1 1 0\nf 1 2 3\nf 2 1 4\n")
    return path


def test_colliding_has_a_status_of_its_own(quadmesh, square, wall, raised, where):
    done = quadmesh("collide", square, wall, *where)
    assert done.returncode == 1 and "1 pair of faces meets" in done.stdout
    assert "0 and 0: segment at 1 " in done.stdout
    done = quadmesh("collide", square, raised, *where)
    assert done.returncode == 0 and "0 pairs of faces meet" in done.stdout


def test_json_is_the_result_object(quadmesh, square, wall, where):
    done = quadmesh("collide", square, wall, "--json", "--mode", "first", "--quads", "bilinear", *where)
    assert done.returncode == 1
    result = json.loads(done.stdout)
    assert result["count"] == 1 and result["pairs"][0]["faces"] == [0, 0] and result["elapsed_ms"] >= 0
    assert result["mode"] == "first" and result["quads"] == "bilinear"


def test_self_collision(quadmesh, fold, square, where):
    assert quadmesh("self-collide", square, *where).returncode == 0
    done = quadmesh("self-collide", fold, "--json", "--limit", "0", *where)
    assert done.returncode == 1
    result = json.loads(done.stdout)
    assert result["count"] == 1 and result["pairs"] == []


def test_pairs_as_rows(quadmesh, tmp_path, where):
    a = write_torus(tmp_path / "a.obj", 40, 20, 0.3)
    b = write_torus(tmp_path / "b.obj", 40, 20, 0.4, 0.25)
    write_torus(tmp_path / "c.obj", 40, 20, 0.3, 0.5)
    done = quadmesh("collide", a, "c.obj", "--csv", "pairs.csv", "--json", *where)
    assert done.returncode == 1, done.stderr
    rows = (tmp_path / "pairs.csv").read_text().splitlines()
    assert rows[0] == "face_a,face_b" and len(rows) == json.loads(done.stdout)["count"] + 1 > 100
    pairs = [tuple(map(int, row.split(","))) for row in rows[1:]]
    assert pairs == sorted(set(pairs))
    done = quadmesh("collide", a, b, "-o", "none.csv", *where)
    assert done.returncode == 0 and (tmp_path / "none.csv").read_text() == "face_a,face_b\n"


def test_distance(quadmesh, square, raised, wall, where):
    done = quadmesh("distance", square, raised, "--json", "--tolerance", "1e-9", "--absolute", *where)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["lower"] <= 1 <= result["upper"] <= result["lower"] + 1e-9
    done = quadmesh("distance", square, wall, *where)
    assert done.returncode == 0 and "the surfaces meet" in done.stdout


def test_faults_are_told(quadmesh, square, tmp_path):
    assert quadmesh("collide", square).returncode == 2
    assert quadmesh("self-collide", square, square).returncode == 2
    assert quadmesh("distance", square, square, "--mode", "any").returncode == 2
    assert quadmesh("collide", square, square, "--mode", "some").returncode == 2
    assert quadmesh("collide", square, square, "--limit", "0.5").returncode == 2
    done = quadmesh("collide", square, tmp_path / "nowhere.obj")
    assert done.returncode == 2 and "nowhere.obj" in done.stderr
    done = quadmesh("collide", square, square, "--csv", tmp_path / "no" / "folder.csv")
    assert done.returncode == 2 and "cannot be written" in done.stderr


def write_cube(path, side, at):
    corners = [[at + side * (i >> k & 1) for k in range(3)] for i in range(8)]
    faces = ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"]
    path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {face}\n" for face in faces))
    return path


def test_solids(quadmesh, tmp_path, square, where):
    cube = write_cube(tmp_path / "cube.obj", 1, 0)
    small = write_cube(tmp_path / "small.obj", 0.5, 0.25)
    through = write_cube(tmp_path / "through.obj", 1, 0.75)
    done = quadmesh("collide", small, cube, "--solid", *where)
    assert done.returncode == 0 and "solids   a_inside_b" in done.stdout, done.stderr
    done = quadmesh("collide", cube, through, "--penetration", *where)
    assert done.returncode == 1 and "solids   meeting" in done.stdout and "deep" in done.stdout
    done = quadmesh("collide", cube, square, "--solid", *where)
    assert done.returncode == 2 and "boundary edge" in done.stderr and "mesh B" in done.stderr


def test_a_clearance(quadmesh, square, raised, where):
    assert "verdict  above the limit" in quadmesh("distance", square, raised, "--limit", "0.5", *where).stdout
    done = quadmesh("distance", square, raised, "--limit", "1.5", *where)
    assert done.returncode == 1 and "verdict  below the limit" in done.stdout


def test_a_mesh_that_is_moved_meets_itself_there(quadmesh, tmp_path, where):
    (tmp_path / "fold.obj").write_text("v 0 0 0\nv 2 0 0\nv 0 2 0\nv 1 1 -1\nv 1 1 1\nv 0.5 0.1 1\nf 1 2 3\nf 4 5 6\n")
    (tmp_path / "pose.json").write_text("[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,10,1]")
    here = json.loads(quadmesh("self-collide", "fold.obj", "--json", *where).stdout)
    done = quadmesh("self-collide", "fold.obj", "--json", "--transform", "pose.json", *where)
    moved = json.loads(done.stdout)
    assert done.returncode == 1 and moved["count"] == here["count"] == 1
    for before, after in zip(here["pairs"][0]["points"], moved["pairs"][0]["points"], strict=True):
        assert after == pytest.approx([before[0], before[1], before[2] + 10])
