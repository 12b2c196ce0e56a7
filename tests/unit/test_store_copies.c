/*
 * Rows as copies, on both kinds of store (qm_store_list_job_copies and what follows in store.h), and everything from an
 * embedded store to a shared one and back (store_copy.h). The shared store needs a server (QM_TEST_POSTGRES).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "database.h"
#include "folder.h"
#include "store/blob.h"
#include "store/result_file.h"
#include "store/store.h"
#include "store/store_copy.h"
#include "stored.h"

/* ---- jobs ---- */

static qm_store_job_copy make_ended(const char *id, const char *key)
{
    qm_store_job_copy copy = {.job = {.key = "hash of the request",
                                      .idempotency_key = (char *)(uintptr_t)key,
                                      .body = "{\"type\":\"distance\"}",
                                      .created = "2026-01-02T03:04:05.678Z",
                                      .document = "\"state\":\"failed\",\"a\":\"\\\\ {}\"",
                                      .result = "{\"lower\":1}",
                                      .labels = "\nci/1\nnight\n",
                                      .state = QM_JOB_FAILED},
                              .type = "distance",
                              .subjects = "m_a m_b m_c",
                              .revisions = "1 2",
                              .claims = 3};
    snprintf(copy.job.id, sizeof copy.job.id, "%s", id);
    return copy;
}

/** One that waits: claimed twice, and dead once. */
static qm_store_job_copy make_waiting(const char *id)
{
    qm_store_job_copy copy = make_ended(id, NULL);
    copy.job.document = copy.job.result = NULL;
    copy.job.state = QM_JOB_QUEUED;
    copy.revisions = "";
    copy.subjects = "m_a";
    copy.claims = 2;
    copy.job.deaths = 1;
    return copy;
}

static void check_text(const char *found, const char *expected)
{
    assert_int_equal(!found, !expected);
    if (found) assert_string_equal(found, expected);
}

static void check_copy(const qm_store_job_copy *found, const qm_store_job_copy *expected)
{
    assert_string_equal(found->job.id, expected->job.id);
    check_text(found->job.key, expected->job.key);
    check_text(found->job.idempotency_key, expected->job.idempotency_key);
    check_text(found->job.body, expected->job.body);
    check_text(found->job.created, expected->job.created);
    check_text(found->job.document, expected->job.document);
    check_text(found->job.result, expected->job.result);
    check_text(found->job.labels, expected->job.labels);
    check_text(found->type, expected->type);
    check_text(found->revisions, expected->revisions);
    check_text(found->subjects, expected->subjects);
    assert_int_equal(found->job.state, expected->job.state);
    assert_int_equal(found->job.deaths, expected->job.deaths);
    assert_int_equal(found->job.is_canceled, expected->job.is_canceled);
    assert_int_equal(found->claims, expected->claims);
}

/** Checks the only job of a store. */
static void check_only(qm_store *store, const qm_store_job_copy *expected)
{
    qm_store_job_copy rows[2];
    size_t count;
    assert_int_equal(qm_store_list_job_copies(store, &(qm_store_page){.limit = 2}, rows, &count), QM_STORED);
    assert_int_equal(count, 1);
    check_copy(&rows[0], expected);
    qm_store_job_copy_reset(&rows[0]);
}

static bool count_event(void *user, const qm_store_event *event)
{
    int *count = user;
    ++*count;
    assert_string_equal(event->name, *count == 1 ? "progress" : "error");
    assert_string_equal(event->members, *count == 1 ? "\"lower\":0" : "\"a\":\"\\\"\"");
    assert_int_equal(event->seq, *count == 1 ? 1 : 1000000007);
    return true;
}

static const qm_store_event events[] = {{NULL, 1, "progress", "\"lower\":0"},
                                        {NULL, 1000000007, "error", "\"a\":\"\\\"\""}};

static void check_events(qm_store *store, const char *id)
{
    int count = 0;
    assert_int_equal(qm_store_read_events(store, id, 0, count_event, &count), QM_STORED);
    assert_int_equal(count, 2);
}

static void test_jobs_that_have_ended(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job_copy a = make_ended("j_a", "key"), other = make_ended("j_a", "other key"),
                      b = make_ended("j_b", "key");
    qm_store_job found;
    uint64_t sums[] = {5, UINT64_MAX};
    qm_store_array array = {QM_STORE_ARRAY_BLOCK + 1, sums, ""}, read;
    assert_true(qm_stored_keep_blob(store, "numbers", array.hash));
    assert_int_equal(qm_store_put_job_copy(store, &a, events, 2, &array), QM_STORED);
    check_only(store, &a);
    check_events(store, "j_a");
    assert_int_equal(qm_store_find_array(store, "j_a", &read), QM_STORED);
    assert_int_equal(read.count, array.count);
    assert_memory_equal(read.sums, sums, sizeof sums);
    free(read.sums);
    assert_int_equal(qm_store_put_job_copy(store, &other, NULL, 0, NULL), QM_STORED); /* it is there */
    assert_int_equal(qm_store_put_job_copy(store, &b, events, 2, NULL), QM_STORED_TAKEN);
    check_only(store, &a);
    check_events(store, "j_a");
    assert_int_equal(qm_store_sync(store), QM_STORED);
    /* It is found as those of this store are. */
    assert_int_equal(qm_store_find_job_by_key(store, a.job.key, "1 2", QM_JOB_FAILED, &found), QM_STORED);
    assert_string_equal(found.id, "j_a");
    assert_int_equal(found.restarts, 2);
    qm_store_job_reset(&found);
    assert_int_equal(qm_store_find_job_by_idempotency_key(store, "key", &found), QM_STORED);
    qm_store_job_reset(&found);
    size_t count;
    const qm_store_job_filter filter = {.type = "distance", .subject = "m_b"};
    assert_int_equal(qm_store_list_jobs(store, &(qm_store_page){.limit = 1}, &filter, &found, &count),
                     QM_STORED);
    assert_int_equal(count, 1);
    qm_store_job_reset(&found);
}

static void test_copies_of_unclaimed_jobs(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job_copy waiting = make_waiting("j_w");
    waiting.claims = waiting.job.deaths = 0;
    assert_int_equal(qm_store_put_job_copy(store, &waiting, NULL, 0, NULL), QM_STORED);
    waiting.claims =
        qm_store_is_shared(store) ? 0 : 1; /* one that is submitted to a folder is claimed by it */
    check_only(store, &waiting);
}

/** A job that waits is claimed once, and its events come after those of the runs before. */
static void test_jobs_that_wait(void **state)
{
    qm_stored_fixture *f = *state;
    qm_store_job_copy waiting = make_waiting("j_w");
    assert_int_equal(qm_store_put_job_copy(f->store, &waiting, events, 2, NULL), QM_STORED);
    check_only(f->store, &waiting);
    if (!f->database) { /* another process */
        qm_store_close(f->store);
        f->store = qm_stored_open_embedded(f->folder, QM_STORE_SERVE);
    }
    qm_store_job rows[2];
    size_t count;
    const qm_store_wish wish = {.free = 2};
    assert_int_equal(qm_store_claim_jobs(f->store, &wish, rows, &count), QM_STORED);
    assert_int_equal(count, 1);
    assert_string_equal(rows[0].id, "j_w");
    assert_int_equal(rows[0].restarts, 2);
    assert_int_equal(rows[0].deaths, 1);
    qm_store_job_reset(&rows[0]);
    assert_int_equal(qm_store_claim_jobs(f->store, &wish, rows, &count), QM_STORED);
    assert_int_equal(count, 0);
}

/** Somebody has asked for its end: the store that has it next is to end it. */
static void test_jobs_whose_end_was_asked_for(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_job_copy waiting = make_waiting("j_w");
    waiting.job.is_canceled = true;
    assert_int_equal(qm_store_put_job_copy(store, &waiting, events, 2, NULL), QM_STORED);
    check_only(store, &waiting);
}

static void test_pages_of_jobs(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    char id[QM_ID_SIZE];
    for (int i = 0; i < 7; i++) {
        snprintf(id, sizeof id, "j_%d", i);
        qm_store_job_copy copy = i % 2 ? make_waiting(id) : make_ended(id, NULL);
        assert_int_equal(qm_store_put_job_copy(store, &copy, NULL, 0, NULL), QM_STORED);
    }
    qm_store_job_copy rows[3];
    qm_store_page page = {.limit = 3};
    int seen = 0;
    for (size_t count = 3; count == 3;) {
        assert_int_equal(qm_store_list_job_copies(store, &page, rows, &count), QM_STORED);
        for (size_t i = 0; i < count; i++) {
            snprintf(id, sizeof id, "j_%d", seen++);
            assert_string_equal(rows[i].job.id, id);
            page.after = rows[i].job.sequence;
            qm_store_job_copy_reset(&rows[i]);
        }
    }
    assert_int_equal(seen, 7);
}

/* ---- layouts ---- */

#define FIRST 5
#define COUNT 12

static void make_revisions(qm_store_layout *out, const char *id, char (*texts)[32])
{
    for (int i = 0; i < COUNT; i++) {
        snprintf(texts[i], sizeof texts[i], "{\"n\":%d}", FIRST + i);
        out[i] = (qm_store_layout){.mesh = "m_a",
                                   .created = "2026-01-02T03:04:05.678Z",
                                   .issues = "\"issues\":[]",
                                   .layout = texts[i],
                                   .revision = FIRST + i,
                                   .next_curve = i,
                                   .is_complete = i % 2};
        snprintf(out[i].id, sizeof out[i].id, "%s", id);
    }
}

static void check_revisions(qm_store *store, const char *id, const qm_store_layout *expected)
{
    qm_store_layout rows[5];
    qm_store_page page = {.after = -1, .limit = 5};
    int seen = 0;
    for (size_t count = 5; count == 5;) {
        assert_int_equal(qm_store_list_layout_revisions(store, id, &page, rows, &count), QM_STORED);
        for (size_t i = 0; i < count; i++) {
            const qm_store_layout *one = &expected[seen++];
            assert_string_equal(rows[i].layout, one->layout);
            assert_string_equal(rows[i].issues, one->issues);
            assert_string_equal(rows[i].mesh, one->mesh);
            assert_string_equal(rows[i].created, one->created);
            assert_int_equal(rows[i].revision, one->revision);
            assert_int_equal(rows[i].next_curve, one->next_curve);
            assert_int_equal(rows[i].is_complete, one->is_complete);
            page.after = rows[i].revision;
            qm_store_layout_reset(&rows[i]);
        }
    }
    assert_int_equal(seen, COUNT);
}

static void test_layouts(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_layout a[COUNT], b[COUNT], found;
    char texts[COUNT][32];
    qm_store_origin origin;
    const qm_store_idempotency key = {"key", "hash"}, none = {0};
    make_revisions(a, "l_a", texts);
    make_revisions(b, "l_b", texts);
    assert_int_equal(qm_store_put_layout_copy(store, a, COUNT, FIRST + 7, &key), QM_STORED);
    assert_int_equal(qm_store_put_layout_copy(store, a, 1, FIRST, &none), QM_STORED); /* it is there */
    assert_int_equal(qm_store_put_layout_copy(store, b, COUNT, FIRST, &key), QM_STORED_TAKEN);
    assert_int_equal(qm_store_find_layout(store, "l_b", &found), QM_STORED_NONE);
    check_revisions(store, "l_a", a);
    assert_int_equal(qm_store_find_layout_origin(store, "l_a", &origin), QM_STORED);
    assert_string_equal(origin.key, "key");
    assert_string_equal(origin.request, "hash");
    free(origin.key);
    assert_int_equal(qm_store_find_layout_origin(store, "l_b", &origin), QM_STORED_NONE);
    assert_int_equal(qm_store_find_layout(store, "l_a", &found), QM_STORED);
    assert_int_equal(found.revision, FIRST + 7);
    assert_int_equal(found.first, FIRST);
    assert_int_equal(found.latest, FIRST + COUNT - 1);
    assert_string_equal(found.layout, a[7].layout);
    qm_store_layout_reset(&found);
    assert_int_equal(qm_store_move_layout(store, "l_a", FIRST + 7, FIRST + COUNT - 1), QM_STORED);
    a[COUNT - 1].layout = "{}";
    assert_int_equal(qm_store_edit_layout(store, &a[COUNT - 1]), QM_STORED);
}

/** Revisions that an undo and an edit have thrown away are in no copy. */
static void test_undone_revisions(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_layout a[COUNT], rows[COUNT];
    char texts[COUNT][32];
    size_t count;
    make_revisions(a, "l_a", texts);
    assert_int_equal(qm_store_put_layout_copy(store, a, COUNT, FIRST + 2, &(qm_store_idempotency){0}),
                     QM_STORED);
    assert_int_equal(qm_store_edit_layout(store, &a[2]), QM_STORED);
    assert_int_equal(qm_store_list_layout_revisions(
                         store, "l_a", &(qm_store_page){.after = -1, .limit = COUNT}, rows, &count),
                     QM_STORED);
    assert_int_equal(count, 4);
    while (count > 0)
        qm_store_layout_reset(&rows[--count]);
}

static void test_origins_of_reconstructions(void **state)
{
    qm_store *store = ((qm_stored_fixture *)*state)->store;
    qm_store_origin origin;
    qm_store_reconstruction r = {.id = "r_a",
                                 .source = "m_s",
                                 .layout_id = "l_a",
                                 .mesh = "m_a",
                                 .layout = "{}\n",
                                 .document = "",
                                 .steps = "",
                                 .records = "",
                                 .state = "",
                                 .revision = 3};
    assert_int_equal(qm_store_put_reconstruction(store, &r, NULL, &(qm_store_idempotency){"key", "hash"}),
                     QM_STORED);
    snprintf(r.id, sizeof r.id, "r_b");
    assert_int_equal(qm_store_put_reconstruction(store, &r, NULL, &(qm_store_idempotency){0}), QM_STORED);
    assert_int_equal(qm_store_find_reconstruction_origin(store, "r_a", &origin), QM_STORED);
    assert_string_equal(origin.key, "key");
    assert_string_equal(origin.request, "hash");
    free(origin.key);
    assert_int_equal(qm_store_find_reconstruction_origin(store, "r_b", &origin), QM_STORED);
    assert_null(origin.key);
    assert_int_equal(qm_store_find_reconstruction_origin(store, "r_c", &origin), QM_STORED_NONE);
}

/* ---- everything ---- */

static qm_store_mesh make_mesh(qm_store *store, const char *id, const char *content)
{
    qm_store_mesh mesh = {.options = "format=off",
                          .name = "a",
                          .document = "{}",
                          .created = "2026-01-02T03:04:05.678Z",
                          .format = 3};
    snprintf(mesh.id, sizeof mesh.id, "%s", id);
    assert_true(qm_stored_keep_blob(store, content, mesh.hash));
    return mesh;
}

/** One of each, and a job with an array. */
static void fill(qm_store *store)
{
    double numbers[QM_RESULT_BLOCK + 3];
    for (int i = 0; i < QM_RESULT_BLOCK + 3; i++)
        numbers[i] = 0.1 * i;
    qm_store_mesh mesh = make_mesh(store, "m_a", "content"), next = mesh;
    assert_int_equal(qm_store_put_mesh(store, &mesh), QM_STORED);
    next.revision = 1, next.options = "deformed m_a";
    assert_true(qm_stored_keep_blob(store, "positions", next.positions));
    assert_int_equal(qm_store_revise_mesh(store, &next), QM_STORED);
    qm_store_layout layouts[COUNT];
    char texts[COUNT][32];
    make_revisions(layouts, "l_a", texts);
    assert_int_equal(
        qm_store_put_layout_copy(store, layouts, COUNT, FIRST + 1, &(qm_store_idempotency){"key", "hash"}),
        QM_STORED);
    qm_store_job_copy ended = make_ended("j_a", "key"), waiting = make_waiting("j_w");
    assert_int_equal(qm_store_put_job_copy(store, &ended, events, 2, NULL), QM_STORED);
    assert_int_equal(qm_result_file_write(store, "j_a", numbers, QM_RESULT_BLOCK + 3), QM_OK);
    assert_int_equal(qm_store_put_job_copy(store, &waiting, events, 2, NULL), QM_STORED);
}

static void check_all(qm_store *store)
{
    qm_store_mesh mesh;
    assert_int_equal(qm_store_find_mesh(store, "m_a", &mesh), QM_STORED);
    assert_int_equal(mesh.revision, 1);
    assert_int_equal(qm_blob_check(store, mesh.hash), QM_OK);
    assert_int_equal(qm_blob_check(store, mesh.positions), QM_OK);
    qm_store_mesh_reset(&mesh);
    qm_store_layout layouts[COUNT];
    char texts[COUNT][32];
    make_revisions(layouts, "l_a", texts);
    check_revisions(store, "l_a", layouts);
    qm_store_job_copy ended = make_ended("j_a", "key"), waiting = make_waiting("j_w"), rows[3];
    size_t count;
    assert_int_equal(qm_store_list_job_copies(store, &(qm_store_page){.limit = 3}, rows, &count), QM_STORED);
    assert_int_equal(count, 2);
    check_copy(&rows[0], &ended);
    check_copy(&rows[1], &waiting);
    qm_store_job_copy_reset(&rows[0]);
    qm_store_job_copy_reset(&rows[1]);
    check_events(store, "j_a");
    check_events(store, "j_w");
    qm_result_file *file;
    double numbers[QM_RESULT_BLOCK];
    assert_int_equal(qm_result_file_open(store, "j_a", &file), QM_OK);
    assert_int_equal(qm_result_file_count(file), QM_RESULT_BLOCK + 3);
    assert_int_equal(qm_result_file_read(file, QM_RESULT_BLOCK, numbers, 3), QM_OK);
    assert_true(numbers[2] == 0.1 * (QM_RESULT_BLOCK + 2));
    qm_result_file_close(file);
}

/** A folder, a database, and where copies of both are to be. */
typedef struct journey {
    char *folder, *database, *cache;
    char back[512];
    qm_store_copied copied;
    char message[QM_MESSAGE_SIZE];
} journey;

static journey *begin_journey(void)
{
    journey *j = calloc(1, sizeof *j);
    if (!j) abort();
    j->folder = qm_folder_make(), j->cache = qm_folder_make(), j->database = qm_database_make();
    snprintf(j->back, sizeof j->back, "%s/back", j->cache);
    qm_store *store = qm_stored_open_embedded(j->folder, QM_STORE_SERVE);
    fill(store);
    qm_store_close(store);
    return j;
}

static void end_journey(journey *j)
{
    qm_folder_remove(j->folder);
    qm_folder_remove(j->cache);
    qm_database_drop(j->database);
    free(j);
}

static qm_stored import(journey *j)
{
    return qm_store_import(j->folder, j->database, &qm_stored_node, false, stderr, &j->copied, j->message);
}

static void test_there_and_back(void **state)
{
    (void)state;
    journey *j = begin_journey();
    assert_int_equal(import(j), QM_STORED);
    assert_int_equal(j->copied.meshes, 1);
    assert_int_equal(j->copied.layouts, 1);
    assert_int_equal(j->copied.jobs, 2);
    assert_int_equal(j->copied.before + j->copied.faults, 0);
    assert_int_equal(import(j), QM_STORED_TAKEN); /* what was deleted since would come back */
    assert_int_equal(j->copied.meshes + j->copied.layouts + j->copied.jobs + j->copied.before, 0);
    qm_store *store = qm_stored_open_node(j->database, j->cache);
    check_all(store);
    qm_store_close(store);
    QM_CHECK(qm_store_export(j->database, &qm_stored_node, j->back, stderr, &j->copied, j->message) ==
                 QM_STORED,
             "%s", j->message);
    assert_int_equal(j->copied.jobs, 2);
    assert_int_equal(qm_store_export(j->database, &qm_stored_node, j->back, stderr, &j->copied, j->message),
                     QM_STORED_FAULT); /* it is not empty */
    store = qm_stored_open_embedded(j->back, QM_STORE_SERVE);
    check_all(store);
    qm_store_close(store);
    qm_store_findings found;
    assert_int_equal(qm_store_check(j->back, false, stderr, &found, j->message), QM_OK);
    assert_int_equal(found.faults, 0);
    assert_int_equal(found.files, 2);
    assert_int_equal(qm_store_check_shared(j->database, &qm_stored_node, stderr, &found, j->message),
                     QM_STORED);
    assert_int_equal(found.faults, 0);
    assert_int_equal(found.meshes, 1);
    assert_int_equal(found.jobs, 2);
    end_journey(j);
}

/** What is there under other ids keeps its content and its keys. */
static void test_what_is_taken(void **state)
{
    (void)state;
    journey *j = begin_journey();
    qm_store *store = qm_stored_open_node(j->database, j->cache);
    qm_store_mesh other = make_mesh(store, "m_other", "content"), found;
    other.options = "deformed m_a"; /* as the one in the folder has */
    assert_int_equal(qm_store_put_mesh(store, &other), QM_STORED);
    qm_store_job_copy job = make_ended("j_other", "key");
    assert_int_equal(qm_store_put_job_copy(store, &job, NULL, 0, NULL), QM_STORED);
    assert_int_equal(import(j), QM_STORED);
    assert_int_equal(j->copied.faults, 1); /* the job's key */
    assert_int_equal(qm_store_find_mesh(store, "m_a", &found), QM_STORED);
    assert_string_equal(found.options, "imported m_a");
    qm_store_mesh_reset(&found);
    qm_store_job row;
    assert_int_equal(qm_store_find_job_by_idempotency_key(store, "key", &row), QM_STORED);
    assert_string_equal(row.id, "j_other");
    qm_store_job_reset(&row);
    assert_int_equal(qm_store_find_job(store, "j_a", &row), QM_STORED);
    assert_null(row.idempotency_key);
    qm_store_job_reset(&row);
    qm_store_close(store);
    end_journey(j);
}

/** Changes the first byte of a file below the folder. */
static void damage(const char *folder, const char *name)
{
    char path[1024];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "r+b");
    QM_CHECK(file, "%s", path);
    int first = fgetc(file);
    rewind(file);
    fputc(first ^ 1, file);
    fclose(file);
}

static void test_damages(void **state)
{
    (void)state;
    journey *j = begin_journey();
    qm_store *store = qm_stored_open_embedded(j->folder, QM_STORE_SERVE);
    qm_store_mesh mesh, good = make_mesh(store, "m_good", "other content");
    char name[QM_HASH_SIZE + 16];
    assert_int_equal(qm_store_put_mesh(store, &good), QM_STORED);
    assert_int_equal(qm_store_find_mesh(store, "m_a", &mesh), QM_STORED);
    snprintf(name, sizeof name, "blobs/%.2s/%s", mesh.positions, mesh.positions);
    qm_store_mesh_reset(&mesh);
    qm_store_close(store);
    damage(j->folder, name);
    damage(j->folder, "results/j_a" QM_RESULT_ENDING);
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    assert_int_equal(
        qm_store_import(j->folder, j->database, &qm_stored_node, false, out, &j->copied, j->message),
        QM_STORED);
    fclose(out);
    QM_CHECK(strstr(text, "mesh m_a: file ") && strstr(text, " is damaged") && strstr(text, "job j_a: "),
             "%s", text);
    free(text);
    assert_int_equal(j->copied.faults, 2);
    assert_int_equal(j->copied.meshes, 1);
    assert_int_equal(j->copied.jobs, 2);
    qm_store_job found;
    store = qm_stored_open_node(j->database, j->cache);
    assert_int_equal(qm_store_find_mesh(store, "m_a", &mesh), QM_STORED_NONE);
    assert_int_equal(qm_store_find_job_by_key(store, "hash of the request", "1 2", QM_JOB_FAILED, &found),
                     QM_STORED_NONE); /* it answers no later request */
    qm_store_close(store);
    end_journey(j);
}

/** Bytes of a blob in the database that are others are found by a check, and left out by an export. */
static void test_damages_of_the_database(void **state)
{
    (void)state;
    journey *j = begin_journey();
    qm_store_findings found;
    assert_int_equal(import(j), QM_STORED);
    qm_database_ask(j->database, "UPDATE quadmeshd.blob_chunks SET bytes = set_byte(bytes, 0, 0)"
                                 " WHERE generation = (SELECT generation FROM quadmeshd.blobs b"
                                 "   JOIN quadmeshd.meshes m ON m.hash = b.hash)");
    assert_int_equal(qm_store_check_shared(j->database, &qm_stored_node, stderr, &found, j->message),
                     QM_STORED);
    assert_int_equal(found.faults, 1);
    assert_int_equal(qm_store_export(j->database, &qm_stored_node, j->back, stderr, &j->copied, j->message),
                     QM_STORED);
    assert_int_equal(j->copied.faults, 1);
    assert_int_equal(j->copied.meshes, 0);
    assert_int_equal(j->copied.jobs, 2);
    qm_store *store = qm_stored_open_embedded(j->back, QM_STORE_SERVE);
    check_events(store, "j_a");
    qm_store_close(store);
    end_journey(j);
}

/** An export reads the database as it was when it began. */
static void test_a_reader_has_a_snapshot(void **state)
{
    (void)state;
    journey *j = begin_journey();
    qm_store *reader;
    qm_store_mesh mesh;
    assert_int_equal(import(j), QM_STORED);
    assert_int_equal(qm_store_visit_to_read(j->database, &qm_stored_node, NULL, &reader, j->message),
                     QM_STORED);
    qm_store *node = qm_stored_open_node(j->database, j->cache);
    assert_int_equal(qm_store_delete_mesh(node, "m_a"), QM_STORED);
    assert_int_equal(qm_store_find_mesh(reader, "m_a", &mesh), QM_STORED);
    qm_store_mesh_reset(&mesh);
    assert_int_not_equal(qm_store_delete_mesh(reader, "m_a"), QM_STORED); /* it writes nothing */
    qm_store_close(reader);
    qm_store_close(node);
    end_journey(j);
}

static void check_status(const char *database, size_t faults, const char *line)
{
    char *text = NULL, message[QM_MESSAGE_SIZE] = "";
    size_t size = 0, found;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    QM_CHECK(qm_store_print_status(database, &qm_stored_node, out, &found, message) == QM_STORED, "%s",
             message);
    fclose(out);
    QM_CHECK(found == faults && strstr(text, line), "%s", text);
    free(text);
}

static void test_status(void **state)
{
    (void)state;
    char *folder = qm_folder_make(), *database = qm_database_make();
    check_status(database, 2, "\ntables: 0\n");
    qm_store *node = qm_stored_open_node(database, folder);
    check_status(database, 0, "\nnode: name=one id=one.");
    check_status(database, 0, "\nnodes that live: 1\n");
    check_status(database, 0, "\njobs waiting: 0\n");
    qm_database_ask(database,
                    "UPDATE quadmeshd.node_beats SET beat = clock_timestamp() - interval '1 minute'");
    check_status(database, 1, " state=silent ");
    check_status(database, 1, "\nfault: no node lives\n");
    qm_database_ask(database, "UPDATE quadmeshd.about SET version = 99");
    check_status(database, 2, "\nfault: tables of version 99");
    qm_store_close(node);
    qm_folder_remove(folder);
    qm_database_drop(database);
}

#define TESTS(set_up)                                                                                        \
    {                                                                                                        \
        cmocka_unit_test_setup_teardown(test_jobs_that_have_ended, set_up, qm_stored_tear_down),             \
            cmocka_unit_test_setup_teardown(test_copies_of_unclaimed_jobs, set_up, qm_stored_tear_down),     \
            cmocka_unit_test_setup_teardown(test_jobs_that_wait, set_up, qm_stored_tear_down),               \
            cmocka_unit_test_setup_teardown(test_jobs_whose_end_was_asked_for, set_up, qm_stored_tear_down), \
            cmocka_unit_test_setup_teardown(test_pages_of_jobs, set_up, qm_stored_tear_down),                \
            cmocka_unit_test_setup_teardown(test_layouts, set_up, qm_stored_tear_down),                      \
            cmocka_unit_test_setup_teardown(test_undone_revisions, set_up, qm_stored_tear_down),             \
            cmocka_unit_test_setup_teardown(test_origins_of_reconstructions, set_up, qm_stored_tear_down),   \
    }

int main(void)
{
    const struct CMUnitTest embedded[] = TESTS(qm_stored_set_up_embedded),
                            shared[] = TESTS(qm_stored_set_up_shared);
    const struct CMUnitTest both[] = {
        cmocka_unit_test(test_there_and_back), cmocka_unit_test(test_what_is_taken),
        cmocka_unit_test(test_damages),        cmocka_unit_test(test_damages_of_the_database),
        cmocka_unit_test(test_status),         cmocka_unit_test(test_a_reader_has_a_snapshot),
    };
    int failed = cmocka_run_group_tests_name("embedded", embedded, NULL, NULL);
    if (qm_database_server()) {
        failed += cmocka_run_group_tests_name("shared", shared, NULL, NULL);
        failed += cmocka_run_group_tests_name("both", both, NULL, NULL);
    } else {
        printf("NOT RUN %zu: QM_TEST_POSTGRES names no server\n",
               sizeof shared / sizeof shared[0] + sizeof both / sizeof both[0]);
    }
    return failed;
}
