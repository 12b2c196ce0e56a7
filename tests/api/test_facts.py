"""What a mesh is: closed or not, which way its faces run, how large it is. Intervals against rational numbers."""
import decimal
import fractions
import math
import random

import pytest

import shapes

SEED = 20


def root(square):
    """The root of a fraction, to 60 digits."""
    with decimal.localcontext(prec=60, Emin=-9999, Emax=9999):
        return fractions.Fraction((decimal.Decimal(square.numerator) / decimal.Decimal(square.denominator)).sqrt())


def cross(a, b):
    return tuple(a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3))


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def measure(mesh):
    """Area and volume of a mesh whose quads are read as triangles, and the number of its faces without area."""
    vertices = [tuple(map(fractions.Fraction, vertex)) for vertex in mesh[0]]
    area, volume, flat = fractions.Fraction(0), fractions.Fraction(0), 0
    for face in mesh[1]:
        squares = []
        for b, c in zip(face[1:], face[2:]):
            corner = [vertices[i] for i in (face[0], b, c)]
            normal = cross(*(tuple(x - y for x, y in zip(end, corner[0])) for end in corner[1:]))
            squares.append(dot(normal, normal))
            area += root(squares[-1]) / 2
            volume += dot(corner[0], normal) / 6
        flat += not any(squares)
    return area, volume, flat


def bilinear_volume(mesh):
    """A patch halves the tetrahedron of its corners: the mean of both ways to cut each quad."""
    turned = [face if len(face) == 3 else face[1:] + face[:1] for face in mesh[1]]
    return (measure(mesh)[1] + measure((mesh[0], turned))[1]) / 2


def torus(chance, columns, rows, size, shift, noise):
    """A closed grid of quads with noise, some of them cut in two."""
    vertices = []
    for i in range(columns):
        for j in range(rows):
            u, v = 2 * math.pi * i / columns, 2 * math.pi * j / rows
            ring = 2 + math.cos(v)
            vertices.append(tuple(shift + size * (x + noise * chance.uniform(-1, 1))
                                  for x in (ring * math.cos(u), ring * math.sin(u), math.sin(v))))
    faces = []
    for i in range(columns):
        for j in range(rows):
            a, b, c, d = (p % columns * rows + q % rows for p, q in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
            faces += [(a, b, c), (a, c, d)] if chance.random() < 0.3 else [(a, b, c, d)]
    return vertices, faces


@pytest.mark.parametrize("size, shift", [(1, 0), (1e-30, 0), (1e30, 0), (1, 1e9), (1e-3, -1e9)])
def test_intervals_hold_the_exact_figures(client, size, shift):
    chance = random.Random(SEED)
    for _ in range(12):
        mesh = torus(chance, chance.randint(3, 9), chance.randint(3, 9), size, shift, chance.choice((0, 0.3)))
        facts = client.upload(shapes.obj(mesh), format="obj")
        area, volume, flat = measure(mesh)
        print("seed", SEED, facts["area"], float(area), facts["volume"], float(volume))
        assert facts["watertight"] and facts["winding_consistent"] and facts["genus"] == 1
        assert facts["euler_number"] == 0 and facts["boundary_loops"] == 0
        assert facts["degenerate_faces"] == flat and facts["duplicate_faces"] == 0
        assert facts["area"]["lower"] <= area <= facts["area"]["upper"] <= facts["area"]["lower"] * (1 + 1e-12)
        assert facts["volume"]["lower"] <= volume <= facts["volume"]["upper"]
        assert facts["volume"]["upper"] - facts["volume"]["lower"] <= 1e-10 * size**3
        patches = facts["volume"]["bilinear"]
        assert patches["lower"] <= bilinear_volume(mesh) <= patches["upper"]


def test_boxes_have_whole_numbers(client):
    chance = random.Random(SEED)
    for _ in range(10):
        x, y, z = (chance.randint(1, 1000) for _ in range(3))
        vertices, faces = shapes.cube()
        mesh = [(x * a, y * b, z * c) for a, b, c in vertices], faces
        facts = client.upload(mesh)
        for figures in (facts["area"], facts["area"]["bilinear"]):
            assert figures["lower"] <= 2 * (x * y + y * z + z * x) <= figures["upper"]
        for figures in (facts["volume"], facts["volume"]["bilinear"]):
            assert figures["lower"] <= x * y * z <= figures["upper"]
        assert facts["edges"] == 12 and facts["genus"] == 0


def test_an_open_or_badly_wound_mesh_has_no_volume(client):
    vertices, faces = shapes.cube()
    facts = client.upload((vertices, faces[1:]))
    assert not facts["watertight"] and facts["winding_consistent"]
    assert facts["volume"] is None and facts["genus"] is None and facts["boundary_loops"] == 1
    assert facts["area"]["lower"] <= 5 <= facts["area"]["upper"]
    facts = client.upload((vertices, [faces[0][::-1], *faces[1:]]))
    assert facts["watertight"] and not facts["winding_consistent"] and facts["volume"] is None
    facts = client.upload((vertices, [face[::-1] for face in faces]))
    assert facts["volume"]["lower"] <= -1 <= facts["volume"]["upper"] < 0


def test_faces_that_are_nothing_or_there_twice_are_counted(client):
    vertices, faces = shapes.cube()
    more = [(0, 1, 0), (0, 1, 3), (0, 1, 5, 4), (5, 1, 0, 4), (8, 9, 10)]
    facts = client.upload(shapes.obj((vertices + [(0, 0, 9), (1, 1, 9), (2, 2, 9)], faces + more)), format="obj")
    assert facts["duplicate_faces"] == 2 and facts["degenerate_faces"] == 2
    assert not facts["watertight"] and facts["volume"] is None


def test_a_point_set_has_no_surface(client):
    facts = client.upload(b"0 0 0\n1 0 0\n0 1 0\n", format="xyz")
    assert facts["area"] is None and facts["volume"] is None and facts["euler_number"] is None
    assert facts["genus"] is None and not facts["watertight"] and not facts["winding_consistent"]


def test_a_deformation_measures_anew(client):
    mesh = client.upload(shapes.cube(), name="grows")
    assert client.get(f"/v1/meshes/{mesh['id']}").json()["volume"] == mesh["volume"]
    moved = [[2 * x for x in vertex] for vertex in shapes.cube()[0]]
    reply = client.patch(f"/v1/meshes/{mesh['id']}/vertices", json={"positions": moved})
    assert reply.status_code == 200, reply.text
    facts = client.get(f"/v1/meshes/{mesh['id']}").json()
    assert facts["volume"]["lower"] <= 8 <= facts["volume"]["upper"]
    assert facts["area"]["lower"] <= 24 <= facts["area"]["upper"] and facts["genus"] == 0


def test_figures_beyond_the_range_of_doubles_have_no_bound(client):
    facts = client.upload(shapes.obj(shapes.cube(1e200)), format="obj")
    assert facts["area"]["lower"] > 1e308 and facts["area"]["upper"] is None
    assert facts["volume"]["lower"] > 1e308 and facts["volume"]["upper"] is None
    facts = client.upload(shapes.obj(shapes.cube(1e-200)), format="obj")
    assert 0 <= facts["area"]["lower"] < facts["area"]["upper"] < 1e-300
    assert facts["volume"]["lower"] <= 0 < facts["volume"]["upper"] < 1e-300
