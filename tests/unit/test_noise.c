/* Reconstruction of points that are off their surface: the noise that is found, the distance of the quads from the true surface by its
 * own formula, what is told, edits, lack of memory. */
#include "check.h"

#include "core/vec.h"
#include "failing_allocator.h"
#include "ground.h"
#include "layouts.h"
#include "qm/quality.h"
#include "qm/reconstruct.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.141592653589793
#define QUADS 6144
#define WAVE 0.12

/* ---- surfaces by formula, and the distance of a point from each ---- */

typedef struct shape {
    const char *name;
    qm_shape_fn *at;
    double (*distance)(const double p[3]);
    int columns, rows;
    bool wraps;
    double diagonal;
} shape;

static double torus_distance(const double p[3])
{
    return fabs(hypot(hypot(p[0], p[1]) - 1.0, p[2]) - 0.35);
}

static void wave_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    out[0] = 2.0 * u - 1.0;
    out[1] = 2.0 * v - 1.0;
    out[2] = WAVE * sin(PI * out[0]) * cos(PI * out[1]);
}

/** Newton steps to the foot over the plane would do; the height over the slope is the same to a hundredth here. */
static double wave_distance(const double p[3])
{
    double sx = sin(PI * p[0]), cx = cos(PI * p[0]), sy = sin(PI * p[1]), cy = cos(PI * p[1]);
    return fabs(p[2] - WAVE * sx * cy) /
           sqrt(1.0 + WAVE * WAVE * PI * PI * (cx * cx * cy * cy + sx * sx * sy * sy));
}

/** A sphere without its caps. */
static void sphere_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    double latitude = 1.2 * (2.0 * v - 1.0), longitude = 2.0 * PI * u;
    out[0] = cos(latitude) * cos(longitude);
    out[1] = cos(latitude) * sin(longitude);
    out[2] = sin(latitude);
}

static double sphere_distance(const double p[3])
{
    return fabs(sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - 1.0);
}

static const shape shapes[] = {{"torus", qm_torus_at, torus_distance, 6, 4, true, 3.8818},
                               {"wave", wave_at, wave_distance, 3, 2, false, 2.8385},
                               {"sphere", sphere_at, sphere_distance, 4, 2, false, 3.3895}};

enum { SHAPES = sizeof shapes / sizeof *shapes };

static qm_layout layout_of(const shape *s)
{
    bool wraps_u = s->wraps || s->at == sphere_at;
    return qm_layout_of_grid(s->columns, s->rows, wraps_u, s->wraps, 24, s->at, NULL);
}

static qm_mesh mesh_surface(const shape *s)
{
    bool wraps_u = s->wraps || s->at == sphere_at;
    return qm_shape_grid(192, 128, wraps_u, s->wraps, s->at, NULL);
}

/** A number of a normal distribution: the sum of twelve even ones. */
static double gauss(qm_random *random)
{
    double sum = -6.0;
    for (int k = 0; k < 12; k++)
        sum += qm_random_range(random, 0.0, 1.0);
    return sum;
}

static void add_noise(qm_mesh *mesh, double sigma, uint64_t stream)
{
    qm_random random = qm_random_make(qm_check_seed(), stream);
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        mesh->positions[i] += sigma * gauss(&random);
}

/* ---- a reconstruction, and what it is off the formula ---- */

typedef struct outcome {
    double noise, rms, greatest; /* shares of the diagonal of the shape */
    size_t folded, warnings[QM_RECONSTRUCTION_WARNING_COUNT];
    double share[QM_RECONSTRUCTION_WARNING_COUNT];
} outcome;

/** Distances at nine points of each quad, bilinear. */
static void measure(const shape *s, const qm_mesh *mesh, outcome *out)
{
    double sum = 0.0;
    out->greatest = 0.0;
    for (size_t face = 0; face < mesh->face_count; face++) {
        const uint32_t *v = mesh->faces + 4 * face;
        for (int k = 0; k < 9; k++) {
            double a = (k % 3) / 3.0 + 1.0 / 6.0, b = (k / 3) / 3.0 + 1.0 / 6.0, p[3];
            for (int axis = 0; axis < 3; axis++) {
                const double *q = mesh->positions + axis;
                p[axis] = (1.0 - b) * ((1.0 - a) * q[3 * (size_t)v[0]] + a * q[3 * (size_t)v[1]]) +
                          b * ((1.0 - a) * q[3 * (size_t)v[3]] + a * q[3 * (size_t)v[2]]);
            }
            double distance = s->distance(p) / s->diagonal;
            sum += distance * distance;
            out->greatest = fmax(out->greatest, distance);
        }
    }
    out->rms = sqrt(sum / (9.0 * (double)mesh->face_count));
    qm_quality quality;
    qm_quality_measure(mesh, &quality);
    out->folded = quality.folded;
}

static void tell(const qm_reconstruction *r, outcome *out)
{
    qm_reconstruction_warning warning[50];
    size_t count = qm_reconstruction_find_warnings(r, warning, 50);
    assert_true(count <= 50);
    for (size_t i = 0; i < count; i++) {
        out->warnings[warning[i].kind]++;
        out->share[warning[i].kind] = warning[i].share;
    }
}

/** Reconstructs a surface, which it takes over. */
static outcome reconstruct(const shape *s, qm_mesh surface, double noise_share, qm_mesh *mesh)
{
    qm_ground g;
    qm_ground_make(&g, surface);
    qm_layout layout = layout_of(s);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    options.noise_share = noise_share;
    qm_reconstruction *r;
    qm_status status = qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r);
    QM_CHECK(status == QM_OK, "%s: %s", s->name, g.ctx.message);
    qm_reconstruction_record record;
    do
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, QUADS, &record), QM_OK);
    while (record.chords_changed > 0);
    qm_mesh found;
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &found), QM_OK);
    outcome out = {.noise = qm_reconstruction_noise(r) / s->diagonal};
    measure(s, &found, &out);
    tell(r, &out);
    if (mesh)
        *mesh = found;
    else
        qm_shape_free(&found);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
    return out;
}

/* ---- the tests ---- */

static void exact_surfaces_are_followed_bit_for_bit(void **state)
{
    (void)state;
    for (int i = 0; i < SHAPES; i++) {
        for (int kind = 0; kind < 2; kind++) {
            qm_mesh mesh[2];
            for (int k = 0; k < 2; k++) {
                qm_mesh surface = kind == 0 ? mesh_surface(&shapes[i])
                                            : qm_ground_sample(shapes[i].at, 20000, 0.0, 40 + (uint64_t)i);
                outcome out = reconstruct(&shapes[i], surface, k == 0 ? QM_NOISE_AUTOMATIC : 0.0, &mesh[k]);
                QM_CHECK(out.noise == 0.0, "%s: noise %g", shapes[i].name, out.noise);
                assert_int_equal(out.warnings[QM_RECONSTRUCTION_NOISE], 0);
            }
            assert_int_equal(mesh[0].vertex_count, mesh[1].vertex_count);
            assert_memory_equal(mesh[0].positions, mesh[1].positions, 24 * mesh[0].vertex_count);
            qm_shape_free(&mesh[0]);
            qm_shape_free(&mesh[1]);
        }
    }
}

/** The noise is found to a quarter, and the rms is a fifth of it and what quads without noise are off. */
static void check_fit(const shape *s, const char *what, const outcome *out, double noise, double exact)
{
    printf("%s, %s, noise %g: found %g, rms %g (%.3f of it), greatest %g, %zu folded\n", s->name, what, noise,
           out->noise, out->rms, out->rms / noise, out->greatest, out->folded);
    QM_CHECK(fabs(out->noise / noise - 1.0) < 0.25, "%s, %s: noise %g, not %g", s->name, what, out->noise,
             noise);
    QM_CHECK(out->rms <= hypot(0.2 * noise, exact), "%s, %s: rms %g of noise %g", s->name, what, out->rms,
             noise);
    QM_CHECK(out->folded == 0, "%s, %s: %zu folded", s->name, what, out->folded);
    assert_int_equal(out->warnings[QM_RECONSTRUCTION_NOISE], 1);
    assert_true(out->share[QM_RECONSTRUCTION_NOISE] > 0.0);
}

static void noise_is_fitted(void **state)
{
    (void)state;
    static const double noises[] = {0.002, 0.005};
    for (int i = 0; i < SHAPES; i++) {
        const shape *s = &shapes[i];
        double exact = reconstruct(s, mesh_surface(s), 0.0, NULL).rms;
        for (int k = 0; k < 2; k++) {
            double sigma = noises[k] * s->diagonal;
            outcome out = reconstruct(s, qm_ground_sample(s->at, 30000, sigma, 50 + (uint64_t)i),
                                      QM_NOISE_AUTOMATIC, NULL);
            check_fit(s, "points", &out, noises[k], exact);
            assert_int_equal(out.warnings[QM_RECONSTRUCTION_NORMALS], 1);
            qm_mesh mesh = mesh_surface(s);
            add_noise(&mesh, sigma, 60 + (uint64_t)i);
            out = reconstruct(s, mesh, QM_NOISE_AUTOMATIC, NULL);
            check_fit(s, "mesh", &out, noises[k], exact);
            assert_int_equal(out.warnings[QM_RECONSTRUCTION_NORMALS], 0);
        }
    }
}

static void noise_may_be_given_or_kept(void **state)
{
    (void)state;
    const shape *s = &shapes[0];
    double noise = 0.005, sigma = noise * s->diagonal;
    outcome kept = reconstruct(s, qm_ground_sample(s->at, 30000, sigma, 70), 0.0, NULL);
    outcome given = reconstruct(s, qm_ground_sample(s->at, 30000, sigma, 70), noise, NULL);
    QM_CHECK(kept.noise == 0.0 && kept.warnings[QM_RECONSTRUCTION_NOISE] == 0, "noise %g", kept.noise);
    QM_CHECK(given.rms <= 0.2 * noise && kept.rms > 2.0 * given.rms, "given %g, kept %g", given.rms,
             kept.rms);
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(8, 0.0));
    qm_layout layout = qm_layout_of_grid(1, 1, false, false, 2, qm_square_at, NULL);
    static const double wrong[] = {-0.5, 0.11, INFINITY, NAN};
    for (int k = 0; k < 4; k++) {
        qm_reconstruction_options options = qm_reconstruction_options_default();
        options.noise_share = wrong[k];
        qm_reconstruction *r;
        assert_int_equal(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r), QM_E_ARGUMENT);
        assert_non_null(strstr(g.ctx.message, "noise"));
    }
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void size_does_not_matter(void **state)
{
    (void)state;
    const shape *s = &shapes[1];
    qm_mesh found[3];
    static const double scales[3] = {1.0, 0x1p300, 0x1p-300};
    for (int k = 0; k < 3; k++) {
        qm_ground g;
        qm_mesh points = qm_ground_sample(s->at, 6000, 0.004 * s->diagonal, 75);
        qm_layout layout = layout_of(s);
        static const double here[3] = {0.0, 0.0, 0.0};
        qm_shape_move(&points, scales[k], here);
        for (size_t i = 0; i < 3 * layout.node_count; i++)
            layout.nodes[i] *= scales[k];
        for (size_t c = 0; c < layout.curve_count; c++)
            for (size_t i = 0; i < 3 * layout.curves[c].point_count; i++)
                layout.curves[c].points[i] *= scales[k];
        qm_ground_make(&g, points);
        qm_reconstruction_options options = qm_reconstruction_options_default();
        qm_reconstruction *r;
        assert_int_equal(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r), QM_OK);
        assert_true(qm_reconstruction_noise(r) > 0.0);
        qm_reconstruction_record record;
        for (int step = 0; step < 5; step++)
            assert_int_equal(qm_reconstruction_step(&g.ctx, r, 400, &record), QM_OK);
        assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &found[k]), QM_OK);
        qm_reconstruction_destroy(&g.ctx, r);
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
    /* Which curves are divided may depend on the unit, where squares of areas overflow. */
    for (int k = 0; k < 3; k++) {
        for (size_t i = 0; i < found[k].vertex_count; i++) {
            double p[3];
            for (size_t axis = 0; axis < 3; axis++)
                p[axis] = found[k].positions[3 * i + axis] / scales[k];
            QM_CHECK(s->distance(p) < 0.01 * s->diagonal, "scale %g, vertex %zu: %g off", scales[k], i,
                     s->distance(p));
        }
    }
    for (int k = 0; k < 3; k++)
        qm_shape_free(&found[k]);
}

static void outliers_and_holes_are_told(void **state)
{
    (void)state;
    const shape *s = &shapes[0];
    for (int k = 0; k < 2; k++) {
        double noise = k == 0 ? 0.0 : 0.003;
        qm_mesh points = qm_ground_sample(s->at, 20000, noise * s->diagonal, 80);
        qm_random random = qm_random_make(qm_check_seed(), 81);
        for (size_t i = 0; i < 200; i++)
            qm_random_point(&random, -1.3, 1.3, points.positions + 300 * i);
        outcome out = reconstruct(s, points, QM_NOISE_AUTOMATIC, NULL);
        /* Most of a hundredth: those near the surface, and among each other near it, may count as points of it. */
        double share = out.share[QM_RECONSTRUCTION_OUTLIERS];
        printf("noise %g: share of outliers %g, rms %g\n", noise, share, out.rms);
        QM_CHECK(share > 0.005 && share <= 0.0105, "noise %g: share of outliers %g", noise, share);
        QM_CHECK(out.rms < 0.001, "noise %g with outliers: rms %g", noise, out.rms);
        assert_int_equal(out.warnings[QM_RECONSTRUCTION_FILLS_HOLE], 0);

        points = qm_ground_sample(s->at, 20000, noise * s->diagonal, 82);
        size_t kept = 0;
        for (size_t i = 0; i < points.vertex_count; i++) {
            const double *p = points.positions + 3 * i;
            if (hypot(hypot(p[0] - 1.0, p[1]), p[2] - 0.35) < 0.2) continue;
            memmove(points.positions + 3 * kept++, p, 24);
        }
        points.vertex_count = kept;
        out = reconstruct(s, points, QM_NOISE_AUTOMATIC, NULL);
        assert_int_equal(out.warnings[QM_RECONSTRUCTION_FILLS_HOLE], 1);
        QM_CHECK(out.share[QM_RECONSTRUCTION_OUTLIERS] <= 0.0005, "noise %g with a hole: %g outliers", noise,
                 out.share[QM_RECONSTRUCTION_OUTLIERS]);
        QM_CHECK(out.greatest < 0.02 && out.folded == 0, "noise %g with a hole: %g", noise, out.greatest);
    }
}

static void an_edit_keeps_the_other_patches(void **state)
{
    (void)state;
    const shape *s = &shapes[1];
    qm_ground g;
    qm_ground_make(&g, qm_ground_sample(s->at, 8000, 0.003 * s->diagonal, 90));
    qm_layout layout = layout_of(s);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r, *edited;
    assert_int_equal(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r), QM_OK);
    assert_true(qm_reconstruction_noise(r) > 0.0);
    qm_reconstruction_record record;
    for (int k = 0; k < 6; k++)
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, 1536, &record), QM_OK);
    uint32_t middle = layout.patches[0].side[1];
    for (size_t k = 1; k + 1 < layout.curves[middle].point_count; k++)
        layout.curves[middle].points[3 * k] +=
            0.08 * sin(PI * (double)k / (double)(layout.curves[middle].point_count - 1));
    size_t redone;
    assert_int_equal(qm_reconstruction_edit(&g.ctx, r, &layout, &edited, &redone), QM_OK);
    assert_int_equal(redone, 2);
    qm_mesh before, after;
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &before), QM_OK);
    qm_reconstruction_destroy(&g.ctx, r);
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, edited, &after), QM_OK);
    size_t moved = 0;
    for (size_t p = 0; p < qm_reconstruction_patch_count(edited); p++) {
        qm_reconstruction_patch patch = qm_reconstruction_get_patch(edited, p);
        for (size_t c = 0; c < 4 * (size_t)patch.columns * patch.rows; c++) {
            size_t corner = 4 * patch.first_face + c;
            bool is_equal = memcmp(before.positions + 3 * (size_t)before.faces[corner],
                                   after.positions + 3 * (size_t)after.faces[corner], 24) == 0;
            moved += !is_equal;
            QM_CHECK(is_equal || p < 2, "patch %zu, corner %zu", p, c);
        }
    }
    assert_true(moved > 0);
    outcome out = {0};
    measure(s, &after, &out);
    QM_CHECK(out.folded == 0 && out.rms < 0.002, "rms %g, %zu folded", out.rms, out.folded);
    qm_shape_free(&before);
    qm_shape_free(&after);
    qm_reconstruction_destroy(&g.ctx, edited);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static qm_status run_once(qm_context *ctx, const qm_ref_surface *source, const qm_layout *layout)
{
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r, *edited = NULL;
    qm_status status = qm_reconstruction_create(ctx, source, layout, &options, &r);
    qm_reconstruction_record record;
    size_t redone;
    if (status == QM_OK) status = qm_reconstruction_step(ctx, r, 64, &record);
    if (status == QM_OK) status = qm_reconstruction_edit(ctx, r, layout, &edited, &redone);
    qm_reconstruction_destroy(ctx, edited);
    qm_reconstruction_destroy(ctx, r);
    return status;
}

static void running_out_of_memory_is_a_status_at_every_place(void **state)
{
    (void)state;
    for (int kind = 0; kind < 2; kind++) {
        qm_ground g;
        qm_mesh mesh = qm_shape_plane(44, 0.0);
        add_noise(&mesh, 0.008, 95);
        if (kind == 1) {
            free(mesh.faces);
            mesh.faces = NULL;
            mesh.face_count = 0;
        }
        qm_ground_make(&g, mesh);
        qm_layout layout = qm_layout_of_grid(1, 1, false, false, 2, qm_square_at, NULL);
        qm_status status = QM_E_NO_MEMORY;
        size_t tries = 0;
        for (size_t fail_at = 0; status != QM_OK; fail_at += 1 + fail_at / 16, tries++) {
            qm_failing_allocator memory = {.fail_at = fail_at};
            qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
            status = run_once(&ctx, &g.source, &layout);
            QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", fail_at, ctx.message);
            QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks", fail_at,
                     memory.live_blocks);
        }
        assert_true(tries > 20);
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exact_surfaces_are_followed_bit_for_bit),
        cmocka_unit_test(noise_is_fitted),
        cmocka_unit_test(noise_may_be_given_or_kept),
        cmocka_unit_test(size_does_not_matter),
        cmocka_unit_test(outliers_and_holes_are_told),
        cmocka_unit_test(an_edit_keeps_the_other_patches),
        cmocka_unit_test(running_out_of_memory_is_a_status_at_every_place),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
