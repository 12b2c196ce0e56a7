"""Clocks that are an hour apart, on daemons and on a promoted standby (T13)."""
import os
import pathlib
import subprocess
import time

import pytest

from faults import SEED, choose
from load import Load


@pytest.fixture
def shifted(tmp_path):
    """Variables of a process whose clock is so many seconds off."""
    library = tmp_path / "clock_shift.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-D_GNU_SOURCE", "-o", library,
                    pathlib.Path(__file__).parent / "clock_shift.c", "-ldl"], check=True)
    os.chmod(tmp_path, 0o755)
    return lambda seconds: {"LD_PRELOAD": str(library), "CLOCK_SHIFT": str(seconds),
                            "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0"}


def test_clocks_an_hour_apart(make_cluster, shifted):
    cluster = make_cluster(3, standby=True)
    for node, hours in zip(cluster.nodes, (1, -1)):
        node.stop()
        node.start(env={**os.environ, **shifted(3600 * hours)})
    standby = cluster.database.standby
    standby.stop()
    standby.prefix = ["env", *(f"{name}={value}" for name, value in shifted(3600).items())]
    standby.start()
    cluster.database.require_standby()
    with Load(cluster, SEED) as load:
        time.sleep(choose(2, 30))
        cluster.fail_over()
        assert abs(int(cluster.query("SELECT extract(epoch FROM clock_timestamp())::bigint")[0][0]) - time.time() - 3600) < 60
        time.sleep(choose(2, 30))
    cluster.wait_until_ready()
    load.check()
