/**
 * cloud_trim.h: which parts of a surface the points vouch for.
 */
#ifndef QM_CLOUD_TRIM_H
#define QM_CLOUD_TRIM_H

#include "cloud_isosurface.h"
#include "qm/cloud.h"

/** Where a vertex lies among the points. */
typedef struct qm_cloud_place {
    uint32_t point; /* the nearest one */
    float away;     /* the distance from it, in distances from there to its sixth neighbour */
    float
        lean; /* the distance from the mean of the nearest points, in their radius: 0.42 where they end along a line, as the mean
                       of half a disc */
} qm_cloud_place;

#define QM_CLOUD_GAP 2.0 /* the least of `away` in a hole */

/** Finds for each side 3 t + k of the triangles, from corner k of triangle t, the other side of its edge; QM_NO_INDEX where there is
 * none. next has room for all. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_cloud_link_sides(qm_context *ctx, const qm_cloud_triangles *triangles, uint32_t *next);

/**
 * Keeps of the triangles what lies at points, with small holes between; drops sheets of few points, and ends the surface where the
 * points end. Sets the numbers of holes, borders and components and the share of the area that is in holes.
 *
 * place      of each vertex
 * point_count  of all points
 * hole       the greatest diagonal of the box of a hole that is filled
 *
 * QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_cloud_trim(qm_context *ctx, qm_cloud_triangles *triangles, const qm_cloud_place *place,
                        size_t point_count, double hole, qm_cloud_record *record);

/**
 * Closes small ends of the surface by fans: where a sheet without points was cut off, a hole is left in the one with points. The end of a
 * small sheet, which is all of its border, stays. Changes the numbers of holes and borders.
 *
 * hole  the greatest diagonal of the box of an end that is closed
 *
 * QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_cloud_close(qm_context *ctx, qm_cloud_triangles *triangles, double hole,
                         qm_cloud_record *record);

#endif
