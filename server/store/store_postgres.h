/**
 * store_postgres.h: what the files of the driver for a shared store share.
 *
 * A verb is one statement wherever that decides its races; it needs nothing of its session, names every table with
 * its schema, and so works behind a proxy that gives each transaction another session (PgBouncer).
 */
#ifndef QM_STORE_POSTGRES_H
#define QM_STORE_POSTGRES_H

#include <pthread.h>

#include "place.h"
#include "store_driver.h"
#include "store_postgres_library.h"

/* ---- statements (store_postgres_query.c) ---- */

#define QM_POSTGRES_PARAMETERS 32

/** What a connection is for: none of these holds up another. */
typedef enum qm_postgres_use {
    QM_POSTGRES_REQUESTS,
    QM_POSTGRES_PULSE,     /* of the thread that keeps this node alive */
    QM_POSTGRES_TRANSFERS, /* of blobs */
    QM_POSTGRES_USES
} qm_postgres_use;

/** A statement with its parameters, which live until it has run. */
typedef struct qm_postgres_query {
    const char *sql; /* a literal stays prepared, by its address */
    bool is_made;    /* no literal */
    bool is_binary;  /* columns come as bytes: those of the type text are the same */
    bool is_relaxed; /* its commit does not wait for a disk */
    qm_postgres_use use;
    bool failed; /* there was no memory for a parameter */
    /* Set when the statement is sent a second time, as the first one may have been done; also told by the
     * parameter that qm_postgres_add_repeated has added. */
    bool is_repeated;
    int repeated_parameter;
    int count;
    const char *values[QM_POSTGRES_PARAMETERS];
    int sizes[QM_POSTGRES_PARAMETERS], formats[QM_POSTGRES_PARAMETERS];
    char numbers[QM_POSTGRES_PARAMETERS][QM_NUMBER_SIZE];
} qm_postgres_query;

/** Add the next parameter. NULL is an SQL null. */
void qm_postgres_add_text(qm_postgres_query *query, const char *text);
void qm_postgres_add_integer(qm_postgres_query *query, int64_t number);
void qm_postgres_add_real(qm_postgres_query *query, double number);
void qm_postgres_add_bool(qm_postgres_query *query, bool value);
void qm_postgres_add_bytes(qm_postgres_query *query, const void *bytes, size_t size);
void qm_postgres_add_now(qm_postgres_query *query); /* by qm_clock_format_steady */
void qm_postgres_add_repeated(qm_postgres_query *query);

/** An array is written as text, element by element, and then added; qm_text_reset frees it. */
void qm_postgres_write_text(qm_text *array, const char *text);
/** Writes the subjects of a job, which are separated by blanks, each once. */
void qm_postgres_write_subjects(qm_text *array, const char *subjects);
void qm_postgres_write_integer(qm_text *array, int64_t number);
void qm_postgres_add_array(qm_postgres_query *query, qm_text *array);

/** What a statement has returned; to be freed, also after a fault. */
typedef struct qm_postgres_rows {
    PGresult *result;
    int count;
} qm_postgres_rows;
void qm_postgres_free(qm_postgres_rows *rows);

/** Columns of a row. The text lives as long as the rows; NULL for an SQL null. */
const char *qm_postgres_text(const qm_postgres_rows *rows, int row, int column);
int64_t qm_postgres_integer(const qm_postgres_rows *rows, int row, int column);
double qm_postgres_real(const qm_postgres_rows *rows, int row, int column);
bool qm_postgres_bool(const qm_postgres_rows *rows, int row, int column);
size_t qm_postgres_size(const qm_postgres_rows *rows, int row, int column);

/** Copies a column to the heap; NULL for an SQL null. False: out of memory. */
bool qm_postgres_copy(const qm_postgres_rows *rows, int row, int column, char **out);

/** Copies the first size - 1 bytes of a column; "" for an SQL null. */
void qm_postgres_read(const qm_postgres_rows *rows, int row, int column, char *out, size_t size);

/** How rows of a table are read into structs of the caller. */
typedef struct qm_postgres_table {
    size_t size;                                                    /* of a struct */
    bool (*read)(const qm_postgres_rows *rows, int row, void *out); /* false, and nothing to reset: out of
                                                                       memory */
    void (*reset)(void *out);
} qm_postgres_table;

/** Runs a statement that returns one row, or none (QM_STORED_NONE). */
qm_stored qm_postgres_find_row(qm_store *store, qm_postgres_query *query, const qm_postgres_table *table,
                               void *out);

/** The same with one text as its parameter. */
qm_stored qm_postgres_find_row_by(qm_store *store, const char *sql, const char *text,
                                  const qm_postgres_table *table, void *out);

/** A query for pages: SELECT ... FROM ..., its column of sequence numbers, conditions "column = $" with a text each,
 * of which those whose value is NULL are left out, and one without a value, or NULL. */
#define QM_POSTGRES_CONDITIONS 3
typedef struct qm_postgres_listing {
    const char *select, *sequence;
    const char *conditions[QM_POSTGRES_CONDITIONS];
    const char *values[QM_POSTGRES_CONDITIONS];
    const char *condition;
} qm_postgres_listing;
qm_stored qm_postgres_list_rows(qm_store *store, const qm_postgres_listing *listing,
                                const qm_store_page *page, const qm_postgres_table *table, void *out,
                                size_t *count);

/** Runs a statement that changes a row, and returns one when it has; else QM_STORED_NONE. */
qm_stored qm_postgres_change_row(qm_store *store, qm_postgres_query *query);

/**
 * Runs a statement that inserts a row with an id, and returns one when it has. Else another row of this id
 * (QM_STORED), which `find` looks for, or of its other unique columns (QM_STORED_TAKEN) was there.
 */
qm_stored qm_postgres_create_row(qm_store *store, qm_postgres_query *query, const char *find, const char *id);

/** Runs a statement that deletes the row of an id, and returns a row for it. */
qm_stored qm_postgres_delete_row(qm_store *store, const char *sql, const char *id);

/** The idempotency record that a statement with one text finds. */
qm_stored qm_postgres_find_record(qm_store *store, const char *sql, const char *key,
                                  qm_store_idempotency_record *out);

/* ---- connections (store_postgres_pool.c) ---- */

typedef struct qm_postgres_connection qm_postgres_connection;

/**
 * Runs a statement on a free connection, and once more on a new one when the first breaks. QM_STORED with rows, which
 * may be none; QM_STORED_TAKEN after a violation of uniqueness, QM_STORED_LATE after one of a reference: nothing was
 * changed; else a fault.
 */
qm_stored qm_postgres_run(qm_store *store, qm_postgres_query *query, qm_postgres_rows *rows);

/**
 * Runs the statements of a function in a transaction on a connection for transfers, which is committed when it returns QM_STORED; from the start
 * once more when the connection breaks.
 */
typedef qm_stored qm_postgres_body(qm_postgres_connection *connection, void *user);
qm_stored qm_postgres_transact(qm_store *store, qm_postgres_body *body, void *user);

/** Runs a statement of a transaction; or several without parameters and rows. */
qm_stored qm_postgres_execute(qm_postgres_connection *connection, qm_postgres_query *query,
                              qm_postgres_rows *rows);
qm_stored qm_postgres_command(qm_postgres_connection *connection, const char *sql);

/**
 * Has all statements until the end of the snapshot read the database as it is at the first of them, on one connection:
 * from one thread, and nothing is written. When the connection breaks, each statement returns QM_STORED_AWAY.
 */
qm_stored qm_postgres_begin_snapshot(qm_store *store);
void qm_postgres_end_snapshot(qm_store *store);

/**
 * Returns a status once all that was committed before is as durable as a commit can be. For answers that have found
 * a row and written nothing: a read waits for no standby, and the commit that wrote the row may still do so.
 */
qm_stored qm_postgres_confirm(qm_store *store, qm_stored status);

/* ---- the database as a whole ---- */

/** Name of a node, and jobs that wait for it. */
typedef struct qm_postgres_home {
    char name[QM_NODE_NAME_SIZE];
    int64_t waiting;
} qm_postgres_home;

/** A job that this process has, or that is over while a claim is under way. */
typedef struct qm_postgres_claim {
    char id[QM_ID_SIZE];
    bool is_over;
} qm_postgres_claim;

struct qm_postgres {
    struct qm_postgres_pool *pool;
    qm_place *place;               /* of the blobs */
    struct qm_postgres_bell *bell; /* of a node that watches, or NULL */
    qm_store_node self;            /* its version is a copy */
    pthread_mutex_t lock;          /* guards what follows */
    char node[QM_NODE_NAME_SIZE + 16];
    qm_postgres_home *homes; /* nodes that take work, as of the last beat */
    size_t home_count;
    qm_postgres_claim *claims;
    size_t claim_count, claim_capacity;
    bool is_claiming; /* the pulse asks for jobs */
};

/** The id of this start of the process. */
void qm_postgres_name_node(qm_store *store, char out[QM_NODE_NAME_SIZE + 16]);

/** Opens the connections; the first one at once, so that a fault has a message. A reader has that one alone. */
qm_stored qm_postgres_open_pool(qm_store *store, const char *address, bool is_reader,
                                char message[QM_MESSAGE_SIZE]);
void qm_postgres_close_pool(qm_store *store);

/** A connection of the caller's own, with the settings of the pool; NULL with a message. */
PGconn *qm_postgres_connect(qm_store *store, char message[QM_MESSAGE_SIZE]);

/**
 * Tells the other nodes at once (store_postgres_bell.c) what they would find out by asking: about count jobs, or for QUEUED
 * of the node of a name. Never durable, and nothing is said when it fails.
 */
void qm_postgres_ring(qm_store *store, qm_store_news news, const char *const *subjects, size_t count,
                      qm_postgres_use use);
void qm_postgres_watch(qm_store *store, qm_store_news_fn *tell, void *user);
void qm_postgres_unwatch(qm_store *store);

/** Name and version of the database, as of its last connection. */
void qm_postgres_name_engine(qm_store *store, char out[64]);

/** A store at an address that no node joins, with a pool, for qm_store_close; folder "" for none. */
qm_stored qm_postgres_visit(const char *address, const qm_store_node *self, const char *folder,
                            bool is_reader, qm_store **out, char message[QM_MESSAGE_SIZE]);

/** Version of the tables; 0: there are none. */
qm_stored qm_postgres_find_version(qm_store *store, int64_t *version);
/** True for a version that this program uses. */
bool qm_postgres_knows(int64_t version);

/** Makes the tables when there are none, and brings those of an earlier version up to date: when it is asked to, or
 * while no node has joined. Else refuses these, and those of a version after the next. */
qm_stored qm_postgres_set_up(qm_store *store, bool is_asked, char message[QM_MESSAGE_SIZE]);

/**
 * Opens the place of the blobs that the node is to use (store_postgres_places.c). The first node decides for the store;
 * another place is refused, with a message.
 */
qm_stored qm_postgres_open_place(qm_store *store, char message[QM_MESSAGE_SIZE]);

/** The same for who only reads, by the snapshot: nothing is decided. */
qm_stored qm_postgres_open_place_to_read(qm_store *store, char message[QM_MESSAGE_SIZE]);

/** The place that is the database (store_postgres_chunks.c). */
qm_stored qm_postgres_open_chunks(qm_store *store, qm_place **out, char message[QM_MESSAGE_SIZE]);

/** An SQL expression: how durable a commit is, as a number of qm_store_durability. */
#define QM_POSTGRES_DURABILITY                                                                               \
    "CASE WHEN current_setting('fsync') = 'off' OR current_setting('full_page_writes') = 'off'"              \
    "  OR current_setting('synchronous_commit') = 'off' THEN 0"                                              \
    " WHEN current_setting('synchronous_standby_names') = ''"                                                \
    "  OR current_setting('synchronous_commit') = 'local' THEN 1 ELSE 2 END"

/** An SQL expression: an interval of seconds, which is a parameter. */
#define QM_POSTGRES_SECONDS(parameter) "make_interval(secs => " parameter "::float8)"

/** A member of WITH: a row that says that the commit need not wait for the disk. Its reader makes it so. */
#define QM_POSTGRES_RELAXED                                                                                  \
    "relaxed AS MATERIALIZED (SELECT set_config('synchronous_commit', 'off', true) AS mode)"

/* ---- parts of statements ---- */

/** Adds the parameters 1 to 14, a mesh, or nulls for NULL; QM_POSTGRES_MESH_VALUES are its columns. */
void qm_postgres_add_mesh(qm_postgres_query *query, const qm_store_mesh *mesh);
#define QM_POSTGRES_MESH_COLUMNS                                                                             \
    "id, hash, options, name, document, format, revision, positions, created, expires, unit, uncertainty, "  \
    "labels"
#define QM_POSTGRES_MESH_VALUES                                                                              \
    "$1::text, $2::text, $3::text, $4::text, $5::text, $6::smallint, $7::bigint, nullif($8::text, ''),"      \
    " $9::text, clock_timestamp() + make_interval(secs =>"                                                   \
    "   extract(epoch FROM nullif($10::text, '')::timestamptz - $11::timestamptz)::float8), $12::text,"      \
    " $13::float8, $14::text"
/** A member of WITH: the blobs of the mesh stay. */
#define QM_POSTGRES_MESH_BLOBS                                                                               \
    "blobs AS (UPDATE quadmeshd.blobs SET unneeded = NULL WHERE hash IN ($2, $8) AND unneeded IS NOT NULL)"

/** A time by the clock of this process, as one by that of the database: equally far from now. */
#define QM_POSTGRES_TIME(time, now)                                                                          \
    "clock_timestamp() + make_interval(secs =>"                                                              \
    "  extract(epoch FROM " time "::timestamptz - " now "::timestamptz)::float8)"

/** The columns of a job, of the tables below, and how they are read into a qm_store_job. The state of a job that has not
 * ended is told by where it is. */
#define QM_POSTGRES_JOB_COLUMNS                                                                              \
    "j.id, j.key, j.idempotency_key, j.body, j.created,"                                                     \
    " CASE WHEN r.sequence IS NULL THEN j.state ELSE 1 END, j.sequence, j.document,"                         \
    " coalesce(r.epoch - 1, q.epoch, j.restarts), j.result, coalesce(r.deaths, q.deaths, 0), r.progress, "   \
    "j.labels"
#define QM_POSTGRES_JOB_PLACES                                                                               \
    " LEFT JOIN quadmeshd.job_runs r ON r.sequence = j.sequence"                                             \
    " LEFT JOIN quadmeshd.job_queue q ON q.sequence = j.sequence"
bool qm_postgres_read_job(const qm_postgres_rows *rows, int row, void *out);

/** Adds the parameters 1 to 21: an effect, or nulls. Members of WITH, which need rows of `ready` to be done once:
 * the mesh of the effect, and its reconstruction. */
void qm_postgres_add_effect(qm_postgres_query *query, const qm_store_effect *effect);
#define QM_POSTGRES_EFFECT_TARGET                                                                            \
    "target AS (SELECT id FROM quadmeshd.reconstructions"                                                    \
    "  WHERE id = $15::text AND revision = $16::bigint - 1 FOR UPDATE)"
#define QM_POSTGRES_EFFECT                                                                                   \
    QM_POSTGRES_MESH_BLOBS ", mesh AS (INSERT INTO quadmeshd.meshes (" QM_POSTGRES_MESH_COLUMNS              \
                           ")  SELECT " QM_POSTGRES_MESH_VALUES " FROM ready WHERE $1::text IS NOT NULL),"   \
                           " applied AS (UPDATE quadmeshd.reconstructions r SET mesh = $17, layout = $18,"   \
                           "  steps = $19, records = $20, state = $21, revision = $16::bigint FROM ready"    \
                           "  WHERE r.id = $15::text)"

/** Events as three arrays, of their numbers, names and members, which live until the statement has run. */
typedef struct qm_postgres_events {
    qm_text seqs, names, members;
} qm_postgres_events;
void qm_postgres_write_events(qm_postgres_events *arrays, const qm_store_event *events, size_t count);
/** Adds three parameters. */
void qm_postgres_add_events(qm_postgres_query *query, qm_postgres_events *arrays);
void qm_postgres_events_reset(qm_postgres_events *arrays);

/** The columns of the current revision of a layout, of l and r, and how they are read into a qm_store_layout. */
#define QM_POSTGRES_LAYOUT_COLUMNS                                                                           \
    "l.id, l.mesh, l.created, r.layout, r.issues, r.revision, r.next_curve, l.sequence, l.first, l.latest,"  \
    " r.is_complete"
bool qm_postgres_read_layout(const qm_postgres_rows *rows, int row, void *out);

/**
 * The claims that this process knows of (store_postgres_claims.c). The answer to a claim may get lost: the next one
 * also returns the jobs of this node that are not among these. Adding one returns false when there is no memory.
 */
bool qm_postgres_add_claim(qm_store *store, const char *id);
void qm_postgres_remove_claim(qm_store *store, const char *id);
void qm_postgres_remove_claims(qm_store *store);
/** Begins a claim, one at a time, and writes the jobs that it is to tell. */
void qm_postgres_begin_claiming(qm_store *store, qm_text *array);
/** True for a job that was known when the claim began, or has been added since. */
bool qm_postgres_has_claim(qm_store *store, const char *id);
void qm_postgres_end_claiming(qm_store *store);

/* ---- verbs; store.h says what they do ---- */

qm_stored qm_postgres_put_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_stored qm_postgres_find_mesh(qm_store *store, const char *id, qm_store_mesh *out);
qm_stored qm_postgres_find_mesh_states(qm_store *store, const char *const *ids, size_t count,
                                       qm_store_mesh_state *out);
qm_stored qm_postgres_find_undeformed(qm_store *store, const char *const *hashes, size_t count,
                                      char (*ids)[QM_ID_SIZE]);
qm_stored qm_postgres_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                           qm_store_mesh *out);
qm_stored qm_postgres_list_meshes(qm_store *store, const qm_store_page *page,
                                  const qm_store_mesh_filter *filter, qm_store_mesh *out, size_t *count);
qm_stored qm_postgres_revise_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_stored qm_postgres_set_notes(qm_store *store, const qm_store_mesh *mesh);
qm_stored qm_postgres_set_expiry(qm_store *store, const char *id, const char *expires);
qm_stored qm_postgres_find_expired_mesh(qm_store *store, const char *before, qm_store_mesh *out);
qm_stored qm_postgres_delete_mesh(qm_store *store, const char *id);
qm_stored qm_postgres_submit_job(qm_store *store, const qm_store_submission *submission);
qm_stored qm_postgres_claim_jobs(qm_store *store, const qm_store_wish *wish, qm_store_job *out,
                                 size_t *count);
qm_stored qm_postgres_begin_job(qm_store *store, const char *id);
qm_stored qm_postgres_note_cancel(qm_store *store, const char *id);
qm_stored qm_postgres_append_events(qm_store *store, qm_store_run *runs, size_t run_count,
                                    const qm_store_event *events, size_t count);
qm_stored qm_postgres_finish_job(qm_store *store, const qm_store_job *end, const char *revisions,
                                 const qm_store_event *events, size_t count, const qm_store_effect *effect);
qm_stored qm_postgres_leave_jobs(qm_store *store);
qm_stored qm_postgres_read_events(qm_store *store, const char *id, uint64_t after, qm_store_event_fn *take,
                                  void *user);
qm_stored qm_postgres_find_job(qm_store *store, const char *id, qm_store_job *out);
qm_stored qm_postgres_find_job_by_key(qm_store *store, const char *key, const char *revisions,
                                      qm_job_state state, qm_store_job *out);
qm_stored qm_postgres_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out);
qm_stored qm_postgres_set_job_labels(qm_store *store, const char *id, const char *labels);
qm_stored qm_postgres_forget_answer(qm_store *store, const char *id);
qm_stored qm_postgres_list_jobs(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                                qm_store_job *out, size_t *count);
qm_stored qm_postgres_drop_old_jobs(qm_store *store, size_t kept, double kept_s, size_t limit,
                                    char (*ids)[QM_ID_SIZE], size_t *count);
qm_stored qm_postgres_delete_job(qm_store *store, const char *id);
qm_stored qm_postgres_put_array(qm_store *store, const char *job_id, const qm_store_array *array);
qm_stored qm_postgres_find_array(qm_store *store, const char *job_id, qm_store_array *out);
qm_stored qm_postgres_open_parts(qm_store *store, const char *job, int64_t restarts,
                                 const qm_store_bounds *bounds, const qm_store_part *parts, size_t count);
qm_stored qm_postgres_claim_parts(qm_store *store, const char *job, size_t limit, qm_store_part *out,
                                  size_t *count);
qm_stored qm_postgres_finish_parts(qm_store *store, const char *job, const qm_store_part *parts, size_t count,
                                   const qm_store_bounds *found, const qm_store_part *rest,
                                   size_t rest_count);
qm_stored qm_postgres_raise_lower(qm_store *store, const char *job, double lower, const char *witness);
qm_stored qm_postgres_read_bounds(qm_store *store, const char *job, const qm_store_part *claimed,
                                  size_t count, qm_store_bounds *out);
qm_stored qm_postgres_find_split_job(qm_store *store, const char (*except)[QM_ID_SIZE], size_t count,
                                     qm_store_job *out);
qm_stored qm_postgres_put_layout(qm_store *store, const qm_store_layout *layout,
                                 const qm_store_idempotency *idempotency);
qm_stored qm_postgres_find_layout(qm_store *store, const char *id, qm_store_layout *out);
qm_stored qm_postgres_find_layout_by_idempotency_key(qm_store *store, const char *key,
                                                     qm_store_idempotency_record *out);
qm_stored qm_postgres_list_layouts(qm_store *store, const qm_store_page *page, const char *mesh,
                                   qm_store_layout *out, size_t *count);
qm_stored qm_postgres_edit_layout(qm_store *store, const qm_store_layout *layout);
qm_stored qm_postgres_move_layout(qm_store *store, const char *id, int64_t from, int64_t to);
qm_stored qm_postgres_delete_layout(qm_store *store, const char *id);
qm_stored qm_postgres_put_reconstruction(qm_store *store, const qm_store_reconstruction *reconstruction,
                                         const qm_store_mesh *mesh, const qm_store_idempotency *idempotency);
qm_stored qm_postgres_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out);
qm_stored qm_postgres_find_reconstruction_by_idempotency_key(qm_store *store, const char *key,
                                                             qm_store_idempotency_record *out);
qm_stored qm_postgres_list_reconstructions(qm_store *store, const qm_store_page *page, const char *source,
                                           qm_store_reconstruction *out, size_t *count);
qm_stored qm_postgres_update_reconstruction(qm_store *store, const qm_store_effect *effect);
qm_stored qm_postgres_delete_reconstruction(qm_store *store, const char *id);
qm_stored qm_postgres_beat(qm_store *store, size_t free_workers, qm_store_cluster *out,
                           qm_store_durable_fn *take, void *user);
qm_stored qm_postgres_join(qm_store *store);
qm_stored qm_postgres_reap(qm_store *store, double silence_s, size_t *count);
qm_stored qm_postgres_find_home(qm_store *store, const char *id, char out[QM_NODE_NAME_SIZE]);
qm_stored qm_postgres_cancel_job(qm_store *store, const char *id, const char *document,
                                 const qm_store_event *last);
qm_stored qm_postgres_hold_job(qm_store *store, const char *id, int owners, bool is_kept, bool *is_unwanted);
qm_stored qm_postgres_look_at_jobs(qm_store *store, qm_store_look *looks, size_t count,
                                   qm_store_event_fn *take, void *user);
qm_stored qm_postgres_put_blob(qm_store *store, const char *hash, int file, bool is_repair);
qm_stored qm_postgres_get_blob(qm_store *store, const char *hash, int file);
qm_stored qm_postgres_clean_blobs(qm_store *store, double delay_s);
qm_stored qm_postgres_list_orphans(qm_store *store, const char *after, size_t limit,
                                   char (*hashes)[QM_HASH_SIZE], size_t *count);
qm_stored qm_postgres_list_job_copies(qm_store *store, const qm_store_page *page, qm_store_job_copy *out,
                                      size_t *count);
qm_stored qm_postgres_put_job_copy(qm_store *store, const qm_store_job_copy *copy,
                                   const qm_store_event *events, size_t count, const qm_store_array *array);
qm_stored qm_postgres_list_layout_revisions(qm_store *store, const char *id, const qm_store_page *page,
                                            qm_store_layout *out, size_t *count);
qm_stored qm_postgres_put_layout_copy(qm_store *store, const qm_store_layout *revisions, size_t count,
                                      int64_t current, const qm_store_idempotency *idempotency);
qm_stored qm_postgres_find_layout_origin(qm_store *store, const char *id, qm_store_origin *out);
qm_stored qm_postgres_find_reconstruction_origin(qm_store *store, const char *id, qm_store_origin *out);
qm_stored qm_postgres_identify(qm_store *store, char out[QM_STORE_IDENTITY_SIZE]);
qm_stored qm_postgres_sync(qm_store *store);

#endif
