"""A search in parts beside the whole one: seconds, seconds of processors, iterations, and what was done again.

Two heaps of folded patches, one the other cut by another grid and raised by 1/512, at a tolerance of 1e-12 of the diagonal. Each
daemon has one worker and one thread. Work that is done again shows in the processors' seconds of all daemons together, which other
load on the machine changes less than the time that passes.
"""
import json
import os
import resource
import subprocess
import time

import pairs as meshes
from bench_service import shapes

TOLERANCE = 1e-12
RAISED = 1 / 512
NODES = (1, 2, 3)
CLIENT = meshes.ROOT / "build/quadmesh"
ONE_WORKER = ("--workers", 1, "--job-threads", 1)
TICKS = os.sysconf("SC_CLK_TCK")


def make_pair(folds, seed=1):
    heap = shapes.crumpled(folds, seed)
    return [shapes.ply_little(mesh) for mesh in (shapes.cut(heap, 2), shapes.moved(shapes.cut(heap, 3), 0, 0, RAISED))]


def processor_seconds(daemon):
    with open(f"/proc/{daemon.process.pid}/stat", encoding="ascii") as file:
        values = file.read().rsplit(") ", 1)[1].split()
    return (int(values[11]) + int(values[12])) / TICKS


def search_whole(folder, pair):
    """By the command line, which never goes on in parts."""
    files = [folder / name for name in ("a.ply", "b.ply")]
    for file, content in zip(files, pair):
        file.write_bytes(content)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    command = [CLIENT, "hausdorff", "--quads", "bilinear", "--tolerance", str(TOLERANCE), "--threads", "1", "--json",
               *files]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
    seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    result = json.loads(done.stdout.splitlines()[-1])
    return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, result


def search_in_parts(daemons, pair):
    a, b = (daemons[0].upload(content)["id"] for content in pair)
    before = sum(map(processor_seconds, daemons))
    request = {"type": "hausdorff", "a": a, "b": b, "quads": "bilinear", "tolerance": TOLERANCE}
    start = time.perf_counter()
    _, body = daemons[0].call("POST", "/v1/jobs", json.dumps(request), {"Cache-Control": "no-cache", "Prefer": "wait=600"})
    seconds = time.perf_counter() - start
    job = json.loads(body)
    assert job["state"] == "succeeded" and job["result"]["converged"], body
    return seconds, sum(map(processor_seconds, daemons)) - before, job["result"]


def row(what, measured, whole):
    seconds, spent, result = measured
    return {"what": f"long search, {what}", "figure": seconds, "unit": "s",
            "note": f"{spent:.1f} s of processors, {spent / whole[1]:.2f} of the whole search's; {result['iterations'] / 1e6:.2f} million iterations"}


def measure(folder, folds, running, say):
    """`running` starts daemons, as bench_store's."""
    pair = make_pair(folds)
    say("store: a long search whole")
    whole = search_whole(folder, pair)
    yield row("whole", whole, whole)
    say("store: a long search in parts")
    with running(folder, 1, *ONE_WORKER, is_shared=False) as (daemons, _):
        yield row("in parts, embedded store", search_in_parts(daemons, pair), whole)
    for nodes in NODES:
        with running(folder, nodes, *ONE_WORKER) as (daemons, _):
            yield row(f"in parts, {nodes} node{'s' * (nodes > 1)}", search_in_parts(daemons, pair), whole)
