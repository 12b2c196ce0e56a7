"""Two daemons on one database, as through the address of QM_TEST_POSTGRES, which may lead through a proxy; tests/cluster breaks
such nodes."""
import time

import pytest

import shapes
from conftest import PATIENCE, SLOW, SLOW_DISTANCE, WAIT, check_bounds, make_database


@pytest.fixture(params=["database", "folder"])
def pair(request, make_node, tmp_path):
    """Both nodes, with their blobs in the database or in a folder."""
    store, settings = make_database(), []
    if request.param == "folder":
        (tmp_path / "blobs").mkdir()
        settings = ["--blobs", tmp_path / "blobs"]
    return [make_node(name, store, *settings) for name in ("n1", "n2")]


def test_each_has_what_the_other_stores(pair):
    with pair[0].client() as first, pair[1].client() as second:
        mesh = first.upload(shapes.obj(shapes.cube(side=3)))["id"]
        contents = [client.get(f"/v1/meshes/{mesh}/content?format=obj").content for client in (first, second)]
        assert contents[0] == contents[1] and contents[0].count(b"\nf ") == 6
        reply = second.patch(f"/v1/meshes/{mesh}/vertices", json={"indices": [0], "positions": [[0.0, 0.0, -1.0]]})
        assert reply.json()["revision"] == 1
        other = second.upload(shapes.obj(shapes.cube(side=2)))["id"]
        body, key = {"type": "deviation", "a": mesh, "b": other, "tolerance": 0.01}, {"Idempotency-Key": "one"}
        jobs = [client.post("/v1/jobs", json=body, headers={"Prefer": WAIT, **key}).json() for client in (first, second)]
        assert jobs[0] == jobs[1] and jobs[0]["state"] == "succeeded"
        results = [client.get(f"/v1/jobs/{jobs[0]['id']}/result").json() for client in (first, second)]
        assert results[0] == results[1]
        assert first.delete(f"/v1/meshes/{mesh}").status_code == 204
        assert second.get(f"/v1/meshes/{mesh}").status_code == 404
    for node in pair:
        assert node.stop() == 0


def test_a_long_search_is_that_of_both(pair, slow_files):
    with pair[0].client() as first, pair[1].client() as second:
        meshes = [first.upload(content)["id"] for content in slow_files]
        job = second.start(*meshes, headers={"Cache-Control": "no-cache"}, **SLOW)["id"]
        end = time.monotonic() + PATIENCE
        while first.get(f"/v1/jobs/{job}").json().get("progress", {}).get("nodes", 0) < 2:
            assert time.monotonic() < end, first.get(f"/v1/jobs/{job}").json()
            time.sleep(0.05)
        assert first.patch(f"/v1/jobs/{job}", json={"labels": ["of both"]}).status_code == 400
        for client, other, label in ((first, second, "from-1"), (second, first, "from-2")):
            assert client.patch(f"/v1/jobs/{job}", json={"labels": [label]}).json()["labels"] == [label]
            assert other.get(f"/v1/jobs/{job}").json()["labels"] == [label]
            assert [found["id"] for found in other.get("/v1/jobs", params={"label": label}).json()["jobs"]] == [job]
        assert first.delete(f"/v1/jobs/{job}").status_code == 202
        result = second.wait(job)["result"]
        assert result["stopped_by"] == "canceled" and result["lower"] <= SLOW_DISTANCE <= result["upper"]
        events = [client.events(job) for client in (first, second)]
        check_bounds(events[0], result)
        assert events[0] == events[1]
    for node in pair:
        assert node.stop() == 0
