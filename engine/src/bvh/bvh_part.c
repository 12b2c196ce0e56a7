#include "bvh_part.h"

#include "bvh_order.h"

/** The box of a part's vertices. */
static qm_box box_of_part(const qm_mesh *mesh, const qm_bvh_part *part)
{
    qm_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t i = 0; i < part->count; i++) {
        const uint32_t *corner = mesh->faces + 4 * (size_t)(part->entries[i] & QM_RADIX_INDEX_MASK);
        for (int c = 0; c < 4 && corner[c] != QM_NO_INDEX; c++) {
            const double *p = mesh->positions + 3 * (size_t)corner[c];
            for (int k = 0; k < 3; k++) {
                box.min[k] = fmin(box.min[k], p[k]);
                box.max[k] = fmax(box.max[k], p[k]);
            }
        }
    }
    return box;
}

/** In the frame of the box; in a narrower one when the faces take little of it. */
static qm_status build(qm_context *ctx, qm_bvh *bvh, const qm_bvh_part *part, int thread_count)
{
    qm_bvh_faces faces = {part->entries, part->count, part->quad_count};
    bvh->frame = qm_frame_make(&part->box);
    qm_status status = qm_bvh_build_ordered(ctx, bvh, QM_BVH_SOURCE, thread_count, &faces);
    if (status != QM_OK || !qm_bvh_frame_is_wide(bvh)) return status;
    qm_bvh_reset(ctx, bvh);
    qm_box box = box_of_part(&bvh->mesh, part);
    bvh->frame = qm_frame_make(&box);
    return qm_bvh_build_ordered(ctx, bvh, QM_BVH_SOURCE, thread_count, &faces);
}

qm_status qm_bvh_build_part(qm_context *ctx, const qm_mesh *mesh, const qm_bvh_part *part, int thread_count,
                            qm_bvh **out)
{
    *out = NULL;
    qm_status status = qm_radix_sort(ctx, part->entries, part->count, part->key_bits, thread_count);
    qm_bvh *bvh = status == QM_OK ? qm_context_alloc(ctx, 1, sizeof *bvh) : NULL;
    if (bvh) {
        *bvh = (qm_bvh){.mesh = *mesh};
        status = build(ctx, bvh, part, thread_count);
    }
    if (status == QM_OK && !bvh) status = QM_E_NO_MEMORY;
    if (status != QM_OK) {
        qm_bvh_destroy(ctx, bvh);
        return qm_context_fail(ctx, status, "%s while building the tree", qm_status_text(status));
    }
    *out = bvh;
    return QM_OK;
}
