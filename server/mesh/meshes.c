/**
 * meshes.c: the table of meshes in memory: loading, references, eviction, deletion.
 */
#include "meshes_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "base/log.h"
#include "base/metrics.h"
#include "etag.h"
#include "ops/json_out.h"

qm_context qm_meshes_context(qm_meshes *meshes)
{
    qm_context ctx = qm_context_make();
    ctx.allocator = qm_budget_allocator(&meshes->budget);
    return ctx;
}

static bool drop_coldest(void *user);

qm_meshes *qm_meshes_create(qm_store *store, qm_codec_limits limits, size_t memory_limit, int threads)
{
    qm_meshes *meshes = calloc(1, sizeof *meshes);
    if (!meshes) return NULL;
    meshes->store = store;
    meshes->limits = limits;
    meshes->limits.thread_count = threads;
    meshes->budget = (qm_budget){.limit = memory_limit, .make_room = drop_coldest, .user = meshes};
    meshes->threads = threads;
    uv_mutex_init(&meshes->store_lock);
    uv_mutex_init(&meshes->lock);
    uv_cond_init(&meshes->changed);
    return meshes;
}

void qm_meshes_drop_reference(qm_mesh_ref *ref)
{
    QM_ASSERT(ref->references > 0);
    if (--ref->references > 0) return;
    qm_context ctx = qm_meshes_context(ref->meshes);
    qm_loaded_mesh_reset(&ctx, &ref->mesh);
    free(ref);
}

void qm_meshes_destroy(qm_meshes *meshes)
{
    if (!meshes) return;
    for (qm_mesh_ref *ref = meshes->first, *next; ref; ref = next) {
        next = ref->next;
        qm_meshes_drop_reference(ref);
    }
    uv_cond_destroy(&meshes->changed);
    uv_mutex_destroy(&meshes->lock);
    uv_mutex_destroy(&meshes->store_lock);
    free(meshes);
}

static qm_mesh_ref *find_listed(qm_meshes *meshes, const char *id)
{
    QM_ASSERT(qm_meshes_is_locked(&meshes->lock));
    for (qm_mesh_ref *ref = meshes->first; ref; ref = ref->next)
        if (strcmp(ref->id, id) == 0) return ref;
    return NULL;
}

void qm_meshes_unlist(qm_meshes *meshes, qm_mesh_ref *ref)
{
    QM_ASSERT(qm_meshes_is_locked(&meshes->lock));
    if (!ref->listed) return;
    qm_mesh_ref **link = &meshes->first;
    while (*link != ref)
        link = &(*link)->next;
    *link = ref->next;
    ref->listed = false;
    qm_meshes_drop_reference(ref);
}

/** Drops the least recently used mesh without a reference; false when there is none. */
static bool drop_coldest(void *user)
{
    qm_meshes *meshes = user;
    qm_mesh_ref *coldest = NULL;
    uv_mutex_lock(&meshes->lock);
    for (qm_mesh_ref *ref = meshes->first; ref; ref = ref->next)
        if (ref->references == 1 && ref->state == QM_MESH_READY) coldest = ref;
    if (coldest) qm_meshes_unlist(meshes, coldest);
    uv_mutex_unlock(&meshes->lock);
    qm_metrics_add(QM_METRICS_MESH_EVICTIONS, coldest != NULL);
    return coldest;
}

qm_meshes_memory qm_meshes_measure(qm_meshes *meshes)
{
    qm_meshes_memory memory = {.used = atomic_load(&meshes->budget.used), .limit = meshes->budget.limit};
    uv_mutex_lock(&meshes->lock);
    for (const qm_mesh_ref *ref = meshes->first; ref; ref = ref->next)
        memory.loaded++;
    uv_mutex_unlock(&meshes->lock);
    return memory;
}

/** Moves a listed mesh to the front. */
static void touch(qm_meshes *meshes, qm_mesh_ref *ref)
{
    QM_ASSERT(qm_meshes_is_locked(&meshes->lock));
    qm_mesh_ref **link = &meshes->first;
    while (*link != ref)
        link = &(*link)->next;
    *link = ref->next;
    ref->next = meshes->first;
    meshes->first = ref;
}

qm_mesh_ref *qm_meshes_list(qm_meshes *meshes, const char *id)
{
    QM_ASSERT(qm_meshes_is_locked(&meshes->lock));
    qm_mesh_ref *ref = calloc(1, sizeof *ref);
    if (!ref) return NULL;
    snprintf(ref->id, sizeof ref->id, "%s", id);
    ref->references = 1;
    ref->meshes = meshes;
    ref->listed = true;
    ref->next = meshes->first;
    meshes->first = ref;
    return ref;
}

qm_preparation qm_meshes_preparation(const qm_meshes *meshes)
{
    return (qm_preparation){.has_facts = true,
                            .has_patches = true,
                            .has_tetra = true,
                            .keeps_pairs = true,
                            .parts = QM_BVH_ALL,
                            .thread_count = meshes->threads};
}

bool qm_meshes_load_bytes(qm_meshes *meshes, qm_mapped_bytes file, qm_mapped_bytes positions,
                          qm_format format, qm_loaded_mesh *out, qm_problem *problem)
{
    qm_context ctx = qm_meshes_context(meshes);
    ctx.parallel = qm_host_parallel;
    qm_preparation preparation = qm_meshes_preparation(meshes);
    preparation.positions = (const double *)(const void *)positions.bytes;
    preparation.position_count = positions.size / (3 * sizeof(double));
    qm_codec_report report;
    qm_status status =
        qm_mesh_load(&ctx, format, file.bytes, file.size, &meshes->limits, &preparation, out, &report);
    if (status != QM_OK) *problem = qm_problem_from_codec(status, &report);
    return status == QM_OK;
}

/** Maps a blob that is there; "" gives no bytes. */
static bool map_blob(qm_meshes *meshes, const char *hash, qm_mapped_bytes *out)
{
    *out = (qm_mapped_bytes){0};
    if (!hash[0] || qm_blob_map(meshes->store, hash, &out->bytes, &out->size) == QM_OK) return true;
    qm_log(QM_LOG_ERROR, "blob %s cannot be read", hash);
    return false;
}

/** Reads the mesh of a row back. */
static bool load_row(qm_meshes *meshes, const qm_store_mesh *row, qm_loaded_mesh *out, qm_problem *problem)
{
    qm_mapped_bytes file = {0}, positions = {0};
    *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "the bytes of the mesh cannot be read");
    bool loaded = map_blob(meshes, row->hash, &file) && map_blob(meshes, row->positions, &positions) &&
                  qm_meshes_load_bytes(meshes, file, positions, (qm_format)row->format, out, problem);
    qm_blob_unmap(file.bytes, file.size);
    qm_blob_unmap(positions.bytes, positions.size);
    if (loaded) out->revision = row->revision;
    return loaded;
}

char *qm_meshes_make_document(const qm_store_mesh *row, const qm_loaded_mesh *mesh)
{
    qm_mesh_label label = {.id = row->id,
                           .name = row->name,
                           .content_hash = row->hash,
                           .revision = mesh->revision,
                           .created = row->created};
    qm_text document = {0};
    qm_json_write_mesh(&document, &label, mesh);
    return qm_text_take(&document);
}

/** Reads the mesh of a listed entry in; called without the lock. */
static void load_listed(qm_meshes *meshes, qm_mesh_ref *ref)
{
    qm_store_mesh row;
    bool loaded = false;
    qm_status status = qm_store_find_mesh(meshes->store, ref->id, &row);
    if (status == QM_OK) {
        loaded = load_row(meshes, &row, &ref->mesh, &ref->problem);
        qm_store_mesh_reset(&row);
    } else {
        ref->problem = qm_problem_from_store(status, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", ref->id);
    }
    qm_metrics_add(QM_METRICS_MESH_LOADS, loaded);
    uv_mutex_lock(&meshes->lock);
    ref->state = loaded ? QM_MESH_READY : QM_MESH_BROKEN;
    if (!loaded) qm_meshes_unlist(meshes, ref);
    uv_cond_broadcast(&meshes->changed);
    uv_mutex_unlock(&meshes->lock);
}

qm_mesh_ref *qm_meshes_acquire(qm_meshes *meshes, const char *id, qm_problem *problem)
{
    uv_mutex_lock(&meshes->lock);
    qm_mesh_ref *ref = find_listed(meshes, id);
    bool is_mine = !ref;
    if (is_mine && !(ref = qm_meshes_list(meshes, id))) {
        uv_mutex_unlock(&meshes->lock);
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for mesh %s", id);
        return NULL;
    }
    ref->references++;
    touch(meshes, ref);
    if (is_mine) {
        uv_mutex_unlock(&meshes->lock);
        load_listed(meshes, ref);
        uv_mutex_lock(&meshes->lock);
    }
    while (ref->state == QM_MESH_LOADING)
        uv_cond_wait(&meshes->changed, &meshes->lock);
    if (ref->state == QM_MESH_BROKEN) {
        *problem = ref->problem;
        qm_meshes_drop_reference(ref);
        ref = NULL;
    }
    uv_mutex_unlock(&meshes->lock);
    return ref;
}

const qm_loaded_mesh *qm_mesh_ref_get(const qm_mesh_ref *ref)
{
    return &ref->mesh;
}

void qm_meshes_release(qm_meshes *meshes, qm_mesh_ref *ref)
{
    if (!ref) return;
    uv_mutex_lock(&meshes->lock);
    qm_meshes_drop_reference(ref);
    uv_mutex_unlock(&meshes->lock);
}

bool qm_meshes_find_row(qm_meshes *meshes, const char *id, const char *if_match, qm_store_mesh *out,
                        qm_problem *problem)
{
    QM_ASSERT(qm_meshes_is_locked(&meshes->store_lock));
    qm_status status = qm_store_find_mesh(meshes->store, id, out);
    if (status != QM_OK) {
        *problem = qm_problem_from_store(status, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", id);
        return false;
    }
    char tag[QM_ETAG_SIZE];
    qm_etag_write_mesh(out->hash, out->revision, "", tag);
    if (!if_match || qm_etag_is_listed(if_match, tag, false)) return true;
    qm_store_mesh_reset(out);
    *problem = qm_problem_make(QM_PROBLEM_PRECONDITION_FAILED,
                               "If-Match does not match the current revision of the mesh");
    return false;
}

/** store_lock is held. */
static bool delete_row(qm_meshes *meshes, const char *id, const char *if_match, qm_problem *problem)
{
    QM_ASSERT(qm_meshes_is_locked(&meshes->store_lock));
    qm_store_mesh row;
    if (!qm_meshes_find_row(meshes, id, if_match, &row, problem)) return false;
    qm_store_mesh_reset(&row);
    qm_status status = qm_store_delete_mesh(meshes->store, id);
    if (status != QM_OK) *problem = qm_problem_from_store(status, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", id);
    return status == QM_OK;
}

bool qm_meshes_delete(qm_meshes *meshes, const char *id, const char *if_match, qm_problem *problem)
{
    uv_mutex_lock(&meshes->store_lock);
    bool deleted = delete_row(meshes, id, if_match, problem);
    uv_mutex_lock(&meshes->lock);
    qm_mesh_ref *ref = find_listed(meshes, id);
    if (ref && deleted) qm_meshes_unlist(meshes, ref);
    uv_mutex_unlock(&meshes->lock);
    uv_mutex_unlock(&meshes->store_lock);
    return deleted;
}
