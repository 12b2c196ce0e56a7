/* Meshes written and read back: all that a format can keep comes back bit for bit, and the rest is a warning. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "decode.h"
#include "failing_allocator.h"
#include "format/encoder.h"
#include "shapes.h"

typedef struct written {
    qm_status status;
    qm_encode_losses losses;
    qm_text file;
    char message[QM_MESSAGE_SIZE];
} written;

/** Writes the file in its blocks and holds its size against the one announced. */
static written write_mesh(const qm_mesh *mesh, qm_format format, int bits)
{
    written out = {0};
    qm_context ctx = qm_context_make();
    qm_mesh_facts facts;
    qm_encoder *encoder;
    assert_int_equal(qm_mesh_find_facts(&ctx, mesh, &facts), QM_OK);
    out.status = qm_encoder_create(&ctx, mesh, &facts, format, bits, NULL, &encoder);
    memcpy(out.message, ctx.message, sizeof out.message);
    if (out.status != QM_OK) return out;
    out.losses = qm_encoder_losses(encoder);
    while (qm_encoder_next(encoder, &out.file))
        continue;
    uint64_t size;
    assert_false(out.file.failed);
    if (qm_encoder_size(encoder, &size)) assert_int_equal(size, out.file.size);
    qm_encoder_destroy(encoder);
    return out;
}

static qm_decoded read_back(qm_format format, const written *file)
{
    assert_int_equal(file->status, QM_OK);
    qm_decoded decoded = qm_decode(format, file->file.data, file->file.size);
    assert_int_equal(decoded.status, QM_OK);
    return decoded;
}

static void check_same(const qm_mesh *a, const qm_mesh *b, const char *name)
{
    QM_CHECK(a->vertex_count == b->vertex_count && a->face_count == b->face_count, "%s: counts", name);
    QM_CHECK(memcmp(a->positions, b->positions, 24 * a->vertex_count) == 0, "%s: positions", name);
    QM_CHECK(a->face_count == 0 || memcmp(a->faces, b->faces, 16 * a->face_count) == 0, "%s: faces", name);
    QM_CHECK(!a->face_origin == !b->face_origin, "%s: polygons", name);
    if (a->face_origin)
        QM_CHECK(memcmp(a->face_origin, b->face_origin, 4 * a->face_count) == 0, "%s: polygons", name);
}

static void check_exact(const qm_mesh *mesh, qm_format format)
{
    written file = write_mesh(mesh, format, 0);
    qm_decoded decoded = read_back(format, &file);
    assert_true(file.losses.displacement == 0.0);
    assert_int_equal(file.losses.cut_faces + file.losses.left_out_vertices, 0);
    check_same(mesh, &decoded.mesh, qm_format_name(format));
    qm_decoded_free(&decoded);
    qm_text_reset(&file.file);
}

static void test_text_and_ply_keep_everything(void **state)
{
    (void)state;
    static const qm_format exact[] = {QM_FORMAT_OBJ, QM_FORMAT_PLY, QM_FORMAT_OFF};
    for (uint64_t test = 0; test < 60; test++) {
        qm_random random = qm_random_make(qm_check_seed(), test);
        qm_mesh mesh = qm_shape_soup(&random, 1 + test * 7, (qm_soup_corners)(test % 3),
                                     (qm_soup_style)(test % QM_SOUP_STYLE_COUNT), 0.3);
        for (size_t i = 0; i < 3; i++)
            check_exact(&mesh, exact[i]);
        qm_shape_free(&mesh);
    }
}

static void test_points_stay_points(void **state)
{
    (void)state;
    static const qm_format exact[] = {QM_FORMAT_OBJ, QM_FORMAT_PLY, QM_FORMAT_OFF, QM_FORMAT_XYZ,
                                      QM_FORMAT_PCD};
    qm_random random = qm_random_make(qm_check_seed(), 1000);
    qm_mesh points = qm_shape_points(&random, 500);
    for (size_t i = 0; i < sizeof exact / sizeof *exact; i++)
        check_exact(&points, exact[i]);
    qm_shape_free(&points);
}

static const char polygons_obj[] = "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 3 0\nv 0 2 0\nv 0 0 5\n"
                                   "f 1 2 3 4 5\nf 1 2 6\nf 1 5 4 6\nf 2 3 4 5 1 6\n";

static void test_polygons_come_back_whole(void **state)
{
    (void)state;
    static const qm_format exact[] = {QM_FORMAT_OBJ, QM_FORMAT_PLY, QM_FORMAT_OFF};
    qm_decoded original = qm_decode_text(QM_FORMAT_OBJ, polygons_obj);
    assert_int_equal(original.mesh.polygon_count, 2);
    for (size_t i = 0; i < 3; i++)
        check_exact(&original.mesh, exact[i]);
    qm_decoded_free(&original);
}

/** PLY counts corners in a byte as long as that is enough. */
static void test_a_face_of_many_corners_keeps_them(void **state)
{
    (void)state;
    for (size_t corners = 254; corners <= 257; corners++) {
        qm_text obj = {0};
        for (size_t i = 0; i < corners; i++)
            qm_text_printf(&obj, "v %zu %zu 0\n", i, i * i);
        qm_text_add_string(&obj, "f");
        for (size_t i = 0; i < corners; i++)
            qm_text_printf(&obj, " %zu", i + 1);
        qm_decoded original = qm_decode_text(QM_FORMAT_OBJ, obj.data);
        check_exact(&original.mesh, QM_FORMAT_PLY);
        qm_decoded_free(&original);
        qm_text_reset(&obj);
    }
}

/* ---- formats of single precision ---- */

static double distance(const double *a, const double *b)
{
    return hypot(hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
}

/** The vertex of the mesh that a decoded one was: the nearest, as all lie far apart. */
static uint32_t find_nearest(const qm_mesh *mesh, const double *point, double *least)
{
    uint32_t nearest = 0;
    *least = INFINITY;
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        double d = distance(mesh->positions + 3 * i, point);
        if (d < *least) {
            *least = d;
            nearest = i;
        }
    }
    return nearest;
}

/** A face as the least of its rotations; a quad only by two corners, as its diagonal counts. */
static void turn_face(uint32_t face[4])
{
    bool is_quad = face[3] != QM_NO_INDEX;
    int count = is_quad ? 4 : 3, step = is_quad ? 2 : 1, best = 0;
    for (int i = step; i < count; i += step)
        if (face[i] < face[best]) best = i;
    uint32_t turned[4] = {0, 0, 0, QM_NO_INDEX};
    for (int i = 0; i < count; i++)
        turned[i] = face[(best + i) % count];
    memcpy(face, turned, sizeof turned);
}

static int compare_faces(const void *a, const void *b)
{
    return memcmp(a, b, 16);
}

/** The faces in terms of the original's vertices, in one order. */
static uint32_t *list_faces(const qm_mesh *mesh, const uint32_t *names)
{
    uint32_t *faces = malloc(16 * mesh->face_count);
    for (size_t i = 0; i < 4 * mesh->face_count; i++)
        faces[i] = mesh->faces[i] == QM_NO_INDEX || !names ? mesh->faces[i] : names[mesh->faces[i]];
    for (size_t i = 0; i < mesh->face_count; i++)
        turn_face(faces + 4 * i);
    qsort(faces, mesh->face_count, 16, compare_faces);
    return faces;
}

/** The same faces on vertices of which none, and one nearly, is as far off as the writer says. */
static void check_moved(const qm_mesh *mesh, const qm_mesh *decoded, double displacement, const char *name)
{
    QM_CHECK(mesh->face_count == decoded->face_count, "%s: %zu faces", name, decoded->face_count);
    uint32_t *names = malloc(sizeof *names * decoded->vertex_count);
    double farthest = 0.0;
    for (size_t i = 0; i < decoded->vertex_count; i++) {
        double least;
        names[i] = find_nearest(mesh, decoded->positions + 3 * i, &least);
        farthest = fmax(farthest, least);
    }
    QM_CHECK(farthest <= displacement, "%s: %.17g off, said %.17g", name, farthest, displacement);
    QM_CHECK(farthest >= 0.5 * displacement, "%s: %.17g off, said %.17g", name, farthest, displacement);
    uint32_t *before = list_faces(mesh, NULL), *after = list_faces(decoded, names);
    QM_CHECK(memcmp(before, after, 16 * mesh->face_count) == 0, "%s: other faces", name);
    free(before);
    free(after);
    free(names);
}

static void test_stl_and_glb_round_and_stl_cuts(void **state)
{
    (void)state;
    static const qm_format formats[] = {QM_FORMAT_STL, QM_FORMAT_GLB};
    qm_mesh mesh = qm_shape_sphere(0.1), cut = qm_shape_triangulated(&mesh);
    for (size_t i = 0; i < 2; i++) {
        written file = write_mesh(&mesh, formats[i], 0);
        qm_decoded decoded = read_back(formats[i], &file);
        assert_int_equal(file.losses.cut_faces, i == 0 ? mesh.face_count : 0);
        assert_true(file.losses.displacement > 1e-9 && file.losses.displacement < 1e-6);
        check_moved(i == 0 ? &cut : &mesh, &decoded.mesh, file.losses.displacement,
                    qm_format_name(formats[i]));
        qm_decoded_free(&decoded);
        qm_text_reset(&file.file);
    }
    qm_shape_free(&mesh);
    qm_shape_free(&cut);
}

static void check_draco(const qm_mesh *mesh, int bits)
{
    char name[32];
    snprintf(name, sizeof name, "%d bits", bits);
    written file = write_mesh(mesh, QM_FORMAT_DRC, bits);
    qm_decoded decoded = read_back(QM_FORMAT_DRC, &file);
    assert_int_equal(file.losses.cut_faces + file.losses.left_out_vertices, 0);
    check_moved(mesh, &decoded.mesh, file.losses.displacement, name);
    qm_decoded_free(&decoded);
    qm_text_reset(&file.file);
}

static void test_draco_keeps_quads_and_tells_the_displacement(void **state)
{
    (void)state;
    static const int bits[] = {0, 10, 11, 14, 16, 18, 20, 22, 24};
    double far[3] = {1000.0, -3.0, 0.25};
    qm_mesh mesh = qm_shape_torus(40, 20, 3.0, 1.0), triangles = qm_shape_triangulated(&mesh);
    for (size_t i = 0; i < sizeof bits / sizeof *bits; i++) {
        check_draco(&mesh, bits[i]);
        check_draco(&triangles, bits[i]);
    }
    qm_shape_move(&mesh, 1.0, far);
    for (size_t i = 0; i < sizeof bits / sizeof *bits; i++)
        check_draco(&mesh, bits[i]);
    qm_shape_free(&mesh);
    qm_shape_free(&triangles);
}

/** What its shorter method would drop or split stays, by the other one. */
static void test_draco_keeps_what_is_not_a_manifold(void **state)
{
    (void)state;
    static const char obj[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 0 -1\nv 9 9 9\n"
                              "f 1 2 3\nf 1 2 4\nf 1 2 5\nf 3 3 1\n";
    qm_decoded original = qm_decode_text(QM_FORMAT_OBJ, obj);
    written file = write_mesh(&original.mesh, QM_FORMAT_DRC, 0);
    qm_decoded decoded = read_back(QM_FORMAT_DRC, &file);
    check_same(&original.mesh, &decoded.mesh, "drc");
    qm_decoded_free(&decoded);
    qm_decoded_free(&original);
    qm_text_reset(&file.file);
}

static void test_draco_keeps_polygons_and_points(void **state)
{
    (void)state;
    static const char obj[] =
        "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 3 0\nv 0 2 0\nv -1 2 1\nv -2 1 1\nv -2 0 1\nv 4 0 0\n"
        "f 1 2 3 4 5\nf 1 5 6 7 8\nf 3 2 9\n";
    qm_decoded original = qm_decode_text(QM_FORMAT_OBJ, obj);
    written file = write_mesh(&original.mesh, QM_FORMAT_DRC, 0);
    qm_decoded decoded = read_back(QM_FORMAT_DRC, &file);
    assert_int_equal(decoded.mesh.polygon_count, 2);
    assert_int_equal(decoded.mesh.face_count, original.mesh.face_count);
    qm_decoded_free(&decoded);
    qm_decoded_free(&original);
    qm_text_reset(&file.file);

    static const char points[] = "0 0 0\n1 2 3\n-4 5 0.5\n";
    original = qm_decode_text(QM_FORMAT_XYZ, points);
    file = write_mesh(&original.mesh, QM_FORMAT_DRC, 0);
    decoded = read_back(QM_FORMAT_DRC, &file);
    check_same(&original.mesh, &decoded.mesh, "drc");
    qm_decoded_free(&decoded);
    qm_decoded_free(&original);
    qm_text_reset(&file.file);
}

/** Quads about one vertex, and a polygon about them: most sides of the edges are filed under few vertices. */
static void test_draco_joins_many_faces_at_one_vertex(void **state)
{
    (void)state;
    for (size_t quads = 3; quads <= 60; quads += 19) {
        qm_text obj = {0};
        const size_t corners = 2 * quads;
        qm_text_add_string(&obj, "v 0 0 1\n");
        for (size_t i = 0; i < corners; i++) {
            const double angle = 2.0 * M_PI * (double)i / (double)corners;
            qm_text_printf(&obj, "v %.9f %.9f 0\n", cos(angle), sin(angle));
        }
        for (size_t i = 0; i < quads; i++)
            qm_text_printf(&obj, "f 1 %zu %zu %zu\n", 2 * i + 2, 2 * i + 3, (2 * i + 2) % corners + 2);
        qm_text_add_string(&obj, "f");
        for (size_t i = corners; i > 0; i--)
            qm_text_printf(&obj, " %zu", i + 1);
        qm_text_add_string(&obj, "\n");
        qm_decoded original = qm_decode(QM_FORMAT_OBJ, obj.data, obj.size);
        written file = write_mesh(&original.mesh, QM_FORMAT_DRC, 0);
        qm_decoded decoded = read_back(QM_FORMAT_DRC, &file);
        size_t found = 0;
        for (size_t i = 0; i < decoded.mesh.face_count; i++)
            found += decoded.mesh.faces[4 * i + 3] != QM_NO_INDEX;
        assert_int_equal(found, quads);
        assert_int_equal(decoded.mesh.polygon_count, 1);
        assert_int_equal(decoded.mesh.face_count, original.mesh.face_count);
        qm_decoded_free(&decoded);
        qm_decoded_free(&original);
        qm_text_reset(&file.file);
        qm_text_reset(&obj);
    }
}

/* ---- what cannot be written ---- */

static void check_refused(const char *text, qm_format from, qm_format to, qm_status status, const char *words)
{
    qm_decoded original = qm_decode_text(from, text);
    written file = write_mesh(&original.mesh, to, 0);
    QM_CHECK(file.status == status, "%s: %s", qm_format_name(to), qm_status_code(file.status));
    QM_CHECK(strstr(file.message, words), "%s: %s", qm_format_name(to), file.message);
    qm_decoded_free(&original);
}

static void test_what_a_format_cannot_hold_is_refused(void **state)
{
    (void)state;
    static const char far[] = "v 0 0 0\nv 1e39 0 0\nv 0 1 0\nf 1 2 3\n";
    check_refused("0 0 0\n1 1 1\n", QM_FORMAT_XYZ, QM_FORMAT_STL, QM_E_UNSUPPORTED, "points");
    check_refused(polygons_obj, QM_FORMAT_OBJ, QM_FORMAT_XYZ, QM_E_UNSUPPORTED, "faces");
    check_refused(polygons_obj, QM_FORMAT_OBJ, QM_FORMAT_PCD, QM_E_UNSUPPORTED, "faces");
    check_refused(far, QM_FORMAT_OBJ, QM_FORMAT_STL, QM_E_SCALE, "vertex 1");
    check_refused(far, QM_FORMAT_OBJ, QM_FORMAT_GLB, QM_E_SCALE, "vertex 1");
    check_refused(far, QM_FORMAT_OBJ, QM_FORMAT_DRC, QM_E_SCALE, "vertex 1");
}

static void test_memory_that_runs_out_is_a_status(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_saddle(4);
    qm_context plain = qm_context_make();
    qm_mesh_facts facts;
    assert_int_equal(qm_mesh_find_facts(&plain, &mesh, &facts), QM_OK);
    size_t failures = 0;
    for (size_t fail_at = 0;; fail_at++) {
        qm_failing_allocator failing = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&failing);
        qm_encoder *encoder;
        qm_status status = qm_encoder_create(&ctx, &mesh, &facts, QM_FORMAT_DRC, 12, NULL, &encoder);
        if (status == QM_OK) qm_encoder_destroy(encoder);
        assert_int_equal(failing.live_blocks, 0);
        if (status == QM_OK) break;
        assert_int_equal(status, QM_E_NO_MEMORY);
        failures++;
    }
    assert_int_equal(failures, 4);
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_text_and_ply_keep_everything),
        cmocka_unit_test(test_points_stay_points),
        cmocka_unit_test(test_polygons_come_back_whole),
        cmocka_unit_test(test_a_face_of_many_corners_keeps_them),
        cmocka_unit_test(test_stl_and_glb_round_and_stl_cuts),
        cmocka_unit_test(test_draco_keeps_quads_and_tells_the_displacement),
        cmocka_unit_test(test_draco_keeps_what_is_not_a_manifold),
        cmocka_unit_test(test_draco_keeps_polygons_and_points),
        cmocka_unit_test(test_draco_joins_many_faces_at_one_vertex),
        cmocka_unit_test(test_what_a_format_cannot_hold_is_refused),
        cmocka_unit_test(test_memory_that_runs_out_is_a_status),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
