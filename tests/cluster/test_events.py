"""Many readers of one job at all nodes, some of which die (T12)."""
import threading
import time

import at_rest
from faults import SEED, another, choose, runner, start_slow, upload_slow
from load import Client, Load, check_job

READERS = choose(24, 200)


def test_readers_go_on_at_another_node(cluster, slow_files):
    """A node with readers dies, then the one that runs the job. Each reader resumes with the seq that it had."""
    job = start_slow(cluster.nodes[0], upload_slow(cluster, slow_files), 6)
    owner = runner(cluster, job)
    load = Load(cluster, SEED)
    clients = [Client(load, f"reader{k}", f"{SEED} {k}") for k in range(READERS)]
    readers = [threading.Thread(target=client.follow, args=(job, cluster.nodes[k % len(cluster.nodes)]))
               for k, client in enumerate(clients)]
    for reader in readers:
        reader.start()
    time.sleep(1)
    front = another(cluster, owner)
    front.kill()
    time.sleep(0.5)
    owner.kill()
    front.start()
    owner.start()
    for reader in readers:
        reader.join()
    load.ended = load.is_over = True
    load.jobs[job] = {"type": "slow"}
    load.check()
    streams = [call.answer["lines"] for call in load.history.calls if call.name == "stream"]
    assert len(streams) == READERS and all(lines[-1]["event"] == "result" for lines in streams)
    assert all(any(line["event"] == "server_restart" for line in lines) for lines in streams)


def test_events_that_a_failover_takes_away_are_stored_again(cluster, slow_files):
    """They are committed without a wait for a disk, and come back with the next beat of the job's node."""
    job = start_slow(cluster.nodes[0], upload_slow(cluster, slow_files), 8)
    cluster.wait_for("events", lambda: len(at_rest.seqs(cluster.query, job)) >= 4)
    lost = at_rest.lose_events(cluster.query, job)
    assert lost
    cluster.wait_for("them again", lambda: set(lost) <= set(at_rest.seqs(cluster.query, job)))
    time.sleep(0.5)
    assert at_rest.lose_events(cluster.query, job)  # perhaps the end comes before the next beat
    check_job(cluster, job)
