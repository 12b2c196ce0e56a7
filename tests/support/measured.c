#include "measured.h"

#include "base/host.h"
#include "check.h"

#include <math.h>
#include <string.h>

double qm_measured_size(const qm_mesh *a, const qm_mesh *b)
{
    double size = 0;
    for (size_t i = 0; i < 3 * a->vertex_count; ++i)
        size = fmax(size, fabs(a->positions[i]));
    for (size_t i = 0; i < 3 * b->vertex_count; ++i)
        size = fmax(size, fabs(b->positions[i]));
    return size;
}

qm_status qm_measured_trees(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_bvh *tree[2])
{
    tree[0] = tree[1] = NULL;
    qm_status status = qm_bvh_build(ctx, a, QM_BVH_ALL, 1, &tree[0]);
    return status == QM_OK ? qm_bvh_build(ctx, b, QM_BVH_ALL, 1, &tree[1]) : status;
}

void qm_measured_trees_free(qm_context *ctx, qm_bvh *tree[2])
{
    qm_bvh_destroy(ctx, tree[0]);
    qm_bvh_destroy(ctx, tree[1]);
}

qm_hausdorff_result qm_measured(const qm_mesh *a, const qm_mesh *b, const qm_hausdorff_options *options)
{
    qm_context ctx = qm_context_make();
    if (options->thread_count > 1) ctx.parallel = qm_host_parallel;
    qm_bvh *tree[2];
    qm_hausdorff_result result;
    qm_status status = qm_measured_trees(&ctx, a, b, tree);
    if (status == QM_OK) status = qm_hausdorff_measure(&ctx, tree[0], tree[1], options, &result);
    QM_CHECK(status == QM_OK, "status %s: %s", qm_status_code(status), ctx.message);
    qm_measured_trees_free(&ctx, tree);
    return result;
}

qm_status qm_measured_deviation_in(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                                   const qm_deviation_options *options, qm_deviation *out)
{
    qm_bvh *tree[2];
    memset(out, 0, sizeof *out);
    qm_status status = qm_measured_trees(ctx, a, b, tree);
    if (status == QM_OK) status = qm_deviation_measure(ctx, tree[0], tree[1], options, out);
    qm_measured_trees_free(ctx, tree);
    return status;
}

qm_status qm_measured_comparison_in(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                                    const qm_comparison_options *options, qm_comparison *out)
{
    qm_bvh *tree[2];
    memset(out, 0, sizeof *out);
    qm_status status = qm_measured_trees(ctx, a, b, tree);
    if (status == QM_OK) status = qm_comparison_measure(ctx, tree[0], tree[1], options, NULL, out);
    qm_measured_trees_free(ctx, tree);
    return status;
}

qm_deviation qm_measured_deviation(const qm_mesh *a, const qm_mesh *b, const qm_deviation_options *options)
{
    qm_context ctx = qm_context_make();
    qm_deviation out;
    assert_int_equal(qm_measured_deviation_in(&ctx, a, b, options, &out), QM_OK);
    return out;
}

qm_comparison qm_measured_comparison(const qm_mesh *a, const qm_mesh *b, const qm_comparison_options *options)
{
    qm_context ctx = qm_context_make();
    qm_comparison out;
    assert_int_equal(qm_measured_comparison_in(&ctx, a, b, options, &out), QM_OK);
    return out;
}

void qm_measured_deviation_free(qm_deviation *deviation)
{
    qm_context ctx = qm_context_make();
    qm_deviation_reset(&ctx, deviation);
}

void qm_measured_comparison_free(qm_comparison *comparison)
{
    qm_context ctx = qm_context_make();
    qm_comparison_reset(&ctx, comparison);
}

void qm_measured_holds(qm_interval interval, double value, double width, const char *name)
{
    QM_CHECK(interval.lower <= value && value <= interval.upper, "%s: %.17g is not in [%.17g, %.17g]", name,
             value, interval.lower, interval.upper);
    QM_CHECK(interval.upper - interval.lower <= width, "%s: [%.17g, %.17g]", name, interval.lower,
             interval.upper);
}
