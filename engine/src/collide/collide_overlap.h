/**
 * collide_overlap.h: the parts of two meshes that lie where the other one has faces too. No other faces can
 * meet, and often these are few.
 */
#ifndef QM_COLLIDE_OVERLAP_H
#define QM_COLLIDE_OVERLAP_H

#include "bvh/bvh_build.h"

typedef struct qm_overlap {
    bool is_whole;         /* too few faces would be left out to pay: there are no parts */
    bool is_empty;         /* no two faces can meet: there are no parts either */
    qm_bvh_subset part[2]; /* faces that may meet the other mesh, ready for a tree */
    size_t capacity[2];    /* of the entries of each part */
} qm_overlap;

/**
 * Finds the parts: two faces whose boxes overlap are both in them.
 *
 * Returns QM_OK or QM_E_NO_MEMORY; qm_overlap_reset frees in any case.
 */
qm_status qm_overlap_find(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_overlap *out);

void qm_overlap_reset(qm_context *ctx, qm_overlap *overlap);

#endif
