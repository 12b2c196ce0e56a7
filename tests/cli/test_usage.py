"""What a new user types: help, wrong options, files that cannot be read or written, standard input and output."""

import gzip
import json
import pathlib
import struct

import pytest

from conftest import write_box

COMMANDS = {"compare": 2, "check": 2, "report": 2, "hausdorff": 2, "deviation": 2, "heatmap": 2, "distance": 2, "collide": 2,
            "align": 2, "matrix": 2, "project": 2, "info": 1, "quality": 1, "self-collide": 1, "patches": 1, "reconstruct": 2}


@pytest.fixture
def boxes(tmp_path):
    write_box(tmp_path / "a.obj", 1.0)
    write_box(tmp_path / "b.obj", 0.75)
    (tmp_path / "folder.obj").mkdir()
    return tmp_path


def fails(done, *words, status=2):
    assert (done.returncode, done.stdout) == (status, ""), (done.returncode, done.stdout, done.stderr)
    assert done.stderr.count("\n") <= 3, done.stderr
    for word in words:
        assert word in done.stderr, done.stderr


# ---- help ----


def test_the_help_names_all_commands(quadmesh):
    texts = {quadmesh(*words).stdout for words in (["--help"], ["-h"], ["help"])}
    assert len(texts) == 1
    text = texts.pop()
    lines = [line.split()[0] for line in text.splitlines() if line.startswith("  ") and line.strip()]
    assert lines[:-1] == list(COMMANDS) or set(COMMANDS) <= set(lines)
    assert all(len(line) <= 100 for line in text.splitlines())
    for command, words in (("distance", "clearance"), ("hausdorff", "greatest"), ("deviation", "one way"), ("compare", "all figures")):
        assert any(line.strip().startswith(command) and words in line for line in text.splitlines())


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_a_command(quadmesh, command):
    """--help, -h and help COMMAND are one; it says what the command is for, and each option once."""
    texts = {quadmesh(*words).stdout for words in ([command, "--help"], [command, "-h"], ["help", command])}
    assert len(texts) == 1
    text = texts.pop()
    usage, blank, purpose, *_ = text.splitlines()
    assert usage.startswith(f"usage: quadmesh {command} ") and blank == "" and len(purpose) > 30
    names = [word for line in text.splitlines() if line.startswith("  -") for word in line.split() if word.startswith("--")][:99]
    options = [line.split("--", 1)[1].split()[0] for line in text.splitlines() if line.startswith("  -")]
    assert len(options) == len(set(options)) and "help" in options and names
    assert "json" in options and "  -j, --json" in text
    assert "Exit status: 0" in text


def test_the_version(quadmesh):
    told = quadmesh("--version").stdout
    for option in ("--json", "-j"):
        version = json.loads(quadmesh("--version", option).stdout)
        assert told == f"quadmesh {version['version']}\n" and version["name"] == "quadmesh" and "ply" in version["formats"]
    fails(quadmesh("--version", "--xml"), "--version takes --json alone")


# ---- wrong words ----


def test_unknown_commands(quadmesh):
    fails(quadmesh("cmpare", "a", "b"), 'there is no command "cmpare"', "`quadmesh --help` lists the commands")
    fails(quadmesh("help", "cmpare"), 'there is no command "cmpare"')
    fails(quadmesh(), "`quadmesh --help`")


@pytest.mark.parametrize("options, words", [
    (["--nonsense"], "compare has no option --nonsense"), (["--nonsense=3"], "compare has no option --nonsense"),
    (["-x"], "compare has no option -x"), (["--lim", "1"], "--lim is the beginning of --limit --limit-in --limit-out"),
    (["--gap"], "--gap takes a value"), (["-t"], "-t takes a value"), (["--json=1"], "--json takes no value"),
    (["--gap", "1e-3", "--gap", "1e-4"], "--gap is given more than once"), (["-t", "1", "--threads", "2"], "--threads is given more than once"),
    (["--threads", "1.5"], "--threads takes an integer"), (["--gap", "nan"], "--gap takes a number above 0"),
    (["--gap", "-1"], "--gap takes a number above 0"), (["--gap", ""], "--gap takes a number above 0"),
    (["c.obj"], "compare takes two files, got 3")])
def test_wrong_options(quadmesh, boxes, options, words):
    """The message stands out: the usage text is for --help."""
    fails(quadmesh("compare", "a.obj", "b.obj", *options), words, "usage: quadmesh compare A B [options]",
          "`quadmesh compare --help` prints the options")


def test_what_may_be_repeated(quadmesh, boxes):
    assert quadmesh("compare", "a.obj", "b.obj", "--limit", "0.1", "--limit", "0.2,0.3", "--json", "--json").returncode == 0
    fails(quadmesh("check", "a.obj", "b.obj", "--limit", "0.1", "--limit", "9"), "--limit is given more than once")


@pytest.mark.parametrize("command", COMMANDS)
def test_no_files(quadmesh, command):
    fails(quadmesh(command), f"{command} takes ", ", got 0 files\n")


@pytest.mark.parametrize("command", ["report", "project"])
def test_outputs_that_are_missing(quadmesh, boxes, command):
    fails(quadmesh(command, "a.obj", "b.obj"), f"{command} needs --output")


# ---- files ----


@pytest.mark.parametrize("command", [name for name, files in COMMANDS.items() if name not in ("check", "reconstruct", "project")])
def test_files_that_cannot_be_read(quadmesh, boxes, command):
    (boxes / "empty.obj").write_text("")
    (boxes / "words.txt").write_text("no mesh\n")
    (boxes / "nan.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")
    (boxes / "cut.obj.gz").write_bytes(gzip.compress((boxes / "a.obj").read_bytes())[:60])
    output = ["-o", "out.html"] if command == "report" else []
    rest = ["a.obj"] * (COMMANDS[command] - 1)
    for name, words in (("nowhere.obj", "No such file"), ("folder.obj", "Is a directory"), ("empty.obj", "the file is empty"),
                        ("words.txt", "format of the file is unknown"), ("nan.obj", "nan.obj:2: a coordinate is not a finite number"),
                        ("cut.obj.gz", "ends early")):
        fails(quadmesh(command, name, *rest, *output), name, words)
        if rest:
            fails(quadmesh(command, *rest, name, *output), name, words)


@pytest.mark.parametrize("arguments", [
    ["deviation", "a.obj", "b.obj", "-o"], ["deviation", "a.obj", "b.obj", "--csv"], ["heatmap", "a.obj", "b.obj", "-o"],
    ["heatmap", "a.obj", "b.obj", "--csv"], ["collide", "a.obj", "b.obj", "-o"], ["align", "a.obj", "b.obj", "-o"],
    ["align", "a.obj", "b.obj", "-j"], ["matrix", "a.obj", "b.obj", "-o"], ["report", "a.obj", "b.obj", "-o"],
    ["project", "a.obj", "points.xyz", "-o"], ["check", "a.obj", "b.obj", "--limit", "1", "--junit"],
    ["patches", "a.obj", "-o"], ["quality", "a.obj", "-o"]])
def test_files_that_cannot_be_written(quadmesh, boxes, arguments):
    """Told before the work is done, with the reason."""
    (boxes / "points.xyz").write_text("0 0 0\n")
    fails(quadmesh(*arguments, "nowhere/out.ply"), "nowhere/out.ply: cannot be written: No such file or directory")
    fails(quadmesh(*arguments, "folder.obj"), "folder.obj: cannot be written: Is a directory")


def test_a_full_disk(quadmesh, boxes):
    for arguments in (["deviation", "--csv"], ["heatmap", "-o"], ["collide", "-o"]):
        done = quadmesh(arguments[0], "a.obj", "b.obj", arguments[1], "/dev/full")
        assert done.returncode == 2 and "/dev/full: cannot be written: No space left on device" in done.stderr


# ---- standard input and output ----


@pytest.mark.parametrize("arguments", [
    ["compare", "-", "b.obj"], ["compare", "-", "a.obj", "--align"], ["hausdorff", "b.obj", "-"], ["align", "-", "a.obj", "-o", "out.ply"],
    ["report", "-", "b.obj", "-o", "out.html"], ["report", "-", "a.obj", "--align", "-o", "out.html"],
    ["check", "-", "b.obj", "--limit", "1"], ["deviation", "-", "b.obj", "-o", "out.ply"], ["info", "-"]])
def test_standard_input(quadmesh, boxes, arguments, where):
    """It comes once, and some commands read their files twice."""
    options = [] if arguments[0] == "info" else where
    for mesh in ((boxes / "a.obj").read_bytes(), gzip.compress((boxes / "a.obj").read_bytes())):
        done = quadmesh(*arguments, *options, input=mesh, text=False)
        assert (done.returncode, done.stderr) == (0, b""), done.stderr


def test_standard_input_is_one_file(quadmesh, boxes):
    fails(quadmesh("compare", "-", "-", input=""), "standard input (-) is one file")
    fails(quadmesh("matrix", "-", "a.obj", "-", input=""), "standard input (-) is one file")


def test_standard_output_holds_the_document_alone(quadmesh, boxes, where):
    done = quadmesh("deviation", "a.obj", "b.obj", "--csv", "-", *where)
    lines = done.stdout.splitlines()
    assert done.returncode == 0 and lines[0] == "vertex,distance" and len(lines) == 9 and "Deviation of A" in done.stderr
    done = quadmesh("collide", "a.obj", "a.obj", "-o", "-", *where)
    assert done.returncode == 1 and done.stdout.startswith("face_a,face_b\n") and "pairs of faces meet" in done.stderr
    done = quadmesh("heatmap", "a.obj", "b.obj", "-o", "-", *where, text=False)
    head, body = done.stdout.split(b"end_header\n")
    count = int(head.split(b"element face ")[1].split()[0])
    assert done.returncode == 0 and len(body) == count * struct.calcsize("<12dB4Id") and b"triangles" in done.stderr
    assert sorted(path.name for path in boxes.iterdir()) == ["a.obj", "b.obj", "folder.obj"]


@pytest.mark.parametrize("arguments", [
    ["deviation", "--csv", "-", "--json"], ["deviation", "--csv", "-", "-o", "-"], ["heatmap", "-o", "-", "-j"], ["collide", "-o", "-", "-j"],
    ["align", "-o", "-", "--json", "-"], ["report", "-o", "-", "--json"]])
def test_two_documents_on_standard_output(quadmesh, boxes, arguments):
    fails(quadmesh(arguments[0], "a.obj", "b.obj", *arguments[1:]), "standard output holds one document")


# ---- others ----


def test_an_extension_that_names_no_format(quadmesh, boxes):
    fails(quadmesh("align", "a.obj", "b.obj", "-o", "out.foo"), "out.foo: the extension names no format", "ply")
    assert quadmesh("align", "a.obj", "a.obj", "-o", "out").returncode == 0 and (boxes / "out").read_bytes().startswith(b"ply\n")


def test_a_check_of_one_mesh(quadmesh, boxes):
    for name in ("a.obj", "folder.obj", "."):
        fails(quadmesh("check", name, "--limit", "1"), f"{name}: is no manifest in JSON", "a NEW and a GOLDEN")


def test_units_of_files_are_overruled(quadmesh, boxes, where):
    """A glTF is in metres and a 3MF in millimetres."""
    assert quadmesh("align", "a.obj", "a.obj", "-o", "metres.glb").returncode == 0
    assert quadmesh("align", "a.obj", "a.obj", "-o", "mm.3mf").returncode == 0
    for command in (["align"], ["heatmap"], ["compare", "--align"], ["hausdorff"]):
        fails(quadmesh(command[0], "metres.glb", "mm.3mf", *command[1:], *where), "unit")
        done = quadmesh(command[0], "metres.glb", "mm.3mf", *command[1:], "--unit", "mm", *where)
        assert done.returncode == 0, done.stderr


def test_a_limit_of_a_matrix(quadmesh, boxes):
    done = quadmesh("matrix", "a.obj", "b.obj", "--limit", "0.5")
    assert done.returncode == 0 and "1 pair: " in done.stdout and "1 within 0.5" in done.stdout
