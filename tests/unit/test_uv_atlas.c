/* qm_uv_atlas: the promises of texture coordinates, checked face by face, and files that hold them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "decode.h"
#include "failing_allocator.h"
#include "format/encoder.h"
#include "format/uv_atlas.h"
#include "shapes.h"

typedef struct laid_out {
    qm_patch_set patches;
    qm_uv_atlas atlas;
} laid_out;

static laid_out lay_out(const qm_mesh *mesh)
{
    qm_context ctx = qm_context_make();
    laid_out out;
    assert_int_equal(qm_patch_set_find(&ctx, mesh, &out.patches), QM_OK);
    assert_int_equal(qm_uv_atlas_make(&ctx, mesh, &out.patches, &out.atlas), QM_OK);
    return out;
}

static void drop(laid_out *out)
{
    qm_context ctx = qm_context_make();
    qm_patch_set_reset(&ctx, &out->patches);
    qm_uv_atlas_reset(&ctx, &out->atlas);
}

static const double *uv_of(const qm_uv_atlas *atlas, size_t face, int corner)
{
    return atlas->uv + 2 * (size_t)atlas->mesh.faces[4 * face + (size_t)corner];
}

/** Twice the area of a face in the unit square; positive where its corners run counterclockwise. */
static double area_of(const qm_uv_atlas *atlas, size_t face)
{
    int corners = atlas->mesh.faces[4 * face + 3] == QM_NO_INDEX ? 3 : 4;
    double sum = 0.0;
    for (int k = 0; k < corners; k++) {
        const double *a = uv_of(atlas, face, k), *b = uv_of(atlas, face, (k + 1) % corners);
        sum += a[0] * b[1] - a[1] * b[0];
    }
    return sum;
}

/** The faces are those of the mesh, at the same places. */
static void check_faces(const qm_mesh *mesh, const qm_mesh *apart)
{
    assert_int_equal(mesh->face_count, apart->face_count);
    for (size_t i = 0; i < 4 * mesh->face_count; i++) {
        uint32_t a = mesh->faces[i], b = apart->faces[i];
        assert_true((a == QM_NO_INDEX) == (b == QM_NO_INDEX));
        if (a == QM_NO_INDEX) continue;
        assert_true(b < apart->vertex_count);
        assert_memory_equal(mesh->positions + 3 * (size_t)a, apart->positions + 3 * (size_t)b, 24);
    }
}

/** Quads are squares of one size, with sides along the axes, and triangles halves of these. Returns the side. */
static double check_cells(const qm_uv_atlas *atlas, bool is_oriented)
{
    double side = 0.0;
    for (size_t f = 0; f < atlas->mesh.face_count; f++) {
        bool is_quad = atlas->mesh.faces[4 * f + 3] != QM_NO_INDEX;
        double area = area_of(atlas, f), own = sqrt(fabs(area) / (is_quad ? 2.0 : 1.0));
        if (is_oriented) QM_CHECK(area > 0.0, "face %zu is mirrored", f);
        if (f == 0) side = own;
        QM_CHECK(fabs(own - side) < 1e-9, "face %zu has the side %g, others %g", f, own, side);
        for (int k = 0; k < 4 && is_quad; k++) {
            const double *a = uv_of(atlas, f, k), *b = uv_of(atlas, f, (k + 1) % 4);
            double du = fabs(a[0] - b[0]), dv = fabs(a[1] - b[1]);
            QM_CHECK(fmin(du, dv) < 1e-12 && fabs(fmax(du, dv) - side) < 1e-9, "face %zu, side %d", f, k);
        }
    }
    return side;
}

typedef struct box {
    double low[2], high[2];
} box;

/** No rectangles overlap, and there is half a cell between them and round them, also in single precision. */
static void check_boxes(const laid_out *out, double side)
{
    size_t count = out->patches.patch_count;
    box *boxes = calloc(count, sizeof *boxes);
    assert_non_null(boxes);
    for (size_t p = 0; p < count; p++) {
        const qm_regular_patch *patch = &out->patches.patches[p];
        boxes[p] = (box){{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
        for (size_t k = 0; k < (size_t)patch->rows * patch->columns; k++) {
            size_t face = out->patches.faces[patch->first + k];
            for (int c = 0; c < 4; c++) {
                if (out->atlas.mesh.faces[4 * face + (size_t)c] == QM_NO_INDEX) continue;
                const double *uv = uv_of(&out->atlas, face, c);
                for (int axis = 0; axis < 2; axis++) {
                    boxes[p].low[axis] = fmin(boxes[p].low[axis], (double)(float)uv[axis]);
                    boxes[p].high[axis] = fmax(boxes[p].high[axis], (double)(float)uv[axis]);
                }
            }
        }
        double size[2] = {patch->columns * side, patch->rows * side};
        for (int axis = 0; axis < 2; axis++) {
            QM_CHECK(fabs(boxes[p].high[axis] - boxes[p].low[axis] - size[axis]) < 1e-6, "patch %zu", p);
            QM_CHECK(boxes[p].low[axis] > 0.4 * side && boxes[p].high[axis] < 1.0 - 0.4 * side, "patch %zu",
                     p);
        }
    }
    for (size_t p = 0; p < count; p++)
        for (size_t q = 0; q < p; q++) {
            double apart = -INFINITY;
            for (int axis = 0; axis < 2; axis++)
                apart = fmax(apart, fmax(boxes[p].low[axis] - boxes[q].high[axis],
                                         boxes[q].low[axis] - boxes[p].high[axis]));
            QM_CHECK(apart > 0.4 * side, "patches %zu and %zu are %g cells apart", p, q, apart / side);
        }
    free(boxes);
}

/** All promises; returns how much of the unit square the cells fill. */
static double check_mesh(const qm_mesh *mesh, bool is_oriented)
{
    laid_out out = lay_out(mesh);
    check_faces(mesh, &out.atlas.mesh);
    double side = check_cells(&out.atlas, is_oriented), sum = 0.0;
    check_boxes(&out, side);
    for (size_t f = 0; f < mesh->face_count; f++)
        sum += 0.5 * fabs(area_of(&out.atlas, f));
    drop(&out);
    return sum;
}

static void test_shapes(void **state)
{
    (void)state;
    qm_mesh meshes[] = {qm_shape_torus(30, 20, 1.0, 0.3), qm_shape_saddle(12),
                        qm_shape_strip(40, 3, 2.0),       qm_shape_cube(1.0),
                        qm_shape_plane(1, 0.0),           qm_shape_sphere(0.2)};
    for (size_t i = 0; i < sizeof meshes / sizeof *meshes; i++) {
        double filled = check_mesh(&meshes[i], true);
        QM_CHECK(filled > 0.04 && filled < 1.0, "shape %zu fills %g", i, filled);
        /* Seen from the other side the faces are no mirror images either. */
        qm_mesh reversed = qm_shape_reversed(&meshes[i]);
        check_mesh(&reversed, true);
        qm_shape_free(&reversed);
        qm_shape_free(&meshes[i]);
    }
}

/** Patches of many sizes: boxes of grids that are not connected. */
static void test_many_patches_fill_the_square(void **state)
{
    (void)state;
    qm_mesh all = qm_shape_saddle(3);
    for (int n = 2; n < 30; n++) {
        qm_mesh next = n % 2 ? qm_shape_saddle(n) : qm_shape_strip(3 * n, n / 2, 0.1);
        qm_mesh joined = qm_shape_joined(&all, &next);
        qm_shape_free(&next);
        qm_shape_free(&all);
        all = joined;
    }
    double filled = check_mesh(&all, true);
    QM_CHECK(filled > 0.6, "%g of the square is filled", filled);
    qm_shape_free(&all);
}

static void test_random_soups(void **state)
{
    (void)state;
    for (uint64_t test = 0; test < 40; test++) {
        qm_random random = qm_random_make(qm_check_seed(), test);
        qm_mesh mesh = qm_shape_soup(&random, 1 + test * 5, test % 2 ? QM_SOUP_QUADS : QM_SOUP_MIXED,
                                     (qm_soup_style)(test % QM_SOUP_STYLE_COUNT), 0.3);
        check_mesh(&mesh, false);
        qm_shape_free(&mesh);
    }
}

/** The grids of a file are the patches, turned as they are there: u along the columns. */
static void test_grids_lie_as_they_are(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_saddle(6);
    qm_mesh_grid grids[2] = {{2, 6}, {4, 6}};
    mesh.grids = grids;
    mesh.grid_count = 2;
    laid_out out = lay_out(&mesh);
    assert_int_equal(out.patches.patch_count, 2);
    assert_int_equal(out.atlas.mesh.vertex_count, 3 * 7 + 5 * 7);
    assert_int_equal(out.atlas.mesh.grid_count, 2);
    double side = check_cells(&out.atlas, true);
    for (size_t f = 0; f < mesh.face_count; f++) {
        const double *start = uv_of(&out.atlas, f, 0), *next = uv_of(&out.atlas, f, 1),
                     *up = uv_of(&out.atlas, f, 3);
        QM_CHECK(fabs(next[0] - start[0] - side) < 1e-9 && fabs(up[1] - start[1] - side) < 1e-9, "face %zu",
                 f);
    }
    drop(&out);
    mesh.grids = NULL;
    mesh.grid_count = 0;
    qm_shape_free(&mesh);
}

static void test_what_has_no_patches_is_refused(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_uv_atlas atlas;
    qm_patch_set none = {0};
    qm_random random = qm_random_make(qm_check_seed(), 1);
    qm_mesh points = qm_shape_points(&random, 5);
    assert_int_equal(qm_uv_atlas_make(&ctx, &points, &none, &atlas), QM_E_UNSUPPORTED);
    assert_non_null(strstr(ctx.message, "no quads"));
    qm_shape_free(&points);
    qm_decoded polygon = qm_decode_text(
        QM_FORMAT_OBJ, "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 3 0\nv 0 2 0\nf 1 2 3 4 5\nf 1 2 3 4\n");
    qm_patch_set patches;
    assert_int_equal(qm_patch_set_find(&ctx, &polygon.mesh, &patches), QM_OK);
    assert_int_equal(qm_uv_atlas_make(&ctx, &polygon.mesh, &patches, &atlas), QM_E_UNSUPPORTED);
    assert_non_null(strstr(ctx.message, "five corners"));
    assert_null(atlas.uv);
    qm_patch_set_reset(&ctx, &patches);
    qm_decoded_free(&polygon);
}

/** Writes the file in its blocks and holds its size against the one announced. */
static qm_text write_file(const qm_mesh *mesh, const qm_uv_atlas *atlas, qm_format format)
{
    qm_context ctx = qm_context_make();
    qm_text file = {0};
    qm_mesh_facts facts;
    qm_encoder *encoder;
    uint64_t size;
    assert_int_equal(qm_mesh_find_facts(&ctx, mesh, &facts), QM_OK);
    assert_int_equal(qm_encoder_create(&ctx, mesh, &facts, format, 0, atlas, &encoder), QM_OK);
    while (qm_encoder_next(encoder, &file))
        continue;
    if (qm_encoder_size(encoder, &size)) assert_int_equal(size, file.size);
    assert_int_equal(qm_encoder_losses(encoder).left_out_vertices,
                     format == QM_FORMAT_OBJ ? 0 : facts.unused_vertices);
    qm_encoder_destroy(encoder);
    return file;
}

/** Our readers take such files as the mesh: OBJ as it is, the others with their patches apart. */
static void test_files_are_read(void **state)
{
    (void)state;
    static const qm_format formats[] = {QM_FORMAT_OBJ, QM_FORMAT_PLY, QM_FORMAT_GLB};
    static const double place[3] = {0.0, 0.0, 0.0};
    qm_mesh torus = qm_shape_torus(30, 20, 1.0, 0.3), mesh = qm_shape_with_unused(&torus, 3, place);
    laid_out out = lay_out(&mesh);
    for (size_t i = 0; i < 3; i++) {
        qm_text file = write_file(&mesh, &out.atlas, formats[i]);
        qm_decoded decoded = qm_decode(formats[i], file.data, file.size);
        const qm_mesh *expected = i == 0 ? &mesh : &out.atlas.mesh;
        assert_int_equal(decoded.status, QM_OK);
        assert_int_equal(decoded.mesh.vertex_count, expected->vertex_count);
        assert_int_equal(decoded.mesh.face_count, expected->face_count);
        if (i < 2) {
            assert_memory_equal(decoded.mesh.faces, expected->faces, 16 * expected->face_count);
            assert_memory_equal(decoded.mesh.positions, expected->positions, 24 * expected->vertex_count);
        }
        qm_decoded_free(&decoded);
        qm_text_reset(&file);
    }
    drop(&out);
    qm_shape_free(&torus);
    qm_shape_free(&mesh);
}

static void test_other_formats_refuse_them(void **state)
{
    (void)state;
    static const qm_format others[] = {QM_FORMAT_OFF, QM_FORMAT_STL, QM_FORMAT_DRC, QM_FORMAT_3MF};
    qm_mesh mesh = qm_shape_saddle(3);
    laid_out out = lay_out(&mesh);
    qm_context ctx = qm_context_make();
    qm_mesh_facts facts;
    assert_int_equal(qm_mesh_find_facts(&ctx, &mesh, &facts), QM_OK);
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        qm_encoder *encoder;
        assert_int_equal(qm_encoder_create(&ctx, &mesh, &facts, others[i], 0, &out.atlas, &encoder),
                         QM_E_UNSUPPORTED);
        assert_null(encoder);
    }
    drop(&out);
    qm_shape_free(&mesh);
}

static void test_memory_that_runs_out_is_a_status(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_saddle(4);
    laid_out out = lay_out(&mesh);
    size_t fail_at = 0;
    for (;; fail_at++) {
        qm_failing_allocator failing = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&failing);
        qm_uv_atlas atlas;
        qm_status status = qm_uv_atlas_make(&ctx, &mesh, &out.patches, &atlas);
        qm_uv_atlas_reset(&ctx, &atlas);
        assert_int_equal(failing.live_blocks, 0);
        if (status == QM_OK) break;
        assert_int_equal(status, QM_E_NO_MEMORY);
    }
    assert_int_equal(fail_at, 4);
    drop(&out);
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shapes),
        cmocka_unit_test(test_many_patches_fill_the_square),
        cmocka_unit_test(test_random_soups),
        cmocka_unit_test(test_grids_lie_as_they_are),
        cmocka_unit_test(test_what_has_no_patches_is_refused),
        cmocka_unit_test(test_files_are_read),
        cmocka_unit_test(test_other_formats_refuse_them),
        cmocka_unit_test(test_memory_that_runs_out_is_a_status),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
