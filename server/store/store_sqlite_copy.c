/**
 * store_sqlite_copy.c: rows of an embedded store as copies: all that it has of them, read for another store and written
 * from one.
 */
#include <stdlib.h>
#include <string.h>

#include "store_sqlite.h"

/* ---- jobs ---- */

static bool read_job_copy(sqlite3_stmt *statement, void *row)
{
    qm_store_job_copy *out = row;
    *out = (qm_store_job_copy){.claims = sqlite3_column_int64(statement, 8) + 1};
    if (!qm_sqlite_read_job(statement, &out->job)) return false;
    /* What the next process counts when it takes the job over (qm_sqlite_read_job). */
    out->job.deaths = out->job.document ? 0 : 1 + sqlite3_column_int64(statement, 10);
    if (qm_sqlite_copy_text(statement, 13, &out->type) &&
        qm_sqlite_copy_text(statement, 14, &out->revisions) &&
        qm_sqlite_copy_text(statement, 15, &out->subjects))
        return true;
    qm_store_job_copy_reset(out);
    return false;
}

static void reset_job_copy(void *row)
{
    qm_store_job_copy_reset(row);
}

qm_stored qm_sqlite_list_job_copies(qm_store *store, const qm_store_page *page, qm_store_job_copy *out,
                                    size_t *count)
{
    static const qm_sqlite_table table = {sizeof(qm_store_job_copy), read_job_copy, reset_job_copy};
    const qm_sqlite_listing listing = {.select = "SELECT " QM_SQLITE_JOB_COLUMNS ", type, revisions,"
                                                 " (SELECT group_concat(subject, ' ') FROM job_subjects"
                                                 "   WHERE job = sequence) FROM jobs",
                                       .sequence = "sequence"};
    return qm_sqlite_list_rows(store, &listing, page, &table, out, count);
}

/* The functions up to the verb run in a transaction. */

static qm_stored add_job(qm_store *store, const qm_store_job_copy *copy)
{
    const qm_store_job *job = &copy->job;
    sqlite3_stmt *row = qm_sqlite_prepare(
        store, "INSERT INTO jobs (id, key, idempotency_key, body, created, document, result, state,"
               "  revisions, restarts, begun, type, cancel, labels) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
               "?, ?, ?)"
               " ON CONFLICT DO NOTHING");
    if (!row) return QM_STORED_FAULT;
    const char *const texts[] = {job->id,      job->key,      job->idempotency_key, job->body,
                                 job->created, job->document, job->result};
    for (int i = 0; i < 7; i++)
        qm_sqlite_bind_text(row, i + 1, texts[i]);
    sqlite3_bind_int(row, 8, job->document ? (int)job->state : (int)QM_JOB_QUEUED);
    qm_sqlite_bind_text(row, 9, copy->revisions);
    /* The process that takes the job over counts one more claim. */
    sqlite3_bind_int64(row, 10, copy->claims > 0 ? copy->claims - 1 : 0);
    sqlite3_bind_int64(row, 11, job->deaths - 1);
    qm_sqlite_bind_text(row, 12, copy->type);
    sqlite3_bind_int(row, 13, job->is_canceled && !job->document);
    qm_sqlite_bind_text(row, 14, job->labels ? job->labels : "");
    if (!qm_sqlite_run(store, row)) return QM_STORED_FAULT;
    if (qm_sqlite_has_changed(store)) return QM_STORED;
    return QM_STORED_TAKEN;
}

static bool add_events(qm_store *store, const char *id, const qm_store_event *events, size_t count)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(store, "INSERT INTO job_events (job, seq, name, members)"
                                                       " SELECT sequence, ?, ?, ? FROM jobs WHERE id = ?");
    bool added = statement;
    for (size_t i = 0; added && i < count; i++) {
        sqlite3_bind_int64(statement, 1, (sqlite3_int64)events[i].seq);
        qm_sqlite_bind_text(statement, 2, events[i].name);
        qm_sqlite_bind_text(statement, 3, events[i].members);
        qm_sqlite_bind_text(statement, 4, id);
        added = qm_sqlite_run(store, statement);
    }
    return added;
}

qm_stored qm_sqlite_put_job_copy(qm_store *store, const qm_store_job_copy *copy, const qm_store_event *events,
                                 size_t count, const qm_store_array *array)
{
    if (!qm_space_has_room(store)) return QM_STORED_FULL;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    qm_stored stored = QM_STORED;
    if (!qm_sqlite_has_row(store, "SELECT 1 FROM jobs WHERE id = ?", copy->job.id)) {
        stored = add_job(store, copy);
        bool added = stored == QM_STORED && qm_sqlite_add_subjects(store, copy->job.id, copy->subjects) &&
                     add_events(store, copy->job.id, events, count) &&
                     (!array || qm_sqlite_add_array(store, copy->job.id, array));
        if (stored == QM_STORED && !added) stored = QM_STORED_FAULT;
    }
    return qm_sqlite_end_transaction(store, stored);
}

/* ---- layouts ---- */

static void reset_layout(void *row)
{
    qm_store_layout_reset(row);
}

qm_stored qm_sqlite_list_layout_revisions(qm_store *store, const char *id, const qm_store_page *page,
                                          qm_store_layout *out, size_t *count)
{
    static const qm_sqlite_table table = {sizeof(qm_store_layout), qm_sqlite_read_layout, reset_layout};
    const qm_sqlite_listing listing = {"SELECT " QM_SQLITE_LAYOUT_COLUMNS
                                       " FROM layouts l JOIN layout_revisions r ON r.id = l.id",
                                       "r.revision",
                                       {"l.id = ?"},
                                       {id}};
    return qm_sqlite_list_rows(store, &listing, page, &table, out, count);
}

/** In a transaction. */
static qm_stored add_layout(qm_store *store, const qm_store_layout *revisions, size_t count, int64_t current,
                            const qm_store_idempotency *idempotency)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(
        store, "INSERT INTO layouts (id, mesh, created, revision, idempotency_key, request) "
               "VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING");
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, revisions->id);
    qm_sqlite_bind_text(statement, 2, revisions->mesh);
    qm_sqlite_bind_text(statement, 3, revisions->created);
    sqlite3_bind_int64(statement, 4, current);
    qm_sqlite_bind_text(statement, 5, idempotency->key);
    qm_sqlite_bind_text(statement, 6, idempotency->request);
    if (!qm_sqlite_run(store, statement)) return QM_STORED_FAULT;
    if (!qm_sqlite_has_changed(store)) return QM_STORED_TAKEN;
    for (size_t i = 0; i < count; i++)
        if (!qm_sqlite_add_revision(store, &revisions[i], revisions[i].revision)) return QM_STORED_FAULT;
    return QM_STORED;
}

qm_stored qm_sqlite_put_layout_copy(qm_store *store, const qm_store_layout *revisions, size_t count,
                                    int64_t current, const qm_store_idempotency *idempotency)
{
    if (!qm_space_has_room(store)) return QM_STORED_FULL;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    bool is_there = qm_sqlite_has_row(store, "SELECT 1 FROM layouts WHERE id = ?", revisions->id);
    return qm_sqlite_end_transaction(
        store, is_there ? QM_STORED : add_layout(store, revisions, count, current, idempotency));
}

/* ---- the rest ---- */

static bool read_origin(sqlite3_stmt *statement, void *row)
{
    qm_store_origin *out = row;
    return qm_sqlite_read_text(statement, 1, out->request, sizeof out->request) &&
           qm_sqlite_copy_text(statement, 0, &out->key);
}

static const qm_sqlite_table origins = {sizeof(qm_store_origin), read_origin, NULL};

qm_stored qm_sqlite_find_layout_origin(qm_store *store, const char *id, qm_store_origin *out)
{
    return qm_sqlite_find_row_by(store, "SELECT idempotency_key, request FROM layouts WHERE id = ?", id,
                                 &origins, out);
}

qm_stored qm_sqlite_find_reconstruction_origin(qm_store *store, const char *id, qm_store_origin *out)
{
    return qm_sqlite_find_row_by(store, "SELECT idempotency_key, request FROM reconstructions WHERE id = ?",
                                 id, &origins, out);
}

qm_stored qm_sqlite_sync(qm_store *store)
{
    (void)store; /* each commit is durable, or the whole folder by its owner (QM_STORE_FILL) */
    return QM_STORED;
}
