/* qm_extent_measure: shapes whose area and volume are known, random meshes against 113 bits, faces without area. */
#include "check.h"

#include "qm/extent.h"
#include "shapes.h"
#include "wide.h"

#include <float.h>
#include <string.h>

static qm_extent measure(const qm_mesh *mesh)
{
    qm_context ctx = qm_context_make();
    qm_extent extent;
    assert_int_equal(qm_extent_measure(&ctx, mesh, 1, &extent), QM_OK);
    return extent;
}

static void holds(const char *what, qm_interval found, qm_wide truth, double most_width, uint64_t seed)
{
    QM_CHECK(found.lower <= truth && truth <= found.upper, "%s, seed %llu: %.17g not in %.17g to %.17g", what,
             (unsigned long long)seed, (double)truth, found.lower, found.upper);
    QM_CHECK(found.upper - found.lower <= most_width, "%s, seed %llu: %.17g to %.17g is wider than %.3g",
             what, (unsigned long long)seed, found.lower, found.upper, most_width);
}

/* ---- the slow twin: from positions, by the definitions ---- */

static qm_wide_vec wide_corner(const qm_mesh *mesh, size_t face, int i)
{
    const double *p = mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)i];
    return (qm_wide_vec){p[0], p[1], p[2]};
}

/** Twice the area, and six times the volume of the pyramid to the origin. */
static void add_slow_triangle(qm_wide_vec a, qm_wide_vec b, qm_wide_vec c, qm_wide *area, qm_wide *volume)
{
    qm_wide_vec normal = qm_wide_cross(qm_wide_sub(b, a), qm_wide_sub(c, a));
    *area += qm_wide_length(normal);
    *volume += qm_wide_dot(a, normal);
}

/** The integrals of |P_u x P_v| and of P . (P_u x P_v) over the unit square by Gauss's rule with three points each way in
 * n x n cells, both doubled: exact for the second, a polynomial of degree three. */
static void add_slow_patch(const qm_wide_vec corner[4], int n, qm_wide *area, qm_wide *volume)
{
    const qm_wide node[3] = {-qm_wide_sqrt((qm_wide)3 / 5), 0, qm_wide_sqrt((qm_wide)3 / 5)};
    const qm_wide weight[3] = {(qm_wide)5 / 18, (qm_wide)4 / 9, (qm_wide)5 / 18};
    for (int k = 0; k < 9 * n * n; k++) {
        int i = k % 9 % 3, j = k % 9 / 3, cell = k / 9;
        qm_wide u = (cell % n + (1 + node[i]) / 2) / n, v = (cell / n + (1 + node[j]) / 2) / n;
        qm_wide_vec low = qm_wide_lerp(corner[0], corner[1], u), high = qm_wide_lerp(corner[3], corner[2], u);
        qm_wide_vec along =
            qm_wide_lerp(qm_wide_sub(corner[1], corner[0]), qm_wide_sub(corner[2], corner[3]), v);
        qm_wide_vec normal = qm_wide_cross(along, qm_wide_sub(high, low));
        qm_wide share = weight[i] * weight[j] / ((qm_wide)n * n);
        *area += 2 * share * qm_wide_length(normal);
        *volume += 2 * share * qm_wide_dot(qm_wide_lerp(low, high, v), normal);
    }
}

typedef struct slow_extent {
    qm_wide area[2], volume[2];
} slow_extent;

static slow_extent measure_slowly(const qm_mesh *mesh, int n)
{
    slow_extent out = {0};
    for (size_t f = 0; f < mesh->face_count; f++) {
        qm_wide_vec corner[4];
        int count = mesh->faces[4 * f + 3] == QM_NO_INDEX ? 3 : 4;
        for (int i = 0; i < count; i++)
            corner[i] = wide_corner(mesh, f, i);
        for (int reading = 0; reading < (count == 3 ? 2 : 1); reading++)
            add_slow_triangle(corner[0], corner[1], corner[2], &out.area[reading], &out.volume[reading]);
        if (count == 3) continue;
        add_slow_triangle(corner[0], corner[2], corner[3], &out.area[0], &out.volume[0]);
        qm_wide volume = 0;
        add_slow_patch(corner, n, &out.area[1], &volume);
        out.volume[1] += volume;
    }
    for (int reading = 0; reading < 2; reading++) {
        out.area[reading] /= 2;
        out.volume[reading] /= 6;
    }
    return out;
}

/* ---- tests ---- */

static void boxes_have_their_area_and_volume(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 200; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double side[3];
        for (int k = 0; k < 3; k++)
            side[k] = (double)(1 + qm_random_below(&random, 1000));
        qm_mesh box = qm_shape_box(side[0], side[1], side[2]);
        /* Powers of two and whole numbers keep the corners exact. */
        int exponent = (int)qm_random_below(&random, 600) - 300;
        double scale = ldexp(1.0, exponent),
               far = seed % 2 ? scale * (double)qm_random_below(&random, 1u << 30) : 0.0;
        qm_shape_move(&box, scale, (const double[3]){far, -far, far});
        qm_extent extent = measure(&box);
        qm_wide area =
            2 * ((qm_wide)side[0] * side[1] + (qm_wide)side[1] * side[2] + (qm_wide)side[2] * side[0]);
        qm_wide volume = (qm_wide)side[0] * side[1] * side[2];
        double size = fmax(side[0], fmax(side[1], side[2]));
        for (int reading = 0; reading < 2; reading++) {
            holds("area", extent.area[reading], area * scale * scale, 1e-12 * size * size * scale * scale,
                  seed);
            holds("volume", extent.volume[reading], volume * scale * scale * scale,
                  1e-12 * size * size * size * scale * scale * scale, seed);
        }
        assert_int_equal(extent.degenerate_faces, 0);
        qm_mesh reversed = qm_shape_copy(&box);
        for (size_t f = 0; f < reversed.face_count; f++) {
            uint32_t corner = reversed.faces[4 * f + 1];
            reversed.faces[4 * f + 1] = reversed.faces[4 * f + 3];
            reversed.faces[4 * f + 3] = corner;
        }
        holds("volume inside out", measure(&reversed).volume[0], -volume * scale * scale * scale, INFINITY,
              seed);
        qm_shape_free(&reversed);
        qm_shape_free(&box);
    }
}

static void random_meshes_match_wide_numbers(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 3000 : 300;
    for (uint64_t seed = 0; seed < count; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_soup_style style = (qm_soup_style)(seed % QM_SOUP_STYLE_COUNT);
        qm_mesh mesh = qm_shape_soup(&random, 1 + qm_random_below(&random, 12),
                                     (qm_soup_corners)(seed / QM_SOUP_STYLE_COUNT % 3), style, 0.3);
        double scale = pow(10.0, (double)qm_random_below(&random, 60) - 30.0),
               far = seed % 3 == 0 ? 1e9 : 0.0;
        qm_shape_move(&mesh, scale, (const double[3]){far * scale, far, -far * scale});
        qm_extent extent = measure(&mesh);
        slow_extent slow = measure_slowly(&mesh, 12);
        double squares = 40.0 * (double)mesh.face_count * scale * scale;
        holds("area", extent.area[0], slow.area[0], 1e-12 * squares + (double)(1e-9 * slow.area[0]), seed);
        /* The twin's rule is itself off where a patch folds. */
        qm_wide error = 2e-3 * slow.area[1] + 1e-12 * squares;
        QM_CHECK(extent.area[1].lower <= slow.area[1] + error && slow.area[1] - error <= extent.area[1].upper,
                 "bilinear area, seed %llu: %.17g not in %.17g to %.17g", (unsigned long long)seed,
                 (double)slow.area[1], extent.area[1].lower, extent.area[1].upper);
        qm_shape_free(&mesh);
    }
}

static void closed_meshes_match_wide_numbers(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 40; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_mesh torus =
            qm_shape_torus(3 + (int)qm_random_below(&random, 8), 3 + (int)qm_random_below(&random, 8), 2, 1);
        qm_shape_shake(&torus, &random, seed % 4 == 0 ? 0.0 : 0.2);
        double scale = pow(10.0, (double)qm_random_below(&random, 60) - 30.0),
               far = seed % 3 == 0 ? 1e4 : 0.0;
        qm_shape_move(&torus, scale, (const double[3]){far * scale, 0.0, -far * scale});
        qm_extent extent = measure(&torus);
        slow_extent slow = measure_slowly(&torus, 12);
        for (int reading = 0; reading < 2; reading++)
            holds(reading ? "bilinear volume" : "volume", extent.volume[reading], slow.volume[reading],
                  1e-10 * scale * scale * scale, seed);
        /* 12 cells a side leave the twin this. */
        double error = (seed % 4 == 0 ? 1e-9 : 1e-5) * (double)slow.area[1];
        qm_interval wider = {extent.area[1].lower - error, extent.area[1].upper + error};
        holds("bilinear area", wider, slow.area[1], (seed % 4 == 0 ? 5e-9 : 1e-4) * (double)slow.area[1],
              seed);
        qm_shape_free(&torus);
    }
}

/** The patch of (0,0,0) (1,0,0) (1,1,1) (0,1,0) is z = x y: the integral of sqrt(1 + x^2 + y^2). */
static void the_saddle_has_its_area(void **state)
{
    (void)state;
    const double corner[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 1}, {0, 1, 0}};
    qm_mesh saddle = qm_shape_face(4, corner);
    qm_extent extent = measure(&saddle);
    qm_long truth = sqrtl(3.0L) / 3 + 4.0L / 3 * asinhl(1 / sqrtl(2.0L)) - atanl(1 / sqrtl(3.0L)) / 3;
    holds("area", extent.area[1], truth, 1e-7, 0);
    qm_shape_free(&saddle);
}

static void sizes_at_the_ends_of_the_range_hold(void **state)
{
    (void)state;
    static const double scales[] = {1e-320, 1e-308, 1e-160, 1e-100, 1e100, 1e150, 1e307};
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        qm_mesh box = qm_shape_box(scales[i], scales[i], scales[i]);
        qm_extent extent = measure(&box);
        qm_wide side = scales[i];
        for (int reading = 0; reading < 2; reading++) {
            assert_true(extent.area[reading].lower <= 6 * side * side &&
                        6 * side * side <= extent.area[reading].upper);
            assert_true(extent.volume[reading].lower <= side * side * side &&
                        side * side * side <= extent.volume[reading].upper);
            assert_true(extent.area[reading].lower >= 0.0 && extent.area[reading].lower <= DBL_MAX);
        }
        assert_int_equal(extent.degenerate_faces, 0);
        qm_shape_free(&box);
    }
}

/** Whether three points lie on a line, in whole numbers. */
static bool is_flat(const double *a, const double *b, const double *c)
{
    int64_t e[3], f[3];
    for (int k = 0; k < 3; k++) {
        e[k] = (int64_t)b[k] - (int64_t)a[k];
        f[k] = (int64_t)c[k] - (int64_t)a[k];
    }
    return e[1] * f[2] == e[2] * f[1] && e[2] * f[0] == e[0] * f[2] && e[0] * f[1] == e[1] * f[0];
}

static void faces_without_area_are_counted_exactly(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 300; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_mesh mesh = qm_shape_soup(&random, 30, (qm_soup_corners)(seed % 3), QM_SOUP_POOLED, 0);
        /* Whole numbers, few of them or large ones near a line. */
        for (size_t v = 0; v < mesh.vertex_count; v++) {
            int64_t along = (int64_t)qm_random_below(&random, seed % 2 ? 3 : 1u << 28);
            for (uint64_t k = 0; k < 3; k++)
                mesh.positions[3 * v + k] =
                    seed % 2
                        ? (double)qm_random_below(&random, 3)
                        : (double)((int64_t)(k + 1) * along + (int64_t)(qm_random_below(&random, 8) == 0));
        }
        size_t expected = 0;
        for (size_t f = 0; f < mesh.face_count; f++) {
            const uint32_t *face = mesh.faces + 4 * f;
            const double *p = mesh.positions;
            bool flat = is_flat(p + 3 * face[0], p + 3 * face[1], p + 3 * face[2]);
            if (face[3] != QM_NO_INDEX) flat &= is_flat(p + 3 * face[0], p + 3 * face[2], p + 3 * face[3]);
            expected += flat;
        }
        size_t found = measure(&mesh).degenerate_faces;
        QM_CHECK(found == expected, "seed %llu: %zu, not %zu", (unsigned long long)seed, found, expected);
        /* A size beyond the range of the exact signs does not change it. */
        qm_shape_move(&mesh, 0x1p900, (const double[3]){0, 0, 0});
        assert_int_equal(measure(&mesh).degenerate_faces, expected);
        qm_shape_free(&mesh);
    }
}

static void polygons_are_flat_as_a_whole(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_make(7, 6);
    static const double points[7][3] = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0},
                                        {4, 0, 0}, {1, 1, 0}, {5, 0, 0}};
    static const uint32_t faces[6][4] = {{0, 1, 2, QM_NO_INDEX}, {0, 2, 3, QM_NO_INDEX},
                                         {0, 3, 4, QM_NO_INDEX}, {0, 1, 2, QM_NO_INDEX},
                                         {0, 2, 5, QM_NO_INDEX}, {0, 5, 0, QM_NO_INDEX}};
    memcpy(mesh.positions, points, sizeof points);
    memcpy(mesh.faces, faces, sizeof faces);
    mesh.face_origin = calloc(6, sizeof *mesh.face_origin);
    assert_non_null(mesh.face_origin);
    memcpy(mesh.face_origin, (const uint32_t[]){0, 0, 0, 1, 1, 1}, 6 * sizeof *mesh.face_origin);
    assert_int_equal(measure(&mesh).degenerate_faces, 1);
    qm_shape_free(&mesh);
}

static void quads_that_fold_by_the_thousand_end(void **state)
{
    (void)state;
    /* Each crosses itself: its normal is 0 along a line, near which cells are cut until none are left. */
    enum { COUNT = 20000 };
    qm_mesh mesh = qm_shape_make(4, COUNT);
    static const double corners[4][3] = {{0, 0, 0}, {1, 0.1, 0}, {1, 0, 0}, {0, 1, 0.1}};
    memcpy(mesh.positions, corners, sizeof corners);
    for (size_t f = 0; f < COUNT; f++)
        memcpy(mesh.faces + 4 * f, (const uint32_t[4]){0, 1, 2, 3}, 4 * sizeof(uint32_t));
    qm_extent extent = measure(&mesh);
    qm_wide area = 0, volume = 0;
    qm_wide_vec corner[4];
    for (int i = 0; i < 4; i++)
        corner[i] = wide_corner(&mesh, 0, i);
    add_slow_patch(corner, 60, &area, &volume);
    area *= COUNT / 2;
    QM_CHECK(extent.area[1].lower <= 1.0001 * area && 0.9999 * area <= extent.area[1].upper,
             "%.9g to %.9g, not %.9g", extent.area[1].lower, extent.area[1].upper, (double)area);
    qm_shape_free(&mesh);
}

/** Workers one after the other, the last one first. */
static void run_backwards(void *user, int worker_count, void (*task)(void *data, int worker), void *data)
{
    (void)user;
    for (int worker = worker_count; worker-- > 0;)
        task(data, worker);
}

static void threads_do_not_change_the_result(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_waves(150, 0.3, 0.5);
    qm_extent one = measure(&mesh), many;
    qm_context ctx = qm_context_make();
    ctx.parallel = run_backwards;
    assert_int_equal(qm_extent_measure(&ctx, &mesh, 7, &many), QM_OK);
    assert_memory_equal(&one, &many, sizeof one);
    atomic_bool cancel = true;
    ctx.cancel = &cancel;
    assert_int_equal(qm_extent_measure(&ctx, &mesh, 7, &many), QM_E_CANCELED);
    qm_shape_free(&mesh);
}

static void nothing_has_no_extent(void **state)
{
    (void)state;
    qm_random random = qm_random_make(1, 0);
    qm_mesh points = qm_shape_points(&random, 10);
    qm_extent extent = measure(&points), none = {0};
    assert_memory_equal(&extent, &none, sizeof none);
    qm_shape_free(&points);
    const double corner[4][3] = {{3, 4, 5}, {3, 4, 5}, {3, 4, 5}, {3, 4, 5}};
    qm_mesh point = qm_shape_face(4, corner);
    extent = measure(&point);
    assert_true(extent.area[0].upper == 0.0 && extent.area[1].upper == 0.0);
    assert_int_equal(extent.degenerate_faces, 1);
    qm_shape_free(&point);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_have_their_area_and_volume),
        cmocka_unit_test(random_meshes_match_wide_numbers),
        cmocka_unit_test(closed_meshes_match_wide_numbers),
        cmocka_unit_test(the_saddle_has_its_area),
        cmocka_unit_test(sizes_at_the_ends_of_the_range_hold),
        cmocka_unit_test(faces_without_area_are_counted_exactly),
        cmocka_unit_test(polygons_are_flat_as_a_whole),
        cmocka_unit_test(quads_that_fold_by_the_thousand_end),
        cmocka_unit_test(threads_do_not_change_the_result),
        cmocka_unit_test(nothing_has_no_extent),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
