/**
 * tetra_bound.h: distances to a solid tetrahedron, rounded to the safe side. A lane is a face: lane i has the
 * corners i, i + 1 and i + 2, and the corner i + 3 is opposite. So the corners of all four faces are the
 * corners of the tetrahedron, rotated.
 */
#ifndef QM_KERNEL_TETRA_BOUND_H
#define QM_KERNEL_TETRA_BOUND_H

#include <math.h>

#include "four.h"
#include "pack.h"

typedef struct qm_four_vec {
    qm_four x, y, z;
} qm_four_vec;

static inline double qm_four_min_lane(qm_four a)
{
    qm_four b = qm_four_min(a, __builtin_shufflevector(a, a, 2, 3, 0, 1));
    return b[0] < b[1] ? b[0] : b[1];
}

static inline double qm_four_max_lane(qm_four a)
{
    qm_four b = qm_four_max(a, __builtin_shufflevector(a, a, 2, 3, 0, 1));
    return b[0] > b[1] ? b[0] : b[1];
}

static inline qm_four_vec qm_four_vec_splat(qm_vec p)
{
    return (qm_four_vec){qm_four_set(p.x), qm_four_set(p.y), qm_four_set(p.z)};
}

static inline qm_four_vec qm_four_vec_sub(qm_four_vec a, qm_four_vec b)
{
    return (qm_four_vec){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline qm_four_vec qm_four_vec_axpy(qm_four_vec a, qm_four s, qm_four_vec b)
{
    return (qm_four_vec){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

static inline qm_four qm_four_vec_dot(qm_four_vec a, qm_four_vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline qm_four_vec qm_four_vec_cross(qm_four_vec a, qm_four_vec b)
{
    return (qm_four_vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static inline qm_four_vec qm_four_vec_rotate(qm_four_vec a)
{
    return (qm_four_vec){__builtin_shufflevector(a.x, a.x, 1, 2, 3, 0),
                         __builtin_shufflevector(a.y, a.y, 1, 2, 3, 0),
                         __builtin_shufflevector(a.z, a.z, 1, 2, 3, 0)};
}

static inline qm_four_vec qm_tetra_corners(const qm_vec c[4])
{
    return (qm_four_vec){
        {c[0].x, c[1].x, c[2].x, c[3].x}, {c[0].y, c[1].y, c[2].y, c[3].y}, {c[0].z, c[1].z, c[2].z, c[3].z}};
}

/** Squared distances to segments from the origin of w along e, and where the segments have no length to
 * their origins. */
static inline qm_four qm_four_segment_d2(qm_four_vec w, qm_four_vec e)
{
    const qm_four zero = qm_four_set(0.0), tiny = qm_four_set(0x1p-1000);
    qm_four t = qm_four_vec_dot(w, e) / qm_four_max(qm_four_vec_dot(e, e), tiny);
    t = qm_four_min(qm_four_max(t, zero), qm_four_set(1.0));
    qm_four_vec gap = qm_four_vec_axpy(w, -t, e);
    return qm_four_vec_dot(gap, gap);
}

/** Where p projects into the faces, and how far p is beyond the tetrahedron along each normal. */
typedef struct qm_tetra_sides {
    qm_four_mask sound; /* the face is no sliver: its normal is reliable */
    qm_four height2;    /* squared distance to the plane where p projects into the face, else huge */
    qm_four beyond; /* above 0: the plane, or its parallel through the opposite corner, separates p from it */
    double longest2; /* squared length of the longest side or diagonal */
} qm_tetra_sides;

/** w = p - a, e and g the sides of each face from a, o the vector from a to the opposite corner. */
static inline qm_tetra_sides qm_tetra_sides_make(qm_four_vec w, qm_four_vec e, qm_four_vec g, qm_four_vec o)
{
    const qm_four zero = qm_four_set(0.0), huge = qm_four_set(0x1p1000);
    qm_four ee = qm_four_vec_dot(e, e), gg = qm_four_vec_dot(g, g);
    qm_four_vec normal = qm_four_vec_cross(e, g);
    qm_four norm2 = qm_four_vec_dot(normal, normal), height = qm_four_vec_dot(w, normal);
    qm_four opposite = qm_four_vec_dot(o, normal);
    qm_tetra_sides sides;
    sides.sound = norm2 > qm_four_set(0x1p-40) * ee * gg;
    sides.longest2 = qm_four_max_lane(qm_four_max(ee, gg));
    qm_four along_e = qm_four_vec_dot(qm_four_vec_cross(w, g), normal);
    qm_four along_g = qm_four_vec_dot(qm_four_vec_cross(e, w), normal);
    qm_four_mask over = (along_e >= zero) & (along_g >= zero) & (along_e + along_g <= norm2) & sides.sound;
    sides.height2 =
        qm_four_select(over, height * height / qm_four_select(sides.sound, norm2, qm_four_set(1.0)), huge);
    sides.beyond = qm_four_max(height - qm_four_max(opposite, zero), qm_four_min(opposite, zero) - height);
    return sides;
}

/**
 * A lower bound of the distance d from p to the solid tetrahedron; 0 unless a plane separates them. S is the
 * longest side or diagonal and u = 2^-53; |p - a| <= d + S.
 *   - Slivers among the faces, whose sides at a meet at an angle below 2^-20, are represented by their edges,
 *     from which no point of them is farther than 2^-20 S. Where all four are slivers the corners lie as near
 *     to one line, and any point inside is within 2^-19 S of an edge.
 *   - The normal of any other face is off by 4 u |e| |g|, so its direction by 4 u 2^20 = 2^-31. Then a height
 *     is off by 2^-31 (d + S), and a footpoint computed on the wrong side of an edge lies as near to it, sums
 *     and products apart, which are some 10 u (d + S).
 *   - A plane that seems to separate them by such an error has p no deeper inside than that; the
 *     perpendicular to it leaves the tetrahedron within its length, so that a face is as near. Together less
 *     than 2^-19 S + 2^-28 (d + S); the margin is 2^-18 (d + S). Without it tests exceed the distance by
 *     2^-23 (d + S) at most.
 */
static inline double qm_tetra_lower(qm_four_vec a, qm_vec p)
{
    qm_four_vec b = qm_four_vec_rotate(a), c = qm_four_vec_rotate(b), d = qm_four_vec_rotate(c);
    qm_four_vec w = qm_four_vec_sub(qm_four_vec_splat(p), a);
    qm_four_vec e = qm_four_vec_sub(b, a), g = qm_four_vec_sub(c, a);
    qm_tetra_sides sides = qm_tetra_sides_make(w, e, g, qm_four_vec_sub(d, a));
    qm_four_mask separating = (sides.beyond > qm_four_set(0.0)) & sides.sound;
    bool any_sound = (sides.sound[0] | sides.sound[1] | sides.sound[2] | sides.sound[3]) != 0;
    if (any_sound && !(separating[0] | separating[1] | separating[2] | separating[3])) return 0.0;
    qm_four d2 = qm_four_min(qm_four_segment_d2(w, e), qm_four_segment_d2(w, g));
    double distance = sqrt(qm_four_min_lane(qm_four_min(d2, sides.height2)));
    return distance - 0x1p-18 * (distance + sqrt(sides.longest2));
}

/** The faces of a tetrahedron, prepared for measuring points: lane i has the corner i and the sides to its
 * neighbors, which in a patch are about perpendicular. */
typedef struct qm_tetra_faces {
    qm_four_vec a, e, g;
    qm_four ee, eg, gg, inverse; /* of the squared doubled area; 0 where that is 0 */
} qm_tetra_faces;

static inline qm_tetra_faces qm_tetra_faces_make(qm_four_vec a)
{
    const qm_four zero = qm_four_set(0.0), one = qm_four_set(1.0);
    qm_four_vec next = qm_four_vec_rotate(a), before = qm_four_vec_rotate(qm_four_vec_rotate(next));
    qm_tetra_faces faces = {.a = a, .e = qm_four_vec_sub(next, a), .g = qm_four_vec_sub(before, a)};
    faces.ee = qm_four_vec_dot(faces.e, faces.e);
    faces.eg = qm_four_vec_dot(faces.e, faces.g);
    faces.gg = qm_four_vec_dot(faces.g, faces.g);
    qm_four area2 = faces.ee * faces.gg - faces.eg * faces.eg;
    qm_four_mask positive = area2 > zero;
    faces.inverse = qm_four_select(positive, one / qm_four_select(positive, area2, one), zero);
    return faces;
}

/**
 * An upper bound of the squared distance from p to the faces: the distance to points of them near the
 * footpoints. However the weights are rounded, they are those of a point of the face.
 */
static inline double qm_tetra_faces_upper2(const qm_tetra_faces *faces, qm_vec p)
{
    const qm_four zero = qm_four_set(0.0), one = qm_four_set(1.0);
    qm_four_vec w = qm_four_vec_sub(qm_four_vec_splat(p), faces->a);
    qm_four we = qm_four_vec_dot(w, faces->e), wg = qm_four_vec_dot(w, faces->g);
    qm_four s = qm_four_min(qm_four_max((we * faces->gg - wg * faces->eg) * faces->inverse, zero), one);
    qm_four t = qm_four_min(qm_four_max((wg * faces->ee - we * faces->eg) * faces->inverse, zero), one - s);
    qm_four_vec gap = qm_four_vec_axpy(qm_four_vec_axpy(w, -s, faces->e), -t, faces->g);
    return qm_four_min_lane(qm_four_vec_dot(gap, gap));
}

#endif
