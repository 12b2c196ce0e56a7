/**
 * tmesh_polygon.h: a one to one map of a convex polygon onto a simple one: both are cut into the same triangles.
 */
#ifndef QM_TMESH_POLYGON_H
#define QM_TMESH_POLYGON_H

#include "tmesh/tmesh_chart.h"

/** Its arrays are the arena's. */
typedef struct qm_tmesh_polygon {
    size_t count; /* corners; there are two triangles less */
    const qm_tmesh_flat *corner;
    qm_tmesh_flat *round; /* corners of the convex polygon, on the circle of radius 1 */
    uint32_t (*triangle)[3];
} qm_tmesh_polygon;

/**
 * Cuts a simple polygon, of three corners or more, into triangles by its ears, the best-shaped first. The polygon is kept, not
 * copied.
 *
 * Returns: QM_OK, with *is_cut false where rounding leaves no ear; QM_E_NO_MEMORY.
 */
qm_status qm_tmesh_polygon_cut(qm_arena *arena, const qm_tmesh_flat *corner, size_t count,
                               qm_tmesh_polygon *out, bool *is_cut);

/** Where a point of the convex polygon is in the other one. */
qm_tmesh_flat qm_tmesh_polygon_map(const qm_tmesh_polygon *polygon, qm_tmesh_flat point);

#endif
