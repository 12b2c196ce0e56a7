/*
 * All records of the store are there after it was opened again; blobs are named by their hash.
 */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "check.h"
#include "folder.h"
#include "store/checksum.h"
#include "store/result_file.h"
#include "store/store.h"
#include "store/store_parts.h"
#include "store/store_sqlite.h"

typedef struct fixture {
    char *folder;
    qm_store *store;
} fixture;

static void open_store(fixture *f)
{
    char message[QM_MESSAGE_SIZE] = "";
    qm_status status = qm_store_open(f->folder, QM_STORE_SERVE, &f->store, message);
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
    assert_int_equal(qm_blob_begin(f->store, 0, &writer), QM_OK);
    assert_int_equal(qm_blob_write(writer, text, half), QM_OK);
    assert_int_equal(qm_blob_write(writer, text + half, strlen(text) - half), QM_OK);
    assert_int_equal(qm_blob_seal(writer, hash), QM_OK);
    return writer;
}

static void keep_blob(const fixture *f, const char *text, char hash[QM_HASH_SIZE])
{
    assert_int_equal(qm_blob_keep(write_blob(f, text, hash)), QM_STORED);
}

static qm_stored submit_row(const fixture *f, const qm_store_job *job)
{
    return qm_store_submit_job(f->store, &(qm_store_submission){.job = job});
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

/** Replaces what stands in the file of a blob. */
static void overwrite_blob(const fixture *f, const char *hash, const char *bytes, size_t size)
{
    char path[256];
    snprintf(path, sizeof path, "%s/blobs/%.2s/%s", f->folder, hash, hash);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

/** Whatever bit is another one, and wherever the file ends. The same bytes, stored again, repair it. */
static void test_a_damaged_blob_is_never_mapped(void **state)
{
    fixture *f = *state;
    static const char text[] = "the bytes of a mesh";
    char hash[QM_HASH_SIZE], damaged[sizeof text] = "";
    size_t size = sizeof text - 1, got;
    const uint8_t *bytes;
    keep_blob(f, text, hash);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        memcpy(damaged, text, sizeof text);
        damaged[bit / 8] ^= (char)(1 << bit % 8);
        overwrite_blob(f, hash, damaged, size);
        assert_int_equal(qm_blob_map(f->store, hash, &bytes, &got), QM_E_FORMAT);
        assert_int_equal(qm_blob_check(f->store, hash), QM_E_FORMAT);
    }
    for (size_t length = 0; length < size; length++) {
        overwrite_blob(f, hash, text, length);
        assert_int_equal(qm_blob_map(f->store, hash, &bytes, &got), QM_E_FORMAT);
    }
    overwrite_blob(f, hash, text, size + 1);
    assert_int_equal(qm_blob_map(f->store, hash, &bytes, &got), QM_E_FORMAT);
    keep_blob(f, text, hash);
    assert_int_equal(qm_blob_check(f->store, hash), QM_OK);
    check_blob(f, hash, text);
}

static qm_store_mesh make_mesh(const char *id, const char *hash, const char *options)
{
    qm_store_mesh mesh = {.options = (char *)options,
                          .name = (char *)"n\xc3\xa4me",
                          .document = (char *)"{}",
                          .created = (char *)"2026-01-02T03:04:05.678Z",
                          .format = 3};
    snprintf(mesh.id, sizeof mesh.id, "%s", id);
    snprintf(mesh.hash, sizeof mesh.hash, "%s", hash);
    return mesh;
}

static void put_mesh(const fixture *f, const char *id, const char *hash, const char *options)
{
    qm_store_mesh mesh = make_mesh(id, hash, options);
    assert_int_equal(qm_store_put_mesh(f->store, &mesh), QM_STORED);
}

static void test_kept_blobs_survive(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    keep_blob(f, "a mesh", hash);
    keep_blob(f, "a mesh", hash);
    assert_int_equal(count_files(f, "blobs"), 1);
    put_mesh(f, "m_1", hash, "");
    reopen(f);
    check_blob(f, hash, "a mesh");
}

static void set_age(const fixture *f, const char *file, time_t seconds)
{
    char path[256];
    const struct timespec then[2] = {{.tv_sec = time(NULL) - seconds}, {.tv_sec = time(NULL) - seconds}};
    snprintf(path, sizeof path, "%s/%s", f->folder, file);
    assert_int_equal(utimensat(AT_FDCWD, path, then, 0), 0);
}

/** Left by an end between a file and its row, or by a database that has lost rows: there is a day to notice. */
static void test_old_files_without_a_row_are_swept(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    keep_blob(f, "unused", hash);
    qm_store_job job = {.key = (char *)"k", .body = (char *)"{}", .created = (char *)"2030"};
    snprintf(job.id, sizeof job.id, "j_here");
    assert_int_equal(submit_row(f, &job), QM_STORED);
    assert_int_equal(qm_result_file_write(f->store, "j_here", (double[]){1.0}, 1), QM_STORED);
    assert_int_equal(qm_result_file_write(f->store, "j_gone", (double[]){1.0}, 1), QM_STORED);
    char blob[QM_HASH_SIZE + 16];
    snprintf(blob, sizeof blob, "blobs/%.2s/%s", hash, hash);
    for (int age = 0; age < 2; age++) {
        set_age(f, blob, age * 86000);
        set_age(f, "results/j_gone.f64", age * 86000);
        reopen(f);
        assert_int_equal(count_files(f, "blobs"), 1);
        assert_int_equal(count_files(f, "results"), 2);
    }
    set_age(f, blob, 86500);
    set_age(f, "results/j_gone.f64", 86500);
    set_age(f, "results/j_here.f64", 86500);
    reopen(f);
    assert_int_equal(count_files(f, "blobs"), 0);
    assert_int_equal(count_files(f, "results"), 1);
    qm_result_file *kept;
    assert_int_equal(qm_result_file_open(f->store, "j_here", &kept), QM_OK);
    assert_int_equal(qm_result_file_count(kept), 1);
    qm_result_file_close(kept);
}

static void note_orphan(void *user, const char *hash)
{
    qm_text_printf(user, "%s;", hash);
}

/** Every file would be without a row: a folder like this is opened when somebody says what is to become of them. */
static void test_files_without_a_database_are_left_alone(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE], path[256], message[QM_MESSAGE_SIZE] = "", expected[QM_HASH_SIZE + 1];
    keep_blob(f, "a mesh", hash);
    put_mesh(f, "m_1", hash, "");
    snprintf(expected, sizeof expected, "%s;", hash);
    snprintf(path, sizeof path, "%s/quadmeshd.sqlite", f->folder);
    assert_int_equal(qm_store_empty(f->folder, message), QM_E_ARGUMENT); /* in use */
    qm_store_close(f->store);
    f->store = NULL;
    assert_int_equal(qm_store_empty(f->folder, message), QM_E_ARGUMENT); /* there is a database */
    for (int pass = 0; pass < 2; pass++) {
        if (pass == 0) assert_int_equal(unlink(path), 0);
        if (pass == 1) assert_int_equal(truncate(path, 0), 0);
        assert_int_equal(qm_store_open(f->folder, QM_STORE_SERVE, &f->store, message), QM_E_EMPTY);
        assert_non_null(strstr(message, "--adopt"));
        assert_int_equal(qm_store_open(f->folder, QM_STORE_CHECK, &f->store, message), QM_E_EMPTY);
        assert_int_equal(count_files(f, "blobs"), 1);
        assert_int_equal(qm_store_open(f->folder, QM_STORE_ADOPT, &f->store, message), QM_OK);
        qm_text orphans = {0};
        assert_true(qm_blob_each_orphan(f->store, note_orphan, &orphans));
        assert_string_equal(orphans.data, expected);
        qm_text_reset(&orphans);
        qm_store_close(f->store);
    }
    assert_int_equal(unlink(path), 0);
    assert_int_equal(qm_store_empty(f->folder, message), QM_OK);
    open_store(f);
    assert_int_equal(count_files(f, "blobs"), 0);
    assert_int_equal(count_files(f, "lost"), 1);
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

/** Writes a size of bytes 0, 1, 2 ... in pieces of 1000. */
static qm_blob_writer *write_long(const fixture *f, size_t size)
{
    qm_blob_writer *writer;
    uint8_t piece[1000];
    assert_int_equal(qm_blob_begin(f->store, 0, &writer), QM_OK);
    for (size_t done = 0; done < size;) {
        size_t part = size - done < sizeof piece ? size - done : sizeof piece;
        for (size_t i = 0; i < part; i++)
            piece[i] = (uint8_t)(done + i);
        assert_int_equal(qm_blob_write(writer, piece, part), QM_OK);
        done += part;
    }
    assert_int_equal(qm_blob_size(writer), size);
    return writer;
}

/** A few bytes wait in memory and many in a file; either way they can be read back from any place. */
static void test_bytes_are_read_back_while_they_come(void **state)
{
    fixture *f = *state;
    static const size_t sizes[] = {0, 1, 65000, 65536, 65537, 200001};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        qm_blob_writer *writer = write_long(f, sizes[i]);
        QM_CHECK(count_files(f, "incoming") == (sizes[i] > 65536), "%zu bytes", sizes[i]);
        for (size_t place = 0; place + 10 < sizes[i]; place += 7919) {
            uint8_t got[10];
            assert_int_equal(qm_blob_read(writer, place, got, sizeof got), QM_OK);
            for (size_t k = 0; k < sizeof got; k++)
                assert_int_equal(got[k], (uint8_t)(place + k));
        }
        uint8_t beyond[2];
        assert_int_not_equal(qm_blob_read(writer, sizes[i], beyond, 1), QM_OK);
        assert_int_not_equal(qm_blob_read(writer, sizes[i] - (sizes[i] > 0), beyond, 2), QM_OK);
        qm_blob_abort(writer);
        assert_int_equal(count_files(f, "incoming"), 0);
    }
}

/** In memory, in a file, and with a thread that takes the hash behind the writer; bytes in odd pieces. */
static void test_hashes_of_all_sizes(void **state)
{
    fixture *f = *state;
    static const size_t sizes[] = {65536, 65537, 262144, (1 << 20) - 1, 1 << 20, (1 << 20) + 1, 3500001};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        char hash[QM_HASH_SIZE], expected[QM_HASH_SIZE];
        uint8_t digest[QM_DIGEST_SIZE], *bytes = malloc(sizes[i]);
        assert_non_null(bytes);
        for (size_t k = 0; k < sizes[i]; k++)
            bytes[k] = (uint8_t)(k * k >> 7);
        qm_id_hash_bytes(bytes, sizes[i], digest);
        qm_id_hash_print(digest, expected);
        qm_blob_writer *writer;
        assert_int_equal(qm_blob_begin(f->store, 0, &writer), QM_OK);
        for (size_t done = 0, piece; done < sizes[i]; done += piece) {
            piece = sizes[i] - done < 47001 ? sizes[i] - done : 47001;
            assert_int_equal(qm_blob_write(writer, bytes + done, piece), QM_OK);
        }
        assert_int_equal(qm_blob_seal(writer, hash), QM_OK);
        QM_CHECK(strcmp(hash, expected) == 0, "%zu bytes", sizes[i]);
        qm_blob_abort(writer);
        free(bytes);
    }
    qm_blob_abort(write_long(f, 3500001)); /* while its hash is being taken */
    assert_int_equal(count_files(f, "incoming"), 0);
}

static void test_unsealed_blobs_leave_nothing(void **state)
{
    fixture *f = *state;
    qm_blob_writer *writer = write_long(f, 100000);
    assert_int_equal(count_files(f, "incoming"), 1);
    qm_blob_abort(writer);
    assert_int_equal(count_files(f, "incoming") + count_files(f, "blobs"), 0);
    qm_blob_abort(NULL);
}

/** A file where a folder is due: the upload ends in words for the log, and leaves nothing behind. */
static void test_a_blob_that_cannot_be_named(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE], path[256];
    qm_blob_writer *writer = write_blob(f, "abc", hash);
    snprintf(path, sizeof path, "%s/blobs/%.2s", f->folder, hash);
    FILE *obstacle = fopen(path, "w");
    assert_non_null(obstacle);
    fclose(obstacle);
    assert_int_not_equal(qm_blob_keep(writer), QM_STORED);
    assert_int_equal(count_files(f, "incoming"), 0);
    assert_int_equal(count_files(f, "blobs"), 1);
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

static void test_meshes_survive(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    keep_blob(f, "bytes", hash);
    put_mesh(f, "m_1", hash, "format=auto name=");
    reopen(f);
    qm_store_mesh found;
    assert_int_equal(QM_STORED, qm_store_find_mesh(f->store, "m_1", &found));
    assert_string_equal(found.hash, hash);
    assert_string_equal(found.name, "n\xc3\xa4me");
    assert_string_equal(found.document, "{}");
    assert_int_equal(found.format, 3);
    qm_store_mesh_reset(&found);
    assert_int_equal(QM_STORED, qm_store_find_mesh_by_content(f->store, hash, "format=auto name=", &found));
    assert_string_equal(found.id, "m_1");
    qm_store_mesh_reset(&found);
    assert_int_equal(QM_STORED_NONE,
                     qm_store_find_mesh_by_content(f->store, hash, "format=ply name=", &found));
    assert_int_equal(QM_STORED_NONE, qm_store_find_mesh(f->store, "m_1' OR 1 --", &found));
}

static void test_a_revision_takes_the_place_of_the_one_before(void **state)
{
    fixture *f = *state;
    char file[QM_HASH_SIZE], first[QM_HASH_SIZE], second[QM_HASH_SIZE];
    keep_blob(f, "file", file);
    keep_blob(f, "first", first);
    keep_blob(f, "second", second);
    put_mesh(f, "m_1", file, "options");
    qm_store_mesh mesh;
    assert_int_equal(QM_STORED, qm_store_find_mesh(f->store, "m_1", &mesh));
    assert_int_equal(mesh.revision, 0);
    assert_string_equal(mesh.positions, "");
    free(mesh.options);
    mesh.options = strdup("deformed");
    mesh.revision = 1;
    memcpy(mesh.positions, first, sizeof first);
    assert_int_equal(qm_store_revise_mesh(f->store, &mesh), QM_STORED);
    assert_int_equal(qm_store_revise_mesh(f->store, &mesh), QM_STORED); /* once more: it is done */
    memcpy(mesh.positions, second, sizeof second);
    assert_int_equal(qm_store_revise_mesh(f->store, &mesh), QM_STORED_LATE);
    mesh.revision = 2;
    memcpy(mesh.positions, second, sizeof second);
    assert_int_equal(qm_store_revise_mesh(f->store, &mesh), QM_STORED);
    qm_store_mesh_reset(&mesh);

    assert_int_equal(QM_STORED_NONE, qm_store_find_mesh_by_content(f->store, file, "options", &mesh));
    assert_int_equal(QM_STORED, qm_store_find_mesh(f->store, "m_1", &mesh));
    assert_int_equal(mesh.revision, 2);
    assert_string_equal(mesh.positions, second);
    assert_string_equal(mesh.created, "2026-01-02T03:04:05.678Z");
    qm_store_mesh_reset(&mesh);
    const uint8_t *bytes;
    size_t size;
    assert_int_equal(qm_blob_map(f->store, first, &bytes, &size), QM_E_EMPTY);
    check_blob(f, second, "second");
    assert_int_equal(QM_STORED, qm_store_delete_mesh(f->store, "m_1"));
    assert_int_equal(qm_blob_map(f->store, second, &bytes, &size), QM_E_EMPTY);
    assert_int_equal(qm_blob_map(f->store, file, &bytes, &size), QM_E_EMPTY);
}

static void check_expired(const fixture *f, const char *before, const char *expected)
{
    qm_store_mesh mesh;
    qm_stored stored = qm_store_find_expired_mesh(f->store, before, &mesh);
    assert_int_equal(stored, expected ? QM_STORED : QM_STORED_NONE);
    if (!expected) return;
    assert_string_equal(mesh.id, expected);
    qm_store_mesh_reset(&mesh);
}

static void test_meshes_expire_in_order(void **state)
{
    fixture *f = *state;
    for (const char *id = "abc"; *id; id++)
        put_mesh(f, (char[]){*id, 0}, "", (char[]){*id, 0});
    check_expired(f, "9999-01-01T00:00:00.000Z", NULL);
    assert_int_equal(qm_store_set_expiry(f->store, "a", "2026-03-01T00:00:00.000Z"), QM_STORED);
    assert_int_equal(qm_store_set_expiry(f->store, "b", "2026-02-01T00:00:00.000Z"), QM_STORED);
    assert_int_equal(qm_store_set_expiry(f->store, "d", "2026-02-01T00:00:00.000Z"), QM_STORED_NONE);
    reopen(f);
    check_expired(f, "2026-02-01T00:00:00.000Z", NULL);
    check_expired(f, "2026-02-01T00:00:00.001Z", "b");
    assert_int_equal(qm_store_set_expiry(f->store, "b", ""), QM_STORED);
    check_expired(f, "2026-12-31T00:00:00.000Z", "a");
    assert_int_equal(qm_store_delete_mesh(f->store, "a"), QM_STORED);
    check_expired(f, "9999-01-01T00:00:00.000Z", NULL);
}

static void test_pages_of_meshes(void **state)
{
    fixture *f = *state;
    enum { COUNT = 7, PAGE = 3 };
    for (int i = 0; i < COUNT; i++) {
        char id[16];
        snprintf(id, sizeof id, "m_%d", i);
        put_mesh(f, id, "", id);
    }
    qm_store_mesh page[PAGE];
    for (int newest = 0; newest < 2; newest++) {
        qm_store_page asked = {.limit = PAGE, .newest_first = newest};
        const qm_store_mesh_filter all = {0};
        size_t total = 0, count;
        while (qm_store_list_meshes(f->store, &asked, &all, page, &count) == QM_STORED && count > 0) {
            for (size_t i = 0; i < count; i++) {
                size_t number = newest ? COUNT - 1 - (total + i) : total + i;
                assert_int_equal(page[i].id[2] - '0', number);
                assert_true(asked.after == 0 || (page[i].sequence < asked.after) == newest);
                asked.after = page[i].sequence;
                qm_store_mesh_reset(&page[i]);
            }
            total += count;
        }
        assert_int_equal(total, COUNT);
    }
}

static void test_a_blob_goes_with_its_last_mesh(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    keep_blob(f, "shared", hash);
    put_mesh(f, "m_1", hash, "a");
    put_mesh(f, "m_2", hash, "b");
    assert_int_equal(QM_STORED, qm_store_delete_mesh(f->store, "m_1"));
    assert_int_equal(QM_STORED_NONE, qm_store_delete_mesh(f->store, "m_1"));
    check_blob(f, hash, "shared");
    assert_int_equal(QM_STORED, qm_store_delete_mesh(f->store, "m_2"));
    assert_int_equal(count_files(f, "blobs"), 0);
}

/* ---- jobs ---- */

static const qm_job_state unfinished = QM_JOB_QUEUED;

static qm_stored list_jobs(fixture *f, int64_t after, size_t limit, const qm_job_state *of_state,
                           qm_store_job *out, size_t *count)
{
    const qm_store_page page = {.after = after, .limit = limit};
    const qm_store_job_filter filter = {.state = of_state};
    return qm_store_list_jobs(f->store, &page, &filter, out, count);
}

static qm_stored submit(const fixture *f, const char *id, const char *key, const char *idempotency_key)
{
    qm_store_job job = {.key = (char *)key,
                        .idempotency_key = (char *)idempotency_key,
                        .body = (char *)"{\"type\":1}",
                        .created = (char *)"2030-01-02T03:04:05.678Z"};
    snprintf(job.id, sizeof job.id, "%s", id);
    return submit_row(f, &job);
}

static qm_stored finish(const fixture *f, const char *id, qm_job_state state, const char *document,
                        const char *revisions)
{
    const qm_store_event last = {id, 1000, "result", "\"last\":1"};
    qm_store_job end = {.state = state, .document = (char *)document, .result = (char *)"{\"result\":1}"};
    snprintf(end.id, sizeof end.id, "%s", id);
    return qm_store_finish_job(f->store, &end, revisions, &last, 1, NULL);
}

static void check_usage(const fixture *f, uint64_t blobs, uint64_t results, uint64_t uploads)
{
    qm_store_usage usage;
    qm_store_measure(f->store, &usage);
    assert_int_equal(usage.files[QM_STORE_BLOBS], blobs);
    assert_int_equal(usage.files[QM_STORE_RESULTS], results);
    assert_int_equal(usage.files[QM_STORE_UPLOADS], uploads);
    assert_int_equal(usage.total, blobs + results + uploads + usage.database);
}

static void test_bytes_are_counted(void **state)
{
    enum { LARGE = 1 << 20 };
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    double numbers[100] = {0};
    qm_blob_writer *writer;
    uint8_t *bytes = calloc(LARGE, 1);
    keep_blob(f, "1234567", hash);
    put_mesh(f, "m_1", hash, "");
    check_usage(f, 7, 0, 0);
    keep_blob(f, "1234567", hash); /* in place of itself */
    check_usage(f, 7, 0, 0);
    assert_int_equal(qm_blob_begin(f->store, LARGE, &writer), QM_OK);
    check_usage(f, 7, 0, LARGE);
    assert_int_equal(qm_blob_write(writer, bytes, LARGE / 2), QM_OK);
    check_usage(f, 7, 0, LARGE);
    qm_blob_abort(writer);
    check_usage(f, 7, 0, 0);
    /* The last bytes wait in memory until the end. */
    char long_hash[QM_HASH_SIZE];
    assert_int_equal(qm_blob_begin(f->store, 0, &writer), QM_OK);
    assert_int_equal(qm_blob_write(writer, bytes, LARGE), QM_OK);
    assert_int_equal(qm_blob_write(writer, bytes, 100), QM_OK);
    assert_int_equal(qm_blob_seal(writer, long_hash), QM_OK);
    check_usage(f, 7, 0, LARGE + 100);
    assert_int_equal(qm_blob_keep(writer), QM_STORED);
    check_usage(f, LARGE + 107, 0, 0);
    qm_blob_remove(f->store, long_hash);
    check_usage(f, 7, 0, 0);
    assert_int_equal(submit(f, "j_1", "", NULL), QM_STORED);
    assert_int_equal(qm_result_file_write(f->store, "j_1", numbers, 100), QM_STORED);
    check_usage(f, 7, 800, 0);
    assert_int_equal(qm_result_file_write(f->store, "j_1", numbers, 50), QM_STORED);
    check_usage(f, 7, 400, 0);
    reopen(f);
    check_usage(f, 7, 400, 0);

    qm_store_usage usage;
    qm_store_measure(f->store, &usage);
    qm_store_set_quota(f->store, usage.total + LARGE);
    assert_int_equal(qm_blob_begin(f->store, LARGE + 1, &writer), QM_E_TOO_LARGE);
    assert_int_equal(qm_blob_begin(f->store, 0, &writer), QM_OK);
    assert_int_equal(qm_blob_write(writer, bytes, LARGE), QM_OK);
    assert_int_equal(qm_result_file_write(f->store, "j_1", numbers, 1), QM_STORED_FULL);
    assert_int_equal(qm_blob_write(writer, bytes, LARGE), QM_E_TOO_LARGE);
    qm_blob_abort(writer);
    check_usage(f, 7, 400, 0);
    qm_store_set_quota(f->store, usage.total);
    qm_store_job job = {.id = "j_2", .key = "", .body = "{}", .created = ""};
    assert_int_equal(submit_row(f, &job), QM_STORED_FULL);
    qm_result_file_remove(f->store, "j_1");
    check_usage(f, 7, 0, 0);
    assert_int_equal(submit_row(f, &job), QM_STORED);
    assert_int_equal(qm_store_delete_mesh(f->store, "m_1"), QM_STORED);
    check_usage(f, 0, 0, 0);
    free(bytes);
}

static void test_jobs_survive(void **state)
{
    fixture *f = *state;
    assert_int_equal(submit(f, "j_1", "key", "client's"), QM_STORED);
    assert_int_equal(submit(f, "j_2", "key", NULL), QM_STORED);
    assert_int_equal(submit(f, "j_3", "other", NULL), QM_STORED);
    assert_int_equal(finish(f, "j_2", 2, "{\"done\":1}", "0 3"), QM_STORED);
    reopen(f);
    qm_store_job found;
    assert_int_equal(QM_STORED, qm_store_find_job(f->store, "j_2", &found));
    assert_int_equal(found.state, 2);
    assert_string_equal(found.document, "{\"done\":1}");
    assert_string_equal(found.result, "{\"result\":1}");
    assert_null(found.idempotency_key);
    qm_store_job_reset(&found);
    assert_int_equal(QM_STORED, qm_store_find_job_by_key(f->store, "key", "0 3", 2, &found));
    assert_string_equal(found.id, "j_2");
    qm_store_job_reset(&found);
    assert_int_equal(QM_STORED_NONE, qm_store_find_job_by_key(f->store, "other", "0 3", 2, &found));
    assert_int_equal(QM_STORED, qm_store_find_job_by_idempotency_key(f->store, "client's", &found));
    assert_string_equal(found.id, "j_1");
    assert_null(found.document);
    assert_string_equal(found.body, "{\"type\":1}");
    assert_string_equal(found.created, "2030-01-02T03:04:05.678Z");
    qm_store_job_reset(&found);
}

/** Claims up to limit jobs of an earlier process, and checks their last digits and how often they were claimed before. */
static void claim(fixture *f, size_t limit, const char *expected, int64_t restarts)
{
    char found[16] = "";
    qm_store_job rows[4];
    size_t count;
    const qm_store_wish wish = {.free = limit};
    assert_int_equal(qm_store_claim_jobs(f->store, &wish, rows, &count), QM_STORED);
    for (size_t i = 0; i < count; i++) {
        found[i] = rows[i].id[2];
        assert_int_equal(rows[i].restarts, restarts);
        qm_store_job_reset(&rows[i]);
    }
    assert_string_equal(found, expected);
}

static void test_unfinished_jobs(void **state)
{
    size_t listed;
    fixture *f = *state;
    claim(f, 4, "", 0);
    submit(f, "j_1", "k", NULL);
    submit(f, "j_2", "k", NULL);
    submit(f, "j_3", "k", NULL);
    claim(f, 4, "", 0); /* the jobs of this process are its own */
    reopen(f);
    claim(f, 2, "12", 1);
    submit(f, "j_4", "k", NULL);
    claim(f, 2, "3", 1);
    claim(f, 2, "", 1);
    assert_int_equal(finish(f, "j_2", 3, "{}", ""), QM_STORED_LOST); /* of an earlier run */
    const qm_store_job end = {.id = "j_2", .state = QM_JOB_FAILED, .document = (char *)"{}", .restarts = 1};
    assert_int_equal(qm_store_finish_job(f->store, &end, "", NULL, 0, NULL), QM_STORED);
    assert_int_equal(qm_store_finish_job(f->store, &end, "", NULL, 0, NULL), QM_STORED);
    const qm_store_job other = {
        .id = "j_2", .state = QM_JOB_CANCELED, .document = (char *)"{}", .restarts = 1};
    assert_int_equal(qm_store_finish_job(f->store, &other, "", NULL, 0, NULL), QM_STORED_LOST);
    reopen(f);
    qm_store_job rows[4];
    assert_int_equal(QM_STORED, qm_store_find_job(f->store, "j_2", &rows[0]));
    assert_int_equal(rows[0].restarts, 1);
    qm_store_job_reset(&rows[0]);
    assert_int_equal(QM_STORED, list_jobs(f, 0, 4, &unfinished, rows, &listed));
    assert_int_equal(listed, 3);
    assert_string_equal(rows[0].id, "j_1");
    assert_string_equal(rows[1].id, "j_3");
    assert_string_equal(rows[2].id, "j_4");
    int64_t second = rows[1].sequence;
    for (size_t i = 0; i < listed; i++)
        qm_store_job_reset(&rows[i]);
    assert_int_equal(QM_STORED, list_jobs(f, second, 4, &unfinished, rows, &listed));
    assert_int_equal(listed, 1);
    assert_string_equal(rows[0].id, "j_4");
    qm_store_job_reset(&rows[0]);
    assert_int_equal(QM_STORED, list_jobs(f, 0, 2, NULL, rows, &listed));
    assert_int_equal(listed, 2);
    assert_string_equal(rows[1].document, "{}");
    qm_store_job_reset(&rows[0]);
    qm_store_job_reset(&rows[1]);
    claim(f, 1, "1", 2);
}

/** Adds "SEQ NAME MEMBERS;" to a text. */
static bool note_event(void *user, const qm_store_event *event)
{
    qm_text_printf(user, "%llu %s %s;", (unsigned long long)event->seq, event->name, event->members);
    return true;
}

static void check_events(const fixture *f, const char *id, const char *expected)
{
    qm_text all = {0};
    assert_int_equal(qm_store_read_events(f->store, id, 0, note_event, &all), QM_STORED);
    assert_string_equal(all.data ? all.data : "", expected);
    qm_text_reset(&all);
}

static void test_events_are_appended(void **state)
{
    fixture *f = *state;
    submit(f, "j_1", "k", NULL);
    submit(f, "j_2", "k", NULL);
    check_events(f, "j_1", "");
    const qm_store_event first[] = {
        {"j_1", 1, "n", "a"}, {"j_1", 2, "n", "b"}, {"j_2", 1, "n", "x"}, {"j_none", 1, "n", "?"}};
    const qm_store_event second[] = {{"j_1", 10, "n", "d"}, {"j_1", 3, "n", "c"}};
    qm_store_run runs[] = {{.job = "j_1"}, {.job = "j_2"}, {.job = "j_none"}};
    assert_int_equal(qm_store_append_events(f->store, runs, 3, first, 4), QM_STORED);
    assert_int_equal(qm_store_append_events(f->store, runs, 1, second, 2), QM_STORED);
    reopen(f);
    check_events(f, "j_1", "1 n a;2 n b;3 n c;10 n d;");
    check_events(f, "j_2", "1 n x;");
    check_events(f, "j_none", "");
    /* What may have been stored already comes once more, with what followed; then the job has ended. */
    const qm_store_event longer[] = {{"j_1", 10, "n", "d"}, {"j_1", 11, "result", "e"}};
    const qm_store_job end = {.id = "j_1", .state = QM_JOB_SUCCEEDED, .document = (char *)"{}"};
    assert_int_equal(qm_store_finish_job(f->store, &end, "", longer, 2, NULL), QM_STORED);
    assert_int_equal(qm_store_append_events(f->store, runs, 1, &second[0], 1), QM_STORED);
    check_events(f, "j_1", "1 n a;2 n b;3 n c;10 n d;11 result e;");
    /* They go with their job; another one's stay. */
    assert_int_equal(qm_store_delete_job(f->store, "j_1"), QM_STORED);
    check_events(f, "j_1", "");
    submit(f, "j_1", "k", NULL);
    check_events(f, "j_1", "");
    check_events(f, "j_2", "1 n x;");
}

/** Drops jobs that were submitted before a year, 0: of any. */
static void drop(const fixture *f, size_t kept, int year, size_t limit, const char *expected)
{
    char ids[8][QM_ID_SIZE], joined[400] = "";
    struct tm start = {.tm_year = year - 1900, .tm_mday = 1};
    size_t count;
    assert_int_equal(qm_store_drop_old_jobs(f->store, kept, year ? difftime(time(NULL), timegm(&start)) : 0.0,
                                            limit, ids, &count),
                     QM_STORED);
    for (size_t i = 0; i < count; i++)
        snprintf(joined + strlen(joined), sizeof joined - strlen(joined), "%s ", ids[i]);
    assert_string_equal(joined, expected);
}

/** Lists the last digits of the ids of all jobs that pass a filter, a page of two at a time. */
static void check_filter(fixture *f, const qm_store_job_filter *filter, bool newest_first,
                         const char *expected)
{
    char found[16] = "";
    qm_store_job rows[2];
    qm_store_page page = {.newest_first = newest_first, .limit = 2};
    size_t count, total = 0;
    while (qm_store_list_jobs(f->store, &page, filter, rows, &count) == QM_STORED && count > 0)
        for (size_t i = 0; i < count; i++) {
            assert_true(total + 1 < sizeof found);
            found[total++] = rows[i].id[2];
            page.after = rows[i].sequence;
            qm_store_job_reset(&rows[i]);
        }
    assert_string_equal(found, expected);
}

static void test_jobs_are_listed_by_filters(void **state)
{
    fixture *f = *state;
    static const char *const types[] = {"hausdorff", "deviation"}, *const meshes[] = {"m_1", "m_2", "m_3"};
    for (int i = 0; i < 6; i++) {
        qm_store_job job = {.key = (char *)"k", .body = (char *)"{}", .created = (char *)"2020"};
        job.type = types[i % 2];
        char subjects[16];
        snprintf(subjects, sizeof subjects, "%s%s", meshes[i % 3], i == 5 ? " m_3" : i % 2 ? " m_1" : "");
        job.subjects = subjects;
        snprintf(job.id, sizeof job.id, "j_%d", i);
        assert_int_equal(submit_row(f, &job), QM_STORED);
        if (i > 2)
            assert_int_equal(finish(f, job.id, i == 4 ? QM_JOB_FAILED : QM_JOB_SUCCEEDED, "{}", ""),
                             QM_STORED);
    }
    const qm_job_state succeeded = QM_JOB_SUCCEEDED, failed = QM_JOB_FAILED;
    check_filter(f, &(qm_store_job_filter){0}, false, "012345");
    check_filter(f, &(qm_store_job_filter){0}, true, "543210");
    check_filter(f, &(qm_store_job_filter){.type = "deviation"}, false, "135");
    check_filter(f, &(qm_store_job_filter){.state = &unfinished}, true, "210");
    check_filter(f, &(qm_store_job_filter){.state = &succeeded}, false, "35");
    check_filter(f, &(qm_store_job_filter){.state = &failed, .type = "hausdorff"}, true, "4");
    check_filter(f, &(qm_store_job_filter){.subject = "m_1"}, false, "013");
    check_filter(f, &(qm_store_job_filter){.subject = "m_3"}, true, "52");
    check_filter(f, &(qm_store_job_filter){.subject = "m_3", .type = "deviation", .state = &succeeded}, false,
                 "5");
    check_filter(f, &(qm_store_job_filter){.subject = "' OR 1"}, false, "");
    /* With the job goes what it names. */
    assert_int_equal(qm_store_delete_job(f->store, "j_0"), QM_STORED);
    check_filter(f, &(qm_store_job_filter){.subject = "m_1"}, false, "13");
}

static void test_old_jobs_are_dropped(void **state)
{
    size_t listed;
    fixture *f = *state;
    for (int i = 1; i <= 6; i++) {
        qm_store_job job = {.key = (char *)"k", .body = (char *)"{}"};
        char created[16];
        snprintf(created, sizeof created, "20%d0", i);
        job.created = created;
        snprintf(job.id, sizeof job.id, "j_%d", i);
        assert_int_equal(submit_row(f, &job), QM_STORED);
        if (i != 2) assert_int_equal(finish(f, job.id, 2, "{}", ""), QM_STORED);
    }
    drop(f, 100, 0, 8, "");
    drop(f, 100, 2009, 8, "");
    drop(f, 100, 2015, 8, "j_1 ");
    drop(f, 4, 0, 8, "");
    /* One that has not ended stays, however old. */
    drop(f, 1, 0, 1, "j_3 ");
    drop(f, 2, 0, 8, "j_4 ");
    drop(f, 0, 0, 8, "j_5 j_6 ");
    qm_store_job rows[2];
    assert_int_equal(QM_STORED, list_jobs(f, 0, 2, NULL, rows, &listed));
    assert_int_equal(listed, 1);
    assert_string_equal(rows[0].id, "j_2");
    qm_store_job_reset(&rows[0]);
}

/* ---- arrays ---- */

/** Bytes that differ in one bit have different sums, and so have equal bytes in different places. */
static void test_checksums_tell_bits_apart(void **state)
{
    (void)state;
    uint8_t bytes[67];
    for (size_t i = 0; i < sizeof bytes; i++)
        bytes[i] = (uint8_t)(i * 37);
    for (size_t size = 0; size <= sizeof bytes; size++) {
        uint64_t whole = qm_checksum(bytes, size, 5);
        assert_true(whole != qm_checksum(bytes, size, 6));
        if (size > 0) assert_true(whole != qm_checksum(bytes, size - 1, 5));
        for (size_t bit = 0; bit < 8 * size; bit++) {
            bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
            assert_true(whole != qm_checksum(bytes, size, 5));
            for (size_t second = bit + 1; size == 67 && second < 8 * size; second++) {
                bytes[second / 8] ^= (uint8_t)(1 << second % 8);
                assert_true(whole != qm_checksum(bytes, size, 5));
                bytes[second / 8] ^= (uint8_t)(1 << second % 8);
            }
            bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
        }
    }
}

/** The status of reading the array of a job, which must have its numbers 0, 1, 2 ... when it is read. */
static qm_status read_array(const fixture *f, const char *id, size_t expected)
{
    static double numbers[3 * QM_RESULT_BLOCK];
    qm_result_file *file;
    qm_status status = qm_result_file_open(f->store, id, &file);
    if (status != QM_OK) return status;
    assert_int_equal(qm_result_file_count(file), expected);
    for (size_t done = 0, part; status == QM_OK && done < expected; done += part) {
        part = expected - done < 2 * QM_RESULT_BLOCK ? expected - done : 2 * QM_RESULT_BLOCK;
        status = qm_result_file_read(file, done, numbers, part);
        for (size_t i = 0; status == QM_OK && i < part; i++)
            assert_true(numbers[i] == (double)(done + i));
    }
    qm_result_file_close(file);
    return status;
}

static void test_a_damaged_array_is_never_read(void **state)
{
    fixture *f = *state;
    static const size_t counts[] = {0, 1, QM_RESULT_BLOCK, QM_RESULT_BLOCK + 1, 3 * QM_RESULT_BLOCK - 1};
    static double numbers[3 * QM_RESULT_BLOCK];
    char path[256];
    for (size_t i = 0; i < 3 * QM_RESULT_BLOCK; i++)
        numbers[i] = (double)i;
    submit(f, "j_1", "k", NULL);
    assert_int_equal(read_array(f, "j_1", 0), QM_E_EMPTY);
    snprintf(path, sizeof path, "%s/results/j_1.f64", f->folder);
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        size_t size = 8 * counts[i];
        assert_int_equal(qm_result_file_write(f->store, "j_1", numbers, counts[i]), QM_STORED);
        reopen(f);
        assert_int_equal(read_array(f, "j_1", counts[i]), QM_OK);
        for (size_t k = 0; size > 0 && k < 40; k++) {
            FILE *file = fopen(path, "r+b");
            long place = (long)(k * 7919 % size);
            assert_int_equal(fseek(file, place, SEEK_SET), 0);
            int byte = fgetc(file);
            for (int pass = 0; pass < 2; pass++) { /* a bit turns, and turns back */
                byte ^= 1 << k % 8;
                assert_int_equal(fseek(file, place, SEEK_SET), 0);
                assert_int_equal(fputc(byte, file), byte);
                fflush(file);
                assert_int_equal(read_array(f, "j_1", counts[i]), pass == 0 ? QM_E_FORMAT : QM_OK);
            }
            fclose(file);
        }
        if (size > 0) assert_int_equal(truncate(path, (off_t)size - 1), 0);
        if (size > 0) assert_int_equal(read_array(f, "j_1", counts[i]), QM_E_FORMAT);
        assert_int_equal(truncate(path, (off_t)size + 8), 0);
        assert_int_equal(read_array(f, "j_1", counts[i]), QM_E_FORMAT);
        assert_int_equal(unlink(path), 0);
        assert_int_equal(read_array(f, "j_1", counts[i]), QM_E_FORMAT);
    }
    assert_int_equal(qm_store_delete_job(f->store, "j_1"), QM_STORED);
    assert_int_equal(read_array(f, "j_1", 0), QM_E_EMPTY);
}

static void test_a_forgotten_answer_is_not_found_by_its_key(void **state)
{
    fixture *f = *state;
    qm_store_job found;
    submit(f, "j_1", "k", NULL);
    assert_int_equal(finish(f, "j_1", QM_JOB_SUCCEEDED, "{}", "0 0"), QM_STORED);
    assert_int_equal(qm_store_find_job_by_key(f->store, "k", "0 0", QM_JOB_SUCCEEDED, &found), QM_STORED);
    qm_store_job_reset(&found);
    assert_int_equal(qm_store_forget_answer(f->store, "j_1"), QM_STORED);
    assert_int_equal(qm_store_find_job_by_key(f->store, "k", "0 0", QM_JOB_SUCCEEDED, &found),
                     QM_STORED_NONE);
    assert_int_equal(qm_store_find_job(f->store, "j_1", &found), QM_STORED);
    qm_store_job_reset(&found);
}

static void test_an_idempotency_key_names_one_job(void **state)
{
    fixture *f = *state;
    assert_int_equal(submit(f, "j_1", "k", "same"), QM_STORED);
    assert_int_equal(submit(f, "j_2", "k", "same"), QM_STORED_TAKEN);
    qm_store_job found;
    assert_int_equal(qm_store_find_job(f->store, "j_2", &found), QM_STORED_NONE);
    assert_int_equal(QM_STORED, qm_store_delete_job(f->store, "j_1"));
    assert_int_equal(QM_STORED_NONE, qm_store_delete_job(f->store, "j_1"));
    assert_int_equal(submit(f, "j_2", "k", "same"), QM_STORED);
}

/** A reconstruction at a revision, with a mesh. */
static qm_store_reconstruction make_reconstruction(const char *mesh, int64_t revision)
{
    qm_store_reconstruction r = {.layout = (char *)"{}",
                                 .document = (char *)"\"d\":1",
                                 .steps = (char *)"",
                                 .records = (char *)"",
                                 .state = (char *)"\"s\":1",
                                 .revision = revision};
    snprintf(r.id, sizeof r.id, "r_1");
    snprintf(r.source, sizeof r.source, "m_source");
    snprintf(r.mesh, sizeof r.mesh, "%s", mesh);
    return r;
}

static void check_reconstruction(const fixture *f, const char *mesh, int64_t revision)
{
    qm_store_reconstruction found;
    assert_int_equal(qm_store_find_reconstruction(f->store, "r_1", &found), QM_STORED);
    assert_string_equal(found.mesh, mesh);
    assert_int_equal(found.revision, revision);
    qm_store_reconstruction_reset(&found);
}

static void check_mesh(const fixture *f, const char *id, bool exists)
{
    qm_store_mesh found;
    assert_int_equal(qm_store_find_mesh(f->store, id, &found), exists ? QM_STORED : QM_STORED_NONE);
    if (exists) qm_store_mesh_reset(&found);
}

/** The end of a job, the next revision of a reconstruction and its mesh are stored together, or none of them. */
static void test_a_job_ends_with_its_effect_or_not_at_all(void **state)
{
    fixture *f = *state;
    const qm_store_idempotency once = {.key = NULL};
    qm_store_reconstruction first = make_reconstruction("m_first", 0);
    qm_store_mesh mesh = make_mesh("m_first", "hash", "options");
    assert_int_equal(qm_store_put_reconstruction(f->store, &first, &mesh, &once), QM_STORED);
    check_reconstruction(f, "m_first", 0);
    check_mesh(f, "m_first", true);
    /* The same call again changes nothing. A key that is taken, or a mesh whose content has a row: none of both. */
    qm_store_mesh other = make_mesh("m_other", "hash", "others");
    assert_int_equal(qm_store_put_reconstruction(f->store, &first, &other, &once), QM_STORED);
    check_mesh(f, "m_other", false);
    qm_store_reconstruction again = make_reconstruction("m_first", 0);
    const qm_store_idempotency keyed = {.key = "key"};
    snprintf(again.id, sizeof again.id, "r_2");
    qm_store_mesh equal = make_mesh("m_equal", "hash", "options");
    assert_int_equal(qm_store_put_reconstruction(f->store, &again, &equal, &keyed), QM_STORED_LATE);
    assert_int_equal(qm_store_put_reconstruction(f->store, &again, NULL, &keyed), QM_STORED);
    snprintf(again.id, sizeof again.id, "r_3");
    assert_int_equal(qm_store_put_reconstruction(f->store, &again, &other, &keyed), QM_STORED_TAKEN);
    check_mesh(f, "m_other", false);

    submit(f, "j_1", "k", NULL);
    const qm_store_event last = {"j_1", 1, "result", "e"};
    const qm_store_job end = {.id = "j_1", .state = QM_JOB_SUCCEEDED, .document = (char *)"{}"};
    qm_store_reconstruction late = make_reconstruction("m_other", 2),
                            next = make_reconstruction("m_other", 1);
    assert_int_equal(qm_store_finish_job(f->store, &end, "", &last, 1, &(qm_store_effect){&late, &other}),
                     QM_STORED_LATE);
    check_reconstruction(f, "m_first", 0);
    check_mesh(f, "m_other", false);
    check_events(f, "j_1", "");
    qm_store_job found;
    assert_int_equal(qm_store_find_job(f->store, "j_1", &found), QM_STORED);
    assert_null(found.document);
    qm_store_job_reset(&found);

    assert_int_equal(qm_store_finish_job(f->store, &end, "", &last, 1, &(qm_store_effect){&next, &other}),
                     QM_STORED);
    reopen(f);
    check_reconstruction(f, "m_other", 1);
    check_mesh(f, "m_other", true);
    check_events(f, "j_1", "1 result e;");
    /* The same revision once more is late. */
    assert_int_equal(qm_store_update_reconstruction(f->store, &(qm_store_effect){&next, NULL}),
                     QM_STORED_LATE);
    assert_int_equal(qm_store_delete_reconstruction(f->store, "r_1"), QM_STORED);
    assert_int_equal(qm_store_update_reconstruction(f->store, &(qm_store_effect){&late, NULL}),
                     QM_STORED_LATE);
}

/* ---- folders that cannot be used ---- */

static void test_a_folder_has_one_owner(void **state)
{
    fixture *f = *state;
    qm_store *other;
    char message[QM_MESSAGE_SIZE];
    assert_int_not_equal(qm_store_open(f->folder, QM_STORE_SERVE, &other, message), QM_OK);
    assert_null(other);
    assert_non_null(strstr(message, "another process"));
}

/** Runs in a child process, and returns how it ended. */
static int run_child(void (*task)(const char *folder), const char *folder)
{
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        task(folder);
        _exit(0);
    }
    int end;
    assert_int_equal(waitpid(child, &end, 0), child);
    return end;
}

/** Exits with 0 when the folder is refused. */
static void open_in_vain(const char *folder)
{
    qm_store *store;
    char message[QM_MESSAGE_SIZE] = "";
    if (qm_store_open(folder, QM_STORE_SERVE, &store, message) == QM_OK) _exit(1);
    if (!strstr(message, "another process")) _exit(2);
}

static void test_a_refused_process_leaves_uploads_alone(void **state)
{
    fixture *f = *state;
    qm_blob_writer *writer;
    char hash[QM_HASH_SIZE];
    writer = write_blob(f, "on its way", hash);
    int end = run_child(open_in_vain, f->folder);
    assert_true(WIFEXITED(end));
    assert_int_equal(WEXITSTATUS(end), 0);
    assert_int_equal(count_files(f, "incoming"), 1);
    assert_int_equal(qm_blob_keep(writer), QM_STORED);
    check_blob(f, hash, "on its way");
}

static void write_and_die(const char *folder)
{
    fixture f = {.folder = (char *)folder};
    char hash[QM_HASH_SIZE], message[QM_MESSAGE_SIZE];
    qm_blob_writer *writer;
    if (qm_store_open(folder, QM_STORE_SERVE, &f.store, message) != QM_OK) _exit(1);
    keep_blob(&f, "kept", hash);
    put_mesh(&f, "m_1", hash, "");
    submit(&f, "j_1", "key", NULL);
    if (qm_blob_begin(f.store, 0, &writer) != QM_OK || qm_blob_write(writer, "half", 4) != QM_OK) _exit(2);
    raise(SIGKILL);
}

static void test_what_was_stored_survives_a_kill(void **state)
{
    size_t listed;
    fixture *f = *state;
    qm_store_close(f->store);
    f->store = NULL;
    int end = run_child(write_and_die, f->folder);
    assert_true(WIFSIGNALED(end));
    assert_int_equal(WTERMSIG(end), SIGKILL);
    open_store(f);
    qm_store_mesh mesh;
    assert_int_equal(QM_STORED, qm_store_find_mesh(f->store, "m_1", &mesh));
    check_blob(f, mesh.hash, "kept");
    qm_store_mesh_reset(&mesh);
    qm_store_job job;
    assert_int_equal(QM_STORED, list_jobs(f, 0, 1, &unfinished, &job, &listed));
    assert_int_equal(listed, 1);
    assert_string_equal(job.id, "j_1");
    qm_store_job_reset(&job);
    assert_int_equal(count_files(f, "incoming"), 0);
}

static void test_a_broken_database_is_refused(void **state)
{
    fixture *f = *state;
    char path[256], message[QM_MESSAGE_SIZE] = "";
    qm_store_close(f->store);
    f->store = NULL;
    snprintf(path, sizeof path, "%s/quadmeshd.sqlite", f->folder);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    for (int i = 0; i < 1000; i++)
        fputs("not a database ", file);
    fclose(file);
    assert_int_not_equal(qm_store_open(f->folder, QM_STORE_SERVE, &f->store, message), QM_OK);
    QM_CHECK(strstr(message, "database: a page is not as it was written"), "%s", message);
}

static void test_a_database_of_another_version_is_refused(void **state)
{
    fixture *f = *state;
    char path[256], message[QM_MESSAGE_SIZE] = "";
    qm_store_close(f->store);
    f->store = NULL;
    snprintf(path, sizeof path, "%s/quadmeshd.sqlite", f->folder);
    FILE *file = fopen(path, "r+b");
    uint8_t page[4096];
    assert_non_null(file);
    assert_int_equal(fread(page, 1, sizeof page, file), sizeof page);
    assert_int_equal(page[16] << 8 | page[17], sizeof page);
    /* The user version of an SQLite file, big-endian (sqlite.org/fileformat2.html, 1.3), and the sum of the page. */
    memcpy(page + 60, "\0\0\3\xe7", 4);
    uint64_t sum = qm_checksum(page, sizeof page - sizeof sum, 0);
    memcpy(page + sizeof page - sizeof sum, &sum, sizeof sum);
    rewind(file);
    assert_int_equal(fwrite(page, 1, sizeof page, file), sizeof page);
    fclose(file);
    assert_int_equal(qm_store_open(f->folder, QM_STORE_SERVE, &f->store, message), QM_E_UNSUPPORTED);
    assert_non_null(strstr(message, "another version"));
}

static void check_refused(const char *folder, const char *words)
{
    qm_store *store;
    char message[QM_MESSAGE_SIZE] = "";
    assert_int_not_equal(qm_store_open(folder, QM_STORE_SERVE, &store, message), QM_OK);
    assert_null(store);
    QM_CHECK(strstr(message, words), "%s", message);
}

static void test_a_folder_that_cannot_be_made(void **state)
{
    (void)state;
    check_refused("/proc/nowhere/data", "cannot make");
}

static void test_a_file_is_no_folder(void **state)
{
    fixture *f = *state;
    char path[256];
    snprintf(path, sizeof path, "%s/lock", f->folder);
    check_refused(path, "cannot make");
}

/** A path so long that no name fits behind it, for a folder that is there. */
static void test_a_name_that_is_too_long(void **state)
{
    fixture *f = *state;
    char name[4095], hash[QM_HASH_SIZE];
    keep_blob(f, "still here", hash);
    size_t length = (size_t)snprintf(name, sizeof name, "%s", f->folder);
    while (length + 2 < sizeof name)
        length += (size_t)snprintf(name + length, sizeof name - length, "/.");
    check_refused(name, "too long");
    check_blob(f, hash, "still here");
}

/** Also when the name of the folder ends in slashes. */
static void test_folders_are_made(void **state)
{
    fixture *f = *state;
    fixture inner;
    char path[256];
    snprintf(path, sizeof path, "%s/inner//", f->folder);
    inner.folder = path;
    open_store(&inner);
    reopen(&inner);
    assert_int_equal(count_files(f, "inner/incoming"), 0);
    qm_store_close(inner.store);
}

/** Schema 13 had searches in parts in another form. A job that was in such a search is there, and its search begins anew. */
static void test_searches_of_schema_13_begin_anew(void **state)
{
    static const char schema_13[] =
        "DROP TABLE job_parts; DROP TABLE job_bounds; ALTER TABLE jobs DROP COLUMN cancel;"
        "CREATE TABLE job_bounds (job INTEGER PRIMARY KEY REFERENCES jobs (sequence) ON DELETE CASCADE,"
        "  engine TEXT NOT NULL, lower REAL NOT NULL, witness TEXT NOT NULL, settled REAL NOT NULL,"
        "  iterations INTEGER NOT NULL, projections INTEGER NOT NULL);"
        "CREATE TABLE job_parts (part INTEGER PRIMARY KEY AUTOINCREMENT,"
        "  job INTEGER NOT NULL REFERENCES job_bounds (job) ON DELETE CASCADE, upper REAL NOT NULL,"
        "  entries BLOB NOT NULL, tries INTEGER NOT NULL, epoch INTEGER NOT NULL DEFAULT 0);"
        "CREATE INDEX job_parts_by_upper ON job_parts (job, upper DESC);"
        "INSERT INTO job_bounds SELECT sequence, 'e', 1, '', 0, 0, 0 FROM jobs;"
        "INSERT INTO job_parts (job, upper, entries, tries) SELECT sequence, 2, x'00', 0 FROM jobs;"
        "ALTER TABLE meshes DROP COLUMN unit; ALTER TABLE meshes DROP COLUMN uncertainty;"
        "ALTER TABLE meshes DROP COLUMN labels; ALTER TABLE jobs DROP COLUMN labels;"
        "PRAGMA user_version = 13";
    fixture *f = *state;
    const qm_store_job job = {.id = "j_1", .key = "k", .body = "{}", .created = "c", .state = QM_JOB_QUEUED};
    qm_store_bounds bounds;
    qm_store_part part = {.upper = 2.0, .entries = "part", .size = 4};
    size_t count;
    assert_int_equal(qm_store_submit_job(f->store, &(qm_store_submission){.job = &job}), QM_STORED);
    assert_int_equal(sqlite3_exec(f->store->sqlite->database, schema_13, NULL, NULL, NULL), SQLITE_OK);
    reopen(f);
    assert_int_equal(qm_store_read_bounds(f->store, "j_1", NULL, 0, &bounds), QM_STORED_NONE);
    bounds = (qm_store_bounds){.lower = 1.0, .discarded = 0.5};
    assert_int_equal(qm_store_open_parts(f->store, "j_1", 0, &bounds, &part, 1), QM_STORED);
    assert_int_equal(qm_store_claim_parts(f->store, "j_1", 4, &part, &count), QM_STORED);
    assert_int_equal(count, 1);
    qm_store_parts_reset(&part, count);
    assert_int_equal(qm_store_note_cancel(f->store, "j_1"), QM_STORED);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_hashes),
        TEST(test_a_damaged_blob_is_never_mapped),
        TEST(test_kept_blobs_survive),
        TEST(test_old_files_without_a_row_are_swept),
        TEST(test_files_without_a_database_are_left_alone),
        TEST(test_dropped_blobs_leave_nothing),
        TEST(test_bytes_are_read_back_while_they_come),
        TEST(test_hashes_of_all_sizes),
        TEST(test_unsealed_blobs_leave_nothing),
        TEST(test_a_blob_that_cannot_be_named),
        TEST(test_half_written_files_are_swept),
        TEST(test_meshes_survive),
        TEST(test_a_revision_takes_the_place_of_the_one_before),
        TEST(test_meshes_expire_in_order),
        TEST(test_bytes_are_counted),
        TEST(test_pages_of_meshes),
        TEST(test_a_blob_goes_with_its_last_mesh),
        TEST(test_jobs_survive),
        TEST(test_unfinished_jobs),
        TEST(test_events_are_appended),
        TEST(test_old_jobs_are_dropped),
        TEST(test_jobs_are_listed_by_filters),
        cmocka_unit_test(test_checksums_tell_bits_apart),
        TEST(test_a_damaged_array_is_never_read),
        TEST(test_a_forgotten_answer_is_not_found_by_its_key),
        TEST(test_an_idempotency_key_names_one_job),
        TEST(test_a_job_ends_with_its_effect_or_not_at_all),
        TEST(test_a_folder_has_one_owner),
        TEST(test_a_refused_process_leaves_uploads_alone),
        TEST(test_what_was_stored_survives_a_kill),
        TEST(test_a_broken_database_is_refused),
        TEST(test_a_database_of_another_version_is_refused),
        TEST(test_searches_of_schema_13_begin_anew),
        cmocka_unit_test(test_a_folder_that_cannot_be_made),
        TEST(test_a_file_is_no_folder),
        TEST(test_a_name_that_is_too_long),
        TEST(test_folders_are_made),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
