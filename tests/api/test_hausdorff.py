"""The distances that the daemon proves, on shapes whose distances are known."""
import datetime
import math

import pytest

import shapes
from conftest import SLOW, SLOW_DISTANCE, check_problem

DIRECTIONS = ["two_sided", "a_to_b", "b_to_a"]
READINGS = ["triangles", "bilinear"]


def length(a, b):
    return math.dist(a, b)


def check_result(result, diagonal, tolerance):
    """What holds for every result that converged."""
    lower, upper = result["lower"], result["upper"]
    assert 0 <= lower <= upper
    assert upper - lower <= tolerance * (1 + 1e-9)
    assert result["converged"] is True
    # Relative figures are rounded away from the inside of the bracket.
    assert lower / diagonal * (1 - 1e-15) <= result["lower_relative"] + 1e-300
    assert result["lower_relative"] <= lower / diagonal <= result["upper_relative"] * (1 + 1e-15)
    assert result["upper_relative"] >= upper / diagonal
    witness = result["witness"]
    distance = length(witness["from"]["point"], witness["to"]["point"])
    assert distance == pytest.approx(lower, rel=1e-6, abs=1e-12 * diagonal)
    assert {witness["from"]["mesh"], witness["to"]["mesh"]} == {"a", "b"}
    for counter in ("iterations", "projections", "max_queue", "elapsed_ms"):
        assert result[counter] >= 0
    assert result["prepare_ms"]["a"] >= 0 and result["prepare_ms"]["b"] >= 0


def point_of(mesh, face, uv, reading):
    """The point of a quad or triangle at its parameters."""
    corners = [mesh[0][i] for i in mesh[1][face]]
    u, v = uv
    if len(corners) == 3:
        weights = (1 - u - v, u, v)
    elif reading == "bilinear":
        weights = ((1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v)
    elif u >= v:
        weights = (1 - u, u - v, v, 0)
    else:
        weights = (1 - v, 0, u, v - u)
    return [sum(w * c[axis] for w, c in zip(weights, corners)) for axis in range(3)]


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("reading", READINGS)
def test_turned_spheres(client, spheres, direction, reading):
    job = client.hausdorff(*spheres, direction=direction, quads=reading, tolerance=1e-8)
    assert job["state"] == "succeeded"
    result = job["result"]
    diagonal = client.get(f"/v1/meshes/{spheres[0]}").json()["bounding_box"]["diagonal"]
    assert result["lower"] <= shapes.SPHERE_DISTANCE <= result["upper"]
    assert result["lower_relative"] == pytest.approx(0.0001425, rel=1e-3)
    check_result(result, diagonal, 1e-8 * diagonal)
    assert (result["direction"], result["quads"]) == (direction, reading)
    wanted_side = {"a_to_b": "a", "b_to_a": "b"}.get(direction)
    assert wanted_side in (None, result["witness"]["from"]["mesh"])


@pytest.mark.parametrize("reading", READINGS)
def test_the_witness_lies_on_its_face(client, spheres, reading):
    meshes = {"a": shapes.sphere(), "b": shapes.sphere(shapes.SPHERE_TURN)}
    ids = dict(zip("ab", spheres))
    witness = client.hausdorff(*spheres, quads=reading)["result"]["witness"]
    for end in (witness["from"], witness["to"]):
        assert end["id"] == ids[end["mesh"]]
        expected = point_of(meshes[end["mesh"]], end["face"], end["uv"], reading)
        assert end["point"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_surface_against_itself(client, spheres, direction, reading):
    job = client.hausdorff(spheres[0], spheres[0], direction=direction, quads=reading)
    assert job["result"]["lower"] <= 1e-15
    assert job["result"]["upper"] <= job["result"]["gap"]
    assert job["result"]["converged"]


def test_the_same_surface_cut_differently(client):
    quads = client.upload(shapes.cube())["id"]
    cut = client.upload(shapes.triangles(shapes.cube()))["id"]
    for reading in READINGS:
        result = client.hausdorff(quads, cut, quads=reading)["result"]
        assert result["lower"] == 0 and result["upper"] <= result["gap"]


@pytest.mark.parametrize("steps", [(1, 4), (4, 1), (3, 7)])
def test_saddles_are_one_bilinear_surface(client, steps):
    a, b = (client.upload(shapes.saddle(n))["id"] for n in steps)
    curved = client.hausdorff(a, b, quads="bilinear")["result"]
    assert curved["lower"] <= 1e-12 and curved["upper"] <= curved["gap"]
    flat = client.hausdorff(a, b, quads="triangles")["result"]
    assert flat["lower"] > 1e-3


@pytest.mark.parametrize("reading", READINGS)
def test_one_direction_may_be_shorter(client, reading):
    big, small = client.upload(shapes.cube(3.0))["id"], client.upload(shapes.cube(1.0))["id"]
    # The cubes share a corner; the opposite corner of the small one lies inside the big one, 1 from its faces.
    exact = {"a_to_b": math.sqrt(12), "b_to_a": 1.0, "two_sided": math.sqrt(12)}
    for direction, distance in exact.items():
        result = client.hausdorff(big, small, direction=direction, quads=reading)["result"]
        assert result["lower"] <= distance * (1 + 1e-15) and distance <= result["upper"] * (1 + 1e-15)


@pytest.mark.parametrize("reading", READINGS)
def test_mixed_kinds(client, reading):
    quads = client.upload(shapes.moved(shapes.cube(), 0, 0, 0.5))["id"]
    cut = client.upload(shapes.triangles(shapes.cube()))["id"]
    result = client.hausdorff(quads, cut, quads=reading)["result"]
    assert result["lower"] <= 0.5 <= result["upper"]


def test_points_against_a_surface(client):
    points = client.upload(b"0 0 0\n0.5 0.5 3\n", format="xyz")["id"]
    surface = client.upload(shapes.cube())["id"]
    result = client.hausdorff(points, surface, direction="a_to_b")["result"]
    assert result["lower"] <= 2.0 <= result["upper"]
    assert result["witness"]["from"]["point"] == [0.5, 0.5, 3]


def test_two_points(client):
    a = client.upload(b"1 2 3\n", format="xyz")["id"]
    b = client.upload(b"1 2 7\n", format="xyz")["id"]
    result = client.hausdorff(a, b)["result"]
    assert result["lower"] <= 4.0 <= result["upper"]
    # A point has no diagonal to measure by.
    assert result["lower_relative"] is None and result["upper_relative"] is None


def test_absolute_tolerance(client, spheres):
    result = client.hausdorff(*spheres, tolerance=1e-3, tolerance_unit="absolute", direction="a_to_b")["result"]
    assert result["gap"] == 1e-3
    assert result["upper"] - result["lower"] <= 1e-3


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("threshold,verdict", [(4e-4, "above"), (6e-4, "below")])
def test_threshold(client, spheres, reading, threshold, verdict):
    job = client.hausdorff(*spheres, quads=reading, threshold=threshold, tolerance=1e-10)
    result = job["result"]
    assert result["verdict"] == verdict
    assert (result["lower"] > threshold) if verdict == "above" else (result["upper"] <= threshold)
    assert result["lower"] <= shapes.SPHERE_DISTANCE <= result["upper"]


def test_without_threshold_there_is_no_verdict(client, spheres):
    assert client.hausdorff(*spheres, threshold=None)["result"]["verdict"] is None


def test_deadline(client, slow_pair):
    job = client.hausdorff(*slow_pair, deadline_ms=300, **SLOW)
    result = job["result"]
    assert job["state"] == "succeeded"
    assert result["converged"] is False and result["stopped_by"] == "deadline"
    assert result["lower"] <= SLOW_DISTANCE <= result["upper"]
    # The deadline counts from the submission on; times of a document are rounded to milliseconds.
    created, ended = (datetime.datetime.fromisoformat(job[name].replace("Z", "+00:00")) for name in ("created", "ended"))
    assert ended - created >= datetime.timedelta(milliseconds=299)


def test_a_queue_out_of_memory_leaves_the_bounds(client, slow_pair):
    result = client.hausdorff(*slow_pair, memory_limit=65536, **SLOW)["result"]
    assert result["converged"] is False and result["stopped_by"] == "memory"
    assert result["lower"] <= SLOW_DISTANCE <= result["upper"]


@pytest.mark.parametrize("reading", READINGS)
def test_threads_do_not_change_what_holds(client, spheres, reading):
    for threads in (1, 2, 7):
        result = client.hausdorff(*spheres, quads=reading, threads=threads, tolerance=1e-7)["result"]
        assert result["lower"] <= shapes.SPHERE_DISTANCE <= result["upper"]
        assert result["converged"]


def test_scales(client):
    for scale in (1e-30, 1e-6, 1e6, 1e30):
        a, b = (client.upload(shapes.triangles(shapes.cube(scale, (offset * scale, 0, 0))))["id"] for offset in (0, 0.25))
        result = client.hausdorff(a, b)["result"]
        assert result["lower"] <= 0.25 * scale * (1 + 1e-12) and 0.25 * scale * (1 - 1e-12) <= result["upper"]
        assert result["converged"]


@pytest.mark.parametrize("accelerator", ["auto", "boxes", "grid"])
@pytest.mark.parametrize("bounds", ["cover", "matching", "cells"])
def test_each_choice_gives_the_distance(client, spheres, accelerator, bounds):
    job = client.hausdorff(*spheres, accelerator=accelerator, bounds=bounds, tolerance=1e-6)
    result = job["result"]
    engine = job["request"].get("engine", {})
    assert engine.get("bounds", "cover") == ("matching" if bounds == "matching" else "cover")
    assert engine.get("accelerator", "auto") == accelerator
    same = client.hausdorff(*spheres, engine={"accelerator": accelerator, "bounds": bounds}, gap=1e-6)
    assert same["cached"] and same["request"] == job["request"]
    assert result["converged"]
    assert result["lower"] <= shapes.SPHERE_DISTANCE <= result["upper"]


INVALID = [
    ({"type": "volume"}, "/type"), ({"a": 7}, "/a"), ({"a": ""}, "/a"), ({"b": None}, "/b"),
    ({"direction": "sideways"}, "/direction"), ({"quads": "cubic"}, "/quads"),
    ({"tolerance": 0}, "/tolerance"), ({"tolerance": -1e-6}, "/tolerance"), ({"tolerance": "1e-6"}, "/tolerance"),
    ({"tolerance": None}, "/tolerance"), ({"tolerance_unit": "percent"}, "/tolerance_unit"),
    ({"threshold": -1}, "/threshold"), ({"deadline_ms": 0}, "/deadline_ms"), ({"memory_limit": 65535}, "/memory_limit"), ({"threads": 0}, "/threads"),
    ({"threads": 1.5}, "/threads"), ({"threads": 10**9}, "/threads"), ({"detach": 1}, "/detach"),
    ({"colour": "red"}, "/colour"), ({"a/b": 1}, "/a~1b"),
]


@pytest.mark.parametrize("change,pointer", INVALID)
def test_invalid_fields_are_named(client, spheres, change, pointer):
    request = {"type": "hausdorff", "a": spheres[0], "b": spheres[1], **change}
    problem = check_problem(client.post("/v1/jobs", json=request), 400, "invalid_field")
    assert [error["pointer"] for error in problem["errors"]] == [pointer]


@pytest.mark.parametrize("tolerance", ["1e999", "-1e999"])
def test_numbers_beyond_doubles(client, spheres, tolerance):
    text = f'{{"type":"hausdorff","a":"{spheres[0]}","b":"{spheres[1]}","tolerance":{tolerance}}}'
    problem = check_problem(client.post("/v1/jobs", content=text), 400)
    assert problem["errors"][0]["pointer"] == "/tolerance"


def test_missing_fields_are_all_named(client):
    problem = check_problem(client.post("/v1/jobs", json={}), 400)
    assert {error["pointer"] for error in problem["errors"]} == {"/type", "/a", "/b"}


MALFORMED = [b"", b"{", b"[]", b"7", b'{"type": NaN}', b'{"type":"hausdorff"} x', b"\xff\xfe", b'{"a":' * 2000,
             b"[" * 100000, b'{"tolerance": Infinity}', b"\0", b'{"type":"hausdorff","type":"hausdorff"}']


@pytest.mark.parametrize("text", MALFORMED, ids=range(len(MALFORMED)))
def test_malformed_json(client, text):
    check_problem(client.post("/v1/jobs", content=text), 400)


def test_unknown_meshes(client, spheres):
    request = {"type": "hausdorff", "a": spheres[0], "b": "m_none"}
    problem = check_problem(client.post("/v1/jobs", json=request), 404, "mesh_not_found")
    assert problem["errors"][0]["pointer"] == "/b"
