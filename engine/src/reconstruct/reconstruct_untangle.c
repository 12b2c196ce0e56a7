/**
 * reconstruct_untangle.c: quads that are folded or nearly so are smoothed out: their inner vertices, and
 * those around, go to the middle of their neighbours, or wherever else is better, and back onto the surface,
 * a few times, until none is left.
 */
#include "reconstruct_work.h"

#include <string.h>

#define LEAST_SINE 0.1 /* at a corner, seen along the quad's normal: below it a quad counts as folded */
#define ROUNDS 12
#define UNTURN_ROUNDS 3 /* of smoothing and of laying anew what that cannot mend */

enum { ROW = 3 * sizeof(double) };

/** The worst of the four quads round an inner vertex. */
static double worst_around(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    return fmin(fmin(qm_grid_quad_sine(grid, i - 1, j - 1), qm_grid_quad_sine(grid, i, j - 1)),
                fmin(qm_grid_quad_sine(grid, i - 1, j), qm_grid_quad_sine(grid, i, j)));
}

void qm_source_place(const qm_source *source, qm_vec place, double vertex[3])
{
    double at[3];
    qm_foothold foot;
    qm_vec_store(at, place);
    qm_source_pull(source, at, &foot);
    bool is_near = !source->is_cloud || foot.distance <= foot.spacing;
    memcpy(vertex, is_near ? foot.position : at, ROW);
}

/** A vertex and the worst of its quads, while better places are looked for. */
typedef struct trial {
    const qm_source *source;
    const qm_patch_grid *grid;
    uint32_t i, j;
    double worst;
    bool pulls; /* places onto the surface */
} trial;

/** Puts the vertex there when that makes its worst quad better. */
static bool try_place(trial *t, qm_vec place)
{
    double *vertex = qm_grid_vertex(t->grid, t->i, t->j), before[3];
    memcpy(before, vertex, ROW);
    if (t->pulls)
        qm_source_place(t->source, place, vertex);
    else
        qm_vec_store(vertex, place);
    double now = worst_around(t->grid, t->i, t->j);
    if (now > t->worst) {
        t->worst = now;
        return true;
    }
    memcpy(vertex, before, ROW);
    return false;
}

/** Towards the middle of the neighbours. */
static bool try_middle(trial *t)
{
    qm_vec along = qm_vec_add(qm_grid_at(t->grid, t->i - 1, t->j), qm_grid_at(t->grid, t->i + 1, t->j));
    qm_vec across = qm_vec_add(qm_grid_at(t->grid, t->i, t->j - 1), qm_grid_at(t->grid, t->i, t->j + 1));
    qm_vec here = qm_grid_at(t->grid, t->i, t->j), middle = qm_vec_scale(0.25, qm_vec_add(along, across));
    bool is_better = false;
    for (double share = 1.0; share >= 0.25; share /= 2.0)
        is_better |= try_place(t, qm_vec_mix(here, middle, share));
    return is_better;
}

/** Eight ways off, by ever smaller shares of the edges: where curves bend sharply the middle may be no
 * help. */
static bool try_around(trial *t)
{
    qm_vec along = qm_vec_sub(qm_grid_at(t->grid, t->i + 1, t->j), qm_grid_at(t->grid, t->i - 1, t->j));
    qm_vec across = qm_vec_sub(qm_grid_at(t->grid, t->i, t->j + 1), qm_grid_at(t->grid, t->i, t->j - 1));
    bool is_better = false;
    for (double share = 0.25; share > 0.01; share /= 2.0) {
        for (int way = 0; way < 9; way++) {
            double u = share * (way % 3 - 1), v = share * (way / 3 - 1);
            qm_vec here = qm_grid_at(t->grid, t->i, t->j);
            if (way != 4) is_better |= try_place(t, qm_vec_axpy(qm_vec_axpy(here, u, along), v, across));
        }
    }
    return is_better;
}

static bool try_places(trial *t)
{
    bool is_better = try_middle(t);
    if (t->worst <= LEAST_SINE) is_better |= try_around(t);
    return is_better;
}

/** A point set may have too few points there to tell where its surface lies: rather off it than folded. */
static bool better_vertex(const qm_source *source, const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    trial t = {source, grid, i, j, worst_around(grid, i, j), true};
    if (t.worst > LEAST_SINE) return false;
    bool is_better = try_places(&t);
    if (t.worst > 0.0 || !source->is_cloud) return is_better;
    t.pulls = false;
    return try_places(&t) || is_better;
}

static void smooth_folds(const qm_source *source, const qm_patch_grid *grid)
{
    bool goes_on = true;
    for (int round = 0; round < ROUNDS && goes_on; round++) {
        goes_on = false;
        for (uint32_t j = 1; j < grid->rows; j++)
            for (uint32_t i = 1; i < grid->columns; i++)
                goes_on |= better_vertex(source, grid, i, j);
    }
}

void qm_grid_untangle(const qm_source *source, const qm_patch_grid *grid)
{
    bool changed = true;
    for (int round = 0; round < UNTURN_ROUNDS && changed; round++) {
        smooth_folds(source, grid);
        changed = qm_grid_unturn(source, grid);
    }
}

void qm_grids_untangle(const qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++)
        if (r->grids[p].is_stale) qm_grid_untangle(&r->source, &r->grids[p]);
}
