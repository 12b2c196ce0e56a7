#!/usr/bin/env python3
"""Draws a layout from a sketch: nodes near a surface, and which of them curves join.

Usage: draw_layout.py SURFACE.obj SKETCH.json LAYOUT.json [--server URL]

SKETCH.json: {"nodes": {NAME: [x, y, z]}, "curves": [[NAME, NAME], [NAME, NAME, [x, y, z], ...]]}; the points after
the names are places that the curve goes through. A curve takes about the shortest way along the surface: Dijkstra's
over the vertices and the middles of the edges, then straightened by turns of evening it out and projecting it. The
daemon projects, finds the patches, and says what is amiss. SURFACE.obj holds triangles.
"""
import argparse
import array
import heapq
import json
import math
import pathlib
import sys
import urllib.request

ROUNDS = 30      # of straightening
SPACING = 0.012  # of a curve's points, as a share of the longest side of the surface's box
DIGITS = 5


def read_obj(path):
    vertices, triangles = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append(tuple(float(word) for word in words[1:4]))
        elif words[:1] == ["f"]:
            triangles.append([int(word.split("/")[0]) - 1 for word in words[1:]])
    if any(len(triangle) != 3 for triangle in triangles):
        sys.exit(f"{path}: not all faces are triangles")
    return vertices, triangles


def make_graph(vertices, triangles):
    """Vertices and middles of edges; each triangle joins its six."""
    points, middle, links = list(vertices), {}, [{} for _ in vertices]
    for triangle in triangles:
        own = list(triangle)
        for a, b in zip(triangle, triangle[1:] + triangle[:1]):
            key = (min(a, b), max(a, b))
            if key not in middle:
                middle[key] = len(points)
                points.append(tuple((s + t) / 2 for s, t in zip(vertices[a], vertices[b])))
                links.append({})
            own.append(middle[key])
        for a in own:
            for b in own:
                if a != b:
                    links[a][b] = math.dist(points[a], points[b])
    return points, links


def nearest(points, place):
    return min(range(len(points)), key=lambda i: math.dist(points[i], place))


def shortest_way(points, links, start, end):
    length, before, heap = {start: 0.0}, {}, [(0.0, start)]
    while heap:
        done, at = heapq.heappop(heap)
        if at == end:
            break
        if done > length[at]:
            continue
        for other, step in links[at].items():
            if done + step < length.get(other, math.inf):
                length[other], before[other] = done + step, at
                heapq.heappush(heap, (done + step, other))
    if end not in length:
        sys.exit(f"no way along the surface from {points[start]} to {points[end]}")
    way = [end]
    while way[-1] != start:
        way.append(before[way[-1]])
    return [points[i] for i in reversed(way)]


def resample(way, spacing):
    """Points at equal steps along a polyline."""
    arc = [0.0]
    for a, b in zip(way, way[1:]):
        arc.append(arc[-1] + math.dist(a, b))
    count, out, piece = max(2, math.ceil(arc[-1] / spacing)), [], 0
    for k in range(count + 1):
        wanted = arc[-1] * k / count
        while piece + 2 < len(arc) and arc[piece + 1] < wanted:
            piece += 1
        step = arc[piece + 1] - arc[piece]
        share = min(1.0, (wanted - arc[piece]) / step) if step > 0 else 0.0
        out.append(tuple(s + share * (t - s) for s, t in zip(way[piece], way[piece + 1])))
    return out


class Daemon:
    def __init__(self, url, surface):
        self.url = url
        self.mesh = json.loads(self.send("/v1/meshes?format=obj", surface.read_bytes()))["id"]

    def send(self, path, body):
        request = urllib.request.Request(self.url + path, body, {"Content-Type": "application/octet-stream"})
        try:
            return urllib.request.urlopen(request).read()
        except urllib.error.HTTPError as error:
            sys.exit(f"{path}: {error.read().decode()}")

    def project(self, points):
        rows = array.array("d", (x for point in points for x in point))
        feet = array.array("d", self.send(f"/v1/meshes/{self.mesh}/project", rows.tobytes()))
        return [tuple(feet[i + 1:i + 4]) for i in range(0, len(feet), 7)]

    def check(self, layout):
        request = urllib.request.Request(self.url + "/v1/layouts", json.dumps({"mesh": self.mesh, **layout}).encode(),
                                         {"Content-Type": "application/json"})
        try:
            return json.load(urllib.request.urlopen(request))
        except urllib.error.HTTPError as error:
            sys.exit(f"the layout was refused: {error.read().decode()}")


def straighten(daemon, ways):
    """Evens all ways out within the surface; their ends stay."""
    for _ in range(ROUNDS):
        inner = []
        for way in ways:
            for a, b, c in zip(way, way[1:], way[2:]):
                inner.append(tuple((p + 2 * q + r) / 4 for p, q, r in zip(a, b, c)))
        feet = iter(daemon.project(inner))
        ways = [[way[0]] + [next(feet) for _ in way[2:]] + [way[-1]] for way in ways]
    return ways


def draw(daemon, surface, sketch):
    vertices, triangles = read_obj(surface)
    points, links = make_graph(vertices, triangles)
    spacing = SPACING * max(max(axis) - min(axis) for axis in zip(*vertices))
    names = list(sketch["nodes"])
    nodes = dict(zip(names, daemon.project(list(sketch["nodes"].values()))))
    pieces, owner = [], []
    for number, (start, end, *through) in enumerate(sketch["curves"]):
        stops = [nodes[start], *(daemon.project(through) if through else []), nodes[end]]
        for a, b in zip(stops, stops[1:]):
            way = shortest_way(points, links, nearest(points, a), nearest(points, b))
            pieces.append(resample([a, *way[1:-1], b], spacing))
            owner.append(number)
    curves = [[] for _ in sketch["curves"]]
    for number, way in zip(owner, straighten(daemon, pieces)):
        curves[number].extend(way[1:] if curves[number] else way)
    rounded = [[[round(x, DIGITS) for x in point] for point in curve] for curve in curves]
    place = {name: i for i, name in enumerate(names)}
    return {"nodes": [[round(x, DIGITS) for x in nodes[name]] for name in names],
            "curves": [{"id": i, "from": place[start], "to": place[end], "points": rounded[i]}
                       for i, (start, end, *_) in enumerate(sketch["curves"])]}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surface", type=pathlib.Path)
    parser.add_argument("sketch", type=pathlib.Path)
    parser.add_argument("layout", type=pathlib.Path)
    parser.add_argument("--server", default="http://127.0.0.1:8080")
    words = parser.parse_args()
    daemon = Daemon(words.server, words.surface)
    layout = draw(daemon, words.surface, json.loads(words.sketch.read_text()))
    found = daemon.check(layout)
    for issue in found["issues"]:
        print(issue["detail"], file=sys.stderr)
    layout["patches"] = found["patches"]
    words.layout.write_text(json.dumps(layout, separators=(",", ":")) + "\n")
    print(f"{words.layout}: {len(layout['nodes'])} nodes, {len(layout['curves'])} curves, {len(layout['patches'])} patches")


if __name__ == "__main__":
    main()
