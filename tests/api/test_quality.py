"""The shape of faces by the metrics of Verdict, against the formulas of its report."""
import math
import random
import struct

import pytest

import shapes
from conftest import check_problem

SEED = 7
METRICS = ("scaled_jacobian", "aspect_ratio", "skew", "taper", "warpage", "edge_ratio", "shape", "stretch",
           "minimum_angle", "maximum_angle")
PERCENTS = [1, 5, 25, 50, 75, 95, 99]


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def plus(a, b):
    return [x + y for x, y in zip(a, b)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def length(a):
    return math.hypot(*a)


def unit(a):
    return [x / length(a) for x in a]


def degrees(a, b):
    return math.degrees(math.acos(max(-1.0, min(1.0, dot(unit(a), unit(b))))))


def of_triangle(p):
    edges = [minus(p[(i + 1) % 3], p[i]) for i in range(3)]
    long = [length(edge) for edge in edges]
    area = length(cross(edges[0], edges[1])) / 2
    radius = 2 * area / sum(long)
    angles = [degrees(minus(p[(i + 1) % 3], p[i]), minus(p[i - 1], p[i])) for i in range(3)]
    condition = (dot(edges[0], edges[0]) + dot(edges[2], edges[2]) + dot(edges[0], edges[2])) / (2 * area * math.sqrt(3))
    products = [long[0] * long[1], long[1] * long[2], long[2] * long[0]]
    return {"scaled_jacobian": 2 * area * 2 / math.sqrt(3) / max(products),
            "aspect_ratio": max(long) / (2 * math.sqrt(3) * radius), "edge_ratio": max(long) / min(long),
            "shape": 1 / condition, "minimum_angle": min(angles), "maximum_angle": max(angles)}


def of_quad(p):
    edges = [minus(p[(i + 1) % 4], p[i]) for i in range(4)]
    long = [length(edge) for edge in edges]
    first, second = plus(minus(p[1], p[0]), minus(p[2], p[3])), plus(minus(p[2], p[1]), minus(p[3], p[0]))
    middle = unit(cross(first, second))
    normals = [cross(edges[i - 1], edges[i]) for i in range(4)]
    areas = [dot(middle, normal) for normal in normals]
    angles = [degrees(edges[i], [-x for x in edges[i - 1]]) for i in range(4)]
    planar = min(dot(unit(normals[0]), unit(normals[2])), dot(unit(normals[1]), unit(normals[3])))
    across = plus(minus(p[0], p[1]), minus(p[2], p[3]))
    return {"scaled_jacobian": min(areas[i] / (long[i - 1] * long[i]) for i in range(4)),
            "aspect_ratio": max(long) * sum(long) / (2 * (length(normals[1]) + length(normals[3]))),
            "skew": abs(dot(unit(first), unit(second))), "taper": length(across) / min(length(first), length(second)),
            "warpage": 1 - planar ** 3, "edge_ratio": max(long) / min(long),
            "shape": max(0, 2 * min(areas[i] / (long[i - 1] ** 2 + long[i] ** 2) for i in range(4))),
            "stretch": math.sqrt(2) * min(long) / max(length(minus(p[2], p[0])), length(minus(p[3], p[1]))),
            "minimum_angle": min(angles), "maximum_angle": 360 - max(angles) if min(areas) < 0 else max(angles)}


def soup(chance, count):
    """Faces apart: quads and triangles, some of them nearly squares."""
    vertices, faces = [], []
    for _ in range(count):
        size = chance.choice((3, 4))
        noise = chance.choice((0.05, 0.4, 1.5))
        square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        faces.append(tuple(range(len(vertices), len(vertices) + size)))
        vertices += [tuple(5 + x + noise * chance.uniform(-1, 1) for x in corner) for corner in square[:size]]
    return vertices, faces


def quality(client, mesh, **query):
    reply = client.get(f"/v1/meshes/{mesh}/quality", params=query)
    assert reply.status_code == 200, reply.text
    return reply.json()


@pytest.fixture(scope="module")
def faces():
    return soup(random.Random(SEED), 400)


@pytest.mark.parametrize("metric", METRICS)
def test_values_are_those_of_the_formulas(client, faces, metric):
    mesh = client.upload(shapes.obj(faces), format="obj")["id"]
    found = quality(client, mesh, metric=metric)
    expected = [(of_quad if len(face) == 4 else of_triangle)([faces[0][i] for i in face]).get(metric)
                for face in faces[1]]
    assert len(found["values"]) == len(expected)
    for value, truth in zip(found["values"], expected):
        if truth is None:
            assert value is None
        else:
            assert value == pytest.approx(truth, rel=1e-9, abs=1e-7), (SEED, metric)
    known = [value for value in found["values"] if value is not None]
    assert found["faces"] == len(known) and found["undefined"] == 0
    assert found["minimum"] == min(known) == found["values"][found["minimum_face"]]
    assert found["maximum"] == max(known) == found["values"][found["maximum_face"]]
    assert found["mean"] == pytest.approx(sum(known) / len(known), rel=1e-12)
    assert [entry["percent"] for entry in found["percentiles"]] == PERCENTS
    for entry in found["percentiles"]:
        assert entry["value"] == sorted(known)[math.ceil(entry["percent"] / 100 * len(known)) - 1]


def test_all_forms_tell_the_same(client, faces):
    mesh = client.upload(shapes.obj(faces), format="obj")["id"]
    summaries = quality(client, mesh)["metrics"]
    assert tuple(summary["metric"] for summary in summaries) == METRICS
    for summary in summaries:
        path = f"/v1/meshes/{mesh}/quality?metric={summary['metric']}"
        whole = client.get(path).json()
        values = whole.pop("values")
        assert whole == summary
        binary = client.get(path, headers={"Accept": "application/octet-stream"})
        assert binary.headers["content-length"] == str(8 * len(values))
        numbers = struct.unpack(f"<{len(values)}d", binary.content)
        assert [None if math.isnan(number) else number for number in numbers] == values
        head, *lines = client.get(path, headers={"Accept": "text/csv"}).text.splitlines()
        assert head == f"face,{summary['metric']}"
        assert [line.split(",")[0] for line in lines] == [str(i) for i in range(len(values))]
        assert [None if line.endswith(",null") else float(line.split(",")[1]) for line in lines] == values


def test_faces_of_the_file_are_counted(client):
    """A polygon has a row, and no value; a quad without an edge has none of some metrics."""
    mesh = ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (3, 1, 0), (2, 2, 0)],
            [(1, 4, 5, 6, 2), (0, 1, 2, 3), (0, 1, 1, 3)])
    mesh = client.upload(shapes.obj(mesh), format="obj")["id"]
    assert quality(client, mesh, metric="aspect_ratio")["values"][:2] == [None, 1]
    found = quality(client, mesh, metric="edge_ratio")
    assert found["values"] == [None, 1, None] and found["faces"] == 1 and found["undefined"] == 1
    assert quality(client, mesh, metric="scaled_jacobian")["values"] == [None, 1, 0]


def test_points_have_no_faces(client):
    mesh = client.upload(b"0 0 0\n1 0 0\n", format="xyz")["id"]
    assert all(summary["faces"] == 0 and summary["minimum"] is None for summary in quality(client, mesh)["metrics"])
    assert quality(client, mesh, metric="skew")["values"] == []


def test_a_tag_spares_the_reply_and_faults_are_told(client):
    mesh = client.upload(shapes.cube(), name="quality")["id"]
    path = f"/v1/meshes/{mesh}/quality"
    tag = client.get(path).headers["etag"]
    assert client.get(path, headers={"If-None-Match": tag}).status_code == 304
    assert client.get(path + "?metric=skew", headers={"If-None-Match": tag}).status_code == 200
    check_problem(client.get(path + "?metric=beauty"), 400, "invalid_parameter")
    check_problem(client.get(path, headers={"Accept": "text/csv"}), 400, "invalid_parameter")
    check_problem(client.get("/v1/meshes/m_none/quality"), 404, "mesh_not_found")
