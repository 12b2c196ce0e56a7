"""pymeshlab: the distance from samples of A, which is a lower bound with no upper one.

peer_meshlab.py hausdorff A B TOLERANCE     the tolerance is not looked at
"""
import pymeshlab

import measure

SAMPLES = 1000000


def hausdorff(prefix_a, prefix_b, _tolerance):
    meshes = pymeshlab.MeshSet()
    for prefix in (prefix_a, prefix_b):
        vertices, triangles = measure.read_mesh(prefix)
        meshes.add_mesh(pymeshlab.Mesh(vertices, triangles))

    def query(_):
        result = meshes.get_hausdorff_distance(sampledmesh=0, targetmesh=1, samplevert=True, sampleface=True,
                                               samplenum=SAMPLES, maxdist=pymeshlab.PercentageValue(100))
        return lambda: {"lower": result["max"], "upper": None}

    measure.measure(lambda: None, query)


if __name__ == "__main__":
    measure.main(hausdorff=hausdorff)
