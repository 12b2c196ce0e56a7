/**
 * bilinear_side.c: the side of a patch on which a point lies, by the signs of products of two determinants: in doubles with a
 * bound of their error, and in integers where that leaves the sign open.
 */
#include <math.h>
#include <string.h>

#include "bilinear.h"
#include "core/rounding.h"
#include "orient.h"

/** Of a determinant, relative to its terms, and what underflow adds: as those of orient.c. */
#define DETERMINANT_ERROR 1e-15
#define DETERMINANT_UNDERFLOW 0x1p-460

/** The points of the four determinants that the weights are proportional to: p in place of a corner. */
static void replace_corner(const qm_vec corner[4], qm_vec p, int which, qm_vec out[4])
{
    for (int i = 0; i < 4; i++)
        out[i] = i == which ? p : corner[i];
}

/** A determinant and a bound of its error. */
static double determinant(const qm_vec at[4], double *error)
{
    qm_vec u = qm_vec_sub(at[1], at[0]), v = qm_vec_sub(at[2], at[0]), w = qm_vec_sub(at[3], at[0]);
    double yz = u.y * v.z, zy = u.z * v.y, zx = u.z * v.x, xz = u.x * v.z, xy = u.x * v.y, yx = u.y * v.x;
    *error = DETERMINANT_ERROR * ((fabs(yz) + fabs(zy)) * fabs(w.x) + (fabs(zx) + fabs(xz)) * fabs(w.y) +
                                  (fabs(xy) + fabs(yx)) * fabs(w.z)) +
             DETERMINANT_UNDERFLOW;
    return (yz - zy) * w.x + (zx - xz) * w.y + (xy - yx) * w.z;
}

static int exact_side(const qm_vec corner[4], qm_vec p)
{
    int low[3];
    for (int k = 0; k < 3; k++) {
        int high;
        double column[5];
        for (int i = 0; i < 5; i++) {
            const qm_vec *at = i < 4 ? &corner[i] : &p;
            column[i] = k == 0 ? at->x : k == 1 ? at->y : at->z;
        }
        if (!qm_bigint_span(column, 5, &low[k], &high)) return 0; /* all in one plane */
    }
    qm_bigint value[4], even, odd;
    for (int i = 0; i < 4; i++) {
        qm_vec at[4];
        double rows[4][3];
        replace_corner(corner, p, i, at);
        for (int k = 0; k < 4; k++)
            qm_vec_store(rows[k], at[k]);
        qm_orient3d_value((const double(*)[3])rows, low, &value[i]);
    }
    qm_bigint_multiply(&even, &value[0], &value[2]);
    qm_bigint_multiply(&odd, &value[1], &value[3]);
    qm_bigint_add(&even, &even, &odd, 1);
    return even.sign;
}

int qm_bilinear_side(const qm_vec corner[4], qm_vec p)
{
    double value[4], error[4];
    for (int i = 0; i < 4; i++) {
        qm_vec at[4];
        replace_corner(corner, p, i, at);
        value[i] = determinant(at, &error[i]);
    }
    double even = value[0] * value[2], odd = value[1] * value[3], difference = even - odd;
    /* Each factor is off by its error, each product and the difference by u more; the factor covers the roundings of this sum, the
       last term underflow. */
    double bound = fabs(value[0]) * error[2] + fabs(value[2]) * error[0] + error[0] * error[2] +
                   fabs(value[1]) * error[3] + fabs(value[3]) * error[1] + error[1] * error[3] +
                   4.0 * QM_UNIT_ROUNDING * (fabs(even) + fabs(odd));
    bound = bound * (1.0 + 0x1p-40) + 0x1p-1000;
    if (difference > bound || -difference > bound) return difference > 0.0 ? 1 : -1;
    return exact_side(corner, p);
}
