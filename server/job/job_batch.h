/**
 * job_batch.h: many jobs from one file of lines, answered in the order in which they end.
 *
 * A few lines are jobs at a time, and no lines are read while a slow client leaves many answers unread, so
 * that memory does not grow with the file. Jobs of a batch are not stored and have no id: they live as long
 * as the batch is read. A request that has a stored result is answered from the store.
 */
#ifndef QM_JOB_BATCH_H
#define QM_JOB_BATCH_H

#include "base/pool.h"
#include "job.h"

typedef struct qm_batch qm_batch;

/**
 * Creates a batch, which starts with the first qm_batch_read. Takes over the upload; lines are read and
 * checked on the pool, as they wait for the disk. The batch uses the subscriber until qm_batch_close.
 *
 * NULL: out of memory, and the upload is gone.
 */
qm_batch *qm_batch_create(qm_jobs *jobs, qm_pool *pool, qm_blob_writer *upload, const char *client,
                          qm_subscriber *subscriber);

/**
 * Adds the finished answers to out, one JSON object a line:
 *   {"key":K,"line":N,"state":"succeeded","result":{...}}      with "cached":true before result
 *   {"key":K,"line":N,"state":"failed","problem":{...}}        or "canceled"
 * K is the key of the line, N its number from 1. With none to add and some to come, calls suspend under the
 * lock of the jobs and marks the subscriber as waiting; a heartbeat comes when it has waited long.
 */
qm_read_status qm_batch_read(qm_batch *batch, qm_text *out, void (*suspend)(void *user));

/** True when the daemon's end left lines without an answer. */
bool qm_batch_is_cut(qm_batch *batch);

/** The client has left: cancels the jobs that are not over. The last of them frees the batch. */
void qm_batch_close(qm_batch *batch);

#endif
