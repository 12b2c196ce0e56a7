/**
 * store.c: the verbs of a store, each of which its driver does; and the rows that they give.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/metrics.h"
#include "store_driver.h"

bool qm_store_is_shared(const qm_store *store)
{
    return store->postgres != NULL;
}

qm_status qm_store_status(qm_stored stored)
{
    switch (stored) {
    case QM_STORED:
        return QM_OK;
    case QM_STORED_NONE:
        return QM_E_EMPTY;
    case QM_STORED_DAMAGED:
        return QM_E_FORMAT;
    case QM_STORED_FULL:
        return QM_E_TOO_LARGE;
    case QM_STORED_NO_MEMORY:
        return QM_E_NO_MEMORY;
    case QM_STORED_AWAY:
        return QM_E_CANCELED;
    case QM_STORED_NO_ROOM:
    case QM_STORED_LATE:
    case QM_STORED_TAKEN:
    case QM_STORED_LOST:
    case QM_STORED_FAULT:
        break;
    }
    return QM_E_ARGUMENT;
}

/** Names of outcomes in metrics. */
static const char *const outcome_names[] = {
    [QM_STORED] = "stored",          [QM_STORED_NONE] = "none",       [QM_STORED_LATE] = "late",
    [QM_STORED_TAKEN] = "taken",     [QM_STORED_LOST] = "lost",       [QM_STORED_FULL] = "full",
    [QM_STORED_NO_ROOM] = "no_room", [QM_STORED_DAMAGED] = "damaged", [QM_STORED_NO_MEMORY] = "no_memory",
    [QM_STORED_AWAY] = "away",       [QM_STORED_FAULT] = "fault"};

void qm_store_count_verb(const qm_store *store, const char *verb, qm_stored stored, double start_ms)
{
    if (store->postgres)
        qm_metrics_add_store(verb, outcome_names[stored], 1e-3 * (qm_clock_now_ms() - start_ms));
}

/* ---- meshes ---- */

qm_stored qm_store_put_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    QM_STORE_RETURN_VERB(store, put_mesh, store, mesh);
}

qm_stored qm_store_find_mesh(qm_store *store, const char *id, qm_store_mesh *out)
{
    QM_STORE_RETURN_VERB(store, find_mesh, store, id, out);
}

qm_stored qm_store_find_mesh_state(qm_store *store, const char *id, qm_store_mesh_state *out)
{
    qm_stored stored = qm_store_find_mesh_states(store, &id, 1, out);
    return stored == QM_STORED && !out->is_found ? QM_STORED_NONE : stored;
}

qm_stored qm_store_find_mesh_states(qm_store *store, const char *const *ids, size_t count,
                                    qm_store_mesh_state *out)
{
    for (size_t i = 0; i < count; i++)
        out[i] = (qm_store_mesh_state){.is_found = false};
    QM_STORE_RETURN_VERB(store, find_mesh_states, store, ids, count, out);
}

qm_stored qm_store_find_undeformed(qm_store *store, const char *const *hashes, size_t count,
                                   char (*ids)[QM_ID_SIZE])
{
    for (size_t i = 0; i < count; i++)
        ids[i][0] = '\0';
    QM_STORE_RETURN_VERB(store, find_undeformed, store, hashes, count, ids);
}

qm_stored qm_store_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                        qm_store_mesh *out)
{
    QM_STORE_RETURN_VERB(store, find_mesh_by_content, store, hash, options, out);
}

qm_stored qm_store_list_meshes(qm_store *store, const qm_store_page *page, const qm_store_mesh_filter *filter,
                               qm_store_mesh *out, size_t *count)
{
    QM_STORE_RETURN_VERB(store, list_meshes, store, page, filter, out, count);
}

qm_stored qm_store_revise_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    QM_ASSERT(mesh->revision > 0);
    QM_STORE_RETURN_VERB(store, revise_mesh, store, mesh);
}

qm_stored qm_store_set_notes(qm_store *store, const qm_store_mesh *mesh)
{
    QM_STORE_RETURN_VERB(store, set_notes, store, mesh);
}

qm_stored qm_store_set_expiry(qm_store *store, const char *id, const char *expires)
{
    QM_STORE_RETURN_VERB(store, set_expiry, store, id, expires);
}

qm_stored qm_store_find_expired_mesh(qm_store *store, const char *before, qm_store_mesh *out)
{
    QM_STORE_RETURN_VERB(store, find_expired_mesh, store, before, out);
}

qm_stored qm_store_delete_mesh(qm_store *store, const char *id)
{
    QM_STORE_RETURN_VERB(store, delete_mesh, store, id);
}

void qm_store_mesh_reset(qm_store_mesh *mesh)
{
    free(mesh->options);
    free(mesh->name);
    free(mesh->document);
    free(mesh->created);
    free(mesh->labels);
    *mesh = (qm_store_mesh){0};
}

/* ---- jobs ---- */

qm_stored qm_store_submit_job(qm_store *store, const qm_store_submission *submission)
{
    QM_ASSERT(submission->job && submission->job->state == QM_JOB_QUEUED);
    QM_STORE_RETURN_VERB(store, submit_job, store, submission);
}

qm_stored qm_store_claim_jobs(qm_store *store, const qm_store_wish *wish, qm_store_job *out, size_t *count)
{
    QM_STORE_RETURN_VERB(store, claim_jobs, store, wish, out, count);
}

qm_stored qm_store_begin_job(qm_store *store, const char *id)
{
    QM_STORE_RETURN_VERB(store, begin_job, store, id);
}

qm_stored qm_store_note_cancel(qm_store *store, const char *id)
{
    QM_STORE_RETURN_VERB(store, note_cancel, store, id);
}

qm_stored qm_store_append_events(qm_store *store, qm_store_run *runs, size_t run_count,
                                 const qm_store_event *events, size_t count)
{
    QM_STORE_RETURN_VERB(store, append_events, store, runs, run_count, events, count);
}

qm_stored qm_store_finish_job(qm_store *store, const qm_store_job *end, const char *revisions,
                              const qm_store_event *events, size_t count, const qm_store_effect *effect)
{
    QM_ASSERT(end->state > QM_JOB_RUNNING && end->document);
    QM_STORE_RETURN_VERB(store, finish_job, store, end, revisions, events, count, effect);
}

qm_stored qm_store_leave_jobs(qm_store *store)
{
    QM_STORE_RETURN_VERB(store, leave_jobs, store);
}

qm_stored qm_store_read_events(qm_store *store, const char *id, uint64_t after, qm_store_event_fn *take,
                               void *user)
{
    QM_STORE_RETURN_VERB(store, read_events, store, id, after, take, user);
}

qm_stored qm_store_find_job(qm_store *store, const char *id, qm_store_job *out)
{
    QM_STORE_RETURN_VERB(store, find_job, store, id, out);
}

qm_stored qm_store_find_job_by_key(qm_store *store, const char *key, const char *revisions,
                                   qm_job_state state, qm_store_job *out)
{
    QM_STORE_RETURN_VERB(store, find_job_by_key, store, key, revisions, state, out);
}

qm_stored qm_store_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out)
{
    QM_STORE_RETURN_VERB(store, find_job_by_idempotency_key, store, key, out);
}

qm_stored qm_store_forget_answer(qm_store *store, const char *id)
{
    QM_STORE_RETURN_VERB(store, forget_answer, store, id);
}

qm_stored qm_store_list_jobs(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                             qm_store_job *out, size_t *count)
{
    QM_STORE_RETURN_VERB(store, list_jobs, store, page, filter, out, count);
}

qm_stored qm_store_drop_old_jobs(qm_store *store, size_t kept, double kept_s, size_t limit,
                                 char (*ids)[QM_ID_SIZE], size_t *count)
{
    QM_STORE_RETURN_VERB(store, drop_old_jobs, store, kept, kept_s, limit, ids, count);
}

qm_stored qm_store_delete_job(qm_store *store, const char *id)
{
    QM_STORE_RETURN_VERB(store, delete_job, store, id);
}

qm_stored qm_store_put_array(qm_store *store, const char *job_id, const qm_store_array *array)
{
    QM_STORE_RETURN_VERB(store, put_array, store, job_id, array);
}

qm_stored qm_store_find_array(qm_store *store, const char *job_id, qm_store_array *out)
{
    QM_STORE_RETURN_VERB(store, find_array, store, job_id, out);
}

qm_stored qm_store_set_job_labels(qm_store *store, const char *id, const char *labels)
{
    QM_STORE_RETURN_VERB(store, set_job_labels, store, id, labels);
}

void qm_store_job_reset(qm_store_job *job)
{
    free(job->key);
    free(job->idempotency_key);
    free(job->body);
    free(job->created);
    free(job->document);
    free(job->result);
    free(job->progress);
    free(job->labels);
    *job = (qm_store_job){0};
}

/* ---- layouts ---- */

qm_stored qm_store_put_layout(qm_store *store, const qm_store_layout *layout,
                              const qm_store_idempotency *idempotency)
{
    QM_STORE_RETURN_VERB(store, put_layout, store, layout, idempotency);
}

qm_stored qm_store_find_layout(qm_store *store, const char *id, qm_store_layout *out)
{
    QM_STORE_RETURN_VERB(store, find_layout, store, id, out);
}

qm_stored qm_store_find_layout_by_idempotency_key(qm_store *store, const char *key,
                                                  qm_store_idempotency_record *out)
{
    QM_STORE_RETURN_VERB(store, find_layout_by_idempotency_key, store, key, out);
}

qm_stored qm_store_list_layouts(qm_store *store, const qm_store_page *page, const char *mesh,
                                qm_store_layout *out, size_t *count)
{
    QM_STORE_RETURN_VERB(store, list_layouts, store, page, mesh, out, count);
}

qm_stored qm_store_edit_layout(qm_store *store, const qm_store_layout *layout)
{
    QM_STORE_RETURN_VERB(store, edit_layout, store, layout);
}

qm_stored qm_store_move_layout(qm_store *store, const char *id, int64_t from, int64_t to)
{
    QM_STORE_RETURN_VERB(store, move_layout, store, id, from, to);
}

qm_stored qm_store_delete_layout(qm_store *store, const char *id)
{
    QM_STORE_RETURN_VERB(store, delete_layout, store, id);
}

void qm_store_layout_reset(qm_store_layout *layout)
{
    free(layout->created);
    free(layout->layout);
    free(layout->issues);
    *layout = (qm_store_layout){0};
}

/* ---- reconstructions ---- */

qm_stored qm_store_put_reconstruction(qm_store *store, const qm_store_reconstruction *reconstruction,
                                      const qm_store_mesh *mesh, const qm_store_idempotency *idempotency)
{
    QM_STORE_RETURN_VERB(store, put_reconstruction, store, reconstruction, mesh, idempotency);
}

qm_stored qm_store_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out)
{
    QM_STORE_RETURN_VERB(store, find_reconstruction, store, id, out);
}

qm_stored qm_store_find_reconstruction_by_idempotency_key(qm_store *store, const char *key,
                                                          qm_store_idempotency_record *out)
{
    QM_STORE_RETURN_VERB(store, find_reconstruction_by_idempotency_key, store, key, out);
}

qm_stored qm_store_list_reconstructions(qm_store *store, const qm_store_page *page, const char *source,
                                        qm_store_reconstruction *out, size_t *count)
{
    QM_STORE_RETURN_VERB(store, list_reconstructions, store, page, source, out, count);
}

qm_stored qm_store_update_reconstruction(qm_store *store, const qm_store_effect *effect)
{
    QM_STORE_RETURN_VERB(store, update_reconstruction, store, effect);
}

qm_stored qm_store_delete_reconstruction(qm_store *store, const char *id)
{
    QM_STORE_RETURN_VERB(store, delete_reconstruction, store, id);
}

void qm_store_reconstruction_reset(qm_store_reconstruction *reconstruction)
{
    free(reconstruction->layout);
    free(reconstruction->document);
    free(reconstruction->steps);
    free(reconstruction->records);
    free(reconstruction->state);
    *reconstruction = (qm_store_reconstruction){0};
}

bool qm_store_next_subject(const char **rest, char out[QM_ID_SIZE])
{
    if (!*rest || !**rest) return false;
    size_t length = strcspn(*rest, " ");
    snprintf(out, QM_ID_SIZE, "%.*s", (int)length, *rest);
    *rest += length + ((*rest)[length] != '\0');
    return true;
}

/* ---- copies ---- */

qm_stored qm_store_list_job_copies(qm_store *store, const qm_store_page *page, qm_store_job_copy *out,
                                   size_t *count)
{
    QM_STORE_RETURN_VERB(store, list_job_copies, store, page, out, count);
}

qm_stored qm_store_put_job_copy(qm_store *store, const qm_store_job_copy *copy, const qm_store_event *events,
                                size_t count, const qm_store_array *array)
{
    QM_STORE_RETURN_VERB(store, put_job_copy, store, copy, events, count, array);
}

void qm_store_job_copy_reset(qm_store_job_copy *copy)
{
    qm_store_job_reset(&copy->job);
    free(copy->type);
    free(copy->subjects);
    free(copy->revisions);
    *copy = (qm_store_job_copy){0};
}

qm_stored qm_store_list_layout_revisions(qm_store *store, const char *id, const qm_store_page *page,
                                         qm_store_layout *out, size_t *count)
{
    QM_STORE_RETURN_VERB(store, list_layout_revisions, store, id, page, out, count);
}

qm_stored qm_store_put_layout_copy(qm_store *store, const qm_store_layout *revisions, size_t count,
                                   int64_t current, const qm_store_idempotency *idempotency)
{
    QM_ASSERT(count > 0 && revisions[0].revision <= current && current <= revisions[count - 1].revision);
    QM_STORE_RETURN_VERB(store, put_layout_copy, store, revisions, count, current, idempotency);
}

qm_stored qm_store_find_layout_origin(qm_store *store, const char *id, qm_store_origin *out)
{
    QM_STORE_RETURN_VERB(store, find_layout_origin, store, id, out);
}

qm_stored qm_store_find_reconstruction_origin(qm_store *store, const char *id, qm_store_origin *out)
{
    QM_STORE_RETURN_VERB(store, find_reconstruction_origin, store, id, out);
}

qm_stored qm_store_sync(qm_store *store)
{
    QM_STORE_RETURN_VERB(store, sync, store);
}

/* ---- nodes of a shared store ---- */

qm_stored qm_store_beat(qm_store *store, size_t free_workers, qm_store_cluster *out,
                        qm_store_durable_fn *take, void *user)
{
    QM_ASSERT(qm_store_is_shared(store));
    QM_STORE_RETURN_VERB(store, beat, store, free_workers, out, take, user);
}

qm_stored qm_store_join(qm_store *store)
{
    QM_ASSERT(qm_store_is_shared(store));
    QM_STORE_RETURN_VERB(store, join, store);
}

qm_stored qm_store_reap(qm_store *store, double silence_s, size_t *count)
{
    QM_ASSERT(qm_store_is_shared(store));
    QM_STORE_RETURN_VERB(store, reap, store, silence_s, count);
}

qm_stored qm_store_find_home(qm_store *store, const char *id, char out[QM_NODE_NAME_SIZE])
{
    QM_ASSERT(qm_store_is_shared(store));
    return store->driver->find_home(store, id, out);
}

qm_stored qm_store_cancel_job(qm_store *store, const char *id, const char *document,
                              const qm_store_event *last)
{
    QM_ASSERT(qm_store_is_shared(store));
    QM_STORE_RETURN_VERB(store, cancel_job, store, id, document, last);
}

qm_stored qm_store_hold_job(qm_store *store, const char *id, int owners, bool is_kept, bool *is_unwanted)
{
    QM_ASSERT(qm_store_is_shared(store));
    QM_STORE_RETURN_VERB(store, hold_job, store, id, owners, is_kept, is_unwanted);
}

qm_stored qm_store_look_at_jobs(qm_store *store, qm_store_look *looks, size_t count, qm_store_event_fn *take,
                                void *user)
{
    QM_ASSERT(qm_store_is_shared(store));
    QM_STORE_RETURN_VERB(store, look_at_jobs, store, looks, count, take, user);
}

qm_stored qm_store_clean_blobs(qm_store *store, double delay_s)
{
    QM_ASSERT(qm_store_is_shared(store));
    QM_STORE_RETURN_VERB(store, clean_blobs, store, delay_s);
}

void qm_store_watch(qm_store *store, qm_store_news_fn *tell, void *user)
{
    QM_ASSERT(qm_store_is_shared(store));
    store->driver->watch(store, tell, user);
}

void qm_store_unwatch(qm_store *store)
{
    QM_ASSERT(qm_store_is_shared(store));
    store->driver->unwatch(store);
}
