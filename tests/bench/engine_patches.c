/* Times the finding of regular patches, and prints how many there are. */
#include "engine.h"

#include "base/host.h"
#include "measure.h"
#include "qm/patch.h"

void bench_patches(const char *path)
{
    qm_context ctx = qm_host_context();
    qm_mesh mesh = bench_read_mesh(&ctx, path, &(bench_change){0});
    qm_mesh_facts facts;
    if (qm_mesh_find_facts(&ctx, &mesh, &facts) != QM_OK) bench_fail("facts", ctx.message);
    qm_patch_set patches = {0};
    long resting_kb = qm_bench_rest();
    qm_bench_times times = {0};
    do {
        qm_patch_set_reset(&ctx, &patches);
        double start = qm_bench_now_ms();
        if (qm_patch_set_find(&ctx, &mesh, &patches) != QM_OK) bench_fail("patches", ctx.message);
        qm_bench_add(&times, 0.0, qm_bench_now_ms() - start);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    printf(", \"quads\": %zu, \"irregular\": %zu, \"patches\": %zu}\n", facts.quads, facts.irregular_vertices,
           patches.patch_count);
    qm_patch_set_reset(&ctx, &patches);
    qm_mesh_reset(&ctx, &mesh);
}
