/**
 * vec.h: vectors of three doubles, by value and inline.
 */
#ifndef QM_VEC_H
#define QM_VEC_H

#include <math.h>
#include <stdbool.h>

#include "qm/mesh.h"

/** A vector is normalized only when it is longer: the square of its length is then a normal number. */
#define QM_MIN_LENGTH 0x1p-400

typedef struct qm_vec {
    double x, y, z;
} qm_vec;

static inline qm_vec qm_vec_load(const double *p)
{
    return (qm_vec){p[0], p[1], p[2]};
}

static inline void qm_vec_store(double *p, qm_vec a)
{
    p[0] = a.x;
    p[1] = a.y;
    p[2] = a.z;
}

static inline qm_vec qm_vec_add(qm_vec a, qm_vec b)
{
    return (qm_vec){a.x + b.x, a.y + b.y, a.z + b.z};
}

static inline qm_vec qm_vec_sub(qm_vec a, qm_vec b)
{
    return (qm_vec){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline qm_vec qm_vec_scale(double s, qm_vec a)
{
    return (qm_vec){s * a.x, s * a.y, s * a.z};
}

/** a + s b */
static inline qm_vec qm_vec_axpy(qm_vec a, double s, qm_vec b)
{
    return (qm_vec){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

/** (1 - t) a + t b, exact at both ends */
static inline qm_vec qm_vec_mix(qm_vec a, qm_vec b, double t)
{
    double s = 1.0 - t;
    return (qm_vec){s * a.x + t * b.x, s * a.y + t * b.y, s * a.z + t * b.z};
}

static inline double qm_vec_dot(qm_vec a, qm_vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline qm_vec qm_vec_cross(qm_vec a, qm_vec b)
{
    return (qm_vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/** A vector at a right angle to one of length 1; its own length is from 0.6 to 1. */
static inline qm_vec qm_vec_perpendicular(qm_vec unit)
{
    return qm_vec_cross(unit, fabs(unit.x) < 0.6 ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0});
}

static inline double qm_vec_norm2(qm_vec a)
{
    return qm_vec_dot(a, a);
}

static inline double qm_vec_norm(qm_vec a)
{
    return sqrt(qm_vec_norm2(a));
}

static inline bool qm_vec_equal(qm_vec a, qm_vec b)
{
    return a.x == b.x && a.y == b.y && a.z == b.z;
}

static inline qm_vec qm_vec_longer(qm_vec a, qm_vec b)
{
    return qm_vec_norm2(b) > qm_vec_norm2(a) ? b : a;
}

/** Lexicographic order by x, then y, then z: along a line in space this is one of its two directions. */
static inline int qm_vec_compare(qm_vec a, qm_vec b)
{
    if (a.x != b.x) return a.x < b.x ? -1 : 1;
    if (a.y != b.y) return a.y < b.y ? -1 : 1;
    return (a.z > b.z) - (a.z < b.z);
}

static inline double qm_vec_distance(qm_vec a, qm_vec b)
{
    return qm_vec_norm(qm_vec_sub(a, b));
}

/** The vector with length 1; 0 stays 0. */
static inline qm_vec qm_vec_unit(qm_vec a)
{
    double length = qm_vec_norm(a);
    return length > 0.0 ? qm_vec_scale(1.0 / length, a) : a;
}

/** The angle between two vectors, from 0 to pi. */
static inline double qm_vec_angle(qm_vec a, qm_vec b)
{
    return atan2(qm_vec_norm(qm_vec_cross(a, b)), qm_vec_dot(a, b));
}

/** Box of count points, count >= 1. */
static inline qm_box qm_vec_box(const qm_vec *point, int count)
{
    qm_box box = {{point[0].x, point[0].y, point[0].z}, {point[0].x, point[0].y, point[0].z}};
    for (int i = 1; i < count; i++) {
        const double p[3] = {point[i].x, point[i].y, point[i].z};
        for (int k = 0; k < 3; k++) {
            box.min[k] = p[k] < box.min[k] ? p[k] : box.min[k];
            box.max[k] = p[k] > box.max[k] ? p[k] : box.max[k];
        }
    }
    return box;
}

/** Mean of count points, count >= 1. */
static inline qm_vec qm_vec_centroid(const qm_vec *point, int count)
{
    qm_vec mean = {0, 0, 0};
    for (int i = 0; i < count; i++)
        mean = qm_vec_axpy(mean, 1.0 / count, point[i]);
    return mean;
}

static inline double qm_min(double a, double b)
{
    return a < b ? a : b;
}

static inline double qm_max(double a, double b)
{
    return a > b ? a : b;
}

/** Radius of the smallest ball around center that contains count points. */
static inline double qm_vec_radius(const qm_vec *point, int count, qm_vec center)
{
    double radius2 = 0.0;
    for (int i = 0; i < count; i++)
        radius2 = qm_max(radius2, qm_vec_norm2(qm_vec_sub(point[i], center)));
    return sqrt(radius2);
}

#define QM_DEGREE 0.017453292519943295 /* in radians */

static inline double qm_clamp(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

#endif
