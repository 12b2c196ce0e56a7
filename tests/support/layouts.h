/**
 * layouts.h: quad layouts by formula, to draw on the shapes of shapes.h. On malloc; an error ends the test.
 */
#ifndef QM_LAYOUTS_H
#define QM_LAYOUTS_H

#include "qm/layout.h"
#include "shapes.h"

/** Patches over a function: columns along u, rows along v, curves of `pieces` pieces. Wrapped as in
 * qm_shape_grid. */
qm_layout qm_layout_of_grid(int columns, int rows, bool wrap_u, bool wrap_v, int pieces, qm_shape_fn *at,
                            const void *user);

/** Frees it. */
void qm_layout_free(qm_layout *layout);

/** Torus round the z axis, tube of radius 0.35 at distance 1; the saddle z = x y over [-1, 1]^2; the square
 * [0, 1]^2 at z = 0. User is not used. */
void qm_torus_at(const void *user, double u, double v, double out[3]);
void qm_saddle_at(const void *user, double u, double v, double out[3]);
void qm_square_at(const void *user, double u, double v, double out[3]);

#endif
