"""Daemons that die, hang or are slow (T1, T5, T14)."""
import concurrent.futures
import contextlib
import random
import threading
import time

import pytest

import at_rest
from faults import SEED, SILENCE, choose, lease_of, runner, start_slow, upload_slow, wait_for_another_run
from load import Client, Load
from postgres import Session

KILLS = choose(4, 200)


@pytest.mark.timeout(60 + 15 * KILLS)
def test_daemons_are_killed_under_load(cluster):
    """T1, with nodes that are started again at once."""
    chance = random.Random(SEED)
    for _ in range(-(-KILLS // 10)):
        with Load(cluster, SEED) as load:
            for _ in range(min(KILLS, 10)):
                time.sleep(chance.uniform(0.2, 1.0))
                node = chance.choice(cluster.nodes)
                node.kill()
                time.sleep(chance.uniform(0.0, 0.5))
                node.start()
        load.check()


def test_the_jobs_of_a_dead_node_run_elsewhere(cluster, slow_files):
    """T1, with a node that stays dead until its jobs have ended."""
    job = start_slow(cluster.nodes[0], upload_slow(cluster, slow_files), 5)
    dead = runner(cluster, job)
    with Load(cluster, SEED, others=False) as load:
        load.jobs[job] = {"type": "slow"}
        lease = lease_of(cluster, job)
        dead.kill()
        killed = time.monotonic()
        wait_for_another_run(cluster, job, lease)
        print(f"a job of a killed node ran again after {time.monotonic() - killed:.1f} s")
    load.check()
    dead.start()
    with dead.client() as client:
        assert client.wait(job)["state"] == "succeeded"
        events = client.events(job)
    assert any(event["event"] == "server_restart" for event in events)


def test_a_node_that_hangs_and_wakes_changes_nothing(cluster, slow_files):
    """T5: it was declared dead meanwhile; what it still has in hand is void, and it joins anew."""
    job = start_slow(cluster.nodes[0], upload_slow(cluster, slow_files), 6)
    asleep = runner(cluster, job)
    with Load(cluster, SEED) as load:
        load.jobs[job] = {"type": "slow"}
        time.sleep(1)
        lease = lease_of(cluster, job)
        asleep.pause()
        wait_for_another_run(cluster, job, lease)
        time.sleep(max(0.0, choose(0, 15) - SILENCE))
        asleep.resume()
        time.sleep(2)
    load.check()
    cluster.wait_until_ready()
    assert asleep.info()["cluster"]["nodes"] == len(cluster.nodes)
    with asleep.client() as client:
        done = client.wait(job)
        assert done["state"] == "succeeded"
        assert sum(event["event"] == "result" for event in client.events(job)) == 1


@contextlib.contextmanager
def slowed(node, share=0.05, period=0.1):
    """The node has this share of the processors' time, by SIGSTOP and SIGCONT."""
    is_over = threading.Event()

    def work():
        while not is_over.is_set():
            node.pause()
            time.sleep(period * (1 - share))
            node.resume()
            time.sleep(period * share)

    thread = threading.Thread(target=work)
    thread.start()
    yield
    is_over.set()
    thread.join()


def test_a_slow_node_and_a_slow_database(cluster):
    """T14."""
    with Load(cluster, SEED) as load:
        with slowed(cluster.nodes[0]):
            time.sleep(choose(4, 60))
        for node in cluster.nodes:
            for link in node.links:
                link.delay(up=0.025, down=0.025)
        time.sleep(choose(4, 60))
        for node in cluster.nodes:
            for link in node.links:
                link.delay()
    load.check()
    waits = sorted(call.end - call.start for call in load.history.calls if call.is_known)
    print(f"p99 of a request {1000 * waits[int(0.99 * len(waits))]:.0f} ms, of {len(waits)}")


def test_a_claim_is_under_way_when_its_node_dies(cluster):
    """The reaper waits for the claim, and must see what it wrote: a single statement would look with the eyes of its start."""
    load = Load(cluster, SEED, movers=0, askers=0, others=False)
    body = {"type": "hausdorff", "a": load.pair[0], "b": load.pair[1], "tolerance": 1e-7}
    # The server of a claim goes on when its client is dead.
    at_rest.select(cluster.query, at_rest.MAKE_STOP)
    session = Session(cluster.database.primary)
    assert session.run(at_rest.STOP_CLAIMS)
    with concurrent.futures.ThreadPoolExecutor() as pool:
        asking = pool.submit(Client(load, "asking", SEED).submit, body, "claimed by the dead")
        (name,) = cluster.wait_for("a claim that waits", lambda: at_rest.waiting_claims(cluster.query))
        (node,) = (node for node in cluster.nodes if node.name == name)
        node.kill()
        starting = pool.submit(node.start)
        cluster.wait_for("a reaper that waits for it", lambda: at_rest.waiting_reapers(cluster.query))
        session.close()
        starting.result()
        assert asking.result()
    at_rest.select(cluster.query, at_rest.DROP_STOP)
    load.check(check_tables=False)
