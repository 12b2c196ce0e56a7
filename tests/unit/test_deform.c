/* Refitting: the same as refitting everything, the same answers as trees built from scratch. */
#include "check.h"

#include "base/host.h"
#include "bvh/bvh_demand.h"
#include "bvh/kernel.h"
#include "bvh/tetra_tree.h"
#include "failing_allocator.h"
#include "qm/deform.h"
#include "qm/project.h"
#include "random.h"
#include "shapes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { POINT_COUNT = 50 };

/** A mesh, what lies over it, and how it is followed. */
typedef struct body {
    qm_context ctx;
    qm_mesh mesh; /* as it is now */
    qm_bvh *tree;
    qm_patch_set patches;
    qm_tetra *tetra; /* NULL for a point set */
    qm_deformer *deformer;
} body;

static body body_make(qm_mesh mesh)
{
    body b = {.ctx = qm_context_make(), .mesh = mesh};
    assert_int_equal(qm_bvh_build(&b.ctx, &mesh, QM_BVH_ALL, 1, &b.tree), QM_OK);
    if (mesh.face_count > 0) {
        assert_int_equal(qm_patch_set_find(&b.ctx, &mesh, &b.patches), QM_OK);
        assert_int_equal(qm_tetra_build(&b.ctx, b.tree, &b.patches, &b.tetra), QM_OK);
    }
    assert_int_equal(qm_deformer_build(&b.ctx, b.tree, &b.deformer), QM_OK);
    return b;
}

static void body_free(body *b)
{
    qm_deformer_destroy(&b->ctx, b->deformer);
    qm_tetra_destroy(&b->ctx, b->tetra);
    qm_patch_set_reset(&b->ctx, &b->patches);
    qm_bvh_destroy(&b->ctx, b->tree);
    qm_shape_free(&b->mesh);
}

/** Follows the mesh after these vertices have moved, NULL for all; returns the boxes and radii found. */
static size_t follow(body *b, const uint32_t *vertices, size_t count)
{
    uint32_t *faces = NULL;
    size_t face_count = 0, boxes = 0, radii = 0;
    for (size_t i = 0; i < b->tree->pack_count; i++) { /* as of before: they must not stay so */
        qm_pack spare;
        qm_bvh_pack(b->tree, i, &spare);
        qm_bvh_float_pack(b->tree, i);
        if (qm_bvh_has_twists(b->tree)) qm_bvh_twists(b->tree, i);
    }
    if (vertices)
        assert_int_equal(qm_deformer_find_faces(&b->ctx, b->deformer, vertices, count, &faces, &face_count),
                         QM_OK);
    bool is_nothing = vertices && face_count == 0;
    const uint32_t nothing = 0, *list = is_nothing ? &nothing : faces;
    assert_int_equal(qm_bvh_refit(&b->ctx, b->tree, b->deformer, &b->mesh, list, face_count, 1, &boxes),
                     QM_OK);
    if (b->tetra) assert_int_equal(qm_tetra_refit(&b->ctx, b->tetra, list, face_count, &radii), QM_OK);
    qm_context_free(&b->ctx, faces, face_count, sizeof *faces);
    return boxes + radii;
}

static void check_boxes(const qm_box_tree *a, const qm_box_tree *b)
{
    for (int level = 1; level <= a->level_count; level++)
        assert_memory_equal(a->groups[level], b->groups[level],
                            a->group_count[level] * sizeof *a->groups[level]);
}

/** Two bodies of the same mesh: the same boxes, radii and triangles. */
static void check_same(body *a, body *b)
{
    check_boxes(&a->tree->boxes, &b->tree->boxes);
    assert_true(a->tree->reach == b->tree->reach);
    for (size_t i = 0; i < a->tree->pack_count; i++) {
        qm_pack spare[2];
        assert_memory_equal(qm_bvh_pack(a->tree, i, &spare[0]), qm_bvh_pack(b->tree, i, &spare[1]),
                            sizeof(qm_pack));
        assert_memory_equal(qm_bvh_float_pack(a->tree, i), qm_bvh_float_pack(b->tree, i),
                            sizeof(qm_float_pack));
        if (qm_bvh_has_twists(a->tree))
            assert_memory_equal(qm_bvh_twists(a->tree, i), qm_bvh_twists(b->tree, i), sizeof(qm_pack_twists));
    }
    if (!a->tetra) return;
    check_boxes(&a->tetra->boxes, &b->tetra->boxes);
    for (size_t i = 0; i < a->tetra->node_count; i++)
        QM_CHECK(a->tetra->nodes[i].radius == b->tetra->nodes[i].radius, "node %zu: %.9g and %.9g", i,
                 (double)a->tetra->nodes[i].radius, (double)b->tetra->nodes[i].radius);
}

static void project(body *b, qm_locator locator, qm_quad_reading reading, const double *points,
                    double distance[POINT_COUNT])
{
    qm_projection out = {.distance = distance};
    assert_int_equal(qm_project_points_with(&b->ctx, &locator, reading, points, POINT_COUNT, 1, &out), QM_OK);
}

/** Nearest points by the refitted boxes and tetrahedra, and by a tree built from scratch. */
static void check_answers(body *b, qm_random *random)
{
    qm_bvh *fresh;
    assert_int_equal(qm_bvh_build(&b->ctx, &b->mesh, QM_BVH_ALL, 1, &fresh), QM_OK);
    double points[3 * POINT_COUNT], expected[POINT_COUNT], boxes[POINT_COUNT], tetra[POINT_COUNT];
    qm_box box = qm_mesh_bounding_box(&b->mesh);
    double size = qm_mesh_box_diagonal(&box);
    size = size > 0.0 ? size : 1.0;
    for (int i = 0; i < 3 * POINT_COUNT; i++)
        points[i] = 0.5 * (box.min[i % 3] + box.max[i % 3]) + qm_random_range(random, -1.0, 1.0) * size;
    for (int reading = 0; reading < 2; reading++) {
        qm_quad_reading quads = (qm_quad_reading)reading;
        project(b, (qm_locator){.bvh = fresh}, quads, points, expected);
        project(b, (qm_locator){.bvh = b->tree}, quads, points, boxes);
        if (b->tetra)
            project(b, (qm_locator){.bvh = b->tree, .tetra = b->tetra}, quads, points, tetra);
        else
            memcpy(tetra, boxes, sizeof tetra);
        for (int i = 0; i < POINT_COUNT; i++)
            QM_CHECK(fabs(boxes[i] - expected[i]) <= 1e-12 * size &&
                         fabs(tetra[i] - expected[i]) <= 1e-12 * size,
                     "reading %d, point %d: boxes %.17g, tetra %.17g, from scratch %.17g", reading, i,
                     boxes[i], tetra[i], expected[i]);
    }
    qm_bvh_destroy(&b->ctx, fresh);
}

static qm_mesh draw_mesh(qm_random *random, uint64_t stream)
{
    switch (stream % 5) {
    case 0:
        return qm_shape_torus(40, 30, 2.0, 0.5);
    case 1:
        return qm_shape_plane(25, 0.0);
    case 2:
        return qm_shape_points(random, 400);
    default:
        return qm_shape_soup(random, 1 + qm_random_below(random, 300), QM_SOUP_MIXED,
                             (qm_soup_style)(stream % QM_SOUP_STYLE_COUNT), 0.5);
    }
}

static void move_vertex(qm_mesh *mesh, qm_random *random, uint32_t vertex, double amount)
{
    for (int k = 0; k < 3; k++)
        mesh->positions[3 * (size_t)vertex + (size_t)k] += qm_random_range(random, -amount, amount);
}

static void following_some_vertices_is_following_all(void **state)
{
    (void)state;
    for (uint64_t stream = 0; stream < 60; stream++) {
        qm_random random = qm_random_make(qm_check_seed(), stream);
        qm_mesh mesh = draw_mesh(&random, stream);
        body one = body_make(qm_shape_copy(&mesh)), all = body_make(mesh);
        for (int round = 0; round < 4; round++) {
            uint32_t moved[20];
            size_t count = qm_random_below(&random, 20);
            for (size_t i = 0; i < count; i++) {
                moved[i] = (uint32_t)qm_random_below(&random, one.mesh.vertex_count);
                move_vertex(&one.mesh, &random, moved[i], 0.02);
            }
            memcpy(all.mesh.positions, one.mesh.positions, 24 * one.mesh.vertex_count);
            size_t some = follow(&one, moved, count), every = follow(&all, NULL, 0);
            if (memcmp(&one.tree->frame, &all.tree->frame, sizeof one.tree->frame) == 0) {
                QM_CHECK(some <= every, "%zu updates for some, %zu for all", some, every);
                check_same(&one, &all);
            }
            check_answers(&one, &random);
        }
        body_free(&one);
        body_free(&all);
    }
}

static void standing_still_changes_nothing(void **state)
{
    (void)state;
    body built = body_make(qm_shape_torus(50, 31, 2.0, 0.5)),
         refitted = body_make(qm_shape_torus(50, 31, 2.0, 0.5));
    follow(&refitted, NULL, 0);
    check_same(&built, &refitted);
    const uint32_t vertex = 7;
    assert_int_equal(follow(&refitted, &vertex, 0), 0);
    assert_true(follow(&refitted, &vertex, 1) < 60);
    check_same(&built, &refitted);
    body_free(&built);
    body_free(&refitted);
}

static void meshes_may_leave_their_frame(void **state)
{
    (void)state;
    static const double scales[] = {1e-6, 1e6, 1e-150, 1e100};
    for (int i = 0; i < 4; i++) {
        qm_random random = qm_random_make(qm_check_seed(), 500 + (uint64_t)i);
        body b = body_make(qm_shape_torus(20, 12, 2.0, 0.5));
        const double shift[3] = {3.0 * scales[i], -scales[i], 0.0};
        qm_shape_move(&b.mesh, scales[i], shift);
        follow(&b, NULL, 0);
        check_answers(&b, &random);
        const uint32_t far = 3;
        b.mesh.positions[3 * far] += 100.0 * scales[i];
        follow(&b, &far, 1);
        check_answers(&b, &random);
        body_free(&b);
    }
}

/** A vertex that goes far off takes the frame with it, and gives it back when it returns: otherwise all
 * distances would be rounded to the coordinates of that place. */
static void frames_follow_vertices_that_return(void **state)
{
    (void)state;
    for (uint64_t stream = 0; stream < 8; stream++) {
        qm_random random = qm_random_make(qm_check_seed(), stream);
        qm_mesh mesh = draw_mesh(&random, stream);
        body there = body_make(qm_shape_copy(&mesh)), built = body_make(mesh);
        const uint32_t far = there.mesh.faces ? there.mesh.faces[0] : 0;
        there.mesh.positions[3 * far] += 1e12;
        follow(&there, &far, 1);
        there.mesh.positions[3 * far] = built.mesh.positions[3 * far];
        follow(&there, &far, 1);
        assert_true(there.tree->frame.scale == built.tree->frame.scale);
        check_answers(&there, &random);
        body_free(&there);
        body_free(&built);
    }
}

static void threads_find_the_same(void **state)
{
    (void)state;
    body one = body_make(qm_shape_torus(300, 200, 2.0, 0.5)),
         two = body_make(qm_shape_torus(300, 200, 2.0, 0.5));
    qm_random random = qm_random_make(qm_check_seed(), 0);
    qm_shape_shake(&one.mesh, &random, 0.01);
    memcpy(two.mesh.positions, one.mesh.positions, 24 * one.mesh.vertex_count);
    follow(&one, NULL, 0);
    size_t updated;
    two.ctx.parallel = qm_host_parallel;
    assert_int_equal(qm_bvh_refit(&two.ctx, two.tree, two.deformer, &two.mesh, NULL, 0, 3, &updated), QM_OK);
    assert_int_equal(qm_tetra_refit(&two.ctx, two.tetra, NULL, 0, &updated), QM_OK);
    check_same(&one, &two);
    body_free(&one);
    body_free(&two);
}

/** The boxes of packs one by one, and of the groups from them, must be those found group by group. */
static void check_groups(body *b, const qm_kernel *kernel)
{
    const qm_box_tree *boxes = &b->tree->boxes;
    size_t groups = boxes->group_count[1], parents = boxes->level_count > 1 ? boxes->group_count[2] : 0;
    size_t group_size = groups * sizeof *boxes->groups[1], parent_size = parents * sizeof *boxes->groups[2];
    for (size_t pack = 0; pack < b->tree->pack_count; pack++) {
        const qm_pack_lanes *lanes = &b->tree->lanes[pack];
        kernel->fit_box(b->tree, pack, lanes->vertex, lanes->vertex_count);
    }
    qm_box_tree_fill(&b->tree->boxes, 2);
    qm_box_node *expected = malloc(group_size + parent_size);
    assert_non_null(expected);
    memcpy(expected, boxes->groups[1], group_size);
    if (parents > 0) memcpy(expected + groups, boxes->groups[2], parent_size);
    memset(boxes->groups[1], 0, group_size);
    if (parents > 0) memset(boxes->groups[2], 0, parent_size);
    kernel->fit_nodes(b->tree, b->deformer, groups / 2, groups);
    kernel->fit_nodes(b->tree, b->deformer, 0, groups / 2);
    assert_memory_equal(boxes->groups[1], expected, group_size);
    if (parents > 0) assert_memory_equal(boxes->groups[2], expected + groups, parent_size);
    free(expected);
}

static void groups_are_fitted_like_packs(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 1000);
    const qm_mesh meshes[] = {qm_shape_torus(150, 101, 2.0, 0.5), qm_shape_plane(2, 0.0),
                              qm_shape_points(&random, 901),
                              qm_shape_soup(&random, 700, QM_SOUP_MIXED, QM_SOUP_POOLED, 0.5)};
    for (size_t i = 0; i < sizeof meshes / sizeof *meshes; i++) {
        body b = body_make(meshes[i]);
        qm_shape_shake(&b.mesh, &random, 0.01);
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++)
            check_groups(&b, *kernel);
        body_free(&b);
    }
}

static void unknown_vertices_are_named(void **state)
{
    (void)state;
    body b = body_make(qm_shape_plane(3, 0.0));
    const uint32_t vertices[] = {2, 16};
    uint32_t *faces;
    size_t count;
    assert_int_equal(qm_deformer_find_faces(&b.ctx, b.deformer, vertices, 2, &faces, &count), QM_E_INDEX);
    assert_string_equal(b.ctx.message, "entry 1 names vertex 16, the mesh has 16");
    assert_null(faces);
    body_free(&b);
}

static void without_memory_nothing_changes(void **state)
{
    (void)state;
    body b = body_make(qm_shape_torus(20, 12, 2.0, 0.5)),
         untouched = body_make(qm_shape_torus(20, 12, 2.0, 0.5));
    const uint32_t faces[] = {1, 2};
    qm_status status = QM_E_NO_MEMORY;
    size_t fail_at = 0, updated;
    for (; status != QM_OK && fail_at < 50; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&memory);
        qm_deformer *deformer;
        status = qm_deformer_build(&ctx, b.tree, &deformer);
        if (status == QM_OK) status = qm_bvh_refit(&ctx, b.tree, deformer, &b.mesh, faces, 2, 1, &updated);
        if (status == QM_OK) status = qm_tetra_refit(&ctx, b.tetra, faces, 2, &updated);
        qm_deformer_destroy(&ctx, deformer);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu: %zu blocks left", fail_at,
                 memory.live_blocks);
        assert_true(status == QM_OK || status == QM_E_NO_MEMORY);
        check_same(&b, &untouched);
    }
    assert_int_equal(status, QM_OK);
    assert_true(fail_at > 8);
    body_free(&b);
    body_free(&untouched);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(following_some_vertices_is_following_all),
        cmocka_unit_test(standing_still_changes_nothing),
        cmocka_unit_test(meshes_may_leave_their_frame),
        cmocka_unit_test(frames_follow_vertices_that_return),
        cmocka_unit_test(threads_find_the_same),
        cmocka_unit_test(groups_are_fitted_like_packs),
        cmocka_unit_test(unknown_vertices_are_named),
        cmocka_unit_test(without_memory_nothing_changes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
