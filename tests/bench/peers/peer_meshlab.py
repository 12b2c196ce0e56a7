"""pymeshlab: the distance from samples of A, which is a lower bound with no upper one.

peer_meshlab.py hausdorff A B TOLERANCE     the tolerance is not looked at
peer_meshlab.py compare A B POINTS SEED LIMIT   samples of each surface from the other one's faces; no F-score, and the seed is its own
peer_meshlab.py files A B TOLERANCE         files of meshes, which it reads itself
"""
import time

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


def compare(prefix_a, prefix_b, count, _seed, _limit):
    meshes = pymeshlab.MeshSet()
    for prefix in (prefix_a, prefix_b):
        meshes.add_mesh(pymeshlab.Mesh(*measure.read_mesh(prefix)))
    resting_kb = measure.rest()
    start = time.perf_counter()
    ways = [meshes.get_hausdorff_distance(sampledmesh=i, targetmesh=1 - i, samplevert=False, sampleface=True, samplenum=int(count),
                                          maxdist=pymeshlab.PercentageValue(100)) for i in range(2)]
    ms = 1e3 * (time.perf_counter() - start)
    measure.tell({"mean": ways[0]["mean"], "chamfer": ways[0]["mean"] + ways[1]["mean"],
                  "hausdorff": max(way["max"] for way in ways), "build_ms": [0.0], "query_ms": [ms],
                  "resting_kb": resting_kb, "peak_kb": measure.memory_kb("VmHWM")})


if __name__ == "__main__":
    measure.main(hausdorff=hausdorff, compare=compare, files=files)
