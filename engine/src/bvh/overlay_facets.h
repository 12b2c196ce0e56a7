/**
 * overlay_facets.h: facets and faces projected along one direction, for the kernels that compare them and the
 * search that calls these. hausdorff_overlay.c has the argument and derives the margins.
 */
#ifndef QM_OVERLAY_FACETS_H
#define QM_OVERLAY_FACETS_H

#include "bvh_tree.h"
#include "core/rounding.h"

#define QM_OVERLAY_SIDE 128.0 /* u s: margin of half planes, s the greatest coordinate by magnitude */
#define QM_OVERLAY_AREA 64.0  /* u s^2: margin of doubled areas */
#define QM_OVERLAY_GAP 512.0  /* u s (1 + s length / area): margin of vertical distances */

#define QM_OVERLAY_SLOPE 2.0 /* of faces and facets at most, the sum of both axes */

#define QM_OVERLAY_GROUPS 32 /* of eight facets each, that an overlay takes at most */
#define QM_OVERLAY_RIM 128   /* edges of the boundary of these facets */

/** A plane with to_group normal, and the box of interest in to_group coordinates: along the plane (axes 0 and
 * 1) and along the normal (axis 2). */
typedef struct qm_overlay_frame {
    qm_vec origin, axis[3];
    double low[3], high[3];
} qm_overlay_frame;

/** The vertices of a pack in the coordinates of a frame, by axis, and the sides of the box that each lies
 * beyond: bits 2 k and 2 k + 1 for below and above along axis k. */
typedef struct qm_overlay_vertices {
    _Alignas(64) double at[3][3 * QM_PACK_LANES];
    _Alignas(64) int64_t beyond[3 * QM_PACK_LANES];
} qm_overlay_vertices;

#define QM_OVERLAY_BESIDE 15 /* those sides along the plane */

/**
 * Facets of the target in the coordinates of a frame, corner by corner, eight to a group: their planes, off
 * by plane_error at most (INFINITY where a facet is too steep or too thin), and their flatness bounds. Where
 * the target has patches, opposite is the corner of the facet's patch that the facet lacks, at a height of
 * INFINITY where the facet is no part of a patch, or the patch's other facet is missing though it may lie over
 * the box of interest. low and high are the boxes of the groups along the plane. Lanes past count, in the last
 * group, repeat others. The rim is the boundary edges of the facets, each end by to_group coordinates in the
 * plane, padded by copies too.
 */
typedef struct qm_overlay_facets {
    int count, rim_count;
    bool has_patches;
    double size; /* max coordinate of these facets and of the faces by magnitude */
    struct {
        _Alignas(64) double at[3][3][QM_PACK_LANES], twist[QM_PACK_LANES];
        double opposite[3][QM_PACK_LANES];
        double plane[3][QM_PACK_LANES], plane_error[QM_PACK_LANES];
        bool is_second
            [QM_PACK_LANES]; /* set where opposite is: the facet lacks the second corner of its patch */
    } group[QM_OVERLAY_GROUPS];
    _Alignas(64) double low[2][QM_OVERLAY_GROUPS], high[2][QM_OVERLAY_GROUPS];
    _Alignas(64) double rim[2][2][QM_OVERLAY_RIM];
} qm_overlay_facets;

/** A triangle of the source in these coordinates. side[k] = (a, b, c): a x + b y + c is the distance of (x,
 * y) inside the k-th edge. */
typedef struct qm_overlay_face {
    double corner[3][3];
    double side[3][3];
    double plane[3]; /* (a, b, c): to_group height at (x, y) is a x + b y + c */
    double probe[2]; /* a point inside */
} qm_overlay_face;

/** Copies the corners, the opposite one and the twist of a facet from one index to another. */
static inline void qm_overlay_copy_facet(qm_overlay_facets *facets, int from, int to)
{
    QM_ASSERT(from >= 0 && from < QM_OVERLAY_GROUPS * QM_PACK_LANES && to >= 0 &&
              to < QM_OVERLAY_GROUPS * QM_PACK_LANES);
    int lane = from % QM_PACK_LANES, other = to % QM_PACK_LANES;
    int group = from / QM_PACK_LANES, to_group = to / QM_PACK_LANES;
    for (int i = 0; i < 9; i++)
        facets->group[to_group].at[i / 3][i % 3][other] = facets->group[group].at[i / 3][i % 3][lane];
    for (int k = 0; facets->has_patches && k < 3; k++)
        facets->group[to_group].opposite[k][other] = facets->group[group].opposite[k][lane];
    facets->group[to_group].twist[other] = facets->group[group].twist[lane];
    if (facets->has_patches) facets->group[to_group].is_second[other] = facets->group[group].is_second[lane];
}

#endif
