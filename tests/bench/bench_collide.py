"""Pairs of faces that meet: a mesh against itself turned, against a copy, and with itself; after a part has moved; and
whether every triangle mesh of the data has the self-collisions that CGAL finds."""
import measuring
import pairs as meshes
import tables

TURN = 0.4  # radians
LARGEST = 150000  # triangles of a mesh: exact peers take minutes for more
MESHES = 3
MOVED_SIDE = 1000  # of the torus of which a part moves, beside the meshes of the pairs: a million quads


def pick_meshes(pairs):
    """The first meshes of the pairs that are triangles, the largest ones."""
    counts = {}
    for pair in pairs:
        facts = measuring.export(pair.a)[1]
        if facts["faces"] == facts["triangles"] <= LARGEST:
            counts[pair.a] = facts["triangles"]
    return sorted(counts, key=counts.get, reverse=True)[:MESHES]


def make_tasks(path):
    """Name, words for this engine, operands for the peers, and their command."""
    arrays, turned = measuring.export(path)[0], measuring.export(path, turn=TURN)[0]
    return [("turned", ("collide", path, path, "--turn", repr(TURN)), "collide", (arrays, turned)),
            ("copy", ("collide", path, path), "collide", (arrays, arrays)),
            ("self", ("self", path), "self", (arrays,))]


def ask(settings, programs, path, task):
    name, words, command, operands = task
    questions = [measuring.Question("ours", measuring.engine(*words), settings.runs)]
    for peer in programs.colliding():
        if command == "collide" or peer.self:
            questions.append(measuring.Question(peer.name, (*peer.command, command, *operands), settings.peer_runs))
    return {"mesh": f"{path.parent.name} {path.stem}", "triangles": measuring.export(path)[1]["triangles"], "task": name,
            "answers": measuring.by_turns(settings, questions)}


def find_disagreements(row, programs):
    """Exact programs must find the same pairs; of the others the count is shown."""
    ours = row["answers"]["ours"]
    if "failed" in ours:
        return [f"{row['mesh']}, {row['task']}: this engine failed: {ours['failed']} {ours['complaint']}"]
    return [f"{row['mesh']}, {row['task']}: {peer.name} finds {answer['pairs']} pairs, this engine {ours['pairs']}"
            for peer in programs.colliding() if peer.collide == "exact"
            for answer in [row["answers"].get(peer.name, {"failed": "not run"})]
            if "failed" not in answer and not is_same(answer, ours)]


def is_same(answer, ours):
    """A peer that cannot hold a mesh that is not manifold leaves some pairs open."""
    if answer.get("undecided"):
        return 0 <= ours["pairs"] - answer["pairs"] <= answer["undecided"]
    return (answer["pairs"], answer["sum"]) == (ours["pairs"], ours["sum"])


def count_pairs(answer):
    if "failed" in answer:
        return answer["failed"]
    return f"{answer['pairs']}" + (f" to {answer['pairs'] + answer['undecided']}" if answer.get("undecided") else "")


def describe(row, names):
    ours = row["answers"]["ours"]
    cells = [row["mesh"], f"{row['triangles']}", row["task"]]
    totals = []
    for name in ("ours", *names):
        answer = row["answers"].get(name)
        if answer is None:
            cells += ["-", "-"]
            continue
        cells += [tables.cell(answer), count_pairs(answer)]
        if name != "ours" and "failed" not in answer:
            totals.append(answer["total_ms"])
    return [*cells, tables.times(min(totals) / ours["total_ms"]) if totals and "failed" not in ours else "-"]


def find_triangle_meshes(pairs):
    facts = {path: measuring.export(path)[1] for path in meshes.find_all(pairs)}
    return [path for path, counts in facts.items() if counts["faces"] == counts["triangles"]]


def compare_with_cgal(settings, programs, paths, say):
    """Self-collisions of many meshes, once each."""
    exact = [peer for peer in programs.colliding() if peer.self == "exact"]
    rows, faults = [], []
    for path in paths if exact else []:
        say(f"collide: {path.parent.name} {path.name} with itself")
        questions = [measuring.Question("ours", measuring.engine("self", path), 1),
                     *(measuring.Question(peer.name, (*peer.command, "self", measuring.export(path)[0]), 1) for peer in exact)]
        row = {"mesh": f"{path.parent.name} {path.stem}", "triangles": measuring.export(path)[1]["triangles"],
               "task": "self", "answers": measuring.by_turns(settings, questions)}
        faults += find_disagreements(row, programs)
        rows.append(row)
    if rows:
        names = [peer.name for peer in exact]
        print("\nEvery triangle mesh of the data with itself, one run.\n")
        print(tables.table(describe_header(names), [describe(row, names) for row in rows]))
    return rows, faults


def run_moved(settings, paths, say):
    """Self-collision after a hundredth part of the vertices has moved: all pairs again, and the pairs that could change."""
    torus = meshes.MADE / f"torus_{MOVED_SIDE}.off"
    if not torus.exists():
        meshes.write_torus(torus, MOVED_SIDE, MOVED_SIDE, 4)
    rows = []
    for path in (*paths, torus):
        say(f"collide: {path.parent.name} {path.stem}, moved")
        answers = measuring.by_turns(settings, [measuring.Question("ours", measuring.engine("moved", path), settings.runs)])
        rows.append({"mesh": f"{path.parent.name} {path.stem}", "task": "moved", "answers": answers})
    print("\nA mesh with itself after a hundredth part of its vertices, which lie together, has moved: ms of a full run and "
          "of one that carries the other pairs over. The tree follows before.\n")
    print(tables.table(["mesh", "moved:", "pairs:", "full:", "incremental:", "times:"], [describe_moved(row) for row in rows]))
    return rows, [f"{row['mesh']}, moved: {answer['failed']} {answer['complaint']}" for row in rows
                  for answer in row["answers"].values() if "failed" in answer]


def describe_moved(row):
    answer = row["answers"]["ours"]
    if "failed" in answer:
        return [row["mesh"], "", "", "", answer["failed"], ""]
    return [row["mesh"], f"{answer['part']}", f"{answer['pairs']}", tables.ms(answer["full_ms"]), tables.ms(answer["query_ms"]),
            tables.times(answer["full_ms"] / answer["query_ms"])]


def describe_header(names):
    header = ["mesh", "triangles:", "task"]
    for name in ("ours", *names):
        header += [f"{name} ms:", "pairs:"]
    return [*header, "times:"]


def run(settings, programs, pairs, say):
    rows, faults = [], []
    for path in pick_meshes(pairs):
        for task in make_tasks(path):
            say(f"collide: {path.parent.name} {path.stem}, {task[0]}")
            row = ask(settings, programs, path, task)
            faults += find_disagreements(row, programs)
            rows.append(row)
    names = [peer.name for peer in programs.colliding()]
    print("## Pairs of faces that meet\n")
    print("Milliseconds of builds and search together, and how many pairs were found. The last column: the fastest "
          "peer's time by this engine's.\n")
    print(tables.table(describe_header(names), [describe(row, names) for row in rows]))
    for more, wrong in (run_moved(settings, pick_meshes(pairs), say),
                        compare_with_cgal(settings, programs, find_triangle_meshes(pairs), say)):
        rows += more
        faults += wrong
    return rows, faults
