"""Distances of every pair, both ways, against the peers; and whether all of them say the same."""
import measuring
import tables

LARGE = 20000   # triangles of A and B together
SLACK = 1e-7    # by how much, as a share of the diagonal of A, brackets may miss each other


def ask(settings, programs, pair):
    a, facts_a = measuring.export(pair.a)
    b, facts_b = measuring.export(pair.b)
    questions = [measuring.ask_engine(settings, "ours", pair.a, pair.b)]
    questions += [measuring.ask_peer(settings, peer, a, b, facts_a["diagonal"])
                  for peer in programs.guaranteed() + programs.estimates()]
    answers = measuring.by_turns(settings, questions)
    return {"pair": str(pair), "triangles_a": facts_a["triangles"], "triangles_b": facts_b["triangles"],
            "diagonal": facts_a["diagonal"], "answers": answers}


def find_disagreements(row):
    """Sentences; a lower bound above another's upper bound means that one of them is wrong."""
    ours = row["answers"]["ours"]
    if "failed" in ours:
        return [f"{row['pair']}: this engine failed: {ours['failed']} {ours['complaint']}"]
    slack = SLACK * row["diagonal"]
    found = [] if ours["converged"] else [f"{row['pair']}: this engine did not reach the tolerance"]
    for name, answer in row["answers"].items():
        if "failed" in answer:
            continue
        upper = answer["upper"]
        if answer["lower"] > ours["upper"] + slack or (upper is not None and upper < ours["lower"] - slack):
            found.append(f"{row['pair']}: {name} says [{answer['lower']!r}, {upper!r}], "
                         f"this engine [{ours['lower']!r}, {ours['upper']!r}]")
    return found


def fastest_peer(row, programs):
    totals = [row["answers"][peer.name]["total_ms"] for peer in programs.guaranteed()
              if "failed" not in row["answers"][peer.name]]
    return min(totals, default=None)


def advantage(row, programs):
    fastest = fastest_peer(row, programs)
    return fastest / row["answers"]["ours"]["total_ms"] if fastest and "failed" not in row["answers"]["ours"] else None


def is_large(row):
    return row["triangles_a"] + row["triangles_b"] >= LARGE


def print_times(rows, programs):
    peers = programs.guaranteed()
    header = ["pair", "A:", "B:", "build:", "query:", "total:", *(f"{peer.name}:" for peer in peers), "faster:",
              "distance:"]
    lines = []
    for row in rows:
        ours, ratio = row["answers"]["ours"], advantage(row, programs)
        lines.append([row["pair"], str(row["triangles_a"]), str(row["triangles_b"]), tables.cell(ours, "build_ms"),
                      tables.cell(ours, "query_ms"), tables.cell(ours),
                      *(tables.cell(row["answers"][peer.name]) for peer in peers),
                      tables.times(ratio) if ratio else "", "" if "failed" in ours else
                      f"{ours['lower'] / row['diagonal']:.3e}"])
    print(tables.table(header, lines))
    for title, chosen in (("all pairs", rows), (f"{LARGE} triangles or more", list(filter(is_large, rows)))):
        ratios = [ratio for ratio in (advantage(row, programs) for row in chosen) if ratio]
        if ratios:
            print(f"{title}: {len(ratios)} rows, faster than the fastest guaranteed peer by "
                  f"{tables.geometric_mean(ratios):.2f} (geometric mean), {min(ratios):.2f} at least")


def print_estimates(rows, programs):
    peers = programs.estimates()
    if not peers:
        return
    header = ["pair"] + [f"{title}:" for peer in peers for title in (f"{peer.name} ({peer.hausdorff})", "found")]
    lines = []
    for row in rows:
        ours, line = row["answers"]["ours"], [row["pair"]]
        for peer in peers:
            answer = row["answers"][peer.name]
            share = "" if "failed" in answer or not ours.get("lower") else f"{100 * answer['lower'] / ours['lower']:.2f} %"
            line += [tables.cell(answer), share]
        lines.append(line)
    print("\nNot guaranteed: times in ms, and how much of the distance they found.\n")
    print(tables.table(header, lines))


def print_memory(rows, programs):
    peers = programs.guaranteed()
    lines = [[row["pair"], *(tables.memory(row["answers"][name]) for name in ("ours", *(peer.name for peer in peers)))]
             for row in rows]
    print("\nPeak memory in MiB: of the process, and in brackets what came on top of program and input.\n")
    print(tables.table(["pair", "ours:", *(f"{peer.name}:" for peer in peers)], lines))


def run(settings, programs, pairs, say):
    rows, faults = [], []
    for pair in pairs:
        for direction in (pair, pair.swapped()):
            say(str(direction))
            rows.append(ask(settings, programs, direction))
            faults += find_disagreements(rows[-1])
    print("## Distances\n\nFrom A to B, quads as two triangles, "
          f"tolerance {settings.tolerance:g} of A's diagonal, one thread. Median times in ms; build is "
          "both trees; the peers' times hold theirs. The distance is a share of A's diagonal.\n")
    print_times(rows, programs)
    print_estimates(rows, programs)
    print_memory(rows, programs)
    return rows, faults
