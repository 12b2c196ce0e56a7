"""`quadmesh project`: points and rows in every form, in this process and by a daemon."""

import array
import json
import random
import struct

import pytest

ROW = struct.Struct("<7d")


@pytest.fixture
def points(tmp_path):
    """Two points over the square and one beside it."""
    path = tmp_path / "points.xyz"
    path.write_text("1 0.5 3\n0 0 -1 # with more words\n3,1,0\n")
    return path


FEET = [(3, 1, 0.5, 0, 0, 0.5, 0.25), (1, 0, 0, 0, 0, 0, 0), (1, 2, 1, 0, 0, 1, 0.5)]


def csv_rows(text):
    head, *lines = text.splitlines()
    assert head == "distance,x,y,z,face,u,v"
    return [tuple(map(float, line.split(","))) for line in lines]


def check_feet(rows):
    assert len(rows) == len(FEET)
    for row, foot in zip(rows, FEET):
        assert row == pytest.approx(foot, abs=1e-12)


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_the_end_of_the_name_tells_the_form(quadmesh, square, points, tmp_path, where, quads):
    for name in ("out.csv", "out.bin", "out.json"):
        done = quadmesh("project", square, points, "-o", name, "--quads", quads, *where)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    check_feet(csv_rows((tmp_path / "out.csv").read_text()))
    check_feet(list(ROW.iter_unpack((tmp_path / "out.bin").read_bytes())))
    feet = json.loads((tmp_path / "out.json").read_text())["points"]
    check_feet([(f["distance"], *f["point"], f["face"], *f["uv"]) for f in feet])


def test_standard_output_gets_text(quadmesh, square, points, where):
    done = quadmesh("project", square, points, "-o", "-", *where)
    assert (done.returncode, done.stderr) == (0, "")
    check_feet(csv_rows(done.stdout))


@pytest.mark.parametrize("accelerator", ["auto", "boxes", "tetra", "grid"])
def test_each_accelerator_finds_the_feet(quadmesh, square, points, where, accelerator):
    done = quadmesh("project", square, points, "-o", "-", "--accelerator", accelerator, *where)
    assert (done.returncode, done.stderr) == (0, "")
    check_feet(csv_rows(done.stdout))


def test_flags_win_over_names(quadmesh, square, points, tmp_path, where):
    done = quadmesh("project", square, points, "--output", "out.csv", "--binary", *where)
    assert done.returncode == 0
    check_feet(list(ROW.iter_unpack((tmp_path / "out.csv").read_bytes())))
    done = quadmesh("project", square, points, "--output", "out", "--csv", *where)
    assert done.returncode == 0
    check_feet(csv_rows((tmp_path / "out").read_text()))


@pytest.mark.parametrize("name, options", [("p.f64", []), ("p.bin", []), ("p", ["--format", "f64"])])
def test_points_may_be_binary(quadmesh, square, tmp_path, where, name, options):
    (tmp_path / name).write_bytes(struct.pack("<9d", 1, 0.5, 3, 0, 0, -1, 3, 1, 0))
    done = quadmesh("project", square, name, "-o", "-", *options, *where)
    assert (done.returncode, done.stderr) == (0, "")
    check_feet(csv_rows(done.stdout))


def test_many_points_keep_their_order(quadmesh, large_pair, tmp_path, server):
    chance = random.Random(7)
    numbers = array.array("d", [chance.uniform(-1, 1) for _ in range(3 * 150000)])
    (tmp_path / "p.f64").write_bytes(numbers.tobytes())
    for name, options in (("one", []), ("two", ["--threads", "2"]), ("there", ["--server", server])):
        assert quadmesh("project", large_pair[0], "p.f64", "-o", name, *options).returncode == 0
    one = (tmp_path / "one").read_bytes()
    assert len(one) == 150000 * ROW.size
    assert one == (tmp_path / "two").read_bytes() == (tmp_path / "there").read_bytes()
    for i, (distance, x, y, z, *_) in enumerate(ROW.iter_unpack(one)):
        p = numbers[3 * i:3 * i + 3]
        assert abs(distance**2 - (p[0] - x) ** 2 - (p[1] - y) ** 2 - (p[2] - z) ** 2) < 1e-9


@pytest.mark.parametrize("name, options", [("none.xyz", []), ("none.f64", [])])
def test_no_points_have_no_rows(quadmesh, square, tmp_path, where, name, options):
    (tmp_path / name).touch()
    done = quadmesh("project", square, name, "-o", "-", *where)
    assert (done.returncode, done.stdout) == (0, "distance,x,y,z,face,u,v\n")


@pytest.mark.parametrize(
    "name, content, code, words",
    [
        ("p.xyz", b"0 0 0\n1 x 2\n", "malformed_file", "p.xyz:2: "),
        ("p.xyz", b"0 0 0\n1 nan 2\n", "not_finite", "p.xyz:2: "),
        ("p.f64", b"\0" * 25, "malformed_file", "25 bytes"),
        ("p.f64", struct.pack("<6d", 0, 0, 0, 0, float("inf"), 0), "not_finite", "byte 32: point 1 "),
    ],
)
def test_bad_points_are_named(quadmesh, square, tmp_path, where, name, content, code, words):
    (tmp_path / name).write_bytes(content)
    done = quadmesh("project", square, name, "-o", "out", *where)
    assert (done.returncode, done.stdout) == (2, "")
    assert words in done.stderr
    assert not (tmp_path / "out").exists()
    done = quadmesh("project", square, name, "-o", "out", "--json", *where)
    assert (done.returncode, done.stderr) == (2, "")
    assert json.loads(done.stdout)["code"] == code


def test_a_bad_mesh_leaves_no_output(quadmesh, points, tmp_path, where):
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 nan\n")
    done = quadmesh("project", "bad.obj", points, "-o", "out.csv", *where)
    assert (done.returncode, done.stdout) == (2, "")
    assert "bad.obj:2: " in done.stderr
    assert not (tmp_path / "out.csv").exists()


def test_an_output_that_cannot_be_written(quadmesh, square, points, where):
    done = quadmesh("project", square, points, "-o", "no/such/folder", *where)
    assert done.returncode == 2
    assert "cannot be written" in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["mesh"],
        ["mesh", "points"],
        ["mesh", "points", "-o"],
        ["mesh", "points", "more", "-o", "out"],
        ["mesh", "points", "-o", "out", "--format", "f32"],
        ["mesh", "points", "-o", "out", "--quads", "flat"],
        ["mesh", "points", "-o", "out", "--threads", "0"],
        ["mesh", "points", "-o", "out", "--what"],
    ],
)
def test_wrong_usage(quadmesh, arguments):
    done = quadmesh("project", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert "usage:" in done.stderr


def test_help(quadmesh):
    done = quadmesh("project", "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert "usage:" in done.stdout


def test_a_mesh_that_is_moved(quadmesh, square, tmp_path, where):
    (tmp_path / "points.xyz").write_text("1 1 5\n3 3 2\n")
    (tmp_path / "pose.json").write_text('{"transform": [1,0,0,0, 0,1,0,0, 0,0,1,0, 1,0,2,1]}')
    done = quadmesh("project", square, "points.xyz", "-o", "-", "--transform", "pose.json", *where)
    assert (done.returncode, done.stderr) == (0, "")
    found = [[float(x) for x in line.split(",")[:4]] for line in done.stdout.splitlines()[1:]]
    assert found == [pytest.approx([3, 1, 1, 2]), pytest.approx([1, 3, 2, 2])]
    done = quadmesh("project", square, "points.xyz", "-o", "-", "--transform", "nowhere.json", *where)
    assert done.returncode == 2 and "nowhere.json" in done.stderr
