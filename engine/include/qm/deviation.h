/**
 * deviation.h: the distance of a surface A from a surface B: at A's vertices, and over all of A as mean, root
 * mean square, percentiles and histogram, each as an interval that is proven to contain the true value.
 *
 * Nothing is sampled. A is cut into pieces; over each piece the distance to B lies between two linear
 * functions, but for a subset of known size (deviation_piece.h has the proofs); their integrals and level
 * sets have closed forms. The pieces with the widest intervals are cut again until the accuracy is reached,
 * and the two functions differ by at most eight times as much, which is about the width of the percentiles'
 * intervals.
 *
 * The measure of the averages:
 *   a surface              its area, of folded patches once for each fold; faces without area then count
 *                          nothing
 *   a surface without area its vertices that faces use, with equal weights (segments and points: needles,
 *                          spikes)
 *   a point set            its points, with equal weights
 */
#ifndef QM_DEVIATION_H
#define QM_DEVIATION_H

#include "qm/hausdorff.h"

typedef struct qm_deviation_options {
    qm_quad_reading quads;
    double accuracy; /* > 0: mean and rms are narrowed until upper - lower <= accuracy * lower */
    /* > 0, unit of the meshes: width of the interval of the maximum; it stays wider when its search takes
       many times the usual work */
    double tolerance;
    size_t piece_limit;       /* pieces besides the initial ones, A's faces; 0: nothing is cut */
    const double *percentile; /* percentile_count numbers above 0, at most 100 */
    size_t percentile_count;
    size_t bin_count;    /* of the histogram */
    const double *limit; /* limit_count numbers of 0 or more, unit of the meshes */
    size_t limit_count;
    size_t worst_count;                 /* worst places that are searched; 0: none */
    double worst_radius;                /* >= 0, unit of the meshes: they are farther apart than this */
    int thread_count;                   /* 1 or more */
    qm_hausdorff_progress_fn *progress; /* of the search for the maximum; NULL: none */
    void *progress_user;
} qm_deviation_options;

/** Triangles, accuracy 1e-2, tolerance 0 (to be set), 2^20 pieces, no percentiles, no bins, one thread. */
qm_deviation_options qm_deviation_options_default(void);

/** A place of A that is far from B. No point of A farther than the radius from the places before it is farther from B
 * than upper; from is farther than lower, to within the rounding of its coordinates. */
typedef struct qm_deviation_place {
    double lower, upper;
    qm_surface_point from, to; /* on A; the nearest point of B */
} qm_deviation_place;

typedef enum qm_measure { QM_OVER_AREA, QM_OVER_VERTICES, QM_OVER_POINTS } qm_measure;

typedef struct qm_deviation {
    qm_measure measure;
    qm_interval size; /* the measure of A: area in square units, or the count of vertices or points */
    qm_interval mean, rms;
    qm_interval max;         /* over all of A, faces without area included */
    qm_interval *percentile; /* smallest x such that at least this percentage of A is within x */
    qm_interval *bin;        /* fractions of A, 0 to 1: bin i is [i, i + 1) * bin_width, the last closed */
    double bin_width;        /* max.upper / bin_count */
    qm_interval *share;      /* of A, within each limit, that distance included: 0 to 1 */
    double least;            /* no point of A is nearer to B than this */
    /* the worst places, the first one the witness of the maximum; fewer than requested where no more are found, and none
       after a cancelation */
    qm_deviation_place *worst;
    size_t limit_count, worst_count;
    double
        *vertex_distance; /* vertex_count: at every vertex of A, used by a face or not; NULL and 0 where the
                                call was canceled before all were known */
    size_t percentile_count, bin_count, vertex_count;
    size_t pieces;
    uint64_t projections; /* nearest-point searches, with those of the maximum */
    bool is_accurate;     /* the accuracy was reached, up to rounding */
    bool is_canceled;     /* the context's flag was raised before the end; the intervals hold */
    double elapsed_ms;
} qm_deviation;

/**
 * Measures the deviation of A from B.
 *
 * Ownership: borrows everything but *out, which is the caller's, for qm_deviation_reset in the same context.
 * Threads:   only reads the trees; splits its work with ctx->parallel.
 * Returns:   QM_OK, also when the pieces ran out before the accuracy was reached, or the call was canceled:
 *            its intervals are those that were known, first by the size of both meshes, then by A's vertices,
 *            then by its pieces; QM_E_ARGUMENT (accuracy, tolerance, percentiles, limits, radius, threads);
 *            QM_E_NO_MEMORY;
 *            QM_E_SCALE. After an error *out is all zero.
 */
qm_status qm_deviation_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                               const qm_deviation_options *options, qm_deviation *out);

void qm_deviation_reset(qm_context *ctx, qm_deviation *deviation);

#endif
