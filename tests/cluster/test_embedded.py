"""One daemon with its own store under the load of the cluster, and kill -9: harness and checkers work, and so does it.

QM_TEST_LONG=1 kills 100 times.
"""
import os
import random
import subprocess
import time

import pytest

from api_conftest import BUILD
from load import Load

SEED = int(os.environ.get("QM_TEST_SEED", "1"))
KILLS = 100 if os.environ.get("QM_TEST_LONG", "0") != "0" else 5


def test_all_holds_without_a_fault(make_cluster):
    cluster = make_cluster(1, store="embedded")
    with Load(cluster, SEED) as load:
        time.sleep(3)
    load.check()
    kinds = {call.name for call in load.history.calls if call.is_known}
    assert kinds >= {"create", "remove", "list", "fetch", "submit", "read", "write", "swap", "edit", "step", "count", "stream",
                     "log", "document"}


@pytest.mark.timeout(60 + 20 * KILLS)
def test_all_holds_through_kills(make_cluster):
    chance = random.Random(SEED)
    cluster = make_cluster(1, store="embedded")
    (node,) = cluster.nodes
    # A mesh may have a thousand calls: then comes the next load.
    for _ in range(-(-KILLS // 5)):
        with Load(cluster, SEED) as load:
            for _ in range(5):
                time.sleep(chance.uniform(0.2, 1.0))
                node.kill()
                node.start()
        load.check()
    assert node.stop() == 0
    subprocess.run([BUILD / "quadmeshd", "--data-dir", node.folder / "data", "--check"], check=True, capture_output=True)
