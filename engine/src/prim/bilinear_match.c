#include "bilinear_match.h"

#define STEPS 8          /* of least squares for one rectangle */
#define MIN_GAIN 0.9     /* of the greatest difference: a step that leaves more is the last one */
#define DAMPING 1e-9     /* of the matrix: where both directions of the target fall together, along a fold */
#define MAX_DEPTH 12     /* of cuts */
#define MIN_CUT_SIDE 0.5 /* of the longer side: a shorter one is not cut */
#define MAX_EDGE_DEPTH 2 /* of rectangles that reach beyond the target, where another patch has to go on */
#define MAX_FIRST 1      /* levels that are tried before any rectangle is covered, */
#define MAX_BARREN 3     /* and when some has been */
#define MIN_COVERED 4    /* one in so many rectangles of a level must be covered to go on after these */
#define EDGE_PART 1e-7   /* of a side: less of it is not cut off at an edge of the target, */
#define MIN_OVER 1e-3    /* and at least so much must lie over the target */
#define BEYOND 64.0      /* sizes of the target that a match may reach beyond it */
#define MAX_RECTANGLES 256 /* of one level */
#define MAX_ALIKE 8.0 /* of the cutoff distance: how far corners of patches that are alike may be apart */

/** A rectangle of the source with its match. */
typedef struct pairing {
    qm_uv_box source, target;
    double greatest; /* difference of two matched points */
    bool is_beyond;  /* it reaches to where this target cannot cover it, at any size */
} pairing;

typedef struct match_work {
    const qm_bilinear *source;
    qm_bilinear target; /* its parameters in the order of the source's */
    double cutoff;
    qm_match_rest_fn *rest;
    void *user;
} match_work;

/** The side of a box that a corner lies on, across an axis. */
static double *side_of(qm_uv_box *box, int corner, int axis)
{
    bool is_high = axis == 0 ? corner == 1 || corner == 2 : corner >= 2;
    return is_high ? &box->high[axis] : &box->low[axis];
}

/** Differences of matched corners; returns the greatest length, INFINITY where one is no number. */
static double differences(const match_work *work, const qm_vec corner[4], qm_uv_box *target,
                          qm_vec difference[4])
{
    double greatest2 = 0.0;
    for (int i = 0; i < 4; i++) {
        difference[i] = qm_vec_sub(
            corner[i], qm_bilinear_at(&work->target, *side_of(target, i, 0), *side_of(target, i, 1)));
        double length2 = qm_vec_norm2(difference[i]);
        /* A target too small to take products of its sides leads nowhere: its equations are singular. */
        if (!(length2 < INFINITY)) return INFINITY;
        greatest2 = qm_max(greatest2, length2);
    }
    return sqrt(greatest2);
}

/** The step of the four sides that makes the squares of the differences least, to first order. */
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

/** True when a corner is farther than is cutoff from the plane that touches the target at its match: but for
 * the target's bend, no part with that corner is covered, however small. */
static bool is_out_of_reach(const match_work *work, qm_uv_box *target, const qm_vec difference[4])
{
    for (int i = 0; i < 4; i++) {
        qm_vec along_u = qm_vec_axpy(work->target.e1, *side_of(target, i, 1), work->target.w);
        qm_vec along_v = qm_vec_axpy(work->target.e2, *side_of(target, i, 0), work->target.w);
        qm_vec normal = qm_vec_cross(along_u, along_v);
        if (fabs(qm_vec_dot(difference[i], normal)) > work->cutoff * qm_vec_norm(normal)) return true;
    }
    return false;
}

/** Improves the match of a rectangle until it is good enough or gets no better; its sides stay within margin
 * of the target. */
static void improve(const match_work *work, pairing *pair, double margin)
{
    qm_vec corner[4], difference[4];
    qm_uv_box_corners(work->source, &pair->source, corner);
    for (int axis = 0; axis < 2; axis++) {
        pair->target.low[axis] = qm_clamp(pair->target.low[axis], -margin, 1.0 + margin);
        pair->target.high[axis] = qm_clamp(pair->target.high[axis], -margin, 1.0 + margin);
    }
    pair->greatest = differences(work, corner, &pair->target, difference);
    bool is_clamped = false;
    for (int k = 0; k < STEPS && pair->greatest > work->cutoff; k++) {
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
        qm_vec there[4];
        double greatest = differences(work, corner, &moved, there);
        if (!(greatest < pair->greatest)) break;
        bool is_last = greatest > MIN_GAIN * pair->greatest && greatest > work->cutoff;
        pair->target = moved;
        pair->greatest = greatest;
        for (int i = 0; i < 4; i++)
            difference[i] = there[i];
        if (is_last) break;
    }
    pair->is_beyond =
        pair->greatest > work->cutoff && (is_clamped || is_out_of_reach(work, &pair->target, difference));
}

/** Rectangles of equal depth. */
typedef struct level {
    int count;
    pairing at[MAX_RECTANGLES];
} level;

/** Chooses the axes to cut a rectangle across: both, or only that of much longer sides, so that a thin
 * rectangle falls into fewer parts. */
static void axes_to_cut(const qm_bilinear *source, const qm_uv_box *box, bool is_cut[2])
{
    qm_vec c[4];
    qm_uv_box_corners(source, box, c);
    const double side[2] = {qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]),
                            qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2])};
    for (int axis = 0; axis < 2; axis++)
        is_cut[axis] = !(side[axis] < MIN_CUT_SIDE * side[1 - axis]);
}

/** Cuts a rectangle in the middle, across one axis or both. */
static void keep_parts(const match_work *work, const pairing *pair, level *next)
{
    bool is_cut[2];
    axes_to_cut(work->source, &pair->source, is_cut);
    for (int k = 0; k < 4; k++) {
        if ((k & 1 && !is_cut[0]) || (k & 2 && !is_cut[1])) continue;
        pairing *part = &next->at[next->count++];
        *part = *pair;
        for (int axis = 0; axis < 2; axis++) {
            if (!is_cut[axis]) continue;
            double middle = 0.5 * (pair->source.low[axis] + pair->source.high[axis]);
            double below = 0.5 * (pair->target.low[axis] + pair->target.high[axis]);
            *(k >> axis & 1 ? &part->source.low[axis] : &part->source.high[axis]) = middle;
            *(k >> axis & 1 ? &part->target.low[axis] : &part->target.high[axis]) = below;
        }
    }
}

/** Drops the rectangles of a level that are covered; returns how many there were. */
static int drop_covered(const match_work *work, level *here)
{
    int kept = 0, count = here->count;
    for (int i = 0; i < count; i++) {
        improve(work, &here->at[i], 0.0);
        if (!(here->at[i].greatest <= work->cutoff)) here->at[kept++] = here->at[i];
    }
    here->count = kept;
    return count - kept;
}

/** Hands over all of a level. */
static void hand_over(const match_work *work, const level *rest)
{
    for (int i = 0; i < rest->count; i++)
        work->rest(work->user, &rest->at[i].source);
}

/**
 * Level by level, so that what is left over at the end is large and little: a level of which too little is
 * covered is handed over as it is.
 */
static bool cover(const match_work *work, const pairing *whole)
{
    level levels[2], *here = &levels[0], *next = &levels[1];
    here->count = 1;
    here->at[0] = *whole;
    bool has_covered = false;
    for (int depth = 0; here->count > 0; depth++) {
        int before = here->count, covered = drop_covered(work, here);
        has_covered |= covered > 0;
        bool gets_on = covered * MIN_COVERED >= before || depth < (has_covered ? MAX_BARREN : MAX_FIRST);
        if (!gets_on || depth == MAX_DEPTH || 4 * here->count > MAX_RECTANGLES) break;
        next->count = 0;
        for (int i = 0; i < here->count; i++) {
            if (here->at[i].is_beyond && depth >= MAX_EDGE_DEPTH)
                work->rest(work->user, &here->at[i].source);
            else
                keep_parts(work, &here->at[i], next);
        }
        level *used = here;
        here = next;
        next = used;
    }
    if (has_covered) hand_over(work, here);
    return has_covered;
}

/** Which part of a side, from 0 to 1, lies over the target. */
static void inner_part(double low, double high, double part[2])
{
    double at_0 = (0.0 - low) / (high - low), at_1 = (1.0 - low) / (high - low);
    part[0] = qm_clamp(qm_min(at_0, at_1), 0.0, 1.0);
    part[1] = qm_clamp(qm_max(at_0, at_1), 0.0, 1.0);
    if (!(part[0] > EDGE_PART)) part[0] = 0.0; /* as when the side has no length */
    if (!(part[1] < 1.0 - EDGE_PART)) part[1] = 1.0;
}

/**
 * Cuts a rectangle down to what lies over the target, where the match of all of it with the target's whole
 * surface, beyond its edges, is good. strip are up to four rectangles, what is cut off. False when nothing
 * is.
 */
static bool cut_to_target(const match_work *work, pairing *pair, qm_uv_box strip[4], int *strips)
{
    pairing beyond = *pair;
    improve(work, &beyond, BEYOND);
    *strips = 0;
    if (!(beyond.greatest <= work->cutoff)) return false;
    for (int axis = 0; axis < 2; axis++) {
        double part[2], low = pair->source.low[axis], size = pair->source.high[axis] - low;
        double from = beyond.target.low[axis], length = beyond.target.high[axis] - from;
        inner_part(from, beyond.target.high[axis], part);
        if (part[1] - part[0] < MIN_OVER) return false;
        for (int end = 0; end < 2; end++) {
            double place = low + part[end] * size;
            if (part[end] == (double)end) continue;
            strip[*strips] = pair->source;
            *(end ? &strip[*strips].low[axis] : &strip[*strips].high[axis]) = place;
            *(end ? &pair->source.high[axis] : &pair->source.low[axis]) = place;
            ++*strips;
        }
        pair->target.low[axis] = qm_clamp(from + part[0] * length, 0.0, 1.0);
        pair->target.high[axis] = qm_clamp(from + part[1] * length, 0.0, 1.0);
    }
    return *strips > 0;
}

/** Covers what is possible of a rectangle that may reach beyond the target. */
static bool cover_within(const match_work *work, const pairing *whole)
{
    pairing inner = *whole;
    qm_uv_box strip[4];
    int strips;
    improve(work, &inner, 0.0);
    if (inner.greatest <= work->cutoff) return true;
    inner = *whole;
    if (!cut_to_target(work, &inner, strip, &strips)) return cover(work, whole);
    if (!cover(work, &inner)) return false;
    for (int i = 0; i < strips; i++)
        work->rest(work->user, &strip[i]);
    return true;
}

/** A way to lay the parameters of the target along those of the source: swapped, and each turned or not. */
typedef struct layout {
    bool is_swapped, is_turned[2];
} layout;

static qm_bilinear lay_out(const qm_bilinear *patch, layout to)
{
    qm_bilinear laid = *patch;
    if (to.is_swapped) {
        laid.e1 = patch->e2;
        laid.e2 = patch->e1;
    }
    if (to.is_turned[0]) {
        laid.origin = qm_vec_add(laid.origin, laid.e1);
        laid.e1 = qm_vec_scale(-1.0, laid.e1);
        laid.e2 = qm_vec_add(laid.e2, laid.w);
        laid.w = qm_vec_scale(-1.0, laid.w);
    }
    if (to.is_turned[1]) {
        laid.origin = qm_vec_add(laid.origin, laid.e2);
        laid.e2 = qm_vec_scale(-1.0, laid.e2);
        laid.e1 = qm_vec_add(laid.e1, laid.w);
        laid.w = qm_vec_scale(-1.0, laid.w);
    }
    return laid;
}

/** As both run at the middles. */
static layout layout_at(const qm_bilinear *source, const double from_at[2], const qm_bilinear *target,
                        const double to_at[2])
{
    const qm_vec from[2] = {qm_vec_axpy(source->e1, from_at[1], source->w),
                            qm_vec_axpy(source->e2, from_at[0], source->w)};
    const qm_vec to[2] = {qm_vec_axpy(target->e1, to_at[1], target->w),
                          qm_vec_axpy(target->e2, to_at[0], target->w)};
    double along[2][2], straight = 0.0, swapped = 0.0;
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2; k++) {
            along[i][k] =
                qm_vec_dot(from[i], to[k]) / (qm_vec_norm(from[i]) * qm_vec_norm(to[k]) + 0x1p-1000);
            *(i == k ? &straight : &swapped) += fabs(along[i][k]);
        }
    layout found = {.is_swapped = swapped > straight};
    for (int i = 0; i < 2; i++)
        found.is_turned[i] = along[i][found.is_swapped ? 1 - i : i] < 0.0;
    return found;
}

/** From the middles on: rectangles of the same size. */
static bool match_middles(match_work *work, const qm_uv_box *box, const qm_bilinear *target,
                          const double middle[2])
{
    const double from_at[2] = {0.5 * (box->low[0] + box->high[0]), 0.5 * (box->low[1] + box->high[1])};
    layout as = layout_at(work->source, from_at, target, middle);
    work->target = lay_out(target, as);
    double at[2];
    for (int axis = 0; axis < 2; axis++) {
        double there = middle[as.is_swapped ? 1 - axis : axis];
        at[axis] = as.is_turned[axis] ? 1.0 - there : there;
    }
    const qm_vec from[2] = {qm_vec_axpy(work->source->e1, from_at[1], work->source->w),
                            qm_vec_axpy(work->source->e2, from_at[0], work->source->w)};
    const qm_vec to[2] = {qm_vec_axpy(work->target.e1, at[1], work->target.w),
                          qm_vec_axpy(work->target.e2, at[0], work->target.w)};
    pairing whole = {.source = *box};
    for (int axis = 0; axis < 2; axis++) {
        double faster = qm_vec_norm(from[axis]) / (qm_vec_norm(to[axis]) + 0x1p-1000);
        double half = 0.5 * qm_min(BEYOND, faster * (box->high[axis] - box->low[axis]));
        whole.target.low[axis] = at[axis] - half;
        whole.target.high[axis] = at[axis] + half;
    }
    return cover_within(work, &whole);
}

/** The layout in which the corners of both patches are nearest to one another, and the sum of the squares of
 * their distances. */
static layout layout_of_corners(const qm_bilinear *source, const qm_bilinear *target, double *difference2)
{
    layout best = {false, {false, false}};
    double least = INFINITY;
    qm_vec corner[4], there[4];
    const qm_uv_box square = {{0.0, 0.0}, {1.0, 1.0}};
    qm_uv_box_corners(source, &square, corner);
    for (int k = 0; k < 8; k++) {
        layout as = {k & 1, {k >> 1 & 1, k >> 2 & 1}};
        qm_bilinear laid = lay_out(target, as);
        double sum = 0.0;
        qm_uv_box_corners(&laid, &square, there);
        for (int i = 0; i < 4; i++)
            sum += qm_vec_norm2(qm_vec_sub(corner[i], there[i]));
        if (!(sum < least)) continue;
        least = sum;
        best = as;
    }
    *difference2 = least;
    return best;
}

bool qm_bilinear_match(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                       const double middle[2], double cutoff, qm_match_rest_fn *rest, void *user)
{
    match_work work = {.source = source, .cutoff = cutoff, .rest = rest, .user = user};
    /* Two patches between nearly the same corners: the same parameters. */
    double difference2;
    work.target = lay_out(target, layout_of_corners(source, target, &difference2));
    pairing whole = {.source = *box, .target = *box};
    return cover_within(&work, &whole) || match_middles(&work, box, target, middle);
}

/** The sum of the corners, the same in all layouts. */
static qm_vec sum_of_corners(const qm_bilinear *patch)
{
    qm_vec half = qm_vec_axpy(qm_vec_add(patch->e1, patch->e2), 2.0, patch->origin);
    return qm_vec_axpy(patch->w, 2.0, half);
}

bool qm_bilinear_match_alike(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                             double cutoff, qm_match_rest_fn *rest, void *user)
{
    match_work work = {.source = source, .cutoff = cutoff, .rest = rest, .user = user};
    double difference2, most = MAX_ALIKE * cutoff;
    qm_vec apart = qm_vec_sub(sum_of_corners(source), sum_of_corners(target));
    if (!(qm_vec_norm2(apart) <= 16.0 * most * most)) return false;
    work.target = lay_out(target, layout_of_corners(source, target, &difference2));
    pairing whole = {.source = *box, .target = *box};
    return difference2 <= 4.0 * most * most && cover_within(&work, &whole);
}
