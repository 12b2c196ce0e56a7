"""kill -9 at random instants under load: nothing that was answered is lost, and nothing half stays behind.

QM_TEST_LONG=1 kills 200 times. QM_TEST_SEED moves the instants; the seed is shown when a test fails.
"""
import collections
import os
import random
import signal
import threading
import time

import httpx
import pytest

import shapes
from conftest import PATIENCE, SLOW, SLOW_DISTANCE, WAIT, check_bounds, split_runs

KILLS = 200 if os.environ.get("QM_TEST_LONG", "0") != "0" else 12
SEED = int(os.environ.get("QM_TEST_SEED", "1"))


class Load:
    """Clients that record each reply, and each request whose reply did not come."""

    def __init__(self, running, sides, meshes):
        """meshes are there already."""
        self.running, self.sides = running, sides
        self.meshes, self.deleted, self.maybe_deleted, self.jobs = dict(meshes), set(), set(), {}
        self.ended, self.faults = False, []
        self.threads = [threading.Thread(target=self.run, args=(work,))
                        for work in (self.upload, self.upload, self.ask, self.delete)]

    def run(self, work):
        with self.running.client() as client:
            while not self.ended:
                try:
                    work(client)
                except httpx.TransportError:
                    return
                except AssertionError as fault:
                    self.faults.append(fault)
                    return

    def upload(self, client):
        side = next(self.sides)
        reply = client.post("/v1/meshes", content=shapes.obj(shapes.cube(side=side)))
        assert reply.status_code == 201, reply.text
        self.meshes[reply.json()["id"]] = side

    def ask(self, client):
        known = [mesh for mesh in list(self.meshes) if mesh not in self.maybe_deleted]
        if len(known) < 2:
            time.sleep(0.001)
            return
        a, b = known[-1], known[len(known) // 2]
        kind = random.choice(["hausdorff", "deviation"])
        reply = client.post("/v1/jobs", json={"type": kind, "a": a, "b": b, "tolerance": 1e-3},
                            headers={"Cache-Control": "no-cache"})
        assert reply.status_code in (202, 404), reply.text
        if reply.status_code == 202:
            self.jobs[reply.json()["id"]] = (a, b)

    def delete(self, client):
        time.sleep(0.005)
        known = [mesh for mesh in list(self.meshes) if mesh not in self.maybe_deleted]
        if len(known) < 8:
            return
        mesh = known[0]
        self.maybe_deleted.add(mesh)
        assert client.delete(f"/v1/meshes/{mesh}").status_code == 204
        self.deleted.add(mesh)

    def __enter__(self):
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_):
        self.ended = True
        for thread in self.threads:
            thread.join()


def list_all(client, what):
    found, cursor = [], {}
    while True:
        page = client.get(f"/v1/{what}", params={"limit": 1000, **cursor}).json()
        found += page[what]
        if page["next"] is None:
            return found
        cursor = {"cursor": page["next"]}


def check_everything(running, meshes, deleted, maybe_deleted, jobs):
    with running.client() as client:
        listed = {mesh["id"] for mesh in list_all(client, "meshes")}
        assert set(meshes) - maybe_deleted <= listed, "an acknowledged mesh is lost"
        assert not deleted & listed, "a deleted mesh is back"
        states = collections.Counter()
        for job in jobs:
            document = client.wait(job)
            states[document["state"]] += 1
            # Only a mesh that was deleted before the job ran again may fail it.
            if document["state"] == "failed":
                assert document["problem"]["code"] == "mesh_not_found" and set(jobs[job]) & maybe_deleted
            else:
                assert document["state"] == "succeeded"
                check_bounds(client.events(job), document["result"])
        return listed, states


def blobs(running):
    return {path.name for path in (running.folder / "data/blobs").rglob("*") if path.is_file()}


@pytest.mark.timeout(10 * max(KILLS, 12))
def test_kills_at_random_instants(make_daemon):
    chance = random.Random(SEED)
    running = make_daemon("--log-level", "warn")
    sides = iter(range(1, 10**9))
    meshes, deleted, maybe_deleted, total = {}, set(), set(), 0
    for kill in range(KILLS):
        there = [item for item in meshes.items() if item[0] not in maybe_deleted]
        with Load(running, sides, there[-4:]) as load:
            # Now and then before the first answer, else when the load is under way.
            known = len(load.meshes)
            while kill % 4 and len(load.meshes) == known:
                time.sleep(0.001)
            time.sleep(chance.uniform(0.0, 0.15))
            running.process.send_signal(signal.SIGKILL)
        running.process.wait()
        assert not load.faults, f"seed {SEED}, kill {kill}"
        meshes.update(load.meshes)
        deleted |= load.deleted
        maybe_deleted |= load.maybe_deleted
        running.start()
        assert not any((running.folder / "data/incoming").iterdir()), f"seed {SEED}, kill {kill}"
        listed, states = check_everything(running, meshes, deleted, maybe_deleted, load.jobs)
        total += sum(states.values())
    assert len(meshes) > KILLS / 2 and total > 0
    with running.client() as client:
        hashes = {mesh["content_hash"] for mesh in list_all(client, "meshes")}
        # What is stored is there whole: a fresh job reads it.
        for mesh in list(listed)[-5:]:
            assert client.hausdorff(mesh, mesh, headers={"Cache-Control": "no-cache"})["state"] == "succeeded"
    assert hashes <= blobs(running)
    running.stop(signal.SIGKILL)
    running.start()
    assert blobs(running) >= hashes
    running.stop(signal.SIGKILL)
    age(running.folder / "data")
    running.start()
    assert blobs(running) == hashes, "a blob without a mesh stays behind"


def age(data):
    """Makes all files older than the day for which those without a row are kept."""
    for folder in ("blobs", "results"):
        for path in (data / folder).rglob("*"):
            os.utime(path, (time.time() - 90_000,) * 2)


def test_what_no_row_names_is_swept(make_daemon):
    """As if the daemon had been killed between a file and its row."""
    running = make_daemon()
    with running.client() as client:
        pair = [client.upload(shapes.cube(side=side))["id"] for side in (1.0, 2.0)]
        job = client.post("/v1/jobs", json={"type": "deviation", "a": pair[0], "b": pair[1]},
                          headers={"Prefer": WAIT}).json()
    running.stop(signal.SIGKILL)
    data = running.folder / "data"
    (data / "incoming/half").write_bytes(b"v 0 0")
    folder = data / "blobs/ab"
    folder.mkdir(exist_ok=True)
    (folder / ("ab" + "0" * 62)).write_bytes(b"complete, and unused")
    for name in ("j_nobody.f64", f"{job['id']}.part", "odd"):
        (data / "results" / name).write_bytes(bytes(8))
    running.start()
    assert (folder / ("ab" + "0" * 62)).exists(), "it is younger than a day"
    running.stop()
    age(data)
    running.start()
    assert not (data / "incoming/half").exists() and not any(folder.iterdir())
    assert [path.name for path in (data / "results").iterdir()] == [f"{job['id']}.f64"]
    with running.client() as client:
        assert client.get(f"/v1/jobs/{job['id']}/result").json()["vertex_distances"]


def test_old_jobs_make_room(make_daemon):
    running = make_daemon("--kept-jobs", 3)
    with running.client() as client:
        pair = [client.upload(shapes.cube(side=side))["id"] for side in (1.0, 2.0)]
        jobs = [client.post("/v1/jobs", json={"type": "deviation", "a": pair[0], "b": pair[1], "bins": bins},
                            headers={"Prefer": WAIT}).json()["id"] for bins in range(1, 8)]
    running.stop()
    running.start()
    with running.client() as client:
        end = time.monotonic() + 30
        while len(list_all(client, "jobs")) > 3:
            assert time.monotonic() < end
            time.sleep(0.05)
        assert [job["id"] for job in list_all(client, "jobs")] == jobs[-3:]
        assert client.get(f"/v1/jobs/{jobs[0]}").status_code == 404
    while {path.stem for path in (running.folder / "data/results").iterdir()} != set(jobs[-3:]):
        assert time.monotonic() < end, "the arrays of removed jobs stay"  # they go after the rows
        time.sleep(0.05)


def test_a_long_search_goes_on_from_its_bounds(make_daemon, slow_files):
    """After a kill -9 the bounds are no lower than those that were stored, and the search does not begin again."""
    running = make_daemon()
    with running.client() as client:
        pair = [client.upload(content)["id"] for content in slow_files]
        job = client.start(*pair, headers={"Cache-Control": "no-cache"}, **SLOW)["id"]
        before = wait_for_parts(client, job, lambda progress: True)["progress"]
        # Of the rounds since then at least one is stored.
        wait_for_parts(client, job, lambda progress: progress["iterations"] > 2 * before["iterations"])
    running.stop(signal.SIGKILL)
    running.start()
    with running.client() as client:
        after = wait_for_parts(client, job, lambda progress: True)["progress"]
        assert client.delete(f"/v1/jobs/{job}").status_code == 202
        result = client.wait(job)["result"]
        events = client.events(job)
    first = next(event for event in split_runs(events)[1] if event["event"] == "bounds")
    assert before["lower"] <= first["lower"] <= SLOW_DISTANCE <= first["upper"] <= before["upper"]
    assert first["iterations"] >= before["iterations"] and "parts" in first
    assert first["lower"] <= after["lower"] <= result["lower"] <= SLOW_DISTANCE <= result["upper"] <= after["upper"]
    assert result["iterations"] >= after["iterations"]


def wait_for_parts(client, job, holds):
    """The document of a job whose search goes on in parts, once its progress is such that holds(progress)."""
    end = time.monotonic() + PATIENCE
    while True:
        document = client.get(f"/v1/jobs/{job}").json()
        assert document["state"] in ("queued", "running"), document
        if "parts" in document.get("progress", {}) and holds(document["progress"]):
            return document
        assert time.monotonic() < end, document
        time.sleep(0.02)
