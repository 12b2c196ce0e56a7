/*
 * Files to meshes that are ready for questions, and the Hausdorff adapter on top of them.
 */
#include <math.h>
#include <string.h>

#include "check.h"
#include "failing_allocator.h"
#include "ops/job_kinds.h"

static const qm_codec_limits limits = {1000000, 1000000, 1, 0, NULL};
static const qm_preparation everything = {.has_facts = true, .parts = QM_BVH_ALL, .thread_count = 1};

static const char cube[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
                           "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

static qm_status load(qm_context *ctx, qm_format format, const char *text, qm_loaded_mesh *out,
                      qm_codec_report *report)
{
    return qm_mesh_load(ctx, format, (const uint8_t *)text, strlen(text), &limits, &everything, out, report);
}

static void a_cube_is_ready(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_loaded_mesh mesh;
    qm_codec_report report;
    assert_int_equal(load(&ctx, QM_FORMAT_UNKNOWN, cube, &mesh, &report), QM_OK);
    assert_int_equal(mesh.format, QM_FORMAT_OBJ);
    assert_int_equal(mesh.file_size, strlen(cube));
    assert_int_equal(mesh.mesh.vertex_count, 8);
    assert_int_equal(mesh.facts.quads, 6);
    assert_int_equal(mesh.facts.irregular_vertices, 8);
    assert_true(mesh.facts.manifold);
    assert_true(fabs(mesh.diagonal - sqrt(3.0)) < 1e-15);
    assert_ptr_equal(qm_bvh_mesh(mesh.bvh)->positions, mesh.mesh.positions);
    assert_string_equal(qm_loaded_mesh_kind(&mesh), "quads");
    assert_int_equal(mesh.warning_count, 0);
    assert_true(mesh.parse_ms >= 0 && mesh.topology_ms >= 0 && mesh.bvh_ms >= 0);
    assert_true(qm_loaded_mesh_memory_size(&mesh) > 8 * 3 * sizeof(double) + 6 * 4 * sizeof(uint32_t));
    qm_loaded_mesh_reset(&ctx, &mesh);
    assert_null(mesh.bvh);
    assert_null(mesh.warnings);
}

/** A file and what its kind and counts of input faces are. */
typedef struct kind_case {
    const char *text, *kind;
    size_t triangles, quads, polygons;
} kind_case;

static void kinds_are_told_apart(void **state)
{
    (void)state;
    static const kind_case cases[] = {
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "triangles", 1, 0, 0},
        {"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n", "quads", 0, 1, 0},
        {"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 2 0\nf 1 2 3 4\nf 2 5 3\n", "mixed", 1, 1, 0},
        {"v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv 0 1 0\nf 1 2 3 4 5\n", "triangles", 0, 0, 1},
        {"v 0 0 0\nv 1 2 3\n", "points", 0, 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        qm_context ctx = qm_context_make();
        qm_loaded_mesh mesh;
        qm_codec_report report;
        QM_CHECK(load(&ctx, QM_FORMAT_OBJ, cases[i].text, &mesh, &report) == QM_OK, "%s: %s", cases[i].text,
                 report.detail);
        QM_CHECK(strcmp(qm_loaded_mesh_kind(&mesh), cases[i].kind) == 0, "%s: %s", cases[i].text,
                 qm_loaded_mesh_kind(&mesh));
        assert_int_equal(mesh.facts.triangles, cases[i].triangles);
        assert_int_equal(mesh.facts.quads, cases[i].quads);
        assert_int_equal(mesh.facts.polygons, cases[i].polygons);
        qm_loaded_mesh_reset(&ctx, &mesh);
    }
}

static bool warns(const qm_loaded_mesh *mesh, const char *words)
{
    for (size_t i = 0; i < mesh->warning_count; i++)
        if (strstr(mesh->warnings[i], words)) return true;
    return false;
}

static void odd_meshes_come_with_warnings(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_loaded_mesh mesh;
    qm_codec_report report;
    assert_int_equal(load(&ctx, QM_FORMAT_OBJ,
                          "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nv 9 9 9\n"
                          "f 1 2 3\nf 1 2 4\nf 1 2 5\nf 3 3 4\n",
                          &mesh, &report),
                     QM_OK);
    assert_true(warns(&mesh, "no face uses: 1 "));
    assert_true(warns(&mesh, "twice"));
    assert_true(warns(&mesh, "three faces or more"));
    qm_loaded_mesh_reset(&ctx, &mesh);
}

/** A file that is refused, the status, and the line of the fault. */
typedef struct refusal {
    const char *text;
    qm_status status;
    size_t line;
} refusal;

#define STRIP_START(vertices, faces, grids)                                                                  \
    "ply\nformat ascii 1.0\n" grids "element vertex " vertices                                               \
    "\nproperty double x\nproperty double y\nproperty double z\nelement face " faces                         \
    "\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n2 0 0\n0 1 0\n1 1 0\n2 1 0\n"
#define STRIP_FACES "4 0 1 4 3\n4 1 2 5 4\n"

/** Two adjacent quads are one patch, or the patches of the file: not with a third quad at their edge. */
static void told_grids_are_believed_where_they_can_be(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        size_t patches;
    } cases[] = {
        {STRIP_START("6", "2", "") STRIP_FACES, 1},
        {STRIP_START("6", "2", "comment grid 1 2\n") STRIP_FACES, 1},
        {STRIP_START("6", "2", "comment grid 1 1\ncomment grid 1 1\n") STRIP_FACES, 2},
        {STRIP_START("6", "2", "comment grid 2 1\n") STRIP_FACES, 1},
        {STRIP_START("8", "3", "comment grid 1 2\ncomment grid 1 1\n") "1 0 1\n1 1 1\n" STRIP_FACES
                                                                       "4 1 4 7 6\n",
         3},
    };
    qm_preparation preparation = everything;
    preparation.has_patches = true;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        qm_context ctx = qm_context_make();
        qm_loaded_mesh mesh;
        qm_codec_report report;
        const uint8_t *bytes = (const uint8_t *)cases[i].text;
        QM_CHECK(qm_mesh_load(&ctx, QM_FORMAT_PLY, bytes, strlen(cases[i].text), &limits, &preparation, &mesh,
                              &report) == QM_OK,
                 "case %zu: %s", i, report.detail);
        QM_CHECK(mesh.patches.patch_count == cases[i].patches, "case %zu: %zu patches", i,
                 mesh.patches.patch_count);
        assert_null(mesh.mesh.grids);
        qm_loaded_mesh_reset(&ctx, &mesh);
    }
}

static void bad_files_name_the_place(void **state)
{
    (void)state;
    static const refusal cases[] = {
        {"", QM_E_EMPTY, 1},
        {"# nothing\n", QM_E_UNSUPPORTED, QM_NO_LOCATION},
        {"What is this?\n", QM_E_UNSUPPORTED, QM_NO_LOCATION},
        {"v 0 0 0\nv 1 0 nan\n", QM_E_NOT_FINITE, 2},
        {"v 0 0 0\nv 1 0 0\nf 1 2 3\n", QM_E_INDEX, 3},
        {"v 0 0 0\nv 1 0\n", QM_E_FORMAT, 2},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        qm_context ctx = qm_context_make();
        qm_loaded_mesh mesh;
        qm_codec_report report;
        qm_status status = load(&ctx, QM_FORMAT_UNKNOWN, cases[i].text, &mesh, &report);
        QM_CHECK(status == cases[i].status, "%s: %s", cases[i].text, qm_status_code(status));
        QM_CHECK(report.line == cases[i].line, "%s: line %zu", cases[i].text, report.line);
        assert_true(report.detail[0]);
        assert_null(mesh.bvh);
        assert_null(mesh.mesh.positions);
    }
}

static void running_out_of_memory_leaves_nothing_behind(void **state)
{
    (void)state;
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&memory);
        qm_loaded_mesh mesh;
        qm_codec_report report;
        status = load(&ctx, QM_FORMAT_OBJ, cube, &mesh, &report);
        if (status == QM_OK)
            qm_loaded_mesh_reset(&ctx, &mesh);
        else
            QM_CHECK(status == QM_E_NO_MEMORY && report.detail[0], "call %zu: %s", fail_at,
                     qm_status_code(status));
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu left %zu blocks", fail_at,
                 memory.live_blocks);
    }
}

static void a_raised_flag_stops_the_loading(void **state)
{
    (void)state;
    atomic_bool cancel = true;
    qm_context ctx = qm_context_make();
    ctx.cancel = &cancel;
    qm_loaded_mesh mesh;
    qm_codec_report report;
    assert_int_equal(load(&ctx, QM_FORMAT_OBJ, cube, &mesh, &report), QM_E_CANCELED);
    assert_null(mesh.bvh);
}

/** The witness names faces of the input: the pentagon is face 0 of the file and a fan of three inside. */
static void a_witness_counts_the_faces_of_the_file(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_loaded_mesh a, b;
    qm_codec_report report;
    assert_int_equal(load(&ctx, QM_FORMAT_OBJ,
                          "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv 0 1 0\nv 8 0 5\nv 9 0 5\nv 8 1 5\n"
                          "f 1 2 3 4 5\nf 6 7 8\n",
                          &a, &report),
                     QM_OK);
    assert_int_equal(
        load(&ctx, QM_FORMAT_OBJ, "v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nf 1 2 3 4\n", &b, &report), QM_OK);
    qm_job_request request = qm_job_request_default();
    request.direction = QM_A_TO_B;
    qm_job_result result;
    assert_int_equal(qm_job_execute(&ctx, &request, &a, &b, NULL, NULL, &result), QM_OK);
    assert_int_equal(result.hausdorff.stop, QM_STOP_CONVERGED);
    assert_true(result.hausdorff.lower <= 5.0 && result.hausdorff.upper >= 5.0);
    assert_true(result.tolerance == request.tolerance * a.diagonal);
    assert_int_equal(result.from_face, 1);
    assert_int_equal(result.to_face, 0);
    qm_loaded_mesh_reset(&ctx, &a);
    qm_loaded_mesh_reset(&ctx, &b);
}

static void a_point_has_an_absolute_tolerance(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_loaded_mesh a, b;
    qm_codec_report report;
    assert_int_equal(load(&ctx, QM_FORMAT_XYZ, "1 2 3\n", &a, &report), QM_OK);
    assert_int_equal(load(&ctx, QM_FORMAT_XYZ, "1 2 5\n", &b, &report), QM_OK);
    qm_job_request request = qm_job_request_default();
    qm_job_result result;
    assert_int_equal(qm_job_execute(&ctx, &request, &a, &b, NULL, NULL, &result), QM_OK);
    assert_true(result.tolerance == request.tolerance);
    assert_true(result.hausdorff.lower <= 2.0 && result.hausdorff.upper >= 2.0);
    assert_true(result.hausdorff.upper - result.hausdorff.lower <= result.tolerance);
    qm_loaded_mesh_reset(&ctx, &a);
    qm_loaded_mesh_reset(&ctx, &b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_is_ready),
        cmocka_unit_test(kinds_are_told_apart),
        cmocka_unit_test(odd_meshes_come_with_warnings),
        cmocka_unit_test(told_grids_are_believed_where_they_can_be),
        cmocka_unit_test(bad_files_name_the_place),
        cmocka_unit_test(running_out_of_memory_leaves_nothing_behind),
        cmocka_unit_test(a_raised_flag_stops_the_loading),
        cmocka_unit_test(a_witness_counts_the_faces_of_the_file),
        cmocka_unit_test(a_point_has_an_absolute_tolerance),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
