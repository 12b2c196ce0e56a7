/* Alignment: motions that are known, found again; floors against measured distances; balls against all subsets of points. */
#include "check.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/host.h"
#include "failing_allocator.h"
#include "qm/align.h"
#include "random.h"
#include "shapes.h"

/* ---- shapes and motions ---- */

/** A closed surface without a symmetry. */
static void lump(const void *user, double u, double v, double out[3])
{
    (void)user;
    const double a = 2.0 * M_PI * u, b = M_PI * (0.02 + 0.96 * v);
    const double r =
        1.0 + 0.3 * sin(b) * cos(a + 0.4) + 0.2 * cos(3.0 * b) + 0.15 * sin(2.0 * a) * sin(b) * sin(b);
    out[0] = 1.6 * r * sin(b) * cos(a);
    out[1] = r * sin(b) * sin(a);
    out[2] = 0.8 * r * cos(b);
}

/** An open sheet, curved in both ways. */
static void sheet(const void *user, double u, double v, double out[3])
{
    (void)user;
    out[0] = 2.0 * u;
    out[1] = v;
    out[2] = 0.4 * sin(3.0 * u) + 0.3 * v * v + 0.2 * sin(5.0 * u * v);
}

enum { LUMP, SHEET, BRICKS, SOUP, CLOUD, SHAPE_COUNT };

static qm_mesh make_shape(int shape, uint64_t seed)
{
    qm_random random = qm_random_make(seed, (uint64_t)shape);
    if (shape == LUMP) return qm_shape_grid(24, 16, true, false, lump, NULL);
    if (shape == SHEET) return qm_shape_grid(20, 10, false, false, sheet, NULL);
    if (shape == SOUP) return qm_shape_soup(&random, 30, QM_SOUP_MIXED, QM_SOUP_APART, 0.3);
    if (shape == CLOUD) return qm_shape_points(&random, 400);
    qm_mesh long_one = qm_shape_box(3.0, 1.0, 0.5), high_one = qm_shape_box(0.4, 0.7, 2.0);
    qm_mesh both = qm_shape_joined(&long_one, &high_one);
    qm_shape_free(&long_one);
    qm_shape_free(&high_one);
    return both;
}

static double diagonal(const qm_mesh *mesh)
{
    const qm_box box = qm_mesh_bounding_box(mesh);
    return qm_mesh_box_diagonal(&box);
}

/** A random turn with this scale, and a shift of up to reach. */
static void random_motion(qm_random *random, double scale, double reach, double m[16])
{
    double axis[3];
    qm_random_direction(random, axis);
    const double angle = qm_random_range(random, -M_PI, M_PI), c = cos(angle), s = sin(angle);
    qm_transform_identity(m);
    for (int r = 0; r < 3; r++) {
        for (int k = 0; k < 3; k++) {
            const int other = 3 - r - k; /* the third axis where they differ */
            const double cross = r == k ? 0.0 : (k - r + 3) % 3 == 1 ? -axis[other] : axis[other];
            m[4 * k + r] = scale * ((r == k ? c : 0.0) + (1.0 - c) * axis[r] * axis[k] + s * cross);
        }
        m[12 + r] = qm_random_range(random, -reach, reach);
    }
}

static void apply(const double m[16], const double p[3], double out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r];
}

/** Moves a copy of a mesh. */
static qm_mesh moved_copy(const qm_mesh *mesh, const double m[16])
{
    qm_mesh copy = qm_shape_copy(mesh);
    for (size_t i = 0; i < mesh->vertex_count; i++)
        apply(m, mesh->positions + 3 * i, copy.positions + 3 * i);
    return copy;
}

/** How far the transform leaves the vertices of a from their places, the vertices of b. */
static double error_of(const qm_mesh *a, const qm_mesh *b, const double transform[16])
{
    double most = 0.0;
    for (size_t i = 0; i < a->vertex_count; i++) {
        double p[3], square = 0.0;
        apply(transform, a->positions + 3 * i, p);
        for (int k = 0; k < 3; k++)
            square += (p[k] - b->positions[3 * i + (size_t)k]) * (p[k] - b->positions[3 * i + (size_t)k]);
        most = fmax(most, square);
    }
    return sqrt(most);
}

static qm_align_options quick(void)
{
    qm_align_options options = qm_align_options_default();
    options.sample_count = 1000;
    return options;
}

static qm_align_result align_with(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                                  const qm_align_options *options)
{
    qm_bvh *tree[2];
    qm_align_result result;
    assert_int_equal(qm_bvh_build(ctx, a, QM_BVH_ALL, 1, &tree[0]), QM_OK);
    assert_int_equal(qm_bvh_build(ctx, b, QM_BVH_ALL, 1, &tree[1]), QM_OK);
    const qm_status status = qm_align_find(ctx, tree[0], tree[1], options, &result);
    if (status != QM_OK) print_error("%s\n", ctx->message);
    assert_int_equal(status, QM_OK);
    qm_bvh_destroy(ctx, tree[0]);
    qm_bvh_destroy(ctx, tree[1]);
    return result;
}

static qm_align_result align(const qm_mesh *a, const qm_mesh *b, const qm_align_options *options)
{
    qm_context ctx = qm_context_make();
    return align_with(&ctx, a, b, options);
}

static void check_rotation(const double m[16], double scale, bool is_mirrored)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double *p = m + 4 * i, *q = m + 4 * j, dot = p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
            assert_true(fabs(dot - (i == j ? scale * scale : 0.0)) <= 1e-14 * scale * scale);
        }
    assert_int_equal(qm_transform_mirrors(m), is_mirrored);
}

/* ---- motions ---- */

/** Both readings of quads, triangles and point sets; B is the shape, A the moved one. */
static void rigid_motions_are_found(void **state)
{
    (void)state;
    const uint64_t count = qm_check_long() ? 200 : 3;
    for (int shape = 0; shape < SHAPE_COUNT; shape++)
        for (uint64_t i = 0; i < count; i++) {
            qm_random random = qm_random_make(qm_check_seed(), 1000 * (uint64_t)shape + i);
            qm_mesh b = make_shape(shape, qm_check_seed());
            double m[16];
            random_motion(&random, 1.0, 3.0 * diagonal(&b), m);
            qm_mesh a = moved_copy(&b, m);
            qm_align_options options = quick();
            options.quads = i % 2 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
            const qm_align_result result = align(&a, &b, &options);
            const double error = error_of(&a, &b, result.transform);
            QM_CHECK(error <= 1e-9 * diagonal(&b), "seed %llu shape %d motion %llu: error %g, rms %g",
                     (unsigned long long)qm_check_seed(), shape, (unsigned long long)i, error, result.rms);
            assert_true(result.rms <= 1e-9 * diagonal(&b) && result.is_converged);
            assert_true(result.runner_up_rms >= result.rms || isnan(result.runner_up_rms));
            assert_true(result.floor <= 1e-12 * diagonal(&b));
            check_rotation(result.transform, 1.0, false);
            qm_shape_free(&a);
            qm_shape_free(&b);
        }
}

/** With noise no motion is known; but where A lies before must not change where it ends. */
static void noise_ends_at_one_place(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < (qm_check_long() ? 200 : 3); i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        qm_mesh b = make_shape(LUMP, 0);
        qm_mesh noisy = qm_shape_copy(&b);
        qm_shape_shake(&noisy, &random, 0.002 * diagonal(&b));
        double m[16];
        random_motion(&random, 1.0, 3.0 * diagonal(&b), m);
        qm_mesh a = moved_copy(&noisy, m);
        const qm_align_options options = quick();
        const qm_align_result first = align(&noisy, &b, &options), second = align(&a, &b, &options);
        qm_mesh end = moved_copy(&noisy, first.transform);
        const double error = error_of(&a, &end, second.transform);
        QM_CHECK(error <= 1e-6 * diagonal(&b), "seed %llu case %llu: %g", (unsigned long long)qm_check_seed(),
                 (unsigned long long)i, error);
        qm_shape_free(&end);
        qm_shape_free(&a);
        qm_shape_free(&noisy);
        qm_shape_free(&b);
    }
}

static void scales_are_found(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < (qm_check_long() ? 60 : 4); i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        qm_mesh b = make_shape(i % 2 ? LUMP : BRICKS, 0);
        const double scale = pow(10.0, qm_random_range(&random, -3.0, 3.0));
        double m[16];
        random_motion(&random, scale, 1.0, m);
        qm_mesh a = moved_copy(&b, m);
        qm_align_options options = quick();
        options.motion = QM_ALIGN_RIGID_SCALE;
        options.direction = QM_TWO_SIDED;
        const qm_align_result result = align(&a, &b, &options);
        QM_CHECK(error_of(&a, &b, result.transform) <= 1e-9 * diagonal(&b), "seed %llu case %llu: rms %g",
                 (unsigned long long)qm_check_seed(), (unsigned long long)i, result.rms);
        assert_true(fabs(result.scale * scale - 1.0) <= 1e-9);
        assert_true(result.floor == 0.0);
        check_rotation(result.transform, result.scale, false);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static void translations_turn_nothing(void **state)
{
    (void)state;
    qm_mesh b = make_shape(BRICKS, 0), a = qm_shape_copy(&b);
    qm_shape_move(&a, 1.0, (const double[3]){3.0, -7.0, 11.0});
    qm_align_options options = quick();
    options.motion = QM_ALIGN_TRANSLATION;
    const qm_align_result result = align(&a, &b, &options);
    assert_true(error_of(&a, &b, result.transform) <= 1e-9);
    for (int i = 0; i < 12; i++)
        assert_true(result.transform[i] == (i % 5 == 0));
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** A scan of a part, and a scan with something else beside it. */
static void parts_and_strangers_are_placed(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < 4; i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        qm_mesh b = make_shape(LUMP, 0), a;
        double m[16];
        random_motion(&random, 1.0, 5.0, m);
        a = moved_copy(&b, m);
        qm_align_options options = quick();
        if (i % 2) {
            a.face_count /= 2;
        } else {
            for (size_t v = 0; v < 5; v++) /* five vertices fly off, with their faces */
                a.positions[3 * (a.vertex_count / 2 + v)] += 2.0;
            options.trim = 0.3;
        }
        const qm_align_result result = align(&a, &b, &options);
        if (!(i % 2))
            for (size_t v = 0; v < 5; v++) {
                double p[3];
                apply(m, b.positions + 3 * (b.vertex_count / 2 + v), p);
                memcpy(a.positions + 3 * (a.vertex_count / 2 + v), p, sizeof p);
            }
        const double error = error_of(&a, &b, result.transform);
        QM_CHECK(error <= 1e-6 * diagonal(&b), "seed %llu case %llu: %g", (unsigned long long)qm_check_seed(),
                 (unsigned long long)i, error);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static void distant_points_do_not_count(void **state)
{
    (void)state;
    qm_mesh b = make_shape(LUMP, 0), a = qm_shape_copy(&b);
    a.positions[3 * (a.vertex_count / 2)] += 2.0;
    qm_align_options options = quick();
    options.start = QM_ALIGN_IDENTITY;
    qm_align_result result = align(&a, &b, &options);
    assert_true(error_of(&b, &b, result.transform) > 1e-4);
    options.max_distance = 0.02;
    result = align(&a, &b, &options);
    assert_true(error_of(&b, &b, result.transform) < 2e-3);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** A box lies in four ways on itself: the second one is told. */
static void a_symmetric_part_is_told(void **state)
{
    (void)state;
    qm_mesh b = qm_shape_box(1.0, 2.0, 3.0);
    double m[16];
    qm_random random = qm_random_make(qm_check_seed(), 0);
    random_motion(&random, 1.0, 5.0, m);
    qm_mesh a = moved_copy(&b, m);
    const qm_align_options options = quick();
    const qm_align_result result = align(&a, &b, &options);
    assert_true(result.rms <= 1e-9 && result.runner_up_rms <= 1e-9);
    qm_shape_free(&a);
    b = (qm_shape_free(&b), make_shape(LUMP, 0));
    a = moved_copy(&b, m);
    const qm_align_result unique = align(&a, &b, &options);
    assert_true(unique.rms <= 1e-9 && unique.runner_up_rms > 0.01);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Motions that change nothing must not run away. */
static void surfaces_that_slide_come_to_rest(void **state)
{
    (void)state;
    qm_mesh b[] = {qm_shape_sphere(0.0), qm_shape_torus(24, 12, 2.0, 0.5), qm_shape_plane(5, 0.0),
                   qm_shape_strip(8, 2, 0.0)};
    qm_mesh a[] = {qm_shape_sphere(0.3), qm_shape_torus(36, 18, 2.0, 0.5), qm_shape_plane(3, 2.0),
                   qm_shape_strip(5, 3, 0.0)};
    for (size_t i = 0; i < sizeof a / sizeof *a; i++) {
        double m[16];
        qm_random random = qm_random_make(qm_check_seed(), i);
        random_motion(&random, 1.0, 5.0, m);
        qm_mesh moved = moved_copy(&a[i], m);
        const qm_align_options options = quick();
        const qm_align_result result = align(&moved, &b[i], &options);
        assert_true(result.rms <= 0.02);
        check_rotation(result.transform, 1.0, false);
        qm_shape_free(&moved);
        qm_shape_free(&a[i]);
        qm_shape_free(&b[i]);
    }
}

static void a_mirror_image_only_when_asked(void **state)
{
    (void)state;
    qm_mesh b = make_shape(LUMP, 0);
    double mirror[16], m[16];
    qm_transform_identity(mirror);
    mirror[5] = -1.0;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    random_motion(&random, 1.0, 5.0, m);
    qm_mesh image = moved_copy(&b, mirror), a = moved_copy(&image, m);
    qm_align_options options = quick();
    qm_align_result result = align(&a, &b, &options);
    assert_false(result.is_mirrored);
    assert_true(result.rms > 0.005);
    check_rotation(result.transform, 1.0, false);
    options.may_mirror = true;
    result = align(&a, &b, &options);
    assert_true(result.is_mirrored);
    assert_true(error_of(&a, &b, result.transform) <= 1e-9 * diagonal(&b));
    check_rotation(result.transform, 1.0, true);
    result = align(&b, &b, &options); /* where it need not be one, it is none */
    assert_false(result.is_mirrored);
    qm_shape_free(&a);
    qm_shape_free(&image);
    qm_shape_free(&b);
}

static void landmarks_start_near(void **state)
{
    (void)state;
    qm_mesh b = make_shape(LUMP, 0);
    double m[16];
    qm_random random = qm_random_make(qm_check_seed(), 0);
    random_motion(&random, 1.0, 50.0, m);
    qm_mesh a = moved_copy(&b, m);
    qm_align_landmark landmarks[4];
    for (size_t i = 0; i < 4; i++) {
        const size_t vertex = i * b.vertex_count / 4 + 7;
        memcpy(landmarks[i].a, a.positions + 3 * vertex, sizeof landmarks[i].a);
        memcpy(landmarks[i].b, b.positions + 3 * vertex, sizeof landmarks[i].b);
        for (int k = 0; k < 3; k++) /* as by hand */
            landmarks[i].b[k] += qm_random_range(&random, -0.05, 0.05);
    }
    qm_align_options options = quick();
    options.start = QM_ALIGN_LANDMARKS;
    options.landmarks = landmarks;
    options.landmark_count = 4;
    const qm_align_result result = align(&a, &b, &options);
    assert_true(error_of(&a, &b, result.transform) <= 1e-9 * diagonal(&b));
    assert_true(isnan(result.runner_up_rms));
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Sizes of 1e-30 and 1e30, and a part that lies 1e9 of its sizes away, where coordinates have 7 digits. */
static void sizes_and_places_do_not_matter(void **state)
{
    (void)state;
    for (int i = 0; i < 5; i++) {
        static const double size[] = {1e-30, 1e30, 1.0, 1.0, 1e-150}, place[] = {0.0, 0.0, 1e9, 0.0, 0.0};
        qm_mesh b = make_shape(LUMP, 0);
        double m[16];
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)i);
        random_motion(&random, 1.0, 5.0, m);
        qm_mesh a = moved_copy(&b, m);
        qm_shape_move(&b, size[i], (const double[3]){place[i], -place[i], 0.5 * place[i]});
        qm_shape_move(&a, size[i], (const double[3]){i == 3 ? 1e9 : 0.0, 0.0, 0.0});
        const qm_align_options options = quick();
        const qm_align_result result = align(&a, &b, &options);
        const double error = error_of(&a, &b, result.transform);
        const double allowed = (i == 2 || i == 3 ? 2e-6 : 1e-9) * diagonal(&b);
        QM_CHECK(error <= allowed, "case %d: %g", i, error / diagonal(&b));
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/** One point, points on a line, faces without area, a vertex that no face uses. */
static void poor_meshes_have_an_answer(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    const double far[3] = {1e6, 0.0, 0.0};
    const double flat[3][3] = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}},
                 spot[3][3] = {{1, 2, 3}, {1, 2, 3}, {1, 2, 3}};
    qm_mesh lumps = make_shape(LUMP, 0);
    qm_mesh mesh[] = {
        qm_shape_points(&random, 1), qm_shape_points(&random, 2),          qm_shape_face(3, flat),
        qm_shape_face(3, spot),      qm_shape_with_unused(&lumps, 3, far), qm_shape_copies(3)};
    const size_t count = sizeof mesh / sizeof *mesh;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < count; k++)
            for (int kind = 0; kind < 3; kind++) {
                if ((i + k + (size_t)kind) % 2 && !qm_check_long()) continue;
                qm_align_options options = quick();
                options.sample_count = 100;
                options.fit = kind == 2 ? QM_ALIGN_MIN_MAX : QM_ALIGN_LEAST_SQUARES;
                options.motion = kind == 1 ? QM_ALIGN_RIGID_SCALE : QM_ALIGN_RIGID;
                options.direction = kind == 0 ? QM_A_TO_B : QM_TWO_SIDED;
                const qm_align_result result = align(&mesh[i], &mesh[k], &options);
                for (int n = 0; n < 16; n++)
                    assert_true(isfinite(result.transform[n]));
                assert_true(isfinite(result.rms));
                check_rotation(result.transform, result.scale, false);
            }
    for (size_t i = 0; i < count; i++)
        qm_shape_free(&mesh[i]);
    qm_shape_free(&lumps);
}

/* ---- min-max ---- */

/** Boxes of one shape, one larger: concentric they reach the floor, and least squares of A from B need not. */
static void min_max_reaches_the_floor_of_boxes(void **state)
{
    (void)state;
    qm_mesh b = qm_shape_box(1.2, 2.4, 3.6), a = qm_shape_box(1.0, 2.0, 3.0);
    double m[16];
    qm_random random = qm_random_make(qm_check_seed(), 0);
    random_motion(&random, 1.0, 5.0, m);
    qm_mesh moved = moved_copy(&a, m);
    qm_align_options options = quick();
    options.fit = QM_ALIGN_MIN_MAX;
    options.direction = QM_TWO_SIDED;
    const qm_align_result result = align(&moved, &b, &options);
    const double truth = 0.1 * sqrt(1.0 + 4.0 + 9.0);
    assert_true(fabs(result.floor - truth) <= 1e-12);
    qm_mesh end = moved_copy(&moved, result.transform);
    qm_context ctx = qm_context_make();
    qm_bvh *tree[2];
    assert_int_equal(qm_bvh_build(&ctx, &end, QM_BVH_ALL, 1, &tree[0]), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_ALL, 1, &tree[1]), QM_OK);
    qm_hausdorff_options measure = qm_hausdorff_options_default();
    measure.tolerance = 1e-9;
    qm_hausdorff_result found;
    assert_int_equal(qm_hausdorff_measure(&ctx, tree[0], tree[1], &measure, &found), QM_OK);
    QM_CHECK(found.upper <= truth * 1.00001 && found.upper >= truth * (1.0 - 1e-12), "%.17g, not %.17g",
             found.upper, truth);
    qm_bvh_destroy(&ctx, tree[0]);
    qm_bvh_destroy(&ctx, tree[1]);
    qm_shape_free(&end);
    qm_shape_free(&moved);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static double hausdorff_upper(const qm_mesh *a, const qm_mesh *b)
{
    qm_context ctx = qm_context_make();
    qm_bvh *tree[2];
    assert_int_equal(qm_bvh_build(&ctx, a, QM_BVH_ALL, 1, &tree[0]), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, b, QM_BVH_ALL, 1, &tree[1]), QM_OK);
    qm_hausdorff_options measure = qm_hausdorff_options_default();
    measure.tolerance = 1e-7 * diagonal(b);
    qm_hausdorff_result found;
    assert_int_equal(qm_hausdorff_measure(&ctx, tree[0], tree[1], &measure, &found), QM_OK);
    qm_bvh_destroy(&ctx, tree[0]);
    qm_bvh_destroy(&ctx, tree[1]);
    return found.upper;
}

/** It starts from the least squares, and keeps the best distance that it measured. */
static void min_max_is_no_farther_than_least_squares(void **state)
{
    (void)state;
    double ratio = 0.0;
    for (uint64_t i = 0; i < 4; i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        qm_mesh b = make_shape(i % 2 ? LUMP : SHEET, 0), a = qm_shape_copy(&b);
        qm_shape_shake(&a, &random, 0.02);
        a.positions[3 * (a.vertex_count / 3)] += 0.2; /* a high point */
        qm_align_options options = quick();
        options.direction = QM_TWO_SIDED;
        options.start = QM_ALIGN_IDENTITY;
        double upper[2];
        for (int fit = 0; fit < 2; fit++) {
            options.fit = fit ? QM_ALIGN_MIN_MAX : QM_ALIGN_LEAST_SQUARES;
            const qm_align_result result = align(&a, &b, &options);
            qm_mesh end = moved_copy(&a, result.transform);
            upper[fit] = hausdorff_upper(&end, &b);
            assert_true(result.floor <= upper[fit]);
            qm_shape_free(&end);
        }
        QM_CHECK(upper[1] <= upper[0] * 1.001, "case %llu: %g after %g", (unsigned long long)i, upper[1],
                 upper[0]);
        ratio += upper[1] / upper[0] / 4.0;
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
    QM_CHECK(ratio < 0.95, "it lowers the distance by no more than %g", 1.0 - ratio);
}

/** The lowest Hausdorff distance is reached in one place, wherever A lay before; where it grows slowly about that place, less
 * exactly than least squares are. */
static void min_max_ends_at_one_place(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < (qm_check_long() ? 20 : 1); i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        qm_mesh b = make_shape(LUMP, 0), a = qm_shape_copy(&b);
        qm_shape_shake(&a, &random, 0.01);
        qm_align_options options = quick();
        options.direction = QM_TWO_SIDED;
        options.fit = QM_ALIGN_MIN_MAX;
        const qm_align_result first = align(&a, &b, &options);
        qm_mesh place = moved_copy(&a, first.transform);
        for (int run = 0; run < 2; run++) {
            double m[16];
            random_motion(&random, 1.0, 3.0, m);
            qm_mesh moved = moved_copy(&a, m);
            const qm_align_result result = align(&moved, &b, &options);
            const double error = error_of(&moved, &place, result.transform);
            QM_CHECK(error <= 1e-4 * diagonal(&b), "case %llu, run %d: %g", (unsigned long long)i, run,
                     error / diagonal(&b));
            qm_shape_free(&moved);
        }
        qm_shape_free(&place);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/* ---- one answer ---- */

static void threads_change_no_bit(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    for (int kind = 0; kind < 3; kind++) {
        qm_mesh b = make_shape(LUMP, 0), a = qm_shape_copy(&b);
        qm_shape_shake(&a, &random, 0.01);
        qm_align_options options = quick();
        options.fit = kind == 1 ? QM_ALIGN_MIN_MAX : QM_ALIGN_LEAST_SQUARES;
        options.motion = kind == 2 ? QM_ALIGN_RIGID_SCALE : QM_ALIGN_RIGID;
        options.direction = kind == 0 ? QM_A_TO_B : QM_TWO_SIDED;
        qm_align_result results[3];
        if (kind > 0) options.start = QM_ALIGN_CENTROIDS;
        for (int run = 0; run < 3; run++) {
            qm_context ctx = qm_host_context();
            options.thread_count = run == 2 ? 7 : run + 1;
            results[run] = align_with(&ctx, &a, &b, &options);
            assert_memory_equal(results[run].transform, results[0].transform, sizeof results[0].transform);
            assert_true(results[run].rms == results[0].rms);
            assert_int_equal(results[run].iterations, results[0].iterations);
        }
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/* ---- balls and floors ---- */

/** The smallest ball of few points in extended precision: of all balls through up to four of them, the smallest that contains
 * all. Returns its radius. */
static long double slow_radius(const double (*p)[3], int count)
{
    long double best = INFINITY;
    for (unsigned set = 1; set < 1u << count; set++) {
        int chosen[4], size = 0;
        if (__builtin_popcount(set) > 4) continue;
        for (int i = 0; i < count; i++)
            if (set >> i & 1u) chosen[size++] = i;
        /* The center is p0 + sum x_i (p_i - p0) with 2 (p_i - p0) . (center - p0) = |p_i - p0|^2: Gauss with pivots. */
        long double rows[3][4] = {{0}}, center[3];
        for (int i = 1; i < size; i++)
            for (int j = 1; j < size; j++)
                for (int k = 0; k < 3; k++) {
                    const long double e = (long double)p[chosen[i]][k] - p[chosen[0]][k];
                    rows[i - 1][j - 1] += 2.0L * e * ((long double)p[chosen[j]][k] - p[chosen[0]][k]);
                    if (j == 1) rows[i - 1][3] += e * e;
                }
        bool is_flat = false;
        for (int i = 0; i < size - 1; i++) {
            int pivot = i;
            for (int j = i; j < size - 1; j++)
                if (fabsl(rows[j][i]) > fabsl(rows[pivot][i])) pivot = j;
            for (int k = 0; k < 4; k++) {
                const long double swap = rows[i][k];
                rows[i][k] = rows[pivot][k];
                rows[pivot][k] = swap;
            }
            is_flat = is_flat || fabsl(rows[i][i]) < 1e-13L;
            for (int j = 0; j < size - 1 && !is_flat; j++) {
                if (j == i) continue;
                const long double factor = rows[j][i] / rows[i][i];
                for (int k = 0; k < 4; k++)
                    rows[j][k] -= factor * rows[i][k];
            }
        }
        if (is_flat) continue;
        for (int k = 0; k < 3; k++) {
            center[k] = p[chosen[0]][k];
            for (int i = 1; i < size; i++)
                center[k] +=
                    rows[i - 1][3] / rows[i - 1][i - 1] * ((long double)p[chosen[i]][k] - p[chosen[0]][k]);
        }
        long double radius = 0.0L;
        for (int i = 0; i < count; i++) {
            long double square = 0.0L;
            for (int k = 0; k < 3; k++)
                square += (p[i][k] - center[k]) * (p[i][k] - center[k]);
            radius = fmaxl(radius, sqrtl(square));
        }
        best = fminl(best, radius);
    }
    return best;
}

static void balls_hold_the_slow_radius(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    for (uint64_t i = 0; i < (qm_check_long() ? 20000 : 2000); i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        double p[9][3];
        const int count = 1 + (int)qm_random_below(&random, 9);
        const bool is_lattice = i % 3 == 0;
        for (int v = 0; v < count; v++)
            for (int k = 0; k < 3; k++)
                p[v][k] =
                    is_lattice ? (double)qm_random_below(&random, 3) : qm_random_range(&random, -1.0, 1.0);
        const long double truth = slow_radius((const double(*)[3])p, count);
        const double size = i % 4 == 0 ? 0x1p-1000 : i % 4 == 1 ? 0x1p900 : 1.0; /* exact */
        for (int v = 0; v < count; v++)
            for (int k = 0; k < 3; k++)
                p[v][k] *= size;
        const qm_mesh mesh = {.positions = p[0], .vertex_count = (size_t)count};
        qm_align_ball ball;
        assert_int_equal(qm_align_enclose(&ctx, &mesh, &ball), QM_OK);
        const long double lower = ball.lower / (long double)size, upper = ball.upper / (long double)size;
        /* The twin has 64 bits, and a ball that it calls flat may be missing: it is never too small. */
        QM_CHECK(lower <= truth * (1.0L + 1e-16L) && upper - lower <= 1e-9L,
                 "seed %llu case %llu: %.17Lg to %.17Lg, slow %.17Lg", (unsigned long long)qm_check_seed(),
                 (unsigned long long)i, lower, upper, truth);
        QM_CHECK(upper >= truth * (1.0L - 1e-12L), "seed %llu case %llu: %.17Lg, slow %.17Lg",
                 (unsigned long long)qm_check_seed(), (unsigned long long)i, upper, truth);
    }
}

static void balls_of_known_surfaces(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_align_ball ball;
    for (int i = 0; i < 3; i++) {
        const double far[3] = {1e6, 0, 0}, shift[3] = {i == 1 ? 1e9 : 0.0, i == 1 ? -3e9 : 0.0, 0.0};
        qm_mesh box = qm_shape_box(1.0, 2.0, 2.0);
        qm_shape_move(&box, i == 2 ? 0x1p-100 : 1.0, shift);
        qm_mesh mesh = qm_shape_with_unused(&box, 2, far); /* which are no part of the surface */
        assert_int_equal(qm_align_enclose(&ctx, &mesh, &ball), QM_OK);
        const double truth = i == 2 ? 0x1.8p-100 : 1.5;
        assert_true(ball.lower <= truth && truth <= ball.upper && ball.upper - ball.lower <= 1e-12 * truth);
        qm_shape_free(&mesh);
        qm_shape_free(&box);
    }
    qm_mesh sphere = qm_shape_torus(400, 200, 3.0, 1.0);
    assert_int_equal(qm_align_enclose(&ctx, &sphere, &ball), QM_OK);
    assert_true(ball.lower <= 4.0 && 4.0 <= ball.upper && ball.upper - ball.lower <= 1e-9);
    qm_shape_free(&sphere);
}

/** No motion may bring two meshes nearer than their floor. */
static void no_motion_goes_below_the_floor(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    size_t above = 0;
    for (uint64_t i = 0; i < (qm_check_long() ? 5000 : 300); i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        qm_mesh b = make_shape((int)(i % SHAPE_COUNT), i), a = qm_shape_copy(&b);
        double m[16], far[16];
        const double scale = i % 2 ? qm_random_range(&random, 0.5, 2.0) : 1.0;
        qm_shape_move(&a, scale, (const double[3]){0, 0, 0}); /* scaled copies reach their floor */
        random_motion(&random, 1.0, i % 4 < 2 ? 0.0 : 1.0, far);
        if (i % 4 < 2) qm_transform_identity(far);
        memcpy(m, far, sizeof m);
        qm_mesh moved = moved_copy(&a, m);
        qm_align_ball ball[2];
        assert_int_equal(qm_align_enclose(&ctx, &a, &ball[0]), QM_OK);
        assert_int_equal(qm_align_enclose(&ctx, &b, &ball[1]), QM_OK);
        const double floor = qm_align_floor(&ball[0], &ball[1]), upper = hausdorff_upper(&moved, &b);
        above += floor > 0.1 * upper;
        /* The moved mesh is rounded, which a motion is not: by some 2^-50 of its size. */
        QM_CHECK(floor <= upper + 1e-14 * (diagonal(&b) + diagonal(&a)),
                 "seed %llu case %llu: floor %.17g, upper %.17g", (unsigned long long)qm_check_seed(),
                 (unsigned long long)i, floor, upper);
        qm_shape_free(&moved);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
    assert_true(above > 50);
}

/* ---- faults ---- */

static void faults_of_options_are_told(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_box(1, 2, 3);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    const qm_align_landmark line[3] = {
        {{0, 0, 0}, {0, 0, 0}}, {{1, 0, 0}, {1, 0, 0}}, {{2, 0, 0}, {2, 0, 0}}};
    const qm_align_landmark bad[1] = {{{0, NAN, 0}, {0, 0, 0}}};
    for (int i = 0; i < 10; i++) {
        qm_align_options options = quick();
        options.start = QM_ALIGN_LANDMARKS;
        options.landmarks = line;
        options.landmark_count = 3;
        static const char *const words[] = {"trim",     "trim",   "above 0", "landmarks", "one line",
                                            "one line", "finite", "scale",   "min-max",   "samples"};
        if (i == 0) options.trim = -0.1;
        if (i == 1) options.trim = 0.95;
        if (i == 2) options.max_distance = 0.0;
        if (i == 3) options.landmark_count = 0;
        if (i == 5) options.landmark_count = 2;
        if (i == 6) options.landmarks = bad, options.landmark_count = 1;
        if (i == 7) options.motion = QM_ALIGN_RIGID_SCALE;
        if (i == 8) options.fit = QM_ALIGN_MIN_MAX, options.trim = 0.1;
        if (i == 9) options.sample_count = 5;
        qm_align_result result;
        assert_int_equal(qm_align_find(&ctx, tree, tree, &options, &result), QM_E_ARGUMENT);
        QM_CHECK(strstr(ctx.message, words[i]), "case %d: %s", i, ctx.message);
    }
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

static void a_raised_flag_ends_it(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = make_shape(LUMP, 0);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    atomic_bool cancel = true;
    ctx.cancel = &cancel;
    const qm_align_options options = quick();
    qm_align_result result;
    assert_int_equal(qm_align_find(&ctx, tree, tree, &options, &result), QM_E_CANCELED);
    ctx.cancel = NULL;
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

static void memory_that_runs_out_is_told(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_box(1, 2, 3);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    for (int fit = 0; fit < 2; fit++) {
        bool is_over = false;
        for (size_t fail_at = 0; !is_over; fail_at += fail_at < 30 ? 1 : 97) {
            qm_failing_allocator memory = {.fail_at = fail_at};
            qm_context poor = qm_context_make();
            poor.allocator = qm_failing_allocator_hook(&memory);
            qm_align_options options = quick();
            options.fit = fit ? QM_ALIGN_MIN_MAX : QM_ALIGN_LEAST_SQUARES;
            options.direction = fit ? QM_TWO_SIDED : QM_A_TO_B;
            options.start = QM_ALIGN_CENTROIDS;
            options.sample_count = 300;
            qm_align_result result;
            const qm_status status = qm_align_find(&poor, tree, tree, &options, &result);
            is_over = memory.calls <= fail_at;
            /* A Hausdorff search without memory ends early with bounds that hold. */
            assert_true(status == QM_E_NO_MEMORY || status == QM_OK);
            if (is_over) assert_int_equal(status, QM_OK);
            assert_int_equal(memory.live_blocks, 0);
            assert_false(memory.mismatched);
        }
    }
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

int main(void)
{
    printf("seed %llu\n", (unsigned long long)qm_check_seed());
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rigid_motions_are_found),
        cmocka_unit_test(noise_ends_at_one_place),
        cmocka_unit_test(scales_are_found),
        cmocka_unit_test(translations_turn_nothing),
        cmocka_unit_test(parts_and_strangers_are_placed),
        cmocka_unit_test(distant_points_do_not_count),
        cmocka_unit_test(a_symmetric_part_is_told),
        cmocka_unit_test(surfaces_that_slide_come_to_rest),
        cmocka_unit_test(a_mirror_image_only_when_asked),
        cmocka_unit_test(landmarks_start_near),
        cmocka_unit_test(sizes_and_places_do_not_matter),
        cmocka_unit_test(poor_meshes_have_an_answer),
        cmocka_unit_test(min_max_reaches_the_floor_of_boxes),
        cmocka_unit_test(min_max_is_no_farther_than_least_squares),
        cmocka_unit_test(min_max_ends_at_one_place),
        cmocka_unit_test(threads_change_no_bit),
        cmocka_unit_test(balls_hold_the_slow_radius),
        cmocka_unit_test(balls_of_known_surfaces),
        cmocka_unit_test(no_motion_goes_below_the_floor),
        cmocka_unit_test(faults_of_options_are_told),
        cmocka_unit_test(a_raised_flag_ends_it),
        cmocka_unit_test(memory_that_runs_out_is_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
