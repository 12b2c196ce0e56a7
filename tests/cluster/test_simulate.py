"""The models lose nothing and do nothing twice, agree with the design's figures, and show the faults that are planted.

QM_TEST_LONG=1 runs ten thousand nodes. QM_TEST_SEED moves all chances; a failure shows the seed.
"""
import os

import pytest

import simulate
import simulate_split

SEED = int(os.environ.get("QM_TEST_SEED", "1"))
LONG = os.environ.get("QM_TEST_LONG", "0") != "0"


def run(nodes=200, seconds=150.0, job=5.0, plan=simulate.Plan(), **options):
    return simulate.Cluster(nodes, seconds, job, {}, SEED, plan, **options).simulate()


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("nodes", [20, 200, 10_000] if LONG else [20, 200])
def test_nothing_is_lost_and_nothing_done_twice(nodes):
    report = run(nodes)
    assert report["lost"] == report["doubled"] == 0, f"seed {SEED}: {report}"
    assert report["acknowledged"] == report["jobs"] > 100
    # All that goes wrong went wrong, and nobody was declared dead for the outage.
    assert report["restarted"] > 0 and report["late_ends_refused"] > 0, f"seed {SEED}: {report}"
    assert report["given_up"] >= 3 and 0 < report["declared_dead"] <= max(6, 0.04 * nodes), f"seed {SEED}: {report}"


@pytest.mark.parametrize("fault, shows", [
    ("finish", lambda report: report["doubled"] > 0), ("reap", lambda report: report["lost"] > 0),
    ("forget", lambda report: report["lost"] > 0), ("judge", lambda report: report["declared_dead"] > 100)])
def test_a_planted_fault_shows(fault, shows):
    assert shows(run(fault=fault)), f"seed {SEED}"


def test_jobs_at_their_last_attempt_run_apart():
    """A poisonous job takes others with it that waited with it for their next attempt, unless the last ones run apart."""
    never = 9.0
    alone = simulate.Plan(deaths=never, sleepers=(never, never), outage=never, upgrade=(never, never), rejoin=never, poison=1)
    wrong = {apart: sum(simulate.Cluster(50, 40.0, 5.0, {}, seed, alone, apart=apart).simulate()["given_up_wrongly"]
                        for seed in range(SEED, SEED + 20)) for apart in (False, True)}
    assert wrong[False] > 0 and wrong[True] == 0, f"seed {SEED}: {wrong}"


def test_it_agrees_with_the_first_model():
    """The figures of the design for two homes: 100 nodes with jobs of half a second."""
    report = run(100, 60.0, 0.5, plan=None)
    assert report["warm"] == pytest.approx(0.875, abs=0.03) and report["elsewhere"] == pytest.approx(0.13, abs=0.03)
    assert 300 < report["wait_p99_ms"] < 900 and 3000 < report["commits_per_second"] < 4000


@pytest.mark.parametrize("work, nodes, times", [(5e3, 8, 7.4), (5e4, 32, 30.5), (5e4, 128, 105.5), (5e5, 128, 124.0)])
def test_a_split_search_agrees_with_the_design(work, nodes, times):
    one, many = simulate_split.Search(work, 1), simulate_split.Search(work, nodes)
    assert one.run() / many.run() == pytest.approx(times, rel=0.1)
    assert one.is_settled_once() and many.is_settled_once()


def test_a_split_search_agrees_with_real_runs():
    """Runs of bench_split.py with 1500 folds, and one that no search can be as fast as."""
    measured = [{"whole": 10.3, "figure": 59.5, "spent": [9.28], "verbs": True},
                {"whole": 10.3, "figure": 22.1, "spent": [4.85, 4.23], "verbs": True},
                {"whole": 10.3, "figure": 13.5, "spent": [5.15, 1.93, 2.44], "verbs": True}]
    assert simulate_split.calibrate(measured) < 4 / 3
    assert simulate_split.calibrate([{"whole": 100.0, "figure": 10.0, "spent": [10.0, 10.0], "verbs": True}]) > 2


def test_parts_of_dead_nodes_are_settled_once():
    search = simulate_split.Search(5e5, 128, deaths=1e-3, seed=SEED)
    assert search.run() < 400
    assert search.is_settled_once() and search.voided > 10
    planted = simulate_split.Search(5e5, 128, deaths=1e-3, fault=True, seed=SEED)
    planted.run()
    assert not planted.is_settled_once()
