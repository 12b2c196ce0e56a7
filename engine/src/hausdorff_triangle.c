/**
 * hausdorff_triangle.c: the lower stage. A part of a face is covered by convex sets round facets of the
 * target; what is left of it is split and tried again at once, and goes back to the queue when the budget of
 * one visit is used up.
 *
 * Termination: a corner that no candidate reaches is measured, which raises the lower bound to it and makes
 * its nearest facet a candidate; from QM_STRICT_DEPTH on so is every corner that is not reached with half the
 * tolerance to spare. A part of a diameter below that half is then covered by the nearest facet of any of its
 * corners. Cuts never make a diameter larger, and from MIDPOINT_DEPTH on every second level halves it.
 */
#include "hausdorff_piece.h"

#define MIDPOINT_DEPTH 40
#define MAX_ATTEMPTS 4 /* covers of one part, each with candidates that the last one's corners brought */
#define FACE_ATTEMPTS 3
#define ONE_LABEL_PACKS 3 /* looked at for one label that takes all of a piece */
#define PROBE_INTERVAL 16 /* pieces between two tries where one label seldom does */
#define MIN_HIT_SHARE 2   /* of the tries, one in so many must succeed to go on */
#define VISIT_BUDGET 64   /* parts looked at before the rest goes back to the queue */

void qm_piece_reach_corners(const qm_piece_work *work, qm_polygon *polygon)
{
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] = work->kernel->in_reach(&work->candidates, polygon->corner[i]);
}

/** Covers by refined parts of patches; in_reach is of the candidates again when something is left. */
static bool cover_by_refined(const qm_piece_work *work, qm_polygon *polygon, bool *moved)
{
    if (!work->side->target_patches) return false;
    if (qm_piece_cover_refined(work, polygon, moved)) return true;
    qm_piece_reach_corners(work, polygon);
    return false;
}

bool qm_piece_cover(const qm_piece_work *work, qm_polygon *polygon, bool *moved)
{
    bool is_part = work->depth > 0;
    if (is_part && cover_by_refined(work, polygon, moved)) return true;
    if (work->kernel->cover(&work->candidates, polygon, moved)) return true;
    return !is_part && cover_by_refined(work, polygon, moved);
}

/** True when a corner has to be measured: no candidate reaches it, or, deep down, none with enough to spare.
 */
static bool needs_sample(const qm_piece_work *work, const qm_polygon *polygon, int i, int depth)
{
    if (depth < QM_STRICT_DEPTH) return polygon->in_reach[i] == 0;
    int place;
    double upper = work->kernel->hull_upper(&work->candidates, &polygon->corner[i], 1, &place) + work->slack;
    return upper > qm_piece_allowed(work) - 0.5 * work->search->tolerance * work->side->scale;
}

bool qm_piece_sample_corners(qm_piece_work *work, qm_polygon *polygon, int depth)
{
    bool found = false;
    for (int i = 0; i < polygon->count; i++) {
        if (!needs_sample(work, polygon, i, depth)) continue;
        uint32_t hint = work->packs[0];
        qm_worker_sample(work->worker, work->side, polygon->corner[i], work->slack, work->piece.face, &hint);
        found |= qm_piece_add_candidate(work, hint);
    }
    /* A corner that raised the lower bound is reached now, by the pack that was its nearest all along. */
    found |= qm_piece_allowed(work) > work->filled_for;
    if (found) {
        qm_piece_fill_candidates(work);
        qm_piece_reach_corners(work, polygon);
    }
    return found;
}

/** Bound by the ball round the middle, measured to the patches themselves: it falls with the size, labels do
 * not. */
static double ball_upper(const qm_piece_work *work, const qm_piece *piece)
{
    qm_vec middle = {0, 0, 0};
    double radius = 0.0;
    for (int i = 0; i < piece->corner_count; i++)
        middle = qm_vec_axpy(middle, 1.0 / piece->corner_count, piece->corner[i]);
    for (int i = 0; i < piece->corner_count; i++)
        radius = fmax(radius, qm_vec_distance(middle, piece->corner[i]));
    qm_near_quads near = qm_piece_near_quads(work, middle, false);
    return near.count > 0 ? near.at[0].distance + radius : INFINITY;
}

void qm_piece_push(qm_piece_work *work, const qm_piece *piece)
{
    int place;
    double upper = work->kernel->hull_upper(&work->candidates, piece->corner, piece->corner_count, &place);
    if (work->side->target_patches) upper = fmin(upper, ball_upper(work, piece));
    qm_entry entry = work->entry;
    entry.upper = fmin(entry.upper, (upper + piece->slack) * work->side->inverse_scale);
    entry.hint = work->packs[place < work->pack_count ? place : 0];
    qm_worker_push(work->worker, entry, piece);
}

static void push_part(qm_piece_work *work, const qm_part *from)
{
    qm_piece piece = work->piece;
    piece.corner_count = 3;
    piece.slack = work->slack;
    piece.depth = from->depth;
    for (int i = 0; i < 3; i++)
        piece.corner[i] = from->corner[i];
    qm_piece_push(work, &piece);
}

static void keep_part(qm_piece_work *work, const qm_polygon *polygon, int a, int b, int c, uint8_t depth)
{
    qm_part kept = {
        .corner = {polygon->corner[a], polygon->corner[b], polygon->corner[c]},
        .in_reach = {polygon->in_reach[a], polygon->in_reach[b], polygon->in_reach[c]},
        .generation = work->generation,
        .depth = depth,
    };
    if (work->height < QM_PART_STACK)
        work->stack[work->height++] = kept;
    else
        push_part(work, &kept);
}

/** Keeps a triangle of a polygon in four parts, cut at the midpoints: each has half the diameter. */
static void keep_quarters(qm_piece_work *work, const qm_polygon *polygon, int a, int b, int c, uint8_t depth)
{
    const int index[3] = {a, b, c};
    qm_polygon six;
    six.count = 6;
    for (int i = 0; i < 3; i++) {
        six.corner[i] = polygon->corner[index[i]];
        six.in_reach[i] = polygon->in_reach[index[i]];
        six.corner[3 + i] = qm_vec_mix(polygon->corner[index[i]], polygon->corner[index[(i + 1) % 3]], 0.5);
        six.in_reach[3 + i] = work->kernel->in_reach(&work->candidates, six.corner[3 + i]);
    }
    keep_part(work, &six, 0, 3, 5, depth);
    keep_part(work, &six, 3, 1, 4, depth);
    keep_part(work, &six, 5, 4, 2, depth);
    keep_part(work, &six, 4, 5, 3, depth);
}

static void split_rest(qm_piece_work *work, const qm_polygon *rest, bool moved, uint8_t depth)
{
    bool halve = !moved || (depth >= MIDPOINT_DEPTH && depth % 2 == 0);
    uint8_t deeper = (uint8_t)(depth < UINT8_MAX ? depth + 1 : MIDPOINT_DEPTH);
    for (int i = 1; i + 1 < rest->count; i++) {
        if (halve)
            keep_quarters(work, rest, 0, i, i + 1, deeper);
        else
            keep_part(work, rest, 0, i, i + 1, deeper);
    }
}

static qm_polygon part_polygon(const qm_piece_work *work, const qm_part *from)
{
    qm_polygon polygon;
    polygon.count = 3;
    for (int i = 0; i < 3; i++) {
        polygon.corner[i] = from->corner[i];
        polygon.in_reach[i] = from->in_reach[i];
    }
    if (from->generation != work->generation) qm_piece_reach_corners(work, &polygon);
    return polygon;
}

/** One label for the whole polygon, from the nearest packs in turn. */
static bool cover_by_one(const qm_piece_work *work, const qm_polygon *polygon)
{
    qm_box box = qm_vec_box(polygon->corner, polygon->count);
    uint32_t packs[ONE_LABEL_PACKS];
    int count = work->kernel->narrow(work->near, &box, qm_piece_allowed(work), ONE_LABEL_PACKS, packs);
    qm_candidates candidates;
    qm_candidates_fill(&candidates, work->side, packs, count, qm_piece_allowed(work) - work->slack);
    return work->kernel->hull_reached(&candidates, polygon->corner, polygon->count);
}

/** Whether one label is worth a try: where surfaces nearly coincide hardly any face has one. */
static bool try_one_label(const qm_piece_work *work, const qm_polygon *polygon)
{
    qm_worker *worker = work->worker;
    bool is_due = worker->one_label_tries % PROBE_INTERVAL == 0;
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

bool qm_piece_cover_by_nearest(const qm_piece_work *work, qm_polygon *polygon, bool *moved)
{
    if (work->near->count == 0) return false;
    if (try_one_label(work, polygon)) return true;
    qm_shortlist list;
    work->kernel->shortlist(work->side->target, work->near, qm_polygon_middle(polygon), &list);
    qm_candidates nearest;
    nearest.count = 1;
    nearest.pack[0] = &list.pack;
    double allowed = qm_piece_allowed(work) - work->slack;
    for (uint32_t lane = 0; lane < QM_PACK_LANES; lane++)
        qm_candidates_allow(&nearest, 0, lane, qm_side_twist(work->side, list.origin[lane], list.lane[lane]),
                            allowed);
    uint64_t labels = ~UINT64_C(0);
    for (int i = 0; i < polygon->count; i++)
        labels &= polygon->in_reach[i] = work->kernel->in_reach(&nearest, polygon->corner[i]);
    return labels != 0 || (polygon->count == 3 && work->kernel->cover(&nearest, polygon, moved));
}

static void process_part(qm_piece_work *work, const qm_part *from)
{
    qm_polygon rest;
    bool moved = false;
    work->depth = from->depth;
    if (from->generation == 0) {
        rest = (qm_polygon){.count = 3, .corner = {from->corner[0], from->corner[1], from->corner[2]}};
        if (qm_piece_cover_by_nearest(work, &rest, &moved)) return;
        qm_piece_reach_corners(work, &rest);
    } else {
        rest = part_polygon(work, from);
    }
    for (int attempt = 0; attempt < MAX_ATTEMPTS; attempt++) {
        if (qm_piece_cover(work, &rest, &moved)) return;
        if (!qm_piece_sample_corners(work, &rest, from->depth)) break;
    }
    split_rest(work, &rest, moved, from->depth);
}

void qm_piece_process_stack(qm_piece_work *work)
{
    for (int budget = VISIT_BUDGET; work->height > 0; budget--) {
        qm_part next = work->stack[--work->height];
        work->worker->iterations++;
        if (budget > 0)
            process_part(work, &next);
        else
            push_part(work, &next);
    }
    qm_worker_discard(work->worker, qm_search_allowed(work->search));
}

void qm_piece_keep_triangle(qm_piece_work *work, qm_vec a, qm_vec b, qm_vec c)
{
    work->stack[work->height++] = (qm_part){
        .corner = {a, b, c},
        .depth = work->piece.depth,
    };
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
    work->slack = piece->slack;
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

/**
 * Measures a point of a face when the candidates do not reach it. True when that brought a candidate or
 * raised the lower bound, so that another try may succeed.
 */
static bool sample_unreached(qm_piece_work *work, qm_vec p)
{
    int place;
    double upper = work->kernel->hull_upper(&work->candidates, &p, 1, &place);
    if (upper + work->slack <= qm_piece_allowed(work)) return false;
    uint32_t hint = work->packs[place];
    qm_worker_sample(work->worker, work->side, p, work->slack, work->piece.face, &hint);
    bool added = qm_piece_add_candidate(work, hint);
    bool raised = qm_piece_allowed(work) > work->filled_for;
    if (added || raised) qm_piece_fill_candidates(work);
    return added || raised;
}

/**
 * Covers a triangle of the source by the nearest facets, then by all candidates, with what is found on the
 * way; else queues it.
 */
static void settle_triangle(qm_piece_work *work)
{
    const qm_vec *corner = work->piece.corner;
    qm_polygon polygon = {.count = 3, .corner = {corner[0], corner[1], corner[2]}};
    bool moved = false;
    if (qm_piece_cover_by_nearest(work, &polygon, &moved)) return;
    qm_near_packs all;
    qm_piece_gather(work, &all);
    for (int attempt = 0; attempt < FACE_ATTEMPTS; attempt++) {
        qm_piece_reach_corners(work, &polygon);
        if (qm_piece_cover(work, &polygon, &moved)) return;
        /* The middle of what is left is likely as far as any point of the face. */
        if (!sample_unreached(work, qm_polygon_middle(&polygon))) break;
    }
    qm_piece_push(work, &work->piece);
}

/** The same of a patch of the source. */
static void settle_rectangle(qm_piece_work *work)
{
    if (qm_piece_rectangle_covered(work)) return;
    qm_near_packs all;
    qm_piece_gather(work, &all);
    qm_patch patch = qm_patch_make(work->piece.corner);
    if (sample_unreached(work, qm_patch_at(&patch, 0.5, 0.5)) && qm_piece_rectangle_covered(work)) return;
    qm_piece_push(work, &work->piece);
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
