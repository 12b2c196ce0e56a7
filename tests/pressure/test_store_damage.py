"""A data folder whose files have changed behind the daemon's back: reported, never a wrong answer."""
import contextlib
import json
import os
import pathlib
import random
import sqlite3
import subprocess
import tarfile

import httpx
import pytest

import shapes
from api_conftest import BUILD, FINDINGS, WAIT, Daemon, check_problem, gauge

STORED = pathlib.Path(__file__).parent / "stored"
LONG = os.environ.get("QM_TEST_LONG") == "1"
SEED = int(os.environ.get("QM_TEST_SEED", 1))


@pytest.fixture
def stopped(tmp_path):
    """Starts daemons on one folder, and stops the one before."""
    made = []

    def start(*settings):
        stop()
        made.append(Daemon(tmp_path, *settings))
        return made[-1]

    def stop():
        if made and made[-1].process.poll() is None:
            assert made[-1].stop() == 0, made[-1].log()

    start.stop = stop
    start.data = tmp_path / "data"
    yield start
    stop()


def flip(path, bit):
    """Turns one bit of a file round."""
    with open(path, "r+b") as file:
        file.seek(bit // 8)
        byte = file.read(1)[0] ^ 1 << bit % 8
        file.seek(bit // 8)
        file.write(bytes([byte]))


def blob_of(start, mesh):
    return start.data / "blobs" / mesh["content_hash"][:2] / mesh["content_hash"]


def damage(path, how, chance):
    """Changes a file in one way."""
    size = path.stat().st_size
    if how == "flipped":
        flip(path, chance.randrange(8 * size))
    elif how == "truncated":
        os.truncate(path, chance.randrange(size))
    elif how == "longer":
        path.write_bytes(path.read_bytes() + b"\n")
    else:
        path.unlink()


@pytest.mark.parametrize("how", ["flipped", "truncated", "longer", "gone"])
def test_a_damaged_file_of_a_mesh_is_reported_and_healed_by_its_upload(stopped, how):
    """Whatever bytes have changed: comments and unused digits of an OBJ file decode as before."""
    chance = random.Random(SEED)
    content = shapes.obj(shapes.sphere(parallels=10, meridians=20))
    for _ in range(50 if LONG else 3):
        with stopped().client() as client:
            mesh = client.upload(content, name="a.obj")
            first = client.hausdorff(mesh["id"], mesh["id"])["result"]
        stopped.stop()
        damage(blob_of(stopped, mesh), how, chance)
        running = stopped()
        with running.client() as client:
            problem = check_problem(client.get(f"/v1/meshes/{mesh['id']}/content"), 500, "blob_damaged")
            assert mesh["id"] in problem["detail"]
            job = client.hausdorff(mesh["id"], mesh["id"], {"Cache-Control": "no-cache"})
            assert job["state"] == "failed" and job["problem"]["code"] == "blob_damaged"
            assert gauge(client, "damages_total") == 2 and gauge(client, "repairs_total") == 0
            assert f"blob {mesh['content_hash']} of mesh {mesh['id']} is" in running.log()
            # An upload of other bytes changes nothing; one of the same bytes is the same mesh, and repairs it.
            client.upload(shapes.cube())
            check_problem(client.get(f"/v1/meshes/{mesh['id']}/content"), 500, "blob_damaged")
            reply = client.post("/v1/meshes", params={"name": "a.obj"}, content=content)
            assert reply.status_code == 200 and reply.json()["id"] == mesh["id"]
            assert gauge(client, "repairs_total") == 1
            again = client.hausdorff(mesh["id"], mesh["id"], {"Cache-Control": "no-cache"})["result"]
            assert (again["lower"], again["upper"]) == (first["lower"], first["upper"])
            reply = client.post("/v1/meshes", params={"name": "a.obj"}, content=content)
            assert reply.status_code == 200 and gauge(client, "repairs_total") == 1
            assert blob_of(stopped, mesh).read_bytes() == content


def test_an_upload_under_another_name_heals_too(stopped):
    content = shapes.ply_little(shapes.cube())
    with stopped().client() as client:
        mesh = client.upload(content, name="one")
    stopped.stop()
    flip(blob_of(stopped, mesh), 77)
    with stopped().client() as client:
        check_problem(client.get(f"/v1/meshes/{mesh['id']}/content"), 500, "blob_damaged")
        assert client.upload(content, name="two")["id"] != mesh["id"]
        assert client.hausdorff(mesh["id"], mesh["id"])["state"] == "succeeded"


@pytest.mark.parametrize("how", ["flipped", "truncated", "gone"])
def test_damaged_positions_are_reported(stopped, how):
    with stopped().client() as client:
        mesh = client.upload(shapes.cube())
        client.patch(f"/v1/meshes/{mesh['id']}/vertices", json={"indices": [7], "positions": [[2, 2, 2]]})
    stopped.stop()
    [positions] = [path for path in (stopped.data / "blobs").rglob("*") if path.is_file() and path != blob_of(stopped, mesh)]
    damage(positions, how, random.Random(SEED))
    with stopped().client() as client:
        check_problem(client.get(f"/v1/meshes/{mesh['id']}/content"), 500, "blob_damaged")
        reply = client.patch(f"/v1/meshes/{mesh['id']}/vertices", json={"indices": [7], "positions": [[3, 3, 3]]})
        check_problem(reply, 500, "blob_damaged")
        assert client.delete(f"/v1/meshes/{mesh['id']}").status_code == 204
        assert client.get(f"/v1/meshes/{client.upload(shapes.cube())['id']}/content").status_code == 200


# ---- arrays of results ----


def deviation(client, pair):
    """Few pieces: what counts are the distances at the vertices."""
    reply = client.post("/v1/jobs", json={"type": "deviation", "a": pair[0], "b": pair[1], "pieces": 1024},
                        headers={"Prefer": WAIT})
    assert reply.status_code == 200, reply.text
    return reply.json()


@pytest.mark.parametrize("how", ["flipped", "truncated", "longer", "gone"])
def test_a_damaged_array_is_reported_and_computed_again(stopped, how):
    """Never served in part: 104 of 39,200 bytes were an array of 13 numbers."""
    chance = random.Random(SEED)
    with stopped().client() as client:
        pair = [client.upload(shapes.sphere(turn))["id"] for turn in (0, shapes.SPHERE_TURN)]
        job = deviation(client, pair)["id"]
        distances = client.get(f"/v1/jobs/{job}/result").json()["vertex_distances"]
        assert len(distances) == 4900
    for _ in range(50 if LONG else 3):
        stopped.stop()
        damage(stopped.data / "results" / f"{job}.f64", how, chance)
        running = stopped()
        with running.client() as client:
            assert client.get(f"/v1/jobs/{job}").json()["state"] == "succeeded"
            assert deviation(client, pair)["id"] == job  # nobody has read the array yet
            for media in ("application/json", "text/csv", "application/octet-stream"):
                check_problem(client.get(f"/v1/jobs/{job}/result", headers={"Accept": media}), 500, "record_damaged")
            assert gauge(client, "damages_total") == 3
            assert f"array of job {job} is damaged" in running.log()
            new = deviation(client, pair)["id"]
            assert new != job
            assert client.get(f"/v1/jobs/{new}/result").json()["vertex_distances"] == distances
            job = new


def test_a_long_reply_is_cut_where_the_damage_begins(stopped):
    """Its status has been sent: what is left is an end that no client takes for a whole one."""
    with stopped().client() as client:
        pair = [client.upload(shapes.sphere(turn, parallels=300, meridians=300))["id"] for turn in (0, 0.01)]
        job = deviation(client, pair)["id"]
    stopped.stop()
    flip(stopped.data / "results" / f"{job}.f64", 8 * 8 * 80_000)
    with stopped().client() as client:
        for media in ("application/json", "text/csv", "application/octet-stream"):
            with pytest.raises(httpx.RemoteProtocolError):
                client.get(f"/v1/jobs/{job}/result", headers={"Accept": media})
        assert deviation(client, pair)["id"] != job


# ---- folders of earlier versions ----


@pytest.mark.parametrize("name", sorted(path.name for path in STORED.iterdir()))
def test_a_folder_of_an_earlier_version_is_read(stopped, name):
    """Everything in it is there as it was, and in use."""
    with tarfile.open(STORED / name) as packed:
        packed.extractall(stopped.data.parent)
    with sqlite3.connect(stopped.data / "quadmeshd.sqlite") as old:
        before = [row[0] for row in old.execute("SELECT document FROM meshes ORDER BY sequence")]
        jobs = old.execute("SELECT id, result, idempotency_key FROM jobs WHERE document IS NOT NULL").fetchall()
        unfinished = [row[0] for row in old.execute("SELECT id FROM jobs WHERE document IS NULL")]
        old.execute("PRAGMA journal_mode").fetchone()
    old.close()
    arrays = {path.stem: path.read_bytes() for path in (stopped.data / "results").iterdir()}
    assert len(before) == 6 and len(jobs) == 4 and len(unfinished) == 1 and len(arrays) == 2
    no_notes = {"unit": None, "uncertainty": 0, "labels": []}  # the columns are newer than all of these folders
    for start in range(2):
        running = stopped("--grace", 0)
        with running.client() as client:
            meshes = client.get("/v1/meshes").json()["meshes"]
            assert meshes == [json.loads(document) | no_notes for document in before]
            for mesh in meshes:
                reply = client.get(f"/v1/meshes/{mesh['id']}/vertices", headers={"Accept": "application/octet-stream"})
                assert reply.status_code == 200 and len(reply.content) == 24 * mesh["vertices"]
            for job, result, _ in jobs:
                today = json.loads(result.replace('"tolerance":', '"gap":'))  # as the member is called now
                assert client.get(f"/v1/jobs/{job}").json()["result"] == today
                reply = client.get(f"/v1/jobs/{job}/result", headers={"Accept": "application/octet-stream"})
                assert reply.status_code == (200 if job in arrays else 406)
                if job in arrays:
                    assert reply.content == arrays[job]
                assert client.events(job)[-1]["result"] == today
            [named] = [job for job, _, key in jobs if key == "the first"]
            request = client.get(f"/v1/jobs/{named}").json()["request"]
            assert "gap" in request and "tolerance" not in request
            same = client.post("/v1/jobs", json={"type": "hausdorff", "a": meshes[0]["id"], "b": meshes[1]["id"]},
                               headers={"Idempotency-Key": "the first", "Prefer": WAIT})
            assert same.json()["id"] == named and request["a"] == meshes[0]["id"]
            assert client.get(f"/v1/jobs/{unfinished[0]}").json()["state"] in ("queued", "running")
            assert len(client.get("/v1/layouts").json()["layouts"]) == 1
            new = client.upload(shapes.cube(side=3 + start))["id"]
            assert client.hausdorff(new, meshes[0]["id"])["state"] == "succeeded"
            before.append(json.dumps(client.get(f"/v1/meshes/{new}").json()))
        if start == 0:
            assert ("becomes" in running.log()) and stopped.stop() is None


def test_a_database_that_an_earlier_version_began_is_made(stopped):
    """Killed after the first page and before the tables."""
    stopped.data.mkdir()
    database = sqlite3.connect(stopped.data / "quadmeshd.sqlite")
    assert database.execute("PRAGMA journal_mode = WAL").fetchone() == ("wal",)
    database.close()
    assert (stopped.data / "quadmeshd.sqlite").stat().st_size > 0
    for _ in range(2):
        with stopped().client() as client:
            client.upload(shapes.cube())
            assert len(client.get("/v1/meshes").json()["meshes"]) == 1


# ---- a lost database ----


def command(start, *flags):
    done = subprocess.run([BUILD / "quadmeshd", "--data-dir", start.data, *flags], capture_output=True, text=True, timeout=60)
    assert not any(finding in done.stderr for finding in FINDINGS), done.stderr
    return done


@pytest.mark.parametrize("how", ["gone", "empty"])
def test_files_without_a_database_are_never_swept(stopped, how):
    """`rm quadmeshd.sqlite*` and a start deleted every mesh."""
    with stopped().client() as client:
        content = shapes.ply_little(shapes.sphere())
        mesh = client.upload(content, name="sphere.ply")
        moved = client.upload(shapes.cube())["id"]
        client.patch(f"/v1/meshes/{moved}/vertices", json={"indices": [7], "positions": [[2, 2, 2]]})
        deviation(client, (mesh["id"], moved))
    assert "another process" in command(stopped, "--empty").stderr
    stopped.stop()
    assert "there is a database" in command(stopped, "--empty").stderr
    for path in stopped.data.glob("quadmeshd.sqlite*"):
        path.unlink() if how == "gone" else os.truncate(path, 0)
    for path in (stopped.data / "blobs").rglob("*"):
        os.utime(path, (1e9, 1e9))
    refused = command(stopped)
    assert refused.returncode == 1 and "--adopt" in refused.stderr and "--empty" in refused.stderr
    adopted = command(stopped, "--adopt")
    assert adopted.returncode == 0, adopted.stderr
    # The two files, not the positions of the moved one.
    assert "2 meshes adopted, 1 files moved to lost/" in adopted.stdout
    with stopped().client() as client:
        meshes = {one["content_hash"]: one for one in client.get("/v1/meshes").json()["meshes"]}
        assert len(meshes) == 2
        again = meshes[mesh["content_hash"]]
        assert again["vertices"] == mesh["vertices"] and again["name"] == "" and again["id"] != mesh["id"]
        assert client.upload(content)["id"] == again["id"]
        assert client.hausdorff(again["id"], again["id"])["state"] == "succeeded"
    stopped.stop()
    assert "0 meshes adopted, 0 files" in command(stopped, "--adopt").stdout


def test_files_without_a_database_can_be_moved_away(stopped):
    with stopped().client() as client:
        client.upload(shapes.cube())
    stopped.stop()
    (stopped.data / "quadmeshd.sqlite").unlink()
    assert command(stopped, "--empty").returncode == 0
    assert len([path for path in (stopped.data / "lost").rglob("*") if path.is_file()]) == 1
    with stopped().client() as client:
        assert client.get("/v1/meshes").json()["meshes"] == []


# ---- check and repair ----


def test_a_check_finds_what_is_damaged(stopped):
    with stopped().client() as client:
        good, bad = (client.upload(shapes.sphere(turn)) for turn in (0, shapes.SPHERE_TURN))
        moved = client.upload(shapes.cube())["id"]
        client.patch(f"/v1/meshes/{moved}/vertices", json={"indices": [7], "positions": [[2, 2, 2]]})
        jobs = [deviation(client, pair)["id"] for pair in ((good["id"], bad["id"]), (bad["id"], good["id"]))]
        assert "another process" in command(stopped, "--check").stderr
    stopped.stop()
    whole = command(stopped, "--check")
    assert whole.returncode == 0 and whole.stdout == "quadmeshd: 3 meshes, 4 files, 2 jobs: 0 faults, 0 repaired; " \
        "0 files without a mesh\n", whole.stdout + whole.stderr
    flip(blob_of(stopped, bad), 5000)
    os.truncate(stopped.data / "results" / f"{jobs[0]}.f64", 104)
    stray = stopped.data / "blobs/ab" / ("ab" + "0" * 62)
    stray.parent.mkdir(exist_ok=True)
    stray.write_bytes(b"nobody's")
    for repair, faults in ((["--check"], "2 faults, 0 repaired"), (["--check", "--repair"], "2 faults, 1 repaired")):
        found = command(stopped, *repair)
        assert found.returncode == 1
        lines = found.stdout.splitlines()
        assert f"mesh {bad['id']}: file {bad['content_hash']} is damaged" in lines
        assert lines[1].startswith(f"job {jobs[0]} has a damaged array")
        assert lines[2] == f"file {stray.name} belongs to no mesh"
        assert len(lines) == 3 and faults in found.stderr
    with stopped().client() as client:
        client.upload(shapes.sphere(shapes.SPHERE_TURN))
        assert deviation(client, (good["id"], bad["id"]))["id"] != jobs[0]
        assert deviation(client, (bad["id"], good["id"]))["id"] == jobs[1]
        assert client.delete(f"/v1/meshes/{moved}").status_code == 204


# ---- the database ----


def answers(client, ids):
    """What the daemon says of everything stored: the status and, unless that is a fault of its own, the text."""
    paths = ["/v1/meshes", "/v1/jobs", "/v1/layouts", *(f"/v1/meshes/{mesh}" for mesh in ids["meshes"]),
             *(f"/v1/jobs/{job}{part}" for job in ids["jobs"] for part in ("", "/result", "/events")),
             *(f"/v1/layouts/{layout}" for layout in ids["layouts"])]
    found = {}
    for path in paths:
        reply = client.get(path, headers={"Accept": "application/x-ndjson" if path.endswith("events") else "application/json"})
        found[path] = (reply.status_code, reply.text if reply.status_code < 500 else None)
    # A request that was answered before: by the same job, or computed again.
    request = {"type": "hausdorff", "a": ids["meshes"][0], "b": ids["meshes"][1]}
    reply = client.post("/v1/jobs", json=request, headers={"Prefer": WAIT})
    again = reply.json().get("result", {})
    found["again"] = (reply.status_code, (again["lower"], again["upper"]) if reply.status_code == 200 else None)
    return found


def test_a_bit_of_the_database_is_never_a_wrong_answer(stopped):
    """Wherever it is: rows, indices, the schema, the header, free pages. The daemon does not start, or says 500."""
    with stopped().client() as client:
        meshes = [client.upload(shapes.sphere(turn, parallels=8, meridians=12), name=f"m{turn}")["id"] for turn in (0, 0.1)]
        meshes += [client.upload(shapes.cube(side=side))["id"] for side in range(1, 12)]
        jobs = [client.hausdorff(*meshes[:2])["id"], deviation(client, meshes[:2])["id"]]
        jobs += [client.hausdorff(meshes[0], other)["id"] for other in meshes[2:]]
        layouts = [client.post("/v1/layouts", json={"mesh": meshes[0]}).json()["id"]]
        ids = {"meshes": meshes, "jobs": jobs, "layouts": layouts}
        whole = answers(client, ids)
        assert all(status == 200 for status, _ in whole.values()), whole
    stopped.stop()
    path = stopped.data / "quadmeshd.sqlite"
    database, blobs = path.read_bytes(), sorted((stopped.data / "blobs").rglob("*"))
    chance = random.Random(SEED)
    # Each page once, and each byte of the header that decides how the file is read.
    places = [page * 4096 + chance.randrange(4096) for page in range(len(database) // 4096)]
    places += [chance.randrange(len(database)) for _ in range(2000)] if LONG else []
    places += [*range(16, 24), 60, 63, 92, 99] if LONG else [16, 18, 20, 63]
    refused = reported = 0
    for place in places:
        path.write_bytes(database)
        bit = 3 if place == 20 else chance.randrange(8)  # the bit that says that there are checksums
        flip(path, 8 * place + bit)
        try:
            running = stopped()
        except AssertionError as refusal:
            assert "data folder: database" in str(refusal), (place, bit)
            (stopped.data.parent / "log").write_text("")
            refused += 1
            continue
        with running.client() as client:
            found = answers(client, ids)
        for question, answer in found.items():
            if answer[0] >= 500:
                reported += 1
            elif question == "again":
                assert answer == whole[question], (place, bit)
            elif question != "/v1/jobs":  # which may have one more
                assert answer == whole[question], (place, bit, question)
        running.process.kill()
        running.process.wait()
        for rest in stopped.data.glob("quadmeshd.sqlite-*"):
            rest.unlink()
        assert set(blobs) <= set((stopped.data / "blobs").rglob("*"))
    path.write_bytes(database)
    assert refused >= 3 and reported > len(places) / 3, (refused, reported)
    with stopped().client() as client:
        assert answers(client, ids) == whole


def test_a_check_finds_a_damaged_page(stopped):
    with stopped().client() as client:
        for side in range(1, 30):
            client.upload(shapes.cube(side=side))
    stopped.stop()
    path = stopped.data / "quadmeshd.sqlite"
    for page in range(path.stat().st_size // 4096):
        flip(path, 8 * (4096 * page + 2000))
        assert command(stopped, "--check").returncode == 1, page
        flip(path, 8 * (4096 * page + 2000))
    assert command(stopped, "--check").returncode == 0


def test_a_damaged_page_costs_what_is_on_it(stopped):
    """What --repair copies is as it was; files whose rows are lost stay, for --adopt."""
    with stopped().client() as client:
        meshes = {mesh["id"]: mesh for mesh in (client.upload(shapes.cube(side=side)) for side in range(1, 40))}
        ids = list(meshes)
        jobs = {job["id"]: job for job in (client.hausdorff(ids[0], other) for other in ids[1:])}
        array = deviation(client, ids[:2])["id"]
        client.post("/v1/layouts", json={"mesh": ids[0]})
    stopped.stop()
    path = stopped.data / "quadmeshd.sqlite"
    whole = path.read_bytes()
    with contextlib.closing(sqlite3.connect(path)) as database:  # dbstat counts from 1
        schema = {page - 1 for page, in database.execute("SELECT pageno FROM dbstat WHERE name LIKE 'sqlite_%'")}
    repaired = poor = 0
    pages = range(0, len(whole) // 4096, 1 if LONG else 5)
    for page in pages:
        for rest in stopped.data.glob("quadmeshd.sqlite*"):
            rest.unlink()
        path.write_bytes(whole)
        flip(path, 8 * (4096 * page + 2000))
        done = command(stopped, "--repair")
        if done.returncode != 0:  # the header or the schema: for a backup, or --adopt
            assert page in schema and "database" in done.stderr, (page, schema, done.stderr)
            continue
        repaired += 1
        assert "made anew" in done.stdout, (page, done.stdout)
        # An array whose checksums are lost counts as damaged, until its job is gone.
        again = command(stopped, "--check")
        assert again.returncode == 0 or f"job {array} has a damaged array" in again.stdout.splitlines()[0], again.stdout
        adopted = int(command(stopped, "--adopt").stdout.split("quadmeshd: ")[1].split()[0])
        with stopped().client() as client:
            found = client.get("/v1/meshes", params={"limit": 1000}).json()["meshes"]
            assert len(found) == len(meshes) and sum(mesh["id"] not in meshes for mesh in found) == adopted
            assert all(mesh == meshes[mesh["id"]] for mesh in found if mesh["id"] in meshes)
            left = client.get("/v1/jobs", params={"limit": 1000}).json()["jobs"]
            assert all(job["result"] == jobs[job["id"]]["result"] for job in left if job["id"] in jobs)
            poor += len(left) < len(jobs) - 20
            assert client.get(f"/v1/jobs/{array}/result").status_code in (200, 404, 500)
        stopped.stop()
    # The page from which all others of a table are found costs the table.
    assert repaired >= len(pages) - len(schema) and repaired > 2 and poor <= 1


def test_there_is_nothing_to_check(stopped, tmp_path):
    assert command(stopped, "--check").returncode == 1
    assert not stopped.data.exists()
