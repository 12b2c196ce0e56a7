/**
 * align.h: finds the motion that brings a mesh A onto a mesh B.
 *
 * Least squares makes the root mean square of the distance of A from B small: Gauss-Newton steps on points of A, which are
 * projected anew for each. Min-max makes the Hausdorff distance itself small: its witnesses are kept, and each step lowers
 * the largest distance of all of them. Both are local searches, from several starts; the motion is not proven to be the
 * best one. What is proven is the floor: no rigid motion brings the meshes nearer. The distance after the motion is a
 * question for qm_hausdorff_measure on the moved mesh.
 *
 * Nothing is random: the same meshes give the same motion, to the last bit, for each number of threads.
 *
 * Source: Chen, Medioni, Object modeling by registration of multiple range images, 1992 (point to plane); Chetverikov,
 * Stepanov, Krsek, Robust Euclidean alignment of 3D point sets, 2005 (trimming); Horn, Closed-form solution of absolute
 * orientation using unit quaternions, 1987 (landmarks).
 */
#ifndef QM_ALIGN_H
#define QM_ALIGN_H

#include "qm/hausdorff.h"
#include "qm/transform.h"

/** What a motion makes small. */
typedef enum qm_align_fit { QM_ALIGN_LEAST_SQUARES, QM_ALIGN_MIN_MAX } qm_align_fit;

/** Where the search starts. */
typedef enum qm_align_start {
    QM_ALIGN_PRINCIPAL, /* centroids and principal axes in 24 turns, and 60 turns that lie evenly; centroids; identity */
    QM_ALIGN_CENTROIDS, /* the centroid of A on that of B */
    QM_ALIGN_IDENTITY,  /* where A lies */
    QM_ALIGN_LANDMARKS  /* the motion that brings given points of A nearest to given points of B */
} qm_align_start;

typedef enum qm_align_motion {
    QM_ALIGN_RIGID,       /* turn and shift */
    QM_ALIGN_RIGID_SCALE, /* turn, shift and one scale above 0 */
    QM_ALIGN_TRANSLATION  /* shift */
} qm_align_motion;

/** A point of A and the point of B that it belongs to. */
typedef struct qm_align_landmark {
    double a[3], b[3];
} qm_align_landmark;

/** Points of A that are measured by default. */
#define QM_ALIGN_SAMPLES 16384
#define QM_ALIGN_MIN_SAMPLES 100
#define QM_ALIGN_MAX_SAMPLES 10000000

typedef struct qm_align_options {
    qm_align_fit fit;
    qm_align_start start;
    qm_align_motion motion;
    qm_direction
        direction; /* distances that count. A_TO_B: of A from B, so that A may be a part of B. Scaling needs
                               TWO_SIDED, as A could shrink to a point of B else */
    qm_quad_reading quads;
    const qm_align_landmark
        *landmarks; /* for QM_ALIGN_LANDMARKS: 1 or more; a turn needs 3 that are not on a line */
    size_t landmark_count;
    double trim; /* the share of points, the farthest ones, that do not count: 0 to 0.9; not for min-max */
    double
        max_distance; /* > 0: farther points do not count at the end; INFINITY: all count; not for min-max */
    bool may_mirror;  /* a mirror image is taken when it is nearer */
    size_t sample_count; /* QM_ALIGN_MIN_SAMPLES to QM_ALIGN_MAX_SAMPLES */
    int thread_count;    /* 1 or more */
} qm_align_options;

/** Least squares from the principal axes, rigid, A to B, triangles, all points count, no mirror, one thread. */
qm_align_options qm_align_options_default(void);

typedef struct qm_align_result {
    double transform[QM_TRANSFORM_SIZE];
    double rms; /* of the distances that count, over the points that were measured; unit of B */
    double
        runner_up_rms; /* of the best start that ended with A elsewhere; near rms: A fits in two ways. NAN: none */
    double scale;      /* of the motion; 1 unless it scales */
    double floor;      /* see qm_align_floor; 0 when the motion scales */
    uint32_t iterations; /* steps of all starts */
    uint32_t rounds;     /* measured Hausdorff distances; of min-max */
    bool is_mirrored;
    bool is_converged; /* it ended as steps became smaller than roundings, or no step helped */
    double elapsed_ms;
} qm_align_result;

/**
 * Finds the motion.
 *
 * a, b  were built with QM_BVH_TARGET, and QM_BVH_PATCHES for bilinear quads; a may be a source alone where only
 *       distances of A from B count
 *
 * Ownership: borrows every argument, keeps none.
 * Threads:   only reads the trees; splits its work with ctx->parallel.
 * Returns:   QM_OK; QM_E_ARGUMENT (options; landmarks of which none or too few are given, or that lie on a line;
 *            ctx->message says which); QM_E_SCALE; QM_E_NOT_FINITE (the motion overflows); QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_align_find(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, const qm_align_options *options,
                        qm_align_result *out);

/* ---- the floor ---- */

/** The smallest ball that contains a surface: its radius lies from lower to upper. */
typedef struct qm_align_ball {
    double center[3];
    double lower, upper;
} qm_align_ball;

/** Encloses the surface of a mesh that passes qm_mesh_validate: the ball of the vertices that faces use, as faces of both
 * readings lie in the convex hull of their corners. */
qm_status qm_align_enclose(qm_context *ctx, const qm_mesh *mesh, qm_align_ball *out);

/**
 * A lower bound of the Hausdorff distance (two-sided) of the two surfaces under every rigid motion of one of them, mirror
 * images too.
 *
 * Proof: a surface at the Hausdorff distance h of another lies in that one's ball enlarged by h, so their radii differ by at
 * most h, and a motion changes neither.
 */
double qm_align_floor(const qm_align_ball *a, const qm_align_ball *b);

#endif
