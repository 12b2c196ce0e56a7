/**
 * collide_overlap.h: the faces of two meshes that lie where the other one has faces too. No others can meet
 * a face of the other mesh, and often those that can are few.
 */
#ifndef QM_COLLIDE_OVERLAP_H
#define QM_COLLIDE_OVERLAP_H

#include "bvh/bvh_part.h"

typedef struct qm_overlap {
    bool is_whole;       /* leaving out faces would not pay: there are no parts */
    bool is_empty;       /* no face can meet another: there are no parts either */
    qm_bvh_part part[2]; /* faces that may meet the other mesh, ready for a tree */
    size_t capacity[2];  /* entries that there is room for */
} qm_overlap;

/**
 * Finds the parts. Faces whose boxes meet are in them, both of them.
 *
 * Returns QM_OK or QM_E_NO_MEMORY; qm_overlap_reset frees in any case.
 */
qm_status qm_overlap_find(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_overlap *out);

void qm_overlap_reset(qm_context *ctx, qm_overlap *overlap);

#endif
