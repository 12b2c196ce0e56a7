#include "tri_tri.h"

#include "hull_meet.h"

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
    if (qm_hull_find_sides(a, &hull_b, side_b, &b_in_plane)) return false;
    if (qm_hull_find_sides(b, &hull_a, side_a, &a_in_plane)) return false;
    if (!a_in_plane && !b_in_plane && !has_zero(side_a) && !has_zero(side_b))
        return segments_overlap(a, side_a, b, side_b);
    /* Whatever a degenerate triangle has on both sides of itself is 0: only then its true hull matters. */
    if (b_in_plane) hull_a = qm_hull_make(a);
    if (a_in_plane) hull_b = qm_hull_make(b);
    return qm_hulls_meet(&hull_a, &hull_b);
}

/** Without squares that overflow or vanish. */
static double length_between(qm_vec a, qm_vec b)
{
    qm_vec way = qm_vec_sub(a, b);
    return hypot(hypot(way.x, way.y), way.z);
}

static qm_contact contact_from(const qm_hull_meeting *m)
{
    static const qm_contact_kind kinds[] = {QM_CONTACT_POINT, QM_CONTACT_SEGMENT};
    qm_contact contact = {.kind = m->count < 3 ? kinds[m->count - 1] : QM_CONTACT_AREA};
    double longest = -1.0;
    for (int i = 0; i < m->count; i++) {
        for (int k = m->count == 1 ? i : i + 1; k < m->count; k++) {
            double length = length_between(m->extreme[i].point, m->extreme[k].point);
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
    qm_hull_meeting m;
    qm_hull hull_a = qm_hull_make(a), hull_b = qm_hull_make(b);
    qm_hulls_collect(&hull_a, &hull_b, QM_HULL_EXTREMES, &m);
    if (m.count == 0) return false;
    *out = contact_from(&m);
    return true;
}
