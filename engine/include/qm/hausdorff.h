/**
 * hausdorff.h: the Hausdorff distance between two surfaces, as an interval that is proven to contain it.
 *
 * h(A, B) is the maximum distance of points of A from the surface B; H(A, B) is the larger of h(A, B) and
 * h(B, A). The search is a branch and bound: it keeps pieces of A in a priority queue by their upper bounds,
 * splits the first, and ends when no piece can contain a point farther than the cutoff, the best distance
 * found plus the tolerance. Both bounds hold at any time.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, chapter 5 (pieces in
 * one queue, matching); Tang, Lee, Kim, Interactive Hausdorff distance computation for general polygonal
 * models, 2009.
 */
#ifndef QM_HAUSDORFF_H
#define QM_HAUSDORFF_H

#include "qm/bvh.h"
#include "qm/project.h"

typedef enum qm_direction { QM_TWO_SIDED, QM_A_TO_B, QM_B_TO_A } qm_direction;

/** Methods to bound a piece of the source from above. Both are proven; they differ in how fast they become
 * tight. */
typedef enum qm_bounds {
    QM_BOUNDS_COVER,   /* covers a piece by subpolygons, each near one of many facets around it */
    QM_BOUNDS_MATCHING /* matches a piece to the facets under its corners: chapter 5 of the source */
} qm_bounds;

/** Why a search ended. */
typedef enum qm_hausdorff_stop {
    QM_STOP_CONVERGED, /* upper - lower <= tolerance */
    QM_STOP_THRESHOLD, /* the verdict against the threshold is certain */
    QM_STOP_DEADLINE,  /* deadline_ms or work_limit is used up */
    QM_STOP_CANCELED,  /* the context's flag was raised */
    QM_STOP_PRECISION, /* the tolerance is below what double precision can prove here */
    QM_STOP_WORK,      /* the default limit of iterations was reached, see QM_HAUSDORFF_BASE_WORK */
    QM_STOP_MEMORY     /* the queue would exceed memory_limit, or the allocator failed */
} qm_hausdorff_stop;

/** The verdict of a search about the distance and the threshold. */
typedef enum qm_verdict {
    QM_VERDICT_BELOW = -1, /* the distance is at most the threshold */
    QM_VERDICT_OPEN = 0,   /* not certain yet, or there is no threshold */
    QM_VERDICT_ABOVE = 1   /* the distance is larger than the threshold */
} qm_verdict;

/** The mesh on which the witness point lies; the other one holds its projection. */
typedef enum qm_hausdorff_side { QM_HAUSDORFF_FROM_A, QM_HAUSDORFF_FROM_B } qm_hausdorff_side;

/**
 * The default limit of iterations: QM_HAUSDORFF_BASE_WORK, and QM_HAUSDORFF_FACE_WORK for each face of the
 * meshes in each direction. Ordinary meshes need less than one iteration for two faces. More are needed only
 * where surfaces nearly coincide and no cover fits well, such as folded patches of two meshes whose grids do
 * not match.
 */
#define QM_HAUSDORFF_BASE_WORK 16384
#define QM_HAUSDORFF_FACE_WORK 32

/** The default limit of a search: see QM_HAUSDORFF_BASE_WORK. */
uint64_t qm_hausdorff_default_work(const qm_bvh *a, const qm_bvh *b, qm_direction direction);

/** The default memory limit: bytes that the queues of a search take at most. */
#define QM_HAUSDORFF_MEMORY ((size_t)1 << 30)

/** The state of a search: bounds in the unit of the meshes, valid now; later ones are never wider. */
typedef struct qm_hausdorff_progress {
    double elapsed_ms;
    double lower, upper;  /* upper is INFINITY until a first bound is known */
    uint64_t iterations;  /* nodes, packs and parts of faces visited so far; overlays count by their time */
    uint64_t projections; /* nearest-point searches so far */
    size_t queue_count;   /* pieces and nodes in the queues */
} qm_hausdorff_progress;

/** Called on one thread at a time: at the first bounds, at each halving of the gap, and at least every 100
 * ms. */
typedef void qm_hausdorff_progress_fn(void *user, const qm_hausdorff_progress *progress);

/** Bytes of a piece at most. */
#define QM_HAUSDORFF_PIECE_SIZE 160

/**
 * A part of a search: a node of a source's tree, a pack of it (level 0), or a piece of a face of a pack, with what a call has
 * proved of it. Its bound has no margin for roundings. Parts mean the same to every call on trees of the same arrays that were
 * built alike and with the same way of bounding, also in another process of the same version; not to a tree that was refitted.
 */
typedef struct qm_hausdorff_part {
    double upper;        /* no point of the part is farther, but for points that a search has discarded */
    uint32_t index;      /* in the level; of a piece: its pack */
    uint32_t hint;       /* a pack of the target; the nearer, the faster */
    uint8_t side, level; /* side 0 is the first direction of the search, 1 the second */
    uint8_t piece_size;  /* 0: all of the node; else the bytes of a piece, */
    unsigned char piece[QM_HAUSDORFF_PIECE_SIZE]; /* which only the engine reads */
} qm_hausdorff_part;

/** Called on one thread at a time, with the largest distance that one thread of this search has found (-1: none
 * yet): returns the largest lower bound that the caller knows, or 0. Neither has a margin. */
typedef double qm_hausdorff_exchange_fn(void *user, double found_lower);

/** Called at the end, on the calling thread, for each part that is left. A node may come several times, and a pack beside pieces
 * of it: it is one part with the largest of these bounds, and stands for its pieces. Pieces may be given back as their pack,
 * with the largest of their bounds: what was proved of the rest of the pack is then lost. */
typedef void qm_hausdorff_rest_fn(void *user, const qm_hausdorff_part *part);

/**
 * A search in parts: several calls divide the work of one. Let L be the largest found_lower of all calls so far,
 * D the largest `discarded`, and P the parts that no call has ended yet: to begin with those that a call on all of
 * the sources left, or all nodes of a level with an upper bound of INFINITY. Then, with m the margin,
 *     max(0, L - m) <= h <= max(L, D, upper of each part of P) + m.
 * A call that begins with parts from P is given L, or less, as known_lower; when it has ended, its parts leave
 * P, its rest joins P, and found_lower and `discarded` join L and D: all four at once, or none, so that a call
 * that is lost, or made twice, does no harm. Source: the invariant of branch and bound for a union of regions.
 *
 * Of a call that begins with parts, `upper` and a verdict QM_VERDICT_BELOW are about these parts alone, in the
 * result and in progress; `lower` and QM_VERDICT_ABOVE hold for the sources if known_lower does.
 */
typedef struct qm_hausdorff_parts {
    const qm_hausdorff_part *begin; /* NULL: all of the sources */
    size_t count;
    double known_lower;                 /* 0 or more, without margin; 0: none */
    qm_hausdorff_exchange_fn *exchange; /* NULL: none; called as often as limits are checked */
    qm_hausdorff_rest_fn *rest;         /* NULL: none */
    void *user;
} qm_hausdorff_parts;

typedef struct qm_hausdorff_options {
    qm_direction direction;
    qm_quad_reading quads;
    double tolerance;           /* > 0, unit of the meshes */
    double threshold;           /* >= 0: stop once the verdict is certain; NAN: none */
    double deadline_ms;         /* > 0: stop after this time; 0: none */
    uint64_t work_limit;        /* > 0: stop after this many iterations; 0: the default limit */
    size_t memory_limit;        /* > 0: bytes that the queues may take; 0: QM_HAUSDORFF_MEMORY */
    int thread_count;           /* 1 or more */
    qm_accelerator accelerator; /* of nearest points; one that has to be built is built by the call */
    const qm_tetra *tetra[2];   /* over a and over b, for QM_ACCELERATOR_TETRA; NULL: the call builds them */
    qm_bounds bounds;
    qm_hausdorff_progress_fn *progress; /* NULL: none */
    void *progress_user;
    const qm_hausdorff_parts *parts; /* NULL: the search is not in parts */
} qm_hausdorff_options;

/** Two-sided, triangles, tolerance 0 (to be set), no threshold, no limits, one thread. */
qm_hausdorff_options qm_hausdorff_options_default(void);

typedef struct qm_hausdorff_result {
    double lower, upper; /* lower <= distance <= upper */
    qm_hausdorff_side from_side;
    /* witness, rounded to doubles: |from - to| is lower to within a fraction of the tolerance and the
       roundings of its coordinates */
    qm_surface_point from, to;
    bool has_witness; /* false only when no point of a source was measured */
    /* of a search in parts: the distance of the witness (-1: none) and the largest bound with which points were
       discarded, both without margin, and the margin */
    double found_lower, discarded, margin;
    uint64_t iterations, projections;
    size_t max_queue;
    double elapsed_ms;
    qm_hausdorff_stop stop;
    qm_verdict verdict;
} qm_hausdorff_result;

/**
 * Measures the distance between the meshes of two trees. Where both meshes have equal arrays, bit by bit, it
 * is 0 without a search, an accelerator or a progress report.
 *
 * Ownership: borrows every argument, keeps none.
 * Threads:   only reads the trees; splits its work with ctx->parallel.
 * Returns:   QM_OK, also when the search stopped early (out->stop says why; the bounds hold), for example
 *            when the queue ran out of memory; QM_E_ARGUMENT (tolerance, threshold, threads; a part that the
 *            trees do not have; a tree that was not built as a target); QM_E_UNSUPPORTED (the accelerator);
 *            QM_E_NO_MEMORY; QM_E_SCALE.
 */
qm_status qm_hausdorff_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                               const qm_hausdorff_options *options, qm_hausdorff_result *out);

#endif
