/**
 * blob.h: the interface between the files of blobs and the database of the store.
 */
#ifndef QM_BLOB_H
#define QM_BLOB_H

#include "store.h"

/** Buffer size of a path below the data folder; a longer folder name is rejected. */
#define QM_STORE_PATH_SIZE 4096
#define QM_STORE_FOLDER_SIZE (QM_STORE_PATH_SIZE - 128)

/** A result array is named by its job's id with this ending. */
#define QM_RESULT_ENDING ".f64"

/** Creates the data folder and its subfolders, and syncs them. False with a message. */
bool qm_blob_make_folders(const char *folder, char message[QM_MESSAGE_SIZE]);

/** Removes half-written files. Only for the process that holds the folder: it may have uploads of another. */
void qm_blob_sweep(const char *folder);

bool qm_blob_sync_folder(const char *path);

/** True when there is any blob, or array of a result. */
bool qm_blob_has_files(const char *folder);

/** Moves all blobs and arrays to lost/. */
bool qm_blob_move_all_away(const char *folder);

/**
 * Removes blobs and result arrays without a row that are older than a day. A crash leaves some behind, but so
 * does a database that has lost rows: there is a day to notice. For the start, when no other thread uses the
 * store.
 */
void qm_blob_sweep_orphans(qm_store *store);

/** Renames a synced file to its hash, and syncs the folders. */
bool qm_blob_commit_file(qm_store *store, const char *file, const char *hash);

/** Folders of blobs, by the first two digits of the hash. */
#define QM_BLOB_PREFIXES 256u

/** The hash of the bytes of an open file; QM_E_FORMAT when the disk does not give them. */
qm_status qm_blob_hash_file(int file, char hash[QM_HASH_SIZE]);

/** QM_OK when the bytes of an open file have a hash; QM_E_FORMAT when they have not, or the disk does not give them. */
qm_status qm_blob_check_file(int file, const char *hash);

/** Opens a blob whose bytes have its hash, which a shared store fetches when it is not in the folder. As qm_blob_map. */
qm_status qm_blob_open(qm_store *store, const char *hash, int *file);

/** Copies a blob of a shared store to the folder of a store, which may be its own, in place of a copy that is there. As
 * qm_blob_map. */
qm_status qm_blob_fetch(qm_store *from, qm_store *to, const char *hash);

/** Copies a blob between an embedded and a shared store; nothing when the embedded one has it. As qm_blob_map, and
 * QM_E_CANCELED: the database is away. */
qm_status qm_blob_copy(qm_store *from, qm_store *to, const char *hash);

/** Maps a whole open file for reading. */
qm_status qm_blob_map_file(int file, const uint8_t **bytes, size_t *size);

/** What the row of a job says of its array: count numbers, and the checksums of its blocks. */
#define QM_STORE_ARRAY_BLOCK 8192 /* numbers; the last block may have fewer */
typedef struct qm_store_array {
    uint64_t count;
    uint64_t *sums;          /* on the heap */
    char hash[QM_HASH_SIZE]; /* of the blob that has the numbers, in a shared store */
} qm_store_array;

static inline size_t qm_store_array_blocks(uint64_t count)
{
    return (size_t)((count + QM_STORE_ARRAY_BLOCK - 1) / QM_STORE_ARRAY_BLOCK);
}

/** Stores the array of a job in place of one before. QM_STORED_LOST: the job is no longer this node's. */
qm_stored qm_store_put_array(qm_store *store, const char *job_id, const qm_store_array *array);

/** QM_STORED_NONE when the job has none; QM_STORED_DAMAGED when what is stored cannot be one. */
qm_stored qm_store_find_array(qm_store *store, const char *job_id, qm_store_array *out);

#endif
