/**
 * blob.c: bytes as files named by their hash, under blobs/ab/abcd...: written under incoming/, synced,
 * renamed, and the folder synced, so that a name never stands for half a file. A few bytes wait in memory
 * until it is known that they are to stay: most small bodies are questions.
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
#include <unistd.h>

#include "blob.h"
#include "log.h"

#define MAX_HELD (64u << 10) /* bytes that wait in memory */
#define START_SIZE (8u << 20)

struct qm_blob_writer {
    qm_store *store;
    struct sha256_ctx hash; /* of what is in the file */
    char path[QM_STORE_PATH_SIZE];
    char name[QM_HASH_SIZE]; /* the hash, once sealed */
    int file;                /* -1 while the bytes are few and in memory */
    qm_text held;            /* those */
    uint64_t size, started;  /* bytes; those that the disk was told to take */
};

static bool make_folder(const char *path)
{
    return mkdir(path, 0700) == 0 || errno == EEXIST;
}

static bool sync_folder(const char *path)
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
    return sync_folder(parent);
}

bool qm_blob_make_folders(const char *folder, char message[QM_MESSAGE_SIZE])
{
    char blobs[QM_STORE_PATH_SIZE], incoming[QM_STORE_PATH_SIZE], results[QM_STORE_PATH_SIZE];
    snprintf(blobs, sizeof blobs, "%s/blobs", folder);
    snprintf(incoming, sizeof incoming, "%s/incoming", folder);
    snprintf(results, sizeof results, "%s/results", folder);
    if (!make_data_folder(folder) || !make_folder(blobs) || !make_folder(incoming) || !make_folder(results) ||
        !sync_folder(folder)) {
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

/** Removes the files of a folder that the store knows nothing of; returns how many. */
static size_t sweep_folder(qm_store *store, const char *path, bool (*is_needed)(qm_store *, const char *))
{
    size_t removed = 0;
    DIR *files = opendir(path);
    for (struct dirent *entry; files && (entry = readdir(files));) {
        if (entry->d_name[0] == '.' || is_needed(store, entry->d_name)) continue;
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
    return qm_store_has_job(store, id);
}

void qm_blob_sweep_orphans(qm_store *store)
{
    char path[QM_STORE_PATH_SIZE];
    size_t removed = 0;
    for (int first = 0; first < 256; first++) {
        snprintf(path, sizeof path, "%s/blobs/%02x", qm_store_folder(store), (unsigned)first);
        removed += sweep_folder(store, path, qm_store_needs_blob);
    }
    snprintf(path, sizeof path, "%s/results", qm_store_folder(store));
    removed += sweep_folder(store, path, needs_result);
    if (removed > 0) qm_log(QM_LOG_INFO, "%zu files without a mesh or job removed", removed);
}

static void blob_folder(const qm_store *store, const char *hash, char out[QM_STORE_PATH_SIZE])
{
    snprintf(out, QM_STORE_PATH_SIZE, "%s/blobs/%.2s", qm_store_folder(store), hash);
}

static void blob_path(const qm_store *store, const char *hash, char out[QM_STORE_PATH_SIZE])
{
    snprintf(out, QM_STORE_PATH_SIZE, "%s/blobs/%.2s/%s", qm_store_folder(store), hash, hash);
}

/** The cause belongs into the log; the client only hears that nothing was stored. */
static qm_status fail_to_store(const char *step)
{
    qm_log(QM_LOG_ERROR, "blob: cannot %s: %s", step, strerror(errno));
    return QM_E_ARGUMENT;
}

qm_status qm_blob_begin(qm_store *store, qm_blob_writer **out)
{
    *out = calloc(1, sizeof **out);
    if (!*out) return QM_E_NO_MEMORY;
    (*out)->store = store;
    sha256_init(&(*out)->hash);
    (*out)->file = -1;
    return QM_OK;
}

static bool write_all(int file, const char *bytes, size_t size)
{
    while (size > 0) {
        ssize_t written = write(file, bytes, size);
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) return false;
        bytes += written;
        size -= (size_t)written;
    }
    return true;
}

/** What never gets into the file is never asked for its hash. */
static bool append(qm_blob_writer *writer, const char *bytes, size_t size)
{
    sha256_update(&writer->hash, size, (const uint8_t *)bytes);
    return write_all(writer->file, bytes, size);
}

/** Moves the bytes from memory to a file, unless they are there already. */
static qm_status make_file(qm_blob_writer *writer)
{
    if (writer->file >= 0) return QM_OK;
    snprintf(writer->path, QM_STORE_PATH_SIZE, "%s/incoming/XXXXXX", qm_store_folder(writer->store));
    writer->file = mkostemp(writer->path, O_CLOEXEC);
    if (writer->file < 0) return fail_to_store("make a file");
    if (!append(writer, writer->held.data, writer->held.size)) return fail_to_store("write");
    qm_text_reset(&writer->held);
    return QM_OK;
}

/** Has the disk begin with what was written, so that less is left when the blob is to stay. */
static void start_writing(qm_blob_writer *writer)
{
    sync_file_range(writer->file, (off_t)writer->started, (off_t)(writer->size - writer->started),
                    SYNC_FILE_RANGE_WRITE);
    writer->started = writer->size;
}

qm_status qm_blob_write(qm_blob_writer *writer, const void *bytes, size_t size)
{
    writer->size += size;
    if (writer->file < 0 && writer->size <= MAX_HELD) {
        qm_text_add(&writer->held, bytes, size);
        return writer->held.failed ? QM_E_NO_MEMORY : QM_OK;
    }
    qm_status status = make_file(writer);
    if (status != QM_OK) return status;
    if (!append(writer, bytes, size)) return fail_to_store("write");
    if (writer->size - writer->started > START_SIZE) start_writing(writer);
    return QM_OK;
}

uint64_t qm_blob_size(const qm_blob_writer *writer)
{
    return writer->size;
}

qm_status qm_blob_read(const qm_blob_writer *writer, uint64_t offset, void *bytes, size_t size)
{
    if (writer->file < 0) {
        if (offset > writer->size || size > writer->size - offset) return QM_E_ARGUMENT;
        if (size > 0) memcpy(bytes, writer->held.data + offset, size);
        return QM_OK;
    }
    for (char *next = bytes; size > 0;) {
        ssize_t got = pread(writer->file, next, size, (off_t)offset);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return QM_E_ARGUMENT;
        next += got;
        size -= (size_t)got;
        offset += (uint64_t)got;
    }
    return QM_OK;
}

void qm_blob_abort(qm_blob_writer *writer)
{
    if (!writer) return;
    if (writer->file >= 0) {
        close(writer->file);
        unlink(writer->path);
    }
    qm_text_reset(&writer->held);
    free(writer);
}

static bool move_into_place(const qm_blob_writer *writer, const char *hash)
{
    char folder[QM_STORE_PATH_SIZE], path[QM_STORE_PATH_SIZE], blobs[QM_STORE_PATH_SIZE];
    blob_folder(writer->store, hash, folder);
    blob_path(writer->store, hash, path);
    snprintf(blobs, sizeof blobs, "%s/blobs", qm_store_folder(writer->store));
    return make_folder(folder) && sync_folder(blobs) && rename(writer->path, path) == 0 &&
           sync_folder(folder);
}

qm_status qm_blob_seal(qm_blob_writer *writer, char hash[QM_HASH_SIZE])
{
    uint8_t digest[SHA256_DIGEST_SIZE];
    qm_status status = make_file(writer);
    if (status != QM_OK) return status;
    start_writing(writer);
    sha256_digest(&writer->hash, sizeof digest, digest);
    qm_hash_print(digest, writer->name);
    memcpy(hash, writer->name, QM_HASH_SIZE);
    return QM_OK;
}

qm_status qm_blob_keep(qm_blob_writer *writer)
{
    qm_status status = fsync(writer->file) == 0 ? QM_OK : fail_to_store("sync");
    if (status == QM_OK && !move_into_place(writer, writer->name)) status = fail_to_store("name a file");
    if (status != QM_OK) unlink(writer->path);
    close(writer->file);
    free(writer);
    return status;
}

static qm_status map(int file, const uint8_t **bytes, size_t *size)
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

qm_status qm_blob_map_sealed(const qm_blob_writer *writer, const uint8_t **bytes, size_t *size)
{
    return map(writer->file, bytes, size);
}

qm_status qm_blob_map(qm_store *store, const char *hash, const uint8_t **bytes, size_t *size)
{
    char path[QM_STORE_PATH_SIZE];
    blob_path(store, hash, path);
    int file = open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0) return QM_E_EMPTY;
    qm_status status = map(file, bytes, size);
    close(file);
    return status;
}

void qm_blob_unmap(const uint8_t *bytes, size_t size)
{
    if (size > 0) munmap((void *)(uintptr_t)bytes, size);
}

void qm_blob_remove(qm_store *store, const char *hash)
{
    char path[QM_STORE_PATH_SIZE];
    if (qm_store_needs_blob(store, hash)) return;
    blob_path(store, hash, path);
    unlink(path);
}
