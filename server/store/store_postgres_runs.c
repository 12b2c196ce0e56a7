/**
 * store_postgres_runs.c: the life of a job: submitted, claimed, run, and ended once.
 *
 * A job that has not ended has a row of job_queue, or one of job_runs, which names the node that runs it and its epoch,
 * the number of its claims. What a node writes for a job it writes while it locks that row, in the same statement: a
 * node that has lost the job writes nothing.
 */
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "store_postgres.h"

#define WATCHED_S "15" /* how long a job counts as read elsewhere after a look */
#define RENEWED_S "10" /* left of them, when a look writes them again */

#define RUNG 64   /* jobs whose events are told at once to those who wait for them */
#define PAGE 4096 /* events of a job that are read in one statement */
#define STRING(x) #x
#define PAGE_TEXT(x) STRING(x)

void qm_postgres_write_events(qm_postgres_events *arrays, const qm_store_event *events, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        qm_postgres_write_integer(&arrays->seqs, (int64_t)events[i].seq);
        qm_postgres_write_text(&arrays->names, events[i].name);
        qm_postgres_write_text(&arrays->members, events[i].members);
    }
}

void qm_postgres_add_events(qm_postgres_query *query, qm_postgres_events *arrays)
{
    qm_postgres_add_array(query, &arrays->seqs);
    qm_postgres_add_array(query, &arrays->names);
    qm_postgres_add_array(query, &arrays->members);
}

void qm_postgres_events_reset(qm_postgres_events *arrays)
{
    qm_text_reset(&arrays->seqs);
    qm_text_reset(&arrays->names);
    qm_text_reset(&arrays->members);
}

/** Of a statement that inserts events: the last one of a number counts. */
#define REPLACE " ON CONFLICT (sequence, seq) DO UPDATE SET name = EXCLUDED.name, members = EXCLUDED.members"

/* ---- submission ---- */

/** Why nothing was submitted: an equal call, another job of the key, or a limit. */
static qm_stored explain_submission(qm_store *store, const qm_store_submission *submission)
{
    qm_postgres_query query = {.sql =
                                   "SELECT id = $1 FROM quadmeshd.jobs WHERE id = $1 OR idempotency_key = $2"
                                   " ORDER BY 1 DESC"};
    qm_postgres_add_text(&query, submission->job->id);
    qm_postgres_add_text(&query, submission->job->idempotency_key);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED && rows.count == 0)
        status = submission->is_claimed ? QM_STORED_LOST : QM_STORED_FULL;
    else if (status == QM_STORED)
        status = qm_postgres_confirm(store, qm_postgres_bool(&rows, 0, 0) ? QM_STORED : QM_STORED_TAKEN);
    qm_postgres_free(&rows);
    return status;
}

static qm_stored submit(qm_store *store, const qm_store_submission *submission)
{
    const qm_store_job *job = submission->job;
    qm_postgres_query query = {
        .sql = "WITH me AS (SELECT id FROM quadmeshd.nodes WHERE $10::bool AND id = $7::text AND state = 0 "
               "FOR SHARE),"
               " room AS (SELECT WHERE CASE WHEN $10::bool THEN EXISTS (SELECT FROM me) ELSE $9::bigint >"
               "   (SELECT count(*) FROM (SELECT FROM quadmeshd.job_queue LIMIT $9::bigint) waiting) END),"
               " made AS (INSERT INTO quadmeshd.jobs (id, key, idempotency_key, body, created, type, owners, "
               "kept, labels)"
               "   SELECT $1::text, $2::text, $3::text, $4::text, $5::text, $6::text,"
               "     CASE WHEN $11::bool THEN 0 ELSE 1 END, $11::bool, $13::text FROM room"
               "   ON CONFLICT DO NOTHING RETURNING sequence),"
               " queued AS (INSERT INTO quadmeshd.job_queue (sequence, home)"
               "   SELECT sequence, $8::text FROM made WHERE NOT $10::bool),"
               " run AS (INSERT INTO quadmeshd.job_runs (sequence, node, epoch, deaths)"
               "   SELECT sequence, $7::text, 1, 0 FROM made WHERE $10::bool),"
               " subjects AS (INSERT INTO quadmeshd.job_subjects (sequence, subject)"
               "   SELECT DISTINCT sequence, subject FROM made, unnest($12::text[]) AS s(subject))"
               " SELECT sequence FROM made"};
    char node[QM_NODE_NAME_SIZE + 16];
    qm_text subjects = {0};
    qm_postgres_name_node(store, node);
    qm_postgres_write_subjects(&subjects, job->subjects);
    qm_postgres_add_text(&query, job->id);
    qm_postgres_add_text(&query, job->key);
    qm_postgres_add_text(&query, job->idempotency_key);
    qm_postgres_add_text(&query, job->body);
    qm_postgres_add_text(&query, job->created);
    qm_postgres_add_text(&query, job->type ? job->type : "");
    qm_postgres_add_text(&query, node);
    qm_postgres_add_text(&query, submission->home ? submission->home : "");
    qm_postgres_add_integer(&query, submission->limit > INT32_MAX ? INT32_MAX : (int64_t)submission->limit);
    qm_postgres_add_bool(&query, submission->is_claimed);
    qm_postgres_add_bool(&query, submission->is_kept);
    qm_postgres_add_array(&query, &subjects);
    qm_postgres_add_text(&query, job->labels ? job->labels : "");
    qm_stored status = qm_postgres_change_row(store, &query);
    qm_text_reset(&subjects);
    return status == QM_STORED_NONE ? explain_submission(store, submission) : status;
}

qm_stored qm_postgres_submit_job(qm_store *store, const qm_store_submission *submission)
{
    const char *id = submission->job->id;
    if (!submission->is_claimed) {
        const char *home = submission->home ? submission->home : "";
        qm_stored queued = submit(store, submission);
        bool rings = queued == QM_STORED && strcmp(home, store->postgres->self.name) != 0;
        if (rings) qm_postgres_ring(store, QM_STORE_NEWS_QUEUED, &home, 1, QM_POSTGRES_REQUESTS);
        return queued;
    }
    /* Before it is sent: a claim that runs meanwhile must not find it. When the answer is lost, one may. */
    if (!qm_postgres_add_claim(store, id)) return QM_STORED_NO_MEMORY;
    qm_stored status = submit(store, submission);
    if (status != QM_STORED) qm_postgres_remove_claim(store, id);
    return status;
}

/* ---- claims ---- */

qm_stored qm_postgres_claim_jobs(qm_store *store, const qm_store_wish *wish, qm_store_job *out, size_t *count)
{
    /* The node's row is locked when there is something to claim, so that a look at an empty queue writes nothing; the
     * lock meets the update of the reaper. */
    qm_postgres_query query = {
        .sql =
            "WITH unheard AS (SELECT r.sequence, r.epoch, r.deaths, r.progress, true FROM quadmeshd.job_runs "
            "r"
            "   JOIN quadmeshd.jobs j USING (sequence) WHERE r.node = $1 AND j.id <> ALL ($6::text[])"
            "   ORDER BY r.sequence LIMIT $3::bigint + $4::bigint),"
            " near AS (SELECT q.sequence FROM quadmeshd.job_queue q WHERE q.home IN ($2, '')"
            "     OR q.since < clock_timestamp() - " QM_POSTGRES_SECONDS(
                "$5") "   ORDER BY q.home = $2 DESC, q.sequence"
                      "   LIMIT greatest($3::bigint - (SELECT count(*) FROM unheard), 0) FOR UPDATE SKIP "
                      "LOCKED),"
                      " far AS (SELECT q.sequence FROM quadmeshd.job_queue q WHERE q.home NOT IN ($2, '')"
                      "     AND q.since < clock_timestamp() - " QM_POSTGRES_SECONDS(
                          "$5") "     AND q.sequence NOT IN (SELECT sequence FROM near) ORDER BY q.sequence"
                                "   LIMIT least($4::bigint, $3::bigint + $4::bigint - (SELECT count(*) FROM "
                                "unheard))"
                                "   FOR UPDATE SKIP LOCKED),"
                                " found AS (SELECT sequence FROM near UNION ALL SELECT sequence FROM far),"
                                " me AS (SELECT id FROM quadmeshd.nodes WHERE id = $1 AND state = 0"
                                "     AND EXISTS (SELECT FROM found) FOR SHARE),"
                                " taken AS (DELETE FROM quadmeshd.job_queue q USING found f"
                                "   WHERE q.sequence = f.sequence AND EXISTS (SELECT FROM me)"
                                "   RETURNING q.sequence, q.epoch, q.deaths),"
                                " made AS (INSERT INTO quadmeshd.job_runs (sequence, node, epoch, deaths)"
                                "   SELECT sequence, $1, epoch + 1, deaths FROM taken RETURNING sequence, "
                                "epoch, deaths, progress, false)"
                                " SELECT j.id, j.key, j.idempotency_key, j.body, j.created, 1, j.sequence, "
                                "j.document, r.epoch - 1,"
                                "   j.result, r.deaths, r.progress, j.labels, CASE WHEN r.epoch > 1 THEN 0"
                                "     ELSE extract(epoch FROM clock_timestamp() - j.submitted) END::float8,"
                                "   r.is_unheard"
                                " FROM (SELECT * FROM unheard UNION ALL SELECT * FROM made) "
                                "   r(sequence, epoch, deaths, progress, is_unheard) JOIN "
                                "quadmeshd.jobs j USING (sequence)"
                                " ORDER BY j.sequence",
        .use = QM_POSTGRES_PULSE};
    char node[QM_NODE_NAME_SIZE + 16];
    qm_text known = {0};
    qm_postgres_name_node(store, node);
    qm_postgres_begin_claiming(store, &known);
    qm_postgres_add_text(&query, node);
    qm_postgres_add_text(&query, store->postgres->self.name);
    qm_postgres_add_integer(&query, (int64_t)wish->free);
    qm_postgres_add_integer(&query, (int64_t)wish->extra);
    qm_postgres_add_real(&query, wish->spill_s);
    qm_postgres_add_array(&query, &known);
    qm_postgres_rows rows;
    *count = 0;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    for (int i = 0; i < rows.count && status == QM_STORED; i++) {
        qm_store_job *job = &out[*count];
        bool is_unheard = qm_postgres_bool(&rows, i, 14);
        /* A job that does not fit into memory stays claimed, and is found by the next claim. */
        if (!qm_postgres_read_job(&rows, i, job)) {
            status = QM_STORED_NO_MEMORY;
        } else if (is_unheard && qm_postgres_has_claim(store, job->id)) {
            qm_store_job_reset(job); /* it was submitted while this was under way */
        } else if (qm_postgres_add_claim(store, job->id)) {
            job->waited_s = qm_postgres_real(&rows, i, 13);
            ++*count;
        } else {
            qm_store_job_reset(job);
            status = QM_STORED_NO_MEMORY;
        }
    }
    if (*count > 0) status = QM_STORED;
    qm_postgres_end_claiming(store);
    qm_postgres_free(&rows);
    qm_text_reset(&known);
    return status;
}

qm_stored qm_postgres_begin_job(qm_store *store, const char *id)
{
    qm_postgres_query query = {.sql = "UPDATE quadmeshd.job_runs SET deaths = $3::int FROM quadmeshd.jobs j"
                                      " WHERE job_runs.sequence = j.sequence AND j.id = $1 AND node = $2"
                                      "   AND deaths >= $3::int - 1 RETURNING 1"};
    char node[QM_NODE_NAME_SIZE + 16];
    qm_postgres_name_node(store, node);
    qm_postgres_add_text(&query, id);
    qm_postgres_add_text(&query, node);
    qm_postgres_add_integer(&query, QM_STORE_MAX_DEATHS);
    qm_stored status = qm_postgres_change_row(store, &query);
    return status == QM_STORED_NONE ? QM_STORED : status; /* it has more runs left */
}

qm_stored qm_postgres_note_cancel(qm_store *store, const char *id)
{
    qm_postgres_query query = {.sql = "UPDATE quadmeshd.jobs j SET cancel = true FROM quadmeshd.job_runs r"
                                      " WHERE j.id = $1 AND r.sequence = j.sequence RETURNING 1"};
    qm_postgres_add_text(&query, id);
    qm_stored status = qm_postgres_change_row(store, &query);
    return status == QM_STORED_NONE ? QM_STORED : status; /* it has ended */
}

qm_stored qm_postgres_leave_jobs(qm_store *store)
{
    char node[QM_NODE_NAME_SIZE + 16];
    qm_postgres_name_node(store, node);
    /* Two statements: the second one sees what a claim has written that the first one had to wait for. */
    qm_postgres_query leave = {
        .sql = "UPDATE quadmeshd.nodes SET state = 1 WHERE id = $1 AND state = 0 RETURNING 1"};
    qm_postgres_add_text(&leave, node);
    qm_stored status = qm_postgres_change_row(store, &leave);
    if (status != QM_STORED && status != QM_STORED_NONE) return status;
    qm_postgres_query query = {
        .sql =
            "WITH mine AS (DELETE FROM quadmeshd.job_runs WHERE node = $1 RETURNING sequence, epoch)"
            " INSERT INTO quadmeshd.job_queue (sequence, home, epoch) SELECT sequence, '', epoch FROM mine"};
    qm_postgres_add_text(&query, node);
    qm_postgres_rows rows;
    status = qm_postgres_run(store, &query, &rows);
    qm_postgres_free(&rows);
    if (status == QM_STORED) qm_postgres_remove_claims(store);
    return status;
}

/* ---- runs ---- */

/** Reads what the database says of the runs. */
static void read_runs(qm_store *store, const qm_postgres_rows *rows, qm_store_run *runs, size_t run_count)
{
    for (size_t i = 0; i < run_count; i++)
        runs[i].is_lost = true;
    for (int row = 0; row < rows->count; row++) {
        qm_store_run *run = &runs[qm_postgres_integer(rows, row, 0) - 1];
        run->is_lost = false;
        run->is_canceled = qm_postgres_bool(rows, row, 1);
        run->is_watched = qm_postgres_bool(rows, row, 2);
    }
    for (size_t i = 0; i < run_count; i++)
        if (runs[i].is_lost) qm_postgres_remove_claim(store, runs[i].job);
}

/** Tells of new events that somebody at another node waits for. */
static void ring_watchers(qm_store *store, const qm_store_run *runs, size_t run_count,
                          const qm_store_event *events, size_t count)
{
    const char *watched[RUNG];
    size_t watched_count = 0;
    for (size_t i = 0; i < run_count && watched_count < RUNG; i++) {
        bool has_events = false;
        for (size_t k = 0; runs[i].is_watched && k < count && !has_events; k++)
            has_events = strcmp(events[k].job, runs[i].job) == 0;
        if (has_events) watched[watched_count++] = runs[i].job;
    }
    if (watched_count > 0)
        qm_postgres_ring(store, QM_STORE_NEWS_EVENTS, watched, watched_count, QM_POSTGRES_PULSE);
}

qm_stored qm_postgres_append_events(qm_store *store, qm_store_run *runs, size_t run_count,
                                    const qm_store_event *events, size_t count)
{
    qm_postgres_query query = {
        .sql = "WITH " QM_POSTGRES_RELAXED ","
               " asked AS (SELECT * FROM unnest($2::text[], $3::int[], $4::text[]) WITH ORDINALITY"
               "   AS a(id, epoch, progress, place)),"
               " mine AS (UPDATE quadmeshd.job_runs r SET progress = coalesce(a.progress, r.progress)"
               "   FROM asked a JOIN quadmeshd.jobs j ON j.id = a.id, relaxed WHERE relaxed.mode = 'off'"
               "     AND r.sequence = j.sequence AND r.node = $1 AND r.epoch = a.epoch"
               "   RETURNING r.sequence, a.id, a.place, j.cancel, r.watched),"
               " added AS (INSERT INTO quadmeshd.job_events (sequence, seq, name, members)"
               "   SELECT DISTINCT ON (m.sequence, e.seq) m.sequence, e.seq, e.name, e.members"
               "   FROM unnest($5::text[], $6::bigint[], $7::text[], $8::text[]) WITH ORDINALITY"
               "     AS e(id, seq, name, members, place) JOIN mine m USING (id)"
               "   ORDER BY m.sequence, e.seq, e.place DESC" REPLACE ")"
               " SELECT place, cancel, coalesce(watched > clock_timestamp(), false) FROM mine",
        .is_relaxed = true,
        .use = QM_POSTGRES_PULSE};
    char node[QM_NODE_NAME_SIZE + 16];
    qm_text ids = {0}, epochs = {0}, progress = {0}, jobs = {0};
    qm_postgres_events arrays = {0};
    qm_postgres_name_node(store, node);
    for (size_t i = 0; i < run_count; i++) {
        qm_postgres_write_text(&ids, runs[i].job);
        qm_postgres_write_integer(&epochs, runs[i].restarts + 1);
        qm_postgres_write_text(&progress, runs[i].progress);
    }
    for (size_t i = 0; i < count; i++)
        qm_postgres_write_text(&jobs, events[i].job);
    qm_postgres_write_events(&arrays, events, count);
    qm_postgres_add_text(&query, node);
    qm_postgres_add_array(&query, &ids);
    qm_postgres_add_array(&query, &epochs);
    qm_postgres_add_array(&query, &progress);
    qm_postgres_add_array(&query, &jobs);
    qm_postgres_add_events(&query, &arrays);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED) read_runs(store, &rows, runs, run_count);
    if (status == QM_STORED) ring_watchers(store, runs, run_count, events, count);
    qm_postgres_free(&rows);
    qm_text_reset(&ids);
    qm_text_reset(&epochs);
    qm_text_reset(&progress);
    qm_text_reset(&jobs);
    qm_postgres_events_reset(&arrays);
    return status;
}

/* ---- ends ---- */

/** Why a job of this node was not there: it has ended by an equal call, or it is lost. */
static qm_stored explain_end(qm_store *store, const qm_store_job *end)
{
    qm_postgres_query query = {.sql = "SELECT 1 FROM quadmeshd.jobs WHERE id = $1 AND state = $2::smallint"
                                      " AND restarts = $3::int AND document IS NOT NULL"};
    qm_postgres_add_text(&query, end->id);
    qm_postgres_add_integer(&query, end->state);
    qm_postgres_add_integer(&query, end->restarts);
    qm_stored status = qm_postgres_change_row(store, &query);
    if (status == QM_STORED_NONE) return QM_STORED_LOST;
    return status == QM_STORED ? qm_postgres_confirm(store, QM_STORED) : status;
}

static qm_stored finish(qm_store *store, qm_postgres_query *query, const qm_store_job *end)
{
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, query, &rows);
    bool has_lease = status == QM_STORED && qm_postgres_bool(&rows, 0, 0);
    bool has_ended = status == QM_STORED && qm_postgres_bool(&rows, 0, 1);
    qm_postgres_free(&rows);
    if (status == QM_STORED_TAKEN) return QM_STORED_LATE; /* the content of the mesh */
    if (status != QM_STORED || has_ended) return status;
    return has_lease ? QM_STORED_LATE : explain_end(store, end);
}

qm_stored qm_postgres_finish_job(qm_store *store, const qm_store_job *end, const char *revisions,
                                 const qm_store_event *events, size_t count, const qm_store_effect *effect)
{
    qm_postgres_query query = {
        .sql =
            "WITH lease AS (SELECT r.sequence FROM quadmeshd.jobs j JOIN quadmeshd.job_runs r USING "
            "(sequence)"
            "   WHERE j.id = $22 AND r.node = $23 AND r.epoch = $24::int + 1 FOR UPDATE OF r),"
            " " QM_POSTGRES_EFFECT_TARGET ","
            " ready AS (SELECT sequence FROM lease WHERE $15::text IS NULL OR EXISTS (SELECT FROM target)),"
            " " QM_POSTGRES_EFFECT ","
            " gone AS (DELETE FROM quadmeshd.job_runs r USING ready WHERE r.sequence = ready.sequence),"
            " search AS (DELETE FROM quadmeshd.job_bounds b USING ready WHERE b.sequence = ready.sequence),"
            " added AS (INSERT INTO quadmeshd.job_events (sequence, seq, name, members)"
            "   SELECT DISTINCT ON (e.seq) ready.sequence, e.seq, e.name, e.members"
            "   FROM ready, unnest($29::bigint[], $30::text[], $31::text[]) WITH ORDINALITY"
            "     AS e(seq, name, members, place) ORDER BY e.seq, e.place DESC" REPLACE "),"
            " ended AS (UPDATE quadmeshd.jobs j SET state = $25::smallint, document = $26, result = $27,"
            "   revisions = $28, restarts = $24::int FROM ready WHERE j.sequence = ready.sequence)"
            " SELECT EXISTS (SELECT FROM lease), EXISTS (SELECT FROM ready)"};
    char node[QM_NODE_NAME_SIZE + 16];
    qm_postgres_events arrays = {0};
    qm_postgres_name_node(store, node);
    qm_postgres_write_events(&arrays, events, count);
    qm_postgres_add_effect(&query, effect);
    qm_postgres_add_text(&query, end->id);
    qm_postgres_add_text(&query, node);
    qm_postgres_add_integer(&query, end->restarts);
    qm_postgres_add_integer(&query, end->state);
    qm_postgres_add_text(&query, end->document);
    qm_postgres_add_text(&query, end->result);
    qm_postgres_add_text(&query, revisions);
    qm_postgres_add_events(&query, &arrays);
    qm_stored status = finish(store, &query, end);
    qm_postgres_events_reset(&arrays);
    if (status == QM_STORED || status == QM_STORED_LOST) qm_postgres_remove_claim(store, end->id);
    const char *id = end->id;
    if (status == QM_STORED) qm_postgres_ring(store, QM_STORE_NEWS_EVENTS, &id, 1, QM_POSTGRES_REQUESTS);
    return status;
}

/** One attempt; QM_STORED_NONE when the job neither waits nor runs. */
static qm_stored cancel(qm_store *store, const char *id, const char *document, const qm_store_event *last,
                        bool *is_repeated)
{
    qm_postgres_query query = {
        .sql =
            "WITH waiting AS (DELETE FROM quadmeshd.job_queue q USING quadmeshd.jobs j"
            "   WHERE j.id = $1 AND q.sequence = j.sequence RETURNING q.sequence, q.epoch),"
            " search AS (DELETE FROM quadmeshd.job_bounds b USING waiting w WHERE b.sequence = w.sequence),"
            " added AS (INSERT INTO quadmeshd.job_events (sequence, seq, name, members)"
            "   SELECT sequence, $3::bigint, $4::text, $5::text FROM waiting" REPLACE "),"
            " ended AS (UPDATE quadmeshd.jobs j SET state = 4, document = $2, restarts = w.epoch"
            "   FROM waiting w WHERE j.sequence = w.sequence RETURNING true),"
            " marked AS (UPDATE quadmeshd.jobs j SET cancel = true FROM quadmeshd.job_runs r"
            "   WHERE j.id = $1 AND r.sequence = j.sequence RETURNING false)"
            " SELECT * FROM ended UNION ALL SELECT * FROM marked"};
    qm_postgres_add_text(&query, id);
    qm_postgres_add_text(&query, document);
    qm_postgres_add_integer(&query, (int64_t)last->seq);
    qm_postgres_add_text(&query, last->name);
    qm_postgres_add_text(&query, last->members);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED && rows.count == 0)
        status = QM_STORED_NONE;
    else if (status == QM_STORED && !qm_postgres_bool(&rows, 0, 0))
        status = QM_STORED_LATE;
    qm_postgres_free(&rows);
    *is_repeated = *is_repeated || query.is_repeated;
    return status;
}

qm_stored qm_postgres_cancel_job(qm_store *store, const char *id, const char *document,
                                 const qm_store_event *last)
{
    bool is_repeated = false;
    for (int attempt = 0; attempt < 4; attempt++) {
        qm_stored status = cancel(store, id, document, last, &is_repeated);
        if (status == QM_STORED || status == QM_STORED_LATE)
            qm_postgres_ring(store, QM_STORE_NEWS_CANCELED, &id, 1, QM_POSTGRES_REQUESTS);
        if (status != QM_STORED_NONE) return status;
        /* A claim may have moved it from one table to the other while this looked at both. */
        qm_store_job job;
        status = qm_postgres_find_job(store, id, &job);
        if (status != QM_STORED) return status;
        bool has_ended = job.state > QM_JOB_RUNNING;
        bool is_mine = is_repeated && job.state == QM_JOB_CANCELED && strcmp(job.document, document) == 0;
        qm_store_job_reset(&job);
        if (has_ended) return qm_postgres_confirm(store, is_mine ? QM_STORED : QM_STORED_NONE);
    }
    return QM_STORED_AWAY;
}

qm_stored qm_postgres_hold_job(qm_store *store, const char *id, int owners, bool is_kept, bool *is_unwanted)
{
    /* When it is not known whether clients that left were counted, they are not counted again: the job then runs to its
     * end, which a second count could cut off. */
    qm_postgres_query query = {
        .sql =
            "UPDATE quadmeshd.jobs SET kept = kept OR $3::bool,"
            "  owners = CASE WHEN $4::bool AND $2::int < 0 THEN owners ELSE greatest(owners + $2::int, 0) END"
            " WHERE id = $1 AND document IS NULL RETURNING owners = 0 AND NOT kept"};
    qm_postgres_add_text(&query, id);
    qm_postgres_add_integer(&query, owners);
    qm_postgres_add_bool(&query, is_kept);
    qm_postgres_add_repeated(&query);
    qm_postgres_rows rows;
    *is_unwanted = false;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED && rows.count == 0) status = QM_STORED_NONE;
    if (status == QM_STORED) *is_unwanted = qm_postgres_bool(&rows, 0, 0);
    qm_postgres_free(&rows);
    return status;
}

/* ---- events ---- */

/** Reads events after *after, and moves it to the last one of them. *count is their number. */
static qm_stored read_page(qm_store *store, const char *id, uint64_t *after, qm_store_event_fn *take,
                           void *user, int *count)
{
    qm_postgres_query query = {
        .sql = "SELECT e.seq, e.name, e.members FROM quadmeshd.jobs j"
               " JOIN quadmeshd.job_events e USING (sequence)"
               " WHERE j.id = $1 AND e.seq > $2::bigint ORDER BY e.seq LIMIT " PAGE_TEXT(PAGE)};
    qm_postgres_add_text(&query, id);
    qm_postgres_add_integer(&query, *after > INT64_MAX ? INT64_MAX : (int64_t)*after);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    *count = rows.count;
    for (int i = 0; status == QM_STORED && i < rows.count; i++) {
        const qm_store_event event = {id, (uint64_t)qm_postgres_integer(&rows, i, 0),
                                      qm_postgres_text(&rows, i, 1), qm_postgres_text(&rows, i, 2)};
        *after = event.seq;
        if (!take(user, &event)) status = QM_STORED_NO_MEMORY;
    }
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_read_events(qm_store *store, const char *id, uint64_t after, qm_store_event_fn *take,
                                  void *user)
{
    int count = PAGE;
    qm_stored status = QM_STORED;
    while (status == QM_STORED && count == PAGE)
        status = read_page(store, id, &after, take, user, &count);
    return status;
}

/** Gives the rows of a look to the caller: of each job one without an event, then its events. One with more of them
 * than were read has not yet ended for the caller. */
static qm_stored read_looks(const qm_postgres_rows *rows, qm_store_look *looks, qm_store_event_fn *take,
                            void *user)
{
    int first = 0; /* row of the job */
    for (int row = 0; row < rows->count; row++) {
        qm_store_look *look = &looks[qm_postgres_integer(rows, row, 0) - 1];
        const char *name = qm_postgres_text(rows, row, 2);
        if (!name) {
            const char *state = qm_postgres_text(rows, row, 4);
            look->is_gone = !state;
            look->state = state ? (qm_job_state)qm_postgres_integer(rows, row, 4) : QM_JOB_QUEUED;
            first = row;
            continue;
        }
        const qm_store_event event = {look->job, (uint64_t)qm_postgres_integer(rows, row, 1), name,
                                      qm_postgres_text(rows, row, 3)};
        if (!take(user, &event)) return QM_STORED_NO_MEMORY;
        if (row - first == PAGE) look->state = QM_JOB_RUNNING;
    }
    return QM_STORED;
}

qm_stored qm_postgres_look_at_jobs(qm_store *store, qm_store_look *looks, size_t count,
                                   qm_store_event_fn *take, void *user)
{
    qm_postgres_query query = {
        .sql =
            "WITH " QM_POSTGRES_RELAXED ","
            " asked AS (SELECT a.place, a.after, j.sequence, r.sequence AS run, r.watched,"
            "     CASE WHEN r.sequence IS NULL THEN j.state ELSE 1 END AS state"
            "   FROM unnest($1::text[], $2::bigint[]) WITH ORDINALITY AS a(id, after, place)"
            "   LEFT JOIN quadmeshd.jobs j ON j.id = a.id"
            "   LEFT JOIN quadmeshd.job_runs r ON r.sequence = j.sequence),"
            " watched AS (UPDATE quadmeshd.job_runs r SET watched = clock_timestamp() + interval '" WATCHED_S
            " s' FROM asked, relaxed WHERE relaxed.mode = 'off' AND r.sequence = asked.run"
            "     AND (asked.watched IS NULL OR asked.watched < clock_timestamp() + interval '" RENEWED_S
            " s')) SELECT place, NULL::bigint AS seq, NULL AS name, NULL AS members,"
            "   CASE WHEN sequence IS NOT NULL THEN state END FROM asked"
            " UNION ALL SELECT a.place, e.seq, e.name, e.members, NULL FROM asked a, LATERAL"
            "   (SELECT seq, name, members FROM quadmeshd.job_events"
            "    WHERE sequence = a.sequence AND seq > a.after ORDER BY seq LIMIT " PAGE_TEXT(
                PAGE) ") e"
                      " ORDER BY place, seq NULLS FIRST",
        .is_relaxed = true,
        .use = QM_POSTGRES_PULSE};
    qm_text ids = {0}, afters = {0};
    for (size_t i = 0; i < count; i++) {
        qm_postgres_write_text(&ids, looks[i].job);
        qm_postgres_write_integer(&afters, looks[i].after > INT64_MAX ? INT64_MAX : (int64_t)looks[i].after);
    }
    qm_postgres_add_array(&query, &ids);
    qm_postgres_add_array(&query, &afters);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED) status = read_looks(&rows, looks, take, user);
    qm_postgres_free(&rows);
    qm_text_reset(&ids);
    qm_text_reset(&afters);
    return status;
}
