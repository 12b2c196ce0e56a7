/**
 * deviation_facets.c: fills the list: packs from the tree, patches cut into rectangles, rectangles as two
 * triangles each; and measures a facet: distances to its edges and their ends, its angles.
 */
#include "deviation_facets.h"

#include <string.h>

#include "bvh/bvh_demand.h"
#include "prim/bilinear.h"

#define MILD_TURN 0.4  /* r of a rectangle that may stay whole, */
#define MILD_BEND 0.25 /* and g k */

/** A part of a patch with its corners, and its two triangles. */
typedef struct rectangle {
    qm_vec corner[4];
    qm_bilinear_halves halves;
    double excess; /* above the permitted error: the slack of the halves, 0 if they are not needed */
} rectangle;

/** The state of a list while it is filled. */
typedef struct near_work {
    const qm_bvh *target;
    qm_deviation_facets *near;
    qm_vec centre;
    double distance, reach, error, whole;
    bool cuts_all;
    rectangle rectangle[QM_MAX_RECTANGLES]; /* near->rectangle_count of them */
} near_work;

static void copy_lane(qm_pack *to, int to_lane, const qm_pack *from, int from_lane)
{
    for (int row = 0; row < QM_PACK_COMPONENTS; row++)
        to->row[row][to_lane] = from->row[row][from_lane];
}

/** The next free slot; NULL when there is none, which leaves the list incomplete. */
static qm_pack *take_slot(qm_deviation_facets *near, int *lane, double slack, int part_of)
{
    if (near->count == QM_FACET_PACKS * QM_PACK_LANES) {
        near->is_complete = false;
        return NULL;
    }
    QM_ASSERT(part_of == QM_NO_RECTANGLE || (part_of >= 0 && part_of < near->rectangle_count));
    int pack = near->count / QM_PACK_LANES;
    *lane = near->count++ % QM_PACK_LANES;
    near->slack[pack][*lane] = slack;
    near->rectangle_of[pack][*lane] = (int8_t)part_of;
    return &near->pack[pack];
}

static void add_lane(near_work *work, const qm_pack *from, int from_lane, double slack)
{
    int lane;
    qm_pack *to = take_slot(work->near, &lane, slack, QM_NO_RECTANGLE);
    if (to) copy_lane(to, lane, from, from_lane);
}

qm_triangle qm_deviation_facet_at(const qm_pack *pack, int lane)
{
#define ROW(name) pack->row[QM_PACK_##name][lane]
    return (qm_triangle){.origin = {ROW(OX), ROW(OY), ROW(OZ)},
                         .x = {ROW(XX), ROW(XY), ROW(XZ)},
                         .y = {ROW(YX), ROW(YY), ROW(YZ)},
                         .z = {ROW(ZX), ROW(ZY), ROW(ZZ)},
                         .length = ROW(L),
                         .cx = ROW(CX),
                         .cy = ROW(CY),
                         .inverse_c2 = ROW(INVERSE_C2),
                         .inverse_d2 = ROW(INVERSE_D2)};
#undef ROW
}

void qm_deviation_facet_edges(const qm_triangle *t, qm_vec p, double inside[3])
{
    qm_vec d = qm_vec_sub(p, t->origin);
    double x = qm_vec_dot(d, t->x), y = qm_vec_dot(d, t->y), ex = t->cx - t->length;
    inside[0] = y;
    inside[1] = (t->cy * x - t->cx * y) * sqrt(t->inverse_c2);
    inside[2] = (ex * y - t->cy * (x - t->length)) * sqrt(t->inverse_d2);
}

void qm_deviation_facet_ends(const qm_triangle *t, qm_vec p, double within[3][2])
{
    qm_vec d = qm_vec_sub(p, t->origin);
    double x = qm_vec_dot(d, t->x), y = qm_vec_dot(d, t->y), ex = t->cx - t->length;
    double c = sqrt(t->cx * t->cx + t->cy * t->cy), e = sqrt(ex * ex + t->cy * t->cy);
    double length[3] = {t->length, c, e};
    within[0][0] = x;
    within[1][0] = c > 0.0 ? (t->cx * x + t->cy * y) / c : -INFINITY;
    within[2][0] = e > 0.0 ? (ex * (x - t->length) + t->cy * y) / e : -INFINITY;
    for (int k = 0; k < 3; k++)
        within[k][1] = length[k] - within[k][0];
}

double qm_deviation_facet_min_sine(const qm_triangle *t)
{
    double c = sqrt(t->inverse_c2), d = sqrt(t->inverse_d2), min = t->cy * qm_min(c, d);
    bool is_obtuse = t->cx * (t->cx - t->length) + t->cy * t->cy < 0.0;
    return is_obtuse ? min : qm_min(min, t->length * t->cy * c * d);
}

static void add_triangle(near_work *work, const qm_triangle *t, double slack, int part_of)
{
    int lane;
    qm_pack *to = take_slot(work->near, &lane, slack, part_of);
    if (!to) return;
    const double values[QM_PACK_COMPONENTS] = {
        [QM_PACK_OX] = t->origin.x,
        [QM_PACK_OY] = t->origin.y,
        [QM_PACK_OZ] = t->origin.z,
        [QM_PACK_XX] = t->x.x,
        [QM_PACK_XY] = t->x.y,
        [QM_PACK_XZ] = t->x.z,
        [QM_PACK_YX] = t->y.x,
        [QM_PACK_YY] = t->y.y,
        [QM_PACK_YZ] = t->y.z,
        [QM_PACK_ZX] = t->z.x,
        [QM_PACK_ZY] = t->z.y,
        [QM_PACK_ZZ] = t->z.z,
        [QM_PACK_L] = t->length,
        [QM_PACK_CX] = t->cx,
        [QM_PACK_CY] = t->cy,
        [QM_PACK_INVERSE_C2] = t->inverse_c2,
        [QM_PACK_INVERSE_D2] = t->inverse_d2,
    };
    for (int row = 0; row < QM_PACK_COMPONENTS; row++)
        to->row[row][lane] = values[row];
}

/* ---- patches ---- */

/** True when a rectangle, which lies behind the plane across the line to its centroid through the corner that
 * is nearest along it, may come within reach. Roundings of 12 u S are covered by the eta to spare in reach. */
static bool is_near(const near_work *work, const qm_vec corner[4])
{
    qm_vec ends = qm_vec_add(corner[0], corner[2]), others = qm_vec_add(corner[1], corner[3]);
    qm_vec way = qm_vec_sub(qm_vec_scale(0.25, qm_vec_add(ends, others)), work->centre);
    double length = qm_vec_norm(way), nearest = INFINITY;
    for (int i = 0; i < 4; i++)
        nearest = qm_min(nearest, qm_vec_dot(way, qm_vec_sub(corner[i], work->centre)));
    return nearest <= work->reach * length;
}

/** True when a match with the rectangle holds, but for what the piece adds to it: r and g k of
 * deviation_match.h for the rectangle alone, in parameters of its own. */
static bool is_mild(const near_work *work, const qm_vec c[4])
{
    qm_vec along_s = qm_vec_scale(0.5, qm_vec_add(qm_vec_sub(c[1], c[0]), qm_vec_sub(c[2], c[3])));
    qm_vec along_t = qm_vec_scale(0.5, qm_vec_add(qm_vec_sub(c[3], c[0]), qm_vec_sub(c[2], c[1])));
    double w = qm_vec_norm(qm_vec_add(qm_vec_sub(c[0], c[1]), qm_vec_sub(c[2], c[3])));
    double s = qm_vec_norm(along_s), t = qm_vec_norm(along_t);
    double determinant = qm_vec_norm(qm_vec_cross(along_s, along_t));
    double product = s * t + fabs(qm_vec_dot(along_s, along_t));
    return 0.5 * w * (s + t) < MILD_TURN * determinant &&
           work->distance * w * product < MILD_BEND * determinant * determinant;
}

/** A part of a patch: with its triangles, and by how much it should be cut. */
static rectangle make_rectangle(const near_work *work, const qm_vec corner[4], qm_deviation_rectangle *of)
{
    rectangle made;
    for (int i = 0; i < 4; i++)
        made.corner[i] = corner[i];
    made.halves = qm_bilinear_halve(corner, (qm_vec){0, 0, 0});
    of->is_mild = !work->cuts_all && (of->is_plane || is_mild(work, corner));
    made.excess = of->is_mild ? 0.0 : made.halves.slack;
    return made;
}

/** Adds a rectangle that may come within reach. */
static void add_rectangle(near_work *work, const qm_vec corner[4], qm_deviation_rectangle of)
{
    if (!is_near(work, corner)) return;
    rectangle part = make_rectangle(work, corner, &of);
    int slot = work->near->rectangle_count;
    work->near->is_complete &= slot < QM_MAX_RECTANGLES;
    if (slot == QM_MAX_RECTANGLES) return;
    work->rectangle[slot] = part;
    work->near->rectangle[slot] = of;
    work->near->rectangle_count++;
}

/** Replaces a rectangle by those of its halves, across its longer sides, that may come within reach. They are
 * bilinear patches as well. The last rectangle takes its slot. */
static void halve(near_work *work, int slot)
{
    QM_ASSERT(slot >= 0 && slot < work->near->rectangle_count);
    const rectangle whole = work->rectangle[slot];
    const qm_vec *c = whole.corner;
    double along_s = qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]);
    double along_t = qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2]);
    int axis = along_s >= along_t ? 0 : 1;
    qm_vec half[2][4];
    if (axis == 0) {
        qm_vec low = qm_vec_mix(c[0], c[1], 0.5), high = qm_vec_mix(c[3], c[2], 0.5);
        memcpy(half, (const qm_vec[2][4]){{c[0], low, high, c[3]}, {low, c[1], c[2], high}}, sizeof half);
    } else {
        qm_vec left = qm_vec_mix(c[0], c[3], 0.5), right = qm_vec_mix(c[1], c[2], 0.5);
        memcpy(half, (const qm_vec[2][4]){{c[0], c[1], right, left}, {left, right, c[2], c[3]}}, sizeof half);
    }
    qm_deviation_rectangle one = work->near->rectangle[slot], two = one;
    one.box.high[axis] = two.box.low[axis] = 0.5 * (one.box.low[axis] + one.box.high[axis]);
    int last = --work->near->rectangle_count;
    work->rectangle[slot] = work->rectangle[last];
    work->near->rectangle[slot] = work->near->rectangle[last];
    add_rectangle(work, half[0], one);
    add_rectangle(work, half[1], two);
}

/** Cuts the rectangles, the ones farthest from their triangles first, while there is room. */
static void cut_rectangles(near_work *work)
{
    const int *count = &work->near->rectangle_count;
    double limit = 0.0;
    for (int i = 0; i < *count; i++)
        limit = fmax(limit, work->rectangle[i].excess);
    while (limit > work->error && *count < QM_MAX_CUT_RECTANGLES) {
        limit = fmax(0.5 * limit, work->error);
        for (int i = 0; i < *count && *count < QM_MAX_CUT_RECTANGLES;)
            if (work->rectangle[i].excess > limit)
                halve(work, i);
            else
                i++;
    }
}

/** Lists the triangles of the rectangles that may come within reach. */
static void add_rectangles(near_work *work)
{
    for (int i = 0; i < work->near->rectangle_count; i++) {
        const qm_bilinear_halves *halves = &work->rectangle[i].halves;
        const qm_vec *c = halves->corner;
        for (int k = 0; k < 2; k++) {
            qm_triangle half = qm_triangle_make(c[0], c[1 + k], c[2 + k]);
            if (sqrt(qm_triangle_distance2(&half, work->centre)) - halves->slack <= work->reach)
                add_triangle(work, &half, halves->slack, i);
        }
    }
}

/* ---- packs ---- */

/** Adds a patch as a rectangle. */
static void add_patch(near_work *work, uint32_t face, double twist)
{
    qm_vec corner[4];
    qm_bvh_load_face(work->target, face, corner);
    const qm_deviation_rectangle whole = {.face = face,
                                          .is_plane = !(twist > work->error),
                                          .patch = qm_bilinear_make(corner),
                                          .box = {{0.0, 0.0}, {1.0, 1.0}}};
    add_rectangle(work, corner, whole);
}

static void add_pack(near_work *work, const qm_kernel *kernel, uint32_t pack, bool patches)
{
    const qm_bvh *target = work->target;
    const qm_pack_lanes *lanes = &target->lanes[pack];
    _Alignas(64) double d2[QM_PACK_LANES];
    qm_pack spare;
    const qm_pack *rows = qm_bvh_pack(target, pack, &spare);
    kernel->pack_distances(rows, work->centre, d2);
    for (int lane = 0; lane < lanes->lane_count; lane++) {
        double twist = patches ? (double)qm_bvh_twists(target, pack)[lane] : 0.0;
        bool has_second = qm_lane_has_second(lanes, (uint32_t)lane);
        bool stays_whole = patches && has_second && work->distance < work->whole;
        if (twist > work->error || stays_whole) {
            add_patch(work, lanes->face[lane], twist);
            lane += has_second;
        } else if (sqrt(d2[lane]) - twist <= work->reach) {
            add_lane(work, rows, lane, twist);
        }
    }
}

/** Fills the last pack up. */
static void pad(qm_deviation_facets *near)
{
    near->pack_count = (near->count + QM_PACK_LANES - 1) / QM_PACK_LANES;
    QM_ASSERT(near->pack_count <= QM_FACET_PACKS);
    if (near->count == 0) return;
    qm_pack *last = &near->pack[near->pack_count - 1];
    int from = (near->count - 1) % QM_PACK_LANES;
    for (int lane = from + 1; lane < QM_PACK_LANES; lane++) {
        copy_lane(last, lane, last, from);
        near->slack[near->pack_count - 1][lane] = near->slack[near->pack_count - 1][from];
        near->rectangle_of[near->pack_count - 1][lane] = near->rectangle_of[near->pack_count - 1][from];
    }
}

void qm_deviation_facets_find(const qm_kernel *kernel, const qm_bvh *target, bool patches, bool cuts_all,
                              double whole, double error, qm_vec centre, double distance, double reach,
                              qm_deviation_facets *near)
{
    const qm_box point = {{centre.x, centre.y, centre.z}, {centre.x, centre.y, centre.z}};
    near_work work; /* large, and filled as it is used */
    work.target = target;
    work.near = near;
    work.centre = centre;
    work.distance = distance;
    work.reach = reach;
    work.error = error;
    work.whole = whole;
    work.cuts_all = cuts_all;
    qm_near_packs packs;
    kernel->gather(target, &point, reach, &packs);
    near->count = near->rectangle_count = 0;
    near->is_complete = packs.count < QM_NEAR_PACKS;
    for (int i = 0; i < packs.count; i++)
        add_pack(&work, kernel, packs.pack[i], patches);
    cut_rectangles(&work);
    add_rectangles(&work);
    near->is_complete &= near->count > 0;
    pad(near);
}

qm_deviation_facet qm_deviation_facets_nearest(const qm_kernel *kernel, const qm_deviation_facets *near,
                                               qm_vec p)
{
    QM_ASSERT(near->count > 0);
    qm_deviation_facet found = {.distance = INFINITY};
    for (int pack = 0; pack < near->pack_count; pack++) {
        _Alignas(64) double d2[QM_PACK_LANES];
        kernel->pack_distances(&near->pack[pack], p, d2);
        for (int lane = 0; lane < QM_PACK_LANES; lane++) {
            if (!(d2[lane] < found.distance)) continue;
            found.distance = d2[lane];
            found.index = pack * QM_PACK_LANES + lane;
        }
    }
    found.distance = sqrt(found.distance);
    found.triangle =
        qm_deviation_facet_at(&near->pack[found.index / QM_PACK_LANES], found.index % QM_PACK_LANES);
    return found;
}
