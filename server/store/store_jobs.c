/**
 * store_jobs.c: rows of jobs and of their events.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "store_internal.h"

#define COLUMNS "id, key, idempotency_key, body, created, state, sequence, document, restarts, result, begun"

/** In a transaction. QM_E_CANCELED: the idempotency key has another job. */
static qm_status submit(qm_store *store, const qm_store_job *job)
{
    sqlite3_stmt *row = qm_store_prepare(
        store, "INSERT INTO jobs (id, key, idempotency_key, body, created, state, revisions, type)"
               " VALUES (?, ?, ?, ?, ?, ?, '', ?) ON CONFLICT (idempotency_key) DO NOTHING");
    sqlite3_stmt *subject = qm_store_prepare(store, "INSERT OR IGNORE INTO job_subjects (job, subject)"
                                                    " SELECT sequence, ? FROM jobs WHERE id = ?");
    if (!row || !subject) return QM_E_ARGUMENT;
    qm_store_bind_text(row, 1, job->id);
    qm_store_bind_text(row, 2, job->key);
    qm_store_bind_text(row, 3, job->idempotency_key);
    qm_store_bind_text(row, 4, job->body);
    qm_store_bind_text(row, 5, job->created);
    sqlite3_bind_int(row, 6, (int)job->state);
    qm_store_bind_text(row, 7, job->type ? job->type : "");
    if (!qm_store_run(store, row)) return QM_E_ARGUMENT;
    if (sqlite3_changes(store->database) == 0) return QM_E_CANCELED;
    for (int i = 0; i < 2; i++) {
        if (!job->subjects[i] || !job->subjects[i][0]) continue;
        qm_store_bind_text(subject, 1, job->subjects[i]);
        qm_store_bind_text(subject, 2, job->id);
        if (!qm_store_run(store, subject)) return QM_E_ARGUMENT;
    }
    return QM_OK;
}

qm_status qm_store_submit_job(qm_store *store, const qm_store_job *job)
{
    qm_status status = qm_space_check(store);
    if (status != QM_OK) return status;
    if (!qm_store_begin_transaction(store)) return QM_E_ARGUMENT;
    status = submit(store, job);
    return qm_store_end_transaction(store, status == QM_OK) || status != QM_OK ? status : QM_E_ARGUMENT;
}

/** In a transaction. */
static bool append(qm_store *store, const qm_store_event *events, size_t count)
{
    sqlite3_stmt *statement =
        qm_store_prepare(store, "INSERT OR REPLACE INTO job_events (job, seq, name, members)"
                                " SELECT sequence, ?, ?, ? FROM jobs WHERE id = ? AND document IS NULL");
    bool appended = statement;
    for (size_t i = 0; appended && i < count; i++) {
        sqlite3_bind_int64(statement, 1, (sqlite3_int64)events[i].seq);
        qm_store_bind_text(statement, 2, events[i].name);
        qm_store_bind_text(statement, 3, events[i].members);
        qm_store_bind_text(statement, 4, events[i].job);
        appended = qm_store_run(store, statement);
    }
    return appended;
}

qm_status qm_store_append_events(qm_store *store, const qm_store_event *events, size_t count)
{
    if (!qm_store_begin_transaction(store)) return QM_E_ARGUMENT;
    return qm_store_end_transaction(store, append(store, events, count)) ? QM_OK : QM_E_ARGUMENT;
}

/** In a transaction. */
static bool finish(qm_store *store, const qm_store_job *end, const char *revisions)
{
    sqlite3_stmt *statement = qm_store_prepare(
        store, "UPDATE jobs SET state = ?, document = ?, result = ?, revisions = ? WHERE id = ?");
    if (!statement) return false;
    sqlite3_bind_int(statement, 1, (int)end->state);
    qm_store_bind_text(statement, 2, end->document);
    qm_store_bind_text(statement, 3, end->result);
    qm_store_bind_text(statement, 4, revisions);
    qm_store_bind_text(statement, 5, end->id);
    return qm_store_run(store, statement);
}

qm_status qm_store_finish_job(qm_store *store, const qm_store_job *end, const char *revisions,
                              const qm_store_event *events, size_t count, const qm_store_effect *effect)
{
    QM_ASSERT(end->state > QM_JOB_RUNNING && end->document);
    if (!qm_store_begin_transaction(store)) return QM_E_ARGUMENT;
    qm_status status = effect ? qm_store_apply_effect(store, effect) : QM_OK;
    bool good = status == QM_OK && append(store, events, count) && finish(store, end, revisions);
    return qm_store_end_transaction(store, good) || status != QM_OK ? status : QM_E_ARGUMENT;
}

qm_status qm_store_read_events(qm_store *store, const char *id, qm_store_event_fn *take, void *user)
{
    sqlite3_stmt *statement =
        qm_store_begin(store, "SELECT e.seq, e.name, e.members FROM jobs j JOIN job_events e"
                              " ON e.job = j.sequence WHERE j.id = ? ORDER BY e.seq");
    if (!statement) return QM_E_NO_MEMORY;
    qm_store_bind_text(statement, 1, id);
    int result = SQLITE_DONE;
    bool taken = true;
    while (taken && (result = sqlite3_step(statement)) == SQLITE_ROW) {
        const qm_store_event event = {id, (uint64_t)sqlite3_column_int64(statement, 0),
                                      (const char *)sqlite3_column_text(statement, 1),
                                      (const char *)sqlite3_column_text(statement, 2)};
        taken = event.name && event.members && take(user, &event);
    }
    bool failed = taken && result != SQLITE_DONE;
    if (failed) qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->database));
    qm_store_end(store, statement);
    return !taken ? QM_E_NO_MEMORY : failed ? QM_E_ARGUMENT : QM_OK;
}

static bool read_row(sqlite3_stmt *statement, void *row)
{
    qm_store_job *out = row;
    *out = (qm_store_job){.state = (qm_job_state)sqlite3_column_int(statement, 5),
                          .sequence = sqlite3_column_int64(statement, 6),
                          .restarts = sqlite3_column_int64(statement, 8),
                          .begun = sqlite3_column_int64(statement, 10)};
    if (qm_store_read_text(statement, 0, out->id, sizeof out->id) &&
        qm_store_copy_text(statement, 1, &out->key) &&
        qm_store_copy_text(statement, 2, &out->idempotency_key) &&
        qm_store_copy_text(statement, 3, &out->body) && qm_store_copy_text(statement, 4, &out->created) &&
        qm_store_copy_text(statement, 7, &out->document) && qm_store_copy_text(statement, 9, &out->result))
        return true;
    qm_store_job_reset(out);
    return false;
}

static void reset_row(void *row)
{
    qm_store_job_reset(row);
}

static const qm_store_table table = {sizeof(qm_store_job), read_row, reset_row};

qm_status qm_store_find_job(qm_store *store, const char *id, qm_store_job *out)
{
    return qm_store_find_row_by(store, "SELECT " COLUMNS " FROM jobs WHERE id = ?", id, &table, out);
}

qm_status qm_store_find_job_by_key(qm_store *store, const char *key, const char *revisions,
                                   qm_job_state state, qm_store_job *out)
{
    sqlite3_stmt *statement =
        qm_store_begin(store, "SELECT " COLUMNS " FROM jobs WHERE key = ? AND revisions = ?"
                              " AND state = ? ORDER BY sequence DESC LIMIT 1");
    if (!statement) return QM_E_NO_MEMORY;
    qm_store_bind_text(statement, 1, key);
    qm_store_bind_text(statement, 2, revisions);
    sqlite3_bind_int(statement, 3, (int)state);
    return qm_store_find_row(store, statement, &table, out);
}

qm_status qm_store_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out)
{
    return qm_store_find_row_by(store, "SELECT " COLUMNS " FROM jobs WHERE idempotency_key = ?", key, &table,
                                out);
}

qm_status qm_store_list_jobs(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                             qm_store_job *out, size_t *count)
{
    static const char *const states[] = {"0", "0", "2", "3", "4"}; /* one that runs is stored as queued */
    qm_store_listing listing = {"SELECT " COLUMNS " FROM jobs",
                                "sequence",
                                {"type = ?", "state = ?", NULL},
                                {filter->type, filter->state ? states[*filter->state] : NULL, NULL}};
    if (filter->subject) { /* in the order of its index */
        listing.select = "SELECT " COLUMNS " FROM job_subjects CROSS JOIN jobs ON sequence = job";
        listing.sequence = "job";
        listing.conditions[2] = "subject = ?";
        listing.values[2] = filter->subject;
    }
    return qm_store_list_rows(store, &listing, page, &table, out, count);
}

qm_status qm_store_claim_jobs(qm_store *store)
{
    sqlite3_stmt *statement =
        qm_store_begin(store, "UPDATE jobs SET restarts = restarts + 1 WHERE document IS NULL");
    return statement ? qm_store_execute(store, statement) : QM_E_ARGUMENT;
}

qm_status qm_store_begin_job(qm_store *store, const char *id)
{
    sqlite3_stmt *statement = qm_store_begin(store, "UPDATE jobs SET begun = begun + 1 WHERE id = ?");
    if (!statement) return QM_E_ARGUMENT;
    qm_store_bind_text(statement, 1, id);
    return qm_store_execute(store, statement);
}

qm_status qm_store_leave_jobs(qm_store *store)
{
    sqlite3_stmt *statement = qm_store_begin(store, "UPDATE jobs SET begun = -1 WHERE document IS NULL");
    return statement ? qm_store_execute(store, statement) : QM_E_ARGUMENT;
}

qm_status qm_store_forget_answer(qm_store *store, const char *id)
{
    sqlite3_stmt *statement =
        qm_store_begin(store, "UPDATE jobs SET revisions = '' WHERE id = ? AND document IS NOT NULL");
    if (!statement) return QM_E_ARGUMENT;
    qm_store_bind_text(statement, 1, id);
    return qm_store_execute(store, statement);
}

/* ---- arrays ---- */

bool qm_store_put_array_locked(qm_store *store, const char *job_id, const qm_store_array *array)
{
    sqlite3_stmt *statement = qm_store_prepare(store, "INSERT OR REPLACE INTO job_arrays (job, count, sums)"
                                                      " SELECT sequence, ?, ? FROM jobs WHERE id = ?");
    if (!statement) return false;
    sqlite3_bind_int64(statement, 1, (sqlite3_int64)array->count);
    sqlite3_bind_blob64(statement, 2, array->sums, qm_store_array_blocks(array->count) * sizeof *array->sums,
                        SQLITE_STATIC);
    qm_store_bind_text(statement, 3, job_id);
    return qm_store_run(store, statement);
}

qm_status qm_store_put_array(qm_store *store, const char *job_id, const qm_store_array *array)
{
    if (!qm_store_begin_transaction(store)) return QM_E_ARGUMENT;
    bool good = qm_store_put_array_locked(store, job_id, array);
    return qm_store_end_transaction(store, good) ? QM_OK : QM_E_ARGUMENT;
}

static bool read_array(sqlite3_stmt *statement, void *row)
{
    qm_store_array *out = row;
    *out = (qm_store_array){.count = (uint64_t)sqlite3_column_int64(statement, 0)};
    size_t size = (size_t)sqlite3_column_bytes(statement, 1);
    const void *sums = sqlite3_column_blob(statement, 1);
    if (out->count > INT64_MAX / sizeof(double) ||
        size != qm_store_array_blocks(out->count) * sizeof *out->sums)
        return true; /* without sums */
    out->sums = malloc(size + 1);
    if (out->sums && size > 0) memcpy(out->sums, sums, size);
    return out->sums;
}

qm_status qm_store_find_array(qm_store *store, const char *job_id, qm_store_array *out)
{
    static const qm_store_table array_table = {sizeof(qm_store_array), read_array, NULL};
    qm_status status =
        qm_store_find_row_by(store,
                             "SELECT a.count, a.sums FROM jobs j JOIN job_arrays a ON a.job = j.sequence"
                             " WHERE j.id = ?",
                             job_id, &array_table, out);
    return status == QM_OK && !out->sums ? QM_E_FORMAT : status;
}

bool qm_store_has_job(qm_store *store, const char *id)
{
    sqlite3_stmt *statement = qm_store_begin(store, "SELECT 1 FROM jobs WHERE id = ?");
    if (!statement) return true;
    qm_store_bind_text(statement, 1, id);
    bool found = sqlite3_step(statement) != SQLITE_DONE;
    qm_store_end(store, statement);
    return found;
}

size_t qm_store_drop_old_jobs(qm_store *store, size_t kept, const char *before, size_t limit,
                              char (*ids)[QM_ID_SIZE])
{
    sqlite3_stmt *statement = qm_store_begin(
        store,
        "DELETE FROM jobs WHERE id IN (SELECT id FROM jobs WHERE document IS NOT NULL AND"
        " (created < ?1 OR sequence <= (SELECT sequence FROM jobs ORDER BY sequence DESC LIMIT 1 OFFSET ?2))"
        " ORDER BY sequence LIMIT ?3) RETURNING id");
    if (!statement) return 0;
    qm_store_bind_text(statement, 1, before);
    sqlite3_bind_int64(statement, 2, (sqlite3_int64)kept);
    sqlite3_bind_int64(statement, 3, (sqlite3_int64)limit);
    size_t count = 0;
    while (count < limit && qm_store_step(store, statement) &&
           qm_store_read_text(statement, 0, ids[count], QM_ID_SIZE))
        count++;
    qm_store_end(store, statement);
    return count;
}

qm_status qm_store_delete_job(qm_store *store, const char *id)
{
    return qm_store_delete_row(store, "DELETE FROM jobs WHERE id = ?", id);
}

void qm_store_job_reset(qm_store_job *job)
{
    free(job->key);
    free(job->idempotency_key);
    free(job->body);
    free(job->created);
    free(job->document);
    free(job->result);
    *job = (qm_store_job){0};
}
