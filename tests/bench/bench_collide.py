"""Pairs of faces that meet: a mesh against itself turned, against a copy, and with itself."""
import measuring
import tables

TURN = 0.4  # radians
LARGEST = 150000  # triangles of a mesh: exact peers take minutes for more
MESHES = 3


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
            for answer in [row["answers"].get(peer.name, {"failed": "not asked"})]
            if "failed" not in answer and (answer["pairs"], answer["sum"]) != (ours["pairs"], ours["sum"])]


def describe(row, names):
    ours = row["answers"]["ours"]
    cells = [row["mesh"], f"{row['triangles']}", row["task"]]
    totals = []
    for name in ("ours", *names):
        answer = row["answers"].get(name)
        if answer is None:
            cells += ["-", "-"]
            continue
        cells += [tables.cell(answer), answer["failed"] if "failed" in answer else f"{answer['pairs']}"]
        if name != "ours" and "failed" not in answer:
            totals.append(answer["total_ms"])
    return [*cells, tables.times(min(totals) / ours["total_ms"]) if totals and "failed" not in ours else "-"]


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
    header = ["mesh", "triangles:", "task"]
    for name in ("ours", *names):
        header += [f"{name} ms:", "pairs:"]
    print(tables.table([*header, "times:"], [describe(row, names) for row in rows]))
    return rows, faults
