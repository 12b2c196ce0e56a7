"""A camera over a surface, for strokes and clicks: from places in space to the body of a request."""
import math


def _minus(a, b):
    return [x - y for x, y in zip(a, b)]


def _dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _unit(a):
    return [x / math.sqrt(_dot(a, a)) for x in a]


def look(direction, places, distance=4.0, size=1000, half=0.4):
    """The body of a stroke through places, seen from a direction; one place is a click."""
    target = [sum(axis) / len(places) for axis in zip(*places)]
    back = _unit(direction)
    right = _unit(_cross([0, 1, 0] if abs(back[1]) < 0.98 else [0, 0, 1], back))
    axes = [right, _cross(back, right), back]
    eye = [t + distance * b for t, b in zip(target, back)]
    near, far = 0.1, 20.0
    points = []
    for place in places:
        x, y, z = (_dot(axis, _minus(place, eye)) for axis in axes)
        points.append([size / 2 * (1 - x / z / half), size / 2 * (1 + y / z / half)])
    view = [0.0] * 16
    for row, axis in enumerate(axes):
        view[row], view[4 + row], view[8 + row] = axis
        view[12 + row] = -_dot(axis, eye)
    view[15] = 1.0
    projection = [1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, -(far + near) / (far - near), -1,
                  0, 0, -2 * far * near / (far - near), 0]
    return {"points": points, "view": view, "projection": projection, "viewport": [0, 0, size, size]}


def line(a, b, pieces=12):
    """Places on a straight line."""
    return [[x + (y - x) * k / pieces for x, y in zip(a, b)] for k in range(pieces + 1)]


class Sketcher:
    """Edits one layout, and counts the strokes and clicks."""

    def __init__(self, client, layout):
        self.client = client
        self.layout = layout
        self.actions = 0

    def edit(self, path, **body):
        reply = self.client.post(f"/v1/layouts/{self.layout['id']}/{path}", json=body)
        assert reply.status_code == 200, f"{path}: {reply.text}"
        self.layout = reply.json()
        self.actions += 1
        return self.layout

    def ring(self, direction, *places, **more):
        """A ring by a click on one place, or by a stroke between two; returns its first curve."""
        drawn = line(*places) if len(places) == 2 else list(places)
        return self.edit("rings", **look(direction, drawn), **more)["stroke"]["curve"]

    def tube(self, first, second):
        return self.edit("tubes", first=first, second=second)

    def link(self, a, b):
        return self.edit("links", first=self.node_at(a), second=self.node_at(b))

    def node_at(self, place):
        distances = [math.dist(node, place) for node in self.layout["nodes"]]
        return distances.index(min(distances))

    def curve_at(self, place):
        """The id of the curve nearest to a place, by points along its pieces."""
        def distance(curve):
            rows = curve["points"]
            return min(math.dist(place, [x + (y - x) * k / 10 for x, y in zip(a, b)])
                       for a, b in zip(rows, rows[1:]) for k in range(11))
        return min(self.layout["curves"], key=distance)["id"]
