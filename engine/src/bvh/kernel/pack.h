/**
 * pack.h: distance from a point to the triangles of a pack, QM_WIDTH at a time, without a branch.
 *
 * In the frame of its longest edge (bvh_tree.h) a triangle is (0, 0), (L, 0), (CX, CY). The squared distance
 * is the height over the plane squared, plus nothing inside, plus the min squared distance to an edge
 * outside. Every term is a sum of squares of differences: no cancellation.
 */
#ifndef QM_KERNEL_PACK_H
#define QM_KERNEL_PACK_H

#include "bvh/kernel.h"
#include "simd.h"

static inline qm_vd qm_vd_clamp01(qm_vd t)
{
    return qm_vd_min(qm_vd_max(t, qm_vd_set(0.0)), qm_vd_set(1.0));
}

static inline qm_vd qm_pack_part_d2(const qm_pack *pack, int part, qm_vd px, qm_vd py, qm_vd pz)
{
#define COMPONENT(name) qm_vd_load(&pack->row[QM_PACK_##name][part * QM_WIDTH])
    const qm_vd zero = qm_vd_set(0.0);
    qm_vd dx = px - COMPONENT(OX), dy = py - COMPONENT(OY), dz = pz - COMPONENT(OZ);
    qm_vd x = dx * COMPONENT(XX) + dy * COMPONENT(XY) + dz * COMPONENT(XZ);
    qm_vd y = dx * COMPONENT(YX) + dy * COMPONENT(YY) + dz * COMPONENT(YZ);
    qm_vd z = dx * COMPONENT(ZX) + dy * COMPONENT(ZY) + dz * COMPONENT(ZZ);
    qm_vd length = COMPONENT(L), cx = COMPONENT(CX), cy = COMPONENT(CY);

    qm_vd ax = x - qm_vd_min(qm_vd_max(x, zero), length);
    qm_vd edge2 = ax * ax + y * y;

    qm_vd t = qm_vd_clamp01((x * cx + y * cy) * COMPONENT(INVERSE_C2));
    qm_vd bx = x - t * cx, by = y - t * cy;
    edge2 = qm_vd_min(edge2, bx * bx + by * by);

    qm_vd ex = cx - length, xl = x - length;
    qm_vd s = qm_vd_clamp01((xl * ex + y * cy) * COMPONENT(INVERSE_D2));
    qm_vd gx = xl - s * ex, gy = y - s * cy;
    edge2 = qm_vd_min(edge2, gx * gx + gy * gy);

    qm_vl inside = (y > zero) & (cy * x - cx * y > zero) & (ex * y - cy * xl > zero);
    return qm_vd_select(inside, zero, edge2) + z * z;
#undef COMPONENT
}

/** A point broadcast to all lanes, for qm_pack_part_d2. */
typedef struct qm_splat {
    qm_vd x, y, z;
} qm_splat;

static inline qm_splat qm_splat_make(qm_vec p)
{
    return (qm_splat){qm_vd_set(p.x), qm_vd_set(p.y), qm_vd_set(p.z)};
}

/** Squared distances to all eight lanes. */
static inline void qm_pack_d2(const qm_pack *pack, qm_vec p, double d2[QM_PACK_LANES])
{
    qm_splat s = qm_splat_make(p);
    for (int part = 0; part < QM_PARTS; part++)
        qm_vd_store(d2 + part * QM_WIDTH, qm_pack_part_d2(pack, part, s.x, s.y, s.z));
}

#endif
