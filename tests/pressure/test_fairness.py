"""Shares of the workers: small jobs beside endless ones, clients beside each other, deadlines, equal questions.

No test measures how fast the daemon is: an endless job is still running when the small ones have ended, and shares are
compared with each other."""
import json
import secrets
import threading
import time

import pytest

import shapes
from api_conftest import SLOW, SLOW_DISTANCE, check_problem

ENDED = ("succeeded", "failed", "canceled")


@pytest.fixture
def small_files():
    return shapes.sphere(), shapes.sphere(shapes.SPHERE_TURN)


def upload_all(client, files):
    return [client.upload(content)["id"] for content in files]


def state_of(client, job):
    return client.get(f"/v1/jobs/{job['id']}").json()["state"]


def test_small_jobs_end_beside_endless_ones(make_daemon, slow_files, small_files):
    with make_daemon("--workers", 2).client() as client:
        slow, small = upload_all(client, slow_files), upload_all(client, small_files)
        endless = [client.start(*slow, direction="a_to_b", quads="bilinear", tolerance=1e-12 * (1 + k)) for k in range(5)]
        for job in endless:
            client.wait_until_running(job["id"])
        for k in range(12):
            done = client.hausdorff(*small, tolerance=1e-6 * (1 + k))
            assert done["state"] == "succeeded" and "cached" not in done
        done = client.post("/v1/jobs", json={"type": "self_collision", "mesh": small[0]}, headers={"Prefer": "wait=60"})
        assert done.json()["state"] == "succeeded"
        assert [state_of(client, job) for job in endless] == ["running"] * 5
        metrics = client.get("/metrics").text
        assert "quadmeshd_jobs_running 5\n" in metrics
        paused = next(float(line.split()[1]) for line in metrics.splitlines() if line.startswith("quadmeshd_jobs_paused "))
        assert 3 <= paused <= 5
        # All five went on meanwhile: each has bounds, which hold.
        for job in endless:
            progress = client.wait_for_progress(job["id"])["progress"]
            assert progress["lower"] <= SLOW_DISTANCE <= progress["upper"]
            client.delete(f"/v1/jobs/{job['id']}")
        for job in endless:
            ended = client.wait(job["id"])
            assert ended["state"] == "canceled" and ended["result"]["lower"] <= SLOW_DISTANCE <= ended["result"]["upper"]


def test_a_busy_client_does_not_starve_another(make_daemon, slow_files, tmp_path):
    """One client submits 24 jobs, then another one, with another token, 6 like them. When these have ended, about as many
    of the first client's have, and not nearly all."""
    tokens = [secrets.token_hex(24) for _ in range(2)]
    file = tmp_path / "tokens"
    file.write_text("".join(f"write {token}\n" for token in tokens))
    running = make_daemon("--workers", 1, "--token-file", file)
    with running.client() as busy, running.client() as calm:
        busy.headers["Authorization"], calm.headers["Authorization"] = (f"Bearer {token}" for token in tokens)
        slow = upload_all(busy, slow_files)

        def start(client, count, tolerance):
            return [client.start(*slow, quads="bilinear", tolerance=tolerance * (1 + 1e-6 * k)) for k in range(count)]

        def count_ended():
            return sum(state_of(busy, job) in ENDED for job in many)

        many, few = start(busy, 24, 2e-2), start(calm, 6, 2.1e-2)
        before = count_ended()
        for job in few:
            assert calm.wait(job["id"])["state"] == "succeeded"
        ended = count_ended() - before
        assert ended <= 12, (before, ended)
        for job in many:
            assert busy.wait(job["id"])["state"] == "succeeded"


def test_deadlines_count_from_submission(make_daemon, slow_files, small_files):
    with make_daemon("--workers", 1).client() as client:
        slow = upload_all(client, slow_files)
        ahead = [client.start(*slow, quads="bilinear", tolerance=1e-12 * (2 + k)) for k in range(3)]
        for job in ahead:
            client.wait_until_running(job["id"])
        done = client.hausdorff(*slow, deadline_ms=400, **SLOW)
        assert done["state"] == "succeeded" and done["request"]["deadline_ms"] == 400
        assert done["result"]["stopped_by"] == "deadline"
        assert done["result"]["lower"] <= SLOW_DISTANCE <= done["result"]["upper"]
        again = client.hausdorff(*slow, deadline_ms=400, **SLOW)
        assert "cached" not in again and again["id"] != done["id"]
        for request in ({"type": "deviation", "a": slow[0], "b": slow[1], "accuracy": 1e-12, "pieces": 10000000},
                        {"type": "self_collision", "mesh": slow[0], "quads": "bilinear"},
                        {"type": "distance", "a": slow[0], "b": slow[1], "quads": "bilinear", "tolerance": 1e-15}):
            reply = client.post("/v1/jobs", json={**request, "deadline_ms": 300}, headers={"Prefer": "wait=60"})
            ended = reply.json()
            assert reply.status_code == 200 and ended["state"] in ENDED, ended
            if ended["state"] == "failed":
                assert ended["problem"]["code"] == "deadline_exceeded", ended
        for job in ahead:
            assert state_of(client, job) == "running"
            client.delete(f"/v1/jobs/{job['id']}")
        for wrong in (0, -1, "1", None):
            reply = client.post("/v1/jobs", json={"type": "self_collision", "mesh": slow[0], "deadline_ms": wrong})
            check_problem(reply, 400, "invalid_field")


def test_a_job_can_be_ended_while_its_meshes_are_read(make_daemon, slow_files):
    """After a restart no mesh is in memory. A job that is canceled or past its deadline does not wait for them."""
    daemon = make_daemon()
    with daemon.client() as client:
        slow = upload_all(client, slow_files)
    for wait in (0, 0.005, 0.02, 0.05):
        daemon.stop()
        daemon.start()
        with daemon.client() as client:
            reply = client.post("/v1/jobs", json={"type": "self_collision", "mesh": slow[0], "deadline_ms": 1})
            other = client.start(*slow, **SLOW)
            time.sleep(wait)
            assert client.delete(f"/v1/jobs/{other['id']}").status_code == 202
            done = client.wait(other["id"])
            assert done["state"] == "canceled" and ("result" in done or done["problem"]["code"] == "conflict"), done
            late = client.wait(reply.json()["id"])
            assert late["state"] == "failed" and late["problem"]["code"] == "deadline_exceeded", late
            # The meshes are there for the next one.
            after = client.hausdorff(*slow, deadline_ms=20000, tolerance=0.1)
            assert after["state"] == "succeeded" and after["result"]["stopped_by"] == "converged"


def test_a_job_may_not_run_for_ever(make_daemon, slow_files):
    with make_daemon("--max-job-seconds", 1).client() as client:
        slow = upload_all(client, slow_files)
        done = client.hausdorff(*slow, **SLOW)
        assert done["state"] == "succeeded" and done["result"]["stopped_by"] == "deadline"
        assert done["result"]["lower"] <= SLOW_DISTANCE <= done["result"]["upper"]
        assert "cached" not in client.hausdorff(*slow, **SLOW)


def test_equal_questions_are_computed_once(make_daemon, slow_files):
    with make_daemon("--workers", 2).client() as client:
        slow = upload_all(client, slow_files)
        request = {"quads": "bilinear", "tolerance": 3e-2}
        jobs = [client.start(*slow, **SLOW) for _ in range(4)]
        assert len({job["id"] for job in jobs}) == 4
        for job in jobs:
            assert client.wait_for_progress(job["id"])["state"] == "running"
        # The first one ends by its client's wish, and so does one that follows it; the others are computed.
        for job in (jobs[0], jobs[2]):
            client.delete(f"/v1/jobs/{job['id']}")
            assert client.wait(job["id"])["state"] == "canceled"
        for job in (jobs[1], jobs[3]):
            client.wait_until_running(job["id"])
            assert client.wait_for_progress(job["id"])["state"] == "running"
            client.delete(f"/v1/jobs/{job['id']}")
            assert client.wait(job["id"])["state"] == "canceled"

        # Equal results, the time that they took included, come from one search.
        jobs, barrier = [None] * 6, threading.Barrier(6)

        def ask(k):
            with running_client(client) as own:
                barrier.wait()
                jobs[k] = own.hausdorff(*slow, **request)

        threads = [threading.Thread(target=ask, args=(k,)) for k in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert all(job["state"] == "succeeded" for job in jobs)
        assert len({json.dumps(job["result"]) for job in jobs}) == 1
        for job in jobs:
            names = [event["event"] for event in client.events(job["id"])]
            assert names[-1] == "result" and set(names[:-1]) <= {"bounds"}


def running_client(client):
    return type(client)(base_url=client.base_url, timeout=client.timeout)


def test_priorities_are_named(make_daemon, small_files):
    with make_daemon("--workers", 1).client() as client:
        small = upload_all(client, small_files)
        for priority in ("low", "normal", "high"):
            done = client.hausdorff(*small, priority=priority)
            assert done["state"] == "succeeded"
        shown = client.hausdorff(*small, tolerance=1e-4, priority="high")["request"]
        assert shown["priority"] == "high"
        reply = client.post("/v1/jobs", json={"type": "self_collision", "mesh": small[0], "priority": "urgent"})
        check_problem(reply, 400, "invalid_field")


def test_a_stop_ends_paused_jobs(make_daemon, slow_files):
    """Many jobs that wait for a turn end with the daemon, and begin again at its next start."""
    running = make_daemon("--workers", 2, "--grace", 0)
    with running.client() as client:
        slow = upload_all(client, slow_files)
        jobs = [client.start(*slow, quads="bilinear", tolerance=1e-12 * (1 + k % 5)) for k in range(12)]
        for job in jobs:
            client.wait_until_running(job["id"])
    assert running.stop() == 0
