"""Labels of jobs: given with the request, shown, changed, and filters of lists."""

import signal

import pytest

import shapes
from conftest import WAIT, check_problem


@pytest.fixture
def pair(client):
    return [client.upload(shapes.ply_little(shapes.cube(side=side)))["id"] for side in (1, 2)]


def ask(client, pair, **more):
    reply = client.post("/v1/jobs", json={"type": "distance", "a": pair[0], "b": pair[1], **more}, headers={"Prefer": WAIT})
    assert reply.status_code == 200, reply.text
    return reply.json()


def listed(client, **query):
    return [job["id"] for job in client.get("/v1/jobs", params={"order": "newest", **query}).json()["jobs"]]


def test_labels_are_shown_and_found(client, pair):
    job = ask(client, pair, labels=["ci/7", "night", "ci/7"], gap=1e-3)
    assert job["labels"] == ["ci/7", "night"] and "labels" not in job["request"]
    assert client.get(f"/v1/jobs/{job['id']}").json()["labels"] == ["ci/7", "night"]
    other = ask(client, pair, labels=["ci/70"], gap=1e-3)
    none = client.post("/v1/jobs", json={"type": "self_collision", "mesh": pair[0]}, headers={"Prefer": WAIT}).json()
    assert none["labels"] == []
    assert listed(client, label="ci/7") == listed(client, label="night") == [job["id"]]
    assert listed(client, label="ci/70", type="distance", state="succeeded", mesh=pair[1]) == [other["id"]]
    assert listed(client, label="ci") == listed(client, label="") == listed(client, label="\n") == []
    assert listed(client, label="night", type="hausdorff") == []


def test_an_answer_has_the_labels_that_were_asked_for(client, pair):
    first = ask(client, pair, labels=["x", "y"], gap=2e-3)
    assert ask(client, pair, gap=2e-3)["id"] == ask(client, pair, labels=["y"], gap=2e-3)["id"] == first["id"]
    second = ask(client, pair, labels=["y", "z"], gap=2e-3)
    assert second["id"] != first["id"] and "cached" not in second and second["labels"] == ["y", "z"]
    assert second["result"]["lower"] == first["result"]["lower"]


def test_labels_change(client, pair):
    job = ask(client, pair, gap=3e-3)
    address = f"/v1/jobs/{job['id']}"
    changed = client.patch(address, json={"labels": ["b", "a"]})
    assert changed.status_code == 200 and changed.json() == {**job, "labels": ["b", "a"]}
    assert listed(client, label="a") == [job["id"]]
    assert client.patch(address, json={"labels": None}).json()["labels"] == []
    assert listed(client, label="a") == [] and client.get(address).json()["labels"] == []
    for bad in ({}, {"labels": "a"}, {"labels": [1]}, {"labels": [""]}, {"labels": ["a b"]}, {"labels": ["a"] * 3 + ["\u00e9"]},
                {"labels": ["x" * 65]}, {"labels": [f"l{i}" for i in range(17)]}, {"labels": ["a"], "type": "distance"}, []):
        check_problem(client.patch(address, json=bad), 400)
    problem = check_problem(client.patch(address, json={"labels": ["a", "b c"]}), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == "/labels/1"
    check_problem(client.patch("/v1/jobs/j_none", json={"labels": ["a"]}), 404, "job_not_found")
    check_problem(client.post("/v1/jobs", json={"type": "self_collision", "mesh": pair[0], "labels": ["a", ""]}), 400)
    assert client.get(address).json()["labels"] == []


def test_a_job_that_runs_and_a_restart(make_daemon, slow_files):
    daemon = make_daemon("--workers", "1")
    with daemon.client() as client:
        a, b = (client.upload(content)["id"] for content in slow_files)
        jobs = [client.post("/v1/jobs", json={"type": "hausdorff", "a": a, "b": b, "gap": 1e-13 * (1 + i), "quads": "bilinear",
                                              "labels": [f"run{i}"]}).json() for i in range(2)]
        for i, job in enumerate(jobs):
            assert job["labels"] == [f"run{i}"] and job["state"] in ("queued", "running")
            assert client.patch(f"/v1/jobs/{job['id']}", json={"labels": ["kept"]}).json()["labels"] == ["kept"]
        assert listed(client, label="kept") == [jobs[1]["id"], jobs[0]["id"]]
    daemon.stop(signal.SIGKILL)
    daemon.start()
    with daemon.client() as client:
        for job in jobs:
            assert client.get(f"/v1/jobs/{job['id']}").json()["labels"] == ["kept"]
            client.delete(f"/v1/jobs/{job['id']}")
            assert client.wait(job["id"])["labels"] == ["kept"]
        assert len(listed(client, label="kept")) == 2 and listed(client, label="run0") == []
