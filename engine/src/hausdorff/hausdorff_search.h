/**
 * hausdorff_search.h: the state that all workers of a search share.
 *
 * The search is a branch and bound. It keeps a lower bound, the largest distance of a point measured, and a
 * priority queue of parts of the source with an upper bound each. A part whose upper bound is at or below the
 * cutoff, the lower bound plus the tolerance, is discarded. See HAUSDORFF.md.
 */
#ifndef QM_HAUSDORFF_SEARCH_H
#define QM_HAUSDORFF_SEARCH_H

#include <stdatomic.h>
#include <threads.h>

#include "core/clock.h"
#include "hausdorff_queue.h"
#include "hausdorff_side.h"
#include "qm/hausdorff.h"

#define QM_CACHE_LINE 64

/** Value of qm_search.stop beside the reasons of qm_hausdorff_stop. */
enum { QM_SEARCH_RUNNING = -1 };

/** The state that all workers share. Several threads write lower and the members below it that say so; the
 * others are set before the threads start. */
typedef struct qm_search {
    qm_side side[2];
    int side_count;
    const qm_kernel *kernel;
    double eta;           /* the error of a computed distance is at most this, world units */
    double tolerance;     /* of the search itself: the caller's less the rounding margins */
    double floor;         /* bounds at or below this need not be improved (threshold), or 0 */
    _Atomic double lower; /* largest certified distance of a point of a source so far; only rises */
    atomic_int stop;      /* QM_SEARCH_RUNNING, or the first reason to stop that a worker saw */
    int worker_count;
    struct qm_worker *workers;
    const qm_hausdorff_options *options;
    bool is_queued; /* the queues hold all of the source; before that they do not bound the distance */
    uint64_t work_limit;
    qm_hausdorff_stop work_stop; /* the reason reported when work_limit is reached */
    size_t memory_limit;         /* of one worker's queue */
    double start_ms;
    double reported_ms, reported_gap, reported_upper; /* guarded by reporting */
    /* Written all the time, so on another cache line than the members that every worker reads. */
    _Alignas(QM_CACHE_LINE) atomic_int busy_count; /* workers that hold an entry which is in no queue */
    atomic_flag reporting; /* held by the worker that reports progress or checks the limits */
    _Atomic uint64_t iterations, projections;
} qm_search;

/** The cutoff, world units: a part of a source with an upper bound at or below it may be discarded. */
static inline double qm_search_cutoff(const qm_search *search)
{
    double lower = atomic_load_explicit(&search->lower, memory_order_relaxed);
    return fmax(lower + search->tolerance, search->floor);
}

/** Raises the lower bound; false when it was as large already. */
static inline bool qm_search_raise_lower(qm_search *search, double lower)
{
    double before = atomic_load_explicit(&search->lower, memory_order_relaxed);
    while (lower > before && !atomic_compare_exchange_weak(&search->lower, &before, lower))
        continue;
    return lower > before;
}

/** The lower bound in the local space of a side. */
static inline double qm_search_local_lower(const qm_search *search, const qm_side *side)
{
    return atomic_load_explicit(&search->lower, memory_order_relaxed) * side->scale;
}

/** True when pieces are bounded by matching. */
static inline bool qm_search_is_matching(const qm_search *search)
{
    return search->options->bounds == QM_BOUNDS_MATCHING;
}

#endif
