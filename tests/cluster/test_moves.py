"""From one daemon's own store to a cluster and back, with the same answers (T20)."""
import random
import re
import subprocess
import threading
import time

import pytest

from api_conftest import BUILD, Daemon
from faults import SEED, choose
from load import Load
from postgres import NAME

KILLS = choose(6, 40)


def answers(daemon):
    """All that the daemon tells of what it stores, but the milliseconds of expiry, which each store has by its own clock."""
    told = {}
    with daemon.client() as client:
        for kind in ("meshes", "jobs", "layouts", "reconstructions"):
            items, cursor = [], {}
            while cursor is not None:  # a cursor has the store's own numbers
                page = client.get(f"/v1/{kind}", params={"limit": 1000, **cursor}).json()
                items += page[kind]
                cursor = {"cursor": page["next"]} if page["next"] else None
            told[kind] = [item["id"] for item in items]
            for item in items:
                path = f"/v1/{kind}/{item['id']}"
                told[path] = re.sub(r'"expires_at":"([^"]*)\.\d{3}Z"', r'"expires_at":"\1"', client.get(path).text)
                if kind == "meshes":
                    told[path + "/vertices"] = client.get(path + "/vertices").content
                if kind == "jobs":
                    told[path + "/events"] = client.events(item["id"])
    return told


def run(*arguments):
    subprocess.run([BUILD / "quadmeshd", *map(str, arguments)], check=True, capture_output=True)


def test_there_and_back(make_cluster, tmp_path):
    embedded = make_cluster(1, store="embedded")
    (node,) = embedded.nodes
    with Load(embedded, SEED) as load:
        time.sleep(2)
    load.check()
    first = answers(node.daemon)
    assert node.stop() == 0

    cluster = make_cluster(2)
    shared = cluster.nodes[0]
    run("--store", shared.store, "--import", node.folder / "data")
    assert all(answers(one.daemon) == first for one in cluster.nodes)
    imported = node.folder / "data/imported"
    again = subprocess.run([BUILD / "quadmeshd", "--store", shared.store, "--import", node.folder / "data"], capture_output=True,
                           text=True)
    assert again.returncode == 1 and str(imported) in again.stderr  # what was deleted would come back
    imported.unlink()
    run("--store", shared.store, "--import", node.folder / "data")  # what is there is passed over
    assert all(answers(one.daemon) == first for one in cluster.nodes)

    (tmp_path / "back").mkdir()
    run("--store", shared.store, "--export", tmp_path / "back/data")
    back = Daemon(tmp_path / "back")
    assert answers(back) == first
    assert back.stop() == 0


@pytest.mark.timeout(120 + 10 * KILLS)
def test_an_import_that_succeeds_survives_the_database(make_cluster):
    """The database is killed at random instants: an import that says it is done has lost nothing, and one that failed can be
    made again on what is left."""
    embedded = make_cluster(1, store="embedded")
    (node,) = embedded.nodes
    with Load(embedded, SEED) as load:
        time.sleep(3)
    load.check()
    first = answers(node.daemon)
    assert node.stop() == 0
    cluster, chance, ends = make_cluster(0), random.Random(SEED), []
    server = cluster.database.primary
    store = f"postgres://{NAME}@127.0.0.1:{server.port}/{NAME}"
    for _ in range(KILLS):
        if not ends or ends[-1] == 0:
            cluster.query("DROP SCHEMA IF EXISTS quadmeshd CASCADE")
        importing = subprocess.Popen([BUILD / "quadmeshd", "--store", store, "--import", node.folder / "data"],
                                     stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(chance.uniform(0.0, 0.3))
        server.kill()
        server.start()
        ends.append(importing.wait())
        if ends[-1] == 0:
            for kind in ("meshes", "jobs", "layouts", "reconstructions"):
                found = cluster.query(f"SELECT count(*) FROM quadmeshd.{kind}")
                assert int(found[0][0]) == len(first[kind]), (ends, kind)
    if ends[-1] != 0:
        run("--store", store, "--import", node.folder / "data")
    assert answers(cluster.add_node("n1").daemon) == first, ends


def test_an_export_during_work_is_whole(make_cluster, tmp_path):
    """While clients create, change and remove, each export is a snapshot: everything that its rows name is in it."""
    cluster = make_cluster(2)
    exports = []

    def export():
        for number in range(5):
            exports.append(tmp_path / f"{number}")
            exports[-1].mkdir()
            run("--store", cluster.nodes[0].store, "--export", exports[-1] / "data")

    exporting = threading.Thread(target=export)
    with Load(cluster, SEED) as load:
        exporting.start()
        exporting.join()
    load.check()
    assert len(exports) == 5
    for folder in exports:
        run("--data-dir", folder / "data", "--check")


def test_status_shows_the_standby(make_cluster):
    cluster = make_cluster(1, standby=True)
    ask = [BUILD / "quadmeshd", "--store", cluster.nodes[0].store, "--status"]
    told = subprocess.run(ask, capture_output=True, text=True, check=True).stdout
    assert "\ndurability: replicated\n" in told and "\nstandbys: 1\n" in told, told
    assert re.search(r"^standby: name=\S+ state=streaming sync=(sync|quorum)$", told, re.M), told
    cluster.wire.hold()  # commits wait for it
    done = subprocess.run(ask, capture_output=True, text=True)
    cluster.wire.release()
    assert done.returncode == 1 and "fault: the database does not confirm a commit" in done.stdout, done
