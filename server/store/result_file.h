/**
 * result_file.h: long arrays of results, which documents and events leave out: little-endian doubles in
 * results/ of the data folder, named by their job. The database has their length and checksums. A job writes
 * its file before it ends; when it runs again after a restart it overwrites the file.
 */
#ifndef QM_RESULT_FILE_H
#define QM_RESULT_FILE_H

#include "store.h"

/** Writes the array of a job: on disk, whole, when QM_OK is returned. */
qm_stored qm_result_file_write(qm_store *store, const char *job_id, const double *numbers, size_t count);

/** Removes the array of a job, if it has one. Open files stay readable. */
void qm_result_file_remove(qm_store *store, const char *job_id);

typedef struct qm_result_file qm_result_file;

/**
 * Opens the array of a job for reading. QM_E_EMPTY when it has none; QM_E_FORMAT when its file or row is missing, or it
 * does not have the length that was written; QM_E_NO_MEMORY or QM_E_ARGUMENT after a fault.
 */
qm_status qm_result_file_open(qm_store *store, const char *job_id, qm_result_file **out);
void qm_result_file_close(qm_result_file *file);

/** Count of its numbers. */
uint64_t qm_result_file_count(const qm_result_file *file);

/**
 * Reads whole blocks: count numbers from index first on, a multiple of QM_RESULT_BLOCK, to another one or to
 * the end. QM_E_FORMAT when they are not those that were written.
 */
#define QM_RESULT_BLOCK 8192
qm_status qm_result_file_read(const qm_result_file *file, uint64_t first, double *numbers, size_t count);

/** Compares all numbers with their checksums: the first status of qm_result_file_read that is not QM_OK. */
qm_status qm_result_file_check(const qm_result_file *file);

struct qm_store_array;
/**
 * Copies the numbers of the array of a job between an embedded and a shared store, and writes what its row is to say, whose
 * sums are on the heap. As qm_result_file_open; QM_E_FORMAT also when they are not those that were written, QM_E_CANCELED:
 * the database is away.
 */
qm_status qm_result_file_copy(qm_store *from, qm_store *to, const char *job_id, struct qm_store_array *array);

/** Stores the array of a job; false after a fault. */
typedef bool qm_result_put_fn(qm_store *store, const char *job_id, const struct qm_store_array *array);

/** Has length and checksums stored of the files that an earlier version has written without; false after a fault. */
bool qm_result_file_add_sums(qm_store *store, qm_result_put_fn *put);

#endif
