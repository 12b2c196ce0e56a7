"""Comparisons: mean, Chamfer distance, Hausdorff distance and F-score as proven intervals, beside what tools that sample say, run by run."""
import math

import child
import measuring
import programs as catalogue
import tables

QUADMESH = catalogue.ROOT / "build/quadmesh"
POINTS = 20000
ACCURACY, PIECES = 1e-3, 10000000
LIMIT = 1e-3         # of the F-score, as a share of A's diagonal
FIGURES = ("mean", "chamfer", "hausdorff", "f_score")
DEVIATIONS = 6.0     # how many standard errors a mean of samples may be off
ROUNDING = 1e-5      # of the diagonal, of peers in single precision


def ask_ours(settings, a, b, limit):
    """The intervals, in the unit of the meshes."""
    answer = child.run((QUADMESH, "compare", a, b, "--json", "--threads", 1, "--accuracy", repr(ACCURACY), "--pieces", PIECES,
                        "--limit", repr(limit)), 1, settings.limit_s, settings.limit_bytes)
    if "failed" in answer:
        return answer
    both = answer["symmetric"]
    found = {"mean": answer["a_to_b"]["mean"], "chamfer": both["chamfer"]["l1"], "hausdorff": both["hausdorff"],
             "f_score": both["f_score"][0]["f"], "std": answer["a_to_b"]["std"], "mean_back": answer["b_to_a"]["mean"],
             "std_back": answer["b_to_a"]["std"]}
    found = {name: [interval["lower"], interval["upper"]] for name, interval in found.items()}
    return found | {"ms": answer["elapsed_ms"] + sum(answer["prepare_ms"].values())}


def ask_peer(settings, peer, a, b, limit, runs):
    """What each run says of each figure, or {"failed": why}."""
    answers = []
    for run in range(runs):
        answer = child.run((*peer.command, "compare", a, b, POINTS, run + 1, repr(limit)), 1, settings.limit_s,
                           settings.limit_bytes)
        if "failed" in answer:
            return answer
        answers.append(answer)
    found = {name: [answer[name] for answer in answers] for name in FIGURES if name in answers[0]}
    return found | {"ms": sorted(answer["query_ms"][0] for answer in answers)[len(answers) // 2]}


def ask(settings, programs, pair):
    a, facts = measuring.export(pair.a)
    b, _ = measuring.export(pair.b)
    limit = LIMIT * facts["diagonal"]
    row = {"pair": str(pair), "diagonal": facts["diagonal"], "limit": limit,
           "ours": ask_ours(settings, pair.a, pair.b, limit), "self": ask_ours(settings, pair.a, pair.a, limit), "peers": {}}
    for peer in programs.comparing():
        row["peers"][peer.name] = {"from": peer.compares, "pair": ask_peer(settings, peer, a, b, limit, settings.runs),
                                   "self": ask_peer(settings, peer, a, a, limit, 1)}
    return row


def count_inside(interval, values):
    return sum(interval[0] <= value <= interval[1] for value in values)


def number(value, figure, diagonal):
    """Lengths are shares of the diagonal."""
    return f"{value / (1.0 if figure == 'f_score' else diagonal):.6g}"


def spread(values, figure, diagonal):
    low, high = number(min(values), figure, diagonal), number(max(values), figure, diagonal)
    return low if low == high else f"{low} to {high}"


def describe_ours(row):
    ours, myself = row["ours"], row["self"]
    if "failed" in ours or "failed" in myself:
        return [row["pair"], "ours", ours.get("failed") or myself["failed"], *[""] * (len(FIGURES) + 1)]
    return [row["pair"], "ours", *(spread(ours[name], name, row["diagonal"]) for name in FIGURES),
            spread(myself["chamfer"], "chamfer", row["diagonal"]), tables.ms(ours["ms"])]


def describe_peer(row, name, answers):
    found, myself = answers["pair"], answers["self"]
    if "failed" in found or "failed" in myself:
        return ["", name, found.get("failed") or myself["failed"], *[""] * (len(FIGURES) + 1)]
    cells = []
    for figure in FIGURES:
        if figure not in found:
            cells.append("-")
            continue
        cell = spread(found[figure], figure, row["diagonal"])
        if "failed" not in row["ours"]:
            inside = count_inside(row["ours"][figure], found[figure])
            cell += ", " + ("yes" if inside == len(found[figure]) else "no" if inside == 0 else f"{inside} yes")
        cells.append(cell)
    return ["", name, *cells, spread(myself["chamfer"], "chamfer", row["diagonal"]), tables.ms(found["ms"])]


def find_faults(row):
    """An average of samples from the other surface is near the mean, and none of them is farther than the greatest distance."""
    ours, diagonal = row["ours"], row["diagonal"]
    for kind in ("ours", "self"):
        if "failed" in row[kind]:
            return [f"{row['pair']}: this engine failed: {row[kind]['failed']}"]
    faults = []
    if row["self"]["chamfer"] != [0, 0] or row["self"]["f_score"] != [1, 1]:
        faults.append(f"{row['pair']}: A is not itself: {row['self']}")
    for name, answers in row["peers"].items():
        found = answers["pair"]
        if "failed" in found or answers["from"] != "surface":
            continue
        runs = len(found["chamfer"])
        error = DEVIATIONS * math.hypot(ours["std"][1], ours["std_back"][1]) / math.sqrt(POINTS * runs) + ROUNDING * diagonal
        average = sum(found["chamfer"]) / runs
        if not ours["chamfer"][0] - error <= average <= ours["chamfer"][1] + error:
            faults.append(f"{row['pair']}: {name} has a Chamfer distance of {average!r}, not {ours['chamfer']}")
        if max(found["hausdorff"]) > ours["hausdorff"][1] + ROUNDING * diagonal:
            faults.append(f"{row['pair']}: {name} has a point {max(found['hausdorff'])!r} away, farther than {ours['hausdorff'][1]!r}")
    return faults


def run(settings, programs, pairs, say):
    rows = []
    for pair in pairs:
        say(f"compare: {pair}")
        rows.append(ask(settings, programs, pair))
    lines = []
    for row in rows:
        lines.append(describe_ours(row))
        lines += [describe_peer(row, name, answers) for name, answers in row["peers"].items()]
    inside = {figure: [count_inside(row["ours"][figure], answers["pair"][figure]) for row in rows if "failed" not in row["ours"]
                       for answers in row["peers"].values() if figure in answers["pair"]] for figure in FIGURES}
    said = ", ".join(f"{figure} {sum(counts)} of {settings.runs * len(counts)}" for figure, counts in inside.items())
    print(f"## Comparisons\n\nThe mean distance of A from B, the Chamfer distance (both means, added), the Hausdorff distance and the "
          f"F-score within {LIMIT:g} of A's diagonal; lengths as shares of the diagonal, quads as triangles, one thread. This engine: "
          f"proven intervals, to {ACCURACY:g} of mean and rms. Peers: the least and the greatest of {settings.runs} runs with seeds "
          f"of their own, {POINTS:,} points of each surface; yes when all runs are inside this engine's interval. open3d, meshlab and "
          "trimesh measure each point from the faces of the other mesh, pcu from the points of the other sample. Self: the Chamfer "
          "distance of A from itself. ms: of the whole comparison, for this engine with its trees; meshlab draws with a seed of its own, "
          f"the same each time.\n\nRuns of peers inside this engine's interval: {said}.\n")
    print(tables.table(["pair", "program", "mean", "Chamfer", "Hausdorff", "F-score", "self", "ms:"], lines))
    return rows, [fault for row in rows for fault in find_faults(row)]
