#include "blob_hash.h"

#include <errno.h>
#include <nettle/sha2.h>
#include <stdlib.h>
#include <unistd.h>
#include <uv.h>

#define BLOCK (256u << 10) /* bytes read back at a time: they are in the second cache yet */

/** lock guards size and ends; the rest is the thread's until it has ended. */
struct qm_blob_hash {
    int file;
    struct sha256_ctx context;
    bool failed;
    uv_thread_t thread;
    uv_mutex_t lock;
    uv_cond_t grown;
    uint64_t size;
    bool ends, aborted;
    uint8_t block[BLOCK];
};

/** Waits until there is more than done, or there will not be; the size. */
static uint64_t wait_for_more(qm_blob_hash *hash, uint64_t done)
{
    uv_mutex_lock(&hash->lock);
    while (hash->size < done + BLOCK && !hash->ends)
        uv_cond_wait(&hash->grown, &hash->lock);
    uint64_t size = hash->aborted ? done : hash->size;
    uv_mutex_unlock(&hash->lock);
    return size;
}

static void run(void *user)
{
    qm_blob_hash *hash = user;
    uint64_t done = 0, size;
    while (!hash->failed && (size = wait_for_more(hash, done)) > done) {
        size_t wanted = size - done < BLOCK ? (size_t)(size - done) : BLOCK;
        ssize_t got = pread(hash->file, hash->block, wanted, (off_t)done);
        if (got < 0 && errno == EINTR) continue;
        hash->failed = got <= 0;
        if (hash->failed) break;
        sha256_update(&hash->context, (size_t)got, hash->block);
        done += (uint64_t)got;
    }
}

qm_blob_hash *qm_blob_hash_start(int file)
{
    qm_blob_hash *hash = malloc(sizeof *hash);
    if (!hash) return NULL;
    hash->file = file;
    hash->failed = hash->ends = hash->aborted = false;
    hash->size = 0;
    sha256_init(&hash->context);
    uv_mutex_init(&hash->lock);
    uv_cond_init(&hash->grown);
    if (uv_thread_create(&hash->thread, run, hash) == 0) return hash;
    uv_cond_destroy(&hash->grown);
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
    if (is_worth) uv_cond_signal(&hash->grown);
}

static void end(qm_blob_hash *hash, bool aborted)
{
    uv_mutex_lock(&hash->lock);
    hash->ends = true;
    hash->aborted = aborted;
    uv_mutex_unlock(&hash->lock);
    uv_cond_signal(&hash->grown);
    uv_thread_join(&hash->thread);
    uv_cond_destroy(&hash->grown);
    uv_mutex_destroy(&hash->lock);
}

bool qm_blob_hash_end(qm_blob_hash *hash, uint8_t digest[QM_DIGEST_SIZE])
{
    end(hash, false);
    bool good = !hash->failed;
    sha256_digest(&hash->context, QM_DIGEST_SIZE, digest);
    free(hash);
    return good;
}

void qm_blob_hash_abort(qm_blob_hash *hash)
{
    if (!hash) return;
    end(hash, true);
    free(hash);
}
