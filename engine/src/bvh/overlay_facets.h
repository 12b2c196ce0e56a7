/**
 * overlay_facets.h: facets and faces as seen along one direction, for the kernels that compare them and the
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

/** A plane with a direction upright to it, and the box of interest in its coordinates: along the plane (axes
 * 0 and 1) and upright (axis 2). */
typedef struct qm_overlay_frame {
    qm_vec origin, axis[3];
    double low[3], high[3];
} qm_overlay_frame;

/** The vertices of a pack in such coordinates, by axis, and on which sides of the box each lies: bits 2 k and
 * 2 k + 1 for below and above along axis k. */
typedef struct qm_overlay_vertices {
    _Alignas(64) double at[3][3 * QM_PACK_LANES];
    _Alignas(64) int64_t beyond[3 * QM_PACK_LANES];
} qm_overlay_vertices;

#define QM_OVERLAY_BESIDE 15 /* those sides along the plane */

/**
 * Facets of the target in such coordinates, corner by corner, eight to a group: their planes, off by
 * plane_error at most (INFINITY where a facet is too steep or too thin), and how far the surface may be from
 * each. low and high are the boxes of the groups along the plane. Places past count, in the last group,
 * repeat others. The rim is made of edges of theirs, ends by their places in the plane, likewise.
 */
typedef struct qm_overlay_facets {
    int count, rim_count;
    double size; /* no coordinate of these facets and of the faces is greater, by magnitude */
    struct {
        _Alignas(64) double at[3][3][QM_PACK_LANES], twist[QM_PACK_LANES];
        double plane[3][QM_PACK_LANES], plane_error[QM_PACK_LANES];
    } group[QM_OVERLAY_GROUPS];
    _Alignas(64) double low[2][QM_OVERLAY_GROUPS], high[2][QM_OVERLAY_GROUPS];
    _Alignas(64) double rim[2][2][QM_OVERLAY_RIM];
} qm_overlay_facets;

/** A triangle of the source over the same plane. side[k] = (a, b, c): a x + b y + c is how far (x, y) lies
 * inside the k-th edge. */
typedef struct qm_overlay_face {
    double corner[3][3];
    double side[3][3];
    double plane[3]; /* (a, b, c): its height at (x, y) is a x + b y + c */
    double probe[2]; /* a place inside */
} qm_overlay_face;

/** Copies the corners and the twist of a facet from one index to another. */
static inline void qm_overlay_copy_facet(qm_overlay_facets *facets, int from, int to)
{
    int lane = from % QM_PACK_LANES, other = to % QM_PACK_LANES;
    int group = from / QM_PACK_LANES, its = to / QM_PACK_LANES;
    for (int i = 0; i < 9; i++)
        facets->group[its].at[i / 3][i % 3][other] = facets->group[group].at[i / 3][i % 3][lane];
    facets->group[its].twist[other] = facets->group[group].twist[lane];
}

#endif
