"""The places of blobs: a database, a folder, a bucket that fails in many ways (T18)."""
import concurrent.futures
import os
import random
import shutil
import subprocess
import time

import pytest

import proxy
import shapes
from api_conftest import BUILD, WAIT, check_problem
from bucket import Bucket
from faults import SEED, choose

LOST = "the place of --blobs has no quadmeshd-place"


@pytest.fixture(scope="module")
def bucket():
    made = Bucket()
    yield made
    made.close()


@pytest.fixture
def make_place(bucket, tmp_path):
    """The settings of a place of a kind, new for each test."""
    def make(kind, port=None):
        if kind == "database":
            return ()
        if kind == "folder":
            (tmp_path / "blobs").mkdir(exist_ok=True)
            return ("--blobs", tmp_path / "blobs")
        return ("--blobs", bucket.place(tmp_path.name, port), "--blobs-keys", bucket.write_keys(tmp_path / "keys"))
    return make


def big(side, count=20_000):
    """A file that is longer than the blocks of sockets: a cube after comments that no compression makes small."""
    return b"".join(b"# %064x\n" % pow(3, side * count + n, 2**256) for n in range(count)) + shapes.obj(shapes.cube(side=side))


def content(node, mesh):
    with node.client() as client:
        return client.get(f"/v1/meshes/{mesh}/content")


def blobs(cluster):
    return {generation: int(size) for generation, size in cluster.query("SELECT generation, size FROM quadmeshd.blobs")}


def check_files(cluster, files):
    """Each row has its object, and there are no others but those that the store knows of."""
    rows = blobs(cluster)
    known = {row[0] for row in cluster.query("SELECT generation FROM quadmeshd.blob_objects")} | {"quadmeshd-place"}
    assert {name: size for name, size in files.items() if name in rows} == rows
    assert set(files) - set(rows) <= known


@pytest.mark.parametrize("kind", ["database", "folder", "s3"])
def test_what_one_node_stores_another_reads(make_cluster, make_place, bucket, tmp_path, kind):
    cluster = make_cluster(2, settings=make_place(kind))
    first, second = cluster.nodes
    with first.client() as one, second.client() as two:
        a, b = one.upload(shapes.sphere())["id"], two.upload(shapes.sphere(turn=shapes.SPHERE_TURN))["id"]
        job = two.hausdorff(a, b)
        assert job["state"] == "succeeded"
        assert one.get(f"/v1/jobs/{job['id']}").json()["result"] == job["result"]
        assert one.patch(f"/v1/meshes/{a}/vertices", json={"indices": [0], "positions": [[0, 0, 2]]}).status_code == 200
        assert content(first, a).content == content(second, a).content != content(first, b).content
        job = one.post("/v1/jobs", json={"type": "deviation", "a": a, "b": b}, headers={"Prefer": WAIT}).json()["id"]
        arrays = [client.get(f"/v1/jobs/{job}/result", headers={"Accept": "text/csv"}) for client in (one, two)]
        assert arrays[0].status_code == 200 and arrays[0].content == arrays[1].content
        assert one.upload(big(1))["id"] == two.upload(big(1))["id"]
    if kind == "folder":
        check_files(cluster, {file.name: file.stat().st_size for file in (tmp_path / "blobs").iterdir()})
    if kind == "s3":
        check_files(cluster, bucket.files(tmp_path.name))


# ---- a bucket in trouble ----

FAULTS = {"500": {"status": 500}, "503": {"status": 503}, "429": {"status": 429}}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_that_passes_is_not_noticed(make_cluster, make_place, bucket, fault):
    cluster = make_cluster(2, settings=make_place("s3"))
    with cluster.nodes[0].client() as client, bucket.failing("PUT", 2, **FAULTS[fault]):
        mesh = client.upload(big(2))["id"]
    with bucket.failing("GET", 2, **FAULTS[fault]):
        assert content(cluster.nodes[1], mesh).status_code == 200


@pytest.mark.parametrize("fault", FAULTS)
def test_no_mesh_without_its_blob(make_cluster, make_place, bucket, tmp_path, fault):
    cluster = make_cluster(2, settings=make_place("s3"))
    first, second = cluster.nodes
    with first.client() as client:
        with bucket.failing("PUT", **FAULTS[fault]):
            reply = client.post("/v1/meshes", content=big(3))
            check_problem(reply, 503, "store_unavailable")
            assert int(reply.headers["retry-after"]) > 0
            assert client.get("/v1/meshes").json()["meshes"] == [] and blobs(cluster) == {}
        mesh = client.upload(big(3))["id"]
        with bucket.failing("GET", **FAULTS[fault]):
            check_problem(content(second, mesh), 503, "store_unavailable")
        assert content(second, mesh).status_code == 200
    check_files(cluster, bucket.files(tmp_path.name))


def test_answers_that_are_cut_or_spoiled(make_cluster, make_place, bucket):
    cluster = make_cluster(2, settings=make_place("s3"))
    first, second = cluster.nodes
    with first.client() as client:
        mesh = client.upload(big(4))["id"]
    with bucket.failing("GET", 1, cut=100_000):
        assert content(second, mesh).status_code == 200
    shutil.rmtree(second.folder / "data" / "blobs")
    second.stop()
    (second.folder / "data" / "blobs").mkdir()
    second.start()
    with bucket.failing("GET", spoiled=True):
        check_problem(content(second, mesh), 500, "blob_damaged")
    assert content(second, mesh).status_code == 200


@pytest.mark.parametrize("way", [proxy.UP, proxy.DOWN])
def test_connections_that_are_cut(make_cluster, make_place, bucket, way):
    """In the middle of the bytes of an upload, or before its answer, and of a download."""
    with proxy.Proxy(bucket.port, protocol=None) as link:
        cluster = make_cluster(2, settings=make_place("s3", link.port))
        with cluster.nodes[0].client() as client:
            for count in (1, 700, 500_000) if way == proxy.UP else (1, 60):
                link.cut_after(count, way)
                mesh = client.upload(big(5 + count))["id"]
        for count in (1, 500_000):
            link.cut_after(count, proxy.DOWN)
            assert content(cluster.nodes[1], mesh).status_code == 200


def test_a_bucket_that_is_slow_or_silent(make_cluster, make_place, bucket):
    with proxy.Proxy(bucket.port, protocol=None) as link:
        cluster = make_cluster(2, settings=make_place("s3", link.port))
        with cluster.nodes[0].client() as client:
            link.delay(up=0.3, down=0.3)
            mesh = client.upload(big(6))["id"]
            assert content(cluster.nodes[1], mesh).status_code == 200
            link.delay()
            link.hold()
            check_problem(client.post("/v1/meshes", content=big(7)), 503, "store_unavailable")
            # What needs no blob still works.
            assert [row["id"] for row in client.get("/v1/meshes").json()["meshes"]] == [mesh]
            link.release()
            client.upload(big(7))


def test_the_end_of_a_job_waits_for_the_bucket(make_cluster, make_place, bucket):
    """Its result has an array, which is a blob."""
    cluster = make_cluster(2, settings=make_place("s3"))
    with cluster.nodes[0].client() as client, cluster.nodes[1].client() as other:
        pair = [client.upload(shapes.sphere(turn=turn))["id"] for turn in (0.0, shapes.SPHERE_TURN)]
        with bucket.failing("PUT", status=503) as fault:
            job = client.post("/v1/jobs", json={"type": "deviation", "a": pair[0], "b": pair[1]}).json()["id"]
            cluster.wait_for("an attempt", lambda: fault.taken > 0)
            time.sleep(6)  # longer than the requests of one attempt
            assert other.get(f"/v1/jobs/{job}").json()["state"] == "running"
        assert other.wait(job)["state"] == "succeeded"
        assert other.get(f"/v1/jobs/{job}/result", headers={"Accept": "text/csv"}).status_code == 200


@pytest.mark.timeout(600)
def test_load_while_the_bucket_fails(make_cluster, make_place, bucket, tmp_path):
    """Each 201 has its blob, at every node; what was refused can be done again."""
    cluster = make_cluster(2, settings=make_place("s3"))
    chance = random.Random(SEED)
    files = [big(100 + n, 300) for n in range(choose(60, 1000))]
    stored = {}

    def upload(n):
        with cluster.nodes[n % 2].client() as client:
            while (reply := client.post("/v1/meshes", content=files[n])).status_code == 503:
                check_problem(reply, 503, "store_unavailable")
            assert reply.status_code == 201, reply.text
            stored[n] = reply.json()["id"]
            return content(cluster.nodes[1 - n % 2], stored[n]).status_code

    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        work = [pool.submit(upload, n) for n in range(len(files))]
        while not all(task.done() for task in work):
            with bucket.failing(chance.choice(["PUT", "GET"]), chance.choice([1, 5, 50]),
                                **chance.choice([*FAULTS.values(), {"cut": 5}, {"delay": 0.5}])):
                time.sleep(chance.uniform(0.0, 0.5))
        codes = [task.result() for task in work]
    print("seed", SEED, {code: codes.count(code) for code in codes})
    assert set(codes) <= {200, 503}
    for node in cluster.nodes:
        assert {content(node, mesh).status_code for mesh in stored.values()} == {200}
    check_files(cluster, bucket.files(tmp_path.name))


# ---- starts ----

def refuse(node, settings, message):
    """A start with these settings ends with this in one line; the node stays as it was."""
    before = node.settings, node.daemon
    node.settings, node.daemon = settings, None
    with pytest.raises(AssertionError, match=message):
        node.start()
    node.settings, node.daemon = before


def test_places_that_are_wrong(make_cluster, make_place, bucket, tmp_path, monkeypatch):
    right = make_place("s3")
    cluster = make_cluster(1, settings=right)
    (node,) = cluster.nodes
    node.stop()
    settings = list(node.settings)
    place = settings.index("--blobs")
    others = settings[:place] + settings[place + 4:]
    keys = bucket.write_keys(tmp_path / "wrong", secret="no such key")
    refuse(node, [*others], 'of the kind s3')
    refuse(node, [*others, *make_place("folder")], 'of the kind s3')
    refuse(node, [*others, "--blobs", right[1], "--blobs-keys", keys], "SignatureDoesNotMatch")
    refuse(node, [*others, "--blobs", right[1], "--blobs-keys", tmp_path / "none"], "file of keys")
    refuse(node, [*others, "--blobs", right[1]], "AWS_ACCESS_KEY_ID")
    refuse(node, [*others, "--blobs", bucket.place("another"), "--blobs-keys", right[3]], LOST)
    refuse(node, [*others, "--blobs", bucket.place("x", name="missing"), "--blobs-keys", right[3]], "NoSuchBucket")
    refuse(node, [*others, "--blobs", bucket.place("x", port=1), "--blobs-keys", right[3]], "does not answer")
    refuse(node, [*others, "--blobs", "s3://b?endpoint=gopher://x"], "BUCKET/PREFIX")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", bucket.keys[0])
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", bucket.keys[1])
    node.settings, node.daemon = [*others, "--blobs", right[1]], None
    node.start()
    with node.client() as client:
        client.upload(shapes.cube())


def test_an_embedded_store_has_no_other_place():
    done = subprocess.run([BUILD / "quadmeshd", "--blobs", "/tmp"], capture_output=True, text=True)
    assert done.returncode == 2 and "--store" in done.stderr


def test_a_folder_that_is_not_mounted(make_cluster, make_place, tmp_path):
    """The folder goes away while daemons run, and is away when one starts."""
    cluster = make_cluster(2, settings=make_place("folder"))
    first, second = cluster.nodes
    folder, away = tmp_path / "blobs", tmp_path / "away"
    with first.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        os.rename(folder, away)
        folder.mkdir()
        check_problem(client.post("/v1/meshes", content=big(8)), 503, "store_unavailable")
        check_problem(content(second, mesh), 503, "store_unavailable")
        assert list(folder.iterdir()) == []
        second.stop()
        refuse(second, second.settings, LOST)
        folder.rmdir()
        os.rename(away, folder)
        client.upload(big(8))
    second.start()
    assert content(second, mesh).status_code == 200


# ---- damage ----

def spoil(cluster, kind, bucket, folder, prefix):
    """Changes or removes the bytes of the only blob, in turn. Each kind of damage has its own name."""
    (generation,) = blobs(cluster)
    if kind == "database":
        yield lambda: cluster.query("DELETE FROM quadmeshd.blob_chunks")
        yield lambda: cluster.query("UPDATE quadmeshd.blob_chunks SET bytes = set_byte(bytes, 100, 0) WHERE n = 0")
    elif kind == "folder":
        yield lambda: (folder / generation).unlink()
        yield lambda: (folder / next(iter(blobs(cluster)))).write_bytes(b"other bytes")
    else:
        yield lambda: bucket.s3.delete_object(Bucket="meshes", Key=f"{prefix}/{generation}")
        yield lambda: bucket.s3.put_object(Bucket="meshes", Key=f"{prefix}/{next(iter(blobs(cluster)))}", Body=b"other bytes")


@pytest.mark.parametrize("kind", ["database", "folder", "s3"])
def test_an_upload_repairs(make_cluster, make_place, bucket, tmp_path, kind):
    """Also at the node whose own copy is whole, and of bytes that are as many as they were."""
    cluster = make_cluster(2, settings=make_place(kind))
    first, second = cluster.nodes
    with first.client() as client:
        mesh = client.upload(big(9))["id"]
        for damage in spoil(cluster, kind, bucket, tmp_path / "blobs", tmp_path.name):
            damage()
            second.stop()
            shutil.rmtree(second.folder / "data" / "blobs")
            second.start()
            check_problem(content(second, mesh), 500, "blob_damaged")
            assert client.upload(big(9))["id"] == mesh
            assert content(second, mesh).status_code == 200
