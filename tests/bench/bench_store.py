"""What a store that daemons share costs beside the embedded one: jobs, commits, log, events at another daemon, long searches,
uploads.

PostgreSQL runs on this machine with fsync and without a standby, and shares the cores with the daemons and this program.
"""
import concurrent.futures
import contextlib
import json
import math
import pathlib
import re
import shutil
import sys
import tempfile
import threading
import time

import bench_service
import bench_split
import pairs as meshes
import tables
from bench_service import Daemon, shapes

sys.path.append(str(meshes.ROOT / "tests/cluster"))
import postgres

CLIENTS = 16
TOLERANCE = 1e-3
IDLE_S = 5.0
# The verbs of a small job, in their order, and how /metrics tells their times.
VERBS = ("find_mesh", "submit_job", "append_events", "finish_job", "beat")
SERIES = re.compile(r'quadmeshd_store_seconds_(?P<part>bucket|sum|count)\{verb="(?P<verb>\w+)",outcome="stored"(,le="(?P<end>[^"]+)")?\} '
                    r'(?P<value>\S+)')


def make_daemon(folder, name, *settings):
    (folder / name).mkdir()
    return Daemon(folder / name, "--heartbeat", 60, *settings)


@contextlib.contextmanager
def running(folder, count, *settings, is_shared=True):
    """Daemons on a database of their own, or one with an embedded store."""
    with contextlib.ExitStack() as closing:
        folder = pathlib.Path(closing.enter_context(tempfile.TemporaryDirectory(dir=folder)))
        primary, store = None, []
        if is_shared:
            primary = closing.enter_context(postgres.Postgres()).primary
            store = ["--store", f"postgres://{postgres.NAME}@127.0.0.1:{primary.port}/{postgres.NAME}"]
        daemons = []
        for number in range(1, count + 1):
            name = ["--node-name", f"n{number}"] if is_shared else []
            daemons.append(make_daemon(folder, f"n{number}", *store, *name, *settings))
            closing.callback(daemons[-1].stop)
        yield daemons, primary


# ---- jobs ----


def upload_small(daemon):
    return [daemon.upload(shapes.ply_little(shapes.sphere(turn, 20, 40)))["id"] for turn in (0.0, 0.05)]


def run_job(daemon, pair, number):
    request = {"type": "hausdorff", "a": pair[0], "b": pair[1], "tolerance": TOLERANCE * (1 + 1e-7 * number)}
    _, body = daemon.call("POST", "/v1/jobs", json.dumps(request), {"Cache-Control": "no-cache", "Prefer": "wait=600"})
    assert json.loads(body)["state"] == "succeeded", body


def time_together(count, call):
    """As time_each, by CLIENTS at once."""
    def timed(number):
        start = time.perf_counter()
        call(number)
        return 1e3 * (time.perf_counter() - start)

    with concurrent.futures.ThreadPoolExecutor(CLIENTS) as pool:
        times = sorted(pool.map(timed, range(count)))
    return times[count // 2], times[int(0.99 * count)]


def bench_jobs(daemon, store, count):
    pair = upload_small(daemon)
    for number in range(20):
        run_job(daemon, pair, -1 - number)
    for clients, measure in ((1, bench_service.time_each), (CLIENTS, time_together)):
        median, late = measure(count, lambda number, clients=clients: run_job(daemon, pair, clients * 10_000 + number))
        yield {"what": f"small job, {store} store, {clients} client{'s' * (clients > 1)}", "figure": median, "unit": "ms",
               "note": f"p99 {late:.1f}"}


def count_work(primary):
    """Commits and bytes of log so far; sessions tell their commits within a second of idling."""
    time.sleep(2.0)
    ((commits, log),) = primary.query("SELECT xact_commit, pg_current_wal_lsn() - '0/0'::pg_lsn FROM pg_stat_database"
                                      f" WHERE datname = '{postgres.NAME}'", database=postgres.NAME)
    return float(commits), float(log), time.monotonic()


def bench_commits(daemon, primary, count):
    """Less those of a daemon that has nothing to do."""
    pair = upload_small(daemon)
    points = [count_work(primary)]
    time.sleep(IDLE_S)
    points.append(count_work(primary))
    for number in range(count):
        run_job(daemon, pair, 500_000 + number)
    points.append(count_work(primary))
    for part, (what, unit) in enumerate((("transactions of a small job", ""), ("log of the database for a small job", "bytes"))):
        idle = (points[1][part] - points[0][part]) / (points[1][2] - points[0][2])
        busy = points[2][part] - points[1][part] - idle * (points[2][2] - points[1][2])
        yield {"what": what, "figure": busy / count, "unit": unit, "note": f"a daemon without work: {idle:.1f} a second"}


def read_verbs(daemon):
    """The histograms of a daemon: by verb a count, a sum, and buckets."""
    _, text = daemon.call("GET", "/metrics")
    series = {}
    for line in text.decode().splitlines():
        found = SERIES.fullmatch(line)
        if found:
            series.setdefault(found["verb"], {})[found["part"] + (found["end"] or "")] = float(found["value"])
    return series


def bench_verbs(daemon):
    """The mean, and the bucket that holds the 99th percentile."""
    series = read_verbs(daemon)
    for verb in VERBS:
        values = series[verb]
        ends = sorted((float(name.removeprefix("bucket")), count) for name, count in values.items() if name.startswith("bucket"))
        bucket = next(end for end, count in ends if count >= 0.99 * values["count"])
        yield {"what": f"verb {verb}", "figure": 1000 * values["sum"] / values["count"], "unit": "ms",
               "note": f"mean of {values['count']:.0f}; 99 % within {1000 * bucket:g} ms"}


# ---- two daemons ----


def read_events(daemon, job, seen):
    connection = bench_service.http.client.HTTPConnection("127.0.0.1", daemon.port, timeout=600)
    connection.request("GET", f"/v1/jobs/{job}/events", headers={"Accept": "application/x-ndjson"})
    reply = connection.getresponse()
    while line := reply.readline():
        event = json.loads(line)
        if event["event"] in ("bounds", "result"):
            seen[event["seq"]] = time.perf_counter()


def bench_events(daemons, slow, seconds):
    """How much later a line is at the daemon that does not compute."""
    a, b = slow
    request = {"type": "hausdorff", "a": a, "b": b, "quads": "bilinear", "tolerance": 1e-12, "deadline_ms": 1000 * seconds}
    _, body = daemons[0].call("POST", "/v1/jobs", json.dumps(request), {"Cache-Control": "no-cache"})
    job, seen = json.loads(body)["id"], [{}, {}]
    threads = [threading.Thread(target=read_events, args=(daemons[i], job, seen[i])) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    late = sorted(1e3 * abs(seen[0][seq] - seen[1][seq]) for seq in seen[0].keys() & seen[1].keys())
    median = late[len(late) // 2] if late else math.nan
    yield {"what": "line of a stream, later at the other daemon", "figure": median, "unit": "ms",
           "note": f"p99 {late[int(0.99 * len(late))]:.0f}, {len(late)} lines" if late else ""}


def bench_claims(daemons, count):
    """The same jobs asked at the daemon that runs them and at the other one."""
    pair = upload_small(daemons[0])
    times = []
    for place, daemon in enumerate(daemons):
        times.append(bench_service.time_each(count, lambda number, daemon=daemon, place=place:
                                             run_job(daemon, pair, 10_000 * (place + 1) + number)))
    times.sort()
    for what, (median, late) in zip(("at its home", "at another daemon"), times):
        yield {"what": f"small job asked {what}", "figure": median, "unit": "ms", "note": f"p99 {late:.1f}"}


# ---- uploads ----


def bench_uploads(daemon, place, side, runs):
    _, content = bench_service.write_files(side)
    start, end = content.split(b"\n", 1)
    rates = []
    for run in range(runs):
        file = start + b"\ncomment %d\n" % run + end  # other bytes: another blob
        began = time.perf_counter()
        mesh = daemon.upload(file, name=f"upload{run}", format="ply")
        seconds = time.perf_counter() - began
        rates.append(len(file) / 1e6 / (seconds - sum(mesh["prepare_ms"].values()) / 1e3))
        daemon.call("DELETE", f"/v1/meshes/{mesh['id']}")
    rates.sort()
    yield {"what": f"upload of {len(content) / 1e6:.0f} MB, {place}", "figure": rates[runs // 2], "unit": "MB/s",
           "note": f"without decoding and trees; {rates[0]:.0f} to {rates[-1]:.0f}"}


@contextlib.contextmanager
def open_places(folder):
    """The settings of each place."""
    with contextlib.ExitStack() as closing:
        shared = folder / "blobs"
        shared.mkdir()
        closing.callback(shutil.rmtree, shared)
        places = {"database": (), "folder": ("--blobs", shared)}
        try:
            import bucket
        except ImportError:
            print("Left out: the bucket, for which moto is missing (tests/cluster/requirements.txt).\n")
        else:
            made = bucket.Bucket()
            closing.callback(made.close)
            places["bucket of moto, a server in Python"] = ("--blobs", made.place("bench"), "--blobs-keys",
                                                            made.write_keys(folder / "keys"))
        yield places


# ---- all ----


def measure(settings, say):
    quick = settings.runs == 1
    jobs, side, runs = (100, 300, 3) if quick else (1000, 800, 5)
    out = meshes.ROOT / "build/bench"
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="store-", dir=out) as name:
        folder = pathlib.Path(name)
        say("store: the embedded one")
        with running(folder, 1, is_shared=False) as ((daemon,), _):
            yield from bench_jobs(daemon, "embedded", jobs)
            yield from bench_uploads(daemon, "embedded", side, runs)
        say("store: a shared one")
        with running(folder, 1) as ((daemon,), primary):
            yield from bench_jobs(daemon, "shared", jobs)
            yield from bench_commits(daemon, primary, jobs)
            yield from bench_verbs(daemon)
        say("store: two daemons")
        with running(folder, 2) as (daemons, _):
            heap = shapes.crumpled(1500, seed=1)
            slow = [daemons[0].upload(shapes.ply_little(mesh))["id"]
                    for mesh in (shapes.cut(heap, 2), shapes.moved(shapes.cut(heap, 3), 0, 0, 1 / 512))]
            yield from bench_events(daemons, slow, 5 if quick else 20)
            yield from bench_claims(daemons, jobs)
        yield from bench_split.measure(folder, 1500 if quick else 4000, running, read_verbs, say)
        with open_places(folder) as places:
            for place, setting in places.items():
                say(f"store: uploads, {place}")
                with running(folder, 1, *setting) as ((daemon,), _):
                    yield from bench_uploads(daemon, place, side, runs)


def run(settings, programs, pairs, say):
    rows = list(measure(settings, say))
    print("### A store that daemons share\n")
    shown = [[row["what"], tables.ms(row["figure"]) if row["figure"] < 1000 else f"{row['figure']:.0f}", row["unit"],
              row["note"]] for row in rows]
    print(tables.table(["what", "figure:", "unit", "besides"], shown))
    return rows, []
