#include "reconstruct_atlas.h"

#include <string.h>

#define TRUST 0.8 /* of the samples agree, or their normals are not believed */

/** How many samples look to the side of other normals, and how many against them. */
typedef struct side_votes {
    size_t along, against;
} side_votes;

static qm_vec own_normal(const qm_samples *samples, size_t i)
{
    const float *row = samples->normals + 3 * i;
    return (qm_vec){row[0], row[1], row[2]};
}

/** The side of the grid under a sample that its normal looks to: 1, -1, or 0 where that is not told. */
static int sample_side(const qm_reconstruction *r, const qm_samples *samples, size_t i)
{
    const qm_sample_place *place = &samples->place[i];
    const qm_patch_grid *grid = &r->grids[place->patch];
    uint32_t column = (uint32_t)place->u, row = (uint32_t)place->v;
    if (column == grid->columns) column--;
    if (row == grid->rows) row--;
    const double *a = qm_grid_vertex(grid, column, row), *b = qm_grid_vertex(grid, column + 1, row);
    const double *c = qm_grid_vertex(grid, column + 1, row + 1), *d = qm_grid_vertex(grid, column, row + 1);
    qm_vec normal =
        qm_vec_cross(qm_vec_sub(qm_vec_load(c), qm_vec_load(a)), qm_vec_sub(qm_vec_load(d), qm_vec_load(b)));
    double dot = qm_vec_dot(normal, own_normal(samples, i));
    return (dot > 0.0) - (dot < 0.0);
}

static void count_votes(const qm_reconstruction *r, const qm_samples *samples, side_votes *votes)
{
    memset(votes, 0, r->layout.patch_count * sizeof *votes);
    for (size_t i = 0; i < samples->count; i++) {
        int side = sample_side(r, samples, i);
        votes[samples->place[i].patch].along += side > 0;
        votes[samples->place[i].patch].against += side < 0;
    }
}

/** The side that nearly all look to, or 0. */
static int trusted_side(const side_votes *votes)
{
    double all = (double)(votes->along + votes->against);
    if ((double)votes->along > TRUST * all) return 1;
    return (double)votes->against > TRUST * all ? -1 : 0;
}

/** True when the normals of nearly all neighbours look to the same side. */
static bool agree_nearby(const qm_samples *samples, const qm_surface_graph *graph)
{
    side_votes votes = {0};
    for (size_t i = 0; i < samples->count; i++) {
        for (int k = 0; k < QM_GRAPH_LINKS && graph->link[i][k] != QM_NO_INDEX; k++) {
            if (graph->link[i][k] >= samples->count) continue;
            double dot = qm_vec_dot(own_normal(samples, i), own_normal(samples, graph->link[i][k]));
            votes.along += dot > 0.0;
            votes.against += dot < 0.0;
        }
    }
    return trusted_side(&votes) > 0;
}

bool qm_samples_orient(const qm_samples *samples, qm_surface_graph *graph)
{
    if (!samples->normals || !agree_nearby(samples, graph)) return false;
    for (size_t i = 0; i < graph->count; i++) {
        qm_vec side = {0, 0, 0};
        if (i < samples->count) side = own_normal(samples, i);
        for (int k = 0; k < QM_GRAPH_LINKS && graph->link[i][k] != QM_NO_INDEX && i >= samples->count; k++)
            if (graph->link[i][k] < samples->count)
                side = qm_vec_add(side, own_normal(samples, graph->link[i][k]));
        if (qm_vec_dot(graph->normal[i], side) < 0.0) graph->normal[i] = qm_vec_scale(-1.0, graph->normal[i]);
    }
    return true;
}

qm_status qm_samples_drop_turned(qm_context *ctx, const qm_reconstruction *r, qm_samples *samples)
{
    side_votes *votes = qm_context_alloc(ctx, r->layout.patch_count, sizeof *votes);
    if (!votes) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for samples of the surface");
    count_votes(r, samples, votes);
    for (size_t i = 0; i < samples->count; i++) {
        int trusted = trusted_side(&votes[samples->place[i].patch]);
        if (trusted == 0 || sample_side(r, samples, i) != -trusted) continue;
        /* On the outline it tells nothing of the inside. */
        samples->place[i].u = samples->place[i].v = 0.0;
    }
    qm_context_free(ctx, votes, r->layout.patch_count, sizeof *votes);
    return QM_OK;
}
