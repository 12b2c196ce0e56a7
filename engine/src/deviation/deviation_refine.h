/**
 * deviation_refine.h: the pieces of a source, cut in rounds until mean and rms are known closely enough.
 */
#ifndef QM_DEVIATION_REFINE_H
#define QM_DEVIATION_REFINE_H

#include <stdatomic.h>

#include "deviation_choose.h"

/** Parts of one piece. */
typedef struct qm_batch_part qm_batch_part;

/** Set up all zero but for the first few members. */
typedef struct qm_refinement {
    qm_context *ctx;
    qm_piece_maker maker;
    double accuracy;
    double typical;     /* about what the mean will be, local */
    size_t piece_limit; /* besides those that the source's faces make */
    int thread_count;

    qm_source_piece *piece; /* count of them, and their bounds */
    qm_piece_bounds *bounds;
    size_t count, limit;
    double leak, farthest;                  /* see qm_piece_list */
    size_t piece_capacity, bounds_capacity; /* allocated */
    qm_open_piece *todo;                    /* the pieces to cut, todo_capacity allocated */
    size_t todo_count, todo_capacity;
    size_t begin, end;    /* the batch: todo[begin] to todo[end - 1] */
    qm_batch_part *parts; /* of each piece of the batch */
    atomic_size_t next;   /* piece to bound, or place of todo */

    double flat_slack; /* how far patches may be from the triangles that stand for them, in the mean */
    bool has_area;     /* rounding does not hide whether the source has an area at all */
    bool is_accurate, is_canceled;
    _Atomic uint64_t searches;
} qm_refinement;

/** Room for so many pieces. */
qm_status qm_refinement_reserve(qm_refinement *work, size_t count);

static inline qm_piece_list qm_refinement_list(const qm_refinement *work)
{
    return (qm_piece_list){work->bounds, work->count, work->leak, work->farthest};
}

/**
 * Makes a piece of each triangle of the source, bounds them, and cuts them in rounds, if they have an area.
 *
 * Returns QM_OK, also when the pieces ran out before the accuracy was reached, and when the call is canceled
 * once each piece has bounds (is_canceled); QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_refinement_run(qm_refinement *work);

/** Frees the arrays. */
void qm_refinement_reset(qm_refinement *work);

#endif
