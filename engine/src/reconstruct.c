#include "bvh_tree.h"
#include "reconstruct_work.h"

#include <string.h>

#define START_ROUNDS 4 /* of placing, from the Coons patches on */
#define START_FAIR 10  /* rounds of evening out before each of them */
#define STEP_FAIR 4    /* the same before each step's placing */

enum { ROW = 3 * sizeof(double) };

qm_reconstruction_options qm_reconstruction_options_default(void)
{
    return (qm_reconstruction_options){.cover_share = 0.02, .pull_curves = true, .thread_count = 1};
}

static void free_state(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t i = 0; i < r->layout.curve_count && r->tracks; i++) {
        qm_track *track = &r->tracks[i];
        qm_context_free(ctx, track->points, track->point_count, ROW);
        qm_context_free(ctx, track->arc, track->point_count, sizeof *track->arc);
        qm_context_free(ctx, track->vertices, (size_t)track->vertex_edges + 1, ROW);
    }
    for (size_t p = 0; p < r->layout.patch_count && r->grids; p++)
        qm_context_free(ctx, r->grids[p].vertices, qm_grid_vertex_count(&r->grids[p]), ROW);
    qm_context_free(ctx, r->tracks, r->layout.curve_count, sizeof *r->tracks);
    qm_context_free(ctx, r->grids, r->layout.patch_count, sizeof *r->grids);
    qm_context_free(ctx, r->chords, r->layout.curve_count, sizeof *r->chords);
}

void qm_reconstruction_destroy(qm_context *ctx, qm_reconstruction *r)
{
    if (!r) return;
    free_state(ctx, r);
    qm_layout_reset(ctx, &r->layout);
    qm_context_free(ctx, r, 1, sizeof *r);
}

static qm_status allocate(qm_context *ctx, qm_reconstruction *r)
{
    size_t curves = r->layout.curve_count, patches = r->layout.patch_count;
    r->tracks = qm_context_alloc(ctx, curves, sizeof *r->tracks);
    if (r->tracks) memset(r->tracks, 0, curves * sizeof *r->tracks);
    r->grids = qm_context_alloc(ctx, patches, sizeof *r->grids);
    if (r->grids) memset(r->grids, 0, patches * sizeof *r->grids);
    r->chords = qm_context_alloc(ctx, curves, sizeof *r->chords);
    if (r->tracks && r->grids && r->chords) return QM_OK;
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the reconstruction");
}

static size_t working_quads(const qm_reconstruction *r)
{
    size_t quads = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        quads += (size_t)r->grids[p].columns * r->grids[p].rows;
    return quads;
}

/** Evens out and places the stale grids, a number of times with the same samples. */
static qm_status refine(qm_context *ctx, qm_reconstruction *r, int rounds, int fair, qm_samples *samples,
                        qm_reconstruction_record *out)
{
    qm_status status = QM_OK;
    for (int round = 0; round < rounds && status == QM_OK; round++) {
        out->moved_vertices = out->holes_filled = 0;
        qm_grids_fair(r, fair);
        status = qm_samples_locate(ctx, r, samples);
        if (status == QM_OK) status = qm_place_vertices(ctx, r, samples, out);
    }
    return status;
}

static qm_status build(qm_context *ctx, qm_reconstruction *r)
{
    qm_status status = allocate(ctx, r);
    if (status == QM_OK) status = qm_chords_find(ctx, r);
    if (status == QM_OK) status = qm_tracks_create(ctx, r);
    if (status == QM_OK) status = qm_tracks_set_vertices(ctx, r);
    if (status == QM_OK) status = qm_grids_create(ctx, r);
    qm_samples samples = {0};
    qm_reconstruction_record record;
    if (status == QM_OK) status = qm_samples_create(ctx, r, working_quads(r), &samples);
    if (status == QM_OK) status = refine(ctx, r, START_ROUNDS, START_FAIR, &samples, &record);
    qm_samples_reset(ctx, &samples);
    return status;
}

qm_status qm_reconstruction_create(qm_context *ctx, const qm_source *source, const qm_layout *layout,
                                   const qm_reconstruction_options *options, qm_reconstruction **out)
{
    *out = NULL;
    qm_reconstruction *r = qm_context_alloc(ctx, 1, sizeof *r);
    if (!r) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the reconstruction");
    *r = (qm_reconstruction){.source = *source, .options = *options};
    qm_status status = qm_layout_copy(ctx, layout, &r->layout);
    if (status == QM_OK) status = build(ctx, r);
    if (status != QM_OK) {
        qm_reconstruction_destroy(ctx, r);
        return status;
    }
    *out = r;
    return QM_OK;
}

qm_status qm_reconstruction_step(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                                 qm_reconstruction_record *out)
{
    *out = (qm_reconstruction_record){0};
    qm_status status = qm_chords_double(ctx, r, max_quads, out);
    if (status == QM_OK) status = qm_tracks_set_vertices(ctx, r);
    for (size_t p = 0; p < r->layout.patch_count; p++)
        r->grids[p].is_stale = false;
    if (status == QM_OK) status = qm_grids_double(ctx, r);
    bool any = false;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        any |= r->grids[p].is_stale;
    qm_samples samples = {0};
    if (status == QM_OK && any) status = qm_samples_create(ctx, r, working_quads(r), &samples);
    if (status == QM_OK && any) status = refine(ctx, r, 1, STEP_FAIR, &samples, out);
    qm_samples_reset(ctx, &samples);
    out->quads = qm_chords_quads(r);
    out->longest_edge = qm_chords_longest(r);
    return status;
}

qm_status qm_reconstruction_mesh(qm_context *ctx, const qm_reconstruction *r, qm_mesh *out)
{
    return qm_grids_mesh(ctx, r, false, out);
}

size_t qm_reconstruction_patch_count(const qm_reconstruction *r)
{
    return r->layout.patch_count;
}
