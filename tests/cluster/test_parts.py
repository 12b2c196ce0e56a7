"""One long search on three nodes: nodes die, finishes come late, parts are run twice (T17)."""
import time

import pytest

import at_rest
import shapes
from api_conftest import SLOW, SLOW_DISTANCE, check_bounds, split_runs
from faults import SILENCE, another, choose, lease_of, runner

# Long enough to be helped and interrupted, and no longer than a test may take.
FOLDS = choose(900, 1500)


@pytest.fixture(scope="module")
def folds():
    """A pair as slow_files, whose search takes some ten seconds of a node."""
    heap = shapes.crumpled(FOLDS, seed=3)
    raised = shapes.moved(shapes.cut(heap, 3), 0, 0, SLOW_DISTANCE)
    return shapes.ply_little(shapes.cut(heap, 2)), shapes.ply_little(raised)


def start(cluster, files):
    with cluster.nodes[0].client() as client:
        pair = [client.upload(content)["id"] for content in files]
        return client.start(*pair, headers={"Cache-Control": "no-cache"}, **SLOW)["id"]


def await_help(cluster, job):
    """A node that runs parts of the search of another one."""
    owner = runner(cluster, job)
    name = cluster.wait_for("a helper", lambda: next(
        (name for name in at_rest.part_nodes(cluster.query, job) if name != owner.name), None))
    return next(node for node in cluster.nodes if node.name == name)


def check_end(cluster, job):
    """The search has converged to the distance, its bounds were monotone, and no row of it is left."""
    with cluster.serving()[0].client() as client:
        document = client.wait(job)
        assert document["state"] == "succeeded", document
        result, events = document["result"], client.events(job)
    assert result["converged"] and result["lower"] <= SLOW_DISTANCE <= result["upper"], result
    assert result["upper"] - result["lower"] <= result["gap"]
    check_bounds(events, result)
    for event in events:
        if event["event"] == "bounds" and event["upper"] is not None:
            assert event["lower"] <= SLOW_DISTANCE <= event["upper"], event
    assert not at_rest.parts(cluster.query, job)
    return events


def test_nodes_help_and_each_is_killed(cluster, folds):
    """A helper, then the owner, then whoever owns the job by then: what was proved before stays proved."""
    job = start(cluster, folds)
    helper = await_help(cluster, job)
    helper.kill()
    helper.start()
    first = runner(cluster, job)
    await_help(cluster, job)
    lower, upper = at_rest.bounds(cluster.query, job)
    first.kill()
    with another(cluster, first).client() as client:
        cluster.wait_for("another owner", lambda: (at_rest.lease(cluster.query, job) or [first.name])[0] != first.name
                         or client.get(f"/v1/jobs/{job}").json()["state"] not in ("queued", "running"))
        first.start()
        client.wait(job)
    runs = split_runs(check_end(cluster, job))
    if len(runs) > 1:  # it may have ended while it waited for an owner
        bounds = [event for event in runs[1] if event["event"] in ("bounds", "result")]
        after = bounds[0].get("result", bounds[0])
        assert lower <= after["lower"] + 1e-12 and after["upper"] <= upper + 1e-12, (lower, upper, after)


@pytest.mark.parametrize("seconds", [5, SILENCE + 5])
def test_bounds_are_held_back(cluster, folds, seconds):
    """A helper stands still with its parts: for longer than the silence that is death, others run them as well, and its
    own finish is void."""
    job = start(cluster, folds)
    helper = await_help(cluster, job)
    helper.pause()
    time.sleep(seconds)
    helper.resume()
    with another(cluster, helper).client() as client:
        client.wait(job)
    cluster.wait_until_ready()
    check_end(cluster, job)


def test_an_owner_stands_still_until_it_counts_as_dead(cluster, folds):
    """Another node owns the search. The first one has no run of it left, and all its workers again."""
    job = start(cluster, folds)
    await_help(cluster, job)
    owner, lease = runner(cluster, job), lease_of(cluster, job)
    owner.pause()
    with another(cluster, owner).client() as client:
        cluster.wait_for("another owner", lambda: at_rest.lease(cluster.query, job) != lease)
        owner.resume()
        client.wait(job)
    cluster.wait_until_ready()
    check_end(cluster, job)
    for node in cluster.nodes:
        cluster.wait_for("free workers", lambda node=node: node.info()["running"] == 0)


def test_a_search_is_canceled(cluster, slow_files):
    """At a node that neither owns nor helps: the job ends with the bounds that it had."""
    job = start(cluster, slow_files)
    helper = await_help(cluster, job)
    with another(cluster, helper, runner(cluster, job)).client() as client:
        assert client.delete(f"/v1/jobs/{job}").status_code == 202
        document = client.wait(job)
        assert document["state"] == "canceled"
        assert document["result"]["lower"] <= SLOW_DISTANCE <= document["result"]["upper"]
    assert not at_rest.parts(cluster.query, job)
