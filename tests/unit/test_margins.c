/* Computed distances of triangles against 113 bits: the errors that the engine counts with hold for slivers,
 * segments and points, near and far, and for edges that are nearly parallel. */
#include "check.h"

#include "bvh/nearest.h"
#include "prim/triangle.h"
#include "random.h"

typedef __float128 wide;

typedef struct wide_vec {
    wide x, y, z;
} wide_vec;

static wide_vec widen(qm_vec a)
{
    return (wide_vec){a.x, a.y, a.z};
}

static wide_vec minus(wide_vec a, wide_vec b)
{
    return (wide_vec){a.x - b.x, a.y - b.y, a.z - b.z};
}

/** a + s b */
static wide_vec plus(wide_vec a, wide s, wide_vec b)
{
    return (wide_vec){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

static wide dot(wide_vec a, wide_vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static wide_vec cross(wide_vec a, wide_vec b)
{
    return (wide_vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/** Newton's method from the root in doubles. */
static wide root(wide x)
{
    wide r = sqrt((double)x);
    for (int i = 0; i < 2 && r > 0; i++)
        r = (r + x / r) / 2;
    return r;
}

static wide lesser(wide a, wide b)
{
    return a < b ? a : b;
}

static wide point_segment2(wide_vec p, wide_vec a, wide_vec b)
{
    wide_vec e = minus(b, a), w = minus(p, a);
    wide ee = dot(e, e), t = ee > 0 ? dot(w, e) / ee : 0;
    wide_vec gap = plus(w, t < 0 ? 0 : t > 1 ? -1 : -t, e);
    return dot(gap, gap);
}

static wide point_triangle2(wide_vec p, const wide_vec c[3])
{
    wide least = point_segment2(p, c[0], c[1]);
    least = lesser(least, point_segment2(p, c[1], c[2]));
    least = lesser(least, point_segment2(p, c[2], c[0]));
    wide_vec e = minus(c[1], c[0]), g = minus(c[2], c[0]), w = minus(p, c[0]), n = cross(e, g);
    wide nn = dot(n, n), s = dot(cross(e, w), n), t = dot(cross(w, g), n), h = dot(w, n);
    return nn > 0 && s >= 0 && t >= 0 && s + t <= nn ? lesser(least, h * h / nn) : least;
}

static wide segments2(const wide_vec a[2], const wide_vec b[2])
{
    wide least = lesser(point_segment2(a[0], b[0], b[1]), point_segment2(a[1], b[0], b[1]));
    least = lesser(least, lesser(point_segment2(b[0], a[0], a[1]), point_segment2(b[1], a[0], a[1])));
    wide_vec u = minus(a[1], a[0]), v = minus(b[1], b[0]), r = minus(b[0], a[0]), n = cross(u, v);
    wide nn = dot(n, n), s = dot(cross(r, v), n), t = dot(cross(r, u), n);
    if (!(nn > 0 && s >= 0 && s <= nn && t >= 0 && t <= nn)) return least;
    wide h = dot(r, n);
    return lesser(least, h * h / nn);
}

static wide triangles2(const wide_vec a[3], const wide_vec b[3])
{
    wide least = point_triangle2(a[0], b);
    for (int i = 0; i < 3; i++) {
        least = lesser(least, lesser(point_triangle2(a[i], b), point_triangle2(b[i], a)));
        for (int k = 0; k < 3; k++)
            least = lesser(least, segments2((const wide_vec[]){a[i], a[(i + 1) % 3]},
                                            (const wide_vec[]){b[k], b[(k + 1) % 3]}));
    }
    return least;
}

static qm_vec draw(qm_random *random, double size)
{
    double p[3];
    qm_random_point(random, -size, size, p);
    return qm_vec_load(p);
}

static double draw_size(qm_random *random, double least_power)
{
    return exp2(qm_random_range(random, least_power, 0));
}

static void keep_in_frame(qm_vec corner[3])
{
    for (int i = 0; i < 3; i++)
        corner[i] = (qm_vec){qm_clamp(corner[i].x, -1, 1), qm_clamp(corner[i].y, -1, 1),
                             qm_clamp(corner[i].z, -1, 1)};
}

/** A triangle of any size and shape, within [-1, 1] along each axis. */
static void draw_triangle(qm_random *random, qm_vec corner[3])
{
    double size = qm_random_below(random, 2) ? 1 : draw_size(random, -20);
    double thin = size * draw_size(random, -60);
    corner[0] = draw(random, 1);
    corner[1] = qm_vec_add(corner[0], draw(random, size));
    qm_vec between = qm_vec_mix(corner[0], corner[1], qm_random_range(random, -0.2, 1.2));
    switch (qm_random_below(random, 5)) {
    case 0:
        corner[2] = qm_vec_add(corner[0], draw(random, size));
        break;
    case 1:
        corner[2] = qm_vec_add(between, draw(random, thin));
        break;
    case 2:
        corner[2] = qm_vec_add(corner[qm_random_below(random, 2)], draw(random, thin));
        break;
    case 3:
        corner[2] = between;
        break;
    default:
        corner[2] = corner[1];
        break;
    }
    keep_in_frame(corner);
}

static void distances_to_points_are_off_by_what_is_counted(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 3000000 : 60000;
    for (uint64_t seed = 0; seed < count; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_vec c[3], p;
        draw_triangle(&random, c);
        qm_triangle triangle = qm_triangle_make(c[0], c[1], c[2]);
        double reach = (double[]){0, 1, draw_size(&random, -50), 1 / draw_size(&random, -50)}[seed % 4];
        p = qm_vec_mix(c[seed % 3], c[(seed + 1) % 3], qm_random_range(&random, -1, 2));
        p = qm_vec_add(p, draw(&random, reach));
        wide truth =
            root(point_triangle2(widen(p), (const wide_vec[]){widen(c[0]), widen(c[1]), widen(c[2])}));
        double reported = sqrt(qm_triangle_distance2(&triangle, p)), error = fabs((double)(reported - truth));
        QM_CHECK(error <= qm_distance_rounding(p), "seed %llu: %.17g is off by %g, more than %g",
                 (unsigned long long)seed, reported, error, qm_distance_rounding(p));
    }
}

/** A triangle near another: moved, or with an edge that crosses one of its edges at next to no angle. */
static void draw_near(qm_random *random, const qm_vec a[3], qm_vec b[3])
{
    double apart = draw_size(random, -50), tilt = draw_size(random, -52);
    int i = (int)qm_random_below(random, 3);
    draw_triangle(random, b);
    qm_vec along = qm_vec_sub(a[(i + 1) % 3], a[i]);
    qm_vec middle =
        qm_vec_add(qm_vec_mix(a[i], a[(i + 1) % 3], qm_random_range(random, -0.2, 1.2)), draw(random, apart));
    qm_vec turned = qm_vec_add(qm_vec_scale(qm_random_range(random, 0.1, 1), along), draw(random, tilt));
    b[0] = qm_vec_axpy(middle, -qm_random_range(random, 0, 1), turned);
    b[1] = qm_vec_axpy(middle, qm_random_range(random, 0, 1), turned);
    keep_in_frame(b);
}

/** Triangles that go through each other count by their corners and edges here, as they do in the engine. */
static void distances_of_triangles_are_off_by_what_is_counted(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 1000000 : 40000;
    for (uint64_t seed = 0; seed < count; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_vec a[3], b[3];
        wide_vec wide_a[3], wide_b[3];
        draw_triangle(&random, a);
        if (seed % 4)
            draw_near(&random, a, b);
        else
            draw_triangle(&random, b);
        for (int i = 0; i < 3; i++) {
            wide_a[i] = widen(a[i]);
            wide_b[i] = widen(b[i]);
        }
        double truth = (double)root(triangles2(wide_a, wide_b)),
               reported = qm_triangle_find_gap(a, b).distance;
        QM_CHECK(fabs(reported - truth) <= QM_TRIANGLE_GAP_ERROR, "seed %llu: %.17g, true %.17g, off by %g",
                 (unsigned long long)seed, reported, truth, reported - truth);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(distances_to_points_are_off_by_what_is_counted),
        cmocka_unit_test(distances_of_triangles_are_off_by_what_is_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
