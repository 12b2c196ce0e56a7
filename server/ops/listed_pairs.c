/**
 * listed_pairs.c: runs the engine's collision search and computes the contacts of the first pairs.
 */
#include "listed_pairs.h"

#include <math.h>

/** Numbers of the array of faces; one more than needed, so that the array is never empty. */
static size_t face_capacity(const qm_listed_pairs *pairs)
{
    return 2 * pairs->found.pair_count + 1;
}

static qm_status list_pairs(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                            const qm_collide_options *options, size_t list_limit, qm_listed_pairs *out)
{
    const qm_collision *found = &out->found;
    size_t listed = found->pair_count < list_limit ? found->pair_count : list_limit;
    out->faces = qm_context_alloc(ctx, face_capacity(out), sizeof *out->faces);
    if (listed > 0) out->contacts = qm_context_alloc(ctx, listed, sizeof *out->contacts);
    if (!out->faces || (listed > 0 && !out->contacts))
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the pairs");
    QM_ASSERT(listed <= found->pair_count);
    out->listed_count = listed;
    for (size_t i = 0; i < found->pair_count; i++) {
        out->faces[2 * i] = found->pairs[i].a;
        out->faces[2 * i + 1] = found->pairs[i].b;
    }
    for (size_t i = 0; i < listed; i++) {
        if (i % 1024 == 0 && qm_context_canceled(ctx)) return QM_E_CANCELED;
        /* A point that is not known is written as null, with normals of 0: of patches at the very limit of the tolerance, which the search
         * measures in another order. */
        out->contacts[i] =
            (qm_contact){.kind = QM_CONTACT_POINT, .point = {{NAN, NAN, NAN}, {NAN, NAN, NAN}}};
        qm_collide_contact(a, b, options, found->pairs[i], &out->contacts[i]);
    }
    return QM_OK;
}

/** Meshes without trees: the engine builds trees of the faces near the other mesh only. */
static qm_status collide_two(qm_context *ctx, const qm_loaded_mesh *a, const qm_loaded_mesh *b,
                             const qm_collide_options *options, qm_collision *out)
{
    if (a->bvh && b->bvh) return qm_collide_meshes(ctx, a->bvh, b->bvh, options, out);
    return qm_collide_surfaces(ctx, &a->mesh, &b->mesh, options, out);
}

/** The mesh keeps the pairs for the next incremental search if they are complete (not the first, or any). */
static qm_status collide_self(qm_context *ctx, const qm_loaded_mesh *mesh, const qm_collide_options *options,
                              bool incremental, qm_listed_pairs *out)
{
    qm_collide_changes changes;
    bool is_complete = options->mode == QM_COLLIDE_ALL && mesh->self_pairs;
    out->is_incremental =
        is_complete && incremental && qm_self_pairs_recall(mesh->self_pairs, options, &changes);
    qm_status status =
        qm_collide_self(ctx, mesh->bvh, options, out->is_incremental ? &changes : NULL, &out->found);
    if (status == QM_OK && is_complete)
        qm_self_pairs_keep(mesh->self_pairs, options, out->found.pairs, out->found.pair_count);
    if (out->is_incremental) qm_self_pairs_release(&changes);
    return status;
}

qm_status qm_listed_pairs_find(qm_context *ctx, const qm_loaded_mesh *a, const qm_loaded_mesh *b,
                               const qm_collide_options *options, bool incremental, size_t list_limit,
                               qm_listed_pairs *out)
{
    *out = (qm_listed_pairs){0};
    qm_status status =
        b ? collide_two(ctx, a, b, options, &out->found) : collide_self(ctx, a, options, incremental, out);
    if (status == QM_OK)
        status = list_pairs(ctx, &a->mesh, b ? &b->mesh : &a->mesh, options, list_limit, out);
    if (status != QM_OK) qm_listed_pairs_reset(ctx, out);
    return status;
}

void qm_listed_pairs_reset(qm_context *ctx, qm_listed_pairs *pairs)
{
    qm_context_free(ctx, pairs->faces, face_capacity(pairs), sizeof *pairs->faces);
    qm_context_free(ctx, pairs->contacts, pairs->listed_count, sizeof *pairs->contacts);
    qm_collide_reset(ctx, &pairs->found);
    *pairs = (qm_listed_pairs){0};
}
