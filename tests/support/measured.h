/**
 * measured.h: the engine's Hausdorff distance, deviation or comparison of two meshes in one call, trees and context included.
 */
#ifndef QM_MEASURED_H
#define QM_MEASURED_H

#include "qm/comparison.h"
#include "qm/hausdorff.h"

/** The greatest coordinate of both meshes, by absolute value. */
double qm_measured_size(const qm_mesh *a, const qm_mesh *b);

/** Builds the trees of both meshes; in each case for qm_measured_trees_free. */
qm_status qm_measured_trees(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_bvh *tree[2]);

void qm_measured_trees_free(qm_context *ctx, qm_bvh *tree[2]);

/** Measures on malloc, with real threads when more than one is requested; an error fails the test. */
qm_hausdorff_result qm_measured(const qm_mesh *a, const qm_mesh *b, const qm_hausdorff_options *options);

/** In a context of the test; *out is to be reset, also after an error. */
qm_status qm_measured_deviation_in(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                                   const qm_deviation_options *options, qm_deviation *out);
qm_status qm_measured_comparison_in(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                                    const qm_comparison_options *options, qm_comparison *out);

/** On malloc and one thread; an error fails the test. */
qm_deviation qm_measured_deviation(const qm_mesh *a, const qm_mesh *b, const qm_deviation_options *options);
qm_comparison qm_measured_comparison(const qm_mesh *a, const qm_mesh *b,
                                     const qm_comparison_options *options);

void qm_measured_deviation_free(qm_deviation *deviation);
void qm_measured_comparison_free(qm_comparison *comparison);

/** Fails the test unless the interval holds the value and is no wider than that. */
void qm_measured_holds(qm_interval interval, double value, double width, const char *name);

#endif
