/**
 * blob_writer.c: bytes on their way to become a blob: written under incoming/, synced, renamed, and the
 * folder synced, so that a name never stands for half a file. A few bytes wait in memory until it is known
 * that they are to stay: most small bodies are requests.
 *
 * Behind a large file a thread takes the hash and has the disk begin with the bytes, so that the thread that
 * receives them only writes them down.
 */
#include <errno.h>
#include <fcntl.h>
#include <nettle/sha2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <uv.h>

#include "base/id.h"
#include "base/log.h"
#include "store_driver.h"

/* ---- the hash ---- */

#define HASH_BLOCK (256u << 10) /* bytes read back at a time: they are in the second cache yet */
#define DISK_STEP (32u << 20)   /* bytes that are handed to the disk at a time */

/** lock guards what follows it; the rest is the thread's until the hash has been taken. */
typedef struct blob_hash {
    int file;
    struct sha256_ctx context;
    bool failed;
    uint64_t done, started; /* bytes in the hash; bytes handed to the disk */
    uv_thread_t thread;
    uv_mutex_t lock;
    uv_cond_t changed;
    uint64_t size;
    bool ends, aborted, is_taken;
    uint8_t block[HASH_BLOCK];
} blob_hash;

/** Waits until there is more to read, or there will not be; how much there is. */
static uint64_t wait_for_more(blob_hash *hash)
{
    QM_ASSERT(hash->started <= hash->done);
    uv_mutex_lock(&hash->lock);
    while (hash->size < hash->done + HASH_BLOCK && !hash->ends)
        uv_cond_wait(&hash->changed, &hash->lock);
    uint64_t size = hash->aborted ? hash->done : hash->size;
    uv_mutex_unlock(&hash->lock);
    return size;
}

/** Has the disk begin, and does not wait for it: less is left to do when the file is to stay. */
static void start_disk(blob_hash *hash)
{
    sync_file_range(hash->file, (off_t)hash->started, (off_t)(hash->done - hash->started),
                    SYNC_FILE_RANGE_WRITE);
    hash->started = hash->done;
}

static void run_hash(void *user)
{
    blob_hash *hash = user;
    uint64_t size;
    while (!hash->failed && (size = wait_for_more(hash)) > hash->done) {
        size_t wanted = size - hash->done < HASH_BLOCK ? (size_t)(size - hash->done) : HASH_BLOCK;
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

/** Starts at the first byte of a file, which stays open until the end. NULL: no memory or no thread. */
static blob_hash *hash_start(int file)
{
    blob_hash *hash = malloc(sizeof *hash);
    if (!hash) return NULL;
    hash->file = file;
    hash->failed = hash->ends = hash->aborted = hash->is_taken = false;
    hash->size = hash->done = hash->started = 0;
    sha256_init(&hash->context);
    uv_mutex_init(&hash->lock);
    uv_cond_init(&hash->changed);
    if (uv_thread_create(&hash->thread, run_hash, hash) == 0) return hash;
    uv_cond_destroy(&hash->changed);
    uv_mutex_destroy(&hash->lock);
    free(hash);
    return NULL;
}

/** Says how many bytes the file has by now. */
static void hash_grow(blob_hash *hash, uint64_t size)
{
    uv_mutex_lock(&hash->lock);
    /* The thread waits for whole blocks. */
    bool is_worth = size / HASH_BLOCK > hash->size / HASH_BLOCK;
    hash->size = size;
    uv_mutex_unlock(&hash->lock);
    if (is_worth) uv_cond_signal(&hash->changed);
}

/** Waits for the hash of all bytes; called once. False when they cannot be read back. */
static bool hash_take(blob_hash *hash, uint8_t digest[QM_DIGEST_SIZE])
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

/** Ends the thread, whether or not the hash was taken. NULL is fine. */
static void hash_free(blob_hash *hash)
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

/* ---- the file ---- */

/* Bytes that wait in memory. The file grows by as many, from multiples of as many: the system then takes them
 * in large pages, in half the time of pieces that begin anywhere. */
#define STEP ((size_t)64 << 10)
#define MIN_FOLLOWED (1u << 20) /* bytes that make a thread for their hash worth while */

struct qm_blob_writer {
    qm_store *store;
    blob_hash *hash; /* of the file; NULL while the bytes are few */
    char path[QM_STORE_PATH_SIZE];
    char name[QM_HASH_SIZE]; /* the hash, once sealed */
    int file;                /* -1 while the bytes are few and in memory */
    qm_text held;            /* the last ones, which are not in the file yet */
    uint64_t size;
    uint64_t claimed; /* bytes of the folder's quota */
};

/** Logs the cause: the client only learns that nothing was stored. */
static qm_status fail_to_store(const char *step)
{
    qm_log(QM_LOG_ERROR, "blob: cannot %s: %s", step, strerror(errno));
    return QM_E_ARGUMENT;
}

/** Claims room for a file of so many bytes. */
static qm_status claim(qm_blob_writer *writer, uint64_t size)
{
    if (size <= writer->claimed) return QM_OK;
    qm_status status = qm_space_claim(writer->store, QM_STORE_UPLOADS, size - writer->claimed);
    if (status == QM_OK) writer->claimed = size;
    return status;
}

qm_status qm_blob_begin(qm_store *store, uint64_t expected, qm_blob_writer **out)
{
    *out = calloc(1, sizeof **out);
    if (!*out) return QM_E_NO_MEMORY;
    (*out)->store = store;
    (*out)->file = -1;
    qm_status status = expected > STEP ? claim(*out, expected) : QM_OK;
    if (status == QM_OK) return QM_OK;
    free(*out);
    *out = NULL;
    return status;
}

/** Bytes in the file. */
static uint64_t written(const qm_blob_writer *writer)
{
    QM_ASSERT(writer->held.size <= writer->size);
    return writer->size - writer->held.size;
}

static qm_status hold(qm_blob_writer *writer, const char *bytes, size_t size)
{
    qm_text_add(&writer->held, bytes, size);
    return writer->held.failed ? QM_E_NO_MEMORY : QM_OK;
}

static qm_status make_file(qm_blob_writer *writer)
{
    if (writer->file >= 0) return QM_OK;
    snprintf(writer->path, QM_STORE_PATH_SIZE, "%s/incoming/XXXXXX", writer->store->folder);
    writer->file = mkostemp(writer->path, O_CLOEXEC);
    return writer->file >= 0 ? QM_OK : fail_to_store("make a file");
}

static qm_status write_all(int file, const char *bytes, size_t size)
{
    while (size > 0) {
        ssize_t count = write(file, bytes, size);
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0) return fail_to_store("write");
        bytes += count;
        size -= (size_t)count;
    }
    return QM_OK;
}

/** Moves the held bytes to the file. */
static qm_status flush(qm_blob_writer *writer)
{
    qm_status status = write_all(writer->file, writer->held.data, writer->held.size);
    writer->held.size = 0;
    return status;
}

/** Extends the hash to all bytes in the file. */
static qm_status follow(qm_blob_writer *writer)
{
    if (!writer->hash) writer->hash = hash_start(writer->file);
    if (!writer->hash) return QM_E_NO_MEMORY;
    hash_grow(writer->hash, written(writer));
    return QM_OK;
}

/** Writes the held bytes and whole steps of the new ones; holds the remainder. */
static qm_status write_steps(qm_blob_writer *writer, const char *bytes, size_t size)
{
    qm_status status = claim(writer, writer->size);
    if (status == QM_OK) status = make_file(writer);
    size_t missing = (STEP - writer->held.size) % STEP;
    if (status == QM_OK && missing > 0) status = hold(writer, bytes, missing);
    if (status == QM_OK) status = flush(writer);
    bytes += missing;
    size -= missing;
    size_t rest = size % STEP;
    if (status == QM_OK) status = write_all(writer->file, bytes, size - rest);
    if (status == QM_OK) status = hold(writer, bytes + size - rest, rest);
    return status;
}

qm_status qm_blob_write(qm_blob_writer *writer, const void *bytes, size_t size)
{
    writer->size += size;
    if (size <= STEP - writer->held.size) return hold(writer, bytes, size);
    qm_status status = write_steps(writer, bytes, size);
    if (status == QM_OK && written(writer) >= MIN_FOLLOWED) status = follow(writer);
    return status;
}

uint64_t qm_blob_size(const qm_blob_writer *writer)
{
    return writer->size;
}

static qm_status read_file(int file, uint64_t offset, char *bytes, size_t size)
{
    while (size > 0) {
        ssize_t got = pread(file, bytes, size, (off_t)offset);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return QM_E_ARGUMENT;
        bytes += got;
        size -= (size_t)got;
        offset += (uint64_t)got;
    }
    return QM_OK;
}

qm_status qm_blob_read(const qm_blob_writer *writer, uint64_t offset, void *bytes, size_t size)
{
    if (offset > writer->size || size > writer->size - offset) return QM_E_ARGUMENT;
    uint64_t in_file = offset < written(writer) ? written(writer) - offset : 0;
    size_t first = size < in_file ? size : (size_t)in_file;
    qm_status status = read_file(writer->file, offset, bytes, first);
    if (status == QM_OK && size > first)
        memcpy((char *)bytes + first, writer->held.data + (offset + first - written(writer)), size - first);
    return status;
}

/** Ends the writer and its file, which may have another name by now. */
static void end(qm_blob_writer *writer)
{
    hash_free(writer->hash);
    if (writer->file >= 0) close(writer->file);
    qm_text_reset(&writer->held);
    free(writer);
}

void qm_blob_abort(qm_blob_writer *writer)
{
    if (!writer) return;
    if (writer->file >= 0) unlink(writer->path);
    qm_space_release(writer->store, QM_STORE_UPLOADS, writer->claimed);
    end(writer);
}

/** Moves all bytes to the file and takes their hash, from where they are now. */
static qm_status settle(qm_blob_writer *writer, uint8_t digest[QM_DIGEST_SIZE])
{
    qm_status status = claim(writer, writer->size);
    if (writer->file < 0) {
        qm_id_hash_bytes(writer->held.data, writer->held.size, digest);
        if (status == QM_OK) status = make_file(writer);
        return status == QM_OK ? flush(writer) : status;
    }
    if (status == QM_OK) status = flush(writer);
    if (status == QM_OK) status = follow(writer);
    if (status == QM_OK && !hash_take(writer->hash, digest)) status = fail_to_store("read");
    return status;
}

qm_status qm_blob_seal(qm_blob_writer *writer, char hash[QM_HASH_SIZE])
{
    uint8_t digest[QM_DIGEST_SIZE];
    qm_status status = settle(writer, digest);
    if (status == QM_OK) qm_id_hash_print(digest, writer->name);
    memcpy(hash, writer->name, QM_HASH_SIZE);
    return status;
}

static qm_stored keep(qm_blob_writer *writer, bool is_repair)
{
    QM_ASSERT(writer->name[0]);
    QM_FAILPOINT_BEGIN("keep_blob");
    qm_store *store = writer->store;
    qm_stored stored = QM_STORED;
    if (fsync(writer->file) != 0) {
        fail_to_store("sync");
        stored = QM_STORED_FAULT;
    }
    if (stored == QM_STORED && qm_store_is_shared(store))
        stored = store->driver->put_blob(store, writer->name, writer->file, is_repair);
    if (stored == QM_STORED && !qm_blob_commit_file(store, writer->path, writer->name)) {
        fail_to_store("name a file");
        stored = QM_STORED_FAULT;
    }
    bool is_kept = stored == QM_STORED;
    QM_FAILPOINT_END();
    if (!is_kept) unlink(writer->path);
    qm_space_release(store, QM_STORE_UPLOADS, writer->claimed - (is_kept ? writer->size : 0));
    if (is_kept) qm_space_move(store, QM_STORE_UPLOADS, QM_STORE_BLOBS, writer->size);
    end(writer);
    return stored;
}

qm_stored qm_blob_keep(qm_blob_writer *writer)
{
    return keep(writer, false);
}

qm_stored qm_blob_repair(qm_blob_writer *writer)
{
    return keep(writer, true);
}

qm_status qm_blob_map_sealed(const qm_blob_writer *writer, const uint8_t **bytes, size_t *size)
{
    QM_ASSERT(writer->name[0]);
    return qm_blob_map_file(writer->file, bytes, size);
}
