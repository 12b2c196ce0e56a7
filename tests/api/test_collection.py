"""The folder of collected meshes, where it is there: awkward files, one shape in many formats."""
import csv

import pytest

from conftest import DATA, check_problem


def cases():
    """Rows of the list of awkward files."""
    with open(DATA / "nasty" / "CASES.tsv", encoding="utf-8") as lines:
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
            assert result["lower"] <= result["upper"] and result["lower"] <= result["gap"]
    else:
        assert expected in ("bad", "either"), reply.text
        problem = check_problem(reply, 422)
        assert problem["code"] == "empty_mesh" or problem.get("errors"), "the place of the fault is missing"


def test_one_shape_in_every_format(client):
    """Files of the same shape, in single and double precision, lie within single precision of one another."""
    wanted = client.upload((DATA / "formats/wingnut_be_double.ply").read_bytes())
    for path in sorted((DATA / "formats").iterdir()):
        if path.suffix == ".gltf" or "bad" in path.name or "truncated" in path.name or "points" in path.name:
            continue
        mesh = client.upload(path.read_bytes(), name=path.name)
        result = client.hausdorff(wanted["id"], mesh["id"], deadline_ms=20000)["result"]
        # Quantised Draco files move vertices by their step: 11 bits of the longest side.
        limit = 1e-3 if "_q1" in path.name else 1e-6
        assert result["upper_relative"] <= limit + 1e-6, (path.name, result)


def test_broken_files_of_known_formats(client):
    for name in ("wingnut_bad_magic.drc", "wingnut_truncated.drc"):
        content = (DATA / "formats" / name).read_bytes()
        check_problem(client.post("/v1/meshes", params={"name": name}, content=content), 422)
