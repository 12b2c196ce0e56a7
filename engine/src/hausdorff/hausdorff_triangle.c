/**
 * hausdorff_triangle.c: the lower stage. A part of a face is covered by convex sets round facets of the
 * target; what is left of it is split and tried again at once, and goes back to the queue when the budget of
 * one visit is used up.
 *
 * Termination: a corner that no candidate reaches is measured, which raises the lower bound to it and makes
 * its nearest facet a candidate; from QM_STRICT_DEPTH on so is every corner that is not reached with half the
 * tolerance to spare. A part of a diameter below that half is then covered by the nearest facet of any of its
 * corners, or of its middle, which is measured before them and does as well. Every level brings the diameter
 * down to MIN_SHRINK of what it was, or to half.
 */
#include "hausdorff_piece.h"

#define MIN_SHRINK 0.6  /* of the diameter: a rest that keeps more is halved */
#define SHORT_SIDE 0.1  /* of the longest: each part then has at most 0.55 of the diameter */
#define MAX_ATTEMPTS 4  /* covers of one part, each with candidates that the last one's corners brought */
#define VISIT_BUDGET 64 /* parts looked at before the rest goes back to the queue */

void qm_piece_reach_corners(const qm_piece_work *work, qm_polygon *polygon)
{
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] = work->kernel->in_reach(&work->candidates, polygon->corner[i]);
}

/** Covers by refined labels; in_reach is of the candidates again when something is left. */
static bool cover_by_refined(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon,
                             bool *moved)
{
    if (qm_piece_cover_refined(work, refined, polygon, moved)) return true;
    qm_piece_reach_corners(work, polygon);
    return false;
}

bool qm_piece_cover_with(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon,
                         bool *moved)
{
    bool is_part = work->depth > 0;
    if (refined && is_part && cover_by_refined(work, refined, polygon, moved)) return true;
    if (work->kernel->cover(&work->candidates, polygon, moved)) return true;
    return refined && !is_part && cover_by_refined(work, refined, polygon, moved);
}

/** Makes refined labels for a polygon from the quads near its middle. */
static bool refine(const qm_piece_work *work, const qm_polygon *polygon, qm_refined *refined)
{
    if (!work->side->target_patches) return false;
    qm_vec middle = qm_polygon_centroid(polygon);
    double cutoff = qm_piece_cutoff(work), radius = qm_vec_radius(polygon->corner, polygon->count, middle);
    qm_quads_asked asked = {
        .wanted = QM_NEAR_QUADS, .within = cutoff + radius, .enough = cutoff, .twisted_only = true};
    qm_near_quads near = qm_piece_near_quads(work, middle, asked);
    return qm_piece_refine(work, polygon, middle, &near, refined);
}

bool qm_piece_cover(const qm_piece_work *work, qm_polygon *polygon, bool *moved)
{
    qm_refined refined;
    if (work->depth > 0)
        return qm_piece_cover_with(work, refine(work, polygon, &refined) ? &refined : NULL, polygon, moved);
    if (work->kernel->cover(&work->candidates, polygon, moved)) return true;
    return refine(work, polygon, &refined) && cover_by_refined(work, &refined, polygon, moved);
}

/**
 * True when a patch among the candidates is this much nearer than it need be, itself and not its label, which
 * loses its twist: to search for the nearest would bring nothing new.
 */
static bool patch_reaches(const qm_piece_work *work, qm_vec p, double room)
{
    return work->side->target_patches &&
           qm_piece_quad_within(work, p, qm_piece_cutoff(work) - room - work->slack);
}

/** True when a corner has to be measured: no candidate reaches it, or, deep down, not by enough. */
static bool needs_sample(const qm_piece_work *work, const qm_polygon *polygon, int i, int depth)
{
    qm_vec p = polygon->corner[i];
    if (depth < QM_STRICT_DEPTH) return polygon->in_reach[i] == 0 && !patch_reaches(work, p, 0.0);
    int place;
    double upper = work->kernel->hull_upper(&work->candidates, &p, 1, &place) + work->slack;
    double room = 0.5 * work->search->tolerance * work->side->scale;
    return upper > qm_piece_cutoff(work) - room && !patch_reaches(work, p, room);
}

bool qm_piece_sample_corners(qm_piece_work *work, qm_polygon *polygon, int depth)
{
    bool found = false;
    for (int i = 0; i < polygon->count; i++) {
        if (!needs_sample(work, polygon, i, depth)) continue;
        uint32_t hint = work->packs[0];
        qm_worker_sample(work->worker, work->side, polygon->corner[i], work->slack, work->piece.face, 0.0,
                         &hint);
        found |= qm_piece_add_candidate(work, hint);
    }
    /* A corner that raised the lower bound is reached now, by the pack that was its nearest all along. */
    found |= qm_piece_cutoff(work) > work->filled_for;
    if (found) {
        qm_piece_fill_candidates(work);
        qm_piece_reach_corners(work, polygon);
    }
    return found;
}

bool qm_piece_sample_unreached(qm_piece_work *work, qm_vec p)
{
    int place;
    double upper = work->kernel->hull_upper(&work->candidates, &p, 1, &place);
    if (upper + work->slack <= qm_piece_cutoff(work) || patch_reaches(work, p, 0.0)) return false;
    uint32_t hint = work->packs[place];
    qm_worker_sample(work->worker, work->side, p, work->slack, work->piece.face, 0.0, &hint);
    bool added = qm_piece_add_candidate(work, hint);
    bool raised = qm_piece_cutoff(work) > work->filled_for;
    if (added || raised) qm_piece_fill_candidates(work);
    return added || raised;
}

/** Bound by the ball round the middle, measured to the patches themselves, or enough when that is no better:
 * it falls with the size, labels do not. hint becomes the pack of the nearest one. */
static double ball_upper(const qm_piece_work *work, const qm_piece *piece, double enough, uint32_t *hint)
{
    qm_vec middle = qm_vec_centroid(piece->corner, piece->corner_count);
    double radius = qm_vec_radius(piece->corner, piece->corner_count, middle);
    if (radius >= enough) return enough;
    qm_quads_asked asked = {
        .wanted = 1, .within = enough - radius, .enough = fmax(qm_piece_cutoff(work), radius)};
    qm_near_quads near = qm_piece_near_quads(work, middle, asked);
    if (near.count == 0) return enough;
    *hint = near.at[0].pack;
    return near.at[0].distance + radius;
}

void qm_piece_push(qm_piece_work *work, const qm_piece *piece)
{
    int place;
    double upper = work->kernel->hull_upper(&work->candidates, piece->corner, piece->corner_count, &place);
    qm_entry entry = work->entry;
    double known = entry.upper * work->side->scale - work->slack;
    entry.hint = work->packs[place < work->pack_count ? place : 0];
    if (work->side->target_patches) upper = ball_upper(work, piece, fmin(upper, known), &entry.hint);
    entry.upper = fmin(entry.upper, (upper + work->slack) * work->side->inverse_scale);
    qm_worker_push(work->worker, entry, piece);
}

static void push_part(qm_piece_work *work, const qm_part *from)
{
    qm_piece piece = work->piece;
    piece.corner_count = 3;
    piece.cuts = (uint16_t)(work->cut_limit - from->cuts_left);
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
        .cuts_left = (uint8_t)polygon->cuts_left,
    };
    if (work->height < QM_PART_STACK)
        work->stack[work->height++] = kept;
    else
        push_part(work, &kept);
}

/** The side (i to i + 1) of a triangle that is much shorter than the longest, or -1. */
static int short_side(const qm_polygon *six)
{
    double least2 = INFINITY, greatest2 = 0.0;
    int shortest = -1;
    for (int i = 0; i < 3; i++) {
        double length2 = qm_vec_norm2(qm_vec_sub(six->corner[(i + 1) % 3], six->corner[i]));
        greatest2 = fmax(greatest2, length2);
        if (!(length2 < least2)) continue;
        least2 = length2;
        shortest = i;
    }
    return least2 < SHORT_SIDE * SHORT_SIDE * greatest2 ? shortest : -1;
}

/**
 * Keeps a triangle of a polygon in four parts, cut at the midpoints: each has half the diameter. A side much
 * shorter than the others stays whole: else two or three parts lie at its place on every level, and where
 * that place is the one that is hard to cover, they would be exponentially many.
 */
static void keep_quarters(qm_piece_work *work, const qm_polygon *polygon, int a, int b, int c, uint8_t depth)
{
    const int index[3] = {a, b, c};
    qm_polygon six;
    six.count = 6;
    six.cuts_left = polygon->cuts_left - 1;
    for (int i = 0; i < 3; i++) {
        six.corner[i] = polygon->corner[index[i]];
        six.in_reach[i] = polygon->in_reach[index[i]];
        six.corner[3 + i] = qm_vec_mix(polygon->corner[index[i]], polygon->corner[index[(i + 1) % 3]], 0.5);
        six.in_reach[3 + i] = work->kernel->in_reach(&work->candidates, six.corner[3 + i]);
    }
    int side = short_side(&six);
    if (side >= 0) {
        int next = (side + 1) % 3, tip = (side + 2) % 3;
        keep_part(work, &six, side, next, 3 + tip, depth);
        keep_part(work, &six, 3 + tip, next, 3 + next, depth);
        keep_part(work, &six, 3 + tip, 3 + next, tip, depth);
        return;
    }
    keep_part(work, &six, 0, 3, 5, depth);
    keep_part(work, &six, 3, 1, 4, depth);
    keep_part(work, &six, 5, 4, 2, depth);
    keep_part(work, &six, 4, 5, 3, depth);
}

static double longest_way(const qm_vec *corner, int count)
{
    double longest2 = 0.0;
    for (int i = 0; i < count; i++)
        for (int k = 0; k < i; k++)
            longest2 = fmax(longest2, qm_vec_norm2(qm_vec_sub(corner[i], corner[k])));
    return sqrt(longest2);
}

/**
 * True when cuts along labels do not make the rest smaller fast enough. Along a ridge, where labels reach
 * little farther than what is cut off, or lose what falls with the square of the diameter as those of patches
 * do, cuts would take off one thin strip after the other.
 */
static bool is_halved(const qm_part *from, const qm_polygon *rest, bool moved)
{
    return !moved || longest_way(rest->corner, rest->count) > MIN_SHRINK * longest_way(from->corner, 3);
}

static void split_rest(qm_piece_work *work, const qm_part *from, const qm_polygon *rest, bool moved)
{
    bool halve = is_halved(from, rest, moved);
    uint8_t depth = from->depth;
    uint8_t deeper = (uint8_t)(depth < UINT8_MAX ? depth + 1 : UINT8_MAX);
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
    polygon.cuts_left = from->cuts_left;
    for (int i = 0; i < 3; i++) {
        polygon.corner[i] = from->corner[i];
        polygon.in_reach[i] = from->in_reach[i];
    }
    if (from->generation != 0 && from->generation != work->generation) qm_piece_reach_corners(work, &polygon);
    return polygon;
}

static void process_part(qm_piece_work *work, const qm_part *from)
{
    bool moved = false;
    qm_polygon rest = part_polygon(work, from);
    work->depth = from->depth;
    if (from->generation == 0) {
        if (qm_piece_cover_by_nearest(work, &rest, &moved)) return;
        qm_piece_reach_corners(work, &rest);
    } else if (work->side->target_patches && qm_piece_over_patch(work, &rest)) {
        return;
    }
    for (int attempt = 0; attempt < MAX_ATTEMPTS; attempt++) {
        if (qm_piece_cover(work, &rest, &moved)) return;
        if (qm_piece_sample_unreached(work, qm_polygon_centroid(&rest)))
            qm_piece_reach_corners(work, &rest);
        else if (!qm_piece_sample_corners(work, &rest, from->depth))
            break;
    }
    split_rest(work, from, &rest, moved);
}

void qm_piece_process_stack(qm_piece_work *work)
{
    for (int budget = VISIT_BUDGET; work->height > 0; budget--) {
        qm_part next = work->stack[--work->height];
        work->worker->iterations++;
        if (budget > 0 && next.cuts_left > 1)
            process_part(work, &next);
        else
            push_part(work, &next);
    }
    qm_worker_discard(work->worker, qm_search_cutoff(work->search));
}

void qm_piece_set_slack(qm_piece_work *work, double slack)
{
    int beyond = work->cut_limit - QM_FREE_CUTS;
    work->piece.slack = slack;
    work->slack = slack + beyond * QM_CUT_ROUNDINGS * QM_UNIT_ROUNDING * work->side->reach;
}

qm_polygon qm_piece_triangle(const qm_piece_work *work, qm_vec a, qm_vec b, qm_vec c)
{
    return (qm_polygon){.count = 3, .corner = {a, b, c}, .cuts_left = work->cut_limit - work->piece.cuts};
}

void qm_piece_keep_triangle(qm_piece_work *work, qm_vec a, qm_vec b, qm_vec c)
{
    work->stack[work->height++] = (qm_part){
        .corner = {a, b, c},
        .depth = work->piece.depth,
        .cuts_left = (uint8_t)(work->cut_limit - work->piece.cuts),
    };
}
