#include "tri_point.h"

static qm_vec any_perpendicular(qm_vec x)
{
    qm_vec axis = fabs(x.x) < 0.6 ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0};
    qm_vec y = qm_vec_cross(x, axis);
    return qm_vec_scale(1.0 / qm_vec_norm(y), y);
}

/** Unit vector in the plane towards third, at a right angle to x; any one when there is no height to speak
 * of. */
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
    /* A shorter one is a point: the square of its length has too few digits to normalize an edge by. */
    bool is_long = longest2 > QM_LEAST_LENGTH * QM_LEAST_LENGTH;
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

/** The footpoint in the plane of the triangle: squared distance in the plane and weights of the three
 * corners. */
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
    double turned[3];
    plane_footpoint(t, qm_vec_dot(d, t->x), qm_vec_dot(d, t->y), turned);
    for (int i = 0; i < 3; i++)
        weight[(t->first + i) % 3] = turned[i];
}
