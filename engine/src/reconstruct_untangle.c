/**
 * reconstruct_untangle.c: quads that are folded or nearly so are smoothed out: their inner vertices, and
 * those around, go to the middle of their neighbours and back onto the surface, a few times, until none is
 * left.
 */
#include "quad_shape.h"
#include "reconstruct_work.h"

#include <string.h>

#define LEAST_SINE 0.1 /* at a corner, seen along the quad's normal: below it a quad counts as folded */
#define ROUNDS 12

enum { ROW = 3 * sizeof(double) };

static qm_vec vertex_at(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    return qm_vec_load(qm_grid_vertex(grid, i, j));
}

static double quad_sine(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    const qm_vec corner[4] = {vertex_at(grid, i, j), vertex_at(grid, i + 1, j), vertex_at(grid, i + 1, j + 1),
                              vertex_at(grid, i, j + 1)};
    return qm_quad_least_sine(corner);
}

/** The worst of the four quads round an inner vertex. */
static double worst_around(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    return fmin(fmin(quad_sine(grid, i - 1, j - 1), quad_sine(grid, i, j - 1)),
                fmin(quad_sine(grid, i - 1, j), quad_sine(grid, i, j)));
}

/** Moves a vertex towards the middle of its neighbours, on the surface, as far as that makes the worst of its
 * quads better. */
static bool better_vertex(const qm_source *source, const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    double *vertex = qm_grid_vertex(grid, i, j), worst = worst_around(grid, i, j), best[3], at[3];
    if (worst > LEAST_SINE) return false;
    qm_vec along = qm_vec_add(vertex_at(grid, i - 1, j), vertex_at(grid, i + 1, j));
    qm_vec across = qm_vec_add(vertex_at(grid, i, j - 1), vertex_at(grid, i, j + 1));
    qm_vec here = qm_vec_load(vertex), middle = qm_vec_scale(0.25, qm_vec_add(along, across));
    bool is_better = false;
    memcpy(best, vertex, ROW);
    for (double share = 1.0; share >= 0.25; share /= 2.0) {
        qm_foothold foot;
        qm_vec_store(at, qm_vec_mix(here, middle, share));
        qm_source_pull(source, at, &foot);
        bool is_near = !source->is_cloud || foot.distance <= foot.spacing;
        memcpy(vertex, is_near ? foot.position : at, ROW);
        double now = worst_around(grid, i, j);
        if (!(now > worst)) continue;
        worst = now;
        is_better = true;
        memcpy(best, vertex, ROW);
    }
    memcpy(vertex, best, ROW);
    return is_better;
}

static void untangle_grid(const qm_source *source, const qm_patch_grid *grid)
{
    bool goes_on = true;
    for (int round = 0; round < ROUNDS && goes_on; round++) {
        goes_on = false;
        for (uint32_t j = 1; j < grid->rows; j++)
            for (uint32_t i = 1; i < grid->columns; i++)
                goes_on |= better_vertex(source, grid, i, j);
    }
}

void qm_grids_untangle(const qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++)
        if (r->grids[p].is_stale) untangle_grid(&r->source, &r->grids[p]);
}
