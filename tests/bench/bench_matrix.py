"""All pairs of a set of meshes by formula: how many are searched, and the time beside all pairs one by one."""
import measuring
import tables

KINDS = {"sizes": "spheres of 100 radii", "versions": "10 families of 10 versions", "any": "all different"}
WANTS = {"all": "all", "nearest": "the 3 nearest", "within": "within 0.1"}
COUNT = 100
TOLERANCE = 1e-3  # in the unit of the meshes, whose radius is about 1


def ask(settings, kind, want):
    command = measuring.engine("matrix", kind, want, "--count", COUNT, "--tolerance", repr(TOLERANCE))
    return measuring.by_turns(settings, [measuring.Question("ours", command, settings.runs)])["ours"]


def describe(row):
    answer = row["answer"]
    line = [KINDS[row["kind"]], WANTS[row["want"]]]
    if "failed" in answer:
        return [*line, "", "", "", answer["failed"], "", ""]
    return [*line, f"{answer['pairs']:.0f}", f"{answer['searched']:.0f}", f"{answer['searches']:.0f}", tables.ms(answer["query_ms"]),
            tables.ms(answer["full_ms"]), tables.times(answer["full_ms"] / answer["query_ms"])]


def run(settings, _programs, _pairs, say):
    rows = []
    for kind in KINDS:
        for want in WANTS:
            say(f"matrix: {kind}, {want}")
            rows.append({"kind": kind, "want": want, "answer": ask(settings, kind, want)})
    print(f"## All pairs of a set\n\n{COUNT} spheres with waves, of 1,104 quads read as triangles each, tolerance {TOLERANCE:g} of "
          "a unit, one thread. Pairs that were searched, searches (a pair may need a second one that goes further), ms of the "
          "matrix, and of a search for each pair with the same tolerance and limit, whose intervals must agree with it.\n")
    print(tables.table(["set", "wanted", "pairs:", "searched:", "searches:", "ms:", "one by one:", "times:"],
                       [describe(row) for row in rows]))
    return rows, [f"{row['kind']}, {row['want']}: {row['answer']['failed']}" for row in rows if "failed" in row["answer"]]
