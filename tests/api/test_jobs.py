"""The life of a job: waiting, the cache, keys, canceling, lists, a full queue."""
import time

import pytest

import shapes
from conftest import IS_SHARED, MET_CODES, SLOW, SLOW_DISTANCE, WAIT, check_bounds, check_problem


def test_a_job_is_accepted_then_done(client, spheres):
    request = {"type": "hausdorff", "a": spheres[0], "b": spheres[1], "tolerance": 3e-6}
    reply = client.post("/v1/jobs", json=request)
    assert reply.status_code == 202
    job = reply.json()
    assert reply.headers["location"] == f"/v1/jobs/{job['id']}"
    assert job["type"] == "hausdorff" and job["state"] in ("queued", "running")
    done = client.wait(job["id"])
    assert done["state"] == "succeeded" and done["id"] == job["id"]
    assert done["request"]["gap"] == 3e-6
    assert done["created"] <= done["started"] <= done["ended"]
    check_bounds(client.events(job["id"]), done["result"])
    assert client.get(f"/v1/jobs/{job['id']}").json() == done


def test_prefer_wait_gives_up_in_time(client, slow_pair):
    start = time.monotonic()
    reply = client.post("/v1/jobs", json={"type": "hausdorff", "a": slow_pair[0], "b": slow_pair[1], **SLOW},
                        headers={"Prefer": "wait=1", "Cache-Control": "no-cache"})
    assert reply.status_code == 202 and 0.9 < time.monotonic() - start < 10
    job = client.wait_for_progress(reply.json()["id"])
    assert job["state"] == "running"
    # The bounds so far are part of the document.
    assert job["progress"]["lower"] <= SLOW_DISTANCE <= job["progress"]["upper"]
    client.delete(reply.headers["location"])
    assert client.wait(job["id"])["state"] == "canceled"


def test_prefer_wait_answers_when_done(client, spheres):
    reply = client.post("/v1/jobs", json={"type": "hausdorff", "a": spheres[0], "b": spheres[1], "tolerance": 4e-6},
                        headers={"Prefer": "respond-async, wait=30"})
    assert reply.status_code == 200 and reply.json()["state"] == "succeeded"
    assert reply.headers["preference-applied"].startswith("wait=30")


def test_a_job_asked_again_is_answered_from_the_first(client, spheres):
    first = client.hausdorff(*spheres, tolerance=5e-6)
    again = client.hausdorff(*spheres, tolerance=5e-6)
    assert "cached" not in first or first["cached"] is False
    assert again["cached"] is True
    assert again["id"] == first["id"] and again["result"] == first["result"]
    # Defaults that are spelled out are the same job.
    spelled = client.hausdorff(*spheres, tolerance=5e-6, direction="two_sided", quads="triangles",
                               tolerance_unit="relative")
    assert spelled["id"] == first["id"]
    other = client.hausdorff(*spheres, tolerance=5e-6, quads="bilinear")
    assert other["id"] != first["id"]


def test_no_cache_measures_anew(client, spheres):
    first = client.hausdorff(*spheres, tolerance=6e-6)
    again = client.hausdorff(*spheres, headers={"Cache-Control": "no-cache"}, tolerance=6e-6)
    assert again["id"] != first["id"] and not again.get("cached")
    for bound in ("lower", "upper", "witness"):
        assert again["result"][bound] == first["result"][bound]


def test_a_cached_job_streams_too(client, spheres):
    first = client.hausdorff(*spheres, tolerance=7e-6)
    reply = client.post("/v1/jobs", json={"type": "hausdorff", "a": spheres[0], "b": spheres[1], "tolerance": 7e-6},
                        headers={"Accept": "application/x-ndjson"})
    assert reply.headers["location"].endswith(first["id"])
    assert [line for line in reply.text.splitlines() if '"event":"result"' in line]


def test_idempotency_key(client, spheres, slow_pair):
    headers = {"Idempotency-Key": "one-of-a-kind", "Cache-Control": "no-cache"}
    request = {"type": "hausdorff", "a": slow_pair[0], "b": slow_pair[1], "deadline_ms": 700, **SLOW}
    first = client.post("/v1/jobs", json=request, headers=headers)
    again = client.post("/v1/jobs", json=request, headers=headers)
    assert first.status_code == 202 and again.status_code in (200, 202)
    assert first.json()["id"] == again.json()["id"]
    client.wait(first.json()["id"])
    late = client.post("/v1/jobs", json=request, headers=headers)
    assert late.json()["id"] == first.json()["id"]
    check_problem(client.post("/v1/jobs", json={**request, "deadline_ms": 701}, headers=headers), 422,
                  "idempotency_mismatch")
    other = client.post("/v1/jobs", json=request, headers={**headers, "Idempotency-Key": "another"})
    assert other.json()["id"] != first.json()["id"]
    client.delete(f"/v1/jobs/{other.json()['id']}")


def test_canceling_keeps_the_bounds(client, slow_pair):
    job = client.start(*slow_pair, headers={"Cache-Control": "no-cache"}, **SLOW)
    client.wait_for_progress(job["id"])
    reply = client.delete(f"/v1/jobs/{job['id']}")
    assert reply.status_code == 202
    done = client.wait(job["id"])
    assert done["state"] == "canceled"
    result = done["result"]
    assert result["converged"] is False
    assert result["lower"] <= SLOW_DISTANCE <= result["upper"]
    check_bounds(client.events(job["id"]), result)
    check_problem(client.delete(f"/v1/jobs/{job['id']}"), 409, "conflict")
    check_problem(client.delete(f"/v1/jobs/{job['id']}", params={"job": "running"}), 409, "conflict")
    assert client.get(f"/v1/jobs/{job['id']}").status_code == 200


def test_an_ended_job_is_removed(client, daemon, slow_pair):
    """With all that belongs to it; one that runs is not canceled by it."""
    cube = client.upload(shapes.cube(side=17))["id"]
    request = {"type": "deviation", "a": cube, "b": cube}
    headers = {"Idempotency-Key": "removed", "Prefer": WAIT}
    job = client.post("/v1/jobs", json=request, headers=headers).json()["id"]
    array = daemon.folder / f"data/results/{job}.f64"
    assert array.exists() != IS_SHARED  # a shared one has arrays among its blobs
    check_problem(client.delete(f"/v1/jobs/{job}", params={"job": "any"}), 400, "invalid_parameter")
    reply = client.delete(f"/v1/jobs/{job}", params={"job": "ended"})
    assert reply.status_code == 204 and not reply.content
    assert not array.exists()
    for path in ("", "/result", "/events"):
        check_problem(client.get(f"/v1/jobs/{job}{path}"), 404, "job_not_found")
    check_problem(client.delete(f"/v1/jobs/{job}", params={"job": "ended"}), 404, "job_not_found")
    # Neither the cache nor the key knows it any more.
    again = client.post("/v1/jobs", json=request, headers=headers)
    assert again.json()["id"] != job and "cached" not in again.json()
    runs = client.start(*slow_pair, headers={"Cache-Control": "no-cache"}, **SLOW)["id"]
    client.wait_until_running(runs)
    check_problem(client.delete(f"/v1/jobs/{runs}", params={"job": "ended"}), 409, "conflict")
    assert client.get(f"/v1/jobs/{runs}").json()["state"] == "running"
    assert client.delete(f"/v1/jobs/{runs}").status_code == 202


def test_lists_have_filters_and_orders(make_daemon, slow_files):
    with make_daemon("--workers", 1).client() as client:
        cube, box = client.upload(shapes.obj(shapes.cube()), name="cube"), client.upload(shapes.obj(shapes.cube(2.0)))
        slow = [client.upload(file)["id"] for file in slow_files]
        done = [client.hausdorff(cube["id"], box["id"], tolerance=x)["id"] for x in (0.1, 0.2, 0.3)]
        done.append(client.post("/v1/jobs", json={"type": "distance", "a": box["id"], "b": cube["id"]},
                                headers={"Prefer": "wait=20"}).json()["id"])
        runs = client.start(*slow, **SLOW)["id"]
        client.wait_until_running(runs)

        def ids(path="jobs", **query):
            found, cursor = [], None
            while True:
                page = client.get(f"/v1/{path}", params={**query, "limit": 2, **({"cursor": cursor} if cursor else {})})
                assert page.status_code == 200, page.text
                found += [entry["id"] for entry in page.json()[path]]
                cursor = page.json()["next"]
                if not cursor:
                    return found

        assert ids() == [*done, runs] and ids(order="newest") == [runs, *done[::-1]] and ids(order="oldest") == ids()
        assert ids(type="distance") == done[3:] and ids(type="hausdorff", order="newest") == [runs, *done[2::-1]]
        assert ids(state="succeeded") == done and ids(state="running") == [runs] and ids(state="queued") == []
        assert ids(mesh=cube["id"]) == done and ids(mesh=slow[1]) == [runs] and ids(mesh="m_none") == []
        assert ids(mesh=box["id"], state="succeeded", type="hausdorff", order="newest") == done[2::-1]
        assert ids(reconstruction="r_1") == []
        client.delete(f"/v1/jobs/{runs}")
        client.wait(runs)
        assert ids(state="canceled") == [runs] and ids(state="running") == []
        assert ids("meshes", name="cube") == [cube["id"]] and ids("meshes", name="cub") == []
        assert ids("meshes", content_hash=box["content_hash"]) == [box["id"]]
        assert ids("meshes", order="newest")[-1] == cube["id"]
        layout = client.post("/v1/layouts", json={"mesh": cube["id"]}).json()["id"]
        assert ids("layouts", mesh=cube["id"]) == [layout] and ids("layouts", mesh=box["id"]) == []
        assert ids("reconstructions", mesh=cube["id"], order="newest") == []
        for query, word in (({"order": "up"}, "`order`"), ({"state": "done"}, "`state`"), ({"type": "x"}, "`type`"),
                            ({"mesh": "m_1", "reconstruction": "r_1"}, "`mesh`")):
            problem = check_problem(client.get("/v1/jobs", params=query), 400, "invalid_parameter")
            assert word in problem["detail"]


def test_canceling_a_job_that_waits(make_daemon, slow_files):
    with make_daemon("--workers", 1).client() as client:
        pair = [client.upload(content)["id"] for content in slow_files]
        first = client.start(*pair, **SLOW)
        second = client.start(*pair, direction="a_to_b", **SLOW)
        assert client.get(f"/v1/jobs/{second['id']}").json()["state"] == "queued"
        client.delete(f"/v1/jobs/{second['id']}")
        done = client.wait(second["id"])
        assert done["state"] == "canceled" and "result" not in done
        events = client.events(second["id"])
        assert [event["event"] for event in events] == ["error"]
        client.delete(f"/v1/jobs/{first['id']}")


def test_a_canceled_job_answers_no_other(client, slow_pair):
    job = client.start(*slow_pair, tolerance=2e-12, quads="bilinear")
    client.delete(f"/v1/jobs/{job['id']}")
    client.wait(job["id"])
    again = client.start(*slow_pair, tolerance=2e-12, quads="bilinear")
    assert again["id"] != job["id"]
    client.delete(f"/v1/jobs/{again['id']}")


def test_a_full_queue_is_told(make_daemon, slow_files):
    with make_daemon("--workers", 1, "--queue", 2).client() as client:
        pair = [client.upload(content)["id"] for content in slow_files]
        # Jobs that have begun are no longer in the queue: it fills when no more may begin.
        jobs = []
        for k in range(100):
            request = {"type": "hausdorff", "a": pair[0], "b": pair[1], **SLOW, "tolerance": 1e-12 * (1 + k)}
            reply = client.post("/v1/jobs", json=request)
            if reply.status_code != 202:
                break
            jobs.append(reply.json())
        check_problem(reply, 429, "too_many_jobs")
        assert int(reply.headers["retry-after"]) >= 1
        if not IS_SHARED:  # there they wait in the database, which the last beat has counted
            assert client.get("/v1/info").json()["queued"] == 2
        for job in reversed(jobs):
            client.delete(f"/v1/jobs/{job['id']}")
        for job in jobs:
            assert client.wait(job["id"])["state"] == "canceled"
        assert client.post("/v1/jobs", json=request).status_code == 202


def test_a_mesh_deleted_under_a_job(client, slow_files, make_daemon):
    with make_daemon().client() as own:
        pair = [own.upload(content)["id"] for content in slow_files]
        job = own.start(*pair, deadline_ms=3000, **SLOW)
        own.wait_for_progress(job["id"])  # it has its meshes
        for mesh in pair:
            assert own.delete(f"/v1/meshes/{mesh}").status_code == 204
        done = own.wait(job["id"])
        assert done["state"] == "succeeded"
        assert done["result"]["lower"] <= SLOW_DISTANCE <= done["result"]["upper"]


def test_a_deadline_that_is_over_when_the_job_begins(client, slow_pair):
    """A kind without a partial result fails."""
    reply = client.post("/v1/jobs", json={"type": "self_collision", "mesh": slow_pair[0], "deadline_ms": 1e-6},
                        headers={"Prefer": "wait=30"})
    ended = reply.json()
    assert reply.status_code == 200 and ended["state"] == "failed", ended
    assert (ended["problem"]["status"], ended["problem"]["code"]) == (504, "deadline_exceeded")
    MET_CODES.add(ended["problem"]["code"])


def test_lists_come_in_pages(make_daemon):
    with make_daemon().client() as client:
        assert client.get("/v1/jobs").json() == {"jobs": [], "next": None}
        mesh = client.upload(b"0 0 0\n1 1 1\n", format="xyz")["id"]
        ids = [client.hausdorff(mesh, mesh, tolerance=10.0 ** -k)["id"] for k in range(1, 6)]
        seen, cursor = [], None
        for _ in range(3):
            page = client.get("/v1/jobs", params={"limit": 2, **({"cursor": cursor} if cursor else {})}).json()
            seen += [job["id"] for job in page["jobs"]]
            cursor = page["next"]
        assert seen == ids and cursor is None


def test_unknown_jobs(client):
    check_problem(client.get("/v1/jobs/j_none"), 404, "job_not_found")
    check_problem(client.delete("/v1/jobs/j_none"), 404, "job_not_found")


@pytest.mark.parametrize("count", [40])
def test_many_jobs_at_once(client, spheres, count):
    jobs = [client.start(*spheres, tolerance=1e-4 * (1 + k / 1000), direction="a_to_b") for k in range(count)]
    assert len({job["id"] for job in jobs}) == count
    for job in jobs:
        assert client.wait(job["id"])["state"] == "succeeded"
