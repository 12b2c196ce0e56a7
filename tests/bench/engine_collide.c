/* Times pairs of faces that meet: the trees, then the search. Quads as triangles. */
#include "engine.h"

#include <stdlib.h>

#include "measure.h"
#include "pair_print.h"
#include "qm/collide.h"

/** One run; b is NULL for a mesh with itself. The last run's pairs are kept. */
static void measure_once(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_bench_times *times,
                         qm_collision *found)
{
    qm_collide_options options = qm_collide_options_default();
    qm_bvh *tree_a, *tree_b = NULL;
    double start = qm_bench_now_ms();
    if (qm_bvh_build(ctx, a, QM_BVH_SOURCE, 1, &tree_a) != QM_OK) bench_fail("tree of A", ctx->message);
    if (b && qm_bvh_build(ctx, b, QM_BVH_SOURCE, 1, &tree_b) != QM_OK) bench_fail("tree of B", ctx->message);
    double built = qm_bench_now_ms();
    qm_status status = b ? qm_collide_meshes(ctx, tree_a, tree_b, &options, found)
                         : qm_collide_self(ctx, tree_a, &options, NULL, found);
    if (status != QM_OK) bench_fail("search", ctx->message);
    qm_bench_add(times, built - start, qm_bench_now_ms() - built);
    qm_bvh_destroy(ctx, tree_b);
    qm_bvh_destroy(ctx, tree_a);
}

static void print_pairs(const qm_collision *found)
{
    uint64_t *pairs = bench_alloc(found->pair_count, sizeof *pairs);
    for (size_t i = 0; i < found->pair_count; i++)
        pairs[i] = qm_bench_pair(found->pairs[i].a, found->pairs[i].b);
    printf(", ");
    qm_bench_print_pairs(pairs, found->pair_count);
    printf(", \"tests\": %llu}\n", (unsigned long long)found->tests);
    free(pairs);
}

void bench_collide(const char *path_a, const char *path_b, const bench_change *change_b)
{
    qm_context ctx = qm_context_make();
    qm_mesh a = bench_read_mesh(&ctx, path_a, &(bench_change){0}), b = {0};
    if (path_b) b = bench_read_mesh(&ctx, path_b, change_b);
    qm_collision found = {0};
    long resting_kb = qm_bench_rest();
    qm_bench_times times = {0};
    do {
        qm_collision_reset(&ctx, &found);
        measure_once(&ctx, &a, path_b ? &b : NULL, &times, &found);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    print_pairs(&found);
    qm_collision_reset(&ctx, &found);
    qm_mesh_reset(&ctx, &b);
    qm_mesh_reset(&ctx, &a);
}
