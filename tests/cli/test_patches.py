"""`quadmesh patches`: counts, and the faces of each patch."""
import json

from conftest import write_torus


def test_counts_in_words_and_as_json(quadmesh, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 12, 8, 0.3)
    run = quadmesh("patches", torus)
    assert run.returncode == 0 and "1 patches of 96 quads" in run.stdout
    counts = json.loads(quadmesh("patches", torus, "--json").stdout)
    assert counts["patch_count"] == 1 and counts["irregular_vertices"] == 0
    assert sorted(counts["largest_patch"].values()) == [8, 12]


def test_faces_as_json_and_csv(quadmesh, tmp_path):
    torus = write_torus(tmp_path / "torus.obj", 12, 8, 0.3)
    assert quadmesh("patches", torus, "-o", "out.json").returncode == 0
    patch, = json.loads((tmp_path / "out.json").read_text())["patches"]
    assert sorted(patch["faces"]) == list(range(96))
    run = quadmesh("patches", torus, "-o", "out.csv")
    head, *lines = (tmp_path / "out.csv").read_text().splitlines()
    assert run.returncode == 0 and head == "face,patch,row,column"
    assert [int(line.split(",")[0]) for line in lines] == patch["faces"]
    assert quadmesh("patches", torus, "-o", "-").stdout == (tmp_path / "out.json").read_text()


def test_faults_are_told(quadmesh, tmp_path):
    assert quadmesh("patches").returncode == 2
    assert quadmesh("patches", "nowhere.obj").returncode == 2
    torus = write_torus(tmp_path / "torus.obj", 4, 4, 0.3)
    run = quadmesh("patches", torus, "-o", tmp_path / "no" / "out.csv")
    assert run.returncode == 2 and "cannot be written" in run.stderr
