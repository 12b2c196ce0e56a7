"""The checkers find what is planted in forged histories, name the calls, and pass what is right.

QM_TEST_SEED moves the random histories; a failure shows the seed.
"""
import copy
import itertools
import os
import random

import pytest

import checkers
import linear
from history import Call, History

SEED = int(os.environ.get("QM_TEST_SEED", "1"))
LONG = os.environ.get("QM_TEST_LONG", "0") != "0"
clock = iter(range(1, 10**9))


def call(name, key="m", start=None, end=None, answer=None, **arguments):
    """A call after all that were forged before, unless its times are told; without an answer it is unknown."""
    start = next(clock) if start is None else start
    made = Call("p", name, key, arguments, start)
    if answer is not None:
        made.end, made.answer = next(clock) if end is None else end, answer
    return made


def write(slot, value, revision=None, **times):
    return call("write", slot=slot, value=value, answer=revision and {"revision": revision}, **times)


def swap(expected, slot, value, revision=None, **times):
    answer = {"revision": revision} if revision else {"is_conflict": True}
    return call("swap", expected=expected, slot=slot, value=value, answer=answer, **times)


def read(revision, *values, **times):
    return call("read", answer={"revision": revision, "values": list(values)}, **times)


def planted(violations, rule, *calls):
    """There are violations, all of this rule, and one of them names the calls."""
    assert violations and {violation.rule for violation in violations} == {rule}, violations
    assert any(set(map(id, calls)) <= set(map(id, violation.calls)) for violation in violations), \
        "\n".join(map(str, violations))
    assert all(str(violation) for violation in violations)


def register(calls):
    return checkers.check_register(calls, {"m": (0, (0, 0))})


# ---- C1 ----

def test_registers_that_are_right():
    assert not register([write(0, 5, 1), read(1, 5, 0), swap(1, 1, 7, 2), swap(1, 1, 8), read(2, 5, 7)])
    # Two at the same time, and a read between them.
    assert not register([write(0, 1, 2, start=1, end=9), write(1, 2, 1, start=2, end=8), read(1, 0, 2, start=3, end=7),
                         read(2, 1, 2, start=10, end=11)])
    # Without an answer: never, late, or at once.
    assert not register([write(0, 1), read(0, 0, 0), read(0, 0, 0)])
    assert not register([write(0, 1), read(0, 0, 0), write(1, 3, 2), read(2, 1, 3)])
    assert not register([call("swap", expected=0, slot=0, value=4), read(1, 4, 0)])
    assert not register([call("swap", expected=3, slot=0, value=4), read(0, 0, 0)])
    # Removed, perhaps.
    assert not register([write(0, 1, 1), call("remove", answer={}), call("read", answer={"is_gone": True}),
                         call("write", slot=0, value=1, answer={"is_gone": True})])
    assert not register([call("remove"), read(0, 0, 0), call("read", answer={"is_gone": True})])


def test_registers_that_are_wrong():
    lost, seen = write(0, 5, 1), read(0, 0, 0)
    planted(register([lost, seen]), "C1", lost, seen)
    maybe, first, stale = write(0, 5), read(1, 5, 0), read(0, 0, 0)
    planted(register([maybe, first, stale]), "C1", stale)                # read, then lost
    one, twin = swap(0, 0, 1, 1), swap(0, 1, 2, 1)
    planted(register([one, twin]), "C1", one, twin)                      # both had the revision
    one, torn = write(0, 1, 1), read(1, 0, 0)
    planted(register([one, torn]), "C1", one, torn)                      # the number without the change
    one, other, mixed = write(0, 1, 1), write(1, 2, 2), read(2, 0, 2)
    planted(register([one, other, mixed]), "C1", other, mixed)           # a sparse change undone by another
    refused = swap(0, 0, 1)
    planted(register([refused]), "C1", refused)                          # 412 for the current revision
    once, twice = write(0, 9), read(2, 9, 0)
    planted(register([once, twice]), "C1", twice)                        # a repetition that counted again
    removal, back = call("remove", answer={}), read(0, 0, 0)
    planted(register([removal, back]), "C1", removal, back)
    early = read(1, 1, 0)
    planted(register([early, write(0, 1, 1)]), "C1", early)              # read before it was asked for


def random_history(chance, length, clients=5, slots=3, unknown=0.03):
    """Calls of a register that is right, each with its effect at a random instant within it, and its first state."""
    state, calls = (0, (0,) * slots), []
    instants = sorted(chance.random() * length for _ in range(length))
    busy = [0.0] * clients
    for number, at in enumerate(instants, 1):
        ready = [client for client in range(clients) if busy[client] < at]
        if not ready:
            continue
        client = chance.choice(ready)
        made = Call(f"c{client}", chance.choice(["read", "write", "swap"]), "m", {},
                    chance.uniform(max(busy[client], at - 3), at))
        if made.name != "read":
            made.arguments = {"slot": chance.randrange(slots), "value": number}
        if made.name == "swap":
            made.arguments["expected"] = max(0, state[0] - chance.choice([0, 0, 0, 1]))
        if made.name == "swap" and made.arguments["expected"] != state[0]:
            answer = {"is_conflict": True}
        elif made.name == "read":
            answer = {"revision": state[0], "values": list(state[1])}
        elif chance.random() < unknown / 2:
            answer = None  # it had no effect, and nobody knows
        else:
            slot = made.arguments["slot"]
            state = (state[0] + 1, state[1][:slot] + (number,) + state[1][slot + 1:])
            answer = {"revision": state[0]}
        if answer and chance.random() > unknown:
            made.end, made.answer = at + chance.random() * 3, answer
            busy[client] = made.end
        calls.append(made)
    return calls


@pytest.mark.parametrize("length", [10, 100, 1000])
def test_random_registers_that_are_right(length):
    for seed in range(SEED, SEED + (20 if length == 1000 else 100) * (10 if LONG else 1)):
        calls = random_history(random.Random(seed), length)
        assert not register_of(calls), f"seed {seed}"


def register_of(calls):
    return checkers.check_register(calls, {"m": (0, (0, 0, 0))})


def spoil(chance, calls):
    """A copy with one answer that no order explains: a value that nobody wrote, or a number that went backwards."""
    calls = copy.deepcopy(calls)
    how = chance.choice(["value", "back", "twin"])
    reads = [made for made in calls if made.name == "read" and made.is_known]
    if how == "value":
        spoiled = chance.choice(reads)
        spoiled.answer["values"][0] = -1
    elif how == "back":
        late = [made for made in reads if any(
            other.is_known and other.end < made.start and "revision" in other.answer and other.answer["revision"] >= 1
            for other in calls)]
        if not late:
            return None
        spoiled = chance.choice(late)
        spoiled.answer = {"revision": 0, "values": [0, 0, 0]}
    else:
        done = [made for made in calls if made.is_known and made.name != "read" and "revision" in made.answer]
        if len(done) < 2:
            return None
        spoiled, other = chance.sample(done, 2)
        spoiled.answer["revision"] = other.answer["revision"]
    return calls, spoiled


@pytest.mark.parametrize("length", [20, 200])
def test_random_registers_that_are_wrong(length):
    found = 0
    for seed in range(SEED, SEED + 100 * (10 if LONG else 1)):
        chance = random.Random(seed)
        wrong = spoil(chance, random_history(chance, length))
        if wrong:
            found += 1
            assert register_of(wrong[0]), f"seed {seed}: {wrong[1]}"
    assert found > 50


def test_a_search_that_becomes_too_long_says_so():
    calls = [call("write", slot=0, value=n) for n in range(40)] + [read(20, -1, 0)]
    with pytest.raises(linear.Undecided):
        linear.linearize(calls, (0, (0, 0)), checkers.register_step, limit=1000)


def test_a_slow_search_finds_the_same():
    """Against all orders of short histories, one by one."""
    def holds(calls, state, rest):
        if not any(made.is_known for made in rest):
            return True
        for made in rest:
            if any(other.is_known and other.end < made.start for other in rest if other is not made):
                continue
            after = checkers.register_step(state, made)
            if after is not linear.IMPOSSIBLE and holds(calls, after, [other for other in rest if other is not made]):
                return True
        return False

    verdicts = set()
    for seed in itertools.count(SEED):
        chance = random.Random(seed)
        calls = random_history(chance, 8, unknown=0.2)
        if chance.random() < 0.7 and any(made.name == "read" and made.is_known for made in calls):
            wrong = spoil(chance, calls)
            calls = wrong[0] if wrong else calls
        verdict = holds(calls, (0, (0, 0, 0)), calls)
        assert verdict == (not register_of(calls)), f"seed {seed}: {[str(made) for made in calls]}"
        verdicts.add(verdict)
        if seed > SEED + 200:
            break
    assert verdicts == {True, False}


# ---- C2 ----

def create(id_, content="h", kind="mesh", **times):
    return call("create", kind=kind, hash=content, answer=id_ and {"id": id_}, **times)


def listed(kind="mesh", start=None, end=None, **items):
    return call("list", "", kind=kind, answer={"items": items}, start=start, end=end)


def fetched(key, content):
    return call("fetch", key, kind="mesh", answer={"hash": content} if content else {"is_gone": True})


def test_sets_that_are_right():
    assert not checkers.check_sets([create("a"), listed(a="h"), fetched("a", "h"), call("remove", "a", answer={}),
                                    listed(), fetched("a", None)])
    assert not checkers.check_sets([create(None, "x"), listed(b="x")])    # it was made, and nobody was told
    assert not checkers.check_sets([create(None, "x"), listed()])
    assert not checkers.check_sets([create("a", start=1, end=5), listed(start=2, end=3)])
    assert not checkers.check_sets([create("a"), call("remove", "a"), listed(), create("a"), listed(a="h")])
    assert not checkers.check_sets([create("a"), listed("layout")])       # another kind


def test_sets_that_are_wrong():
    made, look = create("a"), listed()
    planted(checkers.check_sets([made, look]), "C2", made, look)
    made, look = create("a"), fetched("a", None)
    planted(checkers.check_sets([made, look]), "C2", made, look)
    gone, look = call("remove", "a", answer={}), listed(a="h")
    planted(checkers.check_sets([create("a"), gone, look]), "C2", gone, look)
    made, look = create("a"), fetched("a", "other")
    planted(checkers.check_sets([made, look]), "C2", made, look)
    look = listed(b="h")
    planted(checkers.check_sets([look]), "C2", look)
    one, other = create("a", "h"), create("a", "i")
    planted(checkers.check_sets([one, other]), "C2", one, other)


# ---- C3 ----

def submit(id_, body="b", key="k"):
    return call("submit", key, body=body, answer={"id": id_} if id_ else {"is_mismatch": True})


def test_keys():
    assert not checkers.check_keys([submit("j"), submit("j"), submit(None, "other"), submit("i", key="l"),
                                    call("submit", "k", body="b")])
    one, other = submit("j"), submit("i")
    planted(checkers.check_keys([one, other]), "C3", one, other)
    one, other = submit("j"), submit("j", "other")
    planted(checkers.check_keys([one, other]), "C3", one, other)
    refused = submit(None)
    planted(checkers.check_keys([refused]), "C3", refused)


# ---- C4 ----

def bounds(seq, lower, upper):
    return {"event": "bounds", "seq": seq, "lower": lower, "upper": upper}


def result(seq, lower, upper):
    return {"event": "result", "seq": seq, "state": "succeeded", "result": {"lower": lower, "upper": upper}}


def again(run):
    return {"event": "server_restart", "seq": (run - 1) * 10**9 + 1}


GOOD = [bounds(1, 0, None), bounds(2, 0.5, 2), again(2), bounds(10**9 + 2, 0.9, 1.5), result(10**9 + 3, 0.99, 1.01)]


def log(lines):
    return call("log", "j", answer={"lines": lines})


def stream(lines):
    return call("stream", "j", answer={"lines": lines})


def test_events_that_are_right():
    whole = log(GOOD)
    assert not checkers.check_events([whole, stream(GOOD), stream(GOOD[1:4]), stream([])], {"j": 1.0})
    # What a sudden end cut off from the log, some readers got.
    assert not checkers.check_events([whole, stream(GOOD[:2] + [bounds(3, 0.6, 2), bounds(4, 0.7, 2)] + GOOD[2:])])
    assert not checkers.check_events([whole, stream(GOOD[:2] + [{"event": "server_shutdown", "seq": 3}] + GOOD[2:])])


@pytest.mark.parametrize("name, lines", [
    ("no end", GOOD[:-1]), ("two ends", GOOD[:2] + [result(3, 0.9, 1.1)] + GOOD[2:]),
    ("a gap", GOOD[:1] + [bounds(3, 0.5, 2)] + GOOD[2:]), ("backwards", [GOOD[1], GOOD[0], *GOOD[2:]]),
    ("wider", GOOD[:3] + [bounds(10**9 + 2, 0.9, 1.005), result(10**9 + 3, 0.99, 1.01)]),
    ("crossed", GOOD[:3] + [bounds(10**9 + 2, 1.2, 1.1), result(10**9 + 3, 0.99, 1.01)]),
    ("no restart", GOOD[:2] + [bounds(10**9 + 1, 0.9, 1.5), result(10**9 + 2, 0.99, 1.01)]),
    ("untrue", GOOD[:-1] + [result(10**9 + 3, 1.001, 1.01)]), ("empty", [])])
def test_logs_that_are_wrong(name, lines):
    whole = log(lines)
    planted(checkers.check_events([whole], {"j": 1.0}), "C4", whole)


@pytest.mark.parametrize("name, lines", [
    ("another line", [bounds(1, 0, 3)]), ("a line that never was", [*GOOD, bounds(10**9 + 4, 0.99, 1.01)]),
    ("left out", [GOOD[0], *GOOD[2:]]), ("twice", [GOOD[0], *GOOD]), ("out of order", [GOOD[1], GOOD[0]])])
def test_readers_that_are_wrong(name, lines):
    whole, reader = log(GOOD), stream(lines)
    planted(checkers.check_events([whole, reader]), "C4", whole, reader)


def test_two_readers_that_differ():
    one, other = stream([bounds(1, 0, 2)]), stream([bounds(1, 0, 3)])
    planted(checkers.check_events([one, other]), "C4", one, other)


# ---- C5 ----

def test_effects():
    assert not checkers.check_effects([write(0, 1, 2), write(0, 1), write(0, 1, 1), write(0, 1, 4)])
    one, twin = write(0, 1, 1), write(0, 2, 1)
    planted(checkers.check_effects([one, twin]), "C5", one, twin)
    one, gap = write(0, 1, 1), write(0, 2, 3)
    planted(checkers.check_effects([one, gap]), "C5", one, gap)


def step(steps, taken):
    return call("step", "r", steps=steps, answer=None if taken is None else {"taken": taken})


def test_steps():
    for total in (5, 6, 8, 9):
        assert not checkers.check_effects([step(3, 3), step(2, 2), step(1, None), step(3, None), step(4, 0),
                                           call("count", "r", answer={"steps": total})])
    twice, count = step(2, 2), call("count", "r", answer={"steps": 4})
    planted(checkers.check_effects([twice, count]), "C5", twice, count)
    lost, count = step(2, 2), call("count", "r", answer={"steps": 0})
    planted(checkers.check_effects([lost, count]), "C5", lost, count)


# ---- C6 ----

def document(state="succeeded", epoch=None, node="n1", value=1):
    answer = {"state": state, "document": {"result": value} if state == "succeeded" else {}}
    return call("document", "j", answer={**answer, "epoch": epoch, "node": node} if epoch else answer)


def test_leases():
    assert not checkers.check_leases([document("running", 1), document("running", 2, "n2"), document(epoch=2, node="n2"),
                                      document(epoch=2, node="n2")])
    end = {"lower": 0.99, "upper": 1.01}
    assert not checkers.check_leases([log(GOOD), stream(GOOD[:2]), document(value=end)])
    late, newer = document(epoch=1), document("running", 2, "n2")
    planted(checkers.check_leases([late, newer]), "C6", late, newer)
    late, newer = stream([result(3, 0, 2)]), log(GOOD)
    planted(checkers.check_leases([late, newer]), "C6", late, newer)
    one, other = document(epoch=2, value=1), document(epoch=2, value=2)
    planted(checkers.check_leases([one, other]), "C6", one, other)
    one, other = document("running", 1, "n1"), document("running", 1, "n2")
    planted(checkers.check_leases([one, other]), "C6", one, other)


# ---- C7 ----

REST = {"blobs": {"a": 3, "b": 5, "c": 1}, "stored_bytes": {"a": 3, "b": 5, "c": 1}, "named_blobs": ["a", "b", None],
        "unneeded_blobs": ["c"], "queued": ["j1"], "running": ["j2"], "unfinished": ["j1", "j2"],
        "terminal_events": {"j3": 1}}


@pytest.mark.parametrize("change", [
    {"named_blobs": ["a", "b", "d"]}, {"unneeded_blobs": []}, {"stored_bytes": {"a": 3, "b": 4, "c": 1}},
    {"queued": ["j1", "j2"]}, {"queued": []}, {"unfinished": ["j1"]}, {"running": ["j2", "j2"]},
    {"terminal_events": {"j3": 2}}, {"terminal_events": {"j3": 0}}])
def test_tables(change):
    assert not checkers.check_rest(REST)
    planted(checkers.check_rest({**REST, **change}), "C7")


# ---- the history itself ----

def test_a_history_is_written_and_read(tmp_path):
    made = History()
    first = made.begin("p1", "write", "m", "n1", slot=0, value=1)
    made.end(first, revision=1)
    made.begin("p2", "read", "m")
    made.withdraw(made.begin("p2", "read", "m"))
    made.save(tmp_path / "history")
    again_ = History.load(tmp_path / "history")
    assert list(map(str, again_.calls)) == list(map(str, made.calls)) and len(made.calls) == 2
    assert not checkers.check_all(again_, {"m": (0, (0, 0))})
