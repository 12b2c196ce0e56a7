/**
 * store_postgres_schema.c: the tables of a shared store. They lie in a schema of their own, so that the database may
 * hold other things. Times are the database's own: no node's clock is compared with another's.
 */
#include <stdio.h>
#include <string.h>

#include "store_postgres.h"

#define VERSION 1 /* of these tables */
#define OLDEST_SERVER 150000

/** True when the tables are there: asked of the catalog's rows, as what a session remembers of names may be older than
 * the lock that it has waited for. */
#define IS_THERE                                                                                             \
    "EXISTS (SELECT FROM pg_catalog.pg_tables WHERE schemaname = 'quadmeshd' AND tablename = 'about')"

/* Of those who make the tables: any number that nobody else in the database uses. */
#define LOCK "7019267140411325"

/** Where a job is that has not ended: in exactly one of job_queue and job_runs, which stay as small as what waits and
 * runs. A row of job_runs is the lease of a node: who writes for a job has it in the conditions of the statement. */
#define JOBS                                                                                                 \
    "CREATE TABLE quadmeshd.jobs ("                                                                          \
    "  sequence bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY, id text NOT NULL UNIQUE COLLATE \"C\","     \
    "  key text NOT NULL COLLATE \"C\", idempotency_key text UNIQUE COLLATE \"C\", body text NOT NULL,"      \
    "  type text NOT NULL COLLATE \"C\", created text NOT NULL,"                                             \
    "  submitted timestamptz NOT NULL DEFAULT clock_timestamp(),"                                            \
    "  state smallint NOT NULL DEFAULT 0," /* qm_job_state; 0 until it has ended */                          \
    "  document text, result text, revisions text NOT NULL DEFAULT '' COLLATE \"C\","                        \
    "  restarts int NOT NULL DEFAULT 0, cancel boolean NOT NULL DEFAULT false,"                              \
    "  owners int NOT NULL," /* clients whose leaving ends it, unless it is kept */                          \
    "  kept boolean NOT NULL) WITH (fillfactor = 80);"                                                       \
    "CREATE INDEX ON quadmeshd.jobs (key, revisions, state);"                                                \
    "CREATE INDEX ON quadmeshd.jobs (submitted) WHERE document IS NOT NULL;"                                 \
    "CREATE INDEX ON quadmeshd.jobs (type, sequence);"                                                       \
    "CREATE INDEX ON quadmeshd.jobs (state, sequence);"                                                      \
    "CREATE TABLE quadmeshd.job_subjects ("                                                                  \
    "  sequence bigint NOT NULL REFERENCES quadmeshd.jobs ON DELETE CASCADE,"                                \
    "  subject text NOT NULL COLLATE \"C\", PRIMARY KEY (sequence, subject));"                               \
    "CREATE INDEX ON quadmeshd.job_subjects (subject, sequence);"                                            \
    "CREATE TABLE quadmeshd.job_queue ("                                                                     \
    "  sequence bigint PRIMARY KEY REFERENCES quadmeshd.jobs ON DELETE CASCADE,"                             \
    "  home text NOT NULL COLLATE \"C\"," /* name of a node; '' for any */                                   \
    "  epoch int NOT NULL DEFAULT 0,"     /* claims so far */                                                \
    "  deaths int NOT NULL DEFAULT 0,"    /* of these, how many ended with their node */                     \
    "  since timestamptz NOT NULL DEFAULT clock_timestamp())"                                                \
    "  WITH (autovacuum_vacuum_scale_factor = 0.01);"                                                        \
    "CREATE INDEX ON quadmeshd.job_queue (home, sequence);"                                                  \
    "CREATE TABLE quadmeshd.job_runs ("                                                                      \
    "  sequence bigint PRIMARY KEY REFERENCES quadmeshd.jobs ON DELETE CASCADE,"                             \
    "  node text NOT NULL COLLATE \"C\" REFERENCES quadmeshd.nodes, epoch int NOT NULL,"                     \
    "  deaths int NOT NULL, progress text,"                                                                  \
    "  watched timestamptz)" /* until when somebody elsewhere reads its events */                            \
    "  WITH (fillfactor = 50, autovacuum_vacuum_scale_factor = 0.01);"                                       \
    "CREATE INDEX ON quadmeshd.job_runs (node);"                                                             \
    "CREATE TABLE quadmeshd.job_events ("                                                                    \
    "  sequence bigint NOT NULL REFERENCES quadmeshd.jobs ON DELETE CASCADE, seq bigint NOT NULL,"           \
    "  name text NOT NULL, members text NOT NULL, PRIMARY KEY (sequence, seq));"                             \
    "CREATE TABLE quadmeshd.job_arrays ("                                                                    \
    "  sequence bigint PRIMARY KEY REFERENCES quadmeshd.jobs ON DELETE CASCADE,"                             \
    "  count bigint NOT NULL, sums bytea NOT NULL,"                                                          \
    "  hash text NOT NULL COLLATE \"C\" REFERENCES quadmeshd.blobs);"                                        \
    "CREATE INDEX ON quadmeshd.job_arrays (hash);"

/** A node is one start of a daemon. Beats are apart from nodes, whose rows are locked to fence. A row of about comes
 * last: who sees it sees all. Text ids have the collation of bytes, which no new C library changes. */
static const char schema[] =
    "CREATE SCHEMA quadmeshd;"
    "CREATE TABLE quadmeshd.nodes ("
    "  id text PRIMARY KEY COLLATE \"C\", name text NOT NULL COLLATE \"C\", version text NOT NULL,"
    "  state smallint NOT NULL DEFAULT 0," /* 0 takes work, 1 leaves, 2 is gone */
    "  started timestamptz NOT NULL DEFAULT clock_timestamp(), workers int NOT NULL,"
    "  memory bigint NOT NULL);" /* bytes of its budget */
    "CREATE INDEX ON quadmeshd.nodes (name);"
    "CREATE TABLE quadmeshd.node_beats ("
    "  id text PRIMARY KEY COLLATE \"C\" REFERENCES quadmeshd.nodes ON DELETE CASCADE,"
    "  beat timestamptz NOT NULL DEFAULT clock_timestamp(), free int NOT NULL)"
    "  WITH (fillfactor = 50, autovacuum_vacuum_scale_factor = 0.01);"
    "CREATE TABLE quadmeshd.blobs ("
    "  hash text PRIMARY KEY COLLATE \"C\", size bigint NOT NULL,"
    "  generation text NOT NULL COLLATE \"C\","
    "  unneeded timestamptz);" /* since when no row names it */
    "CREATE INDEX ON quadmeshd.blobs (unneeded) WHERE unneeded IS NOT NULL;"
    "CREATE TABLE quadmeshd.blob_chunks ("
    "  generation text NOT NULL COLLATE \"C\", n int NOT NULL, bytes bytea NOT NULL,"
    "  PRIMARY KEY (generation, n));"
    "ALTER TABLE quadmeshd.blob_chunks ALTER bytes SET STORAGE EXTERNAL;" /* not compressed */
    "CREATE TABLE quadmeshd.meshes ("
    "  sequence bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY, id text NOT NULL UNIQUE COLLATE \"C\","
    "  hash text NOT NULL COLLATE \"C\" REFERENCES quadmeshd.blobs, options text NOT NULL COLLATE \"C\","
    "  name text NOT NULL COLLATE \"C\", document text NOT NULL, format smallint NOT NULL,"
    "  revision bigint NOT NULL, positions text COLLATE \"C\" REFERENCES quadmeshd.blobs,"
    "  created text NOT NULL, expires timestamptz, UNIQUE (hash, options));"
    "CREATE INDEX ON quadmeshd.meshes (positions) WHERE positions IS NOT NULL;"
    "CREATE INDEX ON quadmeshd.meshes (name, sequence);"
    "CREATE INDEX ON quadmeshd.meshes (expires) WHERE expires IS NOT NULL;" JOBS
    "CREATE TABLE quadmeshd.layouts ("
    "  sequence bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY, id text NOT NULL UNIQUE COLLATE \"C\","
    "  mesh text NOT NULL COLLATE \"C\", created text NOT NULL,"
    "  revision bigint NOT NULL, first bigint NOT NULL, latest bigint NOT NULL,"
    "  idempotency_key text UNIQUE COLLATE \"C\", request text NOT NULL);"
    "CREATE INDEX ON quadmeshd.layouts (mesh, sequence);"
    "CREATE TABLE quadmeshd.layout_revisions ("
    "  id text NOT NULL COLLATE \"C\" REFERENCES quadmeshd.layouts (id) ON DELETE CASCADE,"
    "  revision bigint NOT NULL, layout text NOT NULL, issues text NOT NULL, next_curve bigint NOT NULL,"
    "  is_complete boolean NOT NULL, PRIMARY KEY (id, revision));"
    "CREATE TABLE quadmeshd.reconstructions ("
    "  sequence bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY, id text NOT NULL UNIQUE COLLATE \"C\","
    "  source text NOT NULL COLLATE \"C\", layout_id text NOT NULL, mesh text NOT NULL COLLATE \"C\","
    "  layout text NOT NULL, document text NOT NULL, steps text NOT NULL, records text NOT NULL,"
    "  state text NOT NULL, revision bigint NOT NULL, cover_share double precision NOT NULL,"
    "  pull_curves boolean NOT NULL, idempotency_key text UNIQUE COLLATE \"C\", request text NOT NULL);"
    "CREATE INDEX ON quadmeshd.reconstructions (source, sequence);"
    "CREATE INDEX ON quadmeshd.reconstructions (mesh);"
    "CREATE TABLE quadmeshd.about (version int NOT NULL);"
    "INSERT INTO quadmeshd.about VALUES (%d)";

/** What the database is. */
typedef struct facts {
    int64_t server; /* its version as a number */
    bool is_utf8, is_there;
    int64_t version; /* of its tables; 0: none */
} facts;

static qm_stored read_facts(qm_store *store, facts *out)
{
    qm_postgres_query query = {.sql = "SELECT current_setting('server_version_num'),"
                                      " current_setting('server_encoding') = 'UTF8',"
                                      " " IS_THERE};
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED)
        *out = (facts){.server = qm_postgres_integer(&rows, 0, 0),
                       .is_utf8 = qm_postgres_bool(&rows, 0, 1),
                       .is_there = qm_postgres_bool(&rows, 0, 2)};
    qm_postgres_free(&rows);
    if (status != QM_STORED || !out->is_there) return status;
    query = (qm_postgres_query){.sql = "SELECT version FROM quadmeshd.about"};
    status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED) out->version = rows.count > 0 ? qm_postgres_integer(&rows, 0, 0) : 0;
    qm_postgres_free(&rows);
    return status;
}

/** Makes the tables unless another node has just done so. */
static qm_stored make_tables(qm_postgres_connection *connection, void *user)
{
    (void)user;
    qm_postgres_rows rows;
    qm_postgres_query lock = {.sql = "SELECT pg_advisory_xact_lock(" LOCK ")"};
    qm_stored status = qm_postgres_execute(connection, &lock, &rows);
    qm_postgres_free(&rows);
    if (status != QM_STORED) return status;
    qm_postgres_query look = {.sql = "SELECT " IS_THERE};
    status = qm_postgres_execute(connection, &look, &rows);
    bool is_there = status == QM_STORED && qm_postgres_bool(&rows, 0, 0);
    qm_postgres_free(&rows);
    if (status != QM_STORED || is_there) return status;
    char sql[sizeof schema + 16];
    snprintf(sql, sizeof sql, schema, VERSION);
    return qm_postgres_command(connection, sql);
}

bool qm_postgres_knows(int64_t version)
{
    return version == VERSION;
}

qm_stored qm_postgres_find_version(qm_store *store, int64_t *version)
{
    facts found = {0};
    qm_stored status = read_facts(store, &found);
    *version = found.version;
    return status;
}

qm_stored qm_postgres_set_up(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    facts found = {0};
    qm_stored status = read_facts(store, &found);
    if (status == QM_STORED && found.server >= OLDEST_SERVER && found.is_utf8 && !found.is_there) {
        status = qm_postgres_transact(store, make_tables, NULL);
        if (status == QM_STORED) status = read_facts(store, &found);
    }
    if (status != QM_STORED)
        snprintf(message, QM_MESSAGE_SIZE, "database: its tables cannot be made or read; the log has more");
    else if (found.server < OLDEST_SERVER)
        snprintf(message, QM_MESSAGE_SIZE, "database: PostgreSQL %d or newer is needed",
                 OLDEST_SERVER / 10000);
    else if (!found.is_utf8)
        snprintf(message, QM_MESSAGE_SIZE, "database: its encoding is not UTF8");
    else if (!qm_postgres_knows(found.version))
        snprintf(message, QM_MESSAGE_SIZE,
                 "database: tables of version %d were made by another version of quadmeshd; this one has %d",
                 (int)found.version, VERSION);
    else
        return QM_STORED;
    return status == QM_STORED ? QM_STORED_FAULT : status;
}
