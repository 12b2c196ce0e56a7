"""`quadmesh align`, and --transform of the commands of two meshes: files, words, JSON and exit status."""

import json
import math

import pytest

TURN = math.pi / 3


def place(x, y, z):
    c, s = math.cos(TURN), math.sin(TURN)
    return (c * x - s * y + 4, s * x + c * y - 2, z + 1)


def write_box(path, at=lambda x, y, z: (x, y, z), size=1.0):
    """A box of sides 1, 2, 3 with a corner cut off, so that it lies on itself in one way."""
    corners = [(x, 2 * y, 3 * z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    corners[7] = (0.7, 1.2, 2.0)
    lines = ["v %r %r %r" % tuple(at(*(size * c for c in p))) for p in corners]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    path.write_text("\n".join(lines + ["f " + " ".join(str(i + 1) for i in face) for face in faces]) + "\n")
    return path


@pytest.fixture
def part(tmp_path):
    return write_box(tmp_path / "part.obj")


@pytest.fixture
def scan(tmp_path):
    return write_box(tmp_path / "scan.obj", place)


def test_the_motion_and_the_moved_mesh(quadmesh, tmp_path, part, scan, where):
    done = quadmesh("align", scan, part, "-o", "aligned.ply", "--json", "pose.json", "--samples", "1000", *where)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Motion of A onto B, least_squares") and "floor" in done.stdout
    result = json.loads((tmp_path / "pose.json").read_text())
    for x, y, z in [(0, 0, 0), (1, 2, 3)]:
        p, t = place(x, y, z), result["transform"]
        q = [t[k] * p[0] + t[4 + k] * p[1] + t[8 + k] * p[2] + t[12 + k] for k in range(3)]
        assert q == pytest.approx((x, y, z), abs=1e-9)
    assert result["rms"] < 1e-9 and result["hausdorff"]["upper"] < 1e-4
    # The written mesh and the pose are the same: no farther than roundings of each other.
    for command in ("hausdorff", "deviation"):
        assert quadmesh(command, "aligned.ply", part).returncode == 0
    done = quadmesh("hausdorff", scan, part, "--transform", "pose.json", "--json", *where)
    assert done.returncode == 0 and json.loads(done.stdout)["upper"] < 1e-4
    done = quadmesh("hausdorff", scan, part, "--json", *where)
    assert json.loads(done.stdout)["lower"] > 1


def test_json_on_standard_output(quadmesh, part, scan, where):
    done = quadmesh("align", scan, part, "--json", "-", "--samples", "500", "--fit", "min_max", *where)
    assert done.returncode in (0, 3), done.stderr
    assert json.loads(done.stdout)["fit"] == "min_max"


def test_a_transform_moves_a_in_every_command_of_two(quadmesh, tmp_path, square, raised, where):
    (tmp_path / "up.json").write_text("[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,1,1]")
    for command in ("hausdorff", "deviation", "distance"):
        done = quadmesh(command, square, raised, "--transform", "up.json", "--json", *where)
        result = json.loads(done.stdout)
        assert done.returncode == 0 and (result["max"]["upper"] if command == "deviation" else result["upper"]) == 0
    assert quadmesh("collide", square, raised, *where).returncode == 0
    assert quadmesh("collide", square, raised, "--transform", "up.json", *where).returncode == 1
    done = quadmesh("deviation", square, raised, "--transform", "up.json", "--ply", "painted.ply", *where)
    assert done.returncode == 0
    assert quadmesh("hausdorff", "painted.ply", raised, "--limit", "0").returncode == 0


def test_compare_and_check_align_first(quadmesh, tmp_path, part, scan, where):
    assert quadmesh("compare", scan, part, "--align", "--json", *where).returncode == 0
    aligned = json.loads(quadmesh("compare", scan, part, "--align", "--json", *where).stdout)
    quadmesh("align", scan, part, "--json", "pose.json")
    posed = json.loads(quadmesh("compare", scan, part, "--transform", "pose.json", "--json", *where).stdout)
    for result in (aligned, posed):
        assert result["symmetric"]["hausdorff"]["upper"] < 1e-4
    assert quadmesh("check", scan, part, "--limit", "1e-6").returncode == 1
    assert quadmesh("check", scan, part, "--limit", "1e-6", "--align").returncode == 0
    write_box(tmp_path / "large.obj", place, 1.2)
    done = quadmesh("check", "large.obj", part, "--limit", "0.01", "--align")
    assert done.returncode == 1 and "no rigid motion" in done.stdout + done.stderr


def test_scale_landmarks_and_mirror(quadmesh, tmp_path, part):
    write_box(tmp_path / "small.obj", place, 0.5)
    done = quadmesh("align", "small.obj", part, "--motion", "rigid_scale", "--json", "-", "--samples", "1000")
    assert done.returncode == 0 and json.loads(done.stdout)["scale"] == pytest.approx(2)
    write_box(tmp_path / "image.obj", lambda x, y, z: (-x, y, z))
    done = quadmesh("align", "image.obj", part, "--mirror", "--json", "-", "--samples", "1000")
    assert json.loads(done.stdout)["mirrored"] is True
    points = [(0, 0, 0), (1, 0, 0), (0, 2, 0)]
    write_box(tmp_path / "scan.obj", place)
    marks = [word for p in points for word in ("--landmark", ",".join(map(repr, place(*p) + p)))]
    done = quadmesh("align", "scan.obj", part, *marks, "--json", "-", "--samples", "1000")
    result = json.loads(done.stdout)
    assert done.returncode == 0 and result["rms"] < 1e-9 and result["certainty"]["runner_up_rms"] is None


@pytest.mark.parametrize("text, word", [
    ("x", "no transform"), ("{}", "no transform"), ("[1,2,3]", "no transform"), ("[" + "0," * 16 + "1]", "no transform"),
    ('{"transform":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,"x"]}', "no transform"), ("[" + "0," * 15 + "1]", "singular"),
    ("[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1]", "last row"),
    ("[1e308,0,0,0,0,1e308,0,0,0,0,1e308,0,0,0,0,1]", "overflow"),
])
def test_a_pose_file_that_is_none(quadmesh, tmp_path, square, raised, text, word):
    (tmp_path / "pose.json").write_text(text)
    (tmp_path / "big.obj").write_text("v 0 0 9\nv 20 0 9\nv 20 20 9\nv 0 20 9\nf 1 2 3 4\n")
    done = quadmesh("hausdorff", tmp_path / "big.obj", raised, "--transform", "pose.json")
    assert done.returncode == 2 and word in done.stderr, done.stderr


def test_wrong_usage(quadmesh, tmp_path, square, raised):
    done = quadmesh("compare", square, raised, "--align", "--transform", "nowhere.json")
    assert (done.returncode, done.stdout) == (2, "") and "one of them" in done.stderr
    for words in (["--landmark", "1,2,3"], ["--landmark", "1,2,3,4,5,x"], ["--trim", "1"], ["--samples", "3"], ["--fit", "x"]):
        done = quadmesh("align", square, raised, *words)
        assert done.returncode == 2 and words[0][2:] in done.stderr
    assert quadmesh("align", square, raised, "-o", "no/such/folder.ply").returncode == 2
    assert quadmesh("hausdorff", square, raised, "--transform", "missing.json").returncode == 2
