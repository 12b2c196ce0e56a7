/**
 * result_file.c: arrays of results as files: written beside, synced, then renamed.
 */
#include "result_file.h"

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

#define BLOCK 8192 /* numbers that are turned and written at a time */

struct qm_result_file {
    int file;
    uint64_t count;
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

static bool write_numbers(int file, const double *numbers, size_t count)
{
    double block[BLOCK];
    for (size_t done = 0; done < count;) {
        size_t part = count - done < BLOCK ? count - done : BLOCK;
        memcpy(block, numbers + done, part * sizeof *block);
        qm_text_swap_bytes(block, part);
        if (!write_all(file, block, part * sizeof *block)) return false;
        done += part;
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
    int file = open(part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    bool written = file >= 0 && write_numbers(file, numbers, count) && fsync(file) == 0;
    if (file >= 0) close(file);
    if (written && rename(part, path) == 0 && sync_folder(store)) return QM_OK;
    qm_log(QM_LOG_ERROR, "result of %s: cannot write: %s", job_id, strerror(errno));
    unlink(part);
    return QM_E_ARGUMENT;
}

void qm_result_file_remove(qm_store *store, const char *job_id)
{
    char path[QM_STORE_PATH_SIZE];
    make_path(store, job_id, QM_RESULT_ENDING, path);
    unlink(path);
}

qm_result_file *qm_result_file_open(qm_store *store, const char *job_id)
{
    char path[QM_STORE_PATH_SIZE];
    struct stat facts;
    make_path(store, job_id, QM_RESULT_ENDING, path);
    qm_result_file *opened = calloc(1, sizeof *opened);
    if (!opened) return NULL;
    opened->file = open(path, O_RDONLY | O_CLOEXEC);
    if (opened->file >= 0 && fstat(opened->file, &facts) == 0) {
        opened->count = (uint64_t)facts.st_size / sizeof(double);
        return opened;
    }
    qm_result_file_close(opened);
    return NULL;
}

void qm_result_file_close(qm_result_file *file)
{
    if (!file) return;
    if (file->file >= 0) close(file->file);
    free(file);
}

uint64_t qm_result_file_count(const qm_result_file *file)
{
    return file->count;
}

bool qm_result_file_read(const qm_result_file *file, uint64_t first, double *numbers, size_t count)
{
    QM_ASSERT(first + count <= file->count);
    char *next = (char *)numbers;
    size_t size = count * sizeof *numbers;
    uint64_t offset = first * sizeof *numbers;
    while (size > 0) {
        ssize_t got = pread(file->file, next, size, (off_t)offset);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return false;
        next += got;
        size -= (size_t)got;
        offset += (uint64_t)got;
    }
    qm_text_swap_bytes(numbers, count);
    return true;
}
