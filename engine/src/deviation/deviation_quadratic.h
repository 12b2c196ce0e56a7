/**
 * deviation_quadratic.h: a quadratic height over a piece, and the cells in which it is about linear.
 *
 * The piece is divided into n^2 similar cells, by lines parallel to its edges; every other one is inverted.
 * The difference between a quadratic function and the linear one with its values at the corners depends on
 * its second derivatives along the edges only: in each cell it is 1 / n^2 of the difference in the whole
 * piece. So the values at the corners of the cells give the distribution of the heights, without a cut of the
 * piece.
 */
#ifndef QM_DEVIATION_QUADRATIC_H
#define QM_DEVIATION_QUADRATIC_H

#include "core/vec.h"

#define QM_QUADRATIC_CELLS 16 /* along an edge at most */
#define QM_QUADRATIC_CORNERS ((QM_QUADRATIC_CELLS + 1) * (QM_QUADRATIC_CELLS + 2) / 2)

/**
 * A function between q - below and q + above; q has these coefficients in the Bernstein basis: 00 11 22, then
 * 01 12 20. It is nearer to the cubic function q + e, between q + e - below + cubic_most and
 * q + e + above - cubic_most:
 *     e = sum 3 l_i l_j (l_i - l_j) cubic_ij over ij = 01, 12, 20, + 6 l_0 l_1 l_2 cubic_3, |e| <= cubic_most.
 */
typedef struct qm_quadratic {
    double value[6];
    double below, above;
    double cubic[4], cubic_most;
    int cells; /* n; 0: there is no such function */
} qm_quadratic;

/** A bound of |e|. */
double qm_quadratic_cubic_most(const double cubic[4]);

/** e at a point. */
double qm_quadratic_cubic_at(const double cubic[4], const double weight[3]);

/** The most by which a quadratic function is below the linear one with its values at the corners, and above
 * it. */
void qm_quadratic_linear_error(const double value[6], double open[2]);

/** Values at the corners of linear functions below and above a quadratic one, as near to it as its linear
 * error. */
void qm_quadratic_open(const double value[6], double low[3], double high[3]);

/** Values at the corners of a linear function above a quadratic one, exact along edges on which that is
 * linear. */
void qm_quadratic_raise(const double value[6], double high[3]);

/** The value at a point. */
double qm_quadratic_at(const double value[6], const double weight[3]);

/** The coefficients over a triangle within the piece, whose corners have these weights. */
void qm_quadratic_restrict(const double value[6], const double corner[3][3], double part[6]);

/** The smallest n with a linear error of at most room in each cell; at most QM_QUADRATIC_CELLS. */
int qm_quadratic_count_cells(const double value[6], double room);

/** The most by which the function is below that which is linear in each cell with the values of q at its corners,
 * and above it. */
void qm_quadratic_cells_open(const qm_quadratic *bend, double open[2]);

/** The values at the corners of all cells, row by row; qm_quadratic_cell gives the indices of one cell's. */
void qm_quadratic_values(const qm_quadratic *bend, double at[QM_QUADRATIC_CORNERS]);

/** The indices of the three corners of cell i of row j, 0 <= j < n and 0 <= i < 2 (n - j) - 1; odd cells are
 * inverted. */
static inline void qm_quadratic_cell(int n, int j, int i, int index[3])
{
    int row = j * (n + 1) - j * (j - 1) / 2, above = row + n + 1 - j, k = i / 2;
    index[0] = i % 2 ? above + k + 1 : row + k;
    index[1] = i % 2 ? above + k : row + k + 1;
    index[2] = i % 2 ? row + k + 1 : above + k;
}

#endif
