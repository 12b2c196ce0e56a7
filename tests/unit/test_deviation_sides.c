/*
 * Signed deviations: known values, and intervals held against a dense subdivision of the source, whose cells have distances by the slow
 * twin and sides by solid angles.
 */
#include <float.h>
#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "failing_allocator.h"
#include "measured.h"
#include "shapes.h"
#include "slow_twin.h"

static qm_deviation_options options_for(qm_quad_reading quads, qm_sign sign, const qm_interval *band,
                                        size_t count)
{
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = quads;
    options.tolerance = 1e-6;
    options.sign = sign;
    options.band = band;
    options.band_count = count;
    options.piece_limit = 1 << 16;
    return options;
}

/* ---- known values ---- */

static void a_box_in_a_box_is_inside(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_cube(0.9), b = qm_shape_cube(1.0);
    const qm_interval bands[] = {{-0.11, -0.09}, {-0.09, 0.09}, {0.0, INFINITY}, {-INFINITY, 0.0}};
    for (int reading = 0; reading < 2; reading++)
        for (int sign = QM_SIGN_OUTSIDE; sign <= QM_SIGN_NORMAL; sign++) {
            qm_interval turned[4];
            double up = sign == QM_SIGN_INSIDE ? -1.0 : 1.0;
            for (int i = 0; i < 4; i++)
                turned[i] = up < 0.0 ? (qm_interval){-bands[i].upper, -bands[i].lower} : bands[i];
            qm_deviation_options options = options_for((qm_quad_reading)reading, (qm_sign)sign, turned, 4);
            qm_deviation found = qm_measured_deviation(&a, &b, &options);
            assert_true(found.sides.is_proven == (sign != QM_SIGN_NORMAL));
            qm_measured_holds(found.sides.mean, -0.1 * up, 1e-9, "mean");
            qm_measured_holds(found.sides.behind.max, 0.1, 2e-6, "inside");
            qm_measured_holds(found.sides.front.max, 0.0, 0.0, "outside");
            qm_measured_holds(found.sides.behind.size, 6 * 1.8 * 1.8, 1e-9, "area inside");
            qm_measured_holds(found.sides.front.size, 0.0, 1e-9, "area outside");
            assert_true(found.sides.open_size <= 1e-9);
            assert_true(found.sides.behind.has_witness && !found.sides.front.has_witness);
            static const double shares[] = {1, 0, 0, 1};
            for (int i = 0; i < 4; i++)
                qm_measured_holds(found.sides.band[i], shares[i], 1e-9, "band");
            qm_measured_deviation_free(&found);
        }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Of the part of a square of half side 2 that is outside of one of half side 1 within its plane, the part within x. */
static double frame_within(double x)
{
    double pi = 3.14159265358979323846;
    return x <= 0.0 ? 0.0 : x >= 1.0 ? NAN : 4 * 2 * x + pi * x * x;
}

static void a_square_through_a_box_is_on_both_sides(void **state)
{
    (void)state;
    static const double corners[4][3] = {{-2, -2, 0}, {2, -2, 0}, {2, 2, 0}, {-2, 2, 0}};
    qm_mesh a = qm_shape_face(4, corners), b = qm_shape_cube(1.0);
    const qm_interval bands[] = {{-0.5, 0.5}, {0.25, 0.75}, {-0.75, -0.25}, {-INFINITY, INFINITY}};
    const double shares[] = {(frame_within(0.5) + 3.0) / 16, (frame_within(0.75) - frame_within(0.25)) / 16,
                             (1.5 * 1.5 - 0.5 * 0.5) / 16, 1};
    for (int reading = 0; reading < 2; reading++) {
        qm_deviation_options options = options_for((qm_quad_reading)reading, QM_SIGN_OUTSIDE, bands, 4);
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        qm_measured_holds(found.sides.behind.max, 1.0, 1e-5, "inside");
        qm_measured_holds(found.sides.front.max, sqrt(2.0), 1e-5, "outside");
        qm_measured_holds(found.sides.behind.size, 4.0, 0.2, "area inside");
        qm_measured_holds(found.sides.front.size, 12.0, 0.2, "area outside");
        for (int i = 0; i < 4; i++)
            qm_measured_holds(found.sides.band[i], shares[i], 0.03, "band");
        const double *at = found.sides.behind.from.position;
        assert_true(fabs(at[0]) < 1e-5 && fabs(at[1]) < 1e-5 && at[2] == 0.0);
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Areas of the sides that are above 0 and below the least number. */
static void a_tiny_area_is_not_none(void **state)
{
    (void)state;
    static const double corners[4][3] = {{-2, -2, 0}, {2, -2, 0}, {2, 2, 0}, {-2, 2, 0}}, origin[3] = {0};
    for (double scale = 0x1p-500; scale >= 0x1p-1000; scale *= 0x1p-50) {
        qm_mesh a = qm_shape_face(4, corners), b = qm_shape_cube(1.0);
        qm_shape_move(&a, scale, origin);
        qm_shape_move(&b, scale, origin);
        qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, QM_SIGN_OUTSIDE, NULL, 0);
        options.tolerance *= scale;
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        double inside = 4.0 * scale * scale, outside = 12.0 * scale * scale;
        qm_measured_holds(found.sides.behind.size, inside, 0.1 * inside + DBL_MIN, "area inside");
        qm_measured_holds(found.sides.front.size, outside, 0.1 * outside + DBL_MIN, "area outside");
        assert_true(found.sides.behind.size.upper > 0.0 && found.sides.front.size.upper > 0.0);
        qm_measured_deviation_free(&found);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static void a_surface_on_the_target_is_on_neither_side(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_cube(1.0);
    const qm_interval band = {-1e-9, 1e-9};
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, QM_SIGN_OUTSIDE, &band, 1);
    qm_deviation found = qm_measured_deviation(&a, &a, &options);
    qm_measured_holds(found.sides.mean, 0.0, 1e-9, "mean");
    qm_measured_holds(found.sides.front.max, 0.0, 1e-9, "outside");
    qm_measured_holds(found.sides.behind.max, 0.0, 1e-9, "inside");
    assert_true(found.sides.front.size.lower == 0.0 && found.sides.front.size.upper >= 24.0 * (1 - 1e-9));
    qm_measured_holds(found.sides.band[0], 1.0, 1e-9, "band");
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
}

static void points_are_counted_by_side(void **state)
{
    (void)state;
    qm_mesh b = qm_shape_cube(1.0), a = qm_shape_make(5, 0);
    static const double at[15] = {0, 0, 0, 0.5, 0.9, 0, 3, 0, 0, 0, 0, -1.5, 1, 0.5, 0.25};
    memcpy(a.positions, at, sizeof at);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, QM_SIGN_OUTSIDE, NULL, 0);
    options.thread_count = 2;
    qm_context ctx = qm_host_context();
    qm_deviation found;
    assert_int_equal(qm_measured_deviation_in(&ctx, &a, &b, &options, &found), QM_OK);
    qm_measured_holds(found.sides.behind.size, 2.0, 1.0 + 1e-9, "points inside");
    qm_measured_holds(found.sides.front.size, 2.0, 1.0 + 1e-9, "points outside");
    qm_measured_holds(found.sides.mean, (-1.0 - 0.1 + 2.0 + 0.5) / 5, 1e-9, "mean");
    qm_measured_holds(found.sides.behind.max, 1.0, 1e-9, "inside");
    qm_measured_holds(found.sides.front.max, 2.0, 1e-9, "outside");
    assert_int_equal(found.sides.front.from.face, 2);
    assert_int_equal(found.sides.behind.from.face, 0);
    qm_deviation_reset(&ctx, &found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void only_solids_prove_a_sign(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_cube(0.5), b = qm_shape_cube(1.0), points = qm_shape_make(1, 0);
    b.face_count--;
    qm_context ctx = qm_context_make();
    qm_deviation out;
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, QM_SIGN_OUTSIDE, NULL, 0);
    assert_int_equal(qm_measured_deviation_in(&ctx, &a, &b, &options, &out), QM_E_NOT_CLOSED);
    assert_non_null(strstr(ctx.message, "4 boundary edges"));
    options.sign = QM_SIGN_NORMAL;
    assert_int_equal(qm_measured_deviation_in(&ctx, &a, &b, &options, &out), QM_OK);
    assert_false(out.sides.is_proven);
    qm_measured_deviation_free(&out);
    assert_int_equal(qm_measured_deviation_in(&ctx, &a, &points, &options, &out), QM_E_NOT_CLOSED);
    qm_shape_free(&a);
    qm_shape_free(&b);
    qm_shape_free(&points);
}

/* ---- the slow twin ---- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double solid_angle(const double c[3][3])
{
    double l[3], above = c[0][0] * (c[1][1] * c[2][2] - c[1][2] * c[2][1]) -
                         c[0][1] * (c[1][0] * c[2][2] - c[1][2] * c[2][0]) +
                         c[0][2] * (c[1][0] * c[2][1] - c[1][1] * c[2][0]);
    for (int i = 0; i < 3; i++)
        l[i] = sqrt(dot(c[i], c[i]));
    return 2.0 * atan2(above, l[0] * l[1] * l[2] + dot(c[0], c[1]) * l[2] + dot(c[1], c[2]) * l[0] +
                                  dot(c[2], c[0]) * l[1]);
}

enum { PATCH_CELLS = 10 };

/** Whether a point is in a closed mesh; patches are subdivided. */
static bool is_inside(const qm_mesh *mesh, qm_quad_reading reading, const double p[3])
{
    double sum = 0.0;
    int cells = reading == QM_QUADS_BILINEAR ? PATCH_CELLS : 1;
    for (size_t f = 0; f < mesh->face_count; f++) {
        bool is_quad = mesh->faces[4 * f + 3] != QM_NO_INDEX;
        for (int i = 0; i < cells * cells; i++)
            for (int half = 0; half < (is_quad ? 2 : 1); half++) {
                static const int corner_of[2][3][2] = {{{0, 0}, {1, 0}, {1, 1}}, {{0, 0}, {1, 1}, {0, 1}}};
                double c[3][3];
                for (int k = 0; k < 3; k++) {
                    const double uv[2] = {(double)(i % cells + corner_of[half][k][0]) / cells,
                                          (double)(i / cells + corner_of[half][k][1]) / cells};
                    const double of_triangle[2] = {k == 1, k == 2};
                    qm_slow_position(mesh, f, reading, is_quad ? uv : of_triangle, c[k]);
                    for (int m = 0; m < 3; m++)
                        c[k][m] -= p[m];
                }
                if (!is_quad && i > 0) continue;
                sum += solid_angle((const double(*)[3])c);
            }
    }
    return fabs(sum) > 2.0 * 3.14159265358979323846;
}

typedef struct twin_figures {
    double area, mean[2], size[2][2]; /* from below and above; by side, outside first */
    double max[2][2], band[2];
    double limit[2];
} twin_figures;

/** Adds a triangle of the source, with its interval of signed distances. */
static void add_cell(twin_figures *twin, const qm_mesh *b, qm_quad_reading reading, const double c[3][3])
{
    double middle[3], reach = 0.0, e[2][3], n[3];
    for (int k = 0; k < 3; k++) {
        middle[k] = (c[0][k] + c[1][k] + c[2][k]) / 3.0;
        e[0][k] = c[1][k] - c[0][k];
        e[1][k] = c[2][k] - c[0][k];
    }
    for (int i = 0; i < 3; i++) {
        double d[3] = {c[i][0] - middle[0], c[i][1] - middle[1], c[i][2] - middle[2]};
        reach = fmax(reach, sqrt(dot(d, d)));
    }
    for (int k = 0; k < 3; k++)
        n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
    double area = 0.5 * sqrt(dot(n, n));
    qm_slow_bracket found = qm_slow_distance(b, reading, middle, 1e-4);
    double least = found.lower - reach, most = found.upper + reach;
    bool inside = is_inside(b, reading, middle), is_known = least > 0.0;
    double low = inside ? -most : least, high = inside ? -least : most;
    if (!is_known) {
        low = -most;
        high = most;
    }
    twin->area += area;
    twin->mean[0] += area * low;
    twin->mean[1] += area * high;
    for (int side = 0; side < 2; side++) {
        if (is_known && inside == (side == 1)) twin->size[side][0] += area;
        if (!is_known || inside == (side == 1)) twin->size[side][1] += area;
        if (found.lower > 1e-3 && inside == (side == 1))
            twin->max[side][0] = fmax(twin->max[side][0], found.lower);
        if (!is_known || inside == (side == 1)) twin->max[side][1] = fmax(twin->max[side][1], most);
    }
    if (low >= twin->limit[0] && high <= twin->limit[1]) twin->band[0] += area;
    if (high >= twin->limit[0] && low <= twin->limit[1]) twin->band[1] += area;
}

static void overlaps(qm_interval found, double low, double high, const char *name, int i)
{
    double room = 1e-9 * (1.0 + fabs(low) + fabs(high));
    QM_CHECK(found.lower <= high + room && found.upper >= low - room && found.lower <= found.upper,
             "%s of pair %d, seed %llu: [%.9g, %.9g] is apart from [%.9g, %.9g]", name, i,
             (unsigned long long)qm_check_seed(), found.lower, found.upper, low, high);
}

/** A spike, a thin wall, a shell in a shell, or a shaken torus. */
static qm_mesh random_target(qm_random *random, int i)
{
    if (i % 4 == 0) { /* a needle of a tetrahedron */
        qm_mesh mesh = qm_shape_make(4, 4);
        static const uint32_t faces[16] = {0, 2, 1, QM_NO_INDEX, 0, 1, 3, QM_NO_INDEX,
                                           1, 2, 3, QM_NO_INDEX, 2, 0, 3, QM_NO_INDEX};
        const double at[12] = {0, 0, 0, 0.1, 0, 0, 0, 0.1, 0, qm_random_range(random, -1, 1), 0.2, 1.5};
        memcpy(mesh.positions, at, sizeof at);
        memcpy(mesh.faces, faces, sizeof faces);
        return mesh;
    }
    if (i % 4 == 1) return qm_shape_box(1.0, 0.02 + qm_random_range(random, 0, 0.1), 1.0);
    if (i % 4 == 2) {
        qm_mesh outer = qm_shape_cube(1.0), inner = qm_shape_cube(qm_random_range(random, 0.3, 0.8));
        for (size_t f = 0; f < inner.face_count; f++) {
            uint32_t kept = inner.faces[4 * f + 1];
            inner.faces[4 * f + 1] = inner.faces[4 * f + 3];
            inner.faces[4 * f + 3] = kept;
        }
        qm_mesh both = qm_shape_joined(&outer, &inner);
        qm_shape_free(&outer);
        qm_shape_free(&inner);
        return both;
    }
    qm_mesh torus = qm_shape_torus(6, 4, 1.0, 0.4);
    qm_shape_shake(&torus, random, 0.08);
    return torus;
}

static void figures_hold_what_a_subdivision_finds(void **state)
{
    (void)state;
    int pairs = qm_check_long() ? 400 : 32, cells = 12, narrow = 0;
    for (int i = 0; i < pairs; i++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)i);
        qm_quad_reading reading = (qm_quad_reading)(i / 4 % 2);
        qm_mesh b = random_target(&random, i);
        qm_mesh a = qm_shape_soup(&random, 2, QM_SOUP_TRIANGLES, QM_SOUP_APART, 0.0);
        twin_figures twin = {.limit = {-qm_random_range(&random, 0, 0.3), qm_random_range(&random, 0, 0.6)}};
        if (i % 5 == 0) twin.limit[0] = 0.5 * twin.limit[1];
        for (size_t f = 0; f < a.face_count; f++)
            for (int k = 0; k < 2 * cells * cells; k++) {
                int u = k / 2 % cells, v = k / 2 / cells, up = k % 2;
                double c[3][3];
                if (u + v + up >= cells) continue;
                for (int m = 0; m < 3; m++) {
                    const double uv[2] = {(double)(u + (up ? m != 1 : m == 1)) / cells,
                                          (double)(v + (up ? m != 2 : m == 2)) / cells};
                    const double of[2] = {up && m == 0 ? (u + 1.0) / cells : uv[0],
                                          up && m == 0 ? (v + 1.0) / cells : uv[1]};
                    qm_slow_position(&a, f, QM_QUADS_TRIANGLES, of, c[m]);
                }
                add_cell(&twin, &b, reading, (const double(*)[3])c);
            }
        const qm_interval band = {twin.limit[0], twin.limit[1]};
        qm_deviation_options options = options_for(reading, QM_SIGN_OUTSIDE, &band, 1);
        qm_context ctx = qm_context_make();
        qm_deviation found;
        qm_status status = qm_measured_deviation_in(&ctx, &a, &b, &options, &found);
        if (status == QM_E_NOT_CLOSED) { /* a torus shaken until it meets itself */
            qm_shape_free(&a);
            qm_shape_free(&b);
            continue;
        }
        assert_int_equal(status, QM_OK);
        const qm_signed_deviation *sides = &found.sides;
        overlaps(sides->mean, twin.mean[0] / twin.area, twin.mean[1] / twin.area, "mean", i);
        overlaps(sides->front.size, twin.size[0][0], twin.size[0][1], "area outside", i);
        overlaps(sides->behind.size, twin.size[1][0], twin.size[1][1], "area inside", i);
        overlaps(sides->front.max, twin.max[0][0], twin.max[0][1], "maximum outside", i);
        overlaps(sides->behind.max, twin.max[1][0], twin.max[1][1], "maximum inside", i);
        overlaps(sides->band[0], twin.band[0] / twin.area, twin.band[1] / twin.area, "band", i);
        for (int side = 0; side < 2; side++) {
            const qm_deviation_side *of = side ? &sides->behind : &sides->front;
            if (!of->has_witness) continue;
            qm_slow_bracket far = qm_slow_distance(&b, reading, of->from.position, 1e-9);
            QM_CHECK(far.upper >= of->max.lower - 1e-12, "witness of pair %d: %g, %g", i, far.upper,
                     of->max.lower);
            QM_CHECK(is_inside(&b, reading, of->from.position) == (side == 1) || far.upper < 1e-2,
                     "side of the witness of pair %d", i);
        }
        narrow += sides->mean.upper - sides->mean.lower <= 0.05 * found.mean.upper &&
                  sides->front.max.upper - sides->front.max.lower < 1e-3;
        qm_measured_deviation_free(&found);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
    QM_CHECK(narrow >= pairs * 3 / 4, "%d of %d narrow", narrow, pairs);
}

/* ---- the rules of every call ---- */

static void threads_do_not_change_the_result(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(24, 12, 1.0, 0.4), b = qm_shape_torus(20, 10, 1.01, 0.39);
    const qm_interval band = {-0.01, 0.01};
    qm_deviation first = {0};
    for (int threads = 1; threads <= 3; threads += 2) {
        qm_context ctx = qm_host_context();
        qm_deviation_options options = options_for(QM_QUADS_BILINEAR, QM_SIGN_OUTSIDE, &band, 1);
        options.thread_count = threads;
        qm_deviation found;
        assert_int_equal(qm_measured_deviation_in(&ctx, &a, &b, &options, &found), QM_OK);
        if (threads > 1) {
            assert_memory_equal(&found.sides.mean, &first.sides.mean, sizeof first.sides.mean);
            assert_memory_equal(&found.sides.front.max, &first.sides.front.max, sizeof(qm_interval));
            assert_memory_equal(found.sides.band, first.sides.band, sizeof *first.sides.band);
            qm_deviation_reset(&ctx, &first);
        }
        first = found;
    }
    qm_measured_deviation_free(&first);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** A call that is canceled, whenever that is, has intervals that hold the truth. */
typedef struct cancel_after {
    int calls;
    atomic_bool flag;
} cancel_after;

static void *count_and_cancel(void *user, void *block, size_t old_size, size_t new_size)
{
    cancel_after *state = user;
    if (new_size > 0 && --state->calls == 0) atomic_store(&state->flag, true);
    return qm_allocator_default.resize(qm_allocator_default.user, block, old_size, new_size);
}

static void a_canceled_call_has_intervals(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_cube(0.9), b = qm_shape_cube(1.0);
    const qm_interval band = {-0.11, -0.09};
    int canceled = 0;
    for (int calls = 15; calls < 80; calls += 3) {
        cancel_after cancel = {.calls = calls};
        qm_context ctx = qm_context_make();
        ctx.allocator = (qm_allocator){count_and_cancel, &cancel};
        ctx.cancel = &cancel.flag;
        qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, QM_SIGN_OUTSIDE, &band, 1);
        options.region_limit = 0.05;
        qm_deviation out;
        qm_status status = qm_measured_deviation_in(&ctx, &a, &b, &options, &out);
        if (status == QM_E_CANCELED) continue; /* before there were trees */
        assert_int_equal(status, QM_OK);
        canceled += out.is_canceled;
        assert_int_equal(out.sides.band_count, 1);
        qm_measured_holds(out.sides.mean, -0.1, 100.0, "mean");
        qm_measured_holds(out.sides.behind.max, 0.1, 100.0, "inside");
        qm_measured_holds(out.sides.behind.size, 6 * 1.8 * 1.8, 1e3, "area inside");
        qm_measured_holds(out.sides.front.size, 0.0, 1e3, "area outside");
        qm_measured_holds(out.sides.band[0], 1.0, 1.0, "band");
        assert_true(!out.has_regions || out.region_count == 1);
        qm_deviation_reset(&ctx, &out);
    }
    assert_true(canceled > 3);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void out_of_memory_is_reported_and_leaves_nothing(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_cube(0.7), b = qm_shape_cube(1.0);
    const double shift[3] = {0.5, 0.2, 0.1};
    qm_shape_move(&a, 1.0, shift);
    const qm_interval band = {-0.1, 0.1};
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, QM_SIGN_OUTSIDE, &band, 1);
    options.accuracy = 0.2;
    options.tolerance = 1e-2;
    qm_status status = QM_E_NO_MEMORY;
    for (size_t at = 0; status == QM_E_NO_MEMORY; at++) {
        qm_failing_allocator failing = {.fail_at = at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&failing);
        qm_deviation out;
        status = qm_measured_deviation_in(&ctx, &a, &b, &options, &out);
        if (status == QM_OK) qm_deviation_reset(&ctx, &out);
        assert_true(status == QM_OK || status == QM_E_NO_MEMORY);
        assert_int_equal(failing.live_blocks, 0);
        assert_false(failing.mismatched);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_box_in_a_box_is_inside),
        cmocka_unit_test(a_square_through_a_box_is_on_both_sides),
        cmocka_unit_test(a_tiny_area_is_not_none),
        cmocka_unit_test(a_surface_on_the_target_is_on_neither_side),
        cmocka_unit_test(points_are_counted_by_side),
        cmocka_unit_test(only_solids_prove_a_sign),
        cmocka_unit_test(figures_hold_what_a_subdivision_finds),
        cmocka_unit_test(threads_do_not_change_the_result),
        cmocka_unit_test(a_canceled_call_has_intervals),
        cmocka_unit_test(out_of_memory_is_reported_and_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
