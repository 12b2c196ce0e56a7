#include "hull.h"

int qm_hull_axis(qm_vec a, qm_vec b, qm_vec c)
{
    for (int axis = 0; axis < 3; axis++)
        if (qm_orient2d(a, b, c, axis) != 0) return axis;
    return -1;
}

qm_hull qm_hull_make(const qm_vec corner[3])
{
    if (qm_hull_axis(corner[0], corner[1], corner[2]) >= 0) return qm_hull_proper(corner);
    qm_vec low = corner[0], high = corner[0];
    for (int i = 1; i < 3; i++) {
        low = qm_vec_compare(corner[i], low) < 0 ? corner[i] : low;
        high = qm_vec_compare(corner[i], high) > 0 ? corner[i] : high;
    }
    return qm_hull_segment(low, high);
}

/* ---- extreme points of the intersection of two hulls ---- */

static qm_vec corner_at(const qm_hull *hull, int i)
{
    return hull->corner[i % hull->count];
}

/** Location of a point in a hull: at corner i, inside edge EDGE + i (from corner i to i + 1), or inside. */
enum { EDGE = 3, INSIDE = 6, OUTSIDE = 7 };

static bool is_corner(const qm_hull_extreme *e)
{
    return e->location[0] < EDGE || e->location[1] < EDGE;
}

/** Adds an extreme point unless it is known: by its locations, or by its position where corners coincide. */
static void add(qm_hull_intersection *m, qm_hull_extreme e)
{
    for (int i = 0; i < m->count; i++) {
        const qm_hull_extreme *known = &m->extreme[i];
        if (known->location[0] == e.location[0] && known->location[1] == e.location[1]) return;
        if (is_corner(known) && is_corner(&e) && qm_vec_compare(known->point, e.point) == 0) return;
    }
    QM_ASSERT(m->count < QM_HULL_EXTREMES);
    m->extreme[m->count++] = e;
}

static bool has_enough(const qm_hull_intersection *m)
{
    return m->count >= m->enough;
}

/** The power of two that scales the longer of two vectors to about 1: without it, products of four
 * differences of coordinates overflow or underflow. */
static double power_for(qm_vec a, qm_vec b)
{
    double x = fmax(fabs(a.x), fabs(b.x)), y = fmax(fabs(a.y), fabs(b.y)), z = fmax(fabs(a.z), fabs(b.z));
    double largest = fmax(x, fmax(y, z));
    int exponent = 0;
    if (largest > 0.0) frexp(largest, &exponent);
    return ldexp(1.0, exponent < -1000 ? 1000 : -exponent);
}

static qm_vec bring_to_one(qm_vec a)
{
    return qm_vec_scale(power_for(a, a), a);
}

/** The point of a segment in the plane through origin at a right angle to across; rounded. */
static qm_vec cut_segment(qm_vec p, qm_vec q, qm_vec origin, qm_vec across)
{
    qm_vec to_p = qm_vec_sub(p, origin), to_q = qm_vec_sub(q, origin);
    double power = power_for(to_p, to_q);
    double at_p = qm_vec_dot(across, qm_vec_scale(power, to_p)),
           at_q = qm_vec_dot(across, qm_vec_scale(power, to_q));
    double span = at_p - at_q, t = span != 0.0 ? at_p / span : 0.5;
    return qm_vec_mix(p, q, qm_clamp(t, 0.0, 1.0));
}

/** The location in a triangle of a point, from its signs against the three edges, which are 0 or all equal.
 */
static int location_from_signs(const int sign[3])
{
    int zeros = 0, last = 0;
    for (int i = 0; i < 3; i++)
        if (sign[i] == 0) zeros++, last = i;
    if (zeros == 0) return INSIDE;
    if (zeros == 1) return EDGE + last;
    return sign[0] != 0 ? 2 : sign[1] != 0 ? 0 : 1; /* the corner between the two edges */
}

static qm_vec face_normal(const qm_hull *face)
{
    return qm_vec_cross(bring_to_one(qm_vec_sub(face->corner[1], face->corner[0])),
                        bring_to_one(qm_vec_sub(face->corner[2], face->corner[0])));
}

/** Adds the point where an edge of one hull pierces the other one, a triangle in another plane. */
static void pierce_edge(qm_hull_intersection *m, int edge_hull, int i, const int *side)
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
    qm_hull_extreme e;
    int location = location_from_signs(sign);
    e.location[edge_hull] = side[i] == 0 ? i : side[k] == 0 ? k : EDGE + i;
    e.location[1 - edge_hull] = location;
    if (e.location[edge_hull] < EDGE)
        e.point = edges->corner[e.location[edge_hull]];
    else if (location < EDGE)
        e.point = face->corner[location];
    else
        e.point = cut_segment(p, q, face->corner[0], face_normal(face));
    add(m, e);
}

static void pierce(qm_hull_intersection *m, int edge_hull, const int *side)
{
    int count = m->hull[edge_hull]->count, edges = count == 3 ? 3 : count - 1;
    for (int i = 0; i < edges && !has_enough(m); i++)
        pierce_edge(m, edge_hull, i, side);
}

/* ---- hulls in one plane ---- */

/** Orientation of three points of the common plane, projected along axis; 0 when the hulls lie on one line
 * (axis -1). */
static int orient(qm_vec a, qm_vec b, qm_vec c, int axis)
{
    return axis < 0 ? 0 : qm_orient2d(a, b, c, axis);
}

static int location_in_segment(const qm_hull *hull, qm_vec p, int axis)
{
    int first = qm_vec_compare(p, hull->corner[0]), last = qm_vec_compare(p, hull->corner[hull->count - 1]);
    if (first == 0) return 0;
    if (last == 0) return hull->count - 1;
    if (first * last > 0 || orient(hull->corner[0], hull->corner[1], p, axis) != 0) return OUTSIDE;
    return EDGE;
}

/** The location in a hull of a point of the same plane. */
static int location_in_hull(const qm_hull *hull, qm_vec p, int axis)
{
    if (hull->count < 3) return location_in_segment(hull, p, axis);
    int positive = 0, negative = 0, sign[3];
    for (int i = 0; i < 3; i++) {
        sign[i] = orient(hull->corner[i], hull->corner[(i + 1) % 3], p, axis);
        positive += sign[i] > 0;
        negative += sign[i] < 0;
        if (positive > 0 && negative > 0) return OUTSIDE;
    }
    return location_from_signs(sign);
}

static void add_corners(qm_hull_intersection *m, int side, int axis)
{
    const qm_hull *hull = m->hull[side];
    for (int i = 0; i < hull->count && !has_enough(m); i++) {
        qm_hull_extreme e = {.point = hull->corner[i]};
        e.location[side] = i;
        e.location[1 - side] = location_in_hull(m->hull[1 - side], e.point, axis);
        if (e.location[1 - side] != OUTSIDE) add(m, e);
    }
}

/** Adds the crossing of two edges inside both; add_corners finds all other crossings. */
static void add_crossing(qm_hull_intersection *m, int i, int k, int axis)
{
    const qm_hull *a = m->hull[0], *b = m->hull[1];
    qm_vec p = a->corner[i], q = corner_at(a, i + 1), r = b->corner[k], s = corner_at(b, k + 1);
    if (orient(p, q, r, axis) * orient(p, q, s, axis) >= 0 ||
        orient(r, s, p, axis) * orient(r, s, q, axis) >= 0)
        return;
    qm_vec along = bring_to_one(qm_vec_sub(s, r));
    qm_vec normal = qm_vec_cross(bring_to_one(qm_vec_sub(q, p)), along);
    qm_vec across = qm_vec_cross(bring_to_one(normal), along);
    add(m, (qm_hull_extreme){{EDGE + i, EDGE + k}, cut_segment(p, q, r, across)});
}

/** An axis along which two hulls of one plane project without collapsing; -1 when they lie on one line. */
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

static void meet_in_plane(qm_hull_intersection *m)
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

bool qm_hull_find_sides(const qm_vec plane[3], const qm_hull *hull, int side[3], bool *in_plane)
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

void qm_hull_intersect(const qm_hull *a, const qm_hull *b, int enough, qm_hull_intersection *out)
{
    QM_ASSERT(a->count >= 1 && a->count <= 3 && b->count >= 1 && b->count <= 3);
    out->hull[0] = a;
    out->hull[1] = b;
    out->enough = enough;
    out->count = 0;
    int side_a[3], side_b[3];
    bool a_in_plane = false, b_in_plane = false;
    if (a->count < 3 && b->count < 3) {
        if (!(a->count == 2 && b->count == 2 &&
              qm_orient3d(a->corner[0], a->corner[1], b->corner[0], b->corner[1]) != 0))
            meet_in_plane(out);
        return;
    }
    if (a->count == 3 && qm_hull_find_sides(a->corner, b, side_b, &b_in_plane)) return;
    if (b->count == 3 && qm_hull_find_sides(b->corner, a, side_a, &a_in_plane)) return;
    if (a_in_plane || b_in_plane) {
        meet_in_plane(out);
        return;
    }
    if (a->count == 3) pierce(out, 1, side_b);
    if (b->count == 3 && !has_enough(out)) pierce(out, 0, side_a);
}

bool qm_hull_meets(const qm_hull *a, const qm_hull *b)
{
    qm_hull_intersection m;
    qm_hull_intersect(a, b, 1, &m);
    return m.count > 0;
}
