"""Instant Meshes: a mesh of quads.

peer_instant.py remesh MESH QUADS OUT
"""
import pathlib
import time

import numpy
import pynanoinstantmeshes

import measure


def remesh(prefix, quads, out):
    vertices, triangles = measure.read_mesh(prefix)
    start = time.monotonic()
    # What it extracts has other faces too: it cuts every face into quads at the end, about four each.
    positions, faces = pynanoinstantmeshes.remesh(vertices.astype(numpy.float32), triangles.astype(numpy.uint32),
                                                  max(int(quads) // 4, 1), creaseAngle=40.0, align_to_boundaries=True,
                                                  smooth_iter=2, deterministic=True)
    seconds = time.monotonic() - start
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in positions]
    lines += ["f " + " ".join(str(corner + 1) for corner in dict.fromkeys(face.tolist())) + "\n" for face in faces]
    pathlib.Path(out).write_text("".join(lines), encoding="ascii")
    measure.tell({"seconds": seconds})


if __name__ == "__main__":
    measure.main(remesh=remesh)
