"""libigl: nearest points; and the distance from the vertices of A, which is a lower bound with no upper one.

peer_igl.py hausdorff A B TOLERANCE     the tolerance is not looked at
peer_igl.py project MESH POINTS
"""
import igl
import numpy

import measure


def hausdorff(prefix_a, prefix_b, _tolerance):
    # igl.hausdorff is the greater of this and of the same with A and B exchanged.
    vertices_a, _ = measure.read_mesh(prefix_a)
    vertices_b, triangles_b = measure.read_mesh(prefix_b)
    triangles_b = triangles_b.astype(numpy.int64)

    def query(_):
        squares = igl.point_mesh_squared_distance(vertices_a, vertices_b, triangles_b)[0]
        farthest = float(numpy.sqrt(squares.max()))
        return lambda: {"lower": farthest, "upper": None}

    measure.measure(lambda: None, query)


def project(prefix, points_path):
    vertices, triangles = measure.read_mesh(prefix)
    triangles = triangles.astype(numpy.int64)
    points = measure.read_points(points_path)

    def build():
        tree = igl.AABB()
        tree.init(vertices, triangles)
        return tree

    def query(tree):
        squares = tree.squared_distance(vertices, triangles, points)[0]
        return lambda: {"distances": numpy.sqrt(squares[:: measure.CHECK_STEP]).tolist()}

    measure.measure(build, query)


if __name__ == "__main__":
    measure.main(hausdorff=hausdorff, project=project)
