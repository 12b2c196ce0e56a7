"""Nodes are stopped in order and started again, one after the other (T16)."""
import time

import pytest

import at_rest
from faults import SEED, another, choose, lease_of, runner, start_slow, upload_slow, wait_for_another_run
from load import Load


def roll(cluster):
    for node in cluster.nodes:
        assert node.stop() == 0
        node.start()
        time.sleep(0.5)


def check_load(load):
    load.check()
    # Calls with a key, and those that change nothing, came to their answers.
    left = [call for call in load.history.calls if not call.is_known and call.name == "submit"]
    assert all(any(other.is_known and other.key == call.key for other in load.history.calls) for call in left), left


def test_a_rolling_restart(cluster, slow_files):
    """A long job is given back and goes on elsewhere at once; nobody is declared dead."""
    with Load(cluster, SEED) as load:
        for _ in range(choose(1, 10)):
            roll(cluster)
    check_load(load)

    job = start_slow(cluster.nodes[0], upload_slow(cluster, slow_files), 7)
    node, lease, dead = runner(cluster, job), lease_of(cluster, job), at_rest.dead_nodes(cluster.query)
    assert node.stop() == 0
    wait_for_another_run(cluster, job, lease)
    with another(cluster, node).client() as client:
        assert client.wait(job)["state"] == "succeeded"
    node.start()
    assert not {life for life in at_rest.dead_nodes(cluster.query) - dead if not life.startswith(node.name)}


def test_tables_become_those_of_the_next_version(make_cluster):
    """Migrated while these nodes run, the tables are theirs as before: those that run go on, and those that start join them."""
    cluster = make_cluster(3)
    with Load(cluster, SEED) as load:
        time.sleep(1)
        at_rest.select(cluster.query, at_rest.NEXT_VERSION)
        roll(cluster)
    check_load(load)


def test_tables_of_the_version_before(make_cluster):
    """A node does not start beside others that use them, and says what does it; alone it brings them up to date."""
    cluster = make_cluster(2)
    first, second = cluster.nodes
    assert second.stop() == 0
    at_rest.select(cluster.query, at_rest.FIRST_VERSION)
    with pytest.raises(AssertionError, match="--migrate"):
        second.daemon.start()
    assert first.stop() == 0
    second.start()
    first.start()
    cluster.wait_until_ready()
    with Load(cluster, SEED) as load:
        time.sleep(1)
    load.check()
