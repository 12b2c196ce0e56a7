"""Meshes of quads from surfaces alone: ours, plain and semi-regular, QuadriFlow's of the same model at the same number, and Instant
Meshes'."""
import csv
import json
import math
import subprocess
import time

import child
import measuring
import pairs as meshes
import programs as catalogue
import tables

COUNTS = (2000, 8000, 32000)
SEMI_REGULAR = "semi-regular"
MANY = 32000  # of so many quads one run is made, and no median
LIMIT_S = 2100  # of all: what is left then is told
QUADMESH = catalogue.ROOT / "build" / "quadmesh"
FOLDER = catalogue.OUT / "remesh"


def ask(*words, limit_s=None):
    """The JSON object that a command prints, on one core."""
    command = [*child.pin(1), QUADMESH, *map(str, words), "--json"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=limit_s)
    except subprocess.TimeoutExpired as expired:
        raise RuntimeError(f"more than {limit_s:.0f} s") from expired
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip()[:200] or done.stdout.strip()[:200])
    return json.loads(done.stdout.splitlines()[0])


def measure(surface, mesh):
    """Distances as shares of the surface's diagonal: two-sided Hausdorff, and rms from the surface."""
    sines = FOLDER / "sines.csv"
    facts = ask("info", mesh)
    ask("quality", mesh, "--metric", "scaled_jacobian", "--per-face", sines)
    with open(sines, encoding="ascii", newline="") as file:
        values = [float(row["scaled_jacobian"] or "nan") for row in csv.DictReader(file)]
    means = {row["metric"]: row["mean"] for row in ask("quality", mesh)["metrics"]}
    rms = ask("deviation", surface, mesh, "--accuracy", "0.05", "--threads", "1")["rms"]
    return {"quads": facts["faces"]["quads"] + facts["faces"]["triangles"],
            "hausdorff": ask("hausdorff", surface, mesh, "--tolerance", "1e-4", "--threads", "1")["upper_relative"],
            "rms": 0.5 * (rms["lower_relative"] + rms["upper_relative"]),
            "folded": sum(not value > 0 for value in values),
            "least_sine": min((-1.0 if math.isnan(value) else value for value in values), default=-1.0),
            "angle": 0.5 * (means["maximum_angle"] - means["minimum_angle"]),
            "irregular": facts["irregular_vertices"]}


def make_ours(settings, surface, quads, *options, most_runs=3):
    out = FOLDER / "ours.ply"
    times = [ask("remesh", surface, "-o", out, "--quads", quads, "--threads", "1", *options, limit_s=settings.limit_s)["elapsed_ms"]
             for _ in range(min(settings.runs, most_runs))]
    return {**measure(surface, out), "seconds": sorted(times)[len(times) // 2] / 1e3}


def make_peer(settings, peer, surface, quads):
    out = FOLDER / f"{peer.name}.obj"
    prefix, _ = measuring.export(surface)
    said = child.run([*peer.command, "remesh", prefix, quads, out], 1, settings.limit_s, settings.limit_bytes)
    return said if "failed" in said else {**measure(surface, out), "seconds": said["seconds"]}


def published_seconds():
    """What QuadriFlow took, by the name of its file."""
    table = meshes.data_folder() / "quadriflow" / "FIGURES.tsv"
    if not table.exists():
        return {}
    with open(table, encoding="ascii", newline="") as file:
        return {row["file"]: float(row["seconds"]) for row in csv.DictReader(file, delimiter="\t")}


def describe(model, name, row):
    if "failed" in row:
        return [model, name, row["failed"], *[""] * 7]
    return [model, name, str(row["quads"]), f"{row['hausdorff']:.2e}", f"{row['rms']:.2e}", str(row["folded"]),
            f"{row['least_sine']:.3f}", str(row["irregular"]), f"{row['angle']:.1f}",
            f"{row['seconds']:.2f}" if row["seconds"] is not None else "-"]


def compare(settings, programs, model, surface, quads, seconds):
    rows = {}
    ours = {"ours": ([], 1 if quads >= MANY else 3), SEMI_REGULAR: (["--semi-regular"], 1)}
    for name, (options, most_runs) in ours.items():
        try:
            rows[name] = make_ours(settings, surface, quads, *options, most_runs=most_runs)
        except RuntimeError as fault:
            rows[name] = {"failed": str(fault)}
    published = meshes.data_folder() / "quadriflow" / f"{model}_{quads}.ply"
    if published.exists():
        rows["QuadriFlow"] = {**measure(surface, published), "seconds": seconds.get(published.name)}
    for peer in programs.remeshing():
        rows[peer.name] = make_peer(settings, peer, surface, quads)
    return rows


def summarise(rows, ours):
    """How often ours is ahead of QuadriFlow's, and the worst ratio, by measure."""
    both = [row["answers"] for row in rows if "QuadriFlow" in row["answers"] and "failed" not in row["answers"][ours]]
    lines = []
    for key, title in (("hausdorff", "distance"), ("rms", "rms"), ("irregular", "irregular vertices"), ("angle", "angle deviation")):
        ratios = [answers[ours][key] / answers["QuadriFlow"][key] for answers in both if answers["QuadriFlow"][key]]
        if ratios:
            lines.append([f"{ours}, {title}", f"{sum(ratio <= 1 for ratio in ratios)} of {len(ratios)}",
                          f"{math.prod(ratios) ** (1 / len(ratios)):.2f}", f"{max(ratios):.2f}"])
    return lines


def run(settings, programs, pairs, say):
    FOLDER.mkdir(parents=True, exist_ok=True)
    wanted, seconds, end = {pair.model for pair in pairs}, published_seconds(), time.monotonic() + LIMIT_S
    models = [(model, min(triangles, key=lambda path: (len(path.name), path.name)))
              for model, triangles, _ in meshes.find_models() if model in wanted and triangles]
    rows, faults, lines, left = [], [], [], []
    # A number after the other, so that what the time does not suffice for is the most expensive.
    for quads in COUNTS[:1] if settings.runs == 1 else COUNTS:
        for model, surface in models:
            if time.monotonic() > end:
                left.append(f"{model} to {quads}")
                continue
            say(f"remeshing, {model} to {quads} quads")
            answers = compare(settings, programs, model, surface, quads, seconds)
            rows.append({"model": model, "surface": surface.name, "wanted": quads, "answers": answers})
            lines += [describe(f"{model}, {quads}" if name == "ours" else "", name, row) for name, row in answers.items()]
            faults += [f"{model} to {quads} quads, {name}: {answers[name]['failed']}"
                       for name in ("ours", SEMI_REGULAR) if "failed" in answers[name]]
    if lines:
        print("## Remeshing\n\nQuads from the surface alone, one thread: the two-sided distance and the rms distance of the "
              "surface from the quads as shares of its diagonal, quads with a corner that is folded, the least scaled "
              "Jacobian, irregular vertices, by how many degrees the least and the greatest angle of a quad are off a right one in the "
              "mean, seconds (QuadriFlow's are those that its meshes came with).\n")
        print(tables.table(["model", "by", "quads:", "distance:", "rms:", "folded:", "least:", "irregular:", "angle:", "s:"], lines))
        print("\nOurs / QuadriFlow's: how often it is no more, the geometric mean and the greatest ratio:\n")
        print(tables.table(["", "no more:", "mean:", "greatest:"], summarise(rows, "ours") + summarise(rows, SEMI_REGULAR)))
    if left:
        print(f"\nNot measured, since {LIMIT_S / 60:.0f} minutes were over: {', '.join(left)}.")
    return rows, faults
