/* Times pairs of faces that meet: the trees, then the search. Quads as triangles. */
#include "engine.h"

#include <stdlib.h>

#include "base/host.h"
#include "measure.h"
#include "pair_print.h"
#include "qm/collide.h"

/** One run; b is NULL for a mesh with itself. */
static qm_status find_pairs(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_collision *found)
{
    qm_collide_options options = qm_collide_options_default();
    if (b) return qm_collide_surfaces(ctx, a, b, &options, found);
    qm_bvh *tree;
    qm_status status = qm_bvh_build(ctx, a, QM_BVH_SOURCE, 1, &tree);
    if (status == QM_OK) status = qm_collide_self(ctx, tree, &options, NULL, found);
    qm_bvh_destroy(ctx, tree);
    return status;
}

/** The last run's pairs are kept; whatever is not the search counts as building. */
static void measure_once(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_bench_times *times,
                         qm_collision *found)
{
    double start = qm_bench_now_ms();
    if (find_pairs(ctx, a, b, found) != QM_OK) bench_fail("collision", ctx->message);
    double all = qm_bench_now_ms() - start;
    qm_bench_add(times, all - found->elapsed_ms, found->elapsed_ms);
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
    qm_context ctx = qm_host_context();
    qm_mesh a = bench_read_mesh(&ctx, path_a, &(bench_change){0}), b = {0};
    if (path_b) b = bench_read_mesh(&ctx, path_b, change_b);
    qm_collision found = {0};
    long resting_kb = qm_bench_rest();
    qm_bench_times times = {0};
    do {
        qm_collide_reset(&ctx, &found);
        measure_once(&ctx, &a, path_b ? &b : NULL, &times, &found);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    print_pairs(&found);
    qm_collide_reset(&ctx, &found);
    qm_mesh_reset(&ctx, &b);
    qm_mesh_reset(&ctx, &a);
}
