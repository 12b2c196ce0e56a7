/* qm_mesh_find_facts: known shapes, faults of every kind, random meshes against plain counting. */
#include "check.h"

#include "qm/mesh.h"
#include "shapes.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

static qm_mesh_facts find(const qm_mesh *mesh)
{
    qm_context ctx = qm_context_make();
    qm_mesh_facts facts;
    assert_int_equal(qm_mesh_find_facts(&ctx, mesh, &facts), QM_OK);
    return facts;
}

/** A mesh of these faces over as many vertices as they name; the vertices stay at the origin. */
static qm_mesh mesh_of(const uint32_t (*faces)[4], size_t count)
{
    uint32_t last = 0;
    for (size_t i = 0; i < 4 * count; ++i)
        if (faces[i / 4][i % 4] != QM_NO_INDEX && faces[i / 4][i % 4] > last) last = faces[i / 4][i % 4];
    qm_mesh mesh = qm_shape_make((size_t)last + 1, count);
    memcpy(mesh.faces, faces, count * sizeof *faces);
    return mesh;
}

static qm_mesh_facts find_in(const uint32_t (*faces)[4], size_t count)
{
    qm_mesh mesh = mesh_of(faces, count);
    qm_mesh_facts facts = find(&mesh);
    qm_shape_free(&mesh);
    return facts;
}

#define N QM_NO_INDEX
#define FACTS_OF(...)                                                                                        \
    find_in((const uint32_t[][4]){__VA_ARGS__}, sizeof((const uint32_t[][4]){__VA_ARGS__}) / 16)

static void cube_is_closed_with_eight_irregular_corners(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1);
    qm_mesh_facts facts = find(&box);
    assert_int_equal(facts.quads, 6);
    assert_int_equal(facts.triangles, 0);
    assert_int_equal(facts.boundary_edges, 0);
    assert_int_equal(facts.nonmanifold_edges, 0);
    assert_int_equal(facts.irregular_vertices, 8);
    assert_int_equal(facts.components, 1);
    assert_true(facts.manifold);

    qm_mesh split = qm_shape_triangulated(&box);
    facts = find(&split);
    assert_int_equal(facts.triangles, 12);
    assert_int_equal(facts.irregular_vertices, 0);
    assert_true(facts.manifold);
    qm_shape_free(&box);
    qm_shape_free(&split);
}

static void grids_have_the_boundary_of_their_shape(void **state)
{
    (void)state;
    qm_mesh plane = qm_shape_plane(5, 0), torus = qm_shape_torus(12, 7, 2, 1), sphere = qm_shape_sphere(0);
    qm_mesh_facts facts = find(&plane);
    assert_int_equal(facts.boundary_edges, 20);
    assert_int_equal(facts.irregular_vertices, 0);
    assert_true(facts.manifold);
    facts = find(&torus);
    assert_int_equal(facts.boundary_edges, 0);
    assert_int_equal(facts.irregular_vertices, 0);
    assert_true(facts.manifold);
    facts = find(&sphere);
    assert_int_equal(facts.quads, 4800);
    assert_int_equal(facts.boundary_edges, 200);
    assert_int_equal(facts.components, 1);
    qm_shape_free(&plane);
    qm_shape_free(&torus);
    qm_shape_free(&sphere);
}

static void fans_of_three_and_five_quads_are_irregular(void **state)
{
    (void)state;
    qm_mesh_facts facts = FACTS_OF({0, 1, 2, 3}, {0, 3, 4, 5}, {0, 5, 6, 1});
    assert_int_equal(facts.irregular_vertices, 1);
    facts = FACTS_OF({0, 1, 2, 3}, {0, 3, 4, 5}, {0, 5, 6, 7}, {0, 7, 8, 1});
    assert_int_equal(facts.irregular_vertices, 0);
    facts = FACTS_OF({0, 1, 2, 3}, {0, 3, 4, 5}, {0, 5, 6, 7}, {0, 7, 8, 9}, {0, 9, 10, 1});
    assert_int_equal(facts.irregular_vertices, 1);
    /* Two quads that share two edges: an inner vertex of valence 2. */
    facts = FACTS_OF({0, 1, 2, 3}, {0, 3, 4, 1});
    assert_int_equal(facts.irregular_vertices, 1);
    assert_int_equal(facts.boundary_edges, 4);
    /* A triangle in the fan: the vertex is not of quads only. */
    facts = FACTS_OF({0, 1, 2, 3}, {0, 3, 4, 5}, {0, 5, 1, N});
    assert_int_equal(facts.irregular_vertices, 0);
}

static void edges_of_three_faces_are_not_manifold(void **state)
{
    (void)state;
    qm_mesh_facts facts = FACTS_OF({0, 1, 2, N}, {0, 1, 3, N}, {1, 0, 4, N});
    assert_int_equal(facts.nonmanifold_edges, 1);
    assert_int_equal(facts.boundary_edges, 6);
    assert_false(facts.manifold);
}

static void two_fans_at_one_vertex_are_not_manifold(void **state)
{
    (void)state;
    qm_mesh_facts facts = FACTS_OF({0, 1, 2, N}, {0, 3, 4, N});
    assert_int_equal(facts.components, 1);
    assert_int_equal(facts.nonmanifold_edges, 0);
    assert_false(facts.manifold);
}

static void turned_faces_and_moebius_strips_are_manifold(void **state)
{
    (void)state;
    qm_mesh_facts facts = FACTS_OF({0, 1, 2, N}, {0, 1, 3, N});
    assert_int_equal(facts.boundary_edges, 4);
    assert_true(facts.manifold);
    facts = FACTS_OF({0, 1, 3, 2}, {2, 3, 5, 4}, {4, 5, 0, 1});
    assert_int_equal(facts.boundary_edges, 6);
    assert_true(facts.manifold);
}

static void components_join_at_vertices_and_leave_out_unused_ones(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1), two = qm_shape_joined(&box, &box);
    qm_mesh padded = qm_shape_with_unused(&two, 3, (const double[3]){9, 9, 9});
    qm_mesh_facts facts = find(&padded);
    assert_int_equal(facts.components, 2);
    assert_int_equal(facts.unused_vertices, 6);
    assert_int_equal(facts.irregular_vertices, 16);
    qm_shape_free(&box);
    qm_shape_free(&two);
    qm_shape_free(&padded);
}

static void repeated_corners_leave_the_smaller_shape(void **state)
{
    (void)state;
    /* A quad with two equal neighbours is a triangle and closes the gap between its two real neighbours. */
    qm_mesh_facts facts = FACTS_OF({0, 1, 1, 2}, {1, 0, 3, N});
    assert_int_equal(facts.repeated_corner_faces, 1);
    assert_int_equal(facts.quads, 1);
    assert_int_equal(facts.boundary_edges, 4);
    assert_true(facts.manifold);
    /* A segment between two triangles does not part them. */
    facts = FACTS_OF({0, 1, 2, N}, {0, 1, 1, N}, {1, 0, 3, N});
    assert_int_equal(facts.boundary_edges, 4);
    assert_int_equal(facts.nonmanifold_edges, 0);
    assert_true(facts.manifold);
    /* Points, segments and quads that fold back have no edges, but they are components. */
    facts = FACTS_OF({0, 0, 0, N}, {1, 1, 1, 1}, {2, 3, 2, 4}, {5, 6, 6, 5});
    assert_int_equal(facts.repeated_corner_faces, 4);
    assert_int_equal(facts.boundary_edges, 0);
    assert_int_equal(facts.components, 4);
    assert_int_equal(facts.unused_vertices, 0);
}

static void fans_count_as_polygons_only(void **state)
{
    (void)state;
    const uint32_t faces[][4] = {{0, 1, 2, N}, {0, 2, 3, N}, {0, 3, 4, N},
                                 {0, 4, 5, 6}, {7, 8, 9, N}, {0, 1, 7, N}};
    qm_mesh mesh = mesh_of(faces, 6);
    mesh.polygon_count = 1;
    mesh.face_origin = calloc(6, sizeof *mesh.face_origin);
    assert_non_null(mesh.face_origin);
    memcpy(mesh.face_origin, (const uint32_t[]){0, 0, 0, 1, 2, 3}, 6 * sizeof *mesh.face_origin);
    qm_mesh_facts facts = find(&mesh);
    assert_int_equal(facts.polygons, 1);
    assert_int_equal(facts.triangles, 2);
    assert_int_equal(facts.quads, 1);
    assert_int_equal(facts.components, 1);
    qm_shape_free(&mesh);
}

static void point_sets_have_no_surface(void **state)
{
    (void)state;
    qm_random random = qm_random_make(1, 0);
    qm_mesh points = qm_shape_points(&random, 10);
    qm_mesh_facts facts = find(&points);
    assert_int_equal(facts.components, 0);
    assert_int_equal(facts.unused_vertices, 0);
    assert_int_equal(facts.triangles + facts.quads + facts.boundary_edges, 0);
    assert_false(facts.manifold);
    qm_shape_free(&points);
}

/** Edges of one face, and of three or more, by comparing every pair of sides. Triangles of three corners. */
static void count_edges_slowly(const qm_mesh *mesh, size_t *boundary, size_t *crowded)
{
    size_t sides = 3 * mesh->face_count;
    *boundary = *crowded = 0;
    for (size_t i = 0; i < sides; ++i) {
        const uint32_t *f = mesh->faces + 4 * (i / 3);
        uint32_t a = f[i % 3], b = f[(i + 1) % 3];
        size_t same = 0, before = 0;
        for (size_t j = 0; j < sides; ++j) {
            const uint32_t *g = mesh->faces + 4 * (j / 3);
            uint32_t c = g[j % 3], d = g[(j + 1) % 3];
            bool equal = (a == c && b == d) || (a == d && b == c);
            same += equal;
            before += equal && j < i;
        }
        if (before > 0) continue;
        *boundary += same == 1;
        *crowded += same >= 3;
    }
}

static void random_triangles_match_plain_counting(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 300; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        size_t count = 1 + qm_random_below(&random, 40);
        qm_mesh mesh = qm_shape_soup(&random, count, QM_SOUP_TRIANGLES, QM_SOUP_POOLED, 0);
        qm_mesh_facts facts = find(&mesh);
        size_t boundary, crowded;
        count_edges_slowly(&mesh, &boundary, &crowded);
        QM_CHECK(facts.boundary_edges == boundary, "seed %llu: %zu, not %zu", (unsigned long long)seed,
                 facts.boundary_edges, boundary);
        QM_CHECK(facts.nonmanifold_edges == crowded, "seed %llu: %zu, not %zu", (unsigned long long)seed,
                 facts.nonmanifold_edges, crowded);
        qm_shape_free(&mesh);
    }
}

static void a_star_of_many_faces_takes_linear_time(void **state)
{
    (void)state;
    /* All faces share one edge and one vertex: the worst case for anything that looks at pairs. */
    enum { COUNT = 200000 };
    qm_mesh mesh = qm_shape_make(COUNT + 2, COUNT);
    for (uint32_t f = 0; f < COUNT; ++f)
        memcpy(mesh.faces + 4 * f, (const uint32_t[4]){0, 1, f + 2, N}, 4 * sizeof(uint32_t));
    clock_t start = clock();
    qm_mesh_facts facts = find(&mesh);
    double seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    assert_int_equal(facts.nonmanifold_edges, 1);
    assert_int_equal(facts.boundary_edges, 2 * COUNT);
    QM_CHECK(seconds < 2, "%.2f s", seconds);
    qm_shape_free(&mesh);
}

static void a_million_quads_take_well_under_a_second(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_plane(1000, 0);
    clock_t start = clock();
    qm_mesh_facts facts = find(&mesh);
    double seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    print_message("one million quads: %.3f s\n", seconds);
    assert_int_equal(facts.quads, 1000000);
    assert_int_equal(facts.boundary_edges, 4000);
    assert_true(facts.manifold);
    QM_CHECK(seconds < 5, "%.2f s", seconds);
    qm_shape_free(&mesh);
}

static void a_raised_flag_cancels(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1);
    atomic_bool cancel = true;
    qm_context ctx = qm_context_make();
    ctx.cancel = &cancel;
    qm_mesh_facts facts;
    assert_int_equal(qm_mesh_find_facts(&ctx, &box, &facts), QM_E_CANCELED);
    assert_true(strlen(ctx.message) > 0);
    qm_shape_free(&box);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cube_is_closed_with_eight_irregular_corners),
        cmocka_unit_test(grids_have_the_boundary_of_their_shape),
        cmocka_unit_test(fans_of_three_and_five_quads_are_irregular),
        cmocka_unit_test(edges_of_three_faces_are_not_manifold),
        cmocka_unit_test(two_fans_at_one_vertex_are_not_manifold),
        cmocka_unit_test(turned_faces_and_moebius_strips_are_manifold),
        cmocka_unit_test(components_join_at_vertices_and_leave_out_unused_ones),
        cmocka_unit_test(repeated_corners_leave_the_smaller_shape),
        cmocka_unit_test(fans_count_as_polygons_only),
        cmocka_unit_test(point_sets_have_no_surface),
        cmocka_unit_test(random_triangles_match_plain_counting),
        cmocka_unit_test(a_star_of_many_faces_takes_linear_time),
        cmocka_unit_test(a_million_quads_take_well_under_a_second),
        cmocka_unit_test(a_raised_flag_cancels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
