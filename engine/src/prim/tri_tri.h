/**
 * tri_tri.h: whether two closed triangles have a point in common, decided exactly, and where.
 *
 * Triangles may be degenerate: they are the hulls of their corners, segments or single points. Coordinates
 * are at most QM_ORIENT_LIMIT by magnitude. No function here allocates.
 *
 * Source: two triangles meet when an edge of one meets the other, which the signs of tetrahedra decide:
 * P. Guigue, O. Devillers, Fast and robust triangle-triangle overlap test using orientation predicates, 2003.
 */
#ifndef QM_TRI_TRI_H
#define QM_TRI_TRI_H

#include "core/vec.h"
#include "qm/collide.h"

/** True when the triangles have a point in common; touching counts. */
bool qm_tri_tri_meet(const qm_vec a[3], const qm_vec b[3]);

/**
 * Finds where they meet; false when they do not. The kind is exact; the points are rounded: the two ends of a
 * segment, the two corners of an area that are farthest apart, a single point twice.
 */
bool qm_tri_tri_contact(const qm_vec a[3], const qm_vec b[3], qm_contact *out);

/**
 * For triangles of one mesh, whose corners have these vertex indices: true when they have a point in common
 * besides the corners that they share and, when they share two, the edge between them.
 */
bool qm_tri_tri_cross(const qm_vec a[3], const uint32_t a_index[3], const qm_vec b[3],
                      const uint32_t b_index[3]);

#endif
