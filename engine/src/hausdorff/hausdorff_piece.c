/**
 * hausdorff_piece.c: the lower stage of the search: one face of the source, or a piece of one. A piece is a
 * triangle of a face, or a rectangle in the parameters of a bilinear patch.
 *
 *   the bound of a piece    piece_bound: one facet that is near all corners, or the ball round the centroid
 *   covers                  a polygon in the union of convex sets about facets of the target
 *   samples                 points that no candidate reaches are measured, which raises the lower bound
 *   triangles               cover, sample, try an overlay, split the remainder, until the budget of one visit
 *                           is used up
 *   rectangles              the hull of the corners, one patch of the target, or two triangles with a slack
 *   entry points            a new face; a piece that comes back from the queue
 *
 * A piece may be discarded once a valid upper bound of it is at most the cutoff: by convexity where one facet
 * reaches all corners, by a cover where several facets do, by a ball. HAUSDORFF.md has the lemmas.
 *
 * Termination: a corner that no candidate reaches is measured. That raises the lower bound to its distance
 * and makes its nearest facet a candidate; from QM_STRICT_DEPTH on, every corner is measured that is not
 * reached with half the tolerance to spare. A part of a diameter below that half is then covered by the
 * nearest facet of any of its corners, or of its centroid, which is measured before them and does as well.
 * Every level reduces the diameter to MIN_SHRINK of it, or halves it.
 */
#include <string.h>

#include "hausdorff_candidates.h"
#include "hausdorff_overlay.h"
#include "hausdorff_patches.h"
#include "hausdorff_sample.h"
#include "prim/bilinear_match.h"

#define VISIT_CUTS 32   /* of a part in one visit, beyond those that eta has room for */
#define VISIT_BUDGET 64 /* parts processed before the others go back to the queue */

/* Triangles */
#define PART_ATTEMPTS 4     /* covers of one part, each with candidates that the last one's corners brought */
#define MIN_SHRINK 0.6      /* of the diameter: a remainder that keeps more is cut at its midpoints */
#define SHORT_SIDE 0.1      /* of the longest: each part then has at most 0.55 of the diameter */
#define OVERLAY_INTERVAL 8  /* parts from overlay to overlay where they seldom cover one, */
#define MIN_OVERLAY_SHARE 8 /* less than one in so many */

/* New faces */
#define FACE_ATTEMPTS 3       /* covers of one face, each with the candidates that the last one brought */
#define ONE_LABEL_PACKS 3     /* searched for one label that reaches all of a piece */
#define ONE_LABEL_INTERVAL 16 /* pieces from try to try where one label seldom does: a try costs little */
#define COST_BY_NEAREST 30    /* hundreds of AVX2 instructions of a cover by the nearest facets, */
#define COST_BY_ALL 150       /* of a cover by all candidates, */
#define COST_OF_FAILURE 300   /* of all attempts, where none covers the face, */
#define COST_OF_PARTS 2000    /* of a face that is queued and comes back in parts, mostly dozens */
#define MIN_HIT_SHARE 2       /* at least one in two tries must succeed to go on */

/* Rectangles */
#define SLACK_SHARE 0.25      /* of the tolerance: a patch this flat goes on as triangles */
#define MAX_SLACK_SHARE 0.5   /* of the cutoff: a patch bent more is cut before its triangles are tried */
#define MIDPOINT_LEVELS 3     /* cut at the midpoint: grids refined by halves then meet line on line */
#define MIN_SIDE 0.7          /* of the longer side: a shorter one is cut as well */
#define MAX_REMAINDERS 32     /* parts that a match leaves over: one that leaves more is not used */
#define FEW_REMAINDERS 2      /* where a match leaves more, one patch may cover more about the centre */
#define THIN 0.06             /* of the longer side: a rectangle with a shorter one is thin */
#define MAX_LEFT 0.75         /* of the longer side of a thin rectangle may be left over */
#define RECTANGLE_ATTEMPTS 3  /* covers of one rectangle, each with candidates that its centre brought */
#define OFTEN 3               /* cuts and matches that have left a rectangle over, at least */
#define MIN_OVERLAY_SLACK 0.1 /* of the cutoff: a rectangle that is flatter goes on as triangles */
#define MIN_OVERLAY_SIZE 8.0  /* cutoffs: a rectangle that is smaller has few parts */
#define FOLD_SAMPLES 2        /* intervals between the points measured along a fold */
#define CROSSING_STEPS 40     /* of the bisection for the end of a patch */
#define INSET 1e-3            /* share of the way in at which the patch under an end is looked up */
#define CROSSING_MARGIN 1e-3  /* share of the rectangle that a cut must leave on both sides */

/** Sets the slack of the piece's triangles: how far they are from the source's surface, and the roundings of
 * the cuts that eta has no room for. */
static void set_slack(qm_piece_work *work, double slack)
{
    QM_ASSERT(!(slack < 0.0));
    int beyond = work->cut_limit - QM_FREE_CUTS;
    work->piece.slack = slack;
    work->slack = slack + beyond * QM_CUT_ROUNDINGS * QM_UNIT_ROUNDING * work->side->reach;
}

/** A triangle of the piece, with room for all cuts of a visit. */
static qm_polygon piece_triangle(const qm_piece_work *work, qm_vec a, qm_vec b, qm_vec c)
{
    return (qm_polygon){.count = 3, .corner = {a, b, c}, .cuts_left = work->cut_limit - work->piece.cuts};
}

/** Sets in_reach of all corners to the candidates that reach them. */
static void reach_corners(const qm_piece_work *work, qm_polygon *polygon)
{
    QM_ASSERT(polygon->count >= 3 && polygon->count <= QM_COVER_CORNERS);
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] = work->kernel->in_reach(&work->candidates, polygon->corner[i]);
}

/* --- The bound of a piece --- */

/**
 * Upper bound (local) of the distance of any point of a piece: the smallest, over all labels, of the largest
 * distance of a corner, or the bound by the ball where the target has patches. The distance to a convex facet
 * is convex, so its maximum over the hull of the corners is at a corner; a piece is in that hull but for its
 * slack. At most the bound of the entry that it is a piece of. hint becomes a pack near the piece.
 */
static double piece_bound(const qm_piece_work *work, const qm_piece *piece, uint32_t *hint)
{
    QM_ASSERT(piece->corner_count == 3 || piece->corner_count == 4);
    QM_ASSERT(work->candidates.count > 0);
    int index;
    double upper = work->kernel->hull_upper(&work->candidates, piece->corner, piece->corner_count, &index);
    double known = work->entry.upper * work->side->scale - work->slack;
    *hint = work->candidates.id[index];
    if (!work->side->target_patches) return upper + work->slack;
    /* The ball is measured to the patches themselves: its bound falls with the size, a label's does not. */
    upper = fmin(upper, known);
    qm_vec centroid = qm_vec_centroid(piece->corner, piece->corner_count);
    double radius = qm_vec_radius(piece->corner, piece->corner_count, centroid);
    if (radius >= upper) return upper + work->slack;
    qm_quads_query query = {
        .wanted = 1, .within = upper - radius, .enough = fmax(qm_candidates_cutoff(work), radius)};
    qm_near_quads near = qm_candidates_near_quads(work, centroid, query);
    if (near.count == 0) return upper + work->slack;
    *hint = near.at[0].pack;
    return near.at[0].distance + radius + work->slack;
}

/** Queues a triangle or rectangle with its bound, or discards it. */
static void queue_piece(qm_piece_work *work, const qm_piece *piece)
{
    qm_entry entry = work->entry;
    double upper = piece_bound(work, piece, &entry.hint);
    entry.upper = fmin(entry.upper, upper * work->side->inverse_scale);
    qm_worker_push(work->worker, entry, piece);
}

/* --- Covers --- */

/**
 * True when one label of the nearest packs reaches all corners, as far as single precision is certain. It is
 * tried where that is worth it: where surfaces nearly coincide hardly any face has one.
 */
static bool try_one_label(const qm_piece_work *work, const qm_polygon *polygon)
{
    qm_worker *worker = work->worker;
    bool is_due = worker->one_label_tries % ONE_LABEL_INTERVAL == 0;
    if (!is_due && worker->one_label_hits * MIN_HIT_SHARE < worker->one_label_probes) {
        worker->one_label_tries++;
        return false;
    }
    qm_box box = qm_vec_box(polygon->corner, polygon->count);
    uint32_t packs[ONE_LABEL_PACKS];
    double cutoff = qm_candidates_cutoff(work);
    int count = work->kernel->narrow(work->near, &box, cutoff, ONE_LABEL_PACKS, packs);
    bool is_covered = false;
    for (int k = 0; k < count && !is_covered; k++) {
        qm_float_bits bits[QM_COVER_CORNERS];
        unsigned labels = ~0u;
        work->kernel->float_reach(qm_bvh_float_pack(work->side->target, packs[k]),
                                  qm_side_twists(work->side, packs[k]), cutoff - work->slack, polygon->corner,
                                  (1u << polygon->count) - 1, bits);
        for (int i = 0; i < polygon->count; i++)
            labels &= bits[i];
        is_covered = qm_float_certain(labels);
    }
    worker->one_label_tries++;
    worker->one_label_probes++;
    worker->one_label_hits += is_covered;
    return is_covered;
}

/** Covers by the facets of a list in double precision. */
static bool cover_in_doubles(const qm_piece_work *work, const qm_shortlist *list, qm_polygon *polygon,
                             bool *moved)
{
    qm_pack rows;
    qm_candidates nearest;
    work->kernel->shortlist_pack(work->side->target, list, &rows);
    nearest.count = 1;
    nearest.pack[0] = &rows;
    double cutoff = qm_candidates_cutoff(work) - work->slack;
    for (uint32_t i = 0; i < QM_PACK_LANES; i++)
        qm_candidates_set_cutoff(&nearest, 0, i, qm_side_twist(work->side, list->pack[i], list->lane[i]),
                                 cutoff);
    uint64_t labels = ~UINT64_C(0);
    for (int i = 0; i < polygon->count; i++)
        labels &= polygon->in_reach[i] = work->kernel->in_reach(&nearest, polygon->corner[i]);
    return labels != 0 || (!polygon->is_hull && work->kernel->cover(&nearest, polygon, moved));
}

/**
 * Covers a polygon by the facets nearest to its centroid: mostly sufficient, and much cheaper than by all
 * candidates.
 */
static bool cover_by_nearest(const qm_piece_work *work, qm_polygon *polygon, bool *moved)
{
    QM_ASSERT(polygon->count == 3 || polygon->count == 4);
    if (work->near->count == 0) return false;
    if (try_one_label(work, polygon)) return true;
    qm_shortlist list;
    work->kernel->shortlist(work->side->target, work->near, qm_polygon_centroid(polygon), &list);
    const qm_bvh *target = work->side->target;
    bool has_patches = work->side->target_patches;
    qm_float_pack rows;
    _Alignas(32) float twist[QM_PACK_LANES];
    work->kernel->shortlist_float_pack(target, &list, &rows);
    for (int i = 0; has_patches && i < QM_PACK_LANES; i++)
        twist[i] = qm_bvh_twists(target, list.pack[i])[list.lane[i]];
    qm_float_verdict verdict = work->kernel->float_cover(
        &rows, has_patches ? twist : NULL, qm_candidates_cutoff(work) - work->slack, polygon, moved);
    if (verdict == QM_FLOAT_COVERED) return true;
    if (verdict == QM_FLOAT_TOO_COARSE && cover_in_doubles(work, &list, polygon, moved)) return true;
    return has_patches &&
           qm_candidates_quad_covers(work, target->lanes[list.pack[0]].face[list.lane[0]], polygon);
}

/** Covers by refined labels; in_reach is of the candidates again when something remains. */
static bool cover_by_refined(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon,
                             bool *moved)
{
    if (qm_candidates_cover_refined(work, refined, polygon, moved)) return true;
    reach_corners(work, polygon);
    return false;
}

/**
 * Covers a polygon by all candidates, and by refined labels where refined is not NULL: by these first where
 * the polygon is a part of the piece (depth > 0). in_reach is not set afterwards.
 */
static bool cover_with(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon, bool *moved)
{
    bool is_part = work->depth > 0;
    if (refined && is_part && cover_by_refined(work, refined, polygon, moved)) return true;
    if (work->kernel->cover(&work->candidates, polygon, moved)) return true;
    return refined && !is_part && cover_by_refined(work, refined, polygon, moved);
}

/** Makes refined labels for a polygon from the quads near its centroid. */
static bool refine(const qm_piece_work *work, const qm_polygon *polygon, qm_refined *refined)
{
    if (!work->side->target_patches) return false;
    qm_vec centroid = qm_polygon_centroid(polygon);
    double cutoff = qm_candidates_cutoff(work),
           radius = qm_vec_radius(polygon->corner, polygon->count, centroid);
    qm_quads_query query = {
        .wanted = QM_NEAR_QUADS, .within = cutoff + radius, .enough = cutoff, .twisted_only = true};
    qm_near_quads near = qm_candidates_near_quads(work, centroid, query);
    return qm_candidates_refine(work, polygon, centroid, &near, refined);
}

/**
 * Covers as cover_with does; makes the refined labels only when it comes to them. A remainder gets labels of
 * its own: the patches nearest to its centroid are others than those of the whole, where many meet.
 */
static bool cover_polygon(const qm_piece_work *work, qm_polygon *polygon, bool *moved)
{
    qm_refined refined;
    bool is_refined, is_covered, is_cut = false;
    if (work->depth > 0) {
        is_refined = refine(work, polygon, &refined);
        is_covered = cover_with(work, is_refined ? &refined : NULL, polygon, &is_cut);
    } else {
        if (work->kernel->cover(&work->candidates, polygon, moved)) return true;
        is_refined = refine(work, polygon, &refined);
        is_covered = is_refined && cover_by_refined(work, &refined, polygon, &is_cut);
    }
    if (is_covered) return true;
    *moved |= is_cut;
    return is_refined && is_cut && refine(work, polygon, &refined) &&
           cover_by_refined(work, &refined, polygon, moved);
}

/* --- Samples --- */

/**
 * True when a patch among the candidates is nearer than the cutoff by room, the patch itself and not its
 * label, which loses the twist: a search for the nearest facet would bring no new candidate.
 */
static bool patch_reaches(const qm_piece_work *work, qm_vec p, double room)
{
    return work->side->target_patches &&
           qm_candidates_quad_within(work, p, qm_candidates_cutoff(work) - room - work->slack);
}

/** True when a corner has to be measured: no candidate reaches it, or, deep down, none with room. */
static bool needs_sample(const qm_piece_work *work, const qm_polygon *polygon, int i, int depth)
{
    qm_vec p = polygon->corner[i];
    if (depth < QM_STRICT_DEPTH) return polygon->in_reach[i] == 0 && !patch_reaches(work, p, 0.0);
    int index;
    double upper = work->kernel->hull_upper(&work->candidates, &p, 1, &index) + work->slack;
    double room = 0.5 * work->search->tolerance * work->side->scale;
    return upper > qm_candidates_cutoff(work) - room && !patch_reaches(work, p, room);
}

/**
 * Measures the corners that need it. True when that brought a candidate or raised the lower bound: in_reach
 * is then set again.
 */
static bool sample_corners(qm_piece_work *work, qm_polygon *polygon, int depth)
{
    bool found = false;
    for (int i = 0; i < polygon->count; i++) {
        if (!needs_sample(work, polygon, i, depth)) continue;
        uint32_t hint = work->packs[0];
        qm_sample_point(work->worker, work->side, polygon->corner[i], work->slack, work->piece.face, 0.0,
                        &hint);
        found |= qm_candidates_add(work, hint);
    }
    /* A corner that raised the lower bound is reached now, by the pack that was its nearest all along. */
    found |= qm_candidates_cutoff(work) > work->filled_for;
    if (found) {
        qm_candidates_refill(work);
        reach_corners(work, polygon);
    }
    return found;
}

/**
 * Measures a point of a piece when the candidates do not reach it. True when that brought a candidate or
 * raised the lower bound, so that another try may succeed.
 */
static bool sample_unreached(qm_piece_work *work, qm_vec p)
{
    int index;
    double upper = work->kernel->hull_upper(&work->candidates, &p, 1, &index);
    if (upper + work->slack <= qm_candidates_cutoff(work) || patch_reaches(work, p, 0.0)) return false;
    uint32_t hint = work->candidates.id[index];
    qm_sample_point(work->worker, work->side, p, work->slack, work->piece.face, 0.0, &hint);
    bool added = qm_candidates_add(work, hint);
    bool raised = qm_candidates_cutoff(work) > work->filled_for;
    if (added || raised) qm_candidates_refill(work);
    return added || raised;
}

/* --- Triangles --- */

static void queue_part(qm_piece_work *work, const qm_part *from)
{
    qm_piece piece = work->piece;
    piece.corner_count = 3;
    piece.cuts = (uint16_t)(work->cut_limit - from->cuts_left);
    piece.depth = from->depth;
    for (int i = 1; i + 1 < from->count; i++) {
        piece.corner[0] = from->corner[0];
        piece.corner[1] = from->corner[i];
        piece.corner[2] = from->corner[i + 1];
        queue_piece(work, &piece);
    }
}

/** Puts a triangle or a strip of a polygon on the stack; queues it when the stack is full. */
static void stack_part(qm_piece_work *work, const qm_polygon *polygon, const int *index, int count,
                       uint8_t depth)
{
    QM_ASSERT(work->height >= 0 && work->height <= QM_PART_STACK);
    QM_ASSERT(count == 3 || count == 4);
    qm_part kept = {.generation = work->generation,
                    .count = (uint8_t)count,
                    .depth = depth,
                    .cuts_left = (uint8_t)polygon->cuts_left};
    for (int i = 0; i < count; i++) {
        kept.corner[i] = polygon->corner[index[i]];
        kept.in_reach[i] = polygon->in_reach[index[i]];
    }
    if (work->height < QM_PART_STACK)
        work->stack[work->height++] = kept;
    else
        queue_part(work, &kept);
}

/** Appends the midpoint of two corners to a polygon; returns its place. */
static int append_midpoint(const qm_piece_work *work, qm_polygon *polygon, int a, int b)
{
    QM_ASSERT(polygon->count < QM_COVER_CORNERS);
    qm_vec at = qm_vec_mix(polygon->corner[a], polygon->corner[b], 0.5);
    polygon->corner[polygon->count] = at;
    polygon->in_reach[polygon->count] = work->kernel->in_reach(&work->candidates, at);
    return polygon->count++;
}

/** The first of two opposite sides of four corners that are short beside the others; -1 where there are none. */
static int find_strip_side(const qm_polygon *polygon)
{
    if (polygon->count != 4) return -1;
    double length2[4], max2 = 0.0;
    for (int i = 0; i < 4; i++) {
        length2[i] = qm_vec_norm2(qm_vec_sub(polygon->corner[(i + 1) % 4], polygon->corner[i]));
        max2 = fmax(max2, length2[i]);
    }
    for (int i = 0; i < 2; i++)
        if (fmax(length2[i], length2[i + 2]) < SHORT_SIDE * SHORT_SIDE * max2) return i;
    return -1;
}

/** Puts a strip on the stack in two parts, cut across. */
static void stack_halves(qm_piece_work *work, qm_polygon *strip, int side, uint8_t depth)
{
    const int at[4] = {side, side + 1, (side + 2) % 4, (side + 3) % 4};
    int ahead = append_midpoint(work, strip, at[1], at[2]),
        behind = append_midpoint(work, strip, at[3], at[0]);
    stack_part(work, strip, (const int[]){at[0], at[1], ahead, behind}, 4, depth);
    stack_part(work, strip, (const int[]){behind, ahead, at[2], at[3]}, 4, depth);
}

/**
 * Puts a triangle of a polygon on the stack in four parts, cut at the midpoints: each has half the diameter.
 * A side much shorter than the others is not cut: else two or three parts share its location on every level,
 * and where that is the one that is hard to cover, they would be exponentially many. What is beside it stays one part, a
 * strip, for the same reason: of two triangles each would be cut in two again there. The cut is the one that
 * process_part reserves.
 */
static void stack_quarters(qm_piece_work *work, const qm_polygon *polygon, int a, int b, int c, uint8_t depth)
{
    const int index[3] = {a, b, c};
    qm_polygon six;
    six.count = 3;
    six.cuts_left = polygon->cuts_left;
    for (int i = 0; i < 3; i++) {
        six.corner[i] = polygon->corner[index[i]];
        six.in_reach[i] = polygon->in_reach[index[i]];
    }
    double min2 = INFINITY, max2 = 0.0;
    int side = 0; /* the shortest, i to i + 1 */
    for (int i = 0; i < 3; i++) {
        append_midpoint(work, &six, i, (i + 1) % 3);
        double length2 = qm_vec_norm2(qm_vec_sub(six.corner[(i + 1) % 3], six.corner[i]));
        max2 = fmax(max2, length2);
        if (!(length2 < min2)) continue;
        min2 = length2;
        side = i;
    }
    if (min2 < SHORT_SIDE * SHORT_SIDE * max2) {
        int next = (side + 1) % 3, tip = (side + 2) % 3;
        stack_part(work, &six, (const int[]){side, next, 3 + next, 3 + tip}, 4, depth);
        stack_part(work, &six, (const int[]){3 + tip, 3 + next, tip}, 3, depth);
        return;
    }
    stack_part(work, &six, (const int[]){0, 3, 5}, 3, depth);
    stack_part(work, &six, (const int[]){3, 1, 4}, 3, depth);
    stack_part(work, &six, (const int[]){5, 4, 2}, 3, depth);
    stack_part(work, &six, (const int[]){4, 5, 3}, 3, depth);
}

/** The diameter of a polygon. */
static double diameter(const qm_vec *corner, int count)
{
    double longest2 = 0.0;
    for (int i = 0; i < count; i++)
        for (int k = 0; k < i; k++)
            longest2 = fmax(longest2, qm_vec_norm2(qm_vec_sub(corner[i], corner[k])));
    return sqrt(longest2);
}

/**
 * Puts what a cover leaves on the stack. Cuts along labels may not reduce the remainder fast enough: along a
 * ridge, where labels reach little farther than the part that is cut off, or lose an amount that falls with
 * the square of the diameter as labels of patches do, they take off one thin strip after the other. Such a
 * remainder, and one that no cut has changed, is cut at its midpoints.
 */
static void split_remainder(qm_piece_work *work, const qm_part *from, qm_polygon *remainder, bool moved)
{
    bool halve = !moved || diameter(remainder->corner, remainder->count) >
                               MIN_SHRINK * diameter(from->corner, from->count);
    if (!halve) remainder->cuts_left++;
    uint8_t depth = from->depth;
    uint8_t deeper = (uint8_t)(depth < UINT8_MAX ? depth + 1 : UINT8_MAX);
    int strip_side = find_strip_side(remainder);
    if (strip_side >= 0) {
        if (halve)
            stack_halves(work, remainder, strip_side, deeper);
        else
            stack_part(work, remainder, (const int[]){0, 1, 2, 3}, 4, deeper);
        return;
    }
    for (int i = 1; i + 1 < remainder->count; i++) {
        if (halve)
            stack_quarters(work, remainder, 0, i, i + 1, deeper);
        else
            stack_part(work, remainder, (const int[]){0, i, i + 1}, 3, deeper);
    }
}

/**
 * True when an overlay shows a part to be within the cutoff. It is tried where that is worth it: a part over
 * many facets may be cut dozens of times, and one over a ridge is never covered by an overlay.
 */
static bool overlay_reached(const qm_piece_work *work, const qm_part *part)
{
    qm_worker *worker = work->worker;
    bool is_due = worker->overlay_part_tries++ % OVERLAY_INTERVAL == 0;
    if (!is_due && worker->overlay_part_hits * MIN_OVERLAY_SHARE < worker->overlay_part_probes) return false;
    uint64_t before = worker->overlay_cost;
    bool is_covered = true;
    for (int i = 1; i + 1 < part->count && is_covered; i++) {
        const qm_vec triangle[3] = {part->corner[0], part->corner[i], part->corner[i + 1]};
        is_covered = qm_overlay_test_face(worker, work->side, triangle, work->slack, work->near);
    }
    worker->overlay_cost = before; /* it is about the overlays of whole faces */
    worker->overlay_part_probes++;
    worker->overlay_part_hits += is_covered;
    return is_covered;
}

/** Covers by patches; in_reach is of the candidates again when something remains. */
static qm_patches_cover cover_by_patches(const qm_piece_work *work, qm_polygon *polygon)
{
    if (!work->side->target_patches) return QM_PATCHES_NONE;
    qm_patches_cover covered = qm_patches_cover_polygon(work, polygon);
    if (covered == QM_PATCHES_SOME) reach_corners(work, polygon);
    return covered;
}

/**
 * Covers a part with samples where that fails. False when something remains: *moved is then set where that is less than
 * before. A part that is over one patch, and too coarse for its bound, is not tried on: labels seldom reach all of it,
 * and what they cut off leaves slivers, which take more parts than its quarters.
 */
static bool part_covered(qm_piece_work *work, qm_polygon *polygon, bool *moved)
{
    qm_patches_cover by_patches = cover_by_patches(work, polygon);
    if (by_patches == QM_PATCHES_ALL) return true;
    if (by_patches == QM_PATCHES_COARSE && work->depth < QM_STRICT_DEPTH) return false;
    *moved |= by_patches == QM_PATCHES_SOME;
    for (int attempt = 0; attempt < PART_ATTEMPTS; attempt++) {
        if (cover_polygon(work, polygon, moved)) return true;
        if (sample_unreached(work, qm_polygon_centroid(polygon)))
            reach_corners(work, polygon);
        else if (!sample_corners(work, polygon, work->depth))
            break;
    }
    return false;
}

/** Covers a part; puts what remains on the stack. */
static void process_part(qm_piece_work *work, const qm_part *from)
{
    QM_ASSERT(from->cuts_left > 1);
    bool moved = false;
    /* One cut is reserved for that into quarters. */
    qm_polygon polygon;
    polygon.count = from->count;
    polygon.is_hull = false;
    polygon.cuts_left = from->cuts_left - 1;
    for (int i = 0; i < from->count; i++) {
        polygon.corner[i] = from->corner[i];
        polygon.in_reach[i] = from->in_reach[i];
    }
    if (from->generation != 0 && from->generation != work->generation) reach_corners(work, &polygon);
    work->depth = from->depth;
    if (from->generation == 0) {
        if (cover_by_nearest(work, &polygon, &moved)) return;
        reach_corners(work, &polygon);
    }
    if (part_covered(work, &polygon, &moved) || overlay_reached(work, from)) return;
    split_remainder(work, from, &polygon, moved);
}

/** Puts a triangle of the piece on the stack of parts. */
static void stack_triangle(qm_piece_work *work, qm_vec a, qm_vec b, qm_vec c)
{
    QM_ASSERT(work->height < QM_PART_STACK);
    work->stack[work->height++] = (qm_part){
        .corner = {a, b, c},
        .count = 3,
        .depth = work->piece.depth,
        .cuts_left = (uint8_t)(work->cut_limit - work->piece.cuts),
    };
}

/** Processes the stack of parts; queues the parts that the budget of one visit does not reach. */
static void process_stack(qm_piece_work *work)
{
    for (int budget = VISIT_BUDGET; work->height > 0; budget--) {
        qm_part next = work->stack[--work->height];
        work->worker->iterations++;
        if (budget > 0 && next.cuts_left > 1) {
            process_part(work, &next);
            /* The parts beside one that raised the lower bound have nearly its distance. */
            qm_worker_follow(work->worker);
            if (qm_candidates_cutoff(work) > work->filled_for) qm_candidates_refill(work);
        } else
            queue_part(work, &next);
    }
    qm_worker_discard(work->worker, qm_search_cutoff(work->search));
}

/* --- Rectangles --- */

/** The patch of the source that the piece is a rectangle of. */
static qm_bilinear source_patch(const qm_piece_work *work)
{
    const uint32_t *vertex = work->side->source->mesh.faces + 4 * (size_t)work->piece.face;
    qm_vec corner[4];
    for (int i = 0; i < 4; i++)
        corner[i] = qm_side_vertex(work->side, vertex[i]);
    return qm_bilinear_make(corner);
}

/** True when one label reaches the hull of the four corners, which holds that part of the patch. */
static bool hull_reached(const qm_piece_work *work, qm_polygon *corners)
{
    uint64_t labels = ~UINT64_C(0);
    corners->count = 4;
    corners->is_hull = true;
    for (int i = 0; i < 4; i++) {
        corners->corner[i] = work->piece.corner[i];
        corners->in_reach[i] = work->kernel->in_reach(&work->candidates, work->piece.corner[i]);
        labels &= corners->in_reach[i];
    }
    return labels != 0;
}

/**
 * Along the line where a patch of the target is just as far as the cutoff, the patch covers a share of each
 * part that is left over, again and again: such parts are worth the search for a patch that covers more.
 */
static bool is_left_often(const qm_piece_work *work)
{
    return work->piece.depth >= OFTEN;
}

/** Covers the two triangles of a rectangle, with the slack by which the patch may leave them; near are quads
 * near its centre. */
static bool triangles_reached(qm_piece_work *work, const qm_bilinear_halves *halves, qm_vec centre,
                              const qm_near_quads *near)
{
    set_slack(work, halves->slack);
    qm_candidates_refill(work);
    const qm_vec *c = halves->corner;
    qm_polygon whole = {.count = 4, .is_hull = true, .corner = {c[0], c[1], c[2], c[3]}};
    qm_refined refined;
    bool is_refined = qm_candidates_refine(work, &whole, centre, near, &refined);
    bool covered = true, moved = false;
    /* A cover of a whole triangle has a label for each of its corners. */
    for (int i = 0; i < 4 && covered; i++) {
        whole.in_reach[i] = work->kernel->in_reach(&work->candidates, c[i]);
        covered = is_refined || whole.in_reach[i] != 0;
    }
    for (int half = 0; half < 2 && covered; half++) {
        qm_polygon polygon = piece_triangle(work, c[0], c[1 + half], c[2 + half]);
        for (int i = 0; i < 3; i++)
            polygon.in_reach[i] = whole.in_reach[i == 0 ? 0 : half + i];
        covered = cover_with(work, is_refined ? &refined : NULL, &polygon, &moved);
    }
    set_slack(work, 0.0);
    qm_candidates_refill(work);
    return covered;
}

/** The last parameter along [from, to] up to which the target's patch under the point at from is within
 * reach; from when not even that is. */
static double patch_reach(const qm_piece_work *work, const qm_bilinear *source, int axis, double from,
                          double to)
{
    double at[2] = {0.5 * (work->piece.low[0] + work->piece.high[0]),
                    0.5 * (work->piece.low[1] + work->piece.high[1])};
    at[axis] = from + INSET * (to - from); /* off the line where two patches meet */
    qm_hit hit = {.d2 = INFINITY, .pack = work->packs[0]};
    work->kernel->closest(work->side->target, qm_bilinear_at(source, at[0], at[1]), &hit);
    qm_vec corner[4];
    if (qm_bvh_load_face(work->side->target, work->side->target->lanes[hit.pack].face[hit.lane], corner) != 4)
        return from;
    qm_bilinear target = qm_bilinear_make(corner);
    /* Half the cutoff: the speed along this line may be up to twice as great at the rectangle's sides. */
    double cutoff = 0.5 * qm_candidates_cutoff(work), inside = from, outside = to;
    for (int step = 0; step < CROSSING_STEPS; step++) {
        at[axis] = step == 0 ? to : 0.5 * (inside + outside);
        bool is_reached =
            qm_bilinear_minimise(&target, qm_bilinear_at(source, at[0], at[1]), cutoff).distance <= cutoff;
        if (is_reached && step == 0) return to;
        *(is_reached ? &inside : &outside) = at[axis];
    }
    return inside;
}

/**
 * The parameter to cut at: the midpoint, but deep down on every second level the position where the rectangle
 * leaves the patch of the target under one of its ends. Where two surfaces coincide only such cuts end.
 */
static double cut_parameter(const qm_piece_work *work, const qm_bilinear *patch, int axis)
{
    double low = work->piece.low[axis], high = work->piece.high[axis],
           margin = CROSSING_MARGIN * (high - low);
    if (work->side->target_patches && work->piece.depth > MIDPOINT_LEVELS && work->piece.depth % 2 == 1) {
        for (int end = 0; end < 2; end++) {
            double cut = patch_reach(work, patch, axis, end ? high : low, end ? low : high);
            if (cut > low + margin && cut < high - margin) return cut;
        }
    }
    return 0.5 * (low + high);
}

/** Queues the part of the rectangle between these parameters. */
static void queue_rectangle(qm_piece_work *work, const qm_bilinear *patch, const double low[2],
                            const double high[2])
{
    QM_ASSERT(!(low[0] > high[0]) && !(low[1] > high[1]));
    qm_piece part = work->piece;
    part.depth = (uint8_t)(part.depth < UINT8_MAX ? part.depth + 1 : UINT8_MAX);
    for (int k = 0; k < 2; k++) {
        part.low[k] = low[k];
        part.high[k] = high[k];
    }
    part.corner[0] = qm_bilinear_at(patch, low[0], low[1]);
    part.corner[1] = qm_bilinear_at(patch, high[0], low[1]);
    part.corner[2] = qm_bilinear_at(patch, high[0], high[1]);
    part.corner[3] = qm_bilinear_at(patch, low[0], high[1]);
    queue_piece(work, &part);
}

/** The parts of a rectangle that a match leaves over. */
typedef struct remainder_list {
    int count; /* may exceed MAX_REMAINDERS, which are kept */
    qm_uv_box at[MAX_REMAINDERS];
} remainder_list;

static void keep_remainder(void *user, const qm_uv_box *part)
{
    remainder_list *list = user;
    if (list->count < MAX_REMAINDERS) list->at[list->count] = *part;
    list->count++;
}

static void queue_remainder(qm_piece_work *work, const qm_bilinear *patch, const remainder_list *remainder)
{
    for (int i = 0; i < remainder->count; i++)
        queue_rectangle(work, patch, remainder->at[i].low, remainder->at[i].high);
}

/** Sums of the lengths of opposite sides. */
static void side_lengths(const qm_vec c[4], double side[2])
{
    side[0] = qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]);
    side[1] = qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2]);
}

/**
 * Whether to go on with the remainder of a match. Beside an edge of the target each match may halve a strip
 * and leave the half at the edge, as long as before, without an end: a thin rectangle must be covered
 * completely, or its remainder must be shorter.
 */
static bool makes_progress(const qm_piece_work *work, const qm_bilinear *patch,
                           const remainder_list *remainder)
{
    double side[2];
    side_lengths(work->piece.corner, side);
    if (remainder->count > MAX_REMAINDERS) return false;
    double longer = qm_max(side[0], side[1]);
    if (qm_min(side[0], side[1]) > THIN * longer) return true;
    for (int i = 0; i < remainder->count; i++) {
        qm_vec corner[4];
        double left[2];
        qm_uv_box_corners(patch, &remainder->at[i], corner);
        side_lengths(corner, left);
        if (qm_max(left[0], left[1]) > MAX_LEFT * longer) return false;
    }
    return true;
}

static qm_uv_box parameters_of(const qm_piece *piece)
{
    return (qm_uv_box){{piece->low[0], piece->low[1]}, {piece->high[0], piece->high[1]}};
}

/** Covers the rectangle, or parts of it, by a face of the target with nearly the same corners; remainder
 * becomes the parts that are left. */
static bool alike_reached(const qm_piece_work *work, const qm_bilinear *patch, uint32_t face,
                          remainder_list *remainder)
{
    qm_vec corner[4];
    remainder->count = 0;
    if (qm_bvh_load_face(work->side->target, face, corner) != 4) return false;
    qm_uv_box box = parameters_of(&work->piece);
    qm_bilinear alike = qm_bilinear_make(corner);
    return qm_bilinear_match_coincident(patch, &box, &alike, qm_candidates_cutoff(work), keep_remainder,
                                        remainder) &&
           makes_progress(work, patch, remainder);
}

/**
 * Covers by the target's face of the same index. Meshes that nearly coincide are mostly one mesh twice; in a
 * heap of patches that cross each other hundreds of others are as near to the centre of a face, and no search
 * distinguishes its counterpart from them.
 */
static bool counterpart_reached(const qm_piece_work *work, const qm_bilinear *patch,
                                remainder_list *remainder)
{
    remainder->count = 0;
    return work->side->target_patches && work->piece.face < work->side->target->mesh.face_count &&
           alike_reached(work, patch, work->piece.face, remainder);
}

/** Covers all of the rectangle by a quad of the hinted pack: over copies of one face no footpoint need be
 * found. */
static bool hinted_reached(const qm_piece_work *work, const qm_bilinear *patch)
{
    const qm_pack_lanes *lanes = &work->side->target->lanes[work->entry.hint];
    remainder_list remainder;
    for (uint32_t lane = 1; work->side->target_patches && lane < lanes->lane_count; lane++)
        if (qm_lane_is_second(lanes, lane) && alike_reached(work, patch, lanes->face[lane], &remainder) &&
            remainder.count == 0)
            return true;
    return false;
}

/** Covers the rectangle, or parts of it, by one of the quads near its centre: the first that covers any of
 * it, or, once it is left over often, the one that leaves the smallest area. */
static bool match_reached(const qm_piece_work *work, const qm_bilinear *patch, qm_vec centre,
                          qm_near_quads *near, remainder_list *smallest)
{
    qm_uv_box box = parameters_of(&work->piece);
    double left = INFINITY;
    for (int i = 0; i < near->count && left > 0.0; i++) {
        qm_near_quad *quad = &near->at[i];
        remainder_list remainder;
        qm_candidates_find_foot(quad, centre);
        remainder.count = 0;
        bool is_matched = qm_bilinear_match(patch, &box, &quad->patch, quad->uv, qm_candidates_cutoff(work),
                                            keep_remainder, &remainder);
        if (!is_matched || !makes_progress(work, patch, &remainder)) continue;
        double area = 0.0; /* in the parameters */
        for (int k = 0; k < remainder.count; k++) {
            const qm_uv_box *part = &remainder.at[k];
            area += (part->high[0] - part->low[0]) * (part->high[1] - part->low[1]);
        }
        if (!(area < left)) continue;
        left = area;
        QM_ASSERT(remainder.count <= MAX_REMAINDERS);
        smallest->count = remainder.count;
        memcpy(smallest->at, remainder.at, (size_t)remainder.count * sizeof *remainder.at);
        if (!is_left_often(work)) break;
    }
    return left < INFINITY;
}

/** Covers the part about the centre by the patch under it: remainder becomes what is left beside it. */
static bool middle_reached(const qm_piece_work *work, const qm_bilinear *patch, qm_vec centre,
                           qm_near_quads *near, remainder_list *remainder)
{
    qm_uv_box middle, whole = parameters_of(&work->piece);
    if (near->count == 0 || !qm_patches_cover_middle(work, patch, centre, &near->at[0], &middle))
        return false;
    remainder->count = qm_uv_box_strips(&whole, &middle, remainder->at);
    return makes_progress(work, patch, remainder);
}

/**
 * Covers the rectangle, or parts of it, by one patch; near becomes the quads near its centre, when they were
 * needed. The counterpart may leave parts of a whole face only: where it is just as far as the cutoff it
 * would leave parts of parts endlessly.
 */
static bool patch_reached(const qm_piece_work *work, const qm_bilinear *patch, qm_vec centre,
                          qm_near_quads *near, remainder_list *remainder)
{
    near->count = 0;
    if (counterpart_reached(work, patch, remainder) && (remainder->count == 0 || work->piece.depth == 0))
        return true;
    if (work->side->target_patches) {
        double cutoff = qm_candidates_cutoff(work), radius = qm_vec_radius(work->piece.corner, 4, centre);
        qm_quads_query query = {.wanted = QM_NEAR_QUADS,
                                .within = cutoff + radius,
                                .enough = is_left_often(work) ? -1.0 : cutoff};
        *near = qm_candidates_near_quads(work, centre, query);
    }
    return match_reached(work, patch, centre, near, remainder);
}

/**
 * Cuts a rectangle across its longer side; over a target without patches across both where they are about as
 * long, since slack is only halved with each cut, and a rectangle that needs one mostly needs the next.
 */
static void split_rectangle(qm_piece_work *work, const qm_bilinear *patch)
{
    double side[2];
    side_lengths(work->piece.corner, side);
    const double *low = work->piece.low, *high = work->piece.high;
    int longer = side[0] >= side[1] ? 0 : 1;
    double cut[2];
    int parts[2];
    for (int k = 0; k < 2; k++) {
        bool is_cut = k == longer || (!work->side->target_patches && side[k] > MIN_SIDE * side[longer]);
        parts[k] = is_cut ? 2 : 1;
        cut[k] = is_cut ? cut_parameter(work, patch, k) : high[k];
    }
    for (int i = 0; i < parts[0]; i++)
        for (int j = 0; j < parts[1]; j++)
            queue_rectangle(work, patch, (const double[]){i ? cut[0] : low[0], j ? cut[1] : low[1]},
                            (const double[]){i ? high[0] : cut[0], j ? high[1] : cut[1]});
}

/** Covers a rectangle by the facets nearest to it: its hull by one, or its two triangles with the slack of
 * the patch. */
static bool rectangle_is_covered(qm_piece_work *work)
{
    const qm_vec *c = work->piece.corner;
    qm_bilinear patch = source_patch(work);
    remainder_list remainder;
    if (counterpart_reached(work, &patch, &remainder) && remainder.count == 0) return true;
    if (hinted_reached(work, &patch)) return true;
    qm_polygon hull = {.count = 4, .is_hull = true, .corner = {c[0], c[1], c[2], c[3]}};
    bool moved = false, covered = cover_by_nearest(work, &hull, &moved);
    if (covered) return true;
    qm_bilinear_halves halves = qm_bilinear_halve(c, (qm_vec){0, 0, 0});
    if (!(halves.slack < MAX_SLACK_SHARE * qm_candidates_cutoff(work))) return false;
    set_slack(work, halves.slack);
    covered = true;
    for (int half = 0; half < 2 && covered; half++) {
        const qm_vec *h = halves.corner;
        qm_polygon triangle = piece_triangle(work, h[0], h[1 + half], h[2 + half]);
        covered = cover_by_nearest(work, &triangle, &moved);
    }
    set_slack(work, 0.0);
    return covered;
}

/**
 * Measures points of the line along which a patch of the source is folded over, where that crosses the rectangle: the
 * surface ends there, so that the distance often has a ridge along it, which samples on both sides of the line miss.
 */
static void sample_fold(qm_piece_work *work, const qm_bilinear *patch)
{
    const qm_uv_box box = parameters_of(&work->piece);
    qm_bilinear_jacobian area = qm_bilinear_jacobian_make(patch);
    double end[2][2];
    int count = 0;
    for (int k = 0; k < 4 && count < 2; k++) { /* the side of an axis from low to high, the other one fixed */
        int axis = k / 2;
        double at[2], fixed = k % 2 ? box.high[1 - axis] : box.low[1 - axis];
        at[1 - axis] = fixed;
        at[axis] = -(area.at + area.rise[1 - axis] * fixed) / area.rise[axis];
        if (!(at[axis] >= box.low[axis] && at[axis] <= box.high[axis])) continue;
        end[count][0] = at[0];
        end[count][1] = at[1];
        count++;
    }
    if (count < 2) return;
    for (int i = 0; i <= FOLD_SAMPLES; i++) {
        double share = (double)i / FOLD_SAMPLES;
        sample_unreached(work, qm_bilinear_at(patch, end[0][0] + share * (end[1][0] - end[0][0]),
                                              end[0][1] + share * (end[1][1] - end[0][1])));
    }
}

/**
 * A rectangle so small that a sample of any point of it ends it: cuts at the border of what a patch reaches
 * would come down to rectangles between neighbouring numbers, of which a match covers nothing.
 */
static bool is_small(const qm_piece_work *work)
{
    const qm_vec *corner = work->piece.corner;
    return diameter(corner, 4) <= 0.5 * work->search->tolerance * work->side->scale;
}

/**
 * Covers a rectangle that is bent against its distance by an overlay, where that is over triangles: it may be over many of them
 * where it is much larger than the distance.
 */
static bool rectangle_overlaid(const qm_piece_work *work, const qm_bilinear_halves *halves)
{
    double cutoff = qm_candidates_cutoff(work);
    if (!(halves->slack > MIN_OVERLAY_SLACK * cutoff &&
          diameter(work->piece.corner, 4) > MIN_OVERLAY_SIZE * cutoff))
        return false;
    return qm_overlay_test_patch(work->worker, work->side, work->piece.corner, work->near);
}

/** Covers a rectangle by all candidates and those that a sample of its centre brings; else *corners are its
 * own, with in_reach. */
static bool rectangle_reached(qm_piece_work *work, const qm_bilinear *patch, const qm_bilinear_halves *halves,
                              qm_polygon *corners)
{
    const qm_piece *piece = &work->piece;
    qm_vec centre =
        qm_bilinear_at(patch, 0.5 * (piece->low[0] + piece->high[0]), 0.5 * (piece->low[1] + piece->high[1]));
    for (int attempt = 0; attempt < RECTANGLE_ATTEMPTS; attempt++) {
        if (hull_reached(work, corners)) return true;
        remainder_list remainder, left;
        qm_near_quads near;
        bool is_matched = patch_reached(work, patch, centre, &near, &remainder);
        if (is_matched && remainder.count == 0) return true;
        bool is_flat = halves->slack < qm_candidates_cutoff(work);
        if (is_flat && triangles_reached(work, halves, centre, &near)) return true;
        if (attempt == 0 && near.count == 0 && rectangle_overlaid(work, halves)) return true;
        if (attempt == 0 && !is_small(work) && !(is_matched && remainder.count <= FEW_REMAINDERS) &&
            middle_reached(work, patch, centre, &near, &left)) {
            queue_remainder(work, patch, &left);
            return true;
        }
        bool has_new = false; /* candidates, or a larger lower bound */
        for (int i = 0; i < 4 && is_matched && is_left_often(work) && attempt + 1 < RECTANGLE_ATTEMPTS; i++)
            has_new |= sample_unreached(work, work->piece.corner[i]);
        if (is_matched && !has_new && !is_small(work)) {
            queue_remainder(work, patch, &remainder);
            return true;
        }
        if (!is_matched && !sample_unreached(work, centre)) break;
    }
    return false;
}

/** Covers a rectangle; else goes on with its two triangles, which a flat patch leaves by a share of the
 * tolerance, or cuts it in parts for the queue. */
static void process_rectangle(qm_piece_work *work)
{
    qm_polygon corners;
    qm_bilinear_halves halves = qm_bilinear_halve(work->piece.corner, (qm_vec){0, 0, 0});
    qm_bilinear patch = source_patch(work);
    bool reached = rectangle_reached(work, &patch, &halves, &corners);
    qm_worker_discard(work->worker, qm_search_cutoff(work->search));
    if (reached) return;
    if (halves.slack <= SLACK_SHARE * work->search->tolerance * work->side->scale) {
        set_slack(work, halves.slack);
        qm_candidates_refill(work);
        stack_triangle(work, halves.corner[0], halves.corner[1], halves.corner[2]);
        stack_triangle(work, halves.corner[0], halves.corner[2], halves.corner[3]);
        process_stack(work);
        return;
    }
    sample_corners(work, &corners, QM_STRICT_DEPTH);
    sample_fold(work, &patch);
    split_rectangle(work, &patch);
}

/* --- Entry points --- */

static void start_work(qm_piece_work *work, qm_worker *worker, qm_entry entry, const qm_piece *piece,
                       const qm_near_packs *near)
{
    QM_ASSERT(entry.side < worker->search->side_count);
    QM_ASSERT(piece->corner_count == 3 || piece->corner_count == 4);
    work->worker = worker;
    work->search = worker->search;
    work->side = &worker->search->side[entry.side];
    work->kernel = worker->search->kernel;
    work->entry = entry;
    work->piece = *piece;
    work->depth = piece->depth;
    int room = piece->cuts + VISIT_CUTS;
    work->cut_limit = room > QM_FREE_CUTS ? room : QM_FREE_CUTS;
    set_slack(work, piece->slack);
    work->generation = 1;
    work->height = 0;
    work->near = near;
}

void qm_piece_visit(qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    QM_ASSERT(worker && piece);
    QM_ASSERT(entry.kind == QM_ENTRY_PIECE);
    qm_piece_work work;
    qm_near_packs near;
    start_work(&work, worker, entry, piece, NULL);
    qm_candidates_gather(&work, &near);
    if (piece->corner_count == 4) {
        process_rectangle(&work);
        return;
    }
    stack_triangle(&work, piece->corner[0], piece->corner[1], piece->corner[2]);
    process_stack(&work);
}

/** Covers a triangle of the source by the nearest facets, then by all candidates and those that samples
 * bring; else queues it. */
static void process_face(qm_piece_work *work)
{
    qm_worker *worker = work->worker;
    const qm_vec *corner = work->piece.corner;
    qm_polygon polygon = piece_triangle(work, corner[0], corner[1], corner[2]);
    bool moved = false;
    worker->cover_tries++;
    worker->cover_cost += COST_BY_NEAREST;
    if (cover_by_nearest(work, &polygon, &moved)) return;
    worker->cover_cost += COST_BY_ALL;
    qm_near_packs all;
    qm_candidates_gather(work, &all);
    for (int attempt = 0; attempt < FACE_ATTEMPTS; attempt++) {
        reach_corners(work, &polygon);
        if (cover_polygon(work, &polygon, &moved)) return;
        /* The centroid of the remainder is likely as far as any point of the face. */
        if (!sample_unreached(work, qm_polygon_centroid(&polygon))) break;
    }
    worker->cover_cost += COST_OF_FAILURE;
    /* An overlay, unless overlays seldom succeed. It is tried because covers failed, so its cost is theirs. */
    if (worker->overlay_hits * MIN_HIT_SHARE >= worker->overlay_tries) {
        uint64_t before = worker->overlay_cost;
        bool is_covered = qm_overlay_test_face(worker, work->side, corner, work->slack, work->near);
        worker->cover_cost += worker->overlay_cost - before;
        worker->overlay_cost = before;
        if (is_covered) return;
    }
    worker->cover_cost += COST_OF_PARTS;
    queue_piece(work, &work->piece);
}

void qm_piece_visit_face(qm_worker *worker, qm_entry pack, const qm_piece *face, const qm_near_packs *near)
{
    QM_ASSERT(worker && face && near);
    qm_piece_work work;
    start_work(&work, worker, pack, face, near);
    work.entry.kind = QM_ENTRY_PIECE;
    if (face->corner_count == 3) {
        process_face(&work);
    } else if (!rectangle_is_covered(&work)) {
        qm_near_packs all;
        qm_candidates_gather(&work, &all);
        process_rectangle(&work);
    }
}
