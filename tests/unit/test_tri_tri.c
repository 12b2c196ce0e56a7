/* Exact signs, and contact of triangles against a twin in whole numbers. */
#include "check.h"
#include "exact_twin.h"
#include "prim/orient.h"
#include "prim/tri_tri.h"
#include "random.h"
#include "slow_twin.h"

static qm_bigint_point random_whole(qm_random *random, int limit)
{
    qm_bigint_point p;
    for (int k = 0; k < 3; k++)
        p.x[k] = (int64_t)qm_random_below(random, (size_t)(2 * limit + 1)) - limit;
    return p;
}

/** Whole numbers times a step, after a shift by whole numbers: exact while the step is a power of two. */
static qm_vec as_vec(qm_bigint_point p, double step, double shift)
{
    return (qm_vec){step * ((double)p.x[0] + shift), step * ((double)p.x[1] - shift),
                    step * ((double)p.x[2] + shift)};
}

static void signs_match_whole_numbers(void **state)
{
    (void)state;
    const double steps[] = {1.0, 0x1p-30, 0x1p280, 0x1p-1074}, shifts[] = {0.0, 0x1p40, -12345.0};
    for (int limit = 1; limit <= 1000; limit *= 10) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)limit);
        for (int run = 0; run < 4000; run++) {
            qm_bigint_point p[4];
            for (int i = 0; i < 4; i++)
                p[i] = random_whole(&random, limit);
            double step = steps[run % 4], shift = step > 1.0 ? 0.0 : shifts[run % 3];
            qm_vec v[4];
            for (int i = 0; i < 4; i++)
                v[i] = as_vec(p[i], step, shift);
            int expected = qm_exact_turn(p[0], p[1], p[2], p[3]);
            assert_int_equal(qm_orient3d(v[0], v[1], v[2], v[3]), expected);
            assert_int_equal(qm_orient3d(v[1], v[0], v[2], v[3]), -expected);
            assert_int_equal(qm_orient3d(v[3], v[0], v[1], v[2]), -expected);
            for (int axis = 0; axis < 3; axis++) {
                int64_t *const a = p[0].x, *const b = p[1].x, *const c = p[2].x;
                int x = (axis + 1) % 3, y = (axis + 2) % 3;
                int64_t det = (b[x] - a[x]) * (c[y] - a[y]) - (c[x] - a[x]) * (b[y] - a[y]);
                assert_int_equal(qm_orient2d(v[0], v[1], v[2], axis), (det > 0) - (det < 0));
            }
        }
    }
}

/** One unit in the last place off the plane, at every size: no rounding may hide it. */
static void signs_see_the_last_bit(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 7);
    for (int run = 0; run < 5000; run++) {
        double s = ldexp(1.0, (int)qm_random_below(&random, 500) - 250);
        double x = qm_random_range(&random, -1, 1), y = qm_random_range(&random, -1, 1);
        qm_vec a = {s, 0, 0}, b = {0, s, 0}, c = {-s, -s, 0}, d = {s * x, s * y, 0};
        assert_int_equal(qm_orient3d(a, b, c, d), 0);
        d.z = nextafter(0.0, 1.0);
        assert_int_equal(qm_orient3d(a, b, c, d), 1);
        d.z = -d.z;
        assert_int_equal(qm_orient3d(a, b, c, d), -1);
        /* the plane x = z, where the last bit is that of x */
        qm_vec e = {x, y, x}, up = {0, 0, 1}, slope = {1, 0, 2}, side = {0, 1, 1};
        e.z += 1.0;
        e.x = e.z - 1.0;
        assert_int_equal(qm_orient3d(up, slope, side, e), 0);
        e.z = nextafter(e.z, 3.0);
        assert_int_equal(qm_orient3d(up, slope, side, e), 1);
    }
}

typedef struct triangle_pair {
    qm_bigint_point whole[2][3];
    uint32_t index[2][3];
    qm_vec corner[2][3];
} triangle_pair;

/** Corners from a small cube: most triangles touch, many are coplanar, degenerate or share corners. */
static triangle_pair random_pair(qm_random *random, int limit, int run)
{
    triangle_pair pair;
    qm_bigint_point pool[7];
    for (int i = 0; i < 7; i++) {
        pool[i] = random_whole(random, limit);
        if (run % 4 == 1) pool[i].x[2] = pool[i].x[0] - pool[i].x[1];  /* in one plane */
        if (run % 16 == 3) pool[i].x[1] = pool[i].x[2] = pool[i].x[0]; /* on one line */
    }
    double shift = run % 3 == 0 ? 1e6 : 0.0;
    for (int t = 0; t < 2; t++) {
        for (int i = 0; i < 3; i++) {
            uint32_t v = (uint32_t)qm_random_below(random, 7);
            pair.index[t][i] = v;
            pair.whole[t][i] = pool[v];
            pair.corner[t][i] = as_vec(pool[v], 0.125, shift);
        }
    }
    return pair;
}

static double distance_to(qm_vec p, const qm_vec corner[3])
{
    double at[3], c[3][3];
    qm_vec_store(at, p);
    for (int i = 0; i < 3; i++)
        qm_vec_store(c[i], corner[i]);
    return qm_slow_triangle_distance(at, c[0], c[1], c[2]);
}

static void check_contact(const triangle_pair *pair, bool meets, int run)
{
    qm_contact contact, turned;
    bool found = qm_tri_tri_contact(pair->corner[0], pair->corner[1], &contact);
    QM_CHECK(found == meets, "run %d", run);
    assert_int_equal(qm_tri_tri_contact(pair->corner[1], pair->corner[0], &turned), found);
    if (!found) return;
    QM_CHECK(contact.kind == turned.kind, "run %d: kinds %d %d", run, contact.kind, turned.kind);
    qm_vec p = qm_vec_load(contact.point[0]), q = qm_vec_load(contact.point[1]);
    for (int t = 0; t < 2; t++)
        QM_CHECK(distance_to(p, pair->corner[t]) < 1e-8 && distance_to(q, pair->corner[t]) < 1e-8, "run %d",
                 run);
    QM_CHECK((contact.kind == QM_CONTACT_POINT) == (qm_vec_distance(p, q) == 0.0), "run %d: kind %d", run,
             contact.kind);
}

static void contact_matches_twin(void **state)
{
    (void)state;
    for (int limit = 1; limit <= 100; limit *= limit < 4 ? 2 : 5) {
        qm_random random = qm_random_make(qm_check_seed(), 100 + (uint64_t)limit);
        int met = 0, crossed = 0;
        for (int run = 0; run < 6000; run++) {
            triangle_pair pair = random_pair(&random, limit, run);
            const qm_vec *a = pair.corner[0], *b = pair.corner[1];
            bool meets = qm_exact_meet(pair.whole[0], pair.whole[1]);
            QM_CHECK(qm_tri_tri_meet(a, b) == meets, "seed %llu limit %d run %d",
                     (unsigned long long)qm_check_seed(), limit, run);
            QM_CHECK(qm_tri_tri_meet(b, a) == meets, "limit %d run %d", limit, run);
            const qm_vec turned[3] = {a[2], a[0], a[1]}, mirrored[3] = {b[1], b[0], b[2]};
            QM_CHECK(qm_tri_tri_meet(turned, mirrored) == meets, "limit %d run %d", limit, run);
            check_contact(&pair, meets, run);
            bool crosses = qm_exact_cross(pair.whole[0], pair.index[0], pair.whole[1], pair.index[1]);
            QM_CHECK(qm_tri_tri_cross(a, pair.index[0], b, pair.index[1]) == crosses,
                     "seed %llu limit %d run %d: %u %u %u, %u %u %u", (unsigned long long)qm_check_seed(),
                     limit, run, pair.index[0][0], pair.index[0][1], pair.index[0][2], pair.index[1][0],
                     pair.index[1][1], pair.index[1][2]);
            QM_CHECK(qm_tri_tri_cross(b, pair.index[1], a, pair.index[0]) == crosses, "limit %d run %d",
                     limit, run);
            met += meets;
            crossed += crosses;
        }
        assert_true(met > 100 && met < 6000 && crossed > 100 && crossed < met);
    }
}

static void kinds_of_known_pairs(void **state)
{
    (void)state;
    const qm_vec base[3] = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}};
    const struct {
        qm_vec corner[3];
        int kind; /* -1: apart */
    } cases[] = {
        {{{1, 1, 0}, {1, 1, 2}, {2, 2, 2}}, QM_CONTACT_POINT},    /* a corner on the inside */
        {{{1, 1, 0}, {2, 1, 0}, {1, 1, 2}}, QM_CONTACT_SEGMENT},  /* an edge on the inside */
        {{{1, 1, -1}, {1, 1, 1}, {3, 3, 1}}, QM_CONTACT_SEGMENT}, /* through */
        {{{2, 0, -1}, {2, 0, 1}, {2, -3, 0}}, QM_CONTACT_POINT},  /* edge across edge */
        {{{4, 0, 0}, {5, 0, 0}, {5, 0, 1}}, QM_CONTACT_POINT},    /* corner to corner */
        {{{0, 0, 0}, {4, 0, 0}, {2, 0, 3}}, QM_CONTACT_SEGMENT},  /* the same edge */
        {{{1, 1, 0}, {2, 1, 0}, {1, 2, 0}}, QM_CONTACT_AREA},     /* inside in its plane */
        {{{1, 0, 0}, {3, 0, 0}, {2, -4, 0}}, QM_CONTACT_SEGMENT}, /* along an edge in its plane */
        {{{4, 4, 0}, {2, 2, 0}, {4, 3, 0}}, QM_CONTACT_POINT},    /* a corner on an edge in its plane */
        {{{1, 1, 0}, {1, 1, 0}, {1, 1, 0}}, QM_CONTACT_POINT},    /* a point */
        {{{1, -1, 0}, {1, 1, 0}, {1, 9, 0}}, QM_CONTACT_SEGMENT}, /* a segment in its plane */
        {{{1, 1, 1}, {1, 1, 3}, {1, 1, 2}}, -1},                  /* a segment above */
        {{{1, 1, 1}, {2, 1, 1}, {1, 2, 1}}, -1},                  /* parallel */
        {{{5, 5, 0}, {2.5, 2, 0}, {5, 4, 0}}, -1},                /* beside it in its plane */
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        qm_contact contact = {.kind = QM_CONTACT_POINT};
        bool found = qm_tri_tri_contact(base, cases[i].corner, &contact);
        QM_CHECK((found ? (int)contact.kind : -1) == cases[i].kind, "case %zu", i);
    }
}

/** Where triangles of whole numbers meet, at any size: the same but for the size, to the last bit. */
static void contact_goes_with_the_size(void **state)
{
    (void)state;
    static const double steps[] = {0x1p285, 0x1p250, 0x1p-200, 0x1p-400, 0x1p-990};
    int met = 0;
    for (uint64_t seed = 0; seed < 20000; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        int limit = (int[]){2, 10, 1000}[seed % 3];
        bool is_flat = seed / 3 % 2 == 0;
        qm_bigint_point p[6];
        qm_vec one[6], other[6];
        double step = steps[seed % 5];
        for (int i = 0; i < 6; i++) {
            p[i] = random_whole(&random, limit);
            if (is_flat) p[i].x[2] = p[i].x[0];
            one[i] = as_vec(p[i], 1.0, 0.0);
            other[i] = as_vec(p[i], step, 0.0);
        }
        qm_contact here, there;
        bool meets = qm_tri_tri_contact(one, one + 3, &here);
        assert_int_equal(qm_tri_tri_contact(other, other + 3, &there), meets);
        if (!meets) continue;
        met++;
        assert_int_equal(there.kind, here.kind);
        for (int i = 0; i < 6; i++)
            QM_CHECK(there.point[i / 3][i % 3] == step * here.point[i / 3][i % 3],
                     "seed %llu, step %g, coordinate %d: %.17g steps, %.17g at size 1",
                     (unsigned long long)seed, step, i, there.point[i / 3][i % 3] / step,
                     here.point[i / 3][i % 3]);
    }
    assert_true(met > 2000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(signs_match_whole_numbers),  cmocka_unit_test(signs_see_the_last_bit),
        cmocka_unit_test(contact_matches_twin),       cmocka_unit_test(kinds_of_known_pairs),
        cmocka_unit_test(contact_goes_with_the_size),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
