/**
 * blob.c: the data folder, and the files in it that are named by the hash of their bytes: blobs/ab/abcd...
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <nettle/sha2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/id.h"
#include "base/log.h"
#include "store_driver.h"

#define SWEEP_AGE_S (24 * 60 * 60)

static bool make_folder(const char *path)
{
    return mkdir(path, 0700) == 0 || errno == EEXIST;
}

bool qm_blob_sync_folder(const char *path)
{
    int folder = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    bool synced = folder >= 0 && fsync(folder) == 0;
    if (folder >= 0) close(folder);
    return synced;
}

/** The name of the folder that holds this one. */
static void parent_of(const char *path, char out[QM_STORE_PATH_SIZE])
{
    const char *slash = strrchr(path, '/');
    if (!slash)
        snprintf(out, QM_STORE_PATH_SIZE, ".");
    else
        snprintf(out, QM_STORE_PATH_SIZE, "%.*s", slash == path ? 1 : (int)(slash - path), path);
}

static bool make_data_folder(const char *path)
{
    char parent[QM_STORE_PATH_SIZE];
    if (mkdir(path, 0700) != 0) return errno == EEXIST;
    parent_of(path, parent);
    return qm_blob_sync_folder(parent);
}

bool qm_blob_make_folders(const char *folder, char message[QM_MESSAGE_SIZE])
{
    char blobs[QM_STORE_PATH_SIZE], incoming[QM_STORE_PATH_SIZE], results[QM_STORE_PATH_SIZE];
    snprintf(blobs, sizeof blobs, "%s/blobs", folder);
    snprintf(incoming, sizeof incoming, "%s/incoming", folder);
    snprintf(results, sizeof results, "%s/results", folder);
    if (!make_data_folder(folder) || !make_folder(blobs) || !make_folder(incoming) || !make_folder(results) ||
        !qm_blob_sync_folder(folder)) {
        snprintf(message, QM_MESSAGE_SIZE, "cannot make %.200s: %s", folder, strerror(errno));
        return false;
    }
    if (access(incoming, W_OK) != 0) {
        snprintf(message, QM_MESSAGE_SIZE, "cannot write in %.200s: %s", folder, strerror(errno));
        return false;
    }
    return true;
}

void qm_blob_sweep(const char *folder)
{
    char incoming[QM_STORE_PATH_SIZE];
    snprintf(incoming, sizeof incoming, "%s/incoming", folder);
    DIR *files = opendir(incoming);
    for (struct dirent *entry; files && (entry = readdir(files));) {
        if (entry->d_name[0] != '.') unlinkat(dirfd(files), entry->d_name, 0);
    }
    if (files) closedir(files);
}

/** Whatever is younger was perhaps left by a fault that somebody is about to repair. */
static bool is_old(DIR *files, const char *name)
{
    struct stat facts;
    return fstatat(dirfd(files), name, &facts, AT_SYMLINK_NOFOLLOW) == 0 &&
           facts.st_mtime < time(NULL) - SWEEP_AGE_S;
}

/** Removes the old files of a folder that the store knows nothing of; returns how many. */
static size_t sweep_folder(qm_store *store, const char *path, bool (*is_needed)(qm_store *, const char *))
{
    size_t removed = 0;
    DIR *files = opendir(path);
    for (struct dirent *entry; files && (entry = readdir(files));) {
        if (entry->d_name[0] == '.' || !is_old(files, entry->d_name) || is_needed(store, entry->d_name))
            continue;
        removed += unlinkat(dirfd(files), entry->d_name, 0) == 0;
    }
    if (files) closedir(files);
    return removed;
}

/** Arrays are named by their job; one that is half written has another ending. */
static bool needs_result(qm_store *store, const char *name)
{
    char id[QM_ID_SIZE];
    const char *ending = strchr(name, '.');
    if (!ending || strcmp(ending, QM_RESULT_ENDING) != 0 || ending - name >= QM_ID_SIZE) return false;
    snprintf(id, sizeof id, "%.*s", (int)(ending - name), name);
    return store->driver->has_job(store, id);
}

void qm_blob_sweep_orphans(qm_store *store)
{
    char path[QM_STORE_PATH_SIZE];
    size_t removed = 0;
    for (unsigned first = 0; first < QM_BLOB_PREFIXES; first++) {
        snprintf(path, sizeof path, "%s/blobs/%02x", store->folder, first);
        removed += sweep_folder(store, path, store->driver->needs_blob);
    }
    snprintf(path, sizeof path, "%s/results", store->folder);
    removed += sweep_folder(store, path, needs_result);
    if (removed > 0) qm_log(QM_LOG_WARN, "%zu old files without a mesh or job removed", removed);
}

static bool has_files(const char *path)
{
    bool found = false;
    DIR *files = opendir(path);
    for (struct dirent *entry; files && !found && (entry = readdir(files));)
        found = entry->d_name[0] != '.';
    if (files) closedir(files);
    return found;
}

bool qm_blob_has_files(const char *folder)
{
    char path[QM_STORE_PATH_SIZE];
    snprintf(path, sizeof path, "%s/results", folder);
    bool found = has_files(path);
    for (unsigned first = 0; first < QM_BLOB_PREFIXES && !found; first++) {
        snprintf(path, sizeof path, "%s/blobs/%02x", folder, first);
        found = has_files(path);
    }
    return found;
}

bool qm_blob_move_all_away(const char *folder)
{
    static const char *const names[] = {"blobs", "results"};
    char from[QM_STORE_PATH_SIZE], to[QM_STORE_PATH_SIZE], now[QM_TIME_SIZE];
    qm_clock_format(now);
    snprintf(to, sizeof to, "%s/lost", folder);
    bool moved = make_folder(to);
    for (size_t i = 0; moved && i < sizeof names / sizeof *names; i++) {
        snprintf(from, sizeof from, "%s/%s", folder, names[i]);
        snprintf(to, sizeof to, "%s/lost/%s %s", folder, names[i], now);
        moved = rename(from, to) == 0 || errno == ENOENT;
    }
    return moved && qm_blob_sync_folder(folder);
}

/** Calls a function for each orphan of a folder, which from now on counts as new. */
static void take_orphans(qm_store *store, DIR *files, void (*take)(void *user, const char *hash), void *user)
{
    for (struct dirent *entry; (entry = readdir(files));) {
        if (strlen(entry->d_name) != QM_HASH_SIZE - 1 || store->driver->needs_blob(store, entry->d_name))
            continue;
        utimensat(dirfd(files), entry->d_name, NULL, 0);
        take(user, entry->d_name);
    }
}

bool qm_blob_each_orphan(qm_store *store, void (*take)(void *user, const char *hash), void *user)
{
    char path[QM_STORE_PATH_SIZE];
    bool read = true;
    for (unsigned first = 0; first < QM_BLOB_PREFIXES; first++) {
        snprintf(path, sizeof path, "%s/blobs/%02x", store->folder, first);
        DIR *files = opendir(path);
        if (files) take_orphans(store, files, take, user);
        if (!files && errno != ENOENT) read = false;
        if (files) closedir(files);
    }
    return read;
}

static void find_path(const qm_store *store, const char *hash, char out[QM_STORE_PATH_SIZE])
{
    snprintf(out, QM_STORE_PATH_SIZE, "%s/blobs/%.2s/%s", store->folder, hash, hash);
}

bool qm_blob_commit_file(qm_store *store, const char *file, const char *hash)
{
    QM_ASSERT(strlen(hash) == QM_HASH_SIZE - 1);
    char blobs[QM_STORE_PATH_SIZE], folder[QM_STORE_PATH_SIZE], path[QM_STORE_PATH_SIZE];
    snprintf(blobs, sizeof blobs, "%s/blobs", store->folder);
    snprintf(folder, sizeof folder, "%s/blobs/%.2s", store->folder, hash);
    find_path(store, hash, path);
    if (!make_folder(folder) || !qm_blob_sync_folder(blobs)) return false;
    uint64_t replaced = qm_space_size_of(path);
    if (rename(file, path) != 0) return false;
    qm_space_release(store, QM_STORE_BLOBS, replaced);
    return qm_blob_sync_folder(folder);
}

qm_status qm_blob_map_file(int file, const uint8_t **bytes, size_t *size)
{
    static const uint8_t nothing[1];
    struct stat facts;
    if (fstat(file, &facts) != 0) return QM_E_ARGUMENT;
    *size = (size_t)facts.st_size;
    *bytes = nothing;
    if (*size == 0) return QM_OK;
    /* All of it is about to be read: at once is cheaper than page by page. */
    void *mapped = mmap(NULL, *size, PROT_READ, MAP_PRIVATE | MAP_POPULATE, file, 0);
    if (mapped == MAP_FAILED) return QM_E_NO_MEMORY;
    *bytes = mapped;
    return QM_OK;
}

/**
 * The bytes are read, not mapped: a sector that the disk cannot give is an error of read, but the end of a process that
 * touches its page. Mapped afterwards, the pages are those in memory that were just read.
 */
qm_status qm_blob_hash_file(int file, char hash[QM_HASH_SIZE])
{
    enum { BLOCK = 256 << 10 }; /* stays in the second cache */
    uint8_t *block = malloc(BLOCK), digest[QM_DIGEST_SIZE];
    struct sha256_ctx context;
    ssize_t got = 1;
    if (!block) return QM_E_NO_MEMORY;
    sha256_init(&context);
    for (off_t done = 0; got > 0; done += got) {
        do
            got = pread(file, block, BLOCK, done);
        while (got < 0 && errno == EINTR);
        if (got > 0) sha256_update(&context, (size_t)got, block);
    }
    free(block);
    sha256_digest(&context, sizeof digest, digest);
    qm_id_hash_print(digest, hash);
    return got == 0 ? QM_OK : QM_E_FORMAT;
}

qm_status qm_blob_check_file(int file, const char *hash)
{
    char found[QM_HASH_SIZE];
    qm_status status = qm_blob_hash_file(file, found);
    return status == QM_OK && strcmp(found, hash) != 0 ? QM_E_FORMAT : status;
}

static qm_status open_in_folder(qm_store *store, const char *hash, int *file)
{
    char path[QM_STORE_PATH_SIZE];
    find_path(store, hash, path);
    *file = open(path, O_RDONLY | O_CLOEXEC);
    if (*file < 0) return errno == ENOENT ? QM_E_EMPTY : QM_E_ARGUMENT;
    qm_status status = qm_blob_check_file(*file, hash);
    if (status != QM_OK) close(*file);
    return status;
}

qm_status qm_blob_open(qm_store *store, const char *hash, int *file)
{
    qm_status status = open_in_folder(store, hash, file);
    if (!qm_store_is_shared(store) || (status != QM_E_EMPTY && status != QM_E_FORMAT)) return status;
    status = qm_blob_fetch(store, store, hash);
    return status == QM_OK ? open_in_folder(store, hash, file) : status;
}

qm_status qm_blob_copy(qm_store *from, qm_store *to, const char *hash)
{
    QM_ASSERT(qm_store_is_shared(from) != qm_store_is_shared(to));
    int file;
    qm_store *embedded = qm_store_is_shared(from) ? to : from;
    qm_status status = open_in_folder(embedded, hash, &file);
    if (status == QM_OK && embedded == from)
        status = qm_store_status(to->driver->put_blob(to, hash, file, false));
    else if (embedded == to && (status == QM_E_EMPTY || status == QM_E_FORMAT))
        return qm_blob_fetch(from, to, hash);
    else if (status != QM_OK)
        return status;
    close(file);
    return status;
}

qm_status qm_blob_map(qm_store *store, const char *hash, const uint8_t **bytes, size_t *size)
{
    int file;
    qm_status status = qm_blob_open(store, hash, &file);
    if (status != QM_OK) return status;
    status = qm_blob_map_file(file, bytes, size);
    close(file);
    return status;
}

qm_status qm_blob_check(qm_store *store, const char *hash)
{
    int file;
    if (qm_store_is_shared(store)) return qm_blob_fetch(store, store, hash);
    qm_status status = qm_blob_open(store, hash, &file);
    if (status == QM_OK) close(file);
    return status;
}

void qm_blob_unmap(const uint8_t *bytes, size_t size)
{
    if (size > 0) munmap((void *)(uintptr_t)bytes, size);
}

bool qm_blob_move_away(qm_store *store, const char *hash)
{
    char from[QM_STORE_PATH_SIZE], to[QM_STORE_PATH_SIZE];
    find_path(store, hash, from);
    snprintf(to, sizeof to, "%s/lost", store->folder);
    if (!make_folder(to)) return false;
    snprintf(to, sizeof to, "%s/lost/%s", store->folder, hash);
    uint64_t size = qm_space_size_of(from);
    if (rename(from, to) != 0) return false;
    qm_space_release(store, QM_STORE_BLOBS, size);
    return true;
}

void qm_blob_remove(qm_store *store, const char *hash)
{
    char path[QM_STORE_PATH_SIZE];
    if (qm_store_is_shared(store) || store->driver->needs_blob(store, hash)) return;
    find_path(store, hash, path);
    qm_space_unlink(store, QM_STORE_BLOBS, path);
}
