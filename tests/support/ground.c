#include "ground.h"

#include "check.h"

void qm_ground_make(qm_ground *ground, qm_mesh mesh)
{
    *ground = (qm_ground){.ctx = qm_context_make(), .mesh = mesh};
    assert_int_equal(qm_bvh_build(&ground->ctx, &ground->mesh, QM_BVH_TARGET, 1, &ground->tree), QM_OK);
    assert_int_equal(qm_ref_surface_init(&ground->ctx, ground->tree, &ground->source), QM_OK);
}

void qm_ground_free(qm_ground *ground)
{
    qm_bvh_destroy(&ground->ctx, ground->tree);
    qm_shape_free(&ground->mesh);
}

qm_mesh qm_ground_sample(qm_shape_fn *at, size_t count, double noise, uint64_t stream)
{
    qm_random random = qm_random_make(qm_check_seed(), stream);
    qm_mesh points = qm_shape_make(count, 0);
    for (size_t i = 0; i < count; i++) {
        at(NULL, qm_random_range(&random, 0, 1), qm_random_range(&random, 0, 1), points.positions + 3 * i);
        for (size_t k = 0; k < 3 && noise > 0.0; k++) {
            double sum = -6.0; /* of twelve evenly spread numbers: the deviation is 1 */
            for (int n = 0; n < 12; n++)
                sum += qm_random_range(&random, 0, 1);
            points.positions[3 * i + k] += noise * sum;
        }
    }
    return points;
}
