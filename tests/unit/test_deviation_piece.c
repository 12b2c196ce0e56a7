/*
 * The two linear functions of a piece, at points of it: the distance by the slow twin lies between them, for
 * the pieces of random soups and for the parts that they are cut into.
 */
#include "check.h"

#include "deviation/deviation_piece.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>

#define EPS 1e-12 /* of the slow twin's brackets, where it reaches that */

/** A source and a target with their trees, and what their pieces share. */
typedef struct piece_pair {
    uint64_t number;
    qm_quad_reading reading;
    qm_mesh a, b;
    qm_bvh *tree_a, *tree_b;
    qm_deviation_setup maker;
    qm_random random;
    qm_deviation_workspace desk;
} piece_pair;

/** Of random points in pieces that have strays: the expected number of strays, and the number found. */
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
    assert_int_equal(qm_deviation_setup_init(&ctx, pair->tree_a, pair->tree_b, pair->reading, &pair->maker),
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

typedef long double exact_vec[3];

static void exact_cross(const exact_vec a, const exact_vec b, exact_vec out)
{
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static long double exact_dot(const exact_vec a, const exact_vec b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** A patch as seen along the common normal of its diagonals. */
typedef struct patch_view {
    exact_vec corner[4], normal;
} patch_view;

static patch_view see_patch(const qm_mesh *mesh, uint32_t face)
{
    patch_view view;
    exact_vec diagonal[2];
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++)
            view.corner[i][k] =
                mesh->positions[3 * (size_t)mesh->faces[4 * (size_t)face + (size_t)i] + (size_t)k];
    for (int k = 0; k < 3; k++) {
        diagonal[0][k] = view.corner[2][k] - view.corner[0][k];
        diagonal[1][k] = view.corner[3][k] - view.corner[1][k];
    }
    exact_cross(diagonal[0], diagonal[1], view.normal);
    return view;
}

/** The point at parameters, and both derivatives. */
static void patch_at(const patch_view *view, const long double uv[2], exact_vec at, exact_vec along[2])
{
    long double u = uv[0], v = uv[1];
    for (int k = 0; k < 3; k++) {
        long double c[4] = {view->corner[0][k], view->corner[1][k], view->corner[2][k], view->corner[3][k]};
        at[k] = (1 - u) * (1 - v) * c[0] + u * (1 - v) * c[1] + u * v * c[2] + (1 - u) * v * c[3];
        along[0][k] = (1 - v) * (c[1] - c[0]) + v * (c[2] - c[3]);
        along[1][k] = (1 - u) * (c[3] - c[0]) + u * (c[2] - c[1]);
    }
}

/** The point of a patch over one of its triangles, and the normal there, by Newton's method in the view. */
static void find_over(const patch_view *view, const exact_vec from, exact_vec at, exact_vec normal)
{
    long double uv[2] = {0.5L, 0.5L};
    exact_vec along[2], gap, turned;
    for (int step = 0; step < 30; step++) {
        patch_at(view, uv, at, along);
        exact_cross(along[0], along[1], normal);
        for (int k = 0; k < 3; k++)
            gap[k] = from[k] - at[k];
        long double area = exact_dot(normal, view->normal);
        exact_cross(gap, along[1], turned);
        uv[0] += exact_dot(turned, view->normal) / area;
        exact_cross(along[0], gap, turned);
        uv[1] += exact_dot(turned, view->normal) / area;
    }
}

/** The point of the source with these weights of the piece's corners; of a triangle that stands for a patch,
 * that of the patch over it. */
static void find_position(const piece_pair *pair, const qm_deviation_piece *piece, const double weight[3],
                          double out[3])
{
    double uv[2] = {0, 0};
    for (int i = 0; i < 3; i++) {
        uv[0] += weight[i] * piece->u[i];
        uv[1] += weight[i] * piece->v[i];
    }
    const uint32_t *index = pair->a.faces + 4 * (size_t)piece->face;
    if (!piece->is_flat) {
        qm_slow_position(&pair->a, piece->face, QM_QUADS_BILINEAR, uv, out);
        return;
    }
    const double *corner[3] = {pair->a.positions + 3 * (size_t)index[0],
                               pair->a.positions + 3 * (size_t)index[piece->second ? 2 : 1],
                               pair->a.positions + 3 * (size_t)index[piece->second ? 3 : 2]};
    exact_vec at, over, normal;
    for (int k = 0; k < 3; k++)
        at[k] = (1.0L - uv[0] - uv[1]) * corner[0][k] + (long double)uv[0] * corner[1][k] +
                (long double)uv[1] * corner[2][k];
    bool is_patch = index[3] != QM_NO_INDEX && pair->reading == QM_QUADS_BILINEAR;
    if (is_patch) {
        patch_view view = see_patch(&pair->a, piece->face);
        find_over(&view, at, over, normal);
    }
    for (int k = 0; k < 3; k++)
        out[k] = (double)(is_patch ? over[k] : at[k]);
}

/** The functions that a height that bends lies between, term by term. */
static void find_bend(const qm_quadratic *bend, const double weight[3], double between[2])
{
    static const int pair_of[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {2, 0}};
    double value = 0.0;
    for (int k = 0; k < 6; k++)
        value += (k < 3 ? 1.0 : 2.0) * weight[pair_of[k][0]] * weight[pair_of[k][1]] * bend->value[k];
    between[0] = value - bend->below;
    between[1] = value + bend->above;
}

static void check_at(const piece_pair *pair, const qm_deviation_piece *piece,
                     const qm_deviation_bounds *bounds, const double weight[3])
{
    double at[3], low = 0.0, high = 0.0, inverse_scale = pair->tree_b->frame.inverse_scale;
    find_position(pair, piece, weight, at);
    qm_slow_bracket truth = qm_slow_distance(&pair->b, pair->reading, at, EPS);
    /* The position itself is rounded, which matters where the target is far smaller. */
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
    if (bounds->bend.cells > 0) {
        double between[2];
        find_bend(&bounds->bend, weight, between);
        low = fmax(low, inverse_scale * fmax(between[0], -between[1]));
        high = fmin(high, inverse_scale * fmax(between[1], -between[0]));
    }
    high += (bounds->invalid_high > 0.0 ? bounds->excess : 0.0) * inverse_scale;
    if (bounds->invalid_low > 0.0) low = 0.0;
    QM_CHECK(low <= truth.upper && high >= truth.lower,
             "seed %llu, pair %llu, face %u, depth %d, weights %.17g %.17g %.17g: [%.17g, %.17g] against "
             "[%.17g, %.17g]",
             (unsigned long long)qm_check_seed(), (unsigned long long)pair->number, piece->face, piece->depth,
             weight[0], weight[1], weight[2], low, high, truth.lower, truth.upper);
}

/** Whether a random point of a piece is one where a function does not hold. */
static void count_strays(piece_pair *pair, const qm_deviation_piece *piece, const qm_deviation_bounds *bounds)
{
    double expected = fmin(1.0, bounds->invalid_low + bounds->invalid_high);
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
    if (bounds->bend.cells > 0) {
        double between[2];
        find_bend(&bounds->bend, weight, between);
        low = fmax(low, inverse_scale * between[0]);
        high = fmin(high, inverse_scale * between[1]);
    }
    strays.expected += expected;
    strays.variance += expected * (1.0 - expected);
    strays.found += fmax(low, -high) > truth.upper || fmax(high, -low) < truth.lower;
}

/** The share of random points that stray is the pieces' own, within six standard deviations. */
static void check_strays(void)
{
    QM_CHECK((double)strays.found <= strays.expected + 6.0 * sqrt(strays.variance) + 3.0,
             "seed %llu: %zu points stray, %g were reported", (unsigned long long)qm_check_seed(),
             strays.found, strays.expected);
    strays = (stray_count){0.0, 0.0, 0};
}

/** Corners, a point of each edge, and points inside. */
static void check_piece(piece_pair *pair, const qm_deviation_piece *piece, const qm_deviation_bounds *bounds)
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

static __float128 parameter_area(const qm_deviation_piece *piece)
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
static void check_areas(const piece_pair *pair, const qm_deviation_piece *piece,
                        const qm_deviation_piece *part, int count, double leak)
{
    __float128 off = -parameter_area(piece);
    for (int i = 0; i < count; i++)
        off += parameter_area(&part[i]);
    qm_deviation_face face = qm_deviation_face_load(&pair->maker, piece);
    /* Corners on cuts of cuts have products of more than 113 bits. */
    double missed = fmax(0.0, fabs((double)off) - 0x1p-104) * qm_deviation_face_density(&pair->maker, &face);
    QM_CHECK(missed <= leak, "seed %llu, pair %llu: off by %.17g, which was to be %.17g at most",
             (unsigned long long)qm_check_seed(), (unsigned long long)pair->number, missed, leak);
}

/** The fineness of the pieces is drawn for each cut, from exact to coarse. */
static void check_parts(piece_pair *pair, const qm_deviation_piece *piece, int levels)
{
    qm_deviation_piece part[QM_DEVIATION_PARTS];
    qm_deviation_bounds bounds[QM_DEVIATION_PARTS];
    qm_deviation_setup *maker = &pair->maker;
    double finest = 4.0 * maker->eta;
    maker->worth = fmax(finest, pow(10.0, qm_random_range(&pair->random, -14.0, -1.0)));
    maker->patch_error = fmax(finest, pow(10.0, qm_random_range(&pair->random, -5.0, 0.0)));
    maker->part_limit = 3 + (int)qm_random_below(&pair->random, QM_DEVIATION_PARTS - 2);
    double leak;
    int count = qm_deviation_piece_split(maker, piece, &pair->desk, part, bounds, &leak);
    assert_in_range(count, 2, QM_DEVIATION_PARTS);
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
            qm_deviation_piece piece = qm_deviation_piece_first(&pair->maker, face, second == 1);
            qm_deviation_bounds bounds;
            qm_deviation_piece_bound(&pair->maker, &piece, &pair->desk, &bounds);
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
static void check_down(piece_pair *pair, qm_deviation_piece piece, int levels)
{
    for (int level = 0; level < levels; level++) {
        qm_deviation_piece part[QM_DEVIATION_PARTS];
        qm_deviation_bounds bounds[QM_DEVIATION_PARTS];
        double leak;
        int count = qm_deviation_piece_split(&pair->maker, &piece, &pair->desk, part, bounds, &leak);
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
            check_down(&pair, qm_deviation_piece_first(&pair.maker, face, second),
                       2 + (int)qm_random_below(&pair.random, 14));
        }
        close_pair(&pair);
    }
    check_strays();
}

/** Half of a quad that two triangles stand for: at random points of it the area of the patch, for an area of
 * the triangle under it, is within what the shape allows for the whole. */
static void check_spread(piece_pair *pair, const qm_deviation_piece *piece)
{
    patch_view view = see_patch(&pair->a, piece->face);
    qm_deviation_face face = qm_deviation_face_load(&pair->maker, piece);
    qm_deviation_shape shape = qm_deviation_shape_make(&pair->maker, &face, piece);
    const long double *corner[3] = {view.corner[0], view.corner[piece->second ? 2 : 1],
                                    view.corner[piece->second ? 3 : 2]};
    exact_vec edge[2], triangle, at, over, normal;
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            edge[i][k] = corner[i + 1][k] - corner[0][k];
    exact_cross(edge[0], edge[1], triangle);
    long double doubled = sqrtl(exact_dot(triangle, triangle)), scale = pair->tree_b->frame.scale;
    long double whole = 0.5L * doubled * scale * scale * pair->maker.area_unit;
    for (int sample = 0; sample < 8; sample++) {
        double u = qm_random_range(&pair->random, 0, 1), v = qm_random_range(&pair->random, 0, 1 - u);
        for (int k = 0; k < 3; k++)
            at[k] = corner[0][k] + u * edge[0][k] + v * edge[1][k];
        find_over(&view, at, over, normal);
        long double share = sqrtl(exact_dot(normal, normal)) / exact_dot(normal, view.normal) /
                            (doubled / exact_dot(triangle, view.normal));
        for (int i = 0; i < 3; i++)
            QM_CHECK(shape.low[i] <= share * whole && shape.high[i] >= share * whole,
                     "seed %llu, pair %llu, face %u: %.17Lg is not in [%.17g, %.17g]",
                     (unsigned long long)qm_check_seed(), (unsigned long long)pair->number, piece->face,
                     share * whole, shape.low[i], shape.high[i]);
    }
}

/** Quads that are flat but for noise from nothing to a tenth of their size, so that triangles stand for them;
 * the target is the same but for noise, or another one, and cut more or less finely. */
static void triangles_stand_for_patches(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 4000 : 60;
    size_t flat = 0;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        piece_pair pair = {.number = number,
                           .reading = QM_QUADS_BILINEAR,
                           .random = qm_random_make(qm_check_seed(), 800000 + number)};
        qm_random *random = &pair.random;
        pair.a = qm_shape_torus(3 + (int)qm_random_below(random, 4), 3 + (int)qm_random_below(random, 4), 1.0,
                                0.4);
        qm_shape_shake(&pair.a, random,
                       qm_random_below(random, 3) ? pow(10.0, qm_random_range(random, -9.0, -1.0)) : 0.0);
        pair.b = qm_random_below(random, 4) ? qm_shape_copy(&pair.a) : qm_shape_torus(6, 5, 1.0, 0.45);
        qm_shape_shake(&pair.b, random, pow(10.0, qm_random_range(random, -10.0, -0.5)));
        open_pair(&pair);
        pair.maker.flat_error = pair.maker.flat_spread = 1.0;
        double base_margin = pair.maker.base_margin;
        pair.maker.patch_error = pow(10.0, qm_random_range(random, -10.0, -2.0));
        for (int i = 0; i < 4; i++) {
            uint32_t face = (uint32_t)qm_random_below(random, pair.a.face_count);
            pair.maker.base_margin = 1.0; /* twisted targets are no matter */
            qm_deviation_piece piece =
                qm_deviation_piece_first(&pair.maker, face, qm_random_below(random, 2) == 1);
            pair.maker.base_margin = base_margin;
            flat += piece.is_flat;
            if (piece.is_flat) check_spread(&pair, &piece);
            check_down(&pair, piece, 2 + (int)qm_random_below(random, 14));
        }
        close_pair(&pair);
    }
    assert_true(flat > 2 * count);
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
        qm_deviation_piece piece = qm_deviation_piece_first(&pair.maker, 0, false);
        qm_deviation_bounds bounds;
        qm_deviation_piece_bound(&pair.maker, &piece, &pair.desk, &bounds);
        check_at(&pair, &piece, &bounds, (const double[]){1.0 / 3, 1.0 / 3, 1.0 / 3});
        check_piece(&pair, &piece, &bounds);
        close_pair(&pair);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pieces_of_triangles_hold),         cmocka_unit_test(pieces_of_patches_hold),
        cmocka_unit_test(pieces_next_to_bent_patches_hold), cmocka_unit_test(triangles_stand_for_patches),
        cmocka_unit_test(pieces_over_a_point_hold),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
