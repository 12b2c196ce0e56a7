"""Point sets made worse in one way each, to quads by a layout and without: how far these are from the true surface, by both ways.

The points are drawn evenly from models of the data folder, and worsened here: Gaussian noise along every axis, holes, a density that
falls fifty-fold along x, points anywhere in the box, no normals. The true surface is the model."""
import bisect
import itertools
import json
import math
import random
import resource
import subprocess

import pairs as meshes
import programs as catalogue
import tables

OUT = catalogue.OUT / "clouds"
MODELS = (("bunny", "pairs/bunny/tri.obj", "tests/layouts/bunny.json"), ("spot", "pairs/spot/tri.obj", "tests/layouts/spot.json"),
          ("torus", None, "layouts/torus_6x4.json"))
POINTS, QUADS, REMESHED = 40000, 8000, 4000
HOLES, HOLE_SHARE = 12, 0.02  # holes of 4 % of the diagonal
GRADIENT, OUTLIERS = 50.0, 400


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def subtract(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def load_obj(path):
    corners, faces = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            corners.append(tuple(map(float, words[1:4])))
        elif words[:1] == ["f"]:
            index = [int(word.split("/")[0]) - 1 for word in words[1:]]
            faces += [(index[0], b, c) for b, c in zip(index[1:], index[2:])]
    return corners, faces


def make_torus(columns=384, rows=192, major=1.0, minor=0.35):
    """As layouts/torus_6x4.json has it."""
    def at(i, j):
        u, v = 2 * math.pi * i / columns, 2 * math.pi * j / rows
        ring = major + minor * math.cos(v)
        return (ring * math.cos(u), ring * math.sin(u), minor * math.sin(v))
    corners = [at(i, j) for j in range(rows) for i in range(columns)]
    faces = []
    for j, i in itertools.product(range(rows), range(columns)):
        a, b = j * columns + i, j * columns + (i + 1) % columns
        c, d = (j + 1) % rows * columns + (i + 1) % columns, (j + 1) % rows * columns + i
        faces += [(a, b, c), (a, c, d)]
    return corners, faces


def box_of(corners):
    return [min(p[k] for p in corners) for k in range(3)], [max(p[k] for p in corners) for k in range(3)]


def sample(mesh, chance, weight=lambda p: 1.0):
    """Rows of points and normals, with a density that is the area's times a weight."""
    corners, faces = mesh
    sums, normals, total = [], [], 0.0
    for a, b, c in faces:
        normal = cross(subtract(corners[b], corners[a]), subtract(corners[c], corners[a]))
        length = math.hypot(*normal)
        total += length * weight(corners[a])
        sums.append(total)
        normals.append(tuple(x / length for x in normal) if length > 0 else (0.0, 0.0, 0.0))
    rows = []
    for _ in range(POINTS):
        face = min(bisect.bisect(sums, chance.random() * total), len(faces) - 1)
        s, t = math.sqrt(chance.random()), chance.random()
        p, q, r = (corners[i] for i in faces[face])
        rows.append((tuple((1 - s) * p[k] + s * (1 - t) * q[k] + s * t * r[k] for k in range(3)), normals[face]))
    return rows


def add_noise(rows, sigma, chance):
    return [(tuple(x + chance.gauss(0, sigma) for x in p), n) for p, n in rows]


def worsen(mesh, chance):
    """Names, rows and whether these keep their normals, of each way to make points worse."""
    (low, high), rows = box_of(mesh[0]), sample(mesh, chance)
    diagonal = math.dist(low, high)
    noisy = {share: add_noise(rows, share / 100 * diagonal, chance) for share in (0.2, 0.5)}
    centres = [p for p, _ in chance.sample(rows, HOLES)]
    holed = [row for row in rows if all(math.dist(row[0], c) > HOLE_SHARE * diagonal for c in centres)]
    uneven = sample(mesh, chance, lambda p: GRADIENT ** ((p[0] - low[0]) / (high[0] - low[0])))
    anywhere = [(tuple(chance.uniform(1.1 * a - 0.1 * b, 1.1 * b - 0.1 * a) for a, b in zip(low, high)), (0.0, 0.0, 1.0))
                for _ in range(OUTLIERS)]
    yield from (("clean", rows, True), ("noise of 0.2 %", noisy[0.2], True), ("noise of 0.5 %", noisy[0.5], True),
                ("12 holes of 4 %", holed, True), ("50-fold density", uneven, True), ("1 % outliers", rows + anywhere, True),
                ("no normals", rows, False), ("0.2 %, no normals", noisy[0.2], False),
                ("0.5 %, no normals", noisy[0.5], False))


def write_points(path, rows, has_normals):
    names = ["x", "y", "z"] + ["nx", "ny", "nz"] * has_normals
    head = "\n".join(["ply", "format ascii 1.0", f"element vertex {len(rows)}", *(f"property double {n}" for n in names),
                      "end_header"])
    path.write_text(head + "\n" + "".join("%.9g %.9g %.9g" % p + (" %.6g %.6g %.6g" % n if has_normals else "") + "\n"
                                          for p, n in rows))


def quadmesh(*words):
    """The last object that a command prints with --json, all of them, and the seconds of the processor."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run([catalogue.ROOT / "build" / "quadmesh", *map(str, words), "--json"], capture_output=True, text=True,
                          check=False)
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    lines = [json.loads(line) for line in done.stdout.splitlines()] if done.returncode in (0, 3) else []
    return lines, seconds, done.stderr.strip()[:200]


def middle(interval):
    return 0.5 * (interval["lower"] + interval["upper"])


def measure(quads, truth, diagonal):
    """How far the quads are from the true surface, and it from them."""
    found = {}
    for name, a, b in (("from_quads", quads, truth), ("from_truth", truth, quads)):
        measured = quadmesh("deviation", a, b, "--accuracy", "0.05", "--gap", "1e-4")[0]
        found[name] = {"rms": middle(measured[0]["rms"]) / diagonal, "max": measured[0]["max"]["upper"] / diagonal}
    return found


def reconstruct(points, layout, truth, diagonal):
    quads = OUT / "quads.ply"
    lines, seconds, words = quadmesh("reconstruct", points, layout, "-o", quads, "--quads", QUADS, "--no-measure", "--threads", 1)
    if not lines:
        return {"failed": words}
    quality = lines[-2]["quality"]
    return {"seconds": seconds, "quads": lines[-1]["quads"], "bad": f"{quality['folded_quads']} / {quality['turned_quads']}",
            "least": quality["least_jacobian"], "told": sorted({w["kind"] for w in lines[-1]["warnings"]}),
            **measure(quads, truth, diagonal)}


def remesh(points, truth, diagonal):
    quads = OUT / "quads.ply"
    lines, seconds, words = quadmesh("remesh", points, "-o", quads, "--quads", REMESHED, "--threads", 1)
    if not lines:
        return {"failed": words}
    made = lines[-1]
    told = made["points"]
    words = [f"{told['outliers']} outliers"] * (told["outliers"] > 0) + [f"noise {told['noise_relative']:.1e}"] * (told["noise_relative"] > 0)
    words += [f"{told['holes_filled']} holes"] * (told["holes_filled"] > 0) + [f"{told['borders']} borders"] * (told["borders"] > 0)
    return {"seconds": seconds, "quads": made["quads"], "bad": f"{made['folded']} / {made['components']}",
            "least": made["least_scaled_jacobian"], "told": words + ["normals estimated"] * (told["normals"] == "estimated"),
            **measure(quads, truth, diagonal)}


def sigma_of(name):
    """The noise of points by their name, as a share of the diagonal; 0 without."""
    return next((share / 100 for share in (0.2, 0.5) if f"{share} %" in name), 0.0)


def describe(model, name, row):
    if "failed" in row:
        return [model, name, row["failed"], *[""] * 6]
    ways = row["from_quads"], row["from_truth"]
    sigma = sigma_of(name)
    return [model, name, " / ".join(f"{way['rms']:.1e}" for way in ways), f"{ways[0]['rms'] / sigma:.2f}" if sigma > 0 else "",
            " / ".join(f"{way['max']:.1e}" for way in ways), row["bad"], f"{row['least']:.2f}", f"{row['seconds']:.1f}",
            ", ".join(row["told"])]


def run(settings, programs, pairs, say):
    del settings, programs, pairs
    OUT.mkdir(parents=True, exist_ok=True)
    rows, faults, lines, made = [], [], [], []
    for number, (model, path, drawn) in enumerate(MODELS):
        data = meshes.data_folder()
        layout = (catalogue.ROOT if drawn.startswith("tests") else data) / drawn
        if (path and not (data / path).exists()) or not layout.exists():
            continue
        mesh, truth = (load_obj(data / path), data / path) if path else (make_torus(), OUT / "torus.obj")
        if not path:
            truth.write_text("".join("v %.17g %.17g %.17g\n" % p for p in mesh[0]) +
                             "".join("f %d %d %d\n" % tuple(i + 1 for i in face) for face in mesh[1]))
        diagonal = math.dist(*box_of(mesh[0]))
        for name, points, has_normals in worsen(mesh, random.Random(number)):
            say(f"points of {model}, {name}")
            write_points(OUT / "points.ply", points, has_normals)
            for row, way, table in ((reconstruct(OUT / "points.ply", layout, truth, diagonal), "by a layout", lines),
                                    (remesh(OUT / "points.ply", truth, diagonal), "remeshed", made)):
                rows.append({"model": model, "points": name, "way": way, **row})
                table.append(describe(model, name, row))
                if "failed" in row:
                    faults.append(f"{model}, {name}, {way}: {row['failed']}")
    if lines:
        heads = ["model", "points", "rms:", "in noise:", "max:", "bad:", "least:", "s:", "told"]
        print(f"## Point sets\n\n{POINTS:,} points of each model, made worse in one way each, to at most {QUADS:,} quads by a layout, one "
              "thread: distances from the true surface, quads to it / it to quads, as shares of the diagonal; the first rms in standard "
              "deviations of the noise; quads folded / turned; least scaled Jacobian; seconds of the processor; what is told.\n")
        print(tables.table(heads, lines))
        print(f"\nThe same points by `remesh`, to about {REMESHED:,} quads, without a layout; quads folded / components.\n")
        print(tables.table(heads, made))
    return rows, faults
