#include "collide_overlap.h"
#include "collide_search.h"

/** Equal meshes need one tree. */
static qm_status collide_twins(qm_context *ctx, const qm_mesh *mesh, const qm_collide_options *options,
                               qm_collision *out)
{
    qm_bvh *tree;
    qm_status status = qm_bvh_build(ctx, mesh, QM_BVH_SOURCE, options->thread_count, &tree);
    if (status == QM_OK) status = qm_collide_meshes(ctx, tree, tree, options, out);
    qm_bvh_destroy(ctx, tree);
    return status;
}

/** With trees of whole meshes, or of the faces alone that may meet the other mesh. */
static qm_status collide_parts(qm_context *ctx, const qm_mesh *const mesh[2], const qm_overlap *overlap,
                               const qm_collide_options *options, qm_collision *out)
{
    qm_bvh *tree[2] = {NULL, NULL};
    qm_status status = QM_OK;
    int threads = options->thread_count;
    for (int side = 0; side < 2 && status == QM_OK; side++)
        status = overlap->is_whole
                     ? qm_bvh_build(ctx, mesh[side], QM_BVH_SOURCE, threads, &tree[side])
                     : qm_bvh_build_part(ctx, mesh[side], &overlap->part[side], threads, &tree[side]);
    if (status == QM_OK) status = qm_collide_meshes(ctx, tree[0], tree[1], options, out);
    qm_bvh_destroy(ctx, tree[1]);
    qm_bvh_destroy(ctx, tree[0]);
    return status;
}

qm_status qm_collide_surfaces(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                              const qm_collide_options *options, qm_collision *out)
{
    *out = (qm_collision){0};
    qm_status status = qm_collide_check_options(ctx, options);
    if (status != QM_OK) return status;
    if (qm_collide_are_twins(a, b)) return collide_twins(ctx, a, options, out);
    qm_overlap overlap;
    status = qm_overlap_find(ctx, a, b, &overlap);
    if (status != QM_OK)
        qm_context_fail(ctx, status, "%s while looking for collisions", qm_status_text(status));
    else if (!overlap.is_empty)
        status = collide_parts(ctx, (const qm_mesh *const[2]){a, b}, &overlap, options, out);
    qm_overlap_reset(ctx, &overlap);
    return status;
}
