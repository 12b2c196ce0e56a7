"""pymeshlab: the distance from samples of A, which is a lower bound with no upper one.

peer_meshlab.py hausdorff A B TOLERANCE     the tolerance is not looked at
peer_meshlab.py files A B TOLERANCE         files of meshes, which it reads itself
"""
import pymeshlab

import measure

SAMPLES = 1000000


def find_distance(meshes):
    result = meshes.get_hausdorff_distance(sampledmesh=0, targetmesh=1, samplevert=True, sampleface=True,
                                           samplenum=SAMPLES, maxdist=pymeshlab.PercentageValue(100))
    return lambda: {"lower": result["max"], "upper": None}


def hausdorff(prefix_a, prefix_b, _tolerance):
    meshes = pymeshlab.MeshSet()
    for prefix in (prefix_a, prefix_b):
        vertices, triangles = measure.read_mesh(prefix)
        meshes.add_mesh(pymeshlab.Mesh(vertices, triangles))
    measure.measure(lambda: None, lambda _: find_distance(meshes))


def files(path_a, path_b, _tolerance):
    def read():
        meshes = pymeshlab.MeshSet()
        for path in (path_a, path_b):
            meshes.load_new_mesh(path)
        return meshes

    measure.measure(read, find_distance)


if __name__ == "__main__":
    measure.main(hausdorff=hausdorff, files=files)
