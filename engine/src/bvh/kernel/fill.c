/**
 * fill.c: makes packs from the corners of eight triangles, QM_WIDTH at a time. bvh_tree.h defines the
 * components.
 */
#include "kernels.h"
#include "simd.h"

#define WIDE qm_vd
#define WIDE_MASK qm_vl
#define WIDE_SET(x) qm_vd_set(x)
#define WIDE_SQRT(a) qm_vd_sqrt(a)
#define WIDE_SELECT(mask, a, b) qm_vd_select(mask, a, b)
#define WIDE_FLAT 0x1p-50
#define WIDE_SHORT (QM_MIN_LENGTH * QM_MIN_LENGTH)
#include "frames.inc"

static inline wide_vec load(const double corner[3][QM_PACK_LANES], int at)
{
    return (wide_vec){qm_vd_load(corner[0] + at), qm_vd_load(corner[1] + at), qm_vd_load(corner[2] + at)};
}

/** 1 / a, and 0 where a is 0 */
static inline qm_vd inverse_or_zero(qm_vd a)
{
    const qm_vd zero = qm_vd_set(0.0), one = qm_vd_set(1.0);
    qm_vl positive = a > zero;
    return qm_vd_select(positive, one / qm_vd_select(positive, a, one), zero);
}

static inline wide_vec cross(wide_vec a, wide_vec b)
{
    return (wide_vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

void QM_KERNEL(fill_pack)(qm_pack *pack, const double corner[3][3][QM_PACK_LANES])
{
    for (int at = 0; at < QM_PACK_LANES; at += QM_WIDTH) {
        wide_frame f = wide_frame_make(load(corner[0], at), load(corner[1], at), load(corner[2], at));
        wide_vec z = cross(f.x, f.y);
        qm_vd dx = f.cx - f.length;
        const qm_vd component[QM_PACK_COMPONENTS] = {
            f.origin.x,
            f.origin.y,
            f.origin.z,
            f.x.x,
            f.x.y,
            f.x.z,
            f.y.x,
            f.y.y,
            f.y.z,
            z.x,
            z.y,
            z.z,
            f.length,
            f.cx,
            f.cy,
            inverse_or_zero(f.cx * f.cx + f.cy * f.cy),
            inverse_or_zero(dx * dx + f.cy * f.cy),
        };
        for (int i = 0; i < QM_PACK_COMPONENTS; i++)
            qm_vd_store(&pack->row[i][at], component[i]);
    }
}
