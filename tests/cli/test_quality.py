"""`quadmesh quality`: sums in words and as JSON, and a line for each face."""
import csv
import json

from conftest import write_torus


def test_sums_in_words_and_as_json(quadmesh, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 12, 8, 0.3)
    run = quadmesh("quality", torus)
    assert run.returncode == 0 and len(run.stdout.splitlines()) == 11 and "warpage" in run.stdout
    metrics = json.loads(quadmesh("quality", torus, "--json").stdout)["metrics"]
    assert len(metrics) == 10 and all(metric["faces"] == 96 for metric in metrics)
    one = json.loads(quadmesh("quality", torus, "--json", "--metric", "skew").stdout)
    assert one == metrics[2]


def test_a_line_for_each_face(quadmesh, tmp_path):
    mesh = tmp_path / "mesh.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nf 1 2 3 4\nf 2 5 3\n")
    run = quadmesh("quality", mesh, "--per-face", "out.csv")
    assert run.returncode == 0 and "scaled_jacobian" in run.stdout
    quad, triangle = csv.DictReader((tmp_path / "out.csv").open())
    assert quad["face"] == "0" and float(quad["scaled_jacobian"]) == 1 and float(quad["skew"]) == 0
    assert triangle["skew"] == "" and abs(float(triangle["minimum_angle"]) - 45) < 1e-9
    assert quadmesh("quality", mesh, "--metric", "taper", "--per-face", "-").stdout == "face,taper\n0,0\n1,\n"


def test_faults_are_told(quadmesh, tmp_path):
    assert quadmesh("quality").returncode == 2
    torus = write_torus(tmp_path / "torus.obj", 4, 4, 0.3)
    run = quadmesh("quality", torus, "--metric", "beauty")
    assert run.returncode == 2 and "scaled_jacobian" in run.stderr
    assert quadmesh("quality", "nowhere.obj").returncode == 2
    run = quadmesh("quality", torus, "--per-face", tmp_path / "no" / "out.csv")
    assert run.returncode == 2 and "cannot be written" in run.stderr
