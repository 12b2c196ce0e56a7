"""Heat maps: triangles with distances that are right to a stated error."""
import struct

import pytest

import shapes
from conftest import WAIT, check_problem


def test_triangles_in_every_form(client):
    a = client.upload(shapes.cube(0.5, (0.25, 0.25, 0.25)))["id"]
    b = client.upload(shapes.cube())["id"]
    job = client.post("/v1/jobs", json={"type": "heatmap", "a": a, "b": b, "error": 0.01}, headers={"Prefer": WAIT}).json()
    assert job["state"] == "succeeded" and job["request"]["error"] == 0.01
    result = job["result"]
    assert result["accurate"] is True and result["error"] <= 0.01 and "triangles" not in result
    path = f"/v1/jobs/{job['id']}/result"
    rows = client.get(path, headers={"Accept": "application/json"}).json()["triangles"]
    assert len(rows) == result["count"] and {len(row) for row in rows} == {14}
    assert max(row[13] for row in rows) == result["error"] and [row[12] for row in rows] == sorted(row[12] for row in rows)
    for row in rows:  # all of the small cube is a quarter away
        assert all(abs(row[4 * k + 3] - 0.25) <= row[13] + 1e-12 for k in range(3))
    numbers = client.get(path, headers={"Accept": "application/octet-stream"}).content
    assert [list(row) for row in struct.iter_unpack("<14d", numbers)] == rows
    text = client.get(path, headers={"Accept": "text/csv"}).text.splitlines()
    assert text[0].split(",")[12:] == ["face", "error"] and len(text) == len(rows) + 1


@pytest.mark.parametrize("field, value", [("error", 0), ("error", "1"), ("pieces", -1), ("accuracy", 0.1)])
def test_bad_fields_are_pointed_at(client, field, value):
    a = client.upload(shapes.cube())["id"]
    problem = check_problem(client.post("/v1/jobs", json={"type": "heatmap", "a": a, "b": a, field: value}), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == f"/{field}"


def test_points_have_no_map(client):
    a = client.upload(b"0 0 1\n0 1 2\n", format="xyz")["id"]
    job = client.post("/v1/jobs", json={"type": "heatmap", "a": a, "b": client.upload(shapes.cube())["id"]},
                      headers={"Prefer": WAIT}).json()
    assert job["problem"]["code"] == "unsupported_feature"
