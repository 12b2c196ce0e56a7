"""The figures of a comparison from distances of samples, as papers compute them; what all peers that sample share."""
import time

import numpy

import measure


def compare(words, read, distances):
    """distances(mesh, count, seed, other): of points drawn on the mesh from the other one."""
    prefix_a, prefix_b, count, seed, limit = words
    a, b = read(prefix_a), read(prefix_b)
    count, seed, limit = int(count), int(seed), float(limit)
    resting_kb = measure.rest()
    start = time.perf_counter()
    there, back = distances(a, count, seed, b), distances(b, count, seed + 1000, a)
    precision, recall = numpy.mean(there <= limit), numpy.mean(back <= limit)
    f_score = 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0
    ms = 1e3 * (time.perf_counter() - start)
    measure.tell({"mean": float(there.mean()), "hausdorff": float(max(there.max(), back.max())),
                  "chamfer": float(there.mean() + back.mean()), "f_score": float(f_score),
                  "build_ms": [0.0], "query_ms": [ms], "resting_kb": resting_kb, "peak_kb": measure.memory_kb("VmHWM")})
