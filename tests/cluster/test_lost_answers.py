"""The answer of each durable statement is lost once, after it was done (T8)."""
import collections
import time

import pytest

from faults import SEED, choose
from load import Client, Load

WRITES = ("INSERT", "UPDATE", "DELETE", "COMMIT", "MERGE", "SELECT")


def is_write(answer):
    """A statement may be a SELECT over WITH parts that write."""
    return any(tag.startswith(WRITES) for tag in answer.tags) and any(
        word in text.upper() for text in answer.statements for word in ("INSERT ", "UPDATE ", "DELETE ", "COMMIT"))


@pytest.mark.timeout(900)
def test_each_answer_is_lost_once(make_cluster):
    """Every statement loses its answer with its connection; some, and in the long form all, silently, until the daemon has
    waited long enough."""
    cluster = make_cluster(1)
    (node,) = cluster.nodes
    (link,) = node.links
    load = Load(cluster, SEED)
    client = Client(load, "one", SEED)
    link.note_answers()
    client.use_everything()
    time.sleep(2.5)  # a beat, and a look for dead nodes
    counts = collections.Counter(tuple(answer.statements) for answer in link.answers if is_write(answer))
    # The end of a transaction does not say of which, so that each of them gets its turn.
    cases = [(kind, skip) for kind, count in counts.items() for skip in range(count if kind == ("COMMIT",) else 1)]
    assert len(cases) > 8, cases
    met = 0
    for place, (kind, skip) in enumerate(cases):
        for is_silent in (False, True) if choose(place % 5 == 0, True) else (False,):
            loss = link.lose_answer(lambda answer, kind=kind: tuple(answer.statements) == kind, skip, is_silent)
            client.use_everything()
            loss.done.wait(4)
            met += loss.done.is_set()
            print("lost" if loss.done.is_set() else "not met", "silently" if is_silent else "with the connection",
                  " ".join(kind)[:90])
            link.release()
            cluster.wait_until_ready()
    assert met > 8
    load.ended = load.is_over = True
    load.check()
