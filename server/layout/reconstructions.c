/**
 * reconstructions.c: the table of those in memory: each belongs to who works on it, a few idle ones are kept.
 */
#include "reconstructions_internal.h"

#include <stdlib.h>
#include <string.h>

#include "base/json_write.h"

#define KEPT_IDLE 4 /* reconstructions in memory that nobody works on */

qm_reconstructions *qm_reconstructions_create(qm_store *store, qm_meshes *meshes)
{
    qm_reconstructions *rs = calloc(1, sizeof *rs);
    if (!rs) return NULL;
    rs->store = store;
    rs->meshes = meshes;
    uv_mutex_init(&rs->lock);
    return rs;
}

void qm_reconstructions_destroy(qm_reconstructions *rs)
{
    if (!rs) return;
    for (qm_refining_entry *e = rs->first, *next; e; e = next) {
        next = e->next;
        qm_refining_free(rs, e);
    }
    uv_mutex_destroy(&rs->lock);
    free(rs);
}

/** Takes an entry out of the list; NULL when it is not there. The caller holds the lock. */
static qm_refining_entry *unlist(qm_reconstructions *rs, const char *id)
{
    qm_refining_entry **link = &rs->first;
    while (*link && strcmp((*link)->refining.id, id) != 0)
        link = &(*link)->next;
    qm_refining_entry *found = *link;
    if (found) *link = found->next;
    return found;
}

void qm_reconstructions_list(qm_reconstructions *rs, qm_refining_entry *e)
{
    e->in_work = true;
    uv_mutex_lock(&rs->lock);
    e->next = rs->first;
    rs->first = e;
    uv_mutex_unlock(&rs->lock);
}

qm_refining *qm_reconstructions_take(qm_reconstructions *rs, const char *id, qm_problem *problem)
{
    uv_mutex_lock(&rs->lock);
    qm_refining_entry *e = rs->first;
    while (e && strcmp(e->refining.id, id) != 0)
        e = e->next;
    bool is_mine = e && !e->in_work, is_taken = e && e->in_work;
    if (is_mine) e->in_work = true;
    uv_mutex_unlock(&rs->lock);
    if (is_mine) return &e->refining;
    if (is_taken) {
        *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "another job works on the reconstruction");
        return NULL;
    }
    e = qm_refining_make_again(rs, id, problem);
    if (!e) return NULL;
    e->in_work = true;
    uv_mutex_lock(&rs->lock);
    qm_refining_entry *other = rs->first;
    while (other && strcmp(other->refining.id, id) != 0)
        other = other->next;
    if (!other) {
        e->next = rs->first;
        rs->first = e;
    }
    uv_mutex_unlock(&rs->lock);
    if (!other) return &e->refining;
    qm_refining_free(rs, e);
    *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "another job works on the reconstruction");
    return NULL;
}

/** The first idle entry beyond those that are kept, out of the list; NULL for none. The caller holds the
 * lock. */
static qm_refining_entry *unlist_surplus(qm_reconstructions *rs)
{
    int idle = 0;
    for (qm_refining_entry **link = &rs->first; *link; link = &(*link)->next) {
        if ((*link)->in_work || ++idle <= KEPT_IDLE) continue;
        qm_refining_entry *surplus = *link;
        *link = surplus->next;
        return surplus;
    }
    return NULL;
}

void qm_reconstructions_release(qm_reconstructions *rs, qm_refining *refining, bool keeps)
{
    if (!refining) return;
    refining->ctx.cancel = NULL;
    uv_mutex_lock(&rs->lock);
    qm_refining_entry *own = unlist(rs, refining->id), *dropped = own;
    if (keeps) {
        own->in_work = false;
        own->next = rs->first;
        rs->first = own;
        dropped = unlist_surplus(rs);
    }
    uv_mutex_unlock(&rs->lock);
    if (dropped) qm_refining_free(rs, dropped);
}

qm_status qm_reconstructions_delete(qm_reconstructions *rs, const char *id)
{
    qm_status status = qm_store_delete_reconstruction(rs->store, id);
    uv_mutex_lock(&rs->lock);
    qm_refining_entry *e = unlist(rs, id);
    /* Who works on it gives it back, and it is dropped then for want of a place among the idle. */
    if (e && e->in_work) {
        e->next = rs->first;
        rs->first = e;
        e = NULL;
    }
    uv_mutex_unlock(&rs->lock);
    if (e) qm_refining_free(rs, e);
    return status;
}

size_t qm_refining_quads(const qm_refining *refining)
{
    size_t quads = 0;
    for (size_t p = 0; p < qm_reconstruction_patch_count(refining->reconstruction); p++) {
        qm_reconstruction_patch patch = qm_reconstruction_get_patch(refining->reconstruction, p);
        quads += (size_t)patch.columns * patch.rows;
    }
    return quads;
}

void qm_refining_add_patches(const qm_refining *refining, qm_text *out)
{
    qm_json_open(out, "patches", "[");
    for (size_t p = 0; p < qm_reconstruction_patch_count(refining->reconstruction); p++) {
        qm_reconstruction_patch patch = qm_reconstruction_get_patch(refining->reconstruction, p);
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_count(out, "patch", p);
        qm_json_add_count(out, "first_face", patch.first_face);
        qm_json_add_count(out, "columns", patch.columns);
        qm_json_add_count(out, "rows", patch.rows);
        qm_json_add_count(out, "samples", patch.points);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}
