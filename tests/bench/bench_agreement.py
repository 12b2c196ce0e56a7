"""Compares the distances of all accelerators to every mesh of the data."""
import child
import measuring
import pairs as meshes

POINTS = 33334  # of each of the three sets
SLACK = 1e-12   # of the diagonal


def find_worst(row):
    return max((value for key, value in row["answers"]["agree"].items() if key.startswith(("triangles_", "bilinear_"))),
               default=0.0)


def find_faults(row):
    answer = row["answers"]["agree"]
    if "failed" in answer:
        return [f"{row['mesh']}, agree: {answer['failed']}"]
    worst = find_worst(row)
    return [f"{row['mesh']}: accelerators differ by {worst:.3g} of the diagonal"] if worst > SLACK else []


def run(settings, _programs, pairs, say):
    print("## Do accelerators agree?\n")
    rows = []
    for path in meshes.find_all(pairs):
        say(f"accelerators agree, {path.parent.name} {path.stem}")
        answer = child.run(measuring.engine("agree", path, "--count", POINTS, "--seed", settings.seed), 1,
                           10 * settings.limit_s, settings.limit_bytes)
        rows.append({"mesh": f"{path.parent.name} {path.stem}", "answers": {"agree": answer}})
    worst = max(map(find_worst, rows), default=0.0)
    print(f"Distances of {3 * POINTS} points to each of {len(rows)} meshes by all accelerators, in both readings: they "
          f"differ by at most {worst:.3g} of the diagonal.\n")
    return rows, [fault for row in rows for fault in find_faults(row)]
