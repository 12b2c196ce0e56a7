"""The accelerators beside one another: nearest points, whether they agree, Hausdorff distances, memory, following a
deformation; and the patches that one of them lies over."""
import statistics

import bench_projection
import child
import measuring
import pairs as meshes
import tables

NAMES = ("boxes", "tetra", "grid")
SIDE = 1000  # of the torus that is refitted: a million quads
AGREE_POINTS = 33334  # of each of the three sets
AGREE_SLACK = 1e-12   # of the diagonal


def pick_pairs(pairs):
    """Those whose second mesh has quads: the patches lie over it."""
    def has_quads(path):
        facts = measuring.export(path)[1]
        return facts["faces"] < facts["triangles"]
    return [pair for pair in pairs if has_quads(pair.b)]


def ask_projection(settings, path, points, name):
    questions = [measuring.Question(which, measuring.engine("project", path, f"{points}.{name}.few", "--accelerator", which),
                                    settings.runs) for which in (*NAMES, "auto")]
    answers = measuring.by_turns(settings, questions)
    for answer in answers.values():
        answer.pop("distances", None)
    return {"mesh": f"{path.parent.name} {path.stem}", "set": name, "answers": answers}


def ask_hausdorff(settings, pair):
    questions = [measuring.ask_engine(settings, which, pair.a, pair.b, "--accelerator", which)
                 for which in (*NAMES, "auto")]
    return {"pair": str(pair), "answers": measuring.by_turns(settings, questions)}


def slower(answers, key):
    """How much longer auto takes than the best of the three."""
    if any("failed" in answer for answer in answers.values()):
        return ""
    return tables.times(answers["auto"][key] / min(answers[name][key] for name in NAMES))


def find_faults(rows):
    return [f"{row.get('mesh', row.get('pair'))}, {key}: {answer['failed']}" for row in rows
            for key, answer in row["answers"].items() if "failed" in answer]


def run_projections(settings, pairs, say):
    rows = []
    for path in sorted({pair.b for pair in pairs}, key=str):
        points, _ = bench_projection.draw(settings, path)
        for name in bench_projection.SETS:
            say(f"accelerators, {path.parent.name} {path.stem}, {name}")
            rows.append(ask_projection(settings, path, points, name))
    print(f"Projection of {bench_projection.FEW} points in random order, one thread: query, and in brackets what is built "
          "for it (the tree, and what lies over it), in ms. Auto: times the best of both together.\n")
    print(tables.table(["mesh", "points", *(f"{name}:" for name in NAMES), "auto:"],
                       [[row["mesh"], row["set"],
                         *(f"{tables.cell(row['answers'][name], 'query_ms')} ({tables.cell(row['answers'][name], 'build_ms')})"
                           for name in NAMES), slower(row["answers"], "total_ms")] for row in rows]))
    return rows


def run_distances(settings, pairs, say):
    rows = []
    for pair in pairs:
        say(f"accelerators, {pair}")
        rows.append(ask_hausdorff(settings, pair))
    print("Hausdorff distance to the mesh of quads, one thread, ms with everything that is built. Auto: times the best.\n")
    print(tables.table(["pair", *(f"{name}:" for name in NAMES), "auto:"],
                       [[row["pair"], *(tables.cell(row["answers"][name]) for name in NAMES),
                         slower(row["answers"], "total_ms")] for row in rows]))
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
             ["grid", tables.ms(middle["grid_build_ms"]), "built anew", "", "", "", f"{answer['grid_size'] / quads:.0f}"]]
    print(f"Following a deformation of {quads} quads, one thread, ms. Gain: over building the boxes; part: "
          f"{answer['part']} vertices that lie together; gain: over all. Triangle frames of the boxes, made when distances "
          f"are asked for next: {tables.ms(middle['refresh_all_ms'])} ms for all.\n")
    print(tables.table(["", "build:", "all moved:", "gain:", "part moved:", "gain:", "bytes a quad:"], lines))
    return {"mesh": path.stem, "answers": {"refit": answer}}


def run_agreement(settings, pairs, say):
    """All accelerators on all meshes: they must tell the same distances."""
    rows = []
    for path in meshes.find_all(pairs):
        say(f"accelerators agree, {path.parent.name} {path.stem}")
        answer = child.run(measuring.engine("agree", path, "--count", AGREE_POINTS, "--seed", settings.seed), 1,
                           10 * settings.limit_s, settings.limit_bytes)
        rows.append({"mesh": f"{path.parent.name} {path.stem}", "answers": {"agree": answer}})
    worst = max((worst_of(row) for row in rows), default=0.0)
    print(f"Distances of {3 * AGREE_POINTS} points to each of {len(rows)} meshes by all accelerators, in both readings: they "
          f"differ by at most {worst:.3g} of the diagonal.\n")
    return rows


def worst_of(row):
    return max((value for key, value in row["answers"]["agree"].items() if key.startswith(("triangles_", "bilinear_"))),
               default=0.0)


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
    agreement = run_agreement(settings, given, say)
    wrong = [f"{row['mesh']}: accelerators differ by {worst_of(row):.3g} of the diagonal" for row in agreement
             if worst_of(row) > AGREE_SLACK]
    rows += agreement
    return rows, find_faults(rows) + wrong
