/**
 * hausdorff_candidates.c: the facets of the target that a piece may be covered with.
 *
 * Any facets make valid bounds; the choice decides how often a cover succeeds. The candidates are the packs
 * nearest to the piece. Where the target has patches, single quads among them are measured themselves, and
 * the part of a patch under a polygon gets labels of its own.
 */
#include "hausdorff_candidates.h"
#include "prim/bilinear.h"

#define NEGLIGIBLE_TWIST 0.1 /* of the tolerance: labels with less are not refined */
#define CERTAIN_DEPTH 16     /* from here on every quad that may be nearer is measured */
#define MIN_SINE 0.01        /* between the directions of a patch, for a ball to bound the footpoints, */
#define MAX_BEND 0.1         /* and how much of their area they may lose or gain within the ball */
#define QUAD_TRIES 2         /* of the nearest quads, to show that a point is near enough */
#define FOLD_MARGIN 1e-3     /* of the change of the area: how far from the fold a part of a patch ends */
#define REFINED_MARGIN 1.1   /* by which refined labels extend beyond the piece, from its centre */

/** The largest twist of a patch that is not refined, local. */
static double negligible_twist(const qm_piece_work *work)
{
    return NEGLIGIBLE_TWIST * work->search->tolerance * work->side->scale;
}

void qm_candidates_fill(qm_candidates *candidates, const qm_side *side, const uint32_t *packs, int count,
                        double cutoff)
{
    QM_ASSERT(candidates && side && packs);
    QM_ASSERT(count >= 0 && count <= QM_COVER_PACKS);
    candidates->count = count;
    for (int k = 0; k < count; k++) {
        candidates->id[k] = packs[k];
        candidates->pack[k] = qm_bvh_pack(side->target, packs[k], &candidates->spare[k]);
        for (uint32_t lane = 0; lane < QM_PACK_LANES; lane++)
            qm_candidates_set_cutoff(candidates, k, lane, qm_side_twist(side, packs[k], lane), cutoff);
    }
}

void qm_candidates_refill(qm_piece_work *work)
{
    work->filled_for = qm_candidates_cutoff(work);
    qm_candidates_fill(&work->candidates, work->side, work->packs, work->pack_count,
                       work->filled_for - work->slack);
    work->generation++;
}

bool qm_candidates_add(qm_piece_work *work, uint32_t pack)
{
    QM_ASSERT(pack < work->side->target->pack_count);
    QM_ASSERT(work->pack_count >= 0 && work->pack_count <= QM_COVER_PACKS);
    for (int k = 0; k < work->pack_count; k++)
        if (work->packs[k] == pack) return false;
    if (work->pack_count < QM_COVER_PACKS) work->pack_count++;
    for (int k = work->pack_count - 1; k > 0; k--)
        work->packs[k] = work->packs[k - 1];
    work->packs[0] = pack;
    return true;
}

void qm_candidates_gather(qm_piece_work *work, qm_near_packs *near)
{
    QM_ASSERT(work && near);
    qm_box box = qm_vec_box(work->piece.corner, work->piece.corner_count);
    work->kernel->gather(work->side->target, &box, qm_candidates_cutoff(work), near);
    work->near = near;
    work->pack_count =
        work->kernel->narrow(work->near, &box, qm_candidates_cutoff(work), QM_COVER_PACKS, work->packs);
    if (work->pack_count == 0 || work->side->target_patches) qm_candidates_add(work, work->entry.hint);
    qm_candidates_refill(work);
}

enum { MAX_QUADS = QM_COVER_PACKS * QM_PACK_LANES / 2 };

/** Quads of the candidates with the distance to their triangles. */
typedef struct quad_list {
    int count;
    struct listed_quad {
        double distance, twist;
        uint32_t face, pack;
    } at[MAX_QUADS];
} quad_list;

static void list_quads(const qm_piece_work *work, qm_vec p, double min_twist, quad_list *list)
{
    list->count = 0;
    const qm_candidates *candidates =
        &work->candidates; /* a pack may have been added since they were filled */
    for (int k = 0; k < candidates->count; k++) {
        const qm_pack_lanes *lanes = &work->side->target->lanes[candidates->id[k]];
        double d2[QM_PACK_LANES];
        work->kernel->pack_distances(candidates->pack[k], p, d2);
        for (uint32_t lane = 1; lane < lanes->lane_count; lane++) {
            double twist = candidates->twist[k][lane];
            if (!qm_lane_is_second(lanes, lane) || twist < min_twist) continue;
            list->at[list->count++] = (struct listed_quad){sqrt(fmin(d2[lane - 1], d2[lane])), twist,
                                                           lanes->face[lane], candidates->id[k]};
        }
    }
}

/** Takes the quad of the nearest triangles out of the list. */
static struct listed_quad take_nearest(quad_list *list)
{
    QM_ASSERT(list->count > 0);
    int nearest = 0;
    for (int i = 1; i < list->count; i++)
        if (list->at[i].distance < list->at[nearest].distance) nearest = i;
    struct listed_quad quad = list->at[nearest];
    list->at[nearest] = list->at[--list->count];
    return quad;
}

void qm_candidates_find_foot(qm_near_quad *quad, qm_vec p)
{
    QM_ASSERT(quad);
    if (quad->has_foot) return;
    qm_bilinear_footpoint foot = qm_bilinear_minimise(&quad->patch, p, INFINITY);
    quad->has_foot = true;
    quad->uv[0] = foot.uv[0];
    quad->uv[1] = foot.uv[1];
}

/** Measures a listed quad and keeps it when it is among the nearest. */
static void visit_quad(const qm_piece_work *work, qm_vec p, struct listed_quad listed, double negligible,
                       qm_near_quads *near)
{
    qm_near_quad quad = {
        .face = listed.face, .pack = listed.pack, .distance = listed.distance, .twist = listed.twist};
    quad.patch = qm_bvh_load_patch(work->side->target, quad.face);
    if (quad.twist >= negligible) {
        qm_bilinear_footpoint foot = qm_bilinear_minimise(&quad.patch, p, near->farthest);
        quad.distance = foot.distance;
        quad.has_foot = true;
        quad.uv[0] = foot.uv[0];
        quad.uv[1] = foot.uv[1];
    } else {
        quad.distance += quad.twist;
    }
    if (!(quad.distance < near->farthest)) return;
    int index = near->count < near->wanted ? near->count++ : near->wanted - 1;
    for (; index > 0 && near->at[index - 1].distance > quad.distance; index--)
        near->at[index] = near->at[index - 1];
    near->at[index] = quad;
    if (near->count == near->wanted) near->farthest = near->at[near->wanted - 1].distance;
}

qm_near_quads qm_candidates_near_quads(const qm_piece_work *work, qm_vec p, qm_quads_query query)
{
    QM_ASSERT(query.wanted > 0 && query.wanted <= QM_NEAR_QUADS);
    double negligible = negligible_twist(work);
    quad_list list;
    list_quads(work, p, query.twisted_only ? negligible : 0.0, &list);
    qm_near_quads near = {.wanted = query.wanted, .farthest = query.within};
    bool is_enough = false;
    for (int tries = 0; list.count > 0 && tries < QM_NEAR_QUADS && !is_enough; tries++) {
        struct listed_quad quad = take_nearest(&list);
        if (quad.distance - quad.twist < near.farthest) visit_quad(work, p, quad, negligible, &near);
        is_enough = near.count == query.wanted && near.at[0].distance <= query.enough;
    }
    /* Patches that leave their triangles may still be nearer; that matters only where none of these is near
     * enough, and to pieces that no cheaper test has covered. */
    is_enough = work->depth < CERTAIN_DEPTH && near.count > 0 && near.at[0].distance <= query.enough;
    for (int i = 0; !is_enough && i < list.count; i++)
        if (list.at[i].distance - list.at[i].twist < near.farthest)
            visit_quad(work, p, list.at[i], negligible, &near);
    return near;
}

bool qm_candidates_quad_within(const qm_piece_work *work, qm_vec p, double distance)
{
    quad_list list;
    list_quads(work, p, 0.0, &list);
    for (int tries = 0; tries < QUAD_TRIES && list.count > 0; tries++) {
        struct listed_quad quad = take_nearest(&list);
        if (quad.distance + quad.twist <= distance) return true;
        if (quad.distance - quad.twist > distance) return false;
        qm_bilinear patch = qm_bvh_load_patch(work->side->target, quad.face);
        if (qm_bilinear_minimise(&patch, p, distance).distance <= distance) return true;
    }
    return false;
}

bool qm_candidates_quad_covers(const qm_piece_work *work, uint32_t face, const qm_polygon *polygon)
{
    qm_vec corner[4];
    if (polygon->count != 3 || qm_bvh_load_face(work->side->target, face, corner) != 4) return false;
    qm_bilinear patch = qm_bilinear_make(corner);
    double uv[3][2], cutoff = qm_candidates_cutoff(work) - work->slack;
    for (int i = 0; i < 3; i++) {
        qm_bilinear_footpoint foot = qm_bilinear_minimise(&patch, polygon->corner[i], cutoff);
        if (foot.distance > cutoff) return false;
        uv[i][0] = foot.uv[0];
        uv[i][1] = foot.uv[1];
    }
    return qm_bilinear_triangle_upper(&patch, polygon->corner, uv) <= cutoff;
}

typedef struct foot_range {
    double low[2], high[2];
} foot_range;

/** The parameters under the corners of a piece, on the sheet of the quad's footpoint, with a margin. */
static foot_range range_of_corners(const qm_near_quad *quad, const qm_polygon *polygon)
{
    foot_range range = {{1.0, 1.0}, {0.0, 0.0}};
    for (int i = 0; i < polygon->count; i++) {
        qm_bilinear_footpoint foot = {.distance = INFINITY, .uv = {quad->uv[0], quad->uv[1]}};
        foot.distance =
            qm_vec_distance(polygon->corner[i], qm_bilinear_at(&quad->patch, foot.uv[0], foot.uv[1]));
        qm_bilinear_polish(&quad->patch, polygon->corner[i], QM_ROUGH_GAIN, &foot);
        for (int k = 0; k < 2; k++) {
            range.low[k] = fmin(range.low[k], foot.uv[k]);
            range.high[k] = fmax(range.high[k], foot.uv[k]);
        }
    }
    for (int k = 0; k < 2; k++) {
        double margin = (REFINED_MARGIN - 1.0) * (range.high[k] - range.low[k]);
        range.low[k] = fmax(0.0, range.low[k] - margin);
        range.high[k] = fmin(1.0, range.high[k] + margin);
    }
    return range;
}

/**
 * Cuts a rectangle down to one side of the fold of its patch, the side of the footpoint: that part of a flat
 * patch is convex, and its two triangles are exact. The cut is across the axis along which the area changes
 * most, where that leaves the footpoint inside.
 */
static void keep_one_sheet(const qm_near_quad *quad, foot_range *range)
{
    qm_bilinear_jacobian area = qm_bilinear_jacobian_make(&quad->patch);
    double here = qm_bilinear_jacobian_at(&area, quad->uv), sign = here < 0.0 ? -1.0 : 1.0, change[2];
    for (int k = 0; k < 2; k++) {
        area.rise[k] *= sign;
        change[k] = fabs(area.rise[k]) * (range->high[k] - range->low[k]);
    }
    int across = change[1] > change[0], along = 1 - across;
    bool falls = area.rise[across] < 0.0;
    double rise = area.rise[along];
    /* At the end of the other axis where it is smallest. */
    double smallest = sign * area.at + rise * (rise > 0.0 ? range->low[along] : range->high[along]);
    double cut = (FOLD_MARGIN * change[along] - smallest) / area.rise[across];
    if (!(change[across] > 0.0) || (falls ? cut < quad->uv[across] : cut > quad->uv[across])) return;
    if (falls)
        range->high[across] = fmin(range->high[across], cut);
    else
        range->low[across] = fmax(range->low[across], cut);
}

/** The parameters of a quad that a piece is over, with a margin: those round the footpoint of the centre that
 * the piece's radius takes in, or by its corners where the directions of the parameters
 * nearly coincide or change much within the piece. */
static foot_range find_range(const qm_near_quad *quad, const qm_polygon *polygon, double radius)
{
    const qm_bilinear *patch = &quad->patch;
    qm_vec along_u = qm_vec_axpy(patch->e1, quad->uv[1], patch->w);
    qm_vec along_v = qm_vec_axpy(patch->e2, quad->uv[0], patch->w);
    const double speed[2] = {qm_vec_norm(along_u), qm_vec_norm(along_v)};
    double area = qm_vec_norm(qm_vec_cross(along_u, along_v));
    double bend = radius * qm_vec_norm(patch->w) * speed[0] * speed[1] / (area * area);
    bool by_ball = area > MIN_SINE * speed[0] * speed[1] && bend < MAX_BEND;
    if (!by_ball) return range_of_corners(quad, polygon);
    foot_range range;
    for (int k = 0; k < 2; k++) {
        double reach = REFINED_MARGIN * radius * speed[1 - k] / area;
        range.low[k] = fmax(0.0, quad->uv[k] - reach);
        range.high[k] = fmin(1.0, quad->uv[k] + reach);
    }
    return range;
}

/** Corners of eight triangles in the layout of the kernels: corner, axis, lane. */
typedef struct lane_corners {
    _Alignas(64) double at[3][3][QM_PACK_LANES];
} lane_corners;

static void set_lane_corner(lane_corners *corners, int i, int lane, qm_vec p)
{
    corners->at[i][0][lane] = p.x;
    corners->at[i][1][lane] = p.y;
    corners->at[i][2][lane] = p.z;
}

bool qm_candidates_refine(const qm_piece_work *work, const qm_polygon *polygon, qm_vec centre,
                          const qm_near_quads *near, qm_refined *refined)
{
    QM_ASSERT(near->count <= QM_NEAR_QUADS);
    double radius = qm_vec_radius(polygon->corner, polygon->count, centre);
    double cutoff = qm_candidates_cutoff(work) - work->slack;
    double negligible = negligible_twist(work);
    qm_candidates *labels = &refined->labels;
    lane_corners corners;
    int lane = 0;
    for (int i = 0; i < near->count; i++) {
        const qm_near_quad *quad = &near->at[i];
        if (quad->twist < negligible) continue;
        foot_range range = find_range(quad, polygon, radius);
        keep_one_sheet(quad, &range);
        qm_vec from = qm_vec_sub(centre, qm_bilinear_at(&quad->patch, quad->uv[0], quad->uv[1]));
        double length = qm_vec_norm(from); /* may be rounding alone, not the same as in the distance */
        qm_vec direction = qm_vec_scale(length > 0.0 ? 1.0 / length : 0.0, from);
        /* Two triangles stand for this part of the patch, which leaves them by a slack of its own. */
        const qm_vec c[4] = {qm_bilinear_at(&quad->patch, range.low[0], range.low[1]),
                             qm_bilinear_at(&quad->patch, range.high[0], range.low[1]),
                             qm_bilinear_at(&quad->patch, range.high[0], range.high[1]),
                             qm_bilinear_at(&quad->patch, range.low[0], range.high[1])};
        qm_bilinear_halves halves = qm_bilinear_halve(c, direction);
        for (int half = 0; half < 2; half++, lane++) {
            set_lane_corner(&corners, 0, lane, halves.corner[0]);
            set_lane_corner(&corners, 1, lane, halves.corner[1 + half]);
            set_lane_corner(&corners, 2, lane, halves.corner[2 + half]);
            qm_candidates_set_cutoff(labels, 0, (uint32_t)lane, halves.slack, cutoff);
        }
    }
    if (lane == 0) return false;
    for (; lane < QM_PACK_LANES; lane++) { /* unused lanes are copies of the first two */
        for (int i = 0; i < 3; i++)
            for (int axis = 0; axis < 3; axis++)
                corners.at[i][axis][lane] = corners.at[i][axis][lane % 2];
        labels->twist[0][lane] = labels->twist[0][lane % 2];
        labels->cutoff2[0][lane] = labels->cutoff2[0][lane % 2];
    }
    labels->count = 1;
    labels->pack[0] = &refined->pack;
    work->kernel->fill_pack(&refined->pack, corners.at);
    return true;
}

bool qm_candidates_cover_refined(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon,
                                 bool *moved)
{
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] = work->kernel->in_reach(&refined->labels, polygon->corner[i]);
    return work->kernel->cover(&refined->labels, polygon, moved);
}
