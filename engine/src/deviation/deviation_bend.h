/**
 * deviation_bend.h: a quadratic height over a piece, and the cells in which it is about linear.
 *
 * The piece is cut into n^2 cells like itself, by lines parallel to its edges, every other row turned round.
 * What a quadratic function is off the linear one with its values at the corners depends on its second
 * derivatives along the edges only: in each cell it is 1 / n^2 of what it is in the whole piece. So a cell is
 * known by the values at its corners, and a piece that bends need not be cut to know how its heights are
 * spread.
 */
#ifndef QM_DEVIATION_BEND_H
#define QM_DEVIATION_BEND_H

#include "core/vec.h"

#define QM_BEND_CELLS 16 /* along an edge at most */
#define QM_BEND_CORNERS ((QM_BEND_CELLS + 1) * (QM_BEND_CELLS + 2) / 2)

/** Between value - below and value + above, value in the Bernstein basis: 00 11 22, then 01 12 20. */
typedef struct qm_bend {
    double value[6];
    double below, above;
    int cells; /* n; 0 where there is no such height */
} qm_bend;

/** By how much a quadratic function is below the linear one with its values at the corners, and above it, at
 * most. */
void qm_bend_open(const double value[6], double open[2]);

/** The function over a triangle within the piece, whose corners have these weights. */
void qm_bend_part(const double value[6], const double corner[3][3], double part[6]);

/** So many cells that linear functions leave open no more than room in each, if so few do. */
int qm_bend_count_cells(const double value[6], double room);

/** Values at the corners of all cells, row by row; the places of those of a cell of the first to the last,
 * one of n^2, are found by qm_bend_cell. */
void qm_bend_corners(const qm_bend *bend, double at[QM_BEND_CORNERS]);

/** The places of the three corners of each cell in turn; calls are made for row 0 <= j < n and 0 <= i < 2 (n
 * - j) - 1: every other cell is turned round. */
static inline void qm_bend_cell(int n, int j, int i, int place[3])
{
    int row = j * (n + 1) - j * (j - 1) / 2, above = row + n + 1 - j, k = i / 2;
    place[0] = i % 2 ? above + k + 1 : row + k;
    place[1] = i % 2 ? above + k : row + k + 1;
    place[2] = i % 2 ? row + k + 1 : above + k;
}

#endif
