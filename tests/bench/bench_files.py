"""Whole processes of the command line, from the names of two files to the answer, against the warm engine."""
import json
import os
import statistics
import tempfile
import time

import measuring
import tables
from pairs import ROOT

PROGRAM = ROOT / "build/quadmesh"
SINGLE = 1e-6  # of the diagonal: what a peer that holds single precision may be off


def run_process(words, threads):
    """Wall time, processor time and page faults of one process, and what it printed; or {"failed": why}."""
    free = os.sched_getaffinity(0)
    with tempfile.TemporaryFile() as out:
        os.sched_setaffinity(0, sorted(free)[-threads:])  # which the process takes over, without a program between
        start = time.perf_counter()
        process = os.posix_spawn(words[0], words, os.environ, file_actions=[(os.POSIX_SPAWN_DUP2, out.fileno(), 1)])
        _, status, usage = os.wait4(process, 0)
        wall = time.perf_counter() - start
        os.sched_setaffinity(0, free)
        out.seek(0)
        printed = out.read()
    if status:
        return {"failed": f"exit status {os.waitstatus_to_exitcode(status)}"}
    return json.loads(printed) | {"wall_ms": 1e3 * wall, "processor_ms": 1e3 * (usage.ru_utime + usage.ru_stime),
                                  "faults": usage.ru_minflt}


def time_processes(settings, pair):
    """Medians over processes with one thread and with two that take turns, by number of threads."""
    counts = [threads for threads in (1, 2) if threads <= len(os.sched_getaffinity(0))]
    said = {threads: [] for threads in counts}
    for _ in range(3 * settings.runs + 1):  # the first one finds files and program that may not be in memory
        for threads in counts:
            words = ["hausdorff", pair.a, pair.b, "--direction", "a_to_b", "--tolerance", repr(settings.tolerance),
                     "--threads", threads, "--json"]
            said[threads].append(run_process([str(word) for word in (PROGRAM, *words)], threads))
    return {str(threads): take_medians(answers[1:]) for threads, answers in said.items()}


def take_medians(answers):
    failed = [answer for answer in answers if "failed" in answer]
    if failed:
        return failed[0]
    medians = {key: statistics.median(answer[key] for answer in answers)
               for key in ("wall_ms", "processor_ms", "faults", "elapsed_ms")}
    medians["prepare_ms"] = statistics.median(sum(answer["prepare_ms"].values()) for answer in answers)
    return medians | {key: answers[-1][key] for key in ("lower", "upper")}


def ask(settings, programs, pair):
    _, facts_a = measuring.export(pair.a)
    questions = [measuring.ask_engine(settings, "warm", pair.a, pair.b)]
    tolerance = repr(settings.tolerance * facts_a["diagonal"])
    questions += [measuring.Question(peer.name, (*peer.command, "files", pair.a, pair.b, tolerance), 1)
                  for peer in programs.reading()]
    return {"pair": str(pair), "diagonal": facts_a["diagonal"], "bytes": sum(path.stat().st_size for path in (pair.a, pair.b)),
            "processes": time_processes(settings, pair), "answers": measuring.by_turns(settings, questions)}


def find_faults(row, programs):
    """Sentences; the process and the warm engine give the same bracket, and no peer finds more than its upper end."""
    found, warm = [], row["answers"]["warm"]
    for threads, answer in row["processes"].items():
        if "failed" in answer:
            found.append(f"{row['pair']}: the command line failed on {threads} threads: {answer['failed']}")
        elif "failed" in warm or max(answer["lower"], warm["lower"]) > min(answer["upper"], warm["upper"]):
            found.append(f"{row['pair']}: the command line says [{answer['lower']!r}, {answer['upper']!r}] on {threads} "
                         f"threads, which the warm engine does not")
    one = row["processes"]["1"]
    for peer in programs.reading():
        answer = row["answers"][peer.name]
        if "failed" not in answer and "failed" not in one and \
                answer["lower"] > one["upper"] + SINGLE * row["diagonal"]:
            found.append(f"{row['pair']}: {peer.name} found {answer['lower']!r}, this engine at most {one['upper']!r}")
    return found


def over_warm(row):
    one, warm = row["processes"]["1"], row["answers"]["warm"]
    return None if "failed" in one or "failed" in warm else one["wall_ms"] / warm["total_ms"]


def describe(row, programs):
    one, two, warm = row["processes"]["1"], row["processes"].get("2"), row["answers"]["warm"]
    ratio = over_warm(row)
    stages = [""] * 4 if "failed" in one else [
        tables.ms(one["prepare_ms"]), tables.ms(one["elapsed_ms"]),
        tables.ms(max(0.0, one["wall_ms"] - one["prepare_ms"] - one["elapsed_ms"])), f"{one['faults']:.0f}"]
    return [row["pair"], f"{row['bytes'] / 1e6:.1f}", tables.cell(warm), tables.cell(one, "wall_ms"),
            tables.cell(one, "processor_ms"), *stages, tables.times(ratio) if ratio else "",
            *(tables.cell(two, key) if two else "" for key in ("wall_ms", "processor_ms")),
            *(tables.cell(row["answers"][peer.name]) for peer in programs.reading())]


def run(settings, programs, pairs, say):
    rows, faults = [], []
    for pair in pairs:
        say(f"from files, {pair}")
        rows.append(ask(settings, programs, pair))
        faults += find_faults(rows[-1], programs)
    peers = programs.reading()
    print("## From files to the answer\n\nThe distance from A to B by a process of the command line that does nothing "
          "else, in ms from its start to its end: loading is files to trees, rest is start and end; "
          "processor is the time of all threads together, which other work on the machine changes least. Warm: trees "
          "and search in a process that has done the same before. The peers' times hold reading, not the start of "
          "Python.\n")
    print(tables.table(["pair", "MB:", "warm:", "one thread:", "processor:", "loading:", "search:", "rest:",
                        "page faults:", "over warm:", "two threads:", "processor:",
                        *(f"{peer.name} ({peer.hausdorff}):" for peer in peers)],
                       [describe(row, programs) for row in rows]))
    ratios = [ratio for ratio in map(over_warm, rows) if ratio]
    if ratios:
        print(f"one thread, {len(ratios)} rows: {tables.geometric_mean(ratios):.2f} times the warm engine (geometric "
              f"mean), {max(ratios):.2f} at most")
    return rows, faults
