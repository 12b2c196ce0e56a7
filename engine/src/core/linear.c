/**
 * linear.c: Jacobi eigenvalue iteration, Cholesky factorization, and the dual simplex method on three columns.
 */
#include "linear.h"

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

void qm_linear_eigen(const double m[6], double value[3], qm_vec vector[3])
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

void qm_linear_add(qm_least_squares *sums, const double *row, double right, double weight)
{
    QM_ASSERT(sums->count >= 1 && sums->count <= QM_LEAST_SQUARES_MAX);
    for (int i = 0; i < sums->count; i++) {
        double scaled = weight * row[i];
        sums->right[i] += scaled * right;
        for (int j = 0; j <= i; j++)
            sums->matrix[i][j] += scaled * row[j];
    }
}

bool qm_linear_solve(const qm_least_squares *sums, double *x)
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

/* ---- the max-min linear program ---- */

#define MAX_CHANGES 32   /* of the basis */
#define ROUNDING 0x1p-40 /* a smaller weight is 0, and as a fraction of the radius a smaller violation */
#define HEIGHT_ROUNDING 0x1p-50 /* as a fraction of the heights: a smaller violation is 0 */

/** A constraint as the column (slope, 1 or 0 for a bound) of the dual program, and its height. */
typedef struct column {
    qm_vec a;
    double height;
} column;

/** Three columns whose weights (>= 0) sum to (0, 0, 1), by their cross products. */
typedef struct basis {
    column at[3];
    qm_vec cross[3];
    double determinant;
} basis;

static const double directions[3][2] = {{1.0, 0.0}, {-0.5, 0.8660254037844386}, {-0.5, -0.8660254037844386}};

/** The planes, and after them the sides of the triangle. */
static column column_of(const qm_max_min_plane *planes, int count, double radius, int i)
{
    if (i >= count) return (column){{-directions[i - count][0], -directions[i - count][1], 0.0}, radius};
    const qm_max_min_plane *s = &planes[i];
    return (column){{s->slope[0], s->slope[1], s->is_bound ? 0.0 : 1.0}, s->height};
}

static void find_crosses(basis *b)
{
    for (int i = 0; i < 3; i++)
        b->cross[i] = qm_vec_cross(b->at[(i + 1) % 3].a, b->at[(i + 2) % 3].a);
    b->determinant = qm_vec_dot(b->at[0].a, b->cross[0]);
}

/** The first basis: the first plane, and the two sides of the triangle towards which it rises. */
static void start(basis *b, const qm_max_min_plane *planes, int count, double radius)
{
    int out = 0;
    double lowest = INFINITY;
    for (int i = 0; i < 3; i++) {
        double along = planes[0].slope[0] * directions[i][0] + planes[0].slope[1] * directions[i][1];
        if (along < lowest) {
            lowest = along;
            out = i;
        }
    }
    b->at[0] = column_of(planes, count, radius, 0);
    for (int k = 1; k < 3; k++)
        b->at[k] = column_of(planes, count, radius, count + (out + k) % 3);
    find_crosses(b);
}

/** Exchanges the column that the ratio test selects for the entering one. False when there is none. */
static bool pivot(basis *b, column entering)
{
    int leaving = -1;
    double min_ratio = INFINITY;
    for (int i = 0; i < 3; i++) {
        double weight = b->cross[i].z / b->determinant;
        double rate = qm_vec_dot(b->cross[i], entering.a) / b->determinant;
        if (!(rate > ROUNDING) || !(weight < min_ratio * rate)) continue;
        min_ratio = weight / rate;
        leaving = i;
    }
    if (leaving < 0) return false;
    b->at[leaving] = entering;
    find_crosses(b);
    return b->determinant != 0.0;
}

/** The vertex of the three constraints: (x, y, -t). */
static qm_vec vertex_of(const basis *b)
{
    qm_vec sum = {0, 0, 0};
    for (int i = 0; i < 3; i++)
        sum = qm_vec_axpy(sum, -b->at[i].height / b->determinant, b->cross[i]);
    return sum;
}

double qm_linear_max_min(const qm_max_min_plane *planes, int count, double radius, double at[2])
{
    QM_ASSERT(count >= 1 && !planes[0].is_bound);
    basis b;
    start(&b, planes, count, radius);
    for (int changes = 0; changes < MAX_CHANGES; changes++) {
        qm_vec top = vertex_of(&b);
        double lowest = -fmax(ROUNDING * radius, HEIGHT_ROUNDING * fabs(planes[0].height));
        int entering = -1;
        for (int i = 0; i < count + 3; i++) {
            column c = column_of(planes, count, radius, i);
            double slack = c.height + qm_vec_dot(c.a, top);
            if (slack >= lowest) continue;
            lowest = slack;
            entering = i;
        }
        if (entering < 0) {
            at[0] = top.x;
            at[1] = top.y;
            return -top.z;
        }
        if (!pivot(&b, column_of(planes, count, radius, entering))) break;
    }
    at[0] = at[1] = 0.0;
    return planes[0].height;
}
