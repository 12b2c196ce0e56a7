/* The Hausdorff distance of shapes whose distance is known, and what the options promise. */
#include "check.h"

#include "failing_allocator.h"
#include "measured.h"
#include "random.h"
#include "shapes.h"

#include <math.h>
#include <string.h>

static const qm_direction directions[] = {QM_TWO_SIDED, QM_A_TO_B, QM_B_TO_A};

static qm_status measure_in(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                            const qm_hausdorff_options *options, qm_hausdorff_result *result)
{
    qm_bvh *tree_a = NULL, *tree_b = NULL;
    qm_status status = qm_bvh_build(ctx, a, QM_BVH_ALL, 1, &tree_a);
    if (status == QM_OK) status = qm_bvh_build(ctx, b, QM_BVH_ALL, 1, &tree_b);
    if (status == QM_OK) status = qm_hausdorff_measure(ctx, tree_a, tree_b, options, result);
    qm_bvh_destroy(ctx, tree_a);
    qm_bvh_destroy(ctx, tree_b);
    return status;
}

static qm_hausdorff_options options_of(qm_direction direction, qm_quad_reading reading, double tolerance)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = direction;
    options.quads = reading;
    options.tolerance = tolerance;
    options.work_limit = 400000; /* far more than any of these shapes needs: a failure rather than a hang */
    return options;
}

static qm_hausdorff_result measure(const qm_mesh *a, const qm_mesh *b, qm_direction direction,
                                   qm_quad_reading reading, double tolerance)
{
    qm_hausdorff_options options = options_of(direction, reading, tolerance);
    return qm_measured(a, b, &options);
}

/** The bracket holds the expected value, up to rounding of the input, and is as narrow as requested. */
static void check_value(const char *name, const qm_mesh *a, const qm_mesh *b, qm_direction direction,
                        qm_quad_reading reading, double tolerance, double expected)
{
    qm_hausdorff_result r = measure(a, b, direction, reading, tolerance);
    double slack = 1e-15 * (1 + expected);
    QM_CHECK(r.lower <= expected + slack && r.upper >= expected - slack,
             "%s, direction %d, reading %d: [%.17g, %.17g], expected %.17g", name, (int)direction,
             (int)reading, r.lower, r.upper, expected);
    QM_CHECK(r.stop == QM_STOP_CONVERGED && r.upper - r.lower <= tolerance,
             "%s, direction %d, reading %d: stop %d, width %g", name, (int)direction, (int)reading,
             (int)r.stop, r.upper - r.lower);
    assert_true(r.has_witness);
}

/** The same value in both readings; ab and ba one way, the greater of them both ways. */
static void check_pair(const char *name, const qm_mesh *a, const qm_mesh *b, double tolerance, double ab,
                       double ba)
{
    for (int reading = 0; reading < 2; ++reading) {
        check_value(name, a, b, QM_A_TO_B, (qm_quad_reading)reading, tolerance, ab);
        check_value(name, a, b, QM_B_TO_A, (qm_quad_reading)reading, tolerance, ba);
        check_value(name, a, b, QM_TWO_SIDED, (qm_quad_reading)reading, tolerance, fmax(ab, ba));
    }
}

static void the_turned_spheres_are_one_minus_cosine_apart(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(M_PI / 100);
    double expected = 1 - cos(M_PI / 100), diagonal = 3.46;
    check_pair("spheres", &a, &b, 1e-8 * diagonal, expected, expected);
    qm_mesh split = qm_shape_triangulated(&a);
    check_pair("sphere of triangles", &split, &b, 1e-8 * diagonal, expected, expected);
    check_value("spheres, closely", &a, &b, QM_TWO_SIDED, QM_QUADS_TRIANGLES, 1e-8 * expected, expected);
    qm_shape_free(&a);
    qm_shape_free(&b);
    qm_shape_free(&split);
}

static void parallel_planes_are_their_offset_apart(void **state)
{
    (void)state;
    static const double offsets[] = {0.25, 1e-3, 1e-9, 1e-12};
    for (size_t k = 0; k < 4; ++k) {
        qm_mesh low = qm_shape_plane(7, 0), high = qm_shape_plane(5, offsets[k]);
        check_pair("planes", &low, &high, 1e-9, offsets[k], offsets[k]);
        qm_shape_free(&low);
        qm_shape_free(&high);
    }
}

static void moved_cubes_are_their_move_apart(void **state)
{
    (void)state;
    qm_mesh cube = qm_shape_box(1, 1, 1), moved = qm_shape_box(1, 1, 1), inner = qm_shape_box(1, 1, 1);
    qm_shape_move(&moved, 1, (const double[3]){2.5, 0, 0});
    check_pair("moved cube", &cube, &moved, 1e-10, 2.5, 2.5);
    /* Half the size about the same middle: a quarter from the sides, sqrt(3)/4 from the corners. */
    qm_shape_move(&inner, 0.5, (const double[3]){0.25, 0.25, 0.25});
    check_pair("cube in cube", &cube, &inner, 1e-9, sqrt(3) / 4, 0.25);
    qm_shape_free(&cube);
    qm_shape_free(&moved);
    qm_shape_free(&inner);
}

static void saddles_are_one_surface_in_the_bilinear_reading(void **state)
{
    (void)state;
    static const int sizes[] = {1, 4, 32};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int d = 0; d < 3; ++d) {
                qm_mesh a = qm_shape_saddle(sizes[i]), b = qm_shape_saddle(sizes[j]);
                check_value("saddles", &a, &b, directions[d], QM_QUADS_BILINEAR, 1e-6, 0);
                qm_shape_free(&a);
                qm_shape_free(&b);
            }
    /* One quad as two triangles: its middle lies at height 1, that of the 2 x 2 saddle at 0. The triangles'
     * edge x = y, z = 1 and the vertex at the origin: the plane z = 1 - |x - y| is 1 / sqrt(3) away. */
    qm_mesh one = qm_shape_saddle(1), two = qm_shape_saddle(2);
    check_value("saddles of triangles", &two, &one, QM_A_TO_B, QM_QUADS_TRIANGLES, 1e-9, 1 / sqrt(3));
    qm_shape_free(&one);
    qm_shape_free(&two);
}

static void a_mesh_is_at_distance_zero_from_itself(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    qm_mesh meshes[] = {qm_shape_sphere(0),
                        qm_shape_torus(24, 12, 1, 0.4),
                        qm_shape_strip(20, 3, 9),
                        qm_shape_strip(2, 1, 9),
                        qm_shape_box(1, 1, 0),
                        qm_shape_copies(20),
                        qm_shape_points(&random, 50),
                        qm_shape_soup(&random, 30, QM_SOUP_MIXED, QM_SOUP_POOLED, 2),
                        qm_shape_soup(&random, 30, QM_SOUP_MIXED, QM_SOUP_APART, 2)};
    for (size_t k = 0; k < sizeof meshes / sizeof *meshes; ++k) {
        qm_mesh same = qm_shape_reversed(&meshes[k]);
        for (int reading = 0; reading < 2; ++reading)
            for (int d = 0; d < 3; ++d) {
                qm_hausdorff_result r =
                    measure(&meshes[k], &same, directions[d], (qm_quad_reading)reading, 1e-6);
                QM_CHECK(r.lower <= 1e-15 && r.upper <= 1e-6 && r.stop == QM_STOP_CONVERGED,
                         "mesh %zu, reading %d: [%g, %g]", k, reading, r.lower, r.upper);
            }
        qm_shape_free(&same);
        qm_shape_free(&meshes[k]);
    }
}

/** As two copies of the same arrays, without a search; and one bit away, with one. */
static void equal_arrays_are_seen_at_once(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    qm_mesh meshes[] = {qm_shape_torus(24, 12, 1, 0.4), qm_shape_points(&random, 50)};
    for (size_t k = 0; k < sizeof meshes / sizeof *meshes; ++k) {
        qm_mesh same = qm_shape_copy(&meshes[k]), near = qm_shape_copy(&meshes[k]);
        double *last = near.positions + 3 * near.vertex_count - 1;
        *last = nextafter(*last, INFINITY);
        for (int reading = 0; reading < 2; ++reading) {
            for (int d = 0; d < 3; ++d) {
                qm_hausdorff_options options = options_of(directions[d], (qm_quad_reading)reading, 1e-9);
                options.threshold = 0.0;
                qm_hausdorff_result r = qm_measured(&meshes[k], &same, &options);
                assert_true(r.lower == 0.0 && r.upper == 0.0 && r.stop == QM_STOP_CONVERGED);
                assert_int_equal(r.iterations + r.projections, 0);
                assert_int_equal(r.verdict, -1);
                assert_int_equal(r.from_side, directions[d] == QM_B_TO_A);
                assert_true(r.has_witness);
                uint32_t face = r.from.face;
                uint32_t vertex = same.face_count > 0 ? same.faces[4 * face] : face;
                assert_memory_equal(r.from.position, same.positions + 3 * vertex, sizeof r.from.position);
                assert_memory_equal(&r.to, &r.from, sizeof r.to);
                r = measure(&meshes[k], &near, directions[d], (qm_quad_reading)reading, 1e-9);
                assert_true(r.projections > 0 && r.upper > 0.0);
            }
        }
        qm_shape_free(&near);
        qm_shape_free(&same);
        qm_shape_free(&meshes[k]);
    }
    /* The same vertices between other corners are another surface: the square's other diagonal is bent. */
    static const double corners[][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 1}, {0, 1, 0}};
    qm_mesh bent = qm_shape_face(4, corners), turned = qm_shape_copy(&bent);
    for (uint32_t c = 0; c < 4; ++c)
        turned.faces[c] = (c + 1) % 4;
    assert_true(measure(&bent, &turned, QM_TWO_SIDED, QM_QUADS_TRIANGLES, 1e-9).lower > 0.1);
    qm_shape_free(&turned);
    qm_shape_free(&bent);
}

/** Quads and the triangles that they are read as are one surface; as patches, or with another diagonal or a
 * face less, they are not. */
static void quads_and_their_triangles_are_seen_at_once(void **state)
{
    (void)state;
    qm_mesh quads = qm_shape_saddle(6), triangles = qm_shape_triangulated(&quads);
    const qm_mesh *const meshes[] = {&quads, &triangles};
    for (int from = 0; from < 2; ++from) {
        const qm_mesh *a = meshes[from], *b = meshes[1 - from];
        for (int d = 0; d < 3; ++d) {
            qm_hausdorff_result r = measure(a, b, directions[d], QM_QUADS_TRIANGLES, 1e-9);
            assert_true(r.lower == 0.0 && r.upper == 0.0 && r.stop == QM_STOP_CONVERGED && r.has_witness);
            assert_int_equal(r.iterations + r.projections, 0);
            assert_memory_equal(r.from.position, r.to.position, sizeof r.to.position);
            const qm_mesh *on[2] = {r.from_side ? b : a, r.from_side ? a : b};
            const uint32_t faces[2] = {r.from.face, r.to.face};
            for (int k = 0; k < 2; ++k) {
                const double *p = on[k]->positions + 3 * (size_t)on[k]->faces[4 * (size_t)faces[k]];
                assert_memory_equal(p, r.from.position, sizeof r.from.position);
            }
            assert_true(measure(a, b, directions[d], QM_QUADS_BILINEAR, 1e-6).lower > 1e-4);
        }
    }
    --triangles.face_count;
    assert_true(measure(&quads, &triangles, QM_A_TO_B, QM_QUADS_TRIANGLES, 1e-9).lower > 1e-3);
    ++triangles.face_count;
    uint32_t *last = triangles.faces + 4 * (triangles.face_count - 2), fourth = last[6];
    last[2] = last[5] = fourth;
    assert_true(measure(&quads, &triangles, QM_TWO_SIDED, QM_QUADS_TRIANGLES, 1e-9).projections > 0);
    qm_shape_free(&triangles);
    qm_shape_free(&quads);
}

static void moved_twisted_quads_are_at_most_their_move_apart(void **state)
{
    (void)state;
    const double bends[] = {0.05, 0.3, 1.0, 2.0}; /* in edge lengths: the last ones fold over */
    int folded = 0, converged = 0;
    for (uint64_t seed = 0; seed < 40; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double bend = bends[seed % 4];
        qm_mesh a = qm_shape_soup(&random, 10, QM_SOUP_QUADS, QM_SOUP_APART, bend), b = qm_shape_copy(&a);
        double move[3];
        qm_random_direction(&random, move);
        for (int k = 0; k < 3; ++k)
            move[k] *= 1e-3;
        qm_shape_move(&b, 1, move);
        qm_hausdorff_options options = options_of(QM_A_TO_B, QM_QUADS_BILINEAR, 1e-7);
        options.work_limit = 10000;
        qm_hausdorff_result r = qm_measured(&a, &b, &options);
        bool is_closed = r.upper <= 1e-3 + 1e-7;
        QM_CHECK(r.lower <= 1e-3 + 1e-15 && r.upper >= r.lower && (is_closed || bend >= 1.0),
                 "seed %llu, bend %g: [%.17g, %.17g]", (unsigned long long)seed, bend, r.lower, r.upper);
        folded += bend >= 1.0;
        converged += bend >= 1.0 && is_closed;
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
    /* A fold that lies on its own moved copy may take more work than the limit; the bracket holds all the
     * same. */
    QM_CHECK(converged * 100 >= folded * 75, "%d of %d folded pairs converged", converged, folded);
}

static void single_facets_and_points_have_their_school_distances(void **state)
{
    (void)state;
    qm_mesh triangle = qm_shape_face(3, (const double[][3]){{0, 0, 0}, {4, 0, 0}, {0, 3, 0}});
    qm_mesh above = qm_shape_face(3, (const double[][3]){{0, 0, 2}, {4, 0, 2}, {0, 3, 2}});
    qm_mesh segment = qm_shape_face(3, (const double[][3]){{0, 0, 0}, {4, 0, 0}, {4, 0, 0}});
    qm_mesh dot = qm_shape_face(3, (const double[][3]){{0, 0, 0}, {0, 0, 0}, {0, 0, 0}});
    qm_mesh flat = qm_shape_face(4, (const double[][3]){{0, 0, 0}, {2, 0, 0}, {4, 0, 0}, {1, 0, 0}});
    qm_mesh point = qm_shape_make(1, 0);
    memcpy(point.positions, (const double[]){4, 0, 12}, 24);
    check_pair("triangles", &triangle, &above, 1e-12, 2, 2);
    check_pair("triangle and segment", &triangle, &segment, 1e-12, 3, 0);
    check_pair("triangle and dot", &triangle, &dot, 1e-12, 4, 0);
    check_pair("segment and dot", &segment, &dot, 1e-12, 4, 0);
    check_pair("segment and flat quad", &segment, &flat, 1e-10, 0, 0);
    check_pair("triangle and point", &triangle, &point, 1e-10, sqrt(12 * 12 + 25), 12);
    check_pair("point and dot", &point, &dot, 1e-10, sqrt(160), sqrt(160));
    check_pair("point and itself", &point, &point, 1e-12, 0, 0);
    qm_mesh *all[] = {&triangle, &above, &segment, &dot, &flat, &point};
    for (size_t k = 0; k < 6; ++k)
        qm_shape_free(all[k]);
}

static void point_sets_match_the_plain_loop(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 3);
    qm_mesh a = qm_shape_points(&random, 400), b = qm_shape_points(&random, 300);
    double sides[2] = {0, 0};
    for (int side = 0; side < 2; ++side) {
        const qm_mesh *from = side ? &b : &a, *to = side ? &a : &b;
        for (size_t i = 0; i < from->vertex_count; ++i) {
            double least = INFINITY;
            for (size_t j = 0; j < to->vertex_count; ++j) {
                const double *p = from->positions + 3 * i, *q = to->positions + 3 * j;
                least = fmin(least, hypot(hypot(p[0] - q[0], p[1] - q[1]), p[2] - q[2]));
            }
            sides[side] = fmax(sides[side], least);
        }
    }
    check_pair("point sets", &a, &b, 1e-12, sides[0], sides[1]);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Between two bent walls a triangle is farthest from them where the line half way between them leaves it. */
static void a_ridge_between_patches_is_climbed(void **state)
{
    (void)state;
    static const double triangle[3][3] = {{0, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
    uint64_t iterations = 0;
    for (uint64_t number = 0; number < 20; number++) {
        qm_random random = qm_random_make(qm_check_seed(), number);
        qm_mesh wall[2];
        for (int side = 0; side < 2; side++) {
            double corner[4][3], out = side ? 1.0 : -1.0;
            for (int i = 0; i < 4; i++) {
                double y = (double)((i + 1) / 2 % 2), z = (double)(i / 2);
                qm_random_point(&random, -0.1, 0.1, corner[i]);
                corner[i][0] += out * (1.5 + 0.3 * y);
                corner[i][1] += 4.0 * y - 2.0;
                corner[i][2] += 4.0 * z - 2.0;
            }
            wall[side] = qm_shape_face(4, corner);
        }
        qm_mesh a = qm_shape_face(3, triangle), b = qm_shape_joined(&wall[0], &wall[1]);
        qm_hausdorff_result r = measure(&a, &b, QM_A_TO_B, QM_QUADS_BILINEAR, 1e-9);
        QM_CHECK(r.stop == QM_STOP_CONVERGED, "case %d: stop %d", (int)number, (int)r.stop);
        iterations += r.iterations;
        qm_shape_free(&a);
        qm_shape_free(&b);
        qm_shape_free(&wall[0]);
        qm_shape_free(&wall[1]);
    }
    QM_CHECK(iterations < 600, "%llu parts for 20 triangles", (unsigned long long)iterations);
}

static void unused_vertices_do_not_matter(void **state)
{
    (void)state;
    qm_mesh low = qm_shape_plane(4, 0), high = qm_shape_plane(4, 0.5);
    qm_mesh padded = qm_shape_with_unused(&low, 5, (const double[3]){90, -80, 70});
    check_pair("unused vertices", &padded, &high, 1e-10, 0.5, 0.5);
    check_pair("unused vertices", &high, &padded, 1e-10, 0.5, 0.5);
    qm_shape_free(&low);
    qm_shape_free(&high);
    qm_shape_free(&padded);
}

static void thresholds_give_a_verdict(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(M_PI / 100);
    double distance = 1 - cos(M_PI / 100);
    static const double factors[] = {0, 0.1, 0.99, 1.01, 10};
    for (int d = 0; d < 3; ++d)
        for (size_t k = 0; k < 5; ++k) {
            qm_hausdorff_options options = options_of(directions[d], QM_QUADS_TRIANGLES, 1e-8);
            options.threshold = factors[k] * distance;
            qm_hausdorff_result r = qm_measured(&a, &b, &options);
            QM_CHECK(r.verdict == (factors[k] < 1 ? 1 : -1), "factor %g: verdict %d", factors[k], r.verdict);
            QM_CHECK(r.lower <= distance && r.upper >= distance * (1 - 1e-12), "factor %g: [%.17g, %.17g]",
                     factors[k], r.lower, r.upper);
            QM_CHECK(factors[k] < 1 ? r.lower > options.threshold : r.upper <= options.threshold,
                     "factor %g: [%.17g, %.17g] does not prove it", factors[k], r.lower, r.upper);
            assert_true(r.stop == QM_STOP_THRESHOLD || r.stop == QM_STOP_CONVERGED);
        }
    qm_hausdorff_options plain = options_of(QM_TWO_SIDED, QM_QUADS_TRIANGLES, 1e-8);
    assert_int_equal(qm_measured(&a, &b, &plain).verdict, 0);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void limits_leave_a_bracket_that_holds(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(M_PI / 100);
    double distance = 1 - cos(M_PI / 100);
    for (int reading = 0; reading < 2; ++reading)
        for (uint64_t limit = 1; limit < 100000; limit *= 10) {
            qm_hausdorff_options options = options_of(QM_TWO_SIDED, (qm_quad_reading)reading, 1e-12);
            options.work_limit = limit;
            qm_hausdorff_result r = qm_measured(&a, &b, &options);
            QM_CHECK(r.lower <= distance + 1e-15 && r.upper >= distance - 1e-15, "limit %llu: [%.17g, %.17g]",
                     (unsigned long long)limit, r.lower, r.upper);
            bool has_ended = r.stop == QM_STOP_CONVERGED || r.stop == QM_STOP_PRECISION;
            QM_CHECK(r.stop == QM_STOP_DEADLINE || (has_ended && r.upper - r.lower <= 1e-12),
                     "limit %llu: stop %d, [%.17g, %.17g]", (unsigned long long)limit, (int)r.stop, r.lower,
                     r.upper);
        }
    qm_hausdorff_options options = options_of(QM_TWO_SIDED, QM_QUADS_BILINEAR, 1e-13);
    options.deadline_ms = 1e-3;
    qm_hausdorff_result r = qm_measured(&a, &b, &options);
    assert_true(r.lower <= distance + 1e-15 && r.upper >= distance - 1e-15);
    assert_int_equal(r.stop, QM_STOP_DEADLINE);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** The bilinear patch of a concave quad, which folds over, cut in n x n quads. */
static qm_mesh cut_dart(uint32_t n)
{
    static const double corner[4][3] = {{0, 0, 0}, {1, 0, 0.1}, {0.25, 0.25, 0}, {0, 1, -0.1}};
    qm_mesh mesh = qm_shape_make((n + 1) * (n + 1), n * n);
    for (uint32_t j = 0; j <= n; j++)
        for (uint32_t i = 0; i <= n; i++)
            for (int k = 0; k < 3; k++) {
                double s = (double)i / n, t = (double)j / n;
                mesh.positions[3 * (j * (n + 1) + i) + (uint32_t)k] =
                    (1 - s) * (1 - t) * corner[0][k] + s * (1 - t) * corner[1][k] + s * t * corner[2][k] +
                    (1 - s) * t * corner[3][k];
            }
    for (uint32_t j = 0; j < n; j++)
        for (uint32_t i = 0; i < n; i++) {
            uint32_t first = j * (n + 1) + i, *face = mesh.faces + 4 * (j * n + i);
            const uint32_t index[4] = {first, first + 1, first + n + 2, first + n + 1};
            for (int k = 0; k < 4; k++)
                face[k] = index[k];
        }
    return mesh;
}

/** One folded surface in two grids, whose distance is 0. */
static void folds_of_other_grids_converge(void **state)
{
    (void)state;
    qm_mesh a = cut_dart(2), b = cut_dart(3);
    qm_hausdorff_result r = measure(&a, &b, QM_TWO_SIDED, QM_QUADS_BILINEAR, 1e-12);
    assert_int_equal(r.stop, QM_STOP_CONVERGED);
    QM_CHECK(r.lower <= 1e-15 && r.upper > 0.0, "[%g, %g]", r.lower, r.upper);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Bounds by matching fall with the size of a piece alone, so that this takes very many. */
static void a_search_ends_at_a_bound_of_parts_and_memory(void **state)
{
    (void)state;
    qm_mesh a = cut_dart(2), b = cut_dart(3);
    const size_t lanes = 2 * (4 + 9), packs = 2 * lanes / 8;
    for (int limit = 0; limit < 2; limit++) {
        qm_hausdorff_options options = options_of(QM_A_TO_B, QM_QUADS_BILINEAR, 1e-12);
        options.bounds = QM_BOUNDS_MATCHING;
        options.work_limit = 0;
        options.memory_limit = limit ? 65536 : 0;
        qm_hausdorff_result r = qm_measured(&a, &b, &options);
        assert_int_equal(r.stop, limit ? QM_STOP_MEMORY : QM_STOP_WORK);
        QM_CHECK(r.lower <= 1e-15 && r.upper > 1e-12 && r.upper < 0.1, "[%g, %g]", r.lower, r.upper);
        /* Limits are looked at every so many entries, and an entry has a visit's worth of parts. */
        QM_CHECK(r.iterations <= QM_HAUSDORFF_BASE_WORK + QM_HAUSDORFF_FACE_WORK * 8 * packs + 2048,
                 "%llu parts", (unsigned long long)r.iterations);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void tolerances_below_precision_are_said_to_be_so(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(M_PI / 100);
    double distance = 1 - cos(M_PI / 100);
    for (int reading = 0; reading < 2; ++reading) {
        qm_hausdorff_result r = measure(&a, &b, QM_A_TO_B, (qm_quad_reading)reading, 1e-300);
        assert_int_equal(r.stop, QM_STOP_PRECISION);
        assert_true(r.lower <= distance + 1e-15 && r.upper >= distance - 1e-15);
        QM_CHECK(r.upper - r.lower <= 1e-10, "[%.17g, %.17g]", r.lower, r.upper);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** What the progress callback has seen: bounds may only get tighter and must hold the distance. */
typedef struct watch {
    qm_hausdorff_progress last;
    double distance;
    int calls;
    bool valid;
    atomic_bool *cancel; /* raised at the first call when given */
} watch;

static void look(void *user, const qm_hausdorff_progress *now)
{
    watch *w = user;
    bool holds = now->lower <= w->distance + 1e-15 && now->upper >= w->distance - 1e-15;
    bool tighter =
        w->calls == 0 || (now->lower >= w->last.lower && now->upper <= w->last.upper &&
                          now->elapsed_ms >= w->last.elapsed_ms && now->iterations >= w->last.iterations);
    w->valid = w->valid && holds && tighter;
    w->last = *now;
    ++w->calls;
    if (w->cancel) atomic_store(w->cancel, true);
}

static void progress_only_ever_tightens(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(M_PI / 100);
    for (int threads = 1; threads <= 4; threads += 3)
        for (int d = 0; d < 3; ++d) {
            watch w = {.distance = 1 - cos(M_PI / 100), .valid = true};
            qm_hausdorff_options options = options_of(directions[d], QM_QUADS_BILINEAR, 1e-9);
            options.thread_count = threads;
            options.progress = look;
            options.progress_user = &w;
            qm_hausdorff_result r = qm_measured(&a, &b, &options);
            QM_CHECK(w.valid, "threads %d, direction %d: a bound moved the wrong way", threads, d);
            /* Of several workers one reports at a time, and the others do not wait for it. */
            int least = threads == 1 ? 3 : 1;
            QM_CHECK(w.calls >= least, "threads %d, direction %d: %d calls", threads, d, w.calls);
            assert_true(r.lower >= w.last.lower && r.upper <= w.last.upper);
        }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** A host without threads that takes the workers' tasks from the last to the first. */
static void run_backwards(void *user, int worker_count, void (*task)(void *data, int worker), void *data)
{
    (void)user;
    while (worker_count-- > 0)
        task(data, worker_count);
}

static void no_worker_waits_for_another(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(M_PI / 100);
    qm_context ctx = qm_context_make();
    ctx.parallel = run_backwards;
    for (int d = 0; d < 3; ++d) {
        qm_hausdorff_options options = options_of(directions[d], QM_QUADS_TRIANGLES, 1e-9);
        options.thread_count = 3;
        qm_hausdorff_result r;
        assert_int_equal(measure_in(&ctx, &a, &b, &options, &r), QM_OK);
        double expected = 1 - cos(M_PI / 100);
        QM_CHECK(r.lower <= expected + 1e-15 && r.upper >= expected - 1e-15 && r.upper - r.lower <= 1e-9,
                 "direction %d: [%.17g, %.17g]", d, r.lower, r.upper);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void a_raised_flag_ends_the_search_with_its_bracket(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(M_PI / 100);
    double distance = 1 - cos(M_PI / 100);
    atomic_bool cancel = false;
    watch w = {.distance = distance, .valid = true, .cancel = &cancel};
    qm_context ctx = qm_context_make();
    ctx.cancel = &cancel;
    qm_hausdorff_options options = options_of(QM_TWO_SIDED, QM_QUADS_TRIANGLES, 1e-12);
    options.progress = look;
    options.progress_user = &w;
    qm_hausdorff_result r;
    assert_int_equal(measure_in(&ctx, &a, &b, &options, &r), QM_OK);
    assert_int_equal(r.stop, QM_STOP_CANCELED);
    assert_true(r.lower <= distance + 1e-15 && r.upper >= distance - 1e-15);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Before the first sample, among samples, groups, packs and parts. */
static void a_search_that_ends_anywhere_has_a_bracket_that_holds(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(M_PI / 100);
    double distance = 1 - cos(M_PI / 100);
    atomic_bool cancel = true;
    qm_context ctx = qm_context_make();
    qm_bvh *tree_a, *tree_b;
    assert_int_equal(qm_bvh_build(&ctx, &a, QM_BVH_ALL, 1, &tree_a), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_ALL, 1, &tree_b), QM_OK);
    for (int direction = QM_TWO_SIDED; direction <= QM_B_TO_A; ++direction)
        for (int reading = 0; reading < 2; ++reading)
            for (uint64_t limit = 0; limit < 400; limit += 7) {
                watch w = {.distance = distance, .valid = true};
                qm_hausdorff_options options =
                    options_of((qm_direction)direction, (qm_quad_reading)reading, 1e-12);
                options.progress = look;
                options.progress_user = &w;
                options.work_limit = limit;
                ctx.cancel = limit == 0 ? &cancel : NULL;
                qm_hausdorff_result r;
                assert_int_equal(qm_hausdorff_measure(&ctx, tree_a, tree_b, &options, &r), QM_OK);
                QM_CHECK(r.lower <= distance + 1e-15 && r.upper >= distance - 1e-15 && w.valid,
                         "direction %d, reading %d, limit %llu: [%.17g, %.17g]", direction, reading,
                         (unsigned long long)limit, r.lower, r.upper);
                if (limit == 0) assert_int_equal(r.stop, QM_STOP_CANCELED);
            }
    qm_bvh_destroy(&ctx, tree_a);
    qm_bvh_destroy(&ctx, tree_b);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void bad_options_are_refused_in_words(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1);
    qm_hausdorff_options good = options_of(QM_TWO_SIDED, QM_QUADS_TRIANGLES, 1e-6);
    qm_hausdorff_options bad[7];
    for (int k = 0; k < 7; ++k)
        bad[k] = good;
    bad[0].tolerance = 0;
    bad[1].tolerance = -1;
    bad[2].tolerance = NAN;
    bad[3].tolerance = INFINITY;
    bad[4].threshold = -1;
    bad[5].thread_count = 0;
    bad[6].thread_count = -3;
    for (int k = 0; k < 7; ++k) {
        qm_context ctx = qm_context_make();
        qm_hausdorff_result r;
        QM_CHECK(measure_in(&ctx, &box, &box, &bad[k], &r) == QM_E_ARGUMENT, "case %d is taken", k);
        QM_CHECK(strlen(ctx.message) > 0, "case %d has no message", k);
    }
    qm_shape_free(&box);
}

/** Fails each allocation in turn. */
static void running_out_of_memory_is_a_status_and_leaks_nothing(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(16, 8, 1, 0.4), b = qm_shape_torus(12, 9, 1, 0.4);
    for (int reading = 0; reading < 2; ++reading) {
        qm_status status = QM_E_NO_MEMORY;
        size_t fail_at = 0;
        for (; status != QM_OK; ++fail_at) {
            qm_failing_allocator memory = {.fail_at = fail_at};
            qm_context ctx = qm_context_make();
            ctx.allocator = qm_failing_allocator_hook(&memory);
            qm_hausdorff_options options = options_of(QM_TWO_SIDED, (qm_quad_reading)reading, 1e-4);
            qm_hausdorff_result r;
            status = measure_in(&ctx, &a, &b, &options, &r);
            QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: status %d", fail_at,
                     (int)status);
            QM_CHECK(memory.live_blocks == 0 && memory.live_bytes == 0, "call %zu: %zu blocks left", fail_at,
                     memory.live_blocks);
            QM_CHECK(!memory.mismatched, "call %zu: a block came back with another size", fail_at);
        }
        assert_true(fail_at >= 5);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** The trees' frames differ by the sizes of the meshes: either point of the witness is looked for as closely
 * as the tolerance requires, in its own unit. */
static void witnesses_on_meshes_of_very_different_sizes(void **state)
{
    (void)state;
    const double tolerance = 1e-2, none[3] = {0, 0, 0};
    for (uint64_t k = 0; k < 60; k++) {
        qm_random random = qm_random_make(qm_check_seed(), k);
        qm_mesh large = qm_shape_soup(&random, 2, QM_SOUP_QUADS, QM_SOUP_APART, 1.0),
                small = qm_shape_soup(&random, 2, QM_SOUP_QUADS, QM_SOUP_APART, 1.0);
        qm_shape_move(&large, 1e6, none);
        qm_hausdorff_result r = measure(&large, &small, QM_A_TO_B, QM_QUADS_BILINEAR, tolerance);
        double apart2 = 0;
        for (int i = 0; i < 3; i++)
            apart2 += pow(r.from.position[i] - r.to.position[i], 2);
        QM_CHECK(fabs(sqrt(apart2) - r.lower) <= 0.3 * tolerance, "case %u: %.17g apart, lower bound %.17g",
                 (unsigned)k, sqrt(apart2), r.lower);
        qm_shape_free(&large);
        qm_shape_free(&small);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_turned_spheres_are_one_minus_cosine_apart),
        cmocka_unit_test(parallel_planes_are_their_offset_apart),
        cmocka_unit_test(moved_cubes_are_their_move_apart),
        cmocka_unit_test(saddles_are_one_surface_in_the_bilinear_reading),
        cmocka_unit_test(a_mesh_is_at_distance_zero_from_itself),
        cmocka_unit_test(equal_arrays_are_seen_at_once),
        cmocka_unit_test(quads_and_their_triangles_are_seen_at_once),
        cmocka_unit_test(moved_twisted_quads_are_at_most_their_move_apart),
        cmocka_unit_test(single_facets_and_points_have_their_school_distances),
        cmocka_unit_test(point_sets_match_the_plain_loop),
        cmocka_unit_test(a_ridge_between_patches_is_climbed),
        cmocka_unit_test(unused_vertices_do_not_matter),
        cmocka_unit_test(thresholds_give_a_verdict),
        cmocka_unit_test(limits_leave_a_bracket_that_holds),
        cmocka_unit_test(folds_of_other_grids_converge),
        cmocka_unit_test(a_search_ends_at_a_bound_of_parts_and_memory),
        cmocka_unit_test(tolerances_below_precision_are_said_to_be_so),
        cmocka_unit_test(progress_only_ever_tightens),
        cmocka_unit_test(no_worker_waits_for_another),
        cmocka_unit_test(a_raised_flag_ends_the_search_with_its_bracket),
        cmocka_unit_test(a_search_that_ends_anywhere_has_a_bracket_that_holds),
        cmocka_unit_test(bad_options_are_refused_in_words),
        cmocka_unit_test(running_out_of_memory_is_a_status_and_leaks_nothing),
        cmocka_unit_test(witnesses_on_meshes_of_very_different_sizes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
