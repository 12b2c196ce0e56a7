/**
 * reconstruct_bending.h: the bending energy of a mesh of quads in the moves of its vertices along their normals.
 */
#ifndef QM_RECONSTRUCT_BENDING_H
#define QM_RECONSTRUCT_BENDING_H

#include "core/vec.h"
#include "qm/mesh.h"

enum { QM_BEND_VERTICES = 9 }; /* a vertex and as many as eight round it */

/** A curvature: the sum of `factor` times the moves of the vertices, and the curvature without moves. */
typedef struct qm_bend {
    int count;
    uint32_t vertex[QM_BEND_VERTICES];
    double factor[QM_BEND_VERTICES], curvature, weight;
} qm_bend;

/** Curvatures whose weighted squares are the energy; the weights are areas. */
typedef struct qm_bending {
    size_t count, capacity;
    qm_bend *bends;
    double area; /* of all quads */
} qm_bending;

/** Finds the curvatures of a mesh of quads with unit normals at its vertices. *out is the caller's, for qm_bending_reset.
 * QM_OK or QM_E_NO_MEMORY. */
qm_status qm_bending_create(qm_context *ctx, const qm_mesh *mesh, const qm_vec *normal, qm_bending *out);
void qm_bending_reset(qm_context *ctx, qm_bending *bending);

#endif
