"""Clocks that are an hour apart, on daemons and on a promoted standby (T13)."""
import datetime
import os
import pathlib
import subprocess
import tempfile
import time

import pytest

import shapes
from faults import SEED, choose
from load import Load


@pytest.fixture
def shifted():
    """Variables of a process whose clock is so many seconds off."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)  # the server of the database has another user
        library = pathlib.Path(folder) / "clock_shift.so"
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-D_GNU_SOURCE", "-o", library,
                        pathlib.Path(__file__).parent / "clock_shift.c", "-ldl"], check=True)
        yield lambda seconds: {"LD_PRELOAD": str(library), "CLOCK_SHIFT": str(seconds),
                               "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0"}


def hours_off(node):
    """By how many hours a mesh that the node makes is of another time."""
    with node.client() as client:
        created = client.upload(shapes.obj(shapes.cube(side=1e9 + node.pid)))["created"]
    return round((datetime.datetime.fromisoformat(created).timestamp() - time.time()) / 3600)


def test_clocks_an_hour_apart(make_cluster, shifted):
    cluster = make_cluster(3, standby=True)
    for node, hours in zip(cluster.nodes, (1, -1)):
        node.stop()
        node.start(env={**os.environ, **shifted(3600 * hours)})
    assert [hours_off(node) for node in cluster.nodes] == [1, -1, 0]
    standby = cluster.database.standby
    standby.stop()
    standby.prefix = ["env", *(f"{name}={value}" for name, value in shifted(3600).items())]
    standby.start()
    cluster.database.require_standby()
    with Load(cluster, SEED) as load:
        time.sleep(choose(2, 30))
        cluster.fail_over()
        ((told,),) = cluster.query("SELECT extract(epoch FROM clock_timestamp())::bigint")
        assert round((int(told) - time.time()) / 3600) == 1
        time.sleep(choose(2, 30))
    cluster.wait_until_ready()
    load.check()
