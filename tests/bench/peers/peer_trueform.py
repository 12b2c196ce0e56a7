"""trueform's answers for the benchmark: the pairs of triangles of two meshes that meet."""
import trueform

import measure


def build(arrays):
    vertices, triangles = arrays
    mesh = trueform.Mesh(triangles, vertices)
    mesh.build_tree()
    return mesh


def find(meshes):
    found = trueform.gather_intersecting_ids(*meshes)
    return lambda: measure.tell_pairs(found[:, 0], found[:, 1])


def collide(a, b):
    meshes = measure.read_mesh(a), measure.read_mesh(b)
    measure.measure(lambda: tuple(build(mesh) for mesh in meshes), find)


if __name__ == "__main__":
    measure.main(collide=collide)
