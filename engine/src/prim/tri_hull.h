/**
 * tri_hull.h: hulls of one, two or three points in space as exact closed sets: what triangles are, degenerate
 * ones included.
 */
#ifndef QM_TRI_HULL_H
#define QM_TRI_HULL_H

#include "predicates.h"

/** The hull of count corners that no fewer of them span: a point, a segment or a proper triangle. */
typedef struct qm_hull {
    qm_vec corner[3];
    int count;
} qm_hull;

static inline qm_vec qm_hull_corner(const qm_hull *hull, int i)
{
    return hull->corner[i % hull->count];
}

/** By x, then y, then z: along a line in space this is one of its two directions. */
static inline int qm_vec_compare(qm_vec a, qm_vec b)
{
    if (a.x != b.x) return a.x < b.x ? -1 : 1;
    if (a.y != b.y) return a.y < b.y ? -1 : 1;
    return (a.z > b.z) - (a.z < b.z);
}

/** An axis to drop so that the three points still make a triangle; -1 when they lie on a line. */
int qm_hull_axis(qm_vec a, qm_vec b, qm_vec c);

/** The hull of the triangle. */
qm_hull qm_hull_make(const qm_vec corner[3]);

/** The hull of the triangle when it is known to be a proper one, and of a segment that may be a point. */
static inline qm_hull qm_hull_proper(const qm_vec corner[3])
{
    return (qm_hull){{corner[0], corner[1], corner[2]}, 3};
}

static inline qm_hull qm_hull_segment(qm_vec a, qm_vec b)
{
    return (qm_hull){{a, b, b}, qm_vec_compare(a, b) == 0 ? 1 : 2};
}

#endif
