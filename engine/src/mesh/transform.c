/**
 * transform.c: checks affine maps and moves positions by them.
 */
#include "qm/transform.h"

#include <math.h>
#include <string.h>

#include "core/vec.h"

#define MIN_VOLUME 0x1p-40 /* of the parallelepiped of the columns, scaled to length 1 */

void qm_transform_identity(double m[QM_TRANSFORM_SIZE])
{
    for (int i = 0; i < QM_TRANSFORM_SIZE; i++)
        m[i] = i % 5 == 0;
}

/** The determinant with columns of length 1; 0 when a column is 0. Lengths are taken without overflow. */
static double unit_determinant(const double m[QM_TRANSFORM_SIZE])
{
    qm_vec column[3];
    for (int k = 0; k < 3; k++) {
        const double *entry = m + 4 * k;
        double largest = qm_max(qm_max(fabs(entry[0]), fabs(entry[1])), fabs(entry[2]));
        if (largest == 0.0) return 0.0;
        const qm_vec scaled = {entry[0] / largest, entry[1] / largest, entry[2] / largest};
        column[k] = qm_vec_scale(1.0 / qm_vec_norm(scaled), scaled);
    }
    return qm_vec_dot(column[0], qm_vec_cross(column[1], column[2]));
}

qm_status qm_transform_check(qm_context *ctx, const double m[QM_TRANSFORM_SIZE])
{
    for (int i = 0; i < QM_TRANSFORM_SIZE; i++)
        if (!isfinite(m[i]))
            return qm_context_fail(ctx, QM_E_NOT_FINITE, "number %d of the transform is not finite", i);
    for (int k = 0; k < 4; k++)
        if (m[4 * k + 3] != (k == 3))
            return qm_context_fail(ctx, QM_E_ARGUMENT,
                                   "number %d of the transform is not %d: its last row must be 0 0 0 1",
                                   4 * k + 3, k == 3);
    /* Not below: a NaN, of subnormal columns, is refused. */
    if (!(fabs(unit_determinant(m)) >= MIN_VOLUME))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the transform is singular: it makes space flat");
    return QM_OK;
}

bool qm_transform_mirrors(const double m[QM_TRANSFORM_SIZE])
{
    return unit_determinant(m) < 0.0;
}

bool qm_transform_is_identity(const double m[QM_TRANSFORM_SIZE])
{
    bool is_same = true;
    for (int i = 0; i < QM_TRANSFORM_SIZE; i++)
        is_same = is_same && m[i] == (i % 5 == 0);
    return is_same;
}

qm_status qm_transform_positions(qm_context *ctx, const double m[QM_TRANSFORM_SIZE], const qm_mesh *mesh,
                                 double *positions)
{
    const size_t size = 3 * sizeof *positions * mesh->vertex_count;
    if (qm_transform_is_identity(m)) {
        if (positions != mesh->positions && size > 0) memcpy(positions, mesh->positions, size);
        return QM_OK;
    }
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        const double *from = mesh->positions + 3 * i;
        const double x = from[0], y = from[1], z = from[2];
        double *to = positions + 3 * i;
        for (int k = 0; k < 3; k++)
            to[k] = m[k] * x + m[4 + k] * y + m[8 + k] * z + m[12 + k];
        if (!(isfinite(to[0]) && isfinite(to[1]) && isfinite(to[2])))
            return qm_context_fail(ctx, QM_E_NOT_FINITE, "vertex %zu overflows when it is moved", i);
    }
    return QM_OK;
}

/* The norm of the linear part M is the root of the largest eigenvalue of G = transpose(M) M, which no row sum of |G| is below.
 * With u = 2^-53 and F the sum of the squares of M's entries: an entry of G is a sum of three products of quotients, off by 5 u
 * of the sum of their magnitudes to the first order, which is at most F; a row is off by 15 u F and the rounding of its sum, 2 u
 * of at most 3 F: 2^-48 F = 32 u F is above all. F itself is off by 7 u of it, and the root and the products by 3 u: the last factor
 * is above all. Entries are scaled by the largest one, against overflow; entries that underflow then are below 2^-1022 of it.
 *
 * Each coordinate is off by 2^-49 S (qm_transform_positions), S being at most the largest entry times the largest coordinate,
 * or the largest shift; a point of a face is a convex combination of its corners, and so off by at most sqrt(3) of that. */
qm_transform_change qm_transform_find_change(const double m[QM_TRANSFORM_SIZE], const qm_mesh *mesh)
{
    if (qm_transform_is_identity(m)) return (qm_transform_change){1.0, 0.0};
    double largest = 0.0, shift = 0.0, coordinate = 0.0;
    for (int i = 0; i < QM_TRANSFORM_SIZE - 4; i++)
        largest = qm_max(largest, fabs(m[i]));
    for (int k = 0; k < 3; k++)
        shift = qm_max(shift, fabs(m[12 + k]));
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        coordinate = qm_max(coordinate, fabs(mesh->positions[i]));
    double row_most = 0.0, squares = 0.0;
    for (int i = 0; i < 3; i++) {
        double row = 0.0;
        for (int j = 0; j < 3; j++) {
            double product = 0.0;
            for (int k = 0; k < 3; k++)
                product += m[4 * i + k] / largest * (m[4 * j + k] / largest);
            row += fabs(product);
            if (i == j) squares += product;
        }
        row_most = qm_max(row_most, row);
    }
    double size = qm_max(qm_max(largest * coordinate, shift), 0x1p-1000);
    return (qm_transform_change){largest * sqrt(row_most + 0x1p-48 * squares) * (1.0 + 0x1p-48),
                                 1.75 * 0x1p-49 * size};
}
