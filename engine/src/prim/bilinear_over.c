/**
 * bilinear_over.c: how far a triangle, a plane polygon, or a part of another patch, lies from a bilinear patch, as one
 * bound.
 */
#include "bilinear_match.h"
#include "core/rounding.h"

/*
 * As a fraction of the longest Bezier point: what computing the bound from them may lose; the points
 * themselves are off by roundings of the coordinates, which are in eta (rounding.h). n is of length 1 to 4 u,
 * a height along it off by 3 u more, the component across by 5 u. The quadratic's six terms add 14 u, both
 * squares and the root 3 u: below 32 u.
 */
#define ROUNDINGS 0x1p-48

#define FOLD_MARGIN 1e-9       /* of the largest area: where a rectangle ends beside a fold */
#define MAX_SLOPE 1.0          /* of a patch over a polygon */
#define SIDE_ROUNDINGS 8.0     /* in units of u, of two products */
#define VIEW_ROUNDINGS 0x1p-45 /* of the greatest distance in a view */

/** Bezier points of a surface, or a difference of two, over a triangle: 0 to 2 at the corners, 3 + i across from corner i. */
typedef struct difference {
    qm_vec at[6];
} difference;

/** Maximum along an edge with Bezier points a, b, c where it lies inside; else the lower end. */
static double edge_max(double a, double b, double c)
{
    double bend = a - 2.0 * b + c, x = (a - b) / bend;
    if (!(bend < 0.0 && x > 0.0 && x < 1.0)) return qm_min(a, c);
    return a + x * (b - a);
}

/**
 * Value of a quadratic on a triangle at its stationary point, if that is inside; else that of a corner. It is
 * the value of all six terms at that point, which an error of the point changes by its square only: along a
 * ridge the point is ill-conditioned, but the ridge is as high all along, and reaches an edge.
 */
static double stationary_value(const double g[6])
{
    /* g = g0 + 2 (r, s).(x, y) + (x, y) M (x, y) over the weights x, y of corners 1 and 2 */
    double r = g[5] - g[0], s = g[4] - g[0];
    double xx = g[1] - 2.0 * g[5] + g[0], yy = g[2] - 2.0 * g[4] + g[0], xy = g[3] - g[4] - g[5] + g[0];
    double determinant = xx * yy - xy * xy;
    double x = (xy * s - yy * r) / determinant, y = (xy * r - xx * s) / determinant;
    if (!(x > 0.0 && y > 0.0 && x + y < 1.0)) return g[0];
    return g[0] + 2.0 * (r * x + s * y) + xx * x * x + 2.0 * xy * x * y + yy * y * y;
}

/** Maximum of a quadratic on a triangle. */
static double quadratic_max(const double g[6])
{
    double highest = stationary_value(g);
    for (int i = 0; i < 3; i++) {
        highest = qm_max(highest, g[i]);
        highest = qm_max(highest, edge_max(g[(i + 1) % 3], g[3 + i], g[(i + 2) % 3]));
    }
    return highest;
}

/** Bezier points of the patch over a triangle of its parameters. */
static difference over_triangle(const qm_bilinear *patch, const double *const uv[3])
{
    difference d;
    for (int i = 0; i < 3; i++) {
        d.at[i] = qm_bilinear_polar(patch, uv[i], uv[i]);
        d.at[3 + i] = qm_bilinear_polar(patch, uv[(i + 1) % 3], uv[(i + 2) % 3]);
    }
    return d;
}

/** The difference of a triangle and the patch under it, the parameters interpolated. */
static difference difference_make(const qm_bilinear *patch, const qm_vec *const corner[3],
                                  const double *const uv[3])
{
    difference d = over_triangle(patch, uv);
    for (int i = 0; i < 3; i++) {
        qm_vec middle = qm_vec_mix(*corner[(i + 1) % 3], *corner[(i + 2) % 3], 0.5);
        d.at[i] = qm_vec_sub(*corner[i], d.at[i]);
        d.at[3 + i] = qm_vec_sub(middle, d.at[3 + i]);
    }
    return d;
}

/** The greatest length of a difference: along its mean exactly, across by its Bezier points. */
static double difference_upper(const difference *d)
{
    qm_vec mean = {0, 0, 0};
    double size2 = 0.0;
    for (int i = 0; i < 6; i++) {
        mean = qm_vec_axpy(mean, i < 3 ? 1.0 : 2.0, d->at[i]);
        size2 = qm_max(size2, qm_vec_norm2(d->at[i]));
    }
    double size = sqrt(size2), length = qm_vec_norm(mean);
    if (!(length > 0.0)) return size;
    qm_vec n = qm_vec_scale(1.0 / length, mean);
    double along[6], across2 = 0.0, farthest = 0.0;
    for (int i = 0; i < 6; i++) {
        along[i] = qm_vec_dot(d->at[i], n);
        across2 = qm_max(across2, qm_vec_norm2(qm_vec_axpy(d->at[i], -along[i], n)));
        farthest = qm_max(farthest, -along[i]);
    }
    farthest = qm_max(farthest, quadratic_max(along));
    return sqrt(farthest * farthest + across2) + ROUNDINGS * size;
}

double qm_bilinear_triangle_upper(const qm_bilinear *patch, const qm_vec corner[3], const double uv[3][2])
{
    difference d = difference_make(patch, (const qm_vec *const[]){&corner[0], &corner[1], &corner[2]},
                                   (const double *const[]){uv[0], uv[1], uv[2]});
    return difference_upper(&d);
}

double qm_bilinear_rectangle_upper(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                                   const double uv[4][2])
{
    const double at[4][2] = {{box->low[0], box->low[1]},
                             {box->high[0], box->low[1]},
                             {box->high[0], box->high[1]},
                             {box->low[0], box->high[1]}};
    double upper = 0.0;
    for (int half = 0; half < 2; half++) {
        const int second = 1 + half, third = 2 + half;
        difference d = over_triangle(source, (const double *const[]){at[0], at[second], at[third]});
        difference under = over_triangle(target, (const double *const[]){uv[0], uv[second], uv[third]});
        for (int i = 0; i < 6; i++)
            d.at[i] = qm_vec_sub(d.at[i], under.at[i]);
        upper = qm_max(upper, difference_upper(&d));
    }
    return upper;
}

/* --- A polygon over the patch --- */

/** Coordinates across a direction, and along it. */
typedef struct seen_point {
    double x, y, height;
} seen_point;

/** A view along a direction of length 1, axis[2]. */
typedef struct view {
    qm_vec origin, axis[3];
    double size; /* the greatest distance of a point from the origin */
} view;

static seen_point see(view *from, qm_vec p)
{
    qm_vec d = qm_vec_sub(p, from->origin);
    from->size = qm_max(from->size, qm_vec_norm(d));
    return (seen_point){qm_vec_dot(d, from->axis[0]), qm_vec_dot(d, from->axis[1]),
                        qm_vec_dot(d, from->axis[2])};
}

/** A view along a vector; false when that is hardly longer than 0. */
static bool view_make(qm_vec origin, qm_vec direction, view *out)
{
    double length = qm_vec_norm(direction);
    if (!(length > QM_MIN_LENGTH)) return false;
    qm_vec z = qm_vec_scale(1.0 / length, direction);
    qm_vec other = fabs(z.x) < fabs(z.y) ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0};
    qm_vec across = qm_vec_cross(other, z);
    *out = (view){.origin = origin};
    out->axis[0] = qm_vec_scale(1.0 / qm_vec_norm(across), across);
    out->axis[1] = qm_vec_cross(z, out->axis[0]);
    out->axis[2] = z;
    return true;
}

/** Which side of the line from a to b a point is on, times the length of a b: positive when surely left, 0 when
 * roundings decide. */
static double side_of(const seen_point *a, const seen_point *b, const seen_point *p)
{
    double first = (b->x - a->x) * (p->y - a->y), second = (b->y - a->y) * (p->x - a->x);
    double side = first - second;
    return fabs(side) > SIDE_ROUNDINGS * QM_UNIT_ROUNDING * (fabs(first) + fabs(second)) ? side : 0.0;
}

static double segment_distance(const seen_point *a, const seen_point *b, const seen_point *p)
{
    double dx = b->x - a->x, dy = b->y - a->y, px = p->x - a->x, py = p->y - a->y;
    double length2 = dx * dx + dy * dy;
    double t = length2 > 0.0 ? qm_clamp((px * dx + py * dy) / length2, 0.0, 1.0) : 0.0;
    px -= t * dx;
    py -= t * dy;
    return sqrt(px * px + py * py);
}

/** Distance of a point from a convex quad, by their coordinates across; turn is 1 when it is counterclockwise, -1
 * otherwise. */
static double quad_distance(const seen_point quad[4], double turn, const seen_point *p)
{
    bool is_inside = true;
    double nearest = INFINITY;
    for (int i = 0; i < 4; i++) {
        const seen_point *a = &quad[i], *b = &quad[(i + 1) % 4];
        is_inside &= turn * side_of(a, b, p) > 0.0;
        nearest = qm_min(nearest, segment_distance(a, b, p));
    }
    return is_inside ? 0.0 : nearest;
}

/** 1 or -1 when all four corners of a quad surely turn that way: it is then convex. Else 0. */
static double turn_of(const seen_point quad[4])
{
    double turn = side_of(&quad[0], &quad[1], &quad[2]) > 0.0 ? 1.0 : -1.0;
    for (int i = 0; i < 4; i++)
        if (!(turn * side_of(&quad[i], &quad[(i + 1) % 4], &quad[(i + 2) % 4]) > 0.0)) return 0.0;
    return turn;
}

/** A rectangle of the patch in a view: its corners, and which way they turn. */
typedef struct seen_quad {
    seen_point corner[4];
    double turn, slope; /* slope: of the surface over the plane of the view, at most */
} seen_quad;

/** The slope at a corner, rounded up: that of the plane of its two sides. */
static double slope_at_corner(const seen_point *before, const seen_point *here, const seen_point *after)
{
    double ax = here->x - before->x, ay = here->y - before->y, az = here->height - before->height;
    double bx = after->x - here->x, by = after->y - here->y, bz = after->height - here->height;
    double area = fabs(ax * by - ay * bx), part = fabs(ax * by) + fabs(ay * bx);
    double x = ay * bz - az * by, y = az * bx - ax * bz;
    double off = fabs(ay * bz) + fabs(az * by) + fabs(az * bx) + fabs(ax * bz);
    double margin = SIDE_ROUNDINGS * QM_UNIT_ROUNDING;
    return (sqrt(x * x + y * y) + margin * off) / (area - margin * part) * (1.0 + 0x1p-40);
}

/** The rectangle in a view; false when its outline is not surely convex. */
static bool quad_make(const qm_vec corner[4], view *along, seen_quad *quad)
{
    for (int i = 0; i < 4; i++)
        quad->corner[i] = see(along, corner[i]);
    quad->turn = turn_of(quad->corner);
    if (quad->turn == 0.0) return false;
    quad->slope = 0.0;
    for (int i = 0; i < 4; i++)
        quad->slope = qm_max(quad->slope, slope_at_corner(&quad->corner[(i + 3) % 4], &quad->corner[i],
                                                          &quad->corner[(i + 1) % 4]));
    return true;
}

/** The normal of the largest triangle of a fan. */
static qm_vec fan_normal(int count, const qm_vec corner[])
{
    qm_vec largest = {0, 0, 0};
    for (int i = 1; i + 1 < count; i++) {
        qm_vec normal = qm_vec_cross(qm_vec_sub(corner[i], corner[0]), qm_vec_sub(corner[i + 1], corner[0]));
        if (qm_vec_norm2(normal) > qm_vec_norm2(largest)) largest = normal;
    }
    return largest;
}

/** Greatest height of the polygon over the patch, with the parameters of its corners interpolated in each
 * triangle of the fan; across becomes how far the points of both are apart across the direction, at most. */
static double interpolated_height(const qm_bilinear *patch, int count, const qm_vec corner[],
                                  const double uv[][2], qm_vec n, double *across)
{
    double height = 0.0, across2 = 0.0;
    for (int i = 1; i + 1 < count; i++) {
        difference d = difference_make(patch, (const qm_vec *const[]){&corner[0], &corner[i], &corner[i + 1]},
                                       (const double *const[]){uv[0], uv[i], uv[i + 1]});
        double above[6], below[6];
        for (int k = 0; k < 6; k++) {
            above[k] = qm_vec_dot(d.at[k], n);
            below[k] = -above[k];
            across2 = qm_max(across2, qm_vec_norm2(qm_vec_axpy(d.at[k], -above[k], n)));
        }
        height = qm_max(height, qm_max(quadratic_max(above), quadratic_max(below)));
    }
    *across = sqrt(across2);
    return height;
}

/**
 * Cuts a rectangle off where the patch turns over, as seen along a direction: twice the area of the corners' triangles
 * there is linear along each side. The cut is across the axis, and from the end, that leave most; false when the patch
 * turns over at both ends of both.
 */
static bool keep_one_sheet(const qm_vec corner[4], qm_vec direction, qm_uv_box *box)
{
    static const int sides[2][2][2] = {{{0, 1}, {3, 2}},
                                       {{0, 3}, {1, 2}}}; /* along an axis: from low to high */
    double area[4], largest = 0.0, most = 0.0;
    for (int i = 0; i < 4; i++) {
        qm_vec before = qm_vec_sub(corner[i], corner[(i + 3) % 4]),
               after = qm_vec_sub(corner[(i + 1) % 4], corner[i]);
        area[i] = qm_vec_dot(qm_vec_cross(before, after), direction);
        if (fabs(area[i]) > fabs(largest)) largest = area[i];
    }
    int axis = 0, end = 0;
    for (int k = 0; k < 4; k++) {
        double share = 1.0;
        for (int i = 0; i < 2; i++) {
            const int *side = sides[k / 2][i];
            double here = area[side[k % 2]] / largest, there = area[side[1 - k % 2]] / largest;
            if (there < FOLD_MARGIN) share = qm_min(share, (here - FOLD_MARGIN) / (here - there));
            if (!(here > FOLD_MARGIN)) share = 0.0;
        }
        if (!(share > most)) continue;
        most = share;
        axis = k / 2;
        end = k % 2;
    }
    if (!(most > 0.0)) return false;
    double *from = end ? box->high : box->low, *to = end ? box->low : box->high;
    to[axis] = from[axis] + most * (to[axis] - from[axis]);
    return true;
}

/*
 * The proof. Let n be any direction, and R any rectangle of the parameters, a bilinear patch itself. Let the
 * outline of R turn the same way at all four corners, as seen along n. Four turns of less than half a turn add up
 * to whole turns, here to one: the outline is convex, and the view of R fills its inside K, each point once: the
 * Jacobian, linear in s and t, is at the corners the turn there, so that it has one sign. So R is a surface over
 * K, of a height z along n. Its slope is |N'| / J, where N = Q_s x Q_t, N' is its part across n and J that along
 * n. All are linear, since w x w = 0; |N'| <= c J then holds in all of R if it does at its corners, and slope, the
 * largest of a corner, bounds it.
 *
 * Let p be a point of the polygon. The distance of its view from K is convex, and so at most the largest of a
 * corner, e. Let q be the point of R over the nearest point of K. Across n it is e from p at most. Along n
 *   - p is between the heights of the corners of the polygon, and q between those of the corners of R; and
 *   - where R holds the parameters of all corners, let r be the point of R with the interpolated ones: p - r has a
 *     height of at most h, and a part across n of at most a. Going to the nearest point of K, which is convex, moves
 *     no two points apart, and leaves the view of r where it is: from there to the view of q it is a at most,
 *     inside K, and p - q has a height of at most h + slope a.
 * The smaller of both and e are the sides of a right angle, whose third side is the bound. For any n and R; along
 * the normal of the polygon, or that of R, and with R under the polygon, slope is small, and a counts by its product
 * with the slope. Nothing is lost to the twist in the plane, as where two corners of a patch coincide. Where the
 * rectangle under the polygon is folded, R is what is left of it on one side of the fold; beside a fold the slope
 * has no bound, and heights alone count.
 *
 * Roundings, D being the greatest distance of a corner from the origin of the view. The view is a linear map, as
 * rounded; it moves points of a length D by 14 u D, being not quite orthonormal, and rounding its coordinates
 * moves them by 7 u D: 42 u D for p and q, and 42 u D as R is then not quite the surface that r is on. For these
 * points exactly: a product of two differences is off by 3 u of it, so that the sign of a difference of two is
 * certain from SIDE_ROUNDINGS u of both, and the slope rounded up. A point that is not surely inside is at
 * a distance from an edge that is off by 8 u D; heights are off by 2 u D, h by 14 u D, e and a times a slope up to
 * MAX_SLOPE by 40 u D, root and squares by 3 u of 4 D. All together 160 u D, below VIEW_ROUNDINGS D.
 * A corner that turned the wrong way by roundings alone would turn the right way after a move of 32 u D, which
 * VIEW_ROUNDINGS has room for: so no test can tell whether SIDE_ROUNDINGS is there, but this proof needs it.
 */
static double upper_along(const qm_bilinear *patch, qm_uv_box under, qm_vec direction, int count,
                          const qm_vec corner[], const double uv[][2])
{
    view along;
    seen_quad quad;
    qm_vec outline[4];
    if (!view_make(corner[0], direction, &along)) return INFINITY;
    qm_uv_box_corners(patch, &under, outline);
    bool is_whole = quad_make(outline, &along, &quad);
    if (!is_whole) {
        if (!keep_one_sheet(outline, along.axis[2], &under)) return INFINITY;
        qm_uv_box_corners(patch, &under, outline);
        if (!quad_make(outline, &along, &quad)) return INFINITY;
    }
    double lowest = INFINITY, highest = -INFINITY, beyond = 0.0, height = 0.0;
    for (int i = 0; i < 4; i++) {
        lowest = qm_min(lowest, quad.corner[i].height);
        highest = qm_max(highest, quad.corner[i].height);
    }
    for (int i = 0; i < count; i++) {
        seen_point p = see(&along, corner[i]);
        beyond = qm_max(beyond, quad_distance(quad.corner, quad.turn, &p));
        height = qm_max(height, qm_max(highest - p.height, p.height - lowest));
    }
    if (is_whole && quad.slope <= MAX_SLOPE) {
        double across, interpolated = interpolated_height(patch, count, corner, uv, along.axis[2], &across);
        height = qm_min(height, interpolated + quad.slope * across);
    }
    return sqrt(beyond * beyond + height * height) + VIEW_ROUNDINGS * along.size;
}

/** The greatest distance of a corner from the points of a segment from a to a + d that are nearest to them. */
static double segment_upper(qm_vec a, qm_vec d, int count, const qm_vec corner[])
{
    double length2 = qm_vec_norm2(d), farthest2 = 0.0, size2 = length2;
    for (int i = 0; i < count; i++) {
        qm_vec p = qm_vec_sub(corner[i], a);
        double t = length2 > 0.0 ? qm_clamp(qm_vec_dot(p, d) / length2, 0.0, 1.0) : 0.0;
        farthest2 = qm_max(farthest2, qm_vec_norm2(qm_vec_axpy(p, -t, d)));
        size2 = qm_max(size2, qm_vec_norm2(p));
    }
    return sqrt(farthest2) + ROUNDINGS * sqrt(size2);
}

/**
 * The patch is made of segments, along which one parameter is constant. The distance from a segment is convex, so
 * that no point of a polygon is farther from it than a corner is. Of the segments at the sides of the rectangle,
 * the nearest: of a sliver along a side of the patch, or a narrow tip, this holds all.
 */
static double segments_upper(const qm_bilinear *patch, const qm_uv_box *box, int count, const qm_vec corner[])
{
    double upper = INFINITY;
    for (int i = 0; i < 2; i++) {
        double u = i ? box->high[0] : box->low[0], v = i ? box->high[1] : box->low[1];
        qm_vec along_v = qm_vec_axpy(patch->e2, u, patch->w), along_u = qm_vec_axpy(patch->e1, v, patch->w);
        upper = qm_min(upper, segment_upper(qm_bilinear_at(patch, u, 0.0), along_v, count, corner));
        upper = qm_min(upper, segment_upper(qm_bilinear_at(patch, 0.0, v), along_u, count, corner));
    }
    return upper;
}

/** The smaller of the bounds along the normal of the polygon and along that of the patch under it. */
static double polygon_upper(const qm_bilinear *patch, int count, const qm_vec corner[], const double uv[][2],
                            double enough)
{
    qm_uv_box under = {{1.0, 1.0}, {0.0, 0.0}};
    for (int i = 0; i < count; i++)
        for (int k = 0; k < 2; k++) {
            under.low[k] = qm_min(under.low[k], uv[i][k]);
            under.high[k] = qm_max(under.high[k], uv[i][k]);
        }
    double upper = segments_upper(patch, &under, count, corner);
    if (upper <= enough) return upper;
    upper = qm_min(upper, upper_along(patch, under, fan_normal(count, corner), count, corner, uv));
    if (upper <= enough) return upper;
    qm_vec outline[4];
    qm_uv_box_corners(patch, &under, outline);
    qm_vec normal = qm_vec_cross(qm_vec_sub(outline[2], outline[0]), qm_vec_sub(outline[3], outline[1]));
    return qm_min(upper, upper_along(patch, under, normal, count, corner, uv));
}

double qm_bilinear_polygon_upper(const qm_bilinear *patch, int count, const qm_vec corner[],
                                 const double uv[][2], double enough)
{
    QM_ASSERT(count >= 3);
    double upper = 0.0;
    for (int i = 1; i + 1 < count; i++) {
        const qm_vec triangle[3] = {corner[0], corner[i], corner[i + 1]};
        const double feet[3][2] = {{uv[0][0], uv[0][1]}, {uv[i][0], uv[i][1]}, {uv[i + 1][0], uv[i + 1][1]}};
        upper = qm_max(upper, qm_bilinear_triangle_upper(patch, triangle, feet));
    }
    return upper <= enough ? upper : qm_min(upper, polygon_upper(patch, count, corner, uv, enough));
}
