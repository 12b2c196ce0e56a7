"""Shapes by formula and writers for every format that the daemon reads.

A mesh is a pair (vertices, faces): tuples of three floats, and tuples of three or more indices from 0.
"""
import io
import json
import math
import random
import struct
import zipfile

SPHERE_TURN = math.pi / 100
SPHERE_DISTANCE = 1 - math.cos(SPHERE_TURN)


# ---- shapes ----


def sphere(turn=0.0, parallels=50, meridians=100, radius=1.0):
    """A UV sphere of quads without its poles, turned about its axis. Turned by half a meridian, its points
    farthest from the unturned one lie on the equator, at 1 - cos(pi / meridians)."""
    vertices = []
    for i in range(1, parallels):
        polar = math.pi * i / parallels
        for j in range(meridians):
            azimuth = 2 * math.pi * j / meridians + turn
            vertices.append((radius * math.sin(polar) * math.cos(azimuth),
                             radius * math.sin(polar) * math.sin(azimuth),
                             radius * math.cos(polar)))
    faces = []
    for i in range(parallels - 2):
        for j in range(meridians):
            k = (j + 1) % meridians
            faces.append((i * meridians + j, (i + 1) * meridians + j, (i + 1) * meridians + k, i * meridians + k))
    return vertices, faces


def cube(side=1.0, origin=(0.0, 0.0, 0.0)):
    """Six quads with their corner at origin."""
    x, y, z = origin
    vertices = [(x + side * (i & 1), y + side * (i >> 1 & 1), z + side * (i >> 2 & 1)) for i in range(8)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return vertices, faces


def gridded_cube(steps):
    """The surface of the cube [-1, 1]^3, in steps x steps quads a side, oriented outward."""
    number, vertices, faces = {}, [], []

    def vertex(p):
        if p not in number:
            number[p] = len(vertices)
            vertices.append(tuple(2 * x / steps - 1 for x in p))
        return number[p]

    for axis in range(3):
        for end in (0, steps):
            for i in range(steps):
                for j in range(steps):
                    corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    places = []
                    for u, v in corners if end else corners[::-1]:
                        p = [0, 0, 0]
                        p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3] = end, u, v
                        places.append(vertex(tuple(p)))
                    faces.append(tuple(places))
    return vertices, faces


def saddle(steps):
    """z = xy over [-1, 1] squared, in steps x steps quads; as bilinear patches all of these are one surface."""
    vertices = []
    for i in range(steps + 1):
        for j in range(steps + 1):
            x, y = 2 * i / steps - 1, 2 * j / steps - 1
            vertices.append((x, y, x * y))
    row = steps + 1
    faces = [(i * row + j, (i + 1) * row + j, (i + 1) * row + j + 1, i * row + j + 1)
             for i in range(steps) for j in range(steps)]
    return vertices, faces


def rough(steps, seed, height=0.05):
    """A plate of quads with random heights: no two corners of a quad lie in one plane."""
    chance = random.Random(seed)
    vertices = [(i / steps, j / steps, height * chance.random()) for i in range(steps + 1) for j in range(steps + 1)]
    return vertices, saddle(steps)[1]


def crumpled(count, seed, size=0.3):
    """A flat square, and apart from it quads at random in a heap, with corners pushed out of their
    parallelograms by about two sides: as bilinear patches they fold over."""
    chance = random.Random(seed)
    vertices, faces = [(9, 9, 9), (10, 9, 9), (10, 10, 9), (9, 10, 9)], [(0, 1, 2, 3)]
    for _ in range(count):
        corner = [chance.uniform(0, 3) for _ in range(3)]
        right, up, push = ([chance.gauss(0, size) for _ in range(3)] for _ in range(3))
        first = len(vertices)
        for u, v, w in ((0, 0, 0), (1, 0, 0), (1, 1, 2), (0, 1, 0)):
            vertices.append(tuple(corner[k] + u * right[k] + v * up[k] + w * push[k] for k in range(3)))
        faces.append(tuple(range(first, first + 4)))
    return vertices, faces


def cut(mesh, count):
    """Every quad, as a bilinear patch, cut in count x count quads."""
    vertices, faces = [], []
    for face in mesh[1]:
        corner, first = [mesh[0][i] for i in face], len(vertices)
        for j in range(count + 1):
            for i in range(count + 1):
                s, t = i / count, j / count
                weights = ((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t)
                vertices.append(tuple(sum(w * c[k] for w, c in zip(weights, corner)) for k in range(3)))
        for j in range(count):
            for i in range(count):
                at = first + j * (count + 1) + i
                faces.append((at, at + 1, at + count + 2, at + count + 1))
    return vertices, faces


def moved(mesh, x, y, z):
    return [(v[0] + x, v[1] + y, v[2] + z) for v in mesh[0]], mesh[1]


def triangles(mesh):
    """Every face cut from its first corner."""
    cut = [(f[0], f[i], f[i + 1]) for f in mesh[1] for i in range(1, len(f) - 1)]
    return mesh[0], cut


# ---- formats ----


def obj(mesh):
    lines = ["v {!r} {!r} {!r}".format(*v) for v in mesh[0]]
    lines += ["f " + " ".join(str(i + 1) for i in f) for f in mesh[1]]
    return ("\n".join(lines) + "\n").encode()


def off(mesh):
    lines = ["OFF", f"{len(mesh[0])} {len(mesh[1])} 0"]
    lines += ["{!r} {!r} {!r}".format(*v) for v in mesh[0]]
    lines += [" ".join(map(str, (len(f), *f))) for f in mesh[1]]
    return ("\n".join(lines) + "\n").encode()


def xyz(mesh):
    return "".join("{!r} {!r} {!r}\n".format(*v) for v in mesh[0]).encode()


def threemf(mesh):
    """A 3MF package; quads become two triangles each."""
    triangles = [(f[0], f[i], f[i + 1]) for f in mesh[1] for i in range(1, len(f) - 1)]
    model = ('<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1"><mesh>'
             "<vertices>" + "".join('<vertex x="{!r}" y="{!r}" z="{!r}"/>'.format(*v) for v in mesh[0]) + "</vertices>"
             "<triangles>" + "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*t) for t in triangles) + "</triangles>"
             '</mesh></object></resources><build><item objectid="1"/></build></model>')
    package = io.BytesIO()
    with zipfile.ZipFile(package, "w", zipfile.ZIP_DEFLATED) as archive:
        # Without the time of day, which would give tests another name in each process.
        archive.writestr(zipfile.ZipInfo("3D/3dmodel.model"), model, zipfile.ZIP_DEFLATED)
    return package.getvalue()


def pcd(mesh):
    head = (f"VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(mesh[0])}\nHEIGHT 1\n"
            f"POINTS {len(mesh[0])}\nDATA binary\n")
    return head.encode() + b"".join(struct.pack("<3d", *v) for v in mesh[0])


def _ply_header(kind, mesh):
    return (f"ply\nformat {kind} 1.0\nelement vertex {len(mesh[0])}\nproperty double x\nproperty double y\n"
            f"property double z\nelement face {len(mesh[1])}\nproperty list uchar int vertex_indices\n"
            "end_header\n").encode()


def ply_ascii(mesh):
    lines = ["{!r} {!r} {!r}".format(*v) for v in mesh[0]]
    lines += [" ".join(map(str, (len(f), *f))) for f in mesh[1]]
    return _ply_header("ascii", mesh) + ("\n".join(lines) + "\n").encode()


def _ply_binary(mesh, kind, order):
    body = b"".join(struct.pack(order + "3d", *v) for v in mesh[0])
    body += b"".join(struct.pack(f"{order}B{len(f)}i", len(f), *f) for f in mesh[1])
    return _ply_header(kind, mesh) + body


def ply_little(mesh):
    return _ply_binary(mesh, "binary_little_endian", "<")


def ply_big(mesh):
    return _ply_binary(mesh, "binary_big_endian", ">")


def stl_ascii(mesh):
    vertices, faces = triangles(mesh)
    text = "solid shape\n"
    for face in faces:
        text += "facet normal 0 0 0\nouter loop\n"
        text += "".join("vertex {!r} {!r} {!r}\n".format(*vertices[i]) for i in face)
        text += "endloop\nendfacet\n"
    return (text + "endsolid shape\n").encode()


def stl_binary(mesh):
    vertices, faces = triangles(mesh)
    data = b"made by formula".ljust(80) + struct.pack("<I", len(faces))
    for face in faces:
        data += struct.pack("<3f", 0, 0, 0) + b"".join(struct.pack("<3f", *vertices[i]) for i in face) + b"\0\0"
    return data


def glb(mesh):
    """glTF binary: float positions, 32-bit indices, one buffer."""
    vertices, faces = triangles(mesh)
    indices = b"".join(struct.pack("<3I", *f) for f in faces)
    positions = b"".join(struct.pack("<3f", *v) for v in vertices)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 1}, "indices": 0, "mode": 4}]}],
        "buffers": [{"byteLength": len(indices) + len(positions)}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(indices)},
                        {"buffer": 0, "byteOffset": len(indices), "byteLength": len(positions)}],
        "accessors": [
            {"bufferView": 0, "componentType": 5125, "count": 3 * len(faces), "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": len(vertices), "type": "VEC3",
             "min": [min(v[i] for v in vertices) for i in range(3)],
             "max": [max(v[i] for v in vertices) for i in range(3)]}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary = indices + positions
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def crowded_glb(nodes, cells):
    """A small file that decodes into many faces: nodes that all show one grid of 2 x cells^2 triangles."""
    width = cells + 1
    positions = b"".join(struct.pack("<3f", x, y, 0) for y in range(width) for x in range(width))
    corners = [(y * width + x, y * width + x + 1, (y + 1) * width + x + 1, (y + 1) * width + x)
               for y in range(cells) for x in range(cells)]
    indices = b"".join(struct.pack("<6I", a, b, c, a, c, d) for a, b, c, d in corners)
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(nodes))}],
        "nodes": [{"mesh": 0, "translation": [0, 0, n]} for n in range(nodes)],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(positions) + len(indices)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(positions)},
                        {"buffer": 0, "byteOffset": len(positions), "byteLength": len(indices)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": width * width, "type": "VEC3",
                       "min": [0, 0, 0], "max": [cells, cells, 0]},
                      {"bufferView": 1, "componentType": 5125, "count": 6 * cells * cells, "type": "SCALAR"}]}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary = positions + indices
    return (struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary)) + struct.pack("<I4s", len(text), b"JSON") + text +
            struct.pack("<I4s", len(binary), b"BIN\0") + binary)
