/**
 * symmetric.c: Jacobi eigenvalue iteration, Cholesky factorization.
 */
#include "symmetric.h"

#define SWEEPS 12
#define SINGULAR 1e-10 /* a smaller pivot, as a fraction of the diagonal, is rounding */

/** Rotates the plane (p, q) so that a[p][q] becomes 0; v accumulates the rotations. */
static void rotate(double a[3][3], double v[3][3], int p, int q)
{
    if (a[p][q] == 0.0) return;
    double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    double t = copysign(1.0, theta) / (fabs(theta) + sqrt(theta * theta + 1.0));
    double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
    for (int k = 0; k < 3; k++) {
        double kp = a[k][p], kq = a[k][q];
        a[k][p] = c * kp - s * kq;
        a[k][q] = s * kp + c * kq;
    }
    for (int k = 0; k < 3; k++) {
        double pk = a[p][k], qk = a[q][k];
        a[p][k] = c * pk - s * qk;
        a[q][k] = s * pk + c * qk;
        double vp = v[k][p], vq = v[k][q];
        v[k][p] = c * vp - s * vq;
        v[k][q] = s * vp + c * vq;
    }
}

void qm_symmetric_eigen(const double m[6], double value[3], qm_vec vector[3])
{
    double a[3][3] = {{m[0], m[1], m[2]}, {m[1], m[3], m[4]}, {m[2], m[4], m[5]}};
    double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        double off = fabs(a[0][1]) + fabs(a[0][2]) + fabs(a[1][2]);
        if (!(off > 1e-16 * (fabs(a[0][0]) + fabs(a[1][1]) + fabs(a[2][2])))) break;
        rotate(a, v, 0, 1);
        rotate(a, v, 0, 2);
        rotate(a, v, 1, 2);
    }
    int order[3] = {0, 1, 2};
    for (int i = 1; i < 3; i++)
        for (int j = i; j > 0 && a[order[j]][order[j]] < a[order[j - 1]][order[j - 1]]; j--) {
            int swap = order[j];
            order[j] = order[j - 1];
            order[j - 1] = swap;
        }
    for (int i = 0; i < 3; i++) {
        value[i] = a[order[i]][order[i]];
        vector[i] = (qm_vec){v[0][order[i]], v[1][order[i]], v[2][order[i]]};
    }
}

void qm_least_squares_add(qm_least_squares *sums, const double *row, double right, double weight)
{
    QM_ASSERT(sums->count >= 1 && sums->count <= QM_LEAST_SQUARES_MAX);
    for (int i = 0; i < sums->count; i++) {
        double scaled = weight * row[i];
        sums->right[i] += scaled * right;
        for (int j = 0; j <= i; j++)
            sums->matrix[i][j] += scaled * row[j];
    }
}

bool qm_least_squares_solve(const qm_least_squares *sums, double *x)
{
    QM_ASSERT(sums->count >= 1 && sums->count <= QM_LEAST_SQUARES_MAX);
    double factor[QM_LEAST_SQUARES_MAX][QM_LEAST_SQUARES_MAX];
    for (int i = 0; i < sums->count; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = sums->matrix[i][j];
            for (int k = 0; k < j; k++)
                sum -= factor[i][k] * factor[j][k];
            if (j < i)
                factor[i][j] = sum / factor[j][j];
            else if (sum > SINGULAR * sums->matrix[i][i])
                factor[i][i] = sqrt(sum);
            else
                return false;
        }
    }
    for (int i = 0; i < sums->count; i++) {
        x[i] = sums->right[i];
        for (int k = 0; k < i; k++)
            x[i] -= factor[i][k] * x[k];
        x[i] /= factor[i][i];
    }
    for (int i = sums->count - 1; i >= 0; i--) {
        for (int k = i + 1; k < sums->count; k++)
            x[i] -= factor[k][i] * x[k];
        x[i] /= factor[i][i];
    }
    return true;
}
