#include "bvh/bvh_tree.h"
#include "pick_work.h"

#define EDGE 1e-12 /* how far outside a triangle, in weights, a ray still hits: no gap between neighbours */

/** From the near plane on; t is 1 at the far plane. */
typedef struct ray {
    const qm_bvh *bvh;
    qm_vec origin, direction, inverse;
    double t;
} ray;

/** Source: Moeller, Trumbore, Fast, minimum storage ray-triangle intersection, 1997. */
static void meet_triangle(ray *r, qm_vec a, qm_vec b, qm_vec c)
{
    qm_vec e = qm_vec_sub(b, a), f = qm_vec_sub(c, a), h = qm_vec_cross(r->direction, f);
    double det = qm_vec_dot(e, h);
    if (det == 0.0) return;
    qm_vec s = qm_vec_sub(r->origin, a), q = qm_vec_cross(s, e);
    double u = qm_vec_dot(s, h) / det, v = qm_vec_dot(r->direction, q) / det, t = qm_vec_dot(f, q) / det;
    if (u >= -EDGE && v >= -EDGE && u + v <= 1.0 + EDGE && t >= 0.0 && t < r->t) r->t = t;
}

static void meet_pack(ray *r, uint32_t pack)
{
    for (uint32_t lane = 0; lane < r->bvh->lanes[pack].lane_count; lane++) {
        qm_vec corner[3];
        qm_bvh_load_triangle(r->bvh, pack, lane, corner);
        meet_triangle(r, corner[0], corner[1], corner[2]);
    }
}

/** Where the ray enters a box, or INFINITY when it misses it or comes too late. */
static double enter_box(const ray *r, const qm_box_node *group, int member)
{
    const double origin[3] = {r->origin.x, r->origin.y, r->origin.z};
    const double inverse[3] = {r->inverse.x, r->inverse.y, r->inverse.z};
    double enter = 0.0, leave = r->t;
    for (int k = 0; k < 3; k++) {
        double a = ((double)group->low[k][member] - origin[k]) * inverse[k];
        double b = ((double)group->high[k][member] - origin[k]) * inverse[k];
        /* fmin and fmax pass over what is not a number: a ray in the plane of a side. */
        enter = fmax(enter, fmin(a, b));
        leave = fmin(leave, fmax(a, b));
    }
    return enter <= leave ? enter : INFINITY;
}

static void meet_group(ray *r, int level, size_t group)
{
    double enter[QM_PACK_LANES];
    int order[QM_PACK_LANES], count = 0, members = qm_box_tree_child_count(&r->bvh->boxes, level, group);
    for (int i = 0; i < members; i++) {
        enter[i] = enter_box(r, &r->bvh->boxes.groups[level][group], i);
        if (enter[i] == INFINITY) continue;
        int place = count++;
        for (; place > 0 && enter[order[place - 1]] > enter[i]; place--)
            order[place] = order[place - 1];
        order[place] = i;
    }
    for (int i = 0; i < count; i++) {
        if (enter[order[i]] > r->t) return;
        size_t member = 8 * group + (size_t)order[i];
        if (level > 1)
            meet_group(r, level - 1, member);
        else
            meet_pack(r, (uint32_t)member);
    }
}

bool qm_pick_mesh(const qm_view *view, const double window[2], qm_vec *out)
{
    double x = qm_view_clip_x(view, window[0]), y = qm_view_clip_y(view, window[1]);
    ray r = {.bvh = view->source->bvh, .origin = qm_view_unproject(view, x, y, -1.0), .t = INFINITY};
    r.direction = qm_vec_sub(qm_view_unproject(view, x, y, 1.0), r.origin);
    r.inverse = (qm_vec){1.0 / r.direction.x, 1.0 / r.direction.y, 1.0 / r.direction.z};
    meet_group(&r, r.bvh->boxes.level_count, 0);
    if (!(r.t < INFINITY)) return false;
    *out = qm_vec_axpy(r.origin, r.t, r.direction);
    return true;
}
