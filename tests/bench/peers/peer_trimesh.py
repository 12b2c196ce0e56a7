"""trimesh: distances of points drawn on each surface from the other one, the nearest points on its triangles.

peer_trimesh.py compare A B POINTS SEED LIMIT
"""
import trimesh

import measure
import sampled


def read(prefix):
    vertices, triangles = measure.read_mesh(prefix)
    return trimesh.Trimesh(vertices, triangles, process=False)


def distances(mesh, count, seed, other):
    points, _ = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return trimesh.proximity.closest_point(other, points)[1]


def compare(*words):
    sampled.compare(words, read, distances)


if __name__ == "__main__":
    measure.main(compare=compare)
