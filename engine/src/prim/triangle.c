#include "triangle.h"

/* ---- a triangle and a point ---- */

static qm_vec any_perpendicular(qm_vec x)
{
    qm_vec y = qm_vec_perpendicular(x);
    return qm_vec_scale(1.0 / qm_vec_norm(y), y);
}

/** Unit vector in the plane towards third, at a right angle to x; any perpendicular one when the height is
 * negligible. */
static qm_vec height_direction(qm_vec third, qm_vec x, double length)
{
    qm_vec y = qm_vec_axpy(third, -qm_vec_dot(third, x), x);
    double height = qm_vec_norm(y);
    if (!(height > 0x1p-50 * length)) return any_perpendicular(x);
    y = qm_vec_scale(1.0 / height, y);
    y = qm_vec_axpy(y, -qm_vec_dot(y, x), x); /* once more: the first pass cancels on slivers */
    return qm_vec_scale(1.0 / qm_vec_norm(y), y);
}

qm_triangle qm_triangle_make(qm_vec a, qm_vec b, qm_vec c)
{
    const qm_vec corner[5] = {a, b, c, a, b};
    int first = 0;
    double longest2 = -1.0;
    for (int i = 0; i < 3; i++) {
        double edge2 = qm_vec_norm2(qm_vec_sub(corner[i + 1], corner[i]));
        if (edge2 > longest2) {
            longest2 = edge2;
            first = i;
        }
    }
    /* A shorter triangle is a point: the square of its length has too few digits to normalize an edge by. */
    bool is_long = longest2 > QM_MIN_LENGTH * QM_MIN_LENGTH;
    qm_triangle t = {.origin = corner[first], .first = first, .length = is_long ? sqrt(longest2) : 0.0};
    qm_vec third = is_long ? qm_vec_sub(corner[first + 2], t.origin) : (qm_vec){0, 0, 0};
    t.x = is_long ? qm_vec_scale(1.0 / t.length, qm_vec_sub(corner[first + 1], t.origin)) : (qm_vec){1, 0, 0};
    t.y = height_direction(third, t.x, t.length);
    t.z = qm_vec_cross(t.x, t.y);
    t.cx = qm_vec_dot(third, t.x);
    t.cy = qm_vec_dot(third, t.y);
    double c2 = t.cx * t.cx + t.cy * t.cy;
    double d2 = (t.cx - t.length) * (t.cx - t.length) + t.cy * t.cy;
    t.inverse_c2 = c2 > 0.0 ? 1.0 / c2 : 0.0;
    t.inverse_d2 = d2 > 0.0 ? 1.0 / d2 : 0.0;
    return t;
}

/** The footpoint in the plane of the triangle: returns the squared distance in the plane; weights of the
 * three corners. */
static double plane_footpoint(const qm_triangle *t, double x, double y, double weight[3])
{
    double ex = t->cx - t->length, xl = x - t->length;
    if (y > 0.0 && t->cy * x - t->cx * y > 0.0 && ex * y - t->cy * xl > 0.0) {
        double third = qm_clamp(y / t->cy, 0.0, 1.0);
        double second = qm_clamp((x - third * t->cx) / t->length, 0.0, 1.0 - third);
        weight[0] = fmax(0.0, 1.0 - second - third);
        weight[1] = second;
        weight[2] = third;
        return 0.0;
    }
    double foot = qm_clamp(x, 0.0, t->length), ax = x - foot;
    double best = ax * ax + y * y;
    weight[1] = t->length > 0.0 ? qm_clamp(foot / t->length, 0.0, 1.0) : 0.0;
    weight[0] = 1.0 - weight[1];
    weight[2] = 0.0;

    double r = qm_clamp((x * t->cx + y * t->cy) * t->inverse_c2, 0.0, 1.0);
    double bx = x - r * t->cx, by = y - r * t->cy, along_c2 = bx * bx + by * by;
    if (along_c2 < best) {
        best = along_c2;
        weight[0] = 1.0 - r;
        weight[1] = 0.0;
        weight[2] = r;
    }
    double s = qm_clamp((xl * ex + y * t->cy) * t->inverse_d2, 0.0, 1.0);
    double gx = xl - s * ex, gy = y - s * t->cy, along_d2 = gx * gx + gy * gy;
    if (along_d2 < best) {
        best = along_d2;
        weight[0] = 0.0;
        weight[1] = 1.0 - s;
        weight[2] = s;
    }
    return best;
}

double qm_triangle_distance2(const qm_triangle *t, qm_vec p)
{
    qm_vec d = qm_vec_sub(p, t->origin);
    double weight[3], z = qm_vec_dot(d, t->z);
    return plane_footpoint(t, qm_vec_dot(d, t->x), qm_vec_dot(d, t->y), weight) + z * z;
}

void qm_triangle_footpoint(const qm_triangle *t, qm_vec p, double weight[3])
{
    qm_vec d = qm_vec_sub(p, t->origin);
    double rotated[3];
    plane_footpoint(t, qm_vec_dot(d, t->x), qm_vec_dot(d, t->y), rotated);
    for (int i = 0; i < 3; i++)
        weight[(t->first + i) % 3] = rotated[i];
}

/* ---- two triangles ---- */

/** Candidates at a corner of the other triangle. */
static void try_corners(const qm_vec triangle[3], const qm_vec other[3], int side, qm_triangle_gap *gap)
{
    qm_triangle frame = qm_triangle_make(triangle[0], triangle[1], triangle[2]);
    for (int i = 0; i < 3; i++) {
        double distance = sqrt(qm_triangle_distance2(&frame, other[i]));
        if (!(distance < gap->distance)) continue;
        gap->distance = distance;
        qm_triangle_footpoint(&frame, other[i], gap->weight[side]);
        for (int k = 0; k < 3; k++)
            gap->weight[1 - side][k] = k == i;
    }
}

static void set_edge(double weight[3], int i, double t)
{
    weight[i] = 1.0 - t;
    weight[(i + 1) % 3] = t;
    weight[(i + 2) % 3] = 0.0;
}

/**
 * Edges i of a and k of b where both are nearest inside; else a corner is as near. With h the angle of the
 * edges the point on a is off by some u / h, since the cross product is; the footpoint of that point on b is
 * then off by as much along b, so that the two stay opposite each other and their distance grows by h times
 * u / h. (Two points found independently would be off by u / h from each other.)
 */
static void try_edges(const qm_vec a[3], int i, const qm_vec b[3], int k, qm_triangle_gap *gap)
{
    qm_vec u = qm_vec_sub(a[(i + 1) % 3], a[i]), v = qm_vec_sub(b[(k + 1) % 3], b[k]);
    qm_vec n = qm_vec_cross(u, v), r = qm_vec_sub(b[k], a[i]);
    double size = qm_vec_norm2(n), length2 = qm_vec_norm2(v);
    if (!(size > 0.0)) return;
    double s = qm_clamp(qm_vec_dot(qm_vec_cross(r, v), n) / size, 0.0, 1.0);
    qm_vec from_b = qm_vec_sub(qm_vec_scale(s, u), r);
    double t = qm_clamp(qm_vec_dot(from_b, v) / length2, 0.0, 1.0);
    double distance = qm_vec_norm(qm_vec_axpy(from_b, -t, v));
    if (!(distance < gap->distance)) return;
    gap->distance = distance;
    set_edge(gap->weight[0], i, s);
    set_edge(gap->weight[1], k, t);
}

qm_triangle_gap qm_triangle_find_gap(const qm_vec a[3], const qm_vec b[3])
{
    qm_triangle_gap gap = {.distance = INFINITY};
    try_corners(a, b, 0, &gap);
    try_corners(b, a, 1, &gap);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            try_edges(a, i, b, k, &gap);
    return gap;
}
