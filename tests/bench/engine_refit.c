/*
 * Times how trees follow a mesh that moves, beside building them: all vertices in a wave, and a part of them
 * that lies together. The grid has no refit: it is built again.
 */
#include "engine.h"

#include "base/host.h"
#include "measure.h"
#include "qm/deform.h"
#include "qm/grid.h"

#include <math.h>
#include <stdlib.h>

#define REPEATS 5

/** Times in ms of one thing, one for each repeat. */
typedef struct times {
    double ms[REPEATS];
} times;

typedef struct refit_bench {
    qm_context ctx;
    int threads;
    qm_mesh mesh;
    uint32_t *part; /* vertices */
    size_t part_count;
    qm_bvh *tree;
    qm_patch_set patches;
    qm_tetra *tetra;
    qm_deformer *deformer;
    times boxes_build, patches_find, tetra_build, grid_build, deformer_build;
    times boxes_all, boxes_part, tetra_all, tetra_part;
    size_t boxes_size, tetra_size, grid_size;
} refit_bench;

static void check(refit_bench *b, qm_status status, const char *what)
{
    if (status != QM_OK) bench_fail(what, b->ctx.message);
}

static void build(refit_bench *b, int repeat)
{
    qm_grid *grid;
    double start = qm_bench_now_ms();
    check(b, qm_bvh_build(&b->ctx, &b->mesh, QM_BVH_ALL, b->threads, &b->tree), "tree");
    b->boxes_build.ms[repeat] = qm_bench_now_ms() - start;
    start = qm_bench_now_ms();
    check(b, qm_patch_set_find(&b->ctx, &b->mesh, &b->patches), "patches");
    b->patches_find.ms[repeat] = qm_bench_now_ms() - start;
    start = qm_bench_now_ms();
    check(b, qm_tetra_build(&b->ctx, b->tree, &b->patches, &b->tetra), "tetrahedra");
    b->tetra_build.ms[repeat] = qm_bench_now_ms() - start;
    start = qm_bench_now_ms();
    check(b, qm_grid_build(&b->ctx, b->tree, &grid), "grid");
    b->grid_build.ms[repeat] = qm_bench_now_ms() - start;
    start = qm_bench_now_ms();
    check(b, qm_deformer_build(&b->ctx, b->tree, &b->deformer), "deformer");
    b->deformer_build.ms[repeat] = qm_bench_now_ms() - start;
    b->boxes_size = qm_bvh_memory_size(b->tree);
    b->tetra_size = qm_tetra_memory_size(b->tetra) + qm_patch_set_memory_size(&b->patches);
    b->grid_size = qm_grid_memory_size(grid);
    qm_grid_destroy(&b->ctx, grid);
}

static void drop(refit_bench *b)
{
    qm_deformer_destroy(&b->ctx, b->deformer);
    qm_tetra_destroy(&b->ctx, b->tetra);
    qm_patch_set_reset(&b->ctx, &b->patches);
    qm_bvh_destroy(&b->ctx, b->tree);
}

static void wave(refit_bench *b, uint32_t vertex, double phase)
{
    double *p = b->mesh.positions + 3 * (size_t)vertex;
    p[2] += 1e-3 * sin(7.0 * p[0] + phase);
}

/** The faces are found by the deformer; that is part of the time. */
static void follow(refit_bench *b, const uint32_t *vertices, size_t count, times *boxes, times *tetra,
                   int repeat)
{
    uint32_t *faces = NULL;
    size_t face_count = 0, updated;
    double start = qm_bench_now_ms();
    if (vertices)
        check(b, qm_deformer_find_faces(&b->ctx, b->deformer, vertices, count, &faces, &face_count), "faces");
    double found = qm_bench_now_ms();
    check(b, qm_bvh_refit(&b->ctx, b->tree, b->deformer, &b->mesh, faces, face_count, b->threads, &updated),
          "boxes");
    double boxed = qm_bench_now_ms();
    check(b, qm_tetra_refit(&b->ctx, b->tetra, faces, face_count, &updated), "tetrahedra");
    double done = qm_bench_now_ms();
    boxes->ms[repeat] = boxed - start;
    tetra->ms[repeat] = done - boxed + found - start;
    qm_context_free(&b->ctx, faces, face_count, sizeof *faces);
}

static void deform(refit_bench *b, int repeat)
{
    for (uint32_t v = 0; v < b->mesh.vertex_count; v++)
        wave(b, v, repeat);
    follow(b, NULL, 0, &b->boxes_all, &b->tetra_all, repeat);
    for (size_t i = 0; i < b->part_count; i++)
        wave(b, b->part[i], repeat);
    follow(b, b->part, b->part_count, &b->boxes_part, &b->tetra_part, repeat);
}

void bench_refit(const char *path, int threads)
{
    refit_bench b = {.ctx = qm_host_context(), .threads = threads};
    b.mesh = bench_read_mesh(&b.ctx, path, &(bench_change){0});
    b.part = bench_pick_part(&b.mesh, &b.part_count);
    long resting_kb = qm_bench_rest();
    for (int repeat = 0; repeat < REPEATS; repeat++) {
        build(&b, repeat);
        deform(&b, repeat);
        drop(&b);
    }
    printf("{\"faces\": %zu, \"part\": %zu, \"resting_kb\": %ld, \"peak_kb\": %ld, ", b.mesh.face_count,
           b.part_count, resting_kb, qm_bench_memory_kb("VmHWM"));
    printf("\"boxes_size\": %zu, \"tetra_size\": %zu, \"grid_size\": %zu", b.boxes_size, b.tetra_size,
           b.grid_size);
    const struct {
        const char *name;
        const times *times;
    } lists[] = {{"build_ms", &b.boxes_build},         {"query_ms", &b.boxes_all},
                 {"patches_find_ms", &b.patches_find}, {"tetra_build_ms", &b.tetra_build},
                 {"grid_build_ms", &b.grid_build},     {"deformer_build_ms", &b.deformer_build},
                 {"boxes_part_ms", &b.boxes_part},     {"tetra_all_ms", &b.tetra_all},
                 {"tetra_part_ms", &b.tetra_part}};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        printf(", ");
        qm_bench_print_list(lists[i].name, lists[i].times->ms, REPEATS);
    }
    printf("}\n");
    free(b.part);
    qm_mesh_reset(&b.ctx, &b.mesh);
}
