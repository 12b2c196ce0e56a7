"""Writes a data folder as the present version of the daemon makes it, packed, for the tests of later versions:

    python make_stored.py stored/schema7.tar.gz

A folder of each version of the schema is kept; none is ever made anew. It has meshes (one of them deformed), jobs that have
ended (two with an array, one with an Idempotency-Key), one that has not, and a layout.
"""
import pathlib
import signal
import sys
import tarfile
import tempfile

sys.path.append(str(pathlib.Path(__file__).parent.parent / "api"))
import shapes
from conftest import SLOW, WAIT, Daemon


def fill(client):
    sphere = client.upload(shapes.sphere(parallels=6, meridians=10), name="sphere")["id"]
    turned = client.upload(shapes.sphere(0.1, parallels=6, meridians=10), name="turned")["id"]
    moved = client.upload(shapes.cube(), name="cube")["id"]
    client.patch(f"/v1/meshes/{moved}/vertices", json={"indices": [7], "positions": [[1.5, 1.5, 1.5]]})
    client.hausdorff(sphere, turned, headers={"Idempotency-Key": "the first"})
    client.hausdorff(sphere, moved)
    for kind in ("deviation", "collision"):
        client.post("/v1/jobs", json={"type": kind, "a": sphere, "b": turned}, headers={"Prefer": WAIT})
    client.post("/v1/layouts", json={"mesh": client.upload(shapes.saddle(8), name="saddle")["id"]})
    heap = shapes.crumpled(60, seed=1)
    heaps = [shapes.ply_little(shapes.cut(heap, 2)), shapes.ply_little(shapes.moved(shapes.cut(heap, 3), 0, 0, 1 / 512))]
    client.wait_until_running(client.start(*(client.upload(heap)["id"] for heap in heaps), **SLOW)["id"])


def main(path):
    with tempfile.TemporaryDirectory() as folder:
        running = Daemon(folder, "--grace", 0)
        with running.client() as client:
            fill(client)
        running.stop(signal.SIGTERM)
        with tarfile.open(path, "w:gz", compresslevel=9) as packed:
            packed.add(running.folder / "data", "data", filter=lambda entry: None if entry.name.endswith("lock") else entry)


if __name__ == "__main__":
    main(sys.argv[1])
