/**
 * blob_cache.c: the blobs of a shared store that a node has in its folder. The database has all of them: any may be
 * removed here, and is fetched again when it is needed.
 */
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/id.h"
#include "base/log.h"
#include "base/metrics.h"
#include "store_driver.h"

qm_status qm_blob_fetch(qm_store *from, qm_store *to, const char *hash)
{
    QM_ASSERT(qm_store_is_shared(from));
    char path[QM_STORE_PATH_SIZE];
    snprintf(path, sizeof path, "%s/incoming/XXXXXX", to->folder);
    int file = mkostemp(path, O_CLOEXEC);
    if (file < 0) return QM_E_ARGUMENT;
    qm_status status = qm_store_status(from->driver->get_blob(from, hash, file));
    if (status == QM_OK) status = qm_blob_check_file(file, hash);
    struct stat facts;
    uint64_t size = status == QM_OK && fstat(file, &facts) == 0 ? (uint64_t)facts.st_size : 0;
    close(file);
    if (status == QM_OK) status = qm_space_claim(to, QM_STORE_BLOBS, size);
    if (status == QM_OK && !qm_blob_commit_file(to, path, hash)) {
        qm_space_release(to, QM_STORE_BLOBS, size);
        status = QM_E_ARGUMENT;
    }
    if (status != QM_OK) unlink(path);
    qm_metrics_add(QM_METRICS_BLOB_BYTES_FETCHED, size);
    return status;
}

/** A blob of the folder. */
typedef struct cached_blob {
    char hash[QM_HASH_SIZE];
    struct timespec used;
    uint64_t size;
} cached_blob;

typedef struct cached_list {
    cached_blob *blobs;
    size_t count, capacity;
    uint64_t size;
} cached_list;

static bool add_blob(cached_list *list, const char *name, const struct stat *facts)
{
    if (list->count == list->capacity) {
        size_t capacity = list->capacity ? 2 * list->capacity : 64;
        cached_blob *blobs = realloc(list->blobs, capacity * sizeof *blobs);
        if (!blobs) return false;
        list->blobs = blobs;
        list->capacity = capacity;
    }
    cached_blob *blob = &list->blobs[list->count++];
    memcpy(blob->hash, name, sizeof blob->hash); /* of its length */
    blob->used = facts->st_atim.tv_sec > facts->st_mtim.tv_sec ? facts->st_atim : facts->st_mtim;
    blob->size = (uint64_t)facts->st_size;
    list->size += blob->size;
    return true;
}

static void list_blobs(const qm_store *store, cached_list *list)
{
    char path[QM_STORE_PATH_SIZE];
    struct stat facts;
    for (unsigned first = 0; first < QM_BLOB_PREFIXES; first++) {
        snprintf(path, sizeof path, "%s/blobs/%02x", store->folder, first);
        DIR *files = opendir(path);
        for (struct dirent *entry; files && (entry = readdir(files));)
            if (strlen(entry->d_name) == QM_HASH_SIZE - 1 &&
                fstatat(dirfd(files), entry->d_name, &facts, AT_SYMLINK_NOFOLLOW) == 0 &&
                !add_blob(list, entry->d_name, &facts))
                break;
        if (files) closedir(files);
    }
}

static int compare_used(const void *a, const void *b)
{
    const struct timespec *x = &((const cached_blob *)a)->used, *y = &((const cached_blob *)b)->used;
    if (x->tv_sec != y->tv_sec) return x->tv_sec < y->tv_sec ? -1 : 1;
    return (x->tv_nsec > y->tv_nsec) - (x->tv_nsec < y->tv_nsec);
}

void qm_blob_trim_cache(qm_store *store, uint64_t limit)
{
    QM_ASSERT(qm_store_is_shared(store));
    qm_store_usage usage;
    qm_store_measure(store, &usage);
    if (usage.files[QM_STORE_BLOBS] <= limit) return;
    cached_list list = {0};
    list_blobs(store, &list);
    if (list.count > 0) qsort(list.blobs, list.count, sizeof *list.blobs, compare_used);
    char path[QM_STORE_PATH_SIZE];
    size_t removed = 0;
    for (; removed < list.count && list.size > limit; removed++) {
        const cached_blob *blob = &list.blobs[removed];
        snprintf(path, sizeof path, "%s/blobs/%.2s/%s", store->folder, blob->hash, blob->hash);
        qm_space_unlink(store, QM_STORE_BLOBS, path);
        list.size -= blob->size;
    }
    qm_log(QM_LOG_INFO, "%zu blobs removed from the cache", removed);
    free(list.blobs);
}
