/**
 * deviation_quadratic.c: quadratic functions over a triangle in the Bernstein basis: values and restrictions
 * by the polar form, and their distance from linear functions.
 */
#include "deviation_quadratic.h"

#include <math.h>

#define MAX_SUM (2.0 / 3.0) /* of the sum of 2 l_i l_j over i < j, */
#define MAX_TERM 0.5        /* and of one of them */
#define MAX_EDGE 0.28868    /* of 3 x (1 - x) (1 - 2 x), which is sqrt(3) / 6, rounded up, */
#define MAX_INNER 0.22223   /* and of 6 l_0 l_1 l_2 */

double qm_quadratic_cubic_most(const double cubic[4])
{
    return MAX_EDGE * (fabs(cubic[0]) + fabs(cubic[1]) + fabs(cubic[2])) + MAX_INNER * fabs(cubic[3]);
}

double qm_quadratic_cubic_at(const double cubic[4], const double l[3])
{
    double edges = l[0] * l[1] * (l[0] - l[1]) * cubic[0] + l[1] * l[2] * (l[1] - l[2]) * cubic[1] +
                   l[2] * l[0] * (l[2] - l[0]) * cubic[2];
    return 3.0 * edges + 6.0 * l[0] * l[1] * l[2] * cubic[3];
}

void qm_quadratic_linear_error(const double value[6], double open[2])
{
    double max[2] = {0.0, 0.0}, sum[2] = {0.0, 0.0};
    for (int k = 0; k < 3; k++) {
        double off = value[3 + k] - 0.5 * (value[k] + value[(k + 1) % 3]);
        int side = off > 0.0;
        max[side] = qm_max(max[side], fabs(off));
        sum[side] += fabs(off);
    }
    for (int side = 0; side < 2; side++)
        open[side] = qm_min(MAX_SUM * max[side], MAX_TERM * sum[side]);
}

void qm_quadratic_open(const double value[6], double low[3], double high[3])
{
    double open[2];
    qm_quadratic_linear_error(value, open);
    for (int i = 0; i < 3; i++) {
        low[i] = value[i] - open[0];
        high[i] = value[i] + open[1];
    }
}

/** Of each edge on which the function is above the linear one the lower corner is raised: a linear function
 * with greater coefficients is above. */
void qm_quadratic_raise(const double value[6], double high[3])
{
    for (int i = 0; i < 3; i++)
        high[i] = value[i];
    for (int k = 0; k < 3; k++) {
        int j = (k + 1) % 3, lower = high[k] < high[j] ? k : j;
        high[lower] += qm_max(0.0, 2.0 * value[3 + k] - high[k] - high[j]);
    }
}

/** The polar form at two points: the value of the function if they are one. */
static double polar(const double v[6], const double a[3], const double b[3])
{
    return a[0] * (b[0] * v[0] + b[1] * v[3] + b[2] * v[5]) +
           a[1] * (b[0] * v[3] + b[1] * v[1] + b[2] * v[4]) +
           a[2] * (b[0] * v[5] + b[1] * v[4] + b[2] * v[2]);
}

double qm_quadratic_at(const double value[6], const double weight[3])
{
    return polar(value, weight, weight);
}

void qm_quadratic_restrict(const double value[6], const double corner[3][3], double part[6])
{
    for (int k = 0; k < 3; k++) {
        part[k] = polar(value, corner[k], corner[k]);
        part[3 + k] = polar(value, corner[k], corner[(k + 1) % 3]);
    }
}

int qm_quadratic_count_cells(const double value[6], double room)
{
    double open[2];
    qm_quadratic_linear_error(value, open);
    QM_ASSERT(room >= 0.0);
    double cells = ceil(sqrt((open[0] + open[1]) / room));
    return cells < QM_QUADRATIC_CELLS ? (int)qm_max(1.0, cells) : QM_QUADRATIC_CELLS;
}

void qm_quadratic_cells_open(const qm_quadratic *bend, double open[2])
{
    double part = 1.0 / (double)(bend->cells * bend->cells);
    qm_quadratic_linear_error(bend->value, open);
    open[0] = open[0] * part + bend->below;
    open[1] = open[1] * part + bend->above;
}

void qm_quadratic_values(const qm_quadratic *bend, double at[QM_QUADRATIC_CORNERS])
{
    int n = bend->cells, index = 0;
    QM_ASSERT(n >= 1 && n <= QM_QUADRATIC_CELLS);
    for (int j = 0; j <= n; j++)
        for (int i = 0; i + j <= n; i++) {
            const double weight[3] = {(double)(n - i - j) / n, (double)i / n, (double)j / n};
            at[index++] = polar(bend->value, weight, weight);
        }
}
