/*
 * Compares the distances of all accelerators: of points near a mesh, in its box and far round it, in
 * both readings of quads.
 */
#include "engine.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/host.h"
#include "qm/project.h"

typedef struct agree_bench {
    qm_context ctx;
    qm_mesh mesh;
    qm_bvh *tree;
    double *points[3];
    size_t count;
    double *distance[QM_ACCELERATOR_COUNT];
} agree_bench;

static void project(agree_bench *b, qm_accelerator accelerator, qm_quad_reading quads, const double *points)
{
    qm_locator locator;
    qm_projection out = {.distance = b->distance[accelerator]};
    if (qm_locator_build(&b->ctx, b->tree, NULL, accelerator, &locator) != QM_OK ||
        qm_project_points_with(&b->ctx, &locator, quads, points, b->count, 1, &out) != QM_OK)
        bench_fail("projection", b->ctx.message);
    qm_locator_reset(&b->ctx, &locator);
}

/** The greatest difference of any two accelerators for one set of points. */
static double compare(agree_bench *b, qm_quad_reading quads, const double *points)
{
    double worst = 0.0;
    for (int a = 0; a < QM_ACCELERATOR_COUNT; a++) {
        project(b, (qm_accelerator)a, quads, points);
        for (size_t i = 0; i < b->count; i++)
            worst = fmax(worst, fabs(b->distance[a][i] - b->distance[0][i]));
    }
    return worst;
}

static bool has_quads(const qm_mesh *mesh)
{
    for (size_t i = 0; i < mesh->face_count; i++)
        if (mesh->faces[4 * i + 3] != QM_NO_INDEX) return true;
    return false;
}

void bench_agree(const char *path, size_t count, uint64_t seed)
{
    static const char *const sets[3] = {"near", "mid", "far"};
    agree_bench b = {.ctx = qm_host_context(), .count = count};
    b.mesh = bench_read_mesh(&b.ctx, path, &(bench_change){0});
    qm_box box = qm_mesh_bounding_box(&b.mesh);
    double diagonal = qm_mesh_box_diagonal(&box);
    if (qm_bvh_build(&b.ctx, &b.mesh, QM_BVH_ALL, 1, &b.tree) != QM_OK) bench_fail("tree", b.ctx.message);
    for (int set = 0; set < 3; set++)
        b.points[set] = bench_alloc(count, 3 * sizeof *b.points[set]);
    for (int a = 0; a < QM_ACCELERATOR_COUNT; a++)
        b.distance[a] = bench_alloc(count, sizeof *b.distance[a]);
    bench_draw_sets(&b.mesh, count, seed, b.points);
    printf("{\"points\": %zu, \"faces\": %zu", count, b.mesh.face_count);
    for (int quads = 0; quads < (has_quads(&b.mesh) ? 2 : 1); quads++)
        for (int set = 0; set < 3; set++)
            printf(", \"%s_%s\": %.3g", quads == 0 ? "triangles" : "bilinear", sets[set],
                   compare(&b, (qm_quad_reading)quads, b.points[set]) / diagonal);
    printf("}\n");
    for (int a = 0; a < QM_ACCELERATOR_COUNT; a++)
        free(b.distance[a]);
    for (int set = 0; set < 3; set++)
        free(b.points[set]);
    qm_bvh_destroy(&b.ctx, b.tree);
    qm_mesh_reset(&b.ctx, &b.mesh);
}
