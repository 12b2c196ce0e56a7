"""The database dies, is promoted, loses its standby, or has a wait for it canceled (T2, T3, T6, T7)."""
import random
import threading
import time

import httpx
import pytest

import shapes
from api_conftest import check_problem
from faults import SEED, choose
from load import Load

RESTARTS, FAILOVERS = choose(3, 30), choose(2, 50)


@pytest.mark.timeout(60 + 30 * RESTARTS)
def test_the_primary_is_killed_and_started_again(cluster):
    """T2."""
    chance = random.Random(SEED)
    for _ in range(-(-RESTARTS // 5)):
        with Load(cluster, SEED) as load:
            for _ in range(min(RESTARTS, 5)):
                time.sleep(chance.uniform(0.5, 1.5))
                cluster.database.primary.kill()
                time.sleep(chance.uniform(0.0, 1.0))
                cluster.database.primary.start()
        cluster.wait_until_ready()
        load.check()


@pytest.mark.timeout(60 + 60 * FAILOVERS)
def test_the_standby_takes_over(cluster):
    """T3: what was acknowledged, or read by anybody, is there after the promotion."""
    chance = random.Random(SEED)
    for _ in range(FAILOVERS):
        with Load(cluster, SEED) as load:
            time.sleep(chance.uniform(1.0, 2.0))
            cluster.wire.hold()
            time.sleep(chance.uniform(0.0, 0.5))
            cluster.fail_over()
            time.sleep(1)
        cluster.wait_until_ready()
        load.check()


def upload(node, content, answers):
    with node.client() as client:
        reply = client.post("/v1/meshes", content=content)
        answers.append(reply)


def test_nothing_is_seen_before_the_standby_has_it(cluster):
    """T6."""
    first, second = cluster.nodes[:2]
    answers = []
    cluster.wire.hold()
    writing = threading.Thread(target=upload, args=(first, shapes.obj(shapes.cube(side=0.25)), answers))
    writing.start()
    time.sleep(2)
    with second.client() as client:
        assert not any(mesh["size_bytes"] == len(shapes.obj(shapes.cube(side=0.25))) and mesh["bounding_box"]["max"][0] == 0.25
                       for mesh in client.get("/v1/meshes", params={"limit": 1000}).json()["meshes"])
    writing.join()
    check_problem(answers[0], 503, "store_unavailable")
    cluster.wire.release()
    cluster.wait_until_ready()
    with second.client() as client:
        made = client.upload(shapes.obj(shapes.cube(side=0.25)))
        assert client.get(f"/v1/meshes/{made['id']}").status_code == 200


def submit(node, body, key, answers):
    try:
        with node.client() as client:
            answers.append(client.post("/v1/jobs", json=body, headers={"Idempotency-Key": key}))
    except httpx.TransportError:
        pass


def test_a_canceled_wait_for_the_standby_is_no_answer(cluster):
    """T7: the row is seen then, and not safe. Whoever finds it must not answer for it, at no node."""
    with cluster.nodes[0].client() as client:
        pair = [client.upload(shapes.obj(shapes.cube(side=side)))["id"] for side in (1.0, 2.0)]
    body = {"type": "hausdorff", "a": pair[0], "b": pair[1]}
    answers = []
    cluster.wire.cut(refuse=True)
    tries = [threading.Thread(target=submit, args=(node, body, "canceled", answers)) for node in cluster.nodes for _ in range(2)]
    for one in tries:
        one.start()
        end = time.monotonic() + 1
        while time.monotonic() < end:
            cluster.query("SELECT pg_cancel_backend(pid) FROM pg_stat_activity WHERE wait_event = 'SyncRep'")
            time.sleep(0.05)
    for one in tries:
        one.join()
    assert answers and {reply.status_code for reply in answers} == {503}, [reply.text for reply in answers]
    cluster.fail_over()
    cluster.wait_until_ready()
    answers.clear()
    for node in cluster.nodes:
        submit(node, body, "canceled", answers)
    assert all(reply.status_code in (200, 202) for reply in answers), [reply.text for reply in answers]
    assert len({reply.json()["id"] for reply in answers}) == 1
