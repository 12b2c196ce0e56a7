"""`quadmesh compare`: a table that fits a terminal, JSON, in this process and by a daemon."""

import json
import re

import pytest

from conftest import write_box, write_torus


def test_a_table_of_both_directions(quadmesh, square, raised, where):
    done = quadmesh("compare", square, raised, "--limit", "0.5", "--limit", "2,3e-7", "--worst", "2", "--percentiles",
                    "50", *where)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80 + len(str(square)) - len("square.obj")
    assert all(len(line) <= 80 for line in lines[2:])
    for name in ("hausdorff", "mean", "rms", "std", "50 %", "hd95", "chamfer l1", "chamfer l2", "within", "0.5", "3e-07",
                 "worst of A", "worst of B"):
        assert any(line.startswith("  " + name) for line in lines), name
    assert re.search(r"^  2 +100 +100$", done.stdout, re.M) and re.search(r"^  0.5 +0 +0$", done.stdout, re.M)
    assert "within      F-score" in done.stdout


def test_intervals_are_rounded_outward(quadmesh, tmp_path):
    a = write_torus(tmp_path / "a.obj", 30, 15, 0.3)
    b = write_torus(tmp_path / "b.obj", 31, 16, 0.31, 0.37)
    result = json.loads(quadmesh("compare", a, b, "--json", "--limit", "0.01").stdout)
    table = quadmesh("compare", a, b, "--limit", "0.01").stdout
    number = r"([-+.e\d]+)"
    rows = re.findall(rf"^  (\S+) +{number} to {number}  +{number} to {number}$", table, re.M)
    assert {"hausdorff", "mean", "rms", "std", "0.01"} <= {row[0] for row in rows}
    for name, *ends in rows:
        for side, low, high in (("a_to_b", *ends[:2]), ("b_to_a", *ends[2:])):
            if name in result[side]:
                assert float(low) <= result[side][name]["lower"] and float(high) >= result[side][name]["upper"]
            elif name == "0.01":
                share = result[side]["shares"][0]
                assert float(low) <= 100 * share["lower"] and float(high) >= 100 * share["upper"]


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_mesh_against_itself(quadmesh, square, where, quads):
    done = quadmesh("compare", square, square, "--json", "--limit", "0", "--quads", quads, *where)
    assert done.returncode == 0
    symmetric = json.loads(done.stdout)["symmetric"]
    assert symmetric["chamfer"]["l1"] == {"lower": 0, "upper": 0}
    assert symmetric["f_score"][0]["f"] == {"lower": 1, "upper": 1}


def test_pieces_that_run_out_are_told(quadmesh, tmp_path, where):
    a = write_torus(tmp_path / "a.obj", 12, 6, 0.3)
    b = write_torus(tmp_path / "b.obj", 13, 7, 0.31, 0.37)
    done = quadmesh("compare", a, b, "--pieces", "0", "--accuracy", "1e-6", *where)
    assert done.returncode == 3 and "the intervals hold" in done.stdout


def test_point_sets_are_told(quadmesh, square, tmp_path):
    (tmp_path / "p.xyz").write_text("0 0 1\n1 1 2\n")
    done = quadmesh("compare", "p.xyz", square)
    assert done.returncode == 0 and "A is measured over its points" in done.stdout


def test_limits_of_one_side(quadmesh, tmp_path, where):
    a, b = write_box(tmp_path / "a.obj", 1.0, (0.25, 0, 0)), write_box(tmp_path / "b.obj", 1.0)
    opened = write_box(tmp_path / "open.obj", 0.75, faces=5)
    for limits, status in ((("0.3", "0.3"), 0), (("0.2", "0.3"), 1), (("0.3", "0.2"), 1)):
        done = quadmesh("compare", a, b, "--limit-in", limits[0], "--limit-out", limits[1], "--regions", *where)
        assert (done.returncode, done.stderr) == (status, ""), done.stdout
        assert all(len(line) <= 80 for line in done.stdout.splitlines()[2:])
        assert "positive outside" in done.stdout and f"parts of A are or may be beyond {min(limits)}" in done.stdout
    done = quadmesh("compare", a, b, "--limit-in", "0.1", "--limit-out", "0.1", "--sign", "inside", "--json", *where)
    signed = json.loads(done.stdout)["a_to_b"]["signed"]
    assert done.returncode == 1 and signed["sign"] == "inside"
    assert [(band["from"], band["to"]) for band in signed["bands"]] == [(None, -0.1), (-0.1, 0.1), (0.1, None)]
    done = quadmesh("compare", opened, b, "--sign", "outside", *where)
    assert done.returncode == 0 and "B has no sign against A, which is open" in done.stdout
    done = quadmesh("compare", b, opened, "--limit-in", "1", *where)
    assert done.returncode == 2 and "open" in done.stderr
    done = quadmesh("compare", a, b, "--limit", "0.1", "--regions", *where)
    assert done.returncode == 0 and "may be beyond 0.1" in done.stdout
    done = quadmesh("compare", a, b, "--regions", *where)
    assert done.returncode == 2 and "--regions takes --limit" in done.stderr


def test_bands(quadmesh, tmp_path, where):
    """All of the smaller cube is inside of the larger by a quarter, and all of the larger one outside of it by that or more."""
    a, b = write_box(tmp_path / "a.obj", 0.75), write_box(tmp_path / "b.obj", 1.0)
    bands = ["-0.3:-0.2", ":-0.3", "-0.2:", "0.2:0.5", ":"]
    done = quadmesh("compare", a, b, "--bands", ",".join(bands), "--json", *where)
    result = json.loads(done.stdout)
    assert done.returncode == 0 and result["a_to_b"]["signed"]["sign"] == "outside"
    for side, shares in (("a_to_b", (1, 0, 0, 0, 1)), ("b_to_a", (0, 0, 1, 1, 1))):
        for band, share in zip(result[side]["signed"]["bands"], shares, strict=True):
            assert band["lower"] <= share <= band["upper"] <= band["lower"] + 1e-3, (side, band)
    done = quadmesh("compare", a, b, "--bands", ",".join(bands), "--limit-in", "0.3", *where)
    lines = done.stdout.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("  in the band"))
    assert [line[2:14].strip() for line in lines[at + 1:at + 9]] == [
        "-0.3 to -0.2", "", "below -0.3", "above -0.2", "0.2 to 0.5", "all", "below -0.3", "above -0.3"]
    assert all(len(line) <= 80 and line == line.rstrip() for line in lines[2:])
    done = quadmesh("deviation", a, b, "--bands=-0.3:-0.2", *where)
    assert done.returncode == 0 and "from -0.3 to -0.2: 99.99" in done.stdout
    done = quadmesh("compare", a, b, "--bands", ",".join(["0:1"] * 62), "--limit-in", "0.3", *where)
    assert done.returncode == 2 and "--bands takes up to 61 ranges beside the limits" in done.stderr


@pytest.mark.parametrize("arguments", [
    ["a", "b", "--bands", "1"], ["a", "b", "--bands", "2:1"], ["a", "b", "--bands", ""], ["a", "b", "--bands", "0:1,"],
    ["a", "b", "--bands", "nan:1"], ["a", "b", "--bands", "0:inf"], ["a", "b", "--bands", ",".join(["0:1"] * 65)],
    [], ["a"], ["a", "b", "c"], ["a", "b", "--limit", "-1"], ["a", "b", "--limit", "1,"], ["a", "b", "--limit", "x"],
    ["a", "b", "--worst", "0"], ["a", "b", "--radius", "-1"], ["a", "b", "--gap", "0"], ["a", "b", "--percentiles", "101"],
    ["a", "b", "--limit", "nan"], ["a", "b", "--limit", "inf"], ["a", "b", "--limit", ",".join(["1"] * 65)],
    ["a", "b", "--limit-in", "-1"], ["a", "b", "--sign", "up"]])
def test_wrong_usage(quadmesh, arguments):
    done = quadmesh("compare", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert "usage:" in done.stderr
