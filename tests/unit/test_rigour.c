/*
 * Cases on which a bound, a verdict, a nearest point, a place of contact or a time was wrong once, read from
 * a data folder where there is one (QM_TEST_DATA, or ../shared/data), against the certified reference.
 */
#include "check.h"

#include "data_mesh.h"
#include "measured.h"
#include "qm/collide.h"
#include "wide_farthest.h"

#include <math.h>
#include <stdio.h>

enum { CELLS = 20000, PARTS = 5000 };

typedef struct case_pair {
    qm_context ctx;
    qm_mesh a, b;
} case_pair;

static case_pair read_pair(const char *name)
{
    case_pair pair = {.ctx = qm_context_make()};
    char path[128];
    snprintf(path, sizeof path, "rigour/%s_A.obj", name);
    qm_data_mesh_read(&pair.ctx, path, &pair.a);
    snprintf(path, sizeof path, "rigour/%s_B.obj", name);
    qm_data_mesh_read(&pair.ctx, path, &pair.b);
    return pair;
}

static void free_pair(case_pair *pair)
{
    qm_mesh_reset(&pair->ctx, &pair->a);
    qm_mesh_reset(&pair->ctx, &pair->b);
}

/** The bounds of the distance from a to b that the reference certifies, in the unit of the meshes. */
static void find_distance(const case_pair *pair, qm_quad_reading quads, double *lower, double *upper)
{
    qm_wide_frame frame = qm_wide_frame_make(&pair->a, &pair->b);
    qm_wide_surface a = qm_wide_surface_make(&frame, &pair->a, quads);
    qm_wide_surface b = qm_wide_surface_make(&frame, &pair->b, quads);
    qm_wide_maximum m = qm_wide_farthest(&a, &b, 0x1p-54L, CELLS);
    *lower = (double)(m.lower / frame.scale);
    *upper = (double)(m.upper / frame.scale);
    qm_wide_surface_free(&a);
    qm_wide_surface_free(&b);
}

/** The call that was wrong: from a to b. */
typedef struct known_call {
    const char *name;
    qm_quad_reading quads;
    double tolerance, threshold;
    uint64_t work_limit;
    double known; /* the distance is about this */
} known_call;

static void bounds_hold_the_distance(const known_call *call)
{
    case_pair pair = read_pair(call->name);
    double lower, upper;
    find_distance(&pair, call->quads, &lower, &upper);
    QM_CHECK(upper - lower <= 1e-4 * upper && fabs(lower - call->known) <= 1e-3 * lower,
             "%s: the reference says [%.17g, %.17g]", call->name, lower, upper);
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = QM_A_TO_B;
    options.quads = call->quads;
    options.tolerance = call->tolerance;
    options.work_limit = call->work_limit;
    for (int with_threshold = 0; with_threshold < 2; with_threshold++) {
        options.threshold = with_threshold ? call->threshold : NAN;
        qm_hausdorff_result r = qm_measured(&pair.a, &pair.b, &options);
        QM_CHECK(r.lower <= upper && r.upper >= lower, "%s: [%.17g, %.17g], true in [%.17g, %.17g]",
                 call->name, r.lower, r.upper, lower, upper);
        QM_CHECK(!(r.verdict > 0 && upper <= options.threshold) &&
                     !(r.verdict < 0 && lower > options.threshold),
                 "%s: verdict %d on %.17g, true in [%.17g, %.17g]", call->name, r.verdict, options.threshold,
                 lower, upper);
    }
    free_pair(&pair);
}

static void thin_bent_quad(void **state)
{
    (void)state;
    bounds_hold_the_distance(&(known_call){.name = "twist",
                                           .quads = QM_QUADS_BILINEAR,
                                           .tolerance = 8.9397136231750939e-14,
                                           .threshold = 3e-13,
                                           .known = 5.4555e-13});
}

static void part_on_a_map(void **state)
{
    (void)state;
    bounds_hold_the_distance(&(known_call){.name = "witness_utm",
                                           .tolerance = 1.3669498926543716e-09,
                                           .threshold = 1.31638796862,
                                           .known = 1.3163879686118147});
}

static void part_far_from_the_origin(void **state)
{
    (void)state;
    bounds_hold_the_distance(&(known_call){.name = "witness_offset",
                                           .tolerance = 0.00016009469903371278,
                                           .threshold = 0.32496,
                                           .known = 0.32495846453551802});
}

static void verdict_near_the_threshold(void **state)
{
    (void)state;
    bounds_hold_the_distance(&(known_call){.name = "verdict",
                                           .tolerance = 0.005457207868265551,
                                           .threshold = 1.3681984625955668,
                                           .work_limit = 2,
                                           .known = 1.3681984402160792});
}

/** Reads the one point of a file. */
static void read_point(const char *name, double out[3])
{
    char path[512];
    snprintf(path, sizeof path, "%s/rigour/%s", qm_data_folder(), name);
    FILE *file = fopen(path, "r");
    QM_CHECK(file, "%s is missing", path);
    assert_int_equal(fscanf(file, "%lf %lf %lf", out, out + 1, out + 2), 3);
    fclose(file);
}

/** What each accelerator says of a point of a mesh that is read as patches. */
static void project_by_all(const char *mesh_name, const char *point_name, qm_mesh *mesh, qm_context *ctx,
                           double point[3], double distance[QM_ACCELERATOR_COUNT],
                           uint32_t face[QM_ACCELERATOR_COUNT])
{
    qm_bvh *tree;
    qm_data_mesh_read(ctx, mesh_name, mesh);
    read_point(point_name, point);
    assert_int_equal(qm_bvh_build(ctx, mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    for (int i = 0; i < QM_ACCELERATOR_COUNT; i++) {
        qm_locator locator;
        qm_projection out = {.distance = &distance[i], .face = &face[i]};
        assert_int_equal(qm_locator_build(ctx, tree, NULL, (qm_accelerator)i, &locator), QM_OK);
        assert_int_equal(qm_project_points_with(ctx, &locator, QM_QUADS_BILINEAR, point, 1, 1, &out), QM_OK);
        qm_locator_reset(ctx, &locator);
    }
    qm_bvh_destroy(ctx, tree);
}

static void nearest_point_of_a_thin_bent_quad(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh;
    double point[3], distance[QM_ACCELERATOR_COUNT];
    uint32_t face[QM_ACCELERATOR_COUNT];
    project_by_all("rigour/twist_project.obj", "twist_project.xyz", &mesh, &ctx, point, distance, face);
    qm_wide_frame frame = qm_wide_frame_make(&mesh, NULL);
    qm_wide_surface surface = qm_wide_surface_make(&frame, &mesh, QM_QUADS_BILINEAR);
    qm_wide_distance d = qm_wide_surface_distance(&surface, qm_wide_local(&frame, point), 0x1p-60L);
    double upper = (double)(d.upper / frame.scale);
    for (int i = 0; i < QM_ACCELERATOR_COUNT; i++)
        QM_CHECK(distance[i] <= upper + 1e-13 && face[i] == 0,
                 "accelerator %d: %.17g to face %u, true %.17g to face 0", i, distance[i], face[i], upper);
    qm_wide_surface_free(&surface);
    qm_mesh_reset(&ctx, &mesh);
}

static void accelerators_name_the_same_face(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh;
    double point[3], distance[QM_ACCELERATOR_COUNT];
    uint32_t face[QM_ACCELERATOR_COUNT];
    project_by_all("rigour/acc_509.obj", "acc_509.xyz", &mesh, &ctx, point, distance, face);
    for (int i = 1; i < QM_ACCELERATOR_COUNT; i++)
        QM_CHECK(face[i] == face[0], "accelerator %d names face %u, the boxes %u; %.17g and %.17g", i,
                 face[i], face[0], distance[i], distance[0]);
    qm_mesh_reset(&ctx, &mesh);
}

/** A point of contact lies on both faces, but for the roundings of coordinates. */
static void check_contact(const qm_wide_frame *frame, const qm_wide_surface *surface, uint32_t face,
                          const double point[3])
{
    qm_wide_vec p = qm_wide_local(frame, point);
    qm_wide off = INFINITY;
    double greatest = fmax(fabs(point[0]), fmax(fabs(point[1]), fabs(point[2])));
    for (size_t f = 0; f < surface->count; f++)
        if (surface->facets[f].face == face)
            off = qm_wide_least(off, qm_wide_facet_distance(&surface->facets[f], p, 0x1p-60L, off).upper);
    QM_CHECK((double)(off / frame->scale) <= 0x1p-48 * greatest, "%.17g %.17g %.17g is %g off face %u",
             point[0], point[1], point[2], (double)(off / frame->scale), face);
}

static void contact_of_large_coordinates(void **state)
{
    (void)state;
    case_pair pair = read_pair("contact");
    qm_collide_options options = qm_collide_options_default();
    qm_collision found;
    qm_status status = qm_collide_surfaces(&pair.ctx, &pair.a, &pair.b, &options, &found);
    QM_CHECK(status == QM_OK || status == QM_E_SCALE, "%s", qm_status_code(status));
    qm_wide_frame frame = qm_wide_frame_make(&pair.a, &pair.b);
    qm_wide_surface a = qm_wide_surface_make(&frame, &pair.a, QM_QUADS_TRIANGLES);
    qm_wide_surface b = qm_wide_surface_make(&frame, &pair.b, QM_QUADS_TRIANGLES);
    for (size_t i = 0; i < found.pair_count; i++) {
        qm_contact contact;
        assert_true(qm_collide_contact(&pair.a, &pair.b, &options, found.pairs[i], &contact));
        for (int k = 0; k < 2; k++) {
            check_contact(&frame, &a, found.pairs[i].a, contact.point[k]);
            check_contact(&frame, &b, found.pairs[i].b, contact.point[k]);
        }
    }
    qm_wide_surface_free(&a);
    qm_wide_surface_free(&b);
    qm_collide_reset(&pair.ctx, &found);
    free_pair(&pair);
}

/** Ends by itself within PARTS parts, in every direction. */
static void ends_in_time(const char *name, double share)
{
    case_pair pair = read_pair(name);
    qm_box box = qm_mesh_bounding_box(&pair.a);
    for (int direction = 0; direction < 3; direction++) {
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.direction = (qm_direction)direction;
        options.quads = QM_QUADS_BILINEAR;
        options.tolerance = share * qm_mesh_box_diagonal(&box);
        options.work_limit = PARTS;
        qm_hausdorff_result r = qm_measured(&pair.a, &pair.b, &options);
        QM_CHECK(r.stop != QM_STOP_DEADLINE, "%s, direction %d: [%.17g, %.17g] after %llu parts", name,
                 direction, r.lower, r.upper, (unsigned long long)r.iterations);
    }
    free_pair(&pair);
}

static void one_quad_twisted_by_an_edge_ends(void **state)
{
    (void)state;
    ends_in_time("slow_w1_mode2", 1e-6);
}

static void one_quad_twisted_by_five_edges_ends(void **state)
{
    (void)state;
    ends_in_time("slow_w5_mode2", 1e-6);
}

static void folded_faces_and_their_copy_end(void **state)
{
    (void)state;
    ends_in_time("hd_near-identical_1_4", 1e-6);
}

static void mixed_faces_end(void **state)
{
    (void)state;
    ends_in_time("hd_mixed_2_3645", 1e-8);
}

static void slivers_end(void **state)
{
    (void)state;
    ends_in_time("hd_sliver_2_3214", 3e-14);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(thin_bent_quad),
        cmocka_unit_test(part_on_a_map),
        cmocka_unit_test(part_far_from_the_origin),
        cmocka_unit_test(verdict_near_the_threshold),
        cmocka_unit_test(nearest_point_of_a_thin_bent_quad),
        cmocka_unit_test(accelerators_name_the_same_face),
        cmocka_unit_test(contact_of_large_coordinates),
        cmocka_unit_test(one_quad_twisted_by_an_edge_ends),
        cmocka_unit_test(one_quad_twisted_by_five_edges_ends),
        cmocka_unit_test(folded_faces_and_their_copy_end),
        cmocka_unit_test(mixed_faces_end),
        cmocka_unit_test(slivers_end),
    };
    return qm_data_run_group_tests(tests);
}
