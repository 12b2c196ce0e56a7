/**
 * reconstruct.h: from a surface (mesh or point set) and a quad layout on it to a semi-regular quad mesh, by
 * doubling columns or rows of the patches step by step.
 *
 * Each patch is a grid of quads. Opposite sides of a patch have equally many edges, so that a doubling runs
 * on through the neighbours: all curves that it meets make one chord, and chords are what is doubled. The
 * longest edges go first. Vertices of a curve lie on it at equal arc length and are shared bit for bit, so
 * the mesh has no T-junction, and only nodes of the layout can be irregular.
 *
 * How this differs from the source, and why:
 *   - The grid that points are projected on is never coarser than QM_RECONSTRUCTION_BASE edges a side, and
 *     starts as the Coons patch. The mesh of an early step takes every second, fourth ... vertex of it. One
 *     quad for half a torus may have its corners on one line, and then tells no parameters.
 *   - Before points are projected, inner vertices move within the surface towards the middle of their
 *     neighbours. This keeps early skewness from staying for good.
 *   - A drawn curve leaves the surface a little: it is pulled back on it (options.pull_curves).
 *   - What is interpolated between three points is pulled onto the surface: second order then holds to the
 *     end, and noise is averaged (qm_source_pull).
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, sections 6.2 and 6.3;
 * S. Coons, Surfaces for computer-aided design of space forms, 1967.
 */
#ifndef QM_RECONSTRUCT_H
#define QM_RECONSTRUCT_H

#include "qm/hausdorff.h"
#include "qm/layout.h"
#include "qm/source.h"

#define QM_RECONSTRUCTION_BASE 8

typedef struct qm_reconstruction qm_reconstruction;

typedef struct qm_reconstruction_options {
    double cover_share; /* > 0: what lies farther from all patches than this share of the diagonal is
                           uncovered */
    bool pull_curves;   /* vertices of curves go onto the surface when they are within the cover distance */
    int thread_count;   /* 1 or more; the answer does not depend on it */
} qm_reconstruction_options;

/** 0.02, true, 1. */
qm_reconstruction_options qm_reconstruction_options_default(void);

/**
 * Starts a reconstruction: Coons patches, which patch each point belongs to, one quad a patch.
 *
 * Ownership: borrows the source's tree and mesh, which outlive it; copies the layout. *out is the caller's,
 * for qm_reconstruction_destroy.
 * Returns:   QM_OK; QM_E_LAYOUT (what qm_layout_validate refuses; no patch; a patch that no part of the
 *            surface is near to: ctx->message names it); QM_E_ARGUMENT; QM_E_NO_MEMORY; QM_E_CANCELED. After
 * an error *out is NULL.
 */
qm_status qm_reconstruction_create(qm_context *ctx, const qm_source *source, const qm_layout *layout,
                                   const qm_reconstruction_options *options, qm_reconstruction **out);
void qm_reconstruction_destroy(qm_context *ctx, qm_reconstruction *reconstruction);

/** What a step did. */
typedef struct qm_reconstruction_record {
    size_t quads;          /* of the mesh after the step */
    size_t chords_doubled; /* 0: nothing could be doubled within the limit of quads */
    size_t patches_split;
    size_t moved_vertices; /* inner ones of the patches that were split */
    size_t holes_filled; /* of these, the ones that no three points enclose: blended from their neighbours */
    double longest_edge; /* the longest mean edge of a chord afterwards */
} qm_reconstruction_record;

/**
 * Doubles the chords of the longest edges, longest first: all whose edges are longer than the longest over
 * the square root of 2, as long as the mesh stays within max_quads; then places the vertices of the patches
 * that were split. Two steps so double both directions.
 *
 * Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. After an error the reconstruction is as it was before.
 */
qm_status qm_reconstruction_step(qm_context *ctx, qm_reconstruction *reconstruction, size_t max_quads,
                                 qm_reconstruction_record *out);

/**
 * The same reconstruction after its layout was edited: chords keep their counts, by the ids of their curves,
 * and patches whose four curves are as they were keep their vertices, bit for bit. The others are made anew,
 * with as many columns and rows as their chords now have. *redone_patches tells how many.
 *
 * Ownership: the old one stays as it is and the caller's; *out is another one, over the same source.
 * Returns:   as qm_reconstruction_create.
 */
qm_status qm_reconstruction_edit(qm_context *ctx, const qm_reconstruction *reconstruction,
                                 const qm_layout *layout, qm_reconstruction **out, size_t *redone_patches);

/** The mesh as it is now: for qm_mesh_reset. Faces go patch by patch, row by row, so that a patch's own are
 * known without search (qm_reconstruction_patch). */
qm_status qm_reconstruction_mesh(qm_context *ctx, const qm_reconstruction *reconstruction, qm_mesh *out);

/** A patch of the mesh as it is now. */
typedef struct qm_reconstruction_patch {
    size_t first_face;
    uint32_t columns, rows; /* columns * rows faces */
    size_t points;          /* input points, or samples of the mesh, that belong to it */
} qm_reconstruction_patch;

size_t qm_reconstruction_patch_count(const qm_reconstruction *reconstruction);
qm_reconstruction_patch qm_reconstruction_get_patch(const qm_reconstruction *reconstruction, size_t patch);

/** Points or samples looked at, and those farther than the cover distance from all patches. */
void qm_reconstruction_coverage(const qm_reconstruction *reconstruction, size_t *points, size_t *uncovered);

/**
 * The rim of all patches together: points of the curves that one patch alone has, on the surface.
 *
 * points   rows of x y z, the caller's, for qm_context_free; NULL where there is no rim
 * Returns QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_reconstruction_rim(qm_context *ctx, const qm_reconstruction *reconstruction, double **points,
                                size_t *count);

/**
 * Tells which places on the mesh as it is now lie on its rim. A point whose nearest place is one of them may
 * lie anywhere beyond what was drawn.
 *
 * faces, uv   of the places, as projections tell them: faces of the mesh, rows of u v
 * Returns QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_reconstruction_find_rim(qm_context *ctx, const qm_reconstruction *reconstruction,
                                     const uint32_t *faces, const double *uv, size_t count, bool *on_rim);

/** What counts as covered: the cover share in the unit of the surface. */
double qm_reconstruction_cover_distance(const qm_reconstruction *reconstruction);

#endif
