"""`quadmesh check`: exit statuses, folders, manifests, JUnit as a reader of it sees it, and what GitHub is told."""

import json
import pathlib
import re
import signal
import subprocess
import xml.etree.ElementTree

import junitparser
import pytest
import yaml

from conftest import ROOT, write_torus


def outcome_of(done):
    return json.loads(done.stdout)["outcome"]


def test_statuses(quadmesh, square, raised):
    for limit, status, word in (("1.1", 0, "within"), ("0.9", 1, "beyond")):
        done = quadmesh("check", square, raised, "--limit", limit)
        assert (done.returncode, done.stderr) == (status, "")
        assert done.stdout.startswith(word) and done.stdout.count("\n") == 1
        done = quadmesh("check", square, raised, "--limit", limit, "--json")
        assert done.returncode == status and outcome_of(done) == word
    done = quadmesh("check", square, "nowhere.obj", "--limit", "1")
    assert done.returncode == 2 and done.stdout.startswith("trouble") and "nowhere.obj" in done.stdout


def test_the_same_mesh_is_within_0(quadmesh, square, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 20, 10, 0.3)
    for mesh in (square, torus):
        for quads in ("triangles", "bilinear"):
            assert quadmesh("check", mesh, mesh, "--limit", "0", "--quads", quads).returncode == 0
            assert quadmesh("check", mesh, mesh, "--limit", "0", "--percent", "50", "--quads", quads).returncode == 0


def test_a_distance_at_the_limit_is_within(quadmesh, square, raised):
    """Exactly 1 away, which no rounded bound tells."""
    for options in ([], ["--percent", "90"], ["--quads", "bilinear"]):
        assert quadmesh("check", square, raised, "--limit", "1", *options).returncode == 0
        assert quadmesh("check", square, raised, "--limit", "0.99999999", *options).returncode == 1
    assert quadmesh("hausdorff", square, raised, "--limit", "1").returncode == 0


def test_faces_in_another_order_are_the_same_mesh(quadmesh, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 20, 10, 0.3)
    lines = torus.read_text().splitlines()
    vertices = [line for line in lines if line.startswith("v ")]
    faces = [[int(x) for x in line.split()[1:]] for line in lines if line.startswith("f ")]
    count = len(vertices)
    (tmp_path / "other.obj").write_text("\n".join(
        vertices[::-1] + ["f " + " ".join(str(count + 1 - x) for x in face) for face in faces[::-1]]) + "\n")
    for quads in ("triangles", "bilinear"):
        assert quadmesh("check", torus, "other.obj", "--limit", "0", "--quads", quads).returncode == 0
        done = quadmesh("compare", torus, "other.obj", "--json", "--limit", "0", "--quads", quads)
        symmetric = json.loads(done.stdout)["symmetric"]
        assert symmetric["chamfer"]["l2"] == {"lower": 0, "upper": 0} == symmetric["chamfer"]["l1"]
        assert symmetric["f_score"][0]["f"] == {"lower": 1, "upper": 1}


def test_a_percentage(quadmesh, tmp_path):
    """A ramp that rises from 0 to 1 over its own shadow: 30 % of it is within 0.3."""
    (tmp_path / "ramp.obj").write_text("v 0 0 0\nv 1 0 1\nv 1 1 1\nv 0 1 0\nf 1 2 3 4\n")
    (tmp_path / "floor.obj").write_text("v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\nf 1 2 3 4\n")
    one_way = ["--direction", "a_to_b"]
    for percent, status in (("29.9", 0), ("30.1", 1), ("100", 1)):
        done = quadmesh("check", "ramp.obj", "floor.obj", "--limit", "0.3", "--percent", percent, *one_way)
        assert done.returncode == status, done.stdout
    assert quadmesh("check", "ramp.obj", "floor.obj", "--limit", "1.01", *one_way).returncode == 0
    assert quadmesh("check", "ramp.obj", "floor.obj", "--limit", "1.01").returncode == 1
    done = quadmesh("check", "ramp.obj", "floor.obj", "--limit", "0.3", "--percent", "29.9", *one_way, "--json")
    share = json.loads(done.stdout)["checks"][0]["share_of_new"]
    assert share["lower"] <= 0.3 <= share["upper"]


def test_meeting(quadmesh, square, raised, tmp_path):
    wall = tmp_path / "wall.obj"
    wall.write_text("v 1 -1 -1\nv 1 3 -1\nv 1 3 1\nv 1 -1 1\nf 1 2 3 4\n")
    fold = tmp_path / "fold.obj"
    fold.write_text("v 0 0 0\nv 2 0 0\nv 0 2 0\nv 1 1 0\nf 1 2 3\nf 2 1 4\n")
    for golden, wanted, status in ((wall, "no", 1), (wall, "yes", 0), (raised, "no", 0), (raised, "yes", 1),
                                   (raised, "no", 0)):
        done = quadmesh("check", square, golden, "--collides", wanted)
        assert done.returncode == status, done.stdout
    assert quadmesh("check", square, raised, "--collides", "no", "--limit", "0.5").returncode == 1
    assert quadmesh("check", fold, fold, "--self-collides", "no").returncode == 1
    assert quadmesh("check", fold, fold, "--limit", "0", "--self-collides", "yes").returncode == 0
    assert quadmesh("check", square, raised, "--self-collides", "no", "--limit", "2").returncode == 0


@pytest.fixture
def folders(tmp_path):
    """Pairs by name: one within, one beyond, one that is no mesh, one of other formats, and one on each side alone."""
    flat, high = "v 0 0 0\nv 2 0 0\nv 2 2 0\nf 1 2 3\n", "v 0 0 1\nv 2 0 1\nv 2 2 1\nf 1 2 3\n"
    for folder in ("new", "golden"):
        (tmp_path / folder / "deep").mkdir(parents=True)
        (tmp_path / folder / "notes.txt").write_text("no mesh")
        (tmp_path / folder / ".hidden.obj").write_text(flat)
    (tmp_path / "new" / "same.obj").write_text(flat)
    (tmp_path / "golden" / "same.obj").write_text(flat)
    (tmp_path / "new" / "deep" / "moved.obj").write_text(high)
    (tmp_path / "golden" / "deep" / "moved.obj").write_text(flat)
    (tmp_path / "new" / "format.obj").write_text(flat)
    (tmp_path / "golden" / "format.off").write_text("OFF\n3 1 0\n0 0 0\n2 0 0\n2 2 0\n3 0 1 2\n")
    return tmp_path


def test_folders(quadmesh, folders):
    done = quadmesh("check", "new", "golden/", "--limit", "0.5")
    assert done.returncode == 1, done.stdout
    assert "3 pairs: 2 within, 1 beyond, 0 undecided, 0 trouble" in done.stdout
    assert "deep/moved.obj" in done.stdout and "hidden" not in done.stdout
    assert quadmesh("check", "new", "golden", "--limit", "1.5").returncode == 0
    (folders / "new" / "extra.stl").write_text("solid\nendsolid\n")
    (folders / "golden" / "lost.ply").write_text("ply\n")
    done = quadmesh("check", "new", "golden", "--limit", "1.5", "--json")
    assert done.returncode == 2
    result = json.loads(done.stdout)
    assert result["counts"] == {"within": 3, "undecided": 0, "beyond": 0, "trouble": 2}
    details = {check["name"]: check["detail"] for check in result["checks"]}
    assert "no golden mesh" in details["extra.stl"] and "no new mesh" in details["lost.ply"]


def test_folders_that_cannot_be_paired(quadmesh, folders, square):
    (folders / "empty").mkdir()
    for pair in (("empty", "empty"), ("new", square), (square, "new"), ("nowhere", "golden")):
        done = quadmesh("check", *pair, "--limit", "1")
        assert done.returncode == 2, done.stdout
        assert done.stderr or "trouble" in done.stdout
    done = quadmesh("check", "new", "empty", "--limit", "1")
    assert done.returncode == 2 and done.stdout.count("trouble") == 4  # three, and the sum


def test_nothing_in_a_folder_is_passed_over(quadmesh, square, tmp_path):
    """A link that leads nowhere is in trouble; folders that cannot be followed to their ends are no answer."""
    new, golden = tmp_path / "new", tmp_path / "golden"
    for folder in (new, golden):
        folder.mkdir()
        (folder / "square.obj").write_bytes(square.read_bytes())
        (folder / "lost.obj").symlink_to("nowhere.obj")
        (folder / "round.obj").symlink_to("round.obj")
    done = quadmesh("check", new, golden, "--limit", "1")
    assert done.returncode == 2 and "2 trouble" in done.stdout and "1 within" in done.stdout
    for folder in (new, golden):
        for name in ("lost.obj", "round.obj"):
            (folder / name).unlink()
    assert quadmesh("check", new, golden, "--limit", "1").returncode == 0
    (new / "back").symlink_to(new)
    done = quadmesh("check", new, golden, "--limit", "1")
    assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1 and "leads back" in done.stderr
    (new / "back").unlink()
    for folder in (new, golden):
        deep = folder.joinpath(*"abcdefghijklmnopq")
        deep.mkdir(parents=True)
        (deep / "square.obj").write_text("v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n" if folder == new else square.read_text())
    done = quadmesh("check", new, golden, "--limit", "1")
    assert done.returncode == 2 and "too deep" in done.stderr


def test_a_name_adds_no_lines(quadmesh, square, tmp_path):
    """GitHub takes any line that begins with :: for a command, and a terminal obeys escapes."""
    for folder in ("new", "golden"):
        (tmp_path / folder).mkdir()
    name = "a\n::error::b\r\x1b[31m.obj"
    (tmp_path / "new" / name).write_bytes(square.read_bytes())
    (tmp_path / "golden" / "c.obj").write_bytes(square.read_bytes())
    done = quadmesh("check", "new", "golden", "--limit", "1", "--github")
    lines = re.split("[\r\n]", done.stdout.rstrip("\n"))
    assert len(lines) == 5 and "\x1b" not in "".join(lines[:3])
    assert [line.startswith("::") for line in lines] == [False] * 3 + [True] * 2
    assert "a%0A%3A%3Aerror%3A%3Ab%0D" in lines[3]


def test_a_manifest(quadmesh, folders):
    manifest = {"limit": 0.5, "checks": [
        {"new": "new/same.obj", "golden": "golden/same.obj", "limit": 0},
        {"name": "the moved one", "new": "new/deep/moved.obj", "golden": "golden/deep/moved.obj", "limit": 1.5,
         "direction": "a_to_b", "quads": "bilinear", "percent": 99.5, "collides": "no"},
        {"new": "new/deep/moved.obj", "golden": "golden/deep/moved.obj"}]}
    (folders / "below").mkdir()
    path = folders / "checks.json"
    path.write_text(json.dumps(manifest))
    done = quadmesh("check", path, "--json", cwd=folders / "below")  # paths are relative to the manifest
    assert done.returncode == 1, done.stderr
    result = json.loads(done.stdout)
    assert [check["outcome"] for check in result["checks"]] == ["within", "within", "beyond"]
    assert result["checks"][1]["name"] == "the moved one" and result["checks"][1]["collides"] is False
    # What the command line says holds where the manifest is silent.
    path.write_text(json.dumps({"checks": manifest["checks"][2:]}))
    assert quadmesh("check", path, "--limit", "2").returncode == 0
    assert quadmesh("check", path).returncode == 2


@pytest.mark.parametrize("manifest, words", [
    ("", "empty"), ("[]", "must be a JSON object"), ("{", "cannot be read"), ("{}", "checks must be an array"),
    ('{"checks": []}', "checks must be an array"), ('{"checks": [3]}', "checks/0/ must be an object"),
    ('{"checks": [{"new": "a"}]}', "checks/0/golden is missing"),
    ('{"checks": [{"new": "a", "golden": "b"}]}', "checks/0/limit is missing"),
    ('{"limit": -1, "checks": []}', "limit must be a number of 0 or more"),
    ('{"limit": 1, "chekcs": []}', "chekcs is not a field of a manifest"),
    ('{"limit": 1, "checks": [{"new": "a", "golden": "b", "percent": 0}]}', "checks/0/percent must be"),
    ('{"limit": 1, "checks": [{"new": "a", "golden": "b", "limits": 0}]}', "checks/0/limits is not a field"),
    ('{"limit": 1, "checks": [{"new": "a", "golden": ""}]}', "checks/0/golden must be the path"),
    ('{"limit": 1, "checks": [{"new": "a", "golden": "b", "name": 4}]}', "checks/0/name must be a text"),
    ('{"limit": 1, "collides": "maybe", "checks": []}', "collides must be"),
    ('{"limit": 1, "limit": 2, "checks": []}', "limit is given more than once"),
    ('{"limit": 1, "checks": [{"new": "a", "golden": "b", "new": "c"}]}', "checks/0/new is given more than once"),
])
def test_bad_manifests(quadmesh, tmp_path, manifest, words):
    (tmp_path / "m.json").write_text(manifest)
    done = quadmesh("check", "m.json")
    assert (done.returncode, done.stdout) == (2, "")
    assert "m.json" in done.stderr and words in done.stderr, done.stderr


def test_junit(quadmesh, folders):
    bad = folders / "new" / 'a & "b" <c>\x01é.obj'
    bad.write_text("v 0 0 0\nf 1 2 9\n")
    (folders / "golden" / bad.name).write_text("v 0 0 0\n")
    done = quadmesh("check", "new", "golden", "--limit", "0.5", "--junit", "report.xml")
    assert done.returncode == 2
    report = junitparser.JUnitXml.fromfile(str(folders / "report.xml"))
    assert (report.tests, report.failures, report.errors) == (4, 1, 1)
    suite = next(iter(report))
    cases = {case.name: case for case in suite}
    assert len(cases) == 4 and suite.name == "quadmesh check"
    assert cases["same.obj"].is_passed
    failure = cases["deep/moved.obj"].result[0]
    assert isinstance(failure, junitparser.Failure) and failure.type == "beyond" and "limit 0.5" in failure.message
    error = cases['a & "b" <c>\ufffdé.obj'].result[0]
    assert isinstance(error, junitparser.Error) and error.type == "trouble" and ":2:" in error.message
    root = xml.etree.ElementTree.parse(folders / "report.xml").getroot()
    assert root.tag == "testsuites" and root.find("testsuite").get("tests") == "4"
    assert quadmesh("check", "new", "golden", "--limit", "1", "--junit", "no/folder.xml").returncode == 2


def test_standard_output_holds_one_document(quadmesh, square, raised):
    done = quadmesh("check", square, raised, "--limit", "0.5", "--json", "--junit", "-")
    assert done.returncode == 1 and xml.etree.ElementTree.fromstring(done.stdout).get("failures") == "1"


def test_github(quadmesh, folders):
    bad = folders / "new" / "50%,a:b.obj"
    bad.write_text("f 1 2 9\n")
    (folders / "golden" / bad.name).write_text("v 0 0 0\n")
    lines = quadmesh("check", "new", "golden", "--limit", "0.5", "--github").stdout.splitlines()
    commands = [line for line in lines if line.startswith("::")]
    assert len(commands) == 2
    for command in commands:
        assert re.fullmatch(r"::error file=[^,:]+,title=[^,:]+::.+", command), command
    assert any("file=new/50%25%2Ca%3Ab.obj" in command for command in commands)
    done = quadmesh("check", "new", "golden", "--limit", "0.5", "--github", "--json")
    assert done.stderr.count("::error") == 2 and outcome_of(done) == "trouble"


def test_an_interrupt_is_no_answer(quadmesh, slow_pair):
    command = [quadmesh.program, "check", *slow_pair, "--limit", "0.0015", "--quads", "bilinear", "--gap", "1e-14"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        process.wait(1.0)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode in (0, 1, 3) and out.split()[0] in ("within", "beyond", "undecided")


@pytest.mark.parametrize("arguments", [
    [], ["a", "b", "c", "--limit", "1"], ["a", "b"], ["a", "b", "--limit", "-1"], ["a", "b", "--limit", "nan"],
    ["a", "b", "--limit", "1", "--percent", "0"], ["a", "b", "--limit", "1", "--percent", "101"],
    ["a", "b", "--limit", "1", "--percent", "1,2"], ["a", "b", "--collides", "maybe"], ["a", "b", "--limit", "1", "--gap", "0"]])
def test_wrong_usage(quadmesh, arguments):
    done = quadmesh("check", *arguments)
    assert (done.returncode, done.stdout) == (2, "") and done.stderr


def test_the_workflow_is_one(quadmesh):
    """The sample for GitHub is read as YAML, and its command has options that there are."""
    path = ROOT / "clients" / "examples" / "check.yml"
    steps = yaml.safe_load(path.read_text())["jobs"]["check"]["steps"]
    command = next(step["run"] for step in steps if step.get("run", "").startswith("quadmesh"))
    options = re.findall(r"--[a-z-]+", command)
    usage = quadmesh("check", "--help").stdout
    assert options and all(f"{option} " in usage or f"{option}\n" in usage for option in options)
    assert pathlib.Path(path).name == "check.yml"
