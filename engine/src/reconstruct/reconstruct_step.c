#include "reconstruct_work.h"

#define SAMPLES_PER_QUAD 12

static size_t working_quads(const qm_reconstruction *r)
{
    size_t quads = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        quads += (size_t)r->grids[p].columns * r->grids[p].rows;
    return quads;
}

qm_status qm_samples_create_fine(qm_context *ctx, const qm_reconstruction *r, qm_samples *out)
{
    return qm_samples_create(ctx, r, SAMPLES_PER_QUAD * working_quads(r), out);
}

qm_status qm_grids_refine(qm_context *ctx, qm_reconstruction *r, int fair, qm_samples *samples)
{
    qm_status status = qm_grids_fair(ctx, r, fair);
    if (status == QM_OK) status = qm_samples_locate(ctx, r, samples);
    if (status == QM_OK) status = qm_place_vertices(ctx, r, samples);
    if (status == QM_OK) qm_grids_untangle(r);
    return status;
}

static bool any_stale(const qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++)
        if (r->grids[p].is_stale) return true;
    return false;
}

static qm_status take_step(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                           qm_reconstruction_record *out)
{
    for (size_t p = 0; p < r->layout.patch_count; p++)
        r->grids[p].is_stale = false;
    qm_status status = qm_chords_double(ctx, r, max_quads, out);
    if (status == QM_OK) status = qm_tracks_set_vertices(ctx, r);
    if (status == QM_OK) status = qm_grids_double(ctx, r);
    /* The first steps take vertices that are there already. */
    if (status != QM_OK || !any_stale(r)) return status;
    qm_samples samples = {0};
    status = qm_samples_create_fine(ctx, r, &samples);
    if (status == QM_OK) status = qm_grids_refine(ctx, r, QM_STEP_FAIR, &samples);
    qm_samples_reset(ctx, &samples);
    return status;
}

/** Inner vertices of the split patches: these are placed anew, or come from the first grids. */
static void count_moved(const qm_reconstruction *r, const qm_saved_state *saved,
                        qm_reconstruction_record *out)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const qm_chord *across = qm_patch_chord(r, p, 0), *up = qm_patch_chord(r, p, 1);
        if (saved->chords[across - r->chords].edges == across->edges &&
            saved->chords[up - r->chords].edges == up->edges)
            continue;
        const qm_patch_grid *grid = &r->grids[p];
        for (uint32_t j = 1; j < up->edges; j++) {
            for (uint32_t i = 1; i < across->edges; i++) {
                out->moved_vertices++;
                out->holes_filled += grid->in_hole[qm_grid_index(grid, i * (grid->columns / across->edges),
                                                                 j * (grid->rows / up->edges))];
            }
        }
    }
}

qm_status qm_reconstruction_step(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                                 qm_reconstruction_record *out)
{
    *out = (qm_reconstruction_record){0};
    qm_saved_state saved;
    qm_status status = qm_state_save(ctx, r, &saved);
    if (status != QM_OK) return status;
    status = take_step(ctx, r, max_quads, out);
    if (status == QM_OK) {
        count_moved(r, &saved, out);
        qm_state_drop(ctx, r, &saved);
    } else {
        qm_state_restore(ctx, r, &saved);
    }
    out->quads = qm_chords_quads(r);
    out->longest_edge = qm_chords_longest(r);
    return status;
}
