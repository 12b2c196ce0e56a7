/**
 * hausdorff_search.h: the state that the stages of a search share, and the stages.
 *
 * Lengths in the queue and in the bounds are in world units. Each side (direction) computes in the local
 * frame of its target, whose scale is a power of two, so that going over costs no rounding.
 *
 *   first samples      hausdorff_scout.c    a good lower bound before anything else
 *   groups and packs   hausdorff_source.c   one search a node: ball test; packs: a single label for each face
 *   whole faces        hausdorff_near.c     single labels and balls for the parts of a face
 *                      hausdorff_overlay.c  the same for all of a pack by the facets straight over them
 *   pieces             hausdorff_piece.h    cover by several labels, else split; or, as an option,
 *                      hausdorff_matching.c matched to the facets under their corners, else split
 *   points             hausdorff_sample.c   nearest points, which raise the lower bound
 *   climbs             hausdorff_ascent.c    from such a point to one that no direction leads farther from,
 * over hausdorff_ground.c   facets of the source that meet in a point
 */
#ifndef QM_HAUSDORFF_SEARCH_H
#define QM_HAUSDORFF_SEARCH_H

#include <stdatomic.h>
#include <threads.h>

#include "bvh/bvh_demand.h"
#include "bvh/nearest.h"
#include "core/clock.h"
#include "hausdorff_queue.h"
#include "qm/hausdorff.h"

#define QM_CACHE_LINE 64
#define QM_KNOWN_POINTS 64  /* a power of two */
#define QM_RECENT_PACKS 8   /* one group of boxes */
#define QM_NEAR_ENOUGH 0.25 /* of the lower bound: a facet within it tells well enough how far a point is */

/** Value of qm_search.stop beside the reasons of qm_hausdorff_stop. */
enum { QM_SEARCH_RUNNING = -1 };

/** A pack of the source measured at its middle before the search starts. */
typedef struct qm_seed {
    double distance; /* an upper bound, local; INFINITY where the search was stopped before it */
    uint32_t hint;   /* a pack of the target near it */
} qm_seed;

/** One direction: the points of source, measured to target. */
typedef struct qm_side {
    const qm_bvh *source, *target;
    qm_locator nearest;          /* over target: where the nearest points of samples are searched */
    double scale, inverse_scale; /* local = world * scale */
    double factor;               /* from the source's local frame to the target's: p -> factor p + shift */
    qm_vec shift;
    double reach;        /* greatest local coordinate of either surface */
    bool target_patches; /* read the target's quads as bilinear patches */
    bool source_patches;
    size_t seed_step, seed_count; /* packs of the source from seed to seed, and the number of seeds */
    qm_seed *seeds;               /* NULL: none */
} qm_side;

/** What all workers of a search share. Written by several threads: lower only; the rest is set before they
 * start. */
typedef struct qm_search {
    qm_side side[2];
    int side_count;
    const qm_kernel *kernel;
    double eta;           /* no computed distance is off by more, world units */
    double tolerance;     /* of the search itself: the caller's less the roundings */
    double floor;         /* bounds at or below this are of no interest (threshold), or 0 */
    _Atomic double lower; /* greatest certified distance of a point of a source so far */
    atomic_int stop;      /* set by whoever sees a reason; the workers then leave */
    int worker_count;
    struct qm_worker *workers;
    const qm_hausdorff_options *options;
    bool is_queued; /* all of the source: before, what is queued says nothing of the upper bound */
    uint64_t work_limit;
    qm_hausdorff_stop work_stop; /* what reaching it is told as */
    size_t memory_limit;         /* of one worker's queue */
    double start_ms;
    double reported_ms, reported_gap, reported_upper; /* guarded by reporting */
    /* Written all the time, so kept away from what every worker reads. */
    _Alignas(QM_CACHE_LINE) atomic_int busy_count; /* workers that hold an entry which is in no queue */
    atomic_flag reporting; /* held by the worker that reports progress or looks at the limits */
    _Atomic uint64_t iterations, projections;
} qm_search;

/** What a search of a worker found for a point. */
typedef struct qm_known_point {
    const qm_side *side; /* NULL: nothing yet */
    qm_vec p;
    double slack, enough, upper;
    uint32_t hint;
    bool is_sample; /* measured with certainty where it might have raised the lower bound */
} qm_known_point;

/** A face of the source, local to the target of its side. */
typedef struct qm_settled_face {
    const qm_side *side; /* NULL: none yet */
    int corner_count;
    qm_vec corner[4];
} qm_settled_face;

/** Lock rule: queue and top belong to lock; to take two locks, take the one of the lower index first. */
typedef struct qm_worker {
    _Alignas(QM_CACHE_LINE) qm_context *ctx; /* so that no two workers write to one line */
    qm_search *search;
    int index;
    mtx_t lock; /* used only when there are several workers */
    qm_queue queue;
    double top;               /* greatest upper bound of what this worker holds; -1 for nothing */
    _Atomic double discarded; /* greatest upper bound of what this worker has let go */
    double witness;           /* distance of the witness, world units; -1 for none */
    int witness_side;
    uint32_t witness_face, witness_hint;
    qm_vec witness_point; /* local to the target of the side */
    double witness_slack; /* how far it may be from the source's surface, local */
    double ascend_above;  /* a witness farther than that is worth a climb */
    uint64_t one_label_tries, one_label_probes, one_label_hits; /* how often a single label took a piece */
    uint64_t overlay_tries, overlay_hits; /* how often an overlay settled a face, and how many were covered */
    uint64_t cover_tries;
    uint64_t overlay_cost, cover_cost; /* by counts of what was done, in about a hundred instructions */
    uint64_t overlay_work;             /* of all overlays, as they count in iterations */
    unsigned since_probe;              /* packs since the dearer of the two was tried */
    unsigned share_pause, share_wait;  /* groups of packs without a common overlay after the last failure, and
                                          how many of them are left */
    uint64_t part_tries, part_cost, part_hits; /* of parts of faces */
    const qm_side *recent_side;
    unsigned recent_next;
    qm_near_packs recent;             /* packs of its target that were near faces lately */
    uint64_t iterations, projections; /* not handed over to the search yet */
    size_t max_queue;
    qm_known_point known[QM_KNOWN_POINTS]; /* the last point of each place */
    qm_settled_face settled;               /* the last face: settled, or queued in pieces */
} qm_worker;

/** Anything at or below this can be let go, world units. */
static inline double qm_search_cutoff(const qm_search *search)
{
    double lower = atomic_load_explicit(&search->lower, memory_order_relaxed);
    return fmax(lower + search->tolerance, search->floor);
}

/** The lower bound, local. */
static inline double qm_side_lower(const qm_search *search, const qm_side *side)
{
    return atomic_load_explicit(&search->lower, memory_order_relaxed) * side->scale;
}

/** Remembers that something with this upper bound is not looked at any more. */
static inline void qm_worker_discard(qm_worker *worker, double upper)
{
    if (upper > atomic_load_explicit(&worker->discarded, memory_order_relaxed))
        atomic_store_explicit(&worker->discarded, upper, memory_order_relaxed);
}

/** Puts an entry in the worker's queue; lets it go at once when its bound allows it. */
void qm_worker_push(qm_worker *worker, qm_entry entry, const qm_piece *piece);

/** A vertex of the source in the local frame of the target. */
static inline qm_vec qm_side_vertex(const qm_side *side, uint32_t vertex)
{
    return qm_frame_local(&side->target->frame, side->source->mesh.positions + 3 * (size_t)vertex);
}

/** Corners of the source's face that starts at a lane, as qm_lane_corners gives them, in the local frame of
 * the target. */
static inline int qm_side_corners(const qm_side *side, const qm_pack_lanes *lanes, uint32_t lane,
                                  qm_vec corner[4])
{
    int place[4], count = qm_lane_corners(lanes, lane, side->source_patches, place);
    for (int i = 0; i < count; i++)
        corner[i] = qm_side_vertex(side, lanes->vertex[place[i]]);
    return count;
}

/** How far the surface of a lane's face can be from the lane's triangle: 0 unless patches are read. Local. */
static inline double qm_side_twist(const qm_side *side, uint32_t pack, uint32_t lane)
{
    return side->target_patches ? (double)qm_bvh_twists(side->target, pack)[lane] : 0.0;
}

/** The same of all lanes; NULL for none. */
static inline const float *qm_side_twists(const qm_side *side, uint32_t pack)
{
    return side->target_patches ? qm_bvh_twists(side->target, pack) : NULL;
}

/**
 * Upper bound (local) of the distance of p by one search in single precision from the hint, which moves on to
 * the pack found. The search ends as soon as the bound is enough. Where the twist leaves it open whether p is
 * within reach, the patch that was found is asked.
 */
double qm_side_nearly(const qm_search *search, const qm_side *side, qm_vec p, double enough, double reach,
                      uint32_t *hint);

/** The same; a point that this worker has asked for just before, for as little, is not searched for again:
 * over many copies of one face each search visits all of them, and the copies of a source ask for the same
 * few points. */
double qm_worker_nearly(qm_worker *worker, const qm_side *side, qm_vec p, double enough, double reach,
                        uint32_t *hint);

/**
 * The same, but when the point may raise the lower bound, it is measured with certainty; face is what it lies
 * on, and slack how far from the source's surface it may be. enough is at most the lower bound.
 */
double qm_worker_sample(qm_worker *worker, const qm_side *side, qm_vec p, double slack, uint32_t face,
                        double enough, uint32_t *hint);

/** A point of a pack of the source, local to the target: the middle of a face in its middle. */
qm_vec qm_side_middle(const qm_side *side, uint32_t pack, uint32_t *face);

/** Raises the lower bound by a sparse sample of the source and a closer look where it is farthest, with all
 * workers; keeps the sample as the side's seeds when there is memory for them. Returns a hint. */
uint32_t qm_search_seed_lower(qm_context *ctx, qm_search *search, qm_side *side);

/** Gives the seeds back. */
void qm_side_reset_seeds(qm_context *ctx, qm_side *side);

/** Upper bound (local) of the distance of p by the triangles of one pack alone. */
double qm_side_pack_upper(const qm_search *search, const qm_side *side, uint32_t pack, qm_vec p);

/** Climbs from the worker's witness over the source, and measures where that ends. */
void qm_worker_ascend(qm_worker *worker);

/** The same when the witness is a new one, and that of the lower bound. */
static inline void qm_worker_follow(qm_worker *worker)
{
    if (worker->witness > worker->ascend_above &&
        worker->witness >= atomic_load_explicit(&worker->search->lower, memory_order_relaxed))
        qm_worker_ascend(worker);
}

/** Creates the workers of a search; false when out of memory: nothing is then left behind. */
bool qm_search_create_workers(qm_context *ctx, qm_search *search, int count);
void qm_search_destroy_workers(qm_context *ctx, qm_search *search);

/** The loop of one worker: takes entries, its own or another's, until nothing is left or a reason to stop is
 * seen. */
void qm_worker_run(qm_worker *worker);

/**
 * True when the search is to end; looks for reasons and reports progress when that is due. What a worker has
 * at hand then and does not look at any more it discards with its bound.
 */
bool qm_worker_must_stop(qm_worker *worker);

/** The upper bound that holds now, world units, without roundings. */
double qm_search_upper(const qm_search *search);

/** Looks at one entry taken from the queue. */
void qm_worker_node(qm_worker *worker, qm_entry entry);
void qm_worker_piece(qm_worker *worker, qm_entry entry, const qm_piece *piece);

/** Faces of one pack, local to the target. */
typedef struct qm_near_faces {
    const qm_vec *vertex;
    int vertex_count, count;
    uint8_t corner[QM_PACK_LANES][4]; /* places of vertices; a triangle's last one twice */
} qm_near_faces;

/** A bit for each face that single labels, or balls, show to be near enough, whole or in parts. hint is a
 * pack of the target near the faces whose labels take none of them. */
unsigned qm_worker_faces_near(qm_worker *worker, const qm_side *side, const qm_near_faces *faces,
                              uint32_t hint);

/** Looks at a face of a pack: lets it go when it can be covered at little cost, else queues it as a piece. */
void qm_worker_face(qm_worker *worker, qm_entry pack, const qm_piece *face, const qm_near_packs *near);

/** The same two by matching: face and piece are bounded by the facets under their corners, and split. */
void qm_matching_face(qm_worker *worker, qm_entry pack, const qm_piece *face);
void qm_matching_piece(qm_worker *worker, qm_entry entry, const qm_piece *piece);

/** True when pieces are bounded by matching. */
static inline bool qm_search_is_matching(const qm_search *search)
{
    return search->options->bounds == QM_BOUNDS_MATCHING;
}

/** Sets how far a point may be from a lane: the cutoff distance less the twist of its patch. Local. */
static inline void qm_candidates_set_cutoff(qm_candidates *candidates, int k, uint32_t lane, double twist,
                                            double cutoff)
{
    double rest = cutoff - twist;
    candidates->twist[k][lane] = twist;
    candidates->cutoff2[k][lane] = rest >= 0.0 ? rest * rest : -1.0;
}

/** Sets up the candidates of a list of packs, with what each lane is cutoff (local), less slack. */
void qm_candidates_fill(qm_candidates *candidates, const qm_side *side, const uint32_t *packs, int count,
                        double cutoff);

#endif
