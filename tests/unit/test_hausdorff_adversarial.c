/*
 * Pairs that are chosen to break a search for the Hausdorff distance, each in both readings and in every
 * direction, against the slow twin and, where there is one, against the value on paper.
 */
#include "check.h"

#include "measured.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"
#include "wide_farthest.h"

#include <math.h>
#include <string.h>

enum { SLOW_CELLS = 250 };

static const char *const direction_names[] = {"two-sided", "a to b", "b to a"};
static const char *const reading_names[] = {"triangles", "bilinear"};

/** A pair, its known distances, and the options of the query. */
typedef struct challenge {
    const char *name;
    const qm_mesh *a, *b;
    double ab, ba;    /* both distances on paper; NAN: not known */
    double tolerance; /* 0: 1e-9 of the greatest coordinate */
    bool may_stop;    /* the work limit may end the search for patches: folds and twisted needles are slow */
    int slow_cells;   /* 0: SLOW_CELLS */
} challenge;

static double on_paper(const challenge *c, qm_direction direction)
{
    if (direction == QM_A_TO_B) return c->ab;
    return direction == QM_B_TO_A ? c->ba : isnan(c->ab) || isnan(c->ba) ? NAN : fmax(c->ab, c->ba);
}

static bool may_stop(const challenge *c, qm_quad_reading reading)
{
    return c->may_stop && reading == QM_QUADS_BILINEAR;
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
    QM_CHECK(is_narrow || (may_stop(c, options->quads) && r.stop == QM_STOP_DEADLINE),
             "%s, %s, %s, %d threads, tolerance %g: stop %d, [%.17g, %.17g]", c->name,
             direction_names[options->direction], reading_names[options->quads], options->thread_count,
             options->tolerance, (int)r.stop, r.lower, r.upper);
}

static void ask(const challenge *c, qm_direction direction, qm_quad_reading reading)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    double size = qm_measured_size(c->a, c->b), known = on_paper(c, direction);
    double tolerance = c->tolerance > 0 ? c->tolerance : size > 0 ? 1e-9 * size : 1e-9;
    qm_slow_bracket slow = {known, known, true};
    if (isnan(known))
        slow = qm_slow_hausdorff(c->a, c->b, direction, reading, 1e-10 * size,
                                 (size_t)(c->slow_cells ? c->slow_cells : SLOW_CELLS));
    options.direction = direction;
    options.quads = reading;
    options.work_limit = may_stop(c, reading) ? 4000 : 400000; /* a failure rather than a hang */
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
        /* A long strip that is twisted by a quarter turn leaves its triangles all along its length. */
        challenge strip = {.name = "sliver and blade", .a = &sliver, .b = &blade, .ab = NAN, .ba = NAN};
        strip.may_stop = true;
        face(&strip);
        strip.a = &turned;
        face(&strip);
        qm_shape_free(&sliver);
        qm_shape_free(&turned);
        qm_shape_free(&blade);
    }
    for (uint64_t seed = 0; seed < (qm_check_long() ? 40u : 4u); ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_mesh a = qm_shape_soup(&random, 6, QM_SOUP_MIXED, QM_SOUP_NEEDLES, 0);
        qm_mesh b = qm_shape_soup(&random, 4, QM_SOUP_MIXED, QM_SOUP_NEEDLES, 0);
        challenge needles = {.name = "needles", .a = &a, .b = &b, .ab = NAN, .ba = NAN, .may_stop = true};
        face(&needles);
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
        qm_mesh a = qm_shape_soup(&random, 5, QM_SOUP_MIXED, style, 0), same = qm_shape_reversed(&a);
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
    for (uint64_t seed = 0; seed < (qm_check_long() ? 80u : 12u); ++seed) {
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

/** Far from the origin, very large and very small: scales that are powers of two move the corners exactly. */
static void far_and_tiny_coordinates(void **state)
{
    (void)state;
    static const struct {
        double scale, shift;
    } moves[] = {{1, 0x1p23}, {0x1p23, 0}, {0x1p-30, 0}, {0x1p-30, 0x1p-7}, {0x1p23, -0x1p40}};
    for (size_t k = 0; k < sizeof moves / sizeof *moves; ++k) {
        const double shift[3] = {moves[k].shift, -moves[k].shift, moves[k].shift / 2};
        double scale = moves[k].scale, unit = scale + fabs(moves[k].shift);
        for (uint64_t seed = 0; seed < 4; ++seed) {
            qm_random random = qm_random_make(qm_check_seed(), 300 + seed);
            qm_mesh a = qm_shape_soup(&random, 4, QM_SOUP_MIXED, QM_SOUP_POOLED, 0.5);
            qm_mesh b = qm_shape_copy(&a);
            qm_shape_shake(&b, &random, 0.01);
            qm_shape_move(&a, scale, shift);
            qm_shape_move(&b, scale, shift);
            face(&(challenge){.name = "moved soup",
                              .a = &a,
                              .b = &b,
                              .ab = NAN,
                              .ba = NAN,
                              .tolerance = fmax(1e-7 * scale, 1e-12 * unit),
                              .slow_cells = 100,
                              .may_stop = true});
            qm_shape_free(&a);
            qm_shape_free(&b);
        }
        qm_mesh low = qm_shape_box(1, 1, 1), high = qm_shape_box(1, 1, 1);
        qm_shape_move(&high, 1, (const double[3]){0, 0.25, 0});
        qm_shape_move(&low, scale, shift);
        qm_shape_move(&high, scale, shift);
        face(&(challenge){.name = "moved boxes",
                          .a = &low,
                          .b = &high,
                          .ab = 0.25 * scale,
                          .ba = 0.25 * scale,
                          .tolerance = fmax(1e-9 * scale, 1e-12 * unit)});
        qm_shape_free(&low);
        qm_shape_free(&high);
    }
}

/** A flat triangle far from the middle of its frame, which a vertex without a face puts elsewhere. */
static qm_mesh lone_triangle(double height, double scale, double positions[12])
{
    static const uint32_t face[4] = {0, 1, 2, QM_NO_INDEX};
    const double corner[12] = {-1, -1, height, 1, -1, height, 0, 1, height, 0, 0, -64};
    for (int i = 0; i < 12; i++)
        positions[i] = scale * corner[i];
    return (qm_mesh){.vertex_count = 4, .positions = positions, .face_count = 1, .faces = (uint32_t *)face};
}

/** Nearly as large as a double can be: in a tree's own frame the mesh still measures about 1. */
static void coordinates_as_large_as_they_go(void **state)
{
    (void)state;
    static const qm_accelerator accelerators[] = {QM_ACCELERATOR_BOXES, QM_ACCELERATOR_GRID};
    for (int exponent = 980; exponent <= 1016; exponent++) {
        double scale = ldexp(1.0, exponent), at_a[12], at_b[12];
        qm_mesh low = lone_triangle(64.0, scale, at_a), high = lone_triangle(64.25, scale, at_b);
        for (int i = 0; i < 2; i++) {
            qm_hausdorff_options options = qm_hausdorff_options_default();
            options.accelerator = accelerators[i];
            options.tolerance = 1e-9 * scale;
            qm_hausdorff_result r = qm_measured(&low, &high, &options);
            QM_CHECK(r.lower <= 0.25 * scale && r.upper >= 0.25 * scale && r.stop == QM_STOP_CONVERGED,
                     "2^%d: [%g, %g], stop %d", exponent, r.lower, r.upper, (int)r.stop);
        }
    }
}

static void thousands_of_copies_of_one_triangle(void **state)
{
    (void)state;
    qm_mesh one = qm_shape_copies(1), many = qm_shape_copies(100000), some = qm_shape_copies(5000);
    qm_mesh raised = qm_shape_copies(1);
    qm_shape_move(&raised, 1, (const double[3]){0, 0, 0x1p-6});
    face_known("copies and one", &many, &one, 0, 0);
    face_known("copies and copies", &some, &some, 0, 0);
    /* Copies change nothing: what the slow twin says of one holds for all of them. */
    for (int direction = 1; direction < 3; ++direction) {
        qm_slow_bracket d =
            qm_slow_hausdorff(&one, &raised, (qm_direction)direction, QM_QUADS_TRIANGLES, 1e-12, 500);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.direction = (qm_direction)direction;
        options.tolerance = 1e-9;
        challenge many_raised = {.name = "copies and one raised", .a = &many, .b = &raised};
        check_interval(&many_raised, &options, d.lower, d.upper);
    }
    qm_mesh *all[] = {&one, &many, &some, &raised};
    for (size_t k = 0; k < 4; ++k)
        qm_shape_free(all[k]);
}

/** So many that a search for each of them which visits all of them would not end in a test's time. */
static void copies_of_one_twisted_quad(void **state)
{
    (void)state;
    enum { COUNT = 100000 };
    static const double corner[4][3] = {{0, 0, 0}, {1, 0, 0.3}, {1.1, 1, -0.2}, {0, 1, 0.4}};
    qm_mesh one = qm_shape_face(4, corner), meshes[2];
    for (size_t m = 0; m < 2; m++) {
        meshes[m] = qm_shape_make(4, COUNT - m);
        memcpy(meshes[m].positions, corner, sizeof corner);
        for (size_t f = 0; f < COUNT - m; f++)
            memcpy(meshes[m].faces + 4 * f, one.faces, 4 * sizeof *one.faces);
    }
    for (int raised = 0; raised < 2; raised++) {
        qm_shape_move(&meshes[1], 1, (const double[3]){0, 0, raised * 0x1p-6});
        qm_shape_move(&one, 1, (const double[3]){0, 0, raised * 0x1p-6});
        for (int reading = 0; reading < 2; reading++) {
            qm_hausdorff_options options = qm_hausdorff_options_default();
            options.quads = (qm_quad_reading)reading;
            options.tolerance = 1e-6;
            double most =
                0.0; /* of the corners: no more than that of the surfaces, which is no more than the move */
            for (int i = 0; i < 4; i++)
                most = fmax(most, qm_slow_distance(&one, options.quads, corner[i], 1e-9).lower);
            qm_hausdorff_result r = qm_measured(&meshes[0], &meshes[1], &options);
            QM_CHECK(r.stop == QM_STOP_CONVERGED && r.lower <= raised * 0x1p-6 && r.upper >= most,
                     "[%g, %g], a corner is %g away, stop %d", r.lower, r.upper, most, (int)r.stop);
        }
    }
    qm_shape_free(&one);
    qm_shape_free(&meshes[0]);
    qm_shape_free(&meshes[1]);
}

/** The corners of one face again and again, each time moved by the noise. */
static qm_mesh noisy_copies(const double corner[4][3], size_t count, double noise, qm_random *random)
{
    qm_mesh copies = qm_shape_make(4 * count, count);
    for (size_t f = 0; f < count; f++) {
        memcpy(copies.positions + 12 * f, corner, 12 * sizeof(double));
        for (uint32_t i = 0; i < 4; i++)
            copies.faces[4 * f + i] = (uint32_t)(4 * f) + i;
    }
    qm_shape_shake(&copies, random, noise);
    return copies;
}

/**
 * One twisted quad over hundreds of its copies, each moved by many tolerances: each reaches a part of it, and
 * a search that follows the lines where one copy is just as far as is allowed, instead of looking for another
 * one, does not end in the test's time.
 */
static void noisy_copies_under_one_twisted_quad(void **state)
{
    (void)state;
    enum { COUNT = 600, STEPS = 6, MAX_PARTS = 500 };
    static const double corner[4][3] = {{0, 0, 0.1}, {1, 0, 0.4}, {1, 1, -0.1}, {0, 1, 0.5}};
    static const double below[4][3] = {{0, 0, 0}, {1, 0, 0.3}, {1, 1, -0.2}, {0, 1, 0.4}};
    qm_mesh one = qm_shape_face(4, corner);
    for (uint64_t seed = 0; seed < (qm_check_long() ? 50u : 3u); seed++) {
        qm_random random = qm_random_make(qm_check_seed(), 9800 + seed);
        double noise = pow(10, qm_random_range(&random, -4.5, -3)), most = 0.0;
        qm_mesh copies = noisy_copies(below, COUNT, noise, &random);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.quads = QM_QUADS_BILINEAR;
        options.tolerance = 1e-6;
        qm_hausdorff_result r = qm_measured(&one, &copies, &options);
        for (int i = 0; i <= STEPS; i++)
            for (int j = 0; j <= STEPS; j++) {
                double s = (double)i / STEPS, t = (double)j / STEPS, p[3];
                for (int k = 0; k < 3; k++)
                    p[k] = (1 - t) * ((1 - s) * corner[0][k] + s * corner[1][k]) +
                           t * ((1 - s) * corner[3][k] + s * corner[2][k]);
                most = fmax(most, qm_slow_distance(&copies, options.quads, p, 1e-9).lower);
            }
        QM_CHECK(r.stop == QM_STOP_CONVERGED && r.upper >= most - 1e-15 &&
                     r.lower <= 0.1 + sqrt(3.0) * noise && r.iterations <= MAX_PARTS,
                 "seed %llu, noise %g: stop %d, [%.17g, %.17g], a point is %.17g away, after %llu parts",
                 (unsigned long long)seed, noise, (int)r.stop, r.lower, r.upper, most,
                 (unsigned long long)r.iterations);
        qm_shape_free(&copies);
    }
    qm_shape_free(&one);
}

static void flat_boxes(void **state)
{
    (void)state;
    qm_mesh boxes[] = {qm_shape_box(1, 1, 0), qm_shape_box(1, 0, 0), qm_shape_box(0, 0, 0),
                       qm_shape_box(1, 1, 0x1p-20), qm_shape_box(1, 0.5, 0)};
    enum { COUNT = sizeof boxes / sizeof *boxes };
    for (size_t i = 0; i < COUNT; ++i)
        for (size_t j = i; j < COUNT; ++j)
            face_pair("flat boxes", &boxes[i], &boxes[j]);
    face_known("flat and nearly flat", &boxes[0], &boxes[3], 0, 0x1p-20);
    face_known("plate and half a plate", &boxes[0], &boxes[4], 0.5, 0);
    face_known("plate and line", &boxes[0], &boxes[1], 1, 0);
    face_known("line and dot", &boxes[1], &boxes[2], 1, 0);
    for (size_t i = 0; i < COUNT; ++i)
        qm_shape_free(&boxes[i]);
}

/** One face of each kind against each other, and points. */
static void single_facets(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 400);
    qm_mesh faces[] = {
        qm_shape_face(3, (const double[][3]){{0, 0, 0}, {4, 0, 1}, {1, 3, 0}}),
        qm_shape_face(3, (const double[][3]){{0, 1, 2}, {0, 1, 2}, {3, 1, 0}}),
        qm_shape_face(4, (const double[][3]){{0, 0, 0}, {4, 0, 0}, {4, 3, 1}, {0, 3, 0}}),
        qm_shape_face(4,
                      (const double[][3]){{0, 0, 0}, {4, 0, 0}, {0, 3, 2}, {4, 3, 0}}), /* crosses itself */
        qm_shape_face(4, (const double[][3]){{0, 0, 0}, {4, 0, 0}, {1, 1, 0}, {0, 4, 0}}), /* concave */
        qm_shape_face(4,
                      (const double[][3]){{0, 0, 0}, {4, 0, 0}, {4, 3, 0}, {4, 0, 0}}), /* folded on itself */
        qm_shape_points(&random, 1),
        qm_shape_points(&random, 12),
    };
    enum { COUNT = sizeof faces / sizeof *faces };
    for (size_t i = 0; i < COUNT; ++i)
        for (size_t j = i; j < COUNT; ++j)
            face(&(challenge){.name = "single faces",
                              .a = &faces[i],
                              .b = &faces[j],
                              .ab = NAN,
                              .ba = NAN,
                              .tolerance = 1e-6,
                              .may_stop = true,
                              .slow_cells = 150});
    for (size_t i = 0; i < COUNT; ++i)
        qm_shape_free(&faces[i]);
}

static void points_and_vertices_of_no_face(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 500);
    qm_mesh cloud = qm_shape_points(&random, 60), few = qm_shape_points(&random, 3);
    qm_mesh soup = qm_shape_soup(&random, 6, QM_SOUP_MIXED, QM_SOUP_POOLED, 0.5);
    qm_mesh padded = qm_shape_with_unused(&soup, 4, (const double[3]){50, -50, 50});
    face_pair("two clouds", &cloud, &few);
    face_pair("cloud and soup", &cloud, &soup);
    face_pair("few points and soup", &few, &soup);
    face_known("soup and itself with more vertices", &soup, &padded, 0, 0);
    face_pair("cloud and soup with more vertices", &cloud, &padded);
    qm_mesh *all[] = {&cloud, &few, &soup, &padded};
    for (size_t k = 0; k < 4; ++k)
        qm_shape_free(all[k]);
}

/** Faces of very different sizes, and a target that lies inside one cell of the source. */
static void huge_and_tiny_faces(void **state)
{
    (void)state;
    const double huge[][3] = {
        {-0x1p20, -0x1p20, 0}, {0x1p20, -0x1p20, 0}, {0x1p20, 0x1p20, 0}, {-0x1p20, 0x1p20, 0}};
    qm_mesh sheet = qm_shape_face(4, huge), tiny = qm_shape_plane(4, 0), speck = qm_shape_plane(3, 0);
    qm_shape_move(&tiny, 0x1p-10, (const double[3]){0.5, 0.5, 0});
    qm_shape_move(&speck, 0x1p-10, (const double[3]){0.5, 0.5, 0x1p-12});
    qm_mesh both = qm_shape_joined(&sheet, &speck);
    double corner = 0x1p20 + 0.5, far = sqrt(2 * corner * corner + 0x1p-24);
    challenge sheets = {.name = "sheet and speck", .a = &sheet, .b = &speck, .tolerance = 1e-6};
    sheets.ab = far;
    sheets.ba = 0x1p-12;
    face(&sheets);
    face_known("speck in a sheet", &tiny, &sheet, 0, sqrt(2) * corner);
    face(&(challenge){
        .name = "sheet with a speck", .a = &both, .b = &sheet, .ab = 0x1p-12, .ba = 0, .tolerance = 1e-6});
    face(&(challenge){.name = "speck and sheet with a speck",
                      .a = &tiny,
                      .b = &both,
                      .ab = 0,
                      .ba = sqrt(2) * corner,
                      .tolerance = 1e-6});
    qm_mesh *all[] = {&sheet, &tiny, &speck, &both};
    for (size_t k = 0; k < 4; ++k)
        qm_shape_free(all[k]);
    qm_mesh cell = qm_shape_face(3, (const double[][3]){{0, 0, 0}, {8, 0, 0}, {0, 8, 0}});
    qm_mesh inside = qm_shape_torus(5, 4, 0.5, 0.125);
    qm_shape_move(&inside, 1, (const double[3]){2, 2, 0});
    face_pair("torus in a triangle", &cell, &inside);
    qm_shape_free(&cell);
    qm_shape_free(&inside);
}

static void meshes_far_apart(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 4; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), 600 + seed);
        qm_mesh a = qm_shape_soup(&random, 4, QM_SOUP_MIXED, QM_SOUP_POOLED, 1);
        qm_mesh b = qm_shape_soup(&random, 4, QM_SOUP_MIXED, QM_SOUP_APART, 1);
        qm_shape_move(&b, 1, (const double[3]){2048, 1024 * (double)seed, 0});
        face(&(challenge){.name = "far apart", .a = &a, .b = &b, .ab = NAN, .ba = NAN, .tolerance = 1e-6});
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/** Everything is a tie: mirrored meshes, middles, surfaces at one distance from a point. */
static void ties_everywhere(void **state)
{
    (void)state;
    qm_mesh cube = qm_shape_box(2, 2, 2), mirrored = qm_shape_box(2, 2, 2), small = qm_shape_box(1, 1, 1);
    qm_shape_move(&cube, 1, (const double[3]){-1, -1, -1});
    qm_shape_move(&mirrored, -1, (const double[3]){1, 1, 1});
    qm_shape_move(&small, 1, (const double[3]){-0.5, -0.5, -0.5});
    face_known("cube and its mirror image", &cube, &mirrored, 0, 0);
    face_known("cube in cube", &cube, &small, sqrt(3) / 2, 0.5);
    qm_mesh centre = qm_shape_make(1, 0),
            pole = qm_shape_face(3, (const double[][3]){{0, 0, 0}, {0, 0, 0}, {0, 0, 0}});
    face_known("cube and its centre", &cube, &centre, sqrt(3), 1);
    qm_mesh tube = qm_shape_torus(12, 8, 1, 0.25);
    face_pair("torus and its centre", &tube, &pole);
    /* Two plates, and between them the plate of points that are equally far from both. */
    qm_mesh low = qm_shape_plane(3, -0.5), high = qm_shape_plane(2, 0.5), middle = qm_shape_plane(4, 0);
    qm_mesh both = qm_shape_joined(&low, &high);
    face_known("plate between plates", &middle, &both, 0.5, 0.5);
    qm_mesh *all[] = {&cube, &mirrored, &small, &centre, &pole, &tube, &low, &high, &middle, &both};
    for (size_t k = 0; k < sizeof all / sizeof *all; ++k)
        qm_shape_free(all[k]);
}

static void closed_against_open(void **state)
{
    (void)state;
    qm_mesh closed = qm_shape_box(4, 2, 2), open = qm_shape_box(4, 2, 2), cut = qm_shape_triangulated(&open);
    --open.face_count; /* any side of the box may be missing: its middle is 1 from the edges, the long way too
                        */
    qm_slow_bracket d = qm_slow_hausdorff(&closed, &open, QM_A_TO_B, QM_QUADS_TRIANGLES, 1e-3, 2000);
    QM_CHECK(d.lower > 0.9 && d.upper < 1.1, "[%g, %g]", d.lower, d.upper);
    face_known("closed and open box", &closed, &open, 1, 0);
    face_known("triangles and open box", &cut, &open, 1, 0);
    qm_shape_free(&closed);
    qm_shape_free(&open);
    qm_shape_free(&cut);
}

/**
 * Quads and copies of them that are off by next to nothing: the farthest points lie as near to an edge as the
 * copies to each other, where a line leaves the reach of a triangle by so little that roots of canceled
 * terms miss it.
 */
static void nearly_coincident_copies(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < (qm_check_long() ? 5000u : 500u); seed++) {
        qm_random random = qm_random_make(qm_check_seed(), 700 + seed);
        double noise = pow(10, qm_random_range(&random, -12, -7));
        qm_mesh a = qm_shape_soup(&random, 1, QM_SOUP_QUADS, QM_SOUP_POOLED, 0), b = qm_shape_copy(&a);
        qm_shape_shake(&b, &random, noise);
        qm_wide_frame frame = qm_wide_frame_make(&a, &b);
        qm_wide_surface from = qm_wide_surface_make(&frame, &a, QM_QUADS_TRIANGLES);
        qm_wide_surface to = qm_wide_surface_make(&frame, &b, QM_QUADS_TRIANGLES);
        qm_wide_maximum known = qm_wide_farthest(&from, &to, 0x1p-54L, 2000);
        double low = (double)(known.lower / frame.scale), high = (double)(known.upper / frame.scale);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.direction = QM_A_TO_B;
        options.work_limit = 4000;
        for (int bounds = 0; bounds < 2; bounds++) {
            options.bounds = (qm_bounds)bounds;
            options.tolerance = fmax(1e-2 * noise, 1e-13);
            qm_hausdorff_result r = qm_measured(&a, &b, &options);
            QM_CHECK(r.lower <= high && r.upper >= low,
                     "seed %llu, noise %g, bounds %d: [%.17g, %.17g], true in [%.17g, %.17g]",
                     (unsigned long long)seed, noise, bounds, r.lower, r.upper, low, high);
        }
        qm_wide_surface_free(&from);
        qm_wide_surface_free(&to);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/** The last face becomes the first, so that no face has its copy's number. */
static void reverse_faces(qm_mesh *mesh)
{
    for (size_t i = 0, k = mesh->face_count; i + 1 < k--; i++) {
        uint32_t face[4];
        memcpy(face, mesh->faces + 4 * i, sizeof face);
        memcpy(mesh->faces + 4 * i, mesh->faces + 4 * k, sizeof face);
        memcpy(mesh->faces + 4 * k, face, sizeof face);
    }
}

/**
 * Patches twisted by about their size, all across one another: the copy of each is the nearest one, but by
 * triangles many are nearer. Every point is at most the noise away, so a search that ends has an upper bound
 * of that and its tolerance.
 */
static void crossing_patches_and_their_copies(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < (qm_check_long() ? 500u : 20u); seed++) {
        qm_random random = qm_random_make(qm_check_seed(), 9700 + seed);
        bool is_reversed = seed % 2;
        double noise = pow(10, qm_random_range(&random, -10, is_reversed ? -4 : -1)), size;
        qm_mesh a = qm_shape_soup(&random, 60, QM_SOUP_QUADS, QM_SOUP_POOLED, 0), b = qm_shape_copy(&a);
        qm_shape_shake(&b, &random, noise);
        if (is_reversed) reverse_faces(&b);
        size = qm_measured_size(&a, &b);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.quads = QM_QUADS_BILINEAR;
        options.tolerance = 1e-6 * size;
        qm_hausdorff_result r = qm_measured(&a, &b, &options);
        QM_CHECK(r.stop == QM_STOP_CONVERGED && r.upper <= sqrt(3.0) * noise + options.tolerance,
                 "seed %llu, noise %g: stop %d, [%.17g, %.17g]", (unsigned long long)seed, noise, (int)r.stop,
                 r.lower, r.upper);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/**
 * A ring turned along itself by a few tolerances: each face reaches beyond its copy by a strip as narrow as
 * that, which the next one covers. A search that cuts the faces in quarters until the parts are as small as
 * the strip looks at dozens of parts for each.
 */
static void a_ring_turned_by_a_few_tolerances(void **state)
{
    (void)state;
    enum { COLUMNS = 24, ROWS = 12, FACES = COLUMNS * ROWS };
    for (uint64_t seed = 0; seed < (qm_check_long() ? 100u : 12u); seed++) {
        qm_random random = qm_random_make(qm_check_seed(), 9900 + seed);
        qm_mesh a = qm_shape_torus(COLUMNS, ROWS, 1, 0.3), b = qm_shape_copy(&a);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.quads = QM_QUADS_BILINEAR;
        options.tolerance = 1e-6 * qm_measured_size(&a, &b);
        double angle = options.tolerance * qm_random_range(&random, 0.5, 5);
        for (size_t v = 0; v < b.vertex_count; v++) {
            double *p = b.positions + 3 * v, x = p[0];
            p[0] = x * cos(angle) - p[1] * sin(angle);
            p[1] = x * sin(angle) + p[1] * cos(angle);
        }
        qm_hausdorff_result r = qm_measured(&a, &b, &options);
        double corner[3] = {a.positions[0], a.positions[1], a.positions[2]};
        double known = qm_slow_distance(&b, QM_QUADS_BILINEAR, corner, 1e-12).lower;
        QM_CHECK(r.stop == QM_STOP_CONVERGED && r.upper >= known && r.lower <= 1.3 * angle &&
                     r.iterations <= 4 * FACES,
                 "seed %llu, turned by %g: stop %d, [%.17g, %.17g] after %llu parts",
                 (unsigned long long)seed, angle, (int)r.stop, r.lower, r.upper,
                 (unsigned long long)r.iterations);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slivers_and_needles),
        cmocka_unit_test(coplanar_and_identical_meshes),
        cmocka_unit_test(plateaus),
        cmocka_unit_test(folded_patches),
        cmocka_unit_test(far_and_tiny_coordinates),
        cmocka_unit_test(coordinates_as_large_as_they_go),
        cmocka_unit_test(thousands_of_copies_of_one_triangle),
        cmocka_unit_test(copies_of_one_twisted_quad),
        cmocka_unit_test(noisy_copies_under_one_twisted_quad),
        cmocka_unit_test(flat_boxes),
        cmocka_unit_test(single_facets),
        cmocka_unit_test(points_and_vertices_of_no_face),
        cmocka_unit_test(huge_and_tiny_faces),
        cmocka_unit_test(meshes_far_apart),
        cmocka_unit_test(ties_everywhere),
        cmocka_unit_test(closed_against_open),
        cmocka_unit_test(nearly_coincident_copies),
        cmocka_unit_test(crossing_patches_and_their_copies),
        cmocka_unit_test(a_ring_turned_by_a_few_tolerances),
    };
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    return cmocka_run_group_tests(tests, NULL, NULL);
}
