/**
 * hull_meet.h: what two hulls of up to three points have in common, by exact signs. Nothing here allocates.
 *
 * That set is convex, and its extreme points are of three kinds: corners of one hull that lie in the other,
 * crossings of two edges, and an edge of one through the inside of the other. Those are collected, each once;
 * how many there are tells a point from a segment from an area.
 */
#ifndef QM_HULL_MEET_H
#define QM_HULL_MEET_H

#include "tri_hull.h"

#define QM_HULL_EXTREMES 12 /* at most */

typedef struct qm_hull_extreme {
    int place[2]; /* in hull 0 and in hull 1: at which corner, edge, or inside */
    qm_vec point; /* rounded, but for corners */
} qm_hull_extreme;

typedef struct qm_hull_meeting {
    const qm_hull *hull[2];
    int enough; /* extremes after which the search may stop */
    int count;
    qm_hull_extreme extreme[QM_HULL_EXTREMES];
} qm_hull_meeting;

/** Collects the extremes of what two hulls have in common, until there are enough of them. */
void qm_hulls_collect(const qm_hull *a, const qm_hull *b, int enough, qm_hull_meeting *out);

/** True when the hulls have a point in common. */
bool qm_hulls_meet(const qm_hull *a, const qm_hull *b);

/** Sides of the corners of a hull to the plane of a triangle. True when all lie strictly on one side. */
bool qm_hull_find_sides(const qm_vec plane[3], const qm_hull *hull, int side[3], bool *in_plane);

#endif
