"""point-cloud-utils: points drawn on each surface, and the nearest points of the other one's sample.

peer_pcu.py compare A B POINTS SEED LIMIT
"""
import numpy
import point_cloud_utils

import measure
import sampled


def draw(mesh, count, seed):
    faces, weights = point_cloud_utils.sample_mesh_random(*mesh, count, random_seed=seed)
    return point_cloud_utils.interpolate_barycentric_coords(mesh[1], faces, weights, mesh[0])


def read(prefix):
    return tuple(numpy.ascontiguousarray(array) for array in measure.read_mesh(prefix))


def distances(mesh, count, seed, other):
    # The other surface has points of its own: of two samples, as its chamfer_distance and hausdorff_distance take them.
    points, others = draw(mesh, count, seed), draw(other, count, seed + 500)
    return point_cloud_utils.k_nearest_neighbors(points, others, 1)[0].ravel()


def compare(*words):
    sampled.compare(words, read, distances)


if __name__ == "__main__":
    measure.main(compare=compare)
