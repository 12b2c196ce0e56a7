/**
 * job_kinds.h: requests and results of jobs as plain structs, and the call that executes a request. No HTTP, no JSON, no
 * store: the command line executes jobs in its own process through it.
 *
 * A kind of job is a row of QM_JOB_MAP, and a file of its own: the fields of its request, how it runs, and how its request
 * and result are written (job_kinds_internal.h).
 */
#ifndef QM_JOB_KINDS_H
#define QM_JOB_KINDS_H

#include "base/host.h"
#include "base/id.h"
#include "base/notes.h"
#include "base/scheduler.h"
#include "faced_surface.h"
#include "listed_pairs.h"
#include "problem.h"
#include "projections.h"
#include "qm/align.h"
#include "qm/comparison.h"
#include "qm/distance.h"
#include "qm/hausdorff.h"
#include "qm/heatmap.h"
#include "qm/matrix.h"
#include "refine.h"
#include "remesh.h"
#include "settle.h"

/** Limits of requests. */
#define QM_JOB_MAX_THREADS QM_HOST_MAX_THREADS
#define QM_JOB_MAX_PERCENTILES 64
#define QM_JOB_MAX_BANDS 64
#define QM_JOB_LISTED_REGIONS 1000
#define QM_JOB_LISTED_FACES 1000 /* of each region */
#define QM_JOB_MAX_LIMITS 64
#define QM_JOB_MAX_PLACES 100
#define QM_JOB_MAX_STEPS 64
#define QM_JOB_MAX_LANDMARKS 32
#define QM_JOB_MAX_PIECES 1e7
#define QM_JOB_MAX_BINS 1e4
#define QM_JOB_MAX_LISTED 1e5  /* pairs */
#define QM_JOB_MAX_MESHES 1000 /* of a matrix */
#define QM_JOB_MAX_NEAREST 100
#define QM_JOB_MIN_MEMORY 65536.0
#define QM_JOB_MAX_MEMORY 1099511627776.0

/** Names of the values of some fields, in the order of their enums, with NULL after the last. */
extern const char *const qm_job_kind_names[];        /* qm_job_kind */
extern const char *const qm_priority_names[];        /* qm_priority */
extern const char *const qm_direction_names[];       /* qm_direction */
extern const char *const qm_quads_names[];           /* qm_quad_reading */
extern const char *const qm_accelerator_names[];     /* qm_accelerator */
extern const char *const qm_bounds_names[];          /* qm_bounds, then the former name of the first */
extern const char *const qm_collide_mode_names[];    /* qm_collide_mode */
extern const char *const qm_align_fit_names[];       /* qm_align_fit */
extern const char *const qm_align_start_names[];     /* qm_align_start */
extern const char *const qm_align_motion_names[];    /* qm_align_motion */
extern const char *const qm_align_direction_names[]; /* qm_job_align_direction */
extern const char *const qm_gap_unit_names[];        /* qm_job_request.tolerance_is_absolute */
extern const char *const qm_sign_names[];            /* qm_sign */
extern const char *const qm_relation_names[];        /* qm_relation */

/** XX(suffix, name in "type"). */
#define QM_JOB_MAP(XX)                                                                                       \
    XX(HAUSDORFF, hausdorff)                                                                                 \
    XX(PROJECT, project)                                                                                     \
    XX(DEVIATION, deviation)                                                                                 \
    XX(COMPARISON, comparison)                                                                               \
    XX(HEATMAP, heatmap)                                                                                     \
    XX(DISTANCE, distance)                                                                                   \
    XX(COLLISION, collision)                                                                                 \
    XX(SELF_COLLISION, self_collision)                                                                       \
    XX(ALIGNMENT, alignment)                                                                                 \
    XX(MATRIX, matrix)                                                                                       \
    XX(RECONSTRUCTION_STEP, reconstruction_step)                                                             \
    XX(REMESH, remesh)

typedef enum qm_job_kind {
#define XX(suffix, name) QM_JOB_##suffix,
    QM_JOB_MAP(XX)
#undef XX
        QM_JOB_KIND_COUNT
} qm_job_kind;

/** A kind of job. */
typedef struct qm_job_type {
    const char *name;
    const char
        *mesh_field[2]; /* fields of the request that name its meshes; [1] is NULL for a kind of one mesh, and
                           both are for one of any number */
    bool is_pure;       /* the result depends on the request alone: that of an earlier job may be reused */
    bool is_anytime;    /* a search that is stopped has a result: the bounds that it has so far */
} qm_job_type;
const qm_job_type *qm_job_type_of(qm_job_kind kind);

/** Finds a kind by name; false if there is none. */
bool qm_job_kind_find(const char *name, qm_job_kind *out);

/** The long array in the results of a kind. */
typedef struct qm_job_array {
    const char *member; /* its name in JSON */
    const char *header; /* its first line in CSV, where a single column is preceded by an index */
    int columns;
} qm_job_array;

/** NULL for kinds without one. */
const qm_job_array *qm_job_array_of(qm_job_kind kind);

/** The object of a reconstruction_step, set by the caller of qm_job_execute. */
typedef struct qm_job_refinement {
    qm_reconstruction *reconstruction;
    const qm_ref_surface *source;
    qm_refine_fn *on_step; /* after each complete step */
    void *user;
} qm_job_refinement;

/** Who makes the engine's call of a Hausdorff job in place of qm_hausdorff_measure, and returns what that would; set by
 * the caller of qm_job_execute. */
typedef struct qm_job_search {
    qm_status (*measure)(void *user, qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                         const qm_hausdorff_options *options, qm_hausdorff_result *out);
    void *user;
} qm_job_search;

/** Where a mesh of a request lies: its positions moved by a transform, and rounded once. The map that moves nothing is never
 * given, so that it is no other request. */
typedef struct qm_job_pose {
    bool is_given;
    double transform[QM_TRANSFORM_SIZE];
} qm_job_pose;

/** True when both leave a mesh at the same place. */
bool qm_job_equal_poses(const qm_job_pose *a, const qm_job_pose *b);

/** How a request names a mesh: by its id, or until it is submitted by the hash of its file, after this prefix. */
#define QM_JOB_HASH_PREFIX "sha256:"
#define QM_JOB_MESH_SIZE (sizeof QM_JOB_HASH_PREFIX - 1 + QM_HASH_SIZE)

/** The hash in the name of a mesh; NULL when the name is an id. */
const char *qm_json_hash_of_name(const char *name);

/** True for the hash of a file as it is written in names: 64 digits, a to f among them. */
bool qm_json_is_hash(const char *text);

/** A mesh of a set. */
typedef struct qm_job_member {
    char name[QM_JOB_MESH_SIZE];
    qm_job_pose pose;
} qm_job_member;

/** Which distances an alignment counts: auto is both directions for a scale and for min-max, and those of A else. */
typedef enum qm_job_align_direction {
    QM_JOB_ALIGN_AUTO,
    QM_JOB_ALIGN_TWO_SIDED,
    QM_JOB_ALIGN_A_TO_B,
    QM_JOB_ALIGN_B_TO_A
} qm_job_align_direction;

/** Who has the meshes of a matrix; set by the caller of qm_job_execute. A mesh stays in memory between the two calls, of
 * which two or more may be open. A status other than QM_OK ends the job with it. */
typedef struct qm_job_set {
    qm_status (*acquire)(void *user, size_t index, const qm_loaded_mesh **out);
    void (*release)(void *user, size_t index);
    qm_matrix_progress_fn *progress; /* NULL: none */
    const size_t
        *same; /* of each mesh the first one with the same surface, or itself; NULL: none is known to */
    const double *uncertainty; /* of each mesh where it lies, once it was acquired; NULL: all are exact */
    void *user;
} qm_job_set;
/** A request; fields of other kinds keep their defaults. */
typedef struct qm_job_request {
    qm_job_kind kind;
    char a[QM_JOB_MESH_SIZE],
        b[QM_JOB_MESH_SIZE]; /* meshes (never file names); b is "" for a kind of one mesh */
    qm_notes notes[2];       /* of these, set by the caller of qm_job_execute */
    qm_job_pose pose[2];     /* of a and of b; whoever loads the meshes for qm_job_execute moves them */
    qm_quad_reading quads;
    int threads; /* 0: the host decides */
    bool detach; /* the job continues when the client that streams it disconnects */
    qm_priority priority;
    double deadline_ms; /* from submission on; 0: none */
    char *labels;       /* as of a mesh; malloc'ed, owned by the request; NULL: none */

    /* hausdorff, deviation and comparison for their maxima, distance, and collisions of bilinear quads */
    double tolerance;
    bool tolerance_is_absolute; /* else a fraction of the diagonal of A's box */

    double threshold; /* hausdorff, distance, deviation: the limit; NAN: none */

    /* hausdorff */
    qm_direction direction;
    size_t memory_limit; /* of the queue, bytes; 0: the host decides */
    qm_accelerator accelerator;
    qm_bounds bounds;
    const qm_job_search *search; /* NULL: none */

    /* project */
    double *points; /* x y z of each point; malloc'ed, owned by the request */
    size_t point_count;

    /* deviation and comparison; pieces of heatmap as well */
    double accuracy;
    size_t pieces, bins;
    double percentiles[QM_JOB_MAX_PERCENTILES];
    size_t percentile_count;
    qm_sign sign;
    qm_interval bands[QM_JOB_MAX_BANDS]; /* ends may be infinite */
    size_t band_count;
    bool regions; /* those beyond the limit */

    double error; /* heatmap: 0: a share of the diagonal */

    /* comparison; lengths in the unit of the meshes */
    double limits[QM_JOB_MAX_LIMITS];
    size_t limit_count;
    size_t worst_count;  /* places in the result; 0: none */
    double worst_radius; /* NAN: a share of the diagonal */

    /* collision and self_collision */
    qm_collide_mode mode;
    size_t list_limit; /* max pairs in the result object */
    bool solid;        /* collision: tells how the solids lie; an open mesh is an error */
    bool penetration;  /* collision: and how deep each is in the other */
    bool incremental;  /* self_collision: search only near vertices moved since the last search, if known */

    /* alignment */
    qm_align_options align; /* without direction, quads, landmarks and threads, which it takes from here */
    qm_job_align_direction align_direction;
    qm_align_landmark landmarks[QM_JOB_MAX_LANDMARKS];
    size_t landmark_count;

    /* matrix, whose a is the first of its meshes */
    qm_job_member *meshes; /* malloc'ed, owned by the request */
    size_t mesh_count;
    qm_matrix_want want;
    size_t nearest;
    double within;
    const qm_job_set *set;

    /* reconstruction_step, whose a is the id of the reconstruction */
    qm_refine_goal goal; /* its hausdorff is computed from the fraction below when the job runs */
    double hausdorff_relative;
    bool settles; /* the vertices of the mesh move at the end */
    const qm_job_refinement *refining;

    /* remesh; 0 quads: none are named; who is told of its stages is set by the caller of qm_job_execute */
    qm_remesh_options remesh; /* its distance is computed from the fraction below when the job runs */
    double distance_relative;
} qm_job_request;

/** The defaults: a Hausdorff job, two-sided, triangles, relative tolerance 1e-6, no threshold, no deadline, no points.
 * Deviation and comparison: accuracy 1e-2, 2^20 pieces, 50 bins, percentiles 1, 5, 25, 50, 75, 90, 95, 99, no limits;
 * no sign, no bands.
 * Collisions: all pairs, 1000 of them listed. Alignment: those of the engine. */
qm_job_request qm_job_request_default(void);

/** Frees the points, the list of meshes, and the labels. */
void qm_job_request_reset(qm_job_request *request);

/** Takes over what a request owns: the same request, and the other one owns nothing any more. */
qm_job_request qm_job_request_take(qm_job_request *request);

typedef struct qm_job_result {
    qm_job_kind kind;
    double diagonal;       /* of A's box: the unit of relative figures */
    double other_diagonal; /* of B's box; 0 of a kind of one mesh */
    qm_notes notes[2];     /* of A and B */
    double prepare_a_ms, prepare_b_ms;
    double elapsed_ms;
    bool is_canceled; /* stopped by the context's flag; the result is valid nevertheless */

    double tolerance; /* absolute; of kinds with a tolerance */

    /* hausdorff */
    qm_hausdorff_result hausdorff;
    uint32_t from_face, to_face; /* indices of the input files */

    /* project */
    qm_projections projections;

    /* deviation */
    qm_deviation deviation;

    /* comparison; the faces of its places are indices of the input files */
    qm_comparison comparison;

    /* heatmap */
    qm_heatmap heatmap;

    /* distance; its faces are from_face and to_face */
    qm_distance distance;

    /* collision and self_collision */
    qm_listed_pairs pairs;
    qm_relation relation;                     /* with solid */
    qm_deviation_side a_inside_b, b_inside_a; /* with penetration: of A in B, and of B in A */

    /* alignment; the distance of the moved mesh is in hausdorff */
    qm_align_result alignment;

    /* matrix */
    qm_matrix matrix;
    double *matrix_rows;        /* two indices, lower and upper bound: matrix.pair_count */
    double *matrix_uncertainty; /* of each mesh; NULL: all are exact */

    /* reconstruction_step */
    qm_refine_stop refine_stop;
    char mesh
        [QM_ID_SIZE]; /* the new mesh, also of a remesh; set by the caller, with the counts and the records */
    size_t quads, step_count;
    const char *records;  /* JSON objects separated by commas; borrowed */
    qm_mesh settled_mesh; /* without faces: it was not settled */
    qm_settled settled;

    /* remesh */
    qm_remesh_result remesh;
    qm_faced_points faced;    /* of a point set */
    qm_mesh_facts made_facts; /* of its mesh */
    qm_quality made_quality;
} qm_job_result;

/** False with a problem (422) when both meshes of a request have a unit, and not the same. */
bool qm_job_check_units(const qm_notes notes[2], qm_problem *problem);

/**
 * Executes a request about one mesh or two (b is NULL for a kind of one, and both are for one of a set). ctx carries threads and cancel flag; progress
 * may be NULL, and kinds without intermediate bounds do not call it.
 *
 * Returns QM_OK with a result for qm_job_result_reset in the same context, also if it was canceled with a partial
 * result; QM_E_CANCELED if there is none; or the status of the engine's call. After an error *out needs no reset.
 */
qm_status qm_job_execute(qm_context *ctx, const qm_job_request *request, const qm_loaded_mesh *a,
                         const qm_loaded_mesh *b, qm_hausdorff_progress_fn *progress, void *progress_user,
                         qm_job_result *out);

/** The array of a result that is too long for its document: a deviation's distances at A's vertices, the faces of all
 * colliding pairs, or the pairs of a matrix. NULL if the result has none. */
const double *qm_job_result_array(const qm_job_result *result, size_t *count);

/** The mesh that a result brings, with its facts; NULL if the kind makes none. */
const qm_mesh *qm_job_result_mesh(const qm_job_result *result, const qm_mesh_facts **facts);

void qm_job_result_reset(qm_context *ctx, qm_job_result *result);

#endif
