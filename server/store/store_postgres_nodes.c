/**
 * store_postgres_nodes.c: the nodes that share a store: who lives, who is silent, and which of them is the home of a
 * mesh. Only the database's clock counts.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "store_postgres.h"

void qm_postgres_name_node(qm_store *store, char out[QM_NODE_NAME_SIZE + 16])
{
    pthread_mutex_lock(&store->postgres->lock);
    memcpy(out, store->postgres->node, sizeof store->postgres->node);
    pthread_mutex_unlock(&store->postgres->lock);
}

/* ---- life and death ---- */

/** Queues the jobs of nodes that are gone. A statement of its own after the one that tells these: so it sees what a
 * claim has written that the first one had to wait for. */
static qm_stored requeue(qm_store *store, size_t *count)
{
    qm_postgres_query query = {
        .sql = "WITH lost AS (DELETE FROM quadmeshd.job_runs r USING quadmeshd.nodes n"
               "   WHERE r.node = n.id AND n.state = 2 RETURNING r.sequence, r.epoch, r.deaths)"
               " INSERT INTO quadmeshd.job_queue (sequence, home, epoch, deaths)"
               "  SELECT sequence, '', epoch, greatest(deaths, least(deaths + 1, $1::int - 1)) FROM lost"
               "  RETURNING 1",
        .use = QM_POSTGRES_PULSE};
    qm_postgres_add_integer(&query, QM_STORE_MAX_DEATHS);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    *count = (size_t)rows.count;
    qm_postgres_free(&rows);
    return status;
}

/** Ends earlier starts of this node's name, whose folder this one holds. */
static qm_stored replace_earlier(qm_store *store)
{
    qm_postgres_query query = {
        .sql = "UPDATE quadmeshd.nodes SET state = 2 WHERE name = $1 AND state < 2 RETURNING 1",
        .use = QM_POSTGRES_PULSE};
    qm_postgres_add_text(&query, store->postgres->self.name);
    qm_stored status = qm_postgres_change_row(store, &query);
    size_t count;
    return status == QM_STORED || status == QM_STORED_NONE ? requeue(store, &count) : status;
}

qm_stored qm_postgres_join(qm_store *store)
{
    struct qm_postgres *postgres = store->postgres;
    qm_stored status = replace_earlier(store);
    if (status != QM_STORED) return status;
    char id[QM_ID_SIZE], node[QM_NODE_NAME_SIZE + 16];
    qm_id_make('n', id);
    snprintf(node, sizeof node, "%s.%.10s", postgres->self.name, id + 2);
    qm_postgres_query query = {
        .sql = "WITH made AS (INSERT INTO quadmeshd.nodes (id, name, version, workers, memory)"
               "   VALUES ($1, $2, $3, $4::int, $5::bigint) ON CONFLICT DO NOTHING RETURNING id)"
               " INSERT INTO quadmeshd.node_beats (id, free) SELECT id, 0 FROM made",
        .use = QM_POSTGRES_PULSE};
    qm_postgres_add_text(&query, node);
    qm_postgres_add_text(&query, postgres->self.name);
    qm_postgres_add_text(&query, postgres->self.version);
    qm_postgres_add_integer(&query, postgres->self.workers);
    qm_postgres_add_integer(&query,
                            postgres->self.memory > INT64_MAX ? INT64_MAX : (int64_t)postgres->self.memory);
    qm_postgres_rows rows;
    status = qm_postgres_run(store, &query, &rows);
    qm_postgres_free(&rows);
    if (status != QM_STORED) return status;
    pthread_mutex_lock(&postgres->lock);
    memcpy(postgres->node, node, sizeof node);
    postgres->claim_count = 0;
    pthread_mutex_unlock(&postgres->lock);
    return QM_STORED;
}

/** Keeps the nodes that take work, one a row, for find_home. */
static qm_stored keep_homes(qm_store *store, const qm_postgres_rows *rows)
{
    struct qm_postgres *postgres = store->postgres;
    qm_postgres_home *homes = calloc((size_t)rows->count, sizeof *homes);
    if (!homes) return QM_STORED_NO_MEMORY;
    size_t count = 0;
    for (int i = 0; i < rows->count; i++) {
        if (!qm_postgres_text(rows, i, 5)) continue; /* there is none */
        qm_postgres_read(rows, i, 5, homes[count].name, QM_NODE_NAME_SIZE);
        homes[count++].waiting = qm_postgres_integer(rows, i, 6);
    }
    pthread_mutex_lock(&postgres->lock);
    free(postgres->homes);
    postgres->homes = homes;
    postgres->home_count = count;
    pthread_mutex_unlock(&postgres->lock);
    return QM_STORED;
}

/** Tells of the events that the statement of a beat has seen: "job count last" for each job, between spaces. They are in the log
 * before the commit of the beat, on the same server, which has returned: they are as durable as it. */
static void tell_durable(const char *text, qm_store_durable_fn *take, void *user)
{
    char job[QM_ID_SIZE];
    unsigned long long count, last;
    int length;
    while (text && sscanf(text, "%39s %llu %llu%n", job, &count, &last, &length) == 3) {
        take(user, job, (size_t)count, last);
        text += length;
    }
}
_Static_assert(QM_ID_SIZE == 40, "sscanf reads an id");

qm_stored qm_postgres_beat(qm_store *store, size_t free_workers, qm_store_cluster *out,
                           qm_store_durable_fn *take, void *user)
{
    qm_postgres_query query = {
        .sql = "WITH beaten AS (UPDATE quadmeshd.node_beats b SET beat = clock_timestamp(), free = $2::int"
               "   FROM quadmeshd.nodes n WHERE b.id = $1 AND n.id = b.id AND n.state < 2 RETURNING b.id),"
               " homes AS (SELECT n.name, (SELECT count(*) FROM quadmeshd.job_queue q WHERE q.home = n.name)"
               "     AS waiting FROM quadmeshd.nodes n WHERE n.state = 0)"
               " SELECT EXISTS (SELECT FROM beaten), (SELECT count(*) FROM quadmeshd.nodes WHERE state < 2),"
               "  (SELECT count(*) FROM quadmeshd.job_queue), (SELECT count(*) FROM quadmeshd.job_runs),"
               "  " QM_POSTGRES_DURABILITY ", homes.name, homes.waiting,"
               "  (SELECT string_agg(concat_ws(' ', j.id, e.count, e.last), ' ') FROM quadmeshd.job_runs r"
               "     JOIN quadmeshd.jobs j USING (sequence) CROSS JOIN LATERAL (SELECT count(*),"
               "       coalesce(max(seq), 0) AS last FROM quadmeshd.job_events"
               "       WHERE sequence = r.sequence) e WHERE r.node = $1)"
               " FROM (SELECT 1) one LEFT JOIN homes ON true",
        .use = QM_POSTGRES_PULSE};
    *out = (qm_store_cluster){0};
    qm_postgres_name_node(store, out->node);
    qm_postgres_add_text(&query, out->node);
    qm_postgres_add_integer(&query, free_workers > INT32_MAX ? INT32_MAX : (int64_t)free_workers);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED) {
        out->nodes = (size_t)qm_postgres_integer(&rows, 0, 1);
        out->queued = (size_t)qm_postgres_integer(&rows, 0, 2);
        out->running = (size_t)qm_postgres_integer(&rows, 0, 3);
        out->durability = (qm_store_durability)qm_postgres_integer(&rows, 0, 4);
        qm_postgres_name_engine(store, out->engine);
        bool lives = qm_postgres_bool(&rows, 0, 0);
        status = keep_homes(store, &rows);
        if (!lives) status = QM_STORED_LOST;
        if (lives && take) tell_durable(qm_postgres_text(&rows, 0, 7), take, user);
    }
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_reap(qm_store *store, double silence_s, size_t *count)
{
    *count = 0;
    qm_postgres_query mourn = {
        .sql =
            "UPDATE quadmeshd.nodes n SET state = 2 FROM quadmeshd.node_beats b WHERE b.id = n.id"
            "  AND n.state < 2 AND b.beat < clock_timestamp() - " QM_POSTGRES_SECONDS("$1") " RETURNING n.id",
        .use = QM_POSTGRES_PULSE};
    qm_postgres_add_real(&mourn, silence_s);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &mourn, &rows);
    for (int i = 0; i < rows.count; i++)
        qm_log(QM_LOG_WARN, "node %s is silent: its jobs are given to others", qm_postgres_text(&rows, i, 0));
    qm_postgres_free(&rows);
    if (status == QM_STORED) status = requeue(store, count);
    if (status != QM_STORED) return status;
    /* Rows of nodes that are gone stay a day, for whoever reads logs. */
    qm_postgres_query forget = {
        .sql = "DELETE FROM quadmeshd.nodes n USING quadmeshd.node_beats b WHERE b.id = n.id AND n.state = 2"
               "  AND b.beat < clock_timestamp() - interval '1 day'"
               "  AND NOT EXISTS (SELECT FROM quadmeshd.job_runs r WHERE r.node = n.id)",
        .use = QM_POSTGRES_PULSE};
    status = qm_postgres_run(store, &forget, &rows);
    qm_postgres_free(&rows);
    return status;
}

/* ---- homes ---- */

/** Rendezvous hashing: each node has a number for each id, and the greatest is the first home. FNV-1a, whose last bytes
 * hardly reach the upper bits, with the finalizer of SplitMix64 (Steele, Lea, Flood 2014). */
static uint64_t score_of(const char *name, const char *id)
{
    uint64_t hash = 14695981039346656037u;
    for (const char *c = name; *c; c++)
        hash = (hash ^ (unsigned char)*c) * 1099511628211u;
    hash *= 1099511628211u; /* the end of the name */
    for (const char *c = id; *c; c++)
        hash = (hash ^ (unsigned char)*c) * 1099511628211u;
    hash = (hash ^ hash >> 30) * 0xbf58476d1ce4e5b9u;
    hash = (hash ^ hash >> 27) * 0x94d049bb133111ebu;
    return hash ^ hash >> 31;
}

qm_stored qm_postgres_find_home(qm_store *store, const char *id, char out[QM_NODE_NAME_SIZE])
{
    struct qm_postgres *postgres = store->postgres;
    pthread_mutex_lock(&postgres->lock);
    const qm_postgres_home *first = NULL, *second = NULL;
    uint64_t first_score = 0, second_score = 0;
    for (size_t i = 0; i < postgres->home_count; i++) {
        const qm_postgres_home *home = &postgres->homes[i];
        uint64_t score = score_of(home->name, id);
        if (!first || score > first_score) {
            second = first, second_score = first_score;
            first = home, first_score = score;
        } else if (!second || score > second_score) {
            second = home, second_score = score;
        }
    }
    if (second && second->waiting < first->waiting) first = second;
    snprintf(out, QM_NODE_NAME_SIZE, "%s", first ? first->name : postgres->self.name);
    pthread_mutex_unlock(&postgres->lock);
    return QM_STORED;
}
