/**
 * store_sqlite_jobs.c: rows of jobs and of their events.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "store_sqlite.h"

static const char has_job[] = "SELECT 1 FROM jobs WHERE id = ?";

bool qm_sqlite_add_subjects(qm_store *store, const char *job_id, const char *subjects)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(store, "INSERT OR IGNORE INTO job_subjects (job, subject)"
                                                       " SELECT sequence, ? FROM jobs WHERE id = ?");
    bool added = statement;
    char subject[QM_ID_SIZE];
    while (added && qm_store_next_subject(&subjects, subject)) {
        qm_sqlite_bind_text(statement, 1, subject);
        qm_sqlite_bind_text(statement, 2, job_id);
        added = qm_sqlite_run(store, statement);
    }
    return added;
}

/** In a transaction. */
static qm_stored submit(qm_store *store, const qm_store_job *job)
{
    sqlite3_stmt *row = qm_sqlite_prepare(
        store, "INSERT INTO jobs (id, key, idempotency_key, body, created, state, revisions, type, labels)"
               " VALUES (?, ?, ?, ?, ?, ?, '', ?, ?) ON CONFLICT DO NOTHING");
    if (!row) return QM_STORED_FAULT;
    qm_sqlite_bind_text(row, 1, job->id);
    qm_sqlite_bind_text(row, 2, job->key);
    qm_sqlite_bind_text(row, 3, job->idempotency_key);
    qm_sqlite_bind_text(row, 4, job->body);
    qm_sqlite_bind_text(row, 5, job->created);
    sqlite3_bind_int(row, 6, (int)job->state);
    qm_sqlite_bind_text(row, 7, job->type ? job->type : "");
    qm_sqlite_bind_text(row, 8, job->labels ? job->labels : "");
    if (!qm_sqlite_run(store, row)) return QM_STORED_FAULT;
    if (!qm_sqlite_has_changed(store))
        return qm_sqlite_has_row(store, has_job, job->id) ? QM_STORED : QM_STORED_TAKEN;
    return qm_sqlite_add_subjects(store, job->id, job->subjects) ? QM_STORED : QM_STORED_FAULT;
}

qm_stored qm_sqlite_submit_job(qm_store *store, const qm_store_submission *submission)
{
    if (!qm_space_has_room(store)) return QM_STORED_FULL;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, submit(store, submission->job));
}

/** In a transaction. */
static bool append(qm_store *store, const qm_store_event *events, size_t count)
{
    sqlite3_stmt *statement =
        qm_sqlite_prepare(store, "INSERT OR REPLACE INTO job_events (job, seq, name, members)"
                                 " SELECT sequence, ?, ?, ? FROM jobs WHERE id = ? AND document IS NULL");
    bool appended = statement;
    for (size_t i = 0; appended && i < count; i++) {
        sqlite3_bind_int64(statement, 1, (sqlite3_int64)events[i].seq);
        qm_sqlite_bind_text(statement, 2, events[i].name);
        qm_sqlite_bind_text(statement, 3, events[i].members);
        qm_sqlite_bind_text(statement, 4, events[i].job);
        appended = qm_sqlite_run(store, statement);
    }
    return appended;
}

qm_stored qm_sqlite_append_events(qm_store *store, qm_store_run *runs, size_t run_count,
                                  const qm_store_event *events, size_t count)
{
    for (size_t i = 0; i < run_count; i++) /* one process has all jobs, and knows of each in memory */
        runs[i].is_lost = runs[i].is_canceled = runs[i].is_watched = false;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, append(store, events, count) ? QM_STORED : QM_STORED_FAULT);
}

/** In a transaction. *is_repeated: this call was made before. */
static qm_stored finish(qm_store *store, const qm_store_job *end, const char *revisions, bool *is_repeated)
{
    static const char find[] = "SELECT 1 FROM jobs WHERE id = ?1 AND state = ?2 AND restarts = ?3"
                               " AND document IS NOT NULL";
    sqlite3_stmt *statement =
        qm_sqlite_prepare(store, "UPDATE jobs SET state = ?, document = ?, result = ?, revisions = ?"
                                 " WHERE id = ? AND restarts = ? AND document IS NULL");
    sqlite3_stmt *ended = qm_sqlite_prepare(store, find);
    sqlite3_stmt *search = qm_sqlite_prepare(store, "DELETE FROM job_bounds"
                                                    " WHERE job = (SELECT sequence FROM jobs WHERE id = ?)");
    if (!statement || !ended || !search) return QM_STORED_FAULT;
    sqlite3_bind_int(statement, 1, (int)end->state);
    qm_sqlite_bind_text(statement, 2, end->document);
    qm_sqlite_bind_text(statement, 3, end->result);
    qm_sqlite_bind_text(statement, 4, revisions);
    qm_sqlite_bind_text(statement, 5, end->id);
    sqlite3_bind_int64(statement, 6, end->restarts);
    if (!qm_sqlite_run(store, statement)) return QM_STORED_FAULT;
    *is_repeated = false;
    if (qm_sqlite_has_changed(store)) {
        qm_sqlite_bind_text(search, 1, end->id);
        return qm_sqlite_run(store, search) ? QM_STORED : QM_STORED_FAULT;
    }
    sqlite3_bind_int(ended, 2, (int)end->state);
    sqlite3_bind_int64(ended, 3, end->restarts);
    *is_repeated = qm_sqlite_has_row(store, find, end->id);
    return *is_repeated ? QM_STORED : QM_STORED_LOST;
}

qm_stored qm_sqlite_finish_job(qm_store *store, const qm_store_job *end, const char *revisions,
                               const qm_store_event *events, size_t count, const qm_store_effect *effect)
{
    bool is_repeated = false;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    qm_stored stored =
        append(store, events, count) ? finish(store, end, revisions, &is_repeated) : QM_STORED_FAULT;
    if (stored == QM_STORED && effect && !is_repeated) stored = qm_sqlite_apply_effect(store, effect);
    return qm_sqlite_end_transaction(store, stored);
}

qm_stored qm_sqlite_read_events(qm_store *store, const char *id, uint64_t after, qm_store_event_fn *take,
                                void *user)
{
    sqlite3_stmt *statement =
        qm_sqlite_begin(store, "SELECT e.seq, e.name, e.members FROM jobs j JOIN job_events e"
                               " ON e.job = j.sequence WHERE j.id = ? AND e.seq > ? ORDER BY e.seq");
    if (!statement) return QM_STORED_NO_MEMORY;
    qm_sqlite_bind_text(statement, 1, id);
    sqlite3_bind_int64(statement, 2, (sqlite3_int64)after);
    int result = SQLITE_DONE;
    bool taken = true;
    while (taken && (result = sqlite3_step(statement)) == SQLITE_ROW) {
        const qm_store_event event = {id, (uint64_t)sqlite3_column_int64(statement, 0),
                                      (const char *)sqlite3_column_text(statement, 1),
                                      (const char *)sqlite3_column_text(statement, 2)};
        taken = event.name && event.members && take(user, &event);
    }
    bool failed = taken && result != SQLITE_DONE;
    if (failed) qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->sqlite->database));
    qm_sqlite_end(store, statement);
    return !taken ? QM_STORED_NO_MEMORY : failed ? QM_STORED_FAULT : QM_STORED;
}

bool qm_sqlite_read_job(sqlite3_stmt *statement, void *row)
{
    qm_store_job *out = row;
    *out = (qm_store_job){
        .state = (qm_job_state)sqlite3_column_int(statement, 5),
        .sequence = sqlite3_column_int64(statement, 6),
        .restarts = sqlite3_column_int64(statement, 8),
        .deaths = sqlite3_column_int64(statement, 8) > 0 ? 1 + sqlite3_column_int64(statement, 10) : 0,
        .is_canceled = sqlite3_column_int(statement, 11) != 0};
    if (qm_sqlite_read_text(statement, 0, out->id, sizeof out->id) &&
        qm_sqlite_copy_text(statement, 1, &out->key) &&
        qm_sqlite_copy_text(statement, 2, &out->idempotency_key) &&
        qm_sqlite_copy_text(statement, 3, &out->body) && qm_sqlite_copy_text(statement, 4, &out->created) &&
        qm_sqlite_copy_text(statement, 7, &out->document) &&
        qm_sqlite_copy_text(statement, 9, &out->result) && qm_sqlite_copy_text(statement, 12, &out->labels))
        return true;
    qm_store_job_reset(out);
    return false;
}

static void reset_row(void *row)
{
    qm_store_job_reset(row);
}

static const qm_sqlite_table table = {sizeof(qm_store_job), qm_sqlite_read_job, reset_row};

qm_stored qm_sqlite_find_job(qm_store *store, const char *id, qm_store_job *out)
{
    return qm_sqlite_find_row_by(store, "SELECT " QM_SQLITE_JOB_COLUMNS " FROM jobs WHERE id = ?", id, &table,
                                 out);
}

qm_stored qm_sqlite_find_job_by_key(qm_store *store, const char *key, const char *revisions,
                                    qm_job_state state, qm_store_job *out)
{
    sqlite3_stmt *statement =
        qm_sqlite_begin(store, "SELECT " QM_SQLITE_JOB_COLUMNS " FROM jobs WHERE key = ? AND revisions = ?"
                               " AND state = ? ORDER BY sequence DESC LIMIT 1");
    if (!statement) return QM_STORED_NO_MEMORY;
    qm_sqlite_bind_text(statement, 1, key);
    qm_sqlite_bind_text(statement, 2, revisions);
    sqlite3_bind_int(statement, 3, (int)state);
    return qm_sqlite_find_row(store, statement, &table, out);
}

qm_stored qm_sqlite_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out)
{
    return qm_sqlite_find_row_by(
        store, "SELECT " QM_SQLITE_JOB_COLUMNS " FROM jobs WHERE idempotency_key = ?", key, &table, out);
}

qm_stored qm_sqlite_list_jobs(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                              qm_store_job *out, size_t *count)
{
    static const char *const states[] = {"0", "0", "2", "3", "4"}; /* one that runs is stored as queued */
    qm_sqlite_listing listing = {
        "SELECT " QM_SQLITE_JOB_COLUMNS " FROM jobs",
        "sequence",
        {"type = ?", "state = ?", NULL, "instr(labels, char(10) || ? || char(10)) > 0"},
        {filter->type, filter->state ? states[*filter->state] : NULL, NULL, filter->label}};
    if (filter->subject) { /* in the order of its index */
        listing.select =
            "SELECT " QM_SQLITE_JOB_COLUMNS " FROM job_subjects CROSS JOIN jobs ON sequence = job";
        listing.sequence = "job";
        listing.conditions[2] = "subject = ?";
        listing.values[2] = filter->subject;
    }
    return qm_sqlite_list_rows(store, &listing, page, &table, out, count);
}

/** Counts one more claim of the unfinished jobs, all of an earlier process, and notes the last one of them. */
static qm_stored take_over(qm_store *store)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    sqlite3_stmt *last = qm_sqlite_prepare(store, "SELECT coalesce(max(sequence), 0) FROM jobs");
    bool good = last && qm_sqlite_step(store, last);
    if (good) store->sqlite->last = sqlite3_column_int64(last, 0);
    if (last) sqlite3_reset(last);
    good = good && qm_sqlite_run(store, qm_sqlite_prepare(store, "UPDATE jobs SET restarts = restarts + 1"
                                                                 " WHERE document IS NULL"));
    return qm_sqlite_end_transaction(store, good ? QM_STORED : QM_STORED_FAULT);
}

qm_stored qm_sqlite_claim_jobs(qm_store *store, const qm_store_wish *wish, qm_store_job *out, size_t *count)
{
    struct qm_sqlite *sqlite = store->sqlite;
    const qm_job_state unfinished = QM_JOB_QUEUED;
    const qm_store_job_filter filter = {.state = &unfinished};
    const qm_store_page page = {.after = sqlite->next, .limit = wish->free + wish->extra};
    *count = 0;
    if (!sqlite->has_claimed) {
        qm_stored stored = take_over(store);
        if (stored != QM_STORED) return stored;
        sqlite->has_claimed = true;
    }
    if (sqlite->next >= sqlite->last) return QM_STORED;
    qm_stored stored = qm_sqlite_list_jobs(store, &page, &filter, out, count);
    while (*count > 0 && out[*count - 1].sequence > sqlite->last)
        qm_store_job_reset(&out[--*count]);
    if (stored == QM_STORED) sqlite->next = *count > 0 ? out[*count - 1].sequence : sqlite->last;
    return stored;
}

/** Runs a statement whose one parameter is the id of a job. */
static qm_stored update_job(qm_store *store, const char *sql, const char *id)
{
    sqlite3_stmt *statement = qm_sqlite_begin(store, sql);
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, id);
    return qm_sqlite_execute(store, statement);
}

qm_stored qm_sqlite_begin_job(qm_store *store, const char *id)
{
    return update_job(store, "UPDATE jobs SET begun = begun + 1 WHERE id = ?", id);
}

qm_stored qm_sqlite_note_cancel(qm_store *store, const char *id)
{
    return update_job(store, "UPDATE jobs SET cancel = 1 WHERE id = ? AND document IS NULL", id);
}

qm_stored qm_sqlite_leave_jobs(qm_store *store)
{
    sqlite3_stmt *statement = qm_sqlite_begin(store, "UPDATE jobs SET begun = -1 WHERE document IS NULL");
    return statement ? qm_sqlite_execute(store, statement) : QM_STORED_FAULT;
}

qm_stored qm_sqlite_set_job_labels(qm_store *store, const char *id, const char *labels)
{
    sqlite3_stmt *statement = qm_sqlite_begin(store, "UPDATE jobs SET labels = ? WHERE id = ? RETURNING 1");
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, labels);
    qm_sqlite_bind_text(statement, 2, id);
    return qm_sqlite_change_row(store, statement);
}

qm_stored qm_sqlite_forget_answer(qm_store *store, const char *id)
{
    return update_job(store, "UPDATE jobs SET revisions = '' WHERE id = ? AND document IS NOT NULL", id);
}

/* ---- arrays ---- */

bool qm_sqlite_add_array(qm_store *store, const char *job_id, const qm_store_array *array)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(store, "INSERT OR REPLACE INTO job_arrays (job, count, sums)"
                                                       " SELECT sequence, ?, ? FROM jobs WHERE id = ?");
    if (!statement) return false;
    sqlite3_bind_int64(statement, 1, (sqlite3_int64)array->count);
    sqlite3_bind_blob64(statement, 2, array->sums, qm_store_array_blocks(array->count) * sizeof *array->sums,
                        SQLITE_STATIC);
    qm_sqlite_bind_text(statement, 3, job_id);
    return qm_sqlite_run(store, statement);
}

qm_stored qm_sqlite_put_array(qm_store *store, const char *job_id, const qm_store_array *array)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store,
                                     qm_sqlite_add_array(store, job_id, array) ? QM_STORED : QM_STORED_FAULT);
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

qm_stored qm_sqlite_find_array(qm_store *store, const char *job_id, qm_store_array *out)
{
    static const qm_sqlite_table array_table = {sizeof(qm_store_array), read_array, NULL};
    qm_stored stored =
        qm_sqlite_find_row_by(store,
                              "SELECT a.count, a.sums FROM jobs j JOIN job_arrays a ON a.job = j.sequence"
                              " WHERE j.id = ?",
                              job_id, &array_table, out);
    return stored == QM_STORED && !out->sums ? QM_STORED_DAMAGED : stored;
}

bool qm_sqlite_has_job(qm_store *store, const char *id)
{
    sqlite3_stmt *statement = qm_sqlite_begin(store, has_job);
    if (!statement) return true;
    qm_sqlite_bind_text(statement, 1, id);
    bool found = sqlite3_step(statement) != SQLITE_DONE;
    qm_sqlite_end(store, statement);
    return found;
}

qm_stored qm_sqlite_drop_old_jobs(qm_store *store, size_t kept, double kept_s, size_t limit,
                                  char (*ids)[QM_ID_SIZE], size_t *count)
{
    char before[QM_TIME_SIZE] = "";
    if (kept_s > 0.0) qm_clock_format_past(kept_s, before);
    sqlite3_stmt *statement = qm_sqlite_begin(
        store,
        "DELETE FROM jobs WHERE id IN (SELECT id FROM jobs WHERE document IS NOT NULL AND"
        " (created < ?1 OR sequence <= (SELECT sequence FROM jobs ORDER BY sequence DESC LIMIT 1 OFFSET ?2))"
        " ORDER BY sequence LIMIT ?3) RETURNING id");
    *count = 0;
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, before);
    sqlite3_bind_int64(statement, 2, (sqlite3_int64)kept);
    sqlite3_bind_int64(statement, 3, (sqlite3_int64)limit);
    while (*count < limit && qm_sqlite_step(store, statement) &&
           qm_sqlite_read_text(statement, 0, ids[*count], QM_ID_SIZE))
        ++*count;
    qm_sqlite_end(store, statement);
    return QM_STORED;
}

qm_stored qm_sqlite_delete_job(qm_store *store, const char *id)
{
    return qm_sqlite_delete_row(store, "DELETE FROM jobs WHERE id = ?", id);
}
