"""A control group of 1 GB and a hostile mix: the daemon lives, its memory stays within the budget and the stated reserve,
and it answers right in between and afterwards. QM_TEST_LONG=1 takes ten minutes of it."""
import contextlib
import gzip
import os
import pathlib
import random
import struct
import threading
import time

import httpx
import pytest

import shapes
from api_conftest import PATIENCE, ROOT, Daemon
from test_memory import resident, wide_glb

SECONDS = 600 if os.environ.get("QM_TEST_LONG", "0") != "0" else 20
GROUP_BYTES = 1 << 30
RESERVE = 256 << 20  # README: what is not counted by the budget
SEED = int(os.environ.get("QM_TEST_SEED", random.randrange(1 << 30)))


class Released(Daemon):
    """Sanitizers keep what was freed, to find late uses."""
    build = ROOT / "build"


@pytest.fixture
def group():
    """A control group of this size, of version 1 or 2; None where this user, or this container, cannot make one."""
    root = pathlib.Path("/sys/fs/cgroup")
    old = (root / "memory").is_dir()
    folder = (root / "memory" if old else root) / f"quadmeshd-test-{os.getpid()}"
    try:
        folder.mkdir()
        (folder / ("memory.limit_in_bytes" if old else "memory.max")).write_text(str(GROUP_BYTES))
    except OSError as problem:
        print(f"there is no control group, only the budget: {problem}")
        with contextlib.suppress(OSError):
            folder.rmdir()
        yield None
        return
    yield folder
    for _ in range(100):  # its last process may not be gone yet
        with contextlib.suppress(OSError):
            folder.rmdir()
            break
        time.sleep(0.05)


def big_counts(chance):
    count = chance.randrange(1 << 20, 1 << 27)
    return (f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n"
            "property float z\nend_header\n").encode() + bytes(chance.randrange(1 << 20))


def hostile_files():
    """Writers of files that ask for much; each takes a random generator."""
    large = shapes.ply_little(shapes.rough(400, seed=1))
    glb, packed = wide_glb(4_000_000), gzip.compress(b"v 0 0 0\n" * 30_000_000, 1)
    package = shapes.threemf(shapes.rough(200, seed=2))
    crowded = shapes.crowded_glb(150, 200)
    return [lambda chance: large[:chance.randrange(len(large))], lambda chance: large, big_counts, lambda chance: glb,
            lambda chance: packed, lambda chance: package, lambda chance: crowded]


class Mix:
    """Threads that work until the end; what they meet that should not be is in faults."""

    def __init__(self, running):
        self.running, self.faults, self.ends = running, [], threading.Event()
        self.counts = {}

    def run(self, work, seed):
        chance = random.Random(seed)
        with self.running.client() as client:
            while not self.ends.is_set():
                try:
                    self.counts[work.__name__] = self.counts.get(work.__name__, 0) + 1
                    work(client, chance)
                except httpx.TransportError as problem:
                    self.faults.append(f"{work.__name__}: {problem!r}")
                    return
                except Exception as problem:
                    self.faults.append(f"{work.__name__}: {problem!r}")


@pytest.mark.timeout(SECONDS + 300)
def test_a_hostile_mix_in_a_small_group(tmp_path, group):
    print("QM_TEST_SEED =", SEED)
    if group:
        running = Released(tmp_path, preexec_fn=lambda: (group / "cgroup.procs").write_text("0"))
    else:
        running = Released(tmp_path, "--memory-budget", GROUP_BYTES // 2)
    mix, files = Mix(running), hostile_files()
    with running.client() as client:
        limit = client.get("/v1/info").json()["limits"]["memory_bytes"]
        assert limit == GROUP_BYTES // 2, "the budget is half of the group's memory"
        sphere, turned = (client.upload(shapes.sphere(turn))["id"] for turn in (0, shapes.SPHERE_TURN))
        expected = client.hausdorff(sphere, turned, tolerance=1e-6)["result"]

    def upload(client, chance):
        reply = client.post("/v1/meshes", content=chance.choice(files)(chance),
                            params={"name": str(chance.randrange(100)), "ttl_seconds": 20})
        assert reply.status_code in (200, 201, 413, 422, 507), reply.text

    def deform(client, chance):
        body = struct.pack("<d", chance.random()) * (3 * chance.randrange(1 << 20))
        reply = client.patch(f"/v1/meshes/{turned}/vertices", content=body, headers={"If-Match": '"no"'})
        assert reply.status_code in (400, 412, 507), reply.text

    def ask(client, chance):
        kind = chance.choice(["hausdorff", "deviation", "self_collision", "collision"])
        listed = client.get("/v1/meshes", params={"limit": 50, "order": "newest"}).json()["meshes"]
        a, b = (chance.choice(listed)["id"] if chance.random() < 0.7 else sphere for _ in range(2))
        body = {"type": kind, "mesh": a} if kind == "self_collision" else {"type": kind, "a": a, "b": b}
        reply = client.post("/v1/jobs", json={**body, "deadline_ms": chance.randrange(1, 3000)},
                            headers={"Prefer": "wait=5"})
        assert reply.status_code in (200, 202, 404, 422, 429, 507), reply.text

    def query(client, chance):
        points = struct.pack("<3d", 0, 0, 2) * chance.randrange(1, 50_000)
        reply = client.post(f"/v1/meshes/{sphere}/project", content=points)
        assert reply.status_code in (200, 507), reply.text

    def check(client, chance):
        reply = client.post("/v1/jobs", json={"type": "hausdorff", "a": sphere, "b": turned, "tolerance": 1e-6},
                            headers={"Prefer": f"wait={PATIENCE:.0f}", "Cache-Control": "no-cache"})
        document = reply.json()
        if reply.status_code == 507 or (document.get("problem") or {}).get("code") == "out_of_memory":
            return
        result = document["result"]
        assert (result["lower"], result["upper"]) == (expected["lower"], expected["upper"]), result

    threads = [threading.Thread(target=mix.run, args=(work, SEED + k))
               for k, work in enumerate([upload] * 6 + [deform] * 2 + [ask] * 3 + [query] * 2 + [check])]
    for thread in threads:
        thread.start()
    end, most = time.monotonic() + SECONDS, 0
    while time.monotonic() < end and running.process.poll() is None:
        most = max(most, resident(running)[0])
        time.sleep(0.1)
    mix.ends.set()
    for thread in threads:
        thread.join()
    assert running.process.poll() is None, running.log()[-2000:]
    assert mix.faults == []
    most = max(most, resident(running)[1])
    print(f"resident at most {most >> 20} MiB, budget {limit >> 20} MiB; {mix.counts}")
    assert most <= limit + RESERVE, (most, limit)
    with running.client() as client:
        result = client.hausdorff(sphere, turned, tolerance=1e-6)["result"]
        assert (result["lower"], result["upper"]) == (expected["lower"], expected["upper"])
    assert running.stop() == 0
