/* The certified distance from a point to a bilinear patch, against the slow twin. */
#include "check.h"

#include "prim/bilinear.h"
#include "random.h"
#include "regridded.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

#define ERROR 1e-13                  /* tolerance; the patches measure about 1 */
#define ROUND(d) (2e-15 * (1 + (d))) /* roundings of the engine's own arithmetic at a distance d */

/** How the patches of a run are drawn. */
typedef struct patch_case {
    const char *name;
    double twist; /* greatest |w| in edge lengths */
    double width; /* of the second side, to the first */
} patch_case;

static const patch_case cases[] = {
    {"parallelograms", 0, 1}, {"slightly twisted", 0.2, 1}, {"twisted", 1, 1},   {"folded", 2, 1},
    {"wild", 6, 1},           {"narrow", 0.5, 1e-3},        {"needles", 1, 1e-7}};

enum { CASE_COUNT = sizeof cases / sizeof *cases };

static void draw_patch(qm_random *random, const patch_case *c, double corner[4][3])
{
    double side[2][3], move[3], moved = c->twist * qm_random_range(random, 0, 1);
    qm_random_direction(random, side[0]);
    qm_random_direction(random, side[1]);
    qm_random_direction(random, move);
    qm_random_point(random, -0.3, 0.3, corner[0]);
    for (int k = 0; k < 3; ++k) {
        double e1 = 0.5 * side[0][k], e2 = 0.5 * c->width * side[1][k];
        corner[1][k] = corner[0][k] + e1;
        corner[2][k] = corner[0][k] + e1 + e2 + 0.5 * c->width * moved * move[k];
        corner[3][k] = corner[0][k] + e2;
    }
}

static qm_bilinear engine_patch(const double corner[4][3])
{
    const qm_vec c[4] = {qm_vec_load(corner[0]), qm_vec_load(corner[1]), qm_vec_load(corner[2]),
                         qm_vec_load(corner[3])};
    return qm_bilinear_make(c);
}

/** On the patch, close to it, or anywhere: where the patch is thin and where it has several near places. */
static void draw_query(qm_random *random, const qm_bilinear *patch, double p[3])
{
    double reach = (double[]){0, 1e-9, 0.1, 1, 5}[qm_random_below(random, 5)], off[3];
    qm_random_direction(random, off);
    qm_vec at = qm_bilinear_at(patch, qm_random_range(random, 0, 1), qm_random_range(random, 0, 1));
    p[0] = at.x + reach * off[0];
    p[1] = at.y + reach * off[1];
    p[2] = at.z + reach * off[2];
}

static double foot_distance(const qm_bilinear *patch, const double uv[2], const double p[3])
{
    qm_vec gap = qm_vec_sub(qm_vec_load(p), qm_bilinear_at(patch, uv[0], uv[1]));
    return sqrt(qm_vec_dot(gap, gap));
}

static void check_foot(const qm_bilinear *patch, const qm_bilinear_footpoint *foot, const double p[3],
                       const char *name, uint64_t seed)
{
    QM_CHECK(foot->uv[0] >= 0 && foot->uv[0] <= 1 && foot->uv[1] >= 0 && foot->uv[1] <= 1,
             "%s, seed %llu: (%.17g, %.17g)", name, (unsigned long long)seed, foot->uv[0], foot->uv[1]);
    QM_CHECK(fabs(foot_distance(patch, foot->uv, p) - foot->distance) <= ROUND(foot->distance),
             "%s, seed %llu: %.17g, %.17g", name, (unsigned long long)seed, foot_distance(patch, foot->uv, p),
             foot->distance);
    QM_CHECK(foot->lower >= 0 && foot->lower <= foot->distance, "%s, seed %llu: [%.17g, %.17g]", name,
             (unsigned long long)seed, foot->lower, foot->distance);
}

static void certified_distances_match_the_slow_twin(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 1000000 : 10000;
    uint64_t open = 0;
    for (uint64_t seed = 0; seed < count; ++seed) {
        const patch_case *c = &cases[seed % CASE_COUNT];
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], p[3];
        draw_patch(&random, c, corner);
        qm_bilinear patch = engine_patch(corner);
        draw_query(&random, &patch, p);
        qm_bilinear_footpoint foot = qm_bilinear_project(&patch, qm_vec_load(p), ERROR, INFINITY);
        check_foot(&patch, &foot, p, c->name, seed);
        QM_CHECK(foot.distance - foot.lower <= ERROR + ROUND(foot.distance), "%s, seed %llu: gap %g", c->name,
                 (unsigned long long)seed, foot.distance - foot.lower);
        qm_slow_bracket slow = qm_slow_patch_distance(p, corner, 1e-12);
        open += !slow.finished;
        double slack = ROUND(slow.upper);
        QM_CHECK(foot.lower <= slow.upper + slack, "%s, seed %llu: lower %.17g, true at most %.17g", c->name,
                 (unsigned long long)seed, foot.lower, slow.upper);
        QM_CHECK(foot.distance >= slow.lower - slack, "%s, seed %llu: %.17g, true at least %.17g", c->name,
                 (unsigned long long)seed, foot.distance, slow.lower);
        QM_CHECK(foot.distance <= slow.upper + ERROR + slack, "%s, seed %llu: %.17g, true at most %.17g",
                 c->name, (unsigned long long)seed, foot.distance, slow.upper);
    }
    QM_CHECK(open * 50 <= count, "the slow twin left %llu of %llu open", (unsigned long long)open,
             (unsigned long long)count);
}

/** Many more queries than the slow twin can answer: no lattice point of the patch may be nearer. */
/** Four points of a box that is far longer than it is wide, and far wider than it is high: the parameters of
 * one place along it make a curve that winds through the whole square. */
static void draw_winding_needle(qm_random *random, double corner[4][3])
{
    for (int i = 0; i < 4; i++) {
        qm_random_point(random, -1, 1, corner[i]);
        for (int k = 1; k < 3; k++)
            corner[i][k] *= pow(10, qm_random_range(random, -9, -1));
    }
}

static void winding_needles_are_certified(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 1000000 : 20000;
    for (uint64_t seed = 0; seed < count; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], p[3], error = 2 * ERROR;
        draw_winding_needle(&random, corner);
        qm_bilinear patch = engine_patch(corner);
        qm_vec on = qm_bilinear_at(&patch, qm_random_range(&random, 0, 1), qm_random_range(&random, 0, 1));
        double reach = (double[]){0, 0, 1e-9, 1e-2, 0.3}[seed % 5];
        qm_random_point(&random, -reach, reach, p);
        qm_vec at = {on.x + p[0], on.y + p[1], on.z + p[2]};
        qm_vec_store(p, at);
        qm_bilinear_footpoint foot = qm_bilinear_project(&patch, at, error, INFINITY);
        check_foot(&patch, &foot, p, "winding needle", seed);
        QM_CHECK(foot.distance - foot.lower <= error + ROUND(foot.distance), "seed %llu: gap %g",
                 (unsigned long long)seed, foot.distance - foot.lower);
        QM_CHECK(foot.lower <= qm_vec_distance(at, on) + ROUND(0), "seed %llu: lower %.17g, but %.17g",
                 (unsigned long long)seed, foot.lower, qm_vec_distance(at, on));
    }
}

static void no_lattice_point_is_nearer(void **state)
{
    (void)state;
    enum { LATTICE = 12 };
    for (uint64_t seed = 0; seed < 100000; ++seed) {
        const patch_case *c = &cases[seed % CASE_COUNT];
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], p[3], least = INFINITY;
        draw_patch(&random, c, corner);
        qm_bilinear patch = engine_patch(corner);
        draw_query(&random, &patch, p);
        qm_bilinear_footpoint foot = qm_bilinear_project(&patch, qm_vec_load(p), ERROR, INFINITY);
        check_foot(&patch, &foot, p, c->name, seed);
        for (int i = 0; i <= LATTICE; ++i)
            for (int j = 0; j <= LATTICE; ++j) {
                const double uv[2] = {(double)i / LATTICE, (double)j / LATTICE};
                least = fmin(least, foot_distance(&patch, uv, p));
            }
        QM_CHECK(foot.distance <= least + ERROR + ROUND(least),
                 "%s, seed %llu: %.17g, but %.17g on the lattice", c->name, (unsigned long long)seed,
                 foot.distance, least);
    }
}

/** With a bound beyond which the answer does not matter, the promise is only about that bound. */
static void a_bound_to_stop_at_keeps_its_promise(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 2000; ++seed) {
        const patch_case *c = &cases[seed % CASE_COUNT];
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], p[3];
        draw_patch(&random, c, corner);
        qm_bilinear patch = engine_patch(corner);
        draw_query(&random, &patch, p);
        qm_bilinear_footpoint whole = qm_bilinear_project(&patch, qm_vec_load(p), ERROR, INFINITY);
        double stop = whole.distance * qm_random_range(&random, 0.5, 1.5);
        qm_bilinear_footpoint foot = qm_bilinear_project(&patch, qm_vec_load(p), ERROR, stop);
        check_foot(&patch, &foot, p, c->name, seed);
        QM_CHECK(foot.lower <= whole.distance + ROUND(whole.distance),
                 "%s, seed %llu: lower %.17g above %.17g", c->name, (unsigned long long)seed, foot.lower,
                 whole.distance);
        QM_CHECK(foot.distance - foot.lower <= ERROR + ROUND(foot.distance) || foot.lower >= stop - ERROR,
                 "%s, seed %llu: [%.17g, %.17g] at stop %.17g", c->name, (unsigned long long)seed, foot.lower,
                 foot.distance, stop);
    }
}

static void descents_are_points_of_the_patch(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 5000; ++seed) {
        const patch_case *c = &cases[seed % CASE_COUNT];
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], p[3];
        draw_patch(&random, c, corner);
        qm_bilinear patch = engine_patch(corner);
        draw_query(&random, &patch, p);
        qm_bilinear_footpoint foot = qm_bilinear_minimise(&patch, qm_vec_load(p), INFINITY);
        check_foot(&patch, &foot, p, c->name, seed);
        assert_true(foot.lower == 0);
        /* A bound to stop at may cost the best point, but only of a patch that lies beyond it. */
        double stop = foot.distance * qm_random_range(&random, 0.5, 1.5);
        qm_bilinear_footpoint stopped = qm_bilinear_minimise(&patch, qm_vec_load(p), stop);
        check_foot(&patch, &stopped, p, c->name, seed);
        QM_CHECK(stopped.distance <= foot.distance || foot.distance >= stop - ROUND(stop),
                 "%s, seed %llu: %.17g of %.17g at stop %.17g", c->name, (unsigned long long)seed,
                 stopped.distance, foot.distance, stop);
    }
}

/** No point of the two triangles is farther from the patch than they say. */
static void halves_are_within_their_slack(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 5000; ++seed) {
        const patch_case *c = &cases[seed % CASE_COUNT];
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], direction[3];
        draw_patch(&random, c, corner);
        qm_random_direction(&random, direction);
        qm_bilinear patch = engine_patch(corner);
        qm_vec at[4];
        for (int i = 0; i < 4; i++)
            at[i] = qm_vec_load(corner[i]);
        qm_bilinear_halves halves =
            qm_bilinear_halve(at, seed % 3 == 0 ? (qm_vec){0, 0, 0} : qm_vec_load(direction));
        const qm_vec *h = halves.corner;
        for (int k = 0; k < 20; k++) {
            double s = qm_random_range(&random, 0, 1), t = qm_random_range(&random, 0, 1);
            qm_vec flat = s >= t ? qm_vec_mix(h[0], qm_vec_mix(h[1], h[2], s > 0 ? t / s : 0), s)
                                 : qm_vec_mix(h[0], qm_vec_mix(h[3], h[2], t > 0 ? s / t : 0), t);
            double apart = qm_vec_distance(qm_bilinear_at(&patch, s, t), flat), size = qm_vec_norm(flat);
            bool is_moved = qm_vec_distance(h[0], at[0]) > 0.0; /* else it is the nearest point that counts */
            qm_bilinear_footpoint foot = qm_bilinear_project(&patch, flat, ERROR, INFINITY);
            apart = is_moved ? apart : foot.distance;
            QM_CHECK(apart <= halves.slack + ERROR + ROUND(size), "%s, seed %llu: %g apart, slack %g",
                     c->name, (unsigned long long)seed, apart, halves.slack);
        }
    }
}

/** A corner near to the segment between its neighbours, or to one of them: the patch is as good as a
 * triangle, and is so said, though it may be folded. Both surfaces lie within the slack of one another. */
static void collapsed_patches_are_triangles(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 2000; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], off[3], crumb = seed % 2 ? pow(10, qm_random_range(&random, -16, -3)) : 0;
        for (int i = 0; i < 4; i++)
            qm_random_point(&random, -1, 1, corner[i]);
        size_t i = qm_random_below(&random, 4);
        double share = (double[]){0, 1, qm_random_range(&random, 0, 1)}[qm_random_below(&random, 3)];
        qm_random_direction(&random, off);
        for (int k = 0; k < 3; k++)
            corner[i][k] = corner[(i + 3) % 4][k] +
                           share * (corner[(i + 1) % 4][k] - corner[(i + 3) % 4][k]) + crumb * off[k];
        qm_vec at[4];
        for (int k = 0; k < 4; k++)
            at[k] = qm_vec_load(corner[k]);
        double twist = qm_bilinear_twist(at);
        QM_CHECK(twist <= 2.01 * crumb + 4e-14, "seed %llu: crumb %g, twist %g", (unsigned long long)seed,
                 crumb, twist);
        qm_bilinear patch = engine_patch(corner);
        for (int k = 0; k < 10; k++) {
            double s = qm_random_range(&random, 0, 1), t = qm_random_range(&random, 0, 1), p[3];
            qm_vec_store(p, qm_bilinear_at(&patch, s, t));
            double apart = fmin(qm_slow_triangle_distance(p, corner[0], corner[1], corner[2]),
                                qm_slow_triangle_distance(p, corner[0], corner[2], corner[3]));
            qm_vec flat = s >= t ? qm_vec_mix(at[0], qm_vec_mix(at[1], at[2], s > 0 ? t / s : 0), s)
                                 : qm_vec_mix(at[0], qm_vec_mix(at[3], at[2], t > 0 ? s / t : 0), t);
            qm_vec_store(p, flat);
            double back = qm_slow_patch_distance(p, corner, ERROR).lower;
            QM_CHECK(fmax(apart, back) <= twist + ERROR + ROUND(1), "seed %llu: %g and %g apart, twist %g",
                     (unsigned long long)seed, apart, back, twist);
        }
    }
}

/** Two sides of a bow-tie cross in a point, where both sheets have narrow valleys: a point of it is found on
 * its own sheet, however near to the crossing it lies. */
static void descents_find_both_sheets_of_a_bow_tie(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 5000; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3];
        for (int i = 0; i < 4; i++)
            qm_random_point(&random, -1, 1, corner[i]);
        /* The fourth side of a trapezium that is crossed: at s = 1 / (1 + wide), or t, all is one point. */
        double wide = seed % 2 ? 1 : qm_random_range(&random, 0.2, 5), flip = 1 / (1 + wide);
        bool is_s = qm_random_below(&random, 2) == 0;
        for (int k = 0; k < 3; k++)
            if (is_s)
                corner[2][k] = corner[1][k] - wide * (corner[3][k] - corner[0][k]);
            else
                corner[2][k] = corner[3][k] - wide * (corner[1][k] - corner[0][k]);
        qm_bilinear patch = engine_patch(corner);
        double near = pow(10, qm_random_range(&random, -6, 0)), along = qm_random_range(&random, 0, 1);
        double across = flip + near * (qm_random_below(&random, 2) ? 1 - flip : -flip);
        qm_vec p = is_s ? qm_bilinear_at(&patch, across, along) : qm_bilinear_at(&patch, along, across);
        double found = qm_bilinear_minimise(&patch, p, INFINITY).distance;
        QM_CHECK(found <= 1e-9, "seed %llu: %g beside %g (%d), %g along: %g away", (unsigned long long)seed,
                 across - flip, flip, (int)is_s, along, found);
    }
}

/** The segments of a bow-tie shrink to a point, or to nearly one: a crumb below which they count as a point, or above. */
static void descents_pass_segments_that_shrink(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 1000; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], p[3], crumb = seed % 3 ? pow(10, qm_random_range(&random, -16, -6)) : 0;
        for (int i = 0; i < 4; i++)
            qm_random_point(&random, -1, 1, corner[i]);
        for (int k = 0; k < 3; k++)
            corner[2][k] =
                corner[1][k] - (corner[3][k] - corner[0][k]) + crumb * qm_random_range(&random, -1, 1);
        qm_bilinear patch = engine_patch(corner);
        draw_query(&random, &patch, p);
        double found = qm_bilinear_minimise(&patch, qm_vec_load(p), INFINITY).distance;
        double nearest = qm_slow_patch_distance(p, corner, 1e-9).upper;
        QM_CHECK(found <= nearest + 1e-8, "seed %llu: %.17g, slow twin %.17g, crumb %g",
                 (unsigned long long)seed, found, nearest, crumb);
    }
}

/** A folded patch has several local minima, two of them close to one another beside its fold: the nearest is
 * found, from points on the fold and away from it. */
static void descents_find_the_nearest_local_minimum(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 2000; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_mesh one = qm_folded_heap(&random, 1);
        double corner[4][3], size = 0, offset[3], p[3];
        memcpy(corner, one.positions, sizeof corner);
        qm_bilinear patch = engine_patch(corner);
        for (int i = 1; i < 4; i++)
            size = fmax(size, qm_vec_distance(qm_vec_load(corner[0]), qm_vec_load(corner[i])));
        double uv[2] = {qm_random_range(&random, 0, 1), qm_random_range(&random, 0, 1)};
        qm_bilinear_jacobian area = qm_bilinear_jacobian_make(&patch);
        double fold = -(area.at + area.rise[0] * uv[0]) / area.rise[1];
        if (seed % 2 && fold > 0 && fold < 1) uv[1] = fold;
        qm_random_point(&random, -1, 1, offset);
        qm_vec on = qm_bilinear_at(&patch, uv[0], uv[1]);
        double far = size * pow(10, qm_random_range(&random, -9, 0.3));
        qm_vec_store(p, qm_vec_axpy(on, far, qm_vec_load(offset)));
        double found = qm_bilinear_minimise(&patch, qm_vec_load(p), INFINITY).distance;
        double nearest = qm_slow_distance(&one, QM_QUADS_BILINEAR, p, 1e-8 * size).upper;
        QM_CHECK(found <= nearest + 1e-7 * size, "seed %llu: %.17g, slow twin %.17g, size %g",
                 (unsigned long long)seed, found, nearest, size);
        qm_shape_free(&one);
    }
}

/** Points on the axis of symmetry of a saddle have two nearest points, or a whole neighbourhood at the
 * centre of curvature: the worst case for any search. */
static void saddles_are_certified_at_their_centres_of_curvature(void **state)
{
    (void)state;
    const double corner[4][3] = {{-1, -1, 1}, {1, -1, -1}, {1, 1, 1}, {-1, 1, -1}};
    qm_bilinear patch = engine_patch(corner);
    for (int i = -40; i <= 40; ++i) {
        const double p[3] = {0, 0, i / 20.0};
        qm_bilinear_footpoint foot = qm_bilinear_project(&patch, qm_vec_load(p), ERROR, INFINITY);
        /* On x = y: z = x^2, so |p - Q|^2 = 2 x^2 + (x^2 - h)^2, least at x^2 = |h| - 1 where that is > 0. */
        double h = fabs(p[2]), square = fmin(1, fmax(0, h - 1));
        double expected = sqrt(2 * square + (square - h) * (square - h));
        QM_CHECK(fabs(foot.distance - expected) <= 1e-12, "height %g: %.17g, not %.17g", p[2], foot.distance,
                 expected);
        QM_CHECK(foot.distance - foot.lower <= ERROR + ROUND(foot.distance), "height %g: gap %g", p[2],
                 foot.distance - foot.lower);
    }
}

/** Patches of no area: a point, a segment in several parametrizations, three equal corners. */
static void degenerate_patches_are_segments_and_points(void **state)
{
    (void)state;
    static const int orders[][4] = {{0, 0, 0, 0}, {0, 1, 1, 0}, {0, 0, 1, 1}, {0, 1, 0, 1},
                                    {0, 0, 0, 1}, {0, 1, 1, 1}, {0, 0, 1, 0}};
    for (size_t k = 0; k < sizeof orders / sizeof *orders; ++k)
        for (uint64_t seed = 0; seed < 50; ++seed) {
            qm_random random = qm_random_make(qm_check_seed(), seed);
            double end[2][3], corner[4][3], p[3];
            qm_random_point(&random, -0.5, 0.5, end[0]);
            qm_random_point(&random, -0.5, 0.5, end[1]);
            qm_random_point(&random, -1, 1, p);
            for (int i = 0; i < 4; ++i)
                for (int axis = 0; axis < 3; ++axis)
                    corner[i][axis] = end[orders[k][i]][axis];
            qm_bilinear patch = engine_patch(corner);
            qm_bilinear_footpoint foot = qm_bilinear_project(&patch, qm_vec_load(p), ERROR, INFINITY);
            check_foot(&patch, &foot, p, "degenerate", seed);
            double expected = qm_slow_triangle_distance(p, end[0], k == 0 ? end[0] : end[1], end[0]);
            QM_CHECK(fabs(foot.distance - expected) <= 2 * ERROR, "order %zu, seed %llu: %.17g, not %.17g", k,
                     (unsigned long long)seed, foot.distance, expected);
            QM_CHECK(foot.distance - foot.lower <= ERROR + ROUND(foot.distance),
                     "order %zu, seed %llu: gap %g", k, (unsigned long long)seed, foot.distance - foot.lower);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(certified_distances_match_the_slow_twin),
        cmocka_unit_test(winding_needles_are_certified),
        cmocka_unit_test(no_lattice_point_is_nearer),
        cmocka_unit_test(a_bound_to_stop_at_keeps_its_promise),
        cmocka_unit_test(descents_are_points_of_the_patch),
        cmocka_unit_test(halves_are_within_their_slack),
        cmocka_unit_test(collapsed_patches_are_triangles),
        cmocka_unit_test(descents_find_both_sheets_of_a_bow_tie),
        cmocka_unit_test(descents_pass_segments_that_shrink),
        cmocka_unit_test(descents_find_the_nearest_local_minimum),
        cmocka_unit_test(saddles_are_certified_at_their_centres_of_curvature),
        cmocka_unit_test(degenerate_patches_are_segments_and_points),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
