/**
 * surface.c: footpoints on triangles, quads of two triangles and bilinear patches.
 */
#include "surface.h"

#include <string.h>

#include "prim/bilinear.h"
#include "prim/triangle.h"

/** The footpoint of p on the triangle (c0 c1 c2) of a face, or on the second, (c0 c2 c3), of a quad. */
static qm_surface_point corner_foot(const qm_bvh *bvh, uint32_t face, const qm_vec corner[4], int corners,
                                    bool second, qm_vec p)
{
    qm_vec a = corner[0], b = corner[second ? 2 : 1], c = corner[second ? 3 : 2];
    qm_triangle triangle = qm_triangle_make(a, b, c);
    double weight[3];
    qm_triangle_footpoint(&triangle, p, weight);
    qm_vec at = qm_vec_axpy(qm_vec_axpy(qm_vec_scale(weight[0], a), weight[1], b), weight[2], c);
    qm_surface_point foot = {.face = face};
    if (corners == 3) {
        foot.uv[0] = weight[1];
        foot.uv[1] = weight[2];
    } else {
        foot.uv[0] = second ? weight[1] : weight[1] + weight[2];
        foot.uv[1] = second ? weight[1] + weight[2] : weight[2];
    }
    qm_vec_store(foot.position, qm_frame_world(&bvh->frame, at));
    return foot;
}

qm_surface_point qm_surface_triangle_foot(const qm_bvh *bvh, uint32_t pack, uint32_t lane, qm_vec p)
{
    QM_ASSERT(pack < bvh->pack_count && lane < QM_PACK_LANES);
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    qm_vec corner[4];
    int corners = qm_bvh_load_face(bvh, lanes->face[lane], corner);
    return corner_foot(bvh, lanes->face[lane], corner, corners, qm_lane_is_second(lanes, lane), p);
}

static double local_distance(const qm_bvh *bvh, const qm_surface_point *foot, qm_vec p)
{
    return qm_vec_distance(qm_frame_local(&bvh->frame, foot->position), p);
}

qm_surface_point qm_surface_patch_point(const qm_bvh *bvh, uint32_t face, const double uv[2])
{
    qm_bilinear patch = qm_bvh_load_patch(bvh, face);
    qm_surface_point point = {.face = face, .uv = {uv[0], uv[1]}};
    qm_vec_store(point.position, qm_frame_world(&bvh->frame, qm_bilinear_at(&patch, uv[0], uv[1])));
    return point;
}

qm_surface_point qm_surface_face_foot(const qm_bvh *bvh, qm_quad_reading reading, uint32_t face, qm_vec p,
                                      double error)
{
    qm_vec corner[4];
    int corners = qm_bvh_load_face(bvh, face, corner);
    if (corners == 4 && reading == QM_QUADS_BILINEAR) {
        qm_bilinear patch = qm_bilinear_make(corner);
        qm_bilinear_footpoint found = qm_bilinear_project(&patch, p, error, INFINITY);
        return qm_surface_patch_point(bvh, face, found.uv);
    }
    qm_surface_point foot = corner_foot(bvh, face, corner, corners, false, p);
    if (corners == 3) return foot;
    qm_surface_point second = corner_foot(bvh, face, corner, corners, true, p);
    return local_distance(bvh, &second, p) < local_distance(bvh, &foot, p) ? second : foot;
}
