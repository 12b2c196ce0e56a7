/**
 * hausdorff_face.c: the way into the lower stage. A face of the source is tried with the facets nearest to
 * it, which settles most at little cost; the others become pieces in the queue and come back through
 * qm_worker_piece.
 */
#include "hausdorff_overlay.h"
#include "hausdorff_piece.h"

#define VISIT_CUTS 32         /* of a part in one visit, beyond those that eta has room for */
#define FACE_ATTEMPTS 3       /* covers of one face, each with what the last one brought */
#define ONE_LABEL_PACKS 3     /* looked at for one label that takes all of a piece */
#define ONE_LABEL_INTERVAL 16 /* pieces between two tries where one label seldom does */
#define COST_BY_NEAREST 30    /* hundreds of instructions of a cover by the nearest facets, and by all */
#define COST_BY_ALL 150
#define COST_OF_FAILURE 300 /* of all attempts, where none covers the face */
#define COST_OF_PARTS 2000  /* of a face that goes to the queue and comes back in parts, mostly dozens */
#define MIN_HIT_SHARE 2     /* of the tries, one in so many must succeed to go on */

/** One label for the whole polygon, from the nearest packs in turn, as far as single precision is certain. */
static bool cover_by_one(const qm_piece_work *work, const qm_polygon *polygon)
{
    qm_box box = qm_vec_box(polygon->corner, polygon->count);
    uint32_t packs[ONE_LABEL_PACKS];
    double cutoff = qm_piece_cutoff(work);
    int count = work->kernel->narrow(work->near, &box, cutoff, ONE_LABEL_PACKS, packs);
    for (int k = 0; k < count; k++) {
        qm_float_bits bits[QM_COVER_CORNERS];
        unsigned labels = ~0u;
        work->kernel->float_reach(qm_bvh_floats(work->side->target, packs[k]),
                                  qm_side_twists(work->side, packs[k]), cutoff - work->slack, polygon->corner,
                                  (1u << polygon->count) - 1, bits);
        for (int i = 0; i < polygon->count; i++)
            labels &= bits[i];
        if (qm_float_certain(labels)) return true;
    }
    return false;
}

/** Whether one label is worth a try: where surfaces nearly coincide hardly any face has one. */
static bool try_one_label(const qm_piece_work *work, const qm_polygon *polygon)
{
    qm_worker *worker = work->worker;
    bool is_due = worker->one_label_tries % ONE_LABEL_INTERVAL == 0;
    if (!is_due && worker->one_label_hits * MIN_HIT_SHARE < worker->one_label_probes) {
        worker->one_label_tries++;
        return false;
    }
    bool is_covered = cover_by_one(work, polygon);
    worker->one_label_tries++;
    worker->one_label_probes++;
    worker->one_label_hits += is_covered;
    return is_covered;
}

/** By the facets of a list, in single precision. */
static qm_float_verdict cover_in_floats(const qm_piece_work *work, const qm_shortlist *list,
                                        qm_polygon *polygon, bool *moved)
{
    qm_float_pack rows;
    _Alignas(32) float twist[QM_PACK_LANES];
    work->kernel->shortlist_floats(work->side->target, list, &rows);
    for (int i = 0; work->side->target_patches && i < QM_PACK_LANES; i++)
        twist[i] = qm_bvh_twists(work->side->target, list->pack[i])[list->lane[i]];
    return work->kernel->float_cover(&rows, work->side->target_patches ? twist : NULL,
                                     qm_piece_cutoff(work) - work->slack, polygon, moved);
}

/** The same in double precision. */
static bool cover_in_doubles(const qm_piece_work *work, const qm_shortlist *list, qm_polygon *polygon,
                             bool *moved)
{
    qm_pack rows;
    qm_candidates nearest;
    work->kernel->shortlist_rows(work->side->target, list, &rows);
    nearest.count = 1;
    nearest.pack[0] = &rows;
    double cutoff = qm_piece_cutoff(work) - work->slack;
    for (uint32_t i = 0; i < QM_PACK_LANES; i++)
        qm_candidates_set_cutoff(&nearest, 0, i, qm_side_twist(work->side, list->pack[i], list->lane[i]),
                                 cutoff);
    uint64_t labels = ~UINT64_C(0);
    for (int i = 0; i < polygon->count; i++)
        labels &= polygon->in_reach[i] = work->kernel->in_reach(&nearest, polygon->corner[i]);
    return labels != 0 || (polygon->count == 3 && work->kernel->cover(&nearest, polygon, moved));
}

bool qm_piece_cover_by_nearest(const qm_piece_work *work, qm_polygon *polygon, bool *moved)
{
    if (work->near->count == 0) return false;
    if (try_one_label(work, polygon)) return true;
    qm_shortlist list;
    work->kernel->shortlist(work->side->target, work->near, qm_polygon_centroid(polygon), &list);
    qm_float_verdict verdict = cover_in_floats(work, &list, polygon, moved);
    if (verdict == QM_FLOAT_COVERED) return true;
    if (verdict == QM_FLOAT_TOO_COARSE && cover_in_doubles(work, &list, polygon, moved)) return true;
    const qm_bvh *target = work->side->target;
    return work->side->target_patches &&
           qm_piece_over_face(work, target->lanes[list.pack[0]].face[list.lane[0]], polygon);
}

static void start_work(qm_piece_work *work, qm_worker *worker, qm_entry entry, const qm_piece *piece,
                       const qm_near_packs *near)
{
    work->worker = worker;
    work->search = worker->search;
    work->side = &worker->search->side[entry.side];
    work->kernel = worker->search->kernel;
    work->entry = entry;
    work->piece = *piece;
    work->depth = piece->depth;
    int room = piece->cuts + VISIT_CUTS;
    work->cut_limit = room > QM_FREE_CUTS ? room : QM_FREE_CUTS;
    qm_piece_set_slack(work, piece->slack);
    work->generation = 1;
    work->height = 0;
    work->near = near;
}

void qm_worker_piece(qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    qm_piece_work work;
    qm_near_packs near;
    start_work(&work, worker, entry, piece, &near);
    qm_piece_gather(&work, &near);
    if (piece->corner_count == 4) {
        qm_piece_process_rectangle(&work);
        return;
    }
    qm_piece_keep_triangle(&work, piece->corner[0], piece->corner[1], piece->corner[2]);
    qm_piece_process_stack(&work);
}

/** Settles a triangle by an overlay, unless overlays seldom settle a face. It is here because covers failed,
 * so they bear its cost. */
static bool try_overlay(const qm_piece_work *work)
{
    qm_worker *worker = work->worker;
    if (worker->overlay_hits * MIN_HIT_SHARE < worker->overlay_tries) return false;
    uint64_t before = worker->overlay_cost;
    bool is_settled = qm_worker_overlay_face(worker, work->side, &work->piece, work->near);
    worker->cover_cost += worker->overlay_cost - before;
    worker->overlay_cost = before;
    return is_settled;
}

/**
 * Covers a triangle of the source by the nearest facets, then by all candidates, with what is found on the
 * way; else queues it.
 */
static void settle_triangle(qm_piece_work *work)
{
    const qm_vec *corner = work->piece.corner;
    qm_polygon polygon = qm_piece_triangle(work, corner[0], corner[1], corner[2]);
    bool moved = false;
    work->worker->cover_tries++;
    work->worker->cover_cost += COST_BY_NEAREST;
    if (qm_piece_cover_by_nearest(work, &polygon, &moved)) return;
    work->worker->cover_cost += COST_BY_ALL;
    qm_near_packs all;
    qm_piece_gather(work, &all);
    for (int attempt = 0; attempt < FACE_ATTEMPTS; attempt++) {
        qm_piece_reach_corners(work, &polygon);
        if (qm_piece_cover(work, &polygon, &moved)) return;
        /* The middle of what is left is likely as far as any point of the face. */
        if (!qm_piece_sample_unreached(work, qm_polygon_centroid(&polygon))) break;
    }
    work->worker->cover_cost += COST_OF_FAILURE;
    if (try_overlay(work)) return;
    work->worker->cover_cost += COST_OF_PARTS;
    qm_piece_push(work, &work->piece);
}

/** The same of a patch of the source. */
static void settle_rectangle(qm_piece_work *work)
{
    if (qm_piece_rectangle_covered(work)) return;
    qm_near_packs all;
    qm_piece_gather(work, &all);
    qm_piece_process_rectangle(work);
}

void qm_worker_face(qm_worker *worker, qm_entry pack, const qm_piece *face, const qm_near_packs *near)
{
    qm_piece_work work;
    start_work(&work, worker, pack, face, near);
    work.entry.kind = QM_ENTRY_PIECE;
    if (face->corner_count == 3)
        settle_triangle(&work);
    else
        settle_rectangle(&work);
}
