"""Points of failure by name (server/base/failpoint.h), which the daemon of a build for tests has.

Each step that a small load has the store do is cut off before its commit, after it, and in the long form also before anybody
is told; nothing is lost, done twice or left behind. And a job kills its nodes (T15).
"""
import concurrent.futures
import os
import subprocess
import time

import pytest

import at_rest
import checkers
import shapes
from api_conftest import BUILD, PATIENCE, ROOT
from faults import SEED, choose, start_slow, upload_slow
from load import Client, Load
from test_kills import age

STEPS = ("put_mesh", "revise_mesh", "submit_job", "put_array", "finish_job", "edit_layout", "put_layout", "put_reconstruction",
         "delete_mesh")
# Between a blob and its row.
BLOBS = ["keep_blob.reply:kill"]
KILLS = [f"{step}.{place}:kill" for step in STEPS for place in choose(("before", "after"), ("before", "after", "reply"))]


def fail_at(point, file=None):
    """The arguments of a daemon that fails there; with a file, once there is one."""
    return {"env": {**os.environ, "QM_FAILPOINT": point + (f"@{file}" if file else "")}}


def test_only_builds_for_tests_have_them():
    assert b"failpoint" in (BUILD / "quadmeshd").read_bytes().lower()
    assert b"failpoint" not in (ROOT / "build/quadmeshd").read_bytes().lower()


def test_a_point_that_there_cannot_be_is_refused(make_cluster):
    (node,) = make_cluster(1, store="embedded").nodes
    assert node.stop() == 0
    for text in ("put_mesh:kill", "put_mesh.before", "put_mesh.before:explode"):
        with pytest.raises(AssertionError, match="QM_FAILPOINT=" + text):
            node.start(**fail_at(text))
    node.start(**fail_at(""))


def test_a_daemon_sleeps_and_stops(make_cluster):
    (node,) = make_cluster(1, store="embedded").nodes
    assert node.stop() == 0
    node.start(**fail_at("put_mesh.before:sleep"))
    with node.client() as client:
        start = time.monotonic()
        client.upload(shapes.cube(side=2))
        assert time.monotonic() - start >= 2
    assert node.stop() == 0
    node.start(**fail_at("put_mesh.reply:stop"))
    with node.client() as client, concurrent.futures.ThreadPoolExecutor(1) as pool:
        uploading = pool.submit(client.upload, shapes.cube(side=3))
        while open(f"/proc/{node.pid}/stat", encoding="ascii").read().rsplit(")", 1)[1].split()[0] != "T":
            assert not uploading.done()
            time.sleep(0.01)
        node.resume()
        assert uploading.result()["revision"] == 0


def sweep(cluster, points):
    """Uses everything once for each point, which must be met."""
    (node,) = cluster.nodes
    load = Load(cluster, SEED)
    client = Client(load, "one", SEED)
    file = node.folder / "armed"
    assert node.stop() == 0
    node.start(**fail_at(points[0], file))
    for point, next_point in zip(points, [*points[1:], ""]):
        file.touch()
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            using = pool.submit(client.use_everything)
            while f"failpoint {point.replace(':', ': ')}" not in node.daemon.log():
                assert not using.done(), f"{point} was not met"
                time.sleep(0.01)
            file.unlink()
            if point.endswith(":kill"):
                node.note_kill()
            else:
                using.result(PATIENCE)
                assert node.stop() == 0
            node.start(**fail_at(next_point, file if next_point else None))
            using.result(PATIENCE)
    load.ended = load.is_over = True
    load.check()


def blobs_of(folder):
    return {path.name for path in (folder / "blobs").rglob("*") if path.is_file()}


@pytest.mark.timeout(600)
def test_a_daemon_alone_is_killed_at_each_step(make_cluster):
    cluster = make_cluster(1, store="embedded")
    sweep(cluster, BLOBS + KILLS)
    (node,) = cluster.nodes
    assert node.stop() == 0
    age(node.folder / "data")
    node.start()  # which sweeps
    assert node.stop() == 0
    checked = subprocess.run([BUILD / "quadmeshd", "--data-dir", node.folder / "data", "--check"], capture_output=True, text=True)
    assert checked.returncode == 0 and checked.stdout.endswith(" 0 faults, 0 repaired; 0 files without a mesh\n"), checked.stdout


@pytest.mark.timeout(600)
def test_a_node_is_killed_at_each_step_or_its_answer_is_lost(make_cluster):
    cluster = make_cluster(1)
    lost = [f"{step}.after:drop" for step in STEPS]
    sweep(cluster, [*BLOBS, "keep_blob.before:kill", *choose(KILLS[::2], KILLS), *choose(lost[::3], lost)])
    (node,) = cluster.nodes
    assert node.stop() == 0
    node.start()  # which cleans at once

    def finds_rest():
        return not checkers.check_rest(at_rest.read_tables(cluster.query))
    cluster.wait_for("the cleaner", finds_rest)


@pytest.mark.parametrize("store", ["embedded", "postgres"])
def test_a_cancelation_outlives_a_kill(make_cluster, slow_files, store):
    """It was answered, and the job had not ended yet."""
    cluster = make_cluster(1, store=store)
    (node,) = cluster.nodes
    pair = upload_slow(cluster, slow_files)
    assert node.stop() == 0
    node.start(**fail_at("finish_job.before:sleep"))
    with node.client() as client:
        job = start_slow(node, pair, 1000)
        cluster.wait_for("bounds", lambda: client.get(f"/v1/jobs/{job}").json().get("progress"))
        assert client.delete(f"/v1/jobs/{job}").status_code == 202
        assert client.get(f"/v1/jobs/{job}").json()["state"] == "running"
    node.kill()
    node.start()
    with node.client() as client:
        assert client.wait(job)["state"] == "canceled"


@pytest.mark.timeout(300)
def test_a_job_that_kills_its_nodes_is_given_up(make_cluster, slow_files):
    """T15: three deaths, and the others live. Only a search that takes long has parts."""
    cluster = make_cluster(3)
    for node in cluster.nodes:
        assert node.stop() == 0
        node.start(**fail_at("open_parts.before:kill"))
    pair = upload_slow(cluster, slow_files)
    with Load(cluster, SEED, others=False) as load:
        job = start_slow(cluster.nodes[0], pair, 1000)
        load.jobs[job] = {"type": "slow"}
        for _ in range(3):
            dead = cluster.wait_for("a death", lambda: [node for node in cluster.nodes if node.daemon.process.poll() is not None])
            assert len(dead) == 1
            dead[0].note_kill()
            dead[0].start()  # the second start of a name declares the first one dead
        with cluster.nodes[0].client() as client:
            document = client.wait(job)
            assert document["state"] == "failed" and document["problem"]["detail"], document
            assert client.events(job)[-1]["event"] == "error"
    load.check()
    assert all(node.daemon.process.poll() is None for node in cluster.nodes)
