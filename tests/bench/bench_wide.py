"""Distances of pairs that were drawn, at several tolerances, against the guaranteed peers; and of very large ones."""
import dataclasses
import math

import bench_hausdorff
import measuring
import pairs as meshes
import tables
import variants

TOLERANCES = (1e-8, 1e-6, 1e-3)  # shares of A's diagonal
WORST = 10
LARGEST = ("torus:4000x2000x3", "torus:1680x840x4")  # 16 million triangles and 1.4 million quads, made in memory
LARGEST_TOLERANCE = 1e-3


def ask(settings, programs, pair):
    """A row of bench_hausdorff for each tolerance, in the order of TOLERANCES."""
    guaranteed = dataclasses.replace(programs, peers=programs.guaranteed())
    return [bench_hausdorff.ask(dataclasses.replace(settings, tolerance=tolerance), guaranteed, pair)
            for tolerance in TOLERANCES]


def titles():
    return [f"{tolerance:g}:" for tolerance in TOLERANCES]


def describe(entry, programs):
    first = entry["rows"][0]
    line = [first["pair"], entry["kind"], str(first["triangles_a"]), str(first["triangles_b"])]
    for row in entry["rows"]:
        peer, ratio = bench_hausdorff.fastest_peer(row, programs), bench_hausdorff.advantage(row, programs)
        line += [tables.cell(row["answers"]["ours"]), tables.ms(peer) if peer else "",
                 tables.times(ratio) if ratio else ""]
    return line


def ratios_of(entries, programs):
    """For each tolerance the ratios of all entries that have one."""
    return [[ratio for ratio in (bench_hausdorff.advantage(entry["rows"][i], programs) for entry in entries) if ratio]
            for i in range(len(TOLERANCES))]


def print_kinds(entries, programs):
    kinds = {}
    for entry in entries:
        kinds.setdefault(entry["kind"], []).append(entry)
    lines = [[kind, str(len(found)),
              *(f"{tables.times(tables.geometric_mean(ratios))} ({tables.times(min(ratios))})" if ratios else ""
                for ratios in ratios_of(found, programs))] for kind, found in sorted(kinds.items())]
    print("\nBy kind: geometric mean and, in brackets, least ratio at each tolerance.\n")
    print(tables.table(["kind", "pairs:", *titles()], lines))


def print_worst(entries, programs):
    lines = [(ratio, [entry["rows"][0]["pair"], entry["kind"], f"{tolerance:g}", tables.times(ratio)])
             for entry in entries for tolerance, row in zip(TOLERANCES, entry["rows"])
             if (ratio := bench_hausdorff.advantage(row, programs))]
    lines.sort(key=lambda line: line[0])
    print(f"\nThe {min(WORST, len(lines))} least ratios.\n")
    print(tables.table(["pair", "kind", "tolerance:", "ratio:"], [line for _, line in lines[:WORST]]))


def print_draw(entries, programs):
    header = ["pair", "kind", "A:", "B:"]
    for title in titles():
        header += [title, "peer:", "faster:"]
    print(tables.table(header, [describe(entry, programs) for entry in entries]))
    for tolerance, ratios in zip(TOLERANCES, ratios_of(entries, programs)):
        if ratios:
            print(f"tolerance {tolerance:g}: {len(ratios)} rows, faster than the fastest guaranteed peer by "
                  f"{tables.geometric_mean(ratios):.2f} (geometric mean), {min(ratios):.2f} at least")
    print_kinds(entries, programs)
    print_worst(entries, programs)


def run(settings, programs, drawn, say):
    entries, faults = [], []
    for number, variant in enumerate(drawn, 1):
        say(f"{number} of {len(drawn)}: {variant.pair}, {variant.kind()}")
        entries.append({"kind": variant.kind(), "rows": ask(settings, programs, variant.make())})
        faults += [fault for row in entries[-1]["rows"] for fault in bench_hausdorff.find_disagreements(row)]
    print(f"## A wide draw\n\n{len(drawn)} of {len(variants.find_all())} pairs in both directions, as they are or "
          f"with one mesh changed; drawn with seed {settings.seed}. From A to B, quads as two triangles, one thread; "
          "median times in ms, of this engine and of the fastest guaranteed peer, at three tolerances, which are "
          "shares of A's diagonal.\n")
    print_draw(entries, programs)
    return entries, faults


def per_face(answer, faces):
    return "" if "failed" in answer else f"{1024 * answer['on_top_kb'] / faces:.0f}"


def run_largest(settings, say):
    """Pairs that no file holds and that no peer measures, both ways."""
    rows, lines = [], []
    for a, b in (LARGEST, LARGEST[::-1]):
        say(f"large: {a} -> {b}")
        command = measuring.engine("hausdorff", a, b, "--tolerance", repr(LARGEST_TOLERANCE))
        answer = measuring.by_turns(settings, [measuring.Question("ours", command, 1)])["ours"]
        triangles = sum(2 * math.prod(int(number) for number in name[6:].split("x")[:2]) for name in (a, b))
        rows.append({"pair": f"{a} -> {b}", "triangles": triangles, "answers": {"ours": answer}})
        lines.append([a, b, tables.cell(answer, "build_ms"), tables.cell(answer, "query_ms"),
                      per_face(answer, triangles)])
    print(f"\nMade in memory, tolerance {LARGEST_TOLERANCE:g}, this engine alone: ms, and bytes a triangle as above.\n")
    print(tables.table(["A", "B", "trees:", "search:", "bytes:"], lines))
    return rows, [f"{row['pair']}: {row['answers']['ours']['failed']}" for row in rows
                  if "failed" in row["answers"]["ours"]]


def run_large(settings, programs, _pairs, say):
    """A pair by formula of 4 million triangles and 350,000 quads, both ways; then a larger one."""
    guaranteed = dataclasses.replace(programs, peers=programs.guaranteed())
    names = ["ours", *(peer.name for peer in guaranteed.peers)]
    rows, lines, faults = [], [], []
    pair = meshes.make_large()
    for direction in (pair, pair.swapped()):
        say(f"large: {direction}")
        row = bench_hausdorff.ask(dataclasses.replace(settings, runs=1, peer_runs=1), guaranteed, direction)
        faces = row["triangles_a"] + row["triangles_b"]
        lines.append([row["pair"], str(row["triangles_a"]), str(row["triangles_b"]),
                      *(tables.cell(row["answers"][name]) for name in names),
                      *(per_face(row["answers"][name], faces) for name in names)])
        rows.append(row)
        faults += bench_hausdorff.find_disagreements(row)
    print(f"## Large\n\nTwo surfaces by formula near each other, tolerance {settings.tolerance:g} of A's diagonal, one "
          "thread, one run: ms, and bytes a triangle of both meshes on top of program and input.\n")
    print(tables.table(["pair", "A:", "B:", *(f"{name}:" for name in names), *(f"{name} bytes:" for name in names)],
                       lines))
    largest, failures = run_largest(settings, say)
    return rows + largest, faults + failures
