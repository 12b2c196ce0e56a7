"""Units, uncertainty and labels of meshes, what they do to results, and names by content; ids alone for shells."""
import hashlib
import random

import pytest

import shapes
from conftest import WAIT, check_problem

SEED = 11


def box(shift=0.0, side=1.0):
    return shapes.cube(side, (shift, 0.0, 0.0))


def run(client, **request):
    reply = client.post("/v1/jobs", json=request, headers={"Prefer": WAIT})
    assert reply.status_code == 200, reply.text
    assert reply.json()["state"] == "succeeded", reply.text
    return reply.json()


def test_notes_come_with_an_upload_and_change(client):
    plain = client.upload(box(0.25), name="noted")
    assert plain["unit"] is None and plain["uncertainty"] == 0 and plain["labels"] == []
    noted = client.upload(box(0.25), name="noted", unit="mm", uncertainty="0.125", labels="nightly,part-7")
    assert noted["id"] != plain["id"]
    assert (noted["unit"], noted["uncertainty"], noted["labels"]) == ("mm", 0.125, ["nightly", "part-7"])
    same = client.upload(box(0.25), name="noted", unit="mm", uncertainty="0.125", labels="nightly,part-7")
    assert same["id"] == noted["id"]
    path = f"/v1/meshes/{noted['id']}"
    changed = client.patch(path, json={"uncertainty": 0.5, "labels": ["weekly"]}).json()
    assert (changed["unit"], changed["uncertainty"], changed["labels"]) == ("mm", 0.5, ["weekly"])
    assert client.get(path).json() == changed
    changed = client.patch(path, json={"unit": None, "uncertainty": None, "labels": None, "ttl_seconds": 1000}).json()
    assert (changed["unit"], changed["uncertainty"], changed["labels"]) == (None, 0, [])
    assert changed["expires_at"]
    assert client.patch(path, json={"labels": ["b", "a", "b"]}).json()["labels"] == ["b", "a"]
    # Its upload was in millimetres: that is another mesh now.
    again = client.upload(box(0.25), name="noted", unit="mm", uncertainty="0.125", labels="nightly,part-7")
    assert again["id"] not in (noted["id"], plain["id"])


def test_labels_find_meshes(client):
    ids = [client.upload(box(i), labels=f"run-{SEED},n{i % 2}")["id"] for i in range(4)]
    listed = client.get("/v1/meshes", params={"label": f"run-{SEED}"}).json()["meshes"]
    assert [mesh["id"] for mesh in listed] == ids
    listed = client.get("/v1/meshes", params={"label": "n1", "order": "newest"}).json()["meshes"]
    assert [mesh["id"] for mesh in listed] == [ids[3], ids[1]]
    assert client.get("/v1/meshes", params={"label": "run"}).json()["meshes"] == []
    client.patch(f"/v1/meshes/{ids[0]}", json={"labels": ["moved"]})
    assert len(client.get("/v1/meshes", params={"label": f"run-{SEED}"}).json()["meshes"]) == 3


@pytest.mark.parametrize("query", [{"unit": "furlong"}, {"unit": ""}, {"uncertainty": "-1"}, {"uncertainty": "nan"},
                                   {"uncertainty": "inf"}, {"uncertainty": "0.1mm"}, {"uncertainty": ""}, {"labels": ""},
                                   {"labels": "a,,b"}, {"labels": "a b"}, {"labels": "x" * 65},
                                   {"labels": ",".join(f"l{i}" for i in range(17))}])
def test_bad_notes_of_an_upload_are_refused(client, query):
    check_problem(client.post_mesh(box(), **query), 400, "invalid_parameter")


@pytest.mark.parametrize("body, pointer", [({"unit": "furlong"}, "/unit"), ({"unit": 1}, "/unit"),
                                           ({"uncertainty": -1}, "/uncertainty"), ({"uncertainty": "1"}, "/uncertainty"),
                                           ({"labels": "a"}, "/labels"), ({"labels": ["a", "b c"]}, "/labels/1"),
                                           ({"labels": [1]}, "/labels/0"), ({}, "/ttl_seconds"), ({"name": "x"}, "/name"),
                                           ({"labels": [f"l{i}" for i in range(17)]}, "/labels/16")])
def test_bad_changes_are_refused(client, body, pointer):
    mesh = client.upload(box(), name="stays", unit="mm", labels="kept")
    problem = check_problem(client.patch(f"/v1/meshes/{mesh['id']}", json=body), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == pointer
    assert client.get(f"/v1/meshes/{mesh['id']}").json() == mesh


def test_files_tell_their_unit(client):
    assert client.upload(shapes.threemf(box()), name="a.3mf")["unit"] == "mm"
    assert client.upload(shapes.glb(shapes.triangles(box())), name="a.glb")["unit"] == "m"
    assert client.upload(shapes.glb(shapes.triangles(box())), name="b.glb", unit="mm")["unit"] == "mm"
    assert client.upload(shapes.obj(box()), name="a.obj", format="obj")["unit"] is None


def test_results_hold_for_true_surfaces(client):
    """Of boxes moved by s, moved on by up to eA and eB each: every distance of those is in the interval."""
    chance = random.Random(SEED)
    for _ in range(10):
        shift, ea, eb = chance.uniform(1.5, 3), chance.choice((0, chance.uniform(0, 0.2))), chance.uniform(0.01, 0.2)
        a = client.upload(box(), name="a", uncertainty=repr(ea))["id"]
        b = client.upload(box(shift), name="b", uncertainty=repr(eb))["id"]
        far = run(client, type="hausdorff", a=a, b=b)["result"]
        near = run(client, type="distance", a=a, b=b)["result"]
        deviation = run(client, type="deviation", a=a, b=b, percentiles=[50])["result"]
        for result, truth in ((far, shift), (near, shift - 1), (deviation["max"], shift)):
            print("seed", SEED, ea, eb, result)
            assert result["of_true"]["lower"] <= truth - ea - eb and truth + ea + eb <= result["of_true"]["upper"]
            assert result["of_true"]["lower"] == pytest.approx(result["lower"] - ea - eb, rel=1e-12)
            assert result["of_true"]["upper"] == pytest.approx(result["upper"] + ea + eb, rel=1e-12)
        for figure in (deviation["mean"], deviation["rms"], deviation["percentiles"][0]):
            assert ("of_true" in figure) == (ea == 0)
    close = client.upload(box(1e-3), name="close", uncertainty="0.5")["id"]
    assert run(client, type="hausdorff", a=a, b=close)["result"]["of_true"]["lower"] == 0


def test_no_uncertainty_no_interval(client):
    a, b = (client.upload(box(i), name="sure")["id"] for i in range(2))
    for kind in ("hausdorff", "distance"):
        assert "of_true" not in run(client, type=kind, a=a, b=b)["result"]


def test_a_change_of_the_notes_is_a_new_question(client):
    a = client.upload(box(), name="question")["id"]
    b = client.upload(box(2), name="question")["id"]
    first = run(client, type="hausdorff", a=a, b=b)
    assert run(client, type="hausdorff", a=a, b=b).get("cached")
    client.patch(f"/v1/meshes/{b}", json={"uncertainty": 0.25})
    second = run(client, type="hausdorff", a=a, b=b)
    assert not second.get("cached") and second["result"]["of_true"]["upper"] >= 2.25
    client.patch(f"/v1/meshes/{b}", json={"uncertainty": 0})
    third = run(client, type="hausdorff", a=a, b=b)
    assert third.get("cached") and third["result"] == first["result"]


def test_different_units_are_refused(client):
    a = client.upload(box(), name="u", unit="mm")["id"]
    b = client.upload(box(1), name="u", unit="cm")["id"]
    c = client.upload(box(2), name="u")["id"]
    for kind in ("hausdorff", "deviation", "distance", "collision"):
        problem = check_problem(client.post("/v1/jobs", json={"type": kind, "a": a, "b": b}), 422, "units_differ")
        assert problem["errors"][0]["pointer"] == "/b"
        run(client, type=kind, a=a, b=c)
    client.patch(f"/v1/meshes/{b}", json={"unit": "mm"})
    run(client, type="hausdorff", a=a, b=b)
    lines = client.post("/v1/batches", content='{"type":"distance","a":"%s","b":"%s"}\n' % (a, c)).text
    assert '"succeeded"' in lines


def test_sizes_that_differ_much_are_doubted(client):
    small, large = client.upload(box(), name="s")["id"], client.upload(box(0, 51), name="l")["id"]
    middle = client.upload(box(0, 49), name="m")["id"]
    for a, b in ((small, large), (large, small)):
        for kind in ("hausdorff", "deviation", "distance", "collision"):
            warning, = run(client, type=kind, a=a, b=b)["result"]["warnings"]
            assert "unit" in warning
    assert "warnings" not in run(client, type="hausdorff", a=small, b=middle)["result"]


def test_meshes_are_named_by_their_content(client):
    data = [shapes.obj(box(3 + i)) for i in range(2)]
    data = [text if isinstance(text, bytes) else text.encode() for text in data]
    names = ["sha256:" + hashlib.sha256(text).hexdigest() for text in data]
    problem = check_problem(client.post("/v1/jobs", json={"type": "distance", "a": names[0], "b": names[1]}), 404,
                            "mesh_not_found")
    assert problem["errors"][0]["pointer"] == "/a"
    ids = [client.upload(text, format="obj")["id"] for text in data]
    job = run(client, type="hausdorff", a=names[0], b=names[1])
    assert (job["request"]["a"], job["request"]["b"]) == tuple(ids)
    assert run(client, type="hausdorff", a=ids[0], b=names[1])["cached"]
    assert run(client, type="project", mesh=names[0], points=[[0, 0, 0]])["request"]["mesh"] == ids[0]
    assert run(client, type="self_collision", mesh=names[0])["request"]["mesh"] == ids[0]
    lines = client.post("/v1/batches", content='{"type":"distance","a":"%s","b":"%s"}\n' % tuple(names)).text
    assert '"succeeded"' in lines
    # One that has moved is no longer its file.
    client.patch(f"/v1/meshes/{ids[0]}/vertices", json={"indices": [0], "positions": [[0, 0, 0]]})
    check_problem(client.post("/v1/jobs", json={"type": "distance", "a": names[0], "b": names[1]}), 404, "mesh_not_found")
    other = client.upload(data[0], format="obj")["id"]
    assert run(client, type="distance", a=names[0], b=names[1])["request"]["a"] == other
    for bad in ("sha256:", names[0].upper(), names[0] + "0", "sha256:" + "g" * 64, "md5:" + "0" * 32):
        problem = check_problem(client.post("/v1/jobs", json={"type": "distance", "a": bad, "b": ids[1]}), 400, "invalid_field")
        assert problem["errors"][0]["pointer"] == "/a"


def test_a_mesh_is_found_by_its_content(client):
    text = shapes.ply_little(box(11))
    name = "/v1/meshes/sha256:" + hashlib.sha256(text).hexdigest()
    assert client.head(name).status_code == 404
    check_problem(client.get(name), 404, "mesh_not_found")
    old, mesh = (client.upload(text, name=label) for label in ("old", "new"))
    reply = client.head(name)
    assert reply.status_code == 200 and reply.headers["location"] == f"/v1/meshes/{mesh['id']}" and not reply.content
    assert client.get(name).json() == mesh
    assert client.get(name, headers={"Accept": "text/plain"}).text == mesh["id"] + "\n"
    assert client.get(name, headers={"If-None-Match": reply.headers["etag"]}).status_code == 304
    client.patch(f"/v1/meshes/{mesh['id']}/vertices", json={"indices": [0], "positions": [[0, 0, 0]]})
    assert client.get(name).json() == old
    client.delete(f"/v1/meshes/{old['id']}")
    check_problem(client.get(name), 404, "mesh_not_found")
    for bad in ("zz", name[-64:].upper(), "f" * 63, "g" * 64):
        check_problem(client.get("/v1/meshes/sha256:" + bad), 400, "invalid_parameter")
    check_problem(client.get(name + "0"), 404, "not_found")
    check_problem(client.delete(name), 405)
    check_problem(client.get(f"/v1/meshes/{'f' * 64}"), 404, "not_found")


def test_a_restart_knows_what_a_hash_meant(make_daemon):
    daemon = make_daemon("--workers", "1")
    with daemon.client() as client:
        rough = [shapes.obj(shapes.rough(60, seed, 0.2)) for seed in (1, 2)]
        data = [text if isinstance(text, bytes) else text.encode() for text in rough]
        ids = [client.upload(text, format="obj")["id"] for text in data]
        names = ["sha256:" + hashlib.sha256(text).hexdigest() for text in data]
        jobs = [client.post("/v1/jobs", json={"type": "hausdorff", "a": names[0], "b": names[1], "quads": "bilinear",
                                              "tolerance": 10.0 ** -(3 + i)}).json()["id"] for i in range(6)]
    daemon.stop()
    daemon.start()
    with daemon.client() as client:
        for job in jobs:
            document = client.wait(job)
            assert document["state"] == "succeeded" and document["request"]["a"] == ids[0]


def test_ids_alone_for_shells(client):
    text = {"Accept": "text/plain"}
    reply = client.post("/v1/meshes", content=shapes.ply_little(box(7)), headers=text)
    assert reply.status_code == 201 and reply.headers["content-type"].startswith("text/plain")
    mesh = reply.text.removesuffix("\n")
    assert client.get(f"/v1/meshes/{mesh}").status_code == 200 and reply.headers["location"] == f"/v1/meshes/{mesh}"
    assert client.post("/v1/meshes", content=shapes.ply_little(box(7)), headers=text).text == mesh + "\n"
    reply = client.post("/v1/jobs", json={"type": "self_collision", "mesh": mesh}, headers=text)
    assert reply.status_code == 202
    assert client.wait(reply.text.strip())["state"] == "succeeded"
    reply = client.post("/v1/jobs", json={"type": "self_collision", "mesh": mesh}, headers=text)
    assert reply.status_code in (200, 202)
    reply = client.post("/v1/jobs", json={"type": "self_collision", "mesh": mesh, "mode": "any"},
                        headers={**text, "Prefer": WAIT})
    assert reply.status_code == 200 and client.get(f"/v1/jobs/{reply.text.strip()}").json()["state"] == "succeeded"
    check_problem(client.post("/v1/jobs", json={"type": "self_collision", "mesh": "m_none"}, headers=text), 404)


def test_the_uncertainty_is_moved_with_a_mesh(client):
    text = shapes.obj(box(2))
    exact = client.upload(text)["id"]
    name = "sha256:" + hashlib.sha256(text).hexdigest()
    vague = client.upload(text, uncertainty=0.25)["id"]  # and the newest one with this content
    twice = [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 10, 0, 0, 1]
    moved = {"mesh": name, "transform": twice}
    result = run(client, type="hausdorff", a=moved, b={"mesh": exact, "transform": twice})["result"]
    assert result["upper"] <= 1e-9 and result["of_true"]["lower"] == 0
    assert 0.5 <= result["of_true"]["upper"] - result["upper"] <= 0.5 + 1e-9
    reply = client.post(f"/v1/meshes/{vague}/copies", json={"transform": twice})
    assert reply.status_code == 201, reply.text
    assert 0.5 <= reply.json()["uncertainty"] <= 0.5 + 1e-9
    assert not client.post(f"/v1/meshes/{exact}/copies", json={"transform": twice}).json().get("uncertainty")


def holds(outer, value):
    return outer["lower"] <= value["upper"] and value["lower"] <= outer["upper"]


def test_true_surfaces_of_a_matrix(client):
    """Boxes that are moved by less than their uncertainty are true surfaces that they may have."""
    chance = random.Random(SEED)
    vague = [0.05, 0.0, 0.02, 0.2]

    def boxes(moves):
        return [shapes.ply_little(shapes.cube(side=1 + 0.1 * i, origin=move)) for i, move in enumerate(moves)]

    ids = [client.upload(text, **({"uncertainty": e} if e else {}))["id"] for text, e in zip(boxes([(0, 0, 0)] * 4), vague)]
    asked = {"type": "matrix", "meshes": ids, "gap": 1e-9}
    result = run(client, **asked, want={"nearest": 3})["result"]
    assert result["uncertainties"] == vague
    limit = run(client, **asked, want={"within": 0.2})["result"]["verdicts"]
    assert limit["of_true"]["undecided"] >= limit["undecided"] and sum(limit["of_true"].values()) == 6
    assert limit["of_true"]["within"] <= limit["within"] and limit["of_true"]["beyond"] <= limit["beyond"]
    for _ in range(5):
        moves = [[e * chance.uniform(-1, 1) / 3 ** 0.5 for _ in range(3)] for e in vague]
        true = [client.upload(text)["id"] for text in boxes(moves)]
        exact = run(client, type="matrix", meshes=true, want={"nearest": 3}, gap=1e-9)["result"]
        assert "uncertainties" not in exact and "of_true" not in str(exact)
        for a in range(4):
            found = {near["mesh"]: near for near in exact["nearest"][a]}
            for near in result["nearest"][a]:
                assert holds(near["of_true"], found[near["mesh"]])
    # The notes are part of the question: an answer of exact meshes is none of vague ones.
    client.patch(f"/v1/meshes/{ids[1]}", json={"uncertainty": 0.5})
    again = run(client, **asked, want={"nearest": 3})
    assert "cached" not in again and again["result"]["uncertainties"][1] == 0.5
    moved = run(client, type="matrix", meshes=[ids[1], {"mesh": ids[0], "transform": [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}])
    assert moved["result"]["uncertainties"][1] == pytest.approx(0.1)


def test_true_surfaces_of_places_and_regions(client):
    a = client.upload(shapes.ply_little(shapes.cube(side=2)), uncertainty=0.1)["id"]
    b = client.upload(shapes.ply_little(shapes.cube(side=1)), uncertainty=0.2)["id"]
    result = run(client, type="comparison", a=a, b=b, limit=0.5, regions=True, sign="outside", worst={"count": 2})["result"]
    for direction in ("a_to_b", "b_to_a"):
        for place in result[direction]["worst"]:
            assert place["of_true"]["upper"] - place["upper"] == pytest.approx(0.3)
        assert "of_true" not in str(result[direction]["signed"])
    (region,) = result["a_to_b"]["regions"]
    assert region["max"]["of_true"]["lower"] == pytest.approx(region["max"]["lower"] - 0.3)
    assert region["max"]["of_true"]["upper"] == pytest.approx(region["max"]["upper"] + 0.3)
    found = run(client, type="alignment", a=a, b=b, motion="rigid_scale")["result"]
    assert found["scale"] == pytest.approx(0.5)
    assert found["hausdorff"]["of_true"]["upper"] - found["hausdorff"]["upper"] == pytest.approx(0.05 + 0.2)
    penetration = run(client, type="collision", a=a, b=b, penetration=True)["result"]["penetration"]
    assert "of_true" not in str(penetration)
