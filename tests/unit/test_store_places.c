/*
 * Blobs of a shared store in each of its places that need no other server: the database and a folder. Needs a server:
 * QM_TEST_POSTGRES, tests/support/database.h. A bucket is tested by tests/cluster/test_places.py.
 */
#include <dirent.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/id.h"
#include "check.h"
#include "database.h"
#include "folder.h"
#include "store/place.h"
#include "store/store.h"
#include "store/store_driver.h"

#define NODES 4

typedef struct fixture {
    char *database;
    char *place; /* the folder; NULL: the database */
    char *folders[NODES];
    qm_store *stores[NODES]; /* those that a test has opened */
} fixture;

static qm_stored try_node(fixture *f, int i, const char *blobs, char message[QM_MESSAGE_SIZE])
{
    qm_store_node self = {
        .version = "test", .workers = 2, .memory = 1 << 30, .blobs = blobs, .blobs_keys = ""};
    snprintf(self.name, sizeof self.name, "n%d", i);
    if (!f->folders[i]) f->folders[i] = qm_folder_make();
    return qm_store_open_shared(f->database, f->folders[i], &self, false, &f->stores[i], message);
}

static qm_store *open_node(fixture *f, int i)
{
    char message[QM_MESSAGE_SIZE] = "";
    qm_stored stored = try_node(f, i, f->place, message);
    QM_CHECK(stored == QM_STORED, "%s", message);
    return f->stores[i];
}

static int set_up_database(void **state)
{
    fixture *f = calloc(1, sizeof *f);
    if (!f) return -1;
    f->database = qm_database_make();
    *state = f;
    return 0;
}

static int set_up_folder(void **state)
{
    set_up_database(state);
    ((fixture *)*state)->place = qm_folder_make();
    return 0;
}

static int tear_down(void **state)
{
    fixture *f = *state;
    for (int i = 0; i < NODES; i++) {
        qm_store_close(f->stores[i]);
        if (f->folders[i]) qm_folder_remove(f->folders[i]);
    }
    if (f->place) qm_folder_remove(f->place);
    qm_database_drop(f->database);
    free(f);
    return 0;
}

static int64_t count_rows(const fixture *f, const char *table)
{
    return qm_database_ask(f->database, "SELECT count(*) FROM quadmeshd.%s", table);
}

static int count_files(const char *path)
{
    int count = 0;
    DIR *files = opendir(path);
    assert_non_null(files);
    for (struct dirent *entry; (entry = readdir(files));)
        count += entry->d_name[0] != '.' && strcmp(entry->d_name, QM_PLACE_ID) != 0;
    closedir(files);
    return count;
}

/** Objects in the place, by looking at it. */
static int64_t count_objects(const fixture *f)
{
    if (f->place) return count_files(f->place);
    return qm_database_ask(f->database, "SELECT count(DISTINCT generation) FROM quadmeshd.blob_chunks");
}

/** A file of pseudo-random bytes and its hash. */
static int make_file(const fixture *f, const char *name, size_t size, char hash[QM_HASH_SIZE])
{
    char path[256];
    snprintf(path, sizeof path, "%s/%s", f->folders[0], name);
    char *bytes = malloc(size + 1);
    assert_non_null(bytes);
    uint32_t random = (uint32_t)size + 1;
    for (size_t i = 0; i < size; i++)
        bytes[i] = (char)((random = random * 1664525u + 1013904223u) >> 24);
    qm_id_hash_text(bytes, size, hash);
    int file = open(path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    assert_int_equal(write(file, bytes, size), size);
    free(bytes);
    return file;
}

static qm_stored put(qm_store *store, const char *hash, int file)
{
    return store->driver->put_blob(store, hash, file, false);
}

static qm_stored get(const fixture *f, qm_store *store, const char *hash, size_t size)
{
    char path[256], found[QM_HASH_SIZE];
    snprintf(path, sizeof path, "%s/copy", f->folders[0]);
    int file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600); /* has the bytes of the call before */
    qm_stored stored = store->driver->get_blob(store, hash, file);
    if (stored == QM_STORED) {
        char *bytes = malloc(size + 1);
        assert_non_null(bytes);
        assert_int_equal(pread(file, bytes, size + 1, 0), size);
        qm_id_hash_text(bytes, size, found);
        free(bytes);
        assert_string_equal(found, hash);
    }
    close(file);
    return stored;
}

static void test_blobs(void **state)
{
    static const size_t sizes[] = {0, 1, 1048575, 1048576, 1048577, 3000000};
    fixture *f = *state;
    open_node(f, 0);
    open_node(f, 1);
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        char hash[QM_HASH_SIZE];
        int file = make_file(f, "blob", sizes[i], hash);
        assert_int_equal(get(f, f->stores[1], hash, sizes[i]), QM_STORED_NONE);
        assert_int_equal(put(f->stores[0], hash, file), QM_STORED);
        assert_int_equal(put(f->stores[1], hash, file), QM_STORED);
        assert_int_equal(get(f, f->stores[1], hash, sizes[i]), QM_STORED);
        close(file);
    }
    if (f->place)
        assert_int_equal(count_rows(f, "blob_chunks"), 0);
    else
        assert_int_equal(count_rows(f, "blob_chunks"), 8);
    assert_int_equal(count_rows(f, "blob_objects"), 0);
}

typedef struct uploader {
    qm_store *store;
    const char *hash;
    int file;
    bool is_repair;
    qm_stored stored;
} uploader;

static void *upload(void *user)
{
    uploader *u = user;
    u->stored = u->store->driver->put_blob(u->store, u->hash, u->file, u->is_repair);
    return NULL;
}

/** All nodes put the same bytes at once. */
static void put_at_nodes(const fixture *f, const char *hash, int file, bool is_repair)
{
    uploader uploaders[NODES];
    pthread_t threads[NODES];
    for (int i = 0; i < NODES; i++) {
        uploaders[i] = (uploader){f->stores[i], hash, file, is_repair, QM_STORED_FAULT};
        pthread_create(&threads[i], NULL, upload, &uploaders[i]);
    }
    for (int i = 0; i < NODES; i++) {
        pthread_join(threads[i], NULL);
        assert_int_equal(uploaders[i].stored, QM_STORED);
    }
    assert_int_equal(count_objects(f), 1);
    assert_int_equal(count_rows(f, "blob_objects"), 0);
    assert_int_equal(get(f, f->stores[0], hash, 3000000), QM_STORED);
}

static void test_one_copy_of_a_blob(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    for (int i = 0; i < NODES; i++)
        open_node(f, i);
    int file = make_file(f, "blob", 3000000, hash);
    put_at_nodes(f, hash, file, false);
    put_at_nodes(f, hash, file, true);
    close(file);
}

static void clean(qm_store *store, double delay_s, int times)
{
    for (int i = 0; i < times; i++)
        assert_int_equal(qm_store_clean_blobs(store, delay_s), QM_STORED);
}

static void test_blobs_that_no_row_names_go(void **state)
{
    fixture *f = *state;
    char unused[QM_HASH_SIZE];
    qm_store *store = open_node(f, 0);
    qm_store_mesh mesh = {.id = "m_a", .options = "", .name = "", .document = "{}", .created = "now"}, next;
    int file = make_file(f, "mesh", 2000000, mesh.hash), other = make_file(f, "other", 1000, unused);
    assert_int_equal(put(store, mesh.hash, file), QM_STORED);
    assert_int_equal(put(store, unused, other), QM_STORED);
    clean(store, 1000.0, 3); /* marks both */
    assert_int_equal(count_rows(f, "blobs"), 2);
    assert_int_equal(qm_store_put_mesh(store, &mesh), QM_STORED); /* takes one mark away */
    clean(store, 0.0, 1);
    assert_int_equal(count_rows(f, "blobs"), 1);
    assert_int_equal(count_objects(f), 1);
    assert_int_equal(get(f, store, mesh.hash, 2000000), QM_STORED);
    /* A mesh whose blob has gone is not stored. */
    qm_store_mesh late = mesh;
    snprintf(late.id, sizeof late.id, "m_b");
    snprintf(late.hash, sizeof late.hash, "%s", unused);
    assert_int_equal(qm_store_put_mesh(store, &late), QM_STORED_LATE);
    /* Positions of an earlier revision stay for the delay. */
    next = mesh, next.revision = 1;
    assert_int_equal(put(store, unused, other), QM_STORED);
    snprintf(next.positions, sizeof next.positions, "%s", unused);
    assert_int_equal(qm_store_revise_mesh(store, &next), QM_STORED);
    clean(store, 0.0, 3);
    assert_int_equal(count_rows(f, "blobs"), 2);
    next.revision = 2, next.positions[0] = '\0';
    assert_int_equal(qm_store_revise_mesh(store, &next), QM_STORED);
    clean(store, 1000.0, 3);
    assert_int_equal(count_rows(f, "blobs"), 2);
    clean(store, 0.0, 1);
    assert_int_equal(count_rows(f, "blobs"), 1);
    assert_int_equal(qm_store_delete_mesh(store, "m_a"), QM_STORED);
    clean(store, 0.0, 2);
    assert_int_equal(count_rows(f, "blobs") + count_rows(f, "blob_objects") + count_objects(f), 0);
    close(file);
    close(other);
}

/** Cuts the object of the only blob in the place, or removes it. */
static void damage(const fixture *f, bool removes)
{
    char path[512] = "";
    if (!f->place) {
        qm_database_ask(f->database, removes
                                         ? "DELETE FROM quadmeshd.blob_chunks WHERE n = 0"
                                         : "UPDATE quadmeshd.blob_chunks SET bytes = '\\x00' WHERE n = 1");
        return;
    }
    DIR *files = opendir(f->place);
    for (struct dirent *entry; (entry = readdir(files));)
        if (entry->d_name[0] != '.' && strcmp(entry->d_name, QM_PLACE_ID) != 0)
            snprintf(path, sizeof path, "%s/%s", f->place, entry->d_name);
    closedir(files);
    assert_int_equal(removes ? unlink(path) : truncate(path, 1000), 0);
}

/** An upload of the same bytes puts a blob right that has lost some, without being told; told so, also one whose bytes
 * are others. */
static void test_uploads_repair(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE];
    qm_store *store = open_node(f, 0);
    int file = make_file(f, "blob", 3000000, hash);
    assert_int_equal(put(store, hash, file), QM_STORED);
    damage(f, true);
    assert_int_equal(get(f, store, hash, 3000000), QM_STORED_DAMAGED);
    assert_int_equal(put(store, hash, file), QM_STORED);
    assert_int_equal(get(f, store, hash, 3000000), QM_STORED);
    damage(f, false);
    assert_int_equal(put(store, hash, file), QM_STORED);
    assert_int_equal(get(f, store, hash, 3000000), QM_STORED);
    assert_int_equal(store->driver->put_blob(store, hash, file, true), QM_STORED);
    assert_int_equal(get(f, store, hash, 3000000), QM_STORED);
    assert_int_equal(count_rows(f, "blobs"), 1);
    assert_int_equal(count_objects(f), 1);
    assert_int_equal(count_rows(f, "blob_objects"), 0);
    close(file);
}

/* ---- which place ---- */

static void test_another_place_is_refused(void **state)
{
    fixture *f = *state;
    char message[QM_MESSAGE_SIZE] = "", *other = qm_folder_make();
    const char *wrong = f->place ? "database" : other;
    open_node(f, 0);
    assert_int_equal(try_node(f, 1, wrong, message), QM_STORED_FAULT);
    assert_non_null(strstr(message, "are of the kind"));
    if (f->place) {
        assert_int_equal(try_node(f, 1, other, message), QM_STORED_FAULT);
        assert_non_null(strstr(message, "has no quadmeshd-place"));
        assert_int_equal(try_node(f, 1, "/missing folder", message), QM_STORED_AWAY);
        assert_non_null(strstr(message, "No such file"));
    }
    assert_int_equal(try_node(f, 1, "ftp://somewhere", message), QM_STORED_FAULT);
    assert_int_equal(count_files(other), 0);
    open_node(f, 1);
    qm_folder_remove(other);
}

/** Tables of a version that knew no other place, with blobs. */
static void test_a_store_without_a_place(void **state)
{
    fixture *f = *state;
    char message[QM_MESSAGE_SIZE] = "", hash[QM_HASH_SIZE];
    open_node(f, 0);
    int file = make_file(f, "blob", 1000, hash);
    assert_int_equal(put(f->stores[0], hash, file), QM_STORED);
    close(file);
    qm_store_close(f->stores[0]);
    qm_database_ask(f->database, "UPDATE quadmeshd.nodes SET state = 2");
    qm_database_age(f->database);
    assert_int_equal(try_node(f, 0, "/tmp", message), QM_STORED_FAULT);
    assert_int_equal(get(f, open_node(f, 0), hash, 1000), QM_STORED);
}

/** The empty folder beneath a file system that has gone gets no files, and the objects that are to go wait. */
static void test_a_folder_that_goes_away(void **state)
{
    fixture *f = *state;
    char hash[QM_HASH_SIZE], later[QM_HASH_SIZE], away[256];
    qm_store *store = open_node(f, 0);
    int file = make_file(f, "blob", 1000, hash), second = make_file(f, "later", 2000, later);
    assert_int_equal(put(store, hash, file), QM_STORED);
    clean(store, 0.0, 1);
    snprintf(away, sizeof away, "%s.away", f->place);
    assert_int_equal(rename(f->place, away), 0);
    assert_int_equal(mkdir(f->place, 0700), 0);
    assert_int_equal(put(store, later, second), QM_STORED_AWAY);
    assert_int_equal(get(f, store, hash, 1000), QM_STORED_AWAY);
    assert_int_equal(qm_store_clean_blobs(store, 0.0), QM_STORED_AWAY);
    assert_int_equal(count_rows(f, "blobs"), 0);
    assert_int_equal(count_rows(f, "blob_objects"), 2); /* one to remove, and one that may have been put */
    assert_int_equal(count_files(f->place), 0);
    assert_int_equal(rmdir(f->place), 0);
    assert_int_equal(rename(away, f->place), 0);
    clean(store, 0.0, 1);
    assert_int_equal(count_rows(f, "blob_objects") + count_objects(f), 0);
    assert_int_equal(put(store, later, second), QM_STORED);
    close(file);
    close(second);
}

/** What a node has put that died before the row is removed after the delay. */
static void test_objects_of_a_node_that_died(void **state)
{
    fixture *f = *state;
    char path[512];
    qm_store *store = open_node(f, 0);
    qm_database_ask(f->database,
                    "INSERT INTO quadmeshd.blob_objects (generation) VALUES ('b_whole'), ('b_half')");
    static const char *const names[] = {"b_whole", "b_half.part"};
    for (size_t i = 0; i < 2; i++) {
        snprintf(path, sizeof path, "%s/%s", f->place, names[i]);
        close(open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
    }
    clean(store, 1000.0, 2);
    assert_int_equal(count_objects(f), 2);
    clean(store, 0.0, 1);
    assert_int_equal(count_objects(f) + count_rows(f, "blob_objects"), 0);
}

#define TEST(test, set_up) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_blobs, set_up_database),
        TEST(test_blobs, set_up_folder),
        TEST(test_one_copy_of_a_blob, set_up_database),
        TEST(test_one_copy_of_a_blob, set_up_folder),
        TEST(test_blobs_that_no_row_names_go, set_up_database),
        TEST(test_blobs_that_no_row_names_go, set_up_folder),
        TEST(test_uploads_repair, set_up_database),
        TEST(test_uploads_repair, set_up_folder),
        TEST(test_another_place_is_refused, set_up_database),
        TEST(test_another_place_is_refused, set_up_folder),
        TEST(test_a_store_without_a_place, set_up_database),
        TEST(test_a_folder_that_goes_away, set_up_folder),
        TEST(test_objects_of_a_node_that_died, set_up_folder),
    };
    if (qm_database_server()) return cmocka_run_group_tests(tests, NULL, NULL);
    printf("NOT RUN %zu: QM_TEST_POSTGRES names no server\n", sizeof tests / sizeof tests[0]);
    return 0;
}
