"""From one daemon's folder to a database that daemons share, and back, with the same answers; and what a database tells of
itself. Needs a PostgreSQL server (QM_TEST_POSTGRES).

QM_TEST_SEED moves the instants of the kills; the seed is shown when a test fails.
"""
import concurrent.futures
import os
import random
import re
import shutil
import signal
import socket
import struct
import subprocess
import tarfile
import time

import pytest

import shapes
from conftest import BUILD, FINDINGS, PATIENCE, ROOT, SLOW, WAIT, Daemon, gauge, make_database
from test_layouts import edit, saddle_layout

SEED = int(os.environ.get("QM_TEST_SEED", "1"))
KILLS = 40 if os.environ.get("QM_TEST_LONG", "0") != "0" else 6
UNENDED = ("queued", "running")


def run(*arguments, status=0, env=None):
    """Runs quadmeshd; gives what it printed, errors last."""
    done = subprocess.run([BUILD / "quadmeshd", *map(str, arguments)], capture_output=True, text=True, timeout=PATIENCE,
                          env=env)
    text = done.stdout + done.stderr
    assert done.returncode == status and not any(finding in text for finding in FINDINGS), text
    return text


def count(text):
    """The numbers of the summary of a copy: copied of each kind, there before, faults."""
    found = re.search(r"^quadmeshd: (\d+) meshes, (\d+) layouts, (\d+) reconstructions and (\d+) jobs copied; (\d+) were"
                      r" there: (\d+) faults$", text, re.M)
    assert found, text
    return [int(number) for number in found.groups()]


def submit(client, **request):
    reply = client.post("/v1/jobs", json=request, headers={"Prefer": WAIT})
    assert reply.status_code == 200, reply.text
    return reply.json()


def fill(client):
    """One of everything that a daemon stores."""
    ball, turned = (client.upload(shapes.sphere(turn), name=f"ball {turn}")["id"] for turn in (0.0, shapes.SPHERE_TURN))
    for side in range(1, 30):
        client.upload(shapes.obj(shapes.cube(side=side)), **({"ttl_seconds": 100000} if side % 2 else {}))
    bent = client.upload(shapes.saddle(24), name="saddle \u00fc")["id"]
    for z in (0.1, 0.2):
        reply = client.patch(f"/v1/meshes/{ball}/vertices", json={"indices": [3], "positions": [[0.0, 0.0, z]]})
        assert reply.status_code == 200, reply.text
    for tolerance in (1e-2, 1e-3):
        client.hausdorff(ball, turned, tolerance=tolerance, headers={"Idempotency-Key": f"key {tolerance}"}.items())
    assert submit(client, type="deviation", a=ball, b=turned, tolerance=1e-2)["state"] == "succeeded"
    assert submit(client, type="project", mesh=bent, points=[[0, 0, 1], [1, 2, 3]])["state"] == "succeeded"
    layout = client.post("/v1/layouts", json={"mesh": bent, **saddle_layout()}, headers={"Idempotency-Key": "drawn"}).json()
    split = edit(client, layout, "curves/6/split", point=[0, 0.1, 0])
    edit(client, split, "curves/merge", first=6, second=7)
    client.post(f"/v1/layouts/{layout['id']}/undo")
    whole = client.post("/v1/layouts", json={"mesh": bent, **saddle_layout()}).json()
    made = client.post("/v1/reconstructions", json={"layout": whole["id"]}, headers={"Idempotency-Key": "made"}).json()
    assert submit(client, type="reconstruction_step", reconstruction=made["id"],
                  until={"max_quads": 128})["state"] == "succeeded"
    assert submit(client, type="remesh", mesh=bent, quads=60)["state"] == "succeeded"


def start_slow(client, slow_files):
    """A job that does not end while a test runs, with its first bounds."""
    a, b = (client.upload(content)["id"] for content in slow_files)
    job = client.start(a, b, headers={"Cache-Control": "no-cache"}.items(), **SLOW)["id"]
    client.wait_for_progress(job)
    return job


def history_of(client, layout):
    """All revisions of a layout, undone and redone."""
    path, told = f"/v1/layouts/{layout['id']}", []
    steps = 0
    while (reply := client.post(path + "/undo")).status_code == 200:
        told.append(reply.json())
        steps += 1
    while (reply := client.post(path + "/redo")).status_code == 200:
        told.append(reply.json())
    while client.get(path).json()["revision"] != layout["revision"]:
        assert client.post(path + "/undo").status_code == 200
    return told


def without_expiry(value):
    """Each store has the times by its own clock, to the millisecond."""
    return re.sub(rb'"expires_at":"([^"]*)\.\d\d\dZ"', rb'"expires_at":"\1"', value)


def answers(running):
    """All that a daemon tells of what it stores, but for jobs that have not ended."""
    told = {}
    with running.client() as client:
        def get(path, **headers):
            reply = client.get(path, headers=headers)
            is_problem = reply.headers["content-type"] == "application/problem+json"  # which has the request's own id
            told[path, *headers.values()] = (reply.status_code, reply.headers.get("etag"),
                                             reply.json()["code"] if is_problem else without_expiry(reply.content))

        for kind in ("meshes", "jobs", "layouts", "reconstructions"):
            items = client.get(f"/v1/{kind}", params={"limit": 1000}).json()[kind]
            told[kind] = [item["id"] for item in items if item.get("state") not in UNENDED]
            for item in items:
                path = f"/v1/{kind}/{item['id']}"
                if item.get("state") in UNENDED:
                    continue
                get(path)
                if kind == "meshes":
                    get(path + "/content")
                    get(path + "/vertices", accept="application/json")
                if kind == "jobs":
                    get(path + "/events", accept="application/x-ndjson")
                    get(path + "/result")
                    get(path + "/result", accept="application/octet-stream")
                if kind == "layouts":
                    told[path, "history"] = history_of(client, item)
                if kind == "reconstructions":
                    get(path + "/patches")
        for subject in told["meshes"]:
            told["of", subject] = [job["id"] for job in
                                   client.get("/v1/jobs", params={"mesh": subject, "limit": 1000}).json()["jobs"]
                                   if job["state"] not in UNENDED]
    return told


def check_same(found, expected):
    assert found.keys() == expected.keys()
    for name, answer in expected.items():
        assert found[name] == answer, name


def check_keys(running, layouts):
    """Requests with the keys of before find what these have made."""
    with running.client() as client:
        jobs = client.get("/v1/jobs", params={"limit": 1000}).json()["jobs"]
        (first,) = [job for job in jobs if job["type"] == "hausdorff" and job["request"].get("gap") == 1e-2]
        request = {key: first["request"][key] for key in ("type", "a", "b", "gap")}
        reply = client.post("/v1/jobs", json=request, headers={"Idempotency-Key": f"key {1e-2}", "Prefer": WAIT})
        assert reply.json()["id"] == first["id"], reply.text
        mesh = client.get(f"/v1/layouts/{layouts[0]}").json()["mesh"]
        reply = client.post("/v1/layouts", json={"mesh": mesh, **saddle_layout()}, headers={"Idempotency-Key": "drawn"})
        assert reply.json()["id"] == layouts[0], reply.text


@pytest.fixture(scope="module")
def filled(request, tmp_path_factory, slow_files):
    """The folder of a daemon that was killed during a job, what it told before, and that job with its events."""
    folder = tmp_path_factory.mktemp("filled")
    running = Daemon(folder)
    request.addfinalizer(lambda: running.stop(signal.SIGKILL))
    with running.client() as client:
        fill(client)
        canceled = start_slow(client, slow_files)
        assert client.delete(f"/v1/jobs/{canceled}").status_code == 202
        assert client.wait(canceled)["state"] == "canceled"
        told = answers(running)
        job = start_slow(client, slow_files)
        time.sleep(1)  # its events are stored every half second
    running.stop(signal.SIGKILL)
    running.start()  # the answers are those of a daemon that has begun again
    with running.client() as client:
        client.wait_for_progress(job)
        time.sleep(1)
    running.stop(signal.SIGKILL)
    return folder / "data", told, job


def test_there_and_back(filled, make_node, tmp_path, request):
    folder, told, job = filled
    store = make_database()
    text = run("--store", store, "--import", folder)
    assert count(text)[4:] == [0, 0]
    first = make_node("first", store)
    check_same(answers(first), told)
    check_keys(first, told["layouts"])
    with first.client() as client:  # the job goes on as after a start of the old daemon
        client.wait_for_progress(job)
        events = client.get(f"/v1/jobs/{job}", headers={"Accept": "application/json"}).json()
        assert events["state"] in UNENDED
        assert client.delete(f"/v1/jobs/{job}").status_code == 202
        ended = client.wait(job)
        runs = [event for event in client.events(job) if event["event"] == "server_restart"]
        assert ended["state"] == "canceled" and len(runs) == 2, client.events(job)
    found = answers(first)
    assert first.stop() == 0
    (tmp_path / "back").mkdir()
    text = run("--store", store, "--export", tmp_path / "back/data")
    assert count(text)[4:] == [0, 0]
    back = Daemon(tmp_path / "back")
    request.addfinalizer(lambda: back.stop(signal.SIGKILL))
    check_same(answers(back), found)
    check_keys(back, told["layouts"])
    assert back.stop() == 0
    run("--data-dir", tmp_path / "back/data", "--check")


def rows_of(store):
    """Everything in the tables, by which a second import is to change nothing."""
    tables = ("blobs", "meshes", "jobs", "job_subjects", "job_queue", "job_events", "job_arrays", "layouts",
              "layout_revisions", "reconstructions")
    queries = "; ".join(f"SELECT '{table}', t::text FROM quadmeshd.{table} t ORDER BY 2" for table in tables)
    done = subprocess.run(["psql", "-X", "-A", "-t", store, "-c", queries], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_a_folder_is_imported_once(filled):
    """What was deleted since does not come back, but for those who ask for it; another database may have it, too."""
    store = make_database()
    copied = count(run("--store", store, "--import", filled[0]))
    subprocess.run(["psql", "-q", "-X", store, "-c", "DELETE FROM quadmeshd.meshes WHERE id IN"
                    " (SELECT id FROM quadmeshd.meshes ORDER BY sequence DESC LIMIT 1)"], check=True)
    before = rows_of(store)
    line = run("--store", store, "--import", filled[0], status=1).splitlines()[-1]
    assert "would come back" in line and f"{filled[0]}/imported" in line
    assert rows_of(store) == before
    (filled[0] / "imported").unlink()
    assert count(run("--store", store, "--import", filled[0])) == [1, 0, 0, 0, sum(copied) - 1, 0]
    assert count(run("--store", make_database(), "--import", filled[0]))[:4] == copied[:4]


def test_a_restored_folder_is_imported(filled, tmp_path):
    store, again = make_database(), make_database()
    run("--data-dir", filled[0], "--backup", tmp_path / "backup")
    run("--data-dir", tmp_path / "data", "--restore", tmp_path / "backup")
    run("--store", store, "--import", filled[0])
    run("--store", again, "--import", tmp_path / "data")
    assert anonymous(rows_of(again)) == anonymous(rows_of(store))


def test_a_folder_of_an_older_version_is_imported(tmp_path):
    with tarfile.open(ROOT / "tests/pressure/stored/schema7.tar.gz") as archive:
        archive.extractall(tmp_path, filter="data")
    store = make_database()
    copied = count(run("--store", store, "--import", tmp_path / "data"))
    assert copied[0] > 0 and copied[1] > 0 and copied[3] > 0 and copied[4:] == [0, 0]
    assert " 0 faults" in run("--store", store, "--check").splitlines()[-1]


def anonymous(rows):
    """Rows without what each copy makes anew: numbers of order, names of chunks, times of the copy."""
    kept = []
    for row in rows:
        table, _, text = row.partition("|")
        if table in ("layouts", "layout_revisions", "reconstructions", "meshes", "jobs", "blobs"):
            kept.append((table, re.sub(r'^\(\d+,|b_[a-z0-9]{20}|"\d{4}-[^"]*\+00"', "", text)))
    return sorted(kept)


def test_an_import_that_is_killed_is_made_again(filled):
    chance = random.Random(SEED)
    whole = make_database()
    start = time.monotonic()
    run("--store", whole, "--import", filled[0])
    taken = time.monotonic() - start
    store = make_database()
    for _ in range(KILLS):
        importing = subprocess.Popen([BUILD / "quadmeshd", "--store", store, "--import", str(filled[0])],
                                     stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(chance.uniform(0.0, taken))
        importing.kill()
        importing.wait()
    (filled[0] / "imported").unlink()  # one may have come to its end
    text = run("--store", store, "--import", filled[0])
    assert count(text)[5] == 0, f"seed {SEED}: {text}"
    assert anonymous(rows_of(store)) == anonymous(rows_of(whole)), f"seed {SEED}"
    assert " 0 faults" in run("--store", store, "--check").splitlines()[-1]


def test_an_export_that_is_killed_leaves_no_folder(filled, tmp_path):
    store = make_database()
    run("--store", store, "--import", filled[0])
    exporting = subprocess.Popen([BUILD / "quadmeshd", "--store", store, "--export", str(tmp_path / "data")])
    end = time.monotonic() + PATIENCE
    while not (tmp_path / "data.exporting/quadmeshd.sqlite").exists():
        assert time.monotonic() < end
    exporting.kill()
    exporting.wait()
    assert not (tmp_path / "data").exists()
    assert "cut off or still runs: in the first case, remove it" in run("--store", store, "--export", tmp_path / "data", status=1)
    shutil.rmtree(tmp_path / "data.exporting")
    assert count(run("--store", store, "--export", tmp_path / "data"))[4:] == [0, 0]


def test_an_end_that_was_asked_for_moves_along(make_node, tmp_path, slow_files, request):
    """The node that runs the job stands still: it has not heard of the cancelation when the database is copied."""
    store, again = make_database(), make_database()
    (tmp_path / "back").mkdir()
    first, second = (make_node(name, store) for name in ("n1", "n2"))
    with first.client() as client, second.client() as other:
        job = start_slow(client, slow_files)
        # The one that helps runs no job.
        asleep, awake = (first, second) if gauge(client, "jobs_running") == 1 else (second, first)
        assert gauge(client, "jobs_running") + gauge(other, "jobs_running") == 1
        os.kill(asleep.process.pid, signal.SIGSTOP)
        with awake.client() as asking:
            assert asking.delete(f"/v1/jobs/{job}").status_code == 202
        run("--store", store, "--export", tmp_path / "back/data")
    for node in (first, second):
        node.stop(signal.SIGKILL)
    run("--store", again, "--import", tmp_path / "back/data")
    for running in (Daemon(tmp_path / "back"), make_node("n3", again)):
        request.addfinalizer(lambda running=running: running.stop(signal.SIGKILL))
        with running.client() as client:
            assert client.wait(job)["state"] == "canceled"
            assert client.events(job)[-1]["event"] in ("result", "error")


def test_what_is_damaged_is_left_out(make_daemon, make_node):
    running = make_daemon()
    with running.client() as client:
        good, bad = (client.upload(shapes.cube(side=side)) for side in (1, 2))
        job = client.hausdorff(good["id"], bad["id"], tolerance=1e-3)["id"]
    assert running.stop() == 0
    digest = bad["content_hash"].removeprefix("sha256:")
    path = running.folder / "data/blobs" / digest[:2] / digest
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    store = make_database()
    text = run("--store", store, "--import", running.folder / "data", status=1)
    assert f"mesh {bad['id']}: file {digest} is damaged" in text and count(text) == [1, 0, 0, 1, 0, 1]
    node = make_node("node", store)
    with node.client() as client:
        assert [mesh["id"] for mesh in client.get("/v1/meshes").json()["meshes"]] == [good["id"]]
        assert client.get(f"/v1/jobs/{job}").json()["state"] == "succeeded"
        again = client.upload(shapes.cube(side=2))
        assert again["content_hash"] == bad["content_hash"]
    assert node.stop() == 0


def test_a_check_finds_what_the_database_has_lost(filled):
    store = make_database()
    run("--store", store, "--import", filled[0])
    assert " 0 faults" in run("--store", store, "--check").splitlines()[-1]
    lose = ("UPDATE quadmeshd.blob_chunks SET bytes = set_byte(bytes, 0, 255 - get_byte(bytes, 0)) WHERE generation ="
            " (SELECT generation FROM quadmeshd.blobs b JOIN quadmeshd.meshes m ON m.hash = b.hash ORDER BY sequence LIMIT 1);"
            " DELETE FROM quadmeshd.blob_chunks WHERE generation ="
            " (SELECT generation FROM quadmeshd.blobs b JOIN quadmeshd.job_arrays a USING (hash) LIMIT 1)")
    subprocess.run(["psql", "-q", "-X", store, "-c", lose], check=True)
    text = run("--store", store, "--check", status=1)
    assert re.search(r"^mesh m_\w+: file \w{64} is damaged$", text, re.M), text
    assert re.search(r"^job j_\w+ has a damaged array$", text, re.M) and " 2 faults" in text, text
    assert "only checked" in run("--store", store, "--repair", status=1)


def test_a_folder_in_use_is_not_imported(make_daemon):
    running = make_daemon()
    text = run("--store", make_database(), "--import", running.folder / "data", status=1)
    assert text.strip().endswith("another process uses the folder") and len(text.splitlines()) == 1


# ---- status ----

def facts(text):
    """The lines of a status by their names."""
    told = {}
    for line in text.splitlines():
        name, _, value = line.partition(": ")
        told.setdefault(name, []).append(value)
    return told


def test_status_of_an_empty_a_living_and_a_dead_cluster(make_node):
    store = make_database()
    told = facts(run("--store", store, "--status", status=1))
    assert told["tables"] == ["0"] and told["durability"] == ["one machine"] and len(told["fault"]) == 2
    assert told["engine"][0].startswith("PostgreSQL ") and told["standbys"] == ["0"]
    nodes = [make_node(name, store) for name in ("n1", "n2")]
    with nodes[0].client() as client:
        client.upload(shapes.cube())
    told = facts(run("--store", store, "--status"))
    assert "fault" not in told and told["nodes that live"] == ["2"] and told["meshes"] == told["blobs"] == ["1"]
    assert int(told["blob bytes"][0]) > 100 and told["jobs waiting"] == told["jobs running"] == ["0"]
    for name, line in zip(("n1", "n2"), told["node"]):
        fields = dict(field.split("=") for field in line.split())
        assert fields["name"] == name and fields["id"].startswith(name + ".") and fields["state"] == "working"
        assert float(fields["silent_s"]) < 10 and int(fields["workers"]) == 2
    for node in nodes:
        node.stop(signal.SIGKILL)
    ask = "UPDATE quadmeshd.node_beats SET beat = beat - interval '1 minute'"
    subprocess.run(["psql", "-q", "-X", store, "-c", ask], check=True)
    told = facts(run("--store", store, "--status", status=1))
    assert told["fault"] == ["no node lives"] and all(" state=silent " in line for line in told["node"])


@pytest.mark.parametrize("name", ["two words", "a\tb", "a\nb", "a=b", "\u00fc", "n" * 64])
def test_a_name_that_breaks_lists_is_refused(name):
    (line,) = run("--store", "postgres://nobody@127.0.0.1/none", "--node-name", name, status=2).splitlines()
    assert line.startswith("quadmeshd: --node-name takes at most 63 ")


def test_status_names_commits_that_are_lost():
    store = make_database()
    name = store.rpartition("/")[2]
    subprocess.run(["psql", "-q", "-X", store, "-c", f"ALTER DATABASE {name} SET synchronous_commit = off"], check=True)
    # A proxy may still have a session that began before.
    end = f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{name}'"
    subprocess.run(["psql", "-q", "-X", os.environ["QM_TEST_POSTGRES"], "-c", end], check=True, capture_output=True)
    told = facts(run("--store", store, "--status", status=1))
    assert told["durability"] == ["none"] and any("does not wait for its disk" in fault for fault in told["fault"])


@pytest.mark.parametrize("task", [["--status"], ["--check"], ["--import", "FOLDER"], ["--export", "FOLDER"]])
def test_a_database_that_is_not_there(task, tmp_path, filled):
    arguments = [str(filled[0] if task[0] == "--import" else tmp_path / "new") if word == "FOLDER" else word for word in task]
    (line,) = run("--store", make_database() + "_none", *arguments, status=1).splitlines()
    assert re.fullmatch(r'quadmeshd: database: .*database "\w+_none" does not exist', line)
    assert not (tmp_path / "new").exists()


def test_a_database_without_tables_is_not_exported(tmp_path):
    (line,) = run("--store", make_database(), "--export", tmp_path / "new", status=1).splitlines()
    assert line == "quadmeshd: database: it has no tables of quadmeshd"


def refuse_password(server):
    """Asks one client for a password as PostgreSQL does, and refuses it (protocol 3.0, chapter 55 of its manual)."""
    link, _ = server.accept()
    with link:
        while struct.unpack("!II", link.recv(8, socket.MSG_WAITALL))[1] in (80877103, 80877104):  # encryption: no
            link.sendall(b"N")
        link.recv(4096)
        link.sendall(struct.pack("!cII", b"R", 8, 3))
        link.recv(4096)
        fields = b"SFATAL\0VFATAL\0C28P01\0Mpassword authentication failed\0\0"
        link.sendall(b"E" + struct.pack("!I", 4 + len(fields)) + fields)


def test_a_wrong_password():
    with socket.create_server(("127.0.0.1", 0)) as server, concurrent.futures.ThreadPoolExecutor() as pool:
        refused = pool.submit(refuse_password, server)
        address = f"postgres://quadmeshd:wrong@127.0.0.1:{server.getsockname()[1]}/quadmeshd"
        (line,) = run("--status", status=1, env={**os.environ, "QUADMESHD_STORE": address}).splitlines()
        refused.result(PATIENCE)
    assert line.startswith("quadmeshd: database: ") and line.endswith("password authentication failed"), line


@pytest.mark.parametrize("task", [["--status"], ["--import", "x"], ["--export", "x"]])
def test_tasks_that_need_a_store(task):
    assert run(*task, status=2) == f"quadmeshd: {task[0]} needs the address of a database in --store\n"
