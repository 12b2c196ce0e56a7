#include "collide_pairs.h"

/** Room for one more row than there may be none, so that there is always an array. */
static size_t row_count(const qm_told_pairs *told)
{
    return 2 * told->found.pair_count + 1;
}

static qm_status tell(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, const qm_collide_options *options,
                      size_t list_limit, qm_told_pairs *out)
{
    const qm_collision *found = &out->found;
    size_t listed = found->pair_count < list_limit ? found->pair_count : list_limit;
    out->rows = qm_context_alloc(ctx, row_count(out), sizeof *out->rows);
    if (listed > 0) out->contacts = qm_context_alloc(ctx, listed, sizeof *out->contacts);
    if (!out->rows || (listed > 0 && !out->contacts))
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the pairs");
    out->listed_count = listed;
    for (size_t i = 0; i < found->pair_count; i++) {
        out->rows[2 * i] = found->pairs[i].a;
        out->rows[2 * i + 1] = found->pairs[i].b;
    }
    for (size_t i = 0; i < listed; i++) {
        if (i % 1024 == 0 && qm_context_canceled(ctx)) return QM_E_CANCELED;
        qm_collide_contact(a, b, options, found->pairs[i], &out->contacts[i]);
    }
    return QM_OK;
}

/** Meshes that were loaded without trees need only those of the faces near each other. */
static qm_status collide_two(qm_context *ctx, const qm_loaded_mesh *a, const qm_loaded_mesh *b,
                             const qm_collide_options *options, qm_collision *out)
{
    if (a->bvh && b->bvh) return qm_collide_meshes(ctx, a->bvh, b->bvh, options, out);
    return qm_collide_surfaces(ctx, &a->mesh, &b->mesh, options, out);
}

/** All pairs are kept for the next time; the first, or any, would not do. */
static qm_status collide_self(qm_context *ctx, const qm_loaded_mesh *mesh, const qm_collide_options *options,
                              bool incremental, qm_told_pairs *out)
{
    qm_collide_changes changes;
    bool finds_all = options->mode == QM_COLLIDE_ALL && mesh->self_pairs;
    out->is_incremental =
        finds_all && incremental && qm_self_pairs_recall(mesh->self_pairs, options, &changes);
    qm_status status =
        qm_collide_self(ctx, mesh->bvh, options, out->is_incremental ? &changes : NULL, &out->found);
    if (status == QM_OK && finds_all)
        qm_self_pairs_keep(mesh->self_pairs, options, out->found.pairs, out->found.pair_count);
    if (out->is_incremental) qm_self_pairs_release(&changes);
    return status;
}

qm_status qm_told_pairs_find(qm_context *ctx, const qm_loaded_mesh *a, const qm_loaded_mesh *b,
                             const qm_collide_options *options, bool incremental, size_t list_limit,
                             qm_told_pairs *out)
{
    *out = (qm_told_pairs){0};
    qm_status status =
        b ? collide_two(ctx, a, b, options, &out->found) : collide_self(ctx, a, options, incremental, out);
    if (status == QM_OK) status = tell(ctx, &a->mesh, b ? &b->mesh : &a->mesh, options, list_limit, out);
    if (status != QM_OK) qm_told_pairs_reset(ctx, out);
    return status;
}

void qm_told_pairs_reset(qm_context *ctx, qm_told_pairs *told)
{
    qm_context_free(ctx, told->rows, row_count(told), sizeof *told->rows);
    qm_context_free(ctx, told->contacts, told->listed_count, sizeof *told->contacts);
    qm_collision_reset(ctx, &told->found);
    *told = (qm_told_pairs){0};
}
