#include "layouts.h"

#include <math.h>
#include <string.h>

#include "check.h"

static uint32_t node_of(int columns, int rows, bool wrap_u, bool wrap_v, int i, int j)
{
    int width = wrap_u ? columns : columns + 1;
    if (wrap_u) i %= columns;
    if (wrap_v) j %= rows;
    return (uint32_t)(j * width + i);
}

/** Adds the curve from (u0, v0) to (u1, v1) in grid units. */
static void add_curve(qm_layout *layout, uint32_t from, uint32_t to, int pieces, qm_shape_fn *at,
                      const void *user, const double uv[4])
{
    qm_context ctx = qm_context_make();
    double *points = malloc(3 * sizeof(double) * ((size_t)pieces + 1));
    assert_non_null(points);
    for (int k = 0; k <= pieces; k++) {
        double t = (double)k / pieces;
        at(user, uv[0] + t * (uv[2] - uv[0]), uv[1] + t * (uv[3] - uv[1]), points + 3 * k);
    }
    assert_int_equal(qm_layout_add_curve(&ctx, layout, from, to, points, (size_t)pieces + 1), QM_OK);
    free(points);
}

qm_layout qm_layout_of_grid(int columns, int rows, bool wrap_u, bool wrap_v, int pieces, qm_shape_fn *at,
                            const void *user)
{
    qm_layout layout = {0};
    qm_context ctx = qm_context_make();
    int nodes_u = wrap_u ? columns : columns + 1, nodes_v = wrap_v ? rows : rows + 1;
    double du = 1.0 / columns, dv = 1.0 / rows;
    for (int j = 0; j < nodes_v; j++)
        for (int i = 0; i < nodes_u; i++) {
            double p[3];
            at(user, i * du, j * dv, p);
            assert_int_equal(qm_layout_add_node(&ctx, &layout, p), QM_OK);
        }
    for (int j = 0; j < nodes_v; j++)
        for (int i = 0; i < columns; i++)
            add_curve(&layout, node_of(columns, rows, wrap_u, wrap_v, i, j),
                      node_of(columns, rows, wrap_u, wrap_v, i + 1, j), pieces, at, user,
                      (const double[]){i * du, j * dv, (i + 1) * du, j * dv});
    uint32_t upward = (uint32_t)layout.curve_count;
    for (int j = 0; j < rows; j++)
        for (int i = 0; i < nodes_u; i++)
            add_curve(&layout, node_of(columns, rows, wrap_u, wrap_v, i, j),
                      node_of(columns, rows, wrap_u, wrap_v, i, j + 1), pieces, at, user,
                      (const double[]){i * du, j * dv, i * du, (j + 1) * dv});
    for (int j = 0; j < rows; j++)
        for (int i = 0; i < columns; i++) {
            const uint32_t id[4] = {
                (uint32_t)(j * columns + i), upward + (uint32_t)(j * nodes_u + (i + 1) % nodes_u),
                (uint32_t)((j + 1) % nodes_v * columns + i), upward + (uint32_t)(j * nodes_u + i)};
            assert_int_equal(qm_layout_add_patch(&ctx, &layout, id), QM_OK);
        }
    return layout;
}

void qm_layout_free(qm_layout *layout)
{
    qm_context ctx = qm_context_make();
    qm_layout_reset(&ctx, layout);
}

void qm_torus_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    const double whole = 6.283185307179586, radius = 1.0 + 0.35 * cos(whole * v);
    out[0] = radius * cos(whole * u);
    out[1] = radius * sin(whole * u);
    out[2] = 0.35 * sin(whole * v);
}

void qm_saddle_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    out[0] = 2.0 * u - 1.0;
    out[1] = 2.0 * v - 1.0;
    out[2] = out[0] * out[1];
}

void qm_square_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    out[0] = u;
    out[1] = v;
    out[2] = 0.0;
}
