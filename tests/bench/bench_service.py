"""The daemon under load on loopback: requests a second, latency of streams, speed of uploads, memory in a soak.

Requests come from `wrk`, which shares the cores with the daemon; the rest from this program. A line of a stream is late
by the time that it comes after the first of all streams that had it.
"""
import array
import contextlib
import http.client
import json
import math
import pathlib
import random
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

import pairs as meshes
import tables

sys.path.append(str(meshes.ROOT / "tests/api"))
import shapes

DAEMON = meshes.ROOT / "build/quadmeshd"
POINTS = 100
STREAMS = 200
CONNECTIONS = 16
GOALS = {"health": None, "projection": 5000, "cached": 1000, "p99_ms": 10, "obj": 150, "ply": 400, "small_ms": 50, "beside_ms": 50}


class Daemon:
    def __init__(self, folder, *settings):
        port_file = folder / "port"
        self.process = subprocess.Popen([DAEMON, "--port", "0", "--port-file", port_file, "--data-dir", folder / "data",
                                         "--log-level", "error", *map(str, settings)], stdout=subprocess.DEVNULL)
        while not (port_file.exists() and port_file.read_text().endswith("\n")):
            time.sleep(0.02)
        self.port = int(port_file.read_text())

    def call(self, method, path, body=None, headers=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=600)
        with contextlib.closing(connection):
            connection.request(method, path, body, headers or {})
            reply = connection.getresponse()
            return reply.status, reply.read()

    def upload(self, content, **query):
        text = "&".join(f"{name}={value}" for name, value in query.items())
        status, body = self.call("POST", f"/v1/meshes?{text}", content)
        assert status in (200, 201), body
        return json.loads(body)

    def resident(self):
        for line in open(f"/proc/{self.process.pid}/status", encoding="ascii"):
            if line.startswith("VmRSS"):
                return int(line.split()[1]) / 1024
        return math.nan

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(60)


# ---- requests a second ----


def run_wrk(daemon, folder, method, path, body, seconds):
    (folder / "body").write_bytes(body)
    script = folder / "request.lua"
    script.write_text(f'local file = io.open("{folder}/body", "rb")\nwrk.method = "{method}"\n'
                      'wrk.body = file:read("*a")\nwrk.headers["Content-Type"] = "application/octet-stream"\n'
                      if path.endswith("/project") else
                      f'local file = io.open("{folder}/body", "rb")\nwrk.method = "{method}"\n'
                      'wrk.body = file:read("*a")\nwrk.headers["Content-Type"] = "application/json"\n')
    done = subprocess.run(["wrk", "-t1", f"-c{CONNECTIONS}", f"-d{seconds}s", "--latency", "-s", script,
                           f"http://127.0.0.1:{daemon.port}{path}"], capture_output=True, text=True, check=True)
    assert "Non-2xx" not in done.stdout, done.stdout
    figures = {line.split()[0]: line.split()[1] for line in done.stdout.splitlines() if len(line.split()) == 2}
    return float(figures["Requests/sec:"]), figures["99%"]


def bench_requests(daemon, folder, seconds, spheres):
    a, b = spheres
    chance = random.Random(1)
    points = array.array("d", [chance.uniform(-1, 1) for _ in range(3 * POINTS)]).tobytes()
    job = json.dumps({"type": "hausdorff", "a": a, "b": b, "tolerance": 0.01}).encode()
    daemon.call("POST", "/v1/jobs", job, {"Prefer": "wait=60"})
    for name, what, method, path, body in (
            ("health", "GET /healthz", "GET", "/healthz", b""),
            ("projection", f"POST project, {POINTS} points", "POST", f"/v1/meshes/{a}/project", points),
            ("cached", "POST job, answered before", "POST", "/v1/jobs", job)):
        rate, p99 = run_wrk(daemon, folder, method, path, body, seconds)
        yield {"name": name, "what": what, "figure": rate, "unit": "requests/s", "note": f"p99 {p99}"}


# ---- streams ----


def receive(port, path):
    """The blocks of all streams with the times when they came; one thread, which does nothing else meanwhile."""
    waiting, blocks = select.epoll(), {}
    wires = [socket.create_connection(("127.0.0.1", port)) for _ in range(STREAMS)]
    for wire in wires:
        wire.sendall(f"GET {path} HTTP/1.0\r\nAccept: application/x-ndjson\r\n\r\n".encode())
        waiting.register(wire, select.EPOLLIN)
        blocks[wire.fileno()] = []
    by_number, still_open = {wire.fileno(): wire for wire in wires}, STREAMS
    joined = time.perf_counter()
    while still_open:
        for number, _ in waiting.poll():
            block = by_number[number].recv(65536)
            blocks[number].append((time.perf_counter(), block))
            if not block:
                waiting.unregister(number)
                still_open -= 1
    for wire in wires:
        wire.close()
    return blocks.values(), joined


def find_lines(blocks):
    """(seq, time) of each line of bounds or result."""
    seen, rest = [], b""
    for when, block in blocks:
        *lines, rest = (rest + block).split(b"\n")
        seen += [(int(line.split(b'"seq":')[1].split(b",")[0]), when) for line in lines
                 if line.startswith((b'{"event":"bounds"', b'{"event":"result"'))]
    return seen


def bench_streams(daemon, slow):
    a, b = slow
    request = {"type": "hausdorff", "a": a, "b": b, "quads": "bilinear", "tolerance": 1e-12, "deadline_ms": 6000}
    _, body = daemon.call("POST", "/v1/jobs", json.dumps(request), {"Cache-Control": "no-cache"})
    path = f"/v1/jobs/{json.loads(body)['id']}/events"
    received, joined = receive(daemon.port, path)
    seen = [find_lines(blocks) for blocks in received]
    first = {}
    for lines in seen:
        for seq, when in lines:
            first[seq] = min(when, first.get(seq, math.inf))
    late = sorted(1e3 * (when - first[seq]) for lines in seen for seq, when in lines if first[seq] > joined + 0.2)
    whole = all(len(lines) == len(first) for lines in seen)
    yield {"name": "p99_ms", "what": f"line to {STREAMS} streams, p99", "figure": late[int(0.99 * len(late))],
           "unit": "ms", "note": f"median {late[len(late) // 2]:.2f}, {len(late)} lines" + ("" if whole else ", LINES LOST")}


# ---- small requests beside large ones ----


def time_each(count, call):
    """The median and the 99th percentile of the times of calls, in ms."""
    times = []
    for number in range(count):
        start = time.perf_counter()
        call(number)
        times.append(1e3 * (time.perf_counter() - start))
    times.sort()
    return times[count // 2], times[int(0.99 * count)]


def bench_small_jobs(daemon, slow, count):
    """Small jobs, one at a time, beside deviations that do not end."""
    a, b = (daemon.upload(shapes.ply_little(shapes.sphere(turn, 20, 40)))["id"] for turn in (0.0, 0.05))
    endless = []

    def small(number):
        request = {"type": "hausdorff", "a": a, "b": b, "tolerance": 1e-3 * (1 + 1e-6 * number)}
        _, body = daemon.call("POST", "/v1/jobs", json.dumps(request), {"Cache-Control": "no-cache", "Prefer": "wait=600"})
        assert json.loads(body)["state"] == "succeeded", body

    for beside in (0, 1, 2, 10):
        while len(endless) < beside:
            request = {"type": "deviation", "a": slow[0], "b": slow[1], "accuracy": 1e-12 * (1 + len(endless)), "pieces": 10000000}
            _, body = daemon.call("POST", "/v1/jobs", json.dumps(request))
            endless.append(json.loads(body)["id"])
        time.sleep(0.5)
        median, late = time_each(count, small)
        yield {"name": "small_ms", "what": f"small job beside {beside} endless ones, p99", "figure": late, "unit": "ms",
               "note": f"median {median:.1f}" + ("; waited for their end before jobs took turns" if beside == 2 else "")}
    for job in endless:
        daemon.call("DELETE", f"/v1/jobs/{job}")


def bench_beside_uploads(daemon, mesh, count, faults):
    """Projections beside clients that upload GLB files which decode into millions of faces, again and again."""
    points = array.array("d", [0.3] * 3 * POINTS).tobytes()
    ends = threading.Event()

    def upload(client):
        number = 0
        while not ends.is_set():
            number += 1
            status, body = daemon.call("POST", f"/v1/meshes?format=glb&name={client}-{number}",
                                       shapes.crowded_glb(300 + 10 * client + number % 7, 100))
            if status == 201:
                daemon.call("DELETE", f"/v1/meshes/{json.loads(body)['id']}")
            elif status not in (503, 507):
                faults.append(f"service: an upload was answered with {status}")

    def project(number):
        status, _ = daemon.call("POST", f"/v1/meshes/{mesh}/project", points, {"Content-Type": "application/octet-stream"})
        assert status == 200

    for beside, before in ((0, ""), (8, "; 9770 when both shared two threads")):
        ends.clear()
        threads = [threading.Thread(target=upload, args=[client]) for client in range(beside)]
        for thread in threads:
            thread.start()
        time.sleep(1.5 if beside else 0)
        median, late = time_each(count, project)
        ends.set()
        for thread in threads:
            thread.join()
        yield {"name": "beside_ms", "what": f"projection beside {beside} hostile uploads, p99", "figure": late, "unit": "ms",
               "note": f"median {median:.1f}{before}"}


# ---- uploads ----


def write_files(side):
    """A wavy plate of side x side quads as OBJ text and as binary PLY."""
    vertices = [(i / side, j / side, 0.1 * math.sin(9 * i / side) * math.cos(7 * j / side))
                for i in range(side + 1) for j in range(side + 1)]
    row = side + 1
    quads = [(i * row + j, (i + 1) * row + j, (i + 1) * row + j + 1, i * row + j + 1)
             for i in range(side) for j in range(side)]
    obj = "".join(f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in vertices)
    obj += "".join(f"f {a + 1} {b + 1} {c + 1} {d + 1}\n" for a, b, c, d in quads)
    head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty double x\nproperty double y\n"
            f"property double z\nelement face {len(quads)}\nproperty list uchar uint vertex_indices\nend_header\n")
    faces = b"".join(b"\4" + array.array("I", quad).tobytes() for quad in quads)
    return obj.encode(), head.encode() + array.array("d", [x for p in vertices for x in p]).tobytes() + faces


def bench_uploads(daemon, side, runs):
    for name, content in zip(("obj", "ply"), write_files(side)):
        rates, parses = [], []
        for run in range(runs):
            start = time.perf_counter()
            mesh = daemon.upload(content, name=f"{name}{run}", format=name)
            seconds = time.perf_counter() - start
            building = sum(value for key, value in mesh["prepare_ms"].items() if key != "parse") / 1e3
            rates.append(len(content) / 1e6 / (seconds - building))
            parses.append(len(content) / 1e3 / mesh["prepare_ms"]["parse"])
            daemon.call("DELETE", f"/v1/meshes/{mesh['id']}")
        yield {"name": name, "what": f"{name.upper()} upload and decode, {len(content) / 1e6:.0f} MB",
               "figure": sorted(rates)[runs // 2], "unit": "MB/s",
               "note": f"decode alone {sorted(parses)[runs // 2]:.0f} MB/s"}


# ---- soak ----


def work_for(daemon, end, seed, files, faults):
    """Uploads, jobs, cancels, hang-ups and deletes, until the time is up."""
    chance = random.Random(seed)
    while time.monotonic() < end:
        try:
            mesh = daemon.upload(chance.choice(files), name=f"{seed}-{chance.random()}")["id"]
            job = json.dumps({"type": chance.choice(["hausdorff", "deviation"]), "a": mesh, "b": mesh,
                              "tolerance": 10 ** chance.uniform(-9, -1)})
            deed = chance.randrange(3)
            if deed == 0:
                daemon.call("POST", "/v1/jobs", job, {"Prefer": "wait=10"})
            elif deed == 1:
                _, body = daemon.call("POST", "/v1/jobs", job)
                daemon.call("DELETE", f"/v1/jobs/{json.loads(body)['id']}")
            else:
                with socket.create_connection(("127.0.0.1", daemon.port)) as wire:
                    wire.sendall(f"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nAccept: application/x-ndjson\r\n"
                                 f"Content-Length: {len(job)}\r\n\r\n{job}".encode())
                    wire.recv(100)
            daemon.call("DELETE", f"/v1/meshes/{mesh}")
        except (OSError, AssertionError, ValueError) as fault:
            faults.append(f"soak: {fault}")
            return


def bench_soak(daemon, seconds, files, faults):
    end, samples = time.monotonic() + seconds, []
    threads = [threading.Thread(target=work_for, args=(daemon, end, seed, files, faults)) for seed in range(4)]
    for thread in threads:
        thread.start()
    while time.monotonic() < end:
        time.sleep(seconds / 50)
        samples.append(daemon.resident())
    for thread in threads:
        thread.join()
    middle, last = samples[len(samples) // 4:len(samples) // 2], samples[-len(samples) // 4:]
    growth = sum(last) / len(last) - sum(middle) / len(middle)
    yield {"name": "soak", "what": f"growth of memory in a soak of {seconds} s", "figure": growth, "unit": "MiB",
           "note": f"at {sum(last) / len(last):.0f} MiB in the last quarter"}


# ---- all ----


def measure(settings, say, faults):
    folder = pathlib.Path(tempfile.mkdtemp(prefix="service-", dir=meshes.ROOT / "build/bench"))
    daemon = Daemon(folder, "--streams", 2 * STREAMS, "--heartbeat", 60)
    try:
        quick = settings.runs == 1
        obj, ply = write_files(40)
        spheres = [daemon.upload(shapes.ply_little(shapes.sphere(turn)))["id"] for turn in (0.0, shapes.SPHERE_TURN)]
        heap = shapes.crumpled(1500, seed=1)
        # Two grids of one heap of folded patches, one raised: to prove their distance takes many minutes.
        slow = [daemon.upload(shapes.ply_little(mesh))["id"]
                for mesh in (shapes.cut(heap, 2), shapes.moved(shapes.cut(heap, 3), 0, 0, 1 / 512))]
        say("service: requests")
        yield from bench_requests(daemon, folder, 3 if quick else 10, spheres)
        say("service: streams")
        yield from bench_streams(daemon, slow)
        say("service: small jobs beside endless ones")
        yield from bench_small_jobs(daemon, slow, 100 if quick else 500)
        say("service: projections beside uploads")
        yield from bench_beside_uploads(daemon, spheres[0], 200 if quick else 1000, faults)
        say("service: uploads")
        yield from bench_uploads(daemon, 600 if quick else 800, 3 if quick else 5)
        say("service: soak")
        yield from bench_soak(daemon, 20 if quick else 300, [obj, ply], faults)
    finally:
        if daemon.stop() != 0:
            faults.append("service: the daemon did not stop as it should")
        shutil.rmtree(folder)


def run(settings, programs, pairs, say):
    faults = []
    if not shutil.which("wrk"):
        print("Left out: service, for which wrk is missing.")
        return [], faults
    rows = list(measure(settings, say, faults))
    print("### The daemon under load\n")
    shown = [[row["what"], tables.ms(row["figure"]) if row["figure"] < 1000 else f"{row['figure']:.0f}", row["unit"],
              str(GOALS.get(row["name"]) or ""), row["note"]] for row in rows]
    print(tables.table(["what", "figure:", "unit", "goal:", "besides"], shown))
    return rows, faults
