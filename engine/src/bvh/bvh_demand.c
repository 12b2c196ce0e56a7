#include "bvh_demand.h"

#include "kernel.h"

/** Fills a claimed place and publishes it. */
static void fill_floats(const qm_bvh *bvh, size_t pack, unsigned place, const qm_pack_corners *corners)
{
    qm_float_pack *floats = bvh->floats.items;
    qm_kernel_get()->fill_float(&floats[place], corners->at);
    qm_demand_publish(&bvh->floats, pack, place);
}

const qm_float_pack *qm_bvh_make_floats(const qm_bvh *bvh, size_t pack)
{
    unsigned place;
    const qm_float_pack *floats = bvh->floats.items;
    if (qm_demand_claim(&bvh->floats, pack, &place) == QM_DEMAND_WANTED) {
        qm_pack_corners corners;
        qm_kernel_get()->load_corners(bvh, pack, &corners);
        fill_floats(bvh, pack, place, &corners);
    }
    return &floats[place];
}

void qm_bvh_put_floats(const qm_bvh *bvh, size_t pack, const qm_pack_corners *corners)
{
    unsigned place;
    if (qm_demand_claim(&bvh->floats, pack, &place) == QM_DEMAND_WANTED)
        fill_floats(bvh, pack, place, corners);
}

const qm_pack *qm_bvh_make_rows(const qm_bvh *bvh, size_t pack, qm_pack *spare)
{
    unsigned place;
    qm_demand_answer answer = qm_demand_claim(&bvh->rows, pack, &place);
    qm_pack *rows = answer == QM_DEMAND_FULL ? spare : (qm_pack *)bvh->rows.items + place;
    if (answer == QM_DEMAND_MADE) return rows;
    const qm_kernel *kernel = qm_kernel_get();
    qm_pack_corners corners;
    kernel->load_corners(bvh, pack, &corners);
    kernel->fill_pack(rows, corners.at);
    if (answer == QM_DEMAND_WANTED) qm_demand_publish(&bvh->rows, pack, place);
    return rows;
}

/** How far the patch of a quad leaves its two triangles at most; 0 for a triangle. Local. */
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
    unsigned place;
    qm_pack_twists *twists = bvh->twists.items;
    if (qm_demand_claim(&bvh->twists, pack, &place) == QM_DEMAND_WANTED) {
        fill_twists(bvh, pack, &twists[place]);
        qm_demand_publish(&bvh->twists, pack, place);
    }
    return &twists[place];
}
