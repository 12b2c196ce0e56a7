/**
 * wide_farthest.h: the one-sided Hausdorff distance of two small surfaces, certified by subdivision.
 *
 * A cell of the source (a part of a triangle, a parameter rectangle of a patch) is a Bezier net of points c_i
 * with weights that are never negative and sum to 1. For each label k of the target there are numbers D_ik
 * such that sum_i weight_i D_ik is at least the distance to the target, everywhere in the cell: a convex
 * facet   its distances from the corners, since distance to a convex set is convex a patch          |c_i -
 * b_i|, where b is the net of the patch over a bilinear map of the cell's parameters into the patch's square.
 * Any such map will do; one through the feet of the corners is tight. And as a convex set: the plane quad
 * that a part of it covers, plus how far it leaves that So is every average of labels, and the greatest over
 * i of the best average bounds the cell: a matrix game. Both kinds, and ridges between several labels, are
 * tight to second order in the size of the cell.
 */
#ifndef QM_WIDE_FARTHEST_H
#define QM_WIDE_FARTHEST_H

#include "wide_surface.h"

/** An interval, in the unit of the surfaces' frame, that holds the distance; roundings of about 2^-56 of the
 * frame included. at is a point of the source that is lower away. */
typedef struct qm_wide_maximum {
    qm_wide lower, upper;
    qm_wide_vec at;
    size_t cells;
} qm_wide_maximum;

/** Both surfaces have a facet and are of one frame. Ends when upper - lower <= eps, or after cell_limit
 * cells. */
qm_wide_maximum qm_wide_farthest(const qm_wide_surface *source, const qm_wide_surface *target, qm_long eps,
                                 size_t cell_limit);

#endif
