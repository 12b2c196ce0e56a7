#include "target.h"

#include "slow_twin.h"

void qm_target_search(qm_search *search, qm_side *side, const qm_bvh *target, double allowed)
{
    *search = (qm_search){.kernel = qm_kernel_get(), .floor = allowed};
    *side = (qm_side){.target = target, .scale = 1.0, .inverse_scale = 1.0, .factor = 1.0, .reach = 1.0};
}

double qm_target_distance(const qm_bvh *target, qm_vec p)
{
    double least = INFINITY;
    const double point[3] = {p.x, p.y, p.z};
    for (uint32_t pack = 0; pack < target->pack_count; pack++) {
        for (uint32_t lane = 0; lane < target->lanes[pack].lane_count; lane++) {
            qm_vec corner[3];
            double at[3][3];
            qm_bvh_load_triangle(target, pack, lane, corner);
            for (int i = 0; i < 3; i++)
                qm_vec_store(at[i], corner[i]);
            if (qm_slow_triangle_is_beyond(point, at, least)) continue;
            least = fmin(least, qm_slow_triangle_distance(point, at[0], at[1], at[2]));
        }
    }
    return least;
}
