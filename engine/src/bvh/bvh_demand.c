/**
 * bvh_demand.c: making the items of a pack once, whichever thread asks first.
 */
#include "bvh_demand.h"

#include "kernel.h"

/** Fills a claimed slot and publishes it. */
static void fill_float_pack(const qm_bvh *bvh, size_t pack, unsigned slot, const qm_pack_corners *corners)
{
    qm_float_pack *floats = bvh->floats.items;
    qm_kernel_get()->fill_float(&floats[slot], corners->at);
    qm_demand_publish(&bvh->floats, pack, slot);
}

const qm_float_pack *qm_bvh_make_float_pack(const qm_bvh *bvh, size_t pack)
{
    unsigned slot;
    const qm_float_pack *floats = bvh->floats.items;
    if (qm_demand_claim(&bvh->floats, pack, &slot) == QM_DEMAND_WANTED) {
        qm_pack_corners corners;
        qm_kernel_get()->load_corners(bvh, pack, &corners);
        fill_float_pack(bvh, pack, slot, &corners);
    }
    return &floats[slot];
}

void qm_bvh_put_float_pack(const qm_bvh *bvh, size_t pack, const qm_pack_corners *corners)
{
    unsigned slot;
    if (qm_demand_claim(&bvh->floats, pack, &slot) == QM_DEMAND_WANTED)
        fill_float_pack(bvh, pack, slot, corners);
}

const qm_pack *qm_bvh_make_pack(const qm_bvh *bvh, size_t pack, qm_pack *spare)
{
    unsigned slot;
    qm_demand_claim_result answer = qm_demand_claim(&bvh->rows, pack, &slot);
    qm_pack *out = answer == QM_DEMAND_FULL ? spare : (qm_pack *)bvh->rows.items + slot;
    if (answer == QM_DEMAND_MADE) return out;
    const qm_kernel *kernel = qm_kernel_get();
    qm_pack_corners corners;
    kernel->load_corners(bvh, pack, &corners);
    kernel->fill_pack(out, corners.at);
    if (answer == QM_DEMAND_WANTED) qm_demand_publish(&bvh->rows, pack, slot);
    return out;
}

/** Bound of the distance of points of a quad's patch from its two triangles; 0 for a triangle. Local. */
static double face_twist(const qm_bvh *bvh, uint32_t face)
{
    qm_vec corner[4];
    return qm_bvh_load_face(bvh, face, corner) == 3 ? 0.0 : qm_bilinear_twist(corner);
}

static void fill_twists(const qm_bvh *bvh, size_t pack, qm_pack_twists *twists)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    for (uint32_t lane = 0; lane < QM_PACK_LANES; lane++)
        twists->lane[lane] = qm_lane_is_second(lanes, lane) ? twists->lane[lane - 1]
                                                            : (float)face_twist(bvh, lanes->face[lane]);
}

const qm_pack_twists *qm_bvh_make_twists(const qm_bvh *bvh, size_t pack)
{
    unsigned slot;
    qm_pack_twists *twists = bvh->twists.items;
    if (qm_demand_claim(&bvh->twists, pack, &slot) == QM_DEMAND_WANTED) {
        fill_twists(bvh, pack, &twists[slot]);
        qm_demand_publish(&bvh->twists, pack, slot);
    }
    return &twists[slot];
}
