"""`quadmesh matrix`: table, lists, CSV and JSON, in this process and by a daemon."""

import csv
import io
import itertools
import json
import math

import pytest

PLACES = [(0, 0, 0), (1, 0, 0), (0, 2, 0), (16, 0, 0)]


def write_square(path, place):
    x, y, z = place
    corners = [(x, y, z), (x + 2, y, z), (x + 2, y + 2, z), (x, y + 2, z)]
    path.write_text("".join(f"v {a} {b} {c}\n" for a, b, c in corners) + "f 1 2 3 4\n")
    return path


@pytest.fixture
def squares(tmp_path):
    """Squares that are moved: the distance of two is the length of the way between them."""
    return [write_square(tmp_path / f"square{i}.obj", place) for i, place in enumerate(PLACES)]


def holds(lower, upper, value):
    return lower <= value * (1 + 1e-15) and value <= upper * (1 + 1e-15)


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_all_pairs_as_json_and_csv(quadmesh, squares, where, quads, tmp_path):
    done = quadmesh("matrix", *squares, "--json", "-o", tmp_path / "m.csv", "--quads", quads, *where)
    assert (done.returncode, done.stderr) == (0, "")
    result = json.loads(done.stdout)
    assert result["files"] == [str(path) for path in squares] and result["quads"] == quads
    assert result["converged"] is True and result["pair_count"] == 6
    rows = list(csv.DictReader(io.StringIO((tmp_path / "m.csv").read_text())))
    for (a, b), row, line in zip(itertools.combinations(range(4), 2), result["pairs"], rows, strict=True):
        assert row[:2] == [a, b] and holds(*row[2:], math.dist(PLACES[a], PLACES[b]))
        assert [line["a"], line["b"]] == [f"square{a}.obj", f"square{b}.obj"]
        assert [float(line["lower"]), float(line["upper"])] == row[2:]


def test_a_table_of_80_columns(quadmesh, squares, where):
    done = quadmesh("matrix", *squares, *where)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert all(len(line) <= 80 for line in lines)
    assert lines[1].split() == ["square1.obj", "square2.obj", "square3.obj"]
    assert lines[2].split() == ["square0.obj", "1", "2", "16"]
    assert lines[4].split() == ["square2.obj", "16.12"]
    assert lines[-1].startswith("6 pairs: ")


def test_nearest(quadmesh, squares, where):
    done = quadmesh("matrix", *squares, "--nearest", 1, *where)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[1::2][:4] == [path.name for path in squares]
    assert [line.split()[0] for line in lines[2::2][:4]] == ["square1.obj", "square0.obj", "square0.obj", "square1.obj"]


def test_within(quadmesh, squares, where):
    done = quadmesh("matrix", *squares, "--within", 2.1, *where)
    assert (done.returncode, done.stderr) == (0, "")
    assert "2 within 2.1, 4 beyond, 0 undecided" in done.stdout
    lines = done.stdout.splitlines()
    assert lines[1] == "within" and [line.split()[:2] for line in lines[2:4]] == [
        ["square0.obj", "square1.obj"], ["square0.obj", "square2.obj"]]


def test_a_limit_near_the_distance(quadmesh, squares):
    assert quadmesh("matrix", squares[0], squares[1], "--within", 1.001).returncode == 0
    # The limit is the distance: the verdict is right if there is one.
    done = quadmesh("matrix", squares[0], squares[1], "--within", 1)
    assert (done.returncode == 3 and "1 undecided" in done.stdout) or (done.returncode == 0 and "1 within" in done.stdout)


def test_many_files_and_names(quadmesh, tmp_path):
    paths = []
    for i in range(9):
        folder = tmp_path / f"part, {i}"
        folder.mkdir()
        paths.append(write_square(folder / "a.obj", (i * i, 0, 0)))
    done = quadmesh("matrix", *paths, "-o", "-")
    rows = list(csv.reader(io.StringIO(done.stdout)))
    assert rows[0] == ["a", "b", "lower", "upper"] and len(rows) == 37 and done.returncode == 0
    assert rows[1][:2] == [str(paths[0]), str(paths[1])]  # one name would stand for nine files
    done = quadmesh("matrix", *paths)
    assert "nearest pair" in done.stdout and "farthest pair" in done.stdout


def test_wrong_usage(quadmesh, squares, tmp_path):
    assert quadmesh("matrix", squares[0]).returncode == 2
    assert quadmesh("matrix", *[squares[0]] * 1001).returncode == 2
    done = quadmesh("matrix", *squares, "--nearest", 1, "--within", 1)
    assert done.returncode == 2 and "one of them" in done.stderr
    assert quadmesh("matrix", *squares, "--nearest", 0).returncode == 2
    bad = quadmesh("matrix", squares[0], tmp_path / "none.obj")
    assert bad.returncode == 2 and "none.obj: cannot be read" in bad.stderr
    bad = quadmesh("matrix", squares[0], tmp_path / "none.obj", "--json")
    assert json.loads(bad.stdout)["code"] == "not_found"
    bad = quadmesh("matrix", *squares, "-o", tmp_path / "none" / "m.csv")
    assert bad.returncode == 2 and "cannot be written" in bad.stderr


def test_standard_output_holds_one_document(quadmesh, squares):
    done = quadmesh("matrix", *squares, "--json", "-o", "-")
    assert done.returncode == 0 and done.stdout == quadmesh("matrix", *squares, "-o", "-").stdout


def test_the_same_file_twice(quadmesh, squares, where):
    done = quadmesh("matrix", squares[0], squares[1], squares[0], "--json", *where)
    assert json.loads(done.stdout)["pairs"][1] == [0, 2, 0, 0]


def test_progress(quadmesh, squares):
    done = quadmesh("matrix", *squares, "--progress")
    assert "of 6 pairs searched" in done.stderr
