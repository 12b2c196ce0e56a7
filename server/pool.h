/**
 * pool.h: threads that take tasks from one queue, first in, first out.
 */
#ifndef QM_POOL_H
#define QM_POOL_H

#include <stdbool.h>

typedef struct qm_pool qm_pool;
typedef void qm_task_fn(void *data);

/** NULL when threads or memory run out. */
qm_pool *qm_pool_create(int thread_count);

/** Queues run(data). False when out of memory: it will then never run. */
bool qm_pool_submit(qm_pool *pool, qm_task_fn *run, void *data);

/** Waits until every queued task has run, then ends the threads. */
void qm_pool_destroy(qm_pool *pool);

#endif
