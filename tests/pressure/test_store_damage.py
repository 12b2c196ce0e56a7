"""A data folder whose files have changed behind the daemon's back: reported, never a wrong answer."""
import os
import random

import pytest

import shapes
from api_conftest import WAIT, Daemon, check_problem

LONG = os.environ.get("QM_TEST_LONG") == "1"
SEED = int(os.environ.get("QM_TEST_SEED", 1))


@pytest.fixture
def stopped(tmp_path):
    """Starts daemons on one folder, and stops the one before."""
    made = []

    def start(*settings):
        stop()
        made.append(Daemon(tmp_path, *settings))
        return made[-1]

    def stop():
        if made and made[-1].process.poll() is None:
            assert made[-1].stop() == 0, made[-1].log()

    start.stop = stop
    start.data = tmp_path / "data"
    yield start
    stop()


def flip(path, bit):
    """Turns one bit of a file round."""
    with open(path, "r+b") as file:
        file.seek(bit // 8)
        byte = file.read(1)[0] ^ 1 << bit % 8
        file.seek(bit // 8)
        file.write(bytes([byte]))


def blob_of(start, mesh):
    return start.data / "blobs" / mesh["content_hash"][:2] / mesh["content_hash"]


def metric(client, name):
    return next(float(line.split()[1]) for line in client.get("/metrics").text.splitlines()
                if line.startswith(f"quadmeshd_{name} "))


def damage(path, how, chance):
    """Changes a file in one way."""
    size = path.stat().st_size
    if how == "flipped":
        flip(path, chance.randrange(8 * size))
    elif how == "truncated":
        os.truncate(path, chance.randrange(size))
    elif how == "longer":
        path.write_bytes(path.read_bytes() + b"\n")
    else:
        path.unlink()


@pytest.mark.parametrize("how", ["flipped", "truncated", "longer", "gone"])
def test_a_damaged_file_of_a_mesh_is_reported_and_healed_by_its_upload(stopped, how):
    """Whatever bytes have changed: comments and unused digits of an OBJ file decode as before."""
    chance = random.Random(SEED)
    content = shapes.obj(shapes.sphere(parallels=10, meridians=20))
    for _ in range(50 if LONG else 3):
        with stopped().client() as client:
            mesh = client.upload(content, name="a.obj")
            first = client.hausdorff(mesh["id"], mesh["id"])["result"]
        stopped.stop()
        damage(blob_of(stopped, mesh), how, chance)
        running = stopped()
        with running.client() as client:
            problem = check_problem(client.get(f"/v1/meshes/{mesh['id']}/content"), 500, "blob_damaged")
            assert mesh["id"] in problem["detail"]
            job = client.hausdorff(mesh["id"], mesh["id"], {"Cache-Control": "no-cache"})
            assert job["state"] == "failed" and job["problem"]["code"] == "blob_damaged"
            assert metric(client, "damages_total") == 2 and metric(client, "repairs_total") == 0
            assert f"blob {mesh['content_hash']} of mesh {mesh['id']} is" in running.log()
            # An upload of other bytes changes nothing; one of the same bytes is the same mesh, and repairs it.
            client.upload(shapes.cube())
            check_problem(client.get(f"/v1/meshes/{mesh['id']}/content"), 500, "blob_damaged")
            reply = client.post("/v1/meshes", params={"name": "a.obj"}, content=content)
            assert reply.status_code == 200 and reply.json()["id"] == mesh["id"]
            assert metric(client, "repairs_total") == 1
            again = client.hausdorff(mesh["id"], mesh["id"], {"Cache-Control": "no-cache"})["result"]
            assert (again["lower"], again["upper"]) == (first["lower"], first["upper"])
            reply = client.post("/v1/meshes", params={"name": "a.obj"}, content=content)
            assert reply.status_code == 200 and metric(client, "repairs_total") == 1
            assert blob_of(stopped, mesh).read_bytes() == content


def test_an_upload_under_another_name_heals_too(stopped):
    content = shapes.ply_little(shapes.cube())
    with stopped().client() as client:
        mesh = client.upload(content, name="one")
    stopped.stop()
    flip(blob_of(stopped, mesh), 77)
    with stopped().client() as client:
        check_problem(client.get(f"/v1/meshes/{mesh['id']}/content"), 500, "blob_damaged")
        assert client.upload(content, name="two")["id"] != mesh["id"]
        assert client.hausdorff(mesh["id"], mesh["id"])["state"] == "succeeded"


@pytest.mark.parametrize("how", ["flipped", "truncated", "gone"])
def test_damaged_positions_are_reported(stopped, how):
    with stopped().client() as client:
        mesh = client.upload(shapes.cube())
        client.patch(f"/v1/meshes/{mesh['id']}/vertices", json={"indices": [7], "positions": [[2, 2, 2]]})
    stopped.stop()
    [positions] = [path for path in (stopped.data / "blobs").rglob("*") if path.is_file() and path != blob_of(stopped, mesh)]
    damage(positions, how, random.Random(SEED))
    with stopped().client() as client:
        check_problem(client.get(f"/v1/meshes/{mesh['id']}/content"), 500, "blob_damaged")
        reply = client.patch(f"/v1/meshes/{mesh['id']}/vertices", json={"indices": [7], "positions": [[3, 3, 3]]})
        check_problem(reply, 500, "blob_damaged")
        assert client.delete(f"/v1/meshes/{mesh['id']}").status_code == 204
        assert client.get(f"/v1/meshes/{client.upload(shapes.cube())['id']}/content").status_code == 200
