/**
 * bilinear_hull.c: how near a bilinear patch can be to a point, by its four corners alone.
 */
#include "bilinear.h"
#include "triangle.h"

/* As a fraction of the lengths that a height comes from: an edge and each of three products and two sums are
 * rounded once, a direction has length 1 to within 4 u; together below 9 u of the sum of the edge's
 * coordinates. */
#define ROUNDINGS 0x1p-49
#define THIN 0.25 /* fraction of the flatness bound: a hull this thin bounds the patch better */

/** The four faces of the hull, first the triangles of the patch. */
static const int faces[4][3] = {{0, 1, 2}, {0, 2, 3}, {0, 1, 3}, {1, 2, 3}};

/** The nearest to p of the faces visited so far. */
typedef struct nearest_face {
    double distance2;
    int face;
    qm_triangle triangle;
} nearest_face;

static void visit_face(const qm_vec c[4], int face, qm_vec p, nearest_face *nearest)
{
    const int *corner = faces[face];
    qm_triangle triangle = qm_triangle_make(c[corner[0]], c[corner[1]], c[corner[2]]);
    double here = qm_triangle_distance2(&triangle, p);
    if (here < nearest->distance2) *nearest = (nearest_face){here, face, triangle};
}

double qm_bilinear_hull_width(const qm_vec corner[4], qm_vec direction)
{
    double low = 0.0, high = 0.0, size = 0.0;
    for (int i = 1; i < 4; i++) {
        qm_vec edge = qm_vec_sub(corner[i], corner[0]);
        double height = qm_vec_dot(edge, direction);
        low = fmin(low, height);
        high = fmax(high, height);
        size += fabs(edge.x) + fabs(edge.y) + fabs(edge.z);
    }
    return high - low + ROUNDINGS * size;
}

/**
 * Thickness of the hull, rounded up: how far a point of it can be from its faces at most. A line through the
 * point along any direction leaves the hull within the width of the hull along it. The width is smallest
 * along the common normal of the diagonals; where they are nearly parallel, that normal is lost, but then the
 * hull is thin across the longer: as seen along the longer diagonal, the other one is the base of a triangle,
 * whose width across its base's middle line is at most that base, length / longer.
 */
static double thickness_of(const qm_vec c[4])
{
    qm_vec first = qm_vec_sub(c[2], c[0]), second = qm_vec_sub(c[3], c[1]);
    qm_vec normal = qm_vec_cross(first, second);
    double length = qm_vec_norm(normal), longer = sqrt(fmax(qm_vec_norm2(first), qm_vec_norm2(second)));
    if (longer == 0.0) return qm_vec_distance(c[0], c[1]);
    double thin = length / longer + ROUNDINGS * longer;
    if (!(length > 0.0)) return thin;
    return fmin(thin, qm_bilinear_hull_width(c, qm_vec_scale(1.0 / length, normal)));
}

/** The footpoint of p on a face: returns its position; fraction gets its parameters. */
static qm_vec footpoint_on(const qm_vec c[4], const nearest_face *nearest, qm_vec p, double fraction[2])
{
    double weight[3];
    qm_vec foot = {0, 0, 0};
    qm_triangle_footpoint(&nearest->triangle, p, weight);
    fraction[0] = fraction[1] = 0.0;
    for (int i = 0; i < 3; i++) {
        int k = faces[nearest->face][i];
        foot = qm_vec_axpy(foot, weight[i], c[k]);
        if (k == 1 || k == 2) fraction[0] += weight[i];
        if (k >= 2) fraction[1] += weight[i];
    }
    for (int i = 0; i < 2; i++)
        fraction[i] = qm_clamp(fraction[i], 0.0, 1.0);
    return foot;
}

/** How far p lies beyond the farthest corner in the direction from a point to p: at most the distance to the
 * hull, whatever the point is, and equal to it when the point is the nearest of the hull. */
static double distance_beyond(const qm_vec c[4], qm_vec from, qm_vec p)
{
    qm_vec away = qm_vec_sub(p, from);
    double length = qm_vec_norm(away), beyond = INFINITY;
    if (!(length > 0.0)) return 0.0;
    away = qm_vec_scale(1.0 / length, away);
    for (int i = 0; i < 4; i++)
        beyond = fmin(beyond, qm_vec_dot(away, qm_vec_sub(p, c[i])));
    return beyond;
}

double qm_bilinear_hull_lower(const qm_vec corner[4], qm_vec p, double twist, double enough,
                              double fraction[2])
{
    nearest_face nearest = {.distance2 = INFINITY};
    fraction[0] = fraction[1] = 0.5;
    double beyond = distance_beyond(corner, qm_vec_centroid(corner, 4), p);
    if (beyond >= enough) return fmax(0.0, beyond);
    visit_face(corner, 0, p, &nearest);
    visit_face(corner, 1, p, &nearest);
    double lower = sqrt(nearest.distance2) - twist;
    if (lower >= enough) return fmax(0.0, lower);
    double thickness = thickness_of(corner);
    if (thickness < THIN * twist) {
        visit_face(corner, 2, p, &nearest);
        visit_face(corner, 3, p, &nearest);
        lower = fmax(lower, sqrt(nearest.distance2) - thickness);
        lower = fmax(lower, distance_beyond(corner, footpoint_on(corner, &nearest, p, fraction), p));
    } else {
        footpoint_on(corner, &nearest, p, fraction);
    }
    return fmax(0.0, lower);
}
