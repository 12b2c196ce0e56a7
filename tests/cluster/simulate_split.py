#!/usr/bin/env python3
"""One huge search on many nodes, as a model: parts of it are claimed largest first, run for 2 s, and what is left comes back.

How much work a part holds is heavy-tailed, since few places of a surface matter. A node runs its parts with all its threads. A
better lower bound reaches the others with their next claim; until then they look at what it would have let go.

usage: simulate_split.py [--work CORE_SECONDS] [--nodes N] [--threads N] [--load SECONDS] [--deaths PER_NODE_SECOND] [--fault]
       simulate_split.py --calibrate FILE
Without arguments a table of seconds and speed-ups. --fault: parts are finished without a look at their lease. --calibrate holds the model
against real runs, which bench_split.py has written (`make bench BENCH="--only store"`, build/bench/split.json). There nodes share the
machine with each other and with other work: the busiest one's share of a processor is the pace of each in the model.
Exit status: 0 when each part of the work was settled once, and no calibrated run is more than a third off.
"""
import argparse
import heapq
import json
import math
import random
import sys

# Of the code: QM_SPLIT_WHOLE_MS, QM_SPLIT_ROUND_MS, LOOK_MS (job_help.c), FEWEST_PARTS, QM_STORE_REST_PARTS, PART_SHARE,
# QM_STORE_PART_CLAIMS and ROUND_SHARE (split_search.c, store_parts.h).
ALONE, ROUND, LOOK = 3.0, 2.0, 0.5
EXPORTED, PIECES, PART_SHARE, MOST_CLAIMS, ROUND_SHARE = 256, 8, 4, 64, 0.5
LEASE, AWAY = 12.0, 60.0  # silence until a dead node's part is open again (design), and until the node is back (an assumption)

# Measured on two cores with other load, as processor seconds, which that changes least.
SIGMA = 1.1     # of the logarithm of the work of an exported part: 256 parts of two pairs, each run alone: 0.95 and 1.13
# Share of work that several nodes add: bench_split.py's pair takes 1,132,248 iterations whole and on 1, 2 and 3 nodes, since its lower bound
# is there in the first 3 s. For pairs that find it later this is an assumption.
EXTRA = 0.01
VERB = 0.024    # seconds of a round in claim_parts, read_bounds and finish_parts (8, 2 and 14 ms on two nodes): store_seconds of bench_split.py
EFFICIENCY = 0.75  # of a node's threads: two threads are 1.5 times one on pairs above 100,000 triangles (RESULTS.md, threads)

# Of the machines of a cluster, which are not here: assumptions.
THREADS = 16
LOAD = 3.0         # mean seconds in which a node fetches and prepares both meshes: a pair of ten million triangles (RESULTS.md, large)
CLAIMS = 3000.0    # rounds a second that the database takes


class Search:
    """One run. The work is settled when every part of it has been credited."""

    def __init__(self, work, nodes, threads=THREADS, load=LOAD, deaths=0.0, fault=False, pace=1.0, seed=2):
        self.random = random.Random(seed)
        self.deaths, self.fault, self.load = deaths, fault, load
        self.speed = pace * threads * (EFFICIENCY if threads > 1 else 1.0)  # core seconds a second
        self.work, self.nodes = work, nodes
        self.rest = max(0.0, work - ALONE * self.speed) * (1.0 + EXTRA * (nodes > 1))
        self.epochs, self.credited, self.voided = {}, 0.0, 0

    def run(self):
        """The seconds to the end."""
        if self.rest == 0.0:
            return self.work / self.speed
        sizes = [self.random.lognormvariate(0, SIGMA) for _ in range(EXPORTED)]
        self.names = iter(range(10**9))
        self.open, self.coming = [], []
        for size in sizes:
            heapq.heappush(self.open, (-size * self.rest / sum(sizes), next(self.names)))
        # The owner goes on; the others look twice a second, and load the meshes.
        free = [(ALONE + (LOOK * self.random.random() + self.load * self.random.uniform(0.7, 1.3) if node else 0.0), node)
                for node in range(self.nodes)]
        heapq.heapify(free)
        self.claims = [1] * self.nodes
        self.given, self.end = ALONE, ALONE
        while self.open or self.coming:
            now, node = heapq.heappop(free)
            if not self.open:
                now = max(now, self.coming[0][0])
            while self.coming and self.coming[0][0] <= now:
                heapq.heappush(self.open, heapq.heappop(self.coming)[1:])
            heapq.heappush(free, (self.run_round(node, now), node))
        return self.end

    def run_round(self, node, now):
        """One round of a node; the moment at which it is free again."""
        limit = min(self.claims[node], len(self.open) // PART_SHARE + 1, MOST_CLAIMS)
        parts = []
        for _ in range(limit):
            size, name = heapq.heappop(self.open)
            epoch = self.epochs[name] = self.epochs.get(name, 0) + 1
            parts.append((-size, name, epoch))
        self.given = max(self.given + 1 / CLAIMS, now)
        size = sum(part[0] for part in parts)
        start, spent = self.given + VERB / 2, min(size / self.speed, ROUND)
        if self.random.random() < self.deaths * spent:
            # They are open again when the lease has ended. Half of the dead only slept, and end their parts when it is over.
            is_asleep = self.random.random() < 0.5
            for part, name, epoch in parts:
                heapq.heappush(self.coming, (start + LEASE, -part, name))
                if is_asleep:
                    self.finish(name, epoch, part, is_late=True)
            return start + AWAY
        left = max(size - spent * self.speed, 0.0)
        done = start + spent + VERB / 2
        for part, name, epoch in parts:
            self.finish(name, epoch, part * (1 - left / size))
        if left > 1e-9:
            self.claims[node] = max(1, limit // 2)
            shares = [self.random.lognormvariate(0, SIGMA) for _ in range(PIECES)]
            for piece in shares:
                heapq.heappush(self.coming, (done, -left * piece / sum(shares), next(self.names)))
        elif limit == self.claims[node] and spent < ROUND_SHARE * ROUND:
            self.claims[node] = min(2 * limit, MOST_CLAIMS)
        self.end = max(self.end, done)
        return done

    def finish(self, name, epoch, size, is_late=False):
        """Credits what a node has settled, if it still has the part: one that wakes up late comes after the next claim."""
        if not self.fault and (is_late or self.epochs[name] != epoch):
            self.voided += 1
            return
        self.credited += size

    def is_settled_once(self):
        return math.isclose(self.credited, self.rest, rel_tol=1e-9, abs_tol=1e-9)


def calibrate(rows):
    """Prints real runs beside the model's; the largest factor between their seconds."""
    worst = 1.0
    print("nodes  work  pace  real s  model s")
    for row in rows:
        if not row["verbs"]:
            continue
        real, nodes = row["figure"], len(row["spent"])
        pace = max(row["spent"]) / real
        model = Search(row["whole"], nodes, threads=1, load=0.0, pace=pace).run()
        worst = max(worst, real / model, model / real)
        print(f"{nodes:5d} {row['whole']:5.1f} {pace:5.2f} {real:7.1f} {model:8.1f}")
    return worst


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=float)
    parser.add_argument("--nodes", type=int, default=128)
    parser.add_argument("--threads", type=int, default=THREADS)
    parser.add_argument("--load", type=float, default=LOAD)
    parser.add_argument("--deaths", type=float, default=0.0)
    parser.add_argument("--fault", action="store_true")
    parser.add_argument("--calibrate", metavar="FILE")
    asked = parser.parse_args()
    if asked.calibrate:
        with open(asked.calibrate, encoding="utf-8") as file:
            return 0 if calibrate(json.load(file)) <= 4 / 3 else 1
    widths = (1, 2, 8, 32, 100, 1000, 10000)
    works = (50, 500, 5e3, 5e4, 5e5, 5e6) if asked.work is None else (asked.work,)
    if asked.work is None:
        print("core seconds" + "".join(f"{nodes:>20d}" for nodes in widths))
    is_right = True
    for work in works:
        row = []
        for nodes in widths if asked.work is None else (1, asked.nodes):
            search = Search(work, nodes, asked.threads, asked.load, asked.deaths, asked.fault)
            row.append(search.run())
            is_right = is_right and search.is_settled_once()
        print(f"{work:12.0f}" + "".join(f"{seconds:10.1f} s {row[0] / seconds:6.1f}x" for seconds in row))
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main())
