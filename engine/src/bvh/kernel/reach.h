/**
 * reach.h: how far along a line a triangle reaches, in closed form.
 */
#ifndef QM_KERNEL_REACH_H
#define QM_KERNEL_REACH_H

#include <math.h>

#include "kernels.h"

/** Keeps a computed parameter short of the border of a set, mostly: who uses it measures the point there. */
#define INSIDE (1.0 - 0x1p-40)

/** Coordinates along a segment in a triangle's frame: start + t step. */
typedef struct line {
    double x, y, z;    /* start */
    double ex, ey, ez; /* step */
} line;

static inline line line_in_lane(const qm_pack *pack, int lane, qm_vec a, qm_vec b)
{
#define AXIS(name)                                                                                           \
    ((qm_vec){pack->row[QM_ROW_##name##X][lane], pack->row[QM_ROW_##name##Y][lane],                          \
              pack->row[QM_ROW_##name##Z][lane]})
    qm_vec start = qm_vec_sub(a, AXIS(O)), step = qm_vec_sub(b, a);
    return (line){qm_vec_dot(start, AXIS(X)), qm_vec_dot(start, AXIS(Y)), qm_vec_dot(start, AXIS(Z)),
                  qm_vec_dot(step, AXIS(X)),  qm_vec_dot(step, AXIS(Y)),  qm_vec_dot(step, AXIS(Z))};
#undef AXIS
}

/** The part [from, to] of a line that lies in a convex set; empty when from > to. */
typedef struct span {
    double from, to;
} span;

/** Where a t^2 + 2 b t + c <= 0, a >= 0. */
static inline span quadratic_span(double a, double b, double c)
{
    double discriminant = b * b - a * c;
    if (!(discriminant >= 0.0)) return (span){1.0, 0.0};
    if (!(a > 0.0)) return c <= 0.0 ? (span){-INFINITY, INFINITY} : (span){1.0, 0.0};
    double root = sqrt(discriminant);
    return (span){(-b - root) / a, (-b + root) / a};
}

/** Cuts a span down to where k + m t >= 0. */
static inline span clip(span s, double k, double m)
{
    if (m > 0.0 && -k / m > s.from) s.from = -k / m;
    if (m < 0.0 && -k / m < s.to) s.to = -k / m;
    if (m == 0.0 && k < 0.0) s.to = -INFINITY;
    return s;
}

static inline span around_corner(const line *l, double x, double y, double reach2)
{
    double dx = l->x - x, dy = l->y - y;
    return quadratic_span(l->ex * l->ex + l->ey * l->ey + l->ez * l->ez,
                          dx * l->ex + dy * l->ey + l->z * l->ez, dx * dx + dy * dy + l->z * l->z - reach2);
}

/** Round the edge from (x, y) by (ux, uy), between its ends. */
static inline span around_edge(const line *l, double x, double y, double ux, double uy, double inverse_u2,
                               double reach2)
{
    if (inverse_u2 == 0.0) return (span){1.0, 0.0};
    double dx = l->x - x, dy = l->y - y;
    double k = ux * dy - uy * dx,
           m = ux * l->ey - uy * l->ex; /* height over the edge in the plane, times |u| */
    span s = quadratic_span(m * m * inverse_u2 + l->ez * l->ez, k * m * inverse_u2 + l->z * l->ez,
                            k * k * inverse_u2 + l->z * l->z - reach2);
    double along = (ux * dx + uy * dy) * inverse_u2, step = (ux * l->ex + uy * l->ey) * inverse_u2;
    return clip(clip(s, along, step), 1.0 - along, -step);
}

/** Over the inside of the triangle, both ways. */
static inline span over_inside(const line *l, double length, double cx, double cy, double reach)
{
    double ex = cx - length;
    if (!(cy > 0.0))
        return (span){1.0, 0.0}; /* no inside: the conditions below would let a half space through */
    span s = clip(clip((span){-INFINITY, INFINITY}, reach - l->z, -l->ez), reach + l->z, l->ez);
    s = clip(s, l->y, l->ey);
    s = clip(s, cy * l->x - cx * l->y, cy * l->ex - cx * l->ey);
    return clip(s, ex * l->y - cy * (l->x - length), ex * l->ey - cy * l->ex);
}

static inline double farther(double reached, span s)
{
    return s.from <= s.to && s.to > reached ? s.to : reached;
}

/**
 * How far from a (within reach of the lane) towards b (beyond it) the lane still reaches: a parameter in [0,
 * 1]. What lies within reach of a triangle is the union of a prism, three cylinders and three balls, and
 * convex; so the line leaves it where it leaves the last of them.
 */
static inline double qm_pack_reach_along(const qm_pack *pack, int lane, double reach2, qm_vec a, qm_vec b)
{
#define ROW(name) pack->row[QM_ROW_##name][lane]
    double length = ROW(L), cx = ROW(CX), cy = ROW(CY);
    double inverse_length2 = length > 0.0 ? 1.0 / (length * length) : 0.0;
    line l = line_in_lane(pack, lane, a, b);
    double reached = farther(0.0, over_inside(&l, length, cx, cy, sqrt(reach2)));
    reached = farther(reached, around_edge(&l, 0.0, 0.0, length, 0.0, inverse_length2, reach2));
    reached = farther(reached, around_edge(&l, 0.0, 0.0, cx, cy, ROW(INVERSE_C2), reach2));
    reached = farther(reached, around_edge(&l, length, 0.0, cx - length, cy, ROW(INVERSE_D2), reach2));
    reached = farther(reached, around_corner(&l, 0.0, 0.0, reach2));
    reached = farther(reached, around_corner(&l, length, 0.0, reach2));
    reached = farther(reached, around_corner(&l, cx, cy, reach2));
    return reached < 1.0 ? reached * INSIDE : 1.0;
#undef ROW
}

#endif
