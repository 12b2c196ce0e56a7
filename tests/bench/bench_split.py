"""A search in parts beside the whole one: seconds, seconds of processors, iterations, and what was done again.

Two heaps of folded patches, one the other cut by another grid and raised by 1/512, at a tolerance of 1e-12 of the diagonal. Each
daemon has one worker and one thread. Work that is done again shows in the processors' seconds of all daemons together. Those of the
busiest daemon are the time that the search would take with a processor for each: other load on the machine, or more daemons than
processors, change them less than the time that passes. The rows are also written for tests/cluster/simulate_split.py --calibrate.
"""
import collections
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
CALIBRATION = meshes.ROOT / "build/bench/split.json"
VERBS = ("claim_parts", "read_bounds", "finish_parts")
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
    """Seconds, those of each daemon's processor, and the result."""
    a, b = (daemons[0].upload(content)["id"] for content in pair)
    before = list(map(processor_seconds, daemons))
    request = {"type": "hausdorff", "a": a, "b": b, "quads": "bilinear", "tolerance": TOLERANCE}
    start = time.perf_counter()
    _, body = daemons[0].call("POST", "/v1/jobs", json.dumps(request), {"Cache-Control": "no-cache", "Prefer": "wait=600"})
    seconds = time.perf_counter() - start
    job = json.loads(body)
    assert job["state"] == "succeeded" and job["result"]["converged"], body
    return seconds, [processor_seconds(daemon) - spent for daemon, spent in zip(daemons, before)], job["result"]


def count_verbs(daemons, read_verbs):
    """How often each verb on parts was called, and its mean seconds."""
    counts, sums = collections.Counter(), collections.Counter()
    for daemon in daemons:
        for verb, values in read_verbs(daemon).items():
            counts[verb] += values["count"]
            sums[verb] += values["sum"]
    return {verb: {"calls": counts[verb], "seconds": sums[verb] / max(counts[verb], 1)} for verb in VERBS}


def make_row(what, seconds, spent, result, whole, verbs=None):
    rounds = f", {verbs['finish_parts']['calls']:.0f} rounds" if verbs else ""
    return {"what": f"long search, {what}", "figure": seconds, "unit": "s",
            "note": f"{max(spent):.1f} s of the busiest of {len(spent)}, {sum(spent) / whole:.2f} of the whole search's work in all; "
                    f"{result['iterations'] / 1e6:.2f} million iterations{rounds}",
            "whole": whole, "spent": spent, "iterations": result["iterations"], "verbs": verbs}


def measure(folder, folds, running, read_verbs, say):
    """`running` starts daemons, and `read_verbs` reads their metrics, as bench_store's."""
    pair = make_pair(folds)
    say("store: a long search whole")
    seconds, whole, result = search_whole(folder, pair)
    rows = [make_row("whole", seconds, [whole], result, whole)]
    yield rows[0]
    say("store: a long search in parts")
    with running(folder, 1, *ONE_WORKER, is_shared=False) as (daemons, _):
        yield make_row("in parts, embedded store", *search_in_parts(daemons, pair), whole)
    for nodes in NODES:
        with running(folder, nodes, *ONE_WORKER) as (daemons, _):
            found = search_in_parts(daemons, pair)
            rows.append(make_row(f"in parts, {nodes} node{'s' * (nodes > 1)}", *found, whole, count_verbs(daemons, read_verbs)))
        yield rows[-1]
    CALIBRATION.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
