/* Times a reconstruction, the tree over the surface included, and picks on it. */
#include "engine.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/host.h"
#include "measure.h"
#include "ops/json_layout.h"
#include "qm/reconstruct.h"

#define PICKS 2000

/** A file as text; ends the program without one. */
static char *read_text(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END) != 0) bench_fail(path, "cannot be read");
    long length = ftell(file);
    rewind(file);
    char *text = bench_alloc((size_t)length + 1, 1);
    *size = fread(text, 1, (size_t)length, file);
    fclose(file);
    return text;
}

static qm_layout read_layout(qm_context *ctx, const char *path, const qm_ref_surface *source)
{
    size_t size;
    char *text = read_text(path, &size);
    qm_layout layout;
    qm_layout_issues issues = {0};
    bool has_patches;
    qm_problem problem;
    if (!qm_json_read_layout(ctx, text, size, NULL, NULL, &layout, &has_patches, &problem))
        bench_fail(path, problem.detail);
    if (!has_patches && qm_layout_find_patches(ctx, source, &layout, &issues) != QM_OK)
        bench_fail(path, ctx->message);
    qm_layout_issues_reset(ctx, &issues);
    free(text);
    return layout;
}

/** An eye far above the middle of the surface, which fills the window. */
static qm_camera camera_over(const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    double size = qm_mesh_box_diagonal(&box), near = 2.0 * size, far = 5.0 * size, half = 0.45 * size;
    qm_camera camera = {.view = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1},
                        .viewport = {0, 0, 1000, 1000}};
    for (int k = 0; k < 3; k++)
        camera.view[12 + k] = -0.5 * (box.min[k] + box.max[k]) - (k == 2 ? 3.0 * size : 0.0);
    camera.projection[0] = camera.projection[5] = near / half;
    camera.projection[10] = -(far + near) / (far - near);
    camera.projection[11] = -1.0;
    camera.projection[14] = -2.0 * far * near / (far - near);
    return camera;
}

/** Picks along the diagonals of the window; prints the set-up of a stroke and one pick, in ms. */
static void time_picks(qm_context *ctx, const qm_ref_surface *source)
{
    const qm_camera camera = camera_over(qm_bvh_mesh(source->bvh));
    const qm_pick_options options = {0};
    qm_pick_view view;
    double start = qm_bench_now_ms();
    if (qm_pick_view_init(ctx, source, &camera, &options, &view) != QM_OK) bench_fail("camera", ctx->message);
    double ready = qm_bench_now_ms(), slowest = 0.0;
    size_t hits = 0;
    for (int i = 0; i < PICKS; i++) {
        const double window[2] = {1000.0 * i / PICKS,
                                  i % 2 ? 1000.0 * i / PICKS : 1000.0 - 1000.0 * i / PICKS};
        double at[3], before = qm_bench_now_ms();
        bool found;
        if (qm_pick_point(ctx, &view, window, at, &found) != QM_OK) bench_fail("pick", ctx->message);
        double took = qm_bench_now_ms() - before;
        slowest = took > slowest ? took : slowest;
        hits += found;
    }
    printf(", \"stroke_ms\": %.6f, \"pick_ms\": %.6f, \"slowest_pick_ms\": %.6f, \"hits\": %zu",
           ready - start, (qm_bench_now_ms() - ready) / PICKS, slowest, hits);
}

static size_t take_steps(qm_context *ctx, qm_reconstruction *r, size_t max_quads)
{
    qm_reconstruction_record record;
    do {
        if (qm_reconstruction_step(ctx, r, max_quads, &record) != QM_OK) bench_fail("step", ctx->message);
    } while (record.chords_changed > 0);
    return record.quads;
}

void bench_reconstruct(const char *path, const char *layout_path, size_t max_quads, int threads)
{
    qm_context ctx = qm_host_context();
    qm_mesh mesh = bench_read_any(&ctx, path);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    options.thread_count = threads;
    qm_bench_times times = {0};
    size_t quads;
    long resting_kb = qm_bench_rest();
    qm_bvh *tree;
    qm_ref_surface source;
    do {
        double start = qm_bench_now_ms();
        if (qm_bvh_build(&ctx, &mesh, QM_BVH_TARGET, threads, &tree) != QM_OK)
            bench_fail("tree", ctx.message);
        if (qm_ref_surface_init(&ctx, tree, &source) != QM_OK) bench_fail(path, ctx.message);
        double built = qm_bench_now_ms();
        qm_layout layout = read_layout(&ctx, layout_path, &source);
        qm_reconstruction *r;
        double ready = qm_bench_now_ms();
        if (qm_reconstruction_create(&ctx, &source, &layout, &options, &r) != QM_OK)
            bench_fail(layout_path, ctx.message);
        quads = take_steps(&ctx, r, max_quads);
        qm_bench_add(&times, built - start, qm_bench_now_ms() - ready);
        qm_reconstruction_destroy(&ctx, r);
        qm_layout_reset(&ctx, &layout);
        if (qm_bench_wants_more(&times)) qm_bvh_destroy(&ctx, tree);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    printf(", \"points\": %zu, \"quads\": %zu", mesh.vertex_count, quads);
    time_picks(&ctx, &source);
    printf("}\n");
    qm_bvh_destroy(&ctx, tree);
    qm_mesh_reset(&ctx, &mesh);
}
