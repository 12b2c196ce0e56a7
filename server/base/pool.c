/**
 * pool.c: worker threads and their queue, a singly linked list in the order of rounds: the next task of a client is in the
 * round after its last one that waits, and the first in the current round (round robin).
 */
#include "pool.h"

#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>
#include <uv.h>

#include "qm/base.h"

typedef struct task {
    qm_task_fn *run;
    void *data;
    const char *client;
    uint64_t round;
    struct task *next;
} task;

/** lock guards first, round, load and closing. */
struct qm_pool {
    uv_mutex_t lock;
    uv_cond_t changed;
    task *first;
    uint64_t round; /* of the task that was taken last */
    qm_pool_load load;
    bool closing;
    int niceness;
    int thread_count;
    uv_thread_t threads[];
};

static void work(void *data)
{
    qm_pool *pool = data;
    if (pool->niceness > 0) setpriority(PRIO_PROCESS, (id_t)gettid(), pool->niceness);
    uv_mutex_lock(&pool->lock);
    for (;;) {
        while (!pool->first && !pool->closing)
            uv_cond_wait(&pool->changed, &pool->lock);
        task *next = pool->first;
        if (!next) break;
        pool->first = next->next;
        pool->round = next->round;
        pool->load.waiting--;
        pool->load.running++;
        uv_mutex_unlock(&pool->lock);
        QM_ASSERT(next->run);
        next->run(next->data);
        free(next);
        uv_mutex_lock(&pool->lock);
        pool->load.running--;
    }
    uv_mutex_unlock(&pool->lock);
}

qm_pool *qm_pool_create(int thread_count, int niceness)
{
    QM_ASSERT(thread_count >= 1);
    qm_pool *pool = calloc(1, sizeof *pool + (size_t)thread_count * sizeof pool->threads[0]);
    if (!pool) return NULL;
    pool->niceness = niceness;
    uv_mutex_init(&pool->lock);
    uv_cond_init(&pool->changed);
    for (; pool->thread_count < thread_count; pool->thread_count++)
        if (uv_thread_create(&pool->threads[pool->thread_count], work, pool) != 0) break;
    if (pool->thread_count == thread_count) return pool;
    qm_pool_destroy(pool);
    return NULL;
}

/** Queues a task. The lock is held. */
static void insert(qm_pool *pool, task *added)
{
    added->round = pool->round;
    for (const task *t = pool->first; t; t = t->next)
        if (t->client && added->client && strcmp(t->client, added->client) == 0) added->round = t->round + 1;
    task **link = &pool->first;
    while (*link && (*link)->round <= added->round)
        link = &(*link)->next;
    added->next = *link;
    *link = added;
    pool->load.waiting++;
}

bool qm_pool_submit(qm_pool *pool, const char *client, qm_task_fn *run, void *data)
{
    task *added = malloc(sizeof *added);
    if (!added) return false;
    *added = (task){.run = run, .data = data, .client = client};
    uv_mutex_lock(&pool->lock);
    bool is_open = !pool->closing;
    if (is_open) insert(pool, added);
    uv_mutex_unlock(&pool->lock);
    /* Signal after unlocking, so that the woken thread does not wait for the lock. */
    if (is_open)
        uv_cond_signal(&pool->changed);
    else
        free(added);
    return is_open;
}

qm_pool_load qm_pool_count(qm_pool *pool)
{
    uv_mutex_lock(&pool->lock);
    qm_pool_load load = pool->load;
    uv_mutex_unlock(&pool->lock);
    return load;
}

void qm_pool_close(qm_pool *pool)
{
    uv_mutex_lock(&pool->lock);
    pool->closing = true;
    uv_cond_broadcast(&pool->changed);
    uv_mutex_unlock(&pool->lock);
    for (int i = 0; i < pool->thread_count; i++)
        uv_thread_join(&pool->threads[i]);
    pool->thread_count = 0;
}

void qm_pool_destroy(qm_pool *pool)
{
    if (!pool) return;
    qm_pool_close(pool);
    uv_cond_destroy(&pool->changed);
    uv_mutex_destroy(&pool->lock);
    free(pool);
}
