/**
 * blob_hash.h: a thread behind a file that is being written: it takes the hash and has the disk begin with
 * the bytes, so that who receives them has only to write them down.
 */
#ifndef QM_BLOB_HASH_H
#define QM_BLOB_HASH_H

#include <stdbool.h>

#include "base/hash.h"

typedef struct qm_blob_hash qm_blob_hash;

/** Starts at the first byte of a file, which stays open until the end. NULL without memory or thread. */
qm_blob_hash *qm_blob_hash_start(int file);

/** Tells how many bytes the file has by now. */
void qm_blob_hash_grow(qm_blob_hash *hash, uint64_t size);

/** Waits for the hash of all of them; once. False when they cannot be read back. */
bool qm_blob_hash_take(qm_blob_hash *hash, uint8_t digest[QM_DIGEST_SIZE]);

/** Ends the thread, whether or not the hash was taken. NULL is fine. */
void qm_blob_hash_free(qm_blob_hash *hash);

#endif
