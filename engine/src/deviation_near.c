#include "deviation_near.h"

#include <string.h>

#include "bilinear_point.h"
#include "bvh_demand.h"

#define RECTANGLES 32 /* of all patches of a list; when there are so many they are cut no further */

/** A part of a patch, and its two triangles. */
typedef struct rectangle {
    qm_vec corner[4];
    qm_patch_halves halves;
} rectangle;

/** A list on its way. */
typedef struct near_work {
    const qm_bvh *target;
    qm_near_facets *near;
    qm_vec middle;
    double reach, error;
    int rectangle_count;
    rectangle rectangle[RECTANGLES];
} near_work;

static void copy_lane(qm_pack *to, int to_lane, const qm_pack *from, int from_lane)
{
    for (int row = 0; row < QM_ROW_COUNT; row++)
        to->row[row][to_lane] = from->row[row][from_lane];
}

/** The next free place; NULL when there is none, which leaves the list incomplete. */
static qm_pack *take_place(qm_near_facets *near, int *lane, double slack)
{
    if (near->count == QM_FACET_PACKS * QM_PACK_LANES) {
        near->is_complete = false;
        return NULL;
    }
    int pack = near->count / QM_PACK_LANES;
    *lane = near->count++ % QM_PACK_LANES;
    near->slack[pack][*lane] = slack;
    return &near->pack[pack];
}

static void add_lane(near_work *work, const qm_pack *from, int from_lane, double slack)
{
    int lane;
    qm_pack *to = take_place(work->near, &lane, slack);
    if (to) copy_lane(to, lane, from, from_lane);
}

qm_triangle qm_pack_triangle(const qm_pack *pack, int lane)
{
#define ROW(name) pack->row[QM_ROW_##name][lane]
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

void qm_triangle_walls(const qm_triangle *t, qm_vec p, double inside[3])
{
    qm_vec d = qm_vec_sub(p, t->origin);
    double x = qm_vec_dot(d, t->x), y = qm_vec_dot(d, t->y), ex = t->cx - t->length;
    inside[0] = y;
    inside[1] = (t->cy * x - t->cx * y) * sqrt(t->inverse_c2);
    inside[2] = (ex * y - t->cy * (x - t->length)) * sqrt(t->inverse_d2);
}

double qm_triangle_least_sine(const qm_triangle *t)
{
    double c = sqrt(t->inverse_c2), d = sqrt(t->inverse_d2), least = t->cy * qm_lesser(c, d);
    bool is_obtuse = t->cx * (t->cx - t->length) + t->cy * t->cy < 0.0;
    return is_obtuse ? least : qm_lesser(least, t->length * t->cy * c * d);
}

static void add_triangle(near_work *work, const qm_triangle *t, double slack)
{
    int lane;
    qm_pack *to = take_place(work->near, &lane, slack);
    if (!to) return;
    const double values[QM_ROW_COUNT] = {
        [QM_ROW_OX] = t->origin.x,
        [QM_ROW_OY] = t->origin.y,
        [QM_ROW_OZ] = t->origin.z,
        [QM_ROW_XX] = t->x.x,
        [QM_ROW_XY] = t->x.y,
        [QM_ROW_XZ] = t->x.z,
        [QM_ROW_YX] = t->y.x,
        [QM_ROW_YY] = t->y.y,
        [QM_ROW_YZ] = t->y.z,
        [QM_ROW_ZX] = t->z.x,
        [QM_ROW_ZY] = t->z.y,
        [QM_ROW_ZZ] = t->z.z,
        [QM_ROW_L] = t->length,
        [QM_ROW_CX] = t->cx,
        [QM_ROW_CY] = t->cy,
        [QM_ROW_INVERSE_C2] = t->inverse_c2,
        [QM_ROW_INVERSE_D2] = t->inverse_d2,
    };
    for (int row = 0; row < QM_ROW_COUNT; row++)
        to->row[row][lane] = values[row];
}

/* ---- patches ---- */

/** True when a rectangle, which lies within the ball round its middle through its farthest corner, may come
 * within reach. */
static bool is_near(const near_work *work, const qm_vec corner[4])
{
    qm_vec ends = qm_vec_add(corner[0], corner[2]), others = qm_vec_add(corner[1], corner[3]);
    qm_vec middle = qm_vec_scale(0.25, qm_vec_add(ends, others));
    double radius2 = 0.0;
    for (int i = 0; i < 4; i++)
        radius2 = fmax(radius2, qm_vec_norm2(qm_vec_sub(corner[i], middle)));
    return qm_vec_distance(work->middle, middle) - sqrt(radius2) <= work->reach;
}

static void set_rectangle(rectangle *to, const qm_vec corner[4])
{
    for (int i = 0; i < 4; i++)
        to->corner[i] = corner[i];
    to->halves = qm_patch_halve(corner, (qm_vec){0, 0, 0});
}

static void add_rectangle(near_work *work, const qm_vec corner[4])
{
    if (!is_near(work, corner)) return;
    if (work->rectangle_count < RECTANGLES)
        set_rectangle(&work->rectangle[work->rectangle_count++], corner);
    else
        work->near->is_complete = false;
}

/** Puts the halves of a rectangle, across its longer sides, in its place and at the end. A part of a bilinear
 * patch is one. */
static void halve(near_work *work, rectangle *at)
{
    const qm_vec *c = at->corner;
    double along_s = qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]);
    double along_t = qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2]);
    qm_vec half[2][4];
    if (along_s >= along_t) {
        qm_vec low = qm_vec_mix(c[0], c[1], 0.5), high = qm_vec_mix(c[3], c[2], 0.5);
        memcpy(half, (const qm_vec[2][4]){{c[0], low, high, c[3]}, {low, c[1], c[2], high}}, sizeof half);
    } else {
        qm_vec left = qm_vec_mix(c[0], c[3], 0.5), right = qm_vec_mix(c[1], c[2], 0.5);
        memcpy(half, (const qm_vec[2][4]){{c[0], c[1], right, left}, {left, right, c[2], c[3]}}, sizeof half);
    }
    set_rectangle(at, half[0]);
    add_rectangle(work, half[1]);
}

/** Cuts the rectangles, those first that are farthest from their triangles, as long as there is room. */
static void cut_rectangles(near_work *work)
{
    double limit = 0.0;
    for (int i = 0; i < work->rectangle_count; i++)
        limit = fmax(limit, work->rectangle[i].halves.slack);
    while (limit > work->error && work->rectangle_count < RECTANGLES) {
        limit = fmax(0.5 * limit, work->error);
        for (int i = 0; i < work->rectangle_count && work->rectangle_count < RECTANGLES; i++)
            if (work->rectangle[i].halves.slack > limit) halve(work, &work->rectangle[i]);
    }
}

/** Lists the triangles of the rectangles. */
static void add_rectangles(near_work *work)
{
    for (int i = 0; i < work->rectangle_count; i++) {
        const qm_patch_halves *halves = &work->rectangle[i].halves;
        const qm_vec *c = halves->corner;
        for (int k = 0; k < 2; k++) {
            qm_triangle half = qm_triangle_make(c[0], c[1 + k], c[2 + k]);
            if (sqrt(qm_triangle_distance2(&half, work->middle)) - halves->slack <= work->reach)
                add_triangle(work, &half, halves->slack);
        }
    }
}

/* ---- packs ---- */

static void add_pack(near_work *work, const qm_kernel *kernel, uint32_t pack, bool patches)
{
    const qm_bvh *target = work->target;
    const qm_pack_lanes *lanes = &target->lanes[pack];
    _Alignas(64) double d2[QM_PACK_LANES];
    qm_pack spare;
    const qm_pack *rows = qm_bvh_rows(target, pack, &spare);
    kernel->pack_distances(rows, work->middle, d2);
    for (int lane = 0; lane < lanes->lane_count; lane++) {
        double twist = patches ? (double)qm_bvh_twists(target, pack)[lane] : 0.0;
        if (twist > work->error) {
            qm_vec corner[4];
            qm_bvh_load_face(target, lanes->face[lane], corner);
            add_rectangle(work, corner);
            lane += qm_lane_has_second(lanes, (uint32_t)lane);
        } else if (sqrt(d2[lane]) - twist <= work->reach) {
            add_lane(work, rows, lane, twist);
        }
    }
}

/** Fills the last pack up. */
static void pad(qm_near_facets *near)
{
    near->pack_count = (near->count + QM_PACK_LANES - 1) / QM_PACK_LANES;
    if (near->count == 0) return;
    qm_pack *last = &near->pack[near->pack_count - 1];
    int from = (near->count - 1) % QM_PACK_LANES;
    for (int lane = from + 1; lane < QM_PACK_LANES; lane++) {
        copy_lane(last, lane, last, from);
        near->slack[near->pack_count - 1][lane] = near->slack[near->pack_count - 1][from];
    }
}

void qm_near_facets_find(const qm_kernel *kernel, const qm_bvh *target, bool patches, double error,
                         qm_vec middle, double reach, qm_near_facets *near)
{
    const qm_box point = {{middle.x, middle.y, middle.z}, {middle.x, middle.y, middle.z}};
    near_work work; /* large, and filled as it is used */
    work.target = target;
    work.near = near;
    work.middle = middle;
    work.reach = reach;
    work.error = error;
    work.rectangle_count = 0;
    qm_near_packs packs;
    kernel->gather(target, &point, reach, &packs);
    near->count = 0;
    near->is_complete = packs.count < QM_NEAR_PACKS;
    for (int i = 0; i < packs.count; i++)
        add_pack(&work, kernel, packs.pack[i], patches);
    cut_rectangles(&work);
    add_rectangles(&work);
    near->is_complete &= near->count > 0;
    pad(near);
}

qm_near_facet qm_near_facets_nearest(const qm_kernel *kernel, const qm_near_facets *near, qm_vec p)
{
    qm_near_facet found = {.distance = INFINITY};
    for (int pack = 0; pack < near->pack_count; pack++) {
        _Alignas(64) double d2[QM_PACK_LANES];
        kernel->pack_distances(&near->pack[pack], p, d2);
        for (int lane = 0; lane < QM_PACK_LANES; lane++) {
            if (!(d2[lane] < found.distance)) continue;
            found.distance = d2[lane];
            found.place = pack * QM_PACK_LANES + lane;
        }
    }
    found.distance = sqrt(found.distance);
    found.triangle = qm_pack_triangle(&near->pack[found.place / QM_PACK_LANES], found.place % QM_PACK_LANES);
    return found;
}
