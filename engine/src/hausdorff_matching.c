/**
 * hausdorff_matching.c: the lower stage of the thesis's own bounds. Every corner of a piece is projected; a
 * match assigns to each point of the piece one of the target, and the greatest distance of the pairs bounds
 * the piece from above (5.8). Pieces that are not near enough are cut in four at their midpoints.
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
 * Termination: all corners are measured, which raises the lower bound to them, and the ball then lets every
 * piece go whose diameter is below the tolerance. Each cut halves the diameter.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, sections 5.2 to 5.4.
 */
#include "bilinear_point.h"
#include "hausdorff_search.h"

#define MAX_FACETS 4 /* one a corner */
#define CUT_STEPS 8  /* of the search for the place that is equally far from two facets */
#define MAX_DEPTH                                                                                            \
    64 /* halvings: what is left is a point, and only a bound that cannot be proven keeps it                 \
        */

/** A facet of the target: a triangle, or the patch of a quad. */
typedef struct facet {
    uint32_t place; /* QM_PACK_LANES * pack + lane; the first lane of a patch */
    bool is_patch;
    qm_patch patch;
} facet;

/** A corner of a cell, and the point of a facet that it is matched to. */
typedef struct matched {
    qm_vec corner;
    double distance;
    double uv[2]; /* on a patch */
} matched;

typedef struct matching_work {
    qm_worker *worker;
    const qm_side *side;
    const qm_kernel *kernel;
    qm_entry entry;
    qm_piece piece;
    int facet_count;
    facet facets[MAX_FACETS]; /* the different ones under the corners */
    int label[4];             /* of each corner, in facets */
    matched at[4][MAX_FACETS];
} matching_work;

/* Facets and feet */

static bool holds_patch(const qm_side *side, uint32_t pack, uint32_t lane)
{
    const qm_pack_lanes *lanes = &side->target->lanes[pack];
    return side->target_patches && lane + 1 < lanes->lane_count && (lanes->second >> (lane + 1) & 1);
}

static qm_patch load_patch(const qm_side *side, uint32_t pack, uint32_t lane)
{
    qm_vec corner[4];
    qm_bvh_load_face(side->target, side->target->lanes[pack].face[lane], corner);
    return qm_patch_make(corner);
}

/** The facet of a pack that is nearest to a point. */
static uint32_t nearest_place(const matching_work *work, uint32_t pack, qm_vec p)
{
    const qm_side *side = work->side;
    double d2[QM_PACK_LANES], nearest = INFINITY;
    uint32_t best = 0, lane_count = side->target->lanes[pack].lane_count;
    work->kernel->pack_distances(&side->target->packs[pack], p, d2);
    for (uint32_t lane = 0, next; lane < lane_count; lane = next) {
        double distance = sqrt(d2[lane]);
        next = lane + 1;
        if (holds_patch(side, pack, lane)) {
            next = lane + 2;
            distance = fmin(distance, sqrt(d2[lane + 1]));
            if (distance - qm_side_twist(side, pack, lane) >= nearest) continue;
            qm_patch patch = load_patch(side, pack, lane);
            distance = qm_patch_descend(&patch, p).distance;
        }
        if (distance >= nearest) continue;
        nearest = distance;
        best = lane;
    }
    return QM_PACK_LANES * pack + best;
}

/** A point of the source with what a piece keeps of its corners. */
typedef struct measured {
    qm_vec at;
    double distance;
    uint32_t foot;
} measured;

/** Measures a point of the piece, which may raise the lower bound, and finds the facet under it. */
static measured measure_point(const matching_work *work, qm_vec p, uint32_t hint)
{
    double distance = qm_worker_sample(work->worker, work->side, p, 0.0, work->piece.face, &hint);
    return (measured){p, distance, nearest_place(work, hint, p)};
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

static matched match_point(const matching_work *work, const facet *to, qm_vec p)
{
    if (to->is_patch) {
        qm_patch_foot foot = qm_patch_descend(&to->patch, p);
        return (matched){p, foot.distance, {foot.uv[0], foot.uv[1]}};
    }
    double d2[QM_PACK_LANES];
    work->kernel->pack_distances(&work->side->target->packs[to->place / QM_PACK_LANES], p, d2);
    return (matched){.corner = p, .distance = sqrt(d2[to->place % QM_PACK_LANES])};
}

/** Gathers the different facets under the corners, and matches every corner to every one of them. */
static void gather_facets(matching_work *work)
{
    const qm_piece *piece = &work->piece;
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

/* Bounds of cells */

/** A control point of the difference: the mean of points a and b less that of their match, see cell_upper. */
static double control_distance(const qm_patch *patch, const matched *a, const matched *b)
{
    double u = 0.5 * (a->uv[0] + b->uv[0]), v = 0.5 * (a->uv[1] + b->uv[1]);
    double uv = 0.5 * (a->uv[0] * b->uv[1] + b->uv[0] * a->uv[1]);
    qm_vec on = qm_vec_axpy(qm_vec_axpy(patch->origin, u, patch->e1), v, patch->e2);
    return qm_vec_distance(qm_vec_mix(a->corner, b->corner, 0.5), qm_vec_axpy(on, uv, patch->w));
}

static double centre_distance(const qm_patch *patch, const matched cell[4])
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
 * (5.12, 5.13). Feet within the unit square keep the match on the patch.
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
static double whole_upper(const matching_work *work, int k)
{
    matched cell[4];
    for (int i = 0; i < work->piece.corner_count; i++)
        cell[i] = work->at[i][k];
    return cell_upper(&work->facets[k], cell, work->piece.corner_count);
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

static double allowed_distance(const matching_work *work)
{
    return qm_search_allowed(work->worker->search) * work->side->scale;
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
static double cut_place(const matching_work *work, int i, int j, int a, int b)
{
    const matched *from = work->at[i], *to = work->at[j];
    double least = fmin(from[a].distance, to[b].distance), low = 0.0, high = 1.0, place = 0.5;
    double below = farther(from[a].distance, from[b].distance, least);
    double above = farther(to[a].distance, to[b].distance, least);
    if (!(below <= 0.0 && above >= 0.0 && above - below > 0.0)) return place;
    for (int step = 0; step < CUT_STEPS; step++) {
        place = low + (high - low) * qm_clamp(-below / (above - below), 0.0, 1.0);
        qm_vec p = qm_vec_mix(work->piece.corner[i], work->piece.corner[j], place);
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

/** The two cells on both sides of a cut from x to y: near lies on facet a, far on b, each in turn from x on.
 */
static double cut_upper(const matching_work *work, int a, int b, const int *near, int near_count,
                        const int *far, int far_count, qm_vec x, qm_vec y)
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
static double lone_corner_upper(const matching_work *work, int k)
{
    int i = (k + 1) % 3, j = (k + 2) % 3, a = work->label[k], b = work->label[i];
    const qm_vec *corner = work->piece.corner;
    qm_vec x = qm_vec_mix(corner[k], corner[j], cut_place(work, k, j, a, b));
    qm_vec y = qm_vec_mix(corner[k], corner[i], cut_place(work, k, i, a, b));
    const int far[2] = {i, j};
    return cut_upper(work, a, b, &k, 1, far, 2, x, y);
}

/** A rectangle with corners k and k + 1 on one facet and the others on another: cut along a parameter (5.29).
 */
static double halves_upper(const matching_work *work, int k)
{
    int near[2] = {k, (k + 1) % 4}, far[2] = {(k + 2) % 4, (k + 3) % 4};
    int a = work->label[near[0]], b = work->label[far[0]];
    double place = 0.5 * (cut_place(work, near[0], far[1], a, b) + cut_place(work, near[1], far[0], a, b));
    const qm_vec *corner = work->piece.corner;
    qm_vec x = qm_vec_mix(corner[near[0]], corner[far[1]], place);
    qm_vec y = qm_vec_mix(corner[near[1]], corner[far[0]], place);
    return cut_upper(work, a, b, near, 2, far, 2, x, y);
}

/** The midpoints of the sides (i to i + 1), and the centre. */
static qm_vec piece_middles(const qm_piece *piece, qm_vec middle[4])
{
    int count = piece->corner_count;
    qm_vec centre = {0, 0, 0};
    for (int i = 0; i < count; i++) {
        middle[i] = qm_vec_mix(piece->corner[i], piece->corner[(i + 1) % count], 0.5);
        centre = qm_vec_axpy(centre, 1.0 / count, piece->corner[i]);
    }
    return centre;
}

/** One cell a corner, from the midpoints of its sides to the centre, on the corner's facet: (5.21), (5.31).
 */
static double corners_upper(const matching_work *work)
{
    qm_vec middle[4], centre = piece_middles(&work->piece, middle);
    int count = work->piece.corner_count;
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
static double cells_upper(const matching_work *work)
{
    const int *label = work->label;
    if (work->piece.corner_count == 3) {
        for (int k = 0; k < 3 && work->facet_count == 2; k++)
            if (label[(k + 1) % 3] == label[(k + 2) % 3]) return lone_corner_upper(work, k);
    } else if (work->facet_count == 2) {
        for (int k = 0; k < 2; k++)
            if (label[k] == label[k + 1] && label[k + 2] == label[(k + 3) % 4]) return halves_upper(work, k);
    }
    return corners_upper(work);
}

/* Pieces */

/** Bounds the piece, and lets it go or queues it. */
static void push_piece(matching_work *work)
{
    gather_facets(work);
    double upper = ball_upper(&work->piece), allowed = allowed_distance(work);
    for (int k = 0; k < work->facet_count && upper > allowed; k++)
        upper = fmin(upper, whole_upper(work, k));
    if (work->facet_count > 1 && upper > allowed) upper = fmin(upper, cells_upper(work));
    qm_entry entry = work->entry;
    entry.upper = fmin(entry.upper, upper * work->side->inverse_scale);
    entry.hint = work->piece.foot[0] / QM_PACK_LANES;
    qm_worker_push(work->worker, entry, &work->piece);
}

static void start_work(matching_work *work, qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    work->worker = worker;
    work->side = &worker->search->side[entry.side];
    work->kernel = worker->search->kernel;
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
    qm_vec place[4], centre_place = piece_middles(piece, place);
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
