/* What single precision proves about pairs of triangles, against whole numbers and between instruction
 * sets. */
#include <string.h>

#include "bvh/kernel.h"
#include "check.h"
#include "exact_twin.h"
#include "shapes.h"

enum { FACES = QM_PACK_LANES };

/** As many triangles as a pack holds, with corners that are whole numbers. */
typedef struct whole_pack {
    qm_mesh mesh;
    qm_bigint_point corner[FACES][3];
    qm_bvh *tree;
} whole_pack;

static void make_pack(qm_random *random, qm_context *ctx, int limit, double step, const double shift[3],
                      whole_pack *out)
{
    bool is_flat = qm_random_below(random, 4) == 0, is_thin = qm_random_below(random, 4) == 0;
    out->mesh = qm_shape_make(3 * FACES, FACES);
    for (uint32_t v = 0; v < 3 * FACES; v++) {
        int64_t *x = out->corner[v / 3][v % 3].x;
        for (int k = 0; k < 3; k++)
            x[k] = (int64_t)qm_random_below(random, (size_t)(2 * limit + 1)) - limit;
        if (is_flat) x[2] = x[0];
        if (is_thin && v % 3 == 2)
            for (int k = 0; k < 3; k++)
                x[k] = out->corner[v / 3][qm_random_below(random, 2)].x[k] + (k == 1);
        for (int k = 0; k < 3; k++)
            out->mesh.positions[3 * v + (uint32_t)k] = step * ((double)x[k] + shift[k]);
        out->mesh.faces[4 * (v / 3) + v % 3] = v;
    }
    for (size_t f = 0; f < FACES; f++)
        out->mesh.faces[4 * f + 3] = QM_NO_INDEX;
    assert_int_equal(qm_bvh_build(ctx, &out->mesh, QM_BVH_SOURCE, 1, &out->tree), QM_OK);
}

static void free_pack(qm_context *ctx, whole_pack *pack)
{
    qm_bvh_destroy(ctx, pack->tree);
    qm_shape_free(&pack->mesh);
}

/** A bit for each pair of faces, of faces i and j bit FACES i + j. */
typedef struct found {
    uint64_t meet, open, alike;
} found;

static found decide(const qm_kernel *kernel, const whole_pack *a, const whole_pack *b, bool seeks_alike)
{
    const whole_pack *const side[2] = {a, b};
    qm_collide_leaf leaf[2];
    qm_lane_pairs pairs;
    memset(&pairs, 0, sizeof pairs);
    for (int k = 0; k < 2; k++)
        kernel->fill_leaf(side[k]->tree, &a->tree->frame, QM_COLLIDE_TWO, 0, &leaf[k]);
    qm_near_lanes lanes;
    kernel->add_lane_pairs(&leaf[0], &leaf[1], seeks_alike, &pairs, &lanes);
    found out = {0};
    for (uint64_t alike = lanes.alike; alike; alike &= alike - 1) {
        int place = __builtin_ctzll(alike);
        out.alike |=
            UINT64_C(1) << (FACES * a->tree->lanes[0].face[place / 8] + b->tree->lanes[0].face[place % 8]);
    }
    out.open = out.alike;
    for (unsigned i = 0; i < pairs.count; i++) {
        qm_pair_verdicts verdicts;
        kernel->decide_lane_pairs(&pairs, i / 8 * 8, &verdicts);
        uint64_t bit = UINT64_C(1) << (FACES * a->tree->lanes[0].face[pairs.lane[0][i]] +
                                       b->tree->lanes[0].face[pairs.lane[1][i]]);
        if (verdicts.meet >> i % 8 & 1) out.meet |= bit;
        if (verdicts.open >> i % 8 & 1) out.open |= bit;
    }
    return out;
}

static void check_proofs(const whole_pack *a, const whole_pack *b, found said, int run)
{
    assert_true((said.meet & said.open) == 0);
    assert_true((said.alike & ~said.open) == 0);
    for (int i = 0; i < FACES; i++) {
        for (int j = 0; j < FACES; j++) {
            uint64_t bit = UINT64_C(1) << (FACES * i + j);
            bool meets = qm_exact_meet(a->corner[i], b->corner[j]);
            bool is_wrong = meets ? !((said.meet | said.open) & bit) : (said.meet & bit) != 0;
            QM_CHECK(!is_wrong, "seed %llu, run %d, faces %d and %d %s", (unsigned long long)qm_check_seed(),
                     run, i, j, meets ? "meet" : "do not meet");
        }
    }
}

static void proofs_hold_on_every_instruction_set(void **state)
{
    (void)state;
    size_t met = 0, open = 0;
    int runs = qm_check_long() ? 20000 : 1500;
    for (int run = 0; run < runs; run++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)run);
        qm_context ctx = qm_context_make();
        const int limits[] = {3, 20, 300, QM_EXACT_TWIN_LIMIT};
        int limit = limits[run % 4];
        /* Exact in doubles; far out, single precision decides little. */
        const double far = run % 3 == 0 ? 0x1p20 : run % 3 == 1 ? 64 : 0, shift[3] = {far, -far, far};
        double step = run % 5 == 0 ? 0x1p-60 : 1.0;
        whole_pack a, b;
        make_pack(&random, &ctx, limit, step, shift, &a);
        make_pack(&random, &ctx, limit, step, shift, &b);
        found first = decide(qm_kernel_list()[0], &a, &b, run % 2);
        check_proofs(&a, &b, first, run);
        met += (size_t)__builtin_popcountll(first.meet);
        if (limit == QM_EXACT_TWIN_LIMIT) open += (size_t)__builtin_popcountll(first.open);
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
            found said = decide(*kernel, &a, &b, run % 2);
            assert_memory_equal(&said, &first, sizeof said);
        }
        free_pack(&ctx, &a);
        free_pack(&ctx, &b);
    }
    assert_true(met > (size_t)runs);
    assert_true(open < (size_t)runs * 8);
}

/** Coincident corners are passed on, so that nothing is computed for them. */
static void common_corners_are_told(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_random random = qm_random_make(qm_check_seed(), 0);
    const double none[3] = {0};
    whole_pack a, b;
    make_pack(&random, &ctx, 100, 1.0, none, &a);
    make_pack(&random, &ctx, 100, 1.0, none, &b);
    qm_bvh_destroy(&ctx, b.tree);
    memcpy(b.mesh.positions, a.mesh.positions, 3 * sizeof *a.mesh.positions); /* corner 0 of face 0 of both */
    b.corner[0][0] = a.corner[0][0];
    assert_int_equal(qm_bvh_build(&ctx, &b.mesh, QM_BVH_SOURCE, 1, &b.tree), QM_OK);
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        found said = decide(*kernel, &a, &b, true);
        check_proofs(&a, &b, said, -1);
        assert_true(said.alike == 1);
    }
    free_pack(&ctx, &a);
    free_pack(&ctx, &b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(proofs_hold_on_every_instruction_set),
        cmocka_unit_test(common_corners_are_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
