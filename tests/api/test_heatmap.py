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


def read_ply(content):
    """Corners and faces of the heat map's PLY."""
    head, body = content.split(b"end_header\n", 1)
    count = int(next(line for line in head.split(b"\n") if line.startswith(b"element face")).split()[2])
    assert b"element vertex %d\n" % (3 * count) in head + b"\n" and len(body) == count * (3 * 32 + 25)
    return list(struct.iter_unpack("<4d", body[: 96 * count])), list(struct.iter_unpack("<B4Id", body[96 * count:]))


@pytest.mark.parametrize("error", [0.05, 0.0002])
def test_all_forms_have_the_same_triangles(client, error):
    """Records do not end where the blocks of the stored file do."""
    tent = b"v -9 -9 0\nv 1 -9 0\nv 1 9 0\nv -9 9 0\nv 0.3 0.2 1.7\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"
    a, b = client.upload(shapes.cube(3.0))["id"], client.upload(tent, format="obj")["id"]
    job = client.post("/v1/jobs", json={"type": "heatmap", "a": a, "b": b, "error": error, "pieces": 20000},
                      headers={"Prefer": WAIT}).json()
    count, path = job["result"]["count"], f"/v1/jobs/{job['id']}/result"
    assert count > 4500 or error > 0.01
    rows = client.get(path).json()["triangles"]
    assert len(rows) == count and {len(row) for row in rows} == {14}
    numbers = client.get(path, params={"format": "binary"}).content
    assert [list(row) for row in struct.iter_unpack("<14d", numbers)] == rows
    lines = client.get(path, params={"format": "csv"}).text.splitlines()
    assert [[float(x) for x in line.split(",")] for line in lines[1:]] == rows
    reply = client.get(path, params={"format": "ply"})
    assert reply.headers["Content-Type"] == "application/x-ply" == client.get(path, headers={"Accept": "application/x-ply"}).headers["Content-Type"]
    corners, faces = read_ply(reply.content)
    assert [x for corner in corners for x in corner] == [x for row in rows for x in row[:12]]
    assert faces == [(3, 3 * i, 3 * i + 1, 3 * i + 2, row[12], row[13]) for i, row in enumerate(rows)]
    assert client.upload(reply.content, format="ply")["faces"]["triangles"] == count


def test_only_heat_maps_are_ply(client):
    a = client.upload(shapes.cube())["id"]
    for request in ({"type": "deviation", "a": a, "b": a}, {"type": "hausdorff", "a": a, "b": a}):
        job = client.post("/v1/jobs", json=request, headers={"Prefer": WAIT}).json()
        path = f"/v1/jobs/{job['id']}/result"
        check_problem(client.get(path, params={"format": "ply"}), 406, "not_acceptable")
        check_problem(client.get(path, headers={"Accept": "application/x-ply"}), 406, "not_acceptable")
    check_problem(client.get(path, params={"format": "stl"}), 400, "invalid_parameter")
