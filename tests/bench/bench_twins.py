"""Near twins: a mesh against itself, shifted a little, and shaken; the hard case of many programs."""
import dataclasses

import bench_hausdorff
import measuring
import tables

SHIFT, NOISE = 1e-6, 1e-3  # shares of the diagonal
CHANGES = {"like": {"noise": NOISE}, "same": {}, "shifted": {"shift": SHIFT}}
PEER_LIMIT_S = 60.0


def pick_meshes(pairs):
    """The first mesh of each pair, once each."""
    return list(dict.fromkeys(pair.a for pair in pairs))


def ask_engine(settings, path):
    questions = [measuring.ask_engine(settings, name, path, path,
                                      *(word for key, value in change.items() for word in (f"--{key}", repr(value))))
                 for name, change in CHANGES.items()]
    _, facts = measuring.export(path)
    return {"mesh": f"{path.parent.name} {path.stem}", "triangles": facts["triangles"],
            "answers": measuring.by_turns(settings, questions)}


def ask_peers(settings, programs, path):
    """The guaranteed peers once each, with a time limit: some never end here."""
    a, facts = measuring.export(path)
    rows = []
    for name, change in CHANGES.items():
        b, _ = measuring.export(path, **change)
        words = [word for key, value in change.items() for word in (f"--{key}", repr(value))]
        questions = [measuring.ask_engine(settings, "ours", path, path, *words)]
        questions += [measuring.ask_peer(settings, peer, a, b, facts["diagonal"]) for peer in programs.guaranteed()]
        limited = dataclasses.replace(settings, runs=1, peer_runs=1, limit_s=min(settings.limit_s, PEER_LIMIT_S))
        questions = [dataclasses.replace(question, runs=1) for question in questions]
        rows.append({"pair": f"{path.parent.name} {path.stem}, {name}", "diagonal": facts["diagonal"],
                     "answers": measuring.by_turns(limited, questions)})
    return rows


def describe(row):
    answers = row["answers"]
    line = [row["mesh"], str(row["triangles"]), tables.cell(answers["like"])]
    for name in ("same", "shifted"):
        is_there = "failed" not in answers[name] and "failed" not in answers["like"]
        line += [tables.cell(answers[name]),
                 tables.times(answers[name]["total_ms"] / answers["like"]["total_ms"]) if is_there else ""]
    return line


def run(settings, programs, pairs, say):
    rows = []
    for path in pick_meshes(pairs):
        say(f"twins of {path.parent.name} {path.stem}")
        rows.append(ask_engine(settings, path))
    print(f"## Near twins\n\nEach mesh against itself: shaken by up to {NOISE:g} of its diagonal in every coordinate "
          f"(the like pair), unchanged, and shifted by {SHIFT:g} of its diagonal. One thread, build and query in ms; "
          "over: times the like pair.\n")
    print(tables.table(["mesh", "triangles:", "like pair:", "same:", "over:", "shifted:", "over:"],
                       [describe(row) for row in rows]))
    smallest = min((path for path, row in zip(pick_meshes(pairs), rows)
                    if row["triangles"] >= bench_hausdorff.LARGE), default=None,
                   key=lambda path: path.stat().st_size)
    peer_rows = []
    if smallest and programs.guaranteed():
        say(f"twins of {smallest.parent.name} {smallest.stem}, peers")
        peer_rows = ask_peers(settings, programs, smallest)
        names = ["ours", *(peer.name for peer in programs.guaranteed())]
        print(f"The guaranteed peers on the smallest of these meshes with {bench_hausdorff.LARGE} triangles or more, "
              "one run: ms, and MiB in all (on top of program and input).\n")
        print(tables.table(["pair", *(f"{name}:" for name in names), *(f"{name} memory:" for name in names)],
                           [[row["pair"], *(tables.cell(row["answers"][name]) for name in names),
                             *(tables.memory(row["answers"][name]) for name in names)] for row in peer_rows]))
    faults = [f"{row['mesh']}, {key}: {answer['failed']}" for row in rows for key, answer in row["answers"].items()
              if "failed" in answer]
    return rows + peer_rows, faults + [fault for row in peer_rows for fault in bench_hausdorff.find_disagreements(row)]
