/**
 * store_parts.h: a search that is kept in parts, so that several processes may run it and none loses it: its bounds,
 * and the parts that are left. The store knows nothing of what an entry of a part is.
 *
 * Let L be the lower bound, D the largest upper bound that was discarded, u(p) the upper bound of a part p. The owner of
 * the job opens the parts with L and D such that no point is farther than max(L, D, max u(p)). Each verb is one step and keeps this true, if
 * the caller of qm_store_finish_parts does: in place of what it takes away it gives a rest and a D that cover it.
 *   - A part whose process dies is still there, with its u(p): it is claimed again.
 *   - A part that two processes run is taken away once: each claim raises its epoch, the other finish is LOST.
 *   - L is a fact about two meshes, whoever found it: it needs no lease, and a late or repeated raise is a maximum.
 *   - u(p) of a rest is no larger than that of its part, so the upper bound only falls, and L only rises.
 * Rows of a search go with the end of its job, in the same step.
 */
#ifndef QM_STORE_PARTS_H
#define QM_STORE_PARTS_H

#include "store.h"

#define QM_STORE_ENGINE_SIZE 96
#define QM_STORE_WITNESS_SIZE 400
#define QM_STORE_REST_PARTS 8   /* of a call to finish, at most */
#define QM_STORE_PART_CLAIMS 64 /* parts that one call claims, at most */

typedef struct qm_store_part {
    int64_t number; /* given by the store */
    int64_t epoch;  /* claims so far */
    double upper;
    void *entries; /* of a claimed part from malloc, for qm_store_parts_reset */
    size_t size;   /* bytes */
} qm_store_part;

typedef struct qm_store_bounds {
    char engine[QM_STORE_ENGINE_SIZE];   /* who may run its parts */
    double lower;                        /* raw, as the engine's found_lower; 0: none */
    char witness[QM_STORE_WITNESS_SIZE]; /* of the lower bound */
    double discarded;
    uint64_t iterations, projections; /* of all runs that counted */
    /* Only read: */
    double upper;  /* max of the parts' */
    double others; /* the same without those that the caller names */
    size_t parts;  /* that are left */
    size_t nodes;  /* that run some of them */
} qm_store_bounds;

/**
 * Keeps the search of a job that this process runs, at a restart. Parts of another engine are replaced; when there are some of
 * this one, nothing changes. QM_STORED_LOST: this process does not run the job.
 */
qm_stored qm_store_open_parts(qm_store *store, const char *job, int64_t restarts,
                              const qm_store_bounds *bounds, const qm_store_part *parts, size_t count);

/** Claims up to limit parts that no other living process has, those with the greatest upper bounds. */
qm_stored qm_store_claim_parts(qm_store *store, const char *job, size_t limit, qm_store_part *out,
                               size_t *count);

/**
 * Replaces claimed parts by what is left of them, at most QM_STORE_REST_PARTS, and joins what their run has found: discarded, lower with
 * its witness, and counts. All or nothing. QM_STORED_LOST: not all of them are at the epoch of the claim, as after an equal
 * call, or the job has ended.
 */
qm_stored qm_store_finish_parts(qm_store *store, const char *job, const qm_store_part *parts, size_t count,
                                const qm_store_bounds *found, const qm_store_part *rest, size_t rest_count);

/** Raises the lower bound, if it is less. QM_STORED_NONE: the job has no bounds. */
qm_stored qm_store_raise_lower(qm_store *store, const char *job, double lower, const char *witness);

/** Reads the bounds of a search as of one moment; `claimed` are parts that `others` leaves out. */
qm_stored qm_store_read_bounds(qm_store *store, const char *job, const qm_store_part *claimed, size_t count,
                               qm_store_bounds *out);

/**
 * Finds a job of a shared store with a part that no living process has, which another node runs, or none; not one of
 * those with the ids `except`. QM_STORED_NONE: there is none, as of an embedded store always.
 */
qm_stored qm_store_find_split_job(qm_store *store, const char (*except)[QM_ID_SIZE], size_t count,
                                  qm_store_job *out);

/** Frees the entries of claimed parts. */
void qm_store_parts_reset(qm_store_part *parts, size_t count);

#endif
