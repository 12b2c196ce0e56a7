/**
 * heatmap.h: a surface A cut into triangles with the distance to a surface B at their corners, so that the distance everywhere between them is
 * known to a stated error: colours that are interpolated over them are right.
 *
 * At a point of a triangle with weights l the distance is within the triangle's error of the sum of l_i d_i. A triangle of a bilinear patch is a
 * triangle of its parameters: its corners lie on the patch, and the point with weights l is that of the patch.
 */
#ifndef QM_HEATMAP_H
#define QM_HEATMAP_H

#include "qm/deviation.h"

typedef struct qm_heatmap_options {
    qm_quad_reading quads;
    double error;       /* > 0, unit of the meshes: triangles are cut until their errors are no greater */
    size_t piece_limit; /* triangles besides the initial ones */
    int thread_count;   /* 1 or more */
} qm_heatmap_options;

/** A triangle: corners x y z and their distances, the face of A (in the numbering of the input), and the error. */
#define QM_HEATMAP_COLUMNS 14
enum { QM_HEATMAP_FACE = 12, QM_HEATMAP_ERROR = 13 };

typedef struct qm_heatmap {
    double *row; /* count rows of QM_HEATMAP_COLUMNS numbers, by their faces */
    size_t count;
    double error;     /* the greatest of all triangles, up to rounding */
    bool is_accurate; /* it is no greater than requested */
    double elapsed_ms;
} qm_heatmap;

/**
 * Cuts A. Faces without area are triangles too.
 *
 * Ownership: borrows everything but *out, which is the caller's, for qm_heatmap_reset in the same context.
 * Threads:   only reads the trees; splits its work with ctx->parallel. The result does not depend on them.
 * Returns:   QM_OK, also when the triangles ran out; QM_E_ARGUMENT (error, threads); QM_E_UNSUPPORTED (A is a point set);
 *            QM_E_SCALE; QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out is all zero.
 */
qm_status qm_heatmap_make(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                          const qm_heatmap_options *options, qm_heatmap *out);

void qm_heatmap_reset(qm_context *ctx, qm_heatmap *map);

#endif
