"""A figure as SVG: what the scripts that draw the documents' figures share. Lines follow the reader's colour scheme."""
import math
import pathlib
import sys

STYLE = """
text { font: 13px sans-serif; fill: #222 }
.small { font-size: 11px }
.source { stroke: #c0392b; fill: none; stroke-width: 2.5 }
.target { stroke: #1f5fa8; fill: none; stroke-width: 2.5 }
.sourcefill { fill: #c0392b }
.targetfill { fill: #1f5fa8 }
.set { fill: #1f5fa8; fill-opacity: .14; stroke: #1f5fa8; stroke-width: 1 }
.hull { fill: #888; fill-opacity: .12; stroke: #888; stroke-width: 1; stroke-dasharray: 4 3 }
.thin { stroke: #888; stroke-width: 1; fill: none }
.dash { stroke: #888; stroke-width: 1; fill: none; stroke-dasharray: 4 3 }
.box { fill: #888; fill-opacity: .08; stroke: #888; stroke-width: 1 }
.good { fill: #2e8b57; fill-opacity: .16; stroke: #2e8b57; stroke-width: 1 }
@media (prefers-color-scheme: dark) {
text { fill: #ddd }
.source { stroke: #ff7b6b } .sourcefill { fill: #ff7b6b }
.target { stroke: #79b4ff } .targetfill { fill: #79b4ff }
.set { fill: #79b4ff; stroke: #79b4ff }
}
"""


class Figure:
    """kind is a class of the style; more is style that a figure adds."""

    def __init__(self, width, height, more=''):
        self.width, self.height, self.style, self.parts = width, height, STYLE + more, []

    def add(self, part):
        self.parts.append(part)

    def path(self, points, kind='thin', close=False):
        lines = ' L '.join(f'{x:.1f} {y:.1f}' for x, y in points)
        self.add(f'<path class="{kind}" d="M {lines}{" Z" if close else ""}"/>')

    def dot(self, point, kind, radius=4):
        self.circle(point, radius, kind)

    def circle(self, centre, radius, kind):
        self.add(f'<circle class="{kind}" cx="{centre[0]:.1f}" cy="{centre[1]:.1f}" r="{radius:.1f}"/>')

    def box(self, x, y, width, height, kind='box', radius=5):
        self.add(f'<rect class="{kind}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="{radius}"/>')

    def text(self, x, y, text, anchor='start', kind=''):
        self.add(f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{text}</text>')

    def stage(self, x, y, width, title, line='', kind='box'):
        """A box with a title and a line below it."""
        self.box(x, y, width, 46, kind)
        self.text(x + width / 2, y + (19 if line else 28), title, 'middle', '')
        if line:
            self.text(x + width / 2, y + 36, line, 'middle', 'small')

    def tip(self, start, end):
        """The head of an arrow."""
        angle = math.atan2(end[1] - start[1], end[0] - start[0])
        for side in (2.7, -2.7):
            self.path([end, (end[0] + 8 * math.cos(angle + side), end[1] + 8 * math.sin(angle + side))])

    def arrow(self, *points, kind='thin'):
        self.path(points, kind)
        self.tip(*points[-2:])

    def save(self, name):
        """Writes NAME.svg beside the script that runs."""
        body = '\n'.join(self.parts)
        (pathlib.Path(sys.argv[0]).resolve().parent / f'{name}.svg').write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" width="{self.width}" '
            f'height="{self.height}">\n<style>{self.style}</style>\n{body}\n</svg>\n')
