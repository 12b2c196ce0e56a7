/**
 * result_file.h: long arrays of results, which documents and events leave out: little-endian doubles in
 * results/ of the data folder, named by their job. A job writes its file before it ends; when it runs again
 * after a restart it overwrites the file.
 */
#ifndef QM_RESULT_FILE_H
#define QM_RESULT_FILE_H

#include "store.h"

/** Writes the array of a job: on disk, whole, when QM_OK is returned. */
qm_status qm_result_file_write(qm_store *store, const char *job_id, const double *numbers, size_t count);

/** Removes the array of a job, if it has one. Open files stay readable. */
void qm_result_file_remove(qm_store *store, const char *job_id);

typedef struct qm_result_file qm_result_file;

/** Opens the array of a job for reading; NULL when there is none. */
qm_result_file *qm_result_file_open(qm_store *store, const char *job_id);
void qm_result_file_close(qm_result_file *file);

/** Count of its numbers. */
uint64_t qm_result_file_count(const qm_result_file *file);

/** Reads count numbers from index first on; false after a fault. */
bool qm_result_file_read(const qm_result_file *file, uint64_t first, double *numbers, size_t count);

#endif
