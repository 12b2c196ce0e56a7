/**
 * collide_overlap.h: the faces of two meshes that lie where the other one has faces too. No others can meet
 * a face of the other mesh, and often those that can are few.
 */
#ifndef QM_COLLIDE_OVERLAP_H
#define QM_COLLIDE_OVERLAP_H

#include "qm/mesh.h"

typedef struct qm_overlap {
    qm_mesh part[2];    /* faces that may meet the other mesh, positions borrowed; face_origin leads to the
                           input */
    size_t capacity[2]; /* faces that there is room for; 0 when the part is the mesh itself */
    bool is_empty;      /* no face can meet another; the parts are then of no use */
} qm_overlap;

/**
 * Finds the parts: whole meshes where leaving out faces would not pay. Faces whose boxes meet are in the
 * parts, both of them.
 *
 * Returns QM_OK or QM_E_NO_MEMORY; qm_overlap_reset frees in any case. The meshes must outlive the parts.
 */
qm_status qm_overlap_find(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_overlap *out);

void qm_overlap_reset(qm_context *ctx, qm_overlap *overlap);

#endif
