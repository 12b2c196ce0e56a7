/**
 * fit.c: the box of a pack from where its vertices are now, all axes at once.
 */
#include "../bvh_tree.h"
#include "kernels.h"

/** x, y, z and nothing. */
typedef double four __attribute__((vector_size(32)));

static inline four load_position(const double *p)
{
#if defined(__AVX2__)
    return (four)_mm256_maskload_pd(p, _mm256_set_epi64x(0, -1, -1, -1));
#else
    return (four){p[0], p[1], p[2], 0.0};
#endif
}

static inline four least(four a, four b)
{
#if defined(__AVX__)
    return (four)_mm256_min_pd((__m256d)a, (__m256d)b);
#else
    typedef int64_t mask __attribute__((vector_size(32)));
    mask below = a < b;
    return (four)(((mask)a & below) | ((mask)b & ~below));
#endif
}

static inline four greatest(four a, four b)
{
#if defined(__AVX__)
    return (four)_mm256_max_pd((__m256d)a, (__m256d)b);
#else
    typedef int64_t mask __attribute__((vector_size(32)));
    mask above = a > b;
    return (four)(((mask)a & above) | ((mask)b & ~above));
#endif
}

/** Made local, the box in the mesh is that of the local vertices, since rounding keeps order. */
void QM_KERNEL(fit_box)(qm_bvh *bvh, size_t pack)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    const double *positions = bvh->mesh.positions;
    four low = load_position(positions + 3 * (size_t)lanes->vertex[0]), high = low;
    int count = lanes->vertex_count;
    for (int i = 1; i < count; i++) {
        four p = load_position(positions + 3 * (size_t)lanes->vertex[i]);
        low = least(low, p);
        high = greatest(high, p);
    }
    const qm_frame *frame = &bvh->frame;
    const four origin = {frame->origin.x, frame->origin.y, frame->origin.z, 0.0};
    four from = (low - origin) * frame->scale, to = (high - origin) * frame->scale;
    qm_box box = {{from[0], from[1], from[2]}, {to[0], to[1], to[2]}};
    qm_box_tree_set(&bvh->boxes, pack, &box);
}
