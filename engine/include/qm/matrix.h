/**
 * matrix.h: the distances of all pairs of a set, as intervals, with as few measurements as what is asked for needs.
 *
 * The items are those of a metric space, and the host measures a pair. The Hausdorff distance of surfaces and point sets is
 * such a metric: they are compact and not empty. So for any item p
 *     |d(a, p) - d(p, b)| <= d(a, b) <= d(a, p) + d(p, b),
 * and each measured pair bounds others. The first measured pairs are those of pivots, items that are far from each other,
 * chosen farthest first, as long as they decide several times as many pairs as they cost.
 *
 * Source: E. Vidal, An algorithm for finding nearest neighbours in (approximately) constant average time, 1986 (bounds from all
 * measured pairs); T. Gonzalez, Clustering to minimize the maximum intercluster distance, 1985 (farthest first).
 */
#ifndef QM_MATRIX_H
#define QM_MATRIX_H

#include "qm/mesh.h"

typedef enum qm_matrix_want {
    QM_MATRIX_ALL,     /* every distance to the tolerance */
    QM_MATRIX_NEAREST, /* of each item the nearest others, in order, their distances to the tolerance */
    QM_MATRIX_WITHIN   /* of each pair whether its distance is at most a limit */
} qm_matrix_want;

/** A pair that is to be measured: until upper - lower <= tolerance, or until the distance is known to be at most the threshold
 * or above it. */
typedef struct qm_matrix_question {
    size_t a, b; /* a < b */
    double tolerance;
    double threshold;   /* NAN: none */
    double deadline_ms; /* what is left; 0: no deadline */
} qm_matrix_question;

typedef struct qm_matrix_answer {
    double lower, upper; /* proven; the measurement may have ended with any width */
    bool is_stopped;     /* by the deadline or the context's flag */
} qm_matrix_answer;

/** Measures a pair; a status other than QM_OK ends the call. */
typedef qm_status qm_matrix_measure_fn(void *user, const qm_matrix_question *question, qm_matrix_answer *out);

typedef struct qm_matrix qm_matrix;

/** Called after each measurement, with the pair. */
typedef void qm_matrix_progress_fn(void *user, const qm_matrix *matrix, size_t a, size_t b);

typedef struct qm_matrix_options {
    size_t count;       /* items */
    const size_t *same; /* of each item the first one that equals it, or itself; NULL: none is known to */
    /* of each item its box, on the Hausdorff distance: the least box of a surface; NULL: the metric is another one */
    const qm_box *boxes;
    qm_matrix_want want;
    size_t nearest;     /* number of items in each list, of QM_MATRIX_NEAREST */
    double limit;       /* of QM_MATRIX_WITHIN, 0 or more */
    double tolerance;   /* above 0 */
    double deadline_ms; /* 0: none */
    qm_matrix_measure_fn *measure;
    qm_matrix_progress_fn *progress; /* NULL: none */
    void *user;                      /* first argument of both */
} qm_matrix_options;

typedef enum qm_matrix_stop { QM_MATRIX_DONE, QM_MATRIX_DEADLINE, QM_MATRIX_CANCELED } qm_matrix_stop;

struct qm_matrix {
    size_t count, pair_count; /* pair_count = count * (count - 1) / 2 */
    double *lower,
        *upper;      /* of each pair, see qm_matrix_pair; upper may be INFINITY when the call was stopped */
    uint8_t *state;  /* of each pair, for the call alone */
    size_t searched; /* pairs that were measured */
    size_t searches; /* measurements: a pair may need a second one that goes further */
    size_t bounded;  /* pairs that were not measured, as their bounds answer all that is asked of them */
    size_t pivots;
    size_t
        open; /* QM_MATRIX_ALL: pairs that are wider than the tolerance; QM_MATRIX_WITHIN: pairs without a verdict;
                    QM_MATRIX_NEAREST: lists with an item whose place is not certain, see qm_matrix_place */
    double elapsed_ms;
    qm_matrix_stop stop;
};

/** The index of a pair of two different items: row by row of the upper triangle, (0, 1), (0, 2) ... (count - 2, count - 1). */
static inline size_t qm_matrix_pair(size_t count, size_t a, size_t b)
{
    size_t first = a < b ? a : b, second = a < b ? b : a;
    return first * (2 * count - first - 1) / 2 + second - first - 1;
}

/**
 * Bounds the distances of all pairs. Every interval holds the distance, also when the call was stopped.
 *
 * Cost:    what is measured; and count steps for each measurement, count^2 log count for each pivot.
 * Returns: QM_OK with a matrix for qm_matrix_reset, also when it was stopped (out->stop); QM_E_ARGUMENT; QM_E_NO_MEMORY; or
 *          the status of a measurement. After an error *out needs no reset.
 */
qm_status qm_matrix_measure(qm_context *ctx, const qm_matrix_options *options, qm_matrix *out);

void qm_matrix_reset(qm_context *ctx, qm_matrix *matrix);

/** How certain the place of an item in a list of nearest items is. */
typedef enum qm_matrix_place {
    QM_MATRIX_PROVEN, /* no item before it is farther, and no item after it, or in no list, is nearer */
    QM_MATRIX_TIED,   /* not proven, and the distances of all items in question are known to the tolerance */
    QM_MATRIX_OPEN    /* neither */
} qm_matrix_place;

typedef struct qm_matrix_near {
    size_t item;
    double lower, upper;
    qm_matrix_place place;
} qm_matrix_near;

/** Lists the items that are nearest to one, by the upper bounds of their distances, then the lower bounds, then the
 * indices. There is room for count - 1 of them in out. Returns how many are listed: at most limit. */
size_t qm_matrix_list_nearest(const qm_matrix *matrix, size_t item, size_t limit, double tolerance,
                              qm_matrix_near *out);

/** Bounds on the Hausdorff distance of two surfaces by their least boxes. */
void qm_matrix_bound_by_boxes(const qm_box *a, const qm_box *b, double *lower, double *upper);

#endif
