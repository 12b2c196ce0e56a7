/**
 * store_postgres_schema.c: the tables of a shared store. They lie in a schema of their own, so that the database may
 * hold other things. Times are the database's own: no node's clock is compared with another's.
 */
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "store_postgres.h"

#define OLDEST_SERVER 150000
#define LIVES_S "10" /* after its last beat, a node may be one that runs */

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
static const char first[] =
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
    "INSERT INTO quadmeshd.about VALUES (1)";

/** Searches in parts (store_parts.h); the place of the blobs (store_postgres_places.c), and its objects that no row of
 * blobs names, as they are on their way, or are to go. */
static const char second[] =
    "CREATE TABLE quadmeshd.job_bounds ("
    "  sequence bigint PRIMARY KEY REFERENCES quadmeshd.jobs ON DELETE CASCADE,"
    "  engine text NOT NULL COLLATE \"C\", lower double precision NOT NULL, witness text NOT NULL,"
    "  discarded double precision NOT NULL, iterations bigint NOT NULL, projections bigint NOT NULL)"
    "  WITH (fillfactor = 50, autovacuum_vacuum_scale_factor = 0.01);"
    "CREATE TABLE quadmeshd.job_parts ("
    "  part bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,"
    "  sequence bigint NOT NULL REFERENCES quadmeshd.job_bounds ON DELETE CASCADE,"
    "  upper double precision NOT NULL, entries bytea NOT NULL,"
    "  node text COLLATE \"C\","      /* that runs it; of one that is gone: nobody */
    "  epoch int NOT NULL DEFAULT 0)" /* claims so far */
    "  WITH (autovacuum_vacuum_scale_factor = 0.01);"
    "CREATE INDEX ON quadmeshd.job_parts (sequence, upper DESC);"
    "CREATE TABLE quadmeshd.blob_place (kind text NOT NULL, id text NOT NULL);"
    "CREATE TABLE quadmeshd.blob_objects ("
    "  generation text PRIMARY KEY COLLATE \"C\", is_going boolean NOT NULL DEFAULT false,"
    "  since timestamptz NOT NULL DEFAULT clock_timestamp())";

/** What is known of meshes besides their files; labels stand between line feeds. */
static const char third[] =
    "ALTER TABLE quadmeshd.meshes ADD COLUMN unit text NOT NULL DEFAULT '' COLLATE \"C\","
    "  ADD COLUMN uncertainty double precision NOT NULL DEFAULT 0,"
    "  ADD COLUMN labels text NOT NULL DEFAULT '' COLLATE \"C\"";

/** Labels of jobs, as of meshes. */
static const char fourth[] =
    "ALTER TABLE quadmeshd.jobs ADD COLUMN labels text NOT NULL DEFAULT '' COLLATE \"C\"";

/**
 * Each brings the tables to the next version, the first one to version 1. A step only adds to the tables, so that
 * daemons of the version before go on with them; what it replaces is dropped by the step after it. One that was released is never
 * changed.
 */
static const char *const steps[] = {first, second, third, fourth};
enum { VERSION = sizeof steps / sizeof steps[0] }; /* of these tables */

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

/** What is to become of tables of an earlier version. */
typedef struct migration {
    bool is_asked;  /* by whoever runs the cluster; else only while no node has joined */
    bool is_joined; /* written: by nodes that live */
} migration;

/** True for a query that gives it, on a connection. */
static qm_stored ask(qm_postgres_connection *connection, const char *sql, int64_t *out)
{
    qm_postgres_rows rows;
    qm_postgres_query query = {.sql = sql};
    qm_stored status = qm_postgres_execute(connection, &query, &rows);
    *out = status == QM_STORED && rows.count > 0 ? qm_postgres_integer(&rows, 0, 0) : 0;
    qm_postgres_free(&rows);
    return status;
}

bool qm_postgres_knows(int64_t version)
{
    return version == VERSION || version == VERSION + 1;
}

qm_stored qm_postgres_find_version(qm_store *store, int64_t *version)
{
    facts found = {0};
    qm_stored status = read_facts(store, &found);
    *version = found.version;
    return status;
}

/** Takes the steps that are missing, unless another node has just done so: all of them, or none. */
static qm_stored take_steps(qm_postgres_connection *connection, void *user)
{
    migration *m = user;
    int64_t number = 0, version = 0, nodes = 0;
    qm_stored status = ask(connection, "SELECT 1 FROM pg_advisory_xact_lock(" LOCK ")", &number);
    if (status == QM_STORED)
        status = ask(connection, "SELECT CASE WHEN " IS_THERE " THEN 1 ELSE 0 END", &number);
    if (status == QM_STORED && number > 0) {
        status = ask(connection, "SELECT version FROM quadmeshd.about", &version);
        if (status == QM_STORED)
            status = ask(connection,
                         "SELECT count(*) FROM quadmeshd.nodes JOIN quadmeshd.node_beats USING (id)"
                         " WHERE state = 0 AND beat > clock_timestamp() - interval '" LIVES_S " s'",
                         &nodes);
    }
    m->is_joined = nodes > 0;
    if (status != QM_STORED || version >= VERSION || (m->is_joined && !m->is_asked)) return status;
    for (int64_t i = version; status == QM_STORED && i < VERSION; i++)
        status = qm_postgres_command(connection, steps[i]);
    char sql[64];
    snprintf(sql, sizeof sql, "UPDATE quadmeshd.about SET version = %d", VERSION);
    return status == QM_STORED ? qm_postgres_command(connection, sql) : status;
}

/** Compares what the database is with what this version needs; the status, or QM_STORED_FAULT with a message. */
static qm_stored judge(const facts *found, qm_stored status, const migration *m,
                       char message[QM_MESSAGE_SIZE])
{
    if (status != QM_STORED)
        snprintf(message, QM_MESSAGE_SIZE, "database: its tables cannot be made or read; the log has more");
    else if (found->server < OLDEST_SERVER)
        snprintf(message, QM_MESSAGE_SIZE, "database: PostgreSQL %d or newer is needed",
                 OLDEST_SERVER / 10000);
    else if (!found->is_utf8)
        snprintf(message, QM_MESSAGE_SIZE, "database: its encoding is not UTF8");
    else if (found->version < VERSION && m->is_joined)
        snprintf(
            message, QM_MESSAGE_SIZE,
            "database: its tables have version %d and other daemons run: --migrate makes them version %d, "
            "with which those go on",
            (int)found->version, VERSION);
    else if (!qm_postgres_knows(found->version))
        snprintf(
            message, QM_MESSAGE_SIZE,
            "database: tables of version %d were made by another version of quadmeshd; this one takes %d "
            "and %d",
            (int)found->version, VERSION, VERSION + 1);
    else
        return QM_STORED;
    return status == QM_STORED ? QM_STORED_FAULT : status;
}

qm_stored qm_postgres_set_up(qm_store *store, bool is_asked, char message[QM_MESSAGE_SIZE])
{
    facts found = {0};
    migration m = {.is_asked = is_asked};
    qm_stored status = read_facts(store, &found);
    bool is_fit = status == QM_STORED && found.server >= OLDEST_SERVER && found.is_utf8;
    if (is_fit && (!found.is_there || found.version < VERSION)) {
        int before = (int)found.version;
        status = qm_postgres_transact(store, take_steps, &m);
        if (status == QM_STORED) status = read_facts(store, &found);
        if (status == QM_STORED && before > 0 && before < found.version)
            qm_log(QM_LOG_INFO, "database: tables of version %d are now of version %d", before,
                   (int)found.version);
    }
    return judge(&found, status, &m, message);
}
