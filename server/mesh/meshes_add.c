/**
 * meshes_add.c: uploads become meshes: sealed, decoded and prepared, then stored under their content.
 */
#include <stdlib.h>
#include <string.h>

#include "base/metrics.h"
#include "meshes_internal.h"

static bool load_upload(qm_meshes *meshes, const qm_blob_writer *upload, qm_format format,
                        qm_loaded_mesh *out, qm_problem *problem)
{
    qm_mapped_bytes file = {0};
    *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "the bytes of the upload cannot be read");
    bool loaded = qm_blob_map_sealed(upload, &file.bytes, &file.size) == QM_OK &&
                  qm_meshes_load_bytes(meshes, file, (qm_mapped_bytes){0}, format, out, problem);
    qm_blob_unmap(file.bytes, file.size);
    return loaded;
}

static char *make_options(const char *name, qm_format format)
{
    qm_text options = {0};
    qm_text_printf(&options, "format=%s name=%s",
                   format == QM_FORMAT_UNKNOWN ? "auto" : qm_format_name(format), name);
    return qm_text_take(&options);
}

static void free_loaded(qm_meshes *meshes, qm_loaded_mesh *mesh)
{
    qm_context ctx = qm_meshes_context(meshes);
    qm_loaded_mesh_reset(&ctx, mesh);
}

/** Lists a mesh that waits in memory for its first job. Without memory for that it is loaded again then. */
static void keep_in_memory(qm_meshes *meshes, const char *id, qm_loaded_mesh *mesh)
{
    uv_mutex_lock(&meshes->lock);
    qm_mesh_ref *ref = qm_meshes_list(meshes, id);
    if (ref) {
        ref->mesh = *mesh;
        ref->state = QM_MESH_READY;
    }
    uv_mutex_unlock(&meshes->lock);
    if (!ref) free_loaded(meshes, mesh);
}

/** Finds a mesh of equal content and options. */
static bool find_same(qm_meshes *meshes, const qm_store_mesh *wanted, qm_store_mesh *found)
{
    return qm_store_find_mesh_by_content(meshes->store, wanted->hash, wanted->options, found) == QM_OK;
}

/** Names the blob and inserts the row; takes over the upload. store_lock is held. */
static bool store_new(qm_meshes *meshes, qm_blob_writer *upload, const qm_store_mesh *row)
{
    QM_ASSERT(qm_meshes_is_locked(&meshes->store_lock));
    if (qm_blob_keep(upload) != QM_OK) return false;
    if (qm_store_put_mesh(meshes->store, row) == QM_OK) return true;
    qm_blob_remove(meshes->store, row->hash);
    return false;
}

/** Stores a decoded upload, unless equal content was stored meanwhile. Takes over mesh and upload. */
static bool store_loaded(qm_meshes *meshes, qm_blob_writer *upload, qm_store_mesh *row, qm_loaded_mesh *mesh,
                         bool *is_new, qm_problem *problem)
{
    qm_store_mesh same;
    bool stored = false;
    uv_mutex_lock(&meshes->store_lock);
    bool found = find_same(meshes, row, &same);
    if (found) {
        qm_store_mesh_reset(row);
        *row = same;
        qm_blob_abort(upload);
    } else {
        stored = store_new(meshes, upload, row);
        if (stored) keep_in_memory(meshes, row->id, mesh);
    }
    uv_mutex_unlock(&meshes->store_lock);
    if (!stored) free_loaded(meshes, mesh);
    if (!found && !stored) *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the mesh could not be stored");
    *is_new = stored;
    if (stored) qm_metrics_add(QM_METRICS_MESHES_ADDED, 1);
    return found || stored;
}

/** The row of an upload with all but its document; false when out of memory or when it cannot be written. */
static bool make_row(qm_blob_writer *upload, const char *name, qm_format format, qm_store_mesh *row,
                     qm_problem *problem)
{
    qm_id_make('m', row->id);
    row->options = make_options(name, format);
    row->name = strdup(name);
    char created[QM_TIME_SIZE];
    qm_time_format(created);
    row->created = strdup(created);
    if (!row->options || !row->name || !row->created) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the upload");
        return false;
    }
    if (qm_blob_seal(upload, row->hash) == QM_OK) return true;
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the upload could not be written to disk");
    return false;
}

/** Decodes the upload of a row and makes its document. */
static bool prepare(qm_meshes *meshes, const qm_blob_writer *upload, qm_format format, qm_store_mesh *row,
                    qm_loaded_mesh *mesh, qm_problem *problem)
{
    if (!load_upload(meshes, upload, format, mesh, problem)) return false;
    row->format = (int)mesh->format;
    row->document = qm_meshes_make_document(row, mesh);
    if (row->document) return true;
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the mesh");
    free_loaded(meshes, mesh);
    return false;
}

bool qm_meshes_add(qm_meshes *meshes, qm_blob_writer *upload, const char *name, qm_format format,
                   qm_store_mesh *out, bool *is_new, qm_problem *problem)
{
    qm_store_mesh row = {0};
    qm_loaded_mesh mesh = {0};
    *is_new = false;
    bool sealed = make_row(upload, name, format, &row, problem);
    if (sealed && find_same(meshes, &row, out)) {
        qm_store_mesh_reset(&row);
        qm_blob_abort(upload);
        return true;
    }
    bool prepared = sealed && prepare(meshes, upload, format, &row, &mesh, problem);
    if (!prepared) qm_blob_abort(upload);
    bool added = prepared && store_loaded(meshes, upload, &row, &mesh, is_new, problem);
    *out = row;
    if (!added) qm_store_mesh_reset(out);
    return added;
}
