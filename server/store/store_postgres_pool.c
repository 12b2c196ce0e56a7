/**
 * store_postgres_pool.c: connections to the database, and how statements run on them.
 *
 * A thread of its own opens connections, for that blocks for as long as names and hosts take. A verb takes one that is
 * open, or waits for it, and ends at its deadline in any case. A statement is never cancelled, which could make a
 * commit visible before a standby has it: the connection is closed instead.
 */
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/failpoint.h"
#include "base/log.h"
#include "store_postgres.h"

/* Connections by their use. */
static const qm_postgres_use uses[] = {QM_POSTGRES_REQUESTS,  QM_POSTGRES_REQUESTS, QM_POSTGRES_REQUESTS,
                                       QM_POSTGRES_REQUESTS,  QM_POSTGRES_PULSE,    QM_POSTGRES_PULSE,
                                       QM_POSTGRES_TRANSFERS, QM_POSTGRES_TRANSFERS};
#define CONNECTIONS (sizeof uses / sizeof uses[0])
#define WAITERS 16            /* verbs that wait for a connection; more fail at once */
#define DEADLINE_MS 5000.0    /* of a verb, and of each statement of a transaction */
#define LEAST_MS 1000.0       /* for a statement, however long its verb has waited for a connection */
#define TRANSFER_WAIT_MS 30e3 /* for a connection: blobs take long */
#define STATEMENTS 96         /* more than the driver has */
#define FIRST_DELAY_MS 50.0   /* before connecting again; doubles up to the last one */
#define LAST_DELAY_MS 1000.0

typedef enum connection_state { CLOSED, FREE, IN_USE } connection_state;

struct qm_postgres_connection {
    PGconn *link;
    connection_state state;
    qm_postgres_use use;
    uint64_t generation; /* of the pool, when it was opened */
    uint64_t confirmed;  /* doubts of the pool, when all commits before were known to be durable */
    double deadline_ms;  /* of the statement that runs */
    bool is_prepared;    /* statements stay so */
    bool is_broken, is_worth_repeating, is_in_doubt; /* since the last statement began */
    const char *prepared[STATEMENTS];
    size_t prepared_count;
};

typedef struct qm_postgres_pool {
    pthread_mutex_t lock;   /* guards what follows, but for connections in use */
    pthread_cond_t freed;   /* a connection has become free, or the pool closes */
    pthread_cond_t changed; /* there is something to open, or the pool closes */
    qm_postgres_connection connections[CONNECTIONS];
    size_t waiters[QM_POSTGRES_USES];
    uint64_t generation; /* connections of earlier ones are closed: one of them was found broken */
    uint64_t doubts;     /* commits of which nobody knows how durable they are */
    bool is_unprepared;  /* a proxy gives each transaction another session, without its statements */
    bool is_away;        /* the last attempt to connect has failed */
    bool is_closing, has_thread;
    pthread_t thread;
    qm_postgres_connection *snapshot; /* all statements run on it, of one thread; or NULL */
    bool is_reader; /* one connection, which is not opened again, and may show what is not durable */
    char *address;
    char application[QM_NODE_NAME_SIZE + 16];
    char engine[64];
} qm_postgres_pool;

/* ---- one connection ---- */

/**
 * PostgreSQL answers a commit whose wait for a standby was cancelled like any other, after a warning, which is told by
 * the function that sends it, as its text is translated.
 */
static void take_notice(void *user, const PGresult *notice)
{
    qm_postgres_connection *connection = user;
    const char *function = qm_pq.resultErrorField(notice, PG_DIAG_SOURCE_FUNCTION);
    const char *code = qm_pq.resultErrorField(notice, PG_DIAG_SQLSTATE);
    bool is_warning = code && (strcmp(code, "01000") == 0 || strcmp(code, "57P01") == 0);
    if (function ? strcmp(function, "SyncRepWaitForLSN") == 0 : is_warning) connection->is_in_doubt = true;
}

static double next_deadline(void)
{
    return qm_clock_now_ms() + DEADLINE_MS;
}

/** Waits for the socket; false at the deadline. */
static bool wait_for(const qm_postgres_connection *connection, short events)
{
    struct pollfd socket = {.fd = qm_pq.socket(connection->link), .events = events};
    for (;;) {
        double left_ms = connection->deadline_ms - qm_clock_now_ms();
        if (left_ms <= 0.0 || socket.fd < 0) return false;
        int ready = poll(&socket, 1, (int)left_ms + 1);
        if (ready > 0) return true;
        if (ready < 0 && errno != EINTR) return false;
    }
}

/** Notes that the connection cannot be used again. */
static qm_stored lose(qm_postgres_connection *connection, bool is_worth_repeating)
{
    connection->is_broken = true;
    connection->is_worth_repeating = is_worth_repeating;
    return QM_STORED_AWAY;
}

/** Sends what libpq holds, and reads until a result is whole, which is NULL after the last one. QM_STORED or AWAY. */
static qm_stored receive(qm_postgres_connection *connection, PGresult **out)
{
    int unsent;
    while ((unsent = qm_pq.flush(connection->link)) > 0) {
        if (!wait_for(connection, POLLIN | POLLOUT)) return lose(connection, false);
        if (!qm_pq.consumeInput(connection->link)) return lose(connection, true);
    }
    if (unsent < 0) return lose(connection, true);
    while (qm_pq.isBusy(connection->link)) {
        if (!wait_for(connection, POLLIN)) {
            qm_log(QM_LOG_WARN, "database: no answer within %.0f s", 1e-3 * DEADLINE_MS);
            return lose(connection, false);
        }
        if (!qm_pq.consumeInput(connection->link)) return lose(connection, true);
    }
    *out = qm_pq.getResult(connection->link);
    return QM_STORED;
}

static bool has_class(const char *code, const char *class)
{
    return strncmp(code, class, strlen(class)) == 0;
}

/** What an error of the database means for a verb. Values of rows may stand in its details: they are not logged. */
static qm_stored status_of(qm_postgres_connection *connection, const PGresult *error)
{
    const char *code = qm_pq.resultErrorField(error, PG_DIAG_SQLSTATE);
    if (!code || has_class(code, "08") || has_class(code, "57P") || strcmp(code, "25006") == 0)
        return lose(connection, true); /* also a primary that has become a standby */
    if (strcmp(code, "23505") == 0) return QM_STORED_TAKEN;
    if (strcmp(code, "23503") == 0) return QM_STORED_LATE;
    /* A conflict with another transaction, or a statement that another session has prepared, or this one has not. */
    connection->is_worth_repeating = strcmp(code, "40001") == 0 || strcmp(code, "40P01") == 0;
    if (strcmp(code, "26000") == 0 || strcmp(code, "42P05") == 0) {
        connection->is_worth_repeating = true;
        connection->is_prepared = false;
    }
    if (connection->is_worth_repeating) return QM_STORED_AWAY;
    const char *text = qm_pq.resultErrorField(error, PG_DIAG_MESSAGE_PRIMARY);
    qm_log(QM_LOG_ERROR, "database: error %s: %s", code, text && !has_class(code, "22") ? text : "a value");
    if (strcmp(code, "53100") == 0) return QM_STORED_NO_ROOM;
    if (has_class(code, "XX00")) return QM_STORED_DAMAGED;
    return has_class(code, "53") || strcmp(code, "57014") == 0 ? QM_STORED_AWAY : QM_STORED_FAULT;
}

/** Reads all results of what was sent; rows, or NULL, are those of the last one. */
static qm_stored read_results(qm_postgres_connection *connection, qm_postgres_rows *rows)
{
    qm_stored status = QM_STORED;
    for (PGresult *result;;) {
        qm_stored received = receive(connection, &result);
        if (received != QM_STORED) return received;
        if (!result) break;
        ExecStatusType kind = qm_pq.resultStatus(result);
        bool is_good = kind == PGRES_TUPLES_OK || kind == PGRES_COMMAND_OK;
        if (!is_good && status == QM_STORED) status = status_of(connection, result);
        if (!is_good || !rows) {
            qm_pq.clear(result);
            continue;
        }
        qm_postgres_free(rows);
        *rows = (qm_postgres_rows){result, qm_pq.ntuples(result)};
    }
    if (qm_pq.status(connection->link) != CONNECTION_OK) return lose(connection, true);
    return status == QM_STORED && connection->is_in_doubt ? QM_STORED_AWAY : status;
}

static void begin_statement(qm_postgres_connection *connection, double deadline_ms)
{
    connection->deadline_ms = deadline_ms;
    connection->is_worth_repeating = connection->is_in_doubt = false;
}

/** Runs statements without parameters and results. */
static qm_stored command(qm_postgres_connection *connection, const char *sql, double deadline_ms)
{
    begin_statement(connection, deadline_ms);
    if (!qm_pq.sendQuery(connection->link, sql)) return lose(connection, true);
    return read_results(connection, NULL);
}

/** The name of a prepared statement is a hash (FNV-1a) of its text: behind a proxy, whose sessions have the statements
 * of several processes, it is that of no other text. */
static void print_name(const char *sql, char out[24])
{
    uint64_t hash = 14695981039346656037u;
    for (const char *c = sql; *c; c++)
        hash = (hash ^ (unsigned char)*c) * 1099511628211u;
    snprintf(out, 24, "qm_%016" PRIx64, hash);
}

/** Prepares a statement unless this connection has done so. */
static qm_stored prepare(qm_postgres_connection *connection, const char *sql, char name[24])
{
    print_name(sql, name);
    for (size_t i = 0; i < connection->prepared_count; i++)
        if (connection->prepared[i] == sql) return QM_STORED;
    QM_ASSERT(connection->prepared_count < STATEMENTS);
    if (connection->prepared_count == STATEMENTS) abort();
    if (!qm_pq.sendPrepare(connection->link, name, sql, 0, NULL)) return lose(connection, true);
    qm_stored status = read_results(connection, NULL);
    if (status == QM_STORED) connection->prepared[connection->prepared_count++] = sql;
    return status;
}

static qm_stored run_on(qm_postgres_connection *connection, qm_postgres_query *query, qm_postgres_rows *rows)
{
    *rows = (qm_postgres_rows){0};
    char name[24];
    bool is_prepared = connection->is_prepared && !query->is_made;
    qm_stored status = is_prepared ? prepare(connection, query->sql, name) : QM_STORED;
    if (status != QM_STORED) return status;
    int sent = is_prepared
                   ? qm_pq.sendQueryPrepared(connection->link, name, query->count, query->values,
                                             query->sizes, query->formats, query->is_binary)
                   : qm_pq.sendQueryParams(connection->link, query->sql, query->count, NULL, query->values,
                                           query->sizes, query->formats, query->is_binary);
    if (!sent) return lose(connection, true);
    status = read_results(connection, rows);
    if (status != QM_STORED) qm_postgres_free(rows);
    return status;
}

qm_stored qm_postgres_execute(qm_postgres_connection *connection, qm_postgres_query *query,
                              qm_postgres_rows *rows)
{
    *rows = (qm_postgres_rows){0};
    if (query->failed) return QM_STORED_NO_MEMORY;
    begin_statement(connection, next_deadline());
    return run_on(connection, query, rows);
}

qm_stored qm_postgres_command(qm_postgres_connection *connection, const char *sql)
{
    return command(connection, sql, next_deadline());
}

/* A message in the log of the database, which no row and no table holds, is the smallest commit that is durable. */
#define CONFIRMATION "SELECT pg_logical_emit_message(true, 'quadmeshd', '')"
static const char confirmation[] = CONFIRMATION;

/* PostgreSQL would plan statements with arrays anew each time, as it takes longer ones for likely: that takes longer
 * than to run them. Behind a proxy the setting may get lost, and only time with it. */
#define SETTINGS "SET plan_cache_mode = force_generic_plan; "
static const char first_statements[] = SETTINGS CONFIRMATION, first_statements_of_reader[] = SETTINGS;

/* ---- opening ---- */

static void close_link(qm_postgres_connection *connection)
{
    if (connection->link) qm_pq.finish(connection->link);
    connection->link = NULL;
    connection->prepared_count = 0;
}

/** The first line of libpq's message, for the log of the daemon. */
static void print_failure(const PGconn *link, char message[QM_MESSAGE_SIZE])
{
    const char *text = link ? qm_pq.errorMessage(link) : "out of memory";
    int length = (int)strcspn(text, "\n");
    snprintf(message, QM_MESSAGE_SIZE, "database: %.*s", length > 200 ? 200 : length, text);
}

/** Connects; NULL with a message. The address may replace the settings before it, not those after. */
static PGconn *connect_to(const qm_postgres_pool *pool, char message[QM_MESSAGE_SIZE])
{
    const char *const settings[][2] = {{"connect_timeout", "3"}, /* seconds, as the next two */
                                       {"keepalives_idle", "5"},
                                       {"keepalives_interval", "2"},
                                       {"tcp_user_timeout", "5000"}, /* ms */
                                       {"application_name", pool->application},
                                       {"dbname", pool->address},
                                       {"target_session_attrs", "read-write"},
                                       {"client_encoding", "UTF8"}};
    enum { COUNT = sizeof settings / sizeof settings[0] };
    const char *names[COUNT + 1] = {NULL}, *values[COUNT + 1] = {NULL};
    for (int i = 0; i < COUNT; i++)
        names[i] = settings[i][0], values[i] = settings[i][1];
    PGconn *link = qm_pq.connectdbParams(names, values, 1);
    if (qm_pq.status(link) == CONNECTION_OK) return link;
    print_failure(link, message);
    qm_pq.finish(link);
    return NULL;
}

PGconn *qm_postgres_connect(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    return connect_to(store->postgres->pool, message);
}

/** Opens a connection, and waits until all that it shows is durable: a primary that has come back may show what no
 * standby has. */
static bool open_connection(qm_postgres_pool *pool, qm_postgres_connection *connection,
                            char message[QM_MESSAGE_SIZE])
{
    pthread_mutex_lock(&pool->lock);
    uint64_t generation = pool->generation, doubts = pool->doubts;
    bool is_prepared = !pool->is_unprepared;
    pthread_mutex_unlock(&pool->lock);
    close_link(connection);
    connection->link = connect_to(pool, message);
    if (!connection->link) return false;
    qm_pq.setNoticeReceiver(connection->link, take_notice, connection);
    connection->is_broken = false;
    if (qm_pq.setnonblocking(connection->link, 1) != 0) {
        close_link(connection);
        return false;
    }
    const char *first = pool->is_reader ? first_statements_of_reader : first_statements;
    if (command(connection, first, next_deadline()) != QM_STORED) {
        snprintf(message, QM_MESSAGE_SIZE, "database: it does not confirm a commit");
        close_link(connection);
        return false;
    }
    connection->generation = generation;
    connection->confirmed = doubts;
    connection->is_prepared = is_prepared;
    return true;
}

/** A connection that is to be opened; NULL when there is none. Under the lock. */
static qm_postgres_connection *find_closed(qm_postgres_pool *pool)
{
    for (size_t i = 0; i < CONNECTIONS; i++) {
        qm_postgres_connection *connection = &pool->connections[i];
        bool is_stale = connection->state == FREE && connection->generation != pool->generation;
        if (connection->state == CLOSED || is_stale) return connection;
    }
    return NULL;
}

static void wait_until(pthread_cond_t *condition, pthread_mutex_t *lock, double time_ms)
{
    struct timespec until = {.tv_sec = (time_t)(time_ms / 1e3)};
    until.tv_nsec = (long)(1e6 * (time_ms - 1e3 * (double)until.tv_sec));
    pthread_cond_timedwait(condition, lock, &until);
}

/** Tells when the database is lost and found, once each. Under the lock. */
static void note_connecting(qm_postgres_pool *pool, bool is_open, const char *message)
{
    if (is_open == pool->is_away)
        qm_log(is_open ? QM_LOG_INFO : QM_LOG_ERROR, "%s", is_open ? "database: connected again" : message);
    pool->is_away = !is_open;
}

/** Opens connections as they are closed. */
static void *keep_open(void *user)
{
    qm_postgres_pool *pool = user;
    double delay_ms = FIRST_DELAY_MS;
    pthread_mutex_lock(&pool->lock);
    while (!pool->is_closing) {
        qm_postgres_connection *connection = find_closed(pool);
        if (!connection) {
            pthread_cond_wait(&pool->changed, &pool->lock);
            continue;
        }
        char message[QM_MESSAGE_SIZE] = "";
        connection->state = IN_USE;
        pthread_mutex_unlock(&pool->lock);
        bool is_open = open_connection(pool, connection, message);
        pthread_mutex_lock(&pool->lock);
        connection->state = is_open ? FREE : CLOSED;
        note_connecting(pool, is_open, message);
        if (is_open) pthread_cond_broadcast(&pool->freed);
        double until_ms = qm_clock_now_ms() + delay_ms;
        while (!is_open && !pool->is_closing && qm_clock_now_ms() < until_ms)
            wait_until(&pool->changed, &pool->lock, until_ms);
        delay_ms = is_open ? FIRST_DELAY_MS : 2.0 * delay_ms < LAST_DELAY_MS ? 2.0 * delay_ms : LAST_DELAY_MS;
    }
    pthread_mutex_unlock(&pool->lock);
    return NULL;
}

/* ---- taking and giving back ---- */

/** A free connection of this use. Under the lock. */
static qm_postgres_connection *find_free(qm_postgres_pool *pool, qm_postgres_use use)
{
    for (size_t i = 0; i < CONNECTIONS; i++) {
        qm_postgres_connection *connection = &pool->connections[i];
        if (connection->state == FREE && connection->use == use && connection->generation == pool->generation)
            return connection;
    }
    return NULL;
}

/** Waits for a connection; NULL at the deadline, or when too many wait. */
static qm_postgres_connection *take_free(qm_postgres_pool *pool, qm_postgres_use use, double deadline_ms)
{
    pthread_mutex_lock(&pool->lock);
    qm_postgres_connection *connection = find_free(pool, use);
    bool waits = !connection && pool->waiters[use] < WAITERS;
    if (waits) pool->waiters[use]++;
    while (waits && !connection && !pool->is_closing && qm_clock_now_ms() < deadline_ms) {
        wait_until(&pool->freed, &pool->lock, deadline_ms);
        connection = find_free(pool, use);
    }
    if (waits) pool->waiters[use]--;
    if (connection) {
        connection->state = IN_USE;
        connection->is_prepared = !pool->is_unprepared;
    }
    pthread_mutex_unlock(&pool->lock);
    return connection;
}

static void give_back(qm_postgres_pool *pool, qm_postgres_connection *connection, bool is_in_doubt)
{
    bool is_idle = !connection->is_broken && qm_pq.transactionStatus(connection->link) == PQTRANS_IDLE;
    if (!is_idle) close_link(connection);
    pthread_mutex_lock(&pool->lock);
    connection->state = is_idle ? FREE : CLOSED;
    /* What broke this one has probably broken the others, and the next attempt is to have a new one; but not when it
     * was closed at its deadline. */
    bool has_failed = connection->is_broken && connection->is_worth_repeating;
    if (has_failed && connection->generation == pool->generation) pool->generation++;
    if (!connection->is_prepared && !pool->is_unprepared) {
        pool->is_unprepared = true;
        qm_log(QM_LOG_INFO, "database: statements do not stay prepared: there is a proxy");
    }
    if (is_in_doubt) pool->doubts++;
    pthread_cond_broadcast(&pool->freed);
    pthread_cond_signal(&pool->changed);
    pthread_mutex_unlock(&pool->lock);
}

/** A connection that shows nothing that is in doubt; NULL at the deadline. */
static qm_postgres_connection *take(qm_postgres_pool *pool, qm_postgres_use use, double deadline_ms)
{
    qm_postgres_connection *connection;
    while ((connection = take_free(pool, use, deadline_ms))) {
        pthread_mutex_lock(&pool->lock);
        uint64_t doubts = pool->doubts;
        pthread_mutex_unlock(&pool->lock);
        if (connection->confirmed == doubts) return connection;
        double until_ms = fmin(next_deadline(), fmax(deadline_ms, qm_clock_now_ms() + LEAST_MS));
        if (command(connection, confirmation, until_ms) == QM_STORED) {
            connection->confirmed = doubts;
            return connection;
        }
        give_back(pool, connection, false);
    }
    return NULL;
}

/* ---- verbs ---- */

static void note_repetition(qm_postgres_query *query)
{
    query->is_repeated = true;
    if (query->repeated_parameter > 0) query->values[query->repeated_parameter] = "true";
}

qm_stored qm_postgres_run(qm_store *store, qm_postgres_query *query, qm_postgres_rows *rows)
{
    qm_postgres_pool *pool = store->postgres->pool;
    *rows = (qm_postgres_rows){0};
    if (query->failed) return QM_STORED_NO_MEMORY;
    if (pool->snapshot)
        return pool->snapshot->is_broken ? QM_STORED_AWAY : qm_postgres_execute(pool->snapshot, query, rows);
    double wait_ms = query->use == QM_POSTGRES_TRANSFERS ? TRANSFER_WAIT_MS : DEADLINE_MS - LEAST_MS;
    double deadline_ms = next_deadline(), wait_until_ms = qm_clock_now_ms() + wait_ms;
    qm_stored status = QM_STORED_AWAY;
    for (int attempt = 0; attempt < 2; attempt++) {
        qm_postgres_connection *connection = take(pool, query->use, wait_until_ms);
        if (!connection) return QM_STORED_AWAY;
        begin_statement(connection, fmax(deadline_ms, qm_clock_now_ms() + LEAST_MS));
        QM_FAILPOINT("before");
        status = run_on(connection, query, rows);
        if (QM_FAILPOINT_DROPS("after")) {
            qm_postgres_free(rows);
            status = lose(connection, true);
        }
        bool repeats = connection->is_worth_repeating, is_broken = connection->is_broken;
        give_back(pool, connection, status == QM_STORED_AWAY && !query->is_relaxed);
        if (!repeats) break;
        if (is_broken) note_repetition(query); /* else the database has said that it did nothing */
    }
    return status;
}

qm_stored qm_postgres_transact(qm_store *store, qm_postgres_body *body, void *user)
{
    qm_postgres_pool *pool = store->postgres->pool;
    double wait_until_ms = qm_clock_now_ms() + TRANSFER_WAIT_MS;
    qm_stored status = QM_STORED_AWAY;
    for (int attempt = 0; attempt < 2; attempt++) {
        qm_postgres_connection *connection = take(pool, QM_POSTGRES_TRANSFERS, wait_until_ms);
        if (!connection) return QM_STORED_AWAY;
        status =
            qm_postgres_command(connection, "BEGIN; SET LOCAL idle_in_transaction_session_timeout = '10s'");
        if (status == QM_STORED) status = body(connection, user);
        if (status == QM_STORED) {
            QM_FAILPOINT("before");
            status = qm_postgres_command(connection, "COMMIT");
            if (QM_FAILPOINT_DROPS("after")) status = lose(connection, true);
        }
        bool repeats = status == QM_STORED_AWAY && connection->is_worth_repeating;
        /* Closing the connection would do as well, but another one takes time. */
        if (status != QM_STORED && !connection->is_broken) qm_postgres_command(connection, "ROLLBACK");
        give_back(pool, connection, status == QM_STORED_AWAY);
        if (!repeats) break;
    }
    return status;
}

qm_stored qm_postgres_begin_snapshot(qm_store *store)
{
    qm_postgres_pool *pool = store->postgres->pool;
    qm_postgres_connection *connection = take(pool, QM_POSTGRES_REQUESTS, next_deadline());
    if (!connection) return QM_STORED_AWAY;
    qm_stored status = qm_postgres_command(connection, "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY;"
                                                       " SET LOCAL idle_in_transaction_session_timeout = 0");
    if (status == QM_STORED)
        pool->snapshot = connection;
    else
        give_back(pool, connection, false);
    return status;
}

void qm_postgres_end_snapshot(qm_store *store)
{
    qm_postgres_pool *pool = store->postgres->pool;
    qm_postgres_connection *connection = pool->snapshot;
    if (!connection) return;
    pool->snapshot = NULL;
    if (!connection->is_broken) qm_postgres_command(connection, "ROLLBACK");
    give_back(pool, connection, false);
}

qm_stored qm_postgres_confirm(qm_store *store, qm_stored status)
{
    qm_postgres_query query = {.sql = confirmation};
    qm_postgres_rows rows;
    qm_stored confirmed = qm_postgres_run(store, &query, &rows);
    qm_postgres_free(&rows);
    return confirmed == QM_STORED ? status : confirmed;
}

/* ---- the pool ---- */

static void init_condition(pthread_cond_t *condition)
{
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(condition, &attributes);
    pthread_condattr_destroy(&attributes);
}

static qm_postgres_pool *create_pool(const char *address, const char *node)
{
    qm_postgres_pool *pool = calloc(1, sizeof *pool);
    char *copy = strdup(address);
    if (!pool || !copy) {
        free(pool);
        free(copy);
        return NULL;
    }
    pool->address = copy;
    snprintf(pool->application, sizeof pool->application, "quadmeshd/%s", node);
    pthread_mutex_init(&pool->lock, NULL);
    init_condition(&pool->freed);
    init_condition(&pool->changed);
    for (size_t i = 0; i < CONNECTIONS; i++)
        pool->connections[i].use = uses[i];
    return pool;
}

qm_stored qm_postgres_open_pool(qm_store *store, const char *address, bool is_reader,
                                char message[QM_MESSAGE_SIZE])
{
    qm_postgres_pool *pool = create_pool(address, store->postgres->self.name);
    if (!pool) {
        snprintf(message, QM_MESSAGE_SIZE, "%s", qm_status_text(QM_E_NO_MEMORY));
        return QM_STORED_NO_MEMORY;
    }
    store->postgres->pool = pool;
    pool->is_reader = is_reader;
    pool->is_unprepared =
        is_reader; /* behind a proxy a statement that is prepared already ends the snapshot */
    qm_postgres_connection *first = &pool->connections[0];
    if (!open_connection(pool, first, message)) return QM_STORED_AWAY;
    const char *version = qm_pq.parameterStatus(first->link, "server_version");
    snprintf(pool->engine, sizeof pool->engine, "PostgreSQL %.*s", version ? (int)strcspn(version, " ") : 0,
             version ? version : "");
    first->state = FREE;
    if (is_reader) return QM_STORED;
    pool->has_thread = pthread_create(&pool->thread, NULL, keep_open, pool) == 0;
    if (pool->has_thread) return QM_STORED;
    snprintf(message, QM_MESSAGE_SIZE, "database: there is no thread for its connections");
    return QM_STORED_FAULT;
}

void qm_postgres_close_pool(qm_store *store)
{
    qm_postgres_pool *pool = store->postgres->pool;
    if (!pool) return;
    pthread_mutex_lock(&pool->lock);
    pool->is_closing = true;
    pthread_cond_broadcast(&pool->changed);
    pthread_cond_broadcast(&pool->freed);
    pthread_mutex_unlock(&pool->lock);
    if (pool->has_thread) pthread_join(pool->thread, NULL);
    for (size_t i = 0; i < CONNECTIONS; i++)
        close_link(&pool->connections[i]);
    pthread_mutex_destroy(&pool->lock);
    pthread_cond_destroy(&pool->freed);
    pthread_cond_destroy(&pool->changed);
    free(pool->address);
    free(pool);
    store->postgres->pool = NULL;
}

void qm_postgres_name_engine(qm_store *store, char out[64])
{
    memcpy(out, store->postgres->pool->engine, 64);
}
