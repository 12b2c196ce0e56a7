/*
 * The patches of the target that lie nearest to a point of a piece: what is said of their distances is an
 * upper bound. Where the twist is a small share of the tolerance only the quads' triangles are measured, and
 * the bound must hold all the same.
 */
#include "check.h"

#include "hausdorff/hausdorff_candidates.h"
#include "random.h"
#include "slow_twin.h"

#include <math.h>

enum { TRIALS = 400, POINTS = 20 };
#define TOLERANCE 0.01
#define ERROR 1e-12

/** A strip of two quads, bent by up to so much, in one pack. */
static qm_mesh draw_strip(qm_random *random, double bend, double positions[18], uint32_t faces[8])
{
    static const uint32_t strip[8] = {0, 1, 4, 3, 1, 2, 5, 4};
    for (uint32_t i = 0; i < 6; i++) {
        qm_random_point(random, -0.1, 0.1, positions + 3 * i);
        positions[3 * i] += i % 3;
        positions[3 * i + 1] += i / 3;
        positions[3 * i + 2] = qm_random_range(random, -bend, bend);
    }
    for (int i = 0; i < 8; i++)
        faces[i] = strip[i];
    return (qm_mesh){.positions = positions, .vertex_count = 6, .faces = faces, .face_count = 2};
}

/** A query for one returns the nearest of all, and none beyond the distance of the query is returned. */
static void check_fewer(const qm_piece_work *work, qm_vec p, const qm_near_quads *all)
{
    const double within[] = {0.5 * all->at[0].distance, 0.5 * (all->at[0].distance + all->at[1].distance),
                             INFINITY};
    for (int i = 0; i < 3; i++) {
        qm_near_quads few =
            qm_candidates_near_quads(work, p, (qm_quads_query){.wanted = QM_NEAR_QUADS, .within = within[i]});
        assert_int_equal(few.count, all->at[0].distance < all->at[1].distance ? i : i / 2 * 2);
        for (int k = 0; k < few.count; k++)
            assert_true(few.at[k].distance < within[i]);
        qm_near_quads one =
            qm_candidates_near_quads(work, p, (qm_quads_query){.wanted = 1, .within = within[i]});
        assert_int_equal(one.count, few.count > 0);
        if (one.count > 0) assert_true(one.at[0].distance == all->at[0].distance);
    }
}

/** Returns how many of the distances were those of triangles, with the twist on top. */
static int check_points(const qm_mesh *mesh, qm_piece_work *work, qm_random *random, int trial)
{
    const qm_frame *frame = &work->side->target->frame;
    int flat = 0;
    for (int i = 0; i < POINTS; i++) {
        double p[3];
        qm_random_point(random, -0.5, 0.5, p);
        p[0] += 1.0;
        p[1] += 0.5;
        qm_vec local = qm_frame_local(frame, p);
        qm_quads_query query = {.wanted = QM_NEAR_QUADS, .within = INFINITY};
        qm_near_quads near = qm_candidates_near_quads(work, local, query);
        assert_int_equal(near.count, 2);
        check_fewer(work, local, &near);
        for (int k = 0; k < near.count; k++) {
            double claimed = near.at[k].distance * frame->inverse_scale;
            double known = qm_slow_face_distance(mesh, near.at[k].face, QM_QUADS_BILINEAR, p, ERROR).lower;
            QM_CHECK(claimed >= known - ERROR, "seed %llu, trial %d: %.17g of a patch at %.17g",
                     (unsigned long long)qm_check_seed(), trial, claimed, known);
            flat += near.at[k].twist < 0.1 * TOLERANCE * frame->scale;
        }
    }
    return flat;
}

static void distances_are_upper_bounds(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    int flat = 0;
    for (int trial = 0; trial < TRIALS; trial++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)trial);
        double positions[18];
        uint32_t faces[8];
        qm_mesh mesh = draw_strip(&random, 0.3 * TOLERANCE * (1 + trial % 3), positions, faces);
        qm_bvh *tree;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_TARGET | QM_BVH_PATCHES, 1, &tree), QM_OK);
        const qm_side side = {.target = tree,
                              .scale = tree->frame.scale,
                              .inverse_scale = tree->frame.inverse_scale,
                              .target_patches = true};
        qm_search search = {.tolerance = TOLERANCE, .kernel = qm_kernel_get()};
        qm_piece_work work = {
            .search = &search, .side = &side, .kernel = search.kernel, .packs = {0}, .pack_count = 1};
        qm_candidates_refill(&work);
        flat += check_points(&mesh, &work, &random, trial);
        qm_bvh_destroy(&ctx, tree);
    }
    /* Both kinds were there. */
    assert_in_range(flat, TRIALS, 2 * TRIALS * POINTS - TRIALS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(distances_are_upper_bounds),
    };
    return cmocka_run_group_tests_name("near_quads", tests, NULL, NULL);
}
