/*
 * The two linear functions of a piece, at points of it: the distance by the slow twin lies between them, for
 * the pieces of random soups and for the parts that they are cut into.
 */
#include "check.h"

#include "deviation_piece.h"
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
    for (int i = 0; i < 3; i++) {
        low += weight[i] * bounds->low[i] * inverse_scale;
        high += weight[i] * bounds->high[i] * inverse_scale;
    }
    QM_CHECK(low <= truth.upper && high >= truth.lower,
             "seed %llu, pair %llu, face %u, depth %d, weights %.17g %.17g %.17g: [%.17g, %.17g] against "
             "[%.17g, %.17g]",
             (unsigned long long)qm_check_seed(), (unsigned long long)pair->number, piece->face, piece->depth,
             weight[0], weight[1], weight[2], low, high, truth.lower, truth.upper);
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
    assert_true(bounds->mean_low <= bounds->mean_high && bounds->square_low <= bounds->square_high);
    assert_true(bounds->area_low <= bounds->area_high);
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
    int count = qm_piece_split(maker, piece, &pair->desk, part, bounds);
    assert_in_range(count, 2, QM_PIECE_PARTS);
    double area = 0.0, whole = fabs((piece->u[1] - piece->u[0]) * (piece->v[2] - piece->v[0]) -
                                    (piece->u[2] - piece->u[0]) * (piece->v[1] - piece->v[0]));
    for (int i = 0; i < count; i++)
        area += fabs((part[i].u[1] - part[i].u[0]) * (part[i].v[2] - part[i].v[0]) -
                     (part[i].u[2] - part[i].u[0]) * (part[i].v[1] - part[i].v[0]));
    QM_CHECK(fabs(area - whole) <= 1e-12, "pair %llu: parts of %.17g make %.17g",
             (unsigned long long)pair->number, whole, area);
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pieces_of_triangles_hold),
        cmocka_unit_test(pieces_of_patches_hold),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
