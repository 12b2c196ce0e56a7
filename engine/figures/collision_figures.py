#!/usr/bin/env python3
"""Draws the figures of engine/COLLISION.md as SVG files beside this script.

Shapes are computed, not traced: intervals are those of the triangles on the common line, kept faces those of the grid.

usage: engine/figures/collision_figures.py
"""
import math

from drawing import Figure

STYLE = """
.sourceface { stroke: #c0392b; fill: #c0392b; fill-opacity: .14; stroke-width: 1.5 }
.targetface { stroke: #1f5fa8; fill: #1f5fa8; fill-opacity: .14; stroke-width: 1.5 }
.sourcewide { stroke: #c0392b; fill: none; stroke-width: 5; stroke-opacity: .75 }
.targetwide { stroke: #1f5fa8; fill: none; stroke-width: 5; stroke-opacity: .75 }
@media (prefers-color-scheme: dark) {
.sourcewide { stroke: #ff7b6b } .sourceface { stroke: #ff7b6b; fill: #ff7b6b }
.targetwide { stroke: #79b4ff } .targetface { stroke: #79b4ff; fill: #79b4ff }
}
"""

# ---- two triangles ----

def project(p):
    """A point in space as the page shows it."""
    x, y, z = p
    return 60 * x - 26 * y, -52 * z + 18 * y + 9 * x


def on_line(triangle, axis):
    """The interval that a triangle cuts out of the x axis, whose plane holds it where this coordinate is 0."""
    found = []
    for i in range(3):
        p, q = triangle[i], triangle[(i + 1) % 3]
        if p[axis] * q[axis] < 0:
            t = p[axis] / (p[axis] - q[axis])
            found.append(p[0] + t * (q[0] - p[0]))
    return min(found), max(found)


def triangles():
    figure = Figure(640, 250, STYLE)
    a = [(-1.6, -1.5, 0), (1.7, -1.1, 0), (0.1, 1.9, 0)]
    for origin, shift, verdict in (((150, 110), 0.55, 'the intervals overlap: they meet'),
                                   ((440, 110), 2.1, 'the intervals are apart: they do not')):
        b = [(x + shift, 0, z) for x, z in ((-1.3, 1.2), (1.1, 1.5), (0.2, -1.3))]
        place = lambda p: (origin[0] + project(p)[0], origin[1] + project(p)[1])
        figure.path([place(p) for p in a], 'sourceface', True)
        figure.path([place(p) for p in b], 'targetface', True)
        figure.path([place((-2, 0, 0)), place((3.2 if shift > 1 else 2.4, 0, 0))], 'dash')
        for triangle, axis, kind, lift in ((a, 1, 'sourcewide', 0), (b, 2, 'targetwide', 4)):
            low, high = on_line(triangle, axis)
            ends = [place((x, 0, 0)) for x in (low, high)]
            figure.path([(x, y + lift) for x, y in ends], kind)
        figure.text(origin[0] + (40 if shift > 1 else 0), 232, verdict, 'middle')
    figure.save('triangles')


# ---- the filter ----

def filters():
    figure = Figure(640, 270, STYLE)
    rows = [('boxes of the facets', 'apart', 'nearly all pairs'),
            ('common corners', 'the same position: meet', 'where meshes share vertices'),
            ('signs, or separating planes', 'apart, or proven to meet', 'most of the rest'),
            ('exact test, doubles then integers', 'meet, or do not', 'what is still open')]
    for i, (stage, result, share) in enumerate(rows):
        y = 20 + 62 * i
        width = 280 - 34 * i
        figure.box(160 - width / 2, y, width, 40, 'good' if i == 3 else 'box')
        figure.text(160, y + 25, stage if i < 3 else stage.split(',')[0], 'middle', 'small')
        figure.arrow((160 + width / 2, y + 20), (350, y + 20))
        figure.text(360, y + 17, result)
        figure.text(360, y + 33, share, 'start', 'small')
        if i < 3:
            figure.arrow((160, y + 40), (160, y + 60))
    figure.save('filters')


# ---- the overlap grid ----

def ring(centre, radius, count):
    """A circle as a chain of faces, seen from the side."""
    points = [(centre[0] + radius * math.cos(2 * math.pi * i / count), centre[1] + radius * math.sin(2 * math.pi * i / count))
              for i in range(count)]
    return [(points[i], points[(i + 1) % count]) for i in range(count)]


def box_of(face):
    return tuple(min(p[k] for p in face) for k in (0, 1)), tuple(max(p[k] for p in face) for k in (0, 1))


def cells_of(face, low, high, size):
    """The cells of the grid that the box of a face overlaps; none outside of it."""
    box_low, box_high = box_of(face)
    if any(box_high[k] < low[k] or box_low[k] > high[k] for k in (0, 1)):
        return set()
    first = [math.floor((max(box_low[k], low[k]) - low[k]) / size) for k in (0, 1)]
    last = [math.floor((min(box_high[k], high[k]) - low[k]) / size) for k in (0, 1)]
    return {(i, j) for i in range(first[0], last[0] + 1) for j in range(first[1], last[1] + 1)}


def overlap():
    figure = Figure(640, 290, STYLE)
    meshes = [ring((235, 158), 115, 36), ring((405, 158), 105, 32)]
    bounds = [[f(p[k] for face in mesh for p in face) for f in (min, max) for k in (0, 1)] for mesh in meshes]
    low = [max(b[k] for b in bounds) for k in (0, 1)]
    high = [min(b[2 + k] for b in bounds) for k in (0, 1)]
    size = 14
    marked = [set().union(*(cells_of(face, low, high, size) for face in mesh)) for mesh in meshes]
    for i in range(math.ceil((high[0] - low[0]) / size)):
        for j in range(math.ceil((high[1] - low[1]) / size)):
            both = all((i, j) in cells for cells in marked)
            figure.box(low[0] + i * size, low[1] + j * size, size, size, 'good' if both else 'box', 0)
    for mesh, kind, other in zip(meshes, ('source', 'target'), (marked[1], marked[0])):
        for face in mesh:
            kept = cells_of(face, low, high, size) & other
            figure.path(face, kind + 'wide' if kept else kind)
    figure.text(20, 24, 'thick: kept, in a cell that the other mesh occupies too')
    figure.text(20, 282, 'thin: in no tree', 'start', 'small')
    figure.save('overlap')


if __name__ == '__main__':
    triangles()
    filters()
    overlap()
