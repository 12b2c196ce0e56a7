/**
 * reconstruction_rows.c: what is stored of a reconstruction: its mesh, which is an ordinary one, and its row.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json_write.h"
#include "format/encode.h"
#include "reconstructions_internal.h"

/** The mesh as a PLY upload, which keeps every digit. NULL with a problem. */
static qm_blob_writer *write_upload(qm_reconstructions *rs, qm_refining *r, qm_problem *problem)
{
    qm_mesh mesh;
    qm_mesh_facts facts;
    qm_encoder *encoder = NULL;
    qm_blob_writer *upload = NULL;
    qm_status status = qm_reconstruction_mesh(&r->ctx, r->reconstruction, &mesh);
    if (status == QM_OK) status = qm_mesh_find_facts(&r->ctx, &mesh, &facts);
    if (status == QM_OK) status = qm_encoder_create(&r->ctx, &mesh, &facts, QM_FORMAT_PLY, 0, &encoder);
    if (status == QM_OK) status = qm_blob_begin(rs->store, &upload);
    for (bool goes_on = status == QM_OK; goes_on;) {
        qm_text block = {0};
        goes_on = qm_encoder_next(encoder, &block);
        status = block.failed ? QM_E_NO_MEMORY : qm_blob_write(upload, block.data, block.size);
        goes_on = goes_on && status == QM_OK;
        qm_text_reset(&block);
    }
    qm_encoder_destroy(encoder);
    qm_mesh_reset(&r->ctx, &mesh);
    if (status == QM_OK) return upload;
    qm_blob_abort(upload);
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the mesh could not be written");
    return NULL;
}

/** What a mesh of the reconstruction is called: by its source, where that has a name. */
static char *name_mesh(qm_reconstructions *rs, const qm_refining *r, size_t quads)
{
    qm_store_mesh source;
    bool is_there = qm_store_find_mesh(rs->store, r->source_id, &source) == QM_OK;
    qm_text name = {0};
    qm_text_printf(&name, "%s, %zu quads", is_there && source.name[0] ? source.name : r->id, quads);
    if (is_there) qm_store_mesh_reset(&source);
    return qm_text_take(&name);
}

/** Makes an ordinary mesh of the reconstruction as it is; its id goes to out. */
static bool add_mesh(qm_reconstructions *rs, qm_refining *r, char out[QM_ID_SIZE], size_t *quads,
                     qm_problem *problem)
{
    qm_blob_writer *upload = write_upload(rs, r, problem);
    if (!upload) return false;
    *quads = qm_refining_quads(r);
    char *name = name_mesh(rs, r, *quads);
    if (!name) {
        qm_blob_abort(upload);
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the mesh");
        return false;
    }
    qm_store_mesh row;
    bool is_new;
    bool added = qm_meshes_add(rs->meshes, upload, name, QM_FORMAT_PLY, &row, &is_new, problem);
    free(name);
    if (!added) return false;
    memcpy(out, row.id, QM_ID_SIZE);
    qm_store_mesh_reset(&row);
    return true;
}

static char *make_state(const char *mesh, size_t quads, size_t steps)
{
    qm_text text = {0};
    qm_json_add_string(&text, "mesh", mesh);
    qm_json_add_count(&text, "quads", quads);
    qm_json_add_count(&text, "step_count", steps);
    return qm_text_take(&text);
}

static char *make_document(const qm_refining *r, const qm_store_reconstruction *row)
{
    char created[QM_TIME_SIZE];
    size_t points, uncovered;
    qm_time_format(created);
    qm_reconstruction_coverage(r->reconstruction, &points, &uncovered);
    qm_text text = {0};
    qm_json_add_string(&text, "id", r->id);
    qm_json_add_string(&text, "source", row->source);
    if (row->layout_id[0])
        qm_json_add_string(&text, "layout", row->layout_id);
    else
        qm_json_add_word(&text, "layout", "null");
    qm_json_add_count(&text, "patch_count", qm_reconstruction_patch_count(r->reconstruction));
    qm_json_add_number(&text, "cover_share", row->cover_share);
    qm_json_add_bool(&text, "pull_curves", row->pull_curves);
    qm_json_open(&text, "coverage", "{");
    qm_json_add_count(&text, "samples", points);
    qm_json_add_count(&text, "uncovered_samples", uncovered);
    qm_text_add_string(&text, "}");
    qm_json_add_string(&text, "created", created);
    return qm_text_take(&text);
}

static bool fill_row(qm_reconstructions *rs, qm_refining *r, const char *layout_text,
                     const qm_store_idempotency *once, qm_store_reconstruction *row, qm_problem *problem)
{
    size_t quads;
    if (!add_mesh(rs, r, row->mesh, &quads, problem)) return false;
    memcpy(row->id, r->id, sizeof row->id);
    row->layout = strdup(layout_text);
    row->steps = strdup("");
    row->records = strdup("");
    row->document = make_document(r, row);
    row->state = make_state(row->mesh, quads, 0);
    if (!row->layout || !row->steps || !row->records || !row->document || !row->state) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the reconstruction");
        return false;
    }
    if (qm_store_put_reconstruction(rs->store, row, once) == QM_OK) return true;
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the reconstruction could not be stored");
    return false;
}

bool qm_reconstructions_add(qm_reconstructions *rs, const char *source, const char *layout_id,
                            const char *layout_text, const qm_reconstruction_options *options,
                            const qm_store_idempotency *once, qm_store_reconstruction *out,
                            qm_problem *problem)
{
    *out =
        (qm_store_reconstruction){.cover_share = options->cover_share, .pull_curves = options->pull_curves};
    snprintf(out->source, sizeof out->source, "%s", source);
    snprintf(out->layout_id, sizeof out->layout_id, "%s", layout_id);
    qm_refining_entry *e = qm_refining_begin(rs, source, layout_text, options, problem);
    if (!e) return false;
    qm_id_make('r', e->refining.id);
    if (!fill_row(rs, &e->refining, layout_text, once, out, problem)) {
        qm_store_reconstruction_reset(out);
        qm_refining_free(rs, e);
        return false;
    }
    qm_reconstructions_list(rs, e);
    qm_reconstructions_release(rs, &e->refining, true);
    return true;
}

/** The steps with these added. NULL: out of memory. */
static char *add_steps(const char *steps, size_t max_quads, size_t count)
{
    qm_text text = {0};
    qm_text_printf(&text, "%s%s%zu:%zu", steps, steps[0] ? " " : "", max_quads, count);
    return qm_text_take(&text);
}

static size_t count_steps(const char *steps)
{
    size_t count = 0;
    for (const char *at = strchr(steps, ':'); at; at = strchr(at + 1, ':'))
        count += strtoull(at + 1, NULL, 10);
    return count;
}

/** The row of a reconstruction that somebody works on, and somebody else may have deleted. */
static bool find_row(qm_reconstructions *rs, const char *id, qm_store_reconstruction *row,
                     qm_problem *problem)
{
    qm_status status = qm_store_find_reconstruction(rs->store, id, row);
    if (status == QM_OK) return true;
    *problem = qm_problem_from_store(status, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction any more");
    return false;
}

/** The row after so many steps, whose mesh is there already; stored. */
static bool store_steps(qm_reconstructions *rs, const char *mesh, size_t quads, size_t max_quads,
                        size_t step_count, const char *records, const qm_store_reconstruction *row,
                        qm_problem *problem)
{
    qm_store_reconstruction next = *row;
    qm_text joined = {0};
    qm_text_printf(&joined, "%s%s%s", row->records, row->records[0] ? "," : "", records);
    memcpy(next.mesh, mesh, sizeof next.mesh);
    next.steps = add_steps(row->steps, max_quads, step_count);
    next.records = qm_text_take(&joined);
    next.state = next.steps ? make_state(mesh, quads, count_steps(next.steps)) : NULL;
    next.revision++;
    bool good =
        next.steps && next.records && next.state && qm_store_update_reconstruction(rs->store, &next) == QM_OK;
    if (!good) *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the reconstruction could not be stored");
    free(next.steps);
    free(next.records);
    free(next.state);
    return good;
}

bool qm_reconstructions_commit(qm_reconstructions *rs, qm_refining *refining, size_t max_quads,
                               size_t step_count, const char *records, char mesh[QM_ID_SIZE],
                               qm_problem *problem)
{
    qm_store_reconstruction row;
    if (!find_row(rs, refining->id, &row, problem)) return false;
    memcpy(mesh, row.mesh, QM_ID_SIZE);
    size_t quads;
    bool good =
        step_count == 0 || (add_mesh(rs, refining, mesh, &quads, problem) &&
                            store_steps(rs, mesh, quads, max_quads, step_count, records, &row, problem));
    qm_store_reconstruction_reset(&row);
    return good;
}

/** The row after an edit of the layout, whose mesh is there already; stored. */
static bool store_edit(qm_reconstructions *rs, const char *mesh, size_t quads, const char *layout_text,
                       qm_store_reconstruction *row, qm_problem *problem)
{
    qm_text layouts = {0}, steps = {0};
    qm_text_printf(&layouts, "%s\n%s", row->layout, layout_text);
    qm_text_printf(&steps, "%s%s" QM_EDIT_WORD, row->steps, row->steps[0] ? " " : "");
    free(row->layout);
    free(row->steps);
    free(row->state);
    row->layout = qm_text_take(&layouts);
    row->steps = qm_text_take(&steps);
    row->state = row->steps ? make_state(mesh, quads, count_steps(row->steps)) : NULL;
    row->revision++;
    memcpy(row->mesh, mesh, sizeof row->mesh);
    if (row->layout && row->steps && row->state && qm_store_update_reconstruction(rs->store, row) == QM_OK)
        return true;
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the reconstruction could not be stored");
    return false;
}

bool qm_reconstructions_edit(qm_reconstructions *rs, const char *id, const char *layout_text,
                             qm_store_reconstruction *out, size_t *redone, qm_problem *problem)
{
    *out = (qm_store_reconstruction){0};
    qm_refining *r = qm_reconstructions_take(rs, id, problem);
    if (!r) return false;
    char mesh[QM_ID_SIZE];
    size_t quads;
    bool edited = qm_refining_edit(r, layout_text, redone, problem);
    bool good = edited && add_mesh(rs, r, mesh, &quads, problem) && find_row(rs, id, out, problem) &&
                store_edit(rs, mesh, quads, layout_text, out, problem);
    qm_reconstructions_release(rs, r, good || !edited);
    if (!good) qm_store_reconstruction_reset(out);
    return good;
}
