"""The command line and a daemon, from the folder QM_BUILD (default: build), and small meshes by formula."""

import math
import os
import pathlib
import random
import subprocess
import sys
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("QM_BUILD", ROOT / "build")).resolve()
sys.path.append(str(ROOT / "tests" / "api"))  # shapes


def write_torus(path, columns, rows, minor, turn=0.0):
    """An OBJ file of columns x rows quads on the torus of radii 1 and minor."""
    lines = []
    for i in range(columns):
        for j in range(rows):
            u = 2 * math.pi * (i + turn) / columns
            v = 2 * math.pi * (j + turn) / rows
            ring = 1 + minor * math.cos(v)
            lines.append(f"v {ring * math.cos(u)!r} {ring * math.sin(u)!r} {minor * math.sin(v)!r}")
    for i in range(columns):
        for j in range(rows):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            lines.append("f " + " ".join(str(x % columns * rows + y % rows + 1) for x, y in corners))
    path.write_text("\n".join(lines) + "\n")
    return path


def write_box(path, half, shift=(0, 0, 0), faces=6):
    """An OBJ file of a cube of quads about a point; fewer than six faces leave it open."""
    corners = [[half * (1 if bits >> k & 1 else -1) + shift[k] for k in range(3)] for bits in range(8)]
    quads = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)][:faces]
    path.write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in corners) +
                    "".join("f " + " ".join(map(str, quad)) + "\n" for quad in quads))
    return path


@pytest.fixture
def quadmesh(tmp_path):
    """Runs `quadmesh` with arguments; keywords go to subprocess.run."""

    def run(*arguments, **options):
        options = {"capture_output": True, "text": True, "timeout": 60, "cwd": tmp_path} | options
        return subprocess.run([BUILD / "quadmesh", *map(str, arguments)], **options)

    run.program = BUILD / "quadmesh"
    return run


@pytest.fixture
def square(tmp_path):
    path = tmp_path / "square.obj"
    path.write_text("v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nf 1 2 3 4\n")
    return path


@pytest.fixture
def raised(tmp_path):
    """The square one unit higher: the distance between the two is exactly 1."""
    path = tmp_path / "raised.obj"
    path.write_text("v 0 0 1\nv 2 0 1\nv 2 2 1\nv 0 2 1\nf 1 2 3 4\n")
    return path


def write_heap(path, raised, count):
    """An OBJ file of quads at random whose bilinear patches fold over, each cut in count x count, all of them raised by
    this much."""
    chance = random.Random(1)
    lines = []
    for quad in range(1500):
        corner = [chance.uniform(0, 3) for _ in range(2)] + [chance.uniform(0, 3) + raised]
        right, up, push = ([chance.gauss(0, 0.3) for _ in range(3)] for _ in range(3))
        for j in range(count + 1):
            for i in range(count + 1):
                u, v = i / count, j / count
                x, y, z = (corner[k] + u * right[k] + v * up[k] + 2 * u * v * push[k] for k in range(3))
                lines.append(f"v {x!r} {y!r} {z!r}")
        first = (count + 1) ** 2 * quad + 1
        for j in range(count):
            for i in range(count):
                at = first + j * (count + 1) + i
                lines.append(f"f {at} {at + 1} {at + count + 2} {at + count + 1}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def slow_pair(tmp_path):
    """Two heaps of folded patches in two grids, one above the other: as bilinear patches they take many minutes."""
    return write_heap(tmp_path / "slow_a.obj", 0, 2), write_heap(tmp_path / "slow_b.obj", 1 / 512, 3)


@pytest.fixture
def large_pair(tmp_path):
    """Two tori of eighty thousand quads each."""
    return (
        write_torus(tmp_path / "large_a.obj", 400, 200, 0.3),
        write_torus(tmp_path / "large_b.obj", 401, 201, 0.31, 0.37),
    )


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """The address of a daemon of our own."""
    folder = tmp_path_factory.mktemp("daemon")
    port_file = folder / "port"
    with open(folder / "log", "wb") as log:
        daemon = subprocess.Popen(
            [BUILD / "quadmeshd", "--port", "0", "--port-file", port_file, "--data-dir", folder / "data"],
            stdout=log,
            stderr=log,
        )
    try:
        end = time.monotonic() + 20
        while not (port_file.exists() and port_file.read_text().strip()):
            assert daemon.poll() is None, (folder / "log").read_text()
            assert time.monotonic() < end, "the daemon does not come up"
            time.sleep(0.02)
        yield f"http://127.0.0.1:{port_file.read_text().strip()}"
    finally:
        daemon.terminate()
        assert daemon.wait(20) == 0


@pytest.fixture(params=["here", "there"])
def where(request):
    """The options that ask this process or a daemon."""
    if request.param == "here":
        return []
    return ["--server", request.getfixturevalue("server")]
