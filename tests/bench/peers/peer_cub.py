"""cascading-upper-bounds: Sacht and Jacobson, Cascading upper bounds for triangle soup Pompeiu-Hausdorff distance, 2024.

peer_cub.py hausdorff A B TOLERANCE     in the unit of the meshes
peer_cub.py files A B TOLERANCE         files of meshes, read by libigl, which its authors use
"""
import cascading_upper_bounds
import igl
import numpy

import measure

# How many times more faces and vertices than A has it may make: no limit of ours.
MAX_FACTOR = 1e6


def find_distance(mesh_a, mesh_b, tolerance):
    result = cascading_upper_bounds.pompeiu_hausdorff(*mesh_a, *mesh_b, float(tolerance), MAX_FACTOR, False)
    return lambda: {"lower": result[0], "upper": result[1]}


def hausdorff(prefix_a, prefix_b, tolerance):
    meshes = measure.read_mesh(prefix_a), measure.read_mesh(prefix_b)
    # It builds its tree inside, so that the build is part of the query's time.
    measure.measure(lambda: None, lambda _: find_distance(*meshes, tolerance))


def read_file(path):
    vertices, triangles = igl.read_triangle_mesh(path)
    return numpy.asarray(vertices, dtype=numpy.float64), numpy.asarray(triangles, dtype=numpy.int32)


def files(path_a, path_b, tolerance):
    measure.measure(lambda: (read_file(path_a), read_file(path_b)), lambda meshes: find_distance(*meshes, tolerance))


if __name__ == "__main__":
    measure.main(hausdorff=hausdorff, files=files)
