#!/usr/bin/env python3
"""A cluster as a model: nodes that claim jobs from one store, and everything that goes wrong with them.

The rules are those of the daemon: verbs with leases (node, epoch), two homes a mesh, a spill, beats and their reaper, jobs
given up after three deaths. The model asks what cannot be tried with ten thousand machines: whether a job is lost or has its
effect twice, how long jobs wait, and what the database has to commit.

usage: simulate.py [--nodes N] [--seconds S] [--job SECONDS] [--latencies FILE] [--seed N] [--calm] [--apart] [--fault NAME]

--latencies  a JSON file {"submit": ms, "finish": [least, most], ...}, which replaces what it names of LATENCIES
--calm       nothing goes wrong
--apart      a node runs one job at most that would be given up with it: see Store.claim
--fault      plants a fault of the store: see FAULTS
Exit status: 0 when nothing was lost and nothing done twice.
"""
import argparse
import bisect
import collections
import dataclasses
import heapq
import json
import math
import random
import sys
import time

# Milliseconds of each verb, as measured on one machine with an idle and a busy disk.
LATENCIES = {"submit": 0.15, "claim": 0.17, "finish": [0.15, 4.0], "append": 0.04, "find": 0.03, "beat": [0.15, 4.0]}

# What a store could do wrong. Each is found by a figure of the report.
FAULTS = {
    "finish": "the end of a job is stored without a look at its lease",
    "reap": "the reaper queues what it saw at its start, and not what a node claimed while it was declared dead",
    "forget": "a claim whose answer was lost is not told again",
    "judge": "nodes are declared dead by one that has not beaten itself for long enough",
}

WORKERS = 8            # of a node
LOAD = 0.7             # share of all workers that is busy
MESHES = 20            # in use, for each node
CACHED = 40            # meshes that a node holds
COLD = 0.65            # seconds to fetch and prepare a mesh of 50 MB
POPULARITY = 0.9       # exponent of Zipf's law
BEAT, SILENCE, PULSE, SPILL = 2.0, 10.0, 0.05, 0.2   # seconds
GRACE, START = 5.0, 1.0       # seconds of a drain at most, and of a start
DEATHS = 3             # of its nodes, after which a job is given up
LOST_ANSWERS = 0.001   # share of verbs that are done and whose answer does not come
RETRY = (2.0, 3.0)     # seconds until a client or a node tries again what was answered with 503

QUEUED, RUNNING, ENDED = range(3)


class Job:
    __slots__ = ("asked", "cached", "deaths", "effects", "epoch", "given_up", "home", "lease", "mesh", "poison", "since",
                 "started", "state")

    def __init__(self, asked, mesh, poison):
        self.asked, self.mesh, self.poison = asked, mesh, poison
        self.state = None          # None until the submission is stored
        self.lease, self.epoch, self.deaths = None, 0, 0
        self.effects, self.given_up, self.started = 0, False, None
        self.home, self.since = None, None


class Store:
    """The tables and verbs. A lease is (node's life, epoch); a life is one start of a node."""

    def __init__(self, fault, apart):
        self.fault, self.apart = fault, apart
        self.at_home = collections.defaultdict(collections.deque)
        self.anywhere, self.by_age = collections.deque(), collections.deque()
        self.beats, self.dead, self.runs = {}, set(), collections.defaultdict(dict)
        self.waiting = collections.Counter()

    def queue(self, job, home, now):
        job.state, job.home, job.since, job.lease = QUEUED, home, now, None
        entry = (job, job.epoch)
        if home is None:
            self.anywhere.append(entry)
        else:
            self.at_home[home].append(entry)
            self.by_age.append((now, *entry))
        self.waiting[home] += 1

    def submit(self, job, home, now):
        if job.state is None:      # else this very call was stored before
            self.queue(job, home, now)

    def claim(self, life, home, count, now):
        """The jobs that this life gets, or None when it is dead.

        Jobs that died together wait together, are claimed together, and die together again when one of them is poisonous. With
        `apart`, those at their last attempt run on different nodes, so that the poisonous one is given up alone.
        """
        if life in self.dead and self.fault != "reap":
            return None
        taken = []
        is_taken = self.apart and any(job.deaths == DEATHS - 1 for job in self.runs[life])
        while len(taken) < count and (job := self._next(home, now, is_taken)):
            is_taken = is_taken or (self.apart and job.deaths == DEATHS - 1)
            self.waiting[job.home] -= 1
            job.epoch += 1
            job.state, job.lease = RUNNING, (life, job.epoch)
            self.runs[life][job] = job.epoch
            taken.append(job)
        return taken

    def _next(self, home, now, is_taken):
        for queue in (self.at_home[home], self.anywhere):
            while queue:
                job, epoch = queue[0]
                if is_taken and job.deaths == DEATHS - 1:
                    break
                queue.popleft()
                if job.state == QUEUED and job.epoch == epoch:
                    return job
        while self.by_age and self.by_age[0][0] <= now - SPILL:
            _, job, epoch = self.by_age.popleft()
            if job.state == QUEUED and job.epoch == epoch:
                return job
        return None

    def finish(self, life, job, epoch):
        """True when the job is ended by this call or was by this very call before; False: the lease is gone."""
        if job.state == ENDED and job.lease == (life, epoch):
            return True
        if job.lease != (life, epoch) and self.fault != "finish":
            return False
        self.runs[life].pop(job, None)
        job.state, job.lease = ENDED, (life, epoch)
        job.effects += 1
        return True

    def release(self, life, now):
        for job in list(self.runs.pop(life, ())):
            self.queue(job, None, now)

    def beat(self, life, now):
        """False when this life was declared dead."""
        if life in self.dead:
            return False
        self.beats[life] = now
        return True

    def mourn(self, lives):
        """Declares lives dead."""
        self.dead.update(lives)
        for life in lives:
            self.beats.pop(life, None)

    def requeue(self, lives, now):
        """Queues the jobs of dead lives again, or gives them up; gives those that are queued."""
        queued = []
        for life in lives if self.fault == "reap" else self.dead & self.runs.keys():
            for job in self.runs.pop(life, ()):
                job.deaths += 1
                if job.deaths >= DEATHS:
                    job.state, job.given_up = ENDED, True
                else:
                    self.queue(job, None, now)
                    queued.append(job)
        return queued


class Node:
    def __init__(self, number):
        self.number = number
        self.starts = 0
        self.cache = collections.OrderedDict()
        self.begin()

    def begin(self):
        """A new life, without the jobs of the last one. The meshes in memory are gone."""
        self.starts += 1
        self.life = (self.number, self.starts)
        self.is_up, self.is_leaving, self.is_asleep = True, False, False
        self.free, self.running, self.unheard = WORKERS, {}, []
        self.is_claiming, self.put_off = False, []
        self.cache.clear()


@dataclasses.dataclass
class Plan:
    """When things go wrong, as parts of the seconds of load, which are 150 at least: the database is away for 30 s, and what is
    between its return and the next fault takes its time."""
    deaths: float = 0.1            # 1 % of the nodes die; half of them come back after 30 s
    sleepers: tuple = (0.15, 0.55)  # each time 1 % hang for 15 s and go on as if nothing had been
    outage: float = 0.25           # the database is away
    hot: tuple = (0.62, 0.7)       # one mesh gets a tenth of all jobs
    upgrade: tuple = (0.7, 0.85)   # all nodes restart in order, 2 % at a time
    rejoin: float = 0.9            # a fifth of the nodes dies and is back at once
    poison: int = 3                # jobs that kill their node


class Cluster:
    """One run of the model."""

    def __init__(self, nodes, seconds, job_seconds, latencies, seed=1, plan=None, fault=None, apart=False):
        self.random = random.Random(seed)
        self.seconds, self.job_seconds, self.plan = seconds, job_seconds, plan
        self.latencies = {name: (value if isinstance(value, list) else [value, value])
                          for name, value in {**LATENCIES, **latencies}.items()}
        self.store = Store(fault, apart)
        self.now, self.events, self.count = 0.0, [], 0
        self.nodes = [Node(number) for number in range(nodes)]
        self.idle = set(range(nodes))
        self.away_until, self.back_since = 0.0, -math.inf
        self.jobs, self.poison_left = [], plan.poison if plan else 0
        self.acknowledged = set()
        self.commits, self.appends = collections.Counter(), 0.0
        self.warm = self.cold = self.elsewhere = self.restarts = self.declared = self.voided = 0
        self.fault, self.is_over = fault, False
        total, self.popularity = 0.0, []
        for rank in range(1, MESHES * nodes + 1):
            total += rank**-POPULARITY
            self.popularity.append(total)

    # ---- time ----

    def at(self, delay, work, *arguments):
        self.count += 1
        heapq.heappush(self.events, (self.now + delay, self.count, work, arguments))

    def verb(self, name, work, *arguments):
        """A durable verb: done after its latency, or when the database is back; without an answer now and then."""
        if self.now < self.away_until:
            self.at(self.away_until - self.now + self.random.uniform(0, RETRY[0]), self.verb, name, work, *arguments)
            return
        delay = self.random.uniform(*self.latencies[name]) / 1000
        self.commits[int(self.now)] += 1
        self.at(delay, work, self.random.random() >= LOST_ANSWERS, *arguments)

    # ---- clients ----

    def arrive(self, rate):
        if self.now >= self.seconds:
            return
        self.at(self.random.expovariate(rate), self.arrive, rate)
        part = self.now / self.seconds
        mesh = self._mesh()
        if self.plan and self.plan.hot[0] < part < self.plan.hot[1] and self.random.random() < 0.1:
            mesh = 0
        poison = bool(self.poison_left) and part > 0.05
        self.poison_left -= poison
        job = Job(self.now, mesh, poison)
        self.jobs.append(job)
        self.ask(job)

    def _mesh(self):
        return bisect.bisect(self.popularity, self.random.random() * self.popularity[-1])

    def ask(self, job):
        """A client asks some node that is up; the balancer knows which."""
        front = self.random.choice(self.nodes)
        if self.now < self.away_until or not front.is_up or front.is_asleep:
            self.at(self.random.uniform(*RETRY), self.ask, job)
            return
        self.verb("submit", self.submitted, job, front.life)

    def submitted(self, is_heard, job, front):
        was_stored = job.state is not None
        self.store.submit(job, self._home(job.mesh), self.now)
        if not was_stored:
            self.wake(job)
        node = self.nodes[front[0]]
        if is_heard and node.is_up and node.life == front:
            self.acknowledged.add(job)
        else:
            self.at(self.random.uniform(*RETRY), self.ask, job)  # with the same Idempotency-Key

    def _home(self, mesh):
        """Of the first two nodes in the mesh's order that are not known to be dead, the one with less to do."""
        found, k = [], 0
        while len(found) < 2 and k < 32:
            number = hash((mesh, k)) % len(self.nodes)
            k += 1
            if self.nodes[number].life not in self.store.dead and number not in found:
                found.append(number)
        return min(found, key=lambda number: self.store.waiting[number] - self.nodes[number].free, default=None)

    def wake(self, job):
        """Whoever may claim the job looks within a pulse; others after the spill time."""
        if job.home is not None:
            self.look(self.nodes[job.home])
        elif self.idle:
            self.look(self.nodes[self._some_idle()])
        self.at(SPILL, self.spill, job, job.epoch)

    def spill(self, job, epoch):
        if job.state == QUEUED and job.epoch == epoch and self.idle:
            self.look(self.nodes[self._some_idle()])

    def _some_idle(self):
        for number in self.idle:
            if self.random.random() < 0.3:
                return number
        return next(iter(self.idle))

    # ---- nodes ----

    def look(self, node):
        if node.free > 0 and node.is_up and not node.is_leaving and not node.is_claiming:
            node.is_claiming = True
            self.at(self.random.uniform(0, PULSE), self.claim, node, node.life)

    def _is_able(self, node, life, work, *arguments):
        """Whether this life may do its work now; one that sleeps does it when it wakes."""
        if node.life != life or not node.is_up:
            return False
        if node.is_asleep:
            node.put_off.append((work, (node, life, *arguments)))
            return False
        return True

    def claim(self, node, life):
        if self._is_able(node, life, self.claim):
            self.verb("claim", self.claimed, node, life)

    def claimed(self, is_heard, node, life):
        is_here = node.is_up and node.life == life
        if is_here:
            node.is_claiming = False
        count = node.free - len(node.unheard) if is_here else WORKERS
        taken = self.store.claim(life, node.number, count, self.now)
        if taken is None:
            self.hear_of_death(node, life)
            return
        if not is_here:
            return                 # it died between: the reaper finds them
        for job in taken:
            self.elsewhere += job.home not in (node.number, None)
        if not is_heard:
            node.unheard += taken if self.fault != "forget" else []
            self.at(1.0, self.look, node)
            return
        for job in node.unheard + taken:
            self.run(node, job)
        node.unheard = []

    def run(self, node, job):
        if job.lease is None or job.lease[0] != node.life:
            return                 # heard of too late
        job.started = self.now if job.started is None else job.started
        epoch = job.epoch
        node.running[job] = epoch
        node.free -= 1
        if node.free == 0:
            self.idle.discard(node.number)
        duration = self.random.expovariate(1 / self.job_seconds)
        if job.mesh in node.cache:
            node.cache.move_to_end(job.mesh)
            self.warm += 1
        else:
            self.cold += 1
            duration += COLD
            node.cache[job.mesh] = True
            if len(node.cache) > CACHED:
                node.cache.popitem(last=False)
        self.appends += 1 + 2 * duration
        if job.poison:
            self.at(0.5, self.die, node, node.life, 2.0)
        self.at(duration, self.end, node, node.life, job, epoch)

    def end(self, node, life, job, epoch):
        """The computation has ended; a node that sleeps goes on when it wakes."""
        if self._is_able(node, life, self.end, job, epoch) and node.running.get(job) == epoch:
            self.verb("finish", self.finished, node, life, job, epoch)

    def finished(self, is_heard, node, life, job, epoch):
        stored = self.store.finish(life, job, epoch)
        if node.life != life or not node.is_up:
            return
        if not stored:
            self.voided += 1
            self.hear_of_death(node, life)
            return
        if not is_heard:
            self.at(self.random.uniform(*RETRY), self.end, node, life, job, epoch)
            return
        if node.running.pop(job, None) is not None:
            node.free += 1
            self.idle.add(node.number)
            self.look(node)

    def beat(self, node, life):
        if self._is_able(node, life, self.beat):
            self.verb("beat", self.beaten, node, life)

    def beaten(self, is_heard, node, life):
        if not self.store.beat(life, self.now):
            self.hear_of_death(node, life)
        elif node.life == life and node.is_up:
            self.at(BEAT, self.beat, node, life)

    def hear_of_death(self, node, life):
        """LOST: it forgets its jobs without a word and joins anew."""
        if node.life == life and node.is_up:
            self.join(node)

    def join(self, node):
        before = node.life
        node.begin()
        self.idle.add(node.number)
        self.verb("beat", self.joined, node, node.life, before)

    def joined(self, is_heard, node, life, before):
        self.reap([before] if before not in self.store.dead else [])
        if node.life == life:
            self.beaten(is_heard, node, life)
            self.look(node)

    def die(self, node, life, back=None):
        """kill -9; with back it is started again after so many seconds."""
        if node.life != life or not node.is_up:
            return
        node.is_up = False
        self.idle.discard(node.number)
        if back is not None:
            self.at(back + START, self.come_back, node, life)

    def come_back(self, node, life):
        if node.life == life and not node.is_up:
            self.join(node)

    def leave(self, node):
        """An upgrade: no new jobs, some grace for those that run, the rest is given back, a new start."""
        if node.is_up:
            node.is_leaving = True
            self.idle.discard(node.number)
            self.at(GRACE, self.drained, node, node.life)

    def drained(self, node, life):
        if node.life == life and node.is_up:
            self.verb("finish", self.released, node, life)

    def released(self, is_heard, node, life):
        jobs = list(self.store.runs.get(life, ()))
        self.store.release(life, self.now)
        for job in jobs:
            self.wake(job)
        self.die(node, life, 0.0)

    # ---- the reaper, of which each node has one ----

    def judge(self):
        """Every half second some node looks, of thousands that do so every 2 s; one that may."""
        if self.now >= self.away_until:
            patience = 0.0 if self.fault == "judge" else SILENCE
            if self.now - max(self.away_until, 0.0) >= patience:
                silent = [life for life, beat in self.store.beats.items() if self.now - beat > SILENCE]
                self.declared += len(silent)
                self.reap(silent)
        self.is_over = self.now > self.seconds and all(job.state == ENDED for job in self.jobs) \
            and len(self.acknowledged) == len(self.jobs)
        self.at(0.5, self.judge)

    def reap(self, lives):
        self.store.mourn(lives)
        queued = self.store.requeue(lives, self.now)
        self.restarts += len(queued)
        for job in queued:
            self.wake(job)

    # ---- a run ----

    def go_wrong(self):
        plan, count = self.plan, len(self.nodes)
        share_of = max(2, count // 100)
        some = self.random.sample(self.nodes, 3 * share_of)
        for place, node in enumerate(some[:share_of]):
            self.at(plan.deaths * self.seconds, self.die_now, node, 30.0 if place % 2 else None)
        for place, node in enumerate(some[share_of:]):
            start = plan.sleepers[place // share_of] * self.seconds
            self.at(start, self.sleep, node)
            self.at(start + 15, self.wake_up, node)
        self.at(plan.outage * self.seconds, self.go_away)
        start, end = plan.upgrade
        for node in self.nodes:
            group = node.number * 50 // count
            self.at((start + (end - start) * group / 50) * self.seconds, self.leave, node)
        for node in self.random.sample(self.nodes, count // 5):
            self.at(plan.rejoin * self.seconds, self.die_now, node, 0.0)

    def die_now(self, node, back):
        self.die(node, node.life, back)

    def sleep(self, node):
        node.is_asleep = True
        self.idle.discard(node.number)

    def wake_up(self, node):
        node.is_asleep = False
        if node.is_up:
            if node.free:
                self.idle.add(node.number)
            for work, arguments in node.put_off:
                self.at(self.random.uniform(0, 0.2), work, *arguments)
            node.put_off = []
            self.look(node)

    def go_away(self):
        self.away_until = self.now + 30.0

    def simulate(self):
        rate = len(self.nodes) * WORKERS * LOAD / self.job_seconds
        for node in self.nodes:
            self.store.beats[node.life] = 0.0
            self.at(self.random.uniform(0, BEAT), self.beat, node, node.life)
        self.at(0.0, self.arrive, rate)
        self.at(0.5, self.judge)
        if self.plan:
            self.go_wrong()
        last = self.seconds + 300
        while self.now < last and not self.is_over:
            self.now, _, work, arguments = heapq.heappop(self.events)
            work(*arguments)
        return self.report()

    def report(self):
        waits = sorted(job.started - job.asked for job in self.jobs if job.started is not None)
        first = self.plan.deaths * self.seconds if self.plan else self.seconds
        calm = sorted(job.started - job.asked for job in self.jobs if job.started is not None and job.asked < first - 5)
        per_second = [self.commits[second] for second in range(int(self.seconds))]
        return {
            "nodes": len(self.nodes), "seconds": round(self.now, 1), "jobs": len(self.jobs),
            "acknowledged": len(self.acknowledged),
            "lost": sum(job.state != ENDED for job in self.acknowledged),
            "doubled": sum(job.effects > 1 or (job.given_up and job.effects > 0) for job in self.jobs),
            "given_up": sum(job.given_up for job in self.jobs),
            "given_up_wrongly": sum(job.given_up and not job.poison for job in self.jobs),
            "restarted": self.restarts, "declared_dead": self.declared, "late_ends_refused": self.voided,
            "wait_p50_ms": share(calm, 0.5), "wait_p99_ms": share(calm, 0.99),
            "wait_with_faults_p50_ms": share(waits, 0.5), "wait_with_faults_p99_ms": share(waits, 0.99),
            "warm": round(self.warm / max(1, self.warm + self.cold), 3),
            "elsewhere": round(self.elsewhere / max(1, len(self.jobs)), 3),
            "commits_per_second": round(sum(per_second) / max(1, len(per_second))),
            "commits_per_second_most": max(self.commits.values(), default=0),
            "appends_per_second": round(self.appends / max(1.0, self.now)),
        }


def share(values, part):
    return round(1000 * values[min(len(values) - 1, int(part * len(values)))], 1) if values else None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=200.0)
    parser.add_argument("--job", type=float, default=5.0)
    parser.add_argument("--latencies")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calm", action="store_true")
    parser.add_argument("--apart", action="store_true")
    parser.add_argument("--fault", choices=FAULTS)
    asked = parser.parse_args()
    latencies = {}
    if asked.latencies:
        with open(asked.latencies) as file:
            latencies = json.load(file)
    start = time.monotonic()
    report = Cluster(asked.nodes, asked.seconds, asked.job, latencies, asked.seed, None if asked.calm else Plan(),
                     asked.fault, asked.apart).simulate()
    for name, value in report.items():
        print(f"{name:26} {value}")
    print(f"simulated in {time.monotonic() - start:.1f} s", file=sys.stderr)
    return 0 if report["lost"] == report["doubled"] == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
