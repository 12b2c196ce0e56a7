#!/usr/bin/env python3
"""Draws the figures of engine/HAUSDORFF.md as SVG files beside this script.

Shapes are computed, not traced: covers are the true sets of points within a distance of a segment, patches are evaluated.

usage: engine/figures/hausdorff_figures.py
"""
import math

from drawing import Figure


def offset_segment(a, b, distance, steps=16):
    """The outline of the points within a distance of a segment."""
    angle = math.atan2(b[1] - a[1], b[0] - a[0])
    turn = [angle + math.pi / 2 + math.pi * i / steps for i in range(steps + 1)]
    about = lambda c, shift: [(c[0] + distance * math.cos(t + shift), c[1] + distance * math.sin(t + shift)) for t in turn]
    return about(a, 0) + about(b, math.pi)


def to_segment(p, a, b):
    """The nearest point of a segment."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    t = max(0.0, min(1.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy)))
    return (a[0] + t * dx, a[1] + t * dy)


def mix(a, b, t):
    return tuple(x + t * (y - x) for x, y in zip(a, b))


def ball():
    f = Figure(620, 230)
    target = [(20, 190), (110, 172), (200, 186), (290, 168), (420, 182), (600, 174)]
    node = [(90, 102), (130, 80), (175, 92), (218, 74), (252, 100)]
    low = (min(x for x, _ in node), min(y for _, y in node))
    high = (max(x for x, _ in node), max(y for _, y in node))
    centre, radius = mix(low, high, 0.5), math.dist(low, high) / 2
    foot = min((to_segment(centre, a, b) for a, b in zip(target, target[1:])), key=lambda q: math.dist(q, centre))
    f.circle(centre, radius, 'hull')
    f.box(low[0], low[1], high[0] - low[0], high[1] - low[1])
    f.path(target, 'target')
    f.path(node, 'source')
    f.path([centre, foot], 'dash')
    f.dot(centre, 'sourcefill')
    f.dot(foot, 'targetfill')
    f.text(centre[0] + 8, centre[1] + 30, 'c')
    f.text(foot[0] + 8, foot[1] - 22, 'd = d(c, B)')
    f.path([centre, (centre[0] - radius * 0.8, centre[1] - radius * 0.6)], 'thin')
    f.text(centre[0] - 48, centre[1] - 30, 'r')
    f.text(20, 212, 'target B')
    f.text(high[0] + 30, 60, 'source faces of a node, in their box')
    f.text(high[0] + 30, 80, 'no point of them is farther than d + r')
    f.save('ball')


def cover():
    f = Figure(640, 270)
    corners = [(76, 190), (200, 150), (330, 178), (450, 140), (560, 172)]
    facets = list(zip(corners, corners[1:]))
    reach = 68
    source = ((110, 124), (530, 110))
    for a, b in facets:
        f.path(offset_segment(a, b, reach), 'set', close=True)
    for a, b in facets:
        f.path([a, b], 'target')
        f.dot(a, 'targetfill', 3)
    f.dot(corners[-1], 'targetfill', 3)
    f.path(source, 'source')
    # Where one facet's set ends and the next one goes on: cut in the middle of what both hold.
    within = lambda i, t: math.dist(mix(*source, t), to_segment(mix(*source, t), *facets[i])) <= reach
    steps = [i / 2000 for i in range(2001)]
    cuts, last = [], 0.0
    for i in range(len(facets) - 1):
        both = [t for t in steps if within(i, t) and within(i + 1, t)]
        if both:
            cuts.append(sum(both) / len(both))
    for t in cuts:
        x, y = mix(*source, t)
        f.path([(x, y - 9), (x, y + 9)], 'thin')
    for t in (0.0, 1.0):
        f.dot(mix(*source, t), 'sourcefill')
    bounds = [0.0] + cuts + [1.0]
    for i, (a, b) in enumerate(zip(bounds, bounds[1:])):
        x, y = mix(*source, (a + b) / 2)
        f.text(x, y - 12, f'T{i + 1}', 'middle', 'small')
    for i, (a, b) in enumerate(facets):
        x, y = mix(a, b, 0.5)
        f.text(x, y + 20, f'T{i + 1}', 'middle')
    f.text(20, 30, 'a face of the source, cut where the next facet takes over')
    f.text(20, 48, 'each part has both ends within the cutoff of its facet, hence all of its points')
    f.save('cover')


def overlay():
    f = Figure(620, 280)
    # Seen along the direction of projection: a face over a fan of facets.
    def place(u, v):
        return 30 + 225 * u + 28 * v, 210 - 120 * v - 20 * u

    rows = 4
    for i in range(rows):
        for j in range(rows):
            quad = [place(*p) for p in ((i / rows, j / rows), ((i + 1) / rows, j / rows), ((i + 1) / rows, (j + 1) / rows),
                                        (i / rows, (j + 1) / rows))]
            f.path(quad, 'set', close=True)
            f.path([quad[0], quad[2]], 'thin')
    rim = [place(*p) for p in ((0, 0), (1, 0), (1, 1), (0, 1))]
    f.path(rim, 'target', close=True)
    face = [place(*p) for p in ((0.14, 0.2), (0.86, 0.34), (0.36, 0.86))]
    f.path(face, 'source', close=True)
    f.text(30, 245, 'seen along the direction: the boundary of')
    f.text(30, 262, 'the facets does not cross the face')
    # From the side: vertical distances at the corners of common polygons.
    target = [(350, 190), (410, 168), (470, 182), (530, 160), (590, 178)]
    line = ((368, 132), (572, 118))
    f.path(target, 'target')
    f.path(line, 'source')
    height = lambda points, x: next(y0 + (y1 - y0) * (x - x0) / (x1 - x0)
                                    for (x0, y0), (x1, y1) in zip(points, points[1:]) if x0 <= x <= x1)
    for x in [368] + [p[0] for p in target[1:-1]] + [572]:
        top, bottom = height(line, x), height(target, x)
        f.path([(x, top), (x, bottom)], 'dash')
        f.dot((x, top), 'sourcefill', 3)
    f.text(350, 245, 'from the side: the largest vertical')
    f.text(350, 262, 'distance is at a corner of a polygon')
    f.text(30, 30, 'the number of facets over a point is odd in all of the face, or even')
    f.save('overlay')


def patch():
    f = Figure(620, 220)
    corner = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.45), (1.0, 1.0, -0.35), (0.0, 1.0, 0.55)]

    def look(p, left):
        x, y, z = p
        return left + 112 * x + 40 * y, 178 + 6 * x - 84 * y - 58 * z

    def at(s, t):
        weights = ((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t)
        return tuple(sum(w * c[k] for w, c in zip(weights, corner)) for k in range(3))

    n = 8
    for left, title in ((20, 'patch'), (215, 'two triangles'), (410, 'hull of the corners')):
        c = [look(p, left) for p in corner]
        if title == 'patch':
            for i in range(n + 1):
                f.path([look(at(i / n, j / n), left) for j in range(n + 1)], 'source' if i in (0, n) else 'thin')
                f.path([look(at(j / n, i / n), left) for j in range(n + 1)], 'source' if i in (0, n) else 'thin')
            f.dot(look(at(0.5, 0.5), left), 'sourcefill')
        elif title == 'two triangles':
            f.path([c[0], c[1], c[2]], 'set', close=True)
            f.path([c[0], c[2], c[3]], 'set', close=True)
            f.path(c, 'target', close=True)
            f.path([c[0], c[2]], 'target')
            middle, on = look(at(0.5, 0.5), left), mix(c[0], c[2], 0.5)
            f.path([middle, on], 'source')
            f.dot(middle, 'sourcefill')
            f.text(middle[0] + 8, (middle[1] + on[1]) / 2 + 4, '|w| / 4', kind='small')
        else:
            for a, b in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)):
                f.path([c[a], c[b]], 'dash')
            f.path([c[0], c[1], c[2], c[3]], 'hull', close=True)
        f.text(left + 85, 212, title, 'middle')
    f.save('patch')


def search():
    f = Figure(720, 400)

    f.stage(20, 20, 170, 'seeds', 'samples of all packs')
    f.stage(20, 110, 170, 'ascent', 'to a local maximum')
    f.stage(280, 20, 180, 'queue', 'largest upper bound first')
    f.stage(280, 110, 180, 'node', 'balls about children')
    f.stage(280, 200, 180, 'pack of eight faces', 'one facet, parts, overlay')
    f.stage(280, 290, 180, 'face or piece', 'cover by several facets')
    f.stage(540, 200, 160, 'discarded', 'bound at most the cutoff', 'good')
    f.stage(20, 200, 170, 'lower bound', 'cutoff = lower + tolerance', 'good')
    f.arrow((105, 66), (105, 110))
    f.arrow((105, 156), (105, 200))
    f.arrow((370, 66), (370, 110))
    f.arrow((370, 156), (370, 200))
    f.arrow((370, 246), (370, 290))
    f.arrow((460, 223), (540, 223))
    f.arrow((460, 133), (560, 200))
    f.arrow((460, 313), (560, 246))
    f.arrow((280, 313), (125, 246))
    f.text(110, 300, 'corners that no', kind='small')
    f.text(110, 314, 'facet reaches: samples', kind='small')
    f.path([(370, 336), (370, 366), (700, 366), (712, 358), (712, 51), (704, 43)], 'thin')
    f.arrow((704, 43), (460, 43))
    f.text(500, 384, 'what a cover leaves over, in parts', kind='small')
    f.arrow((190, 223), (280, 223), kind='dash')
    f.save('search')


if __name__ == '__main__':
    for draw in (ball, cover, overlay, patch, search):
        draw()
