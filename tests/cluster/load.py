"""Clients that use a cluster as people do, all of it at the same time, and write down what they asked and were told.

The clients are also the balancer: each request goes to a node that serves, and one that may be repeated is repeated at
another node. What was not answered, or with 503, is unknown.
"""
import hashlib
import itertools
import json
import math
import random
import threading
import time

import httpx

import at_rest
import checkers
import shapes
from api_conftest import PATIENCE
from history import History
from test_layouts import on_saddle, saddle_layout

SLOTS = 4                      # vertices of a mesh that clients move
ANSWER = 15.0                  # seconds after which a request counts as not answered
MERIDIANS = 40                 # of the spheres, whose distance is known
DISTANCE = 1 - math.cos(math.pi / MERIDIANS)
COUNT = itertools.count(1)     # makes contents that differ
FEWEST_CALLS = 20              # with a known answer, that a load is worth checking for
LOOKS = ("read", "list", "fetch", "document", "count", "log")


class Untold(Exception):
    """Nobody knows whether the request had an effect."""


class Refused(Exception):
    """The request had no effect."""


class Client:
    """One client with one request at a time."""

    def __init__(self, load, name, seed):
        self.load, self.name = load, name
        self.chance = random.Random(seed)
        self.http = httpx.Client(timeout=ANSWER, verify=False)

    def pick(self):
        while not (nodes := self.load.cluster.serving()):
            time.sleep(0.02)
        return self.chance.choice(nodes)

    def ask(self, node, method, path, **options):
        try:
            reply = self.http.request(method, node.daemon.url + path, **options)
        except (httpx.ConnectError, httpx.ConnectTimeout):
            raise Refused from None
        except httpx.TransportError:
            raise Untold from None
        if reply.status_code == 503:
            raise Untold  # the store may have done it
        if reply.status_code == 429:
            raise Refused
        return reply

    def call(self, name, key, method, path, statuses, tell, arguments=(), node=None, **options):
        """One call of the history. Gives the reply, or None without an answer. `statuses` are those that may come;
        tell(reply) gives what the history holds, or None when the refusal had no effect and says nothing."""
        node = node or self.pick()
        history = self.load.history
        call = history.begin(self.name, name, key, node.name, **dict(arguments))
        try:
            reply = self.ask(node, method, path, **options)
        except (Untold, Refused) as fault:
            if isinstance(fault, Refused) or name in LOOKS:
                history.withdraw(call)
            time.sleep(0.02)
            return None
        assert reply.status_code in statuses, f"{call}: {reply.status_code} {reply.text}"
        answer = tell(reply)
        if answer is None:
            history.withdraw(call)
        else:
            history.end(call, **answer)
        return reply

    def until_told(self, *arguments, **options):
        """The same call, at any nodes, until there is an answer or the load has ended; only for what may be repeated."""
        while (reply := self.call(*arguments, **options)) is None and not self.load.ended:
            pass
        return reply

    # ---- meshes ----

    def upload(self, content=None):
        data = shapes.obj(shapes.cube(side=next(COUNT))) if content is None else content
        digest = hashlib.sha256(data).hexdigest()
        reply = self.until_told("create", "", "POST", "/v1/meshes", (200, 201), lambda reply: {"id": reply.json()["id"]},
                                {"kind": "mesh", "hash": digest}, content=data)
        return reply and reply.json()["id"]

    def remove(self, mesh):
        self.call("remove", mesh, "DELETE", f"/v1/meshes/{mesh}", (204, 404),
                  lambda reply: {} if reply.status_code == 204 else None, {"kind": "mesh"})

    def read(self, mesh, node=None):
        """The revision and values of a mesh with slots."""
        def tell(reply):
            if reply.status_code == 404:
                return {"is_gone": True}
            return {"revision": revision_of(reply),
                    "values": [round(row[2]) for row in reply.json()["positions"][:SLOTS]]}
        return self.call("read", mesh, "GET", f"/v1/meshes/{mesh}/vertices", (200, 404), tell, node=node,
                         headers={"Accept": "application/json"})

    def move(self, mesh, is_guarded=None):
        """One slot gets a new value, on the condition of the current revision or without one."""
        slot, value = self.chance.randrange(SLOTS), next(COUNT)
        body = {"indices": [slot], "positions": [[float(slot), 0.0, float(value)]]}
        arguments, headers = {"slot": slot, "value": value}, {}
        if self.chance.random() < 0.5 if is_guarded is None else is_guarded:
            seen = self.read(mesh)
            if seen is None or seen.status_code != 200:
                return None
            arguments["expected"] = revision_of(seen)
            # The tag of the mesh, without the form in which its vertices were read.
            headers["If-Match"] = '"' + "-".join(seen.headers["etag"].strip('"').split("-")[:2]) + '"'

        def tell(reply):
            return {200: lambda: {"revision": reply.json()["revision"]}, 412: lambda: {"is_conflict": True},
                    404: lambda: {"is_gone": True}, 409: lambda: None}[reply.status_code]()
        return self.call("swap" if headers else "write", mesh, "PATCH", f"/v1/meshes/{mesh}/vertices",
                         (200, 404, 409, 412) if headers else (200, 404, 409), tell, arguments, json=body, headers=headers)

    def list(self, kind, node=None):
        """All pages of a list, as one call of the history."""
        plural = {"mesh": "meshes"}.get(kind, kind + "s")
        node = node or self.pick()
        call = self.load.history.begin(self.name, "list", "", node.name, kind=kind)
        items, cursor = {}, {}
        try:
            while cursor is not None:
                page = self.ask(node, "GET", f"/v1/{plural}", params={"limit": 1000, **cursor}).json()
                # A reconstruction makes meshes of its own, named "saddle, 512 quads".
                items.update({item["id"]: content_of(kind, item) for item in page[plural]
                              if not item.get("name", "").endswith(" quads")})
                cursor = {"cursor": page["next"]} if page["next"] else None
        except (Untold, Refused):
            self.load.history.withdraw(call)
            return None
        self.load.history.end(call, items=items)
        return items

    def fetch(self, mesh, node=None):
        """Looks at a mesh and at its bytes, which must have its hash."""
        def tell(reply):
            if reply.status_code == 404:
                return {"is_gone": True}
            return {"hash": reply.json()["content_hash"]}
        return self.call("fetch", mesh, "GET", f"/v1/meshes/{mesh}", (200, 404), tell, {"kind": "mesh"}, node=node)

    # ---- jobs ----

    def submit(self, body, key=None, node=None):
        """Until it is told, at any nodes: the key makes one job of all tries. Gives the job's id."""
        key = key or f"key-{next(COUNT)}"
        reply = self.until_told(
            "submit", key, "POST", "/v1/jobs", (200, 202, 404, 422), lambda reply: tell_submission(reply),
            {"body": json.dumps(body)}, node=node, json=body, headers={"Idempotency-Key": key, "Cache-Control": "no-cache"})
        if reply is None or reply.status_code >= 300:
            return None
        self.load.jobs[reply.json()["id"]] = body
        return reply.json()["id"]

    def look(self, job, node=None):
        """A job's document; its epoch and node are there where the daemon tells them."""
        def tell(reply):
            document = reply.json()
            answer = {"state": document["state"], "document": document}
            if "epoch" in document:
                answer.update(epoch=document["epoch"], node=document["node"])
            return answer
        return self.call("document", job, "GET", f"/v1/jobs/{job}", (200,), tell, node=node)

    def wait(self, job):
        """The document of the ended job, or None when the load ended before."""
        end = time.monotonic() + PATIENCE
        while True:
            reply = self.look(job)
            if reply and reply.json()["state"] not in ("queued", "running"):
                return reply.json()
            if self.load.ended:
                return None
            assert time.monotonic() < end, f"job {job} does not end"
            time.sleep(0.02)

    def follow(self, job, node=None):
        """Reads the stream of a job to its end; a cut one goes on at another node after the last event that came."""
        call = self.load.history.begin(self.name, "stream", job)
        lines = []
        while not (lines and lines[-1]["event"] in ("result", "error")):
            at, node = node or self.pick(), None
            headers = {"Accept": "application/x-ndjson"}
            if lines:
                headers["Last-Event-ID"] = str(lines[-1]["seq"])
            try:
                with self.http.stream("GET", f"{at.daemon.url}/v1/jobs/{job}/events", headers=headers) as reply:
                    if reply.status_code != 503:
                        assert reply.status_code == 200, reply.read()
                        for line in reply.iter_lines():
                            event = json.loads(line)
                            if event["event"] not in ("heartbeat", "server_shutdown"):
                                lines.append(event)
            except httpx.TransportError:
                pass
            except json.JSONDecodeError:
                pass  # the line was cut
            if self.load.is_over:
                break
            time.sleep(0.01)
        self.load.history.end(call, lines=lines)
        return lines

    def log(self, job, node=None):
        """All events of a job that has ended."""
        def tell(reply):
            return {"lines": [event for event in map(json.loads, reply.text.splitlines()) if event["event"] != "heartbeat"]}
        return self.call("log", job, "GET", f"/v1/jobs/{job}/events", (200,), tell, node=node,
                         headers={"Accept": "application/x-ndjson"})

    # ---- layouts and reconstructions ----

    def draw(self, mesh):
        key = f"key-{next(COUNT)}"
        reply = self.until_told("create", key, "POST", "/v1/layouts", (201,), lambda reply: {"id": reply.json()["id"]},
                                {"kind": "layout", "hash": mesh}, json={"mesh": mesh, **saddle_layout()},
                                headers={"Idempotency-Key": key})
        return reply and reply.json()["id"]

    def edit(self, layout):
        """Cuts a curve in two, or joins the two again."""
        try:
            seen = self.ask(self.pick(), "GET", f"/v1/layouts/{layout}")
        except (Untold, Refused):
            return
        curves = [curve["id"] for curve in seen.json()["curves"]]
        path, body = ("curves/6/split", {"point": on_saddle(0, 0.1)}) if len(curves) == 7 else \
            ("curves/merge", {"first": 6, "second": max(curves)})
        # Another client may have edited between: 404, 409 or 422, and nothing was done.
        self.call("edit", layout, "POST", f"/v1/layouts/{layout}/{path}", (200, 404, 409, 422),
                  lambda reply: {"revision": reply.json()["revision"]} if reply.status_code == 200 else None, json=body)

    def reconstruct(self, layout):
        key = f"key-{next(COUNT)}"
        reply = self.until_told(
            "create", key, "POST", "/v1/reconstructions", (201,), lambda reply: {"id": reply.json()["id"]},
            {"kind": "reconstruction", "hash": layout}, json={"layout": layout}, headers={"Idempotency-Key": key})
        return reply and reply.json()["id"]

    def refine(self, reconstruction):
        """One step by a job of its own; known once the job has ended."""
        call = self.load.history.begin(self.name, "step", reconstruction, steps=1)
        job = self.submit({"type": "reconstruction_step", "reconstruction": reconstruction, "steps": 1, "measure": False})
        document = self.wait(job) if job else None
        if document:
            refusal = document.get("problem", {"code": None, "detail": ""})
            is_given_up = sum(node.kills for node in self.load.cluster.nodes) >= 3 and "was killed 3 times" in refusal["detail"]
            assert document["state"] == "succeeded" or refusal["code"] == "conflict" or is_given_up, document
            self.load.history.end(call, taken=document["result"]["step_count"] if "result" in document else 0)

    def count(self, reconstruction, node=None):
        return self.call("count", reconstruction, "GET", f"/v1/reconstructions/{reconstruction}", (200,),
                         lambda reply: {"steps": reply.json()["step_count"]}, node=node)

    def use_everything(self):
        """One of each thing that changes the store."""
        load = self.load
        mesh = self.upload()
        self.move(load.registers[0], is_guarded=False)
        self.move(load.registers[0], is_guarded=True)
        jobs = [self.submit({"type": kind, "a": load.pair[0], "b": load.pair[1], "tolerance": tolerance})
                for kind, tolerance in (("hausdorff", 1e-6), ("deviation", 1e-2))]
        self.edit(load.layouts[0])
        made = self.reconstruct(self.draw(load.saddle))
        load.reconstructions.append(made)
        self.refine(made)
        self.remove(mesh)
        for job in jobs:
            self.wait(job)


def revision_of(reply):
    """The number in the tag, which begins with the hash of the content."""
    return int(reply.headers["etag"].strip('"').split("-")[1])


def tell_submission(reply):
    if reply.status_code == 422:
        return {"is_mismatch": True}
    return {"id": reply.json()["id"]} if reply.status_code < 300 else None


def content_of(kind, item):
    return {"mesh": lambda: item["content_hash"], "layout": lambda: item["mesh"], "reconstruction": lambda: item["layout"],
            "job": lambda: ""}[kind]()


def check_job(cluster, job):
    """Waits for the end of a job, and asks every node about it."""
    quiet = Load(cluster, movers=0, askers=0, others=False)
    quiet.jobs[job] = {"type": "any"}
    found = quiet.violations()
    assert not found, "\n".join(map(str, found))


def insist(make):
    """What make() gives, once a node has answered: a machine with much else to do keeps a daemon from its database, which is
    503 then, for some seconds."""
    end = time.monotonic() + PATIENCE
    while not (made := make()):
        assert time.monotonic() < end, "no node has answered"
        time.sleep(0.1)
    return made


class Load:
    """A mixed load for as long as the `with` block lasts. Afterwards `check` waits for what is under way and looks at all of
    it from every node."""

    def __init__(self, cluster, seed=1, movers=2, askers=2, others=True):
        self.cluster, self.seed = cluster, seed
        self.history, self.jobs, self.faults = History(), {}, []
        self.ended = self.is_over = False
        setup = Client(self, "setup", seed)
        self.before = {item for kind in ("mesh", "layout") for item in setup.list(kind)}
        self.registers = []
        for _ in range(2):
            # As many vertices as slots and more, apart from each other, all in z = 0.
            plane = ([(float(i), 0.0, 0.0) for i in range(SLOTS)] + [(float(i), 1.0, float(next(COUNT))) for i in range(SLOTS)],
                     [(i, i + 1, i + 1 + SLOTS, i + SLOTS) for i in range(SLOTS - 1)])
            self.registers.append(insist(lambda plane=plane: setup.upload(shapes.obj(plane))))
        self.pair = [insist(lambda turn=turn: setup.upload(shapes.ply_little(shapes.sphere(turn, MERIDIANS // 2, MERIDIANS))))
                     for turn in (0.0, math.pi / MERIDIANS)]
        self.saddle = insist(lambda: setup.upload(shapes.obj(shapes.saddle(8))))
        self.kept = {*self.registers, *self.pair, self.saddle}
        self.layouts, self.reconstructions = [insist(lambda: setup.draw(self.saddle))], []
        works = [self.move] * movers + [self.submit] * askers
        if others:
            works += [self.store, self.draw, self.refine, self.look]
        self.threads = [threading.Thread(target=self._run, args=(work, Client(self, f"{work.__name__}{n}", f"{seed} {n}")))
                        for n, work in enumerate(works)]

    def _run(self, work, client):
        while not self.ended:
            try:
                work(client)
            except Exception as fault:  # whatever it is, the test fails with it
                self.faults.append(fault)
                return

    # ---- what the clients do, over and over ----

    def move(self, client):
        mesh = client.chance.choice(self.registers)
        client.move(mesh)
        client.read(mesh)
        time.sleep(0.01)

    def submit(self, client):
        a, b = self.pair
        kind = client.chance.choice(["hausdorff", "hausdorff", "self_collision"])
        body = {"type": kind, "a": a, "b": b, "tolerance": 1e-6} if kind == "hausdorff" else {"type": kind, "mesh": a}
        job = client.submit(body)
        if job and client.chance.random() < 0.5:
            client.follow(job)
        elif job:
            client.wait(job)

    def store(self, client):
        mesh = client.upload()
        if mesh and client.chance.random() < 0.5:
            client.remove(mesh)
        elif mesh:
            client.fetch(mesh)
        time.sleep(0.02)

    def draw(self, client):
        layout = client.draw(self.saddle) if client.chance.random() < 0.1 else None
        if layout:
            self.layouts.append(layout)
        client.edit(client.chance.choice(self.layouts))
        time.sleep(0.02)

    def refine(self, client):
        # Each step has four times as many quads, so that a few are enough for one reconstruction.
        if not self.reconstructions or client.chance.random() < 0.3:
            made = client.reconstruct(client.draw(self.saddle)) if not client.load.ended else None
            if made:
                self.reconstructions.append(made)
        if self.reconstructions:
            client.refine(self.reconstructions[-1])
        time.sleep(0.05)

    def look(self, client):
        client.list(client.chance.choice(["mesh", "layout"]))
        time.sleep(0.05)

    # ---- begin and end ----

    def __enter__(self):
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_):
        """All nodes that serve must be well by now, so that what is under way comes to its end."""
        end = time.monotonic() + PATIENCE  # a machine with much else to do has answered little by now
        while self._known_calls() <= FEWEST_CALLS and not self.faults and time.monotonic() < end:
            time.sleep(0.02)
        self.ended = True
        for thread in self.threads:
            thread.join(PATIENCE)
        self.is_over = True
        for thread in self.threads:
            thread.join()

    def violations(self, check_tables=True):
        """Looks at everything from every node, then checks all that was ever told."""
        assert not self.faults, f"seed {self.seed}: {self.faults}"
        last = Client(self, "last", self.seed)
        meshes = {call.answer["id"] for call in self.history.calls if call.name == "create" and call.is_known and
                  call.arguments["kind"] == "mesh"}
        for job in self.jobs:
            self._wait(last, job)
        for node in self.cluster.serving():
            for kind in ("mesh", "layout"):
                assert last.list(kind, node) is not None
            for mesh in self.registers:
                assert last.read(mesh, node)
            for mesh in sorted(meshes)[-20:]:
                last.fetch(mesh, node)
            for reconstruction in self.reconstructions:
                last.count(reconstruction, node)
            for job in list(self.jobs)[-100:]:
                last.look(job, node)
        for job in self.jobs:
            last.log(job)
        distances = {job: DISTANCE for job, body in self.jobs.items() if body["type"] == "hausdorff"}
        found = checkers.check_all(self.history, {mesh: (0, (0,) * SLOTS) for mesh in self.registers}, distances,
                                   self.before)
        if check_tables and self.cluster.database:
            found += checkers.check_rest(at_rest.read_tables(self.cluster.query), is_cleaned=False)
        return found

    def _wait(self, client, job):
        end = time.monotonic() + PATIENCE
        while not (reply := client.look(job)) or reply.json()["state"] in ("queued", "running"):
            assert time.monotonic() < end, f"seed {self.seed}: job {job} does not end"
            time.sleep(0.02)

    def check(self, **options):
        """All holds; a failure is told with the calls that contradict each other, and leaves the history beside the nodes."""
        found = self.violations(**options)
        if found:
            self.history.save(self.cluster.folder / "history")
        assert not found, f"seed {self.seed}, history in {self.cluster.folder}/history:\n" + "\n".join(map(str, found[:5]))
        assert self._known_calls() > FEWEST_CALLS, "the load did nothing"

    def _known_calls(self):
        return sum(call.is_known for call in self.history.calls)
