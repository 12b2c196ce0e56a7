/*
 * What nodes do that share a store: jobs are claimed once, a node that was declared dead writes nothing, answers that
 * get lost do not make a verb happen twice. Needs a server: QM_TEST_POSTGRES, tests/support/database.h.
 */
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/id.h"
#include "check.h"
#include "cut.h"
#include "database.h"
#include "folder.h"
#include "store/blob.h"
#include "store/store.h"
#include "store/store_driver.h"
#include "store/store_parts.h"

#define NODES 4

typedef struct fixture {
    char *database, *through; /* the second one by the proxy */
    qm_cut *cut;
    char *folders[NODES];
    qm_store *stores[NODES]; /* those that a test has opened; the last one through the proxy */
} fixture;

/** The stores of the test that runs, which close in any case. */
static void open_node(fixture *f, int i, const char *address)
{
    char name[16], message[QM_MESSAGE_SIZE] = "";
    snprintf(name, sizeof name, "n%d", i);
    if (!f->folders[i]) f->folders[i] = qm_folder_make();
    const qm_store_node self = {.version = "test", .workers = 2, .memory = 1 << 30};
    qm_store_node named = self;
    snprintf(named.name, sizeof named.name, "%s", name);
    qm_stored stored = qm_store_open_shared(address, f->folders[i], &named, false, &f->stores[i], message);
    QM_CHECK(stored == QM_STORED, "%s", message);
}

static int set_up(void **state)
{
    fixture *f = calloc(1, sizeof *f);
    if (!f) return -1;
    char host[64];
    int port;
    f->database = qm_database_make();
    qm_database_host(f->database, host, &port);
    f->cut = qm_cut_open(host, port);
    f->through = qm_database_move(f->database, "127.0.0.1", qm_cut_port(f->cut));
    *state = f;
    return 0;
}

static int tear_down(void **state)
{
    fixture *f = *state;
    for (int i = 0; i < NODES; i++) {
        qm_store_close(f->stores[i]);
        if (f->folders[i]) qm_folder_remove(f->folders[i]);
    }
    qm_cut_close(f->cut);
    qm_database_drop(f->database);
    free(f->through);
    free(f);
    return 0;
}

static qm_store_job make_job(const char *id)
{
    qm_store_job job = {.key = "hash of the request", .body = "{}", .type = "distance", .created = "now"};
    snprintf(job.id, sizeof job.id, "%s", id);
    return job;
}

/** Submits a job that waits for a node. */
static qm_stored submit(qm_store *store, const char *id, const char *home)
{
    const qm_store_job job = make_job(id);
    return qm_store_submit_job(store, &(qm_store_submission){&job, home, 1000, false, true});
}

static qm_stored submit_claimed(qm_store *store, const char *id)
{
    const qm_store_job job = make_job(id);
    return qm_store_submit_job(store, &(qm_store_submission){&job, "", 1000, true, true});
}

/** Claims; the ids as one text with blanks between, in the order of the rows. */
static qm_stored claim(qm_store *store, size_t free_workers, size_t extra, double spill_s, char ids[256])
{
    qm_store_job jobs[64];
    size_t count, length = 0;
    const qm_store_wish wish = {free_workers, extra, spill_s};
    qm_stored stored = qm_store_claim_jobs(store, &wish, jobs, &count);
    ids[0] = '\0';
    for (size_t i = 0; i < count; i++) {
        length += (size_t)snprintf(ids + length, 256 - length, "%s%s", i > 0 ? " " : "", jobs[i].id);
        qm_store_job_reset(&jobs[i]);
    }
    return stored;
}

static void check_claim(qm_store *store, size_t free_workers, size_t extra, double spill_s,
                        const char *expected)
{
    char ids[256];
    assert_int_equal(claim(store, free_workers, extra, spill_s, ids), QM_STORED);
    assert_string_equal(ids, expected);
}

static qm_stored finish(qm_store *store, const char *id, int64_t restarts)
{
    qm_store_job end = make_job(id);
    end.state = QM_JOB_SUCCEEDED, end.document = "{}", end.restarts = restarts;
    return qm_store_finish_job(store, &end, "", NULL, 0, NULL);
}

static void check_job(qm_store *store, const char *id, qm_job_state state, int64_t restarts, int64_t deaths)
{
    qm_store_job found;
    assert_int_equal(qm_store_find_job(store, id, &found), QM_STORED);
    assert_int_equal(found.state, state);
    assert_int_equal(found.restarts, restarts);
    assert_int_equal(found.deaths, deaths);
    qm_store_job_reset(&found);
}

/** A job that has not ended is in exactly one place. */
static void check_places(const fixture *f)
{
    assert_int_equal(
        qm_database_ask(f->database,
                        "SELECT count(*) FROM quadmeshd.jobs j WHERE (document IS NULL)::int"
                        " <> (SELECT count(*) FROM quadmeshd.job_queue q WHERE q.sequence = j.sequence)"
                        "  + (SELECT count(*) FROM quadmeshd.job_runs r WHERE r.sequence = j.sequence)"),
        0);
}

static int64_t count_rows(const fixture *f, const char *table)
{
    return qm_database_ask(f->database, "SELECT count(*) FROM quadmeshd.%s", table);
}

/** Makes a node look silent for a minute. */
static void silence(const fixture *f, const char *name)
{
    qm_database_ask(f->database,
                    "UPDATE quadmeshd.node_beats b SET beat = beat - interval '1 min'"
                    " FROM quadmeshd.nodes n WHERE n.id = b.id AND n.name = '%s'",
                    name);
}

/* ---- claims ---- */

static void test_claims(void **state)
{
    fixture *f = *state;
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    qm_store *a = f->stores[0], *b = f->stores[1];
    check_claim(a, 4, 4, 0.0, "");
    assert_int_equal(submit(a, "j_1", "n1"), QM_STORED);
    assert_int_equal(submit(a, "j_2", "n0"), QM_STORED);
    assert_int_equal(submit(a, "j_3", ""), QM_STORED);
    assert_int_equal(submit(a, "j_4", "n1"), QM_STORED);
    check_job(b, "j_1", QM_JOB_QUEUED, 0, 0);
    check_claim(a, 0, 0, 0.0, "");
    check_claim(a, 4, 0, 1000.0, "j_2 j_3"); /* its own, and that of nobody */
    check_job(b, "j_2", QM_JOB_RUNNING, 0, 0);
    check_claim(a, 0, 1, 1000.0, "");
    check_claim(a, 0, 1, 0.0, "j_1"); /* it has waited */
    check_claim(b, 4, 4, 1000.0, "j_4");
    check_claim(b, 4, 4, 0.0, "");
    assert_int_equal(finish(b, "j_1", 0), QM_STORED_LOST); /* of another node */
    assert_int_equal(finish(a, "j_1", 0), QM_STORED);
    check_places(f);
    const qm_store_job full = make_job("j_5");
    assert_int_equal(submit(a, "j_6", "n0"), QM_STORED);
    assert_int_equal(qm_store_submit_job(a, &(qm_store_submission){&full, "n0", 1, false, true}),
                     QM_STORED_FULL);
    assert_int_equal(qm_store_submit_job(a, &(qm_store_submission){&full, "n0", 2, false, true}), QM_STORED);
    assert_int_equal(qm_store_submit_job(a, &(qm_store_submission){&full, "n0", 2, false, true}), QM_STORED);
    check_claim(b, 1, 1, 0.0, "j_6 j_5"); /* one of its free workers, and one more */
}

typedef struct claimer {
    qm_store *store;
    int count;
} claimer;

static void *claim_all(void *user)
{
    claimer *c = user;
    char ids[256], *rest;
    for (int empty = 0; empty < 3; empty++) {
        qm_stored stored = claim(c->store, 3, 2, 0.0, ids);
        QM_CHECK(stored == QM_STORED, "%d", stored);
        for (char *id = strtok_r(ids, " ", &rest); id; id = strtok_r(NULL, " ", &rest)) {
            stored = finish(c->store, id, 0);
            QM_CHECK(stored == QM_STORED, "%s: %d", id, stored);
            c->count++;
            empty = 0;
        }
    }
    return NULL;
}

/** Four nodes claim at once: each job once. */
static void test_claims_by_nodes(void **state)
{
    enum { JOBS = 200 };
    fixture *f = *state;
    claimer claimers[NODES];
    pthread_t threads[NODES];
    int sum = 0;
    for (int i = 0; i < NODES; i++)
        open_node(f, i, f->database);
    qm_database_ask(
        f->database,
        "WITH made AS (INSERT INTO quadmeshd.jobs (id, key, body, type, created, owners, kept)"
        " SELECT 'j_' || i, '', '{}', '', '', 0, true FROM generate_series(1, %d) i RETURNING sequence)"
        " INSERT INTO quadmeshd.job_queue (sequence, home) SELECT sequence, 'n' || sequence %% 4 FROM made",
        JOBS);
    for (int i = 0; i < NODES; i++) {
        claimers[i] = (claimer){f->stores[i], 0};
        pthread_create(&threads[i], NULL, claim_all, &claimers[i]);
    }
    for (int i = 0; i < NODES; i++) {
        pthread_join(threads[i], NULL);
        sum += claimers[i].count;
    }
    assert_int_equal(sum, JOBS);
    assert_int_equal(qm_database_ask(f->database, "SELECT count(*) FROM quadmeshd.jobs WHERE state = 2"),
                     JOBS);
    check_places(f);
}

static void wait_for_connections(const fixture *f, int64_t since_us);

static int64_t now_us(const fixture *f)
{
    return qm_database_ask(f->database, "SELECT (extract(epoch FROM clock_timestamp()) * 1000000)::bigint");
}

/** Holds the answers of the server while a call fails, whose statement is prepared. */
static void hold_answers(fixture *f, qm_stored (*call)(qm_store *store))
{
    wait_for_connections(f, 0);
    assert_int_equal(call(f->stores[NODES - 1]), QM_STORED);
    qm_cut_set(f->cut, QM_CUT_HOLD);
    assert_int_equal(call(f->stores[NODES - 1]), QM_STORED_AWAY);
    qm_cut_set(f->cut, QM_CUT_NOTHING);
}

static qm_stored claim_one(qm_store *store)
{
    char ids[256];
    return claim(store, 1, 0, 0.0, ids);
}

static qm_stored submit_one_claimed(qm_store *store)
{
    static int count;
    char id[QM_ID_SIZE];
    snprintf(id, sizeof id, "j_own_%d", count++);
    return submit_claimed(store, id);
}

/** What a claim has claimed whose answer was lost, the next one returns; also a job that was submitted to be run at
 * once. */
static void test_claims_that_were_not_heard_of(void **state)
{
    fixture *f = *state;
    open_node(f, NODES - 1, f->through);
    open_node(f, 0, f->database);
    qm_store *store = f->stores[NODES - 1];
    assert_int_equal(submit(f->stores[0], "j_0", ""), QM_STORED);
    assert_int_equal(submit(f->stores[0], "j_1", ""), QM_STORED);
    hold_answers(f, claim_one);
    check_job(f->stores[0], "j_1", QM_JOB_RUNNING, 0, 0);
    assert_int_equal(submit(f->stores[0], "j_2", ""), QM_STORED);
    check_claim(store, 1, 0, 0.0, "j_1");
    hold_answers(f, submit_one_claimed);
    check_job(f->stores[0], "j_own_1", QM_JOB_RUNNING, 0, 0);
    check_claim(store, 1, 0, 0.0, "j_own_1");
    check_claim(store, 4, 4, 0.0, "j_2");
    check_claim(store, 4, 4, 0.0, "");
    check_places(f);
}

typedef struct busy_client {
    qm_store *store;
    int first, count;
    atomic_int *working;
} busy_client;

/** Submits jobs to be run at once, and ends them at once. */
static void *submit_and_finish(void *user)
{
    busy_client *client = user;
    for (int i = 0; i < client->count; i++) {
        char id[QM_ID_SIZE];
        snprintf(id, sizeof id, "j_at_once_%d", client->first + i);
        qm_stored stored = submit_claimed(client->store, id);
        QM_CHECK(stored == QM_STORED, "%s: %d", id, stored);
        stored = finish(client->store, id, 0);
        QM_CHECK(stored == QM_STORED, "%s: %d", id, stored);
    }
    atomic_fetch_sub(client->working, 1);
    return NULL;
}

/** A claim sees the row of a job that was submitted after it had told which ones the node has. Such a job runs already. */
static void test_a_claim_while_jobs_are_submitted(void **state)
{
    enum { THREADS = 6, JOBS = 150 };
    fixture *f = *state;
    busy_client clients[THREADS];
    pthread_t threads[THREADS];
    atomic_int working = THREADS;
    open_node(f, 0, f->database);
    for (int i = 0; i < THREADS; i++) {
        clients[i] = (busy_client){f->stores[0], i * JOBS, JOBS, &working};
        pthread_create(&threads[i], NULL, submit_and_finish, &clients[i]);
    }
    while (atomic_load(&working) > 0)
        check_claim(f->stores[0], 8, 8, 0.0, "");
    for (int i = 0; i < THREADS; i++)
        pthread_join(threads[i], NULL);
    check_places(f);
}

/** A deadline counts from the submission, whichever node takes the job, and after a death from the next run on. */
static void test_claims_tell_how_long_a_job_has_waited(void **state)
{
    fixture *f = *state;
    qm_store_job job;
    size_t count;
    const qm_store_wish wish = {1, 0, 0.0};
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    assert_int_equal(submit(f->stores[0], "j_1", "n1"), QM_STORED);
    qm_database_ask(f->database, "UPDATE quadmeshd.jobs SET submitted = submitted - interval '1 min'");
    assert_int_equal(qm_store_claim_jobs(f->stores[1], &wish, &job, &count), QM_STORED);
    assert_int_equal(count, 1);
    QM_CHECK(job.waited_s >= 60.0 && job.waited_s < 600.0, "%g", job.waited_s);
    qm_store_job_reset(&job);
    silence(f, "n1");
    assert_int_equal(qm_store_reap(f->stores[0], 10.0, &count), QM_STORED);
    assert_int_equal(qm_store_claim_jobs(f->stores[0], &wish, &job, &count), QM_STORED);
    assert_int_equal(count, 1);
    QM_CHECK(job.waited_s == 0.0, "%g", job.waited_s);
    qm_store_job_reset(&job);
}

/* ---- nodes that end ---- */

typedef struct durable_events {
    size_t jobs, counts[2];
    uint64_t last[2];
} durable_events;

static void note_durable(void *user, const char *job, size_t count, uint64_t last)
{
    durable_events *seen = user;
    size_t place = job[2] == '1' ? 0 : 1;
    seen->jobs++;
    seen->counts[place] = count;
    seen->last[place] = last;
}

/** A beat tells of the events that are there, of this node's jobs alone. */
static void test_a_beat_tells_durable_events(void **state)
{
    fixture *f = *state;
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    qm_store *a = f->stores[0];
    assert_int_equal(submit_claimed(a, "j_1"), QM_STORED);
    assert_int_equal(submit_claimed(a, "j_2"), QM_STORED);
    assert_int_equal(submit_claimed(f->stores[1], "j_3"), QM_STORED);
    qm_store_run run = {.job = "j_1"};
    const qm_store_event events[] = {
        {"j_1", 1, "bounds", ""}, {"j_1", 2, "bounds", ""}, {"j_1", 3, "bounds", ""}};
    assert_int_equal(qm_store_append_events(a, &run, 1, events, 3), QM_STORED);
    qm_store_cluster cluster;
    durable_events seen = {0};
    assert_int_equal(qm_store_beat(a, 1, &cluster, note_durable, &seen), QM_STORED);
    assert_int_equal(seen.jobs, 2);
    assert_int_equal(seen.counts[0], 3);
    assert_int_equal(seen.last[0], 3);
    assert_int_equal(seen.counts[1], 0);
    qm_database_ask(f->database, "DELETE FROM quadmeshd.job_events WHERE seq > 1");
    assert_int_equal(qm_store_beat(a, 1, &cluster, note_durable, &seen), QM_STORED);
    assert_int_equal(seen.counts[0], 1);
    assert_int_equal(seen.last[0], 1);
}

/** Only the run that a job has begun with one run left can be its last. */
static void test_the_last_run_counts_from_its_beginning(void **state)
{
    fixture *f = *state;
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    qm_store *judge = f->stores[1];
    assert_int_equal(submit(judge, "j_1", ""), QM_STORED);
    assert_int_equal(submit(judge, "j_2", ""), QM_STORED);
    const int64_t begun_deaths[] = {1, 2, 3}, waiting_deaths[] = {1, 2, 2};
    for (int k = 0; k < 3; k++) {
        size_t count;
        check_claim(f->stores[0], 2, 0, 0.0, "j_1 j_2");
        assert_int_equal(qm_store_begin_job(f->stores[0], "j_1"), QM_STORED);
        assert_int_equal(qm_store_begin_job(f->stores[0], "j_1"), QM_STORED); /* a repetition */
        silence(f, "n0");
        assert_int_equal(qm_store_reap(judge, 30.0, &count), QM_STORED);
        assert_int_equal(count, 2);
        check_job(judge, "j_1", QM_JOB_QUEUED, k + 1, begun_deaths[k]);
        check_job(judge, "j_2", QM_JOB_QUEUED, k + 1, waiting_deaths[k]);
        assert_int_equal(qm_store_begin_job(f->stores[0], "j_1"), QM_STORED); /* not its any more */
        check_job(judge, "j_2", QM_JOB_QUEUED, k + 1, waiting_deaths[k]);
        assert_int_equal(qm_store_join(f->stores[0]), QM_STORED);
    }
    check_claim(judge, 2, 0, 0.0, "j_1 j_2");
    assert_int_equal(qm_store_leave_jobs(judge), QM_STORED);
    check_job(f->stores[0], "j_1", QM_JOB_QUEUED, 4, 0); /* it has ended nobody */
}

static void test_a_silent_node_loses_its_jobs(void **state)
{
    fixture *f = *state;
    size_t count;
    qm_store_cluster cluster;
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    qm_store *a = f->stores[0], *b = f->stores[1];
    assert_int_equal(submit_claimed(a, "j_1"), QM_STORED);
    assert_int_equal(submit_claimed(a, "j_2"), QM_STORED);
    assert_int_equal(finish(a, "j_2", 0), QM_STORED);
    assert_int_equal(qm_store_reap(b, 30.0, &count), QM_STORED);
    assert_int_equal(count, 0);
    assert_int_equal(qm_store_beat(a, 1, &cluster, NULL, NULL), QM_STORED);
    assert_int_equal(cluster.nodes, 2);
    assert_int_equal(cluster.running, 1);
    assert_int_equal(cluster.durability, QM_STORE_ONE_MACHINE);
    char dead[sizeof cluster.node];
    snprintf(dead, sizeof dead, "%s", cluster.node);
    silence(f, "n0");
    assert_int_equal(qm_store_reap(b, 30.0, &count), QM_STORED);
    assert_int_equal(count, 1);
    check_job(b, "j_1", QM_JOB_QUEUED, 1, 1);
    /* What it does now is void. */
    qm_store_run run = {.job = "j_1"};
    uint64_t sum = 0;
    assert_int_equal(qm_store_beat(a, 1, &cluster, NULL, NULL), QM_STORED_LOST);
    assert_int_equal(qm_store_append_events(a, &run, 1, &(qm_store_event){"j_1", 1, "bounds", ""}, 1),
                     QM_STORED);
    assert_true(run.is_lost);
    assert_int_equal(finish(a, "j_1", 0), QM_STORED_LOST);
    assert_int_equal(qm_store_put_array(a, "j_1", &(qm_store_array){1, &sum, "no blob"}), QM_STORED_LOST);
    assert_int_equal(submit_claimed(a, "j_3"), QM_STORED_LOST);
    assert_int_equal(submit(a, "j_4", "n0"), QM_STORED); /* others may run it */
    check_claim(a, 4, 4, 0.0, "");
    assert_int_equal(count_rows(f, "job_events"), 0);
    check_claim(b, 1, 0, 0.0, "j_1");
    check_job(b, "j_1", QM_JOB_RUNNING, 1, 1);
    assert_int_equal(finish(b, "j_1", 0), QM_STORED_LOST); /* of the first claim */
    assert_int_equal(finish(b, "j_1", 1), QM_STORED);
    check_job(a, "j_1", QM_JOB_SUCCEEDED, 1, 0);
    /* It comes back as another one. */
    assert_int_equal(qm_store_join(a), QM_STORED);
    assert_int_equal(qm_store_beat(a, 1, &cluster, NULL, NULL), QM_STORED);
    assert_string_not_equal(cluster.node, dead);
    check_claim(a, 4, 0, 1000.0, "j_4");
    check_places(f);
}

static void test_a_node_that_starts_again(void **state)
{
    fixture *f = *state;
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    assert_int_equal(submit_claimed(f->stores[0], "j_1"), QM_STORED);
    qm_store_close(f->stores[0]); /* as by kill -9 */
    open_node(f, 0, f->database);
    check_job(f->stores[1], "j_1", QM_JOB_QUEUED, 1, 1);
    check_claim(f->stores[0], 1, 0, 1000.0, "j_1");
}

static void test_a_node_that_leaves(void **state)
{
    fixture *f = *state;
    qm_store_cluster cluster;
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    assert_int_equal(submit_claimed(f->stores[0], "j_1"), QM_STORED);
    assert_int_equal(qm_store_leave_jobs(f->stores[0]), QM_STORED);
    assert_int_equal(qm_store_leave_jobs(f->stores[0]), QM_STORED);
    check_job(f->stores[1], "j_1", QM_JOB_QUEUED, 1, 0);
    check_claim(f->stores[0], 4, 4, 0.0, "");
    assert_int_equal(finish(f->stores[0], "j_1", 0), QM_STORED_LOST);
    assert_int_equal(qm_store_beat(f->stores[0], 0, &cluster, NULL, NULL), QM_STORED);
    check_claim(f->stores[1], 1, 0, 1000.0, "j_1");
    assert_int_equal(finish(f->stores[1], "j_1", 1), QM_STORED);
    check_places(f);
}

/** The home of an id is the same at each node, and nodes have about as many each. */
static void test_homes(void **state)
{
    enum { IDS = 4000 };
    fixture *f = *state;
    qm_store_cluster cluster;
    char home[QM_NODE_NAME_SIZE], other[QM_NODE_NAME_SIZE];
    int counts[NODES] = {0};
    for (int i = 0; i < NODES; i++)
        open_node(f, i, f->database);
    for (int i = 0; i < NODES; i++)
        assert_int_equal(qm_store_beat(f->stores[i], 1, &cluster, NULL, NULL), QM_STORED);
    assert_int_equal(cluster.nodes, NODES);
    for (int i = 0; i < IDS; i++) {
        char id[QM_ID_SIZE];
        snprintf(id, sizeof id, "m_%d", i);
        qm_store_find_home(f->stores[0], id, home);
        qm_store_find_home(f->stores[i % NODES], id, other);
        assert_string_equal(home, other);
        counts[home[1] - '0']++;
    }
    for (int i = 0; i < NODES; i++) /* five standard deviations */
        QM_CHECK(abs(counts[i] - IDS / NODES) < 140, "node %d: %d", i, counts[i]);
    /* The other of two homes, when jobs wait at the first. */
    qm_store_find_home(f->stores[0], "m_0", home);
    assert_int_equal(submit(f->stores[0], "j_1", home), QM_STORED);
    assert_int_equal(qm_store_beat(f->stores[0], 1, &cluster, NULL, NULL), QM_STORED);
    assert_int_equal(cluster.queued, 1);
    qm_store_find_home(f->stores[0], "m_0", other);
    assert_string_not_equal(home, other);
    /* None at a node that leaves. */
    assert_int_equal(qm_store_leave_jobs(f->stores[other[1] - '0']), QM_STORED);
    assert_int_equal(qm_store_beat(f->stores[0], 1, &cluster, NULL, NULL), QM_STORED);
    char third[QM_NODE_NAME_SIZE];
    qm_store_find_home(f->stores[0], "m_0", third);
    assert_string_not_equal(third, other);
}

/* ---- jobs of other nodes ---- */

static void test_cancels(void **state)
{
    fixture *f = *state;
    const qm_store_event last = {"j_1", 2, "canceled", ""};
    qm_store_run run = {.job = "j_2"};
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    qm_store *a = f->stores[0], *b = f->stores[1];
    assert_int_equal(submit(a, "j_1", "n0"), QM_STORED);
    assert_int_equal(submit_claimed(a, "j_2"), QM_STORED);
    assert_int_equal(qm_store_cancel_job(b, "j_1", "{}", &last), QM_STORED);
    check_job(a, "j_1", QM_JOB_CANCELED, 0, 0);
    assert_int_equal(qm_store_cancel_job(b, "j_1", "{}", &last), QM_STORED_NONE);
    assert_int_equal(qm_store_cancel_job(b, "j_none", "{}", &last), QM_STORED_NONE);
    assert_int_equal(count_rows(f, "job_events"), 1);
    assert_int_equal(qm_store_append_events(a, &run, 1, NULL, 0), QM_STORED);
    assert_false(run.is_canceled);
    assert_int_equal(qm_store_cancel_job(b, "j_2", "{}", &last), QM_STORED_LATE);
    assert_int_equal(qm_store_cancel_job(b, "j_2", "{}", &last), QM_STORED_LATE);
    assert_int_equal(qm_store_append_events(a, &run, 1, NULL, 0), QM_STORED);
    assert_true(run.is_canceled);
    assert_int_equal(submit_claimed(a, "j_3"), QM_STORED);
    run = (qm_store_run){.job = "j_3"};
    assert_int_equal(qm_store_note_cancel(a, "j_3"), QM_STORED);
    assert_int_equal(qm_store_note_cancel(a, "j_none"), QM_STORED);
    assert_int_equal(qm_store_append_events(a, &run, 1, NULL, 0), QM_STORED);
    assert_true(run.is_canceled);
    check_places(f);
}

static void test_owners(void **state)
{
    fixture *f = *state;
    bool is_unwanted;
    open_node(f, 0, f->database);
    const qm_store_job job = make_job("j_1");
    assert_int_equal(qm_store_submit_job(f->stores[0], &(qm_store_submission){&job, "", 9, true, false}),
                     QM_STORED);
    assert_int_equal(qm_store_hold_job(f->stores[0], "j_1", 1, false, &is_unwanted), QM_STORED);
    assert_false(is_unwanted);
    assert_int_equal(qm_store_hold_job(f->stores[0], "j_1", -1, false, &is_unwanted), QM_STORED);
    assert_false(is_unwanted); /* the one who has submitted it is there */
    assert_int_equal(qm_store_hold_job(f->stores[0], "j_1", -1, false, &is_unwanted), QM_STORED);
    assert_true(is_unwanted);
    assert_int_equal(qm_store_hold_job(f->stores[0], "j_1", 0, true, &is_unwanted), QM_STORED);
    assert_false(is_unwanted);
    assert_int_equal(finish(f->stores[0], "j_1", 0), QM_STORED);
    assert_int_equal(qm_store_hold_job(f->stores[0], "j_1", 1, false, &is_unwanted), QM_STORED_NONE);
}

static bool print_event(void *user, const qm_store_event *event)
{
    qm_text_printf(user, "%s %d %s;", event->job, (int)event->seq, event->members);
    return true;
}

static void test_looks(void **state)
{
    fixture *f = *state;
    open_node(f, 0, f->database);
    open_node(f, 1, f->database);
    qm_store *a = f->stores[0], *b = f->stores[1];
    const qm_store_event events[] = {
        {"j_1", 1, "queued", "x"}, {"j_1", 2, "bounds", "y"}, {"j_2", 1, "queued", "z"}};
    qm_store_run runs[] = {{.job = "j_1", .progress = "\"lower\":1"}, {.job = "j_2"}};
    qm_store_look looks[] = {{.job = "j_2"}, {.job = "j_1", .after = 1}, {.job = "j_none"}, {.job = "j_3"}};
    qm_text text = {0};
    assert_int_equal(submit_claimed(a, "j_1"), QM_STORED);
    assert_int_equal(submit_claimed(a, "j_2"), QM_STORED);
    assert_int_equal(submit(a, "j_3", ""), QM_STORED);
    assert_int_equal(qm_store_append_events(a, runs, 2, events, 3), QM_STORED);
    assert_false(runs[0].is_watched || runs[1].is_watched);
    assert_int_equal(finish(a, "j_2", 0), QM_STORED);
    assert_int_equal(qm_store_look_at_jobs(b, looks, 4, print_event, &text), QM_STORED);
    assert_string_equal(text.data, "j_2 1 z;j_1 2 y;");
    assert_int_equal(looks[0].state, QM_JOB_SUCCEEDED);
    assert_int_equal(looks[1].state, QM_JOB_RUNNING);
    assert_int_equal(looks[3].state, QM_JOB_QUEUED);
    assert_true(looks[2].is_gone && !looks[0].is_gone && !looks[1].is_gone);
    assert_int_equal(qm_store_append_events(a, runs, 1, NULL, 0), QM_STORED);
    assert_true(runs[0].is_watched);
    qm_store_job found;
    assert_int_equal(qm_store_find_job(b, "j_1", &found), QM_STORED);
    assert_string_equal(found.progress, "\"lower\":1"); /* no progress does not take it away */
    qm_store_job_reset(&found);
    assert_int_equal(qm_store_look_at_jobs(b, NULL, 0, print_event, &text), QM_STORED);
    qm_text_reset(&text);
}

static bool count_event(void *user, const qm_store_event *event)
{
    int *count = user;
    assert_int_equal(event->seq, ++*count);
    return true;
}

/** However many events there are, each is read once and in order, and the end of the job after all. */
static void test_many_events(void **state)
{
    enum { EVENTS = 10000 };
    fixture *f = *state;
    open_node(f, 0, f->database);
    qm_store_look look = {.job = "j_1"};
    int seen = 0, count = 0, calls = 0;
    assert_int_equal(submit_claimed(f->stores[0], "j_1"), QM_STORED);
    assert_int_equal(finish(f->stores[0], "j_1", 0), QM_STORED);
    qm_database_ask(f->database,
                    "INSERT INTO quadmeshd.job_events SELECT sequence, i, 'bounds', '' FROM quadmeshd.jobs,"
                    " generate_series(1, %d) i",
                    EVENTS);
    assert_int_equal(qm_store_read_events(f->stores[0], "j_1", 0, count_event, &count), QM_STORED);
    assert_int_equal(count, EVENTS);
    do {
        look.after = (uint64_t)seen;
        assert_int_equal(qm_store_look_at_jobs(f->stores[0], &look, 1, count_event, &seen), QM_STORED);
        calls++;
    } while (look.state <= QM_JOB_RUNNING && calls < 10);
    assert_int_equal(seen, EVENTS);
    assert_int_equal(look.state, QM_JOB_SUCCEEDED);
}

/* ---- news ---- */

typedef struct listener {
    pthread_mutex_t lock;
    char heard[512]; /* kinds with ids */
} listener;

static void hear(void *user, qm_store_news news, const char *id)
{
    static const char *const names[] = {"queued", "canceled", "events"};
    listener *l = user;
    pthread_mutex_lock(&l->lock);
    size_t length = strlen(l->heard);
    snprintf(l->heard + length, sizeof l->heard - length, "%s %s;", names[news], id);
    pthread_mutex_unlock(&l->lock);
}

/** Waits until a node has heard this and nothing else. */
static void check_heard(listener *l, const char *expected)
{
    bool is_same = false;
    for (int i = 0; i < 10000 && !is_same; i++) {
        usleep(1000);
        pthread_mutex_lock(&l->lock);
        is_same = strcmp(l->heard, expected) == 0;
        pthread_mutex_unlock(&l->lock);
    }
    QM_CHECK(is_same, "heard %s, not %s", l->heard, expected);
    l->heard[0] = '\0';
}

static void test_news(void **state)
{
    enum { HEARERS = 2 };
    fixture *f = *state;
    listener listeners[HEARERS] = {{.lock = PTHREAD_MUTEX_INITIALIZER}, {.lock = PTHREAD_MUTEX_INITIALIZER}};
    qm_store_cluster cluster;
    for (int i = 0; i < HEARERS; i++)
        open_node(f, i, f->database);
    qm_store *a = f->stores[0], *b = f->stores[1];
    for (int i = 0; i < HEARERS; i++) {
        assert_int_equal(qm_store_beat(f->stores[i], 1, &cluster, NULL, NULL),
                         QM_STORED); /* which tells of the other one */
        qm_store_watch(f->stores[i], hear, &listeners[i]);
        check_heard(&listeners[i], "queued ;"); /* what may have come before */
    }
    assert_int_equal(submit(a, "j_1", "n1"), QM_STORED);
    check_heard(&listeners[1], "queued ;");
    assert_int_equal(submit(a, "j_2", "n0"), QM_STORED); /* it knows that itself */
    assert_int_equal(submit(a, "j_3", "another"), QM_STORED);
    check_claim(b, 1, 0, 1000.0, "j_1");
    qm_store_run run = {.job = "j_1"};
    const qm_store_event event = {"j_1", 1, "bounds", ""};
    assert_int_equal(qm_store_append_events(b, &run, 1, &event, 1), QM_STORED); /* nobody waits for it */
    assert_int_equal(qm_store_cancel_job(a, "j_1", "{}", &(qm_store_event){"j_1", 2, "error", ""}),
                     QM_STORED_LATE);
    check_heard(&listeners[1], "canceled j_1;");
    qm_database_ask(f->database,
                    "UPDATE quadmeshd.job_runs SET watched = clock_timestamp() + interval '1 min'");
    assert_int_equal(qm_store_append_events(b, &run, 1, &event, 1), QM_STORED);
    check_heard(&listeners[0], "events j_1;");
    assert_int_equal(finish(b, "j_1", 0), QM_STORED);
    check_heard(&listeners[0], "events j_1;");
    /* A connection that breaks is opened again. */
    qm_database_ask(f->database, "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity"
                                 " WHERE query LIKE '%%pg_notify%%' AND query NOT LIKE 'WITH%%'"
                                 " AND pid <> pg_backend_pid()");
    check_heard(&listeners[0], "queued ;");
    qm_store_unwatch(a);
    assert_int_equal(submit(b, "j_4", "n0"), QM_STORED);
    assert_string_equal(listeners[0].heard, "");
}

/* ---- answers that get lost ---- */

/** Verbs that change rows, with the rows that they need. The first of two calls prepares the statement, so that the lost
 * answer of the second one is that of its commit. */
static qm_store_layout make_layout(int n)
{
    qm_store_layout layout = {.mesh = "m", .created = "now", .layout = "{}", .issues = ""};
    snprintf(layout.id, sizeof layout.id, "l_%d", n);
    return layout;
}

static qm_store_reconstruction make_reconstruction(int n)
{
    qm_store_reconstruction r = {.source = "m",
                                 .layout_id = "l",
                                 .layout = "",
                                 .document = "",
                                 .steps = "",
                                 .records = "",
                                 .state = ""};
    snprintf(r.id, sizeof r.id, "r_%d", n);
    snprintf(r.mesh, sizeof r.mesh, "m_%d", n);
    return r;
}

static qm_store_mesh make_mesh(int n)
{
    qm_store_mesh mesh = {.options = "", .name = "", .document = "{}", .created = "now"};
    snprintf(mesh.id, sizeof mesh.id, "m_%d", n);
    snprintf(mesh.hash, sizeof mesh.hash, "hash %d", n);
    return mesh;
}

static const char *name_of(char prefix, int n)
{
    static char name[QM_ID_SIZE];
    snprintf(name, sizeof name, "%c_%d", prefix, n);
    return name;
}

static qm_stored call_submit(qm_store *store, int n)
{
    return submit(store, name_of('j', n), "none");
}

static qm_stored call_submit_claimed(qm_store *store, int n)
{
    return submit_claimed(store, name_of('j', 10 + n));
}

static qm_stored call_claim(qm_store *store, int n)
{
    char ids[256];
    qm_stored stored = claim(store, 0, 1, 0.0, ids);
    if (stored == QM_STORED) assert_string_equal(ids, name_of('j', n));
    return stored;
}

static qm_stored call_cancel(qm_store *store, int n)
{
    char id[QM_ID_SIZE];
    snprintf(id, sizeof id, "j_%d", 20 + n);
    assert_int_equal(submit(store, id, "none"), QM_STORED);
    return QM_STORED;
}

static qm_stored call_cancel_now(qm_store *store, int n)
{
    return qm_store_cancel_job(store, name_of('j', 20 + n), "{}", &(qm_store_event){"", 1, "canceled", ""});
}

static qm_stored call_append(qm_store *store, int n)
{
    qm_store_run run = {.job = name_of('j', 10 + n), .progress = "p"};
    qm_stored stored = qm_store_append_events(store, &run, 1, &(qm_store_event){run.job, 1, "bounds", ""}, 1);
    return run.is_lost ? QM_STORED_LOST : stored;
}

static qm_stored call_finish(qm_store *store, int n)
{
    return finish(store, name_of('j', 10 + n), 0);
}

static qm_stored call_put_mesh(qm_store *store, int n)
{
    const qm_store_mesh mesh = make_mesh(n);
    return qm_store_put_mesh(store, &mesh);
}

static qm_stored call_revise_mesh(qm_store *store, int n)
{
    qm_store_mesh mesh = make_mesh(n);
    mesh.revision = 1, mesh.options = "deformed", snprintf(mesh.positions, sizeof mesh.positions, "hash 1");
    return qm_store_revise_mesh(store, &mesh);
}

static qm_stored call_put_layout(qm_store *store, int n)
{
    const qm_store_layout layout = make_layout(n);
    return qm_store_put_layout(store, &layout, &(qm_store_idempotency){.key = layout.id});
}

static qm_stored call_edit_layout(qm_store *store, int n)
{
    const qm_store_layout layout = make_layout(n);
    return qm_store_edit_layout(store, &layout);
}

static qm_stored call_move_layout(qm_store *store, int n)
{
    return qm_store_move_layout(store, name_of('l', n), 1, 0);
}

static qm_stored call_put_reconstruction(qm_store *store, int n)
{
    const qm_store_reconstruction r = make_reconstruction(n);
    const qm_store_mesh mesh = make_mesh(10 + n);
    return qm_store_put_reconstruction(store, &r, &mesh, &(qm_store_idempotency){.key = r.id});
}

static qm_stored call_update_reconstruction(qm_store *store, int n)
{
    qm_store_reconstruction r = make_reconstruction(n);
    r.revision = 1;
    return qm_store_update_reconstruction(store, &(qm_store_effect){&r, NULL});
}

static qm_stored call_delete_layout(qm_store *store, int n)
{
    return qm_store_delete_layout(store, name_of('l', n));
}

static qm_stored call_delete_mesh(qm_store *store, int n)
{
    return qm_store_delete_mesh(store, name_of('m', n));
}

/** Waits until the store has all its connections anew, so that the next bytes of the server are the answer to a verb. */
static void wait_for_connections(const fixture *f, int64_t since_us)
{
    enum { CONNECTIONS = 8 };
    while (qm_database_ask(f->database,
                           "SELECT count(*) FROM pg_stat_activity WHERE state = 'idle'"
                           " AND application_name LIKE 'quadmeshd/n3' AND datname = current_database()"
                           " AND extract(epoch FROM backend_start) * 1000000 > %lld",
                           (long long)since_us) != CONNECTIONS)
        usleep(1000);
    usleep(20000); /* the last one has been confirmed by the server: the store is to know it, too */
}

static void test_lost_answers(void **state)
{
    static qm_stored (*const calls[])(qm_store *, int) = {call_submit,
                                                          call_submit_claimed,
                                                          call_claim,
                                                          call_cancel,
                                                          call_cancel_now,
                                                          call_append,
                                                          call_finish,
                                                          call_put_mesh,
                                                          call_revise_mesh,
                                                          call_put_layout,
                                                          call_edit_layout,
                                                          call_move_layout,
                                                          call_put_reconstruction,
                                                          call_update_reconstruction,
                                                          call_delete_layout,
                                                          call_delete_mesh};
    fixture *f = *state;
    open_node(f, NODES - 1, f->through);
    qm_store *store = f->stores[NODES - 1];
    int64_t since_us = 0;
    qm_database_ask(f->database, "INSERT INTO quadmeshd.blobs (hash, size, generation)"
                                 " SELECT 'hash ' || i, 0, '' FROM generate_series(1, 12) i");
    for (size_t i = 0; i < sizeof calls / sizeof calls[0]; i++) {
        wait_for_connections(f, since_us);
        qm_stored stored = calls[i](store, 1);
        QM_CHECK(stored == QM_STORED, "call %zu: %d", i, stored);
        since_us = now_us(f);
        qm_cut_set(f->cut, QM_CUT_ANSWER);
        stored = calls[i](store, 2);
        QM_CHECK(stored == QM_STORED, "call %zu without its first answer: %d", i, stored);
        qm_cut_set(f->cut, QM_CUT_NOTHING);
    }
    check_places(f);
    static const struct {
        const char *what;
        int count;
    } rows[] = {{"jobs", 6},
                {"jobs WHERE state = 2", 2},
                {"jobs WHERE state = 4", 2},
                {"job_runs", 2},
                {"job_events", 4},
                {"meshes", 2},
                {"layouts", 0},
                {"reconstructions WHERE revision = 1", 2}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        QM_CHECK(count_rows(f, rows[i].what) == rows[i].count, "%s: %d", rows[i].what,
                 (int)count_rows(f, rows[i].what));
}

/* ---- a database that goes and comes back ---- */

static void end_connections(const fixture *f)
{
    qm_database_ask(f->database,
                    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
                    " WHERE application_name LIKE 'quadmeshd/%%' AND datname = current_database()");
}

typedef struct killer {
    const fixture *f;
    atomic_bool is_over;
} killer;

static void *end_connections_often(void *user)
{
    killer *k = user;
    while (!k->is_over) {
        end_connections(k->f);
        usleep(100000);
    }
    return NULL;
}

#define WRITERS 6
#define JOBS_EACH 40

typedef struct writer {
    qm_store *store;
    int number, acknowledged, answered;
} writer;

static void *write_jobs(void *user)
{
    writer *w = user;
    for (int i = 0; i < JOBS_EACH; i++) {
        char id[QM_ID_SIZE];
        snprintf(id, sizeof id, "j_%d_%d", w->number, i);
        qm_stored stored = submit(w->store, id, "");
        QM_CHECK(stored == QM_STORED || stored == QM_STORED_AWAY, "%s: %d", id, stored);
        w->answered++;
        if (stored != QM_STORED) continue;
        qm_store_job found;
        w->acknowledged++;
        if (qm_store_find_job(w->store, id, &found) == QM_STORED) qm_store_job_reset(&found);
    }
    return NULL;
}

static void test_connections_end(void **state)
{
    fixture *f = *state;
    open_node(f, 0, f->database);
    assert_int_equal(submit(f->stores[0], "j_1", ""), QM_STORED);
    end_connections(f); /* between two verbs: nobody notices */
    assert_int_equal(submit(f->stores[0], "j_2", ""), QM_STORED);
    qm_store_cluster cluster;
    assert_int_equal(qm_store_beat(f->stores[0], 1, &cluster, NULL, NULL), QM_STORED);
    killer k = {.f = f};
    writer writers[WRITERS];
    pthread_t threads[WRITERS], killing;
    int acknowledged = 0;
    pthread_create(&killing, NULL, end_connections_often, &k);
    for (int i = 0; i < WRITERS; i++) {
        writers[i] = (writer){f->stores[0], i, 0, 0};
        pthread_create(&threads[i], NULL, write_jobs, &writers[i]);
    }
    for (int i = 0; i < WRITERS; i++) {
        pthread_join(threads[i], NULL);
        assert_int_equal(writers[i].answered, JOBS_EACH);
        acknowledged += writers[i].acknowledged;
    }
    k.is_over = true;
    pthread_join(killing, NULL);
    int64_t rows = count_rows(f, "jobs") - 2;
    QM_CHECK(rows >= acknowledged && rows <= WRITERS * JOBS_EACH, "%d acknowledged, %d stored", acknowledged,
             (int)rows);
    assert_true(acknowledged > 0);
    check_places(f);
}

static void test_the_database_is_away(void **state)
{
    fixture *f = *state;
    qm_store_job found;
    open_node(f, NODES - 1, f->through);
    qm_store *store = f->stores[NODES - 1];
    assert_int_equal(submit(store, "j_1", ""), QM_STORED);
    static const qm_cut_mode modes[] = {QM_CUT_ALL, QM_CUT_HOLD};
    for (size_t i = 0; i < 2; i++) {
        qm_cut_set(f->cut, modes[i]);
        assert_int_equal(submit(store, name_of('j', 2 + (int)i), ""), QM_STORED_AWAY);
        assert_int_equal(qm_store_find_job(store, "j_1", &found), QM_STORED_AWAY);
        qm_cut_set(f->cut, QM_CUT_NOTHING);
        assert_int_equal(submit(store, name_of('j', 2 + (int)i), ""), QM_STORED);
        assert_int_equal(qm_store_find_job(store, "j_1", &found), QM_STORED);
        qm_store_job_reset(&found);
    }
    assert_int_equal(count_rows(f, "jobs"), 3);
}

/* ---- commits that wait for a standby ---- */

static void set_standbys(const char *names)
{
    const char *server = qm_database_server();
    qm_database_ask(server, "ALTER SYSTEM SET synchronous_standby_names = '%s'", names);
    qm_database_ask(server, "SELECT pg_reload_conf()");
    /* Every process has read it when a new one has. */
    while (qm_database_ask(server, "SELECT (current_setting('synchronous_standby_names') = '%s')::int",
                           names) != 1)
        usleep(10000);
}

static int tear_down_standbys(void **state)
{
    set_standbys("");
    return tear_down(state);
}

typedef struct submitter {
    qm_store *store;
    const char *id;
    qm_stored stored;
    atomic_bool is_over;
} submitter;

static void *submit_one(void *user)
{
    submitter *s = user;
    s->stored = submit(s->store, s->id, "");
    s->is_over = true;
    return NULL;
}

/** Submits a job, and cancels the wait of its commit. False: the server did not wait yet. */
static bool submit_and_cancel(const fixture *f, qm_store *store, const char *id)
{
    submitter s = {store, id, QM_STORED_FAULT, false};
    pthread_t thread;
    pthread_create(&thread, NULL, submit_one, &s);
    while (!s.is_over &&
           qm_database_ask(f->database, "SELECT count(pg_cancel_backend(pid)) FROM pg_stat_activity"
                                        " WHERE wait_event = 'SyncRep' AND query LIKE 'WITH me%%'"
                                        " AND datname = current_database()") == 0)
        usleep(1000);
    pthread_join(thread, NULL);
    return s.stored == QM_STORED_AWAY;
}

/** A commit whose wait was cancelled is there, and no standby has it: it must not be acknowledged, neither by this call
 * nor by an equal one at another node. */
static void test_a_cancelled_wait_is_no_commit(void **state)
{
    fixture *f = *state;
    qm_store_run run = {.job = "j_2"};
    for (int i = 0; i < 3; i++)
        open_node(f, i, f->database);
    assert_int_equal(submit_claimed(f->stores[2], "j_2"), QM_STORED);
    set_standbys("nobody");
    char id[QM_ID_SIZE];
    int tries = 0;
    do {
        QM_CHECK(tries < 100, "the server does not wait");
        usleep(100000);
        snprintf(id, sizeof id, "j_%d", 100 + tries++);
    } while (!submit_and_cancel(f, f->stores[0], id));
    assert_int_equal(count_rows(f, "jobs"), 1 + tries);
    assert_int_equal(submit(f->stores[1], id, ""), QM_STORED_AWAY);
    /* Events do not wait. */
    assert_int_equal(
        qm_store_append_events(f->stores[2], &run, 1, &(qm_store_event){"j_2", 1, "bounds", ""}, 1),
        QM_STORED);
    set_standbys("");
    for (int i = 0; i < 2; i++) {
        qm_stored stored = QM_STORED_AWAY;
        for (int attempt = 0; stored == QM_STORED_AWAY && attempt < 10; attempt++) /* it may still wait */
            stored = submit(f->stores[1 - i], id, "");
        assert_int_equal(stored, QM_STORED);
    }
    assert_int_equal(count_rows(f, "jobs"), 1 + tries);
}

/* ---- searches in parts ---- */

static void open_parts(qm_store *store, const char *id)
{
    const qm_store_part parts[] = {{.upper = 2, .entries = "a", .size = 1},
                                   {.upper = 1, .entries = "b", .size = 1}};
    const qm_store_bounds bounds = {.engine = "e"};
    assert_int_equal(qm_store_open_parts(store, id, 0, &bounds, parts, 2), QM_STORED);
}

/** Claims up to two parts; their entries may be freed. */
static size_t claim_parts(qm_store *store, const char *id, qm_store_part parts[2])
{
    size_t count;
    assert_int_equal(qm_store_claim_parts(store, id, 2, parts, &count), QM_STORED);
    qm_store_parts_reset(parts, count);
    return count;
}

/** A part has one node at a time, and is free again when that one is dead or leaves; the owner's death loses none. */
static void test_parts_of_nodes(void **state)
{
    fixture *f = *state;
    for (int i = 0; i < 3; i++)
        open_node(f, i, f->database);
    qm_store *a = f->stores[0], *b = f->stores[1], *c = f->stores[2];
    qm_store_part of_b[2], of_c[2];
    qm_store_job job;
    qm_store_bounds bounds;
    const qm_store_bounds found = {.lower = 0.5, .witness = "w"};
    size_t count;
    assert_int_equal(qm_store_find_split_job(b, NULL, 0, &job), QM_STORED_NONE);
    assert_int_equal(submit_claimed(a, "j_a"), QM_STORED);
    open_parts(a, "j_a");
    assert_int_equal(qm_store_find_split_job(a, NULL, 0, &job), QM_STORED_NONE); /* it is its own */
    assert_int_equal(qm_store_find_split_job(b, NULL, 0, &job), QM_STORED);
    assert_string_equal(job.id, "j_a");
    qm_store_job_reset(&job);
    const char except[][QM_ID_SIZE] = {"j_a"};
    assert_int_equal(qm_store_find_split_job(b, except, 1, &job), QM_STORED_NONE);

    assert_int_equal(claim_parts(b, "j_a", of_b), 2);
    assert_int_equal(claim_parts(c, "j_a", of_c), 0);
    assert_int_equal(qm_store_find_split_job(c, NULL, 0, &job), QM_STORED_NONE);
    assert_int_equal(qm_store_read_bounds(c, "j_a", NULL, 0, &bounds), QM_STORED);
    assert_int_equal(bounds.nodes, 1);
    assert_int_equal(claim_parts(b, "j_a", of_b), 2); /* as after an answer that was lost */

    silence(f, "n1");
    assert_int_equal(qm_store_reap(a, 10, &count), QM_STORED);
    assert_int_equal(claim_parts(c, "j_a", of_c), 2);
    assert_int_equal(qm_store_finish_parts(b, "j_a", of_b, 2, &found, NULL, 0), QM_STORED_LOST);
    assert_int_equal(qm_store_raise_lower(b, "j_a", 0.5, "w"), QM_STORED); /* which holds for ever */
    assert_int_equal(qm_store_leave_jobs(c), QM_STORED);
    assert_int_equal(claim_parts(a, "j_a", of_b), 2);
    assert_int_equal(qm_store_finish_parts(c, "j_a", of_c, 2, &found, NULL, 0), QM_STORED_LOST);

    /* The job is another node's now: the parts stay, and the first owner opens none. */
    silence(f, "n0");
    assert_int_equal(qm_store_join(b), QM_STORED);
    assert_int_equal(qm_store_reap(b, 10, &count), QM_STORED);
    assert_int_equal(qm_store_open_parts(a, "j_a", 0, &found, NULL, 0), QM_STORED_LOST);
    check_claim(b, 1, 0, 0, "j_a");
    assert_int_equal(claim_parts(b, "j_a", of_b), 2);
    check_job(b, "j_a", QM_JOB_RUNNING, 1, 1);
    assert_int_equal(qm_store_finish_parts(b, "j_a", of_b, 1, &found, NULL, 0), QM_STORED);
    check_job(b, "j_a", QM_JOB_RUNNING, 1, 0); /* it gets on */
    assert_int_equal(qm_store_read_bounds(b, "j_a", NULL, 0, &bounds), QM_STORED);
    assert_true(bounds.parts == 1 && bounds.lower == 0.5);
    assert_int_equal(finish(b, "j_a", 1), QM_STORED);
    assert_int_equal(count_rows(f, "job_parts"), 0);
    assert_int_equal(count_rows(f, "job_bounds"), 0);
}

/* ---- opening ---- */

static qm_stored try_to_open(fixture *f, const char *address, bool is_unsafe, char message[QM_MESSAGE_SIZE])
{
    if (!f->folders[0]) f->folders[0] = qm_folder_make();
    const qm_store_node self = {.name = "n0", .version = "test", .workers = 1, .memory = 1};
    qm_stored stored = qm_store_open_shared(address, f->folders[0], &self, is_unsafe, &f->stores[0], message);
    if (stored == QM_STORED) qm_store_close(f->stores[0]);
    f->stores[0] = NULL;
    return stored;
}

static void test_what_is_not_opened(void **state)
{
    fixture *f = *state;
    char message[QM_MESSAGE_SIZE] = "";
    qm_cut_set(f->cut, QM_CUT_ALL);
    assert_int_equal(try_to_open(f, f->through, false, message), QM_STORED_AWAY);
    assert_non_null(strstr(message, "database: "));
    assert_int_equal(try_to_open(f, f->database, false, message), QM_STORED);
    qm_database_ask(f->database, "ALTER DATABASE %s SET synchronous_commit = off",
                    strrchr(f->database, '/') + 1);
    assert_int_equal(try_to_open(f, f->database, false, message), QM_STORED_FULL);
    assert_non_null(strstr(message, "synchronous_commit"));
    assert_int_equal(try_to_open(f, f->database, true, message), QM_STORED);
    qm_database_ask(f->database, "UPDATE quadmeshd.about SET version = 1000");
    assert_int_equal(try_to_open(f, f->database, true, message), QM_STORED_FAULT);
    assert_non_null(strstr(message, "version 1000"));
    assert_int_equal(qm_database_ask(f->database, "SELECT version FROM quadmeshd.about"), 1000);
}

/** Tables of version 1 become those of this version at a start while no node lives, or when they are asked to. */
static void test_earlier_tables(void **state)
{
    fixture *f = *state;
    char message[QM_MESSAGE_SIZE] = "";
    assert_int_equal(try_to_open(f, f->database, false, message), QM_STORED);
    int64_t version = qm_database_ask(f->database, "SELECT version FROM quadmeshd.about");
    for (int is_asked = 0; is_asked < 2; is_asked++) {
        qm_database_age(f->database);
        qm_database_ask(f->database, "UPDATE quadmeshd.nodes SET state = 0");
        qm_database_ask(f->database, "UPDATE quadmeshd.node_beats SET beat = clock_timestamp()");
        assert_int_equal(try_to_open(f, f->database, false, message), QM_STORED_FAULT);
        assert_non_null(strstr(message, "--migrate"));
        assert_int_equal(qm_database_ask(f->database, "SELECT version FROM quadmeshd.about"), 1);
        if (is_asked)
            assert_int_equal(
                qm_store_migrate(f->database, &(qm_store_node){.name = "n0", .version = ""}, message),
                QM_STORED);
        else
            qm_database_ask(f->database, "UPDATE quadmeshd.nodes SET state = 2");
        assert_int_equal(try_to_open(f, f->database, false, message), QM_STORED);
        assert_int_equal(qm_database_ask(f->database, "SELECT version FROM quadmeshd.about"), version);
        assert_int_equal(count_rows(f, "job_parts"), 0);
    }
    /* The next version only adds to the tables of this one; the one after may drop some. */
    qm_database_ask(f->database, "UPDATE quadmeshd.about SET version = version + 1");
    assert_int_equal(try_to_open(f, f->database, false, message), QM_STORED);
    qm_database_ask(f->database, "UPDATE quadmeshd.about SET version = version + 1");
    assert_int_equal(try_to_open(f, f->database, false, message), QM_STORED_FAULT);
}

static void *open_one(void *user)
{
    fixture *f = user;
    char message[QM_MESSAGE_SIZE] = "";
    static atomic_int next;
    int i = atomic_fetch_add(&next, 1);
    qm_store_node self = {.version = "test", .workers = 1, .memory = 1};
    snprintf(self.name, sizeof self.name, "n%d", i);
    qm_stored stored = qm_store_open_shared(f->database, f->folders[i], &self, false, &f->stores[i], message);
    QM_CHECK(stored == QM_STORED, "%s", message);
    return NULL;
}

/** Nodes that start at once make the tables once. */
static void test_tables_are_made_once(void **state)
{
    fixture *f = *state;
    pthread_t threads[NODES];
    for (int i = 0; i < NODES; i++)
        f->folders[i] = qm_folder_make();
    for (int i = 0; i < NODES; i++)
        pthread_create(&threads[i], NULL, open_one, f);
    for (int i = 0; i < NODES; i++)
        pthread_join(threads[i], NULL);
    assert_int_equal(count_rows(f, "about"), 1);
    assert_int_equal(count_rows(f, "nodes"), NODES);
}

/* What holds behind a proxy that gives each transaction another session. */
#define ANYWHERE(XX)                                                                                         \
    XX(test_claims)                                                                                          \
    XX(test_claims_by_nodes)                                                                                 \
    XX(test_claims_tell_how_long_a_job_has_waited)                                                           \
    XX(test_a_claim_while_jobs_are_submitted)                                                                \
    XX(test_a_beat_tells_durable_events)                                                                     \
    XX(test_the_last_run_counts_from_its_beginning)                                                          \
    XX(test_a_silent_node_loses_its_jobs)                                                                    \
    XX(test_a_node_that_starts_again)                                                                        \
    XX(test_a_node_that_leaves)                                                                              \
    XX(test_homes)                                                                                           \
    XX(test_cancels)                                                                                         \
    XX(test_owners)                                                                                          \
    XX(test_looks)                                                                                           \
    XX(test_many_events)                                                                                     \
    XX(test_parts_of_nodes)                                                                                  \
    XX(test_earlier_tables)                                                                                  \
    XX(test_tables_are_made_once)

/* These count or end sessions of the server, or hear news. */
#define DIRECT(XX)                                                                                           \
    XX(test_claims_that_were_not_heard_of)                                                                   \
    XX(test_news)                                                                                            \
    XX(test_lost_answers)                                                                                    \
    XX(test_connections_end)                                                                                 \
    XX(test_the_database_is_away)                                                                            \
    XX(test_what_is_not_opened)

#define TEST(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down),

int main(void)
{
    const struct CMUnitTest anywhere[] = {ANYWHERE(TEST)};
    const struct CMUnitTest direct[] = {DIRECT(TEST) cmocka_unit_test_setup_teardown(
        test_a_cancelled_wait_is_no_commit, set_up, tear_down_standbys)};
    if (!qm_database_server()) {
        printf("NOT RUN %zu: QM_TEST_POSTGRES names no server\n",
               (sizeof anywhere + sizeof direct) / sizeof anywhere[0]);
        return 0;
    }
    int failed = cmocka_run_group_tests(anywhere, NULL, NULL);
    if (!getenv("QM_TEST_PROXY")) failed += cmocka_run_group_tests(direct, NULL, NULL);
    return failed;
}
