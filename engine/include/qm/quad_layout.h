/**
 * quad_layout.h: makes a layout from a mesh of quads: few patches that have nodes at its irregular vertices, and
 * curves along its creases and boundaries.
 *
 * Cuts run from the irregular vertices straight over the quads until they meet (patch.h). Every part of a cut then gets an
 * integer length, which may be 0, such that opposite sides of each region are equally long, no two irregular vertices
 * fall together, and few patches come of it. These are drawn on the surface and relaxed there.
 *
 * Source: Campen, Bommes, Kobbelt, Quantized global parametrization, 2015; Lyon, Campen, Kobbelt, Quad layouts via
 *         constrained T-mesh quantization, 2021.
 */
#ifndef QM_QUAD_LAYOUT_H
#define QM_QUAD_LAYOUT_H

#include "qm/layout.h"
#include "qm/quads.h"

/** Lengths of the parts of cuts, from which a layout of more patches of the same quads goes on: to find them takes longest. */
typedef struct qm_quad_layout_lengths {
    uint32_t *length;
    size_t count;
} qm_quad_layout_lengths;

typedef struct qm_quad_layout_options {
    double
        crease_angle; /* degrees, from 0 to 180: an edge whose faces differ by more is a crease; 0: none are */
    const uint8_t
        *creases; /* NULL: by the angle; else, where all faces are quads, a byte for each: bit k for the side
                               from its corner k to the next one */
    size_t patches;      /* the layout is divided until it has nearly so many; 0: as few as are found */
    size_t most_patches; /* a layout of more is refused before it is drawn; 0: any number */
    size_t effort;       /* trials to find fewer patches */
    bool
        merges_doublets; /* two quads with a vertex inside the mesh that no other quad has become one, unless a crease
                             between them has a corner there: in a finer mesh they would have corners of 180 degrees. The
                             layout has no node at it then. Not where some faces are triangles */
    bool
        may_cross; /* curves that cross may remain, also untold, and no other quads are tried: the grids do without, and come several
                       times faster. A layout that is folded in too many places is refused then */
    qm_quad_layout_lengths *
        lengths; /* NULL, or all zero, or from a layout of the same quads with the same options but for fewer patches, which
                     is as if made without them; receives those of this layout, for their reset */
} qm_quad_layout_options;

void qm_quad_layout_lengths_reset(qm_context *ctx, qm_quad_layout_lengths *lengths);

/** 0, NULL, 0, 0, 4000, false, false, NULL. */
qm_quad_layout_options qm_quad_layout_options_default(void);

/** Counts of the quads and of what was made of them. */
typedef struct qm_quad_layout_facts {
    size_t quads;    /* after a division, when some faces were triangles */
    size_t required; /* vertices that nodes have to be at: irregular ones, and corners of features */
    size_t regions;  /* between the cuts */
    size_t patches;
} qm_quad_layout_facts;

/**
 * Makes a layout of a mesh of quads on a surface. A mesh with triangles or polygons is divided into quads first; edges of
 * three faces or more become boundaries. The layout depends on the input alone.
 *
 * quads   passes qm_mesh_validate
 * surface that the curves lie on: of the quads themselves, or one near them
 * facts   may be NULL
 *
 * Ownership: *out and *issues are the caller's, for their resets; empty after an error. Issues name curves that cross
 *            each other on the surface.
 * Returns:   QM_OK; QM_E_EMPTY (no faces); QM_E_ARGUMENT (an option; fewer quads than other faces); QM_E_LAYOUT (the quads
 *            bound no patches: some share two opposite corners; or the layout was refused, see the options); QM_E_TOO_LARGE; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_quad_layout_make(qm_context *ctx, const qm_mesh *quads, const qm_ref_surface *surface,
                              const qm_quad_layout_options *options, qm_layout *out, qm_layout_issues *issues,
                              qm_quad_layout_facts *facts);

/**
 * Makes quads of a surface (quads.h), and a layout of them on it, whose curves follow the creases that the quads follow:
 * the angle of the options is not used. While curves cross, up to four numbers of quads about the wanted one are tried, and the
 * layout with the fewest crossings is kept. Doublets are always merged.
 *
 * made   the quads of the wanted number with the creases of the options, by qm_quads_make_with_creases, where they are there
 *        already: layouts of several numbers of patches share them. NULL: they are made, and the creases are not used
 * grids  receives a grid of each patch (QM_LAYOUT_GRID), with which a reconstruction can start; the caller's, for
 *        qm_quad_layout_free_grids. NULL: not wanted
 *
 * Ownership and returns: as above; QM_E_ARGUMENT for a point set, and what qm_quads_make returns.
 */
qm_status qm_quad_layout_make_of_surface(qm_context *ctx, const qm_ref_surface *surface,
                                         const qm_quads_options *quads, const qm_mesh *made,
                                         const qm_quad_layout_options *options, qm_layout *out,
                                         qm_layout_issues *issues, qm_quad_layout_facts *facts,
                                         double **grids);
void qm_quad_layout_free_grids(qm_context *ctx, const qm_layout *layout, double *grids);

/**
 * Makes a layout of a surface that is its own mirror image at a plane, nearly: as qm_quad_layout_make_of_surface of the half that the normal
 * points to, with curves on the plane, and the mirror image of that. Quads and patches are wanted for both sides together.
 *
 * point, normal  of the plane (qm_symmetry_find)
 * issues         also of cells that are not closed, where the surface and its image are too far apart
 *
 * Ownership and returns: as above; QM_E_ARGUMENT also for a plane without a direction, or without a surface on that side.
 */
qm_status qm_quad_layout_make_symmetric(qm_context *ctx, const qm_ref_surface *surface, const double point[3],
                                        const double normal[3], const qm_quads_options *quads,
                                        const qm_quad_layout_options *options, qm_layout *out,
                                        qm_layout_issues *issues, qm_quad_layout_facts *facts);

#endif
