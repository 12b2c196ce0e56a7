/**
 * linear.h: small problems of linear algebra: eigenvectors of symmetric 3 x 3 matrices, normal equations of
 * least squares, and the max-min linear program in two variables.
 */
#ifndef QM_LINEAR_H
#define QM_LINEAR_H

#include "vec.h"

/**
 * Eigenvalues, ascending, and orthonormal eigenvectors of {xx, xy, xz, yy, yz, zz} by Jacobi rotations.
 * Source: Golub, Van Loan, Matrix Computations, 1996, section 8.4 (Jacobi).
 */
void qm_linear_eigen(const double matrix[6], double value[3], qm_vec vector[3]);

/** Adds the products of a vector's coordinates to {xx, xy, xz, yy, yz, zz}. */
static inline void qm_linear_add_products(double matrix[6], qm_vec d)
{
    const double product[6] = {d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z};
    for (int k = 0; k < 6; k++)
        matrix[k] += product[k];
}

#define QM_LEAST_SQUARES_MAX 7

/** Normal equations of the weighted equations row . x = right. All zero but for count at the start. */
typedef struct qm_least_squares {
    int count; /* unknowns, at most QM_LEAST_SQUARES_MAX */
    double matrix[QM_LEAST_SQUARES_MAX][QM_LEAST_SQUARES_MAX], right[QM_LEAST_SQUARES_MAX];
} qm_least_squares;

void qm_linear_add(qm_least_squares *sums, const double *row, double right, double weight);

/** Solves by Cholesky factorization. False when the normal matrix is numerically singular. */
bool qm_linear_solve(const qm_least_squares *sums, double *x);

/* ---- the highest point (x, t) below several planes, where x lies in a convex region ---- */

/** The constraint t <= height + slope . x, or 0 <= height + slope . x when it bounds the region. */
typedef struct qm_max_min_plane {
    double slope[2], height;
    bool is_bound;
} qm_max_min_plane;

/**
 * Maximum of t over all points x of a triangle around 0, whose sides are at the distance radius, within all
 * bounds. The first plane is no bound; bounds contain 0: their heights are not negative. at gets the
 * maximizing x. Returns the first plane's height, at 0, when rounding ends the iteration early.
 */
double qm_linear_max_min(const qm_max_min_plane *planes, int count, double radius, double at[2]);

#endif
