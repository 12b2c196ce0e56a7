#include "tri_tri.h"

#include "hull.h"

/** The isolated vertex: the corner that is alone on its side of a plane that all three lie off. */
static int isolated_corner(const int side[3])
{
    return side[0] == side[1] ? 2 : side[0] == side[2] ? 1 : 0;
}

/**
 * Proper triangles whose corners all lie off the other's plane, some on either side: each meets the line that
 * the planes have in common in a segment, between the two edges at its isolated vertex. Whether one segment
 * ends before the other begins is the orientation of an edge of one against an edge of the other. With the
 * triangles oriented so that both isolated vertices are below, q1 p1 is the edge of the first where its
 * segment begins.
 */
static bool segments_overlap(const qm_vec a[3], const int side_a[3], const qm_vec b[3], const int side_b[3])
{
    int i = isolated_corner(side_a), k = isolated_corner(side_b);
    int a_next = side_b[k] < 0 ? 1 : 2, b_next = side_a[i] < 0 ? 1 : 2;
    qm_vec p1 = a[i], q1 = a[(i + a_next) % 3], r1 = a[(i + 3 - a_next) % 3];
    qm_vec p2 = b[k], q2 = b[(k + b_next) % 3], r2 = b[(k + 3 - b_next) % 3];
    return qm_orient3d(p1, q1, p2, q2) >= 0 && qm_orient3d(p1, r1, r2, p2) >= 0;
}

static bool has_zero(const int side[3])
{
    return side[0] == 0 || side[1] == 0 || side[2] == 0;
}

bool qm_tri_tri_meet(const qm_vec a[3], const qm_vec b[3])
{
    int side_a[3], side_b[3];
    bool a_in_plane, b_in_plane;
    qm_hull hull_a = qm_hull_proper(a), hull_b = qm_hull_proper(b);
    if (qm_hull_find_sides(a, &hull_b, side_b, &b_in_plane)) return false;
    if (qm_hull_find_sides(b, &hull_a, side_a, &a_in_plane)) return false;
    if (!a_in_plane && !b_in_plane && !has_zero(side_a) && !has_zero(side_b))
        return segments_overlap(a, side_a, b, side_b);
    /* Every sign against a degenerate triangle is 0: only then its true hull matters. */
    if (b_in_plane) hull_a = qm_hull_make(a);
    if (a_in_plane) hull_b = qm_hull_make(b);
    return qm_hull_meets(&hull_a, &hull_b);
}

bool qm_tri_tri_contact(const qm_vec a[3], const qm_vec b[3], qm_contact *out)
{
    qm_hull_intersection m;
    qm_hull hull_a = qm_hull_make(a), hull_b = qm_hull_make(b);
    qm_hull_intersect(&hull_a, &hull_b, QM_HULL_EXTREMES, &m);
    if (m.count == 0) return false;
    static const qm_contact_kind kinds[] = {QM_CONTACT_POINT, QM_CONTACT_SEGMENT};
    qm_contact contact = {.kind = m.count < 3 ? kinds[m.count - 1] : QM_CONTACT_AREA};
    double longest = -1.0;
    for (int i = 0; i < m.count; i++) {
        for (int k = m.count == 1 ? i : i + 1; k < m.count; k++) {
            /* Length by hypot: no square overflows or underflows. */
            qm_vec d = qm_vec_sub(m.extreme[i].point, m.extreme[k].point);
            double length = hypot(hypot(d.x, d.y), d.z);
            if (!(length > longest)) continue;
            longest = length;
            qm_vec_store(contact.point[0], m.extreme[i].point);
            qm_vec_store(contact.point[1], m.extreme[k].point);
        }
    }
    *out = contact;
    return true;
}

/* ---- triangles of one mesh that share corners ---- */

/** A triangle at a shared corner, its apex: the cone between the rays to its other corners. */
typedef struct cone {
    qm_vec apex, ray[2];
    int axis; /* to drop; -1: the triangle is degenerate */
} cone;

/** True when the ray from the apex to p, another point, runs in the cone. */
static bool ray_in_cone(const cone *f, qm_vec p)
{
    if (qm_orient3d(f->apex, f->ray[0], f->ray[1], p) != 0) return false;
    int orientation = qm_orient2d(f->apex, f->ray[0], f->ray[1], f->axis);
    return qm_orient2d(f->apex, f->ray[0], p, f->axis) * orientation >= 0 &&
           qm_orient2d(f->apex, p, f->ray[1], f->axis) * orientation >= 0;
}

static bool rays_coincide(qm_vec apex, qm_vec p, qm_vec q)
{
    int along = qm_vec_compare(p, apex);
    return along != 0 && along == qm_vec_compare(q, apex) && qm_hull_axis(apex, p, q) < 0;
}

/** True when cones at one apex have more than the apex in common; first is degenerate. */
static bool flat_cones_meet(const cone *first, const cone *other)
{
    for (int i = 0; i < 2; i++) {
        qm_vec p = first->ray[i];
        if (qm_vec_compare(p, first->apex) == 0) continue;
        if (other->axis >= 0) {
            if (ray_in_cone(other, p)) return true;
        } else if (rays_coincide(first->apex, p, other->ray[0]) ||
                   rays_coincide(first->apex, p, other->ray[1])) {
            return true;
        }
    }
    return false;
}

static bool cones_meet(const cone *a, const cone *b)
{
    if (a->axis < 0) return flat_cones_meet(a, b);
    if (b->axis < 0) return flat_cones_meet(b, a);
    /* A ray of both cones leaves one of the triangles through the edge opposite the apex. */
    qm_hull far_a = qm_hull_segment(a->ray[0], a->ray[1]), far_b = qm_hull_segment(b->ray[0], b->ray[1]);
    const qm_vec corners_a[3] = {a->apex, a->ray[0], a->ray[1]};
    const qm_vec corners_b[3] = {b->apex, b->ray[0], b->ray[1]};
    qm_hull all_a = qm_hull_proper(corners_a), all_b = qm_hull_proper(corners_b);
    return qm_hull_meets(&far_a, &all_b) || qm_hull_meets(&far_b, &all_a);
}

/** True when two triangles with the edge p q and the third corners r and s meet off that edge. */
static bool meet_beyond_edge(qm_vec p, qm_vec q, qm_vec r, qm_vec s)
{
    int r_axis = qm_hull_axis(p, q, r), s_axis = qm_hull_axis(p, q, s);
    if (r_axis >= 0 && s_axis >= 0)
        return qm_orient3d(p, q, r, s) == 0 &&
               qm_orient2d(p, q, r, r_axis) * qm_orient2d(p, q, s, r_axis) > 0;
    /* A proper triangle has no point but the edge on the edge's line. */
    if (r_axis >= 0 || s_axis >= 0) return false;
    if (qm_vec_compare(p, q) == 0) return rays_coincide(p, r, s);
    qm_vec low = qm_vec_compare(p, q) < 0 ? p : q, high = qm_vec_compare(p, q) < 0 ? q : p;
    return (qm_vec_compare(r, low) < 0 && qm_vec_compare(s, low) < 0) ||
           (qm_vec_compare(r, high) > 0 && qm_vec_compare(s, high) > 0);
}

/** The corners of a triangle that are not shared, filled up with a shared one. */
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

/** The distinct vertices of both triangles; at: their corners in a. Returns their count. */
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
    qm_vec apex = a[at[0]], other_a[2], other_b[2];
    other_corners(a, a_index, shared, count, apex, other_a);
    other_corners(b, b_index, shared, count, apex, other_b);
    if (count == 2) return meet_beyond_edge(apex, a[at[1]], other_a[0], other_b[0]);
    cone cone_a = {apex, {other_a[0], other_a[1]}, qm_hull_axis(apex, other_a[0], other_a[1])};
    cone cone_b = {apex, {other_b[0], other_b[1]}, qm_hull_axis(apex, other_b[0], other_b[1])};
    return cones_meet(&cone_a, &cone_b);
}
