#!/usr/bin/env python3
"""Times this engine and its peers side by side on this machine, and checks that they agree.

    make bench                                   everything; four hours, two of them alignments
    make bench BENCH="--quick"                   one run of a few pairs, to see that it works
    make bench BENCH="--only hausdorff --pairs dragon"
    make bench BENCH="--only hausdorff --wide --draw 30 --seed 7"

`docker/install-packages.sh bench` installs the compiled peers; those in Python come from PyPI, at the versions of
peers/requirements.txt, into build/bench-env. A peer that is not there is left out, and a line says why. Every program
runs in a process of its own with one thread (but for the table of two) on one core; programs take turns; every figure
is a median. Meshes: two spheres and what ../shared/data/pairs holds (QM_TEST_DATA: another folder), or a torus.

Tables go to standard output, in Markdown, and those of whole parts with the usual settings to tests/bench/RESULTS.md;
everything measured to build/bench/PART.json.
Exit status: 0; 1 when two programs cannot both be right, or this engine failed; 2 wrong usage.
"""
import argparse
import contextlib
import dataclasses
import io
import json
import os
import platform
import resource
import subprocess
import sys
import time

import bench_accelerators
import bench_agreement
import bench_align
import bench_clouds
import bench_collide
import bench_compare
import bench_deviation
import bench_files
import bench_hausdorff
import bench_matrix
import bench_projection
import bench_reconstruct
import bench_remesh
import bench_service
import bench_store
import bench_twins
import bench_variants
import bench_wide
import measuring
import pairs as meshes
import programs as catalogue
import results
import variants

PARTS = {"hausdorff": bench_hausdorff, "threads": bench_variants, "twins": bench_twins, "files": bench_files,
         "project": bench_projection,
         "collide": bench_collide, "deviation": bench_deviation, "compare": bench_compare, "align": bench_align, "matrix": bench_matrix,
         "accelerators": bench_accelerators, "agreement": bench_agreement, "service": bench_service, "store": bench_store,
         "reconstruct": bench_reconstruct, "clouds": bench_clouds, "remesh": bench_remesh}
QUICK_PAIRS = ("spheres sphere", "torus fine", "bunny tri -> quad_qf")


def read_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    defaults = measuring.Settings()
    parser.add_argument("--only", choices=PARTS, action="append", help="this part (may be repeated)")
    parser.add_argument("--pairs", metavar="TEXT", action="append", default=[],
                        help="the pairs whose name holds TEXT (may be repeated)")
    parser.add_argument("--runs", type=int, default=defaults.runs, help="processes of this engine for one figure")
    parser.add_argument("--peer-runs", type=int, default=defaults.peer_runs, help="the same for each peer")
    parser.add_argument("--tolerance", type=float, default=defaults.tolerance, help="a share of A's diagonal")
    parser.add_argument("--points", type=int, default=defaults.points, help="points to project")
    parser.add_argument("--seed", type=int, default=defaults.seed, help="of the points, and of --draw")
    parser.add_argument("--limit", type=float, default=defaults.limit_s, metavar="S", help="seconds for one process")
    parser.add_argument("--quick", action="store_true", help="one run, a tenth of the points, a few pairs")
    parser.add_argument("--wide", action="store_true",
                        help="instead of everything: distances of pairs drawn from all, both ways, varied or as they are")
    parser.add_argument("--draw", type=int, default=24, metavar="N", help="how many pairs --wide draws, by --seed")
    parser.add_argument("--large", action="store_true", help="instead of everything: distances of 4 and 16 million triangles")
    given = parser.parse_args()
    if (given.wide or given.large) and given.only not in (None, ["hausdorff"]):
        parser.error("--wide and --large are about distances: --only hausdorff")
    return given


def settle(given):
    settings = measuring.Settings(runs=given.runs, peer_runs=given.peer_runs, tolerance=given.tolerance,
                                  points=given.points, seed=given.seed, limit_s=given.limit)
    if given.quick:
        settings = dataclasses.replace(settings, runs=1, peer_runs=1, points=given.points // 10,
                                       limit_s=min(given.limit, 20.0))
    return settings


def wanted_pairs(given):
    return given.pairs or (QUICK_PAIRS if given.quick else [""])


def pick_pairs(given):
    wanted = wanted_pairs(given)
    return [pair for pair in meshes.find_pairs() if any(text in str(pair) for text in wanted)]


def first_line(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[0]


def describe_machine(programs):
    models = [line.split(":")[1].strip() for line in open("/proc/cpuinfo", encoding="ascii")
              if line.startswith("model name")]
    kernel = json.loads(first_line(catalogue.ENGINE, "kernel"))
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=meshes.ROOT, capture_output=True, text=True,
                            check=False).stdout.strip()
    return {"cpu": models[0] if models else platform.machine(), "cores": len(os.sched_getaffinity(0)),
            "memory_gib": round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30),
            "system": platform.freedesktop_os_release().get("PRETTY_NAME", platform.system()),
            "compiler": first_line("gcc", "--version"), "kernel": kernel["kernel"], "version": kernel["version"],
            "commit": commit, "peers": programs.versions, "missing": programs.missing}


def machine_text(machine):
    lines = [f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_gib']} GiB, {machine['system']}, "
             f"{machine['compiler']}; this engine {machine['version']} ({machine['commit'] or 'no commit'}), "
             f"kernels {machine['kernel']}.",
             "Peers: " + (", ".join(f"{name} = {what}" for name, what in machine["peers"].items()) or "none") + "."]
    lines += [f"Left out: {line}" for line in machine["missing"]]
    return "\n".join(lines) + "\n"


def say(text):
    """Progress, which is not part of the tables."""
    print(f"... {text}", file=sys.stderr, flush=True)


def seconds_of_others():
    """Processor time since the machine started that neither this run nor its programs used."""
    with open("/proc/stat", encoding="ascii") as lines:
        user, nice, system, _idle, _wait, irq, softirq, steal = map(int, lines.readline().split()[1:9])
    busy = (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")
    ours = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return busy - sum(usage.ru_utime + usage.ru_stime for usage in ours)


def pick_tasks(given, pairs):
    """What prints tables, with what it is given, by name."""
    if not (given.wide or given.large):
        return {name: (PARTS[name].run, pairs) for name in given.only or PARTS}
    tasks = {}
    if given.wide:
        tasks["wide"] = (bench_wide.run, variants.draw(given.draw, given.seed, wanted_pairs(given)))
    if given.large:
        tasks["large"] = (bench_wide.run_large, pairs)
    return tasks


class Copy(io.StringIO):
    """Keeps what is printed, and prints it."""

    def write(self, text):
        sys.__stdout__.write(text)
        sys.__stdout__.flush()
        return super().write(text)


def run_task(name, task, machine, settings, programs, is_whole):
    """Prints the tables and writes everything measured; returns what went wrong."""
    start, others = time.monotonic(), seconds_of_others()
    run, pairs = task
    with contextlib.redirect_stdout(Copy()) as tables:
        rows, faults = run(settings, programs, pairs, say)
    seconds = time.monotonic() - start
    others = max(0.0, seconds_of_others() - others) / seconds
    document = {"machine": machine, "settings": dataclasses.asdict(settings), "seconds": seconds,
                "cores_of_others": others, "rows": rows}
    (catalogue.OUT / f"{name}.json").write_text(json.dumps(document, indent=1), encoding="ascii")
    words = f"({name}: {seconds:.0f} s; other work on this machine kept {others:.2f} cores busy)"
    print(f"\n{words}\n", flush=True)
    if is_whole:
        results.write(name, machine_text(machine), f"{tables.getvalue()}\n{words}", PARTS)
    return faults


def is_whole(given, settings):
    """Whether the run is of all pairs with the usual settings."""
    return not given.pairs and not given.quick and settings == measuring.Settings()


def main():
    given = read_arguments()
    settings = settle(given)
    say("building and installing")
    programs = catalogue.find_programs()
    pairs = pick_pairs(given)
    if not pairs:
        sys.exit(f"bench: no pair's name holds {' or '.join(given.pairs)}")
    machine = describe_machine(programs)
    print(machine_text(machine))
    faults = []
    for name, task in pick_tasks(given, pairs).items():
        faults += run_task(name, task, machine, settings, programs, is_whole(given, settings))
    for fault in faults:
        print(f"DISAGREEMENT: {fault}\n")
    print(f"{len(faults)} disagreements." if faults else "All programs agree.")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
