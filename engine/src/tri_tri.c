#include "tri_tri.h"

#include "tri_hull.h"

/*
 * The set that two hulls have in common is convex, and its extreme points are of three kinds: corners of one
 * that lie in the other, crossings of two edges, and an edge of one through the inside of the other. Those
 * are collected, each once; how many there are tells a point from a segment from an area.
 */

/** Where a point lies in a hull: at corner i, inside edge EDGE + i (from corner i to i + 1), or inside. */
enum { EDGE = 3, INSIDE = 6, OUTSIDE = 7 };

typedef struct extreme {
    int place[2]; /* in hull 0 and in hull 1 */
    qm_vec point;
} extreme;

typedef struct meeting {
    const qm_hull *hull[2];
    int enough; /* extremes after which the search may stop */
    int count;
    extreme extreme[12];
} meeting;

static bool is_corner(const extreme *e)
{
    return e->place[0] < EDGE || e->place[1] < EDGE;
}

/** Adds an extreme point unless it is known: by its places, or by its position where corners coincide. */
static void add(meeting *m, extreme e)
{
    for (int i = 0; i < m->count; i++) {
        const extreme *known = &m->extreme[i];
        if (known->place[0] == e.place[0] && known->place[1] == e.place[1]) return;
        if (is_corner(known) && is_corner(&e) && qm_vec_compare(known->point, e.point) == 0) return;
    }
    m->extreme[m->count++] = e;
}

static bool has_enough(const meeting *m)
{
    return m->count >= m->enough;
}

static double volume(qm_vec a, qm_vec b, qm_vec c, qm_vec d)
{
    return qm_vec_dot(qm_vec_cross(qm_vec_sub(b, a), qm_vec_sub(c, a)), qm_vec_sub(d, a));
}

/** The point of the segment where a quantity that runs linearly from at_p to at_q is 0; rounded. */
static qm_vec zero_between(qm_vec p, qm_vec q, double at_p, double at_q)
{
    double span = at_p - at_q, t = span != 0.0 ? at_p / span : 0.5;
    return qm_vec_mix(p, q, qm_clamp(t, 0.0, 1.0));
}

/** The place in a triangle of a point from the signs of its three edges, all of them 0 or turn. */
static int place_from_signs(const int sign[3])
{
    int zeros = 0, last = 0;
    for (int i = 0; i < 3; i++)
        if (sign[i] == 0) zeros++, last = i;
    if (zeros == 0) return INSIDE;
    if (zeros == 1) return EDGE + last;
    return sign[0] != 0 ? 2 : sign[1] != 0 ? 0 : 1; /* the corner between the two edges */
}

/** Where an edge of one hull, not in the plane of the triangle that the other is, goes through it. */
static void pierce_edge(meeting *m, int edge_hull, int i, const int *side)
{
    const qm_hull *edges = m->hull[edge_hull], *face = m->hull[1 - edge_hull];
    int k = (i + 1) % edges->count, sign[3];
    if (side[i] * side[k] > 0 || (side[i] == 0 && side[k] == 0)) return;
    qm_vec p = edges->corner[i], q = edges->corner[k];
    int positive = 0, negative = 0;
    for (int n = 0; n < 3; n++) {
        sign[n] = qm_orient3d(p, q, face->corner[n], face->corner[(n + 1) % 3]);
        positive += sign[n] > 0;
        negative += sign[n] < 0;
        if (positive > 0 && negative > 0) return;
    }
    extreme e;
    int place = place_from_signs(sign);
    e.place[edge_hull] = side[i] == 0 ? i : side[k] == 0 ? k : EDGE + i;
    e.place[1 - edge_hull] = place;
    if (e.place[edge_hull] < EDGE)
        e.point = edges->corner[e.place[edge_hull]];
    else if (place < EDGE)
        e.point = face->corner[place];
    else
        e.point = zero_between(p, q, volume(face->corner[0], face->corner[1], face->corner[2], p),
                               volume(face->corner[0], face->corner[1], face->corner[2], q));
    add(m, e);
}

static void pierce(meeting *m, int edge_hull, const int *side)
{
    int count = m->hull[edge_hull]->count, edges = count == 3 ? 3 : count - 1;
    for (int i = 0; i < edges && !has_enough(m); i++)
        pierce_edge(m, edge_hull, i, side);
}

/* ---- hulls in one plane ---- */

/** The sign in the plane, which is looked at along the axis; 0 when all lies on one line (axis -1). */
static int turn(qm_vec a, qm_vec b, qm_vec c, int axis)
{
    return axis < 0 ? 0 : qm_orient2d(a, b, c, axis);
}

static int place_in_segment(const qm_hull *hull, qm_vec p, int axis)
{
    int first = qm_vec_compare(p, hull->corner[0]), last = qm_vec_compare(p, hull->corner[hull->count - 1]);
    if (first == 0) return 0;
    if (last == 0) return hull->count - 1;
    if (first * last > 0 || turn(hull->corner[0], hull->corner[1], p, axis) != 0) return OUTSIDE;
    return EDGE;
}

/** The place in a hull of a point of the same plane. */
static int place_in_hull(const qm_hull *hull, qm_vec p, int axis)
{
    if (hull->count < 3) return place_in_segment(hull, p, axis);
    int positive = 0, negative = 0, sign[3];
    for (int i = 0; i < 3; i++) {
        sign[i] = turn(hull->corner[i], hull->corner[(i + 1) % 3], p, axis);
        positive += sign[i] > 0;
        negative += sign[i] < 0;
        if (positive > 0 && negative > 0) return OUTSIDE;
    }
    return place_from_signs(sign);
}

static void add_corners(meeting *m, int side, int axis)
{
    const qm_hull *hull = m->hull[side];
    for (int i = 0; i < hull->count && !has_enough(m); i++) {
        extreme e = {.point = hull->corner[i]};
        e.place[side] = i;
        e.place[1 - side] = place_in_hull(m->hull[1 - side], e.point, axis);
        if (e.place[1 - side] != OUTSIDE) add(m, e);
    }
}

/** Crossings of two edges inside both; all others are corners. */
static void add_crossing(meeting *m, int i, int k, int axis)
{
    const qm_hull *a = m->hull[0], *b = m->hull[1];
    qm_vec p = a->corner[i], q = qm_hull_corner(a, i + 1), r = b->corner[k], s = qm_hull_corner(b, k + 1);
    if (turn(p, q, r, axis) * turn(p, q, s, axis) >= 0 || turn(r, s, p, axis) * turn(r, s, q, axis) >= 0)
        return;
    qm_vec along = qm_vec_sub(s, r), normal = qm_vec_cross(qm_vec_sub(q, p), along);
    qm_vec across = qm_vec_cross(normal, along);
    double at_p = qm_vec_dot(across, qm_vec_sub(p, r)), at_q = qm_vec_dot(across, qm_vec_sub(q, r));
    add(m, (extreme){{EDGE + i, EDGE + k}, zero_between(p, q, at_p, at_q)});
}

/** An axis to look along at all corners of two hulls in one plane; -1 when they lie on one line. */
static int common_axis(const qm_hull *a, const qm_hull *b)
{
    const qm_hull *first = a->count >= b->count ? a : b, *other = first == a ? b : a;
    if (first->count == 3) return qm_hull_axis(first->corner[0], first->corner[1], first->corner[2]);
    for (int i = 0; i < other->count; i++) {
        int axis = qm_hull_axis(first->corner[0], first->corner[1], other->corner[i]);
        if (axis >= 0) return axis;
    }
    return -1;
}

static void meet_in_plane(meeting *m)
{
    const qm_hull *a = m->hull[0], *b = m->hull[1];
    int axis = common_axis(a, b);
    add_corners(m, 0, axis);
    add_corners(m, 1, axis);
    int a_edges = a->count == 3 ? 3 : a->count - 1, b_edges = b->count == 3 ? 3 : b->count - 1;
    for (int i = 0; i < a_edges; i++)
        for (int k = 0; k < b_edges && !has_enough(m); k++)
            add_crossing(m, i, k, axis);
}

/* ---- hulls in space ---- */

/** Sides of the corners of a hull to the plane of a triangle. True when all lie strictly on one side. */
static bool find_sides(const qm_vec plane[3], const qm_hull *hull, int side[3], bool *in_plane)
{
    int above = 0, below = 0;
    qm_orient3d_sides(plane, hull->corner, hull->count, side);
    for (int i = 0; i < hull->count; i++) {
        above += side[i] > 0;
        below += side[i] < 0;
    }
    *in_plane = above + below == 0;
    return above == hull->count || below == hull->count;
}

static bool segments_are_skew(const qm_hull *a, const qm_hull *b)
{
    return a->count == 2 && b->count == 2 &&
           qm_orient3d(a->corner[0], a->corner[1], b->corner[0], b->corner[1]) != 0;
}

/** Collects the extremes of what two hulls have in common. */
static void meet_hulls(meeting *m)
{
    const qm_hull *a = m->hull[0], *b = m->hull[1];
    int side_a[3], side_b[3];
    bool a_in_plane = false, b_in_plane = false;
    if (a->count < 3 && b->count < 3) {
        if (!segments_are_skew(a, b)) meet_in_plane(m);
        return;
    }
    if (a->count == 3 && find_sides(a->corner, b, side_b, &b_in_plane)) return;
    if (b->count == 3 && find_sides(b->corner, a, side_a, &a_in_plane)) return;
    if (a_in_plane || b_in_plane) {
        meet_in_plane(m);
        return;
    }
    if (a->count == 3) pierce(m, 1, side_b);
    if (b->count == 3 && !has_enough(m)) pierce(m, 0, side_a);
}

static void meet(meeting *m, const qm_hull *a, const qm_hull *b, int enough)
{
    m->hull[0] = a;
    m->hull[1] = b;
    m->enough = enough;
    m->count = 0;
    meet_hulls(m);
}

static bool hulls_meet(const qm_hull *a, const qm_hull *b)
{
    meeting m;
    meet(&m, a, b, 1);
    return m.count > 0;
}

/** The corner that is alone on its side of a plane that all three lie off. */
static int lonely_corner(const int side[3])
{
    return side[0] == side[1] ? 2 : side[0] == side[2] ? 1 : 0;
}

/**
 * Proper triangles whose corners all lie off the other's plane, some on either side: each meets the line that
 * the planes have in common in a segment, between the two edges from its lonely corner. Whether one segment
 * ends before the other begins is the side of an edge of one to an edge of the other. With the triangles
 * turned so that both lonely corners are below, q1 p1 is the edge of the first where its segment begins.
 */
static bool segments_overlap(const qm_vec a[3], const int side_a[3], const qm_vec b[3], const int side_b[3])
{
    int i = lonely_corner(side_a), k = lonely_corner(side_b);
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
    if (find_sides(a, &hull_b, side_b, &b_in_plane)) return false;
    if (find_sides(b, &hull_a, side_a, &a_in_plane)) return false;
    if (!a_in_plane && !b_in_plane && !has_zero(side_a) && !has_zero(side_b))
        return segments_overlap(a, side_a, b, side_b);
    /* Whatever a degenerate triangle has on both sides of itself is 0: only then its true hull matters. */
    if (b_in_plane) hull_a = qm_hull_make(a);
    if (a_in_plane) hull_b = qm_hull_make(b);
    return hulls_meet(&hull_a, &hull_b);
}

static qm_contact contact_from(const meeting *m)
{
    static const qm_contact_kind kinds[] = {QM_CONTACT_POINT, QM_CONTACT_SEGMENT};
    qm_contact contact = {.kind = m->count < 3 ? kinds[m->count - 1] : QM_CONTACT_AREA};
    double longest = -1.0;
    for (int i = 0; i < m->count; i++) {
        for (int k = m->count == 1 ? i : i + 1; k < m->count; k++) {
            double length = qm_vec_distance(m->extreme[i].point, m->extreme[k].point);
            if (!(length > longest)) continue;
            longest = length;
            qm_vec_store(contact.point[0], m->extreme[i].point);
            qm_vec_store(contact.point[1], m->extreme[k].point);
        }
    }
    return contact;
}

bool qm_tri_tri_contact(const qm_vec a[3], const qm_vec b[3], qm_contact *out)
{
    meeting m;
    qm_hull hull_a = qm_hull_make(a), hull_b = qm_hull_make(b);
    meet(&m, &hull_a, &hull_b, 12);
    if (m.count == 0) return false;
    *out = contact_from(&m);
    return true;
}

/* ---- triangles that share corners ---- */

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
    return hulls_meet(&far_a, &whole_b) || hulls_meet(&far_b, &whole_a);
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
