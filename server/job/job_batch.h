/**
 * job_batch.h: many jobs from one file of lines, answered in the order in which they end.
 *
 * A few lines are jobs at a time, and no more answers are kept than a reader who lags leaves behind, so that
 * memory does not grow with the file. Jobs of a batch are not stored and have no id: they live as long as the
 * batch is read. What was answered before is answered from the store.
 */
#ifndef QM_JOB_BATCH_H
#define QM_JOB_BATCH_H

#include "base/pool.h"
#include "job.h"

typedef struct qm_batch qm_batch;

/**
 * Makes a batch, which starts with the first qm_batch_read. Takes over the upload; lines are read and checked
 * on the pool, which waits for the disk. The reader is the batch's until qm_batch_close.
 *
 * NULL: out of memory, and the upload is gone.
 */
qm_batch *qm_batch_create(qm_jobs *jobs, qm_pool *pool, qm_blob_writer *upload, qm_reader *reader);

/**
 * Adds the answers that are there to out, one JSON object a line:
 *   {"key":K,"line":N,"state":"succeeded","result":{...}}      with "cached":true before result
 *   {"key":K,"line":N,"state":"failed","problem":{...}}        or "canceled"
 * K is the line's own, N its place from 1. With none to add and some to come, puts the reader to sleep by
 * calling suspend under the lock of the jobs; a heartbeat comes when it has slept long.
 */
qm_news qm_batch_read(qm_batch *batch, qm_text *out, void (*suspend)(void *user));

/** True when the daemon's end left lines without an answer. */
bool qm_batch_is_cut(qm_batch *batch);

/** The reader has left: cancels what still runs. The batch is gone when that has ended. */
void qm_batch_close(qm_batch *batch);

#endif
