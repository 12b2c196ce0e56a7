"""Nearest points: near the surface, in its box and far round it, in random order."""
import json
import math
import subprocess

import measuring
import programs as catalogue
import tables

SETS = ("near", "mid", "far")
# Points of the set that slow programs get; the order is random, so that the first ones stand for all.
FEW = 100000
LARGE = 20000  # triangles of a mesh worth the time
SLOW = {"igl", "cgal"}
# Largest difference of two programs' distances, as a share of the diagonal.
SLACK = {"double": 1e-12, "float": 3e-6}
ROW_BYTES = 24


def pick_meshes(pairs):
    """The spheres, and four of the other pairs' first meshes: the smallest, the largest and two between."""
    spheres = [pair.a for pair in pairs if pair.model == "spheres"]
    others = {pair.a: measuring.export(pair.a)[1]["triangles"] for pair in pairs if pair.model != "spheres"}
    large = sorted((path for path, count in others.items() if count >= LARGE), key=others.get)
    last = len(large) - 1
    return spheres + list(dict.fromkeys(large[i] for i in (0, last // 3, 2 * last // 3, last) if large))


def draw(settings, path):
    prefix = measuring.ARRAYS / f"{path.parent.name}-{path.stem}"
    done = subprocess.run([str(word) for word in measuring.engine("draw", path, prefix, "--count", settings.points,
                                                                  "--seed", settings.seed)],
                          capture_output=True, text=True, check=True)
    for name in SETS:
        with open(f"{prefix}.{name}", "rb") as points, open(f"{prefix}.{name}.few", "wb") as few:
            few.write(points.read(ROW_BYTES * FEW))
    return prefix, json.loads(done.stdout)


def ask(settings, programs, path, points, name):
    arrays, facts = measuring.export(path)
    questions = [measuring.Question("ours", measuring.engine("project", path, f"{points}.{name}"), settings.runs)]
    for peer in programs.projecting():
        file = f"{points}.{name}.few" if peer.name in SLOW else f"{points}.{name}"
        questions.append(measuring.Question(peer.name, (*peer.command, "project", arrays, file), settings.peer_runs))
    answers = measuring.by_turns(settings, questions)
    for key, answer in answers.items():
        if "failed" not in answer:
            answer["points"] = min(settings.points, FEW) if key in SLOW else settings.points
    return {"mesh": f"{path.parent.name} {path.stem}", "triangles": facts["triangles"], "set": name,
            "diagonal": facts["diagonal"], "answers": answers}


def find_disagreements(row, programs):
    ours = row["answers"]["ours"]
    if "failed" in ours:
        return [f"{row['mesh']}, {row['set']}: this engine failed: {ours['failed']} {ours['complaint']}"]
    found = []
    for peer in programs.projecting():
        answer = row["answers"][peer.name]
        if "failed" in answer:
            continue
        worst = max(abs(a - b) for a, b in zip(ours["distances"], answer["distances"]))
        answer["worst"] = worst / row["diagonal"]
        if not answer["worst"] <= SLACK[peer.project]:
            found.append(f"{row['mesh']}, {row['set']}: distances of {peer.name} differ by up to {worst:g}")
    return found


def rate(answer, key="query_ms"):
    """Millions of points a second."""
    return answer["points"] / answer[key] / 1e3


def rate_cell(answer, key="query_ms"):
    return answer["failed"] if "failed" in answer else f"{rate(answer, key):.3f}"


def describe(row, names):
    ours, peers = row["answers"]["ours"], [row["answers"][name] for name in names]
    rates = [rate(answer) for answer in peers if "failed" not in answer]
    ratio = tables.times(rate(ours) / max(rates)) if rates and "failed" not in ours else ""
    return [row["mesh"], str(row["triangles"]), row["set"], rate_cell(ours), rate_cell(ours, "full_ms"),
            *(rate_cell(answer) for answer in peers), ratio]


def print_builds(rows, names):
    """The tree is the same for each set of points: the median over the sets."""
    lines = []
    for row in rows[:: len(SETS)]:
        lines.append([row["mesh"], *(tables.cell(row["answers"][name], "build_ms") for name in ("ours", *names))])
    print("Building the tree, ms:\n")
    print(tables.table(["mesh", "ours:", *(f"{name}:" for name in names)], lines))


def run(settings, programs, pairs, say):
    rows, faults = [], []
    for path in pick_meshes(pairs):
        points, _ = draw(settings, path)
        for name in SETS:
            say(f"projection, {path.parent.name} {path.stem}, {name}")
            rows.append(ask(settings, programs, path, points, name))
            faults += find_disagreements(rows[-1], programs)
        for file in catalogue.OUT.glob(f"arrays/{points.name}.*"):
            if file.suffix in (".few", *(f".{name}" for name in SETS)):
                file.unlink()
    for row in rows:
        for answer in row["answers"].values():
            answer.pop("distances", None)
    names = [peer.name for peer in programs.projecting()]
    kinds = {peer.name: peer.project for peer in programs.projecting()}
    print(f"## Projection\n\nMillions of points a second, one thread, {settings.points} points in random order "
          f"(seed {settings.seed}; {', '.join(sorted(SLOW))}: {FEW} of them), tree apart. Ours in double: distance and "
          "face, and with position and parameters (full). Ratio: ours over the fastest peer.\n")
    print(tables.table(["mesh", "triangles:", "points", "ours:", "full:",
                        *(f"{name} ({kinds[name]}):" for name in names), "ratio:"],
                       [describe(row, names) for row in rows]))
    print_builds(rows, names)
    means = [tables.geometric_mean(rate(row["answers"]["ours"]) / rate(row["answers"]["fcpw"])
                                   for row in rows if row["set"] == name and "failed" not in row["answers"]["fcpw"])
             for name in SETS] if "fcpw" in names else []
    if means and not any(math.isnan(mean) for mean in means):
        print("times fcpw, geometric mean: " + ", ".join(f"{name} {mean:.2f}" for name, mean in zip(SETS, means)))
    return rows, faults
