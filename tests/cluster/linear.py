"""Whether a history of one object is linearizable: whether each call may have taken effect at one instant between its start
and its end, so that all answers are those of the object in that order.

The search of Wing and Gong ("Testing and verifying concurrent objects", 1993, section 4) with the memory of Lowe ("Testing
for linearizability", 2017, section 3): a set of calls that were put in order, together with the state that they led to, is
looked at once.
"""
import dataclasses

IMPOSSIBLE = object()   # what a step gives when the object could not have answered so


@dataclasses.dataclass
class Refusal:
    """There is no order. The longest one that was found leads to `state`, and none of the `blocked` calls may be next."""
    order: list
    state: object
    blocked: list


class Undecided(Exception):
    """The search has become too long."""


def linearize(calls, initial, step, limit=10_000_000):
    """None when there is an order, else a Refusal.

    step(state, call) gives the state after a call, or IMPOSSIBLE when it contradicts the answer; states are hashable. A call
    without an answer may be left out. Raises Undecided after `limit` steps.
    """
    known = sorted((call for call in calls if call.is_known), key=lambda call: call.start)
    unknown = sorted((call for call in calls if not call.is_known), key=lambda call: call.start)
    done = [False] * len(known)
    taken = [False] * len(unknown)
    seen, order, steps = set(), [], 0
    best, best_count = Refusal([], initial, known), 0

    def candidates(first):
        """Known and unknown calls that may be next: those that began before any call that is not in order has ended."""
        window, earliest = [], float("inf")
        for i in range(first, len(known)):
            if done[i]:
                continue
            if known[i].start > earliest:
                break
            window.append(i)
            earliest = min(earliest, known[i].end)
        return ([i for i in window if known[i].start <= earliest],
                [i for i in range(len(unknown)) if not taken[i] and unknown[i].start <= earliest])

    # Each level of the stack: state, first known call that is not in order, choices that are left, the choice above it.
    mask = 0
    stack = []

    def enter(state, first):
        ready, open_ = candidates(first)
        stack.append((state, first, iter([(True, i) for i in ready] + [(False, i) for i in open_])))
        return ready

    ready = enter(initial, 0)
    best.blocked = [known[i] for i in ready]
    count = 0   # known calls in order
    while count < len(known):
        state, first, choices = stack[-1]
        for is_known, i in choices:
            steps += 1
            if steps > limit:
                raise Undecided(f"{len(known)} calls and {len(unknown)} without an answer: no verdict after {limit} steps")
            call = known[i] if is_known else unknown[i]
            after = step(state, call)
            if after is IMPOSSIBLE or (not is_known and after == state):
                continue
            bit = 1 << (i if is_known else len(known) + i)
            if (mask | bit, after) in seen:
                continue
            seen.add((mask | bit, after))
            mask |= bit
            (done if is_known else taken)[i] = True
            count += is_known
            order.append((is_known, i))
            while first < len(known) and done[first]:
                first += 1
            ready = enter(after, first)
            if count > best_count:
                best_count = count
                best = Refusal([(known if had_answer else unknown)[k] for had_answer, k in order], after,
                               [known[k] for k in ready])
            break
        else:
            stack.pop()
            if not stack:
                return best
            is_known, i = order.pop()
            (done if is_known else taken)[i] = False
            count -= is_known
            mask &= ~(1 << (i if is_known else len(known) + i))
    return None
