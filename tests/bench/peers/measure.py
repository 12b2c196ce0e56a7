"""How a peer in Python measures itself: the same rules as measure.h and arrays.h beside it."""
import ctypes
import json
import pathlib
import sys
import time

import numpy

REPEATS = 5
ENOUGH_MS = 500.0
CHECK_STEP = 997


def read_mesh(prefix):
    """Vertices as rows of doubles and triangles as rows of 32-bit indices."""
    vertices = numpy.fromfile(f"{prefix}.vertices", dtype=numpy.float64).reshape(-1, 3)
    triangles = numpy.fromfile(f"{prefix}.triangles", dtype=numpy.int32).reshape(-1, 3)
    return vertices, triangles


def read_points(path):
    return numpy.fromfile(path, dtype=numpy.float64).reshape(-1, 3)


def memory_kb(key):
    """A line of /proc/self/status such as VmHWM."""
    for line in pathlib.Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(key + ":"):
            return int(line.split()[1])
    return 0


def rest():
    """Gives back what reading left over and resets the peak; returns the kilobytes held."""
    ctypes.CDLL(None).malloc_trim(0)
    pathlib.Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return memory_kb("VmRSS")


def tell_pairs(a, b):
    """Pairs of faces as pair_print.h prints them; a and b are arrays of indices."""
    pairs = numpy.unique(a.astype(numpy.uint64) << numpy.uint64(32) | b.astype(numpy.uint64))
    mixed = (pairs ^ pairs >> numpy.uint64(30)) * numpy.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ mixed >> numpy.uint64(27)) * numpy.uint64(0x94D049BB133111EB)
    mixed ^= mixed >> numpy.uint64(31)
    return {"pairs": len(pairs), "sum": f"{int(mixed.sum(dtype=numpy.uint64)):016x}"}


def tell(answer):
    json.dump(answer, sys.stdout)
    print()


def measure(build, query):
    """Runs build() and query(what build gave) until the times are worth a median, and prints them.

    query returns what makes what else the reply holds: bounds, distances of points, or pairs of faces.
    """
    resting_kb = rest()
    build_ms, query_ms = [], []
    while not build_ms or (len(build_ms) < REPEATS and sum(build_ms) + sum(query_ms) < ENOUGH_MS):
        start = time.perf_counter()
        built = build()
        middle = time.perf_counter()
        answer = query(built)
        end = time.perf_counter()
        build_ms.append(1e3 * (middle - start))
        query_ms.append(1e3 * (end - middle))
    tell({"build_ms": build_ms, "query_ms": query_ms, "resting_kb": resting_kb, "peak_kb": memory_kb("VmHWM")} | answer())


def main(**commands):
    """Calls the command that the first argument names with the others."""
    command = commands.get(sys.argv[1]) if len(sys.argv) > 1 else None
    if command is None:
        sys.exit(f"usage: {sys.argv[0]} {'|'.join(commands)} ...")
    command(*sys.argv[2:])
