"""What must hold of a history, by the letters of the design: C1 to C7. Each check gives a list of violations, empty when all
holds; each violation names the calls that contradict each other.

Calls by name, with their arguments and what their answers hold:

    create  kind, hash              id                    of a mesh (the hash of its bytes), layout or reconstruction
    remove  kind (key: the id)      -
    list    kind                    items: {id: hash}     all pages
    fetch   kind (key: the id)      hash, or is_gone
    submit  body (key: Idempotency-Key or a name of its own)    id, or is_mismatch (422)
    read    (key: the mesh)         revision, values      of all slots; or is_gone
    write   slot, value             revision              without a condition; or is_gone
    swap    slot, value, expected   revision, or is_conflict, or is_gone
    edit    (key: the layout)       revision
    step    steps (key: the reconstruction)  taken        by the job's result, 0 when it was refused
    count   (key: the reconstruction)        steps        once no step is under way
    stream  (key: the job)          lines                 what one reader got
    log     (key: the job)          lines                 all events, once the job has ended
    document  (key: the job)        state, document; epoch and node where the daemon tells them

A slot is a vertex whose height holds the value.
"""
import collections
import dataclasses
import itertools
import json

import linear

RUN = 10**9               # seqs of a run


@dataclasses.dataclass
class Violation:
    rule: str
    text: str
    calls: list

    def __str__(self):
        return "\n    ".join([f"{self.rule}: {self.text}", *map(str, self.calls)])


def by_key(calls, *names):
    groups = collections.defaultdict(list)
    for call in calls:
        if call.name in names:
            groups[call.key].append(call)
    return groups


# ---- C1: a mesh is a register with compare-and-set ----

def register_step(state, call):
    """The state (revision, value of each slot), or None of a removed mesh, after a call on it."""
    answer = call.answer
    if call.name == "remove":
        return None
    if state is None:
        return None if answer is None or answer.get("is_gone") else linear.IMPOSSIBLE
    if answer is not None and answer.get("is_gone"):
        return linear.IMPOSSIBLE
    revision, values = state
    if call.name == "read":
        agrees = answer is None or (answer["revision"], tuple(answer["values"])) == state
        return state if agrees else linear.IMPOSSIBLE
    if call.name == "swap":
        if answer is None and call.arguments["expected"] != revision:
            return state
        if answer is not None and answer.get("is_conflict", False) != (call.arguments["expected"] != revision):
            return linear.IMPOSSIBLE
        if answer is not None and answer.get("is_conflict"):
            return state
    slot = call.arguments["slot"]
    after = (revision + 1, values[:slot] + (call.arguments["value"],) + values[slot + 1:])
    return after if answer is None or answer["revision"] == after[0] else linear.IMPOSSIBLE


def foreseeing_step(calls):
    """register_step, which also refuses what a later answer is known to contradict, so that a search fails at once instead of
    at that answer. A revision is reached once: by the call whose answer names it, and with the values that were read of it."""
    named = {call.answer["revision"] for call in calls if call.is_known and call.name != "read" and "revision" in call.answer}
    observed = {call.answer["revision"]: tuple(call.answer["values"])
                for call in calls if call.name == "read" and call.is_known and "revision" in call.answer}

    def step(state, call):
        after = register_step(state, call)
        if after is linear.IMPOSSIBLE or after is None or after == state:
            return after
        revision, values = after
        if (not call.is_known and revision in named) or observed.get(revision, values) != values:
            return linear.IMPOSSIBLE
        return after

    return step


def check_register(calls, initial):
    """C1. initial: by mesh, its first state."""
    found = []
    for mesh, group in by_key(calls, "read", "write", "swap", "remove").items():
        if mesh not in initial:
            continue
        refusal = linear.linearize(group, initial[mesh], foreseeing_step(group))
        if refusal:
            near = [refusal.state[0], refusal.state[0] + 1] if refusal.state else []
            reads = [call for call in group if call.name == "read" and call.is_known and call.answer.get("revision") in near]
            changes = [call for call in refusal.order if call.name != "read"][-3:]
            found.append(Violation("C1", f"mesh {mesh} was {refusal.state}, and none of the next calls fits",
                                   changes + [call for call in reads if call not in refusal.blocked] + refusal.blocked))
    return found


# ---- C2: what was acknowledged is there ----

def check_sets(calls, before=()):
    """C2: every acknowledged thing is in every later list and under its id, at every node, with its hash; a removed one is
    not, and nothing is that nobody made. before: ids that were there before the history."""
    found = []
    made, removals = {}, by_key(calls, "remove")
    maybe = collections.defaultdict(list)  # (kind, hash): creations without an answer
    for call in calls:
        if call.name == "create":
            kind, content = call.arguments["kind"], call.arguments["hash"]
            if not call.is_known:
                maybe[kind, content].append(call)
                continue
            first = made.setdefault((kind, call.answer["id"]), call)
            if first.arguments["hash"] != content:
                found.append(Violation("C2", "two contents got one id", [first, call]))
            elif call.end < first.end:
                made[kind, call.answer["id"]] = call
    kinds = collections.defaultdict(dict)
    for (kind, thing), call in made.items():
        kinds[kind][thing] = call
    for look in calls:
        if look.name not in ("list", "fetch") or not look.is_known:
            continue
        kind = look.arguments["kind"]
        if look.name == "fetch":
            items = {} if look.answer.get("is_gone") else {look.key: look.answer["hash"]}
            asked = [look.key] if look.key in kinds[kind] else []
        else:
            items, asked = look.answer["items"], kinds[kind]
        for thing in asked:
            creation, gone = kinds[kind][thing], removals[thing]
            if thing not in items and creation.end < look.start and not any(call.start < look.end for call in gone):
                found.append(Violation("C2", f"the acknowledged {kind} {thing} is lost", [creation, look]))
        for thing, content in items.items():
            after = [call for call in removals[thing] if call.is_known and call.end < look.start]
            if after:
                found.append(Violation("C2", f"the removed {kind} {thing} is back", [after[0], look]))
            creation = kinds[kind].get(thing)
            if creation and creation.arguments["hash"] != content:
                found.append(Violation("C2", f"{kind} {thing} has other bytes", [creation, look]))
            if not creation and thing not in before and not any(call.start < look.end for call in maybe[kind, content]):
                found.append(Violation("C2", f"nobody made {kind} {thing}", [look]))
    return found


# ---- C3: one job for one Idempotency-Key ----

def check_keys(calls):
    """C3."""
    found = []
    for key, group in by_key(calls, "submit").items():
        answered = [call for call in group if call.is_known and "id" in call.answer]
        refused = [call for call in group if call.is_known and call.answer.get("is_mismatch")]
        for call in answered[1:]:
            if call.answer["id"] != answered[0].answer["id"]:
                found.append(Violation("C3", f"key {key} has two jobs", [answered[0], call]))
            elif call.arguments["body"] != answered[0].arguments["body"]:
                found.append(Violation("C3", f"key {key} was taken for another body", [answered[0], call]))
        for call in refused:
            others = [other for other in group if other.arguments["body"] != call.arguments["body"] and
                      other.start < call.end and not (other.is_known and other.answer.get("is_mismatch"))]
            if not others:
                found.append(Violation("C3", f"key {key} was refused, and no other body had it", [call]))
    return found


# ---- C4: the events of a job ----

def check_events(calls, distances=None):
    """C4. distances: by job, the distance that its bounds must hold, where it is known."""
    found = []
    logs = {key: group[0] for key, group in by_key(calls, "log").items() if group[0].is_known}
    for job, log in logs.items():
        found += check_log(job, log, (distances or {}).get(job))
    for job, readers in by_key(calls, "stream").items():
        readers = [reader for reader in readers if reader.is_known]
        if job in logs:
            for reader in readers:
                found += check_reader(job, reader, logs[job])
        first = {}
        for reader in readers:
            for line in reader.answer["lines"]:
                before, other = first.setdefault(line["seq"], (line, reader))
                if before != line:
                    found.append(Violation("C4", f"job {job} told two things as seq {line['seq']}", [other, reader]))
    return found


def check_log(job, log, distance):
    lines = log.answer["lines"]
    seqs = [line["seq"] for line in lines]
    found = []

    def fault(text):
        found.append(Violation("C4", f"job {job}: {text}", [log]))

    if any(later <= sooner for sooner, later in zip(seqs, seqs[1:])):
        fault("seqs do not rise")
    if any(later != sooner + 1 and later % RUN != 1 for sooner, later in zip(seqs, seqs[1:])) or seqs[:1] not in ([], [1]) \
            and seqs[0] % RUN != 1:
        fault("a seq is missing within a run")
    ends = [line for line in lines if line["event"] in ("result", "error")]
    if len(ends) != 1 or lines[-1] != ends[0]:
        fault(f"{len(ends)} terminal events, and the last line is {lines[-1]['event'] if lines else 'none'}")
    for run, group in itertools.groupby(lines, lambda line: line["seq"] // RUN):
        group = list(group)
        if run and group[0]["event"] != "server_restart":
            fault(f"run {run + 1} does not begin with server_restart")
        lower, upper = 0.0, float("inf")
        for line in group:
            bounds = line.get("result") or line
            if "lower" not in bounds:
                continue
            above = float("inf") if bounds["upper"] is None else bounds["upper"]
            if not lower <= bounds["lower"] <= above <= upper:
                fault(f"the bounds of seq {line['seq']} are wider than those before, or crossed")
            lower, upper = bounds["lower"], above
            if distance is not None and not lower <= distance <= upper:
                fault(f"the bounds {lower} to {upper} of seq {line['seq']} do not hold {distance}")
    return found


def check_reader(job, reader, log):
    """A reader has got each line of the log between its first and its last, and besides them only such as a sudden end has
    cut off: behind all that the log has of a run that was not the last."""
    lines, found = reader.answer["lines"], []
    seqs = [line["seq"] for line in lines]
    if any(later <= sooner for sooner, later in zip(seqs, seqs[1:])):
        found.append(Violation("C4", f"a reader of job {job} got seqs that do not rise", [reader, log]))
    kept = {line["seq"]: line for line in log.answer["lines"]}
    greatest = collections.defaultdict(int)
    for seq in kept:
        greatest[seq // RUN] = max(greatest[seq // RUN], seq)
    last = max(greatest, default=0)
    for line in lines:
        seq = line["seq"]
        if line["event"] == "server_shutdown" and seq not in kept:
            continue  # of the connection, not of the job
        if seq in kept and kept[seq] != line:
            found.append(Violation("C4", f"a reader of job {job} got another seq {seq} than the log has", [reader, log]))
        if seq not in kept and (seq // RUN >= last or seq < greatest[seq // RUN]):
            found.append(Violation("C4", f"a reader of job {job} got seq {seq}, which the log has not", [reader, log]))
    if seqs:
        missed = sorted(seq for seq in kept if seqs[0] < seq < seqs[-1] and seq not in seqs)
        if missed:
            found.append(Violation("C4", f"a reader of job {job} did not get seq {missed[0]}", [reader, log]))
    return found


# ---- C5: effects happen once ----

def check_effects(calls):
    """C5: answered revisions have no twin, and no more gaps than there were calls without an answer; the steps of a
    reconstruction are those that were answered, and perhaps some of those that were not."""
    found = []
    for thing, group in by_key(calls, "write", "swap", "edit").items():
        answered = collections.defaultdict(list)
        for call in group:
            if call.is_known and "revision" in call.answer:
                answered[call.answer["revision"]].append(call)
        for revision, twins in answered.items():
            if len(twins) > 1:
                found.append(Violation("C5", f"revision {revision} of {thing} was answered twice", twins))
        unknown = [call for call in group if not call.is_known]
        gaps = set(range(1, max(answered, default=0) + 1)) - set(answered)
        if len(gaps) > len(unknown):
            found.append(Violation("C5", f"nobody made the revisions {sorted(gaps)} of {thing}",
                                   [call for twins in answered.values() for call in twins] + unknown))
    steps = by_key(calls, "step")
    for thing, counts in by_key(calls, "count").items():
        sums = {sum(call.answer["taken"] for call in steps[thing] if call.is_known)}
        for call in steps[thing]:
            if not call.is_known:
                sums |= {total + call.arguments["steps"] for total in sums}
        for count in counts:
            if count.is_known and count.answer["steps"] not in sums:
                found.append(Violation("C5", f"{thing} has {count.answer['steps']} steps, and may have {sorted(sums)}",
                                       steps[thing] + [count]))
    return found


# ---- C6: no answer of a lease that was taken away ----

def check_leases(calls):
    """C6: a job's end is that of its newest run, is the same for everybody, and each run has one node.

    The run is told by the seqs of the events; where a document tells its epoch (the number of the run) and node, these too.
    """
    found = []
    for job, group in by_key(calls, "log", "stream", "document").items():
        nodes, newest, ends = {}, (0, None), []
        for call in group:
            if not call.is_known:
                continue
            for line in call.answer.get("lines", ()):
                epoch = line["seq"] // RUN + 1
                newest = max(newest, (epoch, call), key=lambda pair: pair[0])
                if line["event"] in ("result", "error"):
                    ends.append((epoch, line.get("result") or line.get("problem"), call))
            if call.name == "document":
                epoch = call.answer.get("epoch")
                if epoch is not None:
                    newest = max(newest, (epoch, call), key=lambda pair: pair[0])
                    node, other = nodes.setdefault(epoch, (call.answer["node"], call))
                    if node != call.answer["node"]:
                        found.append(Violation("C6", f"run {epoch} of job {job} has two nodes", [other, call]))
                if call.answer["state"] not in ("queued", "running"):
                    document = call.answer["document"]
                    ends.append((epoch, document.get("result") or document.get("problem"), call))
        for epoch, end, call in ends:
            if epoch is not None and epoch < newest[0]:
                found.append(Violation("C6", f"job {job} was ended by run {epoch}, and run {newest[0]} had begun",
                                       [call, newest[1]]))
            if json.dumps(end, sort_keys=True) != json.dumps(ends[0][1], sort_keys=True):
                found.append(Violation("C6", f"job {job} has two ends", [ends[0][2], call]))
    return found


# ---- C7: at rest ----

def check_rest(rows, is_cleaned=True):
    """C7: tables that agree, when nothing is under way. rows is what at_rest.py reads. is_cleaned: the cleaner has looked at the
    blobs since, and marked those that an upload left which was cut off."""
    found = []

    def fault(text, names):
        if names:
            found.append(Violation("C7", f"{text}: {sorted(names)[:10]}", []))

    blobs = set(rows["blobs"])
    named = {name for name in rows["named_blobs"] if name is not None}
    fault("rows name blobs that there are not", named - blobs)
    if is_cleaned:
        fault("blobs are left that no row names", blobs - named - set(rows["unneeded_blobs"]))
    fault("blobs have not all their bytes", {name for name, size in rows["blobs"].items()
                                             if size != rows["stored_bytes"].get(name, 0)} if "stored_bytes" in rows else ())
    queued, running, unfinished = collections.Counter(rows["queued"]), collections.Counter(rows["running"]), \
        set(rows["unfinished"])
    places = queued + running
    fault("jobs are in two places", {job for job, count in places.items() if count > 1})
    fault("jobs wait or run that have ended", set(places) - unfinished)
    fault("unfinished jobs are nowhere", unfinished - set(places))
    fault("jobs have ended without a terminal event, or with two",
          {job for job, count in rows["terminal_events"].items() if count != 1})
    return found


def check_all(history, initial=None, distances=None, before=()):
    """C1 to C6 of a history; C7 needs the tables."""
    calls = history.calls
    return (check_register(calls, initial or {}) + check_sets(calls, before) + check_keys(calls) + check_events(calls, distances) +
            check_effects(calls) + check_leases(calls))
