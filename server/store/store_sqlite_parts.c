/**
 * store_sqlite_parts.c: rows of searches in parts. One process has the database and runs a job once at a time, so every
 * part is free to be claimed; the epoch tells its earlier claims apart.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "store_sqlite.h"

/** Binds a number that may be infinite, which SQLite keeps. */
static void bind_bounds(sqlite3_stmt *statement, int index, const qm_store_bounds *bounds)
{
    sqlite3_bind_double(statement, index, bounds->discarded);
    sqlite3_bind_double(statement, index + 1, bounds->lower);
    qm_sqlite_bind_text(statement, index + 2, bounds->witness);
    sqlite3_bind_int64(statement, index + 3, (sqlite3_int64)bounds->iterations);
    sqlite3_bind_int64(statement, index + 4, (sqlite3_int64)bounds->projections);
}

/** In a transaction: adds parts to the bounds of a job. */
static bool add_parts(qm_store *store, const char *job, const qm_store_part *parts, size_t count)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(store, "INSERT INTO job_parts (job, upper, entries)"
                                                       " SELECT sequence, ?, ? FROM jobs WHERE id = ?");
    bool added = statement;
    for (size_t i = 0; added && i < count; i++) {
        sqlite3_bind_double(statement, 1, parts[i].upper);
        added = parts[i].size <= INT32_MAX &&
                sqlite3_bind_blob(statement, 2, parts[i].entries, (int)parts[i].size, NULL) == SQLITE_OK;
        qm_sqlite_bind_text(statement, 3, job);
        added = added && qm_sqlite_run(store, statement);
    }
    return added;
}

/** In a transaction. */
static qm_stored open_parts(qm_store *store, const char *job, int64_t restarts, const qm_store_bounds *bounds,
                            const qm_store_part *parts, size_t count)
{
    static const char find_job[] = "SELECT 1 FROM jobs WHERE id = ?1 AND restarts = ?2 AND document IS NULL";
    static const char find_bounds[] = "SELECT 1 FROM job_bounds b JOIN jobs j ON j.sequence = b.job"
                                      " WHERE j.id = ?1 AND b.engine = ?2";
    sqlite3_stmt *run = qm_sqlite_prepare(store, find_job);
    sqlite3_stmt *same = qm_sqlite_prepare(store, find_bounds);
    sqlite3_stmt *old = qm_sqlite_prepare(store, "DELETE FROM job_bounds"
                                                 " WHERE job = (SELECT sequence FROM jobs WHERE id = ?)");
    sqlite3_stmt *made =
        qm_sqlite_prepare(store, "INSERT INTO job_bounds"
                                 " (job, discarded, lower, witness, iterations, projections, engine)"
                                 " SELECT sequence, ?, ?, ?, ?, ?, ? FROM jobs WHERE id = ?");
    if (!run || !same || !old || !made) return QM_STORED_FAULT;
    sqlite3_bind_int64(run, 2, restarts);
    if (!qm_sqlite_has_row(store, find_job, job)) return QM_STORED_LOST;
    qm_sqlite_bind_text(same, 2, bounds->engine);
    if (qm_sqlite_has_row(store, find_bounds, job)) return QM_STORED;
    qm_sqlite_bind_text(old, 1, job);
    bind_bounds(made, 1, bounds);
    qm_sqlite_bind_text(made, 6, bounds->engine);
    qm_sqlite_bind_text(made, 7, job);
    bool good =
        qm_sqlite_run(store, old) && qm_sqlite_run(store, made) && add_parts(store, job, parts, count);
    return good ? QM_STORED : QM_STORED_FAULT;
}

qm_stored qm_sqlite_open_parts(qm_store *store, const char *job, int64_t restarts,
                               const qm_store_bounds *bounds, const qm_store_part *parts, size_t count)
{
    if (!qm_space_has_room(store)) return QM_STORED_FULL;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, open_parts(store, job, restarts, bounds, parts, count));
}

static bool read_part(sqlite3_stmt *statement, qm_store_part *out)
{
    size_t size = (size_t)sqlite3_column_bytes(statement, 3);
    *out = (qm_store_part){.number = sqlite3_column_int64(statement, 0),
                           .epoch = sqlite3_column_int64(statement, 1) + 1,
                           .upper = sqlite3_column_double(statement, 2),
                           .entries = malloc(size > 0 ? size : 1),
                           .size = size};
    if (out->entries && size > 0) memcpy(out->entries, sqlite3_column_blob(statement, 3), size);
    return out->entries;
}

/** In a transaction. */
static qm_stored claim(qm_store *store, const char *job, size_t limit, qm_store_part *out, size_t *count)
{
    sqlite3_stmt *top = qm_sqlite_prepare(
        store, "SELECT p.part, p.epoch, p.upper, p.entries FROM jobs j JOIN job_parts p"
               " ON p.job = j.sequence WHERE j.id = ? ORDER BY p.upper DESC, p.part LIMIT ?");
    sqlite3_stmt *taken = qm_sqlite_prepare(store, "UPDATE job_parts SET epoch = ? WHERE part = ?");
    if (!top || !taken) return QM_STORED_FAULT;
    qm_sqlite_bind_text(top, 1, job);
    sqlite3_bind_int64(top, 2, (sqlite3_int64)limit);
    bool good = true;
    while (good && qm_sqlite_step(store, top)) {
        good = read_part(top, &out[*count]);
        *count += good;
    }
    sqlite3_reset(top);
    for (size_t i = 0; good && i < *count; i++) {
        sqlite3_bind_int64(taken, 1, out[i].epoch);
        sqlite3_bind_int64(taken, 2, out[i].number);
        good = qm_sqlite_run(store, taken);
    }
    return good ? QM_STORED : QM_STORED_NO_MEMORY;
}

qm_stored qm_sqlite_claim_parts(qm_store *store, const char *job, size_t limit, qm_store_part *out,
                                size_t *count)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    qm_stored stored = qm_sqlite_end_transaction(store, claim(store, job, limit, out, count));
    if (stored == QM_STORED) return stored;
    qm_store_parts_reset(out, *count);
    *count = 0;
    return stored;
}

/** In a transaction: removes the parts at their epochs; false when one is not. */
static bool take_away(qm_store *store, const qm_store_part *parts, size_t count)
{
    sqlite3_stmt *gone = qm_sqlite_prepare(store, "DELETE FROM job_parts WHERE part = ? AND epoch = ?");
    bool good = gone;
    for (size_t i = 0; good && i < count; i++) {
        sqlite3_bind_int64(gone, 1, parts[i].number);
        sqlite3_bind_int64(gone, 2, parts[i].epoch);
        good = qm_sqlite_run(store, gone) && qm_sqlite_has_changed(store);
    }
    return good;
}

/** In a transaction. A job that gets on is not one that ends the process: its deaths count from here. */
static qm_stored finish(qm_store *store, const char *job, const qm_store_part *parts, size_t count,
                        const qm_store_bounds *found, const qm_store_part *rest, size_t rest_count)
{
    sqlite3_stmt *raised = qm_sqlite_prepare(
        store, "UPDATE job_bounds SET discarded = max(discarded, ?1), lower = max(lower, ?2),"
               " witness = CASE WHEN ?2 > lower THEN ?3 ELSE witness END,"
               " iterations = iterations + ?4, projections = projections + ?5"
               " WHERE job = (SELECT sequence FROM jobs WHERE id = ?6)");
    sqlite3_stmt *lives = qm_sqlite_prepare(store, "UPDATE jobs SET begun = 0 WHERE id = ? AND begun > 0");
    if (!raised || !lives) return QM_STORED_FAULT;
    if (!take_away(store, parts, count)) return QM_STORED_LOST;
    bind_bounds(raised, 1, found);
    qm_sqlite_bind_text(raised, 6, job);
    qm_sqlite_bind_text(lives, 1, job);
    bool good = qm_sqlite_run(store, raised) && qm_sqlite_has_changed(store) && qm_sqlite_run(store, lives) &&
                add_parts(store, job, rest, rest_count);
    return good ? QM_STORED : QM_STORED_FAULT;
}

qm_stored qm_sqlite_finish_parts(qm_store *store, const char *job, const qm_store_part *parts, size_t count,
                                 const qm_store_bounds *found, const qm_store_part *rest, size_t rest_count)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, finish(store, job, parts, count, found, rest, rest_count));
}

qm_stored qm_sqlite_raise_lower(qm_store *store, const char *job, double lower, const char *witness)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    sqlite3_stmt *raised = qm_sqlite_prepare(store, "UPDATE job_bounds SET lower = max(lower, ?1),"
                                                    " witness = CASE WHEN ?1 > lower THEN ?2 ELSE witness END"
                                                    " WHERE job = (SELECT sequence FROM jobs WHERE id = ?3)");
    if (raised) {
        sqlite3_bind_double(raised, 1, lower);
        qm_sqlite_bind_text(raised, 2, witness);
        qm_sqlite_bind_text(raised, 3, job);
    }
    qm_stored stored = !qm_sqlite_run(store, raised)   ? QM_STORED_FAULT
                       : !qm_sqlite_has_changed(store) ? QM_STORED_NONE
                                                       : QM_STORED;
    return qm_sqlite_end_transaction(store, stored);
}

/** In a transaction: the parts that are left. */
static bool sum_parts(qm_store *store, const char *job, const qm_store_part *claimed, size_t count,
                      qm_store_bounds *out)
{
    sqlite3_stmt *parts = qm_sqlite_prepare(store, "SELECT p.part, p.upper FROM jobs j JOIN job_parts p"
                                                   " ON p.job = j.sequence WHERE j.id = ?");
    if (!parts) return false;
    qm_sqlite_bind_text(parts, 1, job);
    while (qm_sqlite_step(store, parts)) {
        double upper = sqlite3_column_double(parts, 1);
        size_t i = 0;
        while (i < count && claimed[i].number != sqlite3_column_int64(parts, 0))
            i++;
        out->parts++;
        out->upper = fmax(out->upper, upper);
        if (i == count) out->others = fmax(out->others, upper);
    }
    sqlite3_reset(parts);
    return true;
}

/** In a transaction. */
static qm_stored read_bounds(qm_store *store, const char *job, const qm_store_part *claimed, size_t count,
                             qm_store_bounds *out)
{
    sqlite3_stmt *bounds = qm_sqlite_prepare(
        store, "SELECT b.engine, b.lower, b.witness, b.discarded, b.iterations, b.projections FROM jobs j"
               " JOIN job_bounds b ON b.job = j.sequence WHERE j.id = ?");
    if (!bounds) return QM_STORED_FAULT;
    qm_sqlite_bind_text(bounds, 1, job);
    bool is_there = qm_sqlite_step(store, bounds);
    bool good = is_there && qm_sqlite_read_text(bounds, 0, out->engine, sizeof out->engine) &&
                qm_sqlite_read_text(bounds, 2, out->witness, sizeof out->witness);
    if (good) {
        out->lower = sqlite3_column_double(bounds, 1);
        out->discarded = sqlite3_column_double(bounds, 3);
        out->iterations = (uint64_t)sqlite3_column_int64(bounds, 4);
        out->projections = (uint64_t)sqlite3_column_int64(bounds, 5);
    }
    sqlite3_reset(bounds);
    if (!is_there) return QM_STORED_NONE;
    out->nodes = 1;
    return good && sum_parts(store, job, claimed, count, out) ? QM_STORED : QM_STORED_FAULT;
}

qm_stored qm_sqlite_read_bounds(qm_store *store, const char *job, const qm_store_part *claimed, size_t count,
                                qm_store_bounds *out)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, read_bounds(store, job, claimed, count, out));
}
