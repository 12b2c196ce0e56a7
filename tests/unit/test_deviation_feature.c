/*
 * Distances from edges and vertices of the target: the cubic function and its error at points of a piece, in 113
 * bits; and the integrals over pieces beside a few facets, against sums over small triangles.
 */
#include "check.h"

#include "deviation/deviation_feature.h"
#include "qm/deviation.h"
#include "random.h"
#include "shapes.h"

#include <math.h>
#include <string.h>

typedef __float128 wide;

/* Points along an edge of a piece; cells along an edge of a sum. */
enum { POINTS = 12, GRID = 48 };
#define TIGHT 0.25     /* of the permitted error: the greatest that is met, at least */
#define LEAST_NEAR 0.3 /* of the sizes of source and target, in a case: its distance, */
#define MOST_NEAR 1.5

/* ---- the cubic function ---- */

static wide root(wide x)
{
    if (!(x > 0)) return 0;
    wide y = (wide)sqrtl((long double)x);
    for (int i = 0; i < 3; i++)
        y = (y + x / y) / 2;
    return y;
}

/** The distance of a point of a quadratic piece from a vertex, or from a line. */
static wide distance_at(const qm_vec at[6], const qm_deviation_feature *feature, const wide l[3])
{
    static const int pair[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {2, 0}};
    const double o[3] = {feature->origin.x, feature->origin.y, feature->origin.z};
    const double along[3] = {feature->along.x, feature->along.y, feature->along.z};
    wide x[3], dot = 0, norm2 = 0, sum = 0;
    for (int k = 0; k < 3; k++) {
        x[k] = -(wide)o[k];
        for (int c = 0; c < 6; c++) {
            const double here[3] = {at[c].x, at[c].y, at[c].z};
            x[k] += (c < 3 ? 1 : 2) * l[pair[c][0]] * l[pair[c][1]] * (wide)here[k];
        }
        dot += x[k] * (wide)along[k];
        norm2 += (wide)along[k] * (wide)along[k];
    }
    for (int k = 0; k < 3; k++) {
        wide rest = x[k] - (norm2 > 0 ? dot / norm2 * (wide)along[k] : 0);
        sum += rest * rest;
    }
    return root(sum);
}

static wide cubic_part_at(const double c[4], const wide l[3])
{
    wide sum = 6 * l[0] * l[1] * l[2] * (wide)c[3];
    for (int k = 0; k < 3; k++) {
        wide a = l[k], b = l[(k + 1) % 3];
        sum += 3 * a * b * (a - b) * (wide)c[k];
    }
    return sum;
}

static wide quadratic_at(const double q[6], const wide l[3])
{
    wide sum = 0;
    for (int k = 0; k < 3; k++)
        sum += l[k] * l[k] * (wide)q[k] + 2 * l[k] * l[(k + 1) % 3] * (wide)q[3 + k];
    return sum;
}

static qm_vec draw_vec(qm_random *random, double reach)
{
    double x[3];
    qm_random_point(random, -reach, reach, x);
    return (qm_vec){x[0], x[1], x[2]};
}

/** Checks one function; returns the greatest of its errors as a part of what is permitted. */
static double check_function(const qm_vec at[6], const qm_deviation_feature *feature,
                             const qm_feature_distance *of, double eta, uint64_t number)
{
    double most = 0.0;
    for (int j = 0; j <= POINTS; j++)
        for (int i = 0; i + j <= POINTS; i++) {
            const wide l[3] = {(wide)(POINTS - i - j) / POINTS, (wide)i / POINTS, (wide)j / POINTS};
            wide d = distance_at(at, feature, l), e = cubic_part_at(of->cubic, l);
            wide off = quadratic_at(of->value, l) + e - d;
            if (off < 0) off = -off;
            QM_CHECK(off <= (wide)of->off && d >= (wide)of->least && e <= (wide)of->cubic_most &&
                         -e <= (wide)of->cubic_most,
                     "seed %llu, case %llu: off by %g of %g, %g of at least %g, cubic part %g of at most %g",
                     (unsigned long long)qm_check_seed(), (unsigned long long)number, (double)off, of->off,
                     (double)d, of->least, (double)e, of->cubic_most);
            most = fmax(most, (double)off / (of->off - eta));
        }
    return most;
}

/** Pieces of all sizes at all distances. Where the error is far above roundings it is not much above the true one. */
static void cubic_distances_hold(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 200000 : 4000, found = 0;
    double tightest = 0.0;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        qm_random random = qm_random_make(qm_check_seed(), 910000 + number);
        const qm_deviation_setup setup = {.extent = 4.0, .eta = 384.0 * 0x1p-53 * 4.0};
        double size = pow(10.0, qm_random_range(&random, -3.0, 0.0)),
               bend = qm_random_range(&random, 0.0, 0.3);
        qm_deviation_feature feature = {draw_vec(&random, 1.0), {0.0, 0.0, 0.0}, 0.0};
        if (number % 2 == 0) {
            double along[3];
            qm_random_direction(&random, along);
            feature.along = (qm_vec){along[0], along[1], along[2]};
            feature.length = 1.0;
        }
        qm_vec at[6], from = qm_vec_add(feature.origin, draw_vec(&random, 1.0));
        for (int k = 0; k < 3; k++)
            at[k] = qm_vec_add(from, draw_vec(&random, size));
        for (int k = 0; k < 3; k++)
            at[3 + k] = qm_vec_add(qm_vec_mix(at[k], at[(k + 1) % 3], 0.5),
                                   draw_vec(&random, number % 3 ? bend * size : 0.0));
        qm_feature_distance of;
        if (!qm_deviation_feature_distance(&setup, &feature, at, &of)) continue;
        found++;
        double part = check_function(at, &feature, &of, setup.eta, number);
        if (of.off > 1e3 * setup.eta) tightest = fmax(tightest, part);
    }
    QM_CHECK(found > count / 4 && tightest > TIGHT && tightest <= 1.0, "%llu found, tightest %g",
             (unsigned long long)found, tightest);
}

/* ---- pieces beside a few facets ---- */

typedef double vec3[3];

static double dot(const vec3 a, const vec3 b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void subtract(const vec3 a, const vec3 b, vec3 out)
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] - b[k];
}

static void cross(const vec3 a, const vec3 b, vec3 out)
{
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static double segment_distance(const vec3 a, const vec3 b, const vec3 p)
{
    vec3 edge, way;
    subtract(b, a, edge);
    subtract(p, a, way);
    double t = fmin(1.0, fmax(0.0, dot(way, edge) / dot(edge, edge)));
    for (int k = 0; k < 3; k++)
        way[k] -= t * edge[k];
    return sqrt(dot(way, way));
}

/** Over the triangle the height, elsewhere the distance from the nearest edge. */
static double triangle_distance(const vec3 c[3], const vec3 p)
{
    vec3 edge[2], normal, way;
    double least = INFINITY;
    bool is_over = true;
    subtract(c[1], c[0], edge[0]);
    subtract(c[2], c[0], edge[1]);
    cross(edge[0], edge[1], normal);
    for (int k = 0; k < 3; k++) {
        vec3 along, inwards;
        subtract(c[(k + 1) % 3], c[k], along);
        cross(normal, along, inwards);
        subtract(p, c[k], way);
        is_over &= dot(inwards, way) >= 0.0;
        least = fmin(least, segment_distance(c[k], c[(k + 1) % 3], p));
    }
    return is_over ? fabs(dot(normal, way)) / sqrt(dot(normal, normal)) : least;
}

enum { FACETS = 3 };

/** A triangle, and a fan of a few facets beside it. */
typedef struct fan_case {
    vec3 source[3], facet[FACETS][3];
    int count;
} fan_case;

static void draw_case(fan_case *c, qm_random *random)
{
    vec3 rim[FACETS + 1], centre = {0.0, 0.0, qm_random_range(random, LEAST_NEAR, MOST_NEAR)};
    double size = qm_random_range(random, 0.1, 1.0), reach = qm_random_range(random, 0.1, 2.0);
    c->count = 1 + (int)qm_random_below(random, FACETS);
    for (int i = 0; i <= c->count; i++)
        for (int k = 0; k < 3; k++)
            rim[i][k] = reach * qm_random_range(random, -1.0, k < 2 ? 1.0 : 0.5);
    for (int i = 0; i < c->count; i++)
        for (int k = 0; k < 3; k++) {
            c->facet[i][0][k] = 0.0;
            c->facet[i][1][k] = rim[i][k];
            c->facet[i][2][k] = rim[i + 1][k];
        }
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            c->source[i][k] = centre[k] + size * qm_random_range(random, -1.0, 1.0) * (k < 2 ? 1.0 : 0.3);
}

/** A small fan about level with its vertex, and a small source high above that, a part of which lies over the fan: what the fan
 * takes off the distance from the vertex is most of what the bounds leave open. */
static void draw_level_case(fan_case *c, qm_random *random)
{
    double reach = qm_random_range(random, 0.02, 0.1), size = qm_random_range(random, 0.05, 0.2), turn[2];
    vec3 centre = {0.0, 0.0, qm_random_range(random, 0.8, 1.2)};
    c->count = 1 + (int)qm_random_below(random, FACETS);
    turn[0] = qm_random_range(random, 0.0, 2.0 * M_PI);
    for (int i = 0; i < c->count; i++) {
        turn[1] = turn[0] + qm_random_range(random, 0.02, 1.5);
        for (int k = 0; k < 3; k++)
            c->facet[i][0][k] = 0.0;
        for (int end = 0; end < 2; end++) {
            c->facet[i][1 + end][0] = reach * cos(turn[end]);
            c->facet[i][1 + end][1] = reach * sin(turn[end]);
            c->facet[i][1 + end][2] = 0.0;
        }
        turn[0] = turn[1];
    }
    for (int k = 0; k < 2; k++)
        centre[k] = -c->facet[0][1][k] / reach * size * qm_random_range(random, 0.0, 0.4);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            c->source[i][k] = centre[k] + size * qm_random_range(random, -1.0, 1.0) * (k < 2 ? 1.0 : 0.02);
}

/** A needle, and a narrow source above it that sticks out beyond its tip: beyond one edge there, or beyond both. */
static void draw_sharp_case(fan_case *c, qm_random *random)
{
    double angle = qm_random_range(random, 0.03, 0.2), size = qm_random_range(random, 0.3, 0.8);
    double turn = angle * qm_random_range(random, 0.0, 1.0), high = qm_random_range(random, 0.8, 1.2);
    const vec3 facet[3] = {{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {cos(angle), sin(angle), 0.0}};
    const double along[3] = {-size * qm_random_range(random, 0.3, 0.8), size, 0.8 * size};
    c->count = 1;
    memcpy(c->facet[0], facet, sizeof facet);
    for (int i = 0; i < 3; i++) {
        double aside = i == 2 ? 0.02 * angle * size : 0.0;
        c->source[i][0] = along[i] * cos(turn) - aside * sin(turn);
        c->source[i][1] = along[i] * sin(turn) + aside * cos(turn);
        c->source[i][2] = high;
    }
}

/** Means of the distance and of its square over the source. */
static void sum_over_grid(const fan_case *c, double mean[2], double *range)
{
    double least = INFINITY, most = 0.0, cell = 1.0 / (GRID * GRID);
    mean[0] = mean[1] = 0.0;
    for (int j = 0; j < GRID; j++)
        for (int i = 0; i + j < GRID; i++)
            for (int half = 0; half < (i + j + 1 < GRID ? 2 : 1); half++) {
                double third = half ? 2.0 / 3 : 1.0 / 3, u = (i + third) / GRID, v = (j + third) / GRID;
                vec3 p;
                double d = INFINITY;
                for (int k = 0; k < 3; k++)
                    p[k] = (1.0 - u - v) * c->source[0][k] + u * c->source[1][k] + v * c->source[2][k];
                for (int f = 0; f < c->count; f++)
                    d = fmin(d, triangle_distance((const vec3 *)c->facet[f], p));
                mean[0] += cell * d;
                mean[1] += cell * d * d;
                least = fmin(least, d);
                most = fmax(most, d);
            }
    *range = most - least;
}

static void check_case(const fan_case *c, uint64_t number, size_t *bent)
{
    qm_context ctx = qm_context_make();
    qm_deviation_setup setup;
    static qm_deviation_workspace desk;
    qm_deviation_bounds bounds;
    qm_bvh *tree[2];
    qm_mesh a = qm_shape_face(3, (const double(*)[3])c->source), b = {0};
    for (int f = 0; f < c->count; f++) {
        qm_mesh more = qm_shape_face(3, (const double(*)[3])c->facet[f]), before = b;
        b = f == 0 ? more : qm_shape_joined(&before, &more);
        if (f > 0) {
            qm_shape_free(&before);
            qm_shape_free(&more);
        }
    }
    assert_int_equal(qm_bvh_build(&ctx, &a, QM_BVH_ALL, 1, &tree[0]), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_ALL, 1, &tree[1]), QM_OK);
    assert_int_equal(qm_deviation_setup_init(&ctx, tree[0], tree[1], QM_QUADS_TRIANGLES, &setup), QM_OK);
    qm_deviation_piece piece = qm_deviation_piece_first(&setup, 0, false);
    qm_deviation_piece_bound(&setup, &piece, &desk, &bounds);
    *bent += bounds.bend.cells > 0;
    double scale = tree[1]->frame.scale, mean[2], range;
    sum_over_grid(c, mean, &range);
    double spare = range / (GRID * GRID), most = mean[0] + range;
    double low = bounds.mean_low / bounds.area_high / scale,
           high = bounds.mean_high / bounds.area_low / scale;
    QM_CHECK(low <= mean[0] + spare && high >= mean[0] - spare,
             "seed %llu, case %llu: mean [%.17g, %.17g] against %.17g, spare %g",
             (unsigned long long)qm_check_seed(), (unsigned long long)number, low, high, mean[0], spare);
    low = bounds.square_low / bounds.area_high / (scale * scale);
    high = bounds.square_high / bounds.area_low / (scale * scale);
    spare *= 2.0 * most;
    QM_CHECK(low <= mean[1] + spare && high >= mean[1] - spare,
             "seed %llu, case %llu: mean square [%.17g, %.17g] against %.17g, spare %g",
             (unsigned long long)qm_check_seed(), (unsigned long long)number, low, high, mean[1], spare);
    for (int i = 0; i < 2; i++)
        qm_bvh_destroy(&ctx, tree[i]);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void integrals_beside_edges_hold(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 100000 : 3000;
    size_t bent = 0;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        qm_random random = qm_random_make(qm_check_seed(), 920000 + number);
        fan_case c;
        static void (*const draw[3])(fan_case *, qm_random *) = {draw_case, draw_level_case, draw_sharp_case};
        draw[number % 3](&c, &random);
        check_case(&c, number, &bent);
    }
    QM_CHECK(bent > count / 20, "%zu bent", bent);
}

/** A sliver beside patches that are folded: an edge under a centroid is not always the nearest part of the target. */
static void edges_of_bent_patches_hold(void **state)
{
    (void)state;
    static const double source[3][3] = {{0.0000000000, 0.0000000000, 0.0000000000},
                                        {-3.3765006439, 2.8783130636, 2.6430169888},
                                        {-2.2335785507, -1.0808936739, 4.0313863623}};
    static const double target[6][3] = {
        {-5.4803236615, 0.6213862170, 2.7532348816}, {-6.6529719017, 0.6214197194, 2.7122591996},
        {-0.0049766040, 0.6213202216, 2.7534906099}, {-1.8178922891, 0.6213375349, 2.7535036766},
        {-3.2419834638, 0.6213857112, 2.7489391235}, {-3.0893100071, 0.4559471868, 2.7535093794}};
    static const uint32_t faces[2][4] = {{1, 4, 5, 0}, {3, 1, 5, 4}};
    qm_mesh a = qm_shape_face(3, source), b = {0};
    for (int f = 0; f < 2; f++) {
        vec3 corner[4];
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < 3; k++)
                corner[i][k] = target[faces[f][i]][k];
        qm_mesh more = qm_shape_face(4, (const double(*)[3])corner), before = b;
        b = f == 0 ? more : qm_shape_joined(&before, &more);
        if (f > 0) {
            qm_shape_free(&before);
            qm_shape_free(&more);
        }
    }
    qm_context ctx = qm_context_make();
    qm_bvh *tree[2];
    assert_int_equal(qm_bvh_build(&ctx, &a, QM_BVH_ALL, 1, &tree[0]), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_ALL, 1, &tree[1]), QM_OK);
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = QM_QUADS_BILINEAR;
    options.tolerance = 0.1;
    options.piece_limit = 4096;
    for (double accuracy = 1e-2; accuracy > 2e-4; accuracy *= 0.5) {
        qm_deviation found;
        options.accuracy = accuracy;
        assert_int_equal(qm_deviation_measure(&ctx, tree[0], tree[1], &options, &found), QM_OK);
        QM_CHECK(found.mean.lower <= found.mean.upper && found.rms.lower <= found.rms.upper,
                 "accuracy %g: mean [%.17g, %.17g], rms [%.17g, %.17g]", accuracy, found.mean.lower,
                 found.mean.upper, found.rms.lower, found.rms.upper);
        qm_deviation_reset(&ctx, &found);
    }
    for (int i = 0; i < 2; i++)
        qm_bvh_destroy(&ctx, tree[i]);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cubic_distances_hold),
        cmocka_unit_test(integrals_beside_edges_hold),
        cmocka_unit_test(edges_of_bent_patches_hold),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
