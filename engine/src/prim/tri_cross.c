/**
 * tri_cross.c: triangles of one mesh that share corners: what they have in common besides those.
 */
#include "hull_meet.h"
#include "tri_tri.h"

/** What is left of a triangle at a shared corner: the rays to its other corners. */
typedef struct fan {
    qm_vec apex, ray[2];
    int axis; /* to drop; -1: the triangle is degenerate */
} fan;

/** True when the ray from the apex to p, another point, runs in the fan. */
static bool ray_in_fan(const fan *f, qm_vec p)
{
    if (qm_orient3d(f->apex, f->ray[0], f->ray[1], p) != 0) return false;
    int turn_fan = qm_orient2d(f->apex, f->ray[0], f->ray[1], f->axis);
    return qm_orient2d(f->apex, f->ray[0], p, f->axis) * turn_fan >= 0 &&
           qm_orient2d(f->apex, p, f->ray[1], f->axis) * turn_fan >= 0;
}

static bool rays_are_one(qm_vec apex, qm_vec p, qm_vec q)
{
    int along = qm_vec_compare(p, apex);
    return along != 0 && along == qm_vec_compare(q, apex) && qm_hull_axis(apex, p, q) < 0;
}

/** True when fans round one apex have more than it in common; first is degenerate. */
static bool flat_fans_meet(const fan *first, const fan *other)
{
    for (int i = 0; i < 2; i++) {
        qm_vec p = first->ray[i];
        if (qm_vec_compare(p, first->apex) == 0) continue;
        if (other->axis >= 0) {
            if (ray_in_fan(other, p)) return true;
        } else if (rays_are_one(first->apex, p, other->ray[0]) ||
                   rays_are_one(first->apex, p, other->ray[1])) {
            return true;
        }
    }
    return false;
}

static bool fans_meet(const fan *a, const fan *b)
{
    if (a->axis < 0) return flat_fans_meet(a, b);
    if (b->axis < 0) return flat_fans_meet(b, a);
    /* A ray that both have in common leaves one of them through the side across from the apex. */
    qm_hull far_a = qm_hull_segment(a->ray[0], a->ray[1]), far_b = qm_hull_segment(b->ray[0], b->ray[1]);
    const qm_vec corners_a[3] = {a->apex, a->ray[0], a->ray[1]};
    const qm_vec corners_b[3] = {b->apex, b->ray[0], b->ray[1]};
    qm_hull whole_a = qm_hull_proper(corners_a), whole_b = qm_hull_proper(corners_b);
    return qm_hulls_meet(&far_a, &whole_b) || qm_hulls_meet(&far_b, &whole_a);
}

/** Beyond the edge p q: two triangles with that edge and the third corners r and s. */
static bool meet_beyond_edge(qm_vec p, qm_vec q, qm_vec r, qm_vec s)
{
    int r_axis = qm_hull_axis(p, q, r), s_axis = qm_hull_axis(p, q, s);
    if (r_axis >= 0 && s_axis >= 0)
        return qm_orient3d(p, q, r, s) == 0 &&
               qm_orient2d(p, q, r, r_axis) * qm_orient2d(p, q, s, r_axis) > 0;
    /* A proper triangle has nothing but the edge on the edge's line. */
    if (r_axis >= 0 || s_axis >= 0) return false;
    if (qm_vec_compare(p, q) == 0) return rays_are_one(p, r, s);
    qm_vec low = qm_vec_compare(p, q) < 0 ? p : q, high = qm_vec_compare(p, q) < 0 ? q : p;
    return (qm_vec_compare(r, low) < 0 && qm_vec_compare(s, low) < 0) ||
           (qm_vec_compare(r, high) > 0 && qm_vec_compare(s, high) > 0);
}

/** The corners of a triangle that are not among the shared ones, filled up with a shared one. */
static void other_corners(const qm_vec corner[3], const uint32_t index[3], const uint32_t *shared,
                          int shared_count, qm_vec fill, qm_vec out[2])
{
    int count = 0;
    out[0] = out[1] = fill;
    for (int i = 0; i < 3; i++) {
        bool is_shared = false;
        for (int k = 0; k < shared_count; k++)
            is_shared |= index[i] == shared[k];
        if (!is_shared && count < 2) out[count++] = corner[i];
    }
}

static int find_shared(const uint32_t a_index[3], const uint32_t b_index[3], uint32_t shared[3], int at[3])
{
    int count = 0;
    for (int i = 0; i < 3; i++) {
        bool is_new = true, is_in_b = false;
        for (int k = 0; k < count; k++)
            is_new &= shared[k] != a_index[i];
        for (int k = 0; k < 3; k++)
            is_in_b |= b_index[k] == a_index[i];
        if (!is_new || !is_in_b) continue;
        shared[count] = a_index[i];
        at[count++] = i;
    }
    return count;
}

bool qm_tri_tri_cross(const qm_vec a[3], const uint32_t a_index[3], const qm_vec b[3],
                      const uint32_t b_index[3])
{
    uint32_t shared[3];
    int at[3], count = find_shared(a_index, b_index, shared, at);
    if (count == 0) return qm_tri_tri_meet(a, b);
    if (count == 3) return qm_hull_axis(a[0], a[1], a[2]) >= 0;
    qm_vec apex = a[at[0]], rest_a[2], rest_b[2];
    other_corners(a, a_index, shared, count, apex, rest_a);
    other_corners(b, b_index, shared, count, apex, rest_b);
    if (count == 2) return meet_beyond_edge(apex, a[at[1]], rest_a[0], rest_b[0]);
    fan fan_a = {apex, {rest_a[0], rest_a[1]}, qm_hull_axis(apex, rest_a[0], rest_a[1])};
    fan fan_b = {apex, {rest_b[0], rest_b[1]}, qm_hull_axis(apex, rest_b[0], rest_b[1])};
    return fans_meet(&fan_a, &fan_b);
}
