"""`quadmesh` as a shell sees it: standard output, standard error, exit status."""

import gzip
import json
import os
import pty
import signal
import struct
import subprocess
import time

import pytest


def bracket_holds(result, distance):
    return result["lower"] <= distance <= result["upper"]


@pytest.mark.parametrize("direction", ["a_to_b", "b_to_a", "two_sided"])
@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_distance_of_one(quadmesh, square, raised, direction, quads):
    done = quadmesh("hausdorff", square, raised, "--direction", direction, "--quads", quads, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    result = json.loads(done.stdout)
    assert bracket_holds(result, 1.0)
    assert result["upper"] - result["lower"] <= 1e-6 * 8**0.5
    assert result["converged"] is True
    assert result["stopped_by"] == "converged"
    assert result["verdict"] is None
    assert (result["direction"], result["quads"]) == (direction, quads)
    assert {result["witness"]["from"]["mesh"], result["witness"]["to"]["mesh"]} == {"a", "b"}
    assert set(result["prepare_ms"]) == {"a", "b"}


@pytest.mark.parametrize("accelerator", ["auto", "boxes", "grid"])
@pytest.mark.parametrize("bounds", ["cover", "matching", "cells"])
def test_each_choice_gives_the_distance(quadmesh, square, raised, accelerator, bounds):
    done = quadmesh("hausdorff", square, raised, "--accelerator", accelerator, "--bounds", bounds, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert bracket_holds(json.loads(done.stdout), 1.0)


def test_words_for_people(quadmesh, square, raised):
    done = quadmesh("hausdorff", square, raised, "--tolerance", "0.001", "--absolute", "--threads", "2")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Hausdorff distance, two_sided")


@pytest.mark.parametrize("threads", ["1", "2"])
@pytest.mark.parametrize("command", ["hausdorff", "deviation", "collide", "distance"])
def test_of_two_bad_files_the_first_is_told(quadmesh, square, tmp_path, command, threads):
    bad = tmp_path / "bad.obj"
    bad.write_text("v 0 0\n")
    for a, b, name in ((bad, "missing.obj", "bad.obj:1:"), ("missing.obj", bad, "missing.obj: cannot be read"),
                       (square, bad, "bad.obj:1:"), (bad, square, "bad.obj:1:")):
        done = quadmesh(command, a, b, "--threads", threads)
        assert (done.returncode, done.stdout) == (2, "")
        assert name in done.stderr
        assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("threads", ["1", "2"])
def test_one_file_is_standard_input(quadmesh, square, raised, threads):
    for a, b, path in (("-", raised, square), (square, "-", raised)):
        done = quadmesh("hausdorff", a, b, "--threads", threads, "--json", input=path.read_text())
        assert done.returncode == 0
        assert bracket_holds(json.loads(done.stdout), 1.0)
    done = quadmesh("hausdorff", "-", "-", "--threads", threads, input=square.read_text())
    assert done.returncode == 2
    assert "-: the file is empty" in done.stderr or "-:1: the file is empty" in done.stderr


@pytest.mark.parametrize("option", ["--limit", "--threshold"])
@pytest.mark.parametrize("limit, verdict, status", [("0.5", "above", 1), ("1.5", "below", 0)])
def test_a_limit_gives_a_verdict(quadmesh, square, raised, option, limit, verdict, status):
    done = quadmesh("hausdorff", square, raised, option, limit, "--json")
    assert done.returncode == status
    assert json.loads(done.stdout)["verdict"] == verdict
    done = quadmesh("hausdorff", square, raised, option, limit)
    assert done.returncode == status and ("beyond" if status else "within") + " the limit" in done.stdout


def test_a_queue_out_of_memory_leaves_a_bracket(quadmesh, slow_pair):
    options = ["--quads", "bilinear", "--tolerance", "1e-12", "--memory", "65536", "--json"]
    done = quadmesh("hausdorff", *slow_pair, *options)
    assert done.returncode == 3
    result = json.loads(done.stdout)
    assert result["stopped_by"] == "memory"
    assert 0 < result["lower"] < result["upper"]


def test_a_deadline_leaves_a_bracket(quadmesh, slow_pair):
    options = ["--quads", "bilinear", "--tolerance", "1e-12", "--deadline-ms", "200", "--json"]
    done = quadmesh("hausdorff", *slow_pair, *options)
    assert done.returncode == 3
    result = json.loads(done.stdout)
    assert result["stopped_by"] == "deadline"
    assert 0 < result["lower"] < result["upper"]


@pytest.mark.parametrize("where", ["here", "there"])
def test_an_interrupt_leaves_a_bracket(quadmesh, slow_pair, server, where):
    options = ["--server", server] if where == "there" else []
    command = [quadmesh.program, "hausdorff", *slow_pair, "--tolerance", "1e-12", "--quads", "bilinear", "--json"]
    with subprocess.Popen([*command, "--progress", *options], stdout=-1, stderr=-1, text=True) as running:
        assert running.stderr.readline().startswith("[")  # the search has begun
        time.sleep(0.1)
        running.send_signal(signal.SIGINT)
        stdout, _ = running.communicate(timeout=30)
    assert running.returncode == 3
    result = json.loads(stdout)
    assert result["stopped_by"] == "canceled"
    assert result["lower"] < result["upper"]


def test_progress_only_closes_in(quadmesh, large_pair):
    done = quadmesh("hausdorff", *large_pair, "--tolerance", "1e-3", "--progress")
    assert done.returncode == 0
    brackets = [(float(w[1]), float(w[3])) for w in map(str.split, done.stderr.splitlines())]
    assert len(brackets) >= 2
    for (low, high), (next_low, next_high) in zip(brackets, brackets[1:]):
        assert low <= next_low <= next_high <= high


def test_a_terminal_gets_a_bar(quadmesh, large_pair):
    ours, theirs = pty.openpty()
    done = quadmesh("hausdorff", *large_pair, "--tolerance", "1e-3", capture_output=False, stdout=-1, stderr=theirs)
    os.close(theirs)
    drawn = os.read(ours, 65536).decode()
    os.close(ours)
    assert done.returncode == 0
    assert "\r[" in drawn and "gap" in drawn
    assert drawn.endswith("\r\x1b[K")


def test_a_daemon_says_the_same(quadmesh, square, raised, server):
    here = json.loads(quadmesh("hausdorff", square, raised, "--json").stdout)
    done = quadmesh("hausdorff", square, raised, "--json", "--server", server + "/")
    assert (done.returncode, done.stderr) == (0, "")
    there = json.loads(done.stdout)
    assert set(there) == set(here)
    for name in ("lower", "upper", "lower_relative", "upper_relative", "iterations", "gap"):
        assert there[name] == here[name]


@pytest.mark.parametrize("where", ["here", "there"])
def test_a_bad_file_names_its_line(quadmesh, tmp_path, square, server, where):
    bad = tmp_path / "bad.obj"
    bad.write_text("v 0 0 0\nv 1 0 nan\n")
    options = ["--server", server] if where == "there" else []
    words = quadmesh("hausdorff", square, bad, *options)
    assert (words.returncode, words.stdout) == (2, "")
    assert "bad.obj:2: " in words.stderr
    done = quadmesh("hausdorff", square, bad, "--json", *options)
    assert (done.returncode, done.stderr) == (2, "")
    problem = json.loads(done.stdout)
    assert (problem["status"], problem["code"]) == (422, "not_finite")
    assert problem["errors"][0]["line"] == 2


def test_no_daemon_is_a_problem(quadmesh, square, raised):
    done = quadmesh("hausdorff", square, raised, "--json", "--server", "http://127.0.0.1:9")
    assert (done.returncode, json.loads(done.stdout)["code"]) == (2, "unavailable")


def test_no_libcurl_is_a_problem_only_where_a_daemon_is_asked(quadmesh, square, raised, tmp_path):
    (tmp_path / "libcurl.so.4").write_bytes(b"")
    without = os.environ | {"LD_LIBRARY_PATH": str(tmp_path)}
    done = quadmesh("hausdorff", square, raised, "--json", "--server", "http://127.0.0.1:9", env=without)
    problem = json.loads(done.stdout)
    assert (done.returncode, problem["code"]) == (2, "unavailable")
    assert "libcurl.so.4" in problem["detail"]
    assert quadmesh("hausdorff", square, raised, env=without).returncode == 0


def test_info_is_the_mesh_resource(quadmesh, square):
    done = quadmesh("info", square, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    mesh = json.loads(done.stdout)
    assert mesh["name"] == "square.obj"
    assert mesh["kind"] == "quads"
    assert mesh["vertices"] == 4
    assert mesh["faces"] == {"triangles": 0, "quads": 1, "polygons": 0}
    assert mesh["boundary_edges"] == 4
    assert mesh["bounding_box"] == {"min": [0, 0, 0], "max": [2, 2, 0], "diagonal": 8**0.5}
    assert set(mesh["prepare_ms"]) == {"parse", "topology", "patches", "bvh"}
    assert mesh["warnings"] == []


def write_gltf(path, uri):
    """A triangle whose buffer is in another file."""
    path.write_text(json.dumps({
        "asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}))
    return path


def test_a_gltf_file_has_its_buffers_beside_it(quadmesh, tmp_path):
    folder = tmp_path / "a folder"
    folder.mkdir()
    (folder / "the buffer.bin").write_bytes(struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 2, 0))
    path = write_gltf(folder / "triangle.gltf", "the%20buffer.bin")
    for name, where in ((path, tmp_path), (path.name, folder)):
        told = quadmesh("info", name, "--json", cwd=where)
        assert told.returncode == 0, told.stderr
        assert json.loads(told.stdout)["faces"]["triangles"] == 1
    for uri, words in (("none.bin", "the file none.bin cannot be read"), ("../triangle.bin", "not in a file beside"),
                       ("/etc/hostname", "not in a file beside"), ("https://a.b/c.bin", "not in a file beside")):
        told = quadmesh("info", write_gltf(folder / "other.gltf", uri))
        assert told.returncode == 2 and words in told.stderr, told.stderr
    (folder / "short.bin").write_bytes(bytes(35))
    told = quadmesh("info", write_gltf(folder / "other.gltf", "short.bin"))
    assert told.returncode == 2 and "buffer view 0 reaches past its buffer" in told.stderr


def test_info_inflates_gzip_data(quadmesh, square, tmp_path):
    plain = json.loads(quadmesh("info", square, "--json").stdout)
    packed = gzip.compress(square.read_bytes())
    for name in ("packed.obj.gz", "packed"):
        (tmp_path / name).write_bytes(packed)
        done = json.loads(quadmesh("info", name, "--json").stdout)
        assert (done["format"], done["faces"], done["size_bytes"]) == ("obj", plain["faces"], len(packed))
    (tmp_path / "short.obj.gz").write_bytes(packed[:-1])
    done = quadmesh("info", "short.obj.gz")
    assert done.returncode != 0 and f"the gzip data ends early at byte {len(packed) - 1}" in done.stderr


def test_info_reads_standard_input(quadmesh, square):
    done = quadmesh("info", "-", input=square.read_text())
    assert done.returncode == 0
    assert "quads" in done.stdout


def test_an_empty_file_is_refused(quadmesh, tmp_path):
    (tmp_path / "empty.obj").touch()
    done = quadmesh("info", "empty.obj", "--json")
    assert (done.returncode, json.loads(done.stdout)["code"]) == (2, "empty_mesh")


@pytest.mark.parametrize("path", ["missing.obj", ".", "/dev/zero"])
def test_what_is_no_file_is_refused(quadmesh, path):
    done = quadmesh("info", path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "cannot be read" in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["measure"],
        ["hausdorff"],
        ["hausdorff", "a"],
        ["hausdorff", "a", "b", "c"],
        ["hausdorff", "a", "b", "--what"],
        ["hausdorff", "a", "b", "--direction", "up"],
        ["hausdorff", "a", "b", "--quads", "flat"],
        ["hausdorff", "a", "b", "--accelerator", "octree"],
        ["hausdorff", "a", "b", "--bounds", "loose"],
        ["hausdorff", "a", "b", "--tolerance", "0"],
        ["hausdorff", "a", "b", "--tolerance", "1e-6x"],
        ["hausdorff", "a", "b", "--tolerance", "nan"],
        ["hausdorff", "a", "b", "--threshold", "-1"],
        ["hausdorff", "a", "b", "--deadline-ms", "0"],
        ["hausdorff", "a", "b", "--memory", "1000"],
        ["hausdorff", "a", "b", "--threads", "0"],
        ["hausdorff", "a", "b", "--threads", "1.5"],
        ["hausdorff", "a", "b", "--threads", "257"],
        ["info"],
        ["info", "a", "b"],
        ["info", "a", "--what"],
    ],
)
def test_wrong_usage(quadmesh, arguments):
    done = quadmesh(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert "usage:" in done.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["hausdorff", "--help"], ["info", "--help"]])
def test_help_goes_to_standard_output(quadmesh, arguments):
    done = quadmesh(*arguments)
    assert (done.returncode, done.stderr) == (0, "")
    assert "usage:" in done.stdout


def test_version(quadmesh):
    done = quadmesh("--version")
    assert done.returncode == 0
    assert done.stdout.startswith("quadmesh ")


def test_a_full_disk_is_no_success(quadmesh, square):
    with open("/dev/full", "w") as full:
        done = quadmesh("info", square, "--json", capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert "could not be written" in done.stderr
