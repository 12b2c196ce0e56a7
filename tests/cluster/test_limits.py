"""A full disk of the database, a full queue, and databases that promise less than they should (T19)."""
import contextlib
import subprocess

import pytest

import shapes
from api_conftest import SLOW, check_problem
from faults import upload_slow


def filler(seed, count=20_000):
    """Comments make bytes of any number, 67 each here, and digits that no compression makes small."""
    return b"".join(b"# %064x\n" % (pow(3, seed * count + n, 2**256)) for n in range(count))


def test_what_it_tells_of_itself(cluster):
    cluster.wait_for("all nodes", lambda: {(node.info()["cluster"]["nodes"], node.info()["cluster"]["durability"])
                                           for node in cluster.nodes} == {(3, "replicated")})
    for node in cluster.nodes:
        info = node.info()
        assert info["node"].split(".")[0] == node.name
        assert info["cluster"]["queued"] >= 0 and info["cluster"]["running"] >= 0
        with node.client() as client:
            values = dict(line.rsplit(" ", 1) for line in client.get("/metrics").text.splitlines() if not line.startswith("#"))
        assert values["quadmeshd_store_up"] == "1"
        assert int(values['quadmeshd_store_seconds_count{verb="beat",outcome="stored"}']) > 0


def test_a_database_alone_is_one_machine(make_cluster):
    cluster = make_cluster(1)
    assert cluster.nodes[0].info()["cluster"]["durability"] == "one machine"


def test_a_database_that_promises_nothing_is_refused(make_cluster):
    """Without fsync an acknowledged write is lost with the power; who wants that says so."""
    cluster = make_cluster(1)
    (node,) = cluster.nodes
    node.kill()
    cluster.database.primary.stop()
    cluster.database.primary.start(fsync="off")
    with pytest.raises(AssertionError, match="fsync"):
        node.start()
    settings = node.settings
    node.settings, node.daemon = [*settings, "--store-unsafe", 1], None
    node.start()
    assert node.info()["cluster"]["durability"] == "none"


def test_the_address_may_come_from_a_file(make_cluster):
    cluster = make_cluster(1)
    (node,) = cluster.nodes
    node.stop()
    file = node.folder / "store"
    file.write_text(node.store + "\n")
    file.chmod(0o600)
    place = node.settings.index("--store")
    node.settings[place:place + 2] = ["--store-file", file]
    node.daemon = None
    node.start()
    assert node.info()["cluster"]["nodes"] == 1


def test_a_full_disk_of_the_database(make_cluster):
    """Files of the server may have 40 MiB: log segments fit, the table of blobs does not grow further."""
    cluster = make_cluster(1)
    (node,) = cluster.nodes
    primary = cluster.database.primary
    primary.stop()
    primary.prefix = ["prlimit", f"--fsize={40 * 2**20 + 100}"]
    primary.start()
    with node.client() as client:
        cluster.wait_until_ready()
        rest = filler(0, 150_000)
        replies = [client.post("/v1/meshes", content=shapes.obj(shapes.cube(side=side)) + rest) for side in range(1, 8)]
        codes = [reply.status_code for reply in replies]
        print(codes)
        assert codes[0] == 201 and codes[-1] in (503, 507), codes
        assert set(codes) <= {201, 503, 507}, codes
        assert all("database" in reply.json()["detail"] for reply in replies if reply.status_code == 507)
        for reply in replies:
            if reply.status_code == 201:
                assert client.get(f"/v1/meshes/{reply.json()['id']}/content").status_code == 200
            else:
                check_problem(reply, reply.status_code)
        listed = client.get("/v1/meshes").json()["meshes"]
        assert len(listed) == codes.count(201)
        # What needs no blob still works.
        assert client.hausdorff(listed[0]["id"], listed[1]["id"])["state"] == "succeeded"


@pytest.fixture
def mount(tmp_path):
    """Folders on disks of their own, of so many MiB."""
    made = []

    def make(size):
        folder = tmp_path / f"disk{len(made)}"
        folder.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}m,mode=700", "none", folder], check=True)
        made.append(folder)
        return folder

    yield make
    for folder in made:
        subprocess.run(["umount", "-l", folder], check=True)


def fill(file):
    """Takes all that is left of a disk."""
    with contextlib.suppress(OSError), open(file, "wb") as filler:
        while True:
            filler.write(bytes(4096))
            filler.flush()


def test_a_full_disk_of_the_cache(make_cluster, mount):
    """Nothing half is stored by the node whose disk is full, and the other one serves all of it."""
    cluster = make_cluster(1)
    disk = mount(100)  # a node with less than 64 MiB is not ready
    full = cluster.add_node("n2", "--data-dir", disk / "data")
    files = [filler(side) + shapes.obj(shapes.cube(side=side)) for side in range(1, 9)]
    with cluster.nodes[0].client() as client, full.client() as other:
        meshes = [client.upload(file)["id"] for file in files[:4]]
        codes = [other.get(f"/v1/meshes/{mesh}/content").status_code for mesh in meshes]
        fill(disk / "other")
        replies = [other.post("/v1/meshes", content=file) for file in files[4:]]
        codes += [reply.status_code for reply in replies]
        codes += [other.get(f"/v1/meshes/{client.upload(file)['id']}/content").status_code for file in files[4:]]
        print(codes)
        assert set(codes) <= {200, 201, 503, 507} and {503, 507} & set(codes), codes
        for reply in replies:
            if reply.status_code != 201:
                check_problem(reply, reply.status_code)
        listed = [mesh["id"] for mesh in client.get("/v1/meshes").json()["meshes"]]
        assert len(listed) == len(files)
        assert {client.get(f"/v1/meshes/{mesh}/content").status_code for mesh in listed} == {200}
        (disk / "other").unlink()
        assert {other.get(f"/v1/meshes/{mesh}/content").status_code for mesh in meshes[:1]} == {200}


def test_a_full_disk_of_the_place_of_blobs(make_cluster, mount):
    disk = mount(4)
    cluster = make_cluster(2, settings=("--blobs", disk))
    first, second = cluster.nodes
    with first.client() as client, second.client() as other:
        replies = [client.post("/v1/meshes", content=filler(side) + shapes.obj(shapes.cube(side=side))) for side in range(1, 6)]
        codes = [reply.status_code for reply in replies]
        assert codes[0] == 201 and codes[-1] == 507 and set(codes) == {201, 507}, codes
        assert "place of its blobs" in check_problem(replies[-1], 507, "storage_full")["detail"]
        listed = [mesh["id"] for mesh in other.get("/v1/meshes").json()["meshes"]]
        assert len(listed) == codes.count(201)
        assert {other.get(f"/v1/meshes/{mesh}/content").status_code for mesh in listed} == {200}
    assert not [file for file in disk.iterdir() if file.suffix == ".part"]


def test_a_full_queue(make_cluster, slow_files):
    """The limit is one of the cluster. A worker begins several jobs, which take turns: the queue fills when no more may begin."""
    cluster = make_cluster(2, settings=("--queue", 5, "--workers", 1))
    pair = upload_slow(cluster, slow_files)
    jobs, refused = [], set()
    with cluster.nodes[0].client() as first, cluster.nodes[1].client() as second:
        clients = [first, second]
        for k in range(400):
            # Two equal questions would be one run.
            reply = clients[k % 2].post("/v1/jobs", json={"type": "hausdorff", "a": pair[0], "b": pair[1], **SLOW,
                                                         "tolerance": 1e-12 * (1 + k)})
            if reply.status_code == 429:
                check_problem(reply, 429, "too_many_jobs")
                assert int(reply.headers["retry-after"]) > 0
                refused.add(k % 2)
            else:
                jobs.append(reply.json()["id"])
            if refused == {0, 1}:
                break
        assert refused == {0, 1}, len(jobs)
        for client in clients:  # a worker may begin more of them at any time
            def tells_all(client=client):
                told = client.get("/v1/info").json()["cluster"]
                assert told["queued"] <= 5
                return told["queued"] + told["running"] == len(jobs)
            cluster.wait_for("the counts", tells_all)
        for job in reversed(jobs):
            assert first.delete(f"/v1/jobs/{job}").status_code in (200, 202)
        assert all(second.get("/v1/info").json()[name] < 1000 for name in ("queued", "running"))
