/**
 * near_points.h: the points of a point set that lie nearest to a place, by the set's own box tree.
 */
#ifndef QM_NEAR_POINTS_H
#define QM_NEAR_POINTS_H

#include "bvh_tree.h"

#define QM_NEAR_POINTS_MAX 32

typedef struct qm_near_points {
    int count;
    uint32_t index[QM_NEAR_POINTS_MAX];  /* vertices, nearest first; of equally near ones the lower first */
    double d2[QM_NEAR_POINTS_MAX];       /* squared distances, local frame of the tree */
    qm_vec position[QM_NEAR_POINTS_MAX]; /* local */
} qm_near_points;

/** The wanted (at most QM_NEAR_POINTS_MAX) points nearest to p, which is in the local frame; fewer where the
 * set has fewer. The tree is that of a point set, built with QM_BVH_TARGET. */
void qm_near_points_find(const qm_bvh *bvh, qm_vec p, int wanted, qm_near_points *out);

#endif
