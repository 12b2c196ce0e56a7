/*
 * Matches of pieces with patches near them: heights along the patch's normals against their definition, and
 * bounds of the distance against distances of points of the patch.
 */
#include "check.h"

#include "deviation/deviation_match.h"
#include "random.h"

#include <math.h>

enum { POINTS = 12, FEET = 12 };

typedef long double exact_vec[3];

/** A piece of a patch and another patch, with the setup of coordinates up to 2. */
typedef struct match_case {
    uint64_t number;
    qm_random random;
    qm_deviation_setup setup;
    qm_deviation_face face;
    qm_deviation_piece piece;
    qm_bilinear patch;
    qm_deviation_match match;
} match_case;

/** A bent quad, turned by chance; and one near it by less than its own size. */
static void draw_patches(match_case *c)
{
    static const double square[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    double bent = qm_random_range(&c->random, 0.0, 0.4);
    double apart = pow(10.0, qm_random_range(&c->random, -9.0, -0.5));
    qm_vec near[4];
    for (int i = 0; i < 4; i++) {
        double off[6];
        for (int k = 0; k < 6; k++)
            off[k] = qm_random_range(&c->random, -1.0, 1.0);
        c->face.corner[i] =
            (qm_vec){square[i][0] + bent * off[0], square[i][1] + bent * off[1], bent * off[2]};
        near[i] = qm_vec_add(c->face.corner[i], (qm_vec){apart * off[3], apart * off[4], apart * off[5]});
    }
    c->face.is_patch = true;
    c->face.patch = qm_bilinear_make(c->face.corner);
    c->patch = qm_bilinear_make(near);
}

/** A triangle of parameters, mostly within the patch. */
static void draw_piece(match_case *c)
{
    double size = pow(0.5, qm_random_range(&c->random, 0.0, 6.0));
    double at[2] = {qm_random_range(&c->random, 0.0, 1.0 - size),
                    qm_random_range(&c->random, 0.0, 1.0 - size)};
    for (int i = 0; i < 3; i++) {
        c->piece.u[i] = at[0] + size * qm_random_range(&c->random, 0.0, 1.0);
        c->piece.v[i] = at[1] + size * qm_random_range(&c->random, 0.0, 1.0);
    }
}

/** The match points to the patch of the case, which stays where it is. */
static void draw_case(uint64_t number, match_case *c)
{
    const double start[2] = {0.5, 0.5};
    *c = (match_case){.number = number, .random = qm_random_make(qm_check_seed(), 820000 + number)};
    c->setup.extent = 2.0;
    c->setup.eta = 384.0 * 0x1p-53 * c->setup.extent;
    draw_patches(c);
    draw_piece(c);
    qm_deviation_match_make(&c->setup, &c->face, &c->piece, &c->patch, start, false, &c->match);
}

static void exact_at(const qm_bilinear *q, long double s, long double t, exact_vec at, exact_vec along[2])
{
    const double o[3] = {q->origin.x, q->origin.y, q->origin.z}, e1[3] = {q->e1.x, q->e1.y, q->e1.z};
    const double e2[3] = {q->e2.x, q->e2.y, q->e2.z}, w[3] = {q->w.x, q->w.y, q->w.z};
    for (int k = 0; k < 3; k++) {
        along[0][k] = e1[k] + t * w[k];
        along[1][k] = e2[k] + s * w[k];
        at[k] = o[k] + s * e1[k] + t * along[1][k];
    }
}

static long double distance_between(const exact_vec a, const exact_vec b)
{
    long double sum = 0;
    for (int k = 0; k < 3; k++)
        sum += (a[k] - b[k]) * (a[k] - b[k]);
    return sqrtl(sum);
}

/** A point of the piece. */
static void exact_point(const match_case *c, const double l[3], exact_vec at)
{
    long double u = 0, v = 0;
    exact_vec along[2];
    for (int i = 0; i < 3; i++) {
        u += (long double)l[i] * c->piece.u[i];
        v += (long double)l[i] * c->piece.v[i];
    }
    exact_at(&c->face.patch, u, v, at, along);
}

/** The height of the point over the tangent plane at the parameters that the match gives. */
static long double exact_height(const match_case *c, const double l[3], const exact_vec from)
{
    long double s = 0, t = 0, dot = 0, square = 0;
    exact_vec at, along[2];
    for (int i = 0; i < 3; i++) {
        s += (long double)l[i] * c->match.at[i][0];
        t += (long double)l[i] * c->match.at[i][1];
    }
    exact_at(&c->patch, s, t, at, along);
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        long double n = along[0][i] * along[1][j] - along[0][j] * along[1][i];
        dot += n * (from[k] - at[k]);
        square += n * n;
    }
    return dot / sqrtl(square);
}

static double quadratic_at(const double value[6], const double l[3])
{
    double sum = 0.0;
    for (int k = 0; k < 3; k++)
        sum += l[k] * l[k] * value[k] + 2.0 * l[k] * l[(k + 1) % 3] * value[3 + k];
    return sum;
}

static double cubic_at(const double cubic[4], const double l[3])
{
    double sum = 6.0 * l[0] * l[1] * l[2] * cubic[3];
    for (int k = 0; k < 3; k++)
        sum += 3.0 * l[k] * l[(k + 1) % 3] * (l[k] - l[(k + 1) % 3]) * cubic[k];
    return sum;
}

static void check_height(const match_case *c, const double l[3], long double height)
{
    const qm_deviation_match *match = &c->match;
    double off = (double)(height - quadratic_at(match->height, l)), cubic = cubic_at(match->cubic, l);
    QM_CHECK(fabs(off) <= match->off + c->setup.eta,
             "seed %llu, case %llu: height off by %.17g, more than %.17g",
             (unsigned long long)qm_check_seed(), (unsigned long long)c->number, off, match->off);
    QM_CHECK(fabs(off - cubic) <= match->off - match->cubic_most + c->setup.eta,
             "seed %llu, case %llu: height off by %.17g with its cubic part, more than %.17g",
             (unsigned long long)qm_check_seed(), (unsigned long long)c->number, off - cubic,
             match->off - match->cubic_most);
}

/** A point of a rectangle: any, or about the nearest one. */
static void draw_foot(match_case *c, const qm_uv_box *box, const exact_vec from, bool is_nearest,
                      double at[2])
{
    for (int k = 0; k < 2; k++)
        at[k] = qm_random_range(&c->random, box->low[k], box->high[k]);
    if (!is_nearest) return;
    const qm_vec p = {(double)from[0], (double)from[1], (double)from[2]};
    qm_deviation_match_foot(&c->patch, p, false, at);
    for (int k = 0; k < 2; k++)
        at[k] = qm_clamp(at[k], box->low[k], box->high[k]);
}

/** No point of the rectangle is nearer than the margin allows, also with the bound beyond its edges. */
static void check_lower(match_case *c, const qm_uv_box *box, const double l[3], const exact_vec from,
                        double height)
{
    qm_match_margin margin = qm_deviation_match_margin(&c->setup, &c->match, box);
    if (!(margin.loss < INFINITY)) return;
    double beyond[6];
    qm_deviation_match_beyond(&c->match, box, &margin, beyond);
    for (int i = 0; i < FEET; i++) {
        double foot[2], slope = (i % 3) * qm_random_range(&c->random, 0.0, 1.0);
        exact_vec at, along[2];
        draw_foot(c, box, from, i % 2 == 0, foot);
        exact_at(&c->patch, foot[0], foot[1], at, along);
        double least =
            (fabs(height) + slope * quadratic_at(beyond, l)) / sqrt(1.0 + slope * slope) - margin.loss;
        double distance = (double)distance_between(from, at);
        QM_CHECK(distance >= least - c->setup.eta, "seed %llu, case %llu: %.17g is less than %.17g, slope %g",
                 (unsigned long long)qm_check_seed(), (unsigned long long)c->number, distance, least, slope);
    }
}

/** Some point of the patch is as near as the margin tells. */
static void check_upper(match_case *c, const double l[3], const exact_vec from, double height)
{
    const qm_uv_box whole = {{0.0, 0.0}, {1.0, 1.0}};
    qm_match_rise rise = qm_deviation_match_rise(&c->setup, &c->match);
    if (!(rise.over < INFINITY)) return;
    double edge[4][3], most = fabs(height) + rise.over, nearest = INFINITY;
    qm_deviation_match_edges(&c->setup, &c->match, rise.foot, edge);
    for (int k = 0; k < 4; k++)
        most += fmax(0.0, l[0] * edge[k][0] + l[1] * edge[k][1] + l[2] * edge[k][2]);
    for (int i = 0; i < FEET; i++) {
        double foot[2];
        exact_vec at, along[2];
        draw_foot(c, &whole, from, true, foot);
        exact_at(&c->patch, foot[0], foot[1], at, along);
        nearest = fmin(nearest, (double)distance_between(from, at));
    }
    QM_CHECK(nearest <= most + c->setup.eta, "seed %llu, case %llu: %.17g is more than %.17g",
             (unsigned long long)qm_check_seed(), (unsigned long long)c->number, nearest, most);
}

/** No point of the patch is nearer than the planes round all of it allow. */
static void check_planes(match_case *c, const double l[3], const exact_vec from)
{
    const qm_uv_box whole = {{0.0, 0.0}, {1.0, 1.0}};
    qm_vec bezier[6];
    qm_deviation_piece_coefficients(&c->face, &c->piece, bezier);
    double loss = qm_deviation_match_plane_loss(&c->setup, &c->match, bezier);
    double height = quadratic_at(c->match.height, l);
    double with_cubic = height + (c->match.cubic_most > 0.0 ? cubic_at(c->match.cubic, l) : 0.0);
    double most = fmax(fabs(height), fabs(with_cubic));
    for (int i = 0; i < FEET; i++) {
        double foot[2];
        exact_vec at, along[2];
        draw_foot(c, &whole, from, i % 2 == 0, foot);
        if (i >= FEET - 4)
            for (int k = 0; k < 2; k++)
                foot[k] = i >> k & 1;
        exact_at(&c->patch, foot[0], foot[1], at, along);
        double distance = (double)distance_between(from, at);
        QM_CHECK(distance >= most - loss - c->setup.eta,
                 "seed %llu, case %llu: %.17g is less than %.17g less %.17g",
                 (unsigned long long)qm_check_seed(), (unsigned long long)c->number, distance, most, loss);
    }
}

/** A small patch that is bent, and a piece high above it: all of the patch is about as near as the foot, and the part
 * that is bent up nearer. */
static void draw_high_piece(uint64_t number, match_case *c)
{
    static const double square[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    double bent = pow(10.0, qm_random_range(&c->random, -12.0, -4.5)), start[2];
    double size = 1e-4 * qm_random_range(&c->random, 0.5, 1.0), high = qm_random_range(&c->random, 0.5, 1.0);
    qm_vec near[4];
    draw_piece(c);
    for (int i = 0; i < 4; i++) {
        double up = (i % 2 ? bent : -bent) * (number % 2 ? 1.0 : -1.0);
        near[i] = (qm_vec){size * square[i][0], size * square[i][1], up};
        c->face.corner[i] = (qm_vec){near[i].x, near[i].y, high};
    }
    for (int k = 0; k < 2; k++)
        start[k] = qm_random_range(&c->random, 0.0, 1.0);
    c->face.is_patch = true;
    c->face.patch = qm_bilinear_make(c->face.corner);
    c->patch = qm_bilinear_make(near);
    qm_deviation_match_make(&c->setup, &c->face, &c->piece, &c->patch, start, true, &c->match);
}

static void planes_round_a_patch_hold(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 200000 : 4000, held = 0;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        match_case c;
        draw_case(number, &c);
        if (number % 2) draw_high_piece(number / 2, &c);
        if (!c.match.holds) continue;
        held++;
        for (int i = 0; i < POINTS; i++) {
            double u = qm_random_range(&c.random, 0.0, 1.0), v = qm_random_range(&c.random, 0.0, 1.0 - u);
            double corner = i % 3 == 0 ? 1.0 : 0.0;
            const double l[3] = {corner + (1.0 - corner) * (1.0 - u - v), (1.0 - corner) * u,
                                 (1.0 - corner) * v};
            exact_vec from;
            exact_point(&c, l, from);
            check_planes(&c, l, from);
        }
    }
    QM_CHECK(held > count / 2, "seed %llu: only %llu matches", (unsigned long long)qm_check_seed(),
             (unsigned long long)held);
}

static void heights_along_normals_hold(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 200000 : 4000, matched = 0;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        match_case c;
        draw_case(number, &c);
        if (!c.match.holds || !c.match.along_normals) continue;
        matched++;
        qm_uv_box box = {{0.0, 0.0}, {1.0, 1.0}};
        if (number % 2)
            for (int k = 0; k < 2; k++) {
                box.low[k] = qm_random_range(&c.random, 0.0, 1.0);
                box.high[k] = qm_random_range(&c.random, box.low[k], 1.0);
            }
        for (int i = 0; i < POINTS; i++) {
            double u = qm_random_range(&c.random, 0.0, 1.0), v = qm_random_range(&c.random, 0.0, 1.0 - u);
            const double l[3] = {1.0 - u - v, u, v};
            exact_vec from;
            exact_point(&c, l, from);
            long double height = exact_height(&c, l, from);
            check_height(&c, l, height);
            check_lower(&c, &box, l, from, (double)height);
            check_upper(&c, l, from, (double)height);
        }
    }
    QM_CHECK(matched > count / 4, "seed %llu: only %llu matches", (unsigned long long)qm_check_seed(),
             (unsigned long long)matched);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(heights_along_normals_hold),
        cmocka_unit_test(planes_round_a_patch_hold),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
