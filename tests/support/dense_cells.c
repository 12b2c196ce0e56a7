#include "dense_cells.h"

#include <math.h>
#include <string.h>

#include "check.h"
#include "slow_twin.h"

static double distance3(const double a[3], const double b[3])
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

static double triangle_area(const double a[3], const double b[3], const double c[3])
{
    long double u[3], v[3];
    for (int i = 0; i < 3; i++) {
        u[i] = (long double)b[i] - (long double)a[i];
        v[i] = (long double)c[i] - (long double)a[i];
    }
    long double x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
    return (double)(sqrtl(x * x + y * y + z * z) / 2);
}

static void add_cell(qm_cell_list *list, const qm_mesh *b, qm_quad_reading reading, const double corner[4][3],
                     int corners, double area, double bulge, double eps)
{
    double middle[3] = {0, 0, 0}, radius = 0.0;
    for (int i = 0; i < corners; i++)
        for (int k = 0; k < 3; k++)
            middle[k] += corner[i][k] / corners;
    for (int i = 0; i < corners; i++)
        radius = fmax(radius, distance3(middle, corner[i]));
    qm_slow_bracket distance = qm_slow_distance(b, reading, middle, eps);
    radius += bulge;
    list->cells[list->count++] = (qm_dense_cell){.area = area,
                                                 .low = fmax(0.0, distance.lower - radius),
                                                 .high = distance.upper + radius,
                                                 .middle = {middle[0], middle[1], middle[2]},
                                                 .radius = radius};
    list->area += area;
}

/** A flat triangle in n x n cells. */
static void add_triangle(qm_cell_list *list, const qm_mesh *b, qm_quad_reading reading, const double p[3][3],
                         int n)
{
    double area = triangle_area(p[0], p[1], p[2]) / (n * n);
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < 2 * (n - i) - 1; j++) {
            double corner[4][3];
            int column = j / 2;
            bool is_up = j % 2 == 0;
            const int u[3] = {i + !is_up, i + 1, i + (is_up ? 0 : 0)},
                      v[3] = {column + !is_up, column, column + 1};
            for (int c = 0; c < 3; c++)
                for (int k = 0; k < 3; k++)
                    corner[c][k] = p[0][k] + (p[1][k] - p[0][k]) * u[c] / n + (p[2][k] - p[0][k]) * v[c] / n;
            add_cell(list, b, reading, corner, 3, area, 0.0, 1e-6);
        }
    }
}

/** A bilinear patch in n x n cells, which are near the quads of their corners. */
static void add_patch(qm_cell_list *list, const qm_mesh *a, size_t face, const qm_mesh *b, int n)
{
    static const int du[4] = {0, 1, 1, 0}, dv[4] = {0, 0, 1, 1};
    for (int i = 0; i < n * n; i++) {
        double corner[4][3], w = 0.0;
        for (int c = 0; c < 4; c++) {
            const double uv[2] = {(double)(i / n + du[c]) / n, (double)(i % n + dv[c]) / n};
            qm_slow_position(a, face, QM_QUADS_BILINEAR, uv, corner[c]);
        }
        for (int k = 0; k < 3; k++)
            w += fabs(corner[0][k] - corner[1][k] + corner[2][k] - corner[3][k]);
        double area =
            triangle_area(corner[0], corner[1], corner[2]) + triangle_area(corner[0], corner[2], corner[3]);
        add_cell(list, b, QM_QUADS_BILINEAR, corner, 4, area, w, 1e-3);
    }
}

qm_cell_list qm_cells_sample(const qm_mesh *a, const qm_mesh *b, qm_quad_reading reading, int n)
{
    qm_cell_list list = {.cells = calloc(a->face_count * 2 * (size_t)(n * n), sizeof(qm_dense_cell))};
    assert_non_null(list.cells);
    for (size_t f = 0; f < a->face_count; f++) {
        const uint32_t *index = a->faces + 4 * f;
        if (index[3] != QM_NO_INDEX && reading == QM_QUADS_BILINEAR) {
            add_patch(&list, a, f, b, n);
            continue;
        }
        for (int half = 0; half < (index[3] == QM_NO_INDEX ? 1 : 2); half++) {
            double p[3][3];
            const uint32_t corner[3] = {index[0], index[1 + half], index[2 + half]};
            for (int c = 0; c < 3; c++)
                memcpy(p[c], a->positions + 3 * (size_t)corner[c], sizeof p[c]);
            add_triangle(&list, b, reading, p, n);
        }
    }
    return list;
}

double qm_cells_share(const qm_cell_list *list, double from, double to, bool surely)
{
    double area = 0.0;
    for (size_t i = 0; i < list->count; i++) {
        const qm_dense_cell *c = &list->cells[i];
        bool counts = surely ? c->low >= from && c->high <= to : c->high >= from && c->low <= to;
        if (counts) area += c->area;
    }
    return area / list->area;
}

void qm_cells_free(qm_cell_list *list)
{
    free(list->cells);
    *list = (qm_cell_list){0};
}
