#include "bvh/bvh_tree.h"
#include "reconstruct_atlas.h"

#include <string.h>

#define FIRST_PER_PATCH 300 /* samples for the first parameters */
#define FIRST_LEAST 8000
#define FIRST_MOST 60000
#define FIRST_PER_QUAD 6 /* samples that a quad of the first grids needs */
#define START_FAIR 10    /* rounds of evening out after the first placing */
#define EDIT_ROUNDS 2    /* of placing what an edit has touched */

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
        qm_grid_free(ctx, &r->grids[p]);
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

/** Samples for the first parameters. */
static size_t first_samples(const qm_reconstruction *r)
{
    size_t wanted = r->layout.patch_count * FIRST_PER_PATCH;
    return wanted < FIRST_LEAST ? FIRST_LEAST : wanted > FIRST_MOST ? FIRST_MOST : wanted;
}

/** Samples of each patch by their first parameters; a patch without any lies beside the surface. */
static qm_status count_points(qm_context *ctx, qm_reconstruction *r, const qm_samples *samples)
{
    for (size_t i = 0; i < samples->count; i++)
        if (samples->place[i].distance < INFINITY) r->grids[samples->place[i].patch].points++;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        if (r->grids[p].points == 0)
            return qm_context_fail(ctx, QM_E_LAYOUT,
                                   "patch %zu (curves %u, %u, %u, %u) has no point of the surface inside", p,
                                   r->layout.curves[r->layout.patches[p].side[0]].id,
                                   r->layout.curves[r->layout.patches[p].side[1]].id,
                                   r->layout.curves[r->layout.patches[p].side[2]].id,
                                   r->layout.curves[r->layout.patches[p].side[3]].id);
    return QM_OK;
}

static void count_covered(qm_reconstruction *r, const qm_samples *samples)
{
    r->point_count = samples->count;
    r->uncovered_count = 0;
    for (size_t i = 0; i < samples->count; i++)
        r->uncovered_count += samples->place[i].distance > qm_reconstruction_reach(r);
}

/** Grids by the first parameters: at the base count, then as fine as the samples allow where lines are long;
 * at last by as many samples as that needs. */
static qm_status place_first(qm_context *ctx, qm_reconstruction *r, qm_samples *samples)
{
    qm_status status = qm_grids_create(ctx, r);
    if (status == QM_OK) status = count_points(ctx, r, samples);
    if (status == QM_OK) status = qm_place_vertices(ctx, r, samples);
    if (status != QM_OK) return status;
    qm_chords_measure(r);
    qm_chords_refine_work(r, samples->count / FIRST_PER_QUAD);
    status = qm_tracks_set_vertices(ctx, r);
    if (status == QM_OK) status = qm_grids_create(ctx, r);
    if (status != QM_OK) return status;
    qm_samples_scale(r, samples, QM_RECONSTRUCTION_BASE);
    status = qm_place_vertices(ctx, r, samples);
    if (status == QM_OK) status = qm_grids_refine(ctx, r, START_FAIR, samples);
    if (status != QM_OK) return status;
    count_covered(r, samples);
    qm_samples_reset(ctx, samples);
    status = qm_samples_create_fine(ctx, r, samples);
    if (status == QM_OK) status = qm_grids_refine(ctx, r, QM_STEP_FAIR, samples);
    if (status != QM_OK) return status;
    qm_chords_measure(r);
    return QM_OK;
}

/** Curves on the surface, chords and first parameters of samples; old is the one before an edit, or NULL. */
static qm_status prepare(qm_context *ctx, qm_reconstruction *r, const qm_reconstruction *old,
                         qm_samples *samples)
{
    qm_status status = allocate(ctx, r);
    if (status == QM_OK) status = qm_chords_find(ctx, r);
    if (status == QM_OK) status = qm_tracks_create(ctx, r);
    if (status == QM_OK) status = qm_tracks_detour(ctx, r, first_samples(r));
    if (status == QM_OK) qm_tracks_straighten(r);
    if (status == QM_OK && old) {
        qm_edit_inherit_counts(r, old);
        qm_edit_inherit_tracks(r, old);
    }
    if (status == QM_OK) status = qm_tracks_set_vertices(ctx, r);
    if (status == QM_OK) status = qm_atlas_join_patches(ctx, r);
    qm_atlas_nodes nodes = {0};
    if (status == QM_OK) status = qm_samples_create(ctx, r, first_samples(r), samples);
    if (status == QM_OK) status = qm_atlas_nodes_create(ctx, r, samples, &nodes);
    if (status == QM_OK) status = qm_atlas_locate(ctx, r, &nodes, samples);
    qm_atlas_nodes_reset(ctx, &nodes);
    return status;
}

static qm_status build(qm_context *ctx, qm_reconstruction *r)
{
    qm_samples samples = {0};
    qm_status status = prepare(ctx, r, NULL, &samples);
    if (status == QM_OK) status = place_first(ctx, r, &samples);
    qm_samples_reset(ctx, &samples);
    return status;
}

/** Places the grids that an edit has touched: by the first parameters, which may be too few for as fine a
 * grid as that, then by as many samples as it needs. */
static qm_status place_touched(qm_context *ctx, qm_reconstruction *r, const qm_reconstruction *old,
                               qm_samples *samples, size_t *redone)
{
    qm_status status = qm_grids_create(ctx, r);
    if (status == QM_OK) status = count_points(ctx, r, samples);
    if (status != QM_OK) return status;
    qm_samples_scale(r, samples, QM_RECONSTRUCTION_BASE);
    *redone = qm_edit_keep_grids(r, old);
    status = qm_place_vertices(ctx, r, samples);
    qm_samples_reset(ctx, samples);
    if (status == QM_OK) status = qm_samples_create_fine(ctx, r, samples);
    for (int round = 0; round < EDIT_ROUNDS && status == QM_OK; round++)
        status = qm_grids_refine(ctx, r, round == 0 ? START_FAIR : QM_STEP_FAIR, samples);
    if (status != QM_OK) return status;
    count_covered(r, samples);
    qm_chords_measure(r);
    return QM_OK;
}

/** A reconstruction with a copy of a layout that can be one, and nothing else yet; NULL with a status. */
static qm_status begin(qm_context *ctx, const qm_source *source, const qm_layout *layout,
                       const qm_reconstruction_options *options, qm_reconstruction **out)
{
    *out = NULL;
    if (!(options->cover_share > 0.0) || options->thread_count < 1)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the cover share must be above 0, threads 1 or more");
    if (layout->patch_count == 0)
        return qm_context_fail(ctx, QM_E_LAYOUT, "the layout has no patch: no four curves close a cell");
    qm_status status = qm_layout_validate(ctx, layout, source->diagonal);
    if (status != QM_OK) return status;
    qm_reconstruction *r = qm_context_alloc(ctx, 1, sizeof *r);
    if (!r) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the reconstruction");
    *r = (qm_reconstruction){.source = *source, .options = *options};
    status = qm_layout_copy(ctx, layout, &r->layout);
    if (status == QM_OK)
        *out = r;
    else
        qm_context_free(ctx, r, 1, sizeof *r);
    return status;
}

qm_status qm_reconstruction_create(qm_context *ctx, const qm_source *source, const qm_layout *layout,
                                   const qm_reconstruction_options *options, qm_reconstruction **out)
{
    qm_status status = begin(ctx, source, layout, options, out);
    if (status == QM_OK) status = build(ctx, *out);
    if (status == QM_OK) return QM_OK;
    qm_reconstruction_destroy(ctx, *out);
    *out = NULL;
    return status;
}

qm_status qm_reconstruction_edit(qm_context *ctx, const qm_reconstruction *old, const qm_layout *layout,
                                 qm_reconstruction **out, size_t *redone_patches)
{
    qm_samples samples = {0};
    qm_status status = begin(ctx, &old->source, layout, &old->options, out);
    if (status == QM_OK) status = prepare(ctx, *out, old, &samples);
    if (status == QM_OK) status = place_touched(ctx, *out, old, &samples, redone_patches);
    qm_samples_reset(ctx, &samples);
    if (status == QM_OK) return QM_OK;
    qm_reconstruction_destroy(ctx, *out);
    *out = NULL;
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

qm_reconstruction_patch qm_reconstruction_get_patch(const qm_reconstruction *r, size_t patch)
{
    qm_reconstruction_patch out = {.columns = qm_patch_chord(r, patch, 0)->edges,
                                   .rows = qm_patch_chord(r, patch, 1)->edges,
                                   .points = r->grids[patch].points};
    for (size_t p = 0; p < patch; p++)
        out.first_face += (size_t)qm_patch_chord(r, p, 0)->edges * qm_patch_chord(r, p, 1)->edges;
    return out;
}

void qm_reconstruction_coverage(const qm_reconstruction *r, size_t *points, size_t *uncovered)
{
    *points = r->point_count;
    *uncovered = r->uncovered_count;
}

double qm_reconstruction_cover_distance(const qm_reconstruction *r)
{
    return qm_reconstruction_reach(r);
}
