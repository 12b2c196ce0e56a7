"""State that survives the end of the daemon, by a signal to stop or a kill, and how it starts and stops."""
import contextlib
import json
import os
import pathlib
import resource
import shutil
import signal
import sqlite3
import subprocess
import tempfile
import threading
import time

import pytest

import shapes
from conftest import BUILD, PATIENCE, SLOW, WAIT, Daemon, check_bounds, check_problem, split_runs


def fill(client):
    """Two meshes and a finished job over them."""
    pair = [client.upload(shapes.sphere(turn), name="sphere")["id"] for turn in (0.0, shapes.SPHERE_TURN)]
    return pair, client.hausdorff(*pair)


def check_restored(running, meshes, pair, job, events):
    """Everything is there as it was, and in use again."""
    with running.client() as client:
        assert client.get("/v1/meshes").json() == meshes
        assert client.get(f"/v1/jobs/{job['id']}").json() == job
        assert client.events(job["id"]) == events
        again = client.hausdorff(*pair)
        assert again["cached"] is True and again["result"] == job["result"]
        # The raw bytes are back too: a new job reads the meshes from them.
        new = client.hausdorff(*pair, headers={"Cache-Control": "no-cache"})["result"]
        assert (new["lower"], new["upper"]) == (job["result"]["lower"], job["result"]["upper"])
        same = client.post("/v1/meshes", params={"name": "sphere"}, content=shapes.ply_little(shapes.sphere()))
        assert same.status_code == 200 and same.json()["id"] == pair[0]


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_meshes_and_jobs_come_back(make_daemon, how):
    running = make_daemon()
    with running.client() as client:
        pair, job = fill(client)
        job, events = client.get(f"/v1/jobs/{job['id']}").json(), client.events(job["id"])
        meshes = client.get("/v1/meshes").json()
    assert running.stop(how) == (-signal.SIGKILL if how == signal.SIGKILL else 0)
    running.start()
    check_restored(running, meshes, pair, job, events)


def read_some(client, job, **query):
    """The first three events of a job that runs."""
    with client.stream("GET", f"/v1/jobs/{job}/events", params=query) as reply:
        events = []
        for line in reply.iter_lines():
            events.append(json.loads(line))
            if len(events) == 3:
                return events


def wait_until_stored(running, seq):
    """Reads the store, which alone has this state."""
    end = time.monotonic() + PATIENCE
    with contextlib.closing(sqlite3.connect(f"file:{running.folder}/data/quadmeshd.sqlite?mode=ro", uri=True)) as store:
        while not store.execute("SELECT 1 FROM job_events WHERE seq = ?", [seq]).fetchone():
            assert time.monotonic() < end, "the event is not stored"
            time.sleep(0.02)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_unfinished_jobs_run_again(make_daemon, slow_files, how):
    """What a reader heard of a run stays readable, and every run has higher numbers than the one before."""
    running = make_daemon("--workers", 1, "--grace", 0)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
        point = client.upload(b"0 0 0\n1 1 1\n", format="xyz")["id"]
        first = client.start(*slow, deadline_ms=50 * PATIENCE, **SLOW)
        second = client.start(point, point)
    seen = []
    for run in range(2):
        with running.client() as client:
            seen.append(read_some(client, first["id"], after=seen[-1][-1]["seq"] if seen else 0))
        if how == signal.SIGKILL:
            # What was read may all be of the run before, when that was fast.
            for seq in (seen[-1][-1]["seq"], run * 1000000000 + 1):
                wait_until_stored(running, seq)
        running.stop(how)
        running.start()
    with running.client() as client:
        events = client.events(first["id"])
        runs = split_runs(events)
        assert [run[0]["seq"] for run in runs] == [1, 1000000001, 2000000001]
        assert [run[0]["event"] for run in runs] == ["bounds", "server_restart", "server_restart"]
        # The reader went on in the second run where the first had ended, and was not there in the third.
        assert runs[0][:3] == seen[0] and [*runs[0][3:], *runs[1]][:3] == seen[1]
        # Who was cut off goes on with what it had, and one that had more than is stored gets all of the next run.
        for after in (0, 2, seen[0][-1]["seq"], 999, 1000000001, seen[1][-1]["seq"]):
            assert client.events(first["id"], after=after) == [event for event in events if event["seq"] > after]
        assert client.events(first["id"], after=3000000001) == runs[-1]
        for job in (first, second):
            done = client.wait(job["id"])
            assert done["state"] == "succeeded"
            check_bounds(client.events(job["id"]), done["result"])


def kill_while_running(running, job, how=signal.SIGKILL):
    with running.client() as client:
        client.wait_until_running(job)
    running.stop(how)
    running.start()


def test_a_job_that_kills_the_daemon_is_given_up(make_daemon, slow_files):
    """After three starts. One that was interrupted in order has not killed it."""
    running = make_daemon("--grace", 0)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
        job = client.start(*slow, **SLOW)["id"]
    for how in (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGKILL, signal.SIGKILL):
        kill_while_running(running, job, how)
    kill_while_running(running, job)
    with running.client() as client:
        document = client.wait(job)
        assert document["state"] == "failed" and document["problem"]["code"] == "internal"
        assert "killed 3 times" in document["problem"]["detail"]
        events = client.events(job)
        assert events[-1]["event"] == "error" and split_runs(events)
        assert f"job {job} is given up" in running.log()
        # The same request is another job.
        assert client.start(*slow, **SLOW)["id"] != job


def test_a_job_that_kills_the_daemon_takes_no_other_with_it(make_daemon, slow_files):
    """The last run of each begins alone: who is killed then is the one that runs."""
    running = make_daemon("--grace", 0, "--workers", 2)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
        jobs = [client.start(*slow, **SLOW | {"tolerance": SLOW["tolerance"] * (1 + k)})["id"] for k in range(3)]

    def states():
        with running.client() as client:
            return [client.get(f"/v1/jobs/{job}").json()["state"] for job in jobs]

    def wait_for(expected):
        end = time.monotonic() + PATIENCE
        while (found := states()) != expected:
            assert time.monotonic() < end, found
            time.sleep(0.02)

    for _ in range(2):
        wait_for(["running", "running", "running"])
        running.stop(signal.SIGKILL)
        running.start()
    wait_for(["running", "queued", "queued"])
    time.sleep(1)
    assert states() == ["running", "queued", "queued"]
    running.stop(signal.SIGKILL)
    running.start()
    wait_for(["failed", "running", "queued"])
    with running.client() as client:  # the second one is not the cause: it lives on, and so do those after it
        client.delete(f"/v1/jobs/{jobs[1]}")
        assert client.wait(jobs[1])["state"] == "canceled"
    wait_for(["failed", "canceled", "running"])


def test_a_deleted_mesh_stays_deleted(make_daemon):
    running = make_daemon()
    with running.client() as client:
        (kept, gone), _ = fill(client)
        client.delete(f"/v1/meshes/{gone}")
    running.stop(signal.SIGKILL)
    running.start()
    with running.client() as client:
        assert [mesh["id"] for mesh in client.get("/v1/meshes").json()["meshes"]] == [kept]


def test_killed_while_clients_upload(make_daemon):
    """Whatever was answered with 201 is there afterwards, and nothing half."""
    running = make_daemon()
    answered = []

    def upload():
        with running.client() as client:
            try:
                for k in range(10_000):
                    answered.append(client.upload(shapes.cube(side=1 + k))["id"])
            except Exception:  # the daemon is gone: in whatever way, that is how the test ends
                pass

    thread = threading.Thread(target=upload)
    thread.start()
    while len(answered) < 20:
        time.sleep(0.01)
    running.stop(signal.SIGKILL)
    thread.join()
    running.start()
    with running.client() as client:
        for mesh in answered:
            assert client.get(f"/v1/meshes/{mesh}").status_code == 200
            assert client.hausdorff(mesh, mesh)["result"]["lower"] == 0
    assert running.stop() == 0
    assert not [path for path in (running.folder / "data" / "incoming").rglob("*") if path.is_file()]


def test_sigterm_drains(make_daemon, slow_files):
    """A running job gets its grace time, its stream gets an event, and the daemon exits with status 0."""
    running = make_daemon("--grace", 1)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
        job = client.start(*slow, **SLOW)
        heard = []
        with client.stream("GET", f"/v1/jobs/{job['id']}/events", headers={"Accept": "application/x-ndjson"}) as reply:
            lines = reply.iter_lines()
            heard.append(next(lines))
            start = time.monotonic()
            running.process.send_signal(signal.SIGTERM)
            heard += list(lines)
        assert running.stop() == 0
        assert 0.5 < time.monotonic() - start < PATIENCE / 2
    assert '"event":"server_shutdown"' in heard[-1]


def test_sigterm_lets_short_jobs_end(make_daemon, slow_files):
    running = make_daemon("--grace", 30)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
        job = client.start(*slow, deadline_ms=1500, **SLOW)
        with client.stream("GET", f"/v1/jobs/{job['id']}/events", headers={"Accept": "application/x-ndjson"}) as reply:
            lines = reply.iter_lines()
            next(lines)
            running.process.send_signal(signal.SIGTERM)
            last = list(lines)[-1]
        assert '"event":"result"' in last
        assert running.stop() == 0
    running.start()
    with running.client() as client:
        assert client.get(f"/v1/jobs/{job['id']}").json()["state"] == "succeeded"


def test_a_client_cancel_outlives_the_stop(make_daemon, slow_files):
    running = make_daemon("--grace", 0)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
        job = client.start(*slow, **SLOW)
        while client.get(f"/v1/jobs/{job['id']}").json()["state"] == "queued":
            time.sleep(0.01)
        assert client.delete(f"/v1/jobs/{job['id']}").status_code == 202
        assert running.stop() == 0
    running.start()
    with running.client() as client:
        assert client.wait(job["id"])["state"] == "canceled"


# ---- starting ----


def run(*arguments):
    return subprocess.run([BUILD / "quadmeshd", *map(str, arguments)], capture_output=True, text=True, timeout=PATIENCE)


def test_help_and_version():
    assert run("--help").returncode == 0 and "--data-dir" in run("--help").stdout
    assert run("--version").stdout.startswith("quadmeshd ")


@pytest.mark.parametrize("arguments", [("--no-such", "1"), ("--port",), ("--port", "x"), ("--port", "70000"),
                                       ("--workers", "0"), ("--listen", "0.0.0.0"), ("--log-format", "xml")])
def test_bad_settings_are_usage_errors(arguments):
    done = run(*arguments)
    assert done.returncode == 2 and done.stderr.startswith("quadmeshd: ")


def test_one_daemon_a_folder(make_daemon):
    running = make_daemon()
    second = run("--port", 0, "--data-dir", running.folder / "data")
    assert second.returncode == 1
    with running.client() as client:
        assert client.get("/healthz").status_code == 200


def test_a_folder_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("")
    assert run("--port", 0, "--data-dir", tmp_path / "file" / "data").returncode == 1


def test_a_port_that_is_taken(make_daemon, tmp_path):
    assert run("--port", make_daemon().port, "--data-dir", tmp_path / "other").returncode == 1


def test_readiness_ends_with_the_drain(make_daemon, slow_files):
    """While the last job gets its grace, connections that are open hear that the daemon takes nothing new."""
    running = make_daemon("--grace", 3)
    with running.client() as client:
        slow = [client.upload(content)["id"] for content in slow_files]
        client.wait_until_running(client.start(*slow, deadline_ms=2000, **SLOW)["id"])
        running.process.send_signal(signal.SIGTERM)
        time.sleep(0.3)
        reply = client.get("/readyz")
        check_problem(reply, 503)
        check_problem(client.post("/v1/jobs", json={"type": "hausdorff", "a": slow[0], "b": slow[1]}), 503)
        check_problem(client.post("/v1/meshes", content=b"0 0 0\n"), 503)
    assert running.stop() == 0


def test_a_second_sigterm_changes_nothing(make_daemon):
    """Signals come at any instant of the end, the last ones included."""
    for _ in range(10):
        running = make_daemon()
        while running.process.poll() is None:
            running.process.send_signal(signal.SIGTERM)
            time.sleep(0.0005)
        assert running.process.wait() == 0


def test_a_full_disk_refuses_and_the_daemon_lives(make_daemon):
    """Files that may not grow any more stand for it. Reading goes on, and so does writing when there is room again."""
    running = make_daemon("--log-level", "error")
    with running.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        kept = client.hausdorff(mesh, mesh)
        resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
        for side in range(2, 5):
            content = shapes.ply_little(shapes.rough(100, seed=side))
            check_problem(client.post("/v1/meshes", content=content), 503, "unavailable")
        assert client.get(f"/v1/jobs/{kept['id']}").json() == kept
        assert not any((running.folder / "data/incoming").iterdir())
        # Nor does the database grow.
        resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))
        refused = client.post("/v1/jobs", json={"type": "project", "mesh": mesh, "points": []})
        check_problem(refused, 503, "unavailable")
        check_problem(client.post("/v1/meshes", content=shapes.obj(shapes.cube(side=5.5))), 503, "unavailable")
        resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        assert client.upload(shapes.rough(100, seed=9))["id"]
        assert client.hausdorff(mesh, mesh, tolerance=0.5)["state"] == "succeeded"


# ---- a folder that may only be read ----


@pytest.fixture
def plain_folder():
    """A folder of a daemon that does not run as root, since root may write everywhere."""
    folder = pathlib.Path(tempfile.mkdtemp(prefix="quadmeshd-"))
    user = {"user": 65534, "group": 65534} if os.getuid() == 0 else {}
    if user:
        os.chown(folder, 65534, 65534)
    yield folder, user
    shutil.rmtree(folder)


def test_a_folder_that_may_only_be_read(plain_folder):
    folder, user = plain_folder
    folder.chmod(0o555)
    done = subprocess.run([BUILD / "quadmeshd", "--port", "0", "--data-dir", folder / "data"], capture_output=True,
                          text=True, timeout=PATIENCE, **user)
    assert done.returncode == 1
    assert "data folder: " in done.stderr and "Permission denied" in done.stderr, done.stderr


def test_a_folder_that_becomes_read_only(plain_folder):
    """What is there is read and computed with; what has to be written is refused with words, until it can be."""
    folder, user = plain_folder
    running = Daemon(folder, "--log-level", "error", **user)
    with running.client() as client:
        pair = [client.upload(shapes.cube(side=side))["id"] for side in (1.0, 2.0)]
        folders = [path for path in (folder / "data").rglob("*") if path.is_dir()]
        for path in folders:
            path.chmod(0o555)
        check_problem(client.post("/v1/meshes", content=shapes.obj(shapes.cube(side=3.0))), 503, "unavailable")
        failed = client.post("/v1/jobs", json={"type": "deviation", "a": pair[0], "b": pair[1]},
                             headers={"Prefer": WAIT}).json()
        assert failed["state"] == "failed" and failed["problem"]["code"] == "unavailable"
        assert client.get(f"/v1/meshes/{pair[0]}/content?format=obj").status_code == 200
        assert client.get("/readyz").status_code == 200
        for path in folders:
            path.chmod(0o755)
        assert client.upload(shapes.cube(side=3.0))["id"]
    assert "Permission denied" in running.log()
    assert running.stop() == 0
