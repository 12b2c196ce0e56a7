#!/usr/bin/env python3
"""Makes a layout of a closed mesh of quads: the cuts that run on straight from its irregular vertices.

Usage: layout_of_quads.py QUADS.obj LAYOUT.json

Each cut ends at an irregular vertex; where cuts meet or cross is a node. All cells between them have four sides.
"""
import argparse
import collections
import json
import pathlib
import sys


def read_obj(path):
    vertices, quads = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            quads.append([int(word.split("/")[0]) - 1 for word in words[1:]])
    if any(len(quad) != 4 for quad in quads):
        sys.exit(f"{path}: not all faces are quads")
    return vertices, quads


def find_cuts(quads):
    """Nodes, and curves as vertices in turn."""
    quad_of, degree = {}, collections.Counter()
    for number, quad in enumerate(quads):
        for k in range(4):
            quad_of[quad[k], quad[k - 3]] = (number, k)
            degree[quad[k]] += 1
    if any((b, a) not in quad_of for a, b in quad_of):
        raise ValueError("the mesh is not closed, or its faces do not turn the same way")

    def straight_on(a, b):
        """The vertex after a, b: over the edge to the left of b, then on."""
        quad, k = quad_of[a, b]
        quad, k = quad_of[quads[quad][k - 2], b]
        return quads[quad][k - 2]

    edges = set()
    for start, on in list(quad_of):
        a, b = start, on
        while degree[start] != 4 and (a, b) not in edges:
            edges.update(((a, b), (b, a)))
            if degree[b] != 4:
                break
            a, b = b, straight_on(a, b)
    ends = collections.defaultdict(list)
    for a, b in sorted(edges):
        ends[a].append(b)
    nodes = [v for v in sorted(ends) if degree[v] != 4 or len(ends[v]) > 2]
    is_node, curves, drawn = set(nodes), [], set()
    for node in nodes:
        for other in ends[node]:
            if (node, other) in drawn:
                continue
            curve = [node, other]
            while curve[-1] not in is_node:
                curve.append(straight_on(curve[-2], curve[-1]))
            drawn.update(((node, other), (curve[-1], curve[-2])))
            curves.append(curve)
    return nodes, curves


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("quads", type=pathlib.Path)
    parser.add_argument("layout", type=pathlib.Path)
    words = parser.parse_args()
    vertices, quads = read_obj(words.quads)
    try:
        nodes, curves = find_cuts(quads)
    except ValueError as error:
        sys.exit(f"{words.quads}: {error}")
    if not nodes:
        sys.exit(f"{words.quads}: no vertex is irregular, so that there is no cut")
    place = {node: i for i, node in enumerate(nodes)}
    layout = {"nodes": [vertices[node] for node in nodes],
              "curves": [{"id": i, "from": place[curve[0]], "to": place[curve[-1]],
                          "points": [vertices[vertex] for vertex in curve]} for i, curve in enumerate(curves)]}
    words.layout.write_text(json.dumps(layout, separators=(",", ":")) + "\n")
    print(f"{words.layout}: {len(nodes)} nodes, {len(curves)} curves")


if __name__ == "__main__":
    main()
