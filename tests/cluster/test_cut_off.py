"""Nodes that do not reach the database, both ways or one, for a while or for longer than they are waited for (T4)."""
import time

import pytest

import at_rest
from api_conftest import check_problem
from faults import SEED, SILENCE, another, choose, lease_of, runner, start_slow, upload_slow, wait_for_another_run
from load import Load, check_job
from proxy import DOWN, UP


def ask_unready(cluster, node):
    """A node without its store says so, and when to come again; it is alive."""
    with node.client() as client:
        cluster.wait_for("503 of /readyz", lambda: client.get("/readyz").status_code == 503)
        assert client.get("/healthz").status_code == 200
        for method, path in (("GET", "/v1/meshes"), ("GET", "/v1/jobs/j_none"), ("DELETE", "/v1/meshes/m_none")):
            reply = client.request(method, path)
            check_problem(reply, 503, "store_unavailable")
            assert int(reply.headers["retry-after"]) > 0


@pytest.mark.parametrize("ways", [(), (UP,), (DOWN,)], ids=["both", "up", "down"])
def test_a_node_is_cut_off_for_a_while(cluster, ways):
    """Not for so long that it counts as dead: its jobs go on and end once."""
    cut = cluster.nodes[0]
    with Load(cluster, SEED) as load:
        time.sleep(1)
        cut.cut_off(*ways)
        time.sleep(3)
        cut.heal()
        time.sleep(1)
    load.check()


@pytest.mark.timeout(300)
@pytest.mark.parametrize("ways", [(), (UP,), (DOWN,)] if choose(False, True) else [()])
def test_a_node_is_cut_off_until_it_counts_as_dead(cluster, slow_files, ways):
    """Its jobs run elsewhere, what it ends later is void, and it comes back by itself."""
    job = start_slow(cluster.nodes[0], upload_slow(cluster, slow_files), 6)
    cut = runner(cluster, job)
    with Load(cluster, SEED) as load:
        load.jobs[job] = {"type": "slow"}
        lease = lease_of(cluster, job)
        cut.cut_off(*ways)
        ask_unready(cluster, cut)
        cut.is_serving = False  # as a balancer sees it
        wait_for_another_run(cluster, job, lease)
        time.sleep(choose(0, 60))
        cut.heal()
        cluster.wait_until_ready()
        cut.is_serving = True
        time.sleep(1)
    load.check()
    with another(cluster, cut).client() as client:
        assert sum(event["event"] == "result" for event in client.events(job)) == 1


def test_an_end_that_is_long_on_its_way_is_void(cluster, slow_files):
    """The end of a run is sent and held up, until another node has begun the job anew. Then it arrives."""
    job = start_slow(cluster.nodes[0], upload_slow(cluster, slow_files), 4)
    cut, lease = runner(cluster, job), lease_of(cluster, job)
    cut.cut_off(UP)
    wait_for_another_run(cluster, job, lease)
    cut.heal()
    cluster.wait_until_ready()
    check_job(cluster, job)
    with another(cluster, cut).client() as client:
        assert client.events(job)[-1]["seq"] > 10**9


def test_a_deadline_passes_in_an_outage(cluster, slow_files):
    """The array of the result cannot be stored in time: the job ends all the same, once the database is back."""
    a, b = upload_slow(cluster, slow_files)
    with cluster.nodes[0].client() as client:
        job = client.start(a, b, type="deviation", accuracy=1e-9, deadline_ms=2000)["id"]
    node = runner(cluster, job)
    cluster.database.primary.kill()
    time.sleep(4)
    cluster.database.primary.start()
    cluster.wait_until_ready()
    with node.client() as client:
        assert client.wait(job)["state"] in ("succeeded", "failed")
    check_job(cluster, job)


def test_connections_are_reset_again_and_again(cluster):
    with Load(cluster, SEED) as load:
        for turn in range(choose(6, 100)):
            time.sleep(0.3)
            node = cluster.nodes[turn % len(cluster.nodes)]
            for link in node.links:
                link.cut()
                link.cut_after(2000 * turn)
    load.check()


def test_nobody_is_declared_dead_for_an_outage(cluster, slow_files):
    """T22: after an outage all beats look old. Jobs that ran go on and end."""
    job = start_slow(cluster.nodes[0], upload_slow(cluster, slow_files), 3)
    node = runner(cluster, job)
    dead = at_rest.dead_nodes(cluster.query)
    cluster.database.primary.kill()
    ask_unready(cluster, another(cluster, node))
    time.sleep(choose(SILENCE + 3, 60))
    cluster.database.primary.start()
    cluster.wait_until_ready()
    with node.client() as client:
        assert client.wait(job)["state"] == "succeeded"
        assert not any(event["event"] == "server_restart" for event in client.events(job))
    time.sleep(3)  # a turn of each reaper
    assert at_rest.dead_nodes(cluster.query) == dead
