/**
 * hausdorff_matching_upper.c: upper bounds by matching. A match assigns to each point of a piece one of the
 * target, and the greatest distance of the pairs bounds the piece from above (5.8).
 *
 * The facets under the corners are the only ones looked at. A cell is a convex polygon of a triangle, or a
 * sub-rectangle of a bilinear patch, matched to one facet:
 *
 *   one facet      the piece as a whole                            (5.13), (5.19), (5.26)
 *   two facets     two cells, cut where both are equally far       (5.15), (5.20), (5.29)
 *   more           one cell a corner, meeting in the middle        (5.17), (5.21), (5.31)
 *   any            the ball round a corner: distances change by no more than the way gone
 *
 * What makes it sound: any cells that cover a piece and any facets they are matched to give a valid bound, so
 * a cut in the wrong place costs only tightness. The thesis cuts along a bisector plane, which a flat target
 * does not have, and matches corners to the facet on the other side of it; cells with corners of their own do
 * neither. Its three overlapping triangles leave the centre uncovered when read the other way round; the
 * quads of (5.21) cover everything and serve bilinear facets too. Its Bezier triangles (5.24) give way to
 * rectangles, whose parts lie in the hulls of their corners.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, sections 5.2 to 5.4.
 */
#include "hausdorff_matching.h"

#define MAX_FACETS 4 /* one a corner */
#define CUT_STEPS 8  /* of the search for the place that is equally far from two facets */

/** A facet of the target: a triangle, or the patch of a quad. */
typedef struct facet {
    uint32_t place; /* QM_PACK_LANES * pack + lane; the first lane of a patch */
    bool is_patch;
    qm_bilinear patch;
} facet;

/** A corner of a cell, and the point of a facet that it is matched to. */
typedef struct matched {
    qm_vec corner;
    double distance;
    double uv[2]; /* on a patch */
} matched;

/** A piece with the different facets under its corners. */
typedef struct matching {
    const qm_search *search;
    const qm_side *side;
    const qm_piece *piece;
    int facet_count;
    facet facets[MAX_FACETS];
    int label[4]; /* of each corner, in facets */
    matched at[4][MAX_FACETS];
} matching;

static bool holds_patch(const qm_side *side, uint32_t pack, uint32_t lane)
{
    return side->target_patches && qm_lane_has_second(&side->target->lanes[pack], lane);
}

static qm_bilinear load_patch(const qm_side *side, uint32_t pack, uint32_t lane)
{
    return qm_bvh_load_patch(side->target, side->target->lanes[pack].face[lane]);
}

uint32_t qm_matching_facet(const qm_search *search, const qm_side *side, uint32_t pack, qm_vec p)
{
    double d2[QM_PACK_LANES], nearest = INFINITY;
    uint32_t best = 0, lane_count = side->target->lanes[pack].lane_count;
    qm_pack spare;
    search->kernel->pack_distances(qm_bvh_rows(side->target, pack, &spare), p, d2);
    for (uint32_t lane = 0, next; lane < lane_count; lane = next) {
        double distance = sqrt(d2[lane]);
        next = lane + 1;
        if (holds_patch(side, pack, lane)) {
            next = lane + 2;
            distance = fmin(distance, sqrt(d2[lane + 1]));
            if (distance - qm_side_twist(side, pack, lane) >= nearest) continue;
            qm_bilinear patch = load_patch(side, pack, lane);
            distance = qm_bilinear_descend(&patch, p, INFINITY).distance;
        }
        if (distance >= nearest) continue;
        nearest = distance;
        best = lane;
    }
    return QM_PACK_LANES * pack + best;
}

static matched match_point(const matching *work, const facet *to, qm_vec p)
{
    if (to->is_patch) {
        qm_bilinear_foot foot = qm_bilinear_descend(&to->patch, p, INFINITY);
        return (matched){p, foot.distance, {foot.uv[0], foot.uv[1]}};
    }
    double d2[QM_PACK_LANES];
    qm_pack spare;
    work->search->kernel->pack_distances(qm_bvh_rows(work->side->target, to->place / QM_PACK_LANES, &spare),
                                         p, d2);
    return (matched){.corner = p, .distance = sqrt(d2[to->place % QM_PACK_LANES])};
}

/** Gathers the different facets under the corners, and matches every corner to every one of them. */
static void gather_facets(matching *work)
{
    const qm_piece *piece = work->piece;
    work->facet_count = 0;
    for (int i = 0; i < piece->corner_count; i++) {
        int k = 0;
        while (k < work->facet_count && work->facets[k].place != piece->foot[i])
            k++;
        work->label[i] = k;
        if (k < work->facet_count) continue;
        uint32_t pack = piece->foot[i] / QM_PACK_LANES, lane = piece->foot[i] % QM_PACK_LANES;
        facet *found = &work->facets[work->facet_count++];
        found->place = piece->foot[i];
        found->is_patch = holds_patch(work->side, pack, lane);
        if (found->is_patch) found->patch = load_patch(work->side, pack, lane);
        for (int j = 0; j < piece->corner_count; j++)
            work->at[j][k] = match_point(work, found, piece->corner[j]);
    }
}

/** A control point of the difference: the mean of points a and b less that of their match, see cell_upper. */
static double control_distance(const qm_bilinear *patch, const matched *a, const matched *b)
{
    double u = 0.5 * (a->uv[0] + b->uv[0]), v = 0.5 * (a->uv[1] + b->uv[1]);
    double uv = 0.5 * (a->uv[0] * b->uv[1] + b->uv[0] * a->uv[1]);
    qm_vec on = qm_vec_axpy(qm_vec_axpy(patch->origin, u, patch->e1), v, patch->e2);
    return qm_vec_distance(qm_vec_mix(a->corner, b->corner, 0.5), qm_vec_axpy(on, uv, patch->w));
}

static double centre_distance(const qm_bilinear *patch, const matched cell[4])
{
    double u = 0.0, v = 0.0, uv = 0.0;
    qm_vec middle = {0, 0, 0};
    for (int i = 0; i < 4; i++) {
        u += 0.25 * cell[i].uv[0];
        v += 0.25 * cell[i].uv[1];
        uv += 0.25 * cell[i].uv[0] * cell[(i + 2) % 4].uv[1];
        middle = qm_vec_axpy(middle, 0.25, cell[i].corner);
    }
    qm_vec on = qm_vec_axpy(qm_vec_axpy(patch->origin, u, patch->e1), v, patch->e2);
    return qm_vec_distance(middle, qm_vec_axpy(on, uv, patch->w));
}

/**
 * Greatest distance of a cell to the facet that its three or four corners are matched to.
 *
 * A triangle is convex, so the distance from it is convex, and greatest at a corner of whatever hull the cell
 * lies in (5.19). On a patch the parameters of the match are linear over three corners and bilinear over
 * four; the cell less its match is then a Bezier surface, quadratic in each parameter, that lies in the hull
 * of its control points: those of the corners, one for each side, and for four corners one in the middle
 * (5.12, 5.13). Feet within the unit square keep the match on the patch; and the bilinear surface of four
 * corners is the whole of a planar convex cell, or of a sub-rectangle of the source's patch.
 */
static double cell_upper(const facet *to, const matched *cell, int count)
{
    double upper = 0.0;
    for (int i = 0; i < count; i++)
        upper = fmax(upper, cell[i].distance);
    if (!to->is_patch) return upper;
    for (int i = 0; i < count; i++)
        upper = fmax(upper, control_distance(&to->patch, &cell[i], &cell[(i + 1) % count]));
    return count == 4 ? fmax(upper, centre_distance(&to->patch, cell)) : upper;
}

/** All corners matched to one facet: (5.13), (5.19), (5.26), and the minima of (5.16), (5.22) and (5.31). */
static double whole_upper(const matching *work, int k)
{
    matched cell[4];
    for (int i = 0; i < work->piece->corner_count; i++)
        cell[i] = work->at[i][k];
    return cell_upper(&work->facets[k], cell, work->piece->corner_count);
}

/** The ball round a corner, for which any distance is an upper bound by the way to the other corners. */
static double ball_upper(const qm_piece *piece)
{
    double upper = INFINITY;
    for (int i = 0; i < piece->corner_count; i++) {
        double radius = 0.0;
        for (int j = 0; j < piece->corner_count; j++)
            radius = fmax(radius, qm_vec_distance(piece->corner[i], piece->corner[j]));
        upper = fmin(upper, piece->distance[i] + radius);
    }
    return upper;
}

static double allowed_distance(const matching *work)
{
    return qm_search_cutoff(work->search) * work->side->scale;
}

/** How much farther one facet is than another, by the ways from the foot at least: see cut_place. */
static double farther(double to_a, double to_b, double least)
{
    return sqrt(fmax(0.0, to_a * to_a - least * least)) - sqrt(fmax(0.0, to_b * to_b - least * least));
}

/**
 * Where to cut the side from corner i, under which facet a lies, to corner j, under which b lies: the place
 * that is equally far from both, by regula falsi. Beside a facet the distance from its plane is still the
 * same and the rest of the way grows evenly: so it is these rests that are compared, and facets in one plane
 * are cut at their border by a single step. The middle where there is no change of sign, also for the ratio 0
 * / 0 that (5.14) and (5.28) can have.
 */
static double cut_place(const matching *work, int i, int j, int a, int b)
{
    const matched *from = work->at[i], *to = work->at[j];
    double least = fmin(from[a].distance, to[b].distance), low = 0.0, high = 1.0, place = 0.5;
    double below = farther(from[a].distance, from[b].distance, least);
    double above = farther(to[a].distance, to[b].distance, least);
    if (!(below <= 0.0 && above >= 0.0 && above - below > 0.0)) return place;
    for (int step = 0; step < CUT_STEPS; step++) {
        place = low + (high - low) * qm_clamp(-below / (above - below), 0.0, 1.0);
        qm_vec p = qm_vec_mix(work->piece->corner[i], work->piece->corner[j], place);
        double to_a = match_point(work, &work->facets[a], p).distance;
        double to_b = match_point(work, &work->facets[b], p).distance;
        if (fmax(to_a, to_b) <= allowed_distance(work)) break;
        double here = farther(to_a, to_b, least);
        if (here < 0.0) {
            low = place;
            below = here;
            above *= 0.5; /* so that neither end stays where it is (the Illinois rule) */
        } else {
            high = place;
            above = here;
            below *= 0.5;
        }
    }
    return place;
}

/** The two cells on both sides of a cut from x to y: near lies on facet a, far on b, each in turn from x
 * on. */
static double cut_upper(const matching *work, int a, int b, const int *near, int near_count, const int *far,
                        int far_count, qm_vec x, qm_vec y)
{
    const facet *first = &work->facets[a], *second = &work->facets[b];
    matched cell[4];
    for (int i = 0; i < near_count; i++)
        cell[i] = work->at[near[i]][a];
    cell[near_count] = match_point(work, first, y);
    cell[near_count + 1] = match_point(work, first, x);
    double upper = cell_upper(first, cell, near_count + 2);
    for (int i = 0; i < far_count; i++)
        cell[i] = work->at[far[i]][b];
    cell[far_count] = match_point(work, second, x);
    cell[far_count + 1] = match_point(work, second, y);
    return fmax(upper, cell_upper(second, cell, far_count + 2));
}

/** A triangle with corner k on one facet and the two others on another: (5.20), and (5.15) for patches. */
static double lone_corner_upper(const matching *work, int k)
{
    int i = (k + 1) % 3, j = (k + 2) % 3, a = work->label[k], b = work->label[i];
    const qm_vec *corner = work->piece->corner;
    qm_vec x = qm_vec_mix(corner[k], corner[j], cut_place(work, k, j, a, b));
    qm_vec y = qm_vec_mix(corner[k], corner[i], cut_place(work, k, i, a, b));
    const int far[2] = {i, j};
    return cut_upper(work, a, b, &k, 1, far, 2, x, y);
}

/** A rectangle with corners k and k + 1 on one facet and the others on another: cut along a parameter
 * (5.29). */
static double halves_upper(const matching *work, int k)
{
    int near[2] = {k, (k + 1) % 4}, far[2] = {(k + 2) % 4, (k + 3) % 4};
    int a = work->label[near[0]], b = work->label[far[0]];
    double place = 0.5 * (cut_place(work, near[0], far[1], a, b) + cut_place(work, near[1], far[0], a, b));
    const qm_vec *corner = work->piece->corner;
    qm_vec x = qm_vec_mix(corner[near[0]], corner[far[1]], place);
    qm_vec y = qm_vec_mix(corner[near[1]], corner[far[0]], place);
    return cut_upper(work, a, b, near, 2, far, 2, x, y);
}

/** One cell a corner, from the midpoints of its sides to the centre, on the corner's facet: (5.21),
 * (5.31). */
static double corners_upper(const matching *work)
{
    qm_vec middle[4], centre = qm_matching_middles(work->piece, middle);
    int count = work->piece->corner_count;
    double upper = 0.0;
    for (int i = 0; i < count; i++) {
        const facet *to = &work->facets[work->label[i]];
        const matched cell[4] = {work->at[i][work->label[i]], match_point(work, to, middle[i]),
                                 match_point(work, to, centre),
                                 match_point(work, to, middle[(i + count - 1) % count])};
        upper = fmax(upper, cell_upper(to, cell, 4));
    }
    return upper;
}

/** The bound by cells on several facets. */
static double cells_upper(const matching *work)
{
    const int *label = work->label;
    if (work->piece->corner_count == 3) {
        for (int k = 0; k < 3 && work->facet_count == 2; k++)
            if (label[(k + 1) % 3] == label[(k + 2) % 3]) return lone_corner_upper(work, k);
    } else if (work->facet_count == 2) {
        for (int k = 0; k < 2; k++)
            if (label[k] == label[k + 1] && label[k + 2] == label[(k + 3) % 4]) return halves_upper(work, k);
    }
    return corners_upper(work);
}

double qm_matching_upper(const qm_search *search, const qm_side *side, const qm_piece *piece)
{
    matching work = {.search = search, .side = side, .piece = piece};
    gather_facets(&work);
    double upper = ball_upper(piece), cutoff = allowed_distance(&work);
    for (int k = 0; k < work.facet_count && upper > cutoff; k++)
        upper = fmin(upper, whole_upper(&work, k));
    if (work.facet_count > 1 && upper > cutoff) upper = fmin(upper, cells_upper(&work));
    return upper;
}
