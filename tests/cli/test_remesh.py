"""`quadmesh remesh`: a surface in, a mesh of quads out, and what it says when something is wrong."""
import json
import signal
import subprocess
import time

import pytest

from conftest import write_torus


def faces_of(path):
    return [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("f ")]


def test_quads_of_a_torus(quadmesh, tmp_path, where):
    torus = write_torus(tmp_path / "torus.obj", 40, 20, 0.3)
    run = quadmesh("remesh", torus, "-o", "out.obj", "--quads", "600", *where)
    assert run.returncode == 0 and "irregular vertices" in run.stdout
    faces = faces_of(tmp_path / "out.obj")
    assert all(len(face) == 4 for face in faces) and 400 < len(faces) < 900
    facts = json.loads(quadmesh("info", "out.obj", "--json").stdout)
    assert facts["euler_number"] == 0 and facts["watertight"] and facts["manifold"]


def test_the_result_as_json(quadmesh, tmp_path, where):
    torus = write_torus(tmp_path / "torus.obj", 40, 20, 0.3)
    result = json.loads(quadmesh("remesh", torus, "-o", "out.obj", "--quads", "600", "--json", *where).stdout)
    assert result["quads"] == len(faces_of(tmp_path / "out.obj"))
    assert result["components"] == 1 and result["folded"] == 0
    both = [result[way]["upper"] for way in ("from_surface", "from_quads")]
    assert max(both) == result["hausdorff"]["upper"]
    written = quadmesh("remesh", torus, "-o", "-", "--quads", "600", "--threads", "3", *where, text=False)
    assert written.stdout.startswith(b"ply\n") and str(result["quads"]).encode() in written.stderr
    assert quadmesh("remesh", torus, "-o", "-", "--json").returncode == 2  # one document


def test_here_and_there_make_the_same_mesh(quadmesh, server, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 40, 20, 0.3)
    for name in ("here.obj", "here.ply"):
        quadmesh("remesh", torus, "-o", name, "--quads", "300")
        run = quadmesh("remesh", torus, "-o", "there" + name[4:], "--quads", "300", "--server", server, "--progress")
        assert run.returncode == 0 and "quads: 300 quads\n" in run.stderr and "measure: " in run.stderr
        assert (tmp_path / name).read_bytes() == (tmp_path / ("there" + name[4:])).read_bytes()
    assert "measure: " in quadmesh("remesh", torus, "-o", "here.obj", "--quads", "300", "--progress").stderr


@pytest.mark.parametrize("name", ["out.obj", "out.ply", "out.glb"])
def test_texture_coordinates(quadmesh, tmp_path, where, name):
    torus = write_torus(tmp_path / "torus.obj", 80, 40, 0.3)
    run = quadmesh("remesh", torus, "-o", name, "--quads", "1000", "--semi-regular", "--uv", "--json", *where)
    assert run.returncode == 0, run.stderr
    result, facts = json.loads(run.stdout), json.loads(quadmesh("info", name, "--json").stdout)
    assert facts["faces"]["quads"] == result["quads"]
    assert facts["components"] == (1 if name == "out.obj" else result["patches"])
    content = (tmp_path / name).read_bytes()
    assert {"out.obj": b"\nvt ", "out.ply": b"\nproperty float t\n", "out.glb": b"TEXCOORD_0"}[name] in content


def test_texture_coordinates_go_with_some_formats(quadmesh, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 8, 8, 0.3)
    for command in (["remesh", torus], ["reconstruct", torus, "layout.json"]):
        run = quadmesh(*command, "-o", "out.off", "--uv")
        assert run.returncode == 2 and "not with off" in run.stderr and not (tmp_path / "out.off").exists()


def test_faults_of_a_daemon_are_told(quadmesh, server, tmp_path):
    points = tmp_path / "points.xyz"
    points.write_text("0 0 0\n1 0 0\n0 1 0\n")
    run = quadmesh("remesh", points, "-o", "out.obj", "--server", server)
    assert run.returncode == 2 and "too few for a surface" in run.stderr
    torus = write_torus(tmp_path / "torus.obj", 8, 8, 0.3)
    run = quadmesh("remesh", torus, "-o", "out.obj", "--server", "http://127.0.0.1:1")
    assert run.returncode == 2
    run = quadmesh("remesh", torus, "-o", "out.obj", "--quads", "1000001", "--server", server)
    assert run.returncode == 2 and "quads must be an integer from 1 to 1000000" in run.stderr


def test_points_become_quads(quadmesh, tmp_path, where):
    torus = write_torus(tmp_path / "torus.obj", 90, 40, 0.3)
    points = [line[2:] for line in torus.read_text().splitlines() if line.startswith("v ")]
    (tmp_path / "points.xyz").write_text("\n".join(points) + "\n")
    run = quadmesh("remesh", "points.xyz", "-o", "out.obj", "--quads", "900", "--json", *where)
    assert run.returncode == 0, run.stderr
    result = json.loads(run.stdout)
    assert 700 < result["quads"] < 1100 and result["folded"] == 0 and result["components"] == 1
    told = result["points"]
    assert told["used"] == 3600 and told["normals"] == "estimated" and told["outliers"] == told["holes_filled"] == told["borders"] == 0
    assert told["hausdorff"]["upper_relative"] < 0.01
    check_distance(quadmesh, "points.xyz", "out.obj", result, 0.03)
    run = quadmesh("remesh", "points.xyz", "-o", "out.obj", "--distance", "0.002", "--json", *where)
    result = json.loads(run.stdout)
    assert run.returncode == 0 and result["reached"] and result["points"]["hausdorff"]["upper_relative"] <= 0.002
    run = quadmesh("remesh", "points.xyz", "-o", "out.obj", "--quads", "900", *where)
    assert "of 3600 points" in run.stdout and "normals estimated" in run.stdout


def test_an_interrupt_ends_it(quadmesh, tmp_path, where):
    torus = write_torus(tmp_path / "torus.obj", 80, 40, 0.3)
    run = subprocess.Popen([quadmesh.program, "remesh", torus, "-o", tmp_path / "out.obj", "--quads", "300000", "--progress",
                            *where], stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    assert b"quads" in run.stderr.readline()
    time.sleep(0.3)
    run.send_signal(signal.SIGINT)
    assert run.wait(60) == 3
    run.communicate()


def test_faults_are_told(quadmesh, tmp_path):
    assert quadmesh("remesh").returncode == 2
    assert quadmesh("remesh", "nowhere.obj", "-o", "out.obj").returncode == 2
    points = tmp_path / "points.xyz"
    points.write_text("0 0 0\n1 0 0\n0 1 0\n")
    run = quadmesh("remesh", points, "-o", "out.obj")
    assert run.returncode == 2 and "too few for a surface" in run.stderr
    torus = write_torus(tmp_path / "torus.obj", 4, 4, 0.3)
    run = quadmesh("remesh", torus, "-o", tmp_path / "no" / "out.obj")
    assert run.returncode == 2 and "cannot be written" in run.stderr
    for angle in (181, 400):
        run = quadmesh("remesh", torus, "-o", "out.obj", "--crease-angle", angle)
        assert run.returncode == 2 and "0 to 180 degrees" in run.stderr


def check_distance(quadmesh, surface, mesh, result, most):
    """The bounds that were told hold what another command measures."""
    again = json.loads(quadmesh("hausdorff", surface, mesh, "--json").stdout)
    assert result["hausdorff"]["lower"] <= again["upper"] and again["lower"] <= result["hausdorff"]["upper"]
    assert result["hausdorff"]["upper_relative"] <= most


def test_a_distance_is_reached(quadmesh, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 80, 40, 0.3)
    coarse = json.loads(quadmesh("remesh", torus, "-o", "coarse.obj", "--quads", "300", "--json").stdout)
    check_distance(quadmesh, torus, "coarse.obj", coarse, 1)
    most = coarse["hausdorff"]["upper_relative"] / 4
    run = quadmesh("remesh", torus, "-o", "out.obj", "--quads", "300", "--distance", most, "--json")
    result = json.loads(run.stdout)
    assert run.returncode == 0 and result["rounds"] > 1 and result["quads"] > coarse["quads"]
    check_distance(quadmesh, torus, "out.obj", result, most)
    assert quadmesh("remesh", torus, "-o", "out.obj", "--distance", "-1").returncode == 2


def test_blocks_of_quads(quadmesh, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 80, 40, 0.3)
    run = quadmesh("remesh", torus, "-o", "out.obj", "--quads", "2000", "--semi-regular", "--json")
    assert run.returncode == 0, run.stderr
    result = json.loads(run.stdout)
    assert 1900 <= result["quads"] <= 2000 and result["patches"] >= 1 and result["folded"] == 0
    facts = json.loads(quadmesh("info", "out.obj", "--json").stdout)
    assert facts["euler_number"] == 0 and facts["watertight"] and facts["faces"]["quads"] == result["quads"]
    check_distance(quadmesh, torus, "out.obj", result, 0.02)
    out_of_reach = quadmesh("remesh", torus, "-o", "out.obj", "--quads", "500", "--semi-regular", "--distance", "1e-6")
    assert out_of_reach.returncode == 3 and "more than was wanted" in out_of_reach.stdout


def test_smaller_distances_take_more_quads(quadmesh, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 60, 30, 0.3)
    quads = 0
    for most in (0.05, 0.02, 0.012, 0.009, 0.007, 0.005, 0.004, 0.003, 0.0021, 0.0014):
        run = quadmesh("remesh", torus, "-o", "out.obj", "--quads", "50", "--distance", most, "--json")
        result = json.loads(run.stdout)
        assert run.returncode == 0 and result["reached"] and result["hausdorff"]["upper_relative"] <= most
        assert result["quads"] >= quads
        quads = result["quads"]
