/*
 * Pairs that are chosen to break a search for the Hausdorff distance, each in both readings and in every
 * direction, against the slow twin and, where there is one, against the value on paper.
 */
#include "check.h"

#include "measured.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { SLOW_CELLS = 250 };

static const char *const direction_names[] = {"two-sided", "a to b", "b to a"};
static const char *const reading_names[] = {"triangles", "bilinear"};

/** A pair, what is known about it, and how it is asked. */
typedef struct challenge {
    const char *name;
    const qm_mesh *a, *b;
    double ab, ba;    /* both distances on paper; NAN: not known */
    double tolerance; /* 0: 1e-9 of the greatest coordinate */
    bool may_stop;    /* the work limit may end the search: folds, whose surfaces lie over each other */
    int slow_cells;   /* 0: SLOW_CELLS */
} challenge;

static double on_paper(const challenge *c, qm_direction direction)
{
    if (direction == QM_A_TO_B) return c->ab;
    return direction == QM_B_TO_A ? c->ba : isnan(c->ab) || isnan(c->ba) ? NAN : fmax(c->ab, c->ba);
}

static void check_interval(const challenge *c, const qm_hausdorff_options *options, double low, double high)
{
    double size = qm_measured_size(c->a, c->b);
    /* The bracket is proven with its roundings; only those of the value it is held against remain. */
    double slack = 0x1p-52 * high + 0x1p-62 * size;
    qm_hausdorff_result r = qm_measured(c->a, c->b, options);
    QM_CHECK(r.lower <= high + slack && r.upper >= low - slack && r.lower <= r.upper,
             "%s, %s, %s, %d threads, tolerance %g: [%.17g, %.17g], true in [%.17g, %.17g]", c->name,
             direction_names[options->direction], reading_names[options->quads], options->thread_count,
             options->tolerance, r.lower, r.upper, low, high);
    bool is_narrow = r.stop == QM_STOP_CONVERGED && r.upper - r.lower <= options->tolerance;
    QM_CHECK(is_narrow || (c->may_stop && r.stop == QM_STOP_DEADLINE),
             "%s, %s, %s, %d threads, tolerance %g: stop %d, [%.17g, %.17g]", c->name,
             direction_names[options->direction], reading_names[options->quads], options->thread_count,
             options->tolerance, (int)r.stop, r.lower, r.upper);
}

static void ask(const challenge *c, qm_direction direction, qm_quad_reading reading)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    double size = qm_measured_size(c->a, c->b), known = on_paper(c, direction);
    double tolerance = c->tolerance > 0 ? c->tolerance : 1e-9 * size;
    qm_slow_bracket slow = {known, known, true};
    if (isnan(known))
        slow = qm_slow_hausdorff(c->a, c->b, direction, reading, 1e-10 * size,
                                 (size_t)(c->slow_cells ? c->slow_cells : SLOW_CELLS));
    options.direction = direction;
    options.quads = reading;
    options.work_limit = c->may_stop ? 4000 : 400000; /* a failure rather than a hang */
    for (int k = 0; k < 3; ++k) {
        options.tolerance = tolerance * (double[]){1, 1e3, 1e6}[k];
        options.thread_count = (int[]){1, 3, 1}[k];
        check_interval(c, &options, slow.lower, slow.upper);
    }
}

static void face(const challenge *c)
{
    for (int reading = 0; reading < 2; ++reading)
        for (int direction = 0; direction < 3; ++direction)
            ask(c, (qm_direction)direction, (qm_quad_reading)reading);
}

/** A pair without a value on paper. */
static void face_pair(const char *name, const qm_mesh *a, const qm_mesh *b)
{
    face(&(challenge){.name = name, .a = a, .b = b, .ab = NAN, .ba = NAN});
}

static void face_known(const char *name, const qm_mesh *a, const qm_mesh *b, double ab, double ba)
{
    face(&(challenge){.name = name, .a = a, .b = b, .ab = ab, .ba = ba});
}

static void slivers_and_needles(void **state)
{
    (void)state;
    static const double widths[] = {1e-3, 1e-8, 1e-13, 0};
    for (size_t k = 0; k < 4; ++k) {
        double w = widths[k];
        qm_mesh sliver = qm_shape_face(3, (const double[][3]){{-1, 0, 0}, {1, 0, 0}, {0.3, w, 0}});
        qm_mesh turned = qm_shape_face(3, (const double[][3]){{-1, -0.01, w}, {1, 0.01, 0}, {0, 0, -w}});
        qm_mesh blade = qm_shape_face(4, (const double[][3]){{-1, 0, 0}, {1, 0, w}, {1, w, 0}, {-1, w, w}});
        face_pair("slivers", &sliver, &turned);
        face_pair("sliver and blade", &sliver, &blade);
        face_pair("blade and sliver", &blade, &turned);
        qm_shape_free(&sliver);
        qm_shape_free(&turned);
        qm_shape_free(&blade);
    }
    for (uint64_t seed = 0; seed < 10; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_mesh a = qm_shape_soup(&random, 6, QM_SOUP_MIXED, QM_SOUP_NEEDLES, 0);
        qm_mesh b = qm_shape_soup(&random, 4, QM_SOUP_MIXED, QM_SOUP_NEEDLES, 0);
        face_pair("needles", &a, &b);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static void coplanar_and_identical_meshes(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 6; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), 100 + seed);
        qm_soup_style style = seed % 2 ? QM_SOUP_LATTICE : QM_SOUP_COPLANAR;
        qm_mesh a = qm_shape_soup(&random, 5, QM_SOUP_MIXED, style, 0), same = qm_shape_copy(&a);
        qm_mesh b = qm_shape_soup(&random, 4, QM_SOUP_MIXED, style, 0);
        face_known("the same", &a, &same, 0, 0);
        face_pair("coplanar or on a lattice", &a, &b);
        qm_shape_free(&a);
        qm_shape_free(&same);
        qm_shape_free(&b);
    }
    /* One square, cut in different ways: a quad, a grid, a grid of triangles. */
    qm_mesh one = qm_shape_plane(1, 0), five = qm_shape_plane(5, 0), seven = qm_shape_plane(7, 0);
    qm_mesh cut = qm_shape_triangulated(&five);
    face_known("a square and its grid", &one, &five, 0, 0);
    face_known("two grids", &five, &seven, 0, 0);
    face_known("quads and triangles", &cut, &seven, 0, 0);
    qm_shape_free(&one);
    qm_shape_free(&five);
    qm_shape_free(&seven);
    qm_shape_free(&cut);
}

static void plateaus(void **state)
{
    (void)state;
    static const double offsets[] = {0.5, 0x1p-10, 0x1p-30, 0x1p-45};
    for (size_t k = 0; k < 4; ++k) {
        qm_mesh low = qm_shape_plane(6, 0), high = qm_shape_plane(5, offsets[k]);
        qm_mesh bent = qm_shape_saddle(4), raised = qm_shape_saddle(4);
        qm_shape_move(&raised, 1, (const double[3]){0, 0, offsets[k]});
        face_known("offset planes", &low, &high, offsets[k], offsets[k]);
        face_pair("raised saddle", &bent, &raised);
        qm_shape_free(&low);
        qm_shape_free(&high);
        qm_shape_free(&bent);
        qm_shape_free(&raised);
    }
    qm_mesh tube = qm_shape_torus(9, 7, 1, 0.375), turned = qm_shape_torus(9, 7, 1, 0.375);
    const double c = cos(0.2), s = sin(0.2);
    for (size_t v = 0; v < turned.vertex_count; ++v) {
        double *p = turned.positions + 3 * v, x = p[0], y = p[1];
        p[0] = c * x - s * y;
        p[1] = s * x + c * y;
    }
    face(&(challenge){
        .name = "turned torus", .a = &tube, .b = &turned, .ab = NAN, .ba = NAN, .slow_cells = 600});
    qm_shape_free(&tube);
    qm_shape_free(&turned);
    for (int strips = 1; strips <= 3; ++strips) {
        qm_mesh strip = qm_shape_strip(strips, 1, 3), moved = qm_shape_strip(strips, 1, 3);
        qm_shape_move(&moved, 1, (const double[3]){0, 0x1p-9, 0x1p-9});
        challenge moved_strip = {.name = "moved strip", .a = &strip, .b = &moved, .ab = NAN, .ba = NAN};
        moved_strip.may_stop = strips == 1; /* a single quad twisted by half a turn lies over itself */
        face(&moved_strip);
        qm_shape_free(&strip);
        qm_shape_free(&moved);
    }
}

/** |w| of up to two edge lengths, alone, moved, and against others of the kind. */
static void folded_patches(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 12; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), 200 + seed);
        double twist = (double[]){0.25, 0.5, 1, 2}[seed % 4];
        qm_mesh a = qm_shape_soup(&random, 2, QM_SOUP_QUADS, QM_SOUP_APART, twist), moved = qm_shape_copy(&a);
        qm_mesh b = qm_shape_soup(&random, 3, QM_SOUP_QUADS, QM_SOUP_APART, twist);
        qm_shape_move(&moved, 1, (const double[3]){0x1p-8, -0x1p-8, 0x1p-7});
        challenge pair = {.name = "folded patches", .a = &a, .b = &b, .ab = NAN, .ba = NAN, .slow_cells = 80};
        pair.may_stop = true;
        face(&pair);
        pair.name = "moved folded patches";
        pair.b = &moved;
        face(&pair);
        qm_shape_free(&a);
        qm_shape_free(&b);
        qm_shape_free(&moved);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slivers_and_needles),
        cmocka_unit_test(coplanar_and_identical_meshes),
        cmocka_unit_test(plateaus),
        cmocka_unit_test(folded_patches),
    };
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    return cmocka_run_group_tests(tests, NULL, NULL);
}
