/**
 * reconstruct.h: makes a semi-regular quad mesh from a surface (mesh or point set) and a quad layout on it,
 * by doubling columns or rows of the patches step by step, and by whole numbers of them in the last step.
 *
 * Each patch is a grid of quads. Opposite sides of a patch have equal numbers of edges, so that a doubling
 * continues through the neighbours: the curves that it meets form a chord, and a step doubles chords, those
 * of the longest edges first. Vertices of a curve lie on it, nearer to one another where it turns, and are shared bit for bit,
 * so the mesh has no T-junction, and only nodes of the layout can be irregular.
 *
 * How this differs from the source, and why:
 *   - The mesh that is settled starts at maps of the patches over the triangles, where the layout covers a mesh.
 *   - The grid that points are projected on is never coarser than QM_RECONSTRUCTION_BASE edges a side, and
 *     starts as the Coons patch. The mesh of an early step takes every second, fourth ... vertex of it. One
 *     quad for half a torus may have its corners on one line, and then defines no parameters.
 *   - Before points are projected, inner vertices move within the surface towards the mean of their
 *     neighbours. Otherwise early skewness would be permanent.
 *   - A drawn curve leaves the surface a little: it is projected back onto it (options.pull_curves).
 *   - Positions that are interpolated between three points are projected onto the surface: convergence stays
 *     of second order, and noise is averaged (qm_ref_surface_project).
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, sections 6.2 and 6.3;
 *         S. Coons, Surfaces for computer-aided design of space forms, 1967.
 */
#ifndef QM_RECONSTRUCT_H
#define QM_RECONSTRUCT_H

#include "qm/hausdorff.h"
#include "qm/layout.h"
#include "qm/quads.h"
#include "qm/source.h"

#define QM_RECONSTRUCTION_BASE 8
#define QM_NOISE_AUTOMATIC -1.0
#define QM_NOISE_MAX 0.1 /* of the diagonal: with more there is no surface */

typedef struct qm_reconstruction qm_reconstruction;

typedef struct qm_reconstruction_options {
    double cover_share; /* > 0, of the diagonal: a point farther than this from all patches is uncovered */
    bool pull_curves;   /* project vertices of curves onto the surface when they are within that distance */
    double
        noise_share; /* of the diagonal: the standard deviation of the points from the surface, to which the mesh
                           is fitted then; 0: they are exact; QM_NOISE_AUTOMATIC: found from the points */
    int thread_count; /* 1 or more; the result does not depend on it */
    const double *
        grids; /* NULL, or a grid of each patch (QM_LAYOUT_GRID) with which lattices start, instead of a map that is
                            found from the curves: curves may cross then. Used by qm_reconstruction_create alone */
    bool settles_coarse; /* qm_reconstruction_fill_grids settles lattices with half as many edges first */
} qm_reconstruction_options;

/** 0.02, true, QM_NOISE_AUTOMATIC, 1, NULL, true. */
qm_reconstruction_options qm_reconstruction_options_default(void);

/**
 * Starts a reconstruction: Coons patches, the assignment of points to patches, one quad a patch.
 *
 * Ownership: borrows the source's tree and mesh, which must outlive it; copies the layout. *out is the
 * caller's, for
 *            qm_reconstruction_destroy.
 * Returns:   QM_OK; QM_E_LAYOUT (a fault that qm_layout_validate reports; no patch; a point far outside the
 *            surface's box; a layout in another unit; a patch far from all of the surface, unless it lies in a hole:
 *            ctx->message names it); QM_E_ARGUMENT; QM_E_NO_MEMORY; QM_E_CANCELED. After an
 *            error *out is NULL.
 */
qm_status qm_reconstruction_create(qm_context *ctx, const qm_ref_surface *source, const qm_layout *layout,
                                   const qm_reconstruction_options *options, qm_reconstruction **out);
void qm_reconstruction_destroy(qm_context *ctx, qm_reconstruction *reconstruction);

/**
 * Makes the mesh of a layout with options.grids at once, without steps: of at most as many quads as wanted, and nearly as many, more where the
 * surface bends more. Curves and lattices are settled with half as many edges first, which brings nodes to where quads need them; the mesh itself is
 * to be settled (qm_quads_settle).
 *
 * surface  of a mesh
 * quads    the wanted number, the crease angle and the threads count
 *
 * Returns: QM_OK, and *out is the caller's; QM_E_LAYOUT as qm_reconstruction_create; QM_E_ARGUMENT (a point set; more patches than
 *          quads); QM_E_TOO_LARGE; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_reconstruction_fill_grids(qm_context *ctx, const qm_ref_surface *surface,
                                       const qm_layout *layout, const qm_reconstruction_options *options,
                                       const qm_quads_options *quads, qm_mesh *out);

/** The results of a step. */
typedef struct qm_reconstruction_record {
    size_t quads;          /* of the mesh after the step */
    size_t chords_changed; /* 0: the limit of quads allowed no step */
    size_t patches_split;
    size_t moved_vertices; /* inner vertices of the split patches */
    size_t holes_filled;   /* moved vertices that no three points enclose: blended from their neighbours */
    double longest_edge;   /* the longest mean edge of a chord after the step */
} qm_reconstruction_record;

/**
 * Doubles all chords whose edges are longer than the longest divided by the square root of 2, so that two steps double both
 * directions; then positions the vertices of the split patches. If the mesh would have more than max_quads then, the
 * chords get numbers of edges instead with which it has nearly as many, more where the surface bends more.
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. After an error the reconstruction is unchanged.
 */
qm_status qm_reconstruction_step(qm_context *ctx, qm_reconstruction *reconstruction, size_t max_quads,
                                 qm_reconstruction_record *out);

/**
 * Makes a reconstruction for an edited layout: chords keep their counts, by the ids of their curves, and
 * patches whose four curves are unchanged keep their vertices, bit for bit. The other patches are recomputed,
 * with as many columns and rows as their chords now have.
 *
 * redone_patches  number of recomputed patches
 *
 * Ownership: the old reconstruction is unchanged and remains the caller's; *out is a new one, over the same
 * source.
 * Returns:   as qm_reconstruction_create.
 */
qm_status qm_reconstruction_edit(qm_context *ctx, const qm_reconstruction *reconstruction,
                                 const qm_layout *layout, qm_reconstruction **out, size_t *redone_patches);

/** Writes the current mesh, for qm_mesh_reset. Faces are ordered patch by patch and row by row (see
 * qm_reconstruction_patch). Returns QM_OK or QM_E_NO_MEMORY. */
qm_status qm_reconstruction_mesh(qm_context *ctx, const qm_reconstruction *reconstruction, qm_mesh *out);

/**
 * Makes the current mesh anew, to be settled: as qm_reconstruction_fill_grids, but with the present numbers of edges, and marked
 * curves stay. The reconstruction stays as it is.
 *
 * quads  the crease angle and the threads count
 * out    the caller's; empty, without an error, where the layout does not cover an exact mesh
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_reconstruction_mesh_anew(qm_context *ctx, qm_reconstruction *reconstruction,
                                      const qm_quads_options *quads, qm_mesh *out);

/**
 * Finds what of the current mesh is marked in its layout: vertices of fixed curves and corners stay, those of sharp curves lie on
 * the curve.
 *
 * out  the caller's, for qm_quads_marks_reset; all zero if nothing is marked, and after an error
 *
 * Returns: QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_reconstruction_find_marks(qm_context *ctx, const qm_reconstruction *reconstruction,
                                       qm_quads_marks *out);

/** A patch of the current mesh. */
typedef struct qm_reconstruction_patch {
    size_t first_face;
    uint32_t columns, rows; /* columns * rows faces */
    size_t points;          /* input points, or samples of the mesh, that belong to it */
} qm_reconstruction_patch;

size_t qm_reconstruction_patch_count(const qm_reconstruction *reconstruction);
qm_reconstruction_patch qm_reconstruction_get_patch(const qm_reconstruction *reconstruction, size_t patch);

/** What a reconstruction does that its mesh does not show. */
typedef enum qm_reconstruction_warning_kind {
    QM_RECONSTRUCTION_SPANS_HOLE, /* no surface lies under the patch: it is a Coons patch between its curves */
    QM_RECONSTRUCTION_UNCOVERED,  /* more than a hundredth of the samples is beyond the cover distance */
    QM_RECONSTRUCTION_ONE_SIDED,  /* the patches have no common orientation, as on a Moebius strip */
    QM_RECONSTRUCTION_INSIDE_OUT, /* the mesh is closed and its faces look inward, as those of the surface do */
    QM_RECONSTRUCTION_NOISE,      /* the points are off the surface: the mesh is fitted to them */
    QM_RECONSTRUCTION_OUTLIERS,   /* points that are not of the surface, and do not count */
    QM_RECONSTRUCTION_NORMALS,    /* normals of the points are missing or do not agree: they are estimated */
    QM_RECONSTRUCTION_FILLS_HOLE, /* some of the mesh lies where there are no points, or beyond the boundary of a mesh: it
                                     spans holes smoothly */
    QM_RECONSTRUCTION_WARNING_COUNT
} qm_reconstruction_warning_kind;

typedef struct qm_reconstruction_warning {
    qm_reconstruction_warning_kind kind;
    size_t patch; /* that spans the hole */
    double
        share; /* of the samples that is uncovered; of the diagonal that the noise is; of the points that are
                     outliers; of the vertices that are in holes between points, or of the area that is in holes of a mesh */
} qm_reconstruction_warning;

/** Finds the warnings of a reconstruction as it is; writes up to capacity of them, and returns their number. */
size_t qm_reconstruction_find_warnings(const qm_reconstruction *reconstruction,
                                       qm_reconstruction_warning *out, size_t capacity);

/** The standard deviation of the points from the surface, in its unit, to which the mesh is fitted; 0 where they are exact. */
double qm_reconstruction_noise(const qm_reconstruction *reconstruction);

/** Counts the points or samples, and those farther than the cover distance from all patches. */
void qm_reconstruction_coverage(const qm_reconstruction *reconstruction, size_t *points, size_t *uncovered);

/**
 * The boundary of the union of all patches: points of the curves with a single patch, on the surface.
 *
 * points  rows of x y z, the caller's, for qm_context_free; NULL when there is no boundary
 *
 * Returns: QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_reconstruction_boundary(qm_context *ctx, const qm_reconstruction *reconstruction,
                                     double **points, size_t *count);

/**
 * Finds which points of the current mesh lie on the boundary of its patches. A point whose nearest point is
 * one of them may lie anywhere beyond the drawn layout.
 *
 * faces, uv  of the points, as projections report them: faces of the mesh, rows of u v
 * on_rim     the caller's, count entries
 *
 * Returns: QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_reconstruction_mark_boundary(qm_context *ctx, const qm_reconstruction *reconstruction,
                                          const uint32_t *faces, const double *uv, size_t count,
                                          bool *on_rim);

/** The cover distance: cover_share of the diagonal, in the unit of the surface. */
double qm_reconstruction_cover_distance(const qm_reconstruction *reconstruction);

#endif
