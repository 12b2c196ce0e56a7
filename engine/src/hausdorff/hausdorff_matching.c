/**
 * hausdorff_matching.c: pieces bounded by matching, the method of the thesis (as an option). All corners of a
 * piece are measured; a piece that is not within the cutoff is cut in four at its midpoints.
 *
 * Upper bounds. A match assigns to each point of a piece one of the target, and the largest distance of the
 * pairs bounds the piece from above (5.8). Only the facets under the corners are examined. A part is a convex
 * polygon of a triangle, or a sub-rectangle of a bilinear patch, matched to one facet:
 *
 *   one facet      the piece as a whole                            (5.13), (5.19), (5.26)
 *   two facets     two parts, cut where both are equally far       (5.15), (5.20), (5.29)
 *   more           one part a corner, meeting in the centre        (5.17), (5.21), (5.31)
 *   any            the ball round a corner: the distance is 1-Lipschitz
 *
 * Soundness: any parts that cover a piece and any facets they are matched to give a valid bound, so a cut in
 * the wrong position costs only tightness. The thesis cuts along a bisector plane, which a flat target does
 * not have, and matches corners to the facet on the other side of it; parts with corners of their own do
 * neither. Its three overlapping triangles leave the centre uncovered in one of their two readings; the
 * quads of (5.21) cover everything and serve bilinear facets too. Its Bezier triangles (5.24) give way to
 * rectangles, whose parts are in the hulls of their corners.
 *
 * Termination: all corners are measured, which raises the lower bound to them, so the ball discards every
 * piece whose diameter is below the tolerance. Each cut halves the diameter.
 *
 * Source: the thesis cited in HAUSDORFF.md, sections 5.2 to 5.4; equation numbers are of it.
 */
#include "hausdorff_sample.h"
#include "prim/bilinear.h"

/* Halvings of a piece, which leave less of it than the smallest tolerance, 2^-42 of the size. A midpoint is
 * off by u R, a centre by 3 u R, and roundings of levels add up: 48 of them fit into the share of eta for
 * cuts (rounding.h). */
#define MAX_DEPTH 48
#define MAX_FACETS 4 /* one a corner */
#define CUT_STEPS 8  /* of the search for the position that is equally far from two facets */

/** A facet of the target: a triangle, or the patch of a quad. */
typedef struct facet {
    uint32_t lane; /* QM_PACK_LANES * pack + lane; the first lane of a patch */
    bool is_patch;
    qm_bilinear patch;
} facet;

/** A corner of a part, and the point of a facet that it is matched to. */
typedef struct match_pair {
    qm_vec corner;
    double distance;
    double uv[2]; /* on a patch */
} match_pair;

/** A piece with the different facets under its corners. */
typedef struct matching {
    const qm_search *search;
    const qm_side *side;
    const qm_piece *piece;
    int facet_count;
    facet facets[MAX_FACETS];
    int label[4]; /* of each corner, in facets */
    match_pair at[4][MAX_FACETS];
} matching;

static bool holds_patch(const qm_side *side, uint32_t pack, uint32_t lane)
{
    return side->target_patches && qm_lane_has_second(&side->target->lanes[pack], lane);
}

static qm_bilinear load_patch(const qm_side *side, uint32_t pack, uint32_t lane)
{
    return qm_bvh_load_patch(side->target, side->target->lanes[pack].face[lane]);
}

/** The facet of a pack that is nearest to a point, as QM_PACK_LANES * pack + lane: a patch by its first
 * lane. */
static uint32_t nearest_facet(const qm_search *search, const qm_side *side, uint32_t pack, qm_vec p)
{
    QM_ASSERT(pack < side->target->pack_count);
    double d2[QM_PACK_LANES], nearest = INFINITY;
    uint32_t best = 0, lane_count = side->target->lanes[pack].lane_count;
    qm_pack spare;
    search->kernel->pack_distances(qm_bvh_pack(side->target, pack, &spare), p, d2);
    for (uint32_t lane = 0, next; lane < lane_count; lane = next) {
        double distance = sqrt(d2[lane]);
        next = lane + 1;
        if (holds_patch(side, pack, lane)) {
            next = lane + 2;
            distance = fmin(distance, sqrt(d2[lane + 1]));
            if (distance - qm_side_twist(side, pack, lane) >= nearest) continue;
            qm_bilinear patch = load_patch(side, pack, lane);
            distance = qm_bilinear_minimise(&patch, p, INFINITY).distance;
        }
        if (distance >= nearest) continue;
        nearest = distance;
        best = lane;
    }
    return QM_PACK_LANES * pack + best;
}

/** The midpoints of the edges (i to i + 1); returns the centre. */
static qm_vec midpoints_of(const qm_piece *piece, qm_vec midpoint[4])
{
    int count = piece->corner_count;
    qm_vec centre = {0, 0, 0};
    for (int i = 0; i < count; i++) {
        midpoint[i] = qm_vec_mix(piece->corner[i], piece->corner[(i + 1) % count], 0.5);
        centre = qm_vec_axpy(centre, 1.0 / count, piece->corner[i]);
    }
    return centre;
}

/* --- Bounds --- */

static match_pair match_point(const matching *work, const facet *to, qm_vec p)
{
    if (to->is_patch) {
        qm_bilinear_footpoint foot = qm_bilinear_minimise(&to->patch, p, INFINITY);
        return (match_pair){p, foot.distance, {foot.uv[0], foot.uv[1]}};
    }
    double d2[QM_PACK_LANES];
    qm_pack spare;
    work->search->kernel->pack_distances(qm_bvh_pack(work->side->target, to->lane / QM_PACK_LANES, &spare), p,
                                         d2);
    return (match_pair){.corner = p, .distance = sqrt(d2[to->lane % QM_PACK_LANES])};
}

/** Gathers the different facets under the corners, and matches every corner to every one of them. */
static void gather_facets(matching *work)
{
    const qm_piece *piece = work->piece;
    work->facet_count = 0;
    for (int i = 0; i < piece->corner_count; i++) {
        int k = 0;
        while (k < work->facet_count && work->facets[k].lane != piece->foot[i])
            k++;
        work->label[i] = k;
        if (k < work->facet_count) continue;
        uint32_t pack = piece->foot[i] / QM_PACK_LANES, lane = piece->foot[i] % QM_PACK_LANES;
        facet *added = &work->facets[work->facet_count++];
        added->lane = piece->foot[i];
        added->is_patch = holds_patch(work->side, pack, lane);
        if (added->is_patch) added->patch = load_patch(work->side, pack, lane);
        for (int j = 0; j < piece->corner_count; j++)
            work->at[j][k] = match_point(work, added, piece->corner[j]);
    }
}

/** A control point, see subpolygon_bound: the mean of points a and b less that of their match. */
static double control_distance(const qm_bilinear *patch, const match_pair *a, const match_pair *b)
{
    double u = 0.5 * (a->uv[0] + b->uv[0]), v = 0.5 * (a->uv[1] + b->uv[1]);
    double uv = 0.5 * (a->uv[0] * b->uv[1] + b->uv[0] * a->uv[1]);
    qm_vec on = qm_vec_axpy(qm_vec_axpy(patch->origin, u, patch->e1), v, patch->e2);
    return qm_vec_distance(qm_vec_mix(a->corner, b->corner, 0.5), qm_vec_axpy(on, uv, patch->w));
}

static double centre_distance(const qm_bilinear *patch, const match_pair part[4])
{
    double u = 0.0, v = 0.0, uv = 0.0;
    qm_vec centre = {0, 0, 0};
    for (int i = 0; i < 4; i++) {
        u += 0.25 * part[i].uv[0];
        v += 0.25 * part[i].uv[1];
        uv += 0.25 * part[i].uv[0] * part[(i + 2) % 4].uv[1];
        centre = qm_vec_axpy(centre, 0.25, part[i].corner);
    }
    qm_vec on = qm_vec_axpy(qm_vec_axpy(patch->origin, u, patch->e1), v, patch->e2);
    return qm_vec_distance(centre, qm_vec_axpy(on, uv, patch->w));
}

/**
 * Largest distance of a part to the facet that its three or four corners are matched to.
 *
 * A triangle is convex, so the distance to it is convex, and largest at a corner of any hull that holds the
 * part (5.19). On a patch the parameters of the match are linear over three corners and bilinear over four;
 * the part less its match is then a Bezier surface, quadratic in each parameter, in the hull of its control
 * points: those of the corners, one for each edge, and for four corners one in the centre (5.12, 5.13).
 * Footpoints within the unit square keep the match on the patch; and the bilinear surface of four corners is
 * the whole of a planar convex part, or of a sub-rectangle of the source's patch.
 */
static double subpolygon_bound(const facet *to, const match_pair *part, int count)
{
    QM_ASSERT(count == 3 || count == 4);
    double upper = 0.0;
    for (int i = 0; i < count; i++)
        upper = fmax(upper, part[i].distance);
    if (!to->is_patch) return upper;
    for (int i = 0; i < count; i++)
        upper = fmax(upper, control_distance(&to->patch, &part[i], &part[(i + 1) % count]));
    return count == 4 ? fmax(upper, centre_distance(&to->patch, part)) : upper;
}

static double local_cutoff(const matching *work)
{
    return qm_search_cutoff(work->search) * work->side->scale;
}

/** How much farther one facet is than another, along their planes: see cut_parameter. */
static double farther(double to_a, double to_b, double nearest)
{
    return sqrt(fmax(0.0, to_a * to_a - nearest * nearest)) -
           sqrt(fmax(0.0, to_b * to_b - nearest * nearest));
}

/**
 * Where to cut the edge from corner i, under which facet a lies, to corner j, under which b lies: the
 * position that is equally far from both, by regula falsi. Beside a facet the distance from its plane stays
 * the same and the component along the plane grows evenly: so these components are compared, and facets in
 * one plane are cut at their border by a single step. The midpoint where there is no change of sign, also for
 * the ratio 0 / 0 that (5.14) and (5.28) can have.
 */
static double cut_parameter(const matching *work, int i, int j, int a, int b)
{
    const match_pair *from = work->at[i], *to = work->at[j];
    double nearest = fmin(from[a].distance, to[b].distance), low = 0.0, high = 1.0, t = 0.5;
    double below = farther(from[a].distance, from[b].distance, nearest);
    double above = farther(to[a].distance, to[b].distance, nearest);
    if (!(below <= 0.0 && above >= 0.0 && above - below > 0.0)) return t;
    for (int step = 0; step < CUT_STEPS; step++) {
        t = low + (high - low) * qm_clamp(-below / (above - below), 0.0, 1.0);
        qm_vec p = qm_vec_mix(work->piece->corner[i], work->piece->corner[j], t);
        double to_a = match_point(work, &work->facets[a], p).distance;
        double to_b = match_point(work, &work->facets[b], p).distance;
        if (fmax(to_a, to_b) <= local_cutoff(work)) break;
        double here = farther(to_a, to_b, nearest);
        if (here < 0.0) {
            low = t;
            below = here;
            above *= 0.5; /* so that neither end stays where it is (the Illinois rule) */
        } else {
            high = t;
            above = here;
            below *= 0.5;
        }
    }
    return t;
}

/** The two parts on both sides of a cut from x to y: near is on facet a, far on b, each in turn from x on. */
static double cut_bound(const matching *work, int a, int b, const int *near, int near_count, const int *far,
                        int far_count, qm_vec x, qm_vec y)
{
    QM_ASSERT(near_count + 2 <= 4 && far_count + 2 <= 4);
    const facet *first = &work->facets[a], *second = &work->facets[b];
    match_pair part[4];
    for (int i = 0; i < near_count; i++)
        part[i] = work->at[near[i]][a];
    part[near_count] = match_point(work, first, y);
    part[near_count + 1] = match_point(work, first, x);
    double upper = subpolygon_bound(first, part, near_count + 2);
    for (int i = 0; i < far_count; i++)
        part[i] = work->at[far[i]][b];
    part[far_count] = match_point(work, second, x);
    part[far_count + 1] = match_point(work, second, y);
    return fmax(upper, subpolygon_bound(second, part, far_count + 2));
}

/** A triangle with corner k on one facet and the two others on another: (5.20), and (5.15) for patches. */
static double lone_corner_bound(const matching *work, int k)
{
    int i = (k + 1) % 3, j = (k + 2) % 3, a = work->label[k], b = work->label[i];
    const qm_vec *corner = work->piece->corner;
    qm_vec x = qm_vec_mix(corner[k], corner[j], cut_parameter(work, k, j, a, b));
    qm_vec y = qm_vec_mix(corner[k], corner[i], cut_parameter(work, k, i, a, b));
    const int far[2] = {i, j};
    return cut_bound(work, a, b, &k, 1, far, 2, x, y);
}

/** A rectangle with corners k and k + 1 on one facet and the others on another: cut along a parameter
 * (5.29). */
static double halves_bound(const matching *work, int k)
{
    int near[2] = {k, (k + 1) % 4}, far[2] = {(k + 2) % 4, (k + 3) % 4};
    int a = work->label[near[0]], b = work->label[far[0]];
    double t =
        0.5 * (cut_parameter(work, near[0], far[1], a, b) + cut_parameter(work, near[1], far[0], a, b));
    const qm_vec *corner = work->piece->corner;
    qm_vec x = qm_vec_mix(corner[near[0]], corner[far[1]], t);
    qm_vec y = qm_vec_mix(corner[near[1]], corner[far[0]], t);
    return cut_bound(work, a, b, near, 2, far, 2, x, y);
}

/** One part a corner, from the edges' midpoints to the centre, on the corner's facet: (5.21), (5.31). */
static double corners_bound(const matching *work)
{
    qm_vec midpoint[4], centre = midpoints_of(work->piece, midpoint);
    int count = work->piece->corner_count;
    double upper = 0.0;
    for (int i = 0; i < count; i++) {
        const facet *to = &work->facets[work->label[i]];
        const match_pair part[4] = {work->at[i][work->label[i]], match_point(work, to, midpoint[i]),
                                    match_point(work, to, centre),
                                    match_point(work, to, midpoint[(i + count - 1) % count])};
        upper = fmax(upper, subpolygon_bound(to, part, 4));
    }
    return upper;
}

/**
 * Upper bound (local) of the distance of any point of a piece, whose corners have their facets and distances.
 * Not improved once it is at most the cutoff.
 */
static double matching_bound(const qm_search *search, const qm_side *side, const qm_piece *piece)
{
    matching work = {.search = search, .side = side, .piece = piece};
    gather_facets(&work);
    int count = piece->corner_count;
    double upper = INFINITY, cutoff = local_cutoff(&work);
    /* The ball round a corner: the distance grows by the distance to the other corners at most. */
    for (int i = 0; i < count; i++) {
        double radius = 0.0;
        for (int j = 0; j < count; j++)
            radius = fmax(radius, qm_vec_distance(piece->corner[i], piece->corner[j]));
        upper = fmin(upper, piece->distance[i] + radius);
    }
    /* All corners matched to one facet: (5.13), (5.19), (5.26), and the minima in (5.16), (5.22), (5.31). */
    for (int k = 0; k < work.facet_count && upper > cutoff; k++) {
        match_pair part[4];
        for (int i = 0; i < count; i++)
            part[i] = work.at[i][k];
        upper = fmin(upper, subpolygon_bound(&work.facets[k], part, count));
    }
    if (work.facet_count < 2 || !(upper > cutoff)) return upper;
    /* Parts on two facets, where a cut parts their corners, or else one part a corner. */
    const int *label = work.label;
    for (int k = 0; k < count && work.facet_count == 2; k++) {
        if (count == 3 && label[(k + 1) % 3] == label[(k + 2) % 3])
            return fmin(upper, lone_corner_bound(&work, k));
        if (count == 4 && label[k] == label[(k + 1) % 4] && label[(k + 2) % 4] == label[(k + 3) % 4])
            return fmin(upper, halves_bound(&work, k));
    }
    return fmin(upper, corners_bound(&work));
}

/* --- Pieces --- */

/** A piece on its way through one visit. */
typedef struct matching_work {
    qm_worker *worker;
    const qm_side *side;
    qm_entry entry;
    qm_piece piece;
} matching_work;

/** A point of the source with the data that a piece has of its corners. */
typedef struct corner_data {
    qm_vec at;
    double distance;
    uint32_t foot;
} corner_data;

/** Measures a point of the piece, which may raise the lower bound, and finds the facet under it. */
static corner_data measure_point(const matching_work *work, qm_vec p, uint32_t hint)
{
    double distance = qm_sample_point(work->worker, work->side, p, 0.0, work->piece.face, 0.0, &hint);
    return (corner_data){p, distance, nearest_facet(work->worker->search, work->side, hint, p)};
}

static void store_corner(qm_piece *piece, int i, corner_data point)
{
    piece->corner[i] = point.at;
    piece->distance[i] = point.distance;
    piece->foot[i] = point.foot;
}

/** Bounds the piece, and discards or queues it. */
static void push_piece(const matching_work *work)
{
    double upper = matching_bound(work->worker->search, work->side, &work->piece);
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

void qm_matching_visit_face(qm_worker *worker, qm_entry pack, const qm_piece *face)
{
    QM_ASSERT(worker && face);
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
static void push_part(qm_worker *worker, qm_entry entry, const qm_piece *piece, const corner_data corner[4])
{
    matching_work work;
    start_work(&work, worker, entry, piece);
    work.piece.depth++;
    for (int i = 0; i < piece->corner_count; i++)
        store_corner(&work.piece, i, corner[i]);
    push_piece(&work);
}

void qm_matching_visit_piece(qm_worker *worker, qm_entry entry, const qm_piece *piece)
{
    QM_ASSERT(worker && piece);
    if (piece->depth >= MAX_DEPTH) {
        qm_worker_discard(worker, entry.upper);
        return;
    }
    matching_work work;
    start_work(&work, worker, entry, piece);
    int count = piece->corner_count;
    qm_vec at[4], centre_place = midpoints_of(piece, at);
    corner_data midpoint[4], centre;
    for (int i = 0; i < count; i++)
        midpoint[i] = measure_point(&work, at[i], piece->foot[i] / QM_PACK_LANES);
    if (count == 4) centre = measure_point(&work, centre_place, midpoint[0].foot / QM_PACK_LANES);
    for (int i = 0; i < count; i++) {
        corner_data before = midpoint[(i + count - 1) % count],
                    corner = {piece->corner[i], piece->distance[i], piece->foot[i]};
        const corner_data part[4] = {corner, midpoint[i], count == 4 ? centre : before, before};
        push_part(worker, entry, piece, part);
    }
    if (count == 3) push_part(worker, entry, piece, midpoint);
}
