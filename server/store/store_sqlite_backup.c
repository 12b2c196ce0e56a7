/**
 * store_sqlite_backup.c: one file that holds all of a data folder, made while the daemon writes to it, and the folder that
 * is made of such a file.
 *
 * The file is a database of the store with one more table, of the parts of blobs and arrays, so that its pages have
 * checksums and SQLite's own shell can look at it. It begins as a snapshot of the folder's database. A blob that
 * the daemon has removed since then belongs to a mesh that was deleted or moved on: its row in the copy follows.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/text.h"
#include "result_file.h"
#include "store_sqlite.h"

#define PART_SIZE (1u << 20) /* bytes of a blob in a row */
#define TRIES 100            /* how often the row of a mesh may move on while its blob is looked for */
#define SCALAR_SIZE 256

static const char parts_table[] =
    "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; PRAGMA foreign_keys = ON;"
    "CREATE TABLE backup_parts ("
    "  file TEXT NOT NULL, part INTEGER NOT NULL, bytes BLOB NOT NULL, PRIMARY KEY (file, part));";

typedef struct backup {
    qm_store *store;
    sqlite3 *copy;
    FILE *out;
    qm_store_findings found;
} backup;

/* ---- statements of a copy ---- */

/** A statement with up to two strings; finalised by the caller. */
static sqlite3_stmt *prepare(sqlite3 *database, const char *sql, const char *first, const char *second)
{
    sqlite3_stmt *statement = NULL;
    if (sqlite3_prepare_v2(database, sql, -1, &statement, NULL) != SQLITE_OK) return NULL;
    if (first) qm_sqlite_bind_text(statement, 1, first);
    if (second) qm_sqlite_bind_text(statement, 2, second);
    return statement;
}

static bool execute(sqlite3_stmt *statement)
{
    bool done = statement && sqlite3_step(statement) == SQLITE_DONE;
    sqlite3_finalize(statement);
    return done;
}

static bool run_text(sqlite3 *database, const char *sql, const char *text)
{
    return execute(prepare(database, sql, text, NULL));
}

/** Writes the columns of the first row of a query; false when there is none. Each has SCALAR_SIZE bytes. */
static bool find(sqlite3 *database, const char *sql, const char *text, int columns, char (*out)[SCALAR_SIZE])
{
    sqlite3_stmt *statement = prepare(database, sql, text, NULL);
    bool found = statement && sqlite3_step(statement) == SQLITE_ROW;
    for (int i = 0; found && i < columns; i++) {
        const char *value = (const char *)sqlite3_column_text(statement, i);
        snprintf(out[i], SCALAR_SIZE, "%s", value ? value : "");
    }
    sqlite3_finalize(statement);
    return found;
}

/* ---- a backup ---- */

static bool put_part(backup *work, const char *file, size_t part, const void *bytes, size_t size)
{
    sqlite3_stmt *statement =
        prepare(work->copy, "INSERT INTO backup_parts (file, part, bytes) VALUES (?1, ?3, ?2)", file, NULL);
    if (!statement) return false;
    sqlite3_bind_int64(statement, 3, (sqlite3_int64)part);
    sqlite3_bind_blob64(statement, 2, size > 0 ? bytes : "", size, SQLITE_STATIC);
    return execute(statement);
}

static void tell(backup *work, const char *what, const char *id, const char *file, const char *fault)
{
    fprintf(work->out, "%s %s: file %s is %s\n", what, id, file, fault);
    work->found.faults++;
}

/** Copies a blob, whose bytes are compared with their hash. As qm_blob_map; QM_E_ARGUMENT also for a file that
 * cannot be written. */
static qm_status copy_blob(backup *work, const char *hash)
{
    char known[1][SCALAR_SIZE];
    if (!hash[0] || find(work->copy, "SELECT 1 FROM backup_parts WHERE file = ? LIMIT 1", hash, 1, known))
        return QM_OK;
    const uint8_t *bytes;
    size_t size;
    qm_status status = qm_blob_map(work->store, hash, &bytes, &size);
    if (status != QM_OK) return status;
    size_t part = 0, done = 0;
    do {
        size_t rest = size - done, here = rest < PART_SIZE ? rest : PART_SIZE;
        if (!put_part(work, hash, part++, bytes + done, here)) status = QM_E_ARGUMENT;
        done += here;
    } while (status == QM_OK && done < size);
    qm_blob_unmap(bytes, size);
    work->found.files += status == QM_OK;
    return status;
}

/** Brings the row of a mesh in the copy up to date; false when it is so already. */
static bool follow_mesh(backup *work, const char *id, const char *hash, const char *positions)
{
    qm_store_mesh row;
    qm_stored stored = qm_store_find_mesh(work->store, id, &row);
    if (stored == QM_STORED_NONE) return run_text(work->copy, "DELETE FROM meshes WHERE id = ?", id);
    if (stored != QM_STORED) return false;
    bool has_moved = strcmp(row.hash, hash) != 0 || strcmp(row.positions, positions) != 0;
    sqlite3_stmt *statement =
        has_moved ? prepare(work->copy,
                            "UPDATE meshes SET hash = ?1, positions = ?2, options = ?3, document = ?4,"
                            " revision = ?5 WHERE id = ?6",
                            row.hash, row.positions)
                  : NULL;
    if (statement) {
        qm_sqlite_bind_text(statement, 3, row.options);
        qm_sqlite_bind_text(statement, 4, row.document);
        sqlite3_bind_int64(statement, 5, (sqlite3_int64)row.revision);
        qm_sqlite_bind_text(statement, 6, id);
        has_moved = execute(statement);
    }
    qm_store_mesh_reset(&row);
    return has_moved;
}

/** Copies the blobs of a mesh. False when the backup cannot go on. */
static bool copy_mesh(backup *work, const char *id)
{
    char row[2][SCALAR_SIZE];
    const char *sql = "SELECT hash, positions FROM meshes WHERE id = ?";
    for (int i = 0; i < TRIES && find(work->copy, sql, id, 2, row); i++) {
        qm_status status[2] = {copy_blob(work, row[0]), copy_blob(work, row[1])};
        if (status[0] == QM_OK && status[1] == QM_OK) return true;
        for (int k = 0; k < 2; k++)
            if (status[k] == QM_E_ARGUMENT || status[k] == QM_E_NO_MEMORY) return false;
        bool is_missing = status[0] == QM_E_EMPTY || status[1] == QM_E_EMPTY;
        if (is_missing && follow_mesh(work, id, row[0], row[1])) continue;
        for (int k = 0; k < 2; k++)
            if (status[k] != QM_OK)
                tell(work, "mesh", id, row[k], status[k] == QM_E_EMPTY ? "missing" : "damaged");
        return true;
    }
    return true; /* it was deleted */
}

/** Copies the array of a job, whose blocks are compared with their checksums. False when the backup cannot go on. */
static bool copy_array(backup *work, const char *job)
{
    char name[QM_ID_SIZE + sizeof QM_RESULT_ENDING];
    double block[QM_RESULT_BLOCK];
    qm_result_file *file;
    snprintf(name, sizeof name, "%s" QM_RESULT_ENDING, job);
    qm_status status = qm_result_file_open(work->store, job, &file);
    uint64_t count = status == QM_OK ? qm_result_file_count(file) : 0;
    bool written = true;
    for (uint64_t done = 0; status == QM_OK && written && done < count; done += QM_RESULT_BLOCK) {
        uint64_t rest = count - done;
        size_t here = rest < QM_RESULT_BLOCK ? (size_t)rest : QM_RESULT_BLOCK;
        status = qm_result_file_read(file, done, block, here);
        qm_text_swap_bytes(block, here); /* as they are in the file */
        written =
            status != QM_OK || put_part(work, name, done / QM_RESULT_BLOCK, block, here * sizeof *block);
    }
    qm_result_file_close(file);
    if (status == QM_OK || status == QM_E_FORMAT || status == QM_E_EMPTY) {
        work->found.files += status == QM_OK;
        if (status != QM_OK && !qm_sqlite_has_job(work->store, job))
            return run_text(work->copy, "DELETE FROM jobs WHERE id = ?", job);
        if (status != QM_OK) tell(work, "job", job, name, "damaged");
        return written;
    }
    return false;
}

/** Calls a function for each id of a query with one number, in order: the ids after that row. */
static bool for_each(backup *work, const char *sql, bool (*copy)(backup *, const char *id), size_t *count)
{
    int64_t after = 0;
    for (bool good = true; good;) {
        char id[QM_ID_SIZE];
        sqlite3_stmt *statement = prepare(work->copy, sql, NULL, NULL);
        if (!statement) return false;
        sqlite3_bind_int64(statement, 1, after);
        int result = sqlite3_step(statement);
        if (result == SQLITE_ROW) {
            good = qm_sqlite_read_text(statement, 0, id, sizeof id);
            after = sqlite3_column_int64(statement, 1);
        }
        sqlite3_finalize(statement);
        if (result != SQLITE_ROW) return result == SQLITE_DONE;
        good = good && copy(work, id);
        ++*count;
        if (!good) return false;
    }
    return true;
}

static bool copy_files(backup *work)
{
    return for_each(work, "SELECT id, sequence FROM meshes WHERE sequence > ? ORDER BY sequence LIMIT 1",
                    copy_mesh, &work->found.meshes) &&
           for_each(work,
                    "SELECT id, sequence FROM jobs WHERE sequence > ? AND sequence IN"
                    " (SELECT job FROM job_arrays) ORDER BY sequence LIMIT 1",
                    copy_array, &work->found.jobs);
}

static bool write_backup(backup *work, const char *path, char message[QM_MESSAGE_SIZE])
{
    bool good = run_text(work->store->sqlite->database, "VACUUM INTO ?", path);
    if (!good)
        snprintf(message, QM_MESSAGE_SIZE, "database: %s", sqlite3_errmsg(work->store->sqlite->database));
    if (!good) return false;
    good = sqlite3_open_v2(path, &work->copy, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, QM_STORE_SUMS) ==
               SQLITE_OK &&
           sqlite3_exec(work->copy, parts_table, NULL, NULL, NULL) == SQLITE_OK && copy_files(work);
    if (!good) snprintf(message, QM_MESSAGE_SIZE, "backup: %s", sqlite3_errmsg(work->copy));
    return sqlite3_close(work->copy) == SQLITE_OK && good;
}

qm_status qm_store_backup(const char *folder, const char *file, FILE *out, qm_store_findings *found,
                          char message[QM_MESSAGE_SIZE])
{
    char path[QM_STORE_PATH_SIZE];
    backup work = {.out = out};
    *found = work.found;
    if (snprintf(path, sizeof path, "%s.partial", file) >= (int)sizeof path || access(file, F_OK) == 0) {
        snprintf(message, QM_MESSAGE_SIZE, "%.200s: %s", file, strerror(EEXIST));
        return QM_E_ARGUMENT;
    }
    unlink(path);
    work.store = qm_store_create(folder, message);
    if (!work.store) return QM_E_NO_MEMORY;
    qm_status status = qm_sqlite_open_database(work.store, QM_STORE_CHECK, message);
    if (status == QM_OK && !write_backup(&work, path, message)) status = QM_E_ARGUMENT;
    if (status == QM_OK && !qm_store_put_in_place(path, file)) {
        snprintf(message, QM_MESSAGE_SIZE, "cannot write %.200s: %s", file, strerror(errno));
        status = QM_E_ARGUMENT;
    }
    if (status != QM_OK) unlink(path);
    qm_store_close(work.store);
    *found = work.found;
    return status;
}

/* ---- a restoration ---- */

/** Makes the tables, or the indices, of the backup in the new database, and copies the rows of tables. Only what
 * begins like a statement of the schema is run, and nothing after it. */
static bool make_all(sqlite3 *database, const char *kind, const char *beginning)
{
    sqlite3_stmt *each = prepare(database,
                                 "SELECT name, sql FROM old.sqlite_master WHERE type = ? AND sql IS NOT NULL"
                                 " AND name NOT LIKE 'sqlite\\_%' ESCAPE '\\' AND tbl_name != 'backup_parts'",
                                 kind, NULL);
    bool good = each;
    int result = SQLITE_DONE;
    while (good && (result = sqlite3_step(each)) == SQLITE_ROW) {
        const char *name = (const char *)sqlite3_column_text(each, 0),
                   *sql = (const char *)sqlite3_column_text(each, 1);
        good = name && sql && strncmp(sql, beginning, strlen(beginning)) == 0 &&
               execute(prepare(database, sql, NULL, NULL));
        if (!good || strcmp(kind, "table") != 0) continue;
        char *copy = sqlite3_mprintf("INSERT INTO main.\"%w\" SELECT * FROM old.\"%w\"", name, name);
        good = copy && execute(prepare(database, copy, NULL, NULL));
        sqlite3_free(copy);
    }
    sqlite3_finalize(each);
    return good && result == SQLITE_DONE;
}

/** Makes the database of the folder of the rows of the backup. */
static bool make_database(const char *path, const char *file, char message[QM_MESSAGE_SIZE])
{
    sqlite3 *database = NULL;
    char version[1][SCALAR_SIZE], sql[64];
    bool good = qm_sqlite_make_file(path, &database) && run_text(database, "ATTACH ? AS old", file) &&
                find(database, "PRAGMA old.user_version", NULL, 1, version) &&
                sqlite3_exec(database, "BEGIN", NULL, NULL, NULL) == SQLITE_OK &&
                make_all(database, "table", "CREATE TABLE ") &&
                make_all(database, "index", "CREATE INDEX ") &&
                sqlite3_exec(database,
                             "DELETE FROM main.sqlite_sequence;"
                             "INSERT INTO main.sqlite_sequence SELECT * FROM old.sqlite_sequence;"
                             "COMMIT",
                             NULL, NULL, NULL) == SQLITE_OK;
    if (good) {
        snprintf(sql, sizeof sql, "PRAGMA main.user_version = %d", atoi(version[0]));
        good = sqlite3_exec(database, sql, NULL, NULL, NULL) == SQLITE_OK;
    }
    if (!good) snprintf(message, QM_MESSAGE_SIZE, "database: %s", sqlite3_errmsg(database));
    return sqlite3_close(database) == SQLITE_OK && good;
}

/** A file that is being restored: a blob, or the array of a job. */
typedef struct restored_file {
    char name[SCALAR_SIZE];
    qm_blob_writer *blob;
    int array; /* -1 for none */
} restored_file;

/** The names of arrays are those of jobs: letters, digits and underlines. */
static bool is_array(const char *name)
{
    size_t id = strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_");
    return id > 0 && id < QM_ID_SIZE && strcmp(name + id, QM_RESULT_ENDING) == 0;
}

static bool open_file(qm_store *store, const char *name, restored_file *out)
{
    char path[QM_STORE_PATH_SIZE];
    *out = (restored_file){.array = -1};
    snprintf(out->name, sizeof out->name, "%s", name);
    if (!is_array(name)) return qm_blob_begin(store, 0, &out->blob) == QM_OK;
    snprintf(path, sizeof path, "%s/results/%s", store->folder, name);
    out->array = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    return out->array >= 0;
}

/** Ends a file. A blob whose bytes do not have the hash that names it is dropped, which is a fault of the backup. */
static bool close_file(backup *work, restored_file *file)
{
    bool good = true;
    if (file->blob) {
        char hash[QM_HASH_SIZE] = "";
        good = qm_blob_seal(file->blob, hash) == QM_OK;
        bool is_whole = good && strcmp(hash, file->name) == 0;
        if (is_whole)
            good = qm_blob_keep(file->blob) == QM_STORED;
        else
            qm_blob_abort(file->blob);
        if (good && !is_whole) tell(work, "the backup", "", file->name, "damaged");
        work->found.files += good && is_whole;
    } else if (file->array >= 0) {
        good = fsync(file->array) == 0;
        good = close(file->array) == 0 && good;
        work->found.files += good;
    }
    *file = (restored_file){.array = -1};
    return good;
}

static bool write_part(const restored_file *file, const void *bytes, size_t size)
{
    if (file->blob) return size == 0 || qm_blob_write(file->blob, bytes, size) == QM_OK;
    for (const char *next = bytes; size > 0;) {
        ssize_t written = write(file->array, next, size);
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) return false;
        next += written;
        size -= (size_t)written;
    }
    return true;
}

/** Writes all blobs and arrays. */
static bool restore_files(backup *work, char message[QM_MESSAGE_SIZE])
{
    sqlite3_stmt *each = prepare(
        work->copy,
        "SELECT file, bytes FROM backup_parts INDEXED BY sqlite_autoindex_backup_parts_1 ORDER BY file, part",
        NULL, NULL);
    restored_file file = {.array = -1};
    int result = SQLITE_ERROR;
    bool written = true;
    while (each && written && (result = sqlite3_step(each)) == SQLITE_ROW) {
        const char *name = (const char *)sqlite3_column_text(each, 0);
        if (!name) break;
        if (strcmp(name, file.name) != 0)
            written = close_file(work, &file) && open_file(work->store, name, &file);
        written =
            written && write_part(&file, sqlite3_column_blob(each, 1), (size_t)sqlite3_column_bytes(each, 1));
    }
    if (!written) snprintf(message, QM_MESSAGE_SIZE, "cannot write a file: %s", strerror(errno));
    if (written && result != SQLITE_DONE)
        snprintf(message, QM_MESSAGE_SIZE, "the backup is damaged: %s", sqlite3_errmsg(work->copy));
    sqlite3_finalize(each);
    return close_file(work, &file) && written && result == SQLITE_DONE;
}

static bool open_backup(backup *work, const char *file, char message[QM_MESSAGE_SIZE])
{
    char found[1][SCALAR_SIZE];
    bool is_plain = true;
    qm_sqlite_sums_register();
    bool good =
        sqlite3_open_v2(file, &work->copy, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, QM_STORE_SUMS) ==
            SQLITE_OK &&
        find(work->copy, "SELECT count(*) FROM sqlite_master WHERE name = 'backup_parts'", NULL, 1, found);
    if (good) sqlite3_file_control(work->copy, "main", QM_STORE_ASK_PLAIN, &is_plain);
    if (good && !is_plain && strcmp(found[0], "1") == 0) return true;
    snprintf(message, QM_MESSAGE_SIZE, "%.200s is no backup, or damaged: %s", file,
             good ? "it has no files" : sqlite3_errmsg(work->copy));
    return false;
}

/** Restores to a folder that gets its name when everything is in it and on disk. */
static bool restore(backup *work, const char *path, const char *folder, const char *file,
                    char message[QM_MESSAGE_SIZE])
{
    char database[QM_STORE_PATH_SIZE], count[1][SCALAR_SIZE];
    if (!qm_blob_make_folders(path, message)) return false;
    snprintf(database, sizeof database, "%s/" QM_STORE_DATABASE, path);
    if (!restore_files(work, message) || !make_database(database, file, message)) return false;
    if (find(work->copy, "SELECT count(*) FROM meshes", NULL, 1, count))
        work->found.meshes = strtoul(count[0], NULL, 10);
    if (find(work->copy, "SELECT count(*) FROM jobs", NULL, 1, count))
        work->found.jobs = strtoul(count[0], NULL, 10);
    char results[QM_STORE_PATH_SIZE];
    snprintf(results, sizeof results, "%s/results", path);
    if (qm_blob_sync_folder(results) && qm_store_put_in_place(database, database) &&
        qm_store_put_in_place(path, folder))
        return true;
    snprintf(message, QM_MESSAGE_SIZE, "cannot name %.200s: %s", folder, strerror(errno));
    return false;
}

qm_status qm_store_restore(const char *file, const char *folder, FILE *out, qm_store_findings *found,
                           char message[QM_MESSAGE_SIZE])
{
    char name[QM_STORE_FOLDER_SIZE], path[QM_STORE_FOLDER_SIZE];
    backup work = {.out = out};
    *found = work.found;
    if (!qm_store_plan_folder(folder, ".restoring", name, path, message)) return QM_E_ARGUMENT;
    bool good = open_backup(&work, file, message);
    if (good) work.store = qm_store_create(path, message);
    good = work.store && restore(&work, path, name, file, message);
    if (!good && work.store) qm_store_remove_folder(path);
    sqlite3_close(work.copy);
    qm_store_close(work.store);
    *found = work.found;
    return good ? QM_OK : QM_E_ARGUMENT;
}
