/**
 * hausdorff_matching.c: pieces that are bounded by matching. Every corner of a piece is measured; a piece
 * that is not near enough is cut in four at its midpoints.
 *
 * Termination: all corners are measured, which raises the lower bound to them, and the ball then lets every
 * piece go whose diameter is below the tolerance. Each cut halves the diameter.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, sections 5.2 to 5.4.
 */
#include "hausdorff_matching.h"

/* Halvings of a piece, which leave less of it than the smallest tolerance, 2^-42 of the size. A midpoint is
 * off by u R, a centre by 3 u R, and roundings of levels add up: 48 of them fit into the share of eta for
 * cuts (rounding.h). */
#define MAX_DEPTH 48

/** A piece on its way through one visit. */
typedef struct matching_work {
    qm_worker *worker;
    const qm_side *side;
    qm_entry entry;
    qm_piece piece;
} matching_work;

/** A point of the source with what a piece keeps of its corners. */
typedef struct measured {
    qm_vec at;
    double distance;
    uint32_t foot;
} measured;

/** Measures a point of the piece, which may raise the lower bound, and finds the facet under it. */
static measured measure_point(const matching_work *work, qm_vec p, uint32_t hint)
{
    double distance = qm_worker_sample(work->worker, work->side, p, 0.0, work->piece.face, 0.0, &hint);
    return (measured){p, distance, qm_matching_facet(work->worker->search, work->side, hint, p)};
}

static measured load_corner(const qm_piece *piece, int i)
{
    return (measured){piece->corner[i], piece->distance[i], piece->foot[i]};
}

static void store_corner(qm_piece *piece, int i, measured point)
{
    piece->corner[i] = point.at;
    piece->distance[i] = point.distance;
    piece->foot[i] = point.foot;
}

/** Bounds the piece, and lets it go or queues it. */
static void push_piece(const matching_work *work)
{
    double upper = qm_matching_upper(work->worker->search, work->side, &work->piece);
    qm_entry entry = work->entry;
    entry.upper = fmin(entry.upper, upper * work->side->inverse_scale);
    entry.hint = work->piece.foot[0] / QM_PACK_LANES;
    qm_worker_push(work->worker, entry, &work->piece);
}

static void start_work(matching_work *work, qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    work->worker = worker;
    work->side = &worker->search->side[entry.side];
    work->entry = entry;
    work->entry.kind = QM_ENTRY_PIECE;
    work->piece = *piece;
}

void qm_matching_face(qm_worker *worker, qm_entry pack, const qm_piece *face)
{
    matching_work work;
    start_work(&work, worker, pack, face);
    uint32_t hint = pack.hint;
    for (int i = 0; i < face->corner_count; i++) {
        store_corner(&work.piece, i, measure_point(&work, face->corner[i], hint));
        hint = work.piece.foot[i] / QM_PACK_LANES;
    }
    push_piece(&work);
}

/** Queues a part of a piece with the corners given, in turn. */
static void push_part(qm_worker *worker, qm_entry entry, const qm_piece *piece, const measured corner[4])
{
    matching_work work;
    start_work(&work, worker, entry, piece);
    work.piece.depth++;
    for (int i = 0; i < piece->corner_count; i++)
        store_corner(&work.piece, i, corner[i]);
    push_piece(&work);
}

void qm_matching_piece(qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    if (piece->depth >= MAX_DEPTH) {
        qm_worker_discard(worker, entry.upper);
        return;
    }
    matching_work work;
    start_work(&work, worker, entry, piece);
    int count = piece->corner_count;
    qm_vec place[4], centre_place = qm_matching_middles(piece, place);
    measured middle[4], centre;
    for (int i = 0; i < count; i++)
        middle[i] = measure_point(&work, place[i], piece->foot[i] / QM_PACK_LANES);
    if (count == 4) centre = measure_point(&work, centre_place, middle[0].foot / QM_PACK_LANES);
    for (int i = 0; i < count; i++) {
        measured before = middle[(i + count - 1) % count], corner = load_corner(piece, i);
        const measured part[4] = {corner, middle[i], count == 4 ? centre : before, before};
        push_part(worker, entry, piece, part);
    }
    if (count == 3) push_part(worker, entry, piece, middle);
}
