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
#include "qm/solid.h"

/**
 * How the sides of B are told from one another, and which distances count as positive.
 *
 * With OUTSIDE and INSIDE the side is proven: B must bound a solid (solid.h). A piece of A whose distance is above 0 does not meet B, so
 * that all of it is on one side, which one exact winding number tells. With NORMAL it is the side that the normal of the nearest face
 * points to, for targets that are open: nothing proves it, and pieces that reach round the rim of B are on the side of their centroid.
 */
typedef enum qm_sign {
    QM_SIGN_NONE,    /* distances are not signed */
    QM_SIGN_OUTSIDE, /* positive outside of B */
    QM_SIGN_INSIDE,  /* positive inside of B */
    QM_SIGN_NORMAL   /* positive where the normals of B point to */
} qm_sign;

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
    size_t worst_count;  /* worst places that are searched; 0: none */
    double worst_radius; /* >= 0, unit of the meshes: they are farther apart than this */
    int thread_count;    /* 1 or more */
    qm_sign sign;
    const qm_solid
        *solid; /* what qm_solid_check says of B with this reading of quads; NULL: the call checks B itself */
    const qm_interval
        *band; /* band_count ranges of signed distances, lower <= upper; either end may be infinite */
    size_t band_count;
    double region_limit;                /* >= 0: regions beyond it are found; NAN: none */
    size_t face_limit;                  /* faces that are listed of each region */
    qm_hausdorff_progress_fn *progress; /* bounds of the maximum, from those by boxes on; NULL: none */
    void *progress_user;
} qm_deviation_options;

/** Triangles, accuracy 1e-2, tolerance 0 (to be set), 2^20 pieces, no percentiles, no bins, one thread, no sign, no limit. */
qm_deviation_options qm_deviation_options_default(void);

/** A place of A that is far from B. No point of A farther than the radius from the places before it is farther from B
 * than upper; from is farther than lower, to within the rounding of its coordinates. */
typedef struct qm_deviation_place {
    double lower, upper;
    qm_surface_point from, to; /* on A; the nearest point of B */
} qm_deviation_place;

typedef enum qm_measure { QM_OVER_AREA, QM_OVER_VERTICES, QM_OVER_POINTS } qm_measure;

/** The part of A on one side of B. */
typedef struct qm_deviation_side {
    qm_interval max;  /* of the distance there; 0 to 0 where no point of A is proven or possible there */
    qm_interval size; /* area, or count */
    /* A point of A, surely on this side, whose distance is max.lower or more, and its foot on B. */
    bool has_witness;
    qm_surface_point from, to;
} qm_deviation_side;

/** What sign and bands add. Parts of A that are not proven to be on a side, as they touch B or pass through it, count as either in every
 * interval. */
typedef struct qm_signed_deviation {
    bool is_proven;                  /* the sides are; the sign is not NORMAL */
    qm_interval mean;                /* of the signed distance */
    qm_deviation_side front, behind; /* outside and inside of B; with NORMAL, before and behind its faces */
    double open_size;                /* how much of A is on neither side for sure, at most */
    qm_interval *band;               /* shares of A with a signed distance in each band */
    size_t band_count;
} qm_signed_deviation;

/**
 * A connected part of A that may be farther from B than the limit. Each connected part of A that is farther lies in one region, and
 * regions are apart. Parts of A are connected where they touch: in a face, or at a corner or an edge that faces share (corners at
 * equal positions are shared).
 */
typedef struct qm_deviation_region {
    size_t parts;     /* connected parts that are surely beyond the limit; 0: nothing is sure */
    qm_interval area; /* of what is beyond the limit */
    qm_interval max;  /* of the distance */
    bool has_witness; /* from: a point at least max.lower away; to: its foot */
    qm_surface_point from, to;
    double centroid[3]; /* of the pieces that may be beyond, rounded */
    qm_box box;         /* that holds them */
    size_t
        face_count; /* faces of A that they are on, in the numbering of the input; the first ones are listed */
    size_t first_face; /* in region_face */
    size_t listed_faces;
} qm_deviation_region;

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
    qm_signed_deviation sides; /* with a sign only */
    bool has_regions;
    qm_deviation_region
        *region;           /* region_count, the farthest first; with a limit, and NULL when there are none */
    uint32_t *region_face; /* ascending for each region */
    size_t region_count, region_face_count;
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
 *            then by its pieces; QM_E_ARGUMENT (accuracy, tolerance, percentiles, bands, limits, radius, threads);
 *            QM_E_NOT_CLOSED (a sign that B cannot prove; the message names what is in the way);
 *            QM_E_UNSUPPORTED (a limit, and A has no area); QM_E_NO_MEMORY;
 *            QM_E_SCALE. After an error *out is all zero.
 */
qm_status qm_deviation_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                               const qm_deviation_options *options, qm_deviation *out);

void qm_deviation_reset(qm_context *ctx, qm_deviation *deviation);

#endif
