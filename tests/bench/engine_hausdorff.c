/* Times the distance between two meshes: both trees, then the search. */
#include "engine.h"

#include "base/host.h"
#include "measure.h"
#include "qm/hausdorff.h"

typedef struct run {
    double build_a_ms, build_b_ms, query_ms;
    qm_hausdorff_result result;
} run;

static run measure_once(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                        const qm_hausdorff_options *options)
{
    run done;
    qm_bvh *tree_a, *tree_b;
    qm_bvh_parts patches = options->quads == QM_QUADS_BILINEAR ? QM_BVH_PATCHES : 0;
    double start = qm_bench_now_ms();
    if (qm_bvh_build(ctx, a, QM_BVH_SOURCE, options->thread_count, &tree_a) != QM_OK)
        bench_fail("tree of A", ctx->message);
    double built_a = qm_bench_now_ms();
    if (qm_bvh_build(ctx, b, QM_BVH_TARGET | patches, options->thread_count, &tree_b) != QM_OK)
        bench_fail("tree of B", ctx->message);
    double built_b = qm_bench_now_ms();
    if (qm_hausdorff_measure(ctx, tree_a, tree_b, options, &done.result) != QM_OK)
        bench_fail("search", ctx->message);
    done.query_ms = qm_bench_now_ms() - built_b;
    done.build_a_ms = built_a - start;
    done.build_b_ms = built_b - built_a;
    qm_bvh_destroy(ctx, tree_b);
    qm_bvh_destroy(ctx, tree_a);
    return done;
}

void bench_hausdorff(const bench_hausdorff_question *question)
{
    qm_context ctx = qm_host_context();
    qm_mesh a = bench_read_mesh(&ctx, question->path_a, &(bench_change){0});
    qm_mesh b = bench_read_mesh(&ctx, question->path_b, &question->change_b);
    qm_box box = qm_mesh_bounding_box(&a);
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = QM_A_TO_B;
    options.quads = question->quads;
    options.accelerator = question->accelerator;
    options.tolerance = question->tolerance * qm_mesh_box_diagonal(&box);
    options.thread_count = question->threads;

    long resting_kb = qm_bench_rest();
    qm_bench_times times = {0};
    double build_a_ms[QM_BENCH_REPEATS], build_b_ms[QM_BENCH_REPEATS];
    run last;
    do {
        last = measure_once(&ctx, &a, &b, &options);
        build_a_ms[times.count] = last.build_a_ms;
        build_b_ms[times.count] = last.build_b_ms;
        qm_bench_add(&times, last.build_a_ms + last.build_b_ms, last.query_ms);
    } while (qm_bench_wants_more(&times));

    qm_bench_print_times(&times, resting_kb);
    printf(", ");
    qm_bench_print_list("build_a_ms", build_a_ms, times.count);
    printf(", ");
    qm_bench_print_list("build_b_ms", build_b_ms, times.count);
    printf(", \"lower\": %.17g, \"upper\": %.17g, \"iterations\": %llu, \"projections\": %llu, "
           "\"max_queue\": %zu, \"converged\": %s}\n",
           last.result.lower, last.result.upper, (unsigned long long)last.result.iterations,
           (unsigned long long)last.result.projections, last.result.max_queue,
           last.result.stop == QM_STOP_CONVERGED ? "true" : "false");
    qm_mesh_reset(&ctx, &b);
    qm_mesh_reset(&ctx, &a);
}
