/**
 * bvh_pack.h: what a pack holds of its faces' geometry, from where their vertices are now: shared by the
 * builder and by refitting.
 */
#ifndef QM_BVH_PACK_H
#define QM_BVH_PACK_H

#include "bilinear_point.h"
#include "kernel.h"

/** Loads the vertices of a pack, local; returns how many there are. */
static inline int qm_bvh_load_pack(const qm_bvh *bvh, size_t pack, qm_vec vertex[3 * QM_PACK_LANES])
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    int count = 0;
    do
        vertex[count] = qm_bvh_vertex(bvh, lanes->vertex[count]);
    while (++count < lanes->vertex_count);
    return count;
}

/** The same corners about the middle of the first lane's, in single precision. */
static inline void qm_bvh_fill_float(const qm_kernel *kernel, qm_float_pack *pack,
                                     const double corner[3][3][QM_PACK_LANES])
{
    float about[3][3][QM_PACK_LANES];
    for (int k = 0; k < 3; k++) {
        pack->middle[k] = (float)((corner[0][k][0] + corner[0][k][QM_PACK_LANES / 2]) * 0.5);
        for (int i = 0; i < 3; i++)
            for (int lane = 0; lane < QM_PACK_LANES; lane++)
                about[i][k][lane] = (float)(corner[i][k][lane] - (double)pack->middle[k]);
    }
    kernel->fill_float(pack, about);
}

/** The corners of a pack's lanes, local: at[corner][axis][lane]; lanes past the last repeat the first. */
typedef struct qm_pack_corners {
    _Alignas(64) double at[3][3][QM_PACK_LANES];
} qm_pack_corners;

/** Loads the corners of one lane of a pack, to be lane at of others. */
static inline void qm_bvh_load_lane(const qm_bvh *bvh, uint32_t pack, uint32_t lane, int at,
                                    qm_pack_corners *out)
{
    qm_vec corner[3];
    qm_bvh_load_triangle(bvh, pack, lane, corner);
    for (int i = 0; i < 3; i++) {
        out->at[i][0][at] = corner[i].x;
        out->at[i][1][at] = corner[i].y;
        out->at[i][2][at] = corner[i].z;
    }
}

static inline void qm_bvh_load_corners(const qm_bvh *bvh, size_t pack, qm_pack_corners *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    qm_vec vertex[3 * QM_PACK_LANES];
    qm_bvh_load_pack(bvh, pack, vertex);
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        const uint8_t *place = lanes->corner[lane < lanes->lane_count ? lane : 0];
        for (int i = 0; i < 3; i++) {
            out->at[i][0][lane] = vertex[place[i]].x;
            out->at[i][1][lane] = vertex[place[i]].y;
            out->at[i][2][lane] = vertex[place[i]].z;
        }
    }
}

/** How far the patch of a quad leaves its two triangles at most; 0 for a triangle. Local. */
static inline double qm_bvh_face_twist(const qm_bvh *bvh, uint32_t face)
{
    qm_vec corner[4];
    return qm_bvh_load_face(bvh, face, corner) == 3 ? 0.0 : qm_patch_twist(corner);
}

static inline void qm_bvh_fill_twist(qm_bvh *bvh, size_t pack)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    for (uint32_t lane = 0; lane < QM_PACK_LANES; lane++) {
        bvh->twist[pack][lane] = qm_lane_is_second(lanes, lane)
                                     ? bvh->twist[pack][lane - 1]
                                     : (float)qm_bvh_face_twist(bvh, lanes->face[lane]);
    }
}

/** Fills the float pack and the twists that the tree has. */
static inline void qm_bvh_fill_pack(const qm_kernel *kernel, qm_bvh *bvh, size_t pack)
{
    if (bvh->float_packs) {
        qm_pack_corners corners;
        qm_bvh_load_corners(bvh, pack, &corners);
        qm_bvh_fill_float(kernel, &bvh->float_packs[pack], corners.at);
    }
    if (bvh->twist) qm_bvh_fill_twist(bvh, pack);
}

#endif
