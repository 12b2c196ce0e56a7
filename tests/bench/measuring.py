"""Several programs on one question, by turns; medians of what they say."""
import dataclasses
import json
import statistics
import subprocess
import typing

import child
import programs

ARRAYS = programs.OUT / "arrays"


@dataclasses.dataclass(frozen=True)
class Settings:
    runs: int = 5              # of this engine
    peer_runs: int = 3
    patience_s: float = 10.0   # a program that took longer does not run this case again
    limit_s: float = 120.0
    limit_bytes: int = 6 << 30
    tolerance: float = 1e-8    # a share of the diagonal of A
    points: int = 1000000
    seed: int = 1


@dataclasses.dataclass(frozen=True)
class Question:
    """One program's task; the key names it among its fellows."""
    key: str
    command: typing.Sequence[object]
    runs: int
    threads: int = 1


def take_medians(answers):
    """One answer of many runs: the medians of all times, the largest memory, the rest as the last run said it."""
    builds = [ms for answer in answers for ms in answer["build_ms"]]
    queries = [ms for answer in answers for ms in answer["query_ms"]]
    totals = [build + query for build, query in zip(builds, queries)]
    times = {"build_ms": statistics.median(builds), "query_ms": statistics.median(queries),
             "total_ms": statistics.median(totals), "totals_ms": totals}
    if "full_ms" in answers[0]:
        times["full_ms"] = statistics.median(ms for answer in answers for ms in answer["full_ms"])
    memory = {"peak_kb": max(answer["peak_kb"] for answer in answers),
              "on_top_kb": max(answer["peak_kb"] - answer["resting_kb"] for answer in answers)}
    return answers[-1] | times | memory


def by_turns(settings, questions):
    """Asks every program once, then again, and so on; medians or {"failed": why}, by key."""
    answers = {question.key: [] for question in questions}
    failures = {}
    for turn in range(max(question.runs for question in questions)):
        for question in questions:
            said = answers[question.key]
            if turn >= question.runs or question.key in failures:
                continue
            if said and said[-1]["build_ms"][-1] + said[-1]["query_ms"][-1] > 1e3 * settings.patience_s:
                continue
            answer = child.run(question.command, question.threads, settings.limit_s, settings.limit_bytes)
            if "failed" in answer:
                failures[question.key] = answer
            else:
                said.append(answer)
    return {key: failures.get(key) or take_medians(said) for key, said in answers.items()}


def engine(*words):
    return (programs.ENGINE, *words)


def export(path, **change):
    """Writes a mesh as arrays for the peers; returns their prefix and the counts."""
    ARRAYS.mkdir(parents=True, exist_ok=True)
    words = [word for name, amount in change.items() for word in (f"--{name}", repr(amount))]
    prefix = ARRAYS / "-".join([path.parent.name, path.stem, *(word.strip("-") for word in words)])
    done = subprocess.run([str(word) for word in engine("export", path, prefix, *words)], capture_output=True,
                          text=True, check=True)
    return prefix, json.loads(done.stdout)


def ask_engine(settings, key, a, b, *words, threads=1):
    return Question(key, engine("hausdorff", a, b, "--tolerance", repr(settings.tolerance), "--threads", threads,
                                *words), settings.runs, threads)


def ask_peer(settings, peer, a, b, diagonal):
    """a and b are prefixes of arrays."""
    return Question(peer.name, (*peer.command, "hausdorff", a, b, repr(settings.tolerance * diagonal)),
                    settings.peer_runs if peer.hausdorff == "guaranteed" else 1)
