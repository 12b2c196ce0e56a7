/**
 * hausdorff_rectangle.c: parameter rectangles of the source's bilinear patches. The part of the patch lies in
 * the hull of its four corners, and near the two triangles of qm_bilinear_halve, by a share of |w| ds dt.
 */
#include <string.h>

#include "hausdorff_piece.h"
#include "prim/bilinear_match.h"

#define SLACK_SHARE 0.25 /* of the tolerance: a patch this flat goes on as triangles */
/* Of the cutoff distance: a patch bent more is cut before its triangles are tried */
#define MAX_SLACK_SHARE 0.5
#define MIDDLE_LEVELS 8 /* cut in the middle: grids refined by halves then meet line on line */
#define MIN_SIDE 0.7    /* of the longer side: a shorter one is cut as well */
#define MAX_RESTS 512   /* parts that a match leaves over */
#define THIN 0.06       /* of the longer side: a rectangle with a shorter one is thin */
#define MAX_LEFT 0.75   /* of the longer side of a thin rectangle may be left over */
#define MAX_ATTEMPTS 3  /* covers of one rectangle, each with candidates that its middle brought */
#define OFTEN 3         /* cuts and matches that have left a rectangle over, at least */
#define CROSSING_STEPS 40
#define INSET 1e-3           /* share of the way in at which the patch under an end is looked up */
#define CROSSING_MARGIN 1e-3 /* share of the rectangle that a cut must leave on both sides */

static qm_bilinear source_patch(const qm_piece_work *work)
{
    const uint32_t *vertex = work->side->source->mesh.faces + 4 * (size_t)work->piece.face;
    qm_vec corner[4];
    for (int i = 0; i < 4; i++)
        corner[i] = qm_side_vertex(work->side, vertex[i]);
    return qm_bilinear_make(corner);
}

/** One label for the hull of the four corners, which holds that part of the patch. */
static bool hull_reached(const qm_piece_work *work, qm_polygon *corners)
{
    uint64_t labels = ~UINT64_C(0);
    corners->count = 4;
    for (int i = 0; i < 4; i++) {
        corners->corner[i] = work->piece.corner[i];
        corners->in_reach[i] = work->kernel->in_reach(&work->candidates, work->piece.corner[i]);
        labels &= corners->in_reach[i];
    }
    return labels != 0;
}

/**
 * Along the line where a patch of the target is just as far as is cutoff it covers a share of each part that
 * is left over, again and again: such parts are worth the search for a patch that covers more.
 */
static bool is_left_often(const qm_piece_work *work)
{
    return work->piece.depth >= OFTEN;
}

/** Covers the two triangles of a rectangle, with the slack by which the patch leaves them; near are quads
 * near its middle. */
static bool triangles_reached(qm_piece_work *work, const qm_bilinear_halves *halves, qm_vec middle,
                              const qm_near_quads *near)
{
    qm_piece_set_slack(work, halves->slack);
    qm_piece_fill_candidates(work);
    const qm_vec *c = halves->corner;
    qm_polygon whole = {.count = 4, .corner = {c[0], c[1], c[2], c[3]}};
    qm_refined refined;
    bool is_refined = qm_piece_refine(work, &whole, middle, near, &refined);
    bool covered = true, moved = false;
    for (int half = 0; half < 2 && covered; half++) {
        qm_polygon polygon = qm_piece_triangle(work, c[0], c[1 + half], c[2 + half]);
        qm_piece_reach_corners(work, &polygon);
        covered = qm_piece_cover_with(work, is_refined ? &refined : NULL, &polygon, &moved);
    }
    qm_piece_set_slack(work, 0.0);
    qm_piece_fill_candidates(work);
    return covered;
}

/** The quad of the target that lies under a point, or QM_NO_INDEX when it is a triangle. */
static uint32_t quad_under(const qm_piece_work *work, qm_vec p)
{
    qm_hit hit = {.d2 = INFINITY, .pack = work->packs[0]};
    work->kernel->closest(work->side->target, p, &hit);
    uint32_t face = work->side->target->lanes[hit.pack].face[hit.lane];
    qm_vec corner[4];
    return qm_bvh_load_face(work->side->target, face, corner) == 4 ? face : QM_NO_INDEX;
}

/** How far along [from, to] the target's patch under the point at from reaches; from when it does not reach
 * even that. */
static double patch_reach(const qm_piece_work *work, const qm_bilinear *source, int axis, double from,
                          double to)
{
    double at[2] = {0.5 * (work->piece.low[0] + work->piece.high[0]),
                    0.5 * (work->piece.low[1] + work->piece.high[1])};
    at[axis] = from + INSET * (to - from); /* off the line where two patches meet */
    uint32_t face = quad_under(work, qm_bilinear_at(source, at[0], at[1]));
    if (face == QM_NO_INDEX) return from;
    qm_bilinear target = qm_bvh_load_patch(work->side->target, face);
    /* Half of what is cutoff: the speed along this line may be up to twice as great at the rectangle's
     * sides. */
    double cutoff = 0.5 * qm_piece_cutoff(work), inside = from, outside = to;
    for (int step = 0; step < CROSSING_STEPS; step++) {
        at[axis] = step == 0 ? to : 0.5 * (inside + outside);
        bool is_reached =
            qm_bilinear_descend(&target, qm_bilinear_at(source, at[0], at[1]), cutoff).distance <= cutoff;
        if (is_reached && step == 0) return to;
        *(is_reached ? &inside : &outside) = at[axis];
    }
    return inside;
}

/**
 * Where to cut: the middle, but deep down on every second level the place where the rectangle leaves the
 * patch of the target under one of its ends. Where two surfaces lie in one another only such cuts come to an
 * end.
 */
static double cutting_place(const qm_piece_work *work, const qm_bilinear *patch, int axis)
{
    double low = work->piece.low[axis], high = work->piece.high[axis],
           margin = CROSSING_MARGIN * (high - low);
    if (work->side->target_patches && work->piece.depth > MIDDLE_LEVELS && work->piece.depth % 2 == 1) {
        for (int end = 0; end < 2; end++) {
            double place = patch_reach(work, patch, axis, end ? high : low, end ? low : high);
            if (place > low + margin && place < high - margin) return place;
        }
    }
    return 0.5 * (low + high);
}

/** Queues the part of the rectangle that lies between these parameters. */
static void push_part(qm_piece_work *work, const qm_bilinear *patch, const double low[2],
                      const double high[2])
{
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
    qm_piece_push(work, &part);
}

/** What is left of a rectangle after a match. */
typedef struct rest_list {
    int count; /* may be more than are kept */
    qm_uv_box at[MAX_RESTS];
} rest_list;

static void keep_rest(void *user, const qm_uv_box *rest)
{
    rest_list *list = user;
    if (list->count < MAX_RESTS) list->at[list->count] = *rest;
    list->count++;
}

static void copy_rest(const rest_list *from, rest_list *to)
{
    to->count = from->count;
    memcpy(to->at, from->at, (size_t)from->count * sizeof *from->at);
}

/** Of the parameters. */
static double area_of(const rest_list *list)
{
    double area = 0.0;
    for (int i = 0; i < list->count; i++) {
        const qm_uv_box *box = &list->at[i];
        area += (box->high[0] - box->low[0]) * (box->high[1] - box->low[1]);
    }
    return area;
}

/** Sums of the lengths of opposite sides. */
static void side_lengths(const qm_vec c[4], double side[2])
{
    side[0] = qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]);
    side[1] = qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2]);
}

/**
 * Whether what a match leaves over is worth to go on with. Beside an edge of the target each match may halve
 * a strip and leave the half at the edge, as long as before, without an end: of a thin rectangle everything
 * must be covered, or what is left over must be shorter.
 */
static bool gets_on(const qm_piece_work *work, const qm_bilinear *patch, const rest_list *rest)
{
    double side[2];
    side_lengths(work->piece.corner, side);
    if (rest->count > MAX_RESTS) return false;
    double longer = qm_max(side[0], side[1]);
    if (qm_min(side[0], side[1]) > THIN * longer) return true;
    for (int i = 0; i < rest->count; i++) {
        qm_vec corner[4];
        double left[2];
        qm_uv_box_corners(patch, &rest->at[i], corner);
        side_lengths(corner, left);
        if (qm_max(left[0], left[1]) > MAX_LEFT * longer) return false;
    }
    return true;
}

static qm_uv_box parameters_of(const qm_piece *piece)
{
    return (qm_uv_box){{piece->low[0], piece->low[1]}, {piece->high[0], piece->high[1]}};
}

/** Covers the rectangle, or parts of it, by a face of the target with nearly the same corners; rest is what
 * is left over. */
static bool alike_reached(const qm_piece_work *work, const qm_bilinear *patch, uint32_t face, rest_list *rest)
{
    qm_vec corner[4];
    rest->count = 0;
    if (qm_bvh_load_face(work->side->target, face, corner) != 4) return false;
    qm_uv_box box = parameters_of(&work->piece);
    qm_bilinear alike = qm_bilinear_make(corner);
    return qm_bilinear_match_alike(patch, &box, &alike, qm_piece_cutoff(work), keep_rest, rest) &&
           gets_on(work, patch, rest);
}

/**
 * The same by the target's face of the same number. Meshes that nearly coincide are mostly one mesh twice; in
 * a heap of patches that cross each other hundreds of others are as near to the middle of a face, and no
 * search tells its counterpart from them.
 */
static bool counterpart_reached(const qm_piece_work *work, const qm_bilinear *patch, rest_list *rest)
{
    rest->count = 0;
    return work->side->target_patches && work->piece.face < work->side->target->mesh.face_count &&
           alike_reached(work, patch, work->piece.face, rest);
}

/** Covers all of the rectangle by a quad of the pack that is near to what lies round it: over copies of one
 * face no foot need be found. */
static bool hinted_reached(const qm_piece_work *work, const qm_bilinear *patch)
{
    const qm_pack_lanes *lanes = &work->side->target->lanes[work->entry.hint];
    rest_list rest;
    for (uint32_t lane = 1; work->side->target_patches && lane < lanes->lane_count; lane++)
        if (qm_lane_is_second(lanes, lane) && alike_reached(work, patch, lanes->face[lane], &rest) &&
            rest.count == 0)
            return true;
    return false;
}

/** The quads of the target near the middle of the rectangle that may cover some of it. */
static qm_near_quads quads_below(const qm_piece_work *work, qm_vec middle)
{
    double cutoff = qm_piece_cutoff(work), radius = qm_vec_radius(work->piece.corner, 4, middle);
    qm_quads_asked asked = {.wanted = QM_NEAR_QUADS, .within = cutoff + radius, .enough = cutoff};
    if (!work->side->target_patches) return (qm_near_quads){.count = 0};
    if (is_left_often(work)) asked.enough = -1.0;
    return qm_piece_near_quads(work, middle, asked);
}

/** Covers the rectangle, or parts of it, by one of the quads near its middle: the first that covers any of
 * it, or, once it is left over often, that which leaves least. */
static bool match_reached(const qm_piece_work *work, const qm_bilinear *patch, qm_vec middle,
                          qm_near_quads *near, rest_list *least)
{
    qm_uv_box box = parameters_of(&work->piece);
    double left = INFINITY;
    for (int i = 0; i < near->count && left > 0.0; i++) {
        qm_near_quad *quad = &near->at[i];
        rest_list rest;
        qm_piece_find_foot(quad, middle);
        rest.count = 0;
        bool is_matched =
            qm_bilinear_match(patch, &box, &quad->patch, quad->uv, qm_piece_cutoff(work), keep_rest, &rest);
        if (!is_matched || !gets_on(work, patch, &rest)) continue;
        double area = area_of(&rest);
        if (!(area < left)) continue;
        left = area;
        copy_rest(&rest, least);
        if (!is_left_often(work)) break;
    }
    return left < INFINITY;
}

/** Covers the rectangle, or parts of it, by one patch. near are the quads near its middle that were looked
 * for. The counterpart may leave over parts of a whole face only: where it is just as far as is cutoff it
 * would leave over parts of parts endlessly. */
static bool patch_reached(const qm_piece_work *work, const qm_bilinear *patch, qm_vec middle,
                          qm_near_quads *near, rest_list *rest)
{
    near->count = 0;
    if (counterpart_reached(work, patch, rest) && (rest->count == 0 || work->piece.depth == 0)) return true;
    *near = quads_below(work, middle);
    return match_reached(work, patch, middle, near, rest);
}

/**
 * Cuts a rectangle across its longer side; over a target without patches across both where they are about as
 * long, since slack falls by half only with each cut and what needs one mostly needs the next.
 */
static void split_rectangle(qm_piece_work *work, const qm_bilinear *patch)
{
    double side[2];
    side_lengths(work->piece.corner, side);
    const double *low = work->piece.low, *high = work->piece.high;
    int longer = side[0] >= side[1] ? 0 : 1;
    double place[2];
    int parts[2];
    for (int k = 0; k < 2; k++) {
        bool is_cut = k == longer || (!work->side->target_patches && side[k] > MIN_SIDE * side[longer]);
        parts[k] = is_cut ? 2 : 1;
        place[k] = is_cut ? cutting_place(work, patch, k) : high[k];
    }
    for (int i = 0; i < parts[0]; i++)
        for (int j = 0; j < parts[1]; j++)
            push_part(work, patch, (const double[]){i ? place[0] : low[0], j ? place[1] : low[1]},
                      (const double[]){i ? high[0] : place[0], j ? high[1] : place[1]});
}

/** Goes on with the two triangles, which a patch this flat leaves by a share of the tolerance. */
static void go_on_as_triangles(qm_piece_work *work, const qm_bilinear_halves *halves)
{
    qm_piece_set_slack(work, halves->slack);
    qm_piece_fill_candidates(work);
    qm_piece_keep_triangle(work, halves->corner[0], halves->corner[1], halves->corner[2]);
    qm_piece_keep_triangle(work, halves->corner[0], halves->corner[2], halves->corner[3]);
    qm_piece_process_stack(work);
}

bool qm_piece_rectangle_covered(qm_piece_work *work)
{
    const qm_vec *c = work->piece.corner;
    qm_bilinear patch = source_patch(work);
    rest_list rest;
    if (counterpart_reached(work, &patch, &rest) && rest.count == 0) return true;
    if (hinted_reached(work, &patch)) return true;
    qm_polygon hull = {.count = 4, .corner = {c[0], c[1], c[2], c[3]}};
    bool moved = false, covered = qm_piece_cover_by_nearest(work, &hull, &moved);
    if (covered) return true;
    qm_bilinear_halves halves = qm_bilinear_halve(c, (qm_vec){0, 0, 0});
    if (!(halves.slack < MAX_SLACK_SHARE * qm_piece_cutoff(work))) return false;
    qm_piece_set_slack(work, halves.slack);
    covered = true;
    for (int half = 0; half < 2 && covered; half++) {
        const qm_vec *h = halves.corner;
        qm_polygon triangle = qm_piece_triangle(work, h[0], h[1 + half], h[2 + half]);
        covered = qm_piece_cover_by_nearest(work, &triangle, &moved);
    }
    qm_piece_set_slack(work, 0.0);
    return covered;
}

/** Measures the corners that no candidate reaches; true when that brought candidates or raised the lower
 * bound. */
static bool sample_unreached_corners(qm_piece_work *work)
{
    bool found = false;
    for (int i = 0; i < 4; i++)
        found |= qm_piece_sample_unreached(work, work->piece.corner[i]);
    return found;
}

/** Covers a rectangle by all candidates and what its middle brings; else *corners are its own, with
 * in_reach. */
static bool rectangle_reached(qm_piece_work *work, const qm_bilinear *patch, const qm_bilinear_halves *halves,
                              qm_polygon *corners)
{
    const qm_piece *piece = &work->piece;
    qm_vec middle =
        qm_bilinear_at(patch, 0.5 * (piece->low[0] + piece->high[0]), 0.5 * (piece->low[1] + piece->high[1]));
    for (int attempt = 0; attempt < MAX_ATTEMPTS; attempt++) {
        if (hull_reached(work, corners)) return true;
        rest_list rest;
        qm_near_quads near;
        bool is_matched = patch_reached(work, patch, middle, &near, &rest);
        if (is_matched && rest.count == 0) return true;
        bool is_flat = halves->slack < qm_piece_cutoff(work);
        if (is_flat && triangles_reached(work, halves, middle, &near)) return true;
        if (is_matched &&
            !(is_left_often(work) && attempt + 1 < MAX_ATTEMPTS && sample_unreached_corners(work))) {
            for (int k = 0; k < rest.count; k++)
                push_part(work, patch, rest.at[k].low, rest.at[k].high);
            return true;
        }
        if (!is_matched && !qm_piece_sample_unreached(work, middle)) break;
    }
    return false;
}

void qm_piece_process_rectangle(qm_piece_work *work)
{
    qm_polygon corners;
    qm_bilinear_halves halves = qm_bilinear_halve(work->piece.corner, (qm_vec){0, 0, 0});
    qm_bilinear patch = source_patch(work);
    bool reached = rectangle_reached(work, &patch, &halves, &corners);
    qm_worker_discard(work->worker, qm_search_cutoff(work->search));
    if (reached) return;
    if (halves.slack <= SLACK_SHARE * work->search->tolerance * work->side->scale) {
        go_on_as_triangles(work, &halves);
        return;
    }
    qm_piece_sample_corners(work, &corners, QM_STRICT_DEPTH);
    split_rectangle(work, &patch);
}
