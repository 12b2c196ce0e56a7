"""How long and how often the tests make things go wrong, and what several of them do with a job that runs long."""
import os

import at_rest
from api_conftest import SLOW

SEED = int(os.environ.get("QM_TEST_SEED", "1"))
LONG = os.environ.get("QM_TEST_LONG", "0") != "0"
SILENCE = 10.0                 # seconds after which a node counts as dead


def choose(short, long):
    return long if LONG else short


def upload_slow(cluster, slow_files):
    """The ids of a pair whose distance takes many minutes."""
    with cluster.nodes[0].client() as client:
        return [client.upload(content)["id"] for content in slow_files]


def start_slow(node, pair, seconds):
    """A job that ends of itself after so many seconds of a run."""
    with node.client() as client:
        return client.start(*pair, headers={"Cache-Control": "no-cache"}, deadline_ms=1000 * seconds, **SLOW)["id"]


def lease_of(cluster, job):
    """The lease of a job, once a node runs it."""
    return cluster.wait_for(f"a node that runs {job}", lambda: at_rest.lease(cluster.query, job))


def runner(cluster, job):
    """The node that runs a job, once one does."""
    name = lease_of(cluster, job)[0]
    return next(node for node in cluster.nodes if node.name == name)


def wait_for_another_run(cluster, job, lease):
    """Until another lease than this one is out for the job."""
    cluster.wait_for(f"another run of {job}", lambda: at_rest.lease(cluster.query, job) not in (None, lease))


def another(cluster, *nodes):
    """A node that serves and is none of these."""
    return next(node for node in cluster.serving() if node not in nodes)
