/**
 * meshes.c: the table of meshes in memory: loading, references, eviction, deletion; uploads, which are sealed, decoded and
 * prepared, then stored under their content; and the next revisions of meshes.
 */
#include "meshes.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <uv.h>

#include "base/clock.h"
#include "base/host.h"
#include "base/log.h"
#include "base/metrics.h"
#include "etag.h"
#include "format/encoder.h"
#include "ops/json_out.h"
#include "store/store_problem.h"

#define TRIES 5 /* of a step that another node's may come before */

/** An entry lives while it is in the list or anybody holds a reference. */
struct qm_mesh_ref {
    char id[QM_ID_SIZE];
    qm_loaded_mesh mesh;
    enum { QM_MESH_LOADING, QM_MESH_READY, QM_MESH_BROKEN } state; /* loading, or being changed in place */
    int references;                                                /* the list counts as one */
    bool listed;
    bool is_moved; /* a copy of a mesh at the revision in `mesh`, moved by a transform: found by all three */
    double transform[QM_TRANSFORM_SIZE];
    bool is_behind;     /* its next revision is about to be stored, and then to follow in memory */
    qm_problem problem; /* when broken */
    qm_meshes *meshes;
    qm_mesh_ref *next;
};

/**
 * lock guards the list, which has the most recently used mesh first, references and states; changed signals a
 * new state. A mesh that is READY is never written. store_lock is taken before lock, by threads that add,
 * change or remove a mesh in the store: no two rows have equal content and options, no blob is removed that a
 * row is about to name, and list and store agree.
 */
struct qm_meshes {
    qm_store *store;
    qm_codec_limits limits;
    qm_budget budget;
    int threads; /* that prepare a mesh */
    uv_mutex_t store_lock;
    uv_mutex_t lock;
    uv_cond_t changed;
    qm_mesh_ref *first;
};

/** True while any thread holds the mutex; for assertions of functions whose caller holds it. */
static inline bool is_locked(uv_mutex_t *mutex)
{
    if (uv_mutex_trylock(mutex) != 0) return true;
    uv_mutex_unlock(mutex);
    return false;
}

/** A file in memory. */
typedef struct mapped_bytes {
    const uint8_t *bytes;
    size_t size;
} mapped_bytes;

qm_budget *qm_meshes_budget(qm_meshes *meshes)
{
    return &meshes->budget;
}

qm_context qm_meshes_context(qm_meshes *meshes)
{
    qm_context ctx = qm_context_make();
    ctx.allocator = qm_host_budget_allocator(&meshes->budget);
    return ctx;
}

static bool drop_coldest(void *user, size_t missing);

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

/** The lock is held. */
static void drop_reference(qm_mesh_ref *ref)
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
        drop_reference(ref);
    }
    uv_cond_destroy(&meshes->changed);
    uv_mutex_destroy(&meshes->lock);
    uv_mutex_destroy(&meshes->store_lock);
    free(meshes);
}

static qm_mesh_ref *find_listed(qm_meshes *meshes, const char *id)
{
    QM_ASSERT(is_locked(&meshes->lock));
    for (qm_mesh_ref *ref = meshes->first; ref; ref = ref->next)
        if (!ref->is_moved && strcmp(ref->id, id) == 0) return ref;
    return NULL;
}

/** Takes a mesh out of the list. The lock is held. */
static void unlist(qm_meshes *meshes, qm_mesh_ref *ref)
{
    QM_ASSERT(is_locked(&meshes->lock));
    if (!ref->listed) return;
    qm_mesh_ref **link = &meshes->first;
    while (*link != ref)
        link = &(*link)->next;
    *link = ref->next;
    ref->listed = false;
    drop_reference(ref);
}

/** Drops the least recently used mesh without a reference; false when there is none. */
static bool drop_coldest(void *user, size_t missing)
{
    qm_meshes *meshes = user;
    qm_mesh_ref *coldest = NULL;
    size_t unused = 0;
    uv_mutex_lock(&meshes->lock);
    for (qm_mesh_ref *ref = meshes->first; ref; ref = ref->next) {
        if (ref->references != 1 || ref->state != QM_MESH_READY) continue;
        coldest = ref;
        unused += qm_loaded_mesh_memory_size(&ref->mesh);
    }
    if (unused < missing) coldest = NULL;
    if (coldest) unlist(meshes, coldest);
    uv_mutex_unlock(&meshes->lock);
    qm_metrics_add(QM_METRICS_MESH_EVICTIONS, coldest != NULL);
    return coldest;
}

qm_meshes_memory qm_meshes_measure(qm_meshes *meshes)
{
    qm_meshes_memory memory = {.used = atomic_load(&meshes->budget.used), .limit = meshes->budget.limit};
    uv_mutex_lock(&meshes->lock);
    for (const qm_mesh_ref *ref = meshes->first; ref; ref = ref->next)
        memory.loaded += !ref->is_moved;
    uv_mutex_unlock(&meshes->lock);
    return memory;
}

/** A new entry of a mesh in the list, which holds its one reference; NULL: out of memory. The lock is held. */
static qm_mesh_ref *list_entry(qm_meshes *meshes, const char *id)
{
    QM_ASSERT(is_locked(&meshes->lock));
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

/** The structures that a mesh of the table is prepared with. */
static qm_preparation preparation_of(const qm_meshes *meshes)
{
    return (qm_preparation){.has_facts = true,
                            .has_patches = true,
                            .has_tetra = true,
                            .keeps_pairs = true,
                            .parts = QM_BVH_ALL,
                            .thread_count = meshes->threads};
}

/** The bytes of a mesh, and how they become one. */
typedef struct mesh_source {
    qm_format format;
    mapped_bytes file;
    qm_codec_limits limits;
    qm_preparation preparation;
} mesh_source;

static qm_status load_with(qm_context *ctx, const mesh_source *source, qm_loaded_mesh *out,
                           qm_codec_report *report)
{
    return qm_mesh_load(ctx, source->format, source->file.bytes, source->file.size, &source->limits,
                        &source->preparation, out, report);
}

static bool make_room(qm_meshes *meshes, size_t needed, qm_codec_report *report)
{
    if (qm_host_budget_make_room(&meshes->budget, needed)) return true;
    snprintf(report->detail, sizeof report->detail,
             "the mesh takes at least %zu bytes, more than the memory budget has for it", needed);
    return false;
}

/**
 * Evicts meshes until a mesh fits that needs more than the free part of the budget; QM_E_NO_MEMORY, and none is evicted,
 * when all that can be evicted is too little. Some may be evicted for the content of a compressed file before.
 */
static qm_status make_room_for(qm_meshes *meshes, qm_context *spare, mesh_source *source,
                               qm_codec_report *report)
{
    size_t needed = 0;
    qm_status status = QM_E_NO_MEMORY;
    for (int attempt = 0; attempt < 2 && status == QM_E_NO_MEMORY; attempt++) {
        status = qm_mesh_measure(spare, source->format, source->file.bytes, source->file.size,
                                 &source->limits, &source->preparation, &needed, report);
        bool is_known = status == QM_OK || status == QM_E_NO_MEMORY;
        if (is_known && !make_room(meshes, needed, report)) return QM_E_NO_MEMORY;
    }
    /* What cannot be measured is loaded, and fails there if it must. */
    return status == QM_E_NO_MEMORY ? QM_OK : status;
}

/** Decodes the bytes of a file and prepares the mesh; positions are a revision's, or empty. The extent is that of a mesh
 * which is not stored yet: later its document has it. False with a problem. */
static bool load_bytes(qm_meshes *meshes, mapped_bytes file, mapped_bytes positions, qm_format format,
                       bool has_extent, qm_loaded_mesh *out, qm_problem *problem)
{
    mesh_source source = {format, file, meshes->limits, preparation_of(meshes)};
    source.preparation.has_extent = has_extent;
    source.preparation.positions = (const double *)(const void *)positions.bytes;
    source.preparation.position_count = positions.size / (3 * sizeof(double));
    qm_context ctx = qm_meshes_context(meshes);
    ctx.parallel = qm_host_parallel;
    qm_context spare = ctx;
    spare.allocator = qm_host_budget_spare_allocator(&meshes->budget);
    qm_codec_report report;
    qm_status status = load_with(&spare, &source, out, &report);
    if (status == QM_E_NO_MEMORY) {
        status = make_room_for(meshes, &spare, &source, &report);
        if (status == QM_OK) status = load_with(&ctx, &source, out, &report);
    }
    if (status != QM_OK) *problem = qm_problem_from_codec(status, &report);
    return status == QM_OK;
}

/** True for the status of a blob that has other bytes than its hash says, or is missing. */
static bool is_damaged(qm_status status)
{
    return status == QM_E_FORMAT || status == QM_E_EMPTY;
}

/** Maps a blob of a mesh; "" gives no bytes. False with a problem; remedy says what helps against damage. */
static bool map_blob(qm_meshes *meshes, const char *id, const char *hash, const char *remedy,
                     mapped_bytes *out, qm_problem *problem)
{
    *out = (mapped_bytes){0};
    qm_status status = hash[0] ? qm_blob_map(meshes->store, hash, &out->bytes, &out->size) : QM_OK;
    if (status == QM_OK) return true;
    if (is_damaged(status)) {
        qm_metrics_add(QM_METRICS_DAMAGES, 1);
        qm_log(QM_LOG_ERROR, "blob %s of mesh %s is %s", hash, id,
               status == QM_E_EMPTY ? "missing" : "damaged");
        *problem =
            qm_problem_make(QM_PROBLEM_BLOB_DAMAGED, "a stored file of mesh %s is damaged; %s", id, remedy);
    } else if (status == QM_E_CANCELED) {
        *problem = qm_problem_make(QM_PROBLEM_STORE_UNAVAILABLE,
                                   "the store did not answer: the bytes of mesh %s were not read", id);
    } else {
        qm_log(QM_LOG_ERROR, "blob %s of mesh %s cannot be opened", hash, id);
        *problem =
            qm_problem_make(status == QM_E_NO_MEMORY ? QM_PROBLEM_OUT_OF_MEMORY : QM_PROBLEM_UNAVAILABLE,
                            "the bytes of mesh %s cannot be read", id);
    }
    return false;
}

/** The document of a mesh; NULL: out of memory. */
static char *make_document(const qm_store_mesh *row, const qm_loaded_mesh *mesh)
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
    qm_stored stored = qm_store_find_mesh(meshes->store, ref->id, &row);
    if (stored == QM_STORED) {
        mapped_bytes file = {0}, positions = {0};
        loaded = map_blob(meshes, row.id, row.hash, "an upload of the same file repairs it", &file,
                          &ref->problem) &&
                 map_blob(meshes, row.id, row.positions, "the moved vertices are lost", &positions,
                          &ref->problem) &&
                 load_bytes(meshes, file, positions, (qm_format)row.format, false, &ref->mesh, &ref->problem);
        qm_blob_unmap(file.bytes, file.size);
        qm_blob_unmap(positions.bytes, positions.size);
        if (loaded) ref->mesh.revision = row.revision;
        qm_store_mesh_reset(&row);
    } else {
        ref->problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", ref->id);
    }
    qm_metrics_add(QM_METRICS_MESH_LOADS, loaded);
    uv_mutex_lock(&meshes->lock);
    ref->state = loaded ? QM_MESH_READY : QM_MESH_BROKEN;
    if (!loaded) unlist(meshes, ref);
    uv_cond_broadcast(&meshes->changed);
    uv_mutex_unlock(&meshes->lock);
}

bool qm_meshes_has_loaded(qm_meshes *meshes, const char *id)
{
    uv_mutex_lock(&meshes->lock);
    const qm_mesh_ref *ref = find_listed(meshes, id);
    bool is_ready = ref && ref->state == QM_MESH_READY;
    uv_mutex_unlock(&meshes->lock);
    return is_ready;
}

/** Waits until an entry is loaded; the lock is held. False with a problem. */
static bool await_loading(qm_meshes *meshes, qm_mesh_ref *ref, qm_problem *problem)
{
    ref->references++;
    while (ref->state == QM_MESH_LOADING)
        uv_cond_wait(&meshes->changed, &meshes->lock);
    bool is_broken = ref->state == QM_MESH_BROKEN;
    if (is_broken) *problem = ref->problem;
    drop_reference(ref);
    return !is_broken;
}

/**
 * Takes a reference to a ready entry that is at a revision or a later one. An older one is waited for while it is about to follow, else
 * it leaves the list: another node has moved the mesh. NULL: there is none, with a problem when one could not be
 * loaded. The lock is held.
 */
static qm_mesh_ref *find_current(qm_meshes *meshes, const char *id, uint64_t revision, bool *failed,
                                 qm_problem *problem)
{
    QM_ASSERT(is_locked(&meshes->lock));
    qm_mesh_ref *ref;
    *failed = false;
    while (!*failed && (ref = find_listed(meshes, id)) != NULL) {
        if (ref->state == QM_MESH_LOADING)
            *failed = !await_loading(meshes, ref, problem);
        else if (ref->mesh.revision >= revision) {
            ref->references++;
            return ref;
        } else if (ref->is_behind)
            uv_cond_wait(&meshes->changed, &meshes->lock);
        else
            unlist(meshes, ref);
    }
    return NULL;
}

/** The list has the most recently used entry first. The lock is held. */
static void move_to_front(qm_meshes *meshes, qm_mesh_ref *ref)
{
    qm_mesh_ref **link = &meshes->first;
    while (*link != ref)
        link = &(*link)->next;
    *link = ref->next;
    ref->next = meshes->first;
    meshes->first = ref;
}

/** Loads a mesh that is not in memory, and takes a reference. The lock is held, but for the time of loading. */
static qm_mesh_ref *load_new(qm_meshes *meshes, const char *id, qm_problem *problem)
{
    qm_mesh_ref *ref = list_entry(meshes, id);
    if (!ref) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for mesh %s", id);
        return NULL;
    }
    ref->references++;
    uv_mutex_unlock(&meshes->lock);
    load_listed(meshes, ref);
    uv_mutex_lock(&meshes->lock);
    if (ref->state != QM_MESH_BROKEN) return ref;
    *problem = ref->problem;
    drop_reference(ref);
    return NULL;
}

/** Takes a mesh that is gone from the store out of memory. */
static void forget(qm_meshes *meshes, const char *id)
{
    uv_mutex_lock(&meshes->lock);
    qm_mesh_ref *ref = find_listed(meshes, id);
    if (ref && ref->state == QM_MESH_READY) unlist(meshes, ref);
    uv_mutex_unlock(&meshes->lock);
}

qm_mesh_ref *qm_meshes_acquire_noted(qm_meshes *meshes, const char *id, qm_notes *notes, qm_problem *problem)
{
    qm_store_mesh_state state;
    qm_stored stored = qm_store_find_mesh_state(meshes->store, id, &state);
    if (stored == QM_STORED_NONE) forget(meshes, id);
    if (stored != QM_STORED) {
        *problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", id);
        return NULL;
    }
    bool failed;
    uv_mutex_lock(&meshes->lock);
    qm_mesh_ref *ref = find_current(meshes, id, state.revision, &failed, problem);
    if (!ref && !failed) ref = load_new(meshes, id, problem);
    if (ref && ref->listed) move_to_front(meshes, ref);
    uv_mutex_unlock(&meshes->lock);
    *notes = state.notes;
    return ref;
}

qm_mesh_ref *qm_meshes_acquire(qm_meshes *meshes, const char *id, qm_problem *problem)
{
    qm_notes notes;
    return qm_meshes_acquire_noted(meshes, id, &notes, problem);
}

/* ---- moved copies ---- */

/** The entry of a moved copy. The lock is held. */
static qm_mesh_ref *find_moved(qm_meshes *meshes, const char *id, uint64_t revision,
                               const double transform[QM_TRANSFORM_SIZE])
{
    QM_ASSERT(is_locked(&meshes->lock));
    for (qm_mesh_ref *ref = meshes->first; ref; ref = ref->next)
        if (ref->is_moved && strcmp(ref->id, id) == 0 && ref->mesh.revision == revision &&
            memcmp(ref->transform, transform, sizeof ref->transform) == 0)
            return ref;
    return NULL;
}

/** Copies of earlier revisions are asked for no more. The lock is held. */
static void drop_moved_before(qm_meshes *meshes, const char *id, uint64_t revision)
{
    QM_ASSERT(is_locked(&meshes->lock));
    for (qm_mesh_ref *ref = meshes->first, *next; ref; ref = next) {
        next = ref->next;
        const bool is_old = ref->is_moved && ref->mesh.revision < revision && strcmp(ref->id, id) == 0;
        if (is_old && ref->state == QM_MESH_READY) unlist(meshes, ref);
    }
}

/** Makes the mesh of a listed entry by moving another; called without the lock. */
static void make_moved(qm_meshes *meshes, qm_mesh_ref *ref, const qm_loaded_mesh *from)
{
    qm_context ctx = qm_meshes_context(meshes);
    ctx.parallel = qm_host_parallel;
    qm_mesh moved = from->mesh;
    qm_loaded_mesh copy;
    const qm_preparation preparation = preparation_of(meshes);
    moved.positions = qm_context_alloc(&ctx, moved.vertex_count, 3 * sizeof *moved.positions);
    qm_status status = moved.positions
                           ? qm_transform_positions(&ctx, ref->transform, &from->mesh, moved.positions)
                           : qm_context_fail(&ctx, QM_E_NO_MEMORY, "out of memory for the moved mesh");
    if (status == QM_OK) status = qm_mesh_validate(&ctx, &moved);
    if (status == QM_OK) status = qm_loaded_mesh_copy(&ctx, from, moved.positions, &preparation, &copy);
    if (status != QM_OK) {
        ref->problem = qm_problem_from_status(status, ctx.message);
        qm_context_free(&ctx, moved.positions, moved.vertex_count, 3 * sizeof *moved.positions);
    }
    uv_mutex_lock(&meshes->lock);
    if (status == QM_OK) {
        ref->mesh = copy;
        ref->mesh.moved = qm_transform_find_change(ref->transform, &from->mesh);
        ref->mesh.revision = from->revision;
    }
    ref->state = status == QM_OK ? QM_MESH_READY : QM_MESH_BROKEN;
    if (status != QM_OK) unlist(meshes, ref);
    uv_cond_broadcast(&meshes->changed);
    uv_mutex_unlock(&meshes->lock);
}

/** A reference to the moved copy of a mesh, which is made when there is none. The lock is held, but for that time. */
static qm_mesh_ref *take_moved(qm_meshes *meshes, const qm_mesh_ref *source,
                               const double transform[QM_TRANSFORM_SIZE], qm_problem *problem)
{
    const qm_loaded_mesh *from = &source->mesh;
    qm_mesh_ref *ref = find_moved(meshes, source->id, from->revision, transform);
    if (ref) {
        ref->references++;
        if (ref->listed) move_to_front(meshes, ref);
        while (ref->state == QM_MESH_LOADING)
            uv_cond_wait(&meshes->changed, &meshes->lock);
    } else {
        drop_moved_before(meshes, source->id, from->revision);
        ref = list_entry(meshes, source->id);
        if (!ref) {
            *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for mesh %s", source->id);
            return NULL;
        }
        ref->references++;
        ref->is_moved = true;
        ref->mesh.revision = from->revision;
        memcpy(ref->transform, transform, sizeof ref->transform);
        uv_mutex_unlock(&meshes->lock);
        make_moved(meshes, ref, from);
        uv_mutex_lock(&meshes->lock);
    }
    if (ref->state == QM_MESH_READY) return ref;
    *problem = ref->problem;
    drop_reference(ref);
    return NULL;
}

qm_mesh_ref *qm_meshes_acquire_moved(qm_meshes *meshes, const char *id,
                                     const double transform[QM_TRANSFORM_SIZE], qm_notes *notes,
                                     qm_problem *problem)
{
    qm_mesh_ref *source = qm_meshes_acquire_noted(meshes, id, notes, problem);
    if (!source) return NULL;
    uv_mutex_lock(&meshes->lock);
    qm_mesh_ref *moved = take_moved(meshes, source, transform, problem);
    uv_mutex_unlock(&meshes->lock);
    qm_meshes_release(meshes, source);
    return moved;
}

const qm_loaded_mesh *qm_mesh_ref_get(const qm_mesh_ref *ref)
{
    return &ref->mesh;
}

bool qm_meshes_load_apart(qm_meshes *meshes, const uint8_t *bytes, size_t size, qm_format format,
                          qm_mesh_ref **out, qm_problem *problem)
{
    qm_mesh_ref *ref = calloc(1, sizeof *ref);
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the mesh");
    bool is_loaded = ref && load_bytes(meshes, (mapped_bytes){bytes, size}, (mapped_bytes){0}, format, false,
                                       &ref->mesh, problem);
    if (!is_loaded) {
        free(ref);
        return false;
    }
    ref->meshes = meshes;
    ref->references = 1;
    ref->state = QM_MESH_READY;
    *out = ref;
    return true;
}

void qm_meshes_release(qm_meshes *meshes, qm_mesh_ref *ref)
{
    if (!ref) return;
    uv_mutex_lock(&meshes->lock);
    drop_reference(ref);
    uv_mutex_unlock(&meshes->lock);
}

/** The row of a mesh, which must be among the entity tags of if_match, unless that is NULL: false with a problem. store_lock is held, so that it stays so. */
static bool find_row(qm_meshes *meshes, const char *id, const char *if_match, qm_store_mesh *out,
                     qm_problem *problem)
{
    QM_ASSERT(is_locked(&meshes->store_lock));
    qm_stored stored = qm_store_find_mesh(meshes->store, id, out);
    if (stored != QM_STORED) {
        *problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", id);
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

/** Removes a row, and the mesh from memory. store_lock is held. */
static qm_stored remove_row(qm_meshes *meshes, const char *id)
{
    QM_ASSERT(is_locked(&meshes->store_lock));
    qm_stored stored = qm_store_delete_mesh(meshes->store, id);
    uv_mutex_lock(&meshes->lock);
    qm_mesh_ref *ref = find_listed(meshes, id);
    if (ref && stored == QM_STORED) unlist(meshes, ref);
    if (stored == QM_STORED) drop_moved_before(meshes, id, UINT64_MAX);
    uv_mutex_unlock(&meshes->lock);
    return stored;
}

bool qm_meshes_delete(qm_meshes *meshes, const char *id, const char *if_match, qm_problem *problem)
{
    uv_mutex_lock(&meshes->store_lock);
    qm_store_mesh row;
    bool deleted = find_row(meshes, id, if_match, &row, problem);
    if (deleted) {
        qm_store_mesh_reset(&row);
        qm_stored stored = remove_row(meshes, id);
        if (stored != QM_STORED)
            *problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", id);
        deleted = stored == QM_STORED;
    }
    uv_mutex_unlock(&meshes->store_lock);
    return deleted;
}

/* ---- expiry ---- */

/** When a mesh expires that lives for a time from now on; "" for 0. */
static void set_expires(qm_store_mesh *row, double ttl_s)
{
    row->expires[0] = 0;
    if (ttl_s > 0.0) qm_clock_format_steady(ttl_s, row->expires);
}

/** Takes a mesh out of the content index: an upload of its file makes a new one. False when out of memory. */
static bool leave_index(qm_store_mesh *row, const char *why)
{
    qm_text options = {0};
    qm_text_printf(&options, "%s %s", why, row->id);
    free(row->options);
    row->options = qm_text_take(&options);
    return row->options;
}

/** Sets the members of a row that a change names; false when out of memory. */
static bool set_notes(qm_store_mesh *row, const qm_mesh_change *change)
{
    if (change->has_unit) memcpy(row->notes.unit, change->notes.unit, sizeof row->notes.unit);
    if (change->has_uncertainty) row->notes.uncertainty = change->notes.uncertainty;
    if (change->has_labels) {
        free(row->labels);
        row->labels = strdup(change->labels ? change->labels : "");
        if (!row->labels) return false;
    }
    return !(change->has_unit || change->has_uncertainty) || leave_index(row, "noted");
}

bool qm_meshes_change(qm_meshes *meshes, const char *id, const qm_mesh_change *change, const char *if_match,
                      qm_store_mesh *out, qm_problem *problem)
{
    uv_mutex_lock(&meshes->store_lock);
    bool is_found = find_row(meshes, id, if_match, out, problem);
    qm_stored stored = is_found && !set_notes(out, change) ? QM_STORED_NO_MEMORY : QM_STORED;
    bool has_notes = change->has_unit || change->has_uncertainty || change->has_labels;
    if (is_found && stored == QM_STORED && has_notes) stored = qm_store_set_notes(meshes->store, out);
    if (is_found && stored == QM_STORED && change->has_ttl) {
        set_expires(out, change->ttl_s);
        stored = qm_store_set_expiry(meshes->store, id, out->expires);
    }
    if (is_found && stored != QM_STORED) {
        *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the mesh could not be stored");
        qm_store_mesh_reset(out);
    }
    uv_mutex_unlock(&meshes->store_lock);
    return is_found && stored == QM_STORED;
}

bool qm_mesh_add_label(qm_text *labels, const char *label, size_t length)
{
    size_t count = 0;
    for (size_t i = 1; i < labels->size; i++)
        count += labels->data[i] == '\n';
    bool is_good = length > 0 && length < QM_MESH_LABEL_SIZE;
    for (size_t i = 0; i < length && is_good; i++)
        is_good = isalnum((unsigned char)label[i]) || strchr("._-:/", label[i]);
    if (!is_good) return false;
    char line[QM_MESH_LABEL_SIZE + 2];
    snprintf(line, sizeof line, "\n%.*s\n", (int)length, label);
    if (labels->data && strstr(labels->data, line)) return true;
    if (count >= QM_MESH_MAX_LABELS) return false;
    qm_text_add_string(labels, labels->size == 0 ? line : line + 1);
    return true;
}

void qm_mesh_write_labels(qm_text *out, const char *labels)
{
    qm_json_open(out, "labels", "[");
    for (const char *at = labels; at && *at && at[1]; at += 1 + strcspn(at + 1, "\n")) {
        char label[QM_MESH_LABEL_SIZE];
        snprintf(label, sizeof label, "%.*s", (int)strcspn(at + 1, "\n"), at + 1);
        qm_json_add_comma(out);
        qm_json_add_quoted(out, label);
    }
    qm_text_add_string(out, "]");
}

/** An upload of a mesh that exists: it lives for the longer of both times. store_lock is held. */
static bool extend_life(qm_meshes *meshes, qm_store_mesh *row, double ttl_s)
{
    QM_ASSERT(is_locked(&meshes->store_lock));
    qm_store_mesh wanted = {0};
    set_expires(&wanted, ttl_s);
    bool is_longer = row->expires[0] && (ttl_s <= 0.0 || strcmp(wanted.expires, row->expires) > 0);
    if (!is_longer) return true;
    memcpy(row->expires, wanted.expires, sizeof row->expires);
    return qm_store_set_expiry(meshes->store, row->id, row->expires) == QM_STORED;
}

void qm_meshes_drop_expired(qm_meshes *meshes)
{
    char now[QM_TIME_SIZE];
    qm_clock_format_steady(0.0, now);
    for (bool found = true; found;) {
        qm_store_mesh row;
        uv_mutex_lock(&meshes->store_lock);
        found = qm_store_find_expired_mesh(meshes->store, now, &row) == QM_STORED;
        if (found) {
            qm_log(QM_LOG_INFO, "mesh %s expired at %s", row.id, row.expires);
            found = remove_row(meshes, row.id) == QM_STORED;
            qm_store_mesh_reset(&row);
        }
        uv_mutex_unlock(&meshes->store_lock);
    }
}

/* ---- uploads ---- */

static void free_loaded(qm_meshes *meshes, qm_loaded_mesh *mesh)
{
    qm_context ctx = qm_meshes_context(meshes);
    qm_loaded_mesh_reset(&ctx, mesh);
}

/** Finds a mesh of equal content and options. */
static bool find_same(qm_meshes *meshes, const qm_store_mesh *wanted, qm_store_mesh *found)
{
    return qm_store_find_mesh_by_content(meshes->store, wanted->hash, wanted->options, found) == QM_STORED;
}

/** An upload that becomes a mesh, and what stores it. */
typedef struct upload_task {
    qm_meshes *meshes;
    qm_blob_writer *upload; /* until it is a blob */
    double ttl_s;
    qm_mesh_put_fn *put;
    void *user;
    qm_problem *problem;
} upload_task;

/** Stores a new mesh without anything else. */
static qm_stored put_alone(void *user, const qm_store_mesh *mesh, bool is_new, qm_problem *problem)
{
    qm_meshes *meshes = user;
    qm_stored stored = is_new ? qm_store_put_mesh(meshes->store, mesh) : QM_STORED;
    if (stored != QM_STORED) *problem = qm_store_write_problem(stored, "the mesh");
    return stored;
}

/** Makes a blob of the upload with one of the two functions; false with a problem. */
static bool keep_upload(upload_task *task, qm_stored (*keep)(qm_blob_writer *writer))
{
    qm_stored stored = task->upload ? keep(task->upload) : QM_STORED;
    task->upload = NULL;
    if (stored != QM_STORED) *task->problem = qm_store_write_problem(stored, "the mesh");
    return stored == QM_STORED;
}

/** Names the blob and stores the row. store_lock is held. QM_STORED_TAKEN: another node has stored the same. */
static qm_stored store_new(upload_task *task, const qm_store_mesh *row)
{
    QM_ASSERT(is_locked(&task->meshes->store_lock));
    if (!keep_upload(task, qm_blob_keep)) return QM_STORED_FAULT;
    qm_stored stored = task->put(task->user, row, true, task->problem);
    if (stored != QM_STORED) qm_blob_remove(task->meshes->store, row->hash);
    return stored;
}

/** Lets a mesh that is stored live as long as the upload, and stores what names it. store_lock is held. */
static qm_stored store_same(const upload_task *task, qm_store_mesh *row)
{
    if (extend_life(task->meshes, row, task->ttl_s)) return task->put(task->user, row, false, task->problem);
    *task->problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the mesh has just expired: upload it again");
    return QM_STORED_NONE;
}

/** Lists a mesh that was just stored: it waits in memory for its first job. Without memory for that it is loaded again
 * then. Takes over the mesh. */
static void list_loaded(qm_meshes *meshes, const char *id, qm_loaded_mesh *mesh)
{
    uv_mutex_lock(&meshes->lock);
    qm_mesh_ref *listed = list_entry(meshes, id);
    if (listed) {
        listed->mesh = *mesh;
        listed->state = QM_MESH_READY;
    }
    uv_mutex_unlock(&meshes->lock);
    if (!listed) free_loaded(meshes, mesh);
}

/** Stores a decoded upload, unless equal content was stored meanwhile. Takes over mesh and upload. */
static bool store_loaded(upload_task *task, qm_store_mesh *row, qm_loaded_mesh *mesh, bool *is_new)
{
    qm_meshes *meshes = task->meshes;
    qm_store_mesh same;
    qm_stored stored = QM_STORED_TAKEN;
    bool found = false;
    uv_mutex_lock(&meshes->store_lock);
    for (int i = 0; i < TRIES && stored == QM_STORED_TAKEN && !found; i++) {
        found = find_same(meshes, row, &same);
        if (found) {
            qm_store_mesh_reset(row);
            *row = same;
            stored = store_same(task, row);
        } else {
            set_expires(row, task->ttl_s);
            stored = store_new(task, row);
        }
    }
    qm_blob_abort(task->upload);
    *is_new = stored == QM_STORED && !found;
    if (*is_new)
        list_loaded(meshes, row->id, mesh);
    else
        free_loaded(meshes, mesh);
    uv_mutex_unlock(&meshes->store_lock);
    if (*is_new) qm_metrics_add(QM_METRICS_MESHES_ADDED, 1);
    return stored == QM_STORED;
}

/** The options as the content index has them; the name, which may be any text, is last. */
static char *write_options(const qm_mesh_options *options)
{
    char number[QM_NUMBER_SIZE];
    qm_text out = {0};
    qm_text_printf(&out, "format=%s",
                   options->format == QM_FORMAT_UNKNOWN ? "auto" : qm_format_name(options->format));
    if (options->notes.unit[0]) qm_text_printf(&out, " unit=%s", options->notes.unit);
    if (options->notes.uncertainty > 0.0)
        qm_text_printf(&out, " uncertainty=%s", qm_text_number(options->notes.uncertainty, number));
    if (options->labels && options->labels[0]) qm_text_printf(&out, " labels=%s", options->labels);
    qm_text_printf(&out, " name=%s", options->name);
    return qm_text_take(&out);
}

/** A row with all but its hash and document; false when out of memory. */
static bool make_row(const qm_mesh_options *options, qm_store_mesh *row, qm_problem *problem)
{
    qm_id_make('m', row->id);
    row->options = write_options(options);
    row->name = strdup(options->name);
    row->notes = options->notes;
    row->labels = strdup(options->labels ? options->labels : "");
    char created[QM_TIME_SIZE];
    qm_clock_format(created);
    row->created = strdup(created);
    if (row->options && row->name && row->created && row->labels) return true;
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the upload");
    return false;
}

/** Ends the writing of an upload and takes its hash. */
static bool seal(qm_blob_writer *upload, qm_store_mesh *row, qm_problem *problem)
{
    qm_status status = qm_blob_seal(upload, row->hash);
    if (status != QM_OK) *problem = qm_problem_from_write(status, "the upload");
    return status == QM_OK;
}

/** Decodes the file of a row and makes its document. */
static bool prepare(qm_meshes *meshes, mapped_bytes file, qm_format format, qm_store_mesh *row,
                    qm_loaded_mesh *mesh, qm_problem *problem)
{
    if (!load_bytes(meshes, file, (mapped_bytes){0}, format, true, mesh, problem)) return false;
    row->format = (int)mesh->format;
    if (!row->notes.unit[0]) memcpy(row->notes.unit, mesh->unit, sizeof row->notes.unit);
    row->document = make_document(row, mesh);
    if (row->document) return true;
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the mesh");
    free_loaded(meshes, mesh);
    return false;
}

/** Ends an upload whose bytes a mesh has already: it takes the place of their blob when that is damaged. */
static bool give_to_same(upload_task *task, qm_store_mesh *row)
{
    qm_meshes *meshes = task->meshes;
    const char *hash = row->hash;
    qm_store_mesh now;
    uv_mutex_lock(&meshes->store_lock);
    bool exists = qm_store_find_mesh(meshes->store, row->id, &now) == QM_STORED;
    if (exists) qm_store_mesh_reset(&now);
    if (!exists)
        *task->problem =
            qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the mesh has just been removed: upload it again");
    bool stored = exists && store_same(task, row) == QM_STORED;
    uv_mutex_unlock(&meshes->store_lock);
    qm_status status = stored ? qm_blob_check(meshes->store, hash) : QM_OK;
    if (!is_damaged(status)) {
        qm_blob_abort(task->upload);
        if (status == QM_E_CANCELED) *task->problem = qm_store_write_problem(QM_STORED_AWAY, "the mesh");
        return stored && status != QM_E_CANCELED;
    }
    uv_mutex_lock(&meshes->store_lock);
    bool kept = keep_upload(task, qm_blob_repair);
    if (kept) qm_blob_remove(meshes->store, hash); /* the mesh may have been deleted meanwhile */
    uv_mutex_unlock(&meshes->store_lock);
    if (kept) {
        qm_metrics_add(QM_METRICS_REPAIRS, 1);
        qm_log(QM_LOG_WARN, "blob %s was damaged or missing: an upload has replaced it", hash);
    }
    return kept;
}

static bool add(upload_task *task, const qm_mesh_options *options, qm_store_mesh *out, bool *is_new)
{
    qm_meshes *meshes = task->meshes;
    qm_problem *problem = task->problem;
    qm_store_mesh row = {0};
    qm_loaded_mesh mesh = {0};
    *is_new = false;
    bool sealed = make_row(options, &row, problem) && seal(task->upload, &row, problem);
    if (sealed && find_same(meshes, &row, out)) {
        qm_store_mesh_reset(&row);
        bool given = give_to_same(task, out);
        if (!given) qm_store_mesh_reset(out);
        return given;
    }
    mapped_bytes file = {0};
    if (sealed) *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "the bytes of the upload cannot be read");
    bool prepared = sealed && qm_blob_map_sealed(task->upload, &file.bytes, &file.size) == QM_OK &&
                    prepare(meshes, file, options->format, &row, &mesh, problem);
    qm_blob_unmap(file.bytes, file.size);
    if (!prepared) qm_blob_abort(task->upload);
    bool added = prepared && store_loaded(task, &row, &mesh, is_new);
    *out = row;
    if (!added) qm_store_mesh_reset(out);
    return added;
}

bool qm_meshes_add(qm_meshes *meshes, qm_blob_writer *upload, const qm_mesh_options *options,
                   qm_store_mesh *out, bool *is_new, qm_problem *problem)
{
    upload_task task = {meshes, upload, options->ttl_s, put_alone, meshes, problem};
    return add(&task, options, out, is_new);
}

bool qm_meshes_adopt(qm_meshes *meshes, const char *hash, qm_store_mesh *out, qm_problem *problem)
{
    qm_loaded_mesh mesh;
    mapped_bytes file = {0};
    *out = (qm_store_mesh){0};
    memcpy(out->hash, hash, sizeof out->hash);
    bool adopted = make_row(&(qm_mesh_options){.name = ""}, out, problem) &&
                   map_blob(meshes, out->id, hash, "it makes no mesh", &file, problem) &&
                   prepare(meshes, file, QM_FORMAT_UNKNOWN, out, &mesh, problem);
    qm_blob_unmap(file.bytes, file.size);
    if (adopted) {
        free_loaded(meshes, &mesh);
        uv_mutex_lock(&meshes->store_lock);
        adopted = qm_store_put_mesh(meshes->store, out) == QM_STORED;
        uv_mutex_unlock(&meshes->store_lock);
        if (!adopted) *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the mesh could not be stored");
    }
    if (!adopted) qm_store_mesh_reset(out);
    return adopted;
}

/* ---- meshes that are made here ---- */

/** Writes the file of a mesh as PLY, which keeps every digit; false with a problem. */
static bool write_file(qm_meshes *meshes, qm_context *ctx, const qm_mesh *mesh, const qm_mesh_facts *facts,
                       qm_blob_writer **out, qm_problem *problem)
{
    qm_encoder *encoder = NULL;
    qm_status status = qm_encoder_create(ctx, mesh, facts, QM_FORMAT_PLY, 0, NULL, &encoder);
    if (status != QM_OK) {
        *problem = qm_problem_from_status(status, ctx->message);
        return false;
    }
    uint64_t size = 0;
    qm_encoder_size(encoder, &size);
    status = qm_blob_begin(meshes->store, size, out);
    for (bool goes_on = true; goes_on && status == QM_OK;) {
        qm_text block = {0};
        goes_on = qm_encoder_next(encoder, &block);
        status = block.failed ? QM_E_NO_MEMORY : qm_blob_write(*out, block.data, block.size);
        qm_text_reset(&block);
    }
    qm_encoder_destroy(encoder);
    if (status == QM_OK) return true;
    qm_blob_abort(*out);
    *problem = qm_problem_from_write(status, "the mesh");
    return false;
}

/** The name of a mesh that was made of another, for free; NULL when out of memory. */
static char *name_made(const qm_store_mesh *source, const qm_mesh *mesh, const char *maker)
{
    qm_text text = {0};
    qm_text_printf(&text, "%s, %zu quads", source && source->name[0] ? source->name : maker,
                   mesh->face_count);
    return qm_text_take(&text);
}

bool qm_meshes_add_made(qm_meshes *meshes, qm_context *ctx, const qm_mesh *mesh, const qm_mesh_facts *facts,
                        const char *source, const char *maker, qm_mesh_put_fn *put, void *user,
                        qm_problem *problem)
{
    qm_store_mesh of, row;
    qm_blob_writer *upload = NULL;
    if (!write_file(meshes, ctx, mesh, facts, &upload, problem)) return false;
    bool has_source = qm_store_find_mesh(meshes->store, source, &of) == QM_STORED;
    char *name = name_made(has_source ? &of : NULL, mesh, maker);
    qm_mesh_options options = {.name = name, .format = QM_FORMAT_PLY};
    if (has_source) memcpy(options.notes.unit, of.notes.unit, sizeof options.notes.unit);
    if (has_source) qm_store_mesh_reset(&of);
    upload_task task = {meshes, upload, 0.0, put, user, problem};
    bool is_new, added = name && add(&task, &options, &row, &is_new);
    if (added) qm_store_mesh_reset(&row);
    if (!name) {
        qm_blob_abort(upload);
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the mesh");
    }
    free(name);
    return added;
}

bool qm_meshes_add_copy(qm_meshes *meshes, const char *id, const qm_moved_copy *copy, const char *name,
                        qm_store_mesh *out, bool *is_new, qm_problem *problem)
{
    qm_mesh_options options = {.name = name, .format = QM_FORMAT_PLY};
    qm_mesh_ref *moved = qm_meshes_acquire_moved(meshes, id, copy->transform, &options.notes, problem);
    if (!moved) return false;
    qm_blob_writer *writer = NULL;
    qm_context ctx = qm_context_make();
    bool is_written = write_file(meshes, &ctx, &moved->mesh.mesh, &moved->mesh.facts, &writer, problem);
    qm_loaded_mesh_move_notes(&moved->mesh, &options.notes);
    qm_meshes_release(meshes, moved);
    return is_written && qm_meshes_add(meshes, writer, &options, out, is_new, problem);
}

/* ---- revisions ----
 *
 * A revision is on disk before memory changes: one that a client knows survives, and a fault leaves the one before. */

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
    if (!work->positions) {
        *work->problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the vertices");
        return false;
    }
    memcpy(work->positions, mesh->positions, mesh->vertex_count * 3 * sizeof *work->positions);
    if (!(work->moved->indices ? move_some(work) : move_all(work))) return false;
    qm_mesh next = *mesh;
    next.positions = work->positions;
    qm_status status = qm_mesh_validate(ctx, &next);
    if (status != QM_OK) *work->problem = qm_problem_from_status(status, ctx->message);
    return status == QM_OK;
}

/** False with a problem. */
static bool write_positions(deform_task *work)
{
    qm_blob_writer *writer;
    size_t size = vertex_count(work) * 3 * sizeof *work->positions;
    qm_status status = qm_blob_begin(work->meshes->store, size, &writer);
    if (status == QM_OK) status = qm_blob_write(writer, work->positions, size);
    if (status == QM_OK) status = qm_blob_seal(writer, work->row.positions);
    if (status != QM_OK) {
        qm_blob_abort(writer);
        *work->problem = qm_problem_from_write(status, "the vertices");
        return false;
    }
    qm_stored stored = qm_blob_keep(writer);
    if (stored != QM_STORED) *work->problem = qm_store_write_problem(stored, "the vertices");
    return stored == QM_STORED;
}

/** QM_STORED_LATE without a problem; others that are not QM_STORED with one. */
static qm_stored store_revision(deform_task *work, qm_context *ctx)
{
    qm_loaded_mesh next = work->ref->mesh;
    next.mesh.positions = work->positions;
    next.box = qm_mesh_bounding_box(&next.mesh);
    next.diagonal = qm_mesh_box_diagonal(&next.box);
    qm_status status = qm_extent_measure(ctx, &next.mesh, work->meshes->threads, &next.extent);
    if (status != QM_OK) {
        *work->problem = qm_problem_from_status(status, ctx->message);
        return QM_STORED_FAULT;
    }
    next.revision = ++work->row.revision;
    free(work->row.document);
    work->row.document = make_document(&work->row, &next);
    /* It leaves the content index: an upload of the original bytes makes a new mesh. */
    if (!leave_index(&work->row, "deformed") || !work->row.document) {
        *work->problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the mesh");
        return QM_STORED_NO_MEMORY;
    }
    if (!write_positions(work)) return QM_STORED_FAULT;
    qm_stored stored = qm_store_revise_mesh(work->meshes->store, &work->row);
    if (stored == QM_STORED) return stored;
    qm_blob_remove(work->meshes->store, work->row.positions);
    if (stored == QM_STORED_NONE)
        *work->problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", work->row.id);
    else if (stored != QM_STORED_LATE)
        *work->problem = qm_store_write_problem(stored, "the revision");
    return stored;
}

/** Says that the next revision of the mesh comes, or that it has come: threads that need it wait for that. */
static void set_behind(deform_task *work, bool is_behind)
{
    uv_mutex_lock(&work->meshes->lock);
    work->ref->is_behind = is_behind;
    uv_cond_broadcast(&work->meshes->changed);
    uv_mutex_unlock(&work->meshes->lock);
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
        unlist(work->meshes, work->ref);
    }
    uv_cond_broadcast(&work->meshes->changed);
    uv_mutex_unlock(&work->meshes->lock);
}

/** Out of memory for a copy: the revision is read back from the store when it is next acquired. */
static void follow_in_copy(deform_task *work, qm_context *ctx)
{
    qm_loaded_mesh copy;
    qm_preparation preparation = preparation_of(work->meshes);
    if (qm_loaded_mesh_copy(ctx, &work->ref->mesh, work->positions, &preparation, &copy) == QM_OK) {
        work->positions = NULL;
        work->out->updated_nodes = qm_bvh_box_count(copy.bvh);
        /* The known self collisions go to the new revision; holders of the old one keep theirs. */
        qm_self_pairs *known = work->ref->mesh.self_pairs;
        if (copy.self_pairs && known) {
            qm_self_pairs_inherit(copy.self_pairs, known);
            qm_self_pairs_move(copy.self_pairs, work->moved->indices, work->moved->count);
        }
        uv_mutex_lock(&work->meshes->lock);
        unlist(work->meshes, work->ref);
        qm_mesh_ref *next = list_entry(work->meshes, work->row.id);
        if (next) {
            next->mesh = copy;
            next->state = QM_MESH_READY;
        }
        uv_mutex_unlock(&work->meshes->lock);
        if (!next) free_loaded(work->meshes, &copy);
    } else {
        uv_mutex_lock(&work->meshes->lock);
        unlist(work->meshes, work->ref);
        uv_mutex_unlock(&work->meshes->lock);
    }
}

static void follow(deform_task *work, qm_context *ctx)
{
    double start = qm_clock_now_ms();
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
    work->out->refit_ms = qm_clock_now_ms() - start;
    work->out->revision = work->row.revision;
    memcpy(work->out->hash, work->row.hash, sizeof work->out->hash);
}

/** One try, with store_lock held. QM_STORED_LATE without a problem: another node has moved the mesh meanwhile. */
static qm_stored deform(deform_task *work, const char *id, const char *if_match)
{
    qm_meshes *meshes = work->meshes;
    if (!find_row(meshes, id, if_match, &work->row, work->problem)) return QM_STORED_NONE;
    work->ref = qm_meshes_acquire(meshes, id, work->problem);
    if (!work->ref) return QM_STORED_NONE;
    if (work->ref->mesh.revision != work->row.revision) return QM_STORED_LATE;
    qm_context ctx = qm_meshes_context(meshes);
    ctx.parallel = qm_host_parallel;
    size_t vertices = vertex_count(work);
    qm_stored stored = QM_STORED_FAULT;
    set_behind(work, true);
    if (make_positions(work, &ctx)) stored = store_revision(work, &ctx);
    if (stored == QM_STORED) follow(work, &ctx);
    set_behind(work, false);
    qm_context_free(&ctx, work->positions, vertices, 3 * sizeof *work->positions);
    work->positions = NULL;
    return stored;
}

bool qm_meshes_deform(qm_meshes *meshes, const char *id, const qm_moved_vertices *moved, const char *if_match,
                      qm_deformed *out, qm_problem *problem)
{
    QM_ASSERT(id && moved && out && problem);
    *out = (qm_deformed){0};
    deform_task work = {.meshes = meshes, .moved = moved, .out = out, .problem = problem};
    qm_stored stored = QM_STORED_LATE;
    uv_mutex_lock(&meshes->store_lock);
    for (int i = 0; i < TRIES && stored == QM_STORED_LATE; i++) {
        stored = deform(&work, id, if_match);
        qm_meshes_release(meshes, work.ref);
        qm_store_mesh_reset(&work.row);
        work.ref = NULL;
    }
    uv_mutex_unlock(&meshes->store_lock);
    if (stored == QM_STORED_LATE)
        *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "other clients move the mesh at the same time");
    return stored == QM_STORED;
}
