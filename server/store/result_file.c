/**
 * result_file.c: arrays of results as files: written beside, synced, then renamed. Nodes that share a store keep
 * them as blobs, so that each may read them.
 */
#include "result_file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "base/text.h"
#include "checksum.h"
#include "store_driver.h"

_Static_assert(QM_RESULT_BLOCK == QM_STORE_ARRAY_BLOCK, "a block that is read has a checksum");

struct qm_result_file {
    int file;
    qm_store_array array;
};

static void make_path(const qm_store *store, const char *job_id, const char *ending,
                      char out[QM_STORE_PATH_SIZE])
{
    snprintf(out, QM_STORE_PATH_SIZE, "%s/results/%s%s", store->folder, job_id, ending);
}

static bool write_all(int file, const void *bytes, size_t size)
{
    for (const char *next = bytes; size > 0;) {
        ssize_t written = write(file, next, size);
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) return false;
        next += written;
        size -= (size_t)written;
    }
    return true;
}

/** Where numbers go. */
typedef struct result_target {
    int file;
    qm_blob_writer *blob; /* in place of the file; or NULL */
} result_target;

static bool write_block(const result_target *target, const double *block, size_t count)
{
    size_t size = count * sizeof *block;
    return target->blob ? qm_blob_write(target->blob, block, size) == QM_OK
                        : write_all(target->file, block, size);
}

/** Writes the numbers in blocks, and the checksum of each. */
static bool write_numbers(const result_target *target, const double *numbers, const qm_store_array *array)
{
    double block[QM_RESULT_BLOCK];
    for (size_t i = 0; i < qm_store_array_blocks(array->count); i++) {
        size_t first = i * QM_RESULT_BLOCK, rest = (size_t)array->count - first;
        size_t count = rest < QM_RESULT_BLOCK ? rest : QM_RESULT_BLOCK;
        memcpy(block, numbers + first, count * sizeof *block);
        qm_text_swap_bytes(block, count);
        array->sums[i] = qm_checksum(block, count * sizeof *block, i);
        if (!write_block(target, block, count)) return false;
    }
    return true;
}

static bool sync_folder(const qm_store *store)
{
    char path[QM_STORE_PATH_SIZE];
    make_path(store, "", "", path);
    int folder = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool synced = folder >= 0 && fsync(folder) == 0;
    if (folder >= 0) close(folder);
    return synced;
}

static qm_stored write_file(qm_store *store, const char *job_id, const double *numbers,
                            const qm_store_array *array)
{
    char part[QM_STORE_PATH_SIZE], path[QM_STORE_PATH_SIZE];
    make_path(store, job_id, ".part", part);
    make_path(store, job_id, QM_RESULT_ENDING, path);
    uint64_t size = array->count * sizeof *numbers;
    qm_space_unlink(store, QM_STORE_RESULTS, part); /* of a run that was killed */
    if (qm_space_claim(store, QM_STORE_RESULTS, size) != QM_OK) return QM_STORED_FULL;
    const result_target target = {.file = open(part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600)};
    bool written = target.file >= 0 && write_numbers(&target, numbers, array) && fsync(target.file) == 0;
    if (target.file >= 0) close(target.file);
    uint64_t replaced = qm_space_size_of(path);
    if (written && rename(part, path) == 0) {
        qm_space_release(store, QM_STORE_RESULTS, replaced);
        return sync_folder(store) ? QM_STORED : QM_STORED_FAULT;
    }
    unlink(part);
    qm_space_release(store, QM_STORE_RESULTS, size);
    return QM_STORED_FAULT;
}

static qm_stored write_blob(qm_store *store, const double *numbers, qm_store_array *array)
{
    result_target target = {.file = -1};
    qm_status status = qm_blob_begin(store, array->count * sizeof *numbers, &target.blob);
    if (status == QM_OK && !write_numbers(&target, numbers, array)) status = QM_E_ARGUMENT;
    if (status == QM_OK) status = qm_blob_seal(target.blob, array->hash);
    if (status == QM_OK) return qm_blob_keep(target.blob);
    qm_blob_abort(target.blob);
    if (status == QM_E_NO_MEMORY) return QM_STORED_NO_MEMORY;
    return status == QM_E_TOO_LARGE ? QM_STORED_FULL : QM_STORED_FAULT;
}

qm_stored qm_result_file_write(qm_store *store, const char *job_id, const double *numbers, size_t count)
{
    qm_store_array array = {.count = count,
                            .sums = malloc(qm_store_array_blocks(count) * sizeof *array.sums + 1)};
    if (!array.sums) return QM_STORED_NO_MEMORY;
    qm_stored stored = qm_store_is_shared(store) ? write_blob(store, numbers, &array)
                                                 : write_file(store, job_id, numbers, &array);
    if (stored == QM_STORED) stored = qm_store_put_array(store, job_id, &array);
    if (stored != QM_STORED) qm_log(QM_LOG_ERROR, "result of %s: cannot write: %s", job_id, strerror(errno));
    free(array.sums);
    return stored;
}

void qm_result_file_remove(qm_store *store, const char *job_id)
{
    char path[QM_STORE_PATH_SIZE];
    make_path(store, job_id, QM_RESULT_ENDING, path);
    qm_space_unlink(store, QM_STORE_RESULTS, path);
}

/** Opens the file of an array, whose row was found; it has its length. */
static qm_status open_file(qm_store *store, const char *path, qm_result_file *opened)
{
    struct stat facts;
    if (opened->array.hash[0]) {
        qm_status status = qm_blob_open(store, opened->array.hash, &opened->file);
        if (status == QM_E_EMPTY) return QM_E_FORMAT;
        if (status != QM_OK) return status;
    } else {
        opened->file = open(path, O_RDONLY | O_CLOEXEC);
        if (opened->file < 0) return errno == ENOENT ? QM_E_FORMAT : QM_E_ARGUMENT;
    }
    bool is_whole =
        fstat(opened->file, &facts) == 0 && (uint64_t)facts.st_size == opened->array.count * sizeof(double);
    return is_whole ? QM_OK : QM_E_FORMAT;
}

qm_status qm_result_file_open(qm_store *store, const char *job_id, qm_result_file **out)
{
    char path[QM_STORE_PATH_SIZE];
    *out = NULL;
    make_path(store, job_id, QM_RESULT_ENDING, path);
    qm_result_file *opened = calloc(1, sizeof *opened);
    if (!opened) return QM_E_NO_MEMORY;
    opened->file = -1;
    qm_status status = qm_store_status(qm_store_find_array(store, job_id, &opened->array));
    if (status == QM_E_EMPTY && access(path, F_OK) == 0) status = QM_E_FORMAT; /* its row is lost */
    if (status == QM_OK) status = open_file(store, path, opened);
    if (status == QM_OK)
        *out = opened;
    else
        qm_result_file_close(opened);
    return status;
}

void qm_result_file_close(qm_result_file *file)
{
    if (!file) return;
    if (file->file >= 0) close(file->file);
    free(file->array.sums);
    free(file);
}

uint64_t qm_result_file_count(const qm_result_file *file)
{
    return file->array.count;
}

/** Reads all of size from an offset. */
static bool read_all(int file, void *bytes, size_t size, uint64_t offset)
{
    for (char *next = bytes; size > 0;) {
        ssize_t got = pread(file, next, size, (off_t)offset);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return false;
        next += got;
        size -= (size_t)got;
        offset += (uint64_t)got;
    }
    return true;
}

qm_status qm_result_file_read(const qm_result_file *file, uint64_t first, double *numbers, size_t count)
{
    QM_ASSERT(first % QM_RESULT_BLOCK == 0 && first + count <= file->array.count);
    QM_ASSERT(count % QM_RESULT_BLOCK == 0 || first + count == file->array.count);
    if (!read_all(file->file, numbers, count * sizeof *numbers, first * sizeof *numbers)) return QM_E_FORMAT;
    for (size_t done = 0; done < count; done += QM_RESULT_BLOCK) {
        size_t part = count - done < QM_RESULT_BLOCK ? count - done : QM_RESULT_BLOCK;
        uint64_t block = (first + done) / QM_RESULT_BLOCK;
        if (qm_checksum(numbers + done, part * sizeof *numbers, block) != file->array.sums[block])
            return QM_E_FORMAT;
    }
    qm_text_swap_bytes(numbers, count);
    return QM_OK;
}

qm_status qm_result_file_check(const qm_result_file *file)
{
    double block[QM_RESULT_BLOCK];
    qm_status status = QM_OK;
    for (uint64_t done = 0; status == QM_OK && done < file->array.count; done += QM_RESULT_BLOCK) {
        uint64_t rest = file->array.count - done;
        status =
            qm_result_file_read(file, done, block, rest < QM_RESULT_BLOCK ? (size_t)rest : QM_RESULT_BLOCK);
    }
    return status;
}

/* ---- copies for another store ---- */

/** From a file of results to a blob. */
static qm_status copy_to_blob(qm_store *from, qm_store *to, const char *job_id, qm_store_array *array)
{
    qm_result_file *file;
    qm_status status = qm_result_file_open(from, job_id, &file);
    if (status == QM_OK) status = qm_result_file_check(file);
    if (status == QM_OK) status = qm_blob_hash_file(file->file, file->array.hash);
    if (status == QM_OK)
        status = qm_store_status(to->driver->put_blob(to, file->array.hash, file->file, false));
    if (status == QM_OK) {
        *array = file->array;
        file->array.sums = NULL;
    }
    qm_result_file_close(file);
    return status;
}

/** From a blob to a file of results. */
static qm_status copy_to_file(qm_store *from, qm_store *to, const char *job_id, qm_store_array *array)
{
    char part[QM_STORE_PATH_SIZE], path[QM_STORE_PATH_SIZE];
    make_path(to, job_id, ".part", part);
    make_path(to, job_id, QM_RESULT_ENDING, path);
    qm_result_file made = {.file = -1};
    qm_status status = qm_store_status(qm_store_find_array(from, job_id, &made.array));
    if (status != QM_OK) return status;
    made.file = open(part, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (made.file < 0) status = QM_E_ARGUMENT;
    if (status == QM_OK) status = qm_store_status(from->driver->get_blob(from, made.array.hash, made.file));
    if (status == QM_E_EMPTY) status = QM_E_FORMAT; /* its row is there */
    if (status == QM_OK) status = qm_blob_check_file(made.file, made.array.hash);
    uint64_t size = made.array.count * sizeof(double);
    if (status == QM_OK && qm_space_size_of(part) != size) status = QM_E_FORMAT;
    if (status == QM_OK) status = qm_result_file_check(&made);
    if (status == QM_OK) status = qm_space_claim(to, QM_STORE_RESULTS, size);
    if (status == QM_OK && rename(part, path) != 0) status = QM_E_ARGUMENT;
    if (status != QM_OK) unlink(part);
    if (made.file >= 0) close(made.file);
    if (status == QM_OK)
        *array = made.array;
    else
        free(made.array.sums);
    return status;
}

qm_status qm_result_file_copy(qm_store *from, qm_store *to, const char *job_id, qm_store_array *array)
{
    QM_ASSERT(qm_store_is_shared(from) != qm_store_is_shared(to));
    return qm_store_is_shared(to) ? copy_to_blob(from, to, job_id, array)
                                  : copy_to_file(from, to, job_id, array);
}

/* ---- files of earlier versions ---- */

/** Sums the file of a job. One that cannot be read, or has a part of a number, gets no sums: it is damaged. */
static bool add_sums(qm_store *store, int file, const char *job_id, qm_result_put_fn *put)
{
    struct stat facts;
    double block[QM_RESULT_BLOCK];
    if (fstat(file, &facts) != 0 || (uint64_t)facts.st_size % sizeof *block != 0) return true;
    qm_store_array array = {.count = (uint64_t)facts.st_size / sizeof *block};
    array.sums = malloc(qm_store_array_blocks(array.count) * sizeof *array.sums + 1);
    bool good = array.sums;
    for (size_t i = 0; good && i < qm_store_array_blocks(array.count); i++) {
        uint64_t first = (uint64_t)i * QM_RESULT_BLOCK, rest = array.count - first;
        size_t size = (rest < QM_RESULT_BLOCK ? (size_t)rest : QM_RESULT_BLOCK) * sizeof *block;
        good = read_all(file, block, size, first * sizeof *block);
        if (good) array.sums[i] = qm_checksum(block, size, i);
    }
    good = good && put(store, job_id, &array);
    free(array.sums);
    return good;
}

bool qm_result_file_add_sums(qm_store *store, qm_result_put_fn *put)
{
    char path[QM_STORE_PATH_SIZE], id[QM_ID_SIZE];
    make_path(store, "", "", path);
    DIR *files = opendir(path);
    bool good = files;
    for (struct dirent *entry; good && (entry = readdir(files));) {
        const char *ending = strchr(entry->d_name, '.');
        if (!ending || strcmp(ending, QM_RESULT_ENDING) != 0 || ending - entry->d_name >= QM_ID_SIZE)
            continue;
        snprintf(id, sizeof id, "%.*s", (int)(ending - entry->d_name), entry->d_name);
        int file = openat(dirfd(files), entry->d_name, O_RDONLY | O_CLOEXEC);
        good = file >= 0 && add_sums(store, file, id, put);
        if (file >= 0) close(file);
    }
    if (files) closedir(files);
    return good;
}
