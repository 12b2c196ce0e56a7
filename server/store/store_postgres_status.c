/**
 * store_postgres_status.c: prints what a shared store is, for people and scripts.
 */
#include <inttypes.h>
#include <stdio.h>

#include "store_postgres.h"

#define SILENCE_S 10.0 /* after which nodes take another one for dead (job/job_pulse.c) */

typedef struct report {
    qm_store *store;
    FILE *out;
    size_t faults;
} report;

static void tell_fault(report *work, const char *fault)
{
    fprintf(work->out, "fault: %s\n", fault);
    work->faults++;
}

static qm_stored print_durability(report *work)
{
    static const char *const words[] = {"none", "one machine", "replicated"};
    qm_postgres_query query = {.sql = "SELECT " QM_POSTGRES_DURABILITY};
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(work->store, &query, &rows);
    if (status == QM_STORED) {
        int64_t durability = qm_postgres_integer(&rows, 0, 0);
        fprintf(work->out, "durability: %s\n", words[durability]);
        if (durability == QM_STORE_UNSAFE)
            tell_fault(work, "the database does not wait for its disk when it acknowledges a commit");
    }
    qm_postgres_free(&rows);
    return status;
}

/** Roles that may not see how standbys do see that they are there. */
static qm_stored print_standbys(report *work)
{
    qm_postgres_query query = {
        .sql = "SELECT application_name, coalesce(state, 'unknown'), coalesce(sync_state, 'unknown')"
               " FROM pg_catalog.pg_stat_replication ORDER BY application_name, pid"};
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(work->store, &query, &rows);
    if (status == QM_STORED) fprintf(work->out, "standbys: %d\n", rows.count);
    for (int i = 0; i < rows.count; i++)
        fprintf(work->out, "standby: name=%s state=%s sync=%s\n", qm_postgres_text(&rows, i, 0),
                qm_postgres_text(&rows, i, 1), qm_postgres_text(&rows, i, 2));
    qm_postgres_free(&rows);
    return status;
}

static qm_stored print_version(report *work, int64_t *version)
{
    char fault[128];
    qm_stored status = qm_postgres_find_version(work->store, version);
    if (status != QM_STORED) return status;
    fprintf(work->out, "tables: %" PRId64 "\n", *version);
    snprintf(fault, sizeof fault, "tables of version %" PRId64 " are those of another version of quadmeshd",
             *version);
    if (*version == 0)
        tell_fault(work, "there are no tables: the first daemon, or an import, makes them");
    else if (!qm_postgres_knows(*version))
        tell_fault(work, fault);
    return QM_STORED;
}

static qm_stored print_nodes(report *work)
{
    qm_postgres_query query = {
        .sql = "SELECT n.name, n.id, n.version, n.state, n.workers, b.free,"
               "  coalesce(extract(epoch FROM clock_timestamp() - b.beat), 'Infinity')::float8"
               " FROM quadmeshd.nodes n LEFT JOIN quadmeshd.node_beats b USING (id) WHERE n.state < 2"
               " ORDER BY n.name, n.id"};
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(work->store, &query, &rows);
    int living = 0;
    for (int i = 0; i < rows.count; i++) {
        double silence_s = qm_postgres_real(&rows, i, 6);
        bool lives = silence_s < SILENCE_S;
        living += lives;
        fprintf(work->out,
                "node: name=%s id=%s version=%s state=%s silent_s=%.1f workers=%" PRId64 " free=%" PRId64
                "\n",
                qm_postgres_text(&rows, i, 0), qm_postgres_text(&rows, i, 1), qm_postgres_text(&rows, i, 2),
                !lives                                  ? "silent"
                : qm_postgres_integer(&rows, i, 3) == 0 ? "working"
                                                        : "leaving",
                silence_s, qm_postgres_integer(&rows, i, 4), qm_postgres_integer(&rows, i, 5));
    }
    qm_postgres_free(&rows);
    if (status != QM_STORED) return status;
    fprintf(work->out, "nodes that live: %d\n", living);
    if (living == 0) tell_fault(work, "no node lives");
    return QM_STORED;
}

static qm_stored print_counts(report *work)
{
    static const char *const names[] = {"jobs waiting", "oldest waiting s", "jobs running", "meshes",
                                        "blobs",        "blob bytes"};
    qm_postgres_query query = {
        .sql = "SELECT (SELECT count(*) FROM quadmeshd.job_queue),"
               " (SELECT round(coalesce(extract(epoch FROM clock_timestamp() - min(since)), 0), 1)"
               "   FROM quadmeshd.job_queue),"
               " (SELECT count(*) FROM quadmeshd.job_runs), (SELECT count(*) FROM quadmeshd.meshes),"
               " (SELECT count(*) FROM quadmeshd.blobs),"
               " (SELECT coalesce(sum(size), 0) FROM quadmeshd.blobs)"};
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(work->store, &query, &rows);
    for (int i = 0; status == QM_STORED && i < (int)(sizeof names / sizeof names[0]); i++)
        fprintf(work->out, "%s: %s\n", names[i], qm_postgres_text(&rows, 0, i));
    qm_postgres_free(&rows);
    return status;
}

/** In a snapshot. */
static qm_stored print_facts(report *work)
{
    char engine[64];
    int64_t version = 0;
    qm_postgres_name_engine(work->store, engine);
    fprintf(work->out, "engine: %s\n", engine);
    qm_stored status = print_durability(work);
    if (status == QM_STORED) status = print_standbys(work);
    if (status == QM_STORED) status = print_version(work, &version);
    if (status != QM_STORED) return status;
    if (version == 0) {
        tell_fault(work, "no node lives");
        return QM_STORED;
    }
    status = print_nodes(work);
    return status == QM_STORED ? print_counts(work) : status;
}

qm_stored qm_store_print_status(const char *address, const qm_store_node *self, FILE *out, size_t *faults,
                                char message[QM_MESSAGE_SIZE])
{
    report work = {.out = out};
    *faults = 0;
    qm_stored status = qm_postgres_visit(address, self, "", true, &work.store, message);
    if (status != QM_STORED) return status;
    status = qm_postgres_begin_snapshot(work.store);
    if (status == QM_STORED) status = print_facts(&work);
    qm_postgres_end_snapshot(work.store);
    if (status != QM_STORED)
        snprintf(message, QM_MESSAGE_SIZE, "database: it cannot be read; the log has more");
    else if (qm_postgres_confirm(work.store, QM_STORED) != QM_STORED)
        tell_fault(&work, "the database does not confirm a commit: a synchronous standby may be away");
    *faults = work.faults;
    qm_store_close(work.store);
    return status;
}
