"""fcpw: nearest points by its vectorised tree, in single precision, as fcpw is.

peer_fcpw.py project MESH POINTS
"""
import fcpw
import numpy

import measure


def project(prefix, points_path):
    vertices, triangles = measure.read_mesh(prefix)
    vertices = numpy.asfortranarray(vertices, dtype=numpy.float32)
    triangles = numpy.asfortranarray(triangles)
    points = numpy.asfortranarray(measure.read_points(points_path), dtype=numpy.float32)
    radii = numpy.full(len(points), numpy.inf, dtype=numpy.float32)

    def build():
        scene = fcpw.scene_3D()
        scene.set_object_count(1)
        scene.set_object_vertices(vertices, 0)
        scene.set_object_triangles(triangles, 0)
        scene.build(fcpw.aggregate_type.bvh_surface_area, True)
        return scene

    def query(scene):
        found = fcpw.interaction_3D_list()
        scene.find_closest_points(points, radii, found)
        return lambda: {"distances": [found[i].d for i in range(0, len(points), measure.CHECK_STEP)]}

    measure.measure(build, query)


if __name__ == "__main__":
    measure.main(project=project)
