/**
 * remesh.c: quads, or quads, a layout and its steps; and the distance of what comes out.
 */
#include "remesh.h"

#include <math.h>

#include "qm/hausdorff.h"
#include "qm/quad_layout.h"
#include "refine.h"

#define TOLERANCE 1e-6      /* of the measured distance, a fraction of the diagonal */
#define GOAL_TOLERANCE 0.05 /* the same of the distance that is wanted, if that is smaller */
#define DEADLINE_MS 20000.0 /* of one measurement; its bounds are valid when it ends early */
#define LEAST_GROWTH 1.5    /* of the number of quads from one mesh to the next */
#define MOST_GROWTH 8.0
#define LAYOUT_QUADS 5000 /* of which a layout is made, or fewer where the limit is lower */
/* A layout of few patches is divided into so many, or fewer where a patch would have less than QUADS_A_PATCH at the end:
 * a large patch may miss an ear. */
#define LAYOUT_PATCHES 250
#define QUADS_A_PATCH 16

static qm_status measure(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                         qm_remesh_result *out)
{
    qm_bvh *tree = NULL;
    qm_status status = qm_bvh_build(ctx, &out->mesh, QM_BVH_TARGET, options->quads.thread_count, &tree);
    if (status != QM_OK) return status;
    qm_hausdorff_options how = qm_hausdorff_options_default();
    how.direction = QM_TWO_SIDED;
    how.tolerance = TOLERANCE * surface->diagonal;
    if (options->distance > 0.0) how.tolerance = fmin(how.tolerance, GOAL_TOLERANCE * options->distance);
    how.deadline_ms = DEADLINE_MS;
    how.thread_count = options->quads.thread_count;
    qm_hausdorff_result result;
    status = qm_hausdorff_measure(ctx, surface->bvh, tree, &how, &result);
    qm_bvh_destroy(ctx, tree);
    out->lower = result.lower;
    out->upper = result.upper;
    return status;
}

/** The distance falls about as the number of quads grows. */
static double growth_for(const qm_remesh_options *options, const qm_remesh_result *now)
{
    return fmin(fmax(1.2 * now->upper / options->distance, LEAST_GROWTH), MOST_GROWTH);
}

static qm_status make_quads(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                            qm_remesh_result *out)
{
    qm_quads_options quads = options->quads;
    for (;;) {
        qm_mesh_reset(ctx, &out->mesh);
        qm_status status = qm_quads_make(ctx, surface->bvh, &quads, &out->mesh, NULL);
        if (status == QM_OK) status = measure(ctx, surface, options, out);
        if (status != QM_OK) return status;
        out->rounds++;
        if (!(options->distance > 0.0) || out->upper <= options->distance) return QM_OK;
        double next = growth_for(options, out) * (double)quads.quads;
        if (next > QM_REMESH_MOST_QUADS) return QM_OK;
        quads.quads = (size_t)next;
    }
}

static void count_step(void *user, const qm_refine_record *record)
{
    (void)record;
    ((qm_remesh_result *)user)->rounds++;
}

static qm_status take_steps(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                            const qm_layout *layout, qm_remesh_result *out)
{
    qm_reconstruction_options how = qm_reconstruction_options_default();
    how.thread_count = options->quads.thread_count;
    qm_reconstruction *r;
    qm_status status = qm_reconstruction_create(ctx, surface, layout, &how, &r);
    if (status != QM_OK) return status;
    const qm_refine_goal goal = {.max_quads = options->quads.quads,
                                 .hausdorff = options->distance,
                                 .thread_count = options->quads.thread_count};
    qm_refine_stop stop;
    status = qm_refine(ctx, r, surface, &goal, count_step, out, &stop);
    if (status == QM_OK && stop == QM_REFINE_CANCELED)
        status = qm_context_fail(ctx, QM_E_CANCELED, "canceled");
    if (status == QM_OK) status = qm_reconstruction_mesh(ctx, r, &out->mesh);
    qm_reconstruction_destroy(ctx, r);
    return status == QM_OK ? measure(ctx, surface, options, out) : status;
}

/** A layout without crossings, if there is one among some numbers of patches. */
static qm_status make_layout(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                             qm_layout *layout)
{
    qm_quads_options quads = options->quads;
    if (quads.quads > LAYOUT_QUADS) quads.quads = LAYOUT_QUADS;
    size_t wanted = options->quads.quads / QUADS_A_PATCH;
    if (wanted > LAYOUT_PATCHES) wanted = LAYOUT_PATCHES;
    const size_t patches[] = {wanted, 0, 2 * wanted};
    qm_status status = QM_OK;
    for (size_t i = 0; i < sizeof patches / sizeof *patches && status == QM_OK; i++) {
        qm_layout_issues issues;
        qm_quad_layout_options how = qm_quad_layout_options_default();
        how.patches = patches[i];
        qm_layout_reset(ctx, layout);
        status = qm_quad_layout_make_of_surface(ctx, surface, &quads, &how, layout, &issues, NULL);
        bool is_good = issues.count == 0;
        qm_layout_issues_reset(ctx, &issues);
        if (is_good) break;
    }
    return status;
}

static qm_status make_semi_regular(qm_context *ctx, const qm_ref_surface *surface,
                                   const qm_remesh_options *options, qm_remesh_result *out)
{
    qm_layout layout = {0};
    qm_status status = make_layout(ctx, surface, options, &layout);
    out->patches = layout.patch_count;
    if (status == QM_OK) status = take_steps(ctx, surface, options, &layout, out);
    qm_layout_reset(ctx, &layout);
    return status;
}

qm_status qm_remesh(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                    qm_remesh_result *out)
{
    *out = (qm_remesh_result){0};
    qm_status status = options->is_semi_regular ? make_semi_regular(ctx, surface, options, out)
                                                : make_quads(ctx, surface, options, out);
    if (status != QM_OK) qm_mesh_reset(ctx, &out->mesh);
    return status;
}
