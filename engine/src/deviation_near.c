#include "deviation_near.h"

#include "bilinear_point.h"

#define PATCH_CUTS 64 /* of all patches of a list; then they are cut no further */

/** A list on its way. */
typedef struct near_work {
    const qm_bvh *target;
    qm_near_facets *near;
    qm_vec middle;
    double reach, error;
    int patch_cuts;
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

typedef struct rectangle {
    qm_vec corner[4];
} rectangle;

/** The rectangle in halves, across its longer sides. A part of a bilinear patch is one. */
static void halve(const rectangle *from, rectangle out[2])
{
    const qm_vec *c = from->corner;
    double along_s = qm_vec_distance(c[0], c[1]) + qm_vec_distance(c[3], c[2]);
    double along_t = qm_vec_distance(c[0], c[3]) + qm_vec_distance(c[1], c[2]);
    if (along_s >= along_t) {
        qm_vec low = qm_vec_mix(c[0], c[1], 0.5), high = qm_vec_mix(c[3], c[2], 0.5);
        out[0] = (rectangle){{c[0], low, high, c[3]}};
        out[1] = (rectangle){{low, c[1], c[2], high}};
    } else {
        qm_vec left = qm_vec_mix(c[0], c[3], 0.5), right = qm_vec_mix(c[1], c[2], 0.5);
        out[0] = (rectangle){{c[0], c[1], right, left}};
        out[1] = (rectangle){{left, right, c[2], c[3]}};
    }
}

/** Lists the two triangles of a rectangle that lie near, or its halves when it is too twisted; halves go on
 * the stack. */
static int visit_rectangle(near_work *work, const rectangle *at, rectangle *stack)
{
    double twist = qm_patch_twist(at->corner);
    const qm_triangle half[2] = {qm_triangle_make(at->corner[0], at->corner[1], at->corner[2]),
                                 qm_triangle_make(at->corner[0], at->corner[2], at->corner[3])};
    const bool is_near[2] = {
        sqrt(qm_triangle_distance2(&half[0], work->middle)) - twist <= work->reach,
        sqrt(qm_triangle_distance2(&half[1], work->middle)) - twist <= work->reach,
    };
    if (!is_near[0] && !is_near[1]) return 0;
    if (twist > work->error && work->patch_cuts < PATCH_CUTS) {
        work->patch_cuts++;
        halve(at, stack);
        return 2;
    }
    for (int i = 0; i < 2; i++)
        if (is_near[i]) add_triangle(work, &half[i], twist);
    return 0;
}

static void add_patch(near_work *work, const qm_vec corner[4])
{
    rectangle stack[PATCH_CUTS + 2];
    int height = 1;
    stack[0] = (rectangle){{corner[0], corner[1], corner[2], corner[3]}};
    while (height > 0) {
        rectangle at = stack[--height];
        height += visit_rectangle(work, &at, stack + height);
    }
}

/* ---- packs ---- */

static void add_pack(near_work *work, const qm_kernel *kernel, uint32_t pack, bool patches)
{
    const qm_bvh *target = work->target;
    const qm_pack_lanes *lanes = &target->lanes[pack];
    _Alignas(64) double d2[QM_PACK_LANES];
    kernel->pack_distances(&target->packs[pack], work->middle, d2);
    for (int lane = 0; lane < lanes->lane_count; lane++) {
        double twist = patches ? (double)target->twist[pack][lane] : 0.0;
        bool has_second = lane + 1 < lanes->lane_count && (lanes->second >> (lane + 1) & 1);
        if (twist > work->error) {
            qm_vec corner[4];
            qm_bvh_load_face(target, lanes->face[lane], corner);
            add_patch(work, corner);
            lane += has_second;
        } else if (sqrt(d2[lane]) - twist <= work->reach) {
            add_lane(work, &target->packs[pack], lane, twist);
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
    near_work work = {.target = target, .near = near, .middle = middle, .reach = reach, .error = error};
    qm_near_packs packs;
    kernel->gather(target, &point, reach, &packs);
    near->count = 0;
    near->is_complete = packs.count < QM_NEAR_PACKS;
    for (int i = 0; i < packs.count; i++)
        add_pack(&work, kernel, packs.pack[i], patches);
    near->is_complete &= near->count > 0;
    pad(near);
}
