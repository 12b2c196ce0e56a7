/**
 * cloud_field.c: a smooth signed distance, by least squares on a sparse grid.
 *
 * Between the nodes the function is trilinear. Second differences are taken where all nodes that they need are there, so that no
 * value is prescribed at the end of the grid: the function goes on straight there, and smoothly across holes.
 *
 * Source: F. Calakli, G. Taubin, SSD: smooth signed distance surface reconstruction, 2011.
 */
#include "cloud_field.h"

#include <string.h>

#define BENDING 0.1    /* weight of a second difference to that of the points of a cell */
#define HOLDING 1e-4   /* of the value that a node starts with: straight functions that no point holds stay */
#define MAX_ROUNDS 200 /* of conjugate gradients */
#define ACCURACY                                                                                             \
    2e-3 /* of the values, in cells: the root mean square of the next correction of a Jacobi step */
#define MIN_NORMAL 0.5 /* length of the mean of unit normals: below it they are those of two walls */

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a surface of points");
}

/** The sums of the points of a cell. */
typedef struct cell_sums {
    qm_vec at, normal;
    double count;
} cell_sums;

qm_status qm_cloud_samples_make(qm_context *ctx, const qm_cloud_grid *grid, const qm_cloud_points *points,
                                qm_cloud_sample **out, size_t *count)
{
    cell_sums *sums = qm_context_alloc(ctx, grid->cell_count, sizeof *sums);
    *out = qm_context_alloc(ctx, grid->cell_count, sizeof **out);
    *count = 0;
    if (!sums || !*out) {
        qm_context_free(ctx, sums, grid->cell_count, sizeof *sums);
        qm_context_free(ctx, *out, grid->cell_count, sizeof **out);
        *out = NULL;
        return no_memory(ctx);
    }
    memset(sums, 0, grid->cell_count * sizeof *sums);
    for (size_t i = 0; i < points->count; i++) {
        uint64_t key = qm_cloud_grid_key_at(grid, points->position[i]);
        size_t cell = qm_cloud_keys_find(grid->cells, grid->cell_count, key);
        if (cell == SIZE_MAX || !(qm_vec_norm2(points->normal[i]) > 0.0)) continue;
        sums[cell].at = qm_vec_add(sums[cell].at, qm_cloud_grid_within(grid, key, points->position[i]));
        sums[cell].normal = qm_vec_add(sums[cell].normal, points->normal[i]);
        sums[cell].count += 1.0;
    }
    for (size_t c = 0; c < grid->cell_count; c++) {
        double length = qm_vec_norm(sums[c].normal);
        if (!(length > MIN_NORMAL * sums[c].count)) continue;
        (*out)[(*count)++] = (qm_cloud_sample){.cell = (uint32_t)c,
                                               .at = qm_vec_scale(1.0 / sums[c].count, sums[c].at),
                                               .normal = qm_vec_scale(1.0 / length, sums[c].normal)};
    }
    qm_context_free(ctx, sums, grid->cell_count, sizeof *sums);
    return QM_OK;
}

/** The equations, and the vectors of conjugate gradients. */
typedef struct solver {
    const qm_cloud_grid *grid;
    const qm_cloud_sample *samples;
    size_t sample_count;
    double *rest, *step, *product, *diagonal; /* a row of node_count for each */
} solver;

/** Adds to `to` the rows of one second difference times a value; with square the squares of its rows. */
static void add_row(double *to, const uint32_t *node, const double *row, int count, double value, bool square)
{
    for (int i = 0; i < count; i++)
        to[node[i]] += square ? row[i] * row[i] * value : row[i] * value;
}

/** The next second difference at a node: along an axis (which 0 to 2), or of two axes (3 to 5). Returns the number of its nodes,
 * 0 where one of them is missing. */
static int find_difference(const qm_cloud_grid *grid, uint32_t node, int which, uint32_t at[4])
{
    const uint32_t *next = grid->next[node];
    if (which < 3) {
        at[0] = next[QM_CLOUD_BEFORE + which];
        at[1] = node;
        at[2] = next[QM_CLOUD_AFTER + which];
        return at[0] != QM_NO_INDEX && at[2] != QM_NO_INDEX ? 3 : 0;
    }
    int a = which - 3, b = (a + 1) % 3;
    at[0] = node;
    at[1] = next[QM_CLOUD_AFTER + a];
    at[2] = next[QM_CLOUD_AFTER + b];
    if (at[1] == QM_NO_INDEX || at[2] == QM_NO_INDEX) return 0;
    at[3] = grid->next[at[1]][QM_CLOUD_AFTER + b];
    return at[3] != QM_NO_INDEX ? 4 : 0;
}

/** Adds the product of the bending energy's matrix and f, or its diagonal. */
static void add_bending(const solver *s, const double *f, double *to, bool diagonal)
{
    static const double straight[3] = {1, -2, 1}, mixed[4] = {1, -1, -1, 1};
    for (uint32_t i = 0; i < s->grid->node_count; i++)
        for (int which = 0; which < 6; which++) {
            uint32_t at[4];
            int count = find_difference(s->grid, i, which, at);
            if (count == 0) continue;
            const double *row = count == 3 ? straight : mixed;
            double value = BENDING * (count == 3 ? 1.0 : 2.0), sum = 0.0;
            for (int k = 0; k < count && !diagonal; k++)
                sum += row[k] * f[at[k]];
            add_row(to, at, row, count, diagonal ? value : value * sum, diagonal);
        }
}

/** Adds the product of the samples' matrix and f less `wanted` times what they want; or its diagonal. */
static void add_samples(const solver *s, const double *f, double wanted, double *to, bool diagonal)
{
    for (size_t i = 0; i < s->sample_count; i++) {
        const qm_cloud_sample *sample = &s->samples[i];
        uint32_t corner[8];
        double row[4][8];
        qm_cloud_grid_corners(s->grid, sample->cell, corner);
        qm_cloud_grid_weights(sample->at, row[0], row + 1);
        const double want[4] = {0.0, sample->normal.x, sample->normal.y, sample->normal.z};
        for (int k = 0; k < 4; k++) {
            double sum = -wanted * want[k];
            for (int j = 0; j < 8 && !diagonal; j++)
                sum += row[k][j] * f[corner[j]];
            add_row(to, corner, row[k], 8, diagonal ? 1.0 : sum, diagonal);
        }
    }
}

/** to = A f, or the diagonal of A. */
static void apply(const solver *s, const double *f, double *to, bool diagonal)
{
    for (size_t i = 0; i < s->grid->node_count; i++)
        to[i] = diagonal ? HOLDING : HOLDING * f[i];
    add_bending(s, f, to, diagonal);
    add_samples(s, f, 0.0, to, diagonal);
}

/** The scalar product of the residual and itself over the diagonal. */
static double measure_rest(const solver *s)
{
    double sum = 0.0;
    for (size_t i = 0; i < s->grid->node_count; i++)
        sum += s->rest[i] * s->rest[i] / s->diagonal[i];
    return sum;
}

/** Conjugate gradients with the diagonal as preconditioner. */
static qm_status run(qm_context *ctx, solver *s, double *field)
{
    size_t count = s->grid->node_count;
    apply(s, NULL, s->diagonal, true);
    memset(s->rest, 0, count * sizeof *s->rest);
    add_bending(s, field, s->rest, false);
    add_samples(s, field, 1.0, s->rest, false);
    for (size_t i = 0; i < count; i++) {
        s->rest[i] = -s->rest[i];
        s->step[i] = s->rest[i] / s->diagonal[i];
    }
    double square = measure_rest(s);
    for (int round = 0; round < MAX_ROUNDS && square > ACCURACY * ACCURACY * (double)s->sample_count;
         round++) {
        if (qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "surface of points canceled");
        apply(s, s->step, s->product, false);
        double along = 0.0;
        for (size_t i = 0; i < count; i++)
            along += s->step[i] * s->product[i];
        if (!(along > 0.0)) break;
        double length = square / along, before = square;
        for (size_t i = 0; i < count; i++) {
            field[i] += length * s->step[i];
            s->rest[i] -= length * s->product[i];
        }
        square = measure_rest(s);
        for (size_t i = 0; i < count; i++)
            s->step[i] = s->rest[i] / s->diagonal[i] + square / before * s->step[i];
    }
    return QM_OK;
}

qm_status qm_cloud_field_solve(qm_context *ctx, const qm_cloud_grid *grid, const qm_cloud_sample *samples,
                               size_t count, double *field)
{
    size_t nodes = grid->node_count;
    double *memory = qm_context_alloc(ctx, nodes, 4 * sizeof *memory);
    if (!memory) return no_memory(ctx);
    solver s = {grid, samples, count, memory, memory + nodes, memory + 2 * nodes, memory + 3 * nodes};
    qm_status status = run(ctx, &s, field);
    qm_context_free(ctx, memory, nodes, 4 * sizeof *memory);
    return status;
}
