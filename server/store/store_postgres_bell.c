/**
 * store_postgres_bell.c: news between nodes by LISTEN and NOTIFY. All of it is found by asking, too: news that get lost cost
 * the time until the next pulse and nothing else.
 *
 * NOTIFY holds a lock of the whole server until its transaction has committed. So it has a transaction of its own, after
 * that of the verb, and one that waits neither for a disk nor for a standby; and with many nodes there is none.
 *
 * Behind a proxy that gives each transaction another session, LISTEN is accepted and hears nothing. A listener first sends
 * news to itself, and gives up when they do not come.
 */
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "store_postgres.h"

#define MOST_NODES 32
#define PROOF_MS 2000.0 /* that news to itself may take */
#define RETRY_MS 1000   /* between connections */
#define MARK "\t"       /* between the parts of news: kind, node that sends, subject */

struct qm_postgres_bell {
    qm_store *store;
    qm_store_news_fn *tell;
    void *user;
    int end; /* readable when the thread is to end */
    pthread_t thread;
};

/* ---- sending ---- */

void qm_postgres_ring(qm_store *store, qm_store_news news, const char *const *subjects, size_t count,
                      qm_postgres_use use)
{
    struct qm_postgres *postgres = store->postgres;
    pthread_mutex_lock(&postgres->lock);
    bool is_useful = postgres->home_count > 1 && postgres->home_count <= MOST_NODES;
    pthread_mutex_unlock(&postgres->lock);
    if (!is_useful) return;
    qm_postgres_query query = {.sql = "WITH " QM_POSTGRES_RELAXED
                                      " SELECT pg_notify('quadmeshd', $1::text || subject)"
                                      " FROM relaxed, unnest($2::text[]) AS s(subject) WHERE mode = 'off'",
                               .is_relaxed = true,
                               .use = use};
    char start[QM_NODE_NAME_SIZE + 16];
    qm_text texts = {0};
    snprintf(start, sizeof start, "%d" MARK "%s" MARK, (int)news, postgres->self.name);
    for (size_t i = 0; i < count; i++)
        qm_postgres_write_text(&texts, subjects[i]);
    qm_postgres_add_text(&query, start);
    qm_postgres_add_array(&query, &texts);
    qm_postgres_rows rows;
    qm_postgres_run(store, &query, &rows);
    qm_postgres_free(&rows);
    qm_text_reset(&texts);
}

/* ---- hearing ---- */

/** Waits until the connection has something to read; false when the thread is to end, or at the deadline. */
static bool wait_for_news(const struct qm_postgres_bell *bell, PGconn *link, double deadline_ms)
{
    struct pollfd files[] = {{.fd = qm_pq.socket(link), .events = POLLIN},
                             {.fd = bell->end, .events = POLLIN}};
    double left_ms = deadline_ms - qm_clock_now_ms();
    int wait_ms = deadline_ms <= 0.0 ? -1 : left_ms > 0.0 ? (int)left_ms + 1 : 0;
    return poll(files, 2, wait_ms) > 0 && files[1].revents == 0;
}

/** Tells what is for this node. */
static void take(const struct qm_postgres_bell *bell, const char *text)
{
    const char *sender = strstr(text, MARK), *subject = sender ? strstr(sender + 1, MARK) : NULL;
    const char *self = bell->store->postgres->self.name;
    if (!subject) return;
    size_t length = (size_t)(subject - sender - 1);
    if (strlen(self) == length && strncmp(sender + 1, self, length) == 0) return;
    qm_store_news news = (qm_store_news)(text[0] - '0');
    subject++;
    if (news != QM_STORE_NEWS_QUEUED)
        bell->tell(bell->user, news, subject);
    else if (!subject[0] || strcmp(subject, self) == 0)
        bell->tell(bell->user, news, "");
}

/** Takes all news that have come. True when `proof` was among them. */
static bool take_all(const struct qm_postgres_bell *bell, PGconn *link, const char *proof)
{
    bool is_proven = false;
    for (PGnotify *note; (note = qm_pq.notifies(link));) {
        is_proven |= strcmp(note->extra, proof) == 0;
        take(bell, note->extra);
        qm_pq.freemem(note);
    }
    return is_proven;
}

/** Reads results until there is no more; false when the connection has ended. */
static bool read_results(const struct qm_postgres_bell *bell, PGconn *link)
{
    double deadline_ms = qm_clock_now_ms() + PROOF_MS;
    bool is_good = true;
    for (;;) {
        while (qm_pq.isBusy(link))
            if (!wait_for_news(bell, link, deadline_ms) || !qm_pq.consumeInput(link)) return false;
        PGresult *result = qm_pq.getResult(link);
        if (!result) return is_good;
        ExecStatusType kind = qm_pq.resultStatus(result);
        is_good &= kind == PGRES_COMMAND_OK || kind == PGRES_TUPLES_OK;
        qm_pq.clear(result);
    }
}

/** True when news come through: those that this connection sends to itself. */
static bool prove(const struct qm_postgres_bell *bell, PGconn *link)
{
    char proof[QM_ID_SIZE], sql[96 + QM_ID_SIZE];
    qm_id_make('n', proof);
    snprintf(sql, sizeof sql, "SELECT pg_notify('quadmeshd', '%s')", proof);
    double deadline_ms = qm_clock_now_ms() + PROOF_MS;
    if (!qm_pq.sendQuery(link, sql) || !read_results(bell, link)) return false;
    while (!take_all(bell, link, proof))
        if (!wait_for_news(bell, link, deadline_ms) || !qm_pq.consumeInput(link)) return false;
    return true;
}

static void ignore_notice(void *user, const PGresult *notice)
{
    (void)user;
    (void)notice;
}

/** Listens until the connection or the thread ends. False when there is no use in another connection. */
static bool listen_on(const struct qm_postgres_bell *bell, PGconn *link)
{
    qm_pq.setNoticeReceiver(link, ignore_notice, NULL);
    if (!qm_pq.sendQuery(link, "LISTEN quadmeshd") || !read_results(bell, link)) return true;
    if (!prove(bell, link)) return qm_pq.status(link) != CONNECTION_OK;
    bell->tell(bell->user, QM_STORE_NEWS_QUEUED, ""); /* what came before */
    while (wait_for_news(bell, link, 0.0) && qm_pq.consumeInput(link))
        take_all(bell, link, "");
    return true;
}

static bool is_ending(const struct qm_postgres_bell *bell, int wait_ms)
{
    struct pollfd file = {.fd = bell->end, .events = POLLIN};
    return poll(&file, 1, wait_ms) > 0;
}

static void *listen_always(void *user)
{
    const struct qm_postgres_bell *bell = user;
    for (bool is_useful = true; is_useful && !is_ending(bell, 0);) {
        char message[QM_MESSAGE_SIZE];
        PGconn *link = qm_postgres_connect(bell->store, message);
        if (link) {
            is_useful = listen_on(bell, link);
            qm_pq.finish(link);
        }
        if (!is_useful && !is_ending(bell, 0))
            qm_log(QM_LOG_INFO,
                   "database: no news come through: there is a proxy, and nodes ask as often as without");
        if (is_ending(bell, RETRY_MS)) break;
    }
    return NULL;
}

void qm_postgres_watch(qm_store *store, qm_store_news_fn *tell, void *user)
{
    struct qm_postgres_bell *bell = calloc(1, sizeof *bell);
    if (!bell) return;
    *bell =
        (struct qm_postgres_bell){.store = store, .tell = tell, .user = user, .end = eventfd(0, EFD_CLOEXEC)};
    if (bell->end >= 0 && pthread_create(&bell->thread, NULL, listen_always, bell) == 0) {
        store->postgres->bell = bell;
        return;
    }
    if (bell->end >= 0) close(bell->end);
    free(bell);
}

void qm_postgres_unwatch(qm_store *store)
{
    struct qm_postgres_bell *bell = store->postgres->bell;
    if (!bell) return;
    eventfd_write(bell->end, 1);
    pthread_join(bell->thread, NULL);
    close(bell->end);
    free(bell);
    store->postgres->bell = NULL;
}
