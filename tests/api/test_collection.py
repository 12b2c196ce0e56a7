"""The folder of collected meshes, where it is there: awkward files, one shape in many formats, real pairs."""
import csv
import json
import subprocess

import pytest

from conftest import BUILD, DATA, check_problem


def cases():
    """Rows of the list of awkward files; none without the folder."""
    path = DATA / "nasty" / "CASES.tsv"
    if not path.is_file():
        return []
    with open(path, encoding="utf-8") as lines:
        return [(row["file"], row["expected"]) for row in csv.DictReader(lines, delimiter="\t")]


@pytest.mark.parametrize("name,expected", cases())
def test_awkward_files(client, name, expected):
    content = (DATA / "nasty" / name).read_bytes()
    reply = client.post("/v1/meshes", params={"name": name}, content=content)
    if reply.status_code in (200, 201):
        assert expected in ("ok", "either"), reply.text
        # What was taken in is good for an answer.
        mesh = reply.json()["id"]
        for reading in ("triangles", "bilinear"):
            result = client.hausdorff(mesh, mesh, quads=reading, deadline_ms=2000)["result"]
            assert result["lower"] <= result["upper"] and result["lower"] <= result["tolerance"]
    else:
        assert expected in ("bad", "either"), reply.text
        problem = check_problem(reply, 422)
        assert problem["code"] == "empty_mesh" or problem.get("errors"), "the place of the fault is missing"


def test_one_shape_in_every_format(client, data):
    """Files of the same shape, in single and double precision, lie within single precision of one another."""
    wanted = client.upload((data / "formats/wingnut_be_double.ply").read_bytes())
    for path in sorted((data / "formats").iterdir()):
        if path.suffix == ".gltf" or "bad" in path.name or "truncated" in path.name or "points" in path.name:
            continue
        mesh = client.upload(path.read_bytes(), name=path.name)
        result = client.hausdorff(wanted["id"], mesh["id"], deadline_ms=20000)["result"]
        # Quantised Draco files move vertices by their step: 11 bits of the longest side.
        limit = 1e-3 if "_q1" in path.name else 1e-6
        assert result["upper_relative"] <= limit + 1e-6, (path.name, result)


def test_broken_files_of_known_formats(client, data):
    for name in ("wingnut_bad_magic.drc", "wingnut_truncated.drc"):
        content = (data / "formats" / name).read_bytes()
        check_problem(client.post("/v1/meshes", params={"name": name}, content=content), 422)


def pairs():
    """Every model's triangles with each of its quad meshes."""
    found = []
    for folder in sorted((DATA / "pairs").glob("*")):
        # tri_original and tri_dense lie in another frame or on another surface than tri.
        triangles = [path for path in folder.glob("tri*") if path.stem in ("tri", "tri_cc3", "tri_400k")]
        found += [(a, b) for a in sorted(triangles) for b in sorted(folder.glob("quad*"))]
    return found


@pytest.mark.skipif(BUILD.name != "build", reason="the real pairs are for the release build")
@pytest.mark.parametrize("reading", ["triangles", "bilinear"])
@pytest.mark.parametrize("a,b", pairs(), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_real_pairs_converge(a, b, reading):
    done = subprocess.run([BUILD / "quadmesh", "hausdorff", a, b, "--quads", reading, "--json", "--threads", "2"],
                          capture_output=True, text=True, timeout=110)
    result = json.loads(done.stdout)
    assert done.returncode == 0, result
    assert result["converged"] is True and 0 <= result["lower"] <= result["upper"]
    assert result["upper"] - result["lower"] <= result["tolerance"] * (1 + 1e-9)
