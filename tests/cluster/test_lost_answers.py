"""The answer of each durable statement is lost once, after it was done (T8)."""
import pytest

from faults import SEED
from load import Client, Load

WRITES = ("INSERT", "UPDATE", "DELETE", "COMMIT", "MERGE", "SELECT")


def use_everything(load, client):
    """One of each thing that changes the store."""
    mesh = client.upload()
    client.move(load.registers[0], is_guarded=False)
    client.move(load.registers[0], is_guarded=True)
    client.submit({"type": "hausdorff", "a": load.pair[0], "b": load.pair[1], "tolerance": 1e-6})
    client.edit(load.layouts[0])
    made = client.reconstruct(client.draw(load.saddle))
    load.reconstructions.append(made)
    client.refine(made)
    client.remove(mesh)


def is_write(answer):
    """A statement may be a SELECT over WITH parts that write."""
    return any(tag.startswith(WRITES) for tag in answer.tags) and any(
        word in text.upper() for text in answer.statements for word in ("INSERT ", "UPDATE ", "DELETE ", "COMMIT"))


@pytest.mark.timeout(600)
def test_each_answer_is_lost_once(make_cluster):
    cluster = make_cluster(1)
    (node,) = cluster.nodes
    (link,) = node.links
    load = Load(cluster, SEED)
    client = Client(load, "one", SEED)
    link.note_answers()
    use_everything(load, client)
    kinds = list(dict.fromkeys(tuple(answer.statements) for answer in link.answers if is_write(answer)))
    assert len(kinds) > 8, kinds
    for kind in kinds:
        for is_silent in (False, True):
            loss = link.lose_answer(lambda answer, kind=kind: tuple(answer.statements) == kind, is_silent=is_silent)
            use_everything(load, client)
            cluster.wait_until_ready()
            print("lost" if loss.done.is_set() else "not met again", "silently" if is_silent else "with the connection",
                  " ".join(kind)[:100].replace("\n", " "))
            link.release()
    load.ended = load.is_over = True
    load.check()
