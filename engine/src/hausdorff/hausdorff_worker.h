/**
 * hausdorff_worker.h: a worker of a search, and the stages that it takes an entry of its queue through.
 *
 *   first samples    hausdorff_sample.c     a good lower bound before anything else; samples of points
 *   nodes            hausdorff_node.c       balls about nodes and packs of the source
 *   packs            hausdorff_pack.c       one facet for each face; overlays of a node or pack
 *                    hausdorff_near.c       single facets and balls for the parts of a face
 *                    hausdorff_overlay.c    all facets straight over a face at once
 *   pieces           hausdorff_piece.c      cover by several facets, else split
 *                    hausdorff_candidates.c the facets that a piece may be covered with
 *                    hausdorff_patches.c    cover by patches of the target, cell by cell
 *                    hausdorff_matching.c   in place of these two, as an option: bounds by matching
 *   witnesses        hausdorff_ascent.c     from a sample to a local maximum of the distance
 *   the loop         hausdorff_worker.c     queues, locks, limits, reports
 */
#ifndef QM_HAUSDORFF_WORKER_H
#define QM_HAUSDORFF_WORKER_H

#include "hausdorff_search.h"

#define QM_KNOWN_POINTS 64  /* a power of two */
#define QM_RECENT_PACKS 8   /* one record of boxes */
#define QM_CLOSE_SHARE 0.25 /* of the lower bound: a bound at or below it need not be improved */

/** The result of a search for a point. */
typedef struct qm_known_point {
    const qm_side *side; /* NULL: none yet */
    qm_vec p;
    double slack, enough, upper;
    uint32_t hint;
    bool is_sample; /* certified where it might have raised the lower bound */
} qm_known_point;

/** A face of the source in local space. */
typedef struct qm_last_face {
    const qm_side *side; /* NULL: none yet */
    int corner_count;
    qm_vec corner[4];
} qm_last_face;

/** One thread of a search. Lock rule: queue and top belong to lock; a thread that takes several locks takes
 * them in the order of the workers' indices. */
typedef struct qm_worker {
    _Alignas(QM_CACHE_LINE) qm_context *ctx; /* so that no two workers write to one line */
    qm_search *search;
    int index;
    mtx_t lock; /* used only when there are several workers */
    qm_queue queue;
    double top;               /* largest upper bound of the entries that this worker holds; -1 for none */
    _Atomic double discarded; /* largest upper bound that this worker has discarded */
    double witness;           /* distance of the witness, world units; -1 for none */
    int witness_side;
    uint32_t witness_face, witness_hint;
    qm_vec witness_point; /* local to the target of the side */
    double witness_slack; /* how far it may be from the source's surface, local */
    double ascend_above;  /* a witness farther than this is worth an ascent */
    uint64_t one_label_tries, one_label_probes, one_label_hits; /* how often a single label covered a piece */
    uint64_t overlay_tries, overlay_hits;                       /* faces tried by an overlay, and covered */
    uint64_t overlay_part_tries, overlay_part_probes, overlay_part_hits; /* of parts of pieces */
    uint64_t cover_tries;
    uint64_t overlay_cost, cover_cost; /* by counts of operations, in about a hundred instructions */
    uint64_t overlay_work;             /* of all overlays, as iterations count it */
    unsigned since_probe;              /* packs since the dearer of overlay and cover was tried */
    unsigned share_pause, share_wait;  /* nodes to skip after a common overlay failed; of these, left */
    uint64_t part_tries, part_cost, part_hits; /* of parts of faces */
    const qm_side *recent_side;
    unsigned recent_next;
    qm_near_packs recent;             /* packs of its target that were near recent faces */
    uint64_t iterations, projections; /* not added to the search's counts yet */
    size_t max_queue;
    qm_known_point known[QM_KNOWN_POINTS]; /* the last point of each slot, by a hash of its coordinates */
    qm_last_face last_face;                /* the last face: discarded, or queued in pieces */
} qm_worker;

/** Creates the workers of a search; false when out of memory: none is then left. */
bool qm_worker_create_all(qm_context *ctx, qm_search *search, int count);
void qm_worker_destroy_all(qm_context *ctx, qm_search *search);

/** The upper bound at this moment, world units, without the rounding margin. Takes all locks. */
double qm_worker_max_upper(const qm_search *search);

/** Discards a part of the source: remembers the upper bound that it had. */
static inline void qm_worker_discard(qm_worker *worker, double upper)
{
    if (upper > atomic_load_explicit(&worker->discarded, memory_order_relaxed))
        atomic_store_explicit(&worker->discarded, upper, memory_order_relaxed);
}

/** Puts an entry in the worker's queue; discards it at once when its bound allows it. */
void qm_worker_push(qm_worker *worker, qm_entry entry, const qm_piece *piece);

/** The loop of one worker: takes entries, its own or another's, until none is left or a reason to stop is
 * seen. */
void qm_worker_run(qm_worker *worker);

/** True when the search is to end; checks the limits and reports progress when that is due. A caller that
 * stops for it puts the part of the source that it has in work back in the queue. */
bool qm_worker_must_stop(qm_worker *worker);

/** Ascends from the worker's witness over the source to a local maximum, and samples that. */
void qm_ascent_run(qm_worker *worker);

/** Ascends when the witness is a new one, and that of the lower bound. */
static inline void qm_worker_follow(qm_worker *worker)
{
    if (worker->witness > worker->ascend_above &&
        worker->witness >= atomic_load_explicit(&worker->search->lower, memory_order_relaxed))
        qm_ascent_run(worker);
}

/** Bounds the children of a node; queues them, or visits them at once where they are packs. */
void qm_node_visit(qm_worker *worker, qm_entry entry);

/** Visits packs of the source that are children of one node: discards faces, or queues them as pieces. */
void qm_pack_visit_all(qm_worker *worker, const qm_entry *pack, int count);

/** Faces of one pack, in local space. */
typedef struct qm_near_faces {
    const qm_vec *vertex;
    int vertex_count, count;
    uint8_t corner[QM_PACK_LANES][4]; /* indices of vertices; a triangle's last one twice */
} qm_near_faces;

/** A bit for each face that single labels, or balls, show to be within the cutoff, whole or in parts. hint is
 * a pack of the target near the faces whose labels reach none of them. */
unsigned qm_near_test_faces(qm_worker *worker, const qm_side *side, const qm_near_faces *faces,
                            uint32_t hint);

/** Visits a face of a pack: discards it when it can be covered at little cost, else queues it as a piece. */
void qm_piece_visit_face(qm_worker *worker, qm_entry pack, const qm_piece *face, const qm_near_packs *near);

/** Visits a piece taken from the queue. */
void qm_piece_visit(qm_worker *worker, qm_entry entry, const qm_piece *piece);

/** Visit a face and a piece by matching: bounded by the facets under its corners, and split. */
void qm_matching_visit_face(qm_worker *worker, qm_entry pack, const qm_piece *face);
void qm_matching_visit_piece(qm_worker *worker, qm_entry entry, const qm_piece *piece);

#endif
