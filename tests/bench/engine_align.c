/*
 * Times alignments: A, moved by each of a file of motions, onto B. An alignment has placed A when it lies within a hundredth of
 * the diagonal of where it came from, and has found the same motion when it lies within a millionth of where it ends
 * without being moved before.
 */
#include "engine.h"

#include "arrays.h"
#include "base/host.h"
#include "measure.h"
#include "qm/align.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NEAR 1e-2
#define EXACT 1e-6

static qm_mesh read_arrays(const char *prefix)
{
    qm_mesh mesh = {.polygon_count = 0};
    mesh.positions = qm_bench_read_part(prefix, "vertices", 3 * sizeof *mesh.positions, &mesh.vertex_count);
    uint32_t *triangles = qm_bench_read_part(prefix, "triangles", 3 * sizeof *triangles, &mesh.face_count);
    mesh.faces = bench_alloc(mesh.face_count, 4 * sizeof *mesh.faces);
    for (size_t i = 0; i < mesh.face_count; i++) {
        memcpy(mesh.faces + 4 * i, triangles + 3 * i, 3 * sizeof *triangles);
        mesh.faces[4 * i + 3] = QM_NO_INDEX;
    }
    free(triangles);
    return mesh;
}

static void apply(const double m[16], const double p[3], double out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r];
}

/** How far first and then, one after the other, end from where whole ends, at most over the vertices. */
static double distance_of(const qm_mesh *mesh, const double first[16], const double then[16],
                          const double whole[16])
{
    double most = 0.0;
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        double moved[3], end[3], wanted[3], square = 0.0;
        apply(first, mesh->positions + 3 * i, moved);
        apply(then, moved, end);
        apply(whole, mesh->positions + 3 * i, wanted);
        for (int k = 0; k < 3; k++)
            square += (end[k] - wanted[k]) * (end[k] - wanted[k]);
        most = fmax(most, square);
    }
    return sqrt(most);
}

static qm_align_result align(qm_context *ctx, const qm_mesh *a, const qm_bvh *b, int threads,
                             double *build_ms)
{
    qm_bvh *tree;
    qm_align_options options = qm_align_options_default();
    options.thread_count = threads;
    const double start = qm_bench_now_ms();
    qm_status status = qm_bvh_build(ctx, a, QM_BVH_TARGET, threads, &tree);
    *build_ms = qm_bench_now_ms() - start;
    qm_align_result result;
    if (status == QM_OK) status = qm_align_find(ctx, tree, b, &options, &result);
    if (status != QM_OK) bench_fail("alignment", ctx->message);
    qm_bvh_destroy(ctx, tree);
    return result;
}

void bench_align(const char *prefix_a, const char *prefix_b, const char *motions_path, int threads)
{
    qm_context ctx = qm_host_context();
    qm_mesh a = read_arrays(prefix_a), b = read_arrays(prefix_b), moved = a;
    size_t count, placed = 0, exact = 0;
    double *motions = qm_bench_read_rows(motions_path, 16 * sizeof *motions, &count);
    double *build_ms = bench_alloc(count, sizeof *build_ms), *query_ms = bench_alloc(count, sizeof *query_ms);
    const qm_box box = qm_mesh_bounding_box(&b);
    const double diagonal = qm_mesh_box_diagonal(&box);
    double identity[16], still_ms;
    qm_transform_identity(identity);
    qm_bvh *tree;
    if (qm_bvh_build(&ctx, &b, QM_BVH_TARGET, threads, &tree) != QM_OK) bench_fail("tree", ctx.message);
    moved.positions = bench_alloc(a.vertex_count, 3 * sizeof *a.positions);
    const qm_align_result still = align(&ctx, &a, tree, threads, &still_ms);
    const long resting_kb = qm_bench_rest();
    for (size_t i = 0; i < count; i++) {
        const double *motion = motions + 16 * i;
        if (qm_transform_positions(&ctx, motion, &a, moved.positions) != QM_OK)
            bench_fail("motion", ctx.message);
        const double start = qm_bench_now_ms();
        const qm_align_result result = align(&ctx, &moved, tree, threads, &build_ms[i]);
        query_ms[i] = qm_bench_now_ms() - start - build_ms[i];
        placed += distance_of(&a, motion, result.transform, identity) <= NEAR * diagonal;
        exact += distance_of(&a, motion, result.transform, still.transform) <= EXACT * diagonal;
    }
    printf("{\"motions\": %zu, \"placed\": %zu, \"exact\": %zu, \"rms\": %.17g, \"runner_up\": %.17g, ",
           count, placed, exact, still.rms / diagonal,
           isnan(still.runner_up_rms) ? -1.0 : still.runner_up_rms / diagonal);
    qm_bench_print_list("build_ms", build_ms, (int)count);
    printf(", ");
    qm_bench_print_list("query_ms", query_ms, (int)count);
    printf(", \"resting_kb\": %ld, \"peak_kb\": %ld}\n", resting_kb, qm_bench_memory_kb("VmHWM"));
    qm_bvh_destroy(&ctx, tree);
    free(moved.positions);
    free(build_ms);
    free(query_ms);
    free(motions);
    free(a.positions);
    free(a.faces);
    free(b.positions);
    free(b.faces);
}
