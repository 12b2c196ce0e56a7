/**
 * solids.c: two certificates behind one lock. The check runs without it: two jobs that ask at once both check, and agree.
 */
#include "solids.h"

#include <pthread.h>
#include <stdlib.h>

struct qm_solids {
    pthread_mutex_t lock;
    bool is_known[2];
    qm_solid solid[2];
};

qm_solids *qm_solids_create(void)
{
    qm_solids *cache = calloc(1, sizeof *cache);
    if (cache) pthread_mutex_init(&cache->lock, NULL);
    return cache;
}

void qm_solids_destroy(qm_solids *cache)
{
    if (!cache) return;
    pthread_mutex_destroy(&cache->lock);
    free(cache);
}

void qm_solids_forget(qm_solids *cache)
{
    pthread_mutex_lock(&cache->lock);
    cache->is_known[0] = cache->is_known[1] = false;
    pthread_mutex_unlock(&cache->lock);
}

static bool recall(qm_solids *cache, qm_quad_reading reading, qm_solid *out)
{
    pthread_mutex_lock(&cache->lock);
    bool is_known = cache->is_known[reading];
    *out = cache->solid[reading];
    pthread_mutex_unlock(&cache->lock);
    return is_known;
}

qm_status qm_solids_check(qm_solids *cache, qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading,
                          int thread_count, qm_solid *out)
{
    if (cache && recall(cache, reading, out)) return QM_OK;
    qm_status status = qm_solid_check(ctx, bvh, reading, thread_count, out);
    if (status != QM_OK || !cache) return status;
    pthread_mutex_lock(&cache->lock);
    cache->solid[reading] = *out;
    cache->is_known[reading] = true;
    pthread_mutex_unlock(&cache->lock);
    return QM_OK;
}
