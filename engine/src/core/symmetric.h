/**
 * symmetric.h: small symmetric matrices: eigenvectors of 3 x 3, and normal equations of least squares.
 */
#ifndef QM_SYMMETRIC_H
#define QM_SYMMETRIC_H

#include "vec.h"

/**
 * Eigenvalues, ascending, and orthonormal eigenvectors of {xx, xy, xz, yy, yz, zz} by Jacobi rotations.
 * Source: Golub, Van Loan, Matrix Computations, 1996, section 8.4 (Jacobi).
 */
void qm_symmetric_eigen(const double matrix[6], double value[3], qm_vec vector[3]);

#define QM_LEAST_SQUARES_MAX 6

/** Normal equations of the weighted equations row . x = right. All zero but for count at the start. */
typedef struct qm_least_squares {
    int count; /* unknowns, at most QM_LEAST_SQUARES_MAX */
    double matrix[QM_LEAST_SQUARES_MAX][QM_LEAST_SQUARES_MAX], right[QM_LEAST_SQUARES_MAX];
} qm_least_squares;

void qm_least_squares_add(qm_least_squares *sums, const double *row, double right, double weight);

/** Solves by Cholesky factorization. False when the normal matrix is numerically singular. */
bool qm_least_squares_solve(const qm_least_squares *sums, double *x);

#endif
