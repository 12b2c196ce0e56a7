/**
 * hausdorff_candidates.c: the facets of the target that a piece may be covered with.
 */
#include "hausdorff_piece.h"
#include "prim/bilinear_fold.h"
#include "prim/bilinear_over.h"

#define NEGLIGIBLE_TWIST 0.1 /* of the tolerance: labels with less are not refined */
#define CERTAIN_DEPTH 16     /* from here on every quad that may be nearer is measured */
#define MIN_SINE 0.01        /* between the directions of a patch, for a ball to tell where feet lie, */
#define MAX_BEND 0.1         /* and how much of their area they may lose or gain within the ball */
#define QUAD_TRIES 2         /* of the nearest quads, to show that a point is near enough */
#define FOLD_MARGIN 1e-3     /* of the change of the area: how far from the fold a part of a patch ends */
#define REFINED_MARGIN 1.1   /* by which refined labels reach beyond the piece, as seen from its middle */

/** The greatest twist of a patch that is not refined, local. */
static double negligible_twist(const qm_piece_work *work)
{
    return NEGLIGIBLE_TWIST * work->search->tolerance * work->side->scale;
}

void qm_piece_fill_candidates(qm_piece_work *work)
{
    work->filled_for = qm_piece_cutoff(work);
    qm_candidates_fill(&work->candidates, work->side, work->packs, work->pack_count,
                       work->filled_for - work->slack);
    work->generation++;
}

bool qm_piece_add_candidate(qm_piece_work *work, uint32_t pack)
{
    for (int k = 0; k < work->pack_count; k++)
        if (work->packs[k] == pack) return false;
    if (work->pack_count < QM_COVER_PACKS) work->pack_count++;
    for (int k = work->pack_count - 1; k > 0; k--)
        work->packs[k] = work->packs[k - 1];
    work->packs[0] = pack;
    return true;
}

void qm_piece_gather(qm_piece_work *work, qm_near_packs *near)
{
    qm_box box = qm_vec_box(work->piece.corner, work->piece.corner_count);
    work->kernel->gather(work->side->target, &box, qm_piece_cutoff(work), near);
    work->near = near;
    work->pack_count =
        work->kernel->narrow(work->near, &box, qm_piece_cutoff(work), QM_COVER_PACKS, work->packs);
    if (work->pack_count == 0 || work->side->target_patches) qm_piece_add_candidate(work, work->entry.hint);
    qm_piece_fill_candidates(work);
}

enum { MAX_QUADS = QM_COVER_PACKS * QM_PACK_LANES / 2 };

/** Quads of the candidates with the distance of their triangles. */
typedef struct quad_list {
    int count;
    struct listed_quad {
        double distance, twist;
        uint32_t face, pack;
    } at[MAX_QUADS];
} quad_list;

static void list_quads(const qm_piece_work *work, qm_vec p, double least_twist, quad_list *list)
{
    list->count = 0;
    for (int k = 0; k < work->pack_count; k++) {
        const qm_pack_lanes *lanes = &work->side->target->lanes[work->packs[k]];
        double d2[QM_PACK_LANES];
        work->kernel->pack_distances(work->candidates.pack[k], p, d2);
        for (uint32_t lane = 1; lane < lanes->lane_count; lane++) {
            double twist = work->candidates.twist[k][lane];
            if (!qm_lane_is_second(lanes, lane) || twist < least_twist) continue;
            list->at[list->count++] = (struct listed_quad){sqrt(fmin(d2[lane - 1], d2[lane])), twist,
                                                           lanes->face[lane], work->packs[k]};
        }
    }
}

/** Takes the quad of the nearest triangles out of the list. */
static struct listed_quad take_nearest(quad_list *list)
{
    int nearest = 0;
    for (int i = 1; i < list->count; i++)
        if (list->at[i].distance < list->at[nearest].distance) nearest = i;
    struct listed_quad quad = list->at[nearest];
    list->at[nearest] = list->at[--list->count];
    return quad;
}

void qm_piece_find_foot(qm_near_quad *quad, qm_vec p)
{
    if (quad->has_foot) return;
    qm_bilinear_foot foot = qm_bilinear_descend(&quad->patch, p, INFINITY);
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
        qm_bilinear_foot foot = qm_bilinear_descend(&quad.patch, p, near->farthest);
        quad.distance = foot.distance;
        quad.has_foot = true;
        quad.uv[0] = foot.uv[0];
        quad.uv[1] = foot.uv[1];
    } else {
        quad.distance += quad.twist;
    }
    if (!(quad.distance < near->farthest)) return;
    int place = near->count < near->wanted ? near->count++ : near->wanted - 1;
    for (; place > 0 && near->at[place - 1].distance > quad.distance; place--)
        near->at[place] = near->at[place - 1];
    near->at[place] = quad;
    if (near->count == near->wanted) near->farthest = near->at[near->wanted - 1].distance;
}

qm_near_quads qm_piece_near_quads(const qm_piece_work *work, qm_vec p, qm_quads_asked asked)
{
    double negligible = negligible_twist(work);
    quad_list list;
    list_quads(work, p, asked.twisted_only ? negligible : 0.0, &list);
    qm_near_quads near = {.wanted = asked.wanted, .farthest = asked.within};
    bool is_enough = false;
    for (int tries = 0; list.count > 0 && tries < QM_NEAR_QUADS && !is_enough; tries++) {
        struct listed_quad quad = take_nearest(&list);
        if (quad.distance - quad.twist < near.farthest) visit_quad(work, p, quad, negligible, &near);
        is_enough = near.count == asked.wanted && near.at[0].distance <= asked.enough;
    }
    /* Patches that leave their triangles may still be nearer; that matters only where none of these is near
     * enough, and to pieces which nothing else has settled. */
    is_enough = work->depth < CERTAIN_DEPTH && near.count > 0 && near.at[0].distance <= asked.enough;
    for (int i = 0; !is_enough && i < list.count; i++)
        if (list.at[i].distance - list.at[i].twist < near.farthest)
            visit_quad(work, p, list.at[i], negligible, &near);
    return near;
}

bool qm_piece_quad_within(const qm_piece_work *work, qm_vec p, double distance)
{
    quad_list list;
    list_quads(work, p, 0.0, &list);
    for (int tries = 0; tries < QUAD_TRIES && list.count > 0; tries++) {
        struct listed_quad quad = take_nearest(&list);
        if (quad.distance + quad.twist <= distance) return true;
        if (quad.distance - quad.twist > distance) return false;
        qm_bilinear patch = qm_bvh_load_patch(work->side->target, quad.face);
        if (qm_bilinear_descend(&patch, p, distance).distance <= distance) return true;
    }
    return false;
}

bool qm_piece_over_face(const qm_piece_work *work, uint32_t face, const qm_polygon *polygon)
{
    qm_vec corner[4];
    if (polygon->count != 3 || qm_bvh_load_face(work->side->target, face, corner) != 4) return false;
    qm_bilinear patch = qm_bilinear_make(corner);
    double uv[3][2], cutoff = qm_piece_cutoff(work) - work->slack;
    for (int i = 0; i < 3; i++) {
        qm_bilinear_foot foot = qm_bilinear_descend(&patch, polygon->corner[i], cutoff);
        if (foot.distance > cutoff) return false;
        uv[i][0] = foot.uv[0];
        uv[i][1] = foot.uv[1];
    }
    return qm_bilinear_under(&patch, polygon->corner, uv) <= cutoff;
}

bool qm_piece_over_patch(const qm_piece_work *work, const qm_polygon *polygon)
{
    if (polygon->count != 3) return false;
    quad_list list;
    list_quads(work, qm_polygon_centroid(polygon), 0.0, &list);
    return list.count > 0 && qm_piece_over_face(work, take_nearest(&list).face, polygon);
}

typedef struct feet_rectangle {
    double low[2], high[2];
} feet_rectangle;

/** The parameters round the foot of a piece's middle that a piece of this radius lies over, with a margin. */
static feet_rectangle feet_of_ball(const qm_near_quad *quad, double radius, const double speed[2],
                                   double area)
{
    feet_rectangle feet;
    for (int k = 0; k < 2; k++) {
        double reach = REFINED_MARGIN * radius * speed[1 - k] / area;
        feet.low[k] = fmax(0.0, quad->uv[k] - reach);
        feet.high[k] = fmin(1.0, quad->uv[k] + reach);
    }
    return feet;
}

/** The parameters that lie under the corners of a piece, on the sheet of the quad's foot, with a margin. */
static feet_rectangle feet_of_corners(const qm_near_quad *quad, const qm_polygon *polygon)
{
    feet_rectangle feet = {{1.0, 1.0}, {0.0, 0.0}};
    for (int i = 0; i < polygon->count; i++) {
        qm_bilinear_foot foot = {.distance = INFINITY, .uv = {quad->uv[0], quad->uv[1]}};
        foot.distance =
            qm_vec_distance(polygon->corner[i], qm_bilinear_at(&quad->patch, foot.uv[0], foot.uv[1]));
        qm_bilinear_polish(&quad->patch, polygon->corner[i], &foot);
        for (int k = 0; k < 2; k++) {
            feet.low[k] = fmin(feet.low[k], foot.uv[k]);
            feet.high[k] = fmax(feet.high[k], foot.uv[k]);
        }
    }
    for (int k = 0; k < 2; k++) {
        double margin = (REFINED_MARGIN - 1.0) * (feet.high[k] - feet.low[k]);
        feet.low[k] = fmax(0.0, feet.low[k] - margin);
        feet.high[k] = fmin(1.0, feet.high[k] + margin);
    }
    return feet;
}

/**
 * Cuts a rectangle down to one side of the fold of its patch, the side of the foot: what is left of a flat
 * patch is convex, and its two triangles are exact. It is cut across the axis along which the area changes
 * most, where that leaves the foot inside.
 */
static void keep_one_sheet(const qm_near_quad *quad, feet_rectangle *feet)
{
    qm_fold_area area = qm_fold_area_make(&quad->patch);
    double here = qm_fold_area_at(&area, quad->uv), sign = here < 0.0 ? -1.0 : 1.0, change[2];
    for (int k = 0; k < 2; k++) {
        area.rise[k] *= sign;
        change[k] = fabs(area.rise[k]) * (feet->high[k] - feet->low[k]);
    }
    int across = change[1] > change[0], along = 1 - across;
    bool falls = area.rise[across] < 0.0;
    double rise = area.rise[along];
    /* At the end of the other axis where it is least. */
    double least = sign * area.at + rise * (rise > 0.0 ? feet->low[along] : feet->high[along]);
    double place = (FOLD_MARGIN * change[along] - least) / area.rise[across];
    if (!(change[across] > 0.0) || (falls ? place < quad->uv[across] : place > quad->uv[across])) return;
    if (falls)
        feet->high[across] = fmin(feet->high[across], place);
    else
        feet->low[across] = fmax(feet->low[across], place);
}

/** Which parameters of a quad a piece lies over; where the parameters' directions fall together or change
 * much within the piece, by its corners. */
static feet_rectangle find_feet(const qm_near_quad *quad, const qm_polygon *polygon, double radius)
{
    const qm_bilinear *patch = &quad->patch;
    qm_vec along_u = qm_vec_axpy(patch->e1, quad->uv[1], patch->w);
    qm_vec along_v = qm_vec_axpy(patch->e2, quad->uv[0], patch->w);
    const double speed[2] = {qm_vec_norm(along_u), qm_vec_norm(along_v)};
    double area = qm_vec_norm(qm_vec_cross(along_u, along_v));
    double bend = radius * qm_vec_norm(patch->w) * speed[0] * speed[1] / (area * area);
    if (area > MIN_SINE * speed[0] * speed[1] && bend < MAX_BEND)
        return feet_of_ball(quad, radius, speed, area);
    return feet_of_corners(quad, polygon);
}

/** Corners of eight triangles, as kernels take them. */
typedef struct lane_corners {
    _Alignas(64) double at[3][3][QM_PACK_LANES];
} lane_corners;

static void set_lane_corner(lane_corners *corners, int i, int lane, qm_vec p)
{
    corners->at[i][0][lane] = p.x;
    corners->at[i][1][lane] = p.y;
    corners->at[i][2][lane] = p.z;
}

/** The two triangles of a part of a patch as labels; that part leaves them by a slack of its own. */
static void set_refined_lanes(qm_candidates *labels, lane_corners *corners, int lane,
                              const qm_bilinear *patch, const feet_rectangle *feet, qm_vec direction,
                              double cutoff)
{
    const qm_vec c[4] = {qm_bilinear_at(patch, feet->low[0], feet->low[1]),
                         qm_bilinear_at(patch, feet->high[0], feet->low[1]),
                         qm_bilinear_at(patch, feet->high[0], feet->high[1]),
                         qm_bilinear_at(patch, feet->low[0], feet->high[1])};
    qm_bilinear_halves halves = qm_bilinear_halve(c, direction);
    for (int half = 0; half < 2; half++) {
        set_lane_corner(corners, 0, lane + half, halves.corner[0]);
        set_lane_corner(corners, 1, lane + half, halves.corner[1 + half]);
        set_lane_corner(corners, 2, lane + half, halves.corner[2 + half]);
        qm_candidates_set_cutoff(labels, 0, (uint32_t)(lane + half), halves.slack, cutoff);
    }
}

/** Fills an unused lane with a copy of another. */
static void repeat_lane(qm_candidates *labels, lane_corners *corners, int from, int to)
{
    for (int i = 0; i < 3; i++)
        for (int axis = 0; axis < 3; axis++)
            corners->at[i][axis][to] = corners->at[i][axis][from];
    labels->twist[0][to] = labels->twist[0][from];
    labels->cutoff2[0][to] = labels->cutoff2[0][from];
}

bool qm_piece_refine(const qm_piece_work *work, const qm_polygon *polygon, qm_vec middle,
                     const qm_near_quads *near, qm_refined *refined)
{
    double radius = qm_vec_radius(polygon->corner, polygon->count, middle);
    double cutoff = qm_piece_cutoff(work) - work->slack;
    double negligible = negligible_twist(work);
    lane_corners corners;
    int lane = 0;
    for (int i = 0; i < near->count; i++) {
        const qm_near_quad *quad = &near->at[i];
        if (quad->twist < negligible) continue;
        feet_rectangle feet = find_feet(quad, polygon, radius);
        keep_one_sheet(quad, &feet);
        qm_vec from = qm_vec_sub(middle, qm_bilinear_at(&quad->patch, quad->uv[0], quad->uv[1]));
        double length = qm_vec_norm(from); /* which may be roundings only, other than those of the distance */
        qm_vec direction = qm_vec_scale(length > 0.0 ? 1.0 / length : 0.0, from);
        set_refined_lanes(&refined->labels, &corners, lane, &quad->patch, &feet, direction, cutoff);
        lane += 2;
    }
    if (lane == 0) return false;
    for (; lane < QM_PACK_LANES; lane++)
        repeat_lane(&refined->labels, &corners, lane % 2, lane);
    refined->labels.count = 1;
    refined->labels.pack[0] = &refined->pack;
    work->kernel->fill_pack(&refined->pack, corners.at);
    return true;
}

bool qm_piece_cover_refined(const qm_piece_work *work, const qm_refined *refined, qm_polygon *polygon,
                            bool *moved)
{
    for (int i = 0; i < polygon->count; i++)
        polygon->in_reach[i] = work->kernel->in_reach(&refined->labels, polygon->corner[i]);
    return work->kernel->cover(&refined->labels, polygon, moved);
}
