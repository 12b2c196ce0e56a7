/* Faces that are settled in parts, by facets near these: they must be near enough everywhere, triangles and
 * patches, whatever was near the faces before them. */
#include "check.h"

#include "hausdorff/hausdorff_worker.h"
#include "random.h"
#include "shapes.h"
#include "target.h"

#include <math.h>

enum { TARGETS = 24, TRIES = 40, SAMPLES = 24, COLUMNS = 14 };

/** Faces beside a target, from much smaller than its facets to much larger, which share some vertices. */
typedef struct drawn_faces {
    qm_vec vertex[3 * QM_PACK_LANES];
    qm_near_faces faces;
} drawn_faces;

static void draw_faces(qm_random *random, const qm_bvh *target, drawn_faces *out)
{
    double size = pow(2.0, qm_random_range(random, -3.0, 3.0)) / COLUMNS;
    double away = pow(10.0, qm_random_range(random, -4.0, -0.5));
    qm_vec middle[3];
    qm_bvh_load_triangle(target, (uint32_t)qm_random_below(random, target->pack_count), 0, middle);
    qm_near_faces *faces = &out->faces;
    faces->vertex = out->vertex;
    faces->vertex_count = 4 + (int)qm_random_below(random, 3 * QM_PACK_LANES - 3);
    faces->count = 1 + (int)qm_random_below(random, QM_PACK_LANES);
    for (int i = 0; i < faces->vertex_count; i++)
        out->vertex[i] = (qm_vec){middle[0].x + size * qm_random_range(random, -1.0, 1.0),
                                  middle[0].y + size * qm_random_range(random, -1.0, 1.0),
                                  middle[0].z + away * qm_random_range(random, -1.0, 1.0)};
    for (int i = 0; i < faces->count; i++) {
        bool is_patch = qm_random_below(random, 2);
        for (int c = 0; c < 4; c++)
            faces->corner[i][c] = (uint8_t)qm_random_below(random, (uint32_t)faces->vertex_count);
        if (!is_patch) faces->corner[i][3] = faces->corner[i][2];
    }
}

/** A point of a face: the first are its corners. */
static qm_vec draw_point(qm_random *random, const drawn_faces *drawn, int face, int sample)
{
    const uint8_t *place = drawn->faces.corner[face];
    double u = qm_random_range(random, 0.0, 1.0), v = qm_random_range(random, 0.0, 1.0);
    if (sample < 4) {
        u = sample % 2;
        v = sample / 2;
    }
    /* A triangle is the patch whose last two corners are one: to where (1, 1) and (0, 1) are. */
    qm_vec low = qm_vec_mix(drawn->vertex[place[0]], drawn->vertex[place[1]], u);
    qm_vec high = qm_vec_mix(drawn->vertex[place[3]], drawn->vertex[place[2]], u);
    return qm_vec_mix(low, high, v);
}

static void settled_faces_are_near(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 0);
    qm_context ctx = qm_context_make();
    long settled_count[2] = {0}; /* triangles, patches */
    long large = 0;              /* of them, those too large for a single facet or ball */
    for (int i = 0; i < TARGETS; i++) {
        double height = qm_random_range(&random, 0.0, 0.1), turn = qm_random_range(&random, 0.0, 3.0);
        qm_mesh mesh = qm_shape_waves(COLUMNS, height, turn);
        qm_shape_shake(&mesh, &random, i % 2 * qm_random_range(&random, 0.0, 0.05));
        qm_bvh *target;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &target), QM_OK);
        qm_search search;
        qm_side side;
        qm_target_search(&search, &side, target, 0.0);
        qm_worker worker = {.search = &search};
        for (int k = 0; k < TRIES; k++) {
            double cutoff = search.floor = pow(10.0, qm_random_range(&random, -3.0, -0.5));
            drawn_faces drawn;
            draw_faces(&random, target, &drawn);
            uint32_t hint = (uint32_t)qm_random_below(&random, target->pack_count);
            unsigned near = qm_near_test_faces(&worker, &side, &drawn.faces, hint);
            assert_int_equal(near >> drawn.faces.count, 0);
            for (; near; near &= near - 1) {
                int face = __builtin_ctz(near);
                const uint8_t *place = drawn.faces.corner[face];
                settled_count[place[2] != place[3]]++;
                large += qm_vec_distance(drawn.vertex[place[0]], drawn.vertex[place[1]]) >
                         1.5 / COLUMNS + 2.0 * cutoff;
                for (int n = 0; n < SAMPLES; n++) {
                    double distance = qm_target_distance(target, draw_point(&random, &drawn, face, n));
                    QM_CHECK(distance <= cutoff + 1e-14, "seed %llu: settled at %.17g, but %.17g away",
                             (unsigned long long)seed, cutoff, distance);
                }
            }
        }
        qm_bvh_destroy(&ctx, target);
        qm_shape_free(&mesh);
    }
    QM_CHECK(settled_count[0] > TARGETS && settled_count[1] > TARGETS && large > TARGETS,
             "seed %llu: hardly anything was settled: %ld triangles, %ld patches, %ld large",
             (unsigned long long)seed, settled_count[0], settled_count[1], large);
}

/** Faces over many facets of a plane are settled where they are well within the cutoff, and not beyond
 * it. */
static void parts_of_a_face_over_a_plane(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_plane(16, 0.0);
    qm_bvh *target;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &target), QM_OK);
    const double height = 0.1,
                 at[4][3] = {{0.2, 0.3, height}, {0.7, 0.3, height}, {0.7, 0.7, height}, {0.2, 0.7, height}};
    qm_vec vertex[4];
    for (int i = 0; i < 4; i++)
        vertex[i] = qm_frame_local(&target->frame, at[i]);
    const qm_near_faces faces = {vertex, 4, 2, {{0, 1, 2, 2}, {0, 2, 3, 3}}};
    const struct {
        double share;
        unsigned settled;
    } cases[] = {{0.9, 0}, {2.5, 3}, {5.0, 3}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        qm_search search;
        qm_side side;
        qm_target_search(&search, &side, target, cases[i].share * height * target->frame.scale);
        qm_worker worker = {.search = &search};
        assert_int_equal(qm_near_test_faces(&worker, &side, &faces, 0), cases[i].settled);
    }
    qm_bvh_destroy(&ctx, target);
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(settled_faces_are_near),
        cmocka_unit_test(parts_of_a_face_over_a_plane),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
