#!/usr/bin/env python3
"""Makes the demo's models with nothing but Python itself.

models.py sphere TURN OUT.off [N]    a sphere of quads, turned about its axis by TURN radians; N times finer both ways
models.py coarsen IN.obj OUT.obj N   IN with one vertex for each cell of a grid, N cells along the longest side
models.py ring N OUT.xyz OUT.json    N random points of a wavy ring, and a layout of 12 patches drawn over it
"""
import json
import math
import random
import sys

PARALLELS = 49  # latitudes pi * i / 50; the poles stay open
MERIDIANS = 100


def write_sphere(turn, path, finer=1):
    """The unit sphere as quads between its parallels and meridians."""
    bands, meridians = finer * (PARALLELS + 1), finer * MERIDIANS
    with open(path, "w", encoding="ascii") as out:
        out.write(f"OFF\n{(bands - 1) * meridians} {(bands - 2) * meridians} 0\n")
        for i in range(1, bands):
            polar = math.pi * i / bands
            for j in range(meridians):
                azimuth = 2.0 * math.pi * j / meridians + turn
                x, y = math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth)
                out.write(f"{x!r} {y!r} {math.cos(polar)!r}\n")
        for i in range(bands - 2):
            for j in range(meridians):
                here, below = i * meridians, (i + 1) * meridians
                k = (j + 1) % meridians
                out.write(f"4 {here + j} {below + j} {below + k} {here + k}\n")


def read_obj(path):
    """Vertices and triangles (indices from 0) of an OBJ file that holds nothing but triangles."""
    vertices, triangles = [], []
    with open(path, encoding="ascii") as lines:
        for line in lines:
            words = line.split()
            if words[:1] == ["v"]:
                vertices.append(tuple(float(word) for word in words[1:4]))
            elif words[:1] == ["f"]:
                triangles.append(tuple(int(word.split("/")[0]) - 1 for word in words[1:4]))
    return vertices, triangles


def cluster(vertices, cells):
    """The cell of each vertex as an index, and the mean of the vertices of each cell."""
    low = [min(v[axis] for v in vertices) for axis in range(3)]
    size = max(max(v[axis] for v in vertices) - low[axis] for axis in range(3)) / cells
    index_of_cell, members, cell_of_vertex = {}, [], []
    for vertex in vertices:
        cell = tuple(math.floor((vertex[axis] - low[axis]) / size) for axis in range(3))
        index = index_of_cell.setdefault(cell, len(members))
        if index == len(members):
            members.append([])
        members[index].append(vertex)
        cell_of_vertex.append(index)
    means = [tuple(sum(v[axis] for v in group) / len(group) for axis in range(3)) for group in members]
    return cell_of_vertex, means


def coarsen(source, path, cells):
    """Vertex clustering: triangles whose corners fall into three cells stay, each once."""
    vertices, triangles = read_obj(source)
    cell_of_vertex, means = cluster(vertices, cells)
    kept = {}
    for triangle in triangles:
        corners = tuple(cell_of_vertex[vertex] for vertex in triangle)
        if len(set(corners)) == 3:
            kept.setdefault(frozenset(corners), corners)
    # A cell whose triangles all collapsed is left without a face, and so without a vertex.
    used = sorted({corner for corners in kept.values() for corner in corners})
    number = {corner: place + 1 for place, corner in enumerate(used)}
    with open(path, "w", encoding="ascii") as out:
        for corner in used:
            out.write("v {!r} {!r} {!r}\n".format(*means[corner]))
        for corners in kept.values():
            out.write("f {} {} {}\n".format(*(number[corner] for corner in corners)))


def on_ring(u, v):
    """A ring whose tube swells three times on its way round; u and v go from 0 to 1 round ring and tube."""
    around, across = 2.0 * math.pi * u, 2.0 * math.pi * v
    tube = 0.35 + 0.1 * math.cos(3.0 * around)
    reach = 1.0 + tube * math.cos(across)
    return reach * math.cos(around), reach * math.sin(around), tube * math.sin(across)


def write_ring(count, points, layout, columns=6, rows=2, pieces=24):
    """The points have no order, no normals and no faces; patches are not named, so that they are to be found."""
    chance = random.Random(7)
    with open(points, "w", encoding="ascii") as out:
        for _ in range(count):
            out.write("{!r} {!r} {!r}\n".format(*on_ring(chance.random(), chance.random())))
    curves = []
    for i in range(columns):
        for j in range(rows):
            for di, dj in ((1, 0), (0, 1)):
                steps = [k / pieces for k in range(pieces + 1)]
                line = [on_ring((i + di * t) / columns, (j + dj * t) / rows) for t in steps]
                start, end = i * rows + j, (i + di) % columns * rows + (j + dj) % rows
                line[-1] = on_ring(end // rows / columns, end % rows / rows)
                curves.append({"id": len(curves), "from": start, "to": end, "points": line})
    nodes = [on_ring(i / columns, j / rows) for i in range(columns) for j in range(rows)]
    with open(layout, "w", encoding="ascii") as out:
        json.dump({"nodes": nodes, "curves": curves}, out)


def main(arguments):
    if len(arguments) in (3, 4) and arguments[0] == "sphere":
        write_sphere(float(arguments[1]), arguments[2], *map(int, arguments[3:]))
    elif len(arguments) == 4 and arguments[0] == "coarsen":
        coarsen(arguments[1], arguments[2], int(arguments[3]))
    elif len(arguments) == 4 and arguments[0] == "ring":
        write_ring(int(arguments[1]), arguments[2], arguments[3])
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
