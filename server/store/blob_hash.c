#include "blob_hash.h"

#include <errno.h>
#include <fcntl.h>
#include <nettle/sha2.h>
#include <stdlib.h>
#include <unistd.h>
#include <uv.h>

#define BLOCK (256u << 10)    /* bytes read back at a time: they are in the second cache yet */
#define DISK_STEP (32u << 20) /* bytes that the disk is told to take at a time */

/** lock guards what follows it; the rest is the thread's until the hash has been taken. */
struct qm_blob_hash {
    int file;
    struct sha256_ctx context;
    bool failed;
    uint64_t done, started; /* bytes in the hash; those that the disk was told to take */
    uv_thread_t thread;
    uv_mutex_t lock;
    uv_cond_t changed;
    uint64_t size;
    bool ends, aborted, is_taken;
    uint8_t block[BLOCK];
};

/** Waits until there is more to read, or there will not be; how much there is. */
static uint64_t wait_for_more(qm_blob_hash *hash)
{
    uv_mutex_lock(&hash->lock);
    while (hash->size < hash->done + BLOCK && !hash->ends)
        uv_cond_wait(&hash->changed, &hash->lock);
    uint64_t size = hash->aborted ? hash->done : hash->size;
    uv_mutex_unlock(&hash->lock);
    return size;
}

/** Has the disk begin, and does not wait for it: less is left to do when the file is to stay. */
static void start_disk(qm_blob_hash *hash)
{
    sync_file_range(hash->file, (off_t)hash->started, (off_t)(hash->done - hash->started),
                    SYNC_FILE_RANGE_WRITE);
    hash->started = hash->done;
}

static void run(void *user)
{
    qm_blob_hash *hash = user;
    uint64_t size;
    while (!hash->failed && (size = wait_for_more(hash)) > hash->done) {
        size_t wanted = size - hash->done < BLOCK ? (size_t)(size - hash->done) : BLOCK;
        ssize_t got = pread(hash->file, hash->block, wanted, (off_t)hash->done);
        if (got < 0 && errno == EINTR) continue;
        hash->failed = got <= 0;
        if (hash->failed) break;
        sha256_update(&hash->context, (size_t)got, hash->block);
        hash->done += (uint64_t)got;
        if (hash->done - hash->started >= DISK_STEP) start_disk(hash);
    }
    uv_mutex_lock(&hash->lock);
    hash->is_taken = true;
    bool is_wanted = !hash->aborted;
    uv_mutex_unlock(&hash->lock);
    uv_cond_signal(&hash->changed);
    if (is_wanted) start_disk(hash);
}

qm_blob_hash *qm_blob_hash_start(int file)
{
    qm_blob_hash *hash = malloc(sizeof *hash);
    if (!hash) return NULL;
    hash->file = file;
    hash->failed = hash->ends = hash->aborted = hash->is_taken = false;
    hash->size = hash->done = hash->started = 0;
    sha256_init(&hash->context);
    uv_mutex_init(&hash->lock);
    uv_cond_init(&hash->changed);
    if (uv_thread_create(&hash->thread, run, hash) == 0) return hash;
    uv_cond_destroy(&hash->changed);
    uv_mutex_destroy(&hash->lock);
    free(hash);
    return NULL;
}

void qm_blob_hash_grow(qm_blob_hash *hash, uint64_t size)
{
    uv_mutex_lock(&hash->lock);
    /* The thread waits for whole blocks. */
    bool is_worth = size / BLOCK > hash->size / BLOCK;
    hash->size = size;
    uv_mutex_unlock(&hash->lock);
    if (is_worth) uv_cond_signal(&hash->changed);
}

bool qm_blob_hash_take(qm_blob_hash *hash, uint8_t digest[QM_DIGEST_SIZE])
{
    uv_mutex_lock(&hash->lock);
    hash->ends = true;
    uv_cond_signal(&hash->changed);
    while (!hash->is_taken)
        uv_cond_wait(&hash->changed, &hash->lock);
    bool good = !hash->failed;
    uv_mutex_unlock(&hash->lock);
    sha256_digest(&hash->context, QM_DIGEST_SIZE, digest);
    return good;
}

void qm_blob_hash_free(qm_blob_hash *hash)
{
    if (!hash) return;
    uv_mutex_lock(&hash->lock);
    hash->aborted = !hash->ends;
    hash->ends = true;
    uv_mutex_unlock(&hash->lock);
    uv_cond_signal(&hash->changed);
    uv_thread_join(&hash->thread);
    uv_cond_destroy(&hash->changed);
    uv_mutex_destroy(&hash->lock);
    free(hash);
}
