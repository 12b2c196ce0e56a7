/*
 * What the store keeps is there again after it was opened anew; blobs are named by their hash.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "folder.h"
#include "store.h"

typedef struct fixture {
    char *folder;
    qm_store *store;
} fixture;

static void open_store(fixture *f)
{
    char message[QM_MESSAGE_SIZE] = "";
    qm_status status = qm_store_open(f->folder, &f->store, message);
    QM_CHECK(status == QM_OK, "%s", message);
}

static void reopen(fixture *f)
{
    qm_store_close(f->store);
    open_store(f);
}

static int set_up(void **state)
{
    fixture *f = calloc(1, sizeof *f);
    if (!f) return -1;
    f->folder = qm_folder_make();
    open_store(f);
    *state = f;
    return 0;
}

static int tear_down(void **state)
{
    fixture *f = *state;
    qm_store_close(f->store);
    qm_folder_remove(f->folder);
    free(f);
    return 0;
}

static size_t count_files(const fixture *f, const char *below)
{
    char path[256];
    snprintf(path, sizeof path, "%s/%s", f->folder, below);
    return qm_folder_count_files(path);
}

/* ---- blobs ---- */

static qm_blob_writer *write_blob(const fixture *f, const char *text, char hash[QM_HASH_SIZE])
{
    qm_blob_writer *writer;
    size_t half = strlen(text) / 2;
    assert_int_equal(qm_blob_begin(f->store, &writer), QM_OK);
    assert_int_equal(qm_blob_write(writer, text, half), QM_OK);
    assert_int_equal(qm_blob_write(writer, text + half, strlen(text) - half), QM_OK);
    assert_int_equal(qm_blob_seal(writer, hash), QM_OK);
    return writer;
}

static void keep_blob(const fixture *f, const char *text, char hash[QM_HASH_SIZE])
{
    assert_int_equal(qm_blob_keep(write_blob(f, text, hash)), QM_OK);
}

static void check_bytes(const uint8_t *bytes, size_t size, const char *text)
{
    assert_int_equal(size, strlen(text));
    assert_memory_equal(bytes, text, size);
    qm_blob_unmap(bytes, size);
}

static void check_blob(const fixture *f, const char *hash, const char *text)
{
    const uint8_t *bytes;
    size_t size;
    assert_int_equal(qm_blob_map(f->store, hash, &bytes, &size), QM_OK);
    check_bytes(bytes, size, text);
}

/** FIPS 180-2, appendix B, and the hash of nothing. */
static void test_hashes(void **state)
{
    static const char *const known[][2] = {
        {"", "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"},
        {"abc", "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"},
        {"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq",
         "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1"}};
    for (size_t i = 0; i < 3; i++) {
        char hash[QM_HASH_SIZE];
        keep_blob(*state, known[i][0], hash);
        assert_string_equal(hash, known[i][1]);
        check_blob(*state, hash, known[i][0]);
    }
}

static void test_kept_blobs_survive(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    keep_blob(f, "a mesh", hash);
    keep_blob(f, "a mesh", hash);
    assert_int_equal(count_files(f, "blobs"), 1);
    reopen(f);
    check_blob(f, hash, "a mesh");
}

static void test_dropped_blobs_leave_nothing(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    qm_blob_writer *writer = write_blob(f, "refused", hash);
    const uint8_t *bytes;
    size_t size;
    assert_int_equal(qm_blob_map_sealed(writer, &bytes, &size), QM_OK);
    check_bytes(bytes, size, "refused");
    qm_blob_abort(writer);
    assert_int_equal(count_files(f, "incoming") + count_files(f, "blobs"), 0);
    assert_int_equal(qm_blob_map(f->store, hash, &bytes, &size), QM_E_EMPTY);
}

static void test_half_written_files_are_swept(void **state)
{
    fixture *f = *state;
    char path[256];
    snprintf(path, sizeof path, "%s/incoming/left", f->folder);
    FILE *left = fopen(path, "w");
    assert_non_null(left);
    fclose(left);
    reopen(f);
    assert_int_equal(count_files(f, "incoming"), 0);
}

/* ---- meshes ---- */

static void put_mesh(const fixture *f, const char *id, const char *hash, const char *options)
{
    qm_store_mesh mesh = {
        .options = (char *)options, .name = (char *)"n\xc3\xa4me", .document = (char *)"{}", .format = 3};
    snprintf(mesh.id, sizeof mesh.id, "%s", id);
    snprintf(mesh.hash, sizeof mesh.hash, "%s", hash);
    assert_int_equal(qm_store_put_mesh(f->store, &mesh), QM_OK);
}

static void test_meshes_survive(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    keep_blob(f, "bytes", hash);
    put_mesh(f, "m_1", hash, "format=auto name=");
    reopen(f);
    qm_store_mesh found;
    assert_true(qm_store_find_mesh(f->store, "m_1", &found));
    assert_string_equal(found.hash, hash);
    assert_string_equal(found.name, "n\xc3\xa4me");
    assert_string_equal(found.document, "{}");
    assert_int_equal(found.format, 3);
    qm_store_mesh_reset(&found);
    assert_true(qm_store_find_mesh_by_content(f->store, hash, "format=auto name=", &found));
    assert_string_equal(found.id, "m_1");
    qm_store_mesh_reset(&found);
    assert_false(qm_store_find_mesh_by_content(f->store, hash, "format=ply name=", &found));
    assert_false(qm_store_find_mesh(f->store, "m_1' OR 1 --", &found));
}

static void test_pages_of_meshes(void **state)
{
    fixture *f = *state;
    enum { COUNT = 7, PAGE = 3 };
    for (int i = 0; i < COUNT; i++) {
        char id[16];
        snprintf(id, sizeof id, "m_%d", i);
        put_mesh(f, id, "", "");
    }
    qm_store_mesh page[PAGE];
    int64_t after = 0;
    size_t total = 0, count;
    while ((count = qm_store_list_meshes(f->store, after, PAGE, page)) > 0) {
        for (size_t i = 0; i < count; i++) {
            assert_int_equal(page[i].id[2] - '0', total + i);
            assert_true(page[i].sequence > after);
            after = page[i].sequence;
            qm_store_mesh_reset(&page[i]);
        }
        total += count;
    }
    assert_int_equal(total, COUNT);
}

static void test_a_blob_goes_with_its_last_mesh(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    keep_blob(f, "shared", hash);
    put_mesh(f, "m_1", hash, "a");
    put_mesh(f, "m_2", hash, "b");
    assert_true(qm_store_delete_mesh(f->store, "m_1"));
    assert_false(qm_store_delete_mesh(f->store, "m_1"));
    check_blob(f, hash, "shared");
    assert_true(qm_store_delete_mesh(f->store, "m_2"));
    assert_int_equal(count_files(f, "blobs"), 0);
}

/* ---- jobs ---- */

static qm_status submit(const fixture *f, const char *id, const char *key, const char *idempotency_key)
{
    qm_store_job job = {.key = (char *)key,
                        .idempotency_key = (char *)idempotency_key,
                        .body = (char *)"{\"type\":1}",
                        .created = (char *)"2030-01-02T03:04:05.678Z"};
    snprintf(job.id, sizeof job.id, "%s", id);
    return qm_store_submit_job(f->store, &job);
}

static void test_jobs_survive(void **state)
{
    fixture *f = *state;
    assert_int_equal(submit(f, "j_1", "key", "client's"), QM_OK);
    assert_int_equal(submit(f, "j_2", "key", NULL), QM_OK);
    assert_int_equal(submit(f, "j_3", "other", NULL), QM_OK);
    assert_int_equal(qm_store_finish_job(f->store, "j_2", 2, "{\"done\":1}", "{}\n{}\n"), QM_OK);
    reopen(f);
    qm_store_job found;
    assert_true(qm_store_find_job(f->store, "j_2", &found));
    assert_int_equal(found.state, 2);
    assert_string_equal(found.document, "{\"done\":1}");
    assert_string_equal(found.events, "{}\n{}\n");
    assert_null(found.idempotency_key);
    qm_store_job_reset(&found);
    assert_true(qm_store_find_job_by_key(f->store, "key", 2, &found));
    assert_string_equal(found.id, "j_2");
    qm_store_job_reset(&found);
    assert_false(qm_store_find_job_by_key(f->store, "other", 2, &found));
    assert_true(qm_store_find_job_by_idempotency_key(f->store, "client's", &found));
    assert_string_equal(found.id, "j_1");
    assert_null(found.document);
    assert_string_equal(found.body, "{\"type\":1}");
    assert_string_equal(found.created, "2030-01-02T03:04:05.678Z");
    qm_store_job_reset(&found);
}

static void test_unfinished_jobs(void **state)
{
    fixture *f = *state;
    submit(f, "j_1", "k", NULL);
    submit(f, "j_2", "k", NULL);
    submit(f, "j_3", "k", NULL);
    qm_store_finish_job(f->store, "j_2", 3, "{}", "{}\n");
    qm_store_job rows[4];
    assert_int_equal(qm_store_list_unfinished_jobs(f->store, 0, 4, rows), 2);
    assert_string_equal(rows[0].id, "j_1");
    assert_string_equal(rows[1].id, "j_3");
    int64_t first = rows[0].sequence;
    qm_store_job_reset(&rows[0]);
    qm_store_job_reset(&rows[1]);
    assert_int_equal(qm_store_list_unfinished_jobs(f->store, first, 4, rows), 1);
    assert_string_equal(rows[0].id, "j_3");
    qm_store_job_reset(&rows[0]);
    assert_int_equal(qm_store_list_jobs(f->store, 0, 2, rows), 2);
    assert_string_equal(rows[1].document, "{}");
    assert_null(rows[1].events);
    qm_store_job_reset(&rows[0]);
    qm_store_job_reset(&rows[1]);
}

static void test_an_idempotency_key_names_one_job(void **state)
{
    fixture *f = *state;
    assert_int_equal(submit(f, "j_1", "k", "same"), QM_OK);
    assert_int_not_equal(submit(f, "j_2", "k", "same"), QM_OK);
    assert_true(qm_store_delete_job(f->store, "j_1"));
    assert_false(qm_store_delete_job(f->store, "j_1"));
    assert_int_equal(submit(f, "j_2", "k", "same"), QM_OK);
}

/* ---- folders that cannot be used ---- */

static void test_a_folder_has_one_owner(void **state)
{
    fixture *f = *state;
    qm_store *other;
    char message[QM_MESSAGE_SIZE];
    assert_int_not_equal(qm_store_open(f->folder, &other, message), QM_OK);
    assert_null(other);
    assert_non_null(strstr(message, "another process"));
}

static void test_a_broken_database_is_refused(void **state)
{
    fixture *f = *state;
    char path[256], message[QM_MESSAGE_SIZE] = "";
    qm_store_close(f->store);
    snprintf(path, sizeof path, "%s/quadmeshd.sqlite", f->folder);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    for (int i = 0; i < 1000; i++)
        fputs("not a database ", file);
    fclose(file);
    assert_int_not_equal(qm_store_open(f->folder, &f->store, message), QM_OK);
    QM_CHECK(strncmp(message, "database: ", 10) == 0, "%s", message);
}

static void test_a_database_of_another_version_is_refused(void **state)
{
    fixture *f = *state;
    char path[256], message[QM_MESSAGE_SIZE] = "";
    qm_store_close(f->store);
    snprintf(path, sizeof path, "%s/quadmeshd.sqlite", f->folder);
    FILE *file = fopen(path, "r+b");
    assert_non_null(file);
    /* The user version of an SQLite file, big-endian (sqlite.org/fileformat2.html, 1.3). */
    assert_int_equal(fseek(file, 60, SEEK_SET), 0);
    assert_int_equal(fwrite("\0\0\3\xe7", 1, 4, file), 4);
    fclose(file);
    assert_int_equal(qm_store_open(f->folder, &f->store, message), QM_E_UNSUPPORTED);
    assert_non_null(strstr(message, "another version"));
}

static void test_a_folder_that_cannot_be_made(void **state)
{
    (void)state;
    qm_store *store;
    char message[QM_MESSAGE_SIZE] = "";
    assert_int_not_equal(qm_store_open("/proc/nowhere/data", &store, message), QM_OK);
    assert_null(store);
    assert_true(strlen(message) > 0);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_hashes),
        TEST(test_kept_blobs_survive),
        TEST(test_dropped_blobs_leave_nothing),
        TEST(test_half_written_files_are_swept),
        TEST(test_meshes_survive),
        TEST(test_pages_of_meshes),
        TEST(test_a_blob_goes_with_its_last_mesh),
        TEST(test_jobs_survive),
        TEST(test_unfinished_jobs),
        TEST(test_an_idempotency_key_names_one_job),
        TEST(test_a_folder_has_one_owner),
        TEST(test_a_broken_database_is_refused),
        TEST(test_a_database_of_another_version_is_refused),
        cmocka_unit_test(test_a_folder_that_cannot_be_made),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
