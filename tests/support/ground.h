/**
 * ground.h: a surface to draw layouts on, with its tree. An error ends the test.
 */
#ifndef QM_GROUND_H
#define QM_GROUND_H

#include "qm/source.h"
#include "shapes.h"

typedef struct qm_ground {
    qm_context ctx;
    qm_mesh mesh;
    qm_bvh *tree;
    qm_ref_surface source;
} qm_ground;

/** Takes the mesh over. */
void qm_ground_make(qm_ground *ground, qm_mesh mesh);
void qm_ground_free(qm_ground *ground);

/** count random points of a surface by formula, with Gaussian noise of that deviation along every axis. The
 * seed is the test's. */
qm_mesh qm_ground_sample(qm_shape_fn *at, size_t count, double noise, uint64_t stream);

#endif
