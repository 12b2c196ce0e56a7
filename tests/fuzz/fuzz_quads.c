/*
 * libFuzzer target over layouts of quad meshes: quads that are folded, one-sided, without extent or no manifold, on their own
 * surface and on another one, and quads that are made of such a surface. What comes of it is a layout that can be
 * checked, or a status with words.
 */
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

#include "fuzz_check.h"
#include "qm/quad_layout.h"
#include "qm/reconstruct.h"
#include "sheet.h"

#define EFFORT 20
#define STEP_QUADS 300
/* Then calls are canceled, as those of clients are by their deadlines: needles take long. */
#define MOST_POLLS 100000

typedef struct patience {
    atomic_bool is_watched, is_over;
    size_t polls;
} patience;

static void count_poll(void *user)
{
    patience *p = user;
    if (++p->polls >= MOST_POLLS) atomic_store(&p->is_over, true);
}

static bool is_canceled(const qm_context *ctx)
{
    return atomic_load(ctx->cancel);
}

static void check_mesh(qm_context *ctx, const qm_mesh *mesh)
{
    qm_context own = *ctx;
    CHECK(qm_mesh_validate(&own, mesh) == QM_OK);
}

/** A layout that is whole has a mesh, with grids at once and else by a step. */
static void reconstruct(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                        const double *grids)
{
    qm_reconstruction_options options = qm_reconstruction_options_default();
    options.grids = grids;
    qm_quads_options quads = qm_quads_options_default();
    quads.quads = STEP_QUADS;
    qm_mesh mesh;
    if (grids &&
        qm_fuzz_succeeded(ctx, qm_reconstruction_fill_grids(ctx, surface, layout, &options, &quads, &mesh))) {
        check_mesh(ctx, &mesh);
        CHECK(mesh.face_count <= STEP_QUADS);
        qm_mesh_reset(ctx, &mesh);
    }
    qm_reconstruction *made;
    qm_reconstruction_record record;
    if (!qm_fuzz_succeeded(ctx, qm_reconstruction_create(ctx, surface, layout, &options, &made))) return;
    bool is_done = qm_fuzz_succeeded(ctx, qm_reconstruction_step(ctx, made, STEP_QUADS, &record));
    CHECK(is_done || is_canceled(ctx));
    if (is_done && qm_fuzz_succeeded(ctx, qm_reconstruction_mesh(ctx, made, &mesh))) {
        check_mesh(ctx, &mesh);
        qm_mesh_reset(ctx, &mesh);
    } else {
        CHECK(is_canceled(ctx));
    }
    qm_reconstruction_destroy(ctx, made);
}

/** A curve ends at its nodes, and a patch is closed. */
static void check_layout(const qm_layout *layout)
{
    for (size_t i = 0; i < layout->curve_count; i++)
        CHECK(layout->curves[i].from < layout->node_count && layout->curves[i].to < layout->node_count &&
              layout->curves[i].point_count >= 2);
    for (size_t p = 0; p < layout->patch_count; p++)
        for (int k = 0; k < 4; k++) {
            const qm_layout_patch *patch = &layout->patches[p];
            const qm_curve *curve = &layout->curves[patch->side[k]];
            CHECK((patch->against[k] ? curve->from : curve->to) ==
                  qm_layout_corner(layout, patch, (k + 1) % 4));
        }
}

static void take_over(qm_context *ctx, const qm_ref_surface *surface, qm_status status, qm_layout *layout,
                      qm_layout_issues *issues, double *grids)
{
    if (qm_fuzz_succeeded(ctx, status)) {
        check_layout(layout);
        reconstruct(ctx, surface, layout, grids);
    } else {
        CHECK(layout->patch_count == 0 && issues->count == 0);
    }
    qm_quad_layout_free_grids(ctx, layout, grids);
    qm_layout_issues_reset(ctx, issues);
    qm_layout_reset(ctx, layout);
}

static void lay_out(qm_context *ctx, const qm_mesh *quads, const qm_ref_surface *surface, uint8_t choice)
{
    static const double angles[] = {0, 40, 180, 1};
    qm_quad_layout_options options = {.crease_angle = angles[choice % 4],
                                      .patches = choice / 4 % 4 * 20,
                                      .effort = choice / 16 % 2 ? EFFORT : 0};
    qm_layout layout;
    qm_layout_issues issues;
    qm_quad_layout_facts facts;
    if (choice / 32 % 2 && surface->bvh) {
        qm_quads_options make = qm_quads_options_default();
        double *grids = NULL;
        make.quads = 30;
        make.crease_angle = options.crease_angle;
        qm_status status = qm_quad_layout_make_of_surface(ctx, surface, &make, NULL, &options, &layout,
                                                          &issues, &facts, &grids);
        take_over(ctx, surface, status, &layout, &issues, grids);
    }
    qm_status status = qm_quad_layout_make(ctx, quads, surface, &options, &layout, &issues, &facts);
    take_over(ctx, surface, status, &layout, &issues, NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    qm_bytes bytes = {data, size};
    qm_context ctx = qm_context_make();
    patience watch = {.is_watched = true};
    ctx.cancel = &watch.is_over, ctx.pause = &watch.is_watched;
    ctx.wait = count_poll, ctx.wait_user = &watch;
    uint8_t choice = qm_bytes_take(&bytes);
    static qm_sheet quads, other;
    qm_sheet_grid grid = qm_sheet_read_grid(&bytes, QM_SHEET_SIDE);
    qm_sheet_make(&grid, &quads);
    qm_sheet_break(&quads, &bytes);
    const qm_mesh *target = &quads.mesh;
    if (choice / 64 == 1) { /* on another surface, or on points */
        grid = qm_sheet_read_grid(&bytes, QM_SHEET_SIDE);
        qm_sheet_make(&grid, &other);
        qm_sheet_break(&other, &bytes);
        if (qm_bytes_take(&bytes) % 4 == 0) other.mesh.face_count = 0;
        target = &other.mesh;
    }
    if (qm_mesh_validate(&ctx, &quads.mesh) != QM_OK || qm_mesh_validate(&ctx, target) != QM_OK) return 0;
    qm_bvh *tree;
    qm_ref_surface surface;
    if (!qm_fuzz_succeeded(&ctx, qm_bvh_build(&ctx, target, QM_BVH_TARGET, 1, &tree))) return 0;
    if (qm_fuzz_succeeded(&ctx, qm_ref_surface_init(&ctx, tree, &surface)))
        lay_out(&ctx, &quads.mesh, &surface, choice);
    qm_bvh_destroy(&ctx, tree);
    return 0;
}
