/**
 * exact_twin.h: contact of triangles decided in whole numbers by the plainest means, to check the engine
 * against. Corners are whole numbers of at most EXACT_TWIN_LIMIT by magnitude, so that nothing overflows.
 *
 * Two hulls meet when 0 is in the hull of the differences of their corners, and a point is in a hull when it
 * is in a simplex of at most four of its corners (Caratheodory). No code or formula is the engine's.
 */
#ifndef QM_EXACT_TWIN_H
#define QM_EXACT_TWIN_H

#include "qm/mesh.h"

#define QM_EXACT_TWIN_LIMIT 1000

typedef struct qm_bigint_point {
    int64_t x[3];
} qm_bigint_point;

/** The sign of the determinant of b - a, c - a, d - a. */
int qm_exact_turn(qm_bigint_point a, qm_bigint_point b, qm_bigint_point c, qm_bigint_point d);

/** True when the closed triangles have a point in common. */
bool qm_exact_meet(const qm_bigint_point a[3], const qm_bigint_point b[3]);

/** True when they have one besides the corners, and the edge between two of them, that are named alike. */
bool qm_exact_cross(const qm_bigint_point a[3], const uint32_t a_index[3], const qm_bigint_point b[3],
                    const uint32_t b_index[3]);

#endif
