/**
 * space.c: the count of bytes in a data folder.
 */
#include "space.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "store_driver.h"

uint64_t qm_space_size_of(const char *path)
{
    struct stat facts;
    return stat(path, &facts) == 0 ? (uint64_t)facts.st_size : 0;
}

/** Bytes of the files in a folder and the folders in it. */
static uint64_t size_of_folder(const char *path, int depth)
{
    uint64_t size = 0;
    struct stat facts;
    char name[QM_STORE_PATH_SIZE];
    DIR *files = opendir(path);
    for (struct dirent *entry; files && (entry = readdir(files));) {
        if (entry->d_name[0] == '.' || fstatat(dirfd(files), entry->d_name, &facts, AT_SYMLINK_NOFOLLOW) != 0)
            continue;
        if (S_ISREG(facts.st_mode)) size += (uint64_t)facts.st_size;
        if (!S_ISDIR(facts.st_mode) || depth == 0) continue;
        int length = snprintf(name, sizeof name, "%s/%s", path, entry->d_name);
        if (length < (int)sizeof name) size += size_of_folder(name, depth - 1);
    }
    if (files) closedir(files);
    return size;
}

void qm_space_count(qm_store *store)
{
    static const char *const folders[QM_STORE_FILES_COUNT] = {"blobs", "results", "incoming"};
    char path[QM_STORE_PATH_SIZE];
    for (int kind = 0; kind < QM_STORE_FILES_COUNT; kind++) {
        snprintf(path, sizeof path, "%s/%s", store->folder, folders[kind]);
        store->space.files[kind] = size_of_folder(path, 1);
    }
}

/** All that counts. space.lock is held. */
static uint64_t sum(const qm_space *space)
{
    uint64_t used = space->database;
    for (int kind = 0; kind < QM_STORE_FILES_COUNT; kind++)
        used += space->files[kind];
    return used;
}

void qm_space_set_database(qm_store *store, uint64_t size)
{
    qm_space *space = &store->space;
    pthread_mutex_lock(&space->lock);
    space->database = size;
    pthread_mutex_unlock(&space->lock);
}

qm_status qm_space_claim(qm_store *store, qm_store_files kind, uint64_t size)
{
    qm_space *space = &store->space;
    pthread_mutex_lock(&space->lock);
    uint64_t used = sum(space);
    bool fits = space->quota == 0 || (used <= space->quota && size <= space->quota - used);
    if (fits) space->files[kind] += size;
    pthread_mutex_unlock(&space->lock);
    return fits ? QM_OK : QM_E_TOO_LARGE;
}

void qm_space_release(qm_store *store, qm_store_files kind, uint64_t size)
{
    qm_space *space = &store->space;
    pthread_mutex_lock(&space->lock);
    /* Somebody else may have changed the size of a file. */
    space->files[kind] -= size < space->files[kind] ? size : space->files[kind];
    pthread_mutex_unlock(&space->lock);
}

void qm_space_move(qm_store *store, qm_store_files from, qm_store_files to, uint64_t size)
{
    qm_space *space = &store->space;
    pthread_mutex_lock(&space->lock);
    QM_ASSERT(space->files[from] >= size);
    space->files[from] -= size;
    space->files[to] += size;
    pthread_mutex_unlock(&space->lock);
}

void qm_space_unlink(qm_store *store, qm_store_files kind, const char *path)
{
    uint64_t size = qm_space_size_of(path);
    if (unlink(path) == 0) qm_space_release(store, kind, size);
}

bool qm_space_has_room(qm_store *store)
{
    qm_space *space = &store->space;
    if (space->quota == 0) return true;
    pthread_mutex_lock(&space->lock);
    bool has_room = sum(space) < space->quota;
    pthread_mutex_unlock(&space->lock);
    return has_room;
}

void qm_store_set_quota(qm_store *store, uint64_t quota)
{
    store->space.quota = quota;
}

void qm_store_measure(qm_store *store, qm_store_usage *out)
{
    qm_space *space = &store->space;
    pthread_mutex_lock(&space->lock);
    *out = (qm_store_usage){.database = space->database, .total = sum(space), .quota = space->quota};
    memcpy(out->files, space->files, sizeof out->files);
    pthread_mutex_unlock(&space->lock);
}
