/**
 * reconstruction_make.c: a reconstruction from a layout, and again from what a row tells of its steps.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ops/json_layout.h"
#include "reconstructions_internal.h"

void qm_refining_free(qm_reconstructions *rs, qm_refining_entry *e)
{
    qm_reconstruction_destroy(&e->refining.ctx, e->refining.reconstruction);
    qm_meshes_release(rs->meshes, e->refining.mesh);
    free(e);
}

qm_refining_entry *qm_refining_begin(qm_reconstructions *rs, const char *source, const char *layout_text,
                                     const qm_reconstruction_options *options, qm_problem *problem)
{
    qm_refining_entry *e = calloc(1, sizeof *e);
    if (!e) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the reconstruction");
        return NULL;
    }
    qm_refining *r = &e->refining;
    r->ctx = qm_meshes_context(rs->meshes);
    snprintf(r->source_id, sizeof r->source_id, "%s", source);
    r->mesh = qm_meshes_acquire(rs->meshes, source, problem);
    qm_layout layout = {0};
    bool has_patches;
    bool good = r->mesh && qm_json_read_layout(&r->ctx, layout_text, strcspn(layout_text, "\n"), NULL,
                                               &layout, &has_patches, problem);
    if (good) {
        qm_status status = qm_source_init(&r->ctx, qm_mesh_ref_get(r->mesh)->bvh, &r->source);
        if (status == QM_OK)
            status = qm_reconstruction_create(&r->ctx, &r->source, &layout, options, &r->reconstruction);
        if (status != QM_OK) *problem = qm_problem_from_status(status, r->ctx.message);
        good = status == QM_OK;
    }
    qm_layout_reset(&r->ctx, &layout);
    if (good) return e;
    qm_refining_free(rs, e);
    return NULL;
}

bool qm_refining_edit(qm_refining *r, const char *layout_text, size_t *redone, qm_problem *problem)
{
    qm_layout layout;
    bool has_patches;
    if (!qm_json_read_layout(&r->ctx, layout_text, strcspn(layout_text, "\n"), NULL, &layout, &has_patches,
                             problem))
        return false;
    qm_reconstruction *edited;
    qm_status status = qm_reconstruction_edit(&r->ctx, r->reconstruction, &layout, &edited, redone);
    qm_layout_reset(&r->ctx, &layout);
    if (status != QM_OK) {
        *problem = qm_problem_from_status(status, r->ctx.message);
        return false;
    }
    qm_reconstruction_destroy(&r->ctx, r->reconstruction);
    r->reconstruction = edited;
    return true;
}

/** Takes so many steps with a limit of quads. */
static bool take_steps(qm_refining *r, size_t limit, size_t count, qm_problem *problem)
{
    for (size_t k = 0; k < count; k++) {
        qm_reconstruction_record record;
        qm_status status = qm_reconstruction_step(&r->ctx, r->reconstruction, limit, &record);
        if (status == QM_OK) continue;
        *problem = qm_problem_from_status(status, r->ctx.message);
        return false;
    }
    return true;
}

/** Does again what a row tells of: steps, and edits, for which the next lines have the layouts. */
static bool replay(qm_refining_entry *e, const qm_store_reconstruction *row, qm_problem *problem)
{
    const char *layout = row->layout;
    bool good = true;
    for (const char *word = row->steps; *word && good; word += strcspn(word, " "), word += *word == ' ') {
        if (*word == QM_EDIT_WORD[0]) {
            size_t redone;
            layout += strcspn(layout, "\n");
            layout += *layout == '\n';
            good = qm_refining_edit(&e->refining, layout, &redone, problem);
            continue;
        }
        char *end;
        size_t limit = strtoull(word, &end, 10), count = *end == ':' ? strtoull(end + 1, NULL, 10) : 0;
        good = take_steps(&e->refining, limit, count, problem);
    }
    return good;
}

static qm_reconstruction_options options_of(double cover_share, bool pull_curves)
{
    qm_reconstruction_options options = qm_reconstruction_options_default();
    options.cover_share = cover_share;
    options.pull_curves = pull_curves;
    return options;
}

qm_refining_entry *qm_refining_make_again(qm_reconstructions *rs, const char *id, qm_problem *problem)
{
    qm_store_reconstruction row;
    qm_status status = qm_store_find_reconstruction(rs->store, id, &row);
    if (status != QM_OK) {
        *problem =
            qm_problem_from_store(status, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction %s", id);
        return NULL;
    }
    const qm_reconstruction_options options = options_of(row.cover_share, row.pull_curves);
    qm_refining_entry *e = qm_refining_begin(rs, row.source, row.layout, &options, problem);
    if (e) memcpy(e->refining.id, row.id, sizeof e->refining.id);
    if (e && !replay(e, &row, problem)) {
        qm_refining_free(rs, e);
        e = NULL;
    }
    qm_store_reconstruction_reset(&row);
    return e;
}
