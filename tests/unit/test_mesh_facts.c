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

static void closed_surfaces_have_a_genus(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1), torus = qm_shape_torus(12, 7, 2, 1);
    qm_mesh both = qm_shape_joined(&box, &torus);
    qm_mesh_facts facts = find(&both);
    assert_true(facts.watertight && facts.winding_consistent);
    assert_int_equal(facts.edges, 12 + 2 * 84);
    assert_int_equal(facts.euler_number, 2);
    assert_int_equal(facts.genus, 1);
    assert_int_equal(facts.boundary_loops, 0);

    /* One face the other way round: the surface is closed, but has no inside by its faces. */
    uint32_t swap = both.faces[1];
    both.faces[1] = both.faces[3];
    both.faces[3] = swap;
    facts = find(&both);
    assert_true(facts.watertight && !facts.winding_consistent);
    assert_true(facts.genus == QM_NO_GENUS);

    /* A segment from one to the other joins the components, and not the surfaces. */
    qm_mesh linked = qm_shape_joined(&box, &torus);
    linked.faces = realloc(linked.faces, 4 * (linked.face_count + 1) * sizeof *linked.faces);
    assert_non_null(linked.faces);
    memcpy(linked.faces + 4 * linked.face_count, (const uint32_t[4]){0, 8, 8, N}, 4 * sizeof(uint32_t));
    linked.face_count++;
    facts = find(&linked);
    assert_int_equal(facts.components, 1);
    assert_int_equal(facts.genus, 1);
    qm_shape_free(&linked);
    qm_shape_free(&box);
    qm_shape_free(&torus);
    qm_shape_free(&both);
}

static void known_shapes_have_known_loops_and_duplicates(void **state)
{
    (void)state;
    qm_mesh plane = qm_shape_plane(5, 0), sphere = qm_shape_sphere(0);
    qm_mesh_facts facts = find(&plane);
    assert_int_equal(facts.boundary_loops, 1);
    assert_int_equal(facts.euler_number, 1);
    assert_true(facts.winding_consistent && !facts.watertight && facts.genus == QM_NO_GENUS);
    facts = find(&sphere); /* open at both poles */
    assert_int_equal(facts.boundary_loops, 2);
    assert_int_equal(facts.euler_number, 0);
    qm_shape_free(&plane);
    qm_shape_free(&sphere);

    facts = FACTS_OF({0, 1, 3, 2}, {2, 3, 5, 4}, {4, 5, 0, 1}); /* a Moebius strip */
    assert_int_equal(facts.boundary_loops, 1);
    assert_int_equal(facts.euler_number, 0);
    assert_false(facts.winding_consistent);

    facts = FACTS_OF({0, 1, 2, N}, {2, 1, 0, N}); /* a pillow */
    assert_int_equal(facts.duplicate_faces, 1);
    assert_int_equal(facts.genus, 0);
    facts = FACTS_OF({0, 1, 2, 3}, {2, 3, 0, 1}, {1, 0, 3, 2}, {0, 2, 1, 3}, {3, 4, 5, N});
    assert_int_equal(facts.duplicate_faces, 2);
    facts = FACTS_OF({0, 1, 2, N}, {0, 1, 2, 2}, {0, 1, 2, 3}); /* what is left of a face counts */
    assert_int_equal(facts.duplicate_faces, 1);

    const uint32_t faces[][4] = {{0, 1, 2, N}, {0, 2, 3, N}, {0, 3, 4, N},
                                 {0, 2, 1, N}, {0, 3, 2, N}, {0, 4, 3, N}};
    qm_mesh fans = mesh_of(faces, 6);
    fans.polygon_count = 2;
    fans.face_origin = calloc(6, sizeof *fans.face_origin);
    assert_non_null(fans.face_origin);
    memcpy(fans.face_origin, (const uint32_t[]){0, 0, 0, 1, 1, 1}, 6 * sizeof *fans.face_origin);
    assert_int_equal(find(&fans).duplicate_faces, 1);
    qm_shape_free(&fans);
}

/** What the slow twin counts by comparing every pair of sides, and of faces. */
typedef struct slow_counts {
    size_t edges, boundary, crowded, loops, duplicates;
    ptrdiff_t euler;
    bool is_wound;
} slow_counts;

#define MOST_SIDES 1024

/** The distinct corners of a face in order; 0 when fewer than three are left, or one still repeats. */
static int ring_of(const uint32_t face[4], uint32_t ring[4])
{
    int corners = face[3] == N ? 3 : 4, count = 0;
    for (int i = 0; i < corners; ++i)
        if (face[i] != face[(i + 1) % corners]) ring[count++] = face[i];
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < i; ++j)
            if (ring[i] == ring[j]) return 0;
    return count < 3 ? 0 : count;
}

/** True when one list is the other from another start or backwards. */
static bool same_ring(const uint32_t *a, const uint32_t *b, int count)
{
    for (int start = 0; start < count; ++start)
        for (int step = 1; step < count; step += count - 2) {
            int i = 0;
            while (i < count && a[i] == b[(start + i * step) % count])
                ++i;
            if (i == count) return true;
        }
    return false;
}

static slow_counts count_slowly(const qm_mesh *mesh)
{
    slow_counts out = {.is_wound = true};
    uint32_t side[MOST_SIDES][2], loop[MOST_SIDES];
    size_t sides = 0, boundary[MOST_SIDES];
    bool *is_used = calloc(mesh->vertex_count, 1);
    assert_non_null(is_used);
    for (size_t f = 0; f < mesh->face_count; ++f) {
        uint32_t ring[4], other[4];
        int count = ring_of(mesh->faces + 4 * f, ring);
        out.euler += count > 0;
        for (int i = 0; i < count; ++i) {
            out.euler += !is_used[ring[i]];
            is_used[ring[i]] = true;
            assert_true(sides < MOST_SIDES);
            side[sides][0] = ring[i];
            side[sides++][1] = ring[(i + 1) % count];
        }
        bool is_double = false;
        for (size_t g = 0; g < f && count > 0; ++g)
            is_double |= ring_of(mesh->faces + 4 * g, other) == count && same_ring(ring, other, count);
        out.duplicates += is_double;
    }
    for (size_t i = 0; i < sides; ++i) {
        size_t same = 0, before = 0, along = 0;
        for (size_t j = 0; j < sides; ++j) {
            bool is_along = side[i][0] == side[j][0] && side[i][1] == side[j][1];
            bool is_against = side[i][0] == side[j][1] && side[i][1] == side[j][0];
            same += is_along || is_against;
            before += (is_along || is_against) && j < i;
            along += is_along;
        }
        if (along > 1) out.is_wound = false;
        if (before > 0) continue;
        ++out.edges;
        if (same == 1) boundary[out.boundary++] = i;
        out.crowded += same >= 3;
    }
    out.euler -= (ptrdiff_t)out.edges;
    out.is_wound &= out.edges > 0;
    /* Boundary edges take the least number among those that they meet, until nothing changes. */
    for (size_t i = 0; i < out.boundary; ++i)
        loop[i] = (uint32_t)i;
    for (bool changes = true; changes;) {
        changes = false;
        for (size_t i = 0; i < out.boundary; ++i)
            for (size_t j = 0; j < out.boundary; ++j) {
                const uint32_t *a = side[boundary[i]], *b = side[boundary[j]];
                bool meet = a[0] == b[0] || a[0] == b[1] || a[1] == b[0] || a[1] == b[1];
                if (!meet || loop[i] >= loop[j]) continue;
                loop[j] = loop[i];
                changes = true;
            }
    }
    for (size_t i = 0; i < out.boundary; ++i)
        out.loops += loop[i] == i;
    free(is_used);
    return out;
}

static void random_faces_match_plain_counting(void **state)
{
    (void)state;
    static const qm_soup_style styles[] = {QM_SOUP_POOLED, QM_SOUP_DEGENERATE};
    for (uint64_t seed = 0; seed < 600; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        size_t count = 1 + qm_random_below(&random, 40);
        qm_mesh mesh = qm_shape_soup(&random, count, (qm_soup_corners)(seed % 3), styles[seed / 3 % 2], 0);
        /* A narrower choice of vertices has faces twice. */
        uint32_t pool = 3 + (uint32_t)qm_random_below(&random, 8);
        for (size_t i = 0; i < 4 * mesh.face_count && seed % 5 > 1; ++i)
            if (mesh.faces[i] != N) mesh.faces[i] %= pool;
        qm_mesh_facts facts = find(&mesh);
        slow_counts slow = count_slowly(&mesh);
        bool is_equal = facts.boundary_edges == slow.boundary && facts.nonmanifold_edges == slow.crowded &&
                        facts.edges == slow.edges && facts.euler_number == slow.euler &&
                        facts.boundary_loops == slow.loops && facts.duplicate_faces == slow.duplicates &&
                        facts.winding_consistent == slow.is_wound &&
                        facts.watertight == (slow.edges > 0 && slow.boundary + slow.crowded == 0);
        QM_CHECK(is_equal,
                 "seed %llu: %zu %zu %zu %td %zu %zu %d, not %zu %zu %zu %td %zu %zu %d (boundary, crowded, "
                 "edges, "
                 "Euler, loops, duplicates, winding)",
                 (unsigned long long)seed, facts.boundary_edges, facts.nonmanifold_edges, facts.edges,
                 facts.euler_number, facts.boundary_loops, facts.duplicate_faces, facts.winding_consistent,
                 slow.boundary, slow.crowded, slow.edges, slow.euler, slow.loops, slow.duplicates,
                 slow.is_wound);
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
        cmocka_unit_test(closed_surfaces_have_a_genus),
        cmocka_unit_test(known_shapes_have_known_loops_and_duplicates),
        cmocka_unit_test(random_faces_match_plain_counting),
        cmocka_unit_test(a_star_of_many_faces_takes_linear_time),
        cmocka_unit_test(a_million_quads_take_well_under_a_second),
        cmocka_unit_test(a_raised_flag_cancels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
