"""Uploads that take long to decode hold up no query, edit or download of another mesh.

No test measures how fast the daemon is: all queries have been answered when the first upload is."""
import struct
import threading

import pytest

import shapes

UPLOADS = 6


@pytest.fixture
def uploads(make_daemon):
    """A daemon with a mesh in memory that decodes large meshes; a list of the statuses of these, which grows."""
    running = make_daemon()
    with running.client() as client:
        mesh = client.upload(shapes.sphere())["id"]
        client.hausdorff(mesh, mesh)
    statuses = []

    def upload(seed):
        with running.client() as client:
            statuses.append(client.post("/v1/meshes", params={"format": "glb", "name": str(seed)},
                                        content=shapes.crowded_glb(150 + seed, 100)).status_code)

    threads = [threading.Thread(target=upload, args=[k]) for k in range(UPLOADS)]
    for thread in threads:
        thread.start()
    with running.client() as client:
        while client.get("/metrics").text.count("quadmeshd_decodes_running 2\n") == 0:
            assert not statuses, "all uploads were decoded before the first query"
        yield client, mesh, statuses
    for thread in threads:
        thread.join()
    assert statuses == [201] * UPLOADS


def test_queries_do_not_wait_for_uploads(uploads):
    client, mesh, statuses = uploads
    points = struct.pack("<6d", 2, 0, 0, 0, 0, 3)
    for k in range(20):
        reply = client.post(f"/v1/meshes/{mesh}/project", content=points, headers={"Accept": "application/json"})
        assert reply.status_code == 200 and len(reply.json()["points"]) == 2
        moved = {"indices": [0], "positions": [[0, 0, 1 + k / 100]]}
        assert client.patch(f"/v1/meshes/{mesh}/vertices", json=moved).status_code == 200
        assert client.get(f"/v1/meshes/{mesh}/content", params={"format": "ply"}).status_code == 200
        assert client.get(f"/v1/meshes/{mesh}/vertices").status_code == 200
        layout = client.post("/v1/layouts", json={"mesh": mesh})
        assert layout.status_code == 201, layout.text
        assert client.delete(f"/v1/layouts/{layout.json()['id']}").status_code == 204
        assert client.get(f"/v1/jobs/{client.hausdorff(mesh, mesh, tolerance=1e-3 / (k + 1))['id']}").status_code == 200
    assert len(statuses) < UPLOADS, "the uploads ended before the queries"
