"""cascading-upper-bounds: Sacht and Jacobson, Cascading upper bounds for triangle soup Pompeiu-Hausdorff distance, 2024.

peer_cub.py hausdorff A B TOLERANCE     in the unit of the meshes
"""
import cascading_upper_bounds

import measure

# How many times more faces and vertices than A has it may make: no limit of ours.
MAX_FACTOR = 1e6


def hausdorff(prefix_a, prefix_b, tolerance):
    vertices_a, triangles_a = measure.read_mesh(prefix_a)
    vertices_b, triangles_b = measure.read_mesh(prefix_b)

    def query(_):
        result = cascading_upper_bounds.pompeiu_hausdorff(vertices_a, triangles_a, vertices_b, triangles_b,
                                                          float(tolerance), MAX_FACTOR, False)
        return lambda: {"lower": result[0], "upper": result[1]}

    # It builds its tree inside, so that the build is part of the query's time.
    measure.measure(lambda: None, query)


if __name__ == "__main__":
    measure.main(hausdorff=hausdorff)
