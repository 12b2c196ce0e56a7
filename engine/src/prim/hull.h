/**
 * hull.h: convex hulls of one, two or three points in space as exact closed sets (triangles, degenerate ones
 * included), and the intersection of two of them, by exact signs. Nothing here allocates.
 *
 * The intersection is convex, and its extreme points are of three kinds: corners of one hull that lie in the
 * other, crossings of two edges, and an edge of one through the inside of the other. Each is collected once;
 * their count distinguishes a point, a segment and an area.
 */
#ifndef QM_HULL_H
#define QM_HULL_H

#include "orient.h"

/** The hull of count corners that no fewer of them span: a point, a segment or a proper triangle. */
typedef struct qm_hull {
    qm_vec corner[3];
    int count;
} qm_hull;

/** An axis to drop so that the three points still make a triangle; -1 when they lie on a line. */
int qm_hull_axis(qm_vec a, qm_vec b, qm_vec c);

/** The hull of the triangle. */
qm_hull qm_hull_make(const qm_vec corner[3]);

/** The hull of a triangle that is known to be proper. */
static inline qm_hull qm_hull_proper(const qm_vec corner[3])
{
    return (qm_hull){{corner[0], corner[1], corner[2]}, 3};
}

/** The hull of two points, which may be equal. */
static inline qm_hull qm_hull_segment(qm_vec a, qm_vec b)
{
    return (qm_hull){{a, b, b}, qm_vec_compare(a, b) == 0 ? 1 : 2};
}

#define QM_HULL_EXTREMES 12 /* at most */

typedef struct qm_hull_extreme {
    int location[2]; /* in hull 0 and in hull 1: at which corner, on which edge, or inside */
    qm_vec point;    /* rounded, but for corners */
} qm_hull_extreme;

typedef struct qm_hull_intersection {
    const qm_hull *hull[2];
    int enough; /* extremes after which the search may stop */
    int count;
    qm_hull_extreme extreme[QM_HULL_EXTREMES];
} qm_hull_intersection;

/** Collects the extreme points of the intersection of two hulls, until there are enough of them. */
void qm_hull_intersect(const qm_hull *a, const qm_hull *b, int enough, qm_hull_intersection *out);

/** True when the hulls have a point in common. */
bool qm_hull_meets(const qm_hull *a, const qm_hull *b);

/** Finds on which side of a triangle's plane each corner of a hull lies. True when all lie strictly on one
 * side. */
bool qm_hull_find_sides(const qm_vec plane[3], const qm_hull *hull, int side[3], bool *in_plane);

#endif
