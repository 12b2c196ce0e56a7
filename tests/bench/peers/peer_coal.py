"""coal's answers for the benchmark: the pairs of triangles of two meshes that meet."""
import coal
import numpy

import measure

MOST_PAIRS = 100_000_000


def build(arrays):
    vertices, triangles = arrays
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addVertices(vertices)
    model.addTriangles(triangles.astype(numpy.int64))
    model.endModel()
    return model


def find(models):
    request = coal.CollisionRequest()
    request.num_max_contacts = MOST_PAIRS
    request.enable_contact = False
    result = coal.CollisionResult()
    coal.collide(models[0], coal.Transform3s.Identity(), models[1], coal.Transform3s.Identity(), request, result)

    def tell():
        found = numpy.array([(contact.b1, contact.b2) for contact in result.getContacts()], dtype=numpy.int64)
        return measure.tell_pairs(*found.reshape(-1, 2).T)

    return tell


def collide(a, b):
    meshes = measure.read_mesh(a), measure.read_mesh(b)
    measure.measure(lambda: tuple(build(mesh) for mesh in meshes), find)


if __name__ == "__main__":
    measure.main(collide=collide)
