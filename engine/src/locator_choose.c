/**
 * locator_choose.c: what AUTO stands for. A grid finds the nearest points of those that lie very near to the
 * surface up to a fifth faster than the boxes do, those of far ones several times slower, and takes about as
 * long to build as it saves on one point for each triangle.
 */
#include "grid_cells.h"
#include "qm/project.h"

#define SAMPLE 64      /* points that are looked at */
#define MOST_FAR 4     /* of them that may be farther than */
#define NEAR_CELLS 0.2 /* of a cell's edge: from there on the boxes are as fast */

static bool are_near(const double *distance, size_t count, double limit)
{
    size_t far = 0;
    for (size_t i = 0; i < count; i++)
        far += !(distance[i] <= limit);
    return far * SAMPLE <= count * MOST_FAR;
}

qm_accelerator qm_locator_choose(qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading,
                                 const double *points, size_t point_count, size_t total_count)
{
    if (reading != QM_QUADS_TRIANGLES || point_count == 0 || total_count < QM_PACK_LANES * bvh->pack_count)
        return QM_ACCELERATOR_BOXES;
    double sample[SAMPLE][3], distance[SAMPLE];
    size_t count = point_count < SAMPLE ? point_count : SAMPLE;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < 3; k++)
            sample[i][k] = points[3 * (i * point_count / count) + k];
    const qm_projection out = {.distance = distance};
    if (qm_project_points(ctx, bvh, reading, sample[0], count, 1, &out) != QM_OK) return QM_ACCELERATOR_BOXES;
    double limit = NEAR_CELLS * qm_grid_first_edge(bvh) * bvh->frame.inverse_scale;
    return are_near(distance, count, limit) ? QM_ACCELERATOR_GRID : QM_ACCELERATOR_BOXES;
}
