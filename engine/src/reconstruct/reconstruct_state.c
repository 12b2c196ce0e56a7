#include "reconstruct_work.h"

#include <string.h>

enum { ROW = 3 * sizeof(double) };

static double *copy_rows(qm_context *ctx, const double *rows, size_t count)
{
    double *copy = qm_context_alloc(ctx, count, ROW);
    if (copy) memcpy(copy, rows, count * ROW);
    return copy;
}

static size_t track_rows(const qm_track *track)
{
    return (size_t)track->vertex_edges + 1;
}

/** Copies one array of structs, whose vertices are then still shared. */
static void *copy_array(qm_context *ctx, const void *from, size_t count, size_t width)
{
    void *copy = qm_context_alloc(ctx, count, width);
    if (copy) memcpy(copy, from, count * width);
    return copy;
}

/** Gives the copy of a grid arrays of its own; none when it is false. */
static bool copy_grid(qm_context *ctx, const qm_patch_grid *from, qm_patch_grid *to)
{
    size_t count = qm_grid_vertex_count(from);
    if (!qm_grid_allocate(ctx, to)) return false;
    memcpy(to->vertices, from->vertices, count * ROW);
    memcpy(to->in_hole, from->in_hole, count * sizeof *from->in_hole);
    return true;
}

/** Gives the copies vertices of their own. False when out of memory; what has none then has NULL. */
static bool copy_vertices(qm_context *ctx, const qm_reconstruction *r, qm_saved_state *out)
{
    bool has_memory = true;
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        const qm_track *track = &r->tracks[i];
        out->tracks[i].vertices = track->vertices ? copy_rows(ctx, track->vertices, track_rows(track)) : NULL;
        has_memory &= !track->vertices || out->tracks[i].vertices;
    }
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        has_memory &= copy_grid(ctx, &r->grids[p], &out->grids[p]);
    }
    return has_memory;
}

qm_status qm_state_save(qm_context *ctx, const qm_reconstruction *r, qm_saved_state *out)
{
    out->chords = copy_array(ctx, r->chords, r->layout.curve_count, sizeof *r->chords);
    out->tracks = copy_array(ctx, r->tracks, r->layout.curve_count, sizeof *r->tracks);
    out->grids = copy_array(ctx, r->grids, r->layout.patch_count, sizeof *r->grids);
    bool has_memory = out->chords && out->tracks && out->grids;
    if (has_memory && copy_vertices(ctx, r, out)) return QM_OK;
    if (has_memory) {
        qm_state_drop(ctx, r, out);
    } else {
        qm_context_free(ctx, out->chords, r->layout.curve_count, sizeof *r->chords);
        qm_context_free(ctx, out->tracks, r->layout.curve_count, sizeof *r->tracks);
        qm_context_free(ctx, out->grids, r->layout.patch_count, sizeof *r->grids);
    }
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a copy of the patches");
}

void qm_state_drop(qm_context *ctx, const qm_reconstruction *r, qm_saved_state *saved)
{
    for (size_t i = 0; i < r->layout.curve_count; i++)
        qm_context_free(ctx, saved->tracks[i].vertices, track_rows(&saved->tracks[i]), ROW);
    for (size_t p = 0; p < r->layout.patch_count; p++)
        qm_grid_free(ctx, &saved->grids[p]);
    qm_context_free(ctx, saved->chords, r->layout.curve_count, sizeof *saved->chords);
    qm_context_free(ctx, saved->tracks, r->layout.curve_count, sizeof *saved->tracks);
    qm_context_free(ctx, saved->grids, r->layout.patch_count, sizeof *saved->grids);
    *saved = (qm_saved_state){0};
}

void qm_state_restore(qm_context *ctx, qm_reconstruction *r, qm_saved_state *saved)
{
    qm_saved_state failed = {.chords = r->chords, .tracks = r->tracks, .grids = r->grids};
    r->chords = saved->chords;
    r->tracks = saved->tracks;
    r->grids = saved->grids;
    *saved = failed;
    qm_state_drop(ctx, r, saved);
}
