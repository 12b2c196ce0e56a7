"""Alignment: models that are moved at random, brought back; whole, with noise, and as parts, some of them nearly symmetric."""
import array
import dataclasses
import math
import random

import measuring
import tables

MOTIONS = 67  # of each case, 201 of each model
PEER_MOTIONS = 4  # the first of them: an alignment of a peer takes up to ten seconds
NOISE, PART = 0.002, 0.6
CASES = {"whole": {}, "noisy": {"noise": NOISE}, "part": {"part": PART, "noise": NOISE}}
MODELS = 10
SMALLEST, LARGEST = 2000, 100000  # triangles
LIMIT_S = 1800.0


def pick_meshes(pairs):
    """The first mesh of each model that is not too large, the models in order of their names."""
    models = {}
    for pair in pairs:
        for path in (pair.a, pair.b):
            if path.parent.name not in models and SMALLEST <= measuring.export(path)[1]["triangles"] <= LARGEST:
                models[path.parent.name] = path
    return [models[name] for name in sorted(models)][:MODELS]


def write_motions(settings, count, diagonal):
    """Turns evenly over all, by quaternions, and shifts of up to two diagonals."""
    draw = random.Random(settings.seed)
    rows = array.array("d")
    for _ in range(count):
        q = [draw.gauss(0, 1) for _ in range(4)]
        w, x, y, z = (c / math.sqrt(sum(c * c for c in q)) for c in q)
        rows.extend([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
                     2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
                     2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0,
                     *(draw.uniform(-2, 2) * diagonal for _ in range(3)), 1])
    measuring.ARRAYS.mkdir(parents=True, exist_ok=True)
    path = measuring.ARRAYS / f"motions-{settings.seed}-{count}.f64"
    with open(path, "wb") as out:
        rows.tofile(out)
    return path


def ask(settings, programs, path, case, count):
    b, facts = measuring.export(path)
    a, _ = measuring.export(path, **CASES[case])
    motions, few = (write_motions(settings, min(count, most), facts["diagonal"]) for most in (MOTIONS, PEER_MOTIONS))
    questions = [measuring.Question("ours", measuring.engine("align", a, b, motions), 1)]
    for peer in programs.aligning():
        questions += [measuring.Question(f"{peer.name} {command}", (*peer.command, command, a, b, few), 1)
                      for command in peer.aligns]
    return {"model": path.parent.name, "triangles": facts["triangles"], "case": case,
            "answers": measuring.by_turns(settings, questions)}


def describe(row, names, count):
    cells = [row["model"], str(row["triangles"]), row["case"]]
    for name in names:
        answer = row["answers"].get(name, {"failed": "-"})
        if "failed" in answer:
            cells += [answer["failed"], "-", "-"]
        else:
            of = "" if answer["motions"] == count else f" of {answer['motions']}"
            cells += [f"{answer['placed']}{of}", f"{answer['exact']}{of}", tables.ms(answer["query_ms"])]
    ours = row["answers"]["ours"]
    second = ours.get("runner_up", -1.0)
    return [*cells, "-" if second < 0 else f"{ours['rms']:.1e}, {second:.1e}"]


def run(settings, programs, pairs, say):
    count = MOTIONS if settings.runs > 1 else PEER_MOTIONS
    patient = dataclasses.replace(settings, limit_s=max(settings.limit_s, LIMIT_S))
    rows = []
    for path in pick_meshes(pairs):
        for case in CASES:
            say(f"align: {path.parent.name} {path.stem}, {case}")
            rows.append(ask(patient, programs, path, case, count))
    names = ["ours", *(f"{peer.name} {command}" for peer in programs.aligning() for command in peer.aligns)]
    titles = [title for name in names for title in (f"{name} placed:", "exact:", "ms:")]
    print(f"## Alignment\n\nEach model, moved by {count} random turns and shifts, brought back onto itself: whole, with noise of "
          f"{NOISE:g} of the diagonal in every coordinate, and a part of {PART:g} of its width with such noise. Placed: how many "
          "ended within a hundredth of the diagonal of where they came from. Exact: how many ended within a millionth of where "
          "the model ends that was not moved before: one answer, wherever it lay. ms: the median of an alignment, one thread, trees "
          "and samples of the fixed model not counted. This engine knows no start and draws nothing at random; `open3d align` "
          "is point to plane from the centroids, `open3d search` the same after features and RANSAC; CloudCompare's is point to "
          "point from the centroids, reading not counted. The peers have the first four of the motions, CloudCompare two. Last: this "
          "engine's rms and that of the second best placement, as shares of the diagonal; near each other, the model is nearly symmetric.\n")
    print(tables.table(["model", "triangles:", "case", *titles, "rms, second:"], [describe(row, names, count) for row in rows]))
    return rows, [f"{row['model']}, {row['case']}: this engine failed: {row['answers']['ours']['failed']}"
                  for row in rows if "failed" in row["answers"]["ours"]]
