"""CloudCompare's command line: iterative closest points of a mesh's samples, from its centroid on that of the other one.

peer_cloudcompare.py align A B MOTIONS   A, moved by each of the first two motions, onto B
peer_cloudcompare.py version
"""
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import numpy

import measure

MOTIONS = 2  # an alignment takes up to a minute
POINTS = 16384
NEAR, EXACT = 1e-2, 1e-6
PROGRAM = "CloudCompare"


def write_ply(path, vertices, triangles):
    faces = numpy.empty(len(triangles), dtype=[("count", "u1"), ("corner", "<i4", 3)])
    faces["count"], faces["corner"] = 3, triangles
    head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty double x\nproperty double y\n"
            f"property double z\nelement face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
    path.write_bytes(head.encode("ascii") + vertices.astype("<f8").tobytes() + faces.tobytes())


def command(folder, *words):
    """Runs the program without a window; returns its seconds and what it printed."""
    start = time.perf_counter()
    done = subprocess.run([PROGRAM, "-SILENT", "-NO_TIMESTAMP", "-AUTO_SAVE", "OFF", *words], cwd=folder, check=True,
                          capture_output=True, text=True, env=os.environ | {"QT_QPA_PLATFORM": "offscreen"})
    return time.perf_counter() - start, done.stdout + done.stderr


def align(prefix_a, prefix_b, motions_path):
    vertices, triangles = measure.read_mesh(prefix_a)
    others, other_triangles = measure.read_mesh(prefix_b)
    diagonal = float(numpy.linalg.norm(others.max(0) - others.min(0)))
    motions = numpy.fromfile(motions_path).reshape(-1, 4, 4).transpose(0, 2, 1)[:MOTIONS]
    resting_kb = measure.rest()
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        write_ply(folder / "b.ply", others, other_triangles)

        def find(name, motion):
            """The motion that it finds, after the one that puts the centroid of A where that of B is; and its seconds."""
            moved = vertices @ motion[:3, :3].T + motion[:3, 3]
            shift = others.mean(0) - moved.mean(0)
            write_ply(folder / f"{name}.ply", moved + shift, triangles)
            load = ["-O", f"{name}.ply", "-O", "b.ply"]
            idle, _ = command(folder, *load)
            seconds, said = command(folder, *load, "-ICP", "-RANDOM_SAMPLING_LIMIT", str(POINTS))
            found = numpy.eye(4)
            matrix = folder / f"{name}_REGISTRATION_MATRIX.txt"
            if matrix.exists():
                found = numpy.loadtxt(matrix)
            elif "[ICP]" not in said:
                sys.exit(f"error: no alignment: {said[-200:]}")
            found[:3, 3] += found[:3, :3] @ shift
            whole = found @ motion
            return vertices @ whole[:3, :3].T + whole[:3, 3], seconds - idle

        still, _ = find("still", numpy.eye(4))
        times, placed, exact = [], 0, 0
        for i, motion in enumerate(motions):
            at, seconds = find(f"m{i}", motion)
            times.append(1e3 * max(seconds, 0.0))
            placed += numpy.linalg.norm(at - vertices, axis=1).max() <= NEAR * diagonal
            exact += numpy.linalg.norm(at - still, axis=1).max() <= EXACT * diagonal
    measure.tell({"motions": len(motions), "placed": int(placed), "exact": int(exact), "build_ms": [0.0] * len(times),
                  "query_ms": times, "resting_kb": resting_kb, "peak_kb": measure.memory_kb("VmHWM")})


def version():
    words = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", "cloudcompare"], check=True, capture_output=True,
                           text=True).stdout
    measure.tell({"version": re.sub("-.*", "", words)})


if __name__ == "__main__":
    measure.main(align=align, version=version)
