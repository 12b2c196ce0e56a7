/*
 * Times pairs of faces of a mesh that meet after some of its vertices have moved: all of them, and those alone
 * that could have changed. The tree follows first; that is no part of the times.
 */
#include "engine.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "measure.h"
#include "qm/collide.h"
#include "qm/deform.h"

typedef struct moved_bench {
    qm_context ctx;
    qm_mesh mesh;
    qm_bvh *tree;
    qm_deformer *deformer;
    uint32_t *part; /* vertices */
    size_t part_count;
    qm_collision before;
} moved_bench;

static void check(const moved_bench *b, qm_status status, const char *what)
{
    if (status != QM_OK) bench_fail(what, b->ctx.message);
}

/** Moves the part a little, and lets the tree follow. */
static void move(moved_bench *b, int repeat)
{
    qm_box box = qm_mesh_bounding_box(&b->mesh);
    double step = 1e-3 * qm_mesh_box_diagonal(&box);
    for (size_t i = 0; i < b->part_count; i++) {
        double *p = b->mesh.positions + 3 * (size_t)b->part[i];
        p[i % 3] += step * sin((double)i + repeat);
    }
    uint32_t *faces;
    size_t face_count, updated;
    check(b, qm_deformer_find_faces(&b->ctx, b->deformer, b->part, b->part_count, &faces, &face_count),
          "faces");
    check(b, qm_bvh_refit(&b->ctx, b->tree, b->deformer, &b->mesh, faces, face_count, 1, &updated), "refit");
    qm_context_free(&b->ctx, faces, face_count, sizeof *faces);
}

/** Both runs must find the same pairs. */
static void measure_once(moved_bench *b, qm_bench_times *all, qm_bench_times *part)
{
    qm_collide_options options = qm_collide_options_default();
    qm_collide_changes changes = {b->part, b->part_count, b->before.pairs, b->before.pair_count};
    qm_collision full, after;
    double start = qm_bench_now_ms();
    check(b, qm_collide_self(&b->ctx, b->tree, &options, NULL, &full), "all pairs");
    double middle = qm_bench_now_ms();
    check(b, qm_collide_self(&b->ctx, b->tree, &options, &changes, &after), "changed pairs");
    qm_bench_add(part, 0.0, qm_bench_now_ms() - middle);
    qm_bench_add(all, 0.0, middle - start);
    bool same =
        full.pair_count == after.pair_count &&
        (full.pair_count == 0 || memcmp(full.pairs, after.pairs, full.pair_count * sizeof *full.pairs) == 0);
    if (!same) bench_fail("changed pairs", "they are not those of a full run");
    qm_collide_reset(&b->ctx, &b->before);
    qm_collide_reset(&b->ctx, &full);
    b->before = after;
}

void bench_moved(const char *path)
{
    moved_bench b = {.ctx = qm_host_context()};
    b.mesh = bench_read_mesh(&b.ctx, path, &(bench_change){0});
    b.part = bench_pick_part(&b.mesh, &b.part_count);
    check(&b, qm_bvh_build(&b.ctx, &b.mesh, QM_BVH_SOURCE, 1, &b.tree), "tree");
    check(&b, qm_deformer_build(&b.ctx, b.tree, &b.deformer), "deformer");
    qm_collide_options options = qm_collide_options_default();
    check(&b, qm_collide_self(&b.ctx, b.tree, &options, NULL, &b.before), "pairs");
    long resting_kb = qm_bench_rest();
    qm_bench_times all = {0}, part = {0};
    do {
        move(&b, all.count);
        measure_once(&b, &all, &part);
    } while (qm_bench_wants_more(&all));
    qm_bench_print_times(&part, resting_kb);
    printf(", ");
    qm_bench_print_list("full_ms", all.query_ms, all.count);
    printf(", \"part\": %zu, \"pairs\": %zu}\n", b.part_count, b.before.pair_count);
    qm_collide_reset(&b.ctx, &b.before);
    qm_deformer_destroy(&b.ctx, b.deformer);
    qm_bvh_destroy(&b.ctx, b.tree);
    free(b.part);
    qm_mesh_reset(&b.ctx, &b.mesh);
}
