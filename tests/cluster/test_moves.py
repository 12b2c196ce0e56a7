"""From one daemon's own store to a cluster and back, with the same answers (T20)."""
import subprocess
import time

from api_conftest import BUILD, Daemon
from faults import SEED
from load import Load


def answers(daemon):
    """All that the daemon tells of what it stores."""
    told = {}
    with daemon.client() as client:
        for kind in ("meshes", "jobs", "layouts", "reconstructions"):
            told[kind] = client.get(f"/v1/{kind}", params={"limit": 1000}).json()
            for item in told[kind][kind]:
                path = f"/v1/{kind}/{item['id']}"
                told[path] = client.get(path).json()
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
    run("--data-dir", node.folder / "data", "--export", tmp_path / "all.tar")

    cluster = make_cluster(2)
    shared = cluster.nodes[0]
    for _ in range(2):  # what is there is passed over
        run("--store", shared.store, "--data-dir", tmp_path / "import", "--import", tmp_path / "all.tar")
    assert all(answers(one.daemon) == first for one in cluster.nodes)
    run("--store", shared.store, "--data-dir", tmp_path / "export", "--export", tmp_path / "again.tar")

    (tmp_path / "back").mkdir()
    run("--data-dir", tmp_path / "back/data", "--import", tmp_path / "again.tar")
    back = Daemon(tmp_path / "back")
    assert answers(back) == first
    assert back.stop() == 0
