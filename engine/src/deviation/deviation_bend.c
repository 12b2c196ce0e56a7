#include "deviation_bend.h"

#include <math.h>

#define MOST_OF_ALL (2.0 / 3.0) /* of the sum of 2 l_i l_j over i < j, */
#define MOST_OF_ONE 0.5         /* and of one of them */

void qm_bend_open(const double value[6], double open[2])
{
    double most[2] = {0.0, 0.0}, sum[2] = {0.0, 0.0};
    for (int k = 0; k < 3; k++) {
        double off = value[3 + k] - 0.5 * (value[k] + value[(k + 1) % 3]);
        int side = off > 0.0;
        most[side] = qm_max(most[side], fabs(off));
        sum[side] += fabs(off);
    }
    for (int side = 0; side < 2; side++)
        open[side] = qm_min(MOST_OF_ALL * most[side], MOST_OF_ONE * sum[side]);
}

/** The polar form at two points: the value at a point when they are the same. */
static double polar(const double v[6], const double a[3], const double b[3])
{
    return a[0] * (b[0] * v[0] + b[1] * v[3] + b[2] * v[5]) +
           a[1] * (b[0] * v[3] + b[1] * v[1] + b[2] * v[4]) +
           a[2] * (b[0] * v[5] + b[1] * v[4] + b[2] * v[2]);
}

void qm_bend_part(const double value[6], const double corner[3][3], double part[6])
{
    for (int k = 0; k < 3; k++) {
        part[k] = polar(value, corner[k], corner[k]);
        part[3 + k] = polar(value, corner[k], corner[(k + 1) % 3]);
    }
}

int qm_bend_count_cells(const double value[6], double room)
{
    double open[2];
    qm_bend_open(value, open);
    double cells = ceil(sqrt((open[0] + open[1]) / room));
    return cells < QM_BEND_CELLS ? (int)qm_max(1.0, cells) : QM_BEND_CELLS;
}

void qm_bend_corners(const qm_bend *bend, double at[QM_BEND_CORNERS])
{
    int n = bend->cells, place = 0;
    for (int j = 0; j <= n; j++)
        for (int i = 0; i + j <= n; i++) {
            const double weight[3] = {(double)(n - i - j) / n, (double)i / n, (double)j / n};
            at[place++] = polar(bend->value, weight, weight);
        }
}
