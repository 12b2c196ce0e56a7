"""A real daemon for every test: started on a free port, stopped with SIGTERM, its log searched for findings."""
import concurrent.futures
import json
import os
import pathlib
import signal
import subprocess
import time
import uuid

import httpx
import pytest

import shapes

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = ROOT / os.environ.get("QM_BUILD", "build")
DATA = pathlib.Path(os.environ.get("QM_TEST_DATA", ROOT / "../shared/data"))
# What is about the folder of collected meshes is there when the folder is, and what needs a database when a server is.
collect_ignore = [] if DATA.is_dir() else ["test_collection.py", "test_plans.py"]
if not os.environ.get("QM_TEST_POSTGRES"):
    collect_ignore += ["test_moving.py", "test_two_nodes.py"]
# Seconds. Sanitized builds need several times the time of a release; 600 are what the daemon would wait for at most.
PATIENCE = float(os.environ.get("QM_PATIENCE", 60))
WAIT = f"wait={PATIENCE:.0f}"
FINDINGS = ("ERROR: AddressSanitizer", "ERROR: LeakSanitizer", "WARNING: ThreadSanitizer", "runtime error:")


# With QM_TEST_STORE=shared each daemon has a database of its own, on the server of QM_TEST_POSTGRES, for its store; with
# QM_TEST_STORE=folder a folder of its own for the blobs as well.
STORE = os.environ.get("QM_TEST_STORE", "")
IS_SHARED = STORE in ("shared", "folder")


def make_database():
    """The address of a new database."""
    server, name = os.environ["QM_TEST_POSTGRES"], "api_" + uuid.uuid4().hex
    subprocess.run(["psql", "-q", "-X", server, "-c", f"CREATE DATABASE {name}"], check=True)
    return server.rpartition("/")[0] + "/" + name


def is_ready(url):
    """Whether a daemon answers so now."""
    try:
        # No certificates to load, which would take longer than the answer.
        return httpx.get(url + "/readyz", timeout=PATIENCE, verify=False).status_code == 200
    except httpx.TransportError:
        return False


class Daemon:
    """One process of quadmeshd over a data folder that may outlive it."""
    build = BUILD

    def __init__(self, folder, *settings, **user):
        """user may have the ids `user` and `group` of whom it runs as."""
        self.folder = pathlib.Path(folder)
        self.settings = settings
        self.user = user
        self.store = ["--store", make_database()] if IS_SHARED else []
        if STORE == "folder":
            (self.folder / "blobs").mkdir()
            self.store += ["--blobs", self.folder / "blobs"]
        self.log_path = self.folder / "log"
        self.start()

    def start(self):
        port_file = self.folder / "port"
        port_file.unlink(missing_ok=True)
        with open(self.log_path, "ab") as log:
            self.process = subprocess.Popen(
                [self.build / "quadmeshd", "--port", "0", "--port-file", port_file, "--data-dir", self.folder / "data",
                 *self.store, *map(str, self.settings)], stdout=log, stderr=log, **self.user)
        end = time.monotonic() + PATIENCE
        while not self._is_ready(port_file):
            assert self.process.poll() is None, f"the daemon ended at once:\n{self.log()}"
            assert time.monotonic() < end, f"the daemon is not ready:\n{self.log()}"
            time.sleep(0.02)

    def _is_ready(self, port_file):
        text = port_file.read_text() if port_file.exists() else ""
        if not text.endswith("\n"):
            return False
        self.port = int(text)
        self.url = f"http://127.0.0.1:{self.port}"
        return is_ready(self.url)

    def log(self):
        return self.log_path.read_text(errors="replace")

    def stop(self, how=signal.SIGTERM):
        """Ends the process and returns its exit status, once its log is known to hold no findings."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        status = self.process.wait(PATIENCE)
        log = self.log()
        assert not any(finding in log for finding in FINDINGS), log
        return status

    def client(self):
        return Client(base_url=self.url, timeout=PATIENCE + 10, verify=False)  # plain HTTP: no certificates to load


class MetCodes:
    """The codes of all problems that any test of the run has met: an empty file for each, as several processes may share the run.
    test_description.py looks at them last; runs of other folders keep none."""
    folder = None

    def add(self, code):
        if self.folder:
            (self.folder / str(code)).touch()

    def read(self):
        return {file.name for file in self.folder.iterdir()}


MET_CODES = MetCodes()


@pytest.fixture(scope="session", autouse=True)
def folder_of_codes(tmp_path_factory):
    base = tmp_path_factory.getbasetemp()
    MET_CODES.folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "problem-codes"
    MET_CODES.folder.mkdir(exist_ok=True)


def note_problem(reply):
    if reply.headers.get("content-type") == "application/problem+json" and reply.request.method != "HEAD":
        reply.read()
        MET_CODES.add(reply.json().get("code"))


def pytest_collection_modifyitems(items):
    """What looks back at the whole run comes last, and only after a whole run."""
    last = [item for item in items if item.get_closest_marker("looks_back")]
    items[:] = [item for item in items if item not in last]
    files = {path.name for path in pathlib.Path(__file__).parent.glob("test_*.py")}
    if {item.path.name for item in items} >= files:
        items += last


class Client(httpx.Client):
    """The calls that many tests make."""

    def __init__(self, **settings):
        super().__init__(event_hooks={"response": [note_problem]}, **settings)

    def upload(self, content, **query):
        """The resource of an uploaded mesh; content is a mesh of shapes.py or the bytes of a file."""
        return self.check_mesh(self.post_mesh(content, **query))

    def post_mesh(self, content, **query):
        data = content if isinstance(content, bytes) else shapes.ply_little(content)
        return self.post("/v1/meshes", params=query, content=data)

    @staticmethod
    def check_mesh(reply):
        assert reply.status_code in (200, 201), reply.text
        return reply.json()

    def hausdorff(self, a, b, headers=(), **request):
        """Runs a job to its end and returns its document."""
        reply = self.post("/v1/jobs", json={"type": "hausdorff", "a": a, "b": b, **request},
                          headers={"Prefer": WAIT, **dict(headers)})
        assert reply.status_code == 200, reply.text
        return reply.json()

    def start(self, a, b, headers=(), **request):
        """Starts a job and returns its document at once."""
        reply = self.post("/v1/jobs", json={"type": "hausdorff", "a": a, "b": b, **request}, headers=dict(headers))
        assert reply.status_code == 202, reply.text
        return reply.json()

    def wait_until_running(self, job_id):
        end = time.monotonic() + PATIENCE
        while (state := self.get(f"/v1/jobs/{job_id}").json()["state"]) == "queued":
            assert time.monotonic() < end, "the job does not start"
            time.sleep(0.01)
        assert state == "running", state

    def wait_for_progress(self, job_id):
        """The document of a running job once it has its first bounds, or stage."""
        end = time.monotonic() + PATIENCE
        while "progress" not in (document := self.get(f"/v1/jobs/{job_id}").json()):
            assert time.monotonic() < end, "the job has no progress"
            time.sleep(0.01)
        return document

    def wait(self, job_id):
        reply = self.get(f"/v1/jobs/{job_id}", headers={"Prefer": WAIT})
        assert reply.status_code == 200, reply.text
        assert reply.json()["state"] not in ("queued", "running"), reply.text
        return reply.json()

    def events(self, job_id, **query):
        reply = self.get(f"/v1/jobs/{job_id}/events", params=query, headers={"Accept": "application/x-ndjson"})
        assert reply.status_code == 200, reply.text
        return ndjson(reply.text)


def together(count, work):
    """What work gives for 0 to count - 1, all at the same time."""
    with concurrent.futures.ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, range(count)))


def ndjson(text):
    """The events of a stream without its heartbeats."""
    events = [json.loads(line) for line in text.splitlines()]
    return [event for event in events if event["event"] != "heartbeat"]


def gauge(client, name):
    """The value of a metric."""
    for line in client.get("/metrics").text.splitlines():
        if line.startswith(f"quadmeshd_{name} "):
            return float(line.split()[1])
    raise AssertionError(f"there is no metric {name}")


def check_problem(reply, status, code=None):
    """A refusal is a complete problem document that reveals no internals."""
    assert reply.status_code == status, reply.text
    assert reply.headers["content-type"] == "application/problem+json"
    problem = reply.json()
    assert problem["status"] == status
    assert problem["type"] and problem["title"] and problem["detail"]
    if code:
        assert problem["code"] == code, problem
    assert "/tmp" not in reply.text and "0x" not in reply.text
    return problem


def split_runs(events):
    """A job's events by run: each after the first begins with a server_restart and counts from a thousand million on."""
    starts = [0] + [place for place, event in enumerate(events) if event["event"] == "server_restart"]
    runs = [events[start:end] for start, end in zip(starts, [*starts[1:], len(events)])]
    runs = runs if runs[0] else runs[1:]
    for run in runs:
        first = run[0]["seq"]
        assert first % 10**9 == 1 and [event["seq"] for event in run] == list(range(first, first + len(run))), run
    assert events == sorted(events, key=lambda event: event["seq"])
    return runs


def check_bounds(events, result):
    """Bounds never move the wrong way within a run, seq counts on, and one terminal event is the last."""
    for run in split_runs(events):
        lower, upper = 0.0, float("inf")
        for event in run:
            bounds = event.get("result") or event
            if "lower" not in bounds:
                continue
            new_upper = float("inf") if bounds["upper"] is None else bounds["upper"]
            assert lower <= bounds["lower"] <= new_upper <= upper, event
            lower, upper = bounds["lower"], new_upper
    terminal = [event for event in events if event["event"] in ("result", "error")]
    assert terminal == events[-1:]
    if result is not None:
        assert events[-1]["result"] == result


@pytest.fixture(scope="session")
def daemon(tmp_path_factory):
    """One daemon for all tests that need nothing special of it."""
    running = Daemon(tmp_path_factory.mktemp("daemon"))
    yield running
    assert running.stop() == 0, running.log()


@pytest.fixture
def client(daemon):
    with daemon.client() as made:
        yield made
    assert daemon.process.poll() is None, daemon.log()


@pytest.fixture
def make_daemon(tmp_path):
    """Daemons of a test's own: make_daemon("--setting", value, ...)."""
    made = []

    def make(*settings):
        folder = tmp_path / f"daemon{len(made)}"
        folder.mkdir()
        made.append(Daemon(folder, *settings))
        return made[-1]

    yield make
    for running in made:
        if running.process.poll() is None:
            assert running.stop() == 0, running.log()


@pytest.fixture
def make_node(request, tmp_path):
    """Daemons of a test's own on a database that outlives them: make_node("name", address, ...)."""
    def make(name, store, *settings):
        (tmp_path / name).mkdir()
        node = Daemon(tmp_path / name, "--store", store, "--node-name", name, *settings)
        request.addfinalizer(lambda: node.stop(signal.SIGKILL))
        return node
    return make


@pytest.fixture(scope="session")
def spheres(daemon):
    """The ids of the sphere and of the same sphere turned by half a quad."""
    with daemon.client() as made:
        return (made.upload(shapes.sphere(), name="sphere_a")["id"],
                made.upload(shapes.sphere(shapes.SPHERE_TURN), name="sphere_b")["id"])


SLOW = {"quads": "bilinear", "tolerance": 1e-12}
SLOW_DISTANCE = 1 / 512


@pytest.fixture(scope="session")
def slow_files():
    """Two heaps of folded patches, one the other raised by SLOW_DISTANCE and cut by another grid: every point of the one
    is so near to the other, those of the flat square no nearer, and to prove it for the folds takes many minutes."""
    heap = shapes.crumpled(1500, seed=1)
    raised = shapes.moved(shapes.cut(heap, 3), 0, 0, SLOW_DISTANCE)
    return shapes.ply_little(shapes.cut(heap, 2)), shapes.ply_little(raised)


@pytest.fixture(scope="session")
def slow_pair(daemon, slow_files):
    with daemon.client() as made:
        return tuple(made.upload(content)["id"] for content in slow_files)
