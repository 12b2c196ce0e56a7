/*
 * What store.h promises of verbs on rows holds for both kinds of store: repetitions, races of threads, rows that are not
 * as expected. The shared store needs a server (QM_TEST_POSTGRES, tests/support/database.h); test_store_nodes.c has what
 * only nodes do.
 */
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "base/id.h"
#include "check.h"
#include "database.h"
#include "folder.h"
#include "store/blob.h"
#include "store/store.h"
#include "store/store_parts.h"
#include "stored.h"

#define THREADS 8

/** Runs a function in several threads, each with its number. */
typedef struct task {
    qm_store *store;
    int number;
    void (*run)(struct task *task);
    atomic_int *good; /* calls that returned QM_STORED */
} task;

static void *run_task(void *user)
{
    task *t = user;
    t->run(t);
    return NULL;
}

static int run_threads(qm_store *store, void (*run)(task *task))
{
    pthread_t threads[THREADS];
    task tasks[THREADS];
    atomic_int good = 0;
    for (int i = 0; i < THREADS; i++) {
        tasks[i] = (task){store, i, run, &good};
        assert_int_equal(pthread_create(&threads[i], NULL, run_task, &tasks[i]), 0);
    }
    for (int i = 0; i < THREADS; i++)
        pthread_join(threads[i], NULL);
    return good;
}

/* ---- meshes ---- */

static qm_store_mesh make_mesh(qm_store *store, const char *id, const char *content)
{
    qm_store_mesh mesh = {.options = "format=off",
                          .name = "a \"name\"",
                          .document = "{\"a\":\"\\\\ \\u00e9\"}",
                          .created = "2026-01-02T03:04:05.678Z",
                          .format = 3,
                          .notes = {.unit = "mm", .uncertainty = 0.125},
                          .labels = "a:1 b"};
    snprintf(mesh.id, sizeof mesh.id, "%s", id);
    assert_true(qm_stored_keep_blob(store, content, mesh.hash));
    return mesh;
}

static void check_mesh(qm_store *store, const qm_store_mesh *expected)
{
    qm_store_mesh found;
    assert_int_equal(qm_store_find_mesh(store, expected->id, &found), QM_STORED);
    assert_string_equal(found.id, expected->id);
    assert_string_equal(found.hash, expected->hash);
    assert_string_equal(found.options, expected->options);
    assert_string_equal(found.name, expected->name);
    assert_string_equal(found.document, expected->document);
    assert_string_equal(found.created, expected->created);
    assert_string_equal(found.positions, expected->positions);
    assert_int_equal(found.format, expected->format);
    assert_int_equal(found.revision, expected->revision);
    assert_string_equal(found.notes.unit, expected->notes.unit);
    assert_true(found.notes.uncertainty == expected->notes.uncertainty);
    assert_string_equal(found.labels, expected->labels ? expected->labels : "");
    qm_store_mesh_reset(&found);
    qm_store_mesh_state state;
    assert_int_equal(qm_store_find_mesh_state(store, expected->id, &state), QM_STORED);
    assert_int_equal(state.revision, expected->revision);
    assert_string_equal(state.notes.unit, expected->notes.unit);
    assert_true(state.notes.uncertainty == expected->notes.uncertainty);
}

/** States of many, and the newest meshes of contents, come in the order that was asked for, with gaps. */
static void test_many_at_once(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_mesh one = make_mesh(store, "m_1", "content"), two = make_mesh(store, "m_2", "other");
    qm_store_mesh again = make_mesh(store, "m_3", "content");
    again.options = "another name";
    assert_int_equal(qm_store_put_mesh(store, &one), QM_STORED);
    assert_int_equal(qm_store_put_mesh(store, &two), QM_STORED);
    assert_int_equal(qm_store_put_mesh(store, &again), QM_STORED);
    const char *const ids[] = {"m_2", "none", "m_1", "m_2", "{a,\"b\\", ""};
    enum { IDS = sizeof ids / sizeof *ids };
    qm_store_mesh_state states[IDS];
    assert_int_equal(qm_store_find_mesh_states(store, ids, IDS, states), QM_STORED);
    for (int i = 0; i < IDS; i++)
        assert_int_equal(states[i].is_found, i == 0 || i == 2 || i == 3);
    assert_string_equal(states[0].hash, two.hash);
    assert_string_equal(states[2].hash, one.hash);
    assert_string_equal(states[2].positions, "");
    assert_int_equal(states[3].format, two.format);
    assert_int_equal(qm_store_find_mesh_states(store, ids, 0, states), QM_STORED);
    const char *const hashes[] = {two.hash, "none", one.hash};
    char found[3][QM_ID_SIZE];
    assert_int_equal(qm_store_find_undeformed(store, hashes, 3, found), QM_STORED);
    assert_string_equal(found[0], "m_2");
    assert_string_equal(found[1], "");
    assert_string_equal(found[2], "m_3");
    again.revision = 1;
    assert_int_equal(qm_store_revise_mesh(store, &again), QM_STORED);
    assert_int_equal(qm_store_find_undeformed(store, hashes, 3, found), QM_STORED);
    assert_string_equal(found[2], "m_1");
}

/** Notes come with a new row, are changed by themselves, and stay through a revision; labels find meshes. */
static void test_notes(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_mesh a = make_mesh(store, "m_a", "content"), b = make_mesh(store, "m_b", "other"), found[3];
    size_t count;
    a.notes = (qm_notes){"mm", 0.1};
    a.labels = "\nnightly\npart-7\n";
    assert_int_equal(qm_store_put_mesh(store, &a), QM_STORED);
    assert_int_equal(qm_store_put_mesh(store, &b), QM_STORED);
    check_mesh(store, &a);
    check_mesh(store, &b);
    const qm_store_page page = {.limit = 3};
    static const char *const labels[] = {"nightly", "part-7", "night", "", "%", "part-7\nnightly"};
    for (size_t i = 0; i < sizeof labels / sizeof *labels; i++) {
        const qm_store_mesh_filter filter = {.label = labels[i]};
        assert_int_equal(qm_store_list_meshes(store, &page, &filter, found, &count), QM_STORED);
        assert_int_equal(count, i < 2 ? 1 : 0);
        if (count > 0) assert_string_equal(found[0].id, "m_a");
        for (size_t k = 0; k < count; k++)
            qm_store_mesh_reset(&found[k]);
    }
    a.notes = (qm_notes){"", 0x1.123456789abcdp-7};
    a.labels = "";
    a.options = "noted m_a";
    assert_int_equal(qm_store_set_notes(store, &a), QM_STORED);
    assert_int_equal(qm_store_set_notes(store, &a), QM_STORED);
    check_mesh(store, &a);
    a.revision = 1;
    assert_true(qm_stored_keep_blob(store, "moved", a.positions));
    assert_int_equal(qm_store_revise_mesh(store, &a), QM_STORED);
    check_mesh(store, &a);
    snprintf(a.id, sizeof a.id, "m_none");
    assert_int_equal(qm_store_set_notes(store, &a), QM_STORED_NONE);
}

static void test_meshes(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_mesh a = make_mesh(store, "m_a", "content"), b = a, found;
    assert_int_equal(qm_store_find_mesh(store, "m_a", &found), QM_STORED_NONE);
    assert_int_equal(qm_store_put_mesh(store, &a), QM_STORED);
    assert_int_equal(qm_store_put_mesh(store, &a), QM_STORED);
    check_mesh(store, &a);
    snprintf(b.id, sizeof b.id, "m_b");
    assert_int_equal(qm_store_put_mesh(store, &b), QM_STORED_TAKEN);
    assert_int_equal(qm_store_find_mesh(store, "m_b", &found), QM_STORED_NONE);
    b.options = "format=off name=b", b.name = "b";
    assert_int_equal(qm_store_put_mesh(store, &b), QM_STORED);
    check_mesh(store, &b);
    assert_int_equal(qm_store_find_mesh_by_content(store, b.hash, b.options, &found), QM_STORED);
    assert_string_equal(found.id, "m_b");
    qm_store_mesh_reset(&found);
    assert_int_equal(qm_store_find_mesh_by_content(store, b.hash, "", &found), QM_STORED_NONE);
    assert_int_equal(qm_store_delete_mesh(store, "m_a"), QM_STORED);
    assert_int_equal(qm_store_delete_mesh(store, "m_a"), QM_STORED_NONE);
    assert_int_equal(qm_blob_check(store, b.hash), QM_OK); /* another row has it */
}

static void test_lists_of_meshes(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    char id[QM_ID_SIZE], name[16], options[32];
    for (int i = 0; i < 10; i++) {
        snprintf(id, sizeof id, "m_%d", i);
        snprintf(name, sizeof name, "%s", i % 2 ? "odd" : "even");
        snprintf(options, sizeof options, "%d", i);
        qm_store_mesh mesh = make_mesh(store, id, i < 5 ? "small" : "large");
        mesh.name = name, mesh.options = options;
        assert_int_equal(qm_store_put_mesh(store, &mesh), QM_STORED);
    }
    qm_store_mesh rows[10];
    size_t count, seen = 0;
    const qm_store_mesh_filter all = {0}, odd = {.name = "odd"};
    qm_store_page page = {.limit = 3};
    do { /* page by page, upwards */
        assert_int_equal(qm_store_list_meshes(store, &page, &all, rows, &count), QM_STORED);
        for (size_t i = 0; i < count; i++) {
            snprintf(id, sizeof id, "m_%zu", seen++);
            assert_string_equal(rows[i].id, id);
            page.after = rows[i].sequence;
            qm_store_mesh_reset(&rows[i]);
        }
    } while (count == 3);
    assert_int_equal(seen, 10);
    page = (qm_store_page){.newest_first = true, .limit = 10};
    assert_int_equal(qm_store_list_meshes(store, &page, &odd, rows, &count), QM_STORED);
    assert_int_equal(count, 5);
    assert_string_equal(rows[0].id, "m_9");
    for (size_t i = 0; i < count; i++)
        qm_store_mesh_reset(&rows[i]);
}

static void put_same_content(task *t)
{
    char id[QM_ID_SIZE];
    snprintf(id, sizeof id, "m_%d", t->number);
    qm_store_mesh mesh = make_mesh(t->store, id, "the same");
    qm_stored stored = qm_store_put_mesh(t->store, &mesh);
    if (stored == QM_STORED) atomic_fetch_add(t->good, 1);
    QM_CHECK(stored == QM_STORED || stored == QM_STORED_TAKEN, "%d", stored);
}

static void test_one_row_of_a_content(void **state)
{
    assert_int_equal(run_threads(((qm_stored_fixture *)*state)->store, put_same_content), 1);
}

static void test_revisions(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_mesh mesh = make_mesh(store, "m_a", "content"), next = mesh;
    next.revision = 1, next.options = "deformed m_a", next.document = "{\"revision\":1}";
    assert_true(qm_stored_keep_blob(store, "positions of 1", next.positions));
    assert_int_equal(qm_store_revise_mesh(store, &next), QM_STORED_NONE);
    assert_int_equal(qm_store_put_mesh(store, &mesh), QM_STORED);
    assert_int_equal(qm_store_revise_mesh(store, &next), QM_STORED);
    assert_int_equal(qm_store_revise_mesh(store, &next), QM_STORED); /* an equal call */
    check_mesh(store, &next);
    qm_store_mesh stale = next;
    assert_true(qm_stored_keep_blob(store, "other positions of 1", stale.positions));
    assert_int_equal(qm_store_revise_mesh(store, &stale), QM_STORED_LATE);
    stale.revision = 3;
    assert_int_equal(qm_store_revise_mesh(store, &stale), QM_STORED_LATE);
    check_mesh(store, &next);
}

#define EACH 5 /* changes by each thread */

static void revise_again_and_again(task *t)
{
    for (int i = 0; i < EACH; i++) {
        for (;;) {
            qm_store_mesh mesh;
            char text[64];
            assert_int_equal(qm_store_find_mesh(t->store, "m_a", &mesh), QM_STORED);
            mesh.revision++;
            snprintf(text, sizeof text, "thread %d change %d of %d", t->number, i, (int)mesh.revision);
            bool is_kept = qm_stored_keep_blob(t->store, text, mesh.positions);
            qm_stored stored = is_kept ? qm_store_revise_mesh(t->store, &mesh) : QM_STORED_FAULT;
            qm_store_mesh_reset(&mesh);
            QM_CHECK(stored == QM_STORED || stored == QM_STORED_LATE, "%d", stored);
            if (stored == QM_STORED) break;
        }
        atomic_fetch_add(t->good, 1);
    }
}

/** No revision is missing, and none is written twice. */
static void test_revisions_by_threads(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_mesh mesh = make_mesh(store, "m_a", "content");
    qm_store_mesh_state state_now;
    assert_int_equal(qm_store_put_mesh(store, &mesh), QM_STORED);
    assert_int_equal(run_threads(store, revise_again_and_again), THREADS * EACH);
    assert_int_equal(qm_store_find_mesh_state(store, "m_a", &state_now), QM_STORED);
    assert_int_equal(state_now.revision, THREADS * EACH);
}

static qm_store_job make_job(const char *id, const char *key)
{
    qm_store_job job = {.key = "hash of the request",
                        .idempotency_key = (char *)(uintptr_t)key,
                        .body = "{\"type\":\"distance\"}",
                        .type = "distance",
                        .created = "2026-01-02T03:04:05.678Z"};
    snprintf(job.id, sizeof job.id, "%s", id);
    return job;
}

/** A job of this process. */
static qm_stored submit(qm_store *store, const qm_store_job *job)
{
    return qm_store_submit_job(store, &(qm_store_submission){job, "one", 100, true, true});
}

static void end_job(qm_store *store, const char *id, const char *revisions)
{
    qm_store_job end = make_job(id, NULL);
    end.state = QM_JOB_SUCCEEDED, end.document = "\"state\":\"succeeded\"", end.result = "{\"lower\":1}";
    assert_int_equal(qm_store_finish_job(store, &end, revisions, NULL, 0, NULL), QM_STORED);
}

/** A mesh that a job, a layout or a reconstruction needs stays. */
static void test_expiry(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    char past[QM_TIME_SIZE], now[QM_TIME_SIZE], future[QM_TIME_SIZE];
    qm_store_mesh mesh = make_mesh(store, "m_a", "content"), found;
    qm_clock_format_steady(-100.0, past);
    qm_clock_format_steady(0.0, now);
    qm_clock_format_steady(100.0, future);
    assert_int_equal(qm_store_put_mesh(store, &mesh), QM_STORED);
    assert_int_equal(qm_store_set_expiry(store, "m_none", past), QM_STORED_NONE);
    assert_int_equal(qm_store_find_expired_mesh(store, future, &found), QM_STORED_NONE);
    assert_int_equal(qm_store_set_expiry(store, "m_a", future), QM_STORED);
    assert_int_equal(qm_store_find_expired_mesh(store, now, &found), QM_STORED_NONE);
    assert_int_equal(qm_store_set_expiry(store, "m_a", past), QM_STORED);
    assert_int_equal(qm_store_find_expired_mesh(store, now, &found), QM_STORED);
    assert_string_equal(found.id, "m_a");
    assert_int_equal(strlen(found.expires), strlen(past));
    assert_memory_equal(found.expires, past, 13); /* another clock gives other seconds */
    qm_store_mesh_reset(&found);
    qm_store_job job = make_job("j_a", NULL);
    job.subjects = "m_a m_a";
    assert_int_equal(submit(store, &job), QM_STORED);
    assert_int_equal(qm_store_find_expired_mesh(store, now, &found), QM_STORED_NONE);
    end_job(store, "j_a", "");
    assert_int_equal(qm_store_find_expired_mesh(store, now, &found), QM_STORED);
    qm_store_mesh_reset(&found);
    qm_store_layout layout = {.id = "l_a", .mesh = "m_a", .created = now, .layout = "{}", .issues = "[]"};
    assert_int_equal(qm_store_put_layout(store, &layout, &(qm_store_idempotency){0}), QM_STORED);
    assert_int_equal(qm_store_find_expired_mesh(store, now, &found), QM_STORED_NONE);
    assert_int_equal(qm_store_delete_layout(store, "l_a"), QM_STORED);
    assert_int_equal(qm_store_set_expiry(store, "m_a", ""), QM_STORED);
    assert_int_equal(qm_store_find_expired_mesh(store, future, &found), QM_STORED_NONE);
}

/* ---- jobs ---- */

static void test_submissions(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job a = make_job("j_a", "key"), b = make_job("j_b", "key"), c = make_job("j_c", NULL), found;
    assert_int_equal(qm_store_find_job(store, "j_a", &found), QM_STORED_NONE);
    assert_int_equal(submit(store, &a), QM_STORED);
    assert_int_equal(submit(store, &a), QM_STORED); /* an equal call */
    assert_int_equal(submit(store, &b), QM_STORED_TAKEN);
    assert_int_equal(qm_store_find_job(store, "j_b", &found), QM_STORED_NONE);
    assert_int_equal(submit(store, &c), QM_STORED);
    assert_int_equal(qm_store_find_job_by_idempotency_key(store, "key", &found), QM_STORED);
    assert_string_equal(found.id, "j_a");
    assert_string_equal(found.key, a.key);
    assert_string_equal(found.body, a.body);
    assert_string_equal(found.created, a.created);
    assert_null(found.document);
    assert_null(found.result);
    assert_int_equal(found.restarts, 0);
    assert_true(found.state <= QM_JOB_RUNNING);
    qm_store_job_reset(&found);
    assert_int_equal(qm_store_find_job_by_idempotency_key(store, "another", &found), QM_STORED_NONE);
}

static void submit_one_key(task *t)
{
    char id[QM_ID_SIZE];
    snprintf(id, sizeof id, "j_%d", t->number);
    qm_store_job job = make_job(id, "one key");
    qm_stored stored = submit(t->store, &job);
    if (stored == QM_STORED) atomic_fetch_add(t->good, 1);
    QM_CHECK(stored == QM_STORED || stored == QM_STORED_TAKEN, "%d", stored);
    qm_store_job found; /* whichever it is, it is there */
    assert_int_equal(qm_store_find_job_by_idempotency_key(t->store, "one key", &found), QM_STORED);
    qm_store_job_reset(&found);
}

static void test_one_job_of_a_key(void **state)
{
    assert_int_equal(run_threads(((qm_stored_fixture *)*state)->store, submit_one_key), 1);
}

/** Events as one text: seq name members, a line each. */
static bool print_event(void *user, const qm_store_event *event)
{
    qm_text_printf(user, "%d %s %s\n", (int)event->seq, event->name, event->members);
    return true;
}

static void check_events(qm_store *store, const char *id, uint64_t after, const char *expected)
{
    qm_text text = {0};
    qm_text_add_string(&text, "");
    assert_int_equal(qm_store_read_events(store, id, after, print_event, &text), QM_STORED);
    assert_string_equal(text.data, expected);
    qm_text_reset(&text);
}

static bool refuse_event(void *user, const qm_store_event *event)
{
    (void)user, (void)event;
    return false;
}

static void test_events(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job a = make_job("j_a", NULL), b = make_job("j_b", NULL);
    assert_int_equal(submit(store, &a), QM_STORED);
    assert_int_equal(submit(store, &b), QM_STORED);
    qm_store_run runs[] = {{.job = "j_a", .progress = "\"lower\":1"}, {.job = "j_b"}};
    const qm_store_event events[] = {{"j_a", 1, "queued", ""},
                                     {"j_b", 1, "queued", "\"b\":\"{1,2}\""},
                                     {"j_a", 2, "bounds", "\"lower\":0"},
                                     {"j_a", 2, "bounds", "\"lower\":1,\"q\":\"\\\\\""},
                                     {"j_a", 1000000001, "bounds", "\"lower\":2"}};
    assert_int_equal(qm_store_append_events(store, runs, 2, events, 4), QM_STORED);
    assert_false(runs[0].is_lost || runs[0].is_canceled || runs[0].is_watched || runs[1].is_lost);
    assert_int_equal(qm_store_append_events(store, runs, 2, events + 1, 4), QM_STORED);
    check_events(store, "j_a", 0,
                 "1 queued \n2 bounds \"lower\":1,\"q\":\"\\\\\"\n1000000001 bounds \"lower\":2\n");
    check_events(store, "j_a", 2, "1000000001 bounds \"lower\":2\n");
    check_events(store, "j_b", 0, "1 queued \"b\":\"{1,2}\"\n");
    check_events(store, "j_none", 0, "");
    assert_int_equal(qm_store_read_events(store, "j_a", 0, refuse_event, NULL), QM_STORED_NO_MEMORY);
    end_job(store, "j_a", ""); /* one that has ended stays as it is */
    assert_int_equal(qm_store_append_events(store, runs, 2, &(qm_store_event){"j_a", 7, "late", ""}, 1),
                     QM_STORED);
    check_events(store, "j_a", 2, "1000000001 bounds \"lower\":2\n");
    assert_int_equal(qm_store_append_events(store, runs, 0, NULL, 0), QM_STORED);
}

static void test_ends(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job job = make_job("j_a", NULL), end = job, found;
    const qm_store_event last = {"j_a", 5, "result", "\"x\":1"}, other = {"j_a", 6, "result", "\"x\":2"};
    end.state = QM_JOB_SUCCEEDED, end.document = "\"state\":\"succeeded\"", end.result = "{\"upper\":2}";
    assert_int_equal(qm_store_finish_job(store, &end, "0 1", &last, 1, NULL), QM_STORED_LOST);
    assert_int_equal(submit(store, &job), QM_STORED);
    end.restarts = 1; /* of a claim that never was */
    assert_int_equal(qm_store_finish_job(store, &end, "0 1", &last, 1, NULL), QM_STORED_LOST);
    check_events(store, "j_a", 0, "");
    end.restarts = 0;
    assert_int_equal(qm_store_finish_job(store, &end, "0 1", &last, 1, NULL), QM_STORED);
    end.document = "\"again\"";
    assert_int_equal(qm_store_finish_job(store, &end, "0 2", &other, 1, NULL), QM_STORED);
    end.state = QM_JOB_FAILED; /* in another way */
    assert_int_equal(qm_store_finish_job(store, &end, "0 1", &other, 1, NULL), QM_STORED_LOST);
    check_events(store, "j_a", 0, "5 result \"x\":1\n");
    assert_int_equal(qm_store_find_job(store, "j_a", &found), QM_STORED);
    assert_int_equal(found.state, QM_JOB_SUCCEEDED);
    assert_string_equal(found.document, "\"state\":\"succeeded\"");
    assert_string_equal(found.result, "{\"upper\":2}");
    qm_store_job_reset(&found);
    assert_int_equal(qm_store_find_job_by_key(store, job.key, "0 1", QM_JOB_SUCCEEDED, &found), QM_STORED);
    qm_store_job_reset(&found);
    assert_int_equal(qm_store_find_job_by_key(store, job.key, "0 2", QM_JOB_SUCCEEDED, &found),
                     QM_STORED_NONE);
    assert_int_equal(qm_store_forget_answer(store, "j_a"), QM_STORED);
    assert_int_equal(qm_store_find_job_by_key(store, job.key, "0 1", QM_JOB_SUCCEEDED, &found),
                     QM_STORED_NONE);
}

static void test_lists_of_jobs(void **state)
{
    qm_stored_fixture *f = *state;
    qm_store *store = f->store;
    for (int i = 0; i < 9; i++) {
        char id[QM_ID_SIZE];
        snprintf(id, sizeof id, "j_%d", i);
        qm_store_job job = make_job(id, NULL);
        job.type = i % 3 ? "distance" : "collision";
        job.subjects = i % 2 ? "m_odd m_all" : "m_even m_all";
        job.labels = i % 2 ? "\nnight\nci\n" : NULL;
        assert_int_equal(submit(store, &job), QM_STORED);
        if (i < 5) end_job(store, id, "");
    }
    const qm_job_state succeeded = QM_JOB_SUCCEEDED,
                       unfinished = f->database ? QM_JOB_RUNNING : QM_JOB_QUEUED;
    const struct {
        qm_store_job_filter filter;
        size_t count;
        const char *first;
    } cases[] = {{{NULL, NULL, NULL, NULL}, 9, "j_8"},
                 {{"collision", NULL, NULL, NULL}, 3, "j_6"},
                 {{NULL, "m_odd", NULL, NULL}, 4, "j_7"},
                 {{NULL, NULL, &succeeded, NULL}, 5, "j_4"},
                 {{NULL, NULL, &unfinished, NULL}, 4, "j_8"},
                 {{"distance", "m_all", &succeeded, NULL}, 3, "j_4"},
                 {{NULL, NULL, NULL, "ci"}, 4, "j_7"},
                 {{NULL, NULL, NULL, "late"}, 1, "j_0"},
                 {{"distance", "m_all", &unfinished, "ci"}, 2, "j_7"}};
    assert_int_equal(qm_store_set_job_labels(store, "j_0", "\nlate\nci/x\n"), QM_STORED);
    assert_int_equal(qm_store_set_job_labels(store, "none", ""), QM_STORED_NONE);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        qm_store_job rows[9];
        size_t count;
        const qm_store_page page = {.newest_first = true, .limit = 9};
        assert_int_equal(qm_store_list_jobs(store, &page, &cases[i].filter, rows, &count), QM_STORED);
        assert_int_equal(count, cases[i].count);
        assert_string_equal(rows[0].id, cases[i].first);
        for (size_t row = 0; row < count; row++)
            qm_store_job_reset(&rows[row]);
    }
    char ids[9][QM_ID_SIZE];
    size_t count;
    assert_int_equal(qm_store_drop_old_jobs(store, 100, 0.0, 9, ids, &count), QM_STORED);
    assert_int_equal(count, 0);
    assert_int_equal(qm_store_drop_old_jobs(store, 6, 0.0, 2, ids, &count), QM_STORED);
    assert_int_equal(count, 2);
    assert_int_equal(qm_store_drop_old_jobs(store, 6, 0.0, 9, ids, &count), QM_STORED);
    assert_int_equal(count, 1);
    assert_string_equal(ids[0], "j_2");
    assert_int_equal(qm_store_drop_old_jobs(store, 0, 0.0, 9, ids, &count),
                     QM_STORED); /* but those that run */
    assert_int_equal(count, 2);
    assert_int_equal(qm_store_delete_job(store, "j_5"), QM_STORED);
    assert_int_equal(qm_store_delete_job(store, "j_5"), QM_STORED_NONE);
}

static void test_arrays(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job job = make_job("j_a", NULL);
    uint64_t sums[] = {0, UINT64_MAX, 0x0102030405060708};
    qm_store_array array = {2 * QM_STORE_ARRAY_BLOCK + 1, sums, ""}, found;
    assert_true(qm_stored_keep_blob(store, "numbers", array.hash));
    assert_int_equal(submit(store, &job), QM_STORED);
    assert_int_equal(qm_store_find_array(store, "j_a", &found), QM_STORED_NONE);
    assert_int_equal(qm_store_put_array(store, "j_a", &array), QM_STORED);
    array.count--, sums[0] = 5;
    assert_int_equal(qm_store_put_array(store, "j_a", &array), QM_STORED);
    assert_int_equal(qm_store_find_array(store, "j_a", &found), QM_STORED);
    assert_int_equal(found.count, array.count);
    assert_memory_equal(found.sums, sums, 2 * sizeof sums[0]);
    free(found.sums);
}

/* ---- layouts ---- */

static qm_store_layout make_layout(const char *id, const char *text)
{
    qm_store_layout layout = {.mesh = "m_a",
                              .created = "2026-01-02T03:04:05.678Z",
                              .issues = "\"issues\":[]",
                              .layout = (char *)(uintptr_t)text,
                              .next_curve = 7,
                              .is_complete = true};
    snprintf(layout.id, sizeof layout.id, "%s", id);
    return layout;
}

static void check_layout(qm_store *store, const char *id, int64_t revision, int64_t first, int64_t latest,
                         const char *text)
{
    qm_store_layout found;
    assert_int_equal(qm_store_find_layout(store, id, &found), QM_STORED);
    assert_int_equal(found.revision, revision);
    assert_int_equal(found.first, first);
    assert_int_equal(found.latest, latest);
    assert_string_equal(found.layout, text);
    assert_true(found.is_complete);
    assert_int_equal(found.next_curve, 7);
    qm_store_layout_reset(&found);
}

static qm_stored edit(qm_store *store, const char *id, int64_t revision, const char *text)
{
    qm_store_layout layout = make_layout(id, text);
    layout.revision = revision;
    return qm_store_edit_layout(store, &layout);
}

static void test_layouts(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_layout layout = make_layout("l_a", "0"), twin = make_layout("l_b", "0");
    const qm_store_idempotency key = {"key", "hash"};
    qm_store_idempotency_record record;
    assert_int_equal(qm_store_put_layout(store, &layout, &key), QM_STORED);
    assert_int_equal(qm_store_put_layout(store, &layout, &key), QM_STORED);
    assert_int_equal(qm_store_put_layout(store, &twin, &key), QM_STORED_TAKEN);
    assert_int_equal(qm_store_find_layout_by_idempotency_key(store, "key", &record), QM_STORED);
    assert_string_equal(record.id, "l_a");
    assert_string_equal(record.request, "hash");
    assert_int_equal(qm_store_find_layout_by_idempotency_key(store, "none", &record), QM_STORED_NONE);
    assert_int_equal(edit(store, "l_a", 0, "1"), QM_STORED);
    assert_int_equal(edit(store, "l_a", 0, "other"), QM_STORED_LATE);
    assert_int_equal(edit(store, "l_none", 0, "other"), QM_STORED_LATE);
    assert_int_equal(edit(store, "l_a", 1, "2"), QM_STORED);
    check_layout(store, "l_a", 2, 0, 2, "2");
    assert_int_equal(qm_store_move_layout(store, "l_a", 1, 0), QM_STORED_LATE);
    assert_int_equal(qm_store_move_layout(store, "l_a", 2, 0), QM_STORED);
    check_layout(store, "l_a", 0, 0, 2, "0");
    assert_int_equal(qm_store_move_layout(store, "l_a", 0, 1), QM_STORED);
    assert_int_equal(edit(store, "l_a", 1, "2'"), QM_STORED);
    assert_int_equal(edit(store, "l_a", 2, "3"), QM_STORED);
    assert_int_equal(qm_store_move_layout(store, "l_a", 3, 1), QM_STORED);
    assert_int_equal(edit(store, "l_a", 1, "2''"), QM_STORED); /* what was undone is gone */
    check_layout(store, "l_a", 2, 0, 2, "2''");
    assert_int_equal(edit(store, "l_a", 2, "3'"), QM_STORED);
    check_layout(store, "l_a", 3, 0, 3, "3'");
    qm_store_layout rows[2];
    size_t count;
    assert_int_equal(qm_store_list_layouts(store, &(qm_store_page){.limit = 2}, "m_a", rows, &count),
                     QM_STORED);
    assert_int_equal(count, 1);
    qm_store_layout_reset(&rows[0]);
    assert_int_equal(qm_store_list_layouts(store, &(qm_store_page){.limit = 2}, "m_b", rows, &count),
                     QM_STORED);
    assert_int_equal(count, 0);
    assert_int_equal(qm_store_delete_layout(store, "l_a"), QM_STORED);
    assert_int_equal(qm_store_delete_layout(store, "l_a"), QM_STORED_NONE);
}

static void test_old_revisions_of_layouts_go(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_layout layout = make_layout("l_a", "0");
    char text[16];
    assert_int_equal(qm_store_put_layout(store, &layout, &(qm_store_idempotency){0}), QM_STORED);
    for (int i = 0; i < 105; i++) {
        snprintf(text, sizeof text, "%d", i + 1);
        assert_int_equal(edit(store, "l_a", i, text), QM_STORED);
    }
    check_layout(store, "l_a", 105, 5, 105, "105");
    assert_int_equal(qm_store_move_layout(store, "l_a", 105, 5), QM_STORED);
    check_layout(store, "l_a", 5, 5, 105, "5");
}

static void edit_again_and_again(task *t)
{
    for (int i = 0; i < EACH; i++) {
        for (qm_stored stored = QM_STORED_LATE; stored != QM_STORED;) {
            qm_store_layout layout;
            assert_int_equal(qm_store_find_layout(t->store, "l_a", &layout), QM_STORED);
            stored = qm_store_edit_layout(t->store, &layout);
            qm_store_layout_reset(&layout);
            QM_CHECK(stored == QM_STORED || stored == QM_STORED_LATE, "%d", stored);
        }
        atomic_fetch_add(t->good, 1);
    }
}

static void test_edits_by_threads(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_layout layout = make_layout("l_a", "text");
    assert_int_equal(qm_store_put_layout(store, &layout, &(qm_store_idempotency){0}), QM_STORED);
    assert_int_equal(run_threads(store, edit_again_and_again), THREADS * EACH);
    check_layout(store, "l_a", THREADS * EACH, 0, THREADS * EACH, "text");
}

/* ---- reconstructions ---- */

static qm_store_reconstruction make_reconstruction(const char *id, const char *mesh)
{
    qm_store_reconstruction r = {.source = "m_s",
                                 .layout_id = "l_a",
                                 .layout = "{}\n",
                                 .document = "\"d\":1",
                                 .steps = "",
                                 .records = "",
                                 .state = "\"quads\":0",
                                 .cover_share = 0.1};
    snprintf(r.id, sizeof r.id, "%s", id);
    snprintf(r.mesh, sizeof r.mesh, "%s", mesh);
    return r;
}

static void check_reconstruction(qm_store *store, const qm_store_reconstruction *expected)
{
    qm_store_reconstruction found;
    assert_int_equal(qm_store_find_reconstruction(store, expected->id, &found), QM_STORED);
    assert_string_equal(found.mesh, expected->mesh);
    assert_string_equal(found.source, expected->source);
    assert_string_equal(found.layout, expected->layout);
    assert_string_equal(found.steps, expected->steps);
    assert_string_equal(found.records, expected->records);
    assert_string_equal(found.state, expected->state);
    assert_int_equal(found.revision, expected->revision);
    assert_true(found.cover_share == expected->cover_share);
    assert_int_equal(found.pull_curves, expected->pull_curves);
    qm_store_reconstruction_reset(&found);
}

static void test_reconstructions(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_mesh mesh = make_mesh(store, "m_0", "mesh 0"), next_mesh = make_mesh(store, "m_1", "mesh 1"),
                  none;
    qm_store_mesh twin_mesh = mesh;
    qm_store_reconstruction r = make_reconstruction("r_a", "m_0"), twin = make_reconstruction("r_b", "m_2"),
                            gone;
    const qm_store_idempotency key = {"key", "hash"};
    qm_store_idempotency_record record;
    assert_int_equal(qm_store_put_reconstruction(store, &r, &mesh, &key), QM_STORED);
    assert_int_equal(qm_store_put_reconstruction(store, &r, &mesh, &key), QM_STORED);
    check_mesh(store, &mesh);
    check_reconstruction(store, &r);
    /* Both rows, or none. */
    snprintf(twin_mesh.id, sizeof twin_mesh.id, "m_2");
    assert_int_equal(qm_store_put_reconstruction(store, &twin, &twin_mesh, &(qm_store_idempotency){0}),
                     QM_STORED_LATE);
    assert_int_equal(qm_store_find_reconstruction(store, "r_b", &gone), QM_STORED_NONE);
    twin_mesh = make_mesh(store, "m_2", "mesh 2");
    assert_int_equal(qm_store_put_reconstruction(store, &twin, &twin_mesh, &key), QM_STORED_TAKEN);
    assert_int_equal(qm_store_find_mesh(store, "m_2", &none), QM_STORED_NONE);
    assert_int_equal(qm_store_find_reconstruction_by_idempotency_key(store, "key", &record), QM_STORED);
    assert_string_equal(record.id, "r_a");
    qm_store_reconstruction next = r;
    next.revision = 1, next.steps = "100:1 ", next.state = "\"quads\":50";
    snprintf(next.mesh, sizeof next.mesh, "m_1");
    qm_store_effect effect = {&next, &next_mesh};
    assert_int_equal(qm_store_update_reconstruction(store, &effect), QM_STORED);
    check_reconstruction(store, &next);
    check_mesh(store, &next_mesh);
    qm_store_mesh late_mesh = make_mesh(store, "m_3", "mesh 3");
    effect.mesh = &late_mesh;
    assert_int_equal(qm_store_update_reconstruction(store, &effect), QM_STORED_LATE);
    assert_int_equal(qm_store_find_mesh(store, "m_3", &none), QM_STORED_NONE);
    next.revision = 2, effect.mesh = NULL;
    assert_int_equal(qm_store_update_reconstruction(store, &effect), QM_STORED);
    check_reconstruction(store, &next);
    qm_store_reconstruction rows[2];
    size_t count;
    const qm_store_page page = {.limit = 2};
    assert_int_equal(qm_store_list_reconstructions(store, &page, "m_s", rows, &count), QM_STORED);
    assert_int_equal(count, 1);
    qm_store_reconstruction_reset(&rows[0]);
    assert_int_equal(qm_store_delete_reconstruction(store, "r_a"), QM_STORED);
    assert_int_equal(qm_store_delete_reconstruction(store, "r_a"), QM_STORED_NONE);
    next.revision = 3;
    assert_int_equal(qm_store_update_reconstruction(store, &effect), QM_STORED_LATE);
}

/** The end of a job and its effect: both are stored, or neither. */
static void test_effects(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job job = make_job("j_a", NULL), end = job, found;
    qm_store_reconstruction r = make_reconstruction("r_a", "m_0"), next = r;
    qm_store_mesh mesh = make_mesh(store, "m_1", "mesh 1"), none;
    const qm_store_event last = {"j_a", 5, "result", "\"x\":1"};
    qm_store_effect effect = {&next, &mesh};
    end.state = QM_JOB_SUCCEEDED, end.document = "\"state\":\"succeeded\"";
    assert_int_equal(qm_store_put_reconstruction(store, &r, NULL, &(qm_store_idempotency){0}), QM_STORED);
    assert_int_equal(submit(store, &job), QM_STORED);
    next.revision = 2; /* one is missing */
    assert_int_equal(qm_store_finish_job(store, &end, "", &last, 1, &effect), QM_STORED_LATE);
    assert_int_equal(qm_store_find_mesh(store, "m_1", &none), QM_STORED_NONE);
    check_events(store, "j_a", 0, "");
    check_reconstruction(store, &r);
    next.revision = 1, next.steps = "100:1 ", next.records = "{}";
    snprintf(next.mesh, sizeof next.mesh, "m_1");
    assert_int_equal(qm_store_finish_job(store, &end, "", &last, 1, &effect), QM_STORED);
    check_reconstruction(store, &next);
    check_mesh(store, &mesh);
    assert_int_equal(qm_store_finish_job(store, &end, "", &last, 1, &effect), QM_STORED);
    check_reconstruction(store, &next);
    assert_int_equal(qm_store_find_job(store, "j_a", &found), QM_STORED);
    assert_int_equal(found.state, QM_JOB_SUCCEEDED);
    qm_store_job_reset(&found);
    /* The content of the mesh has another row by now. */
    qm_store_job second = make_job("j_b", NULL);
    qm_store_mesh twin = mesh;
    snprintf(twin.id, sizeof twin.id, "m_2");
    effect.mesh = &twin, next.revision = 2, end.id[2] = 'b';
    assert_int_equal(submit(store, &second), QM_STORED);
    assert_int_equal(qm_store_finish_job(store, &end, "", NULL, 0, &effect), QM_STORED_LATE);
    assert_int_equal(qm_store_find_job(store, "j_b", &found), QM_STORED);
    assert_null(found.document);
    qm_store_job_reset(&found);
}

/** The end of a job and a mesh alone: both are stored, or neither. */
static void test_an_effect_that_is_a_mesh(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job job = make_job("j_a", NULL), end = job, found;
    qm_store_mesh mesh = make_mesh(store, "m_1", "mesh 1"), twin = mesh, none;
    const qm_store_event last = {"j_a", 5, "result", "\"x\":1"};
    qm_store_effect effect = {NULL, &mesh};
    snprintf(twin.id, sizeof twin.id, "m_2");
    end.state = QM_JOB_SUCCEEDED, end.document = "\"state\":\"succeeded\"";
    assert_int_equal(submit(store, &job), QM_STORED);
    assert_int_equal(qm_store_finish_job(store, &end, "", &last, 1, &effect), QM_STORED);
    check_mesh(store, &mesh);
    check_events(store, "j_a", 0, "5 result \"x\":1\n");
    assert_int_equal(qm_store_finish_job(store, &end, "", &last, 1, &effect), QM_STORED);
    /* The content of the mesh has another row by now; the job ends with that. */
    qm_store_job second = make_job("j_b", NULL);
    effect.mesh = &twin, end.id[2] = 'b';
    assert_int_equal(submit(store, &second), QM_STORED);
    assert_int_equal(qm_store_finish_job(store, &end, "", NULL, 0, &effect), QM_STORED_LATE);
    assert_int_equal(qm_store_find_job(store, "j_b", &found), QM_STORED);
    assert_null(found.document);
    qm_store_job_reset(&found);
    assert_int_equal(qm_store_find_mesh(store, "m_2", &none), QM_STORED_NONE);
    effect.mesh = NULL;
    assert_int_equal(qm_store_finish_job(store, &end, "", NULL, 0, &effect), QM_STORED);
    assert_int_equal(qm_store_find_job(store, "j_b", &found), QM_STORED);
    assert_int_equal(found.state, QM_JOB_SUCCEEDED);
    qm_store_job_reset(&found);
}

static void finish_one_job(task *t)
{
    qm_store_job end = make_job("j_a", NULL);
    qm_store_reconstruction next = make_reconstruction("r_a", "m_0");
    const qm_store_effect effect = {&next, NULL};
    end.state = t->number % 2 ? QM_JOB_SUCCEEDED : QM_JOB_FAILED;
    end.document = "{}";
    next.revision = 1;
    qm_stored stored = qm_store_finish_job(t->store, &end, "", NULL, 0, t->number % 2 ? &effect : NULL);
    QM_CHECK(stored == QM_STORED || stored == QM_STORED_LOST, "%d", stored);
    if (stored == QM_STORED) atomic_fetch_add(t->good, 1);
}

/** A job that several threads end has one end, and its effect if that has one. */
static void test_one_end(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job job = make_job("j_a", NULL), found;
    qm_store_reconstruction r = make_reconstruction("r_a", "m_0");
    assert_int_equal(qm_store_put_reconstruction(store, &r, NULL, &(qm_store_idempotency){0}), QM_STORED);
    assert_int_equal(submit(store, &job), QM_STORED);
    assert_int_equal(run_threads(store, finish_one_job), THREADS / 2); /* those of the same end */
    assert_int_equal(qm_store_find_job(store, "j_a", &found), QM_STORED);
    r.revision = found.state == QM_JOB_SUCCEEDED;
    qm_store_job_reset(&found);
    check_reconstruction(store, &r);
}

/* ---- parts of searches ---- */

static qm_store_part make_part(double upper, char *entries)
{
    return (qm_store_part){.upper = upper, .entries = entries, .size = strlen(entries)};
}

static qm_stored open_three(qm_store *store, const char *engine)
{
    const qm_store_part parts[] = {make_part(2, "two"), make_part(3, "three"), make_part(1, "")};
    qm_store_bounds bounds = {.lower = 0.5, .discarded = 0.25, .iterations = 10, .projections = 20};
    snprintf(bounds.engine, sizeof bounds.engine, "%s", engine);
    snprintf(bounds.witness, sizeof bounds.witness, "w0");
    return qm_store_open_parts(store, "j_a", 0, &bounds, parts, 3);
}

static void check_bounds(qm_store *store, size_t parts, double lower, double discarded, double upper,
                         const char *witness)
{
    qm_store_bounds found;
    assert_int_equal(qm_store_read_bounds(store, "j_a", NULL, 0, &found), QM_STORED);
    assert_int_equal(found.parts, parts);
    assert_true(found.lower == lower && found.discarded == discarded && found.upper == upper);
    assert_true(found.others == upper);
    assert_string_equal(found.witness, witness);
}

static void test_parts(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_bounds bounds;
    qm_store_part claimed[4], again[4];
    size_t count;
    assert_int_equal(qm_store_read_bounds(store, "j_a", NULL, 0, &bounds), QM_STORED_NONE);
    assert_int_equal(open_three(store, "e"), QM_STORED_LOST);
    const qm_store_job job = make_job("j_a", NULL);
    assert_int_equal(submit(store, &job), QM_STORED);
    assert_int_equal(qm_store_raise_lower(store, "j_a", 1, "w"), QM_STORED_NONE);
    assert_int_equal(open_three(store, "e"), QM_STORED);
    check_bounds(store, 3, 0.5, 0.25, 3, "w0");

    /* Those with the greatest bounds come first; others are left. */
    assert_int_equal(qm_store_claim_parts(store, "j_a", 2, claimed, &count), QM_STORED);
    assert_int_equal(count, 2);
    assert_true(claimed[0].upper == 3 && claimed[1].upper == 2);
    assert_int_equal(claimed[0].size, 5);
    assert_memory_equal(claimed[0].entries, "three", 5);
    assert_int_equal(qm_store_read_bounds(store, "j_a", claimed, 2, &bounds), QM_STORED);
    assert_true(bounds.upper == 3 && bounds.others == 1);
    assert_string_equal(bounds.engine, "e");
    assert_int_equal(bounds.iterations, 10);
    assert_int_equal(bounds.projections, 20);

    /* To open them again changes nothing. */
    assert_int_equal(open_three(store, "e"), QM_STORED);
    check_bounds(store, 3, 0.5, 0.25, 3, "w0");

    /* A finish replaces a part by its rest, and what it has found joins; the same a second time is LOST. */
    qm_store_bounds found = {.lower = 0.75, .discarded = 0.5, .iterations = 1, .projections = 2};
    snprintf(found.witness, sizeof found.witness, "w1");
    qm_store_part rest = make_part(1.5, "rest");
    assert_int_equal(qm_store_finish_parts(store, "j_a", claimed, 1, &found, &rest, 1), QM_STORED);
    check_bounds(store, 3, 0.75, 0.5, 2, "w1");
    assert_int_equal(qm_store_finish_parts(store, "j_a", claimed, 1, &found, &rest, 1), QM_STORED_LOST);
    check_bounds(store, 3, 0.75, 0.5, 2, "w1");

    /* A later claim of the same process takes a part from an earlier one, whose finish is void: all of it. */
    assert_int_equal(qm_store_claim_parts(store, "j_a", 2, again, &count), QM_STORED);
    assert_int_equal(count, 2);
    assert_true(again[0].number == claimed[1].number && again[0].epoch == claimed[1].epoch + 1);
    assert_true(again[1].upper == 1.5 && again[1].size == 4);
    const qm_store_part mixed[] = {again[1], claimed[1]};
    found.lower = 9, found.discarded = 9;
    assert_int_equal(qm_store_finish_parts(store, "j_a", mixed, 2, &found, NULL, 0), QM_STORED_LOST);
    check_bounds(store, 3, 0.75, 0.5, 2, "w1");
    found.lower = 0.1, found.discarded = 0.1;
    assert_int_equal(qm_store_finish_parts(store, "j_a", again, 2, &found, NULL, 0), QM_STORED);
    check_bounds(store, 1, 0.75, 0.5, 1, "w1");
    qm_store_parts_reset(claimed, 2);
    qm_store_parts_reset(again, 2);

    /* The lower bound is a maximum. */
    assert_int_equal(qm_store_raise_lower(store, "j_a", 0.8, "w2"), QM_STORED);
    assert_int_equal(qm_store_raise_lower(store, "j_a", 0.7, "w3"), QM_STORED);
    check_bounds(store, 1, 0.8, 0.5, 1, "w2");

    /* Parts of another engine are replaced. */
    assert_int_equal(open_three(store, "f"), QM_STORED);
    check_bounds(store, 3, 0.5, 0.25, 3, "w0");

    /* The search goes with its job. */
    end_job(store, "j_a", "");
    assert_int_equal(qm_store_read_bounds(store, "j_a", NULL, 0, &bounds), QM_STORED_NONE);
    assert_int_equal(qm_store_claim_parts(store, "j_a", 4, claimed, &count), QM_STORED);
    assert_int_equal(count, 0);
    assert_int_equal(open_three(store, "e"), QM_STORED_LOST);
}

enum { MANY_PARTS = 100 };

/** Claims and finishes until nothing is left. */
static void finish_parts(task *t)
{
    for (;;) {
        qm_store_part parts[3];
        size_t count;
        assert_int_equal(qm_store_claim_parts(t->store, "j_a", 3, parts, &count), QM_STORED);
        qm_store_bounds bounds, found = {.iterations = count};
        assert_int_equal(qm_store_read_bounds(t->store, "j_a", parts, count, &bounds), QM_STORED);
        if (bounds.parts == 0) qm_store_parts_reset(parts, count);
        if (bounds.parts == 0) return;
        if (count == 0) continue;
        found.discarded = parts[0].upper;
        qm_stored stored = qm_store_finish_parts(t->store, "j_a", parts, count, &found, NULL, 0);
        QM_CHECK(stored == QM_STORED || stored == QM_STORED_LOST, "%d", stored);
        if (stored == QM_STORED) atomic_fetch_add(t->good, (int)count);
        qm_store_parts_reset(parts, count);
    }
}

/** Threads of one process take parts from each other; each part ends once. */
static void test_parts_by_threads(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_part parts[MANY_PARTS];
    for (int i = 0; i < MANY_PARTS; i++)
        parts[i] = make_part(i, "entries");
    const qm_store_job job = make_job("j_a", NULL);
    assert_int_equal(submit(store, &job), QM_STORED);
    const qm_store_bounds bounds = {.engine = "e"};
    assert_int_equal(qm_store_open_parts(store, "j_a", 0, &bounds, parts, MANY_PARTS), QM_STORED);
    assert_int_equal(run_threads(store, finish_parts), MANY_PARTS);
    check_bounds(store, 0, 0, MANY_PARTS - 1, 0, "");
}

#define TESTS(set_up)                                                                                        \
    {                                                                                                        \
        cmocka_unit_test_setup_teardown(test_meshes, set_up, qm_stored_tear_down),                           \
            cmocka_unit_test_setup_teardown(test_lists_of_meshes, set_up, qm_stored_tear_down),              \
            cmocka_unit_test_setup_teardown(test_one_row_of_a_content, set_up, qm_stored_tear_down),         \
            cmocka_unit_test_setup_teardown(test_revisions, set_up, qm_stored_tear_down),                    \
            cmocka_unit_test_setup_teardown(test_revisions_by_threads, set_up, qm_stored_tear_down),         \
            cmocka_unit_test_setup_teardown(test_many_at_once, set_up, qm_stored_tear_down),                 \
            cmocka_unit_test_setup_teardown(test_notes, set_up, qm_stored_tear_down),                        \
            cmocka_unit_test_setup_teardown(test_expiry, set_up, qm_stored_tear_down),                       \
            cmocka_unit_test_setup_teardown(test_submissions, set_up, qm_stored_tear_down),                  \
            cmocka_unit_test_setup_teardown(test_one_job_of_a_key, set_up, qm_stored_tear_down),             \
            cmocka_unit_test_setup_teardown(test_events, set_up, qm_stored_tear_down),                       \
            cmocka_unit_test_setup_teardown(test_ends, set_up, qm_stored_tear_down),                         \
            cmocka_unit_test_setup_teardown(test_lists_of_jobs, set_up, qm_stored_tear_down),                \
            cmocka_unit_test_setup_teardown(test_arrays, set_up, qm_stored_tear_down),                       \
            cmocka_unit_test_setup_teardown(test_layouts, set_up, qm_stored_tear_down),                      \
            cmocka_unit_test_setup_teardown(test_old_revisions_of_layouts_go, set_up, qm_stored_tear_down),  \
            cmocka_unit_test_setup_teardown(test_edits_by_threads, set_up, qm_stored_tear_down),             \
            cmocka_unit_test_setup_teardown(test_reconstructions, set_up, qm_stored_tear_down),              \
            cmocka_unit_test_setup_teardown(test_effects, set_up, qm_stored_tear_down),                      \
            cmocka_unit_test_setup_teardown(test_an_effect_that_is_a_mesh, set_up, qm_stored_tear_down),     \
            cmocka_unit_test_setup_teardown(test_one_end, set_up, qm_stored_tear_down),                      \
            cmocka_unit_test_setup_teardown(test_parts, set_up, qm_stored_tear_down),                        \
            cmocka_unit_test_setup_teardown(test_parts_by_threads, set_up, qm_stored_tear_down),             \
    }

int main(void)
{
    const struct CMUnitTest embedded[] = TESTS(qm_stored_set_up_embedded),
                            shared[] = TESTS(qm_stored_set_up_shared);
    int failed = cmocka_run_group_tests_name("embedded", embedded, NULL, NULL);
    if (qm_database_server())
        failed += cmocka_run_group_tests_name("shared", shared, NULL, NULL);
    else
        printf("NOT RUN %zu: QM_TEST_POSTGRES names no server\n", sizeof shared / sizeof shared[0]);
    return failed;
}
