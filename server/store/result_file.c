/**
 * result_file.c: arrays of results as files: written beside, synced, then renamed.
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
#include "blob.h"
#include "checksum.h"
#include "space.h"

_Static_assert(QM_RESULT_BLOCK == QM_STORE_ARRAY_BLOCK, "a block that is read has a checksum");

struct qm_result_file {
    int file;
    qm_store_array array;
};

static void make_path(const qm_store *store, const char *job_id, const char *ending,
                      char out[QM_STORE_PATH_SIZE])
{
    snprintf(out, QM_STORE_PATH_SIZE, "%s/results/%s%s", qm_store_folder(store), job_id, ending);
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

/** Writes the numbers in blocks, and the checksum of each. */
static bool write_numbers(int file, const double *numbers, const qm_store_array *array)
{
    double block[QM_RESULT_BLOCK];
    for (size_t i = 0; i < qm_store_array_blocks(array->count); i++) {
        size_t first = i * QM_RESULT_BLOCK, rest = (size_t)array->count - first;
        size_t count = rest < QM_RESULT_BLOCK ? rest : QM_RESULT_BLOCK;
        memcpy(block, numbers + first, count * sizeof *block);
        qm_text_swap_bytes(block, count);
        array->sums[i] = qm_checksum(block, count * sizeof *block, i);
        if (!write_all(file, block, count * sizeof *block)) return false;
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

qm_status qm_result_file_write(qm_store *store, const char *job_id, const double *numbers, size_t count)
{
    char part[QM_STORE_PATH_SIZE], path[QM_STORE_PATH_SIZE];
    make_path(store, job_id, ".part", part);
    make_path(store, job_id, QM_RESULT_ENDING, path);
    qm_store_array array = {count, malloc(qm_store_array_blocks(count) * sizeof *array.sums + 1)};
    if (!array.sums) return QM_E_NO_MEMORY;
    uint64_t size = count * sizeof *numbers;
    qm_space_unlink(store, QM_STORE_RESULTS, part); /* of a run that was killed */
    qm_status status = qm_space_claim(store, QM_STORE_RESULTS, size);
    if (status != QM_OK) {
        free(array.sums);
        return status;
    }
    int file = open(part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    bool written = file >= 0 && write_numbers(file, numbers, &array) && fsync(file) == 0;
    if (file >= 0) close(file);
    uint64_t replaced = qm_space_size_of(path);
    if (written && rename(part, path) == 0) {
        qm_space_release(store, QM_STORE_RESULTS, replaced);
        status = sync_folder(store) ? qm_store_put_array(store, job_id, &array) : QM_E_ARGUMENT;
    } else {
        unlink(part);
        qm_space_release(store, QM_STORE_RESULTS, size);
        status = QM_E_ARGUMENT;
    }
    if (status != QM_OK) qm_log(QM_LOG_ERROR, "result of %s: cannot write: %s", job_id, strerror(errno));
    free(array.sums);
    return status;
}

void qm_result_file_remove(qm_store *store, const char *job_id)
{
    char path[QM_STORE_PATH_SIZE];
    make_path(store, job_id, QM_RESULT_ENDING, path);
    qm_space_unlink(store, QM_STORE_RESULTS, path);
}

qm_status qm_result_file_open(qm_store *store, const char *job_id, qm_result_file **out)
{
    char path[QM_STORE_PATH_SIZE];
    struct stat facts;
    *out = NULL;
    make_path(store, job_id, QM_RESULT_ENDING, path);
    qm_result_file *opened = calloc(1, sizeof *opened);
    if (!opened) return QM_E_NO_MEMORY;
    opened->file = -1;
    qm_status status = qm_store_find_array(store, job_id, &opened->array);
    if (status == QM_E_EMPTY && access(path, F_OK) == 0) status = QM_E_FORMAT; /* its row is lost */
    if (status == QM_OK) {
        opened->file = open(path, O_RDONLY | O_CLOEXEC);
        bool is_whole = opened->file >= 0 && fstat(opened->file, &facts) == 0 &&
                        (uint64_t)facts.st_size == opened->array.count * sizeof(double);
        if (!is_whole) status = opened->file >= 0 || errno == ENOENT ? QM_E_FORMAT : QM_E_ARGUMENT;
    }
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

/* ---- files of earlier versions ---- */

/** Sums the file of a job. One that cannot be read, or has a part of a number, gets no sums: it is damaged. */
static bool add_sums(qm_store *store, int file, const char *job_id)
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
    good = good && qm_store_put_array_locked(store, job_id, &array);
    free(array.sums);
    return good;
}

bool qm_result_file_add_sums(qm_store *store)
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
        good = file >= 0 && add_sums(store, file, id);
        if (file >= 0) close(file);
    }
    if (files) closedir(files);
    return good;
}
