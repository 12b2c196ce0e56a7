"""Two meshes compared both ways: known values, exact ones, what is refused, and the names of the version before."""
import json
import math
import random
import time

import pytest

from conftest import WAIT, check_problem

FLOOR = ([(-5, -5, 0), (6, -5, 0), (6, 6, 0), (-5, 6, 0)], [(0, 1, 2, 3)])
RAMP = ([(0, 0, 1), (1, 0, 2), (1, 1, 2), (0, 1, 1)], [(0, 1, 2, 3)])


def ask(client, a, b, status=200, **fields):
    reply = client.post("/v1/jobs", json={"type": "comparison", "a": a, "b": b, **fields}, headers={"Prefer": WAIT})
    if status != 200:
        return check_problem(reply, status)
    assert reply.status_code == 200, reply.text
    return reply.json()


def holds(interval, value, width):
    return interval["lower"] <= value <= interval["upper"] <= interval["lower"] + width


@pytest.fixture(scope="module")
def pair(daemon):
    with daemon.client() as made:
        return made.upload(RAMP, name="ramp")["id"], made.upload(FLOOR, name="floor")["id"]


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
def test_a_ramp_over_a_floor(client, pair, quads):
    job = ask(client, *pair, quads=quads, limits=[1.25, 0, 3], percentiles=[25], worst={"count": 3, "radius": 0.5})
    assert job["state"] == "succeeded" and job["type"] == "comparison"
    request = job["request"]
    assert request["limits"] == [1.25, 0, 3] and request["worst"] == {"count": 3, "radius": 0.5}
    result = job["result"]
    up, down, both = result["a_to_b"], result["b_to_a"], result["symmetric"]
    assert holds(up["hausdorff"], 2, 1e-5) and holds(up["mean"], 1.5, 1e-5)
    assert holds(up["rms"], math.sqrt(7 / 3), 1e-5) and holds(up["std"], math.sqrt(1 / 12), 1e-3)
    assert holds(up["percentiles"][0], 1.25, 1e-4) and len(up["percentiles"]) == 1
    assert [share["limit"] for share in up["shares"]] == [1.25, 0, 3]
    assert holds(up["shares"][0], 0.25, 1e-4)
    assert up["shares"][1] == {"limit": 0, "lower": 0, "upper": 0}
    assert up["shares"][2] == {"limit": 3, "lower": 1, "upper": 1}
    assert up["witness"]["from"]["mesh"] == "a" and down["witness"]["from"]["mesh"] == "b"
    far = math.sqrt(54)  # from (6, 6, 0) to (1, 1, 2)
    assert holds(down["hausdorff"], far, 1e-4)
    places = down["worst"]
    assert len(places) == 3 and places[0]["from"] == down["witness"]["from"]
    for i, place in enumerate(places):
        assert place["lower"] <= place["upper"] <= far + 1e-4
        point = place["from"]["point"]
        assert all(math.dist(point, other["from"]["point"]) > 0.5 - 1e-9 for other in places[:i])
    assert both["hausdorff"]["lower"] == down["hausdorff"]["lower"]
    assert both["hd95"]["lower"] > 5
    l1 = up["mean"]["lower"] + down["mean"]["lower"], up["mean"]["upper"] + down["mean"]["upper"]
    chamfer = both["chamfer"]
    assert chamfer["l1"]["lower"] <= l1[0] and chamfer["l1"]["upper"] >= l1[1]
    assert chamfer["l1_half"]["upper"] == chamfer["l1"]["upper"] / 2
    assert chamfer["l2_half"]["lower"] == chamfer["l2"]["lower"] / 2
    assert both["mean"]["lower"] > 2  # the floor is 85 times as large
    score = both["f_score"][0]
    assert score["limit"] == 1.25 and {k: score["precision"][k] for k in ("lower", "upper")} == {
        k: up["shares"][0][k] for k in ("lower", "upper")}
    assert 0 <= score["f"]["lower"] <= score["f"]["upper"] <= 0.5


def test_a_mesh_against_itself(client, spheres, pair):
    points = client.upload(b"0 0 1\n0 1 2\n1 0 6\n", format="xyz")["id"]
    for mesh in (spheres[0], pair[0], points):
        for quads in ("triangles", "bilinear"):
            result = ask(client, mesh, mesh, quads=quads, limits=[0, 1])["result"]
            both = result["symmetric"]
            for name in ("hausdorff", "hd95", "mean", "rms"):
                assert both[name]["lower"] == both[name]["upper"] == 0
            for name in ("l1", "l1_half", "l2", "l2_half"):
                assert both["chamfer"][name] == {"lower": 0, "upper": 0}
            for score in both["f_score"]:
                assert score["f"] == score["precision"] == score["recall"] == {"lower": 1, "upper": 1}
            assert result["a_to_b"]["std"]["upper"] == 0


def test_both_ways_are_one_answer(client, spheres):
    limits = [1e-4, 3e-4]
    there = ask(client, *spheres, limits=limits)["result"]
    back = ask(client, *reversed(spheres), limits=limits)["result"]
    assert there["a_to_b"]["shares"] == back["b_to_a"]["shares"]
    for name in ("mean", "std"):
        assert [there["a_to_b"][name][end] == back["b_to_a"][name][end] for end in ("lower", "upper")] == [True, True]
    assert there["symmetric"]["chamfer"] == back["symmetric"]["chamfer"]
    # A deviation says the same of one direction.
    deviation = client.post("/v1/jobs", json={"type": "deviation", "a": spheres[0], "b": spheres[1]},
                            headers={"Prefer": WAIT}).json()["result"]
    assert there["a_to_b"]["mean"] == deviation["mean"] and there["a_to_b"]["hausdorff"] == deviation["max"]


def test_defaults(client, pair):
    job = ask(client, *pair)
    assert job["request"]["limits"] == [] and "worst" not in job["request"]
    result = job["result"]
    assert result["a_to_b"]["shares"] == [] and "worst" not in result["a_to_b"]
    assert [row["percent"] for row in result["a_to_b"]["percentiles"]] == [1, 5, 25, 50, 75, 90, 95, 99]
    job = ask(client, *pair, worst={"count": 2})
    assert job["request"]["worst"] == {"count": 2} and len(job["result"]["b_to_a"]["worst"]) == 2
    assert ask(client, *pair, worst=None)["request"] == ask(client, *pair)["request"]


@pytest.mark.parametrize("fields, pointer", [
    ({"limits": [-1]}, "/limits/0"),
    ({"limits": [1, "2"]}, "/limits/1"),
    ({"limits": 1}, "/limits"),
    ({"limits": [1] * 65}, "/limits"),
    ({"worst": {"count": 0}}, "/worst"),
    ({"worst": {"radius": 1}}, "/worst"),
    ({"worst": {"count": 1, "radius": -1}}, "/worst"),
    ({"worst": {"count": 1, "more": 1}}, "/worst"),
    ({"worst": 3}, "/worst"),
    ({"bins": 3}, "/bins"),
    ({"percentiles": [0]}, "/percentiles/0"),
    ({"gap": 0}, "/gap"),
    ({"gap": 1e-3, "tolerance": 1e-3}, "/tolerance"),
    ({"gap_unit": "absolute", "tolerance_unit": "absolute"}, "/tolerance_unit"),
    ({"threshold": 1}, "/threshold"),
])
def test_faults_name_their_place(client, pair, fields, pointer):
    problem = ask(client, *pair, status=400, **fields)
    assert [error["pointer"] for error in problem["errors"]] == [pointer]


def test_members_of_worst_are_given_once(client, pair):
    body = f'{{"type": "comparison", "a": "{pair[0]}", "b": "{pair[1]}", "worst": {{"count": 1, "count": 2}}}}'
    reply = client.post("/v1/jobs", content=body.encode(), headers={"Content-Type": "application/json"})
    assert reply.status_code == 400 and reply.json()["errors"][0]["pointer"] == "/worst"


def test_names_of_the_version_before(client, pair):
    def distance(**fields):
        reply = client.post("/v1/jobs", json={"type": "hausdorff", "a": pair[0], "b": pair[1], **fields},
                            headers={"Prefer": WAIT})
        assert reply.status_code == 200, reply.text
        return reply.json()

    new = distance(limit=1, gap=1e-4, gap_unit="absolute")
    old = distance(threshold=1, tolerance=1e-4, tolerance_unit="absolute")
    assert new["request"] == old["request"] and new["result"]["verdict"] == old["result"]["verdict"] == "above"
    assert old["cached"] is True
    reply = client.post("/v1/jobs", json={"type": "hausdorff", "a": pair[0], "b": pair[1], "limit": 1, "threshold": 1})
    assert check_problem(reply, 400)["errors"] == [{"pointer": "/threshold", "detail": "is given more than once"}]


def test_shifted_and_scaled_squares(client):
    """A square above another one: every distance is the height, at any size."""
    seed = 20
    chance = random.Random(seed)
    for draw in range(12):
        size, height = 2.0 ** chance.randint(-60, 60), chance.randint(1, 7) / 4
        square = [(0, 0), (size, 0), (size, size), (0, size)]
        a = client.upload(([(*p, 0) for p in square], [(0, 1, 2, 3)]))["id"]
        b = client.upload(([(*p, height * size) for p in square], [(0, 1, 2, 3)]))["id"]
        limits = [0.99 * height * size, 1.01 * height * size]
        result = ask(client, a, b, limits=limits, quads=chance.choice(["triangles", "bilinear"]))["result"]
        both, note = result["symmetric"], f"seed {seed}, draw {draw}"
        assert holds(both["mean"], height * size, 1e-5 * size), note
        assert holds(both["chamfer"]["l1"], 2 * height * size, 1e-5 * size), note
        assert holds(both["chamfer"]["l2"], 2 * (height * size) ** 2, 1e-4 * size ** 2), note
        assert [score["f"] for score in both["f_score"]] == [{"lower": 0, "upper": 0}, {"lower": 1, "upper": 1}], note


def holds_for_one(one, other):
    return one["lower"] <= (other["upper"] or math.inf) and other["lower"] <= (one["upper"] or math.inf)


def test_a_canceled_job_keeps_its_intervals(client, slow_pair):
    """However early it is canceled: at first they are those of the boxes, and later those of one direction."""
    whole = None
    for wait in (0, 0.1, 0.5, 2):
        job = client.post("/v1/jobs", json={"type": "comparison", "a": slow_pair[0], "b": slow_pair[1], "accuracy": 1e-9,
                                            "pieces": 10000000, "limits": [0.001, 1], "quads": "bilinear",
                                            "worst": {"count": 3}}).json()
        while client.get(f"/v1/jobs/{job['id']}").json()["state"] == "queued":
            time.sleep(0.005)
        time.sleep(wait)
        assert client.delete(f"/v1/jobs/{job['id']}").status_code == 202
        job = client.wait(job["id"])
        assert job["state"] == "canceled", job
        both = job["result"]["symmetric"]
        whole = whole or both
        for name in ("mean", "rms", "hausdorff", "hd95"):
            assert both[name]["lower"] <= both[name]["upper"] and holds_for_one(both[name], whole[name])
        for one, other in zip(both["f_score"], whole["f_score"], strict=True):
            assert 0 <= one["f"]["lower"] <= one["f"]["upper"] <= 1 and holds_for_one(one["f"], other["f"])


def test_bounds_come_closer(client, slow_pair):
    """From the first moment on, and they are those of the symmetric distance."""
    request = {"type": "comparison", "a": slow_pair[0], "b": slow_pair[1], "engine": {"pieces": 20000}}
    reply = client.post("/v1/jobs", json=request, headers={"Accept": "application/x-ndjson", "Cache-Control": "no-cache"})
    *bounds, end = [event for event in map(json.loads, reply.text.splitlines()) if event["event"] != "heartbeat"]
    assert len(bounds) >= 3 and all(event["event"] == "bounds" for event in bounds)
    assert bounds[0]["lower"] == 0 and bounds[0]["upper"] is not None
    for one, next_one in zip(bounds, [*bounds[1:], end["result"]["symmetric"]["hausdorff"]]):
        assert one["lower"] <= next_one["lower"] <= next_one["upper"] <= one["upper"]
    for one, next_one in zip(bounds, bounds[1:]):
        assert all(one[name] <= next_one[name] for name in ("elapsed_ms", "seq", "projections"))
    shown = client.get(f"/v1/jobs/{client.get('/v1/jobs', params={'order': 'newest'}).json()['jobs'][0]['id']}").json()
    assert shown["progress"]["lower"] == bounds[-1]["lower"]


def test_a_deadline_leaves_intervals(client, slow_pair):
    reply = client.post("/v1/jobs", json={"type": "comparison", "a": slow_pair[0], "b": slow_pair[1], "accuracy": 1e-9,
                                          "pieces": 10000000, "deadline_ms": 300}, headers={"Prefer": "wait=60"})
    job = reply.json()
    assert job["state"] == "succeeded", job
    assert job["result"]["accurate"] is False and job["result"]["symmetric"]["mean"]["upper"] > 0


def box(half, shift=(0, 0, 0), faces=6):
    corners = [tuple(half * (1 if bits >> k & 1 else -1) + shift[k] for k in range(3)) for bits in range(8)]
    return corners, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)][:faces]


@pytest.mark.parametrize("quads", ["triangles", "bilinear"])
@pytest.mark.parametrize("sign", ["outside", "inside"])
def test_boxes_have_sides(client, quads, sign):
    inner, outer = client.upload(box(0.75))["id"], client.upload(box(1))["id"]
    turn = 1 if sign == "outside" else -1
    job = ask(client, inner, outer, sign=sign, bands=[[-0.3, 0.3], [None, 0]], limit=0.3, regions=True, quads=quads)
    request, result = job["request"], job["result"]
    assert request["sign"] == sign and request["bands"] == [[-0.3, 0.3], [None, 0]]
    assert request["limit"] == 0.3 and request["regions"] is True
    up, down = result["a_to_b"], result["b_to_a"]
    assert up["signed"]["proven"] is True and down["signed"]["sign"] == sign
    assert holds(up["signed"]["inside"]["max"], 0.25, 1e-5) and up["signed"]["outside"]["max"]["upper"] < 1e-9
    assert holds(up["signed"]["mean"], -turn * 0.25, 1e-2)
    assert up["signed"]["bands"][0]["lower"] > 0.99 and (up["signed"]["bands"][1]["lower"] > 0.99) == (turn == 1)
    assert holds(down["signed"]["outside"]["max"], math.sqrt(3) / 4, 1e-5)
    witness = down["signed"]["outside"]["witness"]
    assert (witness["from"]["mesh"], witness["to"]["mesh"], witness["from"]["id"]) == ("b", "a", outer)
    assert up["verdict"] == "below" and up["region_count"] == 0 and up["regions"] == []
    # Beyond the limit are the surroundings of the corners, which the edges join or not.
    assert down["verdict"] == "above" and down["region_count"] == len(down["regions"]) >= 1
    assert all(region["surely"] and region["witness"]["from"]["mesh"] == "b" for region in down["regions"])
    # One direction is what the deviation says.
    reply = client.post("/v1/jobs", json={"type": "deviation", "a": inner, "b": outer, "sign": sign, "limit": 0.3, "quads": quads,
                                          "bands": [[-0.3, 0.3], [None, 0]], "regions": True}, headers={"Prefer": WAIT}).json()
    assert reply["result"]["signed"] == up["signed"] and reply["result"]["regions"] == up["regions"]


def test_a_limit_that_is_the_distance(client):
    """A maximum of exactly the limit is not above it."""
    a, b = client.upload(box(1, (0.25, 0, 0)))["id"], client.upload(box(1))["id"]
    reply = client.post("/v1/jobs", json={"type": "deviation", "a": a, "b": b, "limit": 0.25}, headers={"Prefer": WAIT}).json()
    assert reply["result"]["verdict"] == "below"


def test_what_has_no_sign_is_told(client, pair):
    outer, opened = client.upload(box(1))["id"], client.upload(box(0.5, faces=5))["id"]
    points = client.upload(b"0 0 1\n0 1 2\n1 0 6\n", format="xyz")["id"]
    for mesh, sign, reason in ((opened, "outside", "open"), (points, "inside", "empty"), (points, "normal", "empty")):
        result = ask(client, mesh, outer, sign=sign, bands=[[0, 1]])["result"]
        assert result["a_to_b"]["signed"]["proven"] is (sign != "normal") and "unsigned" not in result["a_to_b"]
        assert result["b_to_a"]["unsigned"] == reason and "signed" not in result["b_to_a"]
    job = ask(client, outer, opened, sign="outside")
    assert job["state"] == "failed" and job["problem"]["code"] == "not_closed"
    assert ask(client, *pair, sign="normal")["result"]["b_to_a"]["signed"]["proven"] is False
    for side, ids in (("b_to_a", (outer, points)), ("a_to_b", (points, outer))):
        result = ask(client, *ids, limit=0.1, regions=True)["result"]
        assert [name for name in ("a_to_b", "b_to_a") if "region_count" not in result[name]] == [side]


@pytest.mark.parametrize("fields, pointer", [
    ({"sign": "left"}, "/sign"), ({"bands": [[1, 0]]}, "/bands/0"), ({"bands": [[1]]}, "/bands/0"),
    ({"limit": -1}, "/limit"), ({"regions": 1}, "/regions"), ({"regions": True}, "/regions"), ({"bands": [[0, 1]]}, "/bands"),
    ({"bands": [[0, 1]] * 65}, "/bands")])
def test_faults_of_sides_name_their_place(client, pair, fields, pointer):
    problem = ask(client, *pair, status=400, **fields)
    assert [error["pointer"] for error in problem["errors"]] == [pointer]
