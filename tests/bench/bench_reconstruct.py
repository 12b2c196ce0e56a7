"""Reconstructions: time by size on a ring of points, and what becomes of the layouts of the data folder."""
import json
import math
import subprocess
import sys

import measuring
import pairs as meshes
import programs as catalogue
import tables

DEMO = catalogue.ROOT / "clients" / "demo" / "models.py"
OURS = catalogue.ROOT / "tests" / "layouts"
# Points, most quads, and the milliseconds that they may take on one core.
SIZES = ((100000, 10000, 1000.0), (1000000, 40000, 8000.0))
LAYOUTS = (("torus_6x4", "grids/torus_384x192_tris.ply"), ("torus_2x2", "grids/torus_384x192_tris.ply"),
           ("torus_2x2", "clouds/torus_20k.xyz"), ("saddle_3x2", "grids/saddle_200x200_tris.ply"),
           ("rounded_box_12_edges", "grids/rounded_box_tris.ply"), ("rounded_box_3x3x3", "grids/rounded_box_tris.ply"),
           ("rounded_box_3x3x3", "clouds/rounded_box_20k_points.obj"), ("bunny_coarse", "pairs/bunny/tri.obj"),
           ("bunny_coarse_sketched", "pairs/bunny/tri.obj"), ("bunny_coarse", "clouds/bunny_100k.ply"),
           ("bunny_coarse", "clouds/bunny_40k_noise_0.2pct.ply"), ("spot_coarse", "pairs/spot/tri.obj"),
           ("spot_coarse", "clouds/spot_10k.ascii.ply"), ("bunny", "pairs/bunny/tri.obj"),
           ("bunny", "clouds/bunny_100k.ply"), ("spot", "pairs/spot/tri.obj"))
MOST_QUADS = 30000
STEPS_SHOWN = 4
DRAWN = ["--no-measure", "--no-settle"]


def time_ring(settings, points, quads):
    folder = catalogue.OUT / "arrays"
    folder.mkdir(parents=True, exist_ok=True)
    surface, layout = folder / f"ring-{points}.xyz", folder / "ring.json"
    if not surface.exists():
        subprocess.run([sys.executable, DEMO, "ring", str(points), surface, layout], check=True)
    command = measuring.engine("reconstruct", surface, layout, "--count", quads)
    return measuring.by_turns(settings, [measuring.Question("ours", command, settings.runs)])["ours"]


def describe_ring(points, answer):
    if "failed" in answer:
        return [str(points), answer["failed"], *[""] * 5]
    return [str(points), str(answer["quads"]), tables.ms(answer["query_ms"]), tables.ms(answer["build_ms"]),
            f"{answer['stroke_ms']:.4f}", f"{answer['pick_ms']:.4f}", f"{answer['slowest_pick_ms']:.4f}"]


def quadmesh(*words):
    """Lines of JSON that a command prints, or what it complains about."""
    done = subprocess.run([catalogue.ROOT / "build" / "quadmesh", *map(str, words), "--json"], capture_output=True,
                          text=True, check=False)
    if done.returncode != 0:
        return {"failed": done.stderr.strip()[:200] or done.stdout.strip()[:200]}
    return {"lines": [json.loads(line) for line in done.stdout.splitlines()]}


OUT = catalogue.OUT / "reconstruction.obj"


def refine(layout, surface, quads, *options):
    """The steps of the command line, and its last line, the result; distances as shares of the diagonal."""
    found = quadmesh("reconstruct", surface, layout, "-o", OUT, "--quads", quads, *options)
    if "failed" in found:
        return found
    *steps, result = found["lines"]
    return {"steps": steps, "result": result, "mesh": quadmesh("info", OUT)["lines"][0]}


def follow(layout, surface):
    """The last steps with the distance after each. On meshes that is measured afterwards, as a step stops that at a
    deadline; on point sets it is measured from the points, and is in the result."""
    is_mesh = quadmesh("info", surface)["lines"][0]["kind"] != "points"
    row = refine(layout, surface, MOST_QUADS, *DRAWN * is_mesh)
    for step in row.get("steps", [])[-STEPS_SHOWN:]:
        if is_mesh:
            refine(layout, surface, step["quads"], *DRAWN)
            measured = quadmesh("hausdorff", surface, OUT, "--tolerance", "2e-6")["lines"][0]
        step["distance"] = (measured if is_mesh else step["hausdorff"])["upper_relative"]
    return row


def find_layout(name):
    own = OURS / f"{name}.json"
    return own if own.exists() else meshes.data_folder() / "layouts" / f"{name}.json"


def count_bad(quality):
    """Quads that are folded or upside down."""
    return str(quality["folded_quads"] + quality["turned_quads"])


def compare(model):
    """Ours at 8000 quads and an automatic quadrangulator's mesh, whose distance is scaled to as many."""
    tri, automatic = (meshes.data_folder() / "pairs" / model / name for name in ("tri.obj", "quad_qf.obj"))
    row = {"model": model, **refine(find_layout(model), tri, 8000, "--no-measure")}
    if "failed" in row:
        return row, [model, row["failed"], "", ""]
    ours, cells = row["steps"][-1]["quads"], [f"{model}, {row['steps'][-1]['quads']} quads"]
    count = quadmesh("info", automatic)["lines"][0]["faces"]["quads"]
    for quads in ("triangles", "bilinear"):
        own, other = (quadmesh("hausdorff", tri, mesh, "--quads", quads, "--tolerance", "1e-4")["lines"][0]
                      for mesh in (OUT, automatic))
        row[quads] = {"ours": own["upper_relative"], "scaled": other["lower_relative"] * count / ours}
        cells.append(f"{row[quads]['ours']:.2e} / {row[quads]['scaled']:.2e}")
    return row, [*cells, count_bad(row["result"]["settled"]["quality"])]


def describe_steps(steps):
    """Quads, distance and, in brackets, how many times nearer four times the quads come at this step's pace."""
    texts = []
    for before, after in zip([None, *steps[-STEPS_SHOWN:]], steps[-STEPS_SHOWN:]):
        text = f"{after['quads']}: {after['distance']:.1e}"
        if before:
            fall = math.log(before["distance"] / after["distance"]) / math.log(after["quads"] / before["quads"])
            text += f" ({4 ** fall:.1f})"
        texts.append(text)
    return ", ".join(texts)


def describe_layout(name, surface, row):
    if "failed" in row:
        return [name, surface, row["failed"], *[""] * 3]
    last, whole = row["steps"][-1], row["mesh"]["kind"] == "quads" and row["mesh"]["manifold"]
    return [name, surface, describe_steps(row["steps"]), str(last["holes_filled"]),
            count_bad(last["quality"]), str(row["mesh"]["irregular_vertices"]) if whole else "broken"]


def run(settings, programs, pairs, say):
    del programs, pairs
    rows, faults, lines = [], [], []
    for points, quads, limit in SIZES:
        say(f"reconstruction, {points} points")
        answer = time_ring(settings, points, quads)
        rows.append({"points": points, "limit_ms": limit, "answers": {"ours": answer}})
        lines.append(describe_ring(points, answer))
        if "failed" in answer:
            faults.append(f"reconstruction of {points} points failed: {answer['failed']}")
    print("## Reconstruction\n\nA ring of points with 12 patches, all steps together, one thread, ms; the tree over the "
          "points apart; a stroke's set-up, a pick and the slowest of 2000 picks.\n")
    print(tables.table(["points:", "quads:", "steps:", "tree:", "set-up:", "pick:", "slowest:"], lines))
    lines = []
    for name, surface in LAYOUTS:
        layout, path = find_layout(name), meshes.data_folder() / surface
        if not layout.exists() or not path.exists():
            continue
        say(f"reconstruction, {name} on {surface}")
        rows.append({"layout": name, "surface": surface, **follow(layout, path)})
        lines.append(describe_layout(name, surface, rows[-1]))
        if "failed" in rows[-1]:
            faults.append(f"{name} on {surface}: {rows[-1]['failed']}")
    if lines:
        print("\nQuads and the distance after the last steps, as a share of the diagonal (two-sided on meshes, points to "
              "mesh on point sets), in brackets how many times nearer four times the quads come at that pace; at the end "
              "vertices that no points enclose, quads folded or upside down, irregular vertices:\n")
        print(tables.table(["layout", "surface", "quads: distance", "holes:", "bad:", "irregular:"], lines))
    lines = []
    for model in ("spot", "bunny"):
        if not (meshes.data_folder() / "pairs" / model).exists():
            continue
        say(f"reconstruction, {model} and QuadriFlow")
        row, line = compare(model)
        rows.append(row)
        lines.append(line)
        if "failed" in row:
            faults.append(f"{model}: {row['failed']}")
    if lines:
        print("\nTwo-sided distance of settled meshes as a share of the diagonal, ours / QuadriFlow's scaled to as many quads:\n")
        print(tables.table(["", "as triangles:", "bilinear:", "bad:"], lines))
    return rows, faults
