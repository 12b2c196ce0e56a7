/*
 * The two linear functions of a piece, at points of it: the distance by the slow twin lies between them, for
 * the pieces of random soups and for the parts that they are cut into.
 */
#include "check.h"

#include "deviation_shape.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <stdio.h>

#define EPS 1e-12 /* of the slow twin's brackets, where it reaches that */

/** A source and a target with their trees, and what their pieces share. */
typedef struct piece_pair {
    uint64_t number;
    qm_quad_reading reading;
    qm_mesh a, b;
    qm_bvh *tree_a, *tree_b;
    qm_piece_maker maker;
    qm_random random;
    qm_piece_desk desk;
} piece_pair;

/** Of random points in pieces that have strays: how many were told to stray, and how many do. */
typedef struct stray_count {
    double expected, variance;
    size_t found;
} stray_count;

static stray_count strays;

static void open_pair(piece_pair *pair)
{
    qm_context ctx = qm_context_make();
    assert_int_equal(qm_bvh_build(&ctx, &pair->a, QM_BVH_ALL, 1, &pair->tree_a), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &pair->b, QM_BVH_ALL, 1, &pair->tree_b), QM_OK);
    assert_int_equal(qm_piece_maker_init(&ctx, pair->tree_a, pair->tree_b, pair->reading, &pair->maker),
                     QM_OK);
}

static void close_pair(piece_pair *pair)
{
    qm_context ctx = qm_context_make();
    qm_bvh_destroy(&ctx, pair->tree_a);
    qm_bvh_destroy(&ctx, pair->tree_b);
    qm_shape_free(&pair->a);
    qm_shape_free(&pair->b);
}

/** The point of the source with these weights of the piece's corners. */
static void find_position(const piece_pair *pair, const qm_source_piece *piece, const double weight[3],
                          double out[3])
{
    double uv[2] = {0, 0};
    for (int i = 0; i < 3; i++) {
        uv[0] += weight[i] * piece->u[i];
        uv[1] += weight[i] * piece->v[i];
    }
    const uint32_t *index = pair->a.faces + 4 * (size_t)piece->face;
    if (index[3] != QM_NO_INDEX && pair->reading == QM_QUADS_BILINEAR) {
        qm_slow_position(&pair->a, piece->face, QM_QUADS_BILINEAR, uv, out);
        return;
    }
    const double *corner[3] = {pair->a.positions + 3 * (size_t)index[0],
                               pair->a.positions + 3 * (size_t)index[piece->second ? 2 : 1],
                               pair->a.positions + 3 * (size_t)index[piece->second ? 3 : 2]};
    for (int k = 0; k < 3; k++)
        out[k] = (double)((1.0L - uv[0] - uv[1]) * corner[0][k] + (long double)uv[0] * corner[1][k] +
                          (long double)uv[1] * corner[2][k]);
}

static void check_at(const piece_pair *pair, const qm_source_piece *piece, const qm_piece_bounds *bounds,
                     const double weight[3])
{
    double at[3], low = 0.0, high = 0.0, inverse_scale = pair->tree_b->frame.inverse_scale;
    find_position(pair, piece, weight, at);
    qm_slow_bracket truth = qm_slow_distance(&pair->b, pair->reading, at, EPS);
    /* The place itself is rounded, which tells where the target is far smaller. */
    double rounded = 0x1p-52 * fmax(fabs(at[0]), fmax(fabs(at[1]), fabs(at[2])));
    truth.lower -= rounded;
    truth.upper += rounded;
    for (int i = 0; i < 3; i++) {
        low += weight[i] * bounds->low[i] * inverse_scale;
        high += weight[i] * bounds->high[i] * inverse_scale;
    }
    if (bounds->is_signed) {
        double turned = -high;
        high = fmax(high, -low);
        low = fmax(low, turned);
    }
    high += (bounds->stray_high > 0.0 ? bounds->excess : 0.0) * inverse_scale;
    if (bounds->stray_low > 0.0) low = 0.0;
    QM_CHECK(low <= truth.upper && high >= truth.lower,
             "seed %llu, pair %llu, face %u, depth %d, weights %.17g %.17g %.17g: [%.17g, %.17g] against "
             "[%.17g, %.17g]",
             (unsigned long long)qm_check_seed(), (unsigned long long)pair->number, piece->face, piece->depth,
             weight[0], weight[1], weight[2], low, high, truth.lower, truth.upper);
}

/** Whether a random point of a piece is one where a function does not hold. */
static void count_strays(piece_pair *pair, const qm_source_piece *piece, const qm_piece_bounds *bounds)
{
    double expected = fmin(1.0, bounds->stray_low + bounds->stray_high);
    if (!(expected > 0.0)) return;
    double u = qm_random_range(&pair->random, 0.0, 1.0), v = qm_random_range(&pair->random, 0.0, 1.0);
    if (u + v > 1.0) {
        u = 1.0 - u;
        v = 1.0 - v;
    }
    const double weight[3] = {1.0 - u - v, u, v};
    double at[3], low = 0.0, high = 0.0, inverse_scale = pair->tree_b->frame.inverse_scale;
    find_position(pair, piece, weight, at);
    qm_slow_bracket truth = qm_slow_distance(&pair->b, pair->reading, at, EPS);
    for (int i = 0; i < 3; i++) {
        low += weight[i] * bounds->low[i] * inverse_scale;
        high += weight[i] * bounds->high[i] * inverse_scale;
    }
    strays.expected += expected;
    strays.variance += expected * (1.0 - expected);
    strays.found += fmax(low, -high) > truth.upper || fmax(high, -low) < truth.lower;
}

/** The share of random points that stray is what the pieces have told, to within six deviations. */
static void check_strays(void)
{
    QM_CHECK((double)strays.found <= strays.expected + 6.0 * sqrt(strays.variance) + 3.0,
             "seed %llu: %zu points stray, %g were told", (unsigned long long)qm_check_seed(), strays.found,
             strays.expected);
    strays = (stray_count){0.0, 0.0, 0};
}

/** Corners, a point of each edge, and points inside. */
static void check_piece(piece_pair *pair, const qm_source_piece *piece, const qm_piece_bounds *bounds)
{
    for (int i = 0; i < 3; i++) {
        double corner[3] = {0, 0, 0}, edge[3] = {0, 0, 0}, share = qm_random_range(&pair->random, 0.0, 1.0);
        corner[i] = 1.0;
        edge[i] = share;
        edge[(i + 1) % 3] = 1.0 - share;
        check_at(pair, piece, bounds, corner);
        check_at(pair, piece, bounds, edge);
        double u = qm_random_range(&pair->random, 0.0, 1.0), v = qm_random_range(&pair->random, 0.0, 1.0 - u);
        check_at(pair, piece, bounds, (const double[3]){1.0 - u - v, u, v});
    }
    for (int i = 0; i < 4; i++)
        count_strays(pair, piece, bounds);
    assert_true(bounds->mean_low <= bounds->mean_high && bounds->square_low <= bounds->square_high);
    assert_true(bounds->area_low <= bounds->area_high);
}

static __float128 parameter_area(const qm_source_piece *piece)
{
    __float128 u[3], v[3];
    for (int i = 0; i < 3; i++) {
        u[i] = piece->u[i];
        v[i] = piece->v[i];
    }
    __float128 doubled = (u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0]);
    return 0.5 * (doubled < 0 ? -doubled : doubled);
}

/** The areas of the parts in the parameters, which are about exact here, make that of the piece but for the
 * leak.
 */
static void check_areas(const piece_pair *pair, const qm_source_piece *piece, const qm_source_piece *part,
                        int count, double leak)
{
    __float128 off = -parameter_area(piece);
    for (int i = 0; i < count; i++)
        off += parameter_area(&part[i]);
    qm_piece_face face = qm_piece_face_load(&pair->maker, piece);
    /* Corners on cuts of cuts have products of more than 113 bits. */
    double missed = fmax(0.0, fabs((double)off) - 0x1p-104) * qm_piece_face_density(&pair->maker, &face);
    QM_CHECK(missed <= leak, "seed %llu, pair %llu: off by %.17g, which was to be %.17g at most",
             (unsigned long long)qm_check_seed(), (unsigned long long)pair->number, missed, leak);
}

/** How finely the pieces are cut is drawn anew for each cut, from exactly to hardly. */
static void check_parts(piece_pair *pair, const qm_source_piece *piece, int levels)
{
    qm_source_piece part[QM_PIECE_PARTS];
    qm_piece_bounds bounds[QM_PIECE_PARTS];
    qm_piece_maker *maker = &pair->maker;
    double finest = 4.0 * maker->eta;
    maker->worth = fmax(finest, pow(10.0, qm_random_range(&pair->random, -14.0, -1.0)));
    maker->patch_error = fmax(finest, pow(10.0, qm_random_range(&pair->random, -5.0, 0.0)));
    maker->part_limit = 3 + (int)qm_random_below(&pair->random, QM_PIECE_PARTS - 2);
    double leak;
    int count = qm_piece_split(maker, piece, &pair->desk, part, bounds, &leak);
    assert_in_range(count, 2, QM_PIECE_PARTS);
    check_areas(pair, piece, part, count, leak);
    for (int i = 0; i < 4; i++) {
        int k = (int)qm_random_below(&pair->random, (size_t)count);
        check_piece(pair, &part[k], &bounds[k]);
        if (levels > 1 && i < 2) check_parts(pair, &part[k], levels - 1);
    }
}

static void check_pair(piece_pair *pair, int levels)
{
    open_pair(pair);
    for (uint32_t face = 0; face < pair->a.face_count; face++)
        for (int second = 0; second < (pair->a.faces[4 * face + 3] == QM_NO_INDEX ? 1 : 2); second++) {
            qm_source_piece piece = qm_piece_first(&pair->maker, face, second == 1);
            qm_piece_bounds bounds;
            qm_piece_bound(&pair->maker, &piece, &pair->desk, &bounds);
            check_piece(pair, &piece, &bounds);
            check_parts(pair, &piece, levels);
        }
    close_pair(pair);
}

/** Half of the targets are another soup, half the source itself, moved a little or not at all. */
static void check_soups(qm_quad_reading reading, uint64_t count, int levels)
{
    bool bilinear = reading == QM_QUADS_BILINEAR;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        piece_pair pair = {
            .number = number, .reading = reading, .random = qm_random_make(qm_check_seed(), number)};
        qm_random *random = &pair.random;
        qm_soup_style style = (qm_soup_style)qm_random_below(random, QM_SOUP_STYLE_COUNT);
        qm_soup_corners corners = bilinear ? QM_SOUP_QUADS : (qm_soup_corners)qm_random_below(random, 3);
        pair.a = qm_shape_soup(random, 1 + qm_random_below(random, 3), corners, style, 1.0);
        if (qm_random_below(random, 2) == 0) {
            static const double amplitudes[] = {0, 1e-12, 1e-9, 1e-6, 1e-3, 0.1};
            pair.b = qm_shape_copy(&pair.a);
            qm_shape_shake(&pair.b, random, amplitudes[qm_random_below(random, 6)]);
        } else {
            style = (qm_soup_style)qm_random_below(random, QM_SOUP_STYLE_COUNT);
            pair.b = qm_shape_soup(random, 1 + qm_random_below(random, 12), corners, style, 1.0);
        }
        check_pair(&pair, levels);
    }
    check_strays();
}

static void pieces_of_triangles_hold(void **state)
{
    (void)state;
    check_soups(QM_QUADS_TRIANGLES, qm_check_long() ? 10000 : 120, 3);
}

static void pieces_of_patches_hold(void **state)
{
    (void)state;
    check_soups(QM_QUADS_BILINEAR, qm_check_long() ? 300 : 8, 2);
}

/** Cuts a piece again and again, and checks a part of each level. */
static void check_down(piece_pair *pair, qm_source_piece piece, int levels)
{
    for (int level = 0; level < levels; level++) {
        qm_source_piece part[QM_PIECE_PARTS];
        qm_piece_bounds bounds[QM_PIECE_PARTS];
        double leak;
        int count = qm_piece_split(&pair->maker, &piece, &pair->desk, part, bounds, &leak);
        int k = (int)qm_random_below(&pair->random, (size_t)count);
        check_areas(pair, &piece, part, count, leak);
        check_piece(pair, &part[k], &bounds[k]);
        piece = part[k];
    }
}

/** Quads bent by up to their size, some of them folded, alone or as a grid; the target is the same but for
 * noise. */
static piece_pair draw_bent(uint64_t number)
{
    piece_pair pair = {.number = number,
                       .reading = QM_QUADS_BILINEAR,
                       .random = qm_random_make(qm_check_seed(), 700000 + number)};
    qm_random *random = &pair.random;
    if (qm_random_below(random, 3) == 0)
        pair.a = qm_shape_torus(5, 4, 1.0, 0.4);
    else
        pair.a = qm_shape_soup(random, 1 + qm_random_below(random, 3), QM_SOUP_QUADS, QM_SOUP_APART,
                               qm_random_range(random, 0.0, 2.0));
    bool is_flat_source = qm_random_below(random, 6) == 0;
    for (size_t face = 0; face < pair.a.face_count && !is_flat_source; face++)
        if (qm_random_below(random, 5) == 0) {
            uint32_t *index = pair.a.faces + 4 * face, first = index[1];
            index[1] = index[2];
            index[2] = first;
        }
    pair.b = qm_shape_copy(&pair.a);
    qm_shape_shake(&pair.a, random, 0.1 * (double)qm_random_below(random, 2));
    for (size_t i = 0; i < 3 * pair.a.vertex_count; i++)
        pair.b.positions[i] = pair.a.positions[i];
    qm_shape_shake(&pair.b, random, pow(10.0, qm_random_range(random, -12.0, -0.5)));
    if (is_flat_source) {
        qm_mesh flat = qm_shape_triangulated(&pair.a);
        qm_shape_free(&pair.a);
        pair.a = flat;
    }
    return pair;
}

static void pieces_next_to_bent_patches_hold(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 4000 : 60;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        piece_pair pair = draw_bent(number);
        open_pair(&pair);
        pair.maker.patch_error = pow(10.0, qm_random_range(&pair.random, -10.0, -3.0));
        for (int i = 0; i < 4; i++) {
            uint32_t face = (uint32_t)qm_random_below(&pair.random, pair.a.face_count);
            bool second = pair.a.faces[4 * face + 3] != QM_NO_INDEX && qm_random_below(&pair.random, 2) == 1;
            check_down(&pair, qm_piece_first(&pair.maker, face, second),
                       2 + (int)qm_random_below(&pair.random, 14));
        }
        close_pair(&pair);
    }
    check_strays();
}

/**
 * Over a single point the bound by the corners is the distance itself at the middle of an equilateral piece:
 * what is lost there by rounding is seen whole. The point is at the middle of a half, of a quarter or of all.
 */
static void pieces_over_a_point_hold(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 1000000 : 3000;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        piece_pair pair = {.number = number, .random = qm_random_make(qm_check_seed(), 900000 + number)};
        qm_random *random = &pair.random;
        double corner[3][3], point[3][3], out[3], x[3], y[3];
        qm_random_direction(random, x);
        qm_random_direction(random, out);

        double along = 0.0, length = 0.0;
        for (int k = 0; k < 3; k++)
            along += x[k] * out[k];
        for (int k = 0; k < 3; k++) {
            y[k] = out[k] - along * x[k];
            length += y[k] * y[k];
        }
        double size = pow(10.0, qm_random_range(random, -3.0, 0.0));
        double above = qm_random_below(random, 2) ? 0.0 : pow(10.0, qm_random_range(random, -16.0, -6.0));
        for (int k = 0; k < 3; k++) {
            y[k] /= sqrt(length);
            for (int i = 0; i < 3; i++)
                corner[i][k] = size * (x[k] * cos(2.0 * M_PI * i / 3) + y[k] * sin(2.0 * M_PI * i / 3));
            for (int i = 0; i < 3; i++)
                point[i][k] = above * (x[(k + 1) % 3] * y[(k + 2) % 3] - x[(k + 2) % 3] * y[(k + 1) % 3]);
        }
        pair.a = qm_shape_face(3, (const double(*)[3])corner);
        pair.b = qm_shape_face(3, (const double(*)[3])point);
        open_pair(&pair);
        qm_source_piece piece = qm_piece_first(&pair.maker, 0, false);
        qm_piece_bounds bounds;
        qm_piece_bound(&pair.maker, &piece, &pair.desk, &bounds);
        check_at(&pair, &piece, &bounds, (const double[]){1.0 / 3, 1.0 / 3, 1.0 / 3});
        check_piece(&pair, &piece, &bounds);
        close_pair(&pair);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pieces_of_triangles_hold),
        cmocka_unit_test(pieces_of_patches_hold),
        cmocka_unit_test(pieces_next_to_bent_patches_hold),
        cmocka_unit_test(pieces_over_a_point_hold),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
