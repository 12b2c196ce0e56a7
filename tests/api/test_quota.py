"""A quota of the data folder: what is counted, what is refused, and what still works then."""
import concurrent.futures
import http.client
import sqlite3

import pytest

import shapes
from conftest import WAIT, check_problem, gauge
from test_layouts import saddle_layout

QUOTA = 3 << 20


@pytest.fixture
def small(make_daemon):
    return make_daemon("--max-data-bytes", QUOTA)


def count_files(folder):
    """Sizes by the file system: blobs, results, uploads."""
    return [sum(file.stat().st_size for file in (folder / "data" / name).rglob("*") if file.is_file())
            for name in ("blobs", "results", "incoming")]


def check_count(daemon, client):
    """All counts, the database's by SQLite itself, which reads the file of a daemon that rests."""
    counted = [gauge(client, f"data_{kind}_bytes") for kind in ("blob", "result", "upload")]
    assert counted == count_files(daemon.folder)
    with sqlite3.connect(f"file:{daemon.folder}/data/quadmeshd.sqlite?mode=ro", uri=True) as database:
        pages, free, size = (database.execute(f"PRAGMA {name}").fetchone()[0]
                             for name in ("page_count", "freelist_count", "page_size"))
    database.close()
    assert gauge(client, "data_database_bytes") == (pages - free) * size
    total = gauge(client, "data_bytes")
    assert total == sum(counted) + (pages - free) * size
    assert client.get("/v1/info").json()["data_bytes"] == total
    return total


def fill(client):
    """Uploads until no more fits; returns the meshes and the problem."""
    meshes = []
    while True:
        reply = client.post("/v1/meshes", content=shapes.ply_little(shapes.rough(60, seed=len(meshes))))
        if reply.status_code != 201:
            return meshes, check_problem(reply, 507, "storage_full")
        meshes.append(reply.json())


def test_a_full_folder_refuses_and_recovers(small):
    with small.client() as client:
        meshes, problem = fill(client)
        assert "no room" in problem["detail"] and len(meshes) > 3
        assert gauge(client, "data_limit_bytes") == QUOTA == client.get("/v1/info").json()["limits"]["data_bytes"]
        assert QUOTA * 0.9 < check_count(small, client) <= QUOTA
        # Reading goes on, and so does all that makes room.
        assert client.get(f"/v1/meshes/{meshes[0]['id']}/content").status_code == 200
        assert client.post(f"/v1/meshes/{meshes[0]['id']}/project", content=bytes(24)).status_code == 200
        assert client.patch(f"/v1/meshes/{meshes[0]['id']}", json={"ttl_seconds": 100000}).status_code == 200
        assert client.get("/readyz").status_code == 200
        assert client.delete(f"/v1/meshes/{meshes.pop()['id']}").status_code == 204
        check_count(small, client)
        meshes.append(client.upload(shapes.ply_little(shapes.rough(60, seed=1000))))
        assert client.hausdorff(meshes[0]["id"], meshes[1]["id"], tolerance=0.01)["state"] == "succeeded"
    small.stop()
    small.start()
    with small.client() as client:
        check_count(small, client)
        assert {mesh["id"] for mesh in client.get("/v1/meshes").json()["meshes"]} == {mesh["id"] for mesh in meshes}


def test_an_upload_is_refused_before_its_body(small):
    connection = http.client.HTTPConnection("127.0.0.1", small.port, timeout=60)
    connection.putrequest("POST", "/v1/meshes")
    connection.putheader("Content-Length", str(QUOTA))
    connection.endheaders()
    reply = connection.getresponse()
    assert reply.status == 507 and b"storage_full" in reply.read()
    connection.close()


def test_an_upload_of_unknown_length_ends_at_the_quota(small):
    def blocks():
        for _ in range(2 * QUOTA >> 16):
            yield b"#" * (1 << 16)

    with small.client() as client:
        check_problem(client.post("/v1/meshes", content=blocks()), 507, "storage_full")
        check_count(small, client)


def test_uploads_beside_each_other_share_the_room(small):
    """Each of them fits alone."""
    contents = [shapes.ply_little(shapes.rough(120, seed=seed)) for seed in range(8)]
    size = len(contents[0])
    assert 2 * size < QUOTA < 8 * size

    def upload(content):
        with small.client() as client:
            return client.post("/v1/meshes", content=content)

    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        replies = list(pool.map(upload, contents))
    for reply in replies:
        if reply.status_code != 201:
            check_problem(reply, 507, "storage_full")
    taken = sum(reply.status_code == 201 for reply in replies)
    assert 1 <= taken <= QUOTA // size
    with small.client() as client:
        assert check_count(small, client) <= QUOTA


def test_what_would_begin_something_is_refused(make_daemon):
    """A smaller quota than what is there: nothing is lost, and nothing begins."""
    running = make_daemon()
    with running.client() as client:
        mesh = client.upload(shapes.saddle(24))["id"]
        layout = client.post("/v1/layouts", json={"mesh": mesh, **saddle_layout()}).json()
    running.stop()
    running.settings = ("--max-data-bytes", 1000)
    running.start()
    with running.client() as client:
        assert client.get("/v1/meshes").json()["meshes"][0]["id"] == mesh
        check_problem(client.post("/v1/jobs", json={"type": "hausdorff", "a": mesh, "b": mesh}), 507, "storage_full")
        check_problem(client.post("/v1/layouts", json={"mesh": mesh}), 507, "storage_full")
        check_problem(client.post("/v1/meshes", content=shapes.ply_little(shapes.cube())), 507, "storage_full")
        split = f"/v1/layouts/{layout['id']}/curves/6/split"
        check_problem(client.post(split, json={"point": [0, 0.1, 0]}), 507, "storage_full")
        assert client.get(f"/v1/layouts/{layout['id']}").json() == layout
        moved = client.patch(f"/v1/meshes/{mesh}/vertices", json={"indices": [0], "positions": [[0, 0, 0.1]]})
        check_problem(moved, 507, "storage_full")
        assert client.get(f"/v1/meshes/{mesh}").json()["revision"] == 0
        assert client.delete(f"/v1/layouts/{layout['id']}").status_code == 204
        check_count(running, client)


def test_a_result_that_does_not_fit_fails_its_job(make_daemon):
    """One number a vertex is more than what is left."""
    content = shapes.ply_little(shapes.rough(150, seed=5))
    running = make_daemon("--max-data-bytes", len(content) + (1 << 18))
    with running.client() as client:
        big = client.upload(content)["id"]
        request = {"type": "deviation", "a": big, "b": big, "tolerance": 0.01}
        answer = client.post("/v1/jobs", json=request, headers={"Prefer": WAIT}).json()
        assert answer["state"] == "failed" and answer["problem"]["code"] == "storage_full", answer
        check_count(running, client)
    running.stop()
    running.settings = ()
    running.start()
    with running.client() as client:
        answer = client.post("/v1/jobs", json=request, headers={"Prefer": WAIT}).json()
        assert answer["state"] == "succeeded"
        assert gauge(client, "data_result_bytes") == 8 * 151 ** 2
        check_count(running, client)
        assert client.delete(f"/v1/jobs/{answer['id']}", params={"job": "ended"}).status_code == 204
        assert gauge(client, "data_result_bytes") == 0
