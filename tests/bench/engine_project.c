/* Times projections onto a mesh, the tree apart: distance and face alone, and everything. */
#include "engine.h"

#include "arrays.h"
#include "base/host.h"
#include "measure.h"
#include "qm/project.h"

typedef struct question {
    qm_context ctx;
    qm_mesh mesh;
    double *points;
    size_t point_count;
    int threads;
    qm_accelerator accelerator;
    qm_projection out;
} question;

static void measure_once(question *q, const qm_projection *out, qm_bench_times *times)
{
    qm_bvh *tree;
    double start = qm_bench_now_ms();
    if (qm_bvh_build(&q->ctx, &q->mesh, QM_BVH_TARGET, q->threads, &tree) != QM_OK)
        bench_fail("tree", q->ctx.message);
    qm_locator locator;
    if (qm_locator_build(&q->ctx, tree, NULL, q->accelerator, &locator) != QM_OK)
        bench_fail("accelerator", q->ctx.message);
    double built = qm_bench_now_ms();
    if (qm_project_points_with(&q->ctx, &locator, QM_QUADS_TRIANGLES, q->points, q->point_count, q->threads,
                               out) != QM_OK)
        bench_fail("projection", q->ctx.message);
    qm_bench_add(times, built - start, qm_bench_now_ms() - built);
    qm_locator_reset(&q->ctx, &locator);
    qm_bvh_destroy(&q->ctx, tree);
}

void bench_project(const char *path, const char *points_path, qm_accelerator accelerator, int threads)
{
    question q = {.ctx = qm_host_context(), .threads = threads, .accelerator = accelerator};
    q.mesh = bench_read_mesh(&q.ctx, path, &(bench_change){0});
    q.points = qm_bench_read_rows(points_path, 3 * sizeof *q.points, &q.point_count);
    q.out = (qm_projection){
        .distance = bench_alloc(q.point_count, sizeof *q.out.distance),
        .position = bench_alloc(q.point_count, 3 * sizeof *q.out.position),
        .face = bench_alloc(q.point_count, sizeof *q.out.face),
        .uv = bench_alloc(q.point_count, 2 * sizeof *q.out.uv),
    };
    qm_projection short_out = {.distance = q.out.distance, .face = q.out.face};

    long resting_kb = qm_bench_rest();
    qm_bench_times brief = {0}, full = {0};
    do {
        measure_once(&q, &short_out, &brief);
        measure_once(&q, &q.out, &full);
    } while (qm_bench_wants_more(&full));

    qm_bench_print_times(&brief, resting_kb);
    printf(", ");
    qm_bench_print_list("full_ms", full.query_ms, full.count);
    printf(", ");
    qm_bench_print_checks(q.out.distance, q.point_count);
    printf("}\n");
    free(q.out.uv);
    free(q.out.face);
    free(q.out.position);
    free(q.out.distance);
    free(q.points);
    qm_mesh_reset(&q.ctx, &q.mesh);
}
