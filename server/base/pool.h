/**
 * pool.h: threads that take tasks from one queue: those of one client first in, first out, and those of several clients
 * by turns, so that a client waits for one task of each other client and not for all.
 */
#ifndef QM_POOL_H
#define QM_POOL_H

#include <stdbool.h>
#include <stddef.h>

typedef struct qm_pool qm_pool;
typedef void qm_task_fn(void *data);

/** NULL if threads or memory run out. A niceness above 0 (see nice(2)) lowers the priority of these threads, and of
 * those that they start, below that of the threads that answer requests. libuv's pool is not used: it has one
 * size and one priority for the process. */
qm_pool *qm_pool_create(int thread_count, int niceness);

/** Queues run(data) of a client, a name that lives as long as data; NULL for tasks that are no client's. Returns false,
 * and never runs it, if memory ran out or the pool is closed. */
bool qm_pool_submit(qm_pool *pool, const char *client, qm_task_fn *run, void *data);

typedef struct qm_pool_load {
    size_t running, waiting;
} qm_pool_load;

/** Counts the tasks that run and those that wait for a thread. */
qm_pool_load qm_pool_count(qm_pool *pool);

/** Runs all queued tasks, then ends the threads; nothing can be queued any more. */
void qm_pool_close(qm_pool *pool);

/** Closes the pool if it is open, and frees it; NULL is allowed. */
void qm_pool_destroy(qm_pool *pool);

#endif
