/**
 * corners.c: the corners of a whole pack from the current positions of its vertices, each of which is loaded
 * once.
 */
#include <string.h>

#include "extent.h"
#include "kernels.h"

/** Transposes positions to coordinates by axis. They are stored as whole vectors, which loads of whole
 * vectors need not wait for. */
static inline void transpose(const qm_four position[QM_PACK_LANES], qm_eight row[3])
{
    qm_four half[2][3];
    for (int i = 0; i < 2; i++) {
        const qm_four *p = position + 4 * i;
        const qm_four xz = __builtin_shufflevector(p[0], p[1], 0, 4, 2, 6);
        const qm_four xz_next = __builtin_shufflevector(p[2], p[3], 0, 4, 2, 6);
        const qm_four y = __builtin_shufflevector(p[0], p[1], 1, 5, 3, 7);
        const qm_four y_next = __builtin_shufflevector(p[2], p[3], 1, 5, 3, 7);
        half[i][0] = __builtin_shufflevector(xz, xz_next, 0, 1, 4, 5);
        half[i][1] = __builtin_shufflevector(y, y_next, 0, 1, 4, 5);
        half[i][2] = __builtin_shufflevector(xz, xz_next, 2, 3, 6, 7);
    }
    for (int k = 0; k < 3; k++)
        row[k] = __builtin_shufflevector(half[0][k], half[1][k], 0, 1, 2, 3, 4, 5, 6, 7);
}

/** Loads the vertices of a pack, local. Returns their extent. */
static inline extent load_vertices(const qm_bvh *bvh, const qm_pack_lanes *lanes,
                                   qm_four vertex[3 * QM_PACK_LANES])
{
    const qm_frame *frame = &bvh->frame;
    const qm_four origin = {frame->origin.x, frame->origin.y, frame->origin.z, 0.0};
    extent e = extent_of_nothing();
    for (int i = 0; i < lanes->vertex_count; i++) {
        const double *position = bvh->mesh.positions + 3 * (size_t)lanes->vertex[i];
        vertex[i] = (qm_four_position(position) - origin) * frame->scale;
        extent_add(&e, vertex[i]);
    }
    return e;
}

/** Stores the corners of all lanes; lanes past the last repeat the first. */
static inline void spread_vertices(const qm_pack_lanes *lanes, const qm_four vertex[3 * QM_PACK_LANES],
                                   qm_pack_corners *out)
{
    for (int i = 0; i < 3; i++) {
        qm_four corner[QM_PACK_LANES];
        for (int lane = 0; lane < QM_PACK_LANES; lane++)
            corner[lane] = vertex[lanes->corner[lane][i]];
        qm_eight row[3];
        transpose(corner, row);
        for (int k = 0; k < 3; k++)
            memcpy(out->at[i][k], &row[k], sizeof row[k]);
    }
}

void QM_KERNEL(load_corners)(const qm_bvh *bvh, size_t pack, qm_pack_corners *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    qm_four vertex[3 * QM_PACK_LANES];
    load_vertices(bvh, lanes, vertex);
    spread_vertices(lanes, vertex, out);
}

void QM_KERNEL(fit_corners)(qm_bvh *bvh, size_t pack, qm_pack_corners *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    qm_four vertex[3 * QM_PACK_LANES];
    const extent e = load_vertices(bvh, lanes, vertex);
    extent_set_box(bvh, 1, pack, &e);
    spread_vertices(lanes, vertex, out);
}
