"""Deviations of surfaces with noise from the same surfaces without, near and apart: how far the bounds have to go."""
import json
import subprocess

import measuring
import tables

SURFACES = ("box", "sphere", "torus", "saddle", "wave")
SIZES = (144, 1296)
NOISES = ("1e-8", "1e-6", "1e-5", "1e-4", "1e-3", "1e-2")
RUNS = 3
MOST = 3.0  # times as long near as apart


def time_pair(settings, surface, count, noise):
    """The least processor time of some runs, near and apart."""
    command = [str(word) for word in measuring.engine("deviation", surface, "--count", count, "--noise", noise, "--quads",
                                                      "bilinear", "--threads", 1, "--seconds", settings.limit_s)]
    answers = []
    for _ in range(min(RUNS, settings.runs)):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            return {"failed": done.stderr.strip()[:200]}
        answers.append(json.loads(done.stdout))
    if not all(answer[place]["is_accurate"] for answer in answers for place in ("near", "apart")):
        return {"failed": "not accurate"}
    row = {place: min(answer[place]["cpu_ms"] for answer in answers) for place in ("near", "apart")}
    return {**row, "ratio": row["near"] / row["apart"], "faces": answers[0]["faces"]}


def describe(surface, noise, row):
    if "failed" in row:
        return [surface, "", noise, row["failed"], "", ""]
    return [surface, str(row["faces"]), noise, tables.ms(row["near"]), tables.ms(row["apart"]), tables.times(row["ratio"])]


def run(settings, programs, pairs, say):
    del programs, pairs
    rows, faults, lines, above = [], [], [], 0
    for surface in SURFACES:
        for count in SIZES:
            for noise in NOISES:
                say(f"deviation, {surface} of {count} quads, noise {noise}")
                row = time_pair(settings, surface, count, noise)
                rows.append({"surface": surface, "count": count, "noise": noise, **row})
                lines.append(describe(surface, noise, row))
                if "failed" in row:
                    faults.append(f"deviation of {surface}, {count} quads, noise {noise}: {row['failed']}")
                above += row.get("ratio", 0.0) > MOST
    print("## Deviations of near surfaces\n\nBilinear quads with noise, as a share of the diagonal, against the same without, near "
          "and 0.05 of the diagonal apart; accuracy 0.001, one thread, the least processor time of three runs in ms, with "
          f"percentiles and the maximum. {above} of {len(lines)} take more than {MOST:.0f} times as long near.\n")
    print(tables.table(["surface", "quads:", "noise:", "near:", "apart:", "ratio:"], lines))
    return rows, faults
