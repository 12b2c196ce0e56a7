/*
 * The bounds of a triangle, of a polygon and of a part of another patch over a patch: never below the distance of any of its points, whatever points of the
 * patch lie under its corners, and close to the greatest of them where these are the nearest.
 */
#include "check.h"

#include "prim/bilinear_match.h"
#include "random.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

#define ERROR 1e-13
#define POLYGONS 1500
#define RECTANGLES 150
#define GRID 6 /* points a side that are measured */

static void draw_corners(qm_random *random, double twist, double corner[4][3])
{
    static const double square[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    for (int i = 0; i < 4; i++) {
        qm_random_point(random, -0.5 * twist, 0.5 * twist, corner[i]);
        corner[i][0] += square[i][0];
        corner[i][1] += square[i][1];
    }
}

static qm_bilinear patch_of(const double corner[4][3])
{
    const qm_vec c[4] = {qm_vec_load(corner[0]), qm_vec_load(corner[1]), qm_vec_load(corner[2]),
                         qm_vec_load(corner[3])};
    return qm_bilinear_make(c);
}

/** A triangle of this size in some direction off a point of the patch. */
static void draw_triangle(qm_random *random, const qm_bilinear *patch, double height, double size,
                          qm_vec corner[3])
{
    qm_vec at = qm_bilinear_at(patch, qm_random_range(random, 0.2, 0.8), qm_random_range(random, 0.2, 0.8));
    double off[3];
    qm_random_direction(random, off);
    at = qm_vec_axpy(at, height, qm_vec_load(off));
    for (int i = 0; i < 3; i++) {
        qm_random_direction(random, off);
        corner[i] = qm_vec_axpy(at, size, qm_vec_load(off));
    }
}

static double slow_distance(const double patch[4][3], qm_vec p)
{
    double point[3];
    qm_vec_store(point, p);
    return qm_slow_patch_distance(point, patch, ERROR).lower;
}

static qm_vec point_of(const qm_vec corner[3], double x, double y)
{
    qm_vec p = qm_vec_scale(1.0 - x - y, corner[0]);
    return qm_vec_axpy(qm_vec_axpy(p, x, corner[1]), y, corner[2]);
}

static void no_point_is_farther(void **state)
{
    (void)state;
    for (int number = 0; number < 150; number++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)number);
        double c[4][3], uv[3][2];
        draw_corners(&random, (const double[]){0.0, 0.1, 1.0, 3.0}[qm_random_below(&random, 4)], c);
        qm_bilinear patch = patch_of(c);
        qm_vec corner[3];
        draw_triangle(&random, &patch, (const double[]){0.0, 1e-3, 0.3, 3.0}[qm_random_below(&random, 4)],
                      (const double[]){1e-6, 1e-2, 0.3, 2.0}[qm_random_below(&random, 4)], corner);
        bool nearest = qm_random_below(&random, 3) > 0;
        for (int i = 0; i < 3; i++) {
            qm_bilinear_footpoint foot = qm_bilinear_project(&patch, corner[i], ERROR, INFINITY);
            for (int k = 0; k < 2; k++)
                uv[i][k] = nearest ? foot.uv[k] : qm_random_range(&random, 0.0, 1.0);
        }
        double bound = qm_bilinear_triangle_upper(&patch, corner, uv);
        for (int i = 0; i <= GRID; i++)
            for (int j = 0; i + j <= GRID; j++) {
                double d = slow_distance(c, point_of(corner, (double)i / GRID, (double)j / GRID));
                QM_CHECK(d <= bound + 2 * ERROR, "seed %llu, case %d: %.17g is farther than %.17g",
                         (unsigned long long)qm_check_seed(), number, d, bound);
            }
    }
}

/** Greatest distance of a triangle's points, by ever finer grids round the farthest. */
static double farthest(const double patch[4][3], const qm_vec corner[3])
{
    double best[2] = {1.0 / 3.0, 1.0 / 3.0}, most = 0.0;
    for (double width = 1.0; width > 1e-6; width *= 0.25) {
        double from[2] = {best[0], best[1]};
        for (int i = -GRID; i <= GRID; i++)
            for (int j = -GRID; j <= GRID; j++) {
                double x = qm_clamp(from[0] + width * i / GRID, 0.0, 1.0);
                double y = qm_clamp(from[1] + width * j / GRID, 0.0, 1.0 - x);
                double d = slow_distance(patch, point_of(corner, x, y));
                if (d <= most) continue;
                most = d;
                best[0] = x;
                best[1] = y;
            }
    }
    return most;
}

/** Over a saddle: a sixteenth of the excess for half the size, but for what the search for the truth
 * leaves. */
static void the_excess_falls_with_the_fourth_power(void **state)
{
    (void)state;
    const double c[4][3] = {{0, 0, 0}, {1, 0, 0.1}, {1, 1, -0.2}, {0, 1, 0.3}};
    qm_bilinear patch = patch_of(c);
    double last = INFINITY;
    for (double size = 0.2; size > 0.02; size *= 0.5) {
        const qm_vec corner[3] = {
            {0.5 - size, 0.5 - size, 0.5}, {0.5 + size, 0.5 - 0.5 * size, 0.5}, {0.5, 0.5 + size, 0.5}};
        double uv[3][2];
        for (int i = 0; i < 3; i++) {
            qm_bilinear_footpoint foot = qm_bilinear_project(&patch, corner[i], ERROR, INFINITY);
            uv[i][0] = foot.uv[0];
            uv[i][1] = foot.uv[1];
        }
        double excess = qm_bilinear_triangle_upper(&patch, corner, uv) - farthest(c, corner);
        QM_CHECK(excess >= -ERROR && excess <= fmax(last / 12.0, 10.0 * ERROR), "size %g: %g after %g", size,
                 excess, last);
        last = excess;
    }
}

/** A flat quad of a shape that a fan or a fold has, with corners off by less than crumb, bent by less than bend. */
static void draw_flat(qm_random *random, double crumb, double bend, double corner[4][3])
{
    static const double shapes[][4][2] = {
        {{0, 0}, {1, 0}, {1, 1}, {0, 1}},     /* a square */
        {{0, 0}, {1, 0}, {1, 0.3}, {0, 0}},   /* a wedge: two corners in one point */
        {{0, 0}, {1, 0}, {0.4, 0.3}, {0, 1}}, /* nearly reflex */
        {{0, 0}, {1, 1}, {1, 0}, {0, 1}},     /* a bow-tie */
        {{0, 0}, {1, 0}, {1, 0.05}, {0, 0.6}},
    };
    size_t shape = qm_random_below(random, sizeof shapes / sizeof *shapes);
    for (int i = 0; i < 4; i++) {
        for (int k = 0; k < 2; k++)
            corner[i][k] = shapes[shape][i][k] + qm_random_range(random, -crumb, crumb);
        corner[i][2] = qm_random_range(random, -bend, bend);
    }
}

/** A convex polygon of three to five corners in the plane of a flat quad, at random or by points over it. */
static int draw_polygon(qm_random *random, const qm_bilinear *patch, double height, qm_vec corner[5])
{
    int count = 3 + (int)qm_random_below(random, 3);
    double radius = (const double[]){1e-3, 0.05, 0.3, 0.6}[qm_random_below(random, 4)],
           turn = qm_random_range(random, 0.0, 6.283), thin = qm_random_range(random, 0.05, 1.0);
    qm_vec at = qm_bilinear_at(patch, qm_random_range(random, 0.0, 1.0), qm_random_range(random, 0.0, 1.0));
    for (int i = 0; i < count; i++) {
        double x = radius * cos(6.283 * i / count), y = thin * radius * sin(6.283 * i / count);
        corner[i] =
            (qm_vec){at.x + x * cos(turn) - y * sin(turn), at.y + x * sin(turn) + y * cos(turn), height};
    }
    return count;
}

/** Points of a polygon, by the triangles from its first corner. */
static double farthest_of_polygon(const double c[4][3], int count, const qm_vec corner[5])
{
    double most = 0.0;
    for (int t = 1; t + 1 < count; t++) {
        const qm_vec triangle[3] = {corner[0], corner[t], corner[t + 1]};
        for (int i = 0; i <= GRID; i++)
            for (int j = 0; i + j <= GRID; j++)
                most = fmax(most, slow_distance(c, point_of(triangle, (double)i / GRID, (double)j / GRID)));
    }
    return most;
}

/**
 * Polygons over flat patches, wedges and bow-ties among them, and beyond their edges; under the corners their
 * footpoints, or points that are off by a little or by all of the patch. The bound is put to the test only where
 * it is below that of the triangles: that has to be often.
 */
static void no_point_of_a_polygon_is_farther(void **state)
{
    (void)state;
    int lower = 0;
    for (int number = 0; number < POLYGONS; number++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)(10000 + number));
        double c[4][3], uv[5][2], off = (const double[]){0.0, 0.0, 0.02, 1.0}[qm_random_below(&random, 4)];
        double bend = (const double[]){1e-9, 1e-4, 1e-2, 0.1, 0.3}[qm_random_below(&random, 5)];
        draw_flat(&random, (const double[]){0.0, 1e-4, 0.02, 0.3}[qm_random_below(&random, 4)], bend, c);
        qm_bilinear patch = patch_of(c);
        qm_vec corner[5];
        int count = draw_polygon(&random, &patch, bend * (double)qm_random_below(&random, 2), corner);
        for (int i = 0; i < count; i++) {
            qm_bilinear_footpoint foot = qm_bilinear_project(&patch, corner[i], ERROR, INFINITY);
            for (int k = 0; k < 2; k++)
                uv[i][k] = qm_clamp(foot.uv[k] + off * qm_random_range(&random, -1.0, 1.0), 0.0, 1.0);
        }
        double bound = qm_bilinear_polygon_upper(&patch, count, corner, uv, 0.0), triangles = 0.0;
        for (int t = 1; t + 1 < count; t++) {
            const qm_vec triangle[3] = {corner[0], corner[t], corner[t + 1]};
            const double feet[3][2] = {
                {uv[0][0], uv[0][1]}, {uv[t][0], uv[t][1]}, {uv[t + 1][0], uv[t + 1][1]}};
            triangles = fmax(triangles, qm_bilinear_triangle_upper(&patch, triangle, feet));
        }
        QM_CHECK(bound <= triangles, "case %d", number);
        if (bound == triangles) continue;
        lower++;
        double most = farthest_of_polygon(c, count, corner);
        QM_CHECK(most <= bound + 2 * ERROR, "seed %llu, case %d: %.17g is farther than %.17g",
                 (unsigned long long)qm_check_seed(), number, most, bound);
    }
    QM_CHECK(lower > POLYGONS / 8, "seed %llu: only %d of %d polygons", (unsigned long long)qm_check_seed(),
             lower, POLYGONS);
}

/** A wedge whose tip is one point: the parameters interpolated under a triangle are far from those under it, but
 * the patch is as flat as its corners are. */
static void a_flat_wedge_is_as_near_as_its_corners(void **state)
{
    (void)state;
    const double c[4][3] = {{0, 1e-6, 1e-5}, {1, 0, -1e-5}, {1, 0.3, 1e-5}, {0, 2e-6, 1e-5}};
    qm_bilinear patch = patch_of(c);
    const qm_vec corner[4] = {{0.1, 0.01, 0}, {0.9, 0.01, 0}, {0.9, 0.25, 0}, {0.1, 0.02, 0}};
    double uv[4][2];
    for (int i = 0; i < 4; i++) {
        qm_bilinear_footpoint foot = qm_bilinear_project(&patch, corner[i], ERROR, INFINITY);
        uv[i][0] = foot.uv[0];
        uv[i][1] = foot.uv[1];
    }
    double bound = qm_bilinear_polygon_upper(&patch, 4, corner, uv, 0.0);
    QM_CHECK(bound < 1.1e-5, "bound %.17g", bound);
}

/** The point of a patch by its definition, in more digits than a double has. */
static void wide_patch_point(const double c[4][3], double s, double t, double out[3])
{
    long double u = s, v = t;
    for (int k = 0; k < 3; k++)
        out[k] = (double)((1 - u) * (1 - v) * c[0][k] + u * (1 - v) * c[1][k] + u * v * c[2][k] +
                          (1 - u) * v * c[3][k]);
}

/** Greatest distance of points in a rectangle of a patch from another patch. */
static double farthest_of_rectangle(const double source[4][3], const qm_uv_box *box,
                                    const double target[4][3])
{
    double most = 0.0;
    for (int i = 0; i <= GRID; i++)
        for (int j = 0; j <= GRID; j++) {
            double p[3];
            wide_patch_point(source, box->low[0] + (box->high[0] - box->low[0]) * i / GRID,
                             box->low[1] + (box->high[1] - box->low[1]) * j / GRID, p);
            most = fmax(most, qm_slow_patch_distance(p, target, ERROR).lower);
        }
    return most;
}

static qm_uv_box draw_box(qm_random *random, double size)
{
    qm_uv_box box;
    for (int k = 0; k < 2; k++) {
        box.low[k] = qm_random_range(random, 0.0, 1.0 - size);
        box.high[k] = box.low[k] + qm_random_range(random, 0.1, 1.0) * size;
    }
    return box;
}

/** Parameters of the points of a patch nearest to the corners of a rectangle. */
static void feet_of_box(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                        double uv[4][2])
{
    qm_vec corner[4];
    qm_uv_box_corners(source, box, corner);
    for (int i = 0; i < 4; i++) {
        qm_bilinear_footpoint foot = qm_bilinear_project(target, corner[i], ERROR, INFINITY);
        uv[i][0] = foot.uv[0];
        uv[i][1] = foot.uv[1];
    }
}

/** Rectangles of a patch over one like it or another, folded ones among them; under the corners their footpoints, or
 * points that are off by a little or by all of the patch. */
static void no_point_of_a_rectangle_is_farther(void **state)
{
    (void)state;
    for (int number = 0; number < RECTANGLES; number++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)(30000 + number));
        double from[4][3], to[4][3], uv[4][2];
        double bend = (const double[]){1e-9, 1e-2, 0.3, 1.0}[qm_random_below(&random, 4)],
               noise = (const double[]){1e-9, 1e-4, 1e-2, 0.3}[qm_random_below(&random, 4)],
               off = (const double[]){0.0, 0.0, 0.02, 1.0}[qm_random_below(&random, 4)];
        draw_flat(&random, (const double[]){0.0, 0.02, 0.3}[qm_random_below(&random, 3)], bend, from);
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < 3; k++)
                to[i][k] = from[i][k] + qm_random_range(&random, -noise, noise);
        qm_uv_box box = draw_box(&random, (const double[]){1.0, 0.3, 1e-2}[qm_random_below(&random, 3)]);
        qm_bilinear source = patch_of(from), target = patch_of(to);
        feet_of_box(&source, &box, &target, uv);
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < 2; k++)
                uv[i][k] = qm_clamp(uv[i][k] + off * qm_random_range(&random, -1.0, 1.0), 0.0, 1.0);
        double bound = qm_bilinear_rectangle_upper(&source, &box, &target, uv);
        double most = farthest_of_rectangle(from, &box, to);
        QM_CHECK(most <= bound + 2 * ERROR, "seed %llu, case %d: %.17g is farther than %.17g",
                 (unsigned long long)qm_check_seed(), number, most, bound);
    }
}

/** Each half of a rectangle, and the inside of its edges, may be the farthest from the target. */
static void all_of_a_rectangle_counts(void **state)
{
    (void)state;
    const double flat[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    const qm_uv_box box = {{0.0, 0.0}, {1.0, 1.0}};
    const double uv[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    for (int tip = 0; tip < 4; tip++) {
        double bent[4][3];
        memcpy(bent, flat, sizeof bent);
        bent[tip][2] = 0.1;
        qm_bilinear source = patch_of(bent), target = patch_of(flat);
        double bound = qm_bilinear_rectangle_upper(&source, &box, &target, uv);
        QM_CHECK(bound >= 0.1 && bound < 0.1 + 1e-12, "corner %d: bound %.17g", tip, bound);
    }
    /* Over one point of the target: interpolated parameters stay there, and the corners are the farthest. */
    const double still[4][2] = {{0.5, 0.5}, {0.5, 0.5}, {0.5, 0.5}, {0.5, 0.5}};
    qm_bilinear patch = patch_of(flat);
    double far = sqrt(0.5), bound = qm_bilinear_rectangle_upper(&patch, &box, &patch, still);
    QM_CHECK(bound >= far && bound < 1.5 * far, "bound %.17g of %.17g", bound, far);
}

/** Over a patch whose corners have moved, each in a way of its own, the excess is of the fourth order of the size. */
static void the_excess_of_a_rectangle_is_small(void **state)
{
    (void)state;
    const double from[4][3] = {{0, 0, 0}, {1, 0, 0.1}, {1, 1, -0.2}, {0, 1, 0.3}};
    const double to[4][3] = {{-0.1, -0.2, 0.2}, {1.1, -0.1, 0.4}, {1.2, 1.1, 0.1}, {-0.1, 1.2, 0.5}};
    qm_bilinear source = patch_of(from), target = patch_of(to);
    for (double size = 0.4; size > 0.04; size *= 0.5) {
        const qm_uv_box box = {{0.5 - size, 0.5 - size}, {0.5 + size, 0.5 + size}};
        double uv[4][2];
        feet_of_box(&source, &box, &target, uv);
        double excess =
            qm_bilinear_rectangle_upper(&source, &box, &target, uv) - farthest_of_rectangle(from, &box, to);
        QM_CHECK(excess >= -ERROR && excess <= 0.1 * pow(size, 4.0), "size %g: %g", size, excess);
    }
}

/** Numbers the corners of a patch from another one on: the parameters turn with them. */
static void renumber(int first, const double from[4][3], int count, const double uv[][2], double to[4][3],
                     double turned[][2])
{
    for (int i = 0; i < 4; i++)
        memcpy(to[i], from[(i + first) % 4], sizeof to[i]);
    for (int i = 0; i < count; i++) {
        double u = uv[i][0], v = uv[i][1];
        turned[i][0] = (const double[]){u, v, 1.0 - u, 1.0 - v}[first];
        turned[i][1] = (const double[]){v, 1.0 - u, 1.0 - v, u}[first];
    }
}

/** A triangle over a patch, whichever of its corners is the first one. */
static void check_all_numberings(const double c[4][3], const qm_vec corner[3], const double uv[3][2])
{
    double most = farthest(c, corner);
    for (int first = 0; first < 4; first++) {
        double to[4][3], turned[3][2];
        renumber(first, c, 3, uv, to, turned);
        qm_bilinear patch = patch_of(to);
        double bound = qm_bilinear_polygon_upper(&patch, 3, corner, turned, 0.0);
        QM_CHECK(most <= bound + ERROR, "corner %d first: %.17g is farther than %.17g", first, most, bound);
    }
}

/** Points off the interpolated ones, up or down the slope of one steep corner or two: found by searches for cases that
 * only the slope there bounds, and all of it. */
static void the_steepest_corner_counts(void **state)
{
    (void)state;
    static const struct {
        double c[4][3];
        qm_vec corner[3];
        double uv[3][2];
    } cases[] = {
        {{{0.0778298, -0.126637, -0.208285},
          {1.06017, -0.188616, -0.0522512},
          {0.734803, 0.698096, 0.254455},
          {0.000568202, 0.869079, -0.0165726}},
         {{0.503662, 0.539241, 0.169465}, {0.156854, 0.513497, 0.0955634}, {0.281733, 0.213894, 0.0162778}},
         {{0.726459, 0.831457}, {0.325729, 0.596769}, {0.185909, 0.389286}}},
        {{{-0.106639, 0.0202407, -0.108183},
          {1.09043, -0.169484, 0.0187314},
          {0.855063, 0.841517, 0.141171},
          {0.0251263, 0.934551, 0.0473244}},
         {{0.812714, 0.816072, 0.246733}, {0.292849, 0.788165, 0.218679}, {0.391021, 0.054837, 0.0327301}},
         {{1, 1}, {0.559889, 0.679694}, {0.308451, 0.123139}}},
        /* One steep corner alone. */
        {{{0.176481604, 0.209520854, -0.245128732},
          {0.837275037, -0.382712426, -0.00882089588},
          {0.83016584, 1.01585103, -0.225368553},
          {-0.45540609, 0.946846525, -0.236985104}},
         {{0.0573808327, 0.724773446, -0.188274586},
          {0.715777182, 0.0486125568, -0.160531201},
          {0.416683026, 0.345882438, -0.714406619}},
         {{0.234750729, 0.868961028}, {1, 0.327785398}, {0, 0}}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        check_all_numberings(cases[i].c, cases[i].corner, cases[i].uv);
}

/** All corners of a sliver are at the tips of a dart, and its middle is over the notch. */
static void a_reflex_corner_is_not_passed_over(void **state)
{
    (void)state;
    const double c[4][3] = {{0, 0, 0}, {1, 0, 0}, {0.3, 0.3, 0}, {0, 1, 0}};
    const qm_vec corner[3] = {{0.99, 0.003, 0}, {0.003, 0.99, 0}, {0.97, 0.005, 0}};
    const double uv[3][2] = {{1, 0}, {0, 1}, {0.97, 0.01}};
    check_all_numberings(c, corner, uv);
}

/** A point whose coordinates have few digits: sums of them are exact. */
static qm_vec short_point(const double p[3])
{
    return (qm_vec){round(1024.0 * p[0]) / 1024.0, round(1024.0 * p[1]) / 1024.0,
                    round(1024.0 * p[2]) / 1024.0};
}

/** A point and two edges there, nearly at right angles. */
static void draw_edges(qm_random *random, qm_vec *origin, qm_vec edge[2])
{
    double at[3];
    qm_random_point(random, -1.0, 1.0, at);
    *origin = short_point(at);
    for (int i = 0; i < 2; i++) {
        qm_random_direction(random, at);
        if (i == 1)
            qm_vec_store(at, qm_vec_axpy(qm_vec_load(at), -qm_vec_dot(edge[0], qm_vec_load(at)), edge[0]));
        edge[i] = short_point(at);
    }
}

static long double wide_dot(const long double a[3], const long double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void wide_sub(const double a[3], const double b[3], long double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = (long double)a[k] - (long double)b[k];
}

/** The distance of p from the plane of a, b and c, in more digits than a double has. */
static long double wide_plane_distance(const double a[3], const double b[3], const double c[3],
                                       const double p[3])
{
    long double x[3], y[3], z[3];
    wide_sub(b, a, x);
    wide_sub(c, a, y);
    wide_sub(p, a, z);
    long double n[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]};
    return fabsl(wide_dot(n, z)) / sqrtl(wide_dot(n, n));
}

/** The distance of p from the line through a and b. */
static long double wide_line_distance(const double a[3], const double b[3], const double p[3])
{
    long double x[3], z[3];
    wide_sub(b, a, x);
    wide_sub(p, a, z);
    long double t = wide_dot(x, z) / wide_dot(x, x);
    for (int k = 0; k < 3; k++)
        z[k] -= t * x[k];
    return sqrtl(wide_dot(z, z));
}

/**
 * Triangles at one height over a parallelogram in any plane, or beside one of its edges. The parameters interpolate
 * badly, so that the bound is by a view, or by the edge: it is the greatest distance but for roundings, which the
 * margins have to be above.
 */
static void roundings_are_in_the_bound(void **state)
{
    (void)state;
    for (int number = 0; number < 4000; number++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)(20000 + number));
        qm_vec origin, edge[2], corner[3];
        double c[4][3], p[3][3], height = qm_random_range(&random, 1e-3, 0.5);
        bool is_beside = number % 2;
        const double uv[3][2] = {{0.0, 0.0}, {1.0, 0.0}, {0.0, is_beside ? 0.0 : 1.0}};
        draw_edges(&random, &origin, edge);
        if (!(qm_vec_norm(edge[1]) > 0.1)) continue;
        for (int i = 0; i < 4; i++) {
            double u = i == 1 || i == 2, v = i >= 2;
            qm_vec_store(c[i], qm_vec_axpy(qm_vec_axpy(origin, u, edge[0]), v, edge[1]));
        }
        qm_vec off = qm_vec_cross(edge[0], edge[1]);
        off = qm_vec_scale(height / qm_vec_norm(off), off);
        if (is_beside) off = qm_vec_axpy(off, -qm_random_range(&random, 0.05, 0.3), edge[1]);
        for (int i = 0; i < 3; i++) {
            double u = qm_random_range(&random, 0.2, 0.8),
                   v = is_beside ? 0.0 : qm_random_range(&random, 0.2, 0.8);
            qm_vec under = qm_vec_axpy(qm_vec_axpy(origin, u, edge[0]), v, edge[1]);
            corner[i] = qm_vec_add(under, off);
            qm_vec_store(p[i], corner[i]);
        }
        qm_bilinear patch = patch_of(c);
        double bound = qm_bilinear_polygon_upper(&patch, 3, corner, uv, 0.0);
        for (int i = 0; i < 3; i++) {
            long double d = is_beside ? wide_line_distance(c[0], c[1], p[i])
                                      : wide_plane_distance(c[0], c[1], c[3], p[i]);
            QM_CHECK(d <= (long double)bound && (long double)bound < d + 1e-12L,
                     "seed %llu, case %d: %.20Lg is not the bound of %.17g",
                     (unsigned long long)qm_check_seed(), number, d, bound);
        }
    }
}

/** A sliver along a side of a wedge that is noisy: seen from nowhere is the patch there a hill. */
static void a_sliver_is_as_near_as_a_side(void **state)
{
    (void)state;
    const double c[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 0.3, 2e-5}, {1e-5, 1e-5, 3e-5}};
    qm_bilinear patch = patch_of(c);
    const qm_vec corner[3] = {{0.001, -1e-5, 1e-5}, {0.8, -1e-5, 1e-5}, {0.3, -1.1e-5, 1e-5}};
    const double uv[3][2] = {{1e-3, 0.3}, {0.8, 0}, {0.3, 1e-4}};
    double bound = qm_bilinear_polygon_upper(&patch, 3, corner, uv, 0.0);
    QM_CHECK(bound < 1.6e-5, "bound %.17g", bound);
}

/**
 * A triangle and a part of another patch at one height over a parallelogram, all of numbers with few digits: what lies
 * between the surfaces is computed without rounding, so that the bound's own margin alone covers its roundings.
 */
static void exact_heights_are_in_the_bound(void **state)
{
    (void)state;
    for (int number = 0; number < 4000; number++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)(30000 + number));
        qm_vec origin, edge[2], corner[3];
        double c[4][3], above[4][3];
        static const double uv[4][2] = {{0.25, 0.25}, {0.75, 0.25}, {0.75, 0.75}, {0.25, 0.75}};
        const qm_uv_box box = {{0.25, 0.25}, {0.75, 0.75}};
        draw_edges(&random, &origin, edge);
        if (!(qm_vec_norm(edge[1]) > 0.1)) continue;
        qm_vec off = qm_vec_scale(0.25, qm_vec_cross(edge[0], edge[1])); /* products of ten digits each */
        for (int i = 0; i < 4; i++) {
            double u = i == 1 || i == 2, v = i >= 2;
            qm_vec at = qm_vec_axpy(qm_vec_axpy(origin, u, edge[0]), v, edge[1]);
            qm_vec_store(c[i], at);
            qm_vec_store(above[i], qm_vec_add(at, off));
        }
        qm_bilinear patch = patch_of(c), source = patch_of(above);
        for (int i = 0; i < 3; i++)
            corner[i] = qm_bilinear_at(&source, uv[i][0], uv[i][1]);
        long double length[3] = {off.x, off.y, off.z}, height = sqrtl(wide_dot(length, length));
        double triangle = qm_bilinear_triangle_upper(&patch, corner, uv);
        double rectangle = qm_bilinear_rectangle_upper(&source, &box, &patch, uv);
        QM_CHECK(height <= (long double)triangle && (long double)triangle < height + 1e-13L,
                 "seed %llu, case %d: %.20Lg is not the bound of %.17g of a triangle",
                 (unsigned long long)qm_check_seed(), number, height, triangle);
        QM_CHECK(height <= (long double)rectangle && (long double)rectangle < height + 1e-13L,
                 "seed %llu, case %d: %.20Lg is not the bound of %.17g of a rectangle",
                 (unsigned long long)qm_check_seed(), number, height, rectangle);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_point_is_farther),
        cmocka_unit_test(the_excess_falls_with_the_fourth_power),
        cmocka_unit_test(no_point_of_a_polygon_is_farther),
        cmocka_unit_test(a_flat_wedge_is_as_near_as_its_corners),
        cmocka_unit_test(the_steepest_corner_counts),
        cmocka_unit_test(a_reflex_corner_is_not_passed_over),
        cmocka_unit_test(roundings_are_in_the_bound),
        cmocka_unit_test(exact_heights_are_in_the_bound),
        cmocka_unit_test(a_sliver_is_as_near_as_a_side),
        cmocka_unit_test(no_point_of_a_rectangle_is_farther),
        cmocka_unit_test(all_of_a_rectangle_counts),
        cmocka_unit_test(the_excess_of_a_rectangle_is_small),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
