/**
 * collide.c: the calls. Each is one search over two trees, or over one tree twice; after a deformation, over
 * the nodes alone that hold a face that has moved.
 *
 * A pair of faces can begin or cease to meet only when one of the two has moved. So the search is made for
 * pairs of nodes of which one is marked, and the previous pairs whose two faces have not moved are
 * taken over without a test.
 */
#include "qm/collide.h"

#include <string.h>

#include "bvh/bvh_build.h"
#include "collide_search.h"
#include "core/clock.h"
#include "prim/orient.h"

qm_collide_options qm_collide_options_default(void)
{
    return (qm_collide_options){
        .quads = QM_QUADS_TRIANGLES, .mode = QM_COLLIDE_ALL, .thread_count = 1, .pair_limit = 1u << 27};
}

/** An upper bound of the coordinates of a surface, by magnitude. */
static double max_coordinate(const qm_bvh *bvh)
{
    const qm_frame *frame = &bvh->frame;
    double origin = fmax(fabs(frame->origin.x), fmax(fabs(frame->origin.y), fabs(frame->origin.z)));
    return origin + 2.0 * frame->inverse_scale;
}

qm_status qm_collide_check_scale(qm_context *ctx, const qm_bvh *a, const qm_bvh *b)
{
    if (!(max_coordinate(a) < QM_ORIENT_LIMIT && max_coordinate(b) < QM_ORIENT_LIMIT))
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

/* ---- after a deformation ---- */

static uint8_t *alloc_zero(qm_context *ctx, size_t count)
{
    uint8_t *block = qm_context_alloc(ctx, count, 1);
    if (block) memset(block, 0, count);
    return block;
}

/** Marks the faces of the moved vertices and the nodes above them. An input face has moved when one of the
 * faces that it was cut into has. QM_OK; QM_E_INDEX (ctx->message names the entry); QM_E_NO_MEMORY.
 * reset_marks frees in any case. */
static qm_status set_marks(qm_context *ctx, const qm_bvh *bvh, const qm_collide_changes *changes,
                           qm_motion_marks *out)
{
    const qm_mesh *mesh = &bvh->mesh;
    *out = (qm_motion_marks){.vertex = alloc_zero(ctx, mesh->vertex_count),
                             .face = alloc_zero(ctx, qm_bvh_facet_count(mesh))};
    if (!out->vertex || !out->face) return QM_E_NO_MEMORY;
    for (int level = 0; level <= bvh->boxes.level_count; level++)
        if (!(out->level[level] = alloc_zero(ctx, bvh->boxes.group_count[level]))) return QM_E_NO_MEMORY;
    for (size_t i = 0; i < changes->vertex_count; i++) {
        if (changes->vertices[i] >= mesh->vertex_count)
            return qm_context_fail(ctx, QM_E_INDEX, "entry %zu names vertex %u of a mesh of %zu", i,
                                   changes->vertices[i], mesh->vertex_count);
        out->vertex[changes->vertices[i]] = 1;
    }
    for (size_t face = 0; face < qm_bvh_facet_count(mesh); face++) {
        uint8_t has_moved = 0;
        if (mesh->face_count == 0) {
            has_moved = out->vertex[face];
        } else {
            const uint32_t *corner = mesh->faces + 4 * face;
            has_moved = out->vertex[corner[0]] | out->vertex[corner[1]] | out->vertex[corner[2]];
            has_moved |= out->vertex[corner[3] == QM_NO_INDEX ? corner[0] : corner[3]];
        }
        if (has_moved) out->face[qm_mesh_input_face(mesh, (uint32_t)face)] = 1;
    }
    for (size_t pack = 0; pack < bvh->pack_count; pack++) {
        const qm_pack_lanes *lanes = &bvh->lanes[pack];
        unsigned bits = 0;
        for (unsigned lane = 0; lane < lanes->lane_count; lane++)
            bits |= (unsigned)out->face[qm_mesh_input_face(mesh, lanes->face[lane])] << lane;
        out->level[0][pack] = (uint8_t)bits;
    }
    for (int level = 1; level <= bvh->boxes.level_count; level++)
        for (size_t i = 0; i < bvh->boxes.group_count[level - 1]; i++)
            out->level[level][i / 8] |= out->level[level - 1][i] != 0;
    return QM_OK;
}

/** Adds the previous pairs whose faces have not moved: they still meet. QM_OK; QM_E_INDEX; QM_E_NO_MEMORY. */
static qm_status keep_unmoved_pairs(qm_context *ctx, const qm_bvh *bvh, const qm_motion_marks *marks,
                                    const qm_collide_changes *changes, qm_pair_list *list)
{
    size_t count = qm_bvh_facet_count(&bvh->mesh);
    for (size_t i = 0; i < changes->pair_count; i++) {
        qm_face_pair pair = changes->pairs[i];
        if (pair.a >= count || pair.b >= count)
            return qm_context_fail(ctx, QM_E_INDEX, "previous pair %zu has a face index out of range", i);
        if (marks->face[pair.a] || marks->face[pair.b]) continue;
        if (!qm_pair_list_add(ctx, list, pair)) return QM_E_NO_MEMORY;
    }
    return QM_OK;
}

/* ---- one search ---- */

static uint32_t last_input_face(const qm_bvh *bvh)
{
    return qm_mesh_input_face(&bvh->mesh, (uint32_t)(qm_bvh_facet_count(&bvh->mesh) - 1));
}

static qm_status collide(qm_collide_search *search, const qm_collide_changes *changes, qm_collision *out)
{
    qm_context *ctx = search->ctx;
    const qm_bvh *a = search->bvh[0], *b = search->bvh[1];
    double start_ms = qm_clock_ms();
    *out = (qm_collision){0};
    qm_status status = qm_collide_check_options(ctx, search->options);
    if (status == QM_OK) status = qm_collide_check_scale(ctx, a, b);
    if (status != QM_OK) return status;

    qm_pair_list list = {0};
    qm_motion_marks marks = {0};
    if (changes) {
        status = set_marks(ctx, a, changes, &marks);
        if (status == QM_OK) status = keep_unmoved_pairs(ctx, a, &marks, changes, &list);
        search->marks = &marks;
    }
    if (status == QM_OK) status = qm_collide_run(search, &list, &out->tests);
    for (int level = 0; level <= a->boxes.level_count; level++)
        qm_context_free(ctx, marks.level[level], a->boxes.group_count[level], 1);
    qm_context_free(ctx, marks.face, qm_bvh_facet_count(&a->mesh), 1);
    qm_context_free(ctx, marks.vertex, a->mesh.vertex_count, 1);
    const uint32_t last_face[2] = {last_input_face(a), last_input_face(b)};
    if (status == QM_OK) status = qm_pair_list_finish(ctx, &list, last_face, search->options, out);
    qm_pair_list_reset(ctx, &list);

    if (status == QM_OK) {
        out->elapsed_ms = qm_clock_ms() - start_ms;
        return QM_OK;
    }
    qm_collide_reset(ctx, out);
    if (status == QM_E_INDEX) return status; /* it has a message already */
    if (status == QM_E_TOO_LARGE)
        return qm_context_fail(ctx, status, "more than %zu pairs of faces meet", search->options->pair_limit);
    return qm_context_fail(ctx, status, "%s while looking for collisions", qm_status_text(status));
}

/* ---- the calls ---- */

static bool arrays_are_equal(const void *a, const void *b, size_t size)
{
    return a == b || (a && b && memcmp(a, b, size) == 0);
}

bool qm_collide_are_identical(const qm_mesh *a, const qm_mesh *b)
{
    return a->vertex_count == b->vertex_count && a->face_count == b->face_count &&
           arrays_are_equal(a->positions, b->positions, a->vertex_count * 3 * sizeof *a->positions) &&
           arrays_are_equal(a->faces, b->faces, a->face_count * 4 * sizeof *a->faces) &&
           arrays_are_equal(a->face_origin, b->face_origin, a->face_count * sizeof *a->face_origin);
}

qm_status qm_collide_meshes(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                            const qm_collide_options *options, qm_collision *out)
{
    QM_ASSERT(ctx && a && b && options && out);
    qm_collide_search search = {.ctx = ctx, .bvh = {a, b}, .options = options};
    bool has_patches = options->quads == QM_QUADS_BILINEAR && a->has_quads;
    if (!has_patches && qm_collide_are_identical(&a->mesh, &b->mesh)) {
        search.bvh[1] = a;
        search.kind = QM_COLLIDE_COPY;
    }
    return collide(&search, NULL, out);
}

qm_status qm_collide_self(qm_context *ctx, const qm_bvh *bvh, const qm_collide_options *options,
                          const qm_collide_changes *changes, qm_collision *out)
{
    QM_ASSERT(ctx && bvh && options && out);
    qm_collide_search search = {.ctx = ctx, .bvh = {bvh, bvh}, .kind = QM_COLLIDE_SELF, .options = options};
    return collide(&search, changes, out);
}

void qm_collide_reset(qm_context *ctx, qm_collision *collision)
{
    QM_ASSERT(collision->pairs || collision->pair_count == 0);
    qm_context_free(ctx, collision->pairs, collision->pair_count, sizeof *collision->pairs);
    *collision = (qm_collision){0};
}
