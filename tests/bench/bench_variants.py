"""This engine against itself: two threads, and quads as bilinear patches."""
import os

import measuring
import tables

LARGE = 100000  # triangles of A and B together


def ask(settings, pair):
    facts = [measuring.export(path)[1] for path in (pair.a, pair.b)]
    has_quads = any(fact["faces"] < fact["triangles"] for fact in facts)
    questions = [measuring.ask_engine(settings, "one", pair.a, pair.b)]
    if len(os.sched_getaffinity(0)) > 1:
        questions.append(measuring.ask_engine(settings, "two", pair.a, pair.b, threads=2))
    if has_quads:
        questions.append(measuring.ask_engine(settings, "bilinear", pair.a, pair.b, "--quads", "bilinear"))
    return {"pair": str(pair), "triangles": sum(fact["triangles"] for fact in facts),
            "answers": measuring.by_turns(settings, questions)}


def ratio(row, key, name):
    """How often the time of the plain run holds that of the other; None where there is no such run."""
    answers = row["answers"]
    if key not in answers or "failed" in answers[key] or "failed" in answers["one"]:
        return None
    return answers["one"][name] / answers[key][name]


def describe(row):
    answers = row["answers"]
    gain, query_gain = ratio(row, "two", "total_ms"), ratio(row, "two", "query_ms")
    patches = ratio(row, "bilinear", "total_ms")
    return [row["pair"], str(row["triangles"]), tables.cell(answers["one"]),
            tables.cell(answers["two"]) if "two" in answers else "", tables.times(gain) if gain else "",
            tables.times(query_gain) if query_gain else "",
            tables.cell(answers["bilinear"]) if "bilinear" in answers else "",
            tables.times(1 / patches) if patches else ""]


def run(settings, _programs, pairs, say):
    rows = []
    for pair in pairs:
        for direction in (pair, pair.swapped()):
            say(f"threads and patches, {direction}")
            rows.append(ask(settings, direction))
    print("## Threads and patches\n\nBuild and query in ms. Gain: one thread over two, of all and of the query "
          "alone. Cost: bilinear over triangles, one thread.\n")
    print(tables.table(["pair", "triangles:", "one:", "two:", "gain:", "query gain:", "bilinear:", "cost:"],
                       [describe(row) for row in rows]))
    gains = [gain for gain in (ratio(row, "two", "total_ms") for row in rows if row["triangles"] > LARGE) if gain]
    if gains:
        print(f"two threads, {len(gains)} rows above {LARGE} triangles: {tables.geometric_mean(gains):.2f} times one "
              f"(geometric mean), {min(gains):.2f} at least")
    costs = [1 / cost for cost in (ratio(row, "bilinear", "total_ms") for row in rows) if cost]
    if costs:
        print(f"bilinear, {len(costs)} rows: {tables.geometric_mean(costs):.2f} times the triangles' time "
              f"(geometric mean), {max(costs):.2f} at most")
    faults = [f"{row['pair']}, {key}: {answer['failed']}" for row in rows for key, answer in row["answers"].items()
              if "failed" in answer]
    return rows, faults
