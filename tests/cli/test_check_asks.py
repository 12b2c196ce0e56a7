"""`quadmesh check` on a daemon, of meshes that are moved, in units, and uncertain: the same answers here and there."""

import json
import random

import pytest

from conftest import write_box


def shift(x, y, z):
    return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1]


@pytest.fixture
def boxes(tmp_path):
    write_box(tmp_path / "golden.obj", 1.0)
    write_box(tmp_path / "small.obj", 0.75)
    write_box(tmp_path / "shifted.obj", 1.0, (0.25, 0, 0))
    write_box(tmp_path / "open.obj", 1.0, faces=5)
    (tmp_path / "back.json").write_text(json.dumps({"transform": shift(-0.25, 0, 0)}))
    return tmp_path


@pytest.mark.parametrize("new, options, status", [
    ("small", ["--limit", "0.434"], 0), ("small", ["--limit", "0.433"], 1), ("small", ["--limit-in", "0.25"], 0),
    ("small", ["--limit-in", "0.24"], 1), ("small", ["--limit", "0.3", "--percent", "50"], 0),
    ("small", ["--limit", "0.25", "--percent", "99"], 1), ("shifted", ["--limit", "0.3", "--collides", "no"], 1),
    ("shifted", ["--limit", "0.3", "--self-collides", "no", "--collides", "yes"], 0),
    ("shifted", ["--limit", "1e-6"], 1), ("shifted", ["--limit", "1e-6", "--align"], 0),
    ("shifted", ["--limit", "0", "--transform", "back.json"], 0),
    ("shifted", ["--limit-in", "0", "--limit-out", "0", "--transform", "back.json"], 0),
    ("golden", ["--limit", "0", "--quads", "bilinear"], 0), ("small", ["--limit", "0.01", "--align"], 1)])
def test_here_and_there(quadmesh, boxes, where, new, options, status):
    done = quadmesh("check", f"{new}.obj", "golden.obj", *options, *where)
    assert (done.returncode, done.stderr) == (status, ""), done.stdout
    assert done.stdout.startswith("within" if status == 0 else "beyond")


def test_trouble_names_the_file(quadmesh, boxes, where):
    (boxes / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nf 1 2 9\n")
    for new, golden, words in (("nowhere.obj", "golden.obj", "nowhere.obj: cannot be read"),
                               ("bad.obj", "golden.obj", "bad.obj:3: "), ("golden.obj", "bad.obj", "bad.obj:3: "),
                               ("golden.obj", "open.obj", "open.obj: mesh B is open")):
        done = quadmesh("check", new, golden, "--limit-in", "1", *where)
        assert done.returncode == 2 and done.stdout.startswith(f"trouble    {new}: {words}"), done.stdout
        assert done.stderr == "" and done.stdout.count("\n") == 1


def test_no_daemon(quadmesh, boxes):
    done = quadmesh("check", "small.obj", "golden.obj", "--limit", "1", "--server", "http://127.0.0.1:9")
    assert done.returncode == 2 and "small.obj: " in done.stdout and done.stderr == "", done.stdout


def test_folders_manifests_and_reports_on_a_daemon(quadmesh, boxes, where):
    for folder in ("new", "gold"):
        (boxes / folder).mkdir()
        write_box(boxes / folder / "a.obj", 1.0)
        write_box(boxes / folder / "b.obj", 1.0 if folder == "gold" else 0.9)
    (boxes / "new" / "alone.obj").write_text("v 0 0 0\n")
    done = quadmesh("check", "new", "gold", "--limit", "0.1", "--junit", "j.xml", "--github", "--report", "pages", *where)
    assert done.returncode == 2 and "3 pairs: 1 within, 1 beyond, 0 undecided, 1 trouble" in done.stdout
    assert sorted(path.name for path in (boxes / "pages").iterdir()) == ["001-a.obj.html", "002-b.obj.html"]
    assert "Beyond the limit of 0.1" in (boxes / "pages" / "002-b.obj.html").read_text()
    assert "<testcase" in (boxes / "j.xml").read_text()
    manifest = {"limit": 0.01, "unit": "mm", "checks": [
        {"new": "shifted.obj", "golden": "golden.obj", "transform": shift(-0.25, 0, 0)},
        {"new": "shifted.obj", "golden": "golden.obj"},
        {"new": "golden.obj", "golden": "golden.obj", "uncertainty": [0.004, 0.005]},
        {"new": "golden.obj", "golden": "golden.obj", "uncertainty": 0.006}]}
    (boxes / "m.json").write_text(json.dumps(manifest))
    done = quadmesh("check", "m.json", "--json", *where)
    outcomes = [check["outcome"] for check in json.loads(done.stdout)["checks"]]
    assert done.returncode == 1 and outcomes == ["within", "beyond", "within", "undecided"]


@pytest.mark.parametrize("uncertainty, limit, status", [
    ("0", "1", 0), ("0.05", "1.2", 0), ("0.05", "1.1", 0), ("0.05", "1.0999", 3), ("0.05", "1", 3), ("0.05", "0.9001", 3),
    ("0.05", "0.8999", 1), ("0,0.1", "1.2", 0), ("0.1,0", "1.05", 3), ("5", "0.1", 3), ("5", "10.9", 3), ("5", "11", 0)])
def test_uncertain_meshes(quadmesh, square, raised, where, uncertainty, limit, status):
    """1 apart: the true surfaces are 1 less the uncertainties apart at least, and 1 and these at most."""
    done = quadmesh("check", square, raised, "--limit", limit, "--uncertainty", uncertainty, "--json", *where)
    assert (done.returncode, done.stderr) == (status, ""), done.stdout
    check = json.loads(done.stdout)["checks"][0]
    assert ("of_true" in check) == (uncertainty != "0")
    if uncertainty != "0":
        doubt = sum(float(x) for x in (uncertainty.split(",") * 2)[:2])
        assert check["of_true"]["lower"] <= max(1 - doubt, 0) and 1 + doubt <= check["of_true"]["upper"]
        assert "true surfaces" in check["detail"]


def test_no_true_pair_has_another_answer(quadmesh, square, tmp_path):
    """Any height that the uncertainty leaves to the true surface agrees with what is said to be certain."""
    seed = random.randrange(1 << 30)
    print("seed", seed)
    chance = random.Random(seed)
    for _ in range(15):
        height, doubt = chance.uniform(0.5, 2), chance.uniform(0, 0.5)
        limit = chance.uniform(0.2, 2.5)
        corners = ((0, 0), (2, 0), (2, 2), (0, 2))
        (tmp_path / "high.obj").write_text("".join(f"v {x} {y} {height!r}\n" for x, y in corners) + "f 1 2 3 4\n")
        done = quadmesh("check", "high.obj", square, "--limit", repr(limit), "--uncertainty", f"{doubt!r},0")
        for true_height in (height - doubt, height + doubt, height):
            if done.returncode == 0:
                assert true_height <= limit
            if done.returncode == 1:
                assert true_height > limit
        assert (done.returncode == 3) == (height - doubt <= limit < height + doubt), done.stdout


@pytest.mark.parametrize("options, words", [
    (["--uncertainty", "0.1", "--percent", "90"], "an uncertainty goes with a limit for all of both surfaces"),
    (["--uncertainty", "0.1", "--limit-in", "1"], "an uncertainty goes with a limit for all of both surfaces"),
    (["--uncertainty", "-1"], "--uncertainty takes"), (["--uncertainty", "nan"], "--uncertainty takes"),
    (["--uncertainty", "1,2,3"], "--uncertainty takes"), (["--unit", "parsec"], "--unit takes"),
    (["--transform", "nowhere.json"], "nowhere.json: cannot be read"), (["--transform", "golden.obj"], "golden.obj: it has no"),
    (["--transform", "back.json", "--align"], "both move NEW")])
def test_what_does_not_go_together(quadmesh, boxes, options, words):
    done = quadmesh("check", "small.obj", "golden.obj", "--limit", "1", *options)
    assert done.returncode == 2 and words in done.stdout + done.stderr, done.stdout + done.stderr


@pytest.mark.parametrize("member, words", [
    ({"uncertainty": -1}, "must be one or two numbers"), ({"uncertainty": [1]}, "must be one or two numbers"),
    ({"uncertainty": "1"}, "must be one or two numbers"), ({"unit": "mile"}, "unit must be um, mm"), ({"unit": 1}, "unit must be"),
    ({"transform": [1, 2, 3]}, "transform must be 16 numbers"), ({"transform": [0] * 16}, "transform must be 16 numbers")])
def test_bad_members(quadmesh, boxes, member, words):
    pair = {"new": "small.obj", "golden": "golden.obj", "limit": 1}
    for place, manifest in (("checks/0/", {"checks": [pair | member]}), ("", {"checks": [pair]} | member)):
        (boxes / "m.json").write_text(json.dumps(manifest))
        done = quadmesh("check", "m.json")
        assert done.returncode == 2 and f"m.json: {place}" in done.stderr and words in done.stderr, done.stderr


def test_a_transform_and_an_alignment(quadmesh, boxes):
    (boxes / "m.json").write_text(json.dumps({"limit": 1, "checks": [
        {"new": "small.obj", "golden": "golden.obj", "transform": shift(1, 0, 0)}]}))
    done = quadmesh("check", "m.json", "--align")
    assert done.returncode == 2 and "both move the new mesh" in done.stdout


def test_units_that_differ(quadmesh, boxes, where):
    """A glTF file is in metres; --unit says otherwise."""
    assert quadmesh("align", "golden.obj", "golden.obj", "-o", "metres.glb").returncode == 0
    assert quadmesh("align", "golden.obj", "golden.obj", "-o", "mm.3mf").returncode == 0
    done = quadmesh("check", "metres.glb", "mm.3mf", "--limit", "1", *where)
    assert done.returncode == 2 and "unit" in done.stdout, done.stdout
    done = quadmesh("check", "metres.glb", "mm.3mf", "--limit", "1", "--unit", "mm", *where)
    assert done.returncode == 0, done.stdout
