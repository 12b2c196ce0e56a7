/**
 * hausdorff_patches.c: covers a part of the source by patches of the target, cell by cell.
 *
 * A label stands for a patch with the loss of a slack, which near the farthest point is more than the cutoff
 * leaves: a part over the line where two patches meet, or over a tip where many do, then goes down to parts so
 * small that the slack no longer matters. A cell needs no slack. It is the convex piece of the polygon between a
 * run of its corners and the two points where the polygon's edges leave the patch; it is
 * bounded by the patch itself (qm_bilinear_polygon_upper). What is cut off is within the cutoff, and the
 * remainder, again convex, goes on with the patch at its next corner. The edges of patches are straight, so that
 * a cell mostly ends where its patch does.
 *
 * A rectangle of a patch of the source that lies over several patches of the target is cut in the same way: what one of
 * them covers about the centre is a rectangle again, and leaves up to four others beside it. Grids of one surface whose
 * lines run along each other meet so after one cut for each patch, where halves would come down to the size of the gap.
 *
 * The footpoints under a cell are found by descent from one of them: they stay on its sheet where the patch is
 * folded. That, and where the cuts are, decides how often the cover succeeds, never whether it holds.
 */
#include "hausdorff_patches.h"

#define MAX_CELLS 12     /* of one polygon */
#define PROBE 0.05       /* of the way from a corner to the centroid: where its patch is looked up */
#define CROSSING_STEPS 8 /* to the point where an edge leaves a patch */
#define ROOM 0.9         /* of what the distance at the start of an edge leaves of the cutoff, for its end */
#define MIN_PROGRESS 0x1p-7 /* of an edge: a cell with less of both its edges is not cut off */
#define MIN_TWIST 0.25    /* of the cutoff: labels of a patch bent less lose little, and may cover as well */
#define MIN_MIDDLE 0x1p-4 /* of a rectangle: a smaller one in its middle is not cut out */
#define MIN_STRIP 0.05 /* of the way from the centre to a side: to leave thinner rectangles is no progress */

/** A point of the source and a point of the patch under it. */
typedef struct match {
    qm_vec at;
    double uv[2], distance;
} match;

/** A convex piece of the polygon over one patch. */
typedef struct cell {
    int count;
    match at[QM_COVER_CORNERS + 2];
} cell;

/** Matches p by descent from the footpoint of a point near it. */
static match match_from(const qm_bilinear *patch, const double uv[2], qm_vec p)
{
    qm_bilinear_footpoint foot = {.distance = qm_vec_distance(p, qm_bilinear_at(patch, uv[0], uv[1])),
                                  .uv = {uv[0], uv[1]}};
    qm_bilinear_polish(patch, p, QM_ROUGH_GAIN, &foot);
    return (match){p, {foot.uv[0], foot.uv[1]}, foot.distance};
}

static bool cell_is_near(const qm_bilinear *patch, const cell *all, double cutoff)
{
    qm_vec corner[QM_COVER_CORNERS + 2];
    double uv[QM_COVER_CORNERS + 2][2];
    for (int i = 0; i < all->count; i++) {
        corner[i] = all->at[i].at;
        uv[i][0] = all->at[i].uv[0];
        uv[i][1] = all->at[i].uv[1];
    }
    return qm_bilinear_polygon_upper(patch, all->count, corner, uv, cutoff) <= cutoff;
}

/**
 * A point on the way from one corner, within the cutoff, to another, beyond it: near to where the way leaves the
 * patch. Beyond an edge of the patch the distance grows linearly, so that two points there show where the edge
 * is. The cutoff is not used up: the bound of a cell is above the distances of its corners. But cells that end at
 * the very edge leave slivers where patches do not quite meet. *fraction becomes how far the point is.
 */
static match last_match(const qm_bilinear *patch, const match *from, const match *to, double cutoff,
                        double *fraction)
{
    match inside = *from;
    double limit = from->distance + ROOM * (cutoff - from->distance);
    double low = 0.0, high = 1.0, far = to->distance, slope = 0.0; /* slope: between two points beyond */
    for (int step = 0; step < CROSSING_STEPS; step++) {
        double next = slope > 0.0 ? high - far / slope : 0.5 * (low + high);
        bool is_aimed = next > low && next < high;
        if (!is_aimed) next = 0.5 * (low + high);
        match here = match_from(patch, inside.uv, qm_vec_mix(from->at, to->at, next));
        if (here.distance <= limit) {
            low = next;
            inside = here;
            if (is_aimed && slope > 0.0) break;
        } else {
            slope = (far - here.distance) / (high - next);
            high = next;
            far = here.distance;
        }
    }
    *fraction = low;
    return inside;
}

/** Replaces the corners of the run by the two points at the ends of the cell, its first corner and its last. */
static void cut_off(qm_polygon *polygon, int first, int length, const cell *off)
{
    qm_polygon remainder = {.cuts_left = polygon->cuts_left - 1};
    for (int i = length; i < polygon->count; i++)
        remainder.corner[remainder.count++] = polygon->corner[(first + i) % polygon->count];
    remainder.corner[remainder.count++] = off->at[0].at;
    remainder.corner[remainder.count++] = off->at[off->count - 1].at;
    *polygon = remainder;
}

/** Faces that have covered nothing of a polygon. */
typedef struct tried_list {
    int count;
    uint32_t face[QM_COVER_CORNERS];
} tried_list;

typedef enum outcome { NOTHING, TOO_COARSE, CUT_OFF, COVERED } outcome;

/** Covers the polygon, or cuts off a cell, by the patch under a corner. */
static outcome cut_cell(const qm_piece_work *work, qm_polygon *polygon, int corner, double cutoff,
                        tried_list *tried)
{
    int count = polygon->count;
    qm_vec probe = qm_vec_mix(polygon->corner[corner], qm_polygon_centroid(polygon), PROBE);
    qm_quads_query query = {.wanted = 1, .within = cutoff, .enough = cutoff};
    qm_near_quads near = qm_candidates_near_quads(work, probe, query);
    if (near.count == 0) return NOTHING;
    for (int i = 0; i < tried->count; i++)
        if (tried->face[i] == near.at[0].face) return NOTHING;
    tried->face[tried->count++] = near.at[0].face;
    qm_candidates_find_foot(&near.at[0], probe);
    const qm_bilinear *patch = &near.at[0].patch;
    match matches[QM_COVER_CORNERS];
    QM_ASSERT(corner < count && count <= QM_COVER_CORNERS);
    matches[corner] = match_from(patch, near.at[0].uv, polygon->corner[corner]);
    if (!(matches[corner].distance <= cutoff)) return NOTHING;
    for (int i = 0; i < count; i++)
        if (i != corner) matches[i] = match_from(patch, near.at[0].uv, polygon->corner[i]);
    int length = 1, first = corner;
    while (length < count && matches[(first + length) % count].distance <= cutoff)
        length++;
    for (; length < count && matches[(first + count - 1) % count].distance <= cutoff; length++)
        first = (first + count - 1) % count;
    cell all = {.count = 0};
    if (length == count) {
        for (int i = 0; i < count; i++)
            all.at[all.count++] = matches[i];
        if (cell_is_near(patch, &all, cutoff)) return COVERED;
        return near.at[0].twist > MIN_TWIST * cutoff ? TOO_COARSE : NOTHING;
    }
    if (count - length + 2 > QM_COVER_CORNERS || polygon->cuts_left == 0) return NOTHING;
    int last = (first + length - 1) % count, previous = (first + count - 1) % count,
        next = (last + 1) % count;
    double back, forth;
    match before = last_match(patch, &matches[first], &matches[previous], cutoff, &back);
    match after = last_match(patch, &matches[last], &matches[next], cutoff, &forth);
    if (back < MIN_PROGRESS && forth < MIN_PROGRESS) return NOTHING;
    all.at[all.count++] = before;
    for (int i = 0; i < length; i++)
        all.at[all.count++] = matches[(first + i) % count];
    all.at[all.count++] = after;
    if (!cell_is_near(patch, &all, cutoff)) return NOTHING;
    cut_off(polygon, first, length, &all);
    return CUT_OFF;
}

qm_patches_cover qm_patches_cover_polygon(const qm_piece_work *work, qm_polygon *polygon)
{
    QM_ASSERT(work && polygon);
    QM_ASSERT(work->side->target_patches);
    double cutoff = qm_candidates_cutoff(work) - work->slack;
    for (int cells = 0; cells < MAX_CELLS; cells++) {
        outcome here = NOTHING;
        bool is_coarse = false;
        tried_list tried = {.count = 0};
        for (int corner = 0; corner < polygon->count && here < CUT_OFF; corner++) {
            here = cut_cell(work, polygon, corner, cutoff, &tried);
            is_coarse |= here == TOO_COARSE;
        }
        if (here == COVERED) return QM_PATCHES_ALL;
        if (here == CUT_OFF) continue;
        if (cells > 0) return QM_PATCHES_SOME;
        return is_coarse ? QM_PATCHES_COARSE : QM_PATCHES_NONE;
    }
    return QM_PATCHES_SOME;
}

/* --- Rectangles --- */

/** The share of the way from a point of the source to another up to which the patch under the first is near. */
static double near_share(const qm_bilinear *patch, const match *from, qm_vec to, double cutoff)
{
    match end = match_from(patch, from->uv, to);
    if (end.distance <= from->distance + ROOM * (cutoff - from->distance)) return 1.0;
    double share;
    last_match(patch, from, &end, cutoff, &share);
    return share;
}

bool qm_patches_cover_middle(const qm_piece_work *work, const qm_bilinear *source, qm_vec centre,
                             qm_near_quad *quad, qm_uv_box *middle)
{
    QM_ASSERT(work && source && quad && middle);
    double cutoff = qm_candidates_cutoff(work), share = 1.0;
    const double *low = work->piece.low, *high = work->piece.high;
    const double half[2] = {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])};
    qm_candidates_find_foot(quad, centre);
    match from = match_from(&quad->patch, quad->uv, centre);
    if (!(from.distance <= cutoff)) return false;
    for (int k = 0; k < 4; k++) {
        int axis = k / 2;
        double side = k % 2 ? high[axis] : low[axis], at[2] = {half[0], half[1]};
        at[axis] = side;
        double near = near_share(&quad->patch, &from, qm_bilinear_at(source, at[0], at[1]), cutoff);
        if (near < 1.0 && near > 1.0 - MIN_STRIP) return false;
        *(k % 2 ? &middle->high[axis] : &middle->low[axis]) =
            near < 1.0 ? half[axis] + near * (side - half[axis]) : side;
    }
    for (int axis = 0; axis < 2; axis++)
        share *= (middle->high[axis] - middle->low[axis]) / (high[axis] - low[axis]);
    if (!(share > MIN_MIDDLE)) return false;
    qm_vec corner[4];
    double uv[4][2];
    qm_uv_box_corners(source, middle, corner);
    for (int i = 0; i < 4; i++) {
        match here = match_from(&quad->patch, from.uv, corner[i]);
        if (!(here.distance <= cutoff)) return false;
        uv[i][0] = here.uv[0];
        uv[i][1] = here.uv[1];
    }
    return qm_bilinear_rectangle_upper(source, middle, &quad->patch, uv) <= cutoff;
}
