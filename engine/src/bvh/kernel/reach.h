/**
 * reach.h: where a line leaves the set of points within a distance of a triangle, in closed form.
 */
#ifndef QM_KERNEL_REACH_H
#define QM_KERNEL_REACH_H

#include <math.h>

#include "kernels.h"

/** Keeps a computed parameter short of the boundary of a set in most cases: the caller measures the point
 * there. */
#define INSIDE (1.0 - 0x1p-40)

/** Coordinates along a segment in a triangle's frame: start + t step. */
typedef struct line {
    double x, y, z;    /* start */
    double ex, ey, ez; /* step */
} line;

static inline line line_in_lane(const qm_pack *pack, int lane, qm_vec a, qm_vec b)
{
#define AXIS(name)                                                                                           \
    ((qm_vec){pack->row[QM_PACK_##name##X][lane], pack->row[QM_PACK_##name##Y][lane],                        \
              pack->row[QM_PACK_##name##Z][lane]})
    qm_vec start = qm_vec_sub(a, AXIS(O)), step = qm_vec_sub(b, a);
    return (line){qm_vec_dot(start, AXIS(X)), qm_vec_dot(start, AXIS(Y)), qm_vec_dot(start, AXIS(Z)),
                  qm_vec_dot(step, AXIS(X)),  qm_vec_dot(step, AXIS(Y)),  qm_vec_dot(step, AXIS(Z))};
#undef AXIS
}

/** The part [from, to] of a line that lies in a convex set; empty when from > to. */
typedef struct interval {
    double from, to;
} interval;

/** Where a t^2 + 2 b t + c <= 0, a >= 0. */
static inline interval quadratic_interval(double a, double b, double c)
{
    double discriminant = b * b - a * c;
    if (!(discriminant >= 0.0)) return (interval){1.0, 0.0};
    if (!(a > 0.0)) return c <= 0.0 ? (interval){-INFINITY, INFINITY} : (interval){1.0, 0.0};
    double root = sqrt(discriminant);
    return (interval){(-b - root) / a, (-b + root) / a};
}

/** Clips an interval to where k + m t >= 0. */
static inline interval clip(interval s, double k, double m)
{
    if (m > 0.0 && -k / m > s.from) s.from = -k / m;
    if (m < 0.0 && -k / m < s.to) s.to = -k / m;
    if (m == 0.0 && k < 0.0) s.to = -INFINITY;
    return s;
}

/** Within the ball around a corner. */
static inline interval around_corner(const line *l, double x, double y, double reach2)
{
    double dx = l->x - x, dy = l->y - y;
    return quadratic_interval(l->ex * l->ex + l->ey * l->ey + l->ez * l->ez,
                              dx * l->ex + dy * l->ey + l->z * l->ez,
                              dx * dx + dy * dy + l->z * l->z - reach2);
}

/** Within the cylinder around the edge from (x, y) by (ux, uy), between its ends. */
static inline interval around_edge(const line *l, double x, double y, double ux, double uy, double inverse_u2,
                                   double reach2)
{
    if (inverse_u2 == 0.0) return (interval){1.0, 0.0};
    double dx = l->x - x, dy = l->y - y;
    double k = ux * dy - uy * dx,
           m = ux * l->ey - uy * l->ex; /* height over the edge in the plane, times |u| */
    interval s = quadratic_interval(m * m * inverse_u2 + l->ez * l->ez, k * m * inverse_u2 + l->z * l->ez,
                                    k * k * inverse_u2 + l->z * l->z - reach2);
    double along = (ux * dx + uy * dy) * inverse_u2, step = (ux * l->ex + uy * l->ey) * inverse_u2;
    return clip(clip(s, along, step), 1.0 - along, -step);
}

/** Within the prism over the inside of the triangle, on both sides. */
static inline interval over_inside(const line *l, double length, double cx, double cy, double reach)
{
    double ex = cx - length;
    if (!(cy > 0.0))
        return (interval){1.0, 0.0}; /* no inside: the conditions below would hold in a half-space */
    interval s = clip(clip((interval){-INFINITY, INFINITY}, reach - l->z, -l->ez), reach + l->z, l->ez);
    s = clip(s, l->y, l->ey);
    s = clip(s, cy * l->x - cx * l->y, cy * l->ex - cx * l->ey);
    return clip(s, ex * l->y - cy * (l->x - length), ex * l->ey - cy * l->ex);
}

static inline double farther(double reached, interval s)
{
    return s.from <= s.to && s.to > reached ? s.to : reached;
}

/**
 * The parameter in [0, 1] at which the line from a (within reach of the lane) to b (beyond it) leaves the set
 * within reach. That set is the union of a prism, three cylinders and three balls, and convex; so the line
 * leaves it where it leaves the last of them.
 */
static inline double qm_pack_reach_along(const qm_pack *pack, int lane, double reach2, qm_vec a, qm_vec b)
{
#define COMPONENT(name) pack->row[QM_PACK_##name][lane]
    double length = COMPONENT(L), cx = COMPONENT(CX), cy = COMPONENT(CY);
    double inverse_length2 = length > 0.0 ? 1.0 / (length * length) : 0.0;
    line l = line_in_lane(pack, lane, a, b);
    double reached = farther(0.0, over_inside(&l, length, cx, cy, sqrt(reach2)));
    reached = farther(reached, around_edge(&l, 0.0, 0.0, length, 0.0, inverse_length2, reach2));
    reached = farther(reached, around_edge(&l, 0.0, 0.0, cx, cy, COMPONENT(INVERSE_C2), reach2));
    reached = farther(reached, around_edge(&l, length, 0.0, cx - length, cy, COMPONENT(INVERSE_D2), reach2));
    reached = farther(reached, around_corner(&l, 0.0, 0.0, reach2));
    reached = farther(reached, around_corner(&l, length, 0.0, reach2));
    reached = farther(reached, around_corner(&l, cx, cy, reach2));
    return reached < 1.0 ? reached * INSIDE : 1.0;
#undef COMPONENT
}

#endif
