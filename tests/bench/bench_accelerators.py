"""The accelerators beside one another: nearest points, Hausdorff distances, memory, following a deformation; and the
patches that one of them lies over."""
import statistics
import subprocess

import bench_projection
import child
import measuring
import pairs as meshes
import tables

NAMES = ("boxes", "tetra", "grid")
SIDE = 1000  # of the torus that is refitted: a million quads
MESHES = 6   # a spread of sizes
POINTS = 20000  # of each set: tetrahedra take long for far ones


def pick_pairs(pairs):
    """Those whose second mesh has quads: the patches lie over it."""
    def has_quads(path):
        facts = measuring.export(path)[1]
        return facts["faces"] < facts["triangles"]
    quads = [pair for pair in pairs if has_quads(pair.b)]
    by_size = sorted({pair.b for pair in quads}, key=lambda path: (measuring.export(path)[1]["triangles"], str(path)))
    wanted = {by_size[i * (len(by_size) - 1) // max(1, MESHES - 1)] for i in range(MESHES)} if by_size else set()
    return [pair for pair in quads if pair.b in wanted]


def draw(settings, path):
    prefix = measuring.ARRAYS / f"{path.parent.name}-{path.stem}-spread"
    words = measuring.engine("draw", path, prefix, "--count", POINTS, "--seed", settings.seed)
    subprocess.run([str(word) for word in words], stdout=subprocess.DEVNULL, check=True)
    return prefix


def ask_projection(settings, path, points, name):
    questions = [measuring.Question(which, measuring.engine("project", path, f"{points}.{name}", "--accelerator", which),
                                    settings.runs) for which in (*NAMES, "auto")]
    answers = measuring.by_turns(settings, questions)
    for answer in answers.values():
        answer.pop("distances", None)
    return {"mesh": f"{path.parent.name} {path.stem}", "set": name, "answers": answers}


def ask_hausdorff(settings, pair):
    questions = [measuring.ask_engine(settings, which, pair.a, pair.b, "--accelerator", which)
                 for which in (*NAMES, "auto")]
    return {"pair": str(pair), "answers": measuring.by_turns(settings, questions)}


def slower(answers):
    """How much longer auto takes than the best of the three, with everything that is built."""
    if any("failed" in answer for answer in answers.values()):
        return ""
    return f"{answers['auto']['total_ms'] / min(answers[name]['total_ms'] for name in NAMES):.2f}"


def find_faults(rows):
    return [f"{row.get('mesh', row.get('pair'))}, {key}: {answer['failed']}" for row in rows
            for key, answer in row["answers"].items() if "failed" in answer]


def run_projections(settings, pairs, say):
    rows = []
    for path in sorted({pair.b for pair in pairs}, key=str):
        points = draw(settings, path)
        for name in bench_projection.SETS:
            say(f"accelerators, {path.parent.name} {path.stem}, {name}")
            rows.append(ask_projection(settings, path, points, name))
    print(f"Projection of {POINTS} points in random order, one thread: query, and in brackets what is built for it (the "
          "tree, and what lies over it), in ms. Last: both of auto over both of the best.\n")
    print(tables.table(["mesh", "points", *(f"{name}:" for name in (*NAMES, "auto")), "auto/best:"],
                       [[row["mesh"], row["set"],
                         *(f"{tables.cell(row['answers'][name], 'query_ms')} ({tables.cell(row['answers'][name], 'build_ms')})"
                           for name in (*NAMES, "auto")), slower(row["answers"])] for row in rows]))
    return rows


def run_distances(settings, pairs, say):
    rows = []
    for pair in pairs:
        say(f"accelerators, {pair}")
        rows.append(ask_hausdorff(settings, pair))
    print("Hausdorff distance to the mesh of quads, one thread, ms with everything that is built. Last: auto over the best.\n")
    print(tables.table(["pair", *(f"{name}:" for name in (*NAMES, "auto")), "auto/best:"],
                       [[row["pair"], *(tables.cell(row["answers"][name]) for name in (*NAMES, "auto")),
                         slower(row["answers"])] for row in rows]))
    return rows


def run_refit(settings, say):
    say("accelerators, refit")
    path = meshes.MADE / f"torus_{SIDE}.off"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists():
        meshes.write_torus(path, SIDE, SIDE, 4)
    answer = child.run(measuring.engine("refit", path), 1, settings.limit_s, settings.limit_bytes)
    if "failed" in answer:
        return {"mesh": path.stem, "answers": {"refit": answer}}
    middle = {key: statistics.median(value) for key, value in answer.items() if key.endswith("_ms")}
    quads = answer["faces"]
    build, boxes = middle["build_ms"], middle["query_ms"]
    lines = [["boxes", tables.ms(build), tables.ms(boxes), tables.times(build / boxes), tables.ms(middle["boxes_part_ms"]),
              tables.times(boxes / middle["boxes_part_ms"]), f"{answer['boxes_size'] / quads:.0f}"],
             ["tetra", tables.ms(middle["patches_find_ms"] + middle["tetra_build_ms"]), tables.ms(middle["tetra_all_ms"]),
              tables.times(build / middle["tetra_all_ms"]), tables.ms(middle["tetra_part_ms"]),
              tables.times(middle["tetra_all_ms"] / middle["tetra_part_ms"]), f"{answer['tetra_size'] / quads:.0f}"],
             ["grid", tables.ms(middle["grid_build_ms"]), "built again", "", "", "", f"{answer['grid_size'] / quads:.0f}"]]
    print(f"Following a deformation of {quads} quads, one thread, ms. Gain: over building the boxes; part: "
          f"{answer['part']} vertices that lie together; gain: over all.\n")
    print(tables.table(["", "build:", "all moved:", "gain:", "part moved:", "gain:", "bytes a quad:"], lines))
    return {"mesh": path.stem, "answers": {"refit": answer}}


def run_patches(settings, pairs, say):
    rows = []
    for path in sorted({pair.b for pair in pairs}, key=str):
        say(f"patches, {path.parent.name} {path.stem}")
        answers = measuring.by_turns(settings, [measuring.Question("patches", measuring.engine("patches", path),
                                                                   settings.runs)])
        rows.append({"mesh": f"{path.parent.name} {path.stem}", "answers": answers})
    print("Regular patches, ms to find them.\n")
    print(tables.table(["mesh", "quads:", "irregular vertices:", "patches:", "ms:"],
                       [[row["mesh"], *(f"{row['answers']['patches'].get(key, '')}" for key in ("quads", "irregular", "patches")),
                         tables.cell(row["answers"]["patches"])] for row in rows]))
    return rows


def run(settings, _programs, given, say):
    print("## Accelerators\n")
    pairs = pick_pairs(given)
    rows = run_projections(settings, pairs, say) + run_distances(settings, pairs, say)
    rows.append(run_refit(settings, say))
    rows += run_patches(settings, pairs, say)
    return rows, find_faults(rows)
