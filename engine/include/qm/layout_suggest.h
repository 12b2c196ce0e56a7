/**
 * layout_suggest.h: curves that would bring a layout nearer to completion.
 */
#ifndef QM_LAYOUT_SUGGEST_H
#define QM_LAYOUT_SUGGEST_H

#include "qm/layout_edit.h"

typedef enum qm_layout_suggestion_kind {
    QM_SUGGEST_FEATURE, /* along a crease or boundary of the mesh that no curve runs along */
    QM_SUGGEST_END,     /* from an end where no other curve begins to a node of the same cell */
    QM_SUGGEST_JOIN,    /* between parts of the drawing that no curve connects */
    QM_SUGGEST_DIVIDE,  /* across a cell of more than six sides */
    QM_SUGGEST_IMAGE,   /* the mirror image of a curve that has none */
    QM_SUGGEST_KIND_COUNT
} qm_layout_suggestion_kind;

typedef struct qm_layout_suggestion {
    qm_layout_suggestion_kind kind;
    qm_curve_mark mark;
    uint32_t sides; /* of the cell that is divided */
    size_t point_count;
    double *points; /* rows of x y z, on the surface; as a stroke it becomes the curve */
} qm_layout_suggestion;

typedef struct qm_layout_suggestions {
    qm_layout_suggestion *items;
    size_t count;
} qm_layout_suggestions;

/**
 * Suggests curves for a layout. While features of a mesh have no curve only these are suggested; then curves that cross
 * neither what is drawn nor each other, at most one for each end, part and cell.
 *
 * options  of the features
 * most     suggestions, 1 or more
 *
 * Ownership: *out is the caller's, for qm_layout_suggestions_reset; empty after an error.
 * Returns:   QM_OK; QM_E_ARGUMENT (an option); QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_layout_suggest(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                            const qm_layout_features_options *options, size_t most,
                            qm_layout_suggestions *out);

/**
 * Suggests the mirror images, at a plane, of curves on one side of it that have none within a radius; their ends are at the nodes that are
 * the images of the curves' own, where there are such.
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED; *out as above.
 */
qm_status qm_layout_suggest_images(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                                   const double point[3], const double normal[3], double radius, size_t most,
                                   qm_layout_suggestions *out);
void qm_layout_suggestions_reset(qm_context *ctx, qm_layout_suggestions *suggestions);

#endif
