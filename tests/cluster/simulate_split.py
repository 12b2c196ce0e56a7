#!/usr/bin/env python3
"""One huge search on many nodes, as a model: parts of it are claimed largest first, run for 2 s, and what is left comes back.

How much work a part holds is heavy-tailed, since few places of a surface matter. A node runs a part with all its threads. A
better lower bound reaches the others late; until then they look at what it would have let go. The constants are guesses until
real runs have given better ones.

usage: simulate_split.py [--work CORE_SECONDS] [--nodes N] [--late SECONDS] [--deaths PER_NODE_SECOND] [--fault]
Without arguments a table of seconds and speed-ups. --fault: parts are finished without a look at their lease.
Exit status: 0 when each part of the work was settled once.
"""
import argparse
import heapq
import math
import random
import sys

THREADS, EFFICIENCY = 16, 0.9   # of a node
ALONE = 0.3            # seconds that the owner searches before it gives parts away
LOAD = 3.0             # mean seconds in which a node fetches and prepares both meshes
VERB = 0.006           # seconds of a claim or an end
PART = 2.0             # seconds that a node runs a part at most
PIECES, SHORTEST = 8, 0.25      # what is left comes back in that many parts at most, and of so many seconds at least
CLAIMS = 3000.0        # a second, of the database
LEASE, AWAY = 12.0, 60.0        # seconds until a dead node's part is open again, and until the node is back
LATE = 0.1             # seconds until others know a bound
SPEED = THREADS * EFFICIENCY    # core seconds a second


class Search:
    """One run. The work is settled when every part of it has been credited."""

    def __init__(self, work, nodes, late=LATE, deaths=0.0, fault=False, seed=2):
        self.random = random.Random(seed)
        self.deaths, self.fault = deaths, fault
        self.rest = max(0.0, work - ALONE * SPEED)
        # A node joins only while there is twice its loading time of work for each.
        self.nodes = max(1, min(nodes, int(self.rest / (SPEED * 2 * LOAD))))
        self.work = work
        if self.nodes > 1:
            # Bounds rise in the first seconds, and everybody works against an old one until it comes.
            self.rest += self.rest * min(0.5, 0.2 * late) + self.nodes * late * SPEED * 0.2
        self.seconds_a_part = max(PART, self.nodes / CLAIMS)
        self.epochs, self.credited, self.voided = {}, 0.0, 0

    def run(self):
        """The seconds to the end."""
        if self.rest == 0.0:
            return self.work / SPEED
        sizes = [self.random.lognormvariate(0, 2.0) for _ in range(max(64, 8 * self.nodes))]
        scale = self.rest / sum(sizes)
        self.open, self.coming, names = [], [], iter(range(10**9))
        for size in sizes:
            heapq.heappush(self.open, (-size * scale, next(names)))
        free = [(ALONE + (LOAD * self.random.uniform(0.7, 1.3) if node else 0.0), node) for node in range(self.nodes)]
        heapq.heapify(free)
        given, end = ALONE, ALONE
        while self.open or self.coming:
            now, node = heapq.heappop(free)
            if not self.open:
                now = max(now, self.coming[0][0])
            while self.coming and self.coming[0][0] <= now:
                heapq.heappush(self.open, heapq.heappop(self.coming)[1:])
            size, name = heapq.heappop(self.open)
            size = -size
            given = max(given + 1 / CLAIMS, now)
            epoch = self.epochs[name] = self.epochs.get(name, 0) + 1
            start, spent = given + VERB, min(size / SPEED, self.seconds_a_part)
            if self.random.random() < self.deaths * spent:
                # It is open again when the lease has ended. Half of the dead only slept, and end their part when it is over.
                heapq.heappush(self.coming, (start + LEASE, -size, name))
                if self.random.random() < 0.5:
                    self.finish(name, epoch, size, is_late=True)
                heapq.heappush(free, (start + AWAY, node))
                continue
            left = size - spent * SPEED
            done = start + spent + VERB
            self.finish(name, epoch, size - max(left, 0.0))
            if left > 1e-9:
                count = min(PIECES, max(2, int(left / SPEED / SHORTEST)))
                shares = [self.random.random() + 0.1 for _ in range(count)]
                for piece in shares:
                    heapq.heappush(self.coming, (done, -left * piece / sum(shares), next(names)))
            end = max(end, done)
            heapq.heappush(free, (done, node))
        return end

    def finish(self, name, epoch, size, is_late=False):
        """Credits what a node has settled, if it still has the part: one that wakes up late comes after the next claim."""
        if not self.fault and (is_late or self.epochs[name] != epoch):
            self.voided += 1
            return
        self.credited += size

    def is_settled_once(self):
        return math.isclose(self.credited, self.rest, rel_tol=1e-9, abs_tol=1e-9)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=float)
    parser.add_argument("--nodes", type=int, default=128)
    parser.add_argument("--late", type=float, default=LATE)
    parser.add_argument("--deaths", type=float, default=0.0)
    parser.add_argument("--fault", action="store_true")
    asked = parser.parse_args()
    widths = (1, 2, 4, 8, 32, 128, 1024, 10000)
    works = (50, 500, 5e3, 5e4, 5e5, 5e6) if asked.work is None else (asked.work,)
    if asked.work is None:
        print("core seconds" + "".join(f"{nodes:>20d}" for nodes in widths))
    is_right = True
    for work in works:
        row = []
        for nodes in widths if asked.work is None else (1, asked.nodes):
            search = Search(work, nodes, asked.late, asked.deaths, asked.fault)
            row.append(search.run())
            is_right = is_right and search.is_settled_once()
        print(f"{work:12.0f}" + "".join(f"{seconds:10.1f} s {row[0] / seconds:6.1f}x" for seconds in row))
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main())
