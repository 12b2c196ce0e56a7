/**
 * pool.h: threads that take tasks from one queue, first in, first out.
 */
#ifndef QM_POOL_H
#define QM_POOL_H

#include <stdbool.h>

typedef struct qm_pool qm_pool;
typedef void qm_task_fn(void *data);

/** NULL when threads or memory run out. Threads that compute for long are nice to those that answer: they and
 * the threads that they start stand back by so much (see nice(2)); 0 for others. */
qm_pool *qm_pool_create(int thread_count, int niceness);

/** Queues run(data). False when out of memory or closed: it will then never run. */
bool qm_pool_submit(qm_pool *pool, qm_task_fn *run, void *data);

/** Waits until every queued task has run, then ends the threads; from now on nothing can be queued. */
void qm_pool_close(qm_pool *pool);

/** Closes the pool if need be and frees it. NULL is fine. */
void qm_pool_destroy(qm_pool *pool);

#endif
