"""Open3D: iterative closest points, point to plane, as its tutorials have it: Zhou, Park, Koltun, Open3D, 2018; and the metrics of
its compute_metrics.

peer_open3d.py align A B MOTIONS      A, moved by each motion, onto B, from its centroid on that of B
peer_open3d.py search A B MOTIONS     the same from where its search by features and random samples (RANSAC) ends
peer_open3d.py compare A B POINTS SEED LIMIT
"""
import time

import numpy
import open3d

import measure

POINTS = 16384
NEAR, EXACT = 1e-2, 1e-6
registration = open3d.pipelines.registration


def read(prefix):
    vertices, triangles = measure.read_mesh(prefix)
    mesh = open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(triangles))
    mesh.compute_vertex_normals()
    return vertices, mesh


def draw(mesh, count):
    open3d.utility.random.seed(1)
    return mesh.sample_points_uniformly(count, use_triangle_normal=True)


def refine(source, target, reach, start):
    found = registration.registration_icp(
        source, target, reach, start, registration.TransformationEstimationPointToPlane(),
        registration.ICPConvergenceCriteria(relative_fitness=1e-12, relative_rmse=1e-12, max_iteration=200))
    return found.transformation


def features(cloud, voxel):
    small = cloud.voxel_down_sample(voxel)
    small.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=2 * voxel, max_nn=30))
    return small, registration.compute_fpfh_feature(
        small, open3d.geometry.KDTreeSearchParamHybrid(radius=5 * voxel, max_nn=100))


def search(source, target, voxel):
    (a, features_a), (b, features_b) = features(source, voxel), features(target, voxel)
    checks = [registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
              registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel)]
    found = registration.registration_ransac_based_on_feature_matching(
        a, b, features_a, features_b, True, 1.5 * voxel, registration.TransformationEstimationPointToPoint(False), 3,
        checks, registration.RANSACConvergenceCriteria(100000, 0.999))
    return found.transformation


def run(kind, prefix_a, prefix_b, motions_path):
    vertices, mesh_a = read(prefix_a)
    others, mesh_b = read(prefix_b)
    diagonal = float(numpy.linalg.norm(others.max(0) - others.min(0)))
    motions = numpy.fromfile(motions_path).reshape(-1, 4, 4).transpose(0, 2, 1)
    cloud, target = draw(mesh_a, POINTS), draw(mesh_b, 4 * POINTS)
    resting_kb = measure.rest()

    def align(motion):
        source = open3d.geometry.PointCloud(cloud).transform(motion)
        start = time.perf_counter()
        if kind == "search":
            first = search(source, target, diagonal / 40)
            last = refine(source, target, diagonal / 40, first)
        else:
            first = numpy.eye(4)
            first[:3, 3] = target.get_center() - source.get_center()
            last = refine(source, target, diagonal, first)
            last = refine(source, target, diagonal / 40, last)
        return 1e3 * (time.perf_counter() - start), last

    def end(motion, transform):
        whole = transform @ motion
        return vertices @ whole[:3, :3].T + whole[:3, 3]

    still = end(numpy.eye(4), align(numpy.eye(4))[1])
    times, placed, exact = [], 0, 0
    for motion in motions:
        ms, transform = align(motion)
        times.append(ms)
        at = end(motion, transform)
        placed += numpy.linalg.norm(at - vertices, axis=1).max() <= NEAR * diagonal
        exact += numpy.linalg.norm(at - still, axis=1).max() <= EXACT * diagonal
    measure.tell({"motions": len(motions), "placed": int(placed), "exact": int(exact), "build_ms": [0.0] * len(times),
                  "query_ms": times, "resting_kb": resting_kb, "peak_kb": measure.memory_kb("VmHWM")})


def compare(prefix_a, prefix_b, count, seed, limit):
    """Samples of each surface from the faces of the other one, in single precision. It gives no mean of one direction."""
    meshes = []
    for prefix in (prefix_a, prefix_b):
        vertices, triangles = measure.read_mesh(prefix)
        meshes.append(open3d.t.geometry.TriangleMesh(open3d.core.Tensor(vertices.astype(numpy.float32)),
                                                     open3d.core.Tensor(triangles)))
    open3d.utility.random.seed(int(seed))
    resting_kb = measure.rest()
    start = time.perf_counter()
    metric = open3d.t.geometry.Metric
    found = meshes[0].compute_metrics(meshes[1], [metric.ChamferDistance, metric.HausdorffDistance, metric.FScore],
                                      open3d.t.geometry.MetricParameters(fscore_radius=[float(limit)],
                                                                         n_sampled_points=int(count))).numpy()
    ms = 1e3 * (time.perf_counter() - start)
    measure.tell({"chamfer": float(found[0]), "hausdorff": float(found[1]), "f_score": float(found[2]) / 100,
                  "build_ms": [0.0], "query_ms": [ms], "resting_kb": resting_kb, "peak_kb": measure.memory_kb("VmHWM")})


if __name__ == "__main__":
    measure.main(align=lambda *words: run("align", *words), search=lambda *words: run("search", *words), compare=compare)
