"""Every allocation of every kind of request fails in turn: the daemon says so or closes, and lives on.

The daemon runs with tests/faults/failing_malloc.c in front of its allocator, so that the allocations of the libraries
fail too, under the sanitizers of the build.
"""
import json
import mmap
import os
import struct
import subprocess

import httpx
import pytest

import shapes
from conftest import BUILD, ROOT, WAIT, Daemon
from test_layouts import saddle_layout

STEP = 1000000 if os.environ.get("QM_TEST_LONG", "0") != "0" else 10
# The replies that a client may get when there is no memory. A mesh that exists is never reported missing.
REFUSALS = {("out_of_memory", 507), ("unavailable", 503)}


class Faults:
    """The numbers that the daemon's allocator shares with this program."""

    def __init__(self, path):
        path.write_bytes(bytes(16))
        with open(path, "r+b") as file:
            self.shared = mmap.mmap(file.fileno(), 16)

    def arm(self, count):
        self.shared[:8] = struct.pack("q", count)

    def disarm(self):
        """True when the allocation came about and failed."""
        failed = struct.unpack("q", self.shared[8:])[0]
        self.shared[:] = bytes(16)
        return failed > 0


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    path = tmp_path_factory.mktemp("faults") / "failing_malloc.so"
    subprocess.run(["cc", "-std=c17", "-D_GNU_SOURCE", "-O2", "-fPIC", "-shared", "-fno-builtin",
                    ROOT / "tests/faults/failing_malloc.c", "-o", path, "-ldl"], check=True)
    return path


@pytest.fixture
def frail(library, tmp_path, monkeypatch):
    """A daemon and the faults of its allocator."""
    faults = Faults(tmp_path / "faults")
    monkeypatch.setenv("FAILING_MALLOC", str(tmp_path / "faults"))
    monkeypatch.setenv("LD_PRELOAD", str(library))
    monkeypatch.setenv("ASAN_OPTIONS", "verify_asan_link_order=0")
    running = Daemon(tmp_path, "--log-level", "error", "--heartbeat", 60)
    for name in ("FAILING_MALLOC", "LD_PRELOAD", "ASAN_OPTIONS"):
        monkeypatch.delenv(name)
    yield running, faults
    faults.disarm()
    assert running.stop() == 0, running.log()


def check_reply(reply):
    """Good, or a refusal with its reason; a stream ends with its terminal event or is cut."""
    if reply.status_code >= 400:
        problem = reply.json()
        assert (problem.get("code", "out_of_memory"), reply.status_code) in REFUSALS, reply.text
    elif reply.headers.get("content-type") == "application/x-ndjson":
        last = json.loads(reply.text.splitlines()[-1])
        assert last["event"] in ("result", "error"), reply.text
        if last["event"] == "error":
            assert last["problem"] is None or last["problem"]["code"] in ("out_of_memory", "unavailable"), last
    elif reply.headers.get("content-type") == "application/json":
        document = reply.json()
        if document.get("state") == "failed":
            assert document["problem"] is None or document["problem"]["code"] in ("out_of_memory", "unavailable")


def places():
    """One after the other, then farther and farther apart."""
    place = 1
    while True:
        yield place
        place += 1 + place // STEP


def fail_each(running, faults, ask):
    """Asks again and again, with another allocation failing each time, until none is left that would."""
    for place in places():
        with running.client() as client:
            try:
                client.get("/healthz")
                faults.arm(place)
                check_reply(ask(client, place))
            except httpx.TransportError:
                pass
            failed = faults.disarm()
        assert running.process.poll() is None, running.log()
        with running.client() as client:
            assert client.get("/healthz").status_code == 200
        if not failed:
            break
    with running.client() as client:
        reply = ask(client, 0)
        assert reply.status_code < 300, reply.text
    assert place > 2


def mesh_of(running, mesh):
    with running.client() as client:
        return client.upload(mesh)["id"]


def test_uploads(frail):
    running, faults = frail
    taken = set()

    def ask(client, place):
        reply = client.post("/v1/meshes", content=shapes.obj(shapes.cube(side=1.0 + place)))
        if reply.status_code == 201:
            taken.add(reply.json()["id"])
        return reply

    fail_each(running, faults, ask)
    with running.client() as client:
        listed = {mesh["id"] for mesh in client.get("/v1/meshes", params={"limit": 1000}).json()["meshes"]}
    assert taken <= listed, "an acknowledged mesh is lost"
    assert not any((running.folder / "data/incoming").iterdir())


@pytest.mark.parametrize("kind", ["hausdorff", "deviation", "collision"])
def test_jobs_of_two_meshes(frail, kind):
    running, faults = frail
    a, b = mesh_of(running, shapes.cube()), mesh_of(running, shapes.cube(side=2.0))
    fail_each(running, faults, lambda client, place: client.post(
        "/v1/jobs", json={"type": kind, "a": a, "b": b, "tolerance": 1e-3 * (1 + place)},
        headers={"Prefer": WAIT, "Cache-Control": "no-cache"}))


@pytest.mark.parametrize("semi_regular", [False, True])
def test_quads_of_a_surface(frail, semi_regular):
    running, faults = frail
    mesh = mesh_of(running, shapes.cut(shapes.cube(), 2))
    fail_each(running, faults, lambda client, place: client.post(
        "/v1/jobs", json={"type": "remesh", "mesh": mesh, "quads": 30, "semi_regular": semi_regular}, headers={"Prefer": WAIT}))
    # Whatever failed on the way, no job names a mesh that is not there.
    with running.client() as client:
        listed = {made["id"] for made in client.get("/v1/meshes", params={"limit": 1000}).json()["meshes"]}
        jobs = client.get("/v1/jobs", params={"type": "remesh", "limit": 1000}).json()["jobs"]
        assert {job["result"]["mesh"] for job in jobs if "result" in job} <= listed


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb"])
def test_texture_coordinates(frail, suffix):
    running, faults = frail
    mesh = mesh_of(running, shapes.saddle(3))
    fail_each(running, faults, lambda client, place: client.get(
        f"/v1/meshes/{mesh}/content", params={"format": suffix, "uv": "patches"}))


def test_streams(frail):
    running, faults = frail
    a, b = mesh_of(running, shapes.cube()), mesh_of(running, shapes.cube(side=2.0))
    fail_each(running, faults, lambda client, place: client.post(
        "/v1/jobs", json={"type": "hausdorff", "a": a, "b": b, "tolerance": 1e-3 * (1 + place)},
        headers={"Accept": "application/x-ndjson"}))


def test_batches(frail):
    running, faults = frail
    a, b = mesh_of(running, shapes.cube()), mesh_of(running, shapes.cube(side=2.0))
    lines = "".join(json.dumps({"key": key, "type": "distance", "a": a, "b": b}) + "\n" for key in range(3))

    def ask(client, place):
        reply = client.post("/v1/batches", content=lines, headers={"Content-Type": "application/x-ndjson"})
        if reply.status_code == 200:
            answers = [json.loads(line) for line in reply.text.splitlines()]
            answers = [answer for answer in answers if answer.get("event") != "heartbeat"]
            # A line that could not be read has no key.
            lost = [answer for answer in answers if answer["key"] is None]
            assert len(lost) <= 1 and all(answer["problem"]["code"] == "out_of_memory" for answer in lost), answers
            keys = {answer["key"] for answer in answers} - {None}
            assert len(answers) == 3 and len(keys) + len(lost) == 3 and keys <= {0, 1, 2}
            reply.headers["content-type"] = "checked"
        return reply

    fail_each(running, faults, ask)


def test_reading(frail):
    running, faults = frail
    mesh = mesh_of(running, shapes.cube())
    for path in (f"/v1/meshes/{mesh}", f"/v1/meshes/{mesh}/content?format=obj", f"/v1/meshes/{mesh}/content?format=glb",
                 f"/v1/meshes/{mesh}/vertices", f"/v1/meshes/{mesh}/patches", "/v1/meshes", "/v1/jobs",
                 "/metrics", "/openapi.yaml"):
        fail_each(running, faults, lambda client, place: client.get(path))


def test_draco(frail):
    running, faults = frail
    mesh = mesh_of(running, shapes.cube())
    with running.client() as client:
        file = client.get(f"/v1/meshes/{mesh}/content?format=drc").content

    def upload(client, place):
        reply = client.post("/v1/meshes", params={"format": "drc", "name": str(place)}, content=file)
        # When a decoder runs out of memory, the file may have needed too much of it.
        if reply.status_code in (413, 422):
            assert reply.json()["code"] in ("malformed_file", "too_large")
            raise httpx.RemoteProtocolError("refused")
        return reply

    fail_each(running, faults, upload)
    fail_each(running, faults, lambda client, place: client.get(f"/v1/meshes/{mesh}/content?format=drc"))


def test_projection(frail):
    running, faults = frail
    mesh = mesh_of(running, shapes.cube())
    fail_each(running, faults, lambda client, place: client.post(f"/v1/meshes/{mesh}/project", content=bytes(240)))


def test_deformation(frail):
    running, faults = frail
    mesh = mesh_of(running, shapes.cube())
    revisions = [0]

    def ask(client, place):
        reply = client.patch(f"/v1/meshes/{mesh}/vertices", json={"indices": [0], "positions": [[0, 0, -1e-3 * place]]})
        if reply.status_code == 200:
            revisions.append(reply.json()["revision"])
        return reply

    fail_each(running, faults, ask)
    assert revisions == sorted(set(revisions))
    with running.client() as client:
        assert client.get(f"/v1/meshes/{mesh}").json()["revision"] == revisions[-1]


def test_layouts(frail):
    running, faults = frail
    mesh = mesh_of(running, shapes.saddle(4))
    fail_each(running, faults, lambda client, place: client.post("/v1/layouts", json={"mesh": mesh, **saddle_layout()}))


def test_a_matrix(frail):
    running, faults = frail
    meshes = [mesh_of(running, shapes.cube(origin=(x, 0, 0))) for x in range(3)]
    fail_each(running, faults, lambda client, place: client.post(
        "/v1/jobs", json={"type": "matrix", "meshes": meshes, "want": {"nearest": 1}, "threads": 1},
        headers={"Prefer": WAIT, "Cache-Control": "no-cache"}))


def test_two_files_in_one_request(frail):
    running, faults = frail
    files = {"a": shapes.ply_little(shapes.cube()), "b": shapes.ply_little(shapes.cube(origin=(1, 0, 0))),
             "options": json.dumps({"type": "hausdorff", "threads": 1}).encode()}
    fail_each(running, faults, lambda client, place: client.post("/v1/compare", files=files))
