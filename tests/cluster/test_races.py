"""Many fronts at one thing (T9, T10, T11)."""
import itertools
import time

import pytest

import shapes
from api_conftest import together
from faults import SEED, choose
from load import Client, Load

ROUNDS = choose(40, 1000)


@pytest.fixture
def fronts(cluster):
    """Clients of all nodes, two of each."""
    load = Load(cluster, SEED)
    yield load, [(Client(load, f"front{k}", f"{SEED} {k}"), node) for k, node in enumerate(cluster.nodes * 2)]


@pytest.mark.timeout(900)
def test_one_key_at_all_fronts_makes_one_job(fronts):
    """T9; one of the fronts asks something else with the key."""
    load, clients = fronts
    a, b = load.pair
    for turn in range(ROUNDS):
        bodies = [{"type": "hausdorff", "a": a, "b": b, "threshold": 1.0 + turn}] * len(clients)
        bodies[turn % len(clients)] = {"type": "hausdorff", "a": b, "b": a, "threshold": 1.0 + turn}
        together(len(clients), lambda k, bodies=bodies, turn=turn:
                 clients[k][0].submit(bodies[k], f"key of turn {turn}", clients[k][1]))
    load.ended = load.is_over = True
    load.check()
    answers = [call.answer for call in load.history.calls if call.name == "submit"]
    assert sum("id" in answer for answer in answers) >= ROUNDS and sum("is_mismatch" in answer for answer in answers) >= ROUNDS


def test_many_move_one_mesh(cluster):
    """T10, while jobs run on it."""
    with Load(cluster, SEED, movers=8, askers=1, others=False) as load:
        del load.registers[1:]
        time.sleep(choose(4, 15))
        cluster.wait_for("moves of both kinds", lambda: min(count_moves(load, kind) for kind in ("write", "swap")) > 5)
    load.check()


def count_moves(load, kind):
    """The moves that made a revision."""
    return sum(call.name == kind and call.is_known and "revision" in call.answer for call in list(load.history.calls))


@pytest.mark.timeout(900)
def test_one_file_at_all_fronts_and_its_removal(fronts):
    """T11."""
    load, clients = fronts
    for turn in range(ROUNDS):
        content = shapes.obj(shapes.cube(side=1e6 + turn % 10))
        known = set()

        def work(k, content=content, known=known):
            client, node = clients[k]
            if k < 4:
                known.add(client.upload(content))
            else:
                for mesh in itertools.islice(list(known), 1):
                    client.remove(mesh)
        together(len(clients), work)
        if turn % 10 == 9:
            for client, node in clients[:3]:
                check_contents(client, node)
    load.ended = load.is_over = True
    load.check()


def check_contents(client, node):
    """What is listed can be read, or was removed since."""
    for mesh in client.list("mesh", node):
        reply = client.ask(node, "GET", f"/v1/meshes/{mesh}/content", params={"format": "obj"})
        assert reply.status_code in (200, 404), reply.text
