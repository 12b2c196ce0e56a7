#include "measured.h"

#include "base/host.h"
#include "check.h"

#include <math.h>

double qm_measured_size(const qm_mesh *a, const qm_mesh *b)
{
    double size = 0;
    for (size_t i = 0; i < 3 * a->vertex_count; ++i)
        size = fmax(size, fabs(a->positions[i]));
    for (size_t i = 0; i < 3 * b->vertex_count; ++i)
        size = fmax(size, fabs(b->positions[i]));
    return size;
}

qm_hausdorff_result qm_measured(const qm_mesh *a, const qm_mesh *b, const qm_hausdorff_options *options)
{
    qm_context ctx = qm_context_make();
    if (options->thread_count > 1) ctx.parallel = qm_host_parallel;
    qm_bvh *tree_a = NULL, *tree_b = NULL;
    qm_hausdorff_result result;
    qm_status status = qm_bvh_build(&ctx, a, QM_BVH_ALL, 1, &tree_a);
    if (status == QM_OK) status = qm_bvh_build(&ctx, b, QM_BVH_ALL, 1, &tree_b);
    if (status == QM_OK) status = qm_hausdorff_measure(&ctx, tree_a, tree_b, options, &result);
    QM_CHECK(status == QM_OK, "status %s: %s", qm_status_code(status), ctx.message);
    qm_bvh_destroy(&ctx, tree_a);
    qm_bvh_destroy(&ctx, tree_b);
    return result;
}
