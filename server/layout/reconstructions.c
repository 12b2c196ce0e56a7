/**
 * reconstructions.c: builds reconstructions of layouts and rebuilds them from their rows, keeps a table of
 * those in memory, and stores each as an ordinary mesh and a row.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <uv.h>

#include "base/clock.h"
#include "base/json.h"
#include "ops/json_layout.h"
#include "ops/json_request.h"
#include "reconstructions.h"
#include "store/store_problem.h"

#define KEPT_IDLE 4 /* reconstructions in memory without a lease */

/** Stands in the steps of a row for the layout in its next line. */
#define EDIT_WORD "EDIT"

typedef struct lease_entry {
    qm_reconstruction_lease lease; /* first, so that one is the other */
    int64_t revision;              /* of the row that it is as */
    bool in_work;
    struct lease_entry *next; /* the one used last comes first */
} lease_entry;

/** lock guards the list and in_work; a reconstruction belongs to the holder of its lease. */
struct qm_reconstructions {
    qm_store *store;
    qm_meshes *meshes;
    uv_mutex_t lock;
    lease_entry *first;
};

/* ---- a reconstruction from a layout, and again from its row ---- */

static void lease_free(qm_reconstructions *rs, lease_entry *e)
{
    qm_reconstruction_destroy(&e->lease.ctx, e->lease.reconstruction);
    qm_meshes_release(rs->meshes, e->lease.mesh);
    free(e);
}

/** Sets the flags that end or pause the work on a lease; NULL: none. */
static void set_flags(qm_context *ctx, const qm_context *host)
{
    ctx->cancel = host ? host->cancel : NULL;
    ctx->pause = host ? host->pause : NULL;
    ctx->wait = host ? host->wait : NULL;
    ctx->wait_user = host ? host->wait_user : NULL;
}

static lease_entry *lease_begin(qm_reconstructions *rs, const char *source, const char *layout_text,
                                const qm_reconstruction_options *options, const qm_context *host,
                                qm_problem *problem)
{
    lease_entry *e = calloc(1, sizeof *e);
    if (!e) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reconstruction");
        return NULL;
    }
    qm_reconstruction_lease *r = &e->lease;
    r->ctx = qm_meshes_context(rs->meshes);
    set_flags(&r->ctx, host);
    snprintf(r->source_id, sizeof r->source_id, "%s", source);
    r->mesh = qm_meshes_acquire(rs->meshes, source, problem);
    qm_layout layout = {0};
    bool has_patches;
    bool good = r->mesh && qm_json_read_layout(&r->ctx, layout_text, strcspn(layout_text, "\n"), NULL, NULL,
                                               &layout, &has_patches, problem);
    if (good) {
        qm_status status = qm_ref_surface_init(&r->ctx, qm_mesh_ref_get(r->mesh)->bvh, &r->source);
        if (status == QM_OK)
            status = qm_reconstruction_create(&r->ctx, &r->source, &layout, options, &r->reconstruction);
        if (status != QM_OK) *problem = qm_problem_from_status(status, r->ctx.message);
        good = status == QM_OK;
    }
    qm_layout_reset(&r->ctx, &layout);
    if (good) return e;
    lease_free(rs, e);
    return NULL;
}

static bool lease_edit(qm_reconstruction_lease *r, const char *layout_text, size_t *redone,
                       qm_problem *problem)
{
    qm_layout layout;
    bool has_patches;
    if (!qm_json_read_layout(&r->ctx, layout_text, strcspn(layout_text, "\n"), NULL, NULL, &layout,
                             &has_patches, problem))
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

/** Takes count steps with a limit of quads. */
static bool take_steps(qm_reconstruction_lease *r, size_t limit, size_t count, qm_problem *problem)
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

/** Repeats the steps and edits of a row; the layouts of edits are the next lines of its layout. */
static bool replay(lease_entry *e, const qm_store_reconstruction *row, qm_problem *problem)
{
    const char *layout = row->layout;
    bool good = true;
    for (const char *word = row->steps; *word && good; word += strcspn(word, " "), word += *word == ' ') {
        if (*word == EDIT_WORD[0]) {
            size_t redone;
            layout += strcspn(layout, "\n");
            layout += *layout == '\n';
            good = lease_edit(&e->lease, layout, &redone, problem);
            continue;
        }
        char *end;
        size_t limit = strtoull(word, &end, 10), count = *end == ':' ? strtoull(end + 1, NULL, 10) : 0;
        good = take_steps(&e->lease, limit, count, problem);
    }
    return good;
}

static lease_entry *lease_rebuild(qm_reconstructions *rs, const char *id, const qm_context *host,
                                  qm_problem *problem)
{
    qm_store_reconstruction row;
    qm_stored stored = qm_store_find_reconstruction(rs->store, id, &row);
    if (stored != QM_STORED) {
        *problem =
            qm_store_read_problem(stored, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction %s", id);
        return NULL;
    }
    qm_reconstruction_options options = qm_reconstruction_options_default();
    options.cover_share = row.cover_share;
    options.pull_curves = row.pull_curves;
    bool is_read = qm_json_find_noise(row.document, &options.noise_share);
    if (!is_read)
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for reconstruction %s", id);
    lease_entry *e = is_read ? lease_begin(rs, row.source, row.layout, &options, host, problem) : NULL;
    if (e) {
        memcpy(e->lease.id, row.id, sizeof e->lease.id);
        e->revision = row.revision;
    }
    if (e && !replay(e, &row, problem)) {
        lease_free(rs, e);
        e = NULL;
    }
    if (e) set_flags(&e->lease.ctx, NULL);
    qm_store_reconstruction_reset(&row);
    return e;
}

/* ---- the table ---- */

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
    for (lease_entry *e = rs->first, *next; e; e = next) {
        next = e->next;
        lease_free(rs, e);
    }
    uv_mutex_destroy(&rs->lock);
    free(rs);
}

/** The link that leads to an entry, or to the end of the list. The caller holds the lock. */
static lease_entry **find_link(qm_reconstructions *rs, const char *id)
{
    lease_entry **link = &rs->first;
    while (*link && strcmp((*link)->lease.id, id) != 0)
        link = &(*link)->next;
    return link;
}

/** Lists an entry as the one used last. The caller holds the lock. */
static void list_first(qm_reconstructions *rs, lease_entry *e)
{
    e->next = rs->first;
    rs->first = e;
}

/** Takes an entry out of the list; NULL when it is not there. The caller holds the lock. */
static lease_entry *unlist(qm_reconstructions *rs, const char *id)
{
    lease_entry **link = find_link(rs, id), *found = *link;
    if (found) *link = found->next;
    return found;
}

/** True when another node has changed or deleted the reconstruction since it was made or read here. */
static bool is_stale(qm_reconstructions *rs, const lease_entry *e)
{
    qm_store_reconstruction row;
    if (!qm_store_is_shared(rs->store)) return false;
    qm_stored stored = qm_store_find_reconstruction(rs->store, e->lease.id, &row);
    bool stale = stored != QM_STORED || row.revision != e->revision;
    if (stored == QM_STORED) qm_store_reconstruction_reset(&row);
    return stale;
}

qm_reconstruction_lease *qm_reconstructions_take(qm_reconstructions *rs, const char *id,
                                                 const qm_context *host, qm_problem *problem)
{
    uv_mutex_lock(&rs->lock);
    lease_entry *e = *find_link(rs, id);
    bool is_mine = e && !e->in_work, is_taken = e && e->in_work;
    if (is_mine) e->in_work = true;
    uv_mutex_unlock(&rs->lock);
    if (is_mine && !is_stale(rs, e)) return &e->lease;
    if (is_mine) qm_reconstructions_release(rs, &e->lease, false);
    if (is_taken) {
        *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "another job works on the reconstruction");
        return NULL;
    }
    e = lease_rebuild(rs, id, host, problem);
    if (!e) return NULL;
    e->in_work = true;
    uv_mutex_lock(&rs->lock);
    lease_entry *other = *find_link(rs, id);
    if (!other) list_first(rs, e);
    uv_mutex_unlock(&rs->lock);
    if (!other) return &e->lease;
    lease_free(rs, e);
    *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "another job works on the reconstruction");
    return NULL;
}

void qm_reconstructions_release(qm_reconstructions *rs, qm_reconstruction_lease *lease, bool keeps)
{
    if (!lease) return;
    set_flags(&lease->ctx, NULL);
    uv_mutex_lock(&rs->lock);
    lease_entry *own = unlist(rs, lease->id), *dropped = own;
    if (keeps) {
        QM_ASSERT(own && own->in_work);
        own->in_work = false;
        list_first(rs, own);
        /* The first idle entry beyond those that are kept. */
        lease_entry **link = &rs->first;
        for (int idle = 0; *link; link = &(*link)->next)
            if (!(*link)->in_work && ++idle > KEPT_IDLE) break;
        dropped = *link;
        if (dropped) *link = dropped->next;
    }
    uv_mutex_unlock(&rs->lock);
    if (dropped) lease_free(rs, dropped);
}

qm_stored qm_reconstructions_delete(qm_reconstructions *rs, const char *id)
{
    qm_stored stored = qm_store_delete_reconstruction(rs->store, id);
    uv_mutex_lock(&rs->lock);
    lease_entry *e = unlist(rs, id);
    /* The holder of the lease releases it; it is dropped when newer idle ones follow. */
    if (e && e->in_work) {
        list_first(rs, e);
        e = NULL;
    }
    uv_mutex_unlock(&rs->lock);
    if (e) lease_free(rs, e);
    return stored;
}

size_t qm_reconstructions_count_quads(const qm_reconstruction_lease *lease)
{
    size_t quads = 0;
    for (size_t p = 0; p < qm_reconstruction_patch_count(lease->reconstruction); p++) {
        qm_reconstruction_patch patch = qm_reconstruction_get_patch(lease->reconstruction, p);
        quads += (size_t)patch.columns * patch.rows;
    }
    return quads;
}

void qm_reconstructions_add_patches(const qm_reconstruction_lease *lease, qm_text *out)
{
    qm_json_open(out, "patches", "[");
    for (size_t p = 0; p < qm_reconstruction_patch_count(lease->reconstruction); p++) {
        qm_reconstruction_patch patch = qm_reconstruction_get_patch(lease->reconstruction, p);
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

/* ---- meshes and rows ---- */

/** Makes an ordinary mesh of the reconstruction as it is, or of one that it was settled to, which put stores with what
 * names it. */
static bool add_mesh(qm_reconstructions *rs, qm_reconstruction_lease *r, const qm_mesh *settled,
                     qm_mesh_put_fn *put, void *user, qm_problem *problem)
{
    qm_mesh mesh = {0};
    const qm_mesh *added_mesh = settled ? settled : &mesh;
    qm_mesh_facts facts;
    qm_status status = settled ? QM_OK : qm_reconstruction_mesh(&r->ctx, r->reconstruction, &mesh);
    if (status == QM_OK) status = qm_mesh_find_facts(&r->ctx, added_mesh, &facts);
    bool is_made = status == QM_OK;
    if (!is_made) *problem = qm_problem_from_status(status, r->ctx.message);
    bool added = is_made && qm_meshes_add_made(rs->meshes, &r->ctx, added_mesh, &facts, r->source_id, r->id,
                                               put, user, problem);
    qm_mesh_reset(&r->ctx, &mesh);
    return added;
}

static char *make_state(const char *mesh, size_t quads, size_t steps)
{
    qm_text text = {0};
    qm_json_add_string(&text, "mesh", mesh);
    qm_json_add_count(&text, "quads", quads);
    qm_json_add_count(&text, "step_count", steps);
    return qm_text_take(&text);
}

static char *make_document(const qm_reconstruction_lease *r, const qm_store_reconstruction *row,
                           double noise_share)
{
    char created[QM_TIME_SIZE];
    size_t points, uncovered;
    qm_clock_format(created);
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
    if (noise_share == QM_NOISE_AUTOMATIC)
        qm_json_add_string(&text, "noise", "automatic");
    else
        qm_json_add_number(&text, "noise", noise_share);
    qm_json_open(&text, "coverage", "{");
    qm_json_add_count(&text, "samples", points);
    qm_json_add_count(&text, "uncovered_samples", uncovered);
    qm_text_add_string(&text, "}");
    qm_json_add_warnings(&text, r->reconstruction);
    qm_json_add_string(&text, "created", created);
    return qm_text_take(&text);
}

static size_t count_steps(const char *steps)
{
    size_t count = 0;
    for (const char *at = strchr(steps, ':'); at; at = strchr(at + 1, ':'))
        count += strtoull(at + 1, NULL, 10);
    return count;
}

/** A row on its way to the store, for qm_mesh_put_fn: its mesh comes with it. */
typedef struct row_task {
    qm_reconstructions *rs;
    const qm_reconstruction_lease *lease;
    qm_store_reconstruction *row;
    const qm_store_idempotency *idempotency; /* of a new one */
    qm_reconstructions_end_fn *end;          /* stores the row of a job's steps */
    void *end_user;
} row_task;

/** Sets the members of a row that depend on its mesh. */
static bool set_mesh(const row_task *task, const qm_store_mesh *mesh, qm_problem *problem)
{
    qm_store_reconstruction *row = task->row;
    memcpy(row->mesh, mesh->id, sizeof row->mesh);
    free(row->state);
    row->state = make_state(mesh->id, qm_reconstructions_count_quads(task->lease), count_steps(row->steps));
    if (!row->state)
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reconstruction");
    return row->state;
}

/** A mesh that was new, and has a row by now, is looked for again. */
static qm_stored taken_if(bool is_new, qm_stored stored)
{
    return is_new && stored == QM_STORED_LATE ? QM_STORED_TAKEN : stored;
}

static qm_stored put_new(void *user, const qm_store_mesh *mesh, bool is_new, qm_problem *problem)
{
    const row_task *task = user;
    if (!set_mesh(task, mesh, problem)) return QM_STORED_NO_MEMORY;
    qm_stored stored =
        qm_store_put_reconstruction(task->rs->store, task->row, is_new ? mesh : NULL, task->idempotency);
    if (stored == QM_STORED_TAKEN) {
        *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "an equal request is being answered");
        return QM_STORED_LOST;
    }
    if (stored != QM_STORED) *problem = qm_store_write_problem(stored, "the reconstruction");
    return taken_if(is_new, stored);
}

static bool fill_row(qm_reconstructions *rs, qm_reconstruction_lease *r, const char *layout_text,
                     double noise_share, const qm_store_idempotency *idempotency,
                     qm_store_reconstruction *row, qm_problem *problem)
{
    memcpy(row->id, r->id, sizeof row->id);
    row->layout = strdup(layout_text);
    row->steps = strdup("");
    row->records = strdup("");
    row->document = make_document(r, row, noise_share);
    if (!row->layout || !row->steps || !row->records || !row->document) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reconstruction");
        return false;
    }
    row_task task = {.rs = rs, .lease = r, .row = row, .idempotency = idempotency};
    return add_mesh(rs, r, NULL, put_new, &task, problem);
}

bool qm_reconstructions_add(qm_reconstructions *rs, const char *source, const char *layout_id,
                            const char *layout_text, const qm_reconstruction_options *options,
                            const qm_context *host, const qm_store_idempotency *idempotency,
                            qm_store_reconstruction *out, qm_problem *problem)
{
    *out =
        (qm_store_reconstruction){.cover_share = options->cover_share, .pull_curves = options->pull_curves};
    snprintf(out->source, sizeof out->source, "%s", source);
    snprintf(out->layout_id, sizeof out->layout_id, "%s", layout_id);
    lease_entry *e = lease_begin(rs, source, layout_text, options, host, problem);
    if (!e) return false;
    qm_id_make('r', e->lease.id);
    if (!fill_row(rs, &e->lease, layout_text, options->noise_share, idempotency, out, problem)) {
        qm_store_reconstruction_reset(out);
        lease_free(rs, e);
        return false;
    }
    e->in_work = true;
    uv_mutex_lock(&rs->lock);
    list_first(rs, e);
    uv_mutex_unlock(&rs->lock);
    qm_reconstructions_release(rs, &e->lease, true);
    return true;
}

/** The row of a reconstruction that was changed or deleted meanwhile. */
static qm_problem problem_from_update(qm_stored stored)
{
    if (stored == QM_STORED_LATE)
        return qm_problem_make(QM_PROBLEM_CONFLICT, "the reconstruction was changed or deleted meanwhile");
    return qm_store_write_problem(stored, "the reconstruction");
}

/** The row of a leased reconstruction, which another client may have deleted, or another node changed. */
static bool find_row(qm_reconstructions *rs, const qm_reconstruction_lease *lease,
                     qm_store_reconstruction *row, qm_problem *problem)
{
    const char *id = lease->id;
    qm_stored stored = qm_store_find_reconstruction(rs->store, id, row);
    if (stored == QM_STORED && row->revision == ((const lease_entry *)lease)->revision) return true;
    if (stored == QM_STORED) {
        qm_store_reconstruction_reset(row);
        *problem = problem_from_update(QM_STORED_LATE);
        return false;
    }
    *problem = qm_store_read_problem(stored, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction %s", id);
    return false;
}

static qm_stored put_steps(void *user, const qm_store_mesh *mesh, bool is_new, qm_problem *problem)
{
    const row_task *task = user;
    if (!set_mesh(task, mesh, problem)) return QM_STORED_NO_MEMORY;
    const qm_store_effect effect = {task->row, is_new ? mesh : NULL};
    qm_stored stored = task->end(task->end_user, mesh->id, &effect);
    if (stored != QM_STORED) *problem = problem_from_update(stored);
    return taken_if(is_new, stored);
}

/** Makes the row the one after some steps; after none only its mesh will be another. */
static bool add_steps(qm_store_reconstruction *row, size_t max_quads, size_t step_count, const char *records,
                      qm_problem *problem)
{
    qm_text steps = {0}, joined = {0};
    row->revision++;
    if (step_count == 0) return true;
    qm_text_printf(&steps, "%s%s%zu:%zu", row->steps, row->steps[0] ? " " : "", max_quads, step_count);
    qm_text_printf(&joined, "%s%s%s", row->records, row->records[0] ? "," : "", records);
    free(row->steps);
    free(row->records);
    row->steps = qm_text_take(&steps);
    row->records = qm_text_take(&joined);
    if (row->steps && row->records) return true;
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reconstruction");
    return false;
}

bool qm_reconstructions_commit(qm_reconstructions *rs, qm_reconstruction_lease *lease, size_t max_quads,
                               size_t step_count, const char *records, const qm_mesh *settled,
                               qm_reconstructions_end_fn *end, void *user, qm_problem *problem)
{
    qm_store_reconstruction row;
    if (!find_row(rs, lease, &row, problem)) return false;
    row_task task = {.rs = rs, .lease = lease, .row = &row, .end = end, .end_user = user};
    bool good;
    if (step_count == 0 && !settled) {
        qm_stored stored = end(user, row.mesh, NULL);
        good = stored == QM_STORED;
        if (!good) *problem = problem_from_update(stored);
    } else {
        good = add_steps(&row, max_quads, step_count, records, problem) &&
               add_mesh(rs, lease, settled, put_steps, &task, problem);
    }
    if (good) ((lease_entry *)lease)->revision = row.revision;
    qm_store_reconstruction_reset(&row);
    return good;
}

static qm_stored put_edit(void *user, const qm_store_mesh *mesh, bool is_new, qm_problem *problem)
{
    const row_task *task = user;
    if (!set_mesh(task, mesh, problem)) return QM_STORED_NO_MEMORY;
    qm_stored stored =
        qm_store_update_reconstruction(task->rs->store, &(qm_store_effect){task->row, is_new ? mesh : NULL});
    if (stored != QM_STORED) *problem = problem_from_update(stored);
    return taken_if(is_new, stored);
}

/** Makes the row the one after an edit of the layout. */
static bool add_edit(qm_store_reconstruction *row, const char *layout_text, qm_problem *problem)
{
    qm_text layouts = {0}, steps = {0};
    qm_text_printf(&layouts, "%s\n%s", row->layout, layout_text);
    qm_text_printf(&steps, "%s%s" EDIT_WORD, row->steps, row->steps[0] ? " " : "");
    free(row->layout);
    free(row->steps);
    row->layout = qm_text_take(&layouts);
    row->steps = qm_text_take(&steps);
    row->revision++;
    if (row->layout && row->steps) return true;
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reconstruction");
    return false;
}

bool qm_reconstructions_edit(qm_reconstructions *rs, const char *id, const char *layout_text,
                             const qm_context *host, qm_store_reconstruction *out, size_t *redone,
                             qm_problem *problem)
{
    *out = (qm_store_reconstruction){0};
    qm_reconstruction_lease *r = qm_reconstructions_take(rs, id, host, problem);
    if (!r) return false;
    set_flags(&r->ctx, host);
    row_task task = {.rs = rs, .lease = r, .row = out};
    bool edited = lease_edit(r, layout_text, redone, problem);
    bool good = edited && find_row(rs, r, out, problem) && add_edit(out, layout_text, problem) &&
                add_mesh(rs, r, NULL, put_edit, &task, problem);
    if (good) ((lease_entry *)r)->revision = out->revision;
    qm_reconstructions_release(rs, r, good || !edited);
    if (!good) qm_store_reconstruction_reset(out);
    return good;
}
