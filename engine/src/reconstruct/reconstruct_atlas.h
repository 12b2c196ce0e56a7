/**
 * reconstruct_atlas.h: the first parameters of samples. reconstruct_atlas.c finds them; reconstruct_outline.c
 * makes the nodes on the curves and sees to it that all patches turn the same way.
 */
#ifndef QM_RECONSTRUCT_ATLAS_H
#define QM_RECONSTRUCT_ATLAS_H

#include "core/heap.h"
#include "layout/surface_graph.h"
#include "reconstruct_work.h"

/** A point of the outline of patches, whose parameters are known. */
typedef struct qm_fixed_node {
    uint32_t curve;  /* QM_NO_INDEX for a node of the layout */
    uint32_t corner; /* that node */
    double t;        /* share of the curve's length */
    qm_vec tangent;  /* along the curve */
} qm_fixed_node;

/** Samples first, then fixed nodes. */
typedef struct qm_atlas_nodes {
    size_t count, sample_count;
    double *positions; /* rows of x y z */
    qm_fixed_node *fixed;
} qm_atlas_nodes;

/** Nodes on the curves that patches have, about as dense as the samples. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_atlas_nodes_create(qm_context *ctx, const qm_reconstruction *r, const qm_samples *samples,
                                qm_atlas_nodes *out);
void qm_atlas_nodes_reset(qm_context *ctx, qm_atlas_nodes *nodes);

/** Turns the normals of a graph, the first nodes of which are the samples, to the side that the samples' own
 * tell. False when they have none, or too many neighbours look to different sides. */
bool qm_samples_orient(const qm_samples *samples, qm_surface_graph *graph);

/** Turns patches so that those that share a curve go along it in opposite ways: all of a connected part then
 * turn the same way. */
qm_status qm_atlas_join_patches(qm_context *ctx, qm_reconstruction *r);

/** Turns each connected part of the patches as the normals of the surface say: anticlockwise about them. */
qm_status qm_atlas_turn_patches(qm_context *ctx, qm_reconstruction *r, const qm_atlas_nodes *nodes,
                                const qm_surface_graph *graph);

/** Patch and parameters of all samples. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_atlas_locate(qm_context *ctx, qm_reconstruction *r, const qm_atlas_nodes *nodes,
                          qm_samples *samples);

#endif
