/*
 * The bound of a triangle over a patch: never below the distance of any of its points, whatever points of the
 * patch lie under its corners, and close to the greatest of them where these are the nearest.
 */
#include "check.h"

#include "prim/bilinear.h"
#include "random.h"
#include "slow_twin.h"

#include <math.h>

#define ERROR 1e-13
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_point_is_farther),
        cmocka_unit_test(the_excess_falls_with_the_fourth_power),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
