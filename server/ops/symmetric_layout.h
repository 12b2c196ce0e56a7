/**
 * symmetric_layout.h: automatic layouts, on both sides of a plane of symmetry where that is wished. Shared by the daemon and the command line.
 */
#ifndef QM_SYMMETRIC_LAYOUT_H
#define QM_SYMMETRIC_LAYOUT_H

#include "qm/quad_layout.h"

#define QM_SYMMETRY_SHARE                                                                                    \
    0.01 /* of the diagonal: the distance to the mirror image at a plane that is accepted */

/** The plane that a layout shall be its own mirror image at: none, one that is found, or a given one. */
typedef struct qm_symmetry_wish {
    bool finds, is_given;
    double point[3], normal[3]; /* given, or once it is found */
} qm_symmetry_wish;

/**
 * Makes a layout of a surface, symmetric if that is wished.
 *
 * Returns: as qm_quad_layout_make_of_surface; QM_E_ARGUMENT where the surface is not its own mirror image at any plane, to a hundredth of the
 *          diagonal.
 */
qm_status qm_symmetric_layout_make(qm_context *ctx, const qm_ref_surface *surface, qm_symmetry_wish *wish,
                                   const qm_quads_options *quads, const qm_quad_layout_options *options,
                                   qm_layout *out, qm_layout_issues *issues, qm_quad_layout_facts *facts);

#endif
