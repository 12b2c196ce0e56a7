/**
 * deviation_refine.h: the pieces of a source, cut in rounds until mean and rms are known closely enough.
 */
#ifndef QM_DEVIATION_REFINE_H
#define QM_DEVIATION_REFINE_H

#include <stdatomic.h>

#include "deviation_sum.h"

/** A piece to cut, and its uncertainty. */
typedef struct qm_open_piece {
    size_t index;
    double open;
} qm_open_piece;

/** Parts of one piece. */
typedef struct qm_batch_part qm_batch_part;

/** All zero but for the members that the caller sets: down to thread_count. */
typedef struct qm_refinement {
    qm_context *ctx;
    qm_deviation_setup setup;
    double accuracy;
    double typical;     /* an estimate of the mean, local */
    size_t piece_limit; /* besides those that the source's faces make */
    int thread_count;

    qm_deviation_piece *piece; /* count of them, and their bounds */
    qm_deviation_bounds *bounds;
    size_t count, limit;
    double leak, farthest;                  /* see qm_deviation_piece_list */
    size_t piece_capacity, bounds_capacity; /* allocated */
    qm_open_piece *todo;                    /* the pieces to cut, todo_capacity allocated */
    size_t todo_count, todo_capacity;
    size_t begin, end;    /* the batch: todo[begin] to todo[end - 1] */
    qm_batch_part *parts; /* of each piece of the batch */
    atomic_size_t next;   /* piece to bound, or index in todo */

    double flat_slack; /* how far patches may be from the triangles that stand for them, in the mean */
    bool has_area;     /* rounding does not hide whether the source has an area at all */
    bool is_accurate, is_canceled;
    _Atomic uint64_t searches;
} qm_refinement;

/** Makes room for count pieces. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_refinement_reserve(qm_refinement *work, size_t count);

static inline qm_deviation_piece_list qm_refinement_list(const qm_refinement *work)
{
    return (qm_deviation_piece_list){work->bounds, work->count, work->leak, work->farthest};
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
