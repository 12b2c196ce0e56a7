#include "qm/collide.h"

#include <string.h>

#include "bvh/bvh_order.h"
#include "collide_search.h"
#include "core/clock.h"
#include "prim/predicates.h"

qm_collide_options qm_collide_options_default(void)
{
    return (qm_collide_options){
        .quads = QM_QUADS_TRIANGLES, .mode = QM_COLLIDE_ALL, .thread_count = 1, .pair_limit = 1u << 27};
}

/** The greatest coordinate of a surface is at most this. */
static double greatest_coordinate(const qm_bvh *bvh)
{
    const qm_frame *frame = &bvh->frame;
    double origin = fmax(fabs(frame->origin.x), fmax(fabs(frame->origin.y), fabs(frame->origin.z)));
    return origin + 2.0 * frame->inverse_scale;
}

qm_status qm_collide_check_scale(qm_context *ctx, const qm_bvh *a, const qm_bvh *b)
{
    if (!(greatest_coordinate(a) < QM_PREDICATE_LIMIT && greatest_coordinate(b) < QM_PREDICATE_LIMIT))
        return qm_context_fail(ctx, QM_E_SCALE, "coordinates are too large to compare exactly");
    double ratio = a->frame.scale * b->frame.inverse_scale;
    if (!(ratio <= QM_MAX_SCALE_RATIO && ratio >= 1.0 / QM_MAX_SCALE_RATIO))
        return qm_context_fail(ctx, QM_E_SCALE, "the sizes of the meshes differ beyond double precision");
    return QM_OK;
}

qm_status qm_collide_check_options(qm_context *ctx, const qm_collide_options *options)
{
    if (options->thread_count < 1)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "thread count must be 1 or more, got %d",
                               options->thread_count);
    if (options->quads == QM_QUADS_BILINEAR && !(options->tolerance > 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "tolerance must be > 0, got %g", options->tolerance);
    return QM_OK;
}

/** What fails with words of its own is told by them. */
static qm_status fail(qm_context *ctx, qm_status status, const qm_collide_options *options)
{
    if (status == QM_E_TOO_LARGE)
        return qm_context_fail(ctx, status, "more than %zu pairs of faces meet", options->pair_limit);
    if (status == QM_E_INDEX) return status;
    return qm_context_fail(ctx, status, "%s while looking for collisions", qm_status_text(status));
}

static uint32_t last_input_face(const qm_bvh *bvh)
{
    return qm_mesh_input_face(&bvh->mesh, (uint32_t)(qm_mesh_facet_count(&bvh->mesh) - 1));
}

static qm_status run(qm_collide_search *search, const qm_collide_changes *changes, qm_pair_list *list,
                     qm_collision *out)
{
    qm_context *ctx = search->ctx;
    qm_change_marks marks = {0};
    qm_status status = QM_OK;
    if (changes) {
        status = qm_change_marks_set(ctx, search->bvh[0], changes, &marks);
        if (status == QM_OK) status = qm_change_marks_keep(ctx, search->bvh[0], &marks, changes, list);
        search->marks = &marks;
    }
    if (status == QM_OK) status = qm_collide_run(search, list, &out->tests);
    if (changes) qm_change_marks_reset(ctx, search->bvh[0], &marks);
    const uint32_t last_face[2] = {last_input_face(search->bvh[0]), last_input_face(search->bvh[1])};
    if (status == QM_OK) status = qm_pair_list_finish(ctx, list, last_face, search->options, out);
    return status;
}

static qm_status collide(qm_collide_search *search, const qm_collide_changes *changes, qm_collision *out)
{
    qm_context *ctx = search->ctx;
    double start_ms = qm_clock_ms();
    qm_pair_list list = {0};
    *out = (qm_collision){0};
    qm_status status = qm_collide_check_options(ctx, search->options);
    if (status == QM_OK) status = qm_collide_check_scale(ctx, search->bvh[0], search->bvh[1]);
    if (status != QM_OK) return status;
    status = run(search, changes, &list, out);
    qm_pair_list_reset(ctx, &list);
    if (status != QM_OK) {
        qm_collision_reset(ctx, out);
        return fail(ctx, status, search->options);
    }
    out->elapsed_ms = qm_clock_ms() - start_ms;
    return QM_OK;
}

static bool arrays_are_equal(const void *a, const void *b, size_t size)
{
    return a == b || (a && b && memcmp(a, b, size) == 0);
}

bool qm_collide_are_twins(const qm_mesh *a, const qm_mesh *b)
{
    return a->vertex_count == b->vertex_count && a->face_count == b->face_count &&
           arrays_are_equal(a->positions, b->positions, a->vertex_count * 3 * sizeof *a->positions) &&
           arrays_are_equal(a->faces, b->faces, a->face_count * 4 * sizeof *a->faces) &&
           arrays_are_equal(a->face_origin, b->face_origin, a->face_count * sizeof *a->face_origin);
}

qm_status qm_collide_meshes(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                            const qm_collide_options *options, qm_collision *out)
{
    qm_collide_search search = {.ctx = ctx, .bvh = {a, b}, .options = options};
    bool has_patches = options->quads == QM_QUADS_BILINEAR && a->has_quads;
    if (!has_patches && qm_collide_are_twins(&a->mesh, &b->mesh)) {
        search.bvh[1] = a;
        search.kind = QM_COLLIDE_TWIN;
    }
    return collide(&search, NULL, out);
}

qm_status qm_collide_self(qm_context *ctx, const qm_bvh *bvh, const qm_collide_options *options,
                          const qm_collide_changes *changes, qm_collision *out)
{
    qm_collide_search search = {.ctx = ctx, .bvh = {bvh, bvh}, .kind = QM_COLLIDE_SELF, .options = options};
    return collide(&search, changes, out);
}

void qm_collision_reset(qm_context *ctx, qm_collision *collision)
{
    qm_context_free(ctx, collision->pairs, collision->pair_count, sizeof *collision->pairs);
    *collision = (qm_collision){0};
}
