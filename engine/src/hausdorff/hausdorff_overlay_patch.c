/**
 * hausdorff_overlay_patch.c: the vertical distance of a rectangle of a bilinear patch from the facets over it, and of a face
 * from the patches over it.
 *
 * Seen along the axis of an overlay's frame, the height of a point of the rectangle above the plane of a facet is a linear
 * function of the point, and so bilinear in the parameters s and t. So is the doubled area of the point and an edge of the
 * facet, which is at least 0 inside of the edge. The bound is the largest height above the facet's plane of all points of the
 * rectangle that are over the facet: no slack is lost to the bend of the patch.
 *
 * Over a box of half sizes a and b about (s0, t0), a bilinear function is f + (s - s0) f_s + (t - t0) f_t + (s - s0) (t - t0) w,
 * with its values at the centre: it is at most the linear function f + (s - s0) f_s + (t - t0) f_t + |w| a b. Where that is below
 * 0 for one of the edges, no point of the box is over the facet. So the box is clipped to a convex polygon by three linear
 * functions, which holds all of the box that is over the facet. The box of the polygon is smaller, and what the linear functions
 * lose falls with its area: a few rounds leave hardly more than what is over the facet.
 *
 * A bilinear function has no extremum inside a polygon: from any point it is linear along s, so that one of both ways it
 * does not fall, up to an edge. Along an edge it is quadratic, and its extremum is known.
 *
 * Over a facet that is steep the distance is much less than the vertical one. It is a convex function of the point, and each
 * point of the polygon is between two on its edges, along a line of constant t, along which the patch is straight. So none
 * is farther than the farthest Bezier point of an edge: its ends, and the polar form of both.
 *
 * A face of the source over patches of the target is the same the other way round: the height of a patch over the plane of the
 * face, where it is over the face. Which points of the face have a point of a patch over them is shown as for the flatness bound,
 * by the facets (hausdorff_overlay.c).
 *
 * A rectangle whose corners turn the same way, as seen along the axis, lies over the two triangles (c0 c1 c2) and (c0 c2 c3),
 * which fill its convex hull. So each of its points has a facet over it where an odd number of facets is over a point of either
 * triangle, and no edge of the boundary of the facets over their insides (hausdorff_overlay.c).
 *
 * Roundings, s being the greatest coordinate. A doubled area at a corner is off by less than QM_OVERLAY_AREA u s^2, a height
 * above a plane by plane_error s. The clipped values are sums of a few of these with weights up to 1: off by 32 u of the largest.
 * Half planes are taken wider by both, twice: the place where a computed value vanishes along an edge is then beyond the place
 * where the true one does. The parameters of corners of polygons are off by 4 u, and heights there by 4 u of their range over
 * the rectangle for each; with 16 u for computing one from four corners and 16 u for the extremum of an edge, below HEIGHT_ROUNDINGS of
 * the largest height of a corner. The distance of a point from a triangle is off by 240 u s (triangle.h), a Bezier point by less than
 * 32 u s, and the polygon's corners move it by 4 u of the range again: below DISTANCE_ROUNDINGS u s.
 */
#include "hausdorff_overlay.h"

#include "core/rounding.h"
#include "prim/bilinear.h"
#include "prim/triangle.h"

#define CLIP_ROUNDINGS 64.0
#define HEIGHT_ROUNDINGS 64.0
#define DISTANCE_ROUNDINGS 512.0
#define MAX_ROUNDS 5   /* of clipping a box */
#define MIN_SHRINK 0.8 /* of the area: a round that leaves more is the last one */
#define MAX_CORNERS 8

/** A function that is bilinear over the unit square, by its values at (0, 0), (1, 0), (1, 1), (0, 1). */
typedef struct bilinear_function {
    double at[4];
} bilinear_function;

typedef struct clipped_polygon {
    int count;
    double at[MAX_CORNERS][2];
} clipped_polygon;

static double value_at(const bilinear_function *f, double s, double t)
{
    double low = f->at[0] + s * (f->at[1] - f->at[0]), high = f->at[3] + s * (f->at[2] - f->at[3]);
    return low + t * (high - low);
}

static double largest_of(const bilinear_function *f)
{
    return qm_max(qm_max(fabs(f->at[0]), fabs(f->at[1])), qm_max(fabs(f->at[2]), fabs(f->at[3])));
}

static double twist_of(const bilinear_function *f)
{
    return (f->at[0] - f->at[1]) + (f->at[2] - f->at[3]);
}

/** Cuts off what is certainly below 0 in a box. */
static void clip(const bilinear_function *f, double margin, const double low[2], const double high[2],
                 clipped_polygon *polygon)
{
    double s = 0.5 * (low[0] + high[0]), t = 0.5 * (low[1] + high[1]), w = twist_of(f);
    double along_s = f->at[1] - f->at[0] + t * w, along_t = f->at[3] - f->at[0] + s * w;
    double most = value_at(f, s, t) + 0.25 * fabs(w) * (high[0] - low[0]) * (high[1] - low[1]) + margin;
    double value[MAX_CORNERS];
    int count = polygon->count;
    for (int i = 0; i < count; i++)
        value[i] = most + (polygon->at[i][0] - s) * along_s + (polygon->at[i][1] - t) * along_t;
    clipped_polygon out = {.count = 0};
    for (int i = 0; i < count; i++) {
        int next = (i + 1) % count;
        if (!(value[i] < 0.0)) {
            QM_ASSERT(out.count < MAX_CORNERS);
            out.at[out.count][0] = polygon->at[i][0];
            out.at[out.count++][1] = polygon->at[i][1];
        }
        if ((value[i] < 0.0) == (value[next] < 0.0)) continue;
        double share = value[i] / (value[i] - value[next]);
        QM_ASSERT(out.count < MAX_CORNERS);
        for (int k = 0; k < 2; k++)
            out.at[out.count][k] = polygon->at[i][k] + share * (polygon->at[next][k] - polygon->at[i][k]);
        out.count++;
    }
    *polygon = out;
}

/** The greatest value by magnitude on the edges of a polygon, but for roundings. */
static double largest_on(const bilinear_function *f, const clipped_polygon *polygon)
{
    double w = twist_of(f), largest = 0.0;
    for (int i = 0; i < polygon->count; i++) {
        const double *p = polygon->at[i], *q = polygon->at[(i + 1) % polygon->count];
        double here = value_at(f, p[0], p[1]), there = value_at(f, q[0], q[1]);
        double bend = w * (q[0] - p[0]) * (q[1] - p[1]), rise = there - here - bend;
        largest = qm_max(largest, fabs(here));
        if (rise * bend < 0.0 && fabs(rise) < 2.0 * fabs(bend))
            largest = qm_max(largest, fabs(here - 0.25 * rise * rise / bend));
    }
    return largest;
}

/** The greatest height, by magnitude, over the points of the rectangle that lie inside of three edges; improved until it is
 * at most enough, or cannot be. Negative where there are none. polygon becomes one that holds them. */
static double largest_inside(const bilinear_function *height, const bilinear_function inside[3],
                             const double margin[3], double enough, clipped_polygon *polygon)
{
    double low[2] = {0.0, 0.0}, high[2] = {1.0, 1.0}, largest = INFINITY;
    for (int round = 0; round < MAX_ROUNDS; round++) {
        *polygon = (clipped_polygon){
            4, {{low[0], low[1]}, {high[0], low[1]}, {high[0], high[1]}, {low[0], high[1]}}};
        for (int k = 0; k < 3 && polygon->count > 0; k++)
            clip(&inside[k], margin[k], low, high, polygon);
        if (polygon->count == 0) return -1.0;
        largest = qm_min(largest, largest_on(height, polygon));
        double area = (high[0] - low[0]) * (high[1] - low[1]);
        for (int k = 0; k < 2; k++) {
            low[k] = high[k] = polygon->at[0][k];
            for (int i = 1; i < polygon->count; i++) {
                low[k] = qm_min(low[k], polygon->at[i][k]);
                high[k] = qm_max(high[k], polygon->at[i][k]);
            }
        }
        if (largest <= enough || !((high[0] - low[0]) * (high[1] - low[1]) <= MIN_SHRINK * area)) break;
    }
    return largest;
}

static qm_vec point_of(const double at[3])
{
    return (qm_vec){at[0], at[1], at[2]};
}

/** The greatest distance from a facet of the points of a polygon, by the Bezier points of its edges. */
static double largest_distance(const double corner[4][3], const clipped_polygon *polygon,
                               const double facet[3][3])
{
    const qm_vec c[4] = {point_of(corner[0]), point_of(corner[1]), point_of(corner[2]), point_of(corner[3])};
    qm_bilinear patch = qm_bilinear_make(c);
    qm_triangle triangle = qm_triangle_make(point_of(facet[0]), point_of(facet[1]), point_of(facet[2]));
    double farthest2 = 0.0;
    for (int i = 0; i < polygon->count; i++) {
        int next = (i + 1) % polygon->count;
        const double *p[2] = {polygon->at[i], polygon->at[next]};
        for (int k = 0; k < 2; k++) /* the corner, and the middle point of the edge to the next one */
            farthest2 =
                qm_max(farthest2, qm_triangle_distance2(&triangle, qm_bilinear_polar(&patch, p[0], p[k])));
    }
    return sqrt(farthest2);
}

/** A facet's corners, and whether its box meets that of the rectangle. */
static bool load_facet(const qm_overlay_facets *facets, int index, const double corner[4][3],
                       double facet[3][3])
{
    int group = index / QM_PACK_LANES, lane = index % QM_PACK_LANES;
    for (int i = 0; i < 9; i++)
        facet[i / 3][i % 3] = facets->group[group].at[i / 3][i % 3][lane];
    for (int k = 0; k < 2; k++) {
        double low = qm_min(facet[0][k], qm_min(facet[1][k], facet[2][k]));
        double high = qm_max(facet[0][k], qm_max(facet[1][k], facet[2][k]));
        if (low > qm_max(qm_max(corner[0][k], corner[1][k]), qm_max(corner[2][k], corner[3][k])))
            return false;
        if (high < qm_min(qm_min(corner[0][k], corner[1][k]), qm_min(corner[2][k], corner[3][k])))
            return false;
    }
    return true;
}

/** The corner's heights above a plane. */
static bilinear_function heights_over(const double corner[4][3], const double plane[3])
{
    bilinear_function height;
    for (int i = 0; i < 4; i++)
        height.at[i] = corner[i][2] - (plane[0] * corner[i][0] + plane[1] * corner[i][1] + plane[2]);
    return height;
}

/** The greatest height of a patch over a plane, by magnitude, where the patch is over or under a triangle; improved until
 * it is at most enough, or cannot be. Negative where it is nowhere. polygon becomes one that holds the parameters there. */
static double largest_over(const double corner[4][3], const double triangle[3][3],
                           const bilinear_function *height, double size, double enough,
                           clipped_polygon *polygon)
{
    bilinear_function inside[3];
    double turn = 0.0, margin[3];
    for (int e = 0; e < 3; e++) {
        const double *a = triangle[e], *b = triangle[(e + 1) % 3], *c = triangle[(e + 2) % 3];
        double x = b[0] - a[0], y = b[1] - a[1];
        if (e == 0) turn = x * (c[1] - a[1]) - y * (c[0] - a[0]) < 0.0 ? -1.0 : 1.0;
        for (int i = 0; i < 4; i++)
            inside[e].at[i] = turn * (x * (corner[i][1] - a[1]) - y * (corner[i][0] - a[0]));
        margin[e] = 2.0 * QM_UNIT_ROUNDING *
                    (QM_OVERLAY_AREA * size * size + CLIP_ROUNDINGS * largest_of(&inside[e]));
    }
    return largest_inside(height, inside, margin, enough, polygon);
}

/** The greatest distance, vertical or not, of the rectangle from one facet, where that is over it; negative
 * where it is not. */
static double facet_gap(const qm_overlay_facets *facets, int index, const double corner[4][3], double enough)
{
    double facet[3][3], plane[3], size = facets->size;
    int group = index / QM_PACK_LANES, lane = index % QM_PACK_LANES;
    if (!load_facet(facets, index, corner, facet)) return -1.0;
    for (int k = 0; k < 3; k++)
        plane[k] = facets->group[group].plane[k][lane];
    bilinear_function height = heights_over(corner, plane);
    double highest = largest_of(&height), error = size * facets->group[group].plane_error[lane];
    error += facets->group[group].twist[lane] + HEIGHT_ROUNDINGS * QM_UNIT_ROUNDING * highest;
    if (highest + error <= enough) return highest + error;
    clipped_polygon polygon;
    double largest = largest_over(corner, facet, &height, size, enough - error, &polygon);
    if (largest < 0.0 || largest + error <= enough) return largest < 0.0 ? largest : largest + error;
    /* The distance from the facet's plane, which the distance from the facet is at least. */
    if (largest > enough * sqrt(1.0 + plane[0] * plane[0] + plane[1] * plane[1])) return largest + error;
    double off = facets->group[group].twist[lane] + DISTANCE_ROUNDINGS * QM_UNIT_ROUNDING * size;
    return qm_min(largest + error, largest_distance(corner, &polygon, facet) + off);
}

double qm_overlay_patch_gap(const qm_overlay_facets *facets, const double corner[4][3], double enough,
                            uint8_t *far)
{
    QM_ASSERT(facets && corner);
    double largest = -1.0;
    for (int i = 0; i < facets->count; i++) {
        double gap = facet_gap(facets, i, corner, enough);
        if (far && !(gap <= enough)) far[i / QM_PACK_LANES] |= (uint8_t)(1u << i % QM_PACK_LANES);
        if (!(gap <= largest)) largest = gap;
        if (!far && !(gap <= enough)) break;
    }
    return largest;
}

/** The corners of the patch that a facet is part of, in cyclic order. */
static void load_patch(const qm_overlay_facets *facets, int group, int lane, double corner[4][3])
{
    bool is_second = facets->group[group].is_second[lane];
    const int from[3] = {0, is_second ? 2 : 1, is_second ? 3 : 2};
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++)
            corner[from[i]][k] = facets->group[group].at[i][k][lane];
        corner[is_second ? 1 : 3][k] = facets->group[group].opposite[k][lane];
    }
}

bool qm_overlay_patches_are_near(const qm_overlay_facets *facets, const qm_overlay_face *face, double enough,
                                 uint8_t *far)
{
    QM_ASSERT(facets && face && far);
    bool are_near = true;
    for (int i = 0; i < facets->count; i++) {
        int group = i / QM_PACK_LANES, lane = i % QM_PACK_LANES;
        if (!(far[group] >> lane & 1)) continue;
        double corner[4][3];
        bool is_near = false;
        if (facets->group[group].twist[lane] > 0.0 && facets->group[group].opposite[2][lane] < INFINITY) {
            load_patch(facets, group, lane, corner);
            bilinear_function height = heights_over(corner, face->plane);
            double error = HEIGHT_ROUNDINGS * QM_UNIT_ROUNDING * largest_of(&height);
            clipped_polygon polygon;
            is_near =
                largest_over(corner, face->corner, &height, facets->size, enough - error, &polygon) + error <=
                enough;
        }
        if (is_near)
            far[group] &= (uint8_t) ~(1u << lane);
        else
            are_near = false;
    }
    return are_near;
}
