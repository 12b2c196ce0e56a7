#include "hausdorff_ground.h"

#include "prim/tri_point.h"

#define TOUCH 0x1p-36 /* of the reach: two facets of the source meet in a point when both are as near */

static qm_incident_facet ground_of_patch(const qm_vec corner[4], qm_vec place, double *away)
{
    qm_incident_facet ground = {.patch = qm_bilinear_make(corner)};
    qm_bilinear_foot foot = qm_bilinear_descend(&ground.patch, place, INFINITY);
    ground.uv[0] = foot.uv[0];
    ground.uv[1] = foot.uv[1];
    *away = foot.distance;
    return ground;
}

static qm_incident_facet ground_of_triangle(const qm_vec corner[3], qm_vec place, double *away)
{
    qm_incident_facet ground = {
        .patch = {corner[0], qm_vec_sub(corner[1], corner[0]), qm_vec_sub(corner[2], corner[0]), {0, 0, 0}},
        .is_triangle = true,
    };
    qm_triangle triangle = qm_triangle_make(corner[0], corner[1], corner[2]);
    double weight[3];
    qm_triangle_footpoint(&triangle, place, weight);
    ground.uv[0] = weight[1];
    ground.uv[1] = weight[2];
    *away = qm_vec_distance(qm_bilinear_at(&ground.patch, weight[1], weight[2]), place);
    return ground;
}

/** Adds those of a pack. */
static void add_grounds(const qm_side *side, uint32_t pack, qm_vec place, qm_incident_facets *out)
{
    const qm_pack_lanes *lanes = &side->source->lanes[pack];
    for (int lane = 0, count; lane < lanes->lane_count && out->count < QM_MAX_INCIDENT; lane += count - 2) {
        qm_vec corner[4];
        count = qm_side_corners(side, lanes, (uint32_t)lane, corner);
        double away;
        qm_incident_facet ground =
            count == 4 ? ground_of_patch(corner, place, &away) : ground_of_triangle(corner, place, &away);
        ground.face = lanes->face[lane];
        if (away <= TOUCH * side->reach) out->at[out->count++] = ground;
    }
}

void qm_incident_find(const qm_search *search, const qm_side *side, qm_vec place, qm_incident_facets *out)
{
    qm_vec p = qm_vec_scale(1.0 / side->factor, qm_vec_sub(place, side->shift));
    qm_box box = qm_vec_box(&p, 1);
    qm_near_packs near;
    search->kernel->gather(side->source, &box, TOUCH, &near);
    out->count = 0;
    for (int k = 0; k < near.count; k++)
        add_grounds(side, near.pack[k], place, out);
}

int qm_incident_bounds(const qm_incident_facet *ground, const double speed[2], qm_slope walls[QM_MAX_BOUNDS])
{
    double u = ground->uv[0], v = ground->uv[1];
    int count = 0;
    walls[count++] = (qm_slope){{1.0, 0.0}, u * speed[0], true};
    walls[count++] = (qm_slope){{0.0, 1.0}, v * speed[1], true};
    if (ground->is_triangle) {
        double slower = qm_min(speed[0], speed[1]);
        walls[count++] =
            (qm_slope){{-slower / speed[0], -slower / speed[1]}, qm_max(0.0, 1.0 - u - v) * slower, true};
    } else {
        walls[count++] = (qm_slope){{-1.0, 0.0}, (1.0 - u) * speed[0], true};
        walls[count++] = (qm_slope){{0.0, -1.0}, (1.0 - v) * speed[1], true};
    }
    return count;
}

double qm_incident_longest(const qm_incident_facets *grounds)
{
    double largest = 0.0;
    for (int i = 0; i < grounds->count; i++) {
        const qm_bilinear *patch = &grounds->at[i].patch;
        largest = qm_max(largest, qm_max(qm_vec_norm(patch->e1), qm_vec_norm(patch->e2)));
    }
    return largest;
}
