/**
 * store_parts.c: the verbs on parts of searches, each of which the driver does.
 */
#include "store_parts.h"

#include <stdlib.h>

#include "store_driver.h"

qm_stored qm_store_open_parts(qm_store *store, const char *job, int64_t restarts,
                              const qm_store_bounds *bounds, const qm_store_part *parts, size_t count)
{
    QM_STORE_RETURN_VERB(store, open_parts, store, job, restarts, bounds, parts, count);
}

qm_stored qm_store_claim_parts(qm_store *store, const char *job, size_t limit, qm_store_part *out,
                               size_t *count)
{
    QM_ASSERT(limit <= QM_STORE_PART_CLAIMS);
    *count = 0;
    QM_STORE_RETURN_VERB(store, claim_parts, store, job, limit, out, count);
}

qm_stored qm_store_finish_parts(qm_store *store, const char *job, const qm_store_part *parts, size_t count,
                                const qm_store_bounds *found, const qm_store_part *rest, size_t rest_count)
{
    QM_ASSERT(rest_count <= QM_STORE_REST_PARTS);
    QM_STORE_RETURN_VERB(store, finish_parts, store, job, parts, count, found, rest, rest_count);
}

qm_stored qm_store_raise_lower(qm_store *store, const char *job, double lower, const char *witness)
{
    QM_STORE_RETURN_VERB(store, raise_lower, store, job, lower, witness);
}

qm_stored qm_store_read_bounds(qm_store *store, const char *job, const qm_store_part *claimed, size_t count,
                               qm_store_bounds *out)
{
    *out = (qm_store_bounds){0};
    QM_STORE_RETURN_VERB(store, read_bounds, store, job, claimed, count, out);
}

qm_stored qm_store_find_split_job(qm_store *store, const char (*except)[QM_ID_SIZE], size_t count,
                                  qm_store_job *out)
{
    if (!qm_store_is_shared(store)) return QM_STORED_NONE;
    QM_STORE_RETURN_VERB(store, find_split_job, store, except, count, out);
}

void qm_store_parts_reset(qm_store_part *parts, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        free(parts[i].entries);
        parts[i].entries = NULL;
    }
}
