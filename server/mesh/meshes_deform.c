/**
 * meshes_deform.c: the next revision of a mesh. It is on disk before memory changes, so that a revision which
 * a client knows survives, and a fault leaves the revision before.
 */
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/host.h"
#include "base/log.h"
#include "meshes.h"
#include "meshes_internal.h"

/** The state of one deformation. */
typedef struct deform_task {
    qm_meshes *meshes;
    const qm_moved_vertices *moved;
    qm_mesh_ref *ref;
    qm_store_mesh row; /* of the next revision */
    double *positions; /* of the next revision, until the mesh takes them over */
    qm_deformed *out;
    qm_problem *problem;
} deform_task;

static size_t vertex_count(const deform_task *work)
{
    return work->ref->mesh.mesh.vertex_count;
}

static bool fail(deform_task *work, qm_problem_code code, const char *detail)
{
    *work->problem = qm_problem_make(code, "%s", detail);
    return false;
}

static bool move_some(deform_task *work)
{
    const qm_moved_vertices *moved = work->moved;
    for (size_t i = 0; i < moved->count; i++) {
        if (moved->indices[i] >= vertex_count(work)) {
            char pointer[48];
            snprintf(pointer, sizeof pointer, "/indices/%zu", i);
            *work->problem =
                qm_problem_make(QM_PROBLEM_INDEX_OUT_OF_RANGE,
                                "entry %zu is vertex %u; the mesh has %zu vertices, numbered from 0", i,
                                moved->indices[i], vertex_count(work));
            qm_problem_add_pointer(work->problem, pointer, "no such vertex");
            return false;
        }
        memcpy(work->positions + 3 * (size_t)moved->indices[i], moved->positions + 3 * i, 3 * sizeof(double));
    }
    return true;
}

static bool move_all(deform_task *work)
{
    if (work->moved->count != vertex_count(work)) {
        *work->problem = qm_problem_make(QM_PROBLEM_MALFORMED_BODY,
                                         "the body has %zu positions; the mesh has %zu vertices",
                                         work->moved->count, vertex_count(work));
        return false;
    }
    memcpy(work->positions, work->moved->positions, work->moved->count * 3 * sizeof(double));
    return true;
}

/** Makes the positions and checks that they are within the limits of a mesh. */
static bool make_positions(deform_task *work, qm_context *ctx)
{
    const qm_mesh *mesh = &work->ref->mesh.mesh;
    work->positions = qm_context_alloc(ctx, mesh->vertex_count, 3 * sizeof *work->positions);
    if (!work->positions) return fail(work, QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the vertices");
    memcpy(work->positions, mesh->positions, mesh->vertex_count * 3 * sizeof *work->positions);
    if (!(work->moved->indices ? move_some(work) : move_all(work))) return false;
    qm_mesh next = *mesh;
    next.positions = work->positions;
    qm_status status = qm_mesh_validate(ctx, &next);
    if (status != QM_OK) *work->problem = qm_problem_from_status(status, ctx->message);
    return status == QM_OK;
}

static bool write_positions(deform_task *work)
{
    qm_blob_writer *writer;
    if (qm_blob_begin(work->meshes->store, &writer) != QM_OK) return false;
    size_t size = vertex_count(work) * 3 * sizeof *work->positions;
    if (qm_blob_write(writer, work->positions, size) == QM_OK &&
        qm_blob_seal(writer, work->row.positions) == QM_OK)
        return qm_blob_keep(writer) == QM_OK;
    qm_blob_abort(writer);
    return false;
}

/** The row of the next revision. It leaves the content index: an upload of the original bytes makes a new
 * mesh. */
static bool make_row(deform_task *work)
{
    qm_loaded_mesh next = work->ref->mesh;
    next.mesh.positions = work->positions;
    next.box = qm_mesh_bounding_box(&next.mesh);
    next.diagonal = qm_box_diagonal(&next.box);
    next.revision = ++work->row.revision;
    free(work->row.document);
    work->row.document = qm_meshes_make_document(&work->row, &next);
    qm_text options = {0};
    qm_text_printf(&options, "deformed %s", work->row.id);
    free(work->row.options);
    work->row.options = qm_text_take(&options);
    return work->row.document && work->row.options;
}

static bool store_revision(deform_task *work)
{
    if (!make_row(work)) return fail(work, QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the mesh");
    if (!write_positions(work)) return fail(work, QM_PROBLEM_UNAVAILABLE, "the vertices could not be stored");
    if (qm_store_deform_mesh(work->meshes->store, &work->row) == QM_OK) return true;
    qm_blob_remove(work->meshes->store, work->row.positions);
    return fail(work, QM_PROBLEM_UNAVAILABLE, "the revision could not be stored");
}

/** True when only the list and this deformation hold the mesh: other threads then wait for it. */
static bool take_alone(deform_task *work)
{
    uv_mutex_lock(&work->meshes->lock);
    bool is_alone = work->ref->references == 2 && work->ref->listed;
    if (is_alone) work->ref->state = QM_MESH_LOADING;
    uv_mutex_unlock(&work->meshes->lock);
    return is_alone;
}

/** Releases a mesh that was changed in place. After a failure it is read back from the store when it is next
 * acquired. */
static void let_go(deform_task *work, bool is_good)
{
    uv_mutex_lock(&work->meshes->lock);
    work->ref->state = is_good ? QM_MESH_READY : QM_MESH_BROKEN;
    if (!is_good) {
        work->ref->problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the mesh");
        qm_meshes_unlist(work->meshes, work->ref);
    }
    uv_cond_broadcast(&work->meshes->changed);
    uv_mutex_unlock(&work->meshes->lock);
}

/** Lists the next revision; holders of the one before keep it. */
static void list_copy(deform_task *work, qm_loaded_mesh *copy)
{
    uv_mutex_lock(&work->meshes->lock);
    qm_meshes_unlist(work->meshes, work->ref);
    qm_mesh_ref *next = qm_meshes_list(work->meshes, work->row.id);
    if (next) {
        next->mesh = *copy;
        next->state = QM_MESH_READY;
    }
    uv_mutex_unlock(&work->meshes->lock);
    qm_context ctx = qm_meshes_context(work->meshes);
    if (!next) qm_loaded_mesh_reset(&ctx, copy);
}

/** The known self collisions go to the new revision; holders of the old one keep theirs. */
static void take_pairs_along(const deform_task *work, const qm_loaded_mesh *copy)
{
    qm_self_pairs *known = work->ref->mesh.self_pairs;
    if (!copy->self_pairs || !known) return;
    qm_self_pairs_inherit(copy->self_pairs, known);
    qm_self_pairs_move(copy->self_pairs, work->moved->indices, work->moved->count);
}

/** Out of memory for a copy: the revision is read back from the store when it is next acquired. */
static void follow_in_copy(deform_task *work, qm_context *ctx)
{
    qm_loaded_mesh copy;
    qm_preparation preparation = qm_meshes_preparation(work->meshes);
    if (qm_loaded_mesh_copy(ctx, &work->ref->mesh, work->positions, &preparation, &copy) == QM_OK) {
        work->positions = NULL;
        work->out->updated_nodes = qm_bvh_box_count(copy.bvh);
        take_pairs_along(work, &copy);
        list_copy(work, &copy);
    } else {
        uv_mutex_lock(&work->meshes->lock);
        qm_meshes_unlist(work->meshes, work->ref);
        uv_mutex_unlock(&work->meshes->lock);
    }
}

static void follow(deform_task *work, qm_context *ctx)
{
    double start = qm_now_ms();
    if (take_alone(work)) {
        qm_status status =
            qm_loaded_mesh_deform(ctx, &work->ref->mesh, work->positions, work->moved->indices,
                                  work->moved->count, work->meshes->threads, &work->out->updated_nodes);
        work->positions = NULL;
        if (status != QM_OK) qm_log(QM_LOG_ERROR, "mesh %s could not follow in memory", work->row.id);
        let_go(work, status == QM_OK);
    } else {
        follow_in_copy(work, ctx);
    }
    work->out->refit_ms = qm_now_ms() - start;
    work->out->revision = work->row.revision;
    memcpy(work->out->hash, work->row.hash, sizeof work->out->hash);
}

static bool deform(deform_task *work, const char *id, const char *if_match)
{
    if (!qm_meshes_find_row(work->meshes, id, if_match, &work->row, work->problem)) return false;
    work->ref = qm_meshes_acquire(work->meshes, id, work->problem);
    if (!work->ref) return false;
    qm_context ctx = qm_meshes_context(work->meshes);
    ctx.parallel = qm_host_parallel;
    size_t vertices = vertex_count(work);
    bool stored = make_positions(work, &ctx) && store_revision(work);
    if (stored) follow(work, &ctx);
    qm_context_free(&ctx, work->positions, vertices, 3 * sizeof *work->positions);
    return stored;
}

void qm_moved_vertices_reset(qm_moved_vertices *moved)
{
    free(moved->indices);
    free(moved->positions);
    *moved = (qm_moved_vertices){0};
}

bool qm_meshes_deform(qm_meshes *meshes, const char *id, const qm_moved_vertices *moved, const char *if_match,
                      qm_deformed *out, qm_problem *problem)
{
    QM_ASSERT(id && moved && out && problem);
    *out = (qm_deformed){0};
    deform_task work = {.meshes = meshes, .moved = moved, .out = out, .problem = problem};
    uv_mutex_lock(&meshes->store_lock);
    bool done = deform(&work, id, if_match);
    uv_mutex_unlock(&meshes->store_lock);
    qm_meshes_release(meshes, work.ref);
    qm_store_mesh_reset(&work.row);
    return done;
}
