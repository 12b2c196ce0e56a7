"""Meshes of quads from surfaces alone: ours, QuadriFlow's of the same model at the same number, and Instant Meshes'."""
import csv
import json
import math
import subprocess

import child
import measuring
import pairs as meshes
import programs as catalogue
import tables

COUNTS = (2000, 8000, 32000)
QUADMESH = catalogue.ROOT / "build" / "quadmesh"
FOLDER = catalogue.OUT / "remesh"


def ask(*words):
    """The JSON object that a command prints, on one core."""
    done = subprocess.run([*child.pin(1), QUADMESH, *map(str, words), "--json"], capture_output=True, text=True, check=False)
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
    rms = ask("deviation", surface, mesh, "--accuracy", "0.05", "--threads", "1")["rms"]
    return {"quads": facts["faces"]["quads"] + facts["faces"]["triangles"],
            "hausdorff": ask("hausdorff", surface, mesh, "--tolerance", "1e-4", "--threads", "1")["upper_relative"],
            "rms": 0.5 * (rms["lower_relative"] + rms["upper_relative"]),
            "folded": sum(not value > 0 for value in values),
            "least_sine": min((-1.0 if math.isnan(value) else value for value in values), default=-1.0),
            "irregular": facts["irregular_vertices"]}


def make_ours(settings, surface, quads):
    out = FOLDER / "ours.ply"
    times = [ask("remesh", surface, "-o", out, "--quads", quads, "--threads", "1")["elapsed_ms"]
             for _ in range(min(settings.runs, 3))]
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
        return [model, name, row["failed"], *[""] * 6]
    return [model, name, str(row["quads"]), f"{row['hausdorff']:.2e}", f"{row['rms']:.2e}", str(row["folded"]),
            f"{row['least_sine']:.3f}", str(row["irregular"]),
            f"{row['seconds']:.2f}" if row["seconds"] is not None else "-"]


def compare(settings, programs, model, surface, quads, seconds):
    rows = {}
    try:
        rows["ours"] = make_ours(settings, surface, quads)
    except RuntimeError as fault:
        rows["ours"] = {"failed": str(fault)}
    published = meshes.data_folder() / "quadriflow" / f"{model}_{quads}.ply"
    if published.exists():
        rows["QuadriFlow"] = {**measure(surface, published), "seconds": seconds.get(published.name)}
    for peer in programs.remeshing():
        rows[peer.name] = make_peer(settings, peer, surface, quads)
    return rows


def summarise(rows):
    """How often ours is ahead of QuadriFlow's, and the worst ratio, by measure."""
    both = [row["answers"] for row in rows if "QuadriFlow" in row["answers"] and "failed" not in row["answers"]["ours"]]
    lines = []
    for key, title in (("hausdorff", "distance"), ("rms", "rms"), ("irregular", "irregular vertices")):
        ratios = [answers["ours"][key] / answers["QuadriFlow"][key] for answers in both if answers["QuadriFlow"][key]]
        if ratios:
            lines.append([title, f"{sum(ratio <= 1 for ratio in ratios)} of {len(ratios)}",
                          f"{math.prod(ratios) ** (1 / len(ratios)):.2f}", f"{max(ratios):.2f}"])
    return lines


def run(settings, programs, pairs, say):
    FOLDER.mkdir(parents=True, exist_ok=True)
    wanted, seconds = {pair.model for pair in pairs}, published_seconds()
    rows, faults, lines = [], [], []
    for model, triangles, _ in meshes.find_models():
        if model not in wanted or not triangles:
            continue
        surface = min(triangles, key=lambda path: (len(path.name), path.name))
        for quads in COUNTS[:1] if settings.runs == 1 else COUNTS:
            say(f"remeshing, {model} to {quads} quads")
            answers = compare(settings, programs, model, surface, quads, seconds)
            rows.append({"model": model, "surface": surface.name, "wanted": quads, "answers": answers})
            lines += [describe(model if name == "ours" else "", name, row) for name, row in answers.items()]
            if "failed" in answers["ours"]:
                faults.append(f"{model} to {quads} quads: {answers['ours']['failed']}")
    if lines:
        print("## Remeshing\n\nQuads from the surface alone, one thread: the two-sided distance and the rms distance of the "
              "surface from the quads as shares of its diagonal, quads with a corner that is folded, the least scaled "
              "Jacobian, irregular vertices, seconds (QuadriFlow's are those that its meshes came with).\n")
        print(tables.table(["model", "by", "quads:", "distance:", "rms:", "folded:", "least:", "irregular:", "s:"], lines))
        print("\nOurs / QuadriFlow's: how often it is no more, the geometric mean and the greatest ratio:\n")
        print(tables.table(["", "no more:", "mean:", "greatest:"], summarise(rows)))
    return rows, faults
