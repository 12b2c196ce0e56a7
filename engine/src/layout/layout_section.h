/**
 * layout_section.h: curves where a plane cuts the surface: rings round a limb, and curves between two places.
 */
#ifndef QM_LAYOUT_SECTION_H
#define QM_LAYOUT_SECTION_H

#include "core/vec.h"
#include "qm/source.h"

/** Points along a cut, in order. All zero is an empty one. */
typedef struct qm_section {
    double *points; /* rows of x y z */
    size_t count, capacity;
} qm_section;

void qm_section_reset(qm_context *ctx, qm_section *line);
qm_status qm_section_add(qm_context *ctx, qm_section *line, qm_vec point);
double qm_section_length(const qm_section *line);

/** The place at an arc length from the start, or the end of a shorter line. */
qm_vec qm_section_at(const qm_section *line, double length);

/**
 * Cuts the surface with a plane and follows the cut from a place of it until it returns. The last point equals the first.
 * Empty when the cut does not return, as on an open mesh.
 *
 * through  on the surface
 * normal   of length 1
 */
qm_status qm_section_ring(qm_context *ctx, const qm_ref_surface *surface, qm_vec through, qm_vec normal,
                          qm_section *out);

/**
 * Draws a curve on the surface between two places of it, in the plane that both span with the surface's normals there and
 * with `inward`. On a limb's end, round which both places lie, their normals cancel out, and inward leads over its tip.
 * Empty where the cut does not connect them.
 *
 * inward  mean direction into the region that the curve runs in, of length 1 or less; 0 where it is flat
 * tilt    by which the plane is turned about the straight line between the places, in radians
 */
qm_status qm_section_between(qm_context *ctx, const qm_ref_surface *surface, qm_vec from, qm_vec to,
                             qm_vec inward, double tilt, qm_section *out);

/** Projects the straight line between two places onto the surface, as a last resort: it may jump. */
qm_status qm_section_project(qm_context *ctx, const qm_ref_surface *surface, qm_vec from, qm_vec to,
                             qm_section *out);

#endif
