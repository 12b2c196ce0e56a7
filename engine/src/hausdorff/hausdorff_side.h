/**
 * hausdorff_side.h: one direction of a measurement: the points of a source, measured to a target.
 *
 * Every side computes in the local space of its target. The scale of that is a power of two, so a length
 * changes between local and world units without rounding. The bounds in the queue are in world units.
 */
#ifndef QM_HAUSDORFF_SIDE_H
#define QM_HAUSDORFF_SIDE_H

#include "bvh/bvh_demand.h"
#include "bvh/nearest.h"

/** A pack of the source whose centre was measured before the search starts. */
typedef struct qm_seed {
    double distance; /* an upper bound, local; INFINITY where the search was stopped before it */
    uint32_t hint;   /* a pack of the target near it */
} qm_seed;

/** One direction. */
typedef struct qm_side {
    const qm_bvh *source, *target;
    qm_locator nearest;          /* over target: finds the nearest points of samples */
    double scale, inverse_scale; /* local = world * scale */
    double factor;               /* from the source's local space to the target's: p -> factor p + shift */
    qm_vec shift;
    double reach;        /* largest local coordinate of either surface */
    bool target_patches; /* read the target's quads as bilinear patches */
    bool source_patches;
    size_t seed_step, seed_count; /* packs of the source from seed to seed, and the number of seeds */
    qm_seed *seeds;               /* NULL: none */
} qm_side;

/** A vertex of the source in local space. */
static inline qm_vec qm_side_vertex(const qm_side *side, uint32_t vertex)
{
    return qm_frame_local(&side->target->frame, side->source->mesh.positions + 3 * (size_t)vertex);
}

/** Corners, in local space, of the source's face that starts at a lane, in the order of qm_lane_corners. */
static inline int qm_side_corners(const qm_side *side, const qm_pack_lanes *lanes, uint32_t lane,
                                  qm_vec corner[4])
{
    int index[4], count = qm_lane_corners(lanes, lane, side->source_patches, index);
    for (int i = 0; i < count; i++)
        corner[i] = qm_side_vertex(side, lanes->vertex[index[i]]);
    return count;
}

/** Flatness bound: how far the surface of a lane's face can be from the lane's triangle. 0 unless patches are
 * read. Local. */
static inline double qm_side_twist(const qm_side *side, uint32_t pack, uint32_t lane)
{
    return side->target_patches ? (double)qm_bvh_twists(side->target, pack)[lane] : 0.0;
}

/** The flatness bounds of all lanes; NULL unless patches are read. */
static inline const float *qm_side_twists(const qm_side *side, uint32_t pack)
{
    return side->target_patches ? qm_bvh_twists(side->target, pack) : NULL;
}

#endif
