/* qm_metric: values known by hand, sizes at the ends of the range, sums over a mesh against sorting. */
#include "check.h"

#include "qm/metric.h"
#include "shapes.h"

#include <math.h>
#include <string.h>

static void near_to(const char *what, double found, double expected)
{
    QM_CHECK(fabs(found - expected) <= 1e-12 * fmax(1.0, fabs(expected)), "%s: %.17g for %.17g", what, found,
             expected);
}

static void known_faces_have_known_values(void **state)
{
    (void)state;
    const double square[4][3] = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}};
    static const double of_square[] = {1, 1, 0, 0, 0, 1, 1, 1, 90, 90};
    for (int m = 0; m < QM_METRIC_COUNT; m++)
        near_to(qm_metric_names[m], qm_metric_of_corners((qm_metric)m, square, 4), of_square[m]);

    const double root = sqrt(0.75), equal[3][3] = {{0, 0, 0}, {1, 0, 0}, {0.5, root, 0}};
    static const double of_equal[] = {1, 1, NAN, NAN, NAN, 1, 1, NAN, 60, 60};
    for (int m = 0; m < QM_METRIC_COUNT; m++) {
        double found = qm_metric_of_corners((qm_metric)m, equal, 3);
        assert_true(!isnan(of_equal[m]) == !isnan(found));
        assert_true(!isnan(found) == qm_metric_has_triangles((qm_metric)m));
        if (!isnan(found)) near_to(qm_metric_names[m], found, of_equal[m]);
    }

    /* A leaning rectangle of 4 by sqrt(2), with angles of 45 and 135 degrees. */
    const double leaning[4][3] = {{0, 0, 0}, {4, 0, 0}, {5, 1, 0}, {1, 1, 0}};
    static const double of_leaning[] = {0.70710678118654752,
                                        4 * (8 + 2.8284271247461903) / 16,
                                        0.70710678118654752,
                                        0,
                                        0,
                                        2.8284271247461903,
                                        2.0 * 4 / 18,
                                        2 / 5.0990195135927845,
                                        45,
                                        135};
    for (int m = 0; m < QM_METRIC_COUNT; m++)
        near_to(qm_metric_names[m], qm_metric_of_corners((qm_metric)m, leaning, 4), of_leaning[m]);

    /* A trapezoid: axes of (3, 0) and (0, 2); and a quad bent by a right angle about a diagonal. */
    const double tapered[4][3] = {{0, 0, 0}, {2, 0, 0}, {1.5, 1, 0}, {0.5, 1, 0}};
    near_to("taper", qm_metric_of_corners(QM_METRIC_TAPER, tapered, 4), 0.5);
    const double bent[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0.5, 0.5, -0.5}};
    QM_CHECK(qm_metric_of_corners(QM_METRIC_WARPAGE, bent, 4) >= 1.0, "%g",
             qm_metric_of_corners(QM_METRIC_WARPAGE, bent, 4));
}

static void bad_faces_have_bad_values(void **state)
{
    (void)state;
    const double dart[4][3] = {{0, 0, 0}, {2, 0, 0}, {0.5, 0.5, 0}, {0, 2, 0}};
    assert_true(qm_metric_of_corners(QM_METRIC_SCALED_JACOBIAN, dart, 4) < 0.0);
    assert_true(qm_metric_of_corners(QM_METRIC_SHAPE, dart, 4) == 0.0);
    assert_true(qm_metric_of_corners(QM_METRIC_MAXIMUM_ANGLE, dart, 4) > 180.0);
    const double shut[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    assert_true(qm_metric_of_corners(QM_METRIC_SCALED_JACOBIAN, shut, 4) == 0.0);
    assert_true(isnan(qm_metric_of_corners(QM_METRIC_EDGE_RATIO, shut, 4)));
    assert_true(isnan(qm_metric_of_corners(QM_METRIC_WARPAGE, shut, 4)));
    const double point[4][3] = {{3, 3, 3}, {3, 3, 3}, {3, 3, 3}, {3, 3, 3}};
    for (int m = 0; m < QM_METRIC_COUNT; m++)
        for (int count = 3; count <= 4; count++)
            assert_true(!isinf(qm_metric_of_corners((qm_metric)m, point, count)));
}

/** Metrics of shape do not depend on the size, wherever it is in the range of doubles, nor on where counting starts. */
static void sizes_and_starts_do_not_matter(void **state)
{
    (void)state;
    static const int exponents[] = {-1000, -500, -30, 40, 500, 1020};
    for (uint64_t seed = 0; seed < 500; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double corner[4][3], scaled[4][3], turned[4][3];
        int count = seed % 2 ? 3 : 4;
        for (int i = 0; i < count; i++)
            for (int k = 0; k < 3; k++) {
                corner[i][k] = (double)qm_random_below(&random, 1000) / 512.0 - 1.0;
                scaled[i][k] = ldexp(corner[i][k], exponents[seed % 6]);
                turned[(i + 1) % count][k] = corner[i][k];
            }
        for (int m = 0; m < QM_METRIC_COUNT; m++) {
            double plain = qm_metric_of_corners((qm_metric)m, (const double(*)[3])corner, count);
            double other = qm_metric_of_corners((qm_metric)m, (const double(*)[3])scaled, count);
            double start = qm_metric_of_corners((qm_metric)m, (const double(*)[3])turned, count);
            QM_CHECK(isnan(plain) ? isnan(other) : plain == other, "%s, seed %llu: %.17g and %.17g",
                     qm_metric_names[m], (unsigned long long)seed, plain, other);
            /* The area that the aspect ratio of a quad divides by is that of one way to cut it. */
            if (m == QM_METRIC_ASPECT_RATIO && count == 4) continue;
            QM_CHECK(isnan(plain) ? isnan(start) : fabs(plain - start) <= 1e-9 * fabs(plain),
                     "%s, seed %llu: %.17g and %.17g", qm_metric_names[m], (unsigned long long)seed, plain,
                     start);
        }
    }
}

static int compare(const void *a, const void *b)
{
    return (*(const double *)a > *(const double *)b) - (*(const double *)a < *(const double *)b);
}

static void summaries_match_sorting(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 200; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        size_t faces = 1 + qm_random_below(&random, 300), count = 0, place = 0;
        qm_mesh mesh = qm_shape_soup(&random, faces, (qm_soup_corners)(seed % 3),
                                     seed % 2 ? QM_SOUP_LATTICE : QM_SOUP_DEGENERATE, 0.2);
        qm_metric metric = (qm_metric)(seed % QM_METRIC_COUNT);
        qm_context ctx = qm_context_make();
        qm_metric_summary found;
        assert_int_equal(qm_metric_summarize(&ctx, &mesh, metric, &found), QM_OK);
        double *values = calloc(faces, sizeof *values), sum = 0.0;
        assert_non_null(values);
        assert_int_equal(qm_metric_face_count(&mesh), faces);
        /* In two parts, as replies are made. */
        qm_metric_measure(&mesh, metric, 0, faces / 2, &place, values);
        qm_metric_measure(&mesh, metric, faces / 2, faces - faces / 2, &place, values + faces / 2);
        size_t none = 0, applies = 0;
        for (size_t f = 0; f < faces; f++) {
            applies += mesh.faces[4 * f + 3] != QM_NO_INDEX || qm_metric_has_triangles(metric);
            none += isnan(values[f]) ? 1 : 0;
            if (!isnan(values[f])) {
                sum += values[f];
                values[count++] = values[f];
            }
        }
        assert_int_equal(found.faces, count);
        assert_int_equal(found.faces + found.undefined, applies);
        assert_int_equal(count + none, faces);
        qsort(values, count, sizeof *values, compare);
        if (count > 0) {
            near_to("mean", found.mean, sum / (double)count);
            assert_true(found.minimum == values[0] && found.maximum == values[count - 1]);
            assert_true(found.minimum_face < faces && found.maximum_face < faces);
            for (int i = 0; i < QM_METRIC_PERCENTILES; i++) {
                size_t below = 0;
                for (size_t f = 0; f < count; f++)
                    below += values[f] < found.percentile[i];
                size_t upto = below;
                while (upto < count && values[upto] == found.percentile[i])
                    upto++;
                double share = qm_metric_percents[i] / 100.0 * (double)count;
                QM_CHECK(upto > below && (double)below < share && share <= (double)upto,
                         "seed %llu: %g %% of %zu is %.17g, with %zu below", (unsigned long long)seed,
                         qm_metric_percents[i], count, found.percentile[i], below);
            }
        }
        free(values);
        qm_shape_free(&mesh);
    }
}

static void polygons_have_no_value(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_make(7, 4);
    static const double points[7][3] = {{0, 0, 0}, {1, 0, 0},  {2, 1, 0}, {1, 2, 0},
                                        {0, 1, 0}, {-1, 1, 0}, {-1, 0, 0}};
    static const uint32_t faces[4][4] = {
        {0, 1, 2, QM_NO_INDEX}, {0, 2, 3, QM_NO_INDEX}, {0, 3, 4, QM_NO_INDEX}, {0, 4, 5, 6}};
    memcpy(mesh.positions, points, sizeof points);
    memcpy(mesh.faces, faces, sizeof faces);
    mesh.face_origin = calloc(4, sizeof *mesh.face_origin);
    assert_non_null(mesh.face_origin);
    memcpy(mesh.face_origin, (const uint32_t[]){0, 0, 0, 1}, 4 * sizeof *mesh.face_origin);
    double values[2];
    size_t place = 0;
    assert_int_equal(qm_metric_face_count(&mesh), 2);
    qm_metric_measure(&mesh, QM_METRIC_ASPECT_RATIO, 0, 2, &place, values);
    assert_true(isnan(values[0]));
    near_to("square", values[1], 1.0);
    qm_context ctx = qm_context_make();
    qm_metric_summary summary;
    assert_int_equal(qm_metric_summarize(&ctx, &mesh, QM_METRIC_ASPECT_RATIO, &summary), QM_OK);
    assert_int_equal(summary.faces, 1);
    assert_int_equal(summary.undefined, 0);
    assert_int_equal(summary.minimum_face, 1);
    atomic_bool cancel = true;
    ctx.cancel = &cancel;
    assert_int_equal(qm_metric_summarize(&ctx, &mesh, QM_METRIC_ASPECT_RATIO, &summary), QM_E_CANCELED);
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(known_faces_have_known_values),  cmocka_unit_test(bad_faces_have_bad_values),
        cmocka_unit_test(sizes_and_starts_do_not_matter), cmocka_unit_test(summaries_match_sorting),
        cmocka_unit_test(polygons_have_no_value),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
