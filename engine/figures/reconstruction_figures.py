#!/usr/bin/env python3
"""Draws the figures of engine/RECONSTRUCTION.md as SVG files beside this script.

Shapes are computed: lattices are Coons patches of the curves that are drawn, and the moving least squares curve is the true
projection of the engine (one step, polynomial of second order) in the plane.

usage: engine/figures/reconstruction_figures.py
"""
import math
import random

from drawing import Figure


def mix(a, b, t):
    return tuple(x + t * (y - x) for x, y in zip(a, b))


def bezier(points, count=24):
    """A Bezier curve as a polyline."""
    def at(t):
        level = points
        while len(level) > 1:
            level = [mix(p, q, t) for p, q in zip(level, level[1:])]
        return level[0]
    return [at(i / count) for i in range(count + 1)]


def along(curve, t):
    """The point of a polyline with equal parameter steps at a parameter."""
    x = t * (len(curve) - 1)
    i = min(int(x), len(curve) - 2)
    return mix(curve[i], curve[i + 1], x - i)


def coons(bottom, right, top, left, u, v):
    """Two ruled surfaces less the bilinear patch of the corners; top and left run as bottom and right do."""
    ruled = mix(along(bottom, u), along(top, u), v)
    other = mix(along(left, v), along(right, v), u)
    corners = mix(mix(bottom[0], bottom[-1], u), mix(top[0], top[-1], u), v)
    return tuple(a + b - c for a, b, c in zip(ruled, other, corners))


def stages():
    """A stroke, the arrangement of the curves, the lattice of a patch, the mesh."""
    figure = Figure(760, 235)
    bottom = bezier([(0, 118), (50, 140), (110, 105), (150, 122)])
    right = bezier([(150, 122), (163, 90), (138, 50), (146, 8)])
    top = bezier([(8, 0), (50, 16), (100, -8), (146, 8)])
    left = bezier([(0, 118), (-14, 80), (16, 40), (8, 0)])
    middle = bezier([(70, 124), (62, 80), (92, 50), (76, 3)])

    def shift(curve, x):
        return [(px + x, py + 45) for px, py in curve]

    def outline(x):
        for curve in (bottom, right, top, left, middle):
            figure.path(shift(curve, x), 'target')

    noise = random.Random(3)
    stroke = [(x + noise.uniform(-2, 2), y + noise.uniform(-2, 2)) for x, y in bezier([(78, 138), (58, 80), (94, 50), (70, -10)])]
    for curve in (bottom, right, top, left):
        figure.path(shift(curve, 25), 'target')
    figure.path(shift(stroke, 25), 'source')
    figure.text(100, 25, '1. A stroke crosses two curves', 'middle')
    outline(215)
    for x, y in (bottom[0], right[0], right[-1], top[0], middle[0], middle[-1]):
        figure.dot((x + 215, y + 45), 'targetfill', 3.5)
    figure.text(248, 112, 'patch 0', 'middle', 'small')
    figure.text(324, 112, 'patch 1', 'middle', 'small')
    figure.text(290, 25, '2. Faces of four sides', 'middle')

    def lattice(x, columns, rows, kind, from_u, to_u):
        def at(u, v):
            px, py = coons(bottom, right, top, left, u, v)
            return px + x, py + 45
        for i in range(columns + 1):
            u = from_u + (to_u - from_u) * i / columns
            figure.path([at(u, k / 16) for k in range(17)], kind)
        for j in range(rows + 1):
            figure.path([at(from_u + (to_u - from_u) * k / 16, j / rows) for k in range(17)], kind)

    lattice(405, 16, 8, 'thin', 0, 1)
    outline(405)
    figure.text(480, 25, '3. Lattices: 8 edges a side', 'middle')
    lattice(595, 4, 2, 'target', 0, 1)
    figure.text(670, 25, '4. Mesh after two steps', 'middle')
    figure.text(380, 215, 'The lattices are finer than the first meshes, which take every n-th of their vertices.', 'middle', 'small')
    figure.save('reconstruction_stages')


def solve(matrix, right):
    """Gauss elimination of a small system."""
    n = len(right)
    rows = [list(row) + [value] for row, value in zip(matrix, right)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(n):
            if i != k:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k])]
    return [rows[i][n] / rows[i][i] for i in range(n)]


def project(points, p, count):
    """One step of the projection: nearest points, weighted line, polynomial of second order. Returns all that the figure draws."""
    near = sorted(points, key=lambda q: math.dist(p, q))[:count]
    nearest = near[0]
    radius = max(math.dist(q, nearest) for q in near)
    weight = [(1 - math.dist(q, nearest) ** 2 / (1.2 * radius ** 2)) ** 2 for q in near]
    total = sum(weight)
    centroid = tuple(sum(w * q[k] for w, q in zip(weight, near)) / total for k in range(2))
    cov = [sum(w * (q[i] - centroid[i]) * (q[j] - centroid[j]) for w, q in zip(weight, near)) for i, j in ((0, 0), (0, 1), (1, 1))]
    angle = 0.5 * math.atan2(2 * cov[1], cov[0] - cov[2])
    tangent, normal = (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))
    dot = lambda a, b: a[0] * b[0] + a[1] * b[1]
    minus = lambda a, b: (a[0] - b[0], a[1] - b[1])
    height = dot(minus(p, centroid), normal)
    base = (p[0] - height * normal[0], p[1] - height * normal[1])
    matrix, right = [[0.0] * 3 for _ in range(3)], [0.0] * 3
    for w, q in zip(weight, near):
        a, h = dot(minus(q, base), tangent), dot(minus(q, base), normal)
        row = (1, a, a * a)
        for i in range(3):
            right[i] += w * row[i] * h
            for j in range(3):
                matrix[i][j] += w * row[i] * row[j]
    x = solve(matrix, right)
    lift = lambda a: tuple(base[k] + a * tangent[k] + (x[0] + a * x[1] + a * a * x[2]) * normal[k] for k in range(2))
    return near, weight, base, tangent, radius, lift


def moving_least_squares():
    """A noisy point set, a point, its line, the polynomial, and the projection."""
    figure = Figure(640, 265)
    noise = random.Random(11)
    arc = lambda x: (x, 235 - 175 * math.sin(math.pi * x / 640))
    points = [(x, arc(x)[1] + noise.gauss(0, 4)) for x in range(20, 625, 14)]
    p = (350, 18)
    near, weight, base, tangent, radius, lift = project(points, p, 19)
    surface = [project(points, arc(x), 19)[5](0) for x in range(35, 610, 8)]
    figure.path(surface, 'target')
    figure.path([(base[0] + s * 1.4 * radius * tangent[0], base[1] + s * 1.4 * radius * tangent[1]) for s in (-1, 1)], 'dash')
    figure.path([lift(radius * k / 10) for k in range(-12, 13)], 'source')
    for q in points:
        figure.dot(q, 'targetfill', 2)
    for q, w in zip(near, weight):
        figure.circle(q, 3 + 6 * w, 'set')
    figure.arrow(p, base)
    figure.arrow(base, lift(0))
    figure.dot(p, 'sourcefill')
    figure.dot(lift(0), 'sourcefill')
    figure.text(p[0] + 10, p[1] + 4, 'p')
    figure.text(lift(0)[0], lift(0)[1] + 30, 'projection of p', 'middle')
    figure.text(base[0] + 1.1 * radius, base[1] - 10, 'plane of the neighbours', 'start', 'small')
    figure.text(320, 250, 'Circles: weights. Red: the polynomial that is fitted for p. Blue: all projections together, the surface of the '
                          'point set.', 'middle', 'small')
    figure.save('moving_least_squares')


def chords():
    """One chord of a layout before and after its doubling."""
    figure = Figure(640, 250)
    nodes = {(i, j): (20 + 62 * i + 9 * math.sin(1.7 * j + i), 30 + 52 * j + 9 * math.sin(1.3 * i + j)) for i in range(5) for j in range(4)}

    def draw(x, doubled):
        move = lambda q: (q[0] + x, q[1])
        for j in range(4):
            figure.path([move(nodes[i, j]) for i in range(5)], 'thin')
        for i in range(5):
            figure.path([move(nodes[i, j]) for j in range(4)], 'thin')
        for i in range(5):
            figure.path([move(nodes[i, 1]), move(nodes[i, 2])], 'source')
        if doubled:
            figure.path([move(mix(nodes[i, 1], nodes[i, 2], 0.5)) for i in range(5)], 'source')
        for q in nodes.values():
            figure.dot(move(q), 'targetfill', 3)

    draw(10, False)
    draw(340, True)
    figure.text(150, 225, 'the five curves of one chord', 'middle', 'small')
    figure.text(480, 225, 'doubled: each patch along it has one more row', 'middle', 'small')
    figure.save('chords')


def main():
    stages()
    moving_least_squares()
    chords()


if __name__ == '__main__':
    main()
