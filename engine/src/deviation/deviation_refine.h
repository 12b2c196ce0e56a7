/**
 * deviation_refine.h: the pieces of a source, cut in rounds until mean and rms are known closely enough.
 */
#ifndef QM_DEVIATION_REFINE_H
#define QM_DEVIATION_REFINE_H

#include <stdatomic.h>

#include "deviation_sum.h"

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
    qm_deviation_survey survey;             /* of the pieces when a round last began */
    size_t piece_capacity, bounds_capacity; /* allocated */
    size_t *todo;                           /* the pieces to cut, todo_capacity allocated */
    size_t todo_count, todo_capacity;
    size_t begin, end;    /* the batch: todo[begin] to todo[end - 1] */
    qm_batch_part *parts; /* of each piece of the batch */
    atomic_size_t next;   /* piece to bound, or index in todo */

    double flat_slack; /* how far patches may be from the triangles that stand for them, in the mean */
    bool has_area;     /* rounding does not hide whether the source has an area at all */
    bool is_accurate;
    _Atomic uint64_t searches;
    void (*on_survey)(void *user); /* called when a round of cuts begins; NULL: nobody */
    void *user;
} qm_refinement;

/** Makes room for count pieces. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_refinement_reserve(qm_refinement *work, size_t count);

static inline qm_deviation_piece_list qm_refinement_list(const qm_refinement *work)
{
    return (qm_deviation_piece_list){work->bounds, work->count, work->leak, work->farthest};
}

/** Sets up the data of a source and a target, and a survey of nothing. As qm_deviation_setup_init. */
qm_status qm_refinement_init(qm_refinement *work, const qm_bvh *a, const qm_bvh *b, qm_quad_reading reading);

/** Surveys the pieces, or points. QM_OK or QM_E_CANCELED, which leaves the last survey. */
qm_status qm_refinement_survey(qm_refinement *work);

/**
 * Makes a piece of each triangle of the source, bounds them, and cuts them in rounds, if they have an area.
 *
 * vertex_distance  of all vertices of the source, in the unit of the meshes
 *
 * Returns QM_OK, also when the pieces ran out before the accuracy was reached; QM_E_NO_MEMORY; QM_E_CANCELED,
 * and the survey holds.
 */
qm_status qm_refinement_run(qm_refinement *work, const double *vertex_distance);

/**
 * Cuts the pieces with a mark, and bounds their parts: the first part takes the place of its piece, the others follow the pieces that
 * there are. Cuts only as many as there is room for; then *count is less than that of the marks. The survey is not of the parts.
 *
 * Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED, and each piece is whole or replaced by all of its parts.
 */
qm_status qm_refinement_cut(qm_refinement *work, const uint8_t *marks, size_t *count);

#define QM_OPEN_SHARE 0.5 /* of the accuracy: may be left in open pieces */
#define QM_NOT_OPEN -1.0

/** How much an open piece leaves open, as a share of all; QM_NOT_OPEN of the others. */
typedef double qm_refinement_open_fn(const void *user, size_t piece);

/** Called after each round, also one that failed, with a mark of each piece that was to be cut, of as many as there were before. */
typedef qm_status qm_refinement_after_fn(const void *user, const uint8_t *marks, size_t count);

/**
 * Cuts open pieces, those that leave more open than their part of QM_OPEN_SHARE, until there are none, or no room. after may be NULL.
 * The survey is not of the parts.
 *
 * Returns as qm_refinement_cut, or the status of after.
 */
qm_status qm_refinement_cut_open(qm_refinement *work, qm_refinement_open_fn *find_open,
                                 qm_refinement_after_fn *after, const void *user);

/** Frees the arrays. */
void qm_refinement_reset(qm_refinement *work);

#endif
