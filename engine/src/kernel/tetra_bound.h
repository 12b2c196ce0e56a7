/**
 * tetra_bound.h: distances to a solid tetrahedron, rounded to the safe side. A lane is a face: lane i has the
 * corners i, i + 1 and i + 2, and the corner i + 3 lies opposite. So the corners of all four faces are the
 * corners of the tetrahedron, turned.
 */
#ifndef QM_KERNEL_TETRA_BOUND_H
#define QM_KERNEL_TETRA_BOUND_H

#include <math.h>

#include "pack.h"

/** Four doubles whatever the instruction set. */
typedef double qm_v4 __attribute__((vector_size(32)));
typedef int64_t qm_v4l __attribute__((vector_size(32)));

typedef struct qm_v4_vec {
    qm_v4 x, y, z;
} qm_v4_vec;

static inline qm_v4 qm_v4_set(double x)
{
    return (qm_v4){0} + x;
}

static inline qm_v4 qm_v4_select(qm_v4l mask, qm_v4 a, qm_v4 b)
{
#if defined(__AVX__)
    return (qm_v4)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)mask);
#else
    return (qm_v4)(((qm_v4l)a & mask) | ((qm_v4l)b & ~mask));
#endif
}

/** b when either is not a number, as qm_vd_min. */
static inline qm_v4 qm_v4_min(qm_v4 a, qm_v4 b)
{
#if defined(__AVX__)
    return (qm_v4)_mm256_min_pd((__m256d)a, (__m256d)b);
#else
    return qm_v4_select(a < b, a, b);
#endif
}

static inline qm_v4 qm_v4_max(qm_v4 a, qm_v4 b)
{
#if defined(__AVX__)
    return (qm_v4)_mm256_max_pd((__m256d)a, (__m256d)b);
#else
    return qm_v4_select(a > b, a, b);
#endif
}

static inline double qm_v4_least(qm_v4 a)
{
    qm_v4 b = qm_v4_min(a, __builtin_shufflevector(a, a, 2, 3, 0, 1));
    return b[0] < b[1] ? b[0] : b[1];
}

static inline double qm_v4_greatest(qm_v4 a)
{
    qm_v4 b = qm_v4_max(a, __builtin_shufflevector(a, a, 2, 3, 0, 1));
    return b[0] > b[1] ? b[0] : b[1];
}

static inline qm_v4_vec qm_v4_vec_splat(qm_vec p)
{
    return (qm_v4_vec){qm_v4_set(p.x), qm_v4_set(p.y), qm_v4_set(p.z)};
}

static inline qm_v4_vec qm_v4_vec_sub(qm_v4_vec a, qm_v4_vec b)
{
    return (qm_v4_vec){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline qm_v4_vec qm_v4_vec_axpy(qm_v4_vec a, qm_v4 s, qm_v4_vec b)
{
    return (qm_v4_vec){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

static inline qm_v4 qm_v4_vec_dot(qm_v4_vec a, qm_v4_vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline qm_v4_vec qm_v4_vec_cross(qm_v4_vec a, qm_v4_vec b)
{
    return (qm_v4_vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static inline qm_v4_vec qm_v4_vec_turn(qm_v4_vec a)
{
    return (qm_v4_vec){__builtin_shufflevector(a.x, a.x, 1, 2, 3, 0),
                       __builtin_shufflevector(a.y, a.y, 1, 2, 3, 0),
                       __builtin_shufflevector(a.z, a.z, 1, 2, 3, 0)};
}

static inline qm_v4_vec qm_tetra_corners(const qm_vec c[4])
{
    return (qm_v4_vec){
        {c[0].x, c[1].x, c[2].x, c[3].x}, {c[0].y, c[1].y, c[2].y, c[3].y}, {c[0].z, c[1].z, c[2].z, c[3].z}};
}

/** Squared distances to segments from the origin of w along e, and where the segments have no length to
 * their origins. */
static inline qm_v4 qm_v4_segment_d2(qm_v4_vec w, qm_v4_vec e)
{
    const qm_v4 zero = qm_v4_set(0.0), tiny = qm_v4_set(0x1p-1000);
    qm_v4 t = qm_v4_vec_dot(w, e) / qm_v4_max(qm_v4_vec_dot(e, e), tiny);
    t = qm_v4_min(qm_v4_max(t, zero), qm_v4_set(1.0));
    qm_v4_vec gap = qm_v4_vec_axpy(w, -t, e);
    return qm_v4_vec_dot(gap, gap);
}

/** Where the feet of p lie over the faces, and how far p is beyond the tetrahedron along each normal. */
typedef struct qm_tetra_sides {
    qm_v4l sound;    /* the face is no sliver: its normal can be relied on */
    qm_v4 height2;   /* squared distance to the plane where p lies over the face, else huge */
    qm_v4 beyond;    /* above 0: the plane, or its parallel through the opposite corner, parts p from it */
    double longest2; /* squared length of the longest side or diagonal */
} qm_tetra_sides;

/** w = p - a, e and g the sides of each face from a, o the way from a to the opposite corner. */
static inline qm_tetra_sides qm_tetra_sides_make(qm_v4_vec w, qm_v4_vec e, qm_v4_vec g, qm_v4_vec o)
{
    const qm_v4 zero = qm_v4_set(0.0), huge = qm_v4_set(0x1p1000);
    qm_v4 ee = qm_v4_vec_dot(e, e), gg = qm_v4_vec_dot(g, g);
    qm_v4_vec normal = qm_v4_vec_cross(e, g);
    qm_v4 norm2 = qm_v4_vec_dot(normal, normal), height = qm_v4_vec_dot(w, normal);
    qm_v4 opposite = qm_v4_vec_dot(o, normal);
    qm_tetra_sides sides;
    sides.sound = norm2 > qm_v4_set(0x1p-40) * ee * gg;
    sides.longest2 = qm_v4_greatest(qm_v4_max(ee, gg));
    qm_v4 along_e = qm_v4_vec_dot(qm_v4_vec_cross(w, g), normal);
    qm_v4 along_g = qm_v4_vec_dot(qm_v4_vec_cross(e, w), normal);
    qm_v4l over = (along_e >= zero) & (along_g >= zero) & (along_e + along_g <= norm2) & sides.sound;
    sides.height2 =
        qm_v4_select(over, height * height / qm_v4_select(sides.sound, norm2, qm_v4_set(1.0)), huge);
    sides.beyond = qm_v4_max(height - qm_v4_max(opposite, zero), qm_v4_min(opposite, zero) - height);
    return sides;
}

/**
 * A lower bound of the distance from p to the solid tetrahedron; 0 unless a plane parts them. Slivers among
 * the faces are left to their edges, from which no point of them is farther than 2^-20 of the longest. A foot
 * that rounding puts on the wrong side of an edge costs less than that too, so the margin covers both.
 */
static inline double qm_tetra_lower(qm_v4_vec a, qm_vec p)
{
    qm_v4_vec b = qm_v4_vec_turn(a), c = qm_v4_vec_turn(b), d = qm_v4_vec_turn(c);
    qm_v4_vec w = qm_v4_vec_sub(qm_v4_vec_splat(p), a);
    qm_v4_vec e = qm_v4_vec_sub(b, a), g = qm_v4_vec_sub(c, a);
    qm_tetra_sides sides = qm_tetra_sides_make(w, e, g, qm_v4_vec_sub(d, a));
    qm_v4l parting = (sides.beyond > qm_v4_set(0.0)) & sides.sound;
    bool any_sound = (sides.sound[0] | sides.sound[1] | sides.sound[2] | sides.sound[3]) != 0;
    if (any_sound && !(parting[0] | parting[1] | parting[2] | parting[3])) return 0.0;
    qm_v4 d2 = qm_v4_min(qm_v4_segment_d2(w, e), qm_v4_segment_d2(w, g));
    double distance = sqrt(qm_v4_least(qm_v4_min(d2, sides.height2)));
    return distance - 0x1p-18 * (distance + sqrt(sides.longest2));
}

/** The faces of a tetrahedron, ready to measure points to them: lane i has the corner i and the sides to its
 * neighbours, which in a patch stand about upright. */
typedef struct qm_tetra_faces {
    qm_v4_vec a, e, g;
    qm_v4 ee, eg, gg, inverse; /* 0 where there is nothing to divide by */
} qm_tetra_faces;

static inline qm_tetra_faces qm_tetra_faces_make(qm_v4_vec a)
{
    const qm_v4 zero = qm_v4_set(0.0), one = qm_v4_set(1.0);
    qm_v4_vec next = qm_v4_vec_turn(a), before = qm_v4_vec_turn(qm_v4_vec_turn(next));
    qm_tetra_faces faces = {.a = a, .e = qm_v4_vec_sub(next, a), .g = qm_v4_vec_sub(before, a)};
    faces.ee = qm_v4_vec_dot(faces.e, faces.e);
    faces.eg = qm_v4_vec_dot(faces.e, faces.g);
    faces.gg = qm_v4_vec_dot(faces.g, faces.g);
    qm_v4 area2 = faces.ee * faces.gg - faces.eg * faces.eg;
    qm_v4l positive = area2 > zero;
    faces.inverse = qm_v4_select(positive, one / qm_v4_select(positive, area2, one), zero);
    return faces;
}

/**
 * An upper bound of the squared distance from p to the faces: the distance to points of them, near to the
 * feet. Whatever rounding does to the weights, they are those of a point of the face.
 */
static inline double qm_tetra_faces_upper2(const qm_tetra_faces *faces, qm_vec p)
{
    const qm_v4 zero = qm_v4_set(0.0), one = qm_v4_set(1.0);
    qm_v4_vec w = qm_v4_vec_sub(qm_v4_vec_splat(p), faces->a);
    qm_v4 we = qm_v4_vec_dot(w, faces->e), wg = qm_v4_vec_dot(w, faces->g);
    qm_v4 s = qm_v4_min(qm_v4_max((we * faces->gg - wg * faces->eg) * faces->inverse, zero), one);
    qm_v4 t = qm_v4_min(qm_v4_max((wg * faces->ee - we * faces->eg) * faces->inverse, zero), one - s);
    qm_v4_vec gap = qm_v4_vec_axpy(qm_v4_vec_axpy(w, -s, faces->e), -t, faces->g);
    return qm_v4_least(qm_v4_vec_dot(gap, gap));
}

#endif
