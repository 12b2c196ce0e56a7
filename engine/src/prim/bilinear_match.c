/**
 * bilinear_match.c: rectangles of the source in levels of equal size. Each is matched by a damped least
 * squares (Gauss-Newton) iteration for the four sides of its rectangle in the target.
 */
#include "bilinear_match.h"

#define STEPS 8            /* of least squares for one rectangle */
#define MIN_GAIN 0.9       /* of the longest difference: a step that leaves more is the last one */
#define DAMPING 1e-9       /* of the trace: for folds, where both directions of the target coincide */
#define MAX_DEPTH 12       /* of cuts */
#define MIN_CUT_SIDE 0.5   /* of the longer side: a shorter one is not cut */
#define MAX_EDGE_DEPTH 2   /* of rectangles that extend beyond the target: another patch must cover those */
#define MAX_FIRST 1        /* levels that are tried before any rectangle is covered, */
#define MAX_BARREN 3       /* and when some has been */
#define MIN_COVERED 4      /* after these levels: one in this many rectangles must be covered to go on */
#define EDGE_PART 1e-7     /* of a side: a smaller fraction is not cut off at an edge of the target, */
#define MIN_OVER 1e-3      /* and at least this fraction must lie over the target */
#define BEYOND 64.0        /* sizes of the target: how far a match may extend beyond it */
#define PASSES 3           /* matches of parts that are cut to the target, */
#define LONG 16.0          /* where a rectangle is this many cutoffs long at least */
#define MAX_RECTANGLES 256 /* of one level */
#define MAX_COINCIDENT 8.0 /* of the cutoff: how far apart the corners of coincident patches may be */

/** A rectangle of the source with its match. */
typedef struct pairing {
    qm_uv_box source, target;
    double longest; /* difference of two matched points */
    bool is_beyond; /* it extends to where this target cannot cover it, at any size */
} pairing;

typedef struct match_work {
    const qm_bilinear *source;
    qm_bilinear target; /* its parameters in the orientation of the source's */
    double cutoff;
    qm_bilinear_remainder_fn *remainder;
    void *user;
} match_work;

/** The side of a box that a corner lies on, across an axis. */
static double *side_of(qm_uv_box *box, int corner, int axis)
{
    bool is_high = axis == 0 ? corner == 1 || corner == 2 : corner >= 2;
    return is_high ? &box->high[axis] : &box->low[axis];
}

/** Differences of matched corners; returns the largest length, INFINITY when one is NaN. */
static double differences(const match_work *work, const qm_vec corner[4], qm_uv_box *target,
                          qm_vec difference[4])
{
    double longest2 = 0.0;
    for (int i = 0; i < 4; i++) {
        difference[i] = qm_vec_sub(
            corner[i], qm_bilinear_at(&work->target, *side_of(target, i, 0), *side_of(target, i, 1)));
        double length2 = qm_vec_norm2(difference[i]);
        /* The equations of a target are singular when products of its sides underflow. */
        if (!(length2 < INFINITY)) return INFINITY;
        longest2 = qm_max(longest2, length2);
    }
    return sqrt(longest2);
}

/** The Gauss-Newton step of the four sides for the sum of squared differences. */
static void solve_step(const match_work *work, const qm_uv_box *target, const qm_vec difference[4],
                       double step[2][2])
{
    /* Unknowns: sides [axis][low, high]. Sides of one axis share no corner, so their block is diagonal. */
    double diagonal[2][2] = {{0}}, right[2][2] = {{0}}, mixed[2][2] = {{0}};
    qm_uv_box at = *target;
    for (int i = 0; i < 4; i++) {
        int column = i == 1 || i == 2, row = i >= 2;
        double u = *side_of(&at, i, 0), v = *side_of(&at, i, 1);
        qm_vec along_u = qm_vec_axpy(work->target.e1, v, work->target.w);
        qm_vec along_v = qm_vec_axpy(work->target.e2, u, work->target.w);
        diagonal[0][column] += qm_vec_norm2(along_u);
        diagonal[1][row] += qm_vec_norm2(along_v);
        mixed[column][row] = qm_vec_dot(along_u, along_v);
        right[0][column] += qm_vec_dot(difference[i], along_u);
        right[1][row] += qm_vec_dot(difference[i], along_v);
    }
    double trace = diagonal[0][0] + diagonal[0][1] + diagonal[1][0] + diagonal[1][1];
    for (int k = 0; k < 4; k++)
        diagonal[k / 2][k % 2] += DAMPING * trace;
    /* Schur complement of the first axis. */
    double s[2][2] = {{diagonal[1][0], 0.0}, {0.0, diagonal[1][1]}}, r[2] = {right[1][0], right[1][1]};
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < 2; i++) {
            r[i] -= mixed[k][i] * right[0][k] / diagonal[0][k];
            for (int j = 0; j < 2; j++)
                s[i][j] -= mixed[k][i] * mixed[k][j] / diagonal[0][k];
        }
    }
    double determinant = s[0][0] * s[1][1] - s[0][1] * s[1][0];
    step[1][0] = (s[1][1] * r[0] - s[0][1] * r[1]) / determinant;
    step[1][1] = (s[0][0] * r[1] - s[1][0] * r[0]) / determinant;
    for (int k = 0; k < 2; k++)
        step[0][k] = (right[0][k] - mixed[k][0] * step[1][0] - mixed[k][1] * step[1][1]) / diagonal[0][k];
}

/** True when a corner is farther than the cutoff from the tangent plane of the target at its match: but for
 * the target's curvature, no part with that corner is covered, however small. */
static bool is_beyond_cutoff(const match_work *work, qm_uv_box *target, const qm_vec difference[4])
{
    for (int i = 0; i < 4; i++) {
        qm_vec along_u = qm_vec_axpy(work->target.e1, *side_of(target, i, 1), work->target.w);
        qm_vec along_v = qm_vec_axpy(work->target.e2, *side_of(target, i, 0), work->target.w);
        qm_vec normal = qm_vec_cross(along_u, along_v);
        if (fabs(qm_vec_dot(difference[i], normal)) > work->cutoff * qm_vec_norm(normal)) return true;
    }
    return false;
}

/** Improves the match of a rectangle until it is within the cutoff or stalls; its sides stay within margin of
 * the target. */
static void improve(const match_work *work, pairing *pair, double margin)
{
    qm_vec corner[4], difference[4];
    qm_uv_box_corners(work->source, &pair->source, corner);
    for (int axis = 0; axis < 2; axis++) {
        pair->target.low[axis] = qm_clamp(pair->target.low[axis], -margin, 1.0 + margin);
        pair->target.high[axis] = qm_clamp(pair->target.high[axis], -margin, 1.0 + margin);
    }
    pair->longest = differences(work, corner, &pair->target, difference);
    bool is_clamped = false;
    for (int k = 0; k < STEPS && pair->longest > work->cutoff; k++) {
        double step[2][2];
        solve_step(work, &pair->target, difference, step);
        qm_uv_box moved;
        is_clamped = false;
        for (int axis = 0; axis < 2; axis++) {
            double low = pair->target.low[axis] + step[axis][0],
                   high = pair->target.high[axis] + step[axis][1];
            moved.low[axis] = qm_clamp(low, -margin, 1.0 + margin);
            moved.high[axis] = qm_clamp(high, -margin, 1.0 + margin);
            is_clamped |= moved.low[axis] != low || moved.high[axis] != high;
        }
        qm_vec moved_difference[4];
        double longest = differences(work, corner, &moved, moved_difference);
        if (!(longest < pair->longest)) break;
        bool is_last = longest > MIN_GAIN * pair->longest && longest > work->cutoff;
        pair->target = moved;
        pair->longest = longest;
        for (int i = 0; i < 4; i++)
            difference[i] = moved_difference[i];
        if (is_last) break;
    }
    pair->is_beyond =
        pair->longest > work->cutoff && (is_clamped || is_beyond_cutoff(work, &pair->target, difference));
}

/** Rectangles of equal depth. */
typedef struct level {
    int count;
    pairing at[MAX_RECTANGLES];
} level;

/** Cuts a rectangle at its midpoint, across one axis or both, and appends the parts. */
static void add_parts(const match_work *work, const pairing *pair, level *next)
{
    bool is_cut[2];
    /* Across both axes, or only the one of much longer sides, so that a thin rectangle is cut in two. */
    qm_vec c[4];
    qm_uv_box_corners(work->source, &pair->source, c);
    const double side[2] = {qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]),
                            qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2])};
    for (int axis = 0; axis < 2; axis++)
        is_cut[axis] = !(side[axis] < MIN_CUT_SIDE * side[1 - axis]);
    for (int k = 0; k < 4; k++) {
        if ((k & 1 && !is_cut[0]) || (k & 2 && !is_cut[1])) continue;
        QM_ASSERT(next->count < MAX_RECTANGLES);
        pairing *part = &next->at[next->count++];
        *part = *pair;
        for (int axis = 0; axis < 2; axis++) {
            if (!is_cut[axis]) continue;
            double source_midpoint = 0.5 * (pair->source.low[axis] + pair->source.high[axis]);
            double target_midpoint = 0.5 * (pair->target.low[axis] + pair->target.high[axis]);
            *(k >> axis & 1 ? &part->source.low[axis] : &part->source.high[axis]) = source_midpoint;
            *(k >> axis & 1 ? &part->target.low[axis] : &part->target.high[axis]) = target_midpoint;
        }
    }
}

/**
 * Covers level by level, so that the remainder is in few large rectangles: a level of which too little is
 * covered goes to the remainder as it is.
 */
static bool cover(const match_work *work, const pairing *start)
{
    level levels[2], *here = &levels[0], *next = &levels[1];
    here->count = 1;
    here->at[0] = *start;
    bool has_covered = false;
    for (int depth = 0; here->count > 0; depth++) {
        /* Remove the covered rectangles of the level. */
        int kept = 0, count = here->count;
        for (int i = 0; i < count; i++) {
            improve(work, &here->at[i], 0.0);
            if (!(here->at[i].longest <= work->cutoff)) here->at[kept++] = here->at[i];
        }
        here->count = kept;
        int before = here->count, covered = count - kept;
        has_covered |= covered > 0;
        bool goes_on = covered * MIN_COVERED >= before || depth < (has_covered ? MAX_BARREN : MAX_FIRST);
        if (!goes_on || depth == MAX_DEPTH || 4 * here->count > MAX_RECTANGLES) break;
        next->count = 0;
        for (int i = 0; i < here->count; i++) {
            if (here->at[i].is_beyond && depth >= MAX_EDGE_DEPTH)
                work->remainder(work->user, &here->at[i].source);
            else
                add_parts(work, &here->at[i], next);
        }
        level *used = here;
        here = next;
        next = used;
    }
    for (int i = 0; has_covered && i < here->count; i++)
        work->remainder(work->user, &here->at[i].source);
    return has_covered;
}

/** The part of a rectangle of the source that lies over the target as the match of a rectangle is continued; false where
 * that is less than MIN_OVER of a side. */
static bool part_over_target(const pairing *match, const qm_uv_box *whole, pairing *part)
{
    for (int axis = 0; axis < 2; axis++) {
        double low = match->source.low[axis], size = match->source.high[axis] - low;
        double from = match->target.low[axis], length = match->target.high[axis] - from;
        double min = whole->low[axis], max = whole->high[axis], side = max - min;
        /* Where the match enters the target, and where it leaves it; NaN when the side has no length. */
        double enters = low - from / length * size, leaves = low + (1.0 - from) / length * size;
        double first = qm_clamp(qm_min(enters, leaves), min, max);
        double last = qm_clamp(qm_max(enters, leaves), min, max);
        if (!(first > min + EDGE_PART * side)) first = min;
        if (!(last < max - EDGE_PART * side)) last = max;
        if (last - first < MIN_OVER * side) return false;
        part->source.low[axis] = first;
        part->source.high[axis] = last;
        part->target.low[axis] = from + (first - low) / size * length;
        part->target.high[axis] = from + (last - low) / size * length;
    }
    return true;
}

/** Whether a rectangle is so much longer than the cutoff that halves would be many before they match. */
static bool is_long(const match_work *work, const qm_uv_box *box)
{
    qm_vec corner[4];
    qm_uv_box_corners(work->source, box, corner);
    double limit = LONG * work->cutoff;
    return !(qm_vec_distance(corner[0], corner[2]) <= limit &&
             qm_vec_distance(corner[1], corner[3]) <= limit);
}

/**
 * Covers a rectangle that matches as a whole, or else as much as possible of the part that lies over the target.
 *
 * Where that ends is told by the match as continued beyond the target. A rectangle of the source that matches the target
 * continued differs from it by the noise of its corners times the sizes of the target that it extends beyond it, which may
 * be many cutoffs: what lies over the target matches all the same. So up to passes times the part is matched for itself,
 * and cut anew, which takes it nearer to the target's edges; the corners of the last part prove it.
 */
static bool cover_within(const match_work *work, const pairing *start, int passes)
{
    pairing inner = *start, beyond = *start, part;
    improve(work, &inner, 0.0);
    if (inner.longest <= work->cutoff) return true;
    bool is_covered = false;
    qm_uv_box strip[4];
    int strips = 0;
    for (int pass = 0; pass < passes && !is_covered; pass++) {
        improve(work, &beyond, BEYOND);
        bool is_matched = beyond.longest <= work->cutoff;
        if (!is_matched && pass + 1 == passes) return false;
        if (!part_over_target(&beyond, &start->source, &part)) return false;
        strips = qm_uv_box_strips(&start->source, &part.source, strip);
        if (strips == 0) return false;
        inner = part;
        improve(work, &inner, 0.0);
        is_covered = inner.longest <= work->cutoff;
        if (!is_covered && is_matched && !cover(work, &part)) return false;
        is_covered |= is_matched;
        beyond = part;
    }
    for (int i = 0; is_covered && i < strips; i++)
        work->remainder(work->user, &strip[i]);
    return is_covered;
}

/** How the parameters of the target are oriented to run along those of the source: swapped, and each reversed
 * or not. */
typedef struct orientation {
    bool is_swapped, is_reversed[2];
} orientation;

static qm_bilinear orient(const qm_bilinear *patch, orientation to)
{
    qm_bilinear oriented = *patch;
    if (to.is_swapped) {
        oriented.e1 = patch->e2;
        oriented.e2 = patch->e1;
    }
    if (to.is_reversed[0]) {
        oriented.origin = qm_vec_add(oriented.origin, oriented.e1);
        oriented.e1 = qm_vec_scale(-1.0, oriented.e1);
        oriented.e2 = qm_vec_add(oriented.e2, oriented.w);
        oriented.w = qm_vec_scale(-1.0, oriented.w);
    }
    if (to.is_reversed[1]) {
        oriented.origin = qm_vec_add(oriented.origin, oriented.e2);
        oriented.e2 = qm_vec_scale(-1.0, oriented.e2);
        oriented.e1 = qm_vec_add(oriented.e1, oriented.w);
        oriented.w = qm_vec_scale(-1.0, oriented.w);
    }
    return oriented;
}

/** Starts from the centers: with rectangles of the same size, and the target oriented by the derivatives
 * there. */
static pairing start_at_centers(match_work *work, const qm_uv_box *box, const qm_bilinear *target,
                                const double center[2])
{
    const double source_center[2] = {0.5 * (box->low[0] + box->high[0]), 0.5 * (box->low[1] + box->high[1])};
    /* The orientation by the derivatives at one point of each patch. */
    const qm_vec a[2] = {qm_vec_axpy(work->source->e1, source_center[1], work->source->w),
                         qm_vec_axpy(work->source->e2, source_center[0], work->source->w)};
    const qm_vec b[2] = {qm_vec_axpy(target->e1, center[1], target->w),
                         qm_vec_axpy(target->e2, center[0], target->w)};
    double along[2][2], straight = 0.0, swapped = 0.0;
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2; k++) {
            along[i][k] = qm_vec_dot(a[i], b[k]) / (qm_vec_norm(a[i]) * qm_vec_norm(b[k]) + 0x1p-1000);
            *(i == k ? &straight : &swapped) += fabs(along[i][k]);
        }
    orientation as = {.is_swapped = swapped > straight};
    for (int i = 0; i < 2; i++)
        as.is_reversed[i] = along[i][as.is_swapped ? 1 - i : i] < 0.0;
    work->target = orient(target, as);
    double at[2];
    for (int axis = 0; axis < 2; axis++) {
        double x = center[as.is_swapped ? 1 - axis : axis];
        at[axis] = as.is_reversed[axis] ? 1.0 - x : x;
    }
    const qm_vec from[2] = {qm_vec_axpy(work->source->e1, source_center[1], work->source->w),
                            qm_vec_axpy(work->source->e2, source_center[0], work->source->w)};
    const qm_vec to[2] = {qm_vec_axpy(work->target.e1, at[1], work->target.w),
                          qm_vec_axpy(work->target.e2, at[0], work->target.w)};
    pairing start = {.source = *box};
    for (int axis = 0; axis < 2; axis++) {
        double faster = qm_vec_norm(from[axis]) / (qm_vec_norm(to[axis]) + 0x1p-1000);
        double half = 0.5 * qm_min(BEYOND, faster * (box->high[axis] - box->low[axis]));
        start.target.low[axis] = at[axis] - half;
        start.target.high[axis] = at[axis] + half;
    }
    return start;
}

/** The orientation in which the corners of both patches are nearest to one another, and the sum of their
 * squared distances. */
static orientation orientation_of_corners(const qm_bilinear *source, const qm_bilinear *target,
                                          double *difference2)
{
    orientation best = {false, {false, false}};
    double min_sum = INFINITY;
    qm_vec corner[4], target_corner[4];
    const qm_uv_box square = {{0.0, 0.0}, {1.0, 1.0}};
    qm_uv_box_corners(source, &square, corner);
    for (int k = 0; k < 8; k++) {
        orientation as = {k & 1, {k >> 1 & 1, k >> 2 & 1}};
        qm_bilinear oriented = orient(target, as);
        double sum = 0.0;
        qm_uv_box_corners(&oriented, &square, target_corner);
        for (int i = 0; i < 4; i++)
            sum += qm_vec_norm2(qm_vec_sub(corner[i], target_corner[i]));
        if (!(sum < min_sum)) continue;
        min_sum = sum;
        best = as;
    }
    *difference2 = min_sum;
    return best;
}

bool qm_bilinear_match(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                       const double center[2], double cutoff, qm_bilinear_remainder_fn *remainder, void *user)
{
    match_work work = {.source = source, .cutoff = cutoff, .remainder = remainder, .user = user};
    /* Two patches between nearly the same corners have nearly the same parameters. */
    double difference2;
    work.target = orient(target, orientation_of_corners(source, target, &difference2));
    pairing start = {.source = *box, .target = *box};
    if (cover_within(&work, &start, 1)) return true;
    /* Equal parameters are a start for patches that nearly coincide. For others single quarters may match from
     * there, but what an edge of the target crosses is never cut along it, only in ever more quarters. */
    pairing centered = start_at_centers(&work, box, target, center);
    return cover_within(&work, &centered, is_long(&work, box) ? PASSES : 1) || cover(&work, &centered);
}

/** The sum of the corners, which does not depend on the orientation. */
static qm_vec sum_of_corners(const qm_bilinear *patch)
{
    qm_vec half = qm_vec_axpy(qm_vec_add(patch->e1, patch->e2), 2.0, patch->origin);
    return qm_vec_axpy(patch->w, 2.0, half);
}

bool qm_bilinear_match_coincident(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                                  double cutoff, qm_bilinear_remainder_fn *remainder, void *user)
{
    match_work work = {.source = source, .cutoff = cutoff, .remainder = remainder, .user = user};
    double difference2, limit = MAX_COINCIDENT * cutoff;
    qm_vec apart = qm_vec_sub(sum_of_corners(source), sum_of_corners(target));
    if (!(qm_vec_norm2(apart) <= 16.0 * limit * limit)) return false;
    work.target = orient(target, orientation_of_corners(source, target, &difference2));
    pairing start = {.source = *box, .target = *box};
    if (!(difference2 <= 4.0 * limit * limit)) return false;
    return cover_within(&work, &start, 1) || cover(&work, &start);
}
