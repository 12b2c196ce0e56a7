/**
 * reconstruct.c: creation, steps and edits of a reconstruction, as sequences of the stages that
 * reconstruct_internal.h lists.
 *
 * Creation: chords, polylines, samples with parameters along the surface; lattices fitted by these parameters
 * at the base count, then at the count that the samples allow, then by samples projected onto the lattices.
 * A step doubles chords, and fits what that splits. An edit creates a reconstruction of the edited layout and
 * takes over all that the edit left as it was.
 *
 * The mesh of a layout with grids needs no steps: lattices with the numbers of edges that fill the limit start at the grids.
 */
#include "reconstruct_internal.h"

#include <string.h>

#include "bvh/bvh_tree.h"

#define FIRST_PER_PATCH 300 /* samples for the first parameters, within FIRST_MIN and FIRST_MAX */
#define FIRST_MIN 8000
#define FIRST_MAX 60000
#define FIRST_PER_QUAD 6    /* of these, samples that a quad of the first lattices needs */
#define SAMPLES_PER_QUAD 12 /* samples projected onto the lattices */
#define START_FAIR 10       /* rounds of fairing of lattices that have just been created */
#define STEP_FAIR 4         /* rounds of fairing of lattices that were fitted before */
#define MAX_STRAY 0.05      /* of the mean samples of a patch: fewer may have strayed into one over a hole */
#define EDIT_ROUNDS 2       /* fits of the lattices that an edit has changed */
#define START_ROUNDS 2      /* fits of lattices that start at grids or maps */
#define FILL_ROUNDS 2       /* fits of lattices that got counts that are no multiples of the old ones */

enum { POINT_SIZE = 3 * sizeof(double) };

qm_reconstruction_options qm_reconstruction_options_default(void)
{
    return (qm_reconstruction_options){.cover_share = 0.02,
                                       .pull_curves = true,
                                       .noise_share = QM_NOISE_AUTOMATIC,
                                       .thread_count = 1,
                                       .settles_coarse = true};
}

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the reconstruction");
}

void qm_reconstruction_destroy(qm_context *ctx, qm_reconstruction *r)
{
    if (!r) return;
    for (size_t i = 0; i < r->layout.curve_count && r->polylines; i++) {
        qm_polyline *polyline = &r->polylines[i];
        qm_context_free(ctx, polyline->points, polyline->point_count, POINT_SIZE);
        qm_context_free(ctx, polyline->arc, polyline->point_count, sizeof *polyline->arc);
        qm_context_free(ctx, polyline->vertices, (size_t)polyline->vertex_edges + 1, POINT_SIZE);
        qm_context_free(ctx, polyline->across, (size_t)polyline->vertex_edges + 1, POINT_SIZE);
    }
    for (size_t p = 0; p < r->layout.patch_count && r->lattices; p++)
        qm_lattice_free(ctx, &r->lattices[p]);
    qm_context_free(ctx, r->polylines, r->layout.curve_count, sizeof *r->polylines);
    qm_context_free(ctx, r->lattices, r->layout.patch_count, sizeof *r->lattices);
    qm_context_free(ctx, r->chords, r->layout.curve_count, sizeof *r->chords);
    qm_layout_reset(ctx, &r->layout);
    qm_creases_reset(ctx, &r->creases);
    qm_anchors_reset(ctx, &r->anchors);
    qm_guide_release(ctx, r->guide);
    qm_context_free(ctx, r, 1, sizeof *r);
}

/** Takes as many samples as the quads of the lattices need. */
static qm_status create_fine_samples(qm_context *ctx, const qm_reconstruction *r, qm_samples *out)
{
    size_t quads = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        quads += (size_t)r->lattices[p].columns * r->lattices[p].rows;
    return qm_samples_create(ctx, r, SAMPLES_PER_QUAD * quads, out);
}

/** Fairs the stale lattices and fits them to the samples, projected onto the lattices. */
static qm_status refine_lattices(qm_context *ctx, qm_reconstruction *r, int fair_rounds, qm_samples *samples)
{
    qm_status status = qm_lattices_fair(ctx, r, fair_rounds);
    if (status == QM_OK) status = qm_samples_project(ctx, r, samples);
    if (status == QM_OK) status = qm_lattices_fit(ctx, r, samples);
    for (size_t p = 0; p < r->layout.patch_count && status == QM_OK; p++) {
        if (!r->lattices[p].is_stale || r->lattices[p].spans_hole) continue;
        if (qm_context_canceled(ctx)) status = qm_context_fail(ctx, QM_E_CANCELED, "reconstruction canceled");
        if (status == QM_OK) qm_lattice_untangle(&r->surface, &r->lattices[p]);
    }
    return status == QM_OK ? qm_anchors_recover(ctx, r, samples) : status;
}

/** The distance of a position from the surface, of a point set from its nearest point: the surface through points runs
 * on into holes. */
static double gap(const qm_ref_surface *surface, const double position[3])
{
    if (surface->is_cloud) {
        qm_nearest_points near;
        qm_nearest_points_find(surface->bvh, qm_frame_local(&surface->bvh->frame, position), 1, &near);
        return sqrt(near.d2[0]) * surface->bvh->frame.inverse_scale;
    }
    qm_ref_surface_point projection;
    qm_ref_surface_project(surface, position, &projection);
    return projection.distance;
}

/** True if most inner vertices of a lattice, a Coons patch, lie near the surface, for the size of their edges. */
static bool is_near_surface(const qm_reconstruction *r, const qm_lattice *lattice)
{
    size_t near = 0, count = 0;
    for (uint32_t j = 1; j < lattice->rows; j++) {
        for (uint32_t i = 1; i < lattice->columns; i++, count++) {
            double edge =
                fmax(qm_vec_distance(qm_lattice_at(lattice, i - 1, j), qm_lattice_at(lattice, i, j)),
                     qm_vec_distance(qm_lattice_at(lattice, i, j - 1), qm_lattice_at(lattice, i, j)));
            const double *vertex = qm_lattice_vertex(lattice, i, j);
            /* The edges of a small patch may be shorter than the spacing of points. */
            bool is_dense = r->surface.is_cloud && !qm_cloud_is_in_gap(r->surface.bvh, vertex);
            double reach = qm_reconstruction_cover_distance(r);
            near += gap(&r->surface, vertex) <= (is_dense ? reach : fmin(0.5 * edge, reach));
        }
    }
    return 2 * near > count;
}

/** True if another patch has the curve too, or if most of it lies near the surface. */
static bool is_held(const qm_reconstruction *r, uint32_t curve)
{
    size_t owners = 0, near = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        for (int k = 0; k < 4; k++)
            owners += r->layout.patches[p].side[k] == curve;
    if (owners > 1) return true;
    const qm_polyline *polyline = &r->polylines[curve];
    for (size_t i = 0; i < polyline->point_count; i++) {
        qm_ref_surface_point projection;
        qm_ref_surface_project(&r->surface, polyline->points + 3 * i, &projection);
        near += projection.distance <= qm_reconstruction_cover_distance(r);
    }
    return 2 * near > polyline->point_count;
}

/** True if a patch without samples lies in a hole of the surface: all its curves are held. */
static bool is_in_hole(const qm_reconstruction *r, const uint32_t side[4])
{
    return is_held(r, side[0]) && is_held(r, side[1]) && is_held(r, side[2]) && is_held(r, side[3]);
}

/**
 * Counts the samples of each patch by their first parameters. A patch without any is thinner than the samples are
 * dense, or spans a hole, or lies beside the surface, which is an error.
 */
static qm_status count_points(qm_context *ctx, qm_reconstruction *r, const qm_samples *samples)
{
    for (size_t i = 0; i < samples->count; i++)
        if (samples->location[i].distance < INFINITY) r->lattices[samples->location[i].patch].points++;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const uint32_t *side = r->layout.patches[p].side;
        double mean = (double)samples->count / (double)r->layout.patch_count;
        if ((double)r->lattices[p].points > MAX_STRAY * mean || is_near_surface(r, &r->lattices[p])) continue;
        r->lattices[p].spans_hole = is_in_hole(r, side);
        if (r->lattices[p].spans_hole || r->lattices[p].points > 0) continue;
        return qm_context_fail(ctx, QM_E_LAYOUT,
                               "patch %zu (curves %u, %u, %u, %u) has no point of the surface inside", p,
                               r->layout.curves[side[0]].id, r->layout.curves[side[1]].id,
                               r->layout.curves[side[2]].id, r->layout.curves[side[3]].id);
    }
    return QM_OK;
}

/** Counts the samples that are far from all lattices. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
static qm_status count_uncovered(qm_context *ctx, qm_reconstruction *r, qm_samples *samples)
{
    qm_status status = samples->is_projected ? QM_OK : qm_samples_project(ctx, r, samples);
    if (status != QM_OK) return status;
    r->point_count = samples->count;
    r->uncovered_count = 0;
    for (size_t i = 0; i < samples->count; i++)
        r->uncovered_count += samples->location[i].distance > qm_reconstruction_cover_distance(r);
    return QM_OK;
}

/** The number of samples for the first parameters. */
static size_t first_sample_count(const qm_reconstruction *r)
{
    size_t wanted = r->layout.patch_count * FIRST_PER_PATCH;
    return wanted < FIRST_MIN ? FIRST_MIN : wanted > FIRST_MAX ? FIRST_MAX : wanted;
}

/*
 * What an edit takes over from the reconstruction of the layout before it.
 */

/** The curve of the old layout that has the id of this one, or QM_NO_INDEX. */
static uint32_t find_old_curve(const qm_reconstruction *r, const qm_reconstruction *old, size_t curve)
{
    return qm_layout_find_curve(&old->layout, r->layout.curves[curve].id);
}

/** True if the points, the mark and the corners of a curve are those of the old one. */
static bool is_unchanged(const qm_reconstruction *r, const qm_reconstruction *old, size_t curve,
                         uint32_t old_curve)
{
    const qm_curve *a = &r->layout.curves[curve], *b = &old->layout.curves[old_curve];
    if (qm_layout_is_corner(&r->layout, a->from) != qm_layout_is_corner(&old->layout, b->from) ||
        qm_layout_is_corner(&r->layout, a->to) != qm_layout_is_corner(&old->layout, b->to))
        return false;
    return a->mark == b->mark && a->point_count == b->point_count &&
           memcmp(a->points, b->points, a->point_count * POINT_SIZE) == 0;
}

/**
 * Raises the counts of chords to those that their curves had, and copies the polylines of unchanged curves with their vertices, which a
 * fit to noise may have moved. QM_OK or QM_E_NO_MEMORY.
 */
static qm_status inherit_curves(qm_context *ctx, qm_reconstruction *r, const qm_reconstruction *old)
{
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        uint32_t old_curve = find_old_curve(r, old, i);
        if (old_curve == QM_NO_INDEX) continue;
        const qm_polyline *from = &old->polylines[old_curve];
        qm_polyline *to = &r->polylines[i];
        if (to->chord != QM_NO_INDEX && from->chord != QM_NO_INDEX) {
            const qm_chord *old_chord = &old->chords[from->chord];
            qm_chord *chord = &r->chords[to->chord];
            if (chord->edges < old_chord->edges) chord->edges = old_chord->edges;
            if (chord->lattice_edges < old_chord->lattice_edges)
                chord->lattice_edges = old_chord->lattice_edges;
        }
        if (!is_unchanged(r, old, i, old_curve)) continue;
        QM_ASSERT(to->point_count == from->point_count);
        memcpy(to->points, from->points, from->point_count * POINT_SIZE);
        memcpy(to->arc, from->arc, from->point_count * sizeof *from->arc);
        if (to->chord == QM_NO_INDEX || !from->vertices) continue;
        to->vertices = qm_context_alloc(ctx, (size_t)from->vertex_edges + 1, POINT_SIZE);
        if (!to->vertices) return no_memory(ctx);
        to->vertex_edges = from->vertex_edges;
        memcpy(to->vertices, from->vertices, ((size_t)from->vertex_edges + 1) * POINT_SIZE);
    }
    return QM_OK;
}

/**
 * The number of sides by which a patch is rotated against an old one with the same unchanged curves, or -1.
 */
static int find_rotation(const qm_reconstruction *r, const qm_layout_patch *patch,
                         const qm_reconstruction *old, const qm_layout_patch *old_patch)
{
    for (int rotation = 0; rotation < 4; rotation++) {
        int equal = 0;
        while (equal < 4) {
            uint32_t old_curve = find_old_curve(r, old, patch->side[equal]);
            int side = (equal + rotation) % 4;
            if (old_curve != old_patch->side[side] || patch->against[equal] != old_patch->against[side] ||
                !is_unchanged(r, old, patch->side[equal], old_curve))
                break;
            equal++;
        }
        if (equal == 4) return rotation;
    }
    return -1;
}

/** Copies the vertices of a lattice that is rotated by a number of sides, unless its counts differ. */
static void copy_rotated(const qm_lattice *from, int rotation, qm_lattice *to)
{
    QM_ASSERT(rotation >= 0 && rotation < 4);
    bool is_odd = rotation % 2;
    uint32_t columns = is_odd ? from->rows : from->columns, rows = is_odd ? from->columns : from->rows;
    if (to->columns != columns || to->rows != rows) return;
    for (uint32_t j = 0; j <= rows; j++) {
        for (uint32_t i = 0; i <= columns; i++) {
            /* The position before each rotation; entries of the other rotations may be out of range. */
            const uint32_t column[4] = {i, from->columns - j, from->columns - i, j};
            const uint32_t row[4] = {j, i, from->rows - j, from->rows - i};
            size_t source = qm_lattice_index(from, column[rotation], row[rotation]);
            size_t target = qm_lattice_index(to, i, j);
            memcpy(to->vertices + 3 * target, from->vertices + 3 * source, POINT_SIZE);
            to->in_hole[target] = from->in_hole[source];
        }
    }
    to->is_stale = false;
}

/*
 * Creation and edit.
 */

/** Creates a reconstruction with a copy of a valid layout, whose sharp curves lie on creases, and nothing else; *out is to be
 * destroyed after an error, too. */
static qm_status create_empty(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                              const qm_reconstruction_options *options, qm_reconstruction **out)
{
    *out = NULL;
    if (!(options->cover_share > 0.0) || options->thread_count < 1)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the cover share must be above 0, threads 1 or more");
    if (options->noise_share != QM_NOISE_AUTOMATIC &&
        !(options->noise_share >= 0.0 && options->noise_share <= QM_NOISE_MAX))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the noise must be between 0 and %g of the diagonal",
                               QM_NOISE_MAX);
    if (layout->patch_count == 0)
        return qm_context_fail(ctx, QM_E_LAYOUT, "the layout has no patch: no four curves close a cell");
    qm_status status =
        qm_reconstruction_check_place(ctx, surface, layout, options->cover_share * surface->diagonal);
    if (status == QM_OK)
        status = options->grids ? qm_layout_validate_patches(ctx, layout, surface->diagonal)
                                : qm_layout_validate(ctx, layout, surface->diagonal, surface);
    if (status != QM_OK) return status;
    qm_reconstruction *r = qm_context_alloc(ctx, 1, sizeof *r);
    if (!r) return no_memory(ctx);
    *r = (qm_reconstruction){.given = *surface, .surface = *surface, .options = *options};
    status = qm_layout_copy(ctx, layout, &r->layout);
    /* The ends of fixed curves stay, too. Grids come with curves that lie where they belong. */
    for (size_t i = 0; i < r->layout.curve_count && status == QM_OK; i++) {
        const qm_curve *curve = &r->layout.curves[i];
        if (curve->mark != QM_CURVE_FIXED) continue;
        status = qm_layout_set_corner(ctx, &r->layout, curve->from, true);
        if (status == QM_OK) status = qm_layout_set_corner(ctx, &r->layout, curve->to, true);
    }
    if (status == QM_OK && !options->grids) status = qm_creases_follow(ctx, &r->layout, surface, &r->creases);
    *out = r;
    return status;
}

/** Finds the noise and the outliers of the surface, or takes over what was found. */
static qm_status find_guide(qm_context *ctx, qm_reconstruction *r, const qm_reconstruction *old)
{
    qm_status status = QM_OK;
    if (old) {
        r->guide = qm_guide_keep(old->guide);
        r->outlier_share = old->outlier_share;
    } else {
        status = qm_guide_create(ctx, &r->given, r->options.noise_share, r->options.thread_count, &r->guide,
                                 &r->outlier_share);
    }
    if (r->guide) r->surface = *qm_guide_surface(r->guide);
    return status;
}

/** Makes room for chords, polylines and lattices, none of them made. QM_OK or QM_E_NO_MEMORY. */
static qm_status allocate_parts(qm_context *ctx, qm_reconstruction *r)
{
    size_t curves = r->layout.curve_count, patches = r->layout.patch_count;
    r->polylines = qm_context_alloc(ctx, curves, sizeof *r->polylines);
    if (r->polylines) memset(r->polylines, 0, curves * sizeof *r->polylines);
    r->lattices = qm_context_alloc(ctx, patches, sizeof *r->lattices);
    if (r->lattices) memset(r->lattices, 0, patches * sizeof *r->lattices);
    r->chords = qm_context_alloc(ctx, curves, sizeof *r->chords);
    return r->polylines && r->lattices && r->chords ? QM_OK : no_memory(ctx);
}

/** Makes chords, polylines and the first parameters of samples; old is the state before an edit, or NULL. */
static qm_status prepare(qm_context *ctx, qm_reconstruction *r, const qm_reconstruction *old,
                         qm_samples *samples)
{
    qm_status status = allocate_parts(ctx, r);
    if (status == QM_OK) status = find_guide(ctx, r, old);
    if (status == QM_OK) status = qm_samples_create(ctx, r, first_sample_count(r), samples);
    if (status == QM_OK) status = qm_samples_find_sides(ctx, r, samples);
    if (status == QM_OK) status = qm_chords_find(ctx, r);
    if (status == QM_OK) status = qm_polylines_create(ctx, r);
    if (status == QM_OK) status = qm_polylines_reroute(ctx, r, first_sample_count(r));
    if (status == QM_OK) status = qm_maps_lay_jumps(ctx, r);
    if (status == QM_OK) qm_polylines_straighten(r);
    if (status == QM_OK && old) status = inherit_curves(ctx, r, old);
    if (status == QM_OK) status = qm_polylines_set_vertices(ctx, r);
    return status == QM_OK ? qm_parameters_find(ctx, r, samples) : status;
}

/** Starts lattices at the grids of the layout. */
static qm_status start_from_grids(qm_context *ctx, qm_reconstruction *r, qm_samples *samples)
{
    qm_status status = qm_lattices_place(ctx, r);
    if (status != QM_OK) return status;
    qm_chords_measure(r);
    qm_chords_refine_lattices(r, samples->count / FIRST_PER_QUAD);
    status = qm_polylines_set_vertices(ctx, r);
    if (status == QM_OK) status = qm_lattices_place(ctx, r);
    if (status == QM_OK) status = qm_samples_project(ctx, r, samples);
    return status == QM_OK ? count_points(ctx, r, samples) : status;
}

/** Starts lattices as Coons patches, and fits them by the first parameters. */
static qm_status start_from_curves(qm_context *ctx, qm_reconstruction *r, qm_samples *samples)
{
    qm_status status = qm_lattices_create(ctx, r);
    if (status == QM_OK) status = count_points(ctx, r, samples);
    if (status == QM_OK) status = qm_lattices_fit(ctx, r, samples);
    if (status != QM_OK) return status;
    qm_chords_measure(r);
    qm_chords_refine_lattices(r, samples->count / FIRST_PER_QUAD);
    status = qm_polylines_set_vertices(ctx, r);
    if (status == QM_OK) status = qm_lattices_create(ctx, r);
    if (status != QM_OK) return status;
    qm_samples_scale(r, samples, QM_RECONSTRUCTION_BASE);
    return qm_lattices_fit(ctx, r, samples);
}

/** Fits new lattices by projected samples, at last by as many as they need. */
static qm_status fit_new(qm_context *ctx, qm_reconstruction *r, qm_samples *samples)
{
    qm_status status =
        r->options.grids ? start_from_grids(ctx, r, samples) : start_from_curves(ctx, r, samples);
    if (status == QM_OK) status = qm_lattices_choose(ctx, r);
    if (status == QM_OK) status = refine_lattices(ctx, r, START_FAIR, samples);
    if (status == QM_OK) status = count_uncovered(ctx, r, samples);
    if (status != QM_OK) return status;
    qm_samples_reset(ctx, samples);
    status = create_fine_samples(ctx, r, samples);
    if (status == QM_OK) status = refine_lattices(ctx, r, STEP_FAIR, samples);
    if (status == QM_OK) status = qm_noise_fit_lattices(ctx, r, false);
    if (status == QM_OK) qm_chords_measure(r);
    return status;
}

/**
 * Fits the lattices that an edit has changed: by the first parameters, which may be too few for lattices as
 * fine as these, then by as many samples as they need.
 */
static qm_status fit_changed(qm_context *ctx, qm_reconstruction *r, const qm_reconstruction *old,
                             qm_samples *samples, size_t *redone)
{
    qm_status status = qm_lattices_create(ctx, r);
    if (status == QM_OK) status = count_points(ctx, r, samples);
    if (status != QM_OK) return status;
    qm_samples_scale(r, samples, QM_RECONSTRUCTION_BASE);
    /* Copy the lattices of unchanged patches; the others remain stale. */
    size_t stale_count = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        for (size_t q = 0; q < old->layout.patch_count && r->lattices[p].is_stale; q++) {
            int rotation = find_rotation(r, &r->layout.patches[p], old, &old->layout.patches[q]);
            if (rotation >= 0) copy_rotated(&old->lattices[q], rotation, &r->lattices[p]);
        }
        stale_count += r->lattices[p].is_stale;
    }
    *redone = stale_count;
    status = qm_lattices_fit(ctx, r, samples);
    if (status == QM_OK) status = qm_lattices_choose(ctx, r);
    qm_samples_reset(ctx, samples);
    if (status == QM_OK) status = create_fine_samples(ctx, r, samples);
    for (int round = 0; round < EDIT_ROUNDS && status == QM_OK; round++)
        status = refine_lattices(ctx, r, round == 0 ? START_FAIR : STEP_FAIR, samples);
    if (status == QM_OK) status = qm_noise_fit_lattices(ctx, r, true);
    if (status == QM_OK) status = count_uncovered(ctx, r, samples);
    if (status != QM_OK) return status;
    qm_chords_measure(r);
    return QM_OK;
}

qm_status qm_reconstruction_create(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                                   const qm_reconstruction_options *options, qm_reconstruction **out)
{
    QM_ASSERT(ctx && surface && layout && options && out);
    qm_samples samples = {0};
    qm_status status = create_empty(ctx, surface, layout, options, out);
    if (status == QM_OK) status = prepare(ctx, *out, NULL, &samples);
    if (status == QM_OK) status = fit_new(ctx, *out, &samples);
    qm_samples_reset(ctx, &samples);
    if (status == QM_OK) (*out)->options.grids = NULL;
    if (status == QM_OK) return QM_OK;
    qm_reconstruction_destroy(ctx, *out);
    *out = NULL;
    return status;
}

qm_status qm_reconstruction_edit(qm_context *ctx, const qm_reconstruction *old, const qm_layout *layout,
                                 qm_reconstruction **out, size_t *redone_patches)
{
    QM_ASSERT(ctx && old && layout && out && redone_patches);
    qm_samples samples = {0};
    qm_status status = create_empty(ctx, &old->given, layout, &old->options, out);
    if (status == QM_OK) status = prepare(ctx, *out, old, &samples);
    if (status == QM_OK) status = fit_changed(ctx, *out, old, &samples, redone_patches);
    qm_samples_reset(ctx, &samples);
    if (status == QM_OK) return QM_OK;
    qm_reconstruction_destroy(ctx, *out);
    *out = NULL;
    return status;
}

/** Makes chords and polylines, and lattices at the grids, oriented as the surface where its normals tell. */
static qm_status prepare_grids(qm_context *ctx, qm_reconstruction *r)
{
    qm_samples samples = {0};
    qm_status status = allocate_parts(ctx, r);
    if (status == QM_OK) status = qm_samples_create(ctx, r, FIRST_MIN, &samples);
    if (status == QM_OK) status = qm_samples_find_sides(ctx, r, &samples);
    qm_samples_reset(ctx, &samples);
    if (status == QM_OK) status = qm_chords_find(ctx, r);
    if (status == QM_OK) status = qm_polylines_create(ctx, r);
    if (status == QM_OK) qm_polylines_straighten(r);
    if (status == QM_OK) status = qm_polylines_set_vertices(ctx, r);
    if (status == QM_OK) status = qm_parameters_orient(ctx, r);
    if (status == QM_OK && r->has_sides) qm_lattices_orient(r);
    if (status == QM_OK) status = qm_lattices_place(ctx, r);
    if (status == QM_OK) qm_chords_measure(r);
    return status;
}

/** Makes lattices anew with the numbers of edges that the mesh has; such as were not settled on the way are fitted. */
static qm_status make_anew(qm_context *ctx, qm_reconstruction *r, const qm_quads_options *quads,
                           const qm_polyline *steps)
{
    qm_samples samples = {0};
    bool is_settled;
    qm_status status = qm_levels_fill(ctx, r, quads, steps, &is_settled);
    if (status != QM_OK || is_settled) return status;
    status = create_fine_samples(ctx, r, &samples);
    for (int round = 0; round < START_ROUNDS && status == QM_OK; round++)
        status = refine_lattices(ctx, r, round == 0 ? START_FAIR : STEP_FAIR, &samples);
    qm_samples_reset(ctx, &samples);
    return status;
}

qm_status qm_reconstruction_fill_grids(qm_context *ctx, const qm_ref_surface *surface,
                                       const qm_layout *layout, const qm_reconstruction_options *options,
                                       const qm_quads_options *quads, qm_mesh *out)
{
    const size_t max_quads = quads->quads;
    qm_reconstruction_record record = {0};
    QM_ASSERT(ctx && surface && layout && options && options->grids && out);
    qm_reconstruction *r;
    if (surface->is_cloud)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "only meshes are filled from the grids of a layout");
    if (layout->patch_count > max_quads)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the layout has %zu patches, the limit is %zu quads",
                               layout->patch_count, max_quads);
    qm_status status = create_empty(ctx, surface, layout, options, &r);
    if (status == QM_OK) status = prepare_grids(ctx, r);
    if (status == QM_OK) status = qm_chords_fill(ctx, r, max_quads, &record);
    if (status == QM_OK) status = make_anew(ctx, r, quads, NULL);
    if (status == QM_OK) status = qm_lattices_mesh(ctx, r, false, out);
    qm_reconstruction_destroy(ctx, r);
    return status;
}

/*
 * Steps.
 */

/** A copy of all that a step changes. Of the polylines, only the vertices are copies. */
typedef struct saved_state {
    qm_chord *chords;
    qm_polyline *polylines;
    qm_lattice *lattices;
} saved_state;

static void *copy_array(qm_context *ctx, const void *from, size_t count, size_t width)
{
    void *copy = qm_context_alloc(ctx, count, width);
    if (copy) memcpy(copy, from, count * width);
    return copy;
}

static size_t vertex_count(const qm_polyline *polyline)
{
    return (size_t)polyline->vertex_edges + 1;
}

/** Frees a copy, whose vertices may be NULL. */
static void free_saved(qm_context *ctx, const qm_reconstruction *r, saved_state *saved)
{
    for (size_t i = 0; i < r->layout.curve_count && saved->polylines; i++) {
        qm_context_free(ctx, saved->polylines[i].vertices, vertex_count(&saved->polylines[i]), POINT_SIZE);
        qm_context_free(ctx, saved->polylines[i].across, vertex_count(&saved->polylines[i]), POINT_SIZE);
    }
    for (size_t p = 0; p < r->layout.patch_count && saved->lattices; p++)
        qm_lattice_free(ctx, &saved->lattices[p]);
    qm_context_free(ctx, saved->chords, r->layout.curve_count, sizeof *saved->chords);
    qm_context_free(ctx, saved->polylines, r->layout.curve_count, sizeof *saved->polylines);
    qm_context_free(ctx, saved->lattices, r->layout.patch_count, sizeof *saved->lattices);
    *saved = (saved_state){0};
}

static qm_status save_state(qm_context *ctx, const qm_reconstruction *r, saved_state *out)
{
    size_t curves = r->layout.curve_count, patches = r->layout.patch_count;
    out->chords = copy_array(ctx, r->chords, curves, sizeof *r->chords);
    out->polylines = copy_array(ctx, r->polylines, curves, sizeof *r->polylines);
    out->lattices = copy_array(ctx, r->lattices, patches, sizeof *r->lattices);
    bool has_memory = out->chords && out->polylines && out->lattices;
    for (size_t i = 0; i < curves && out->polylines; i++) {
        const qm_polyline *from = &r->polylines[i];
        qm_polyline *to = &out->polylines[i];
        to->vertices = to->across = NULL;
        if (from->vertices) {
            to->vertices = copy_array(ctx, from->vertices, vertex_count(from), POINT_SIZE);
            has_memory &= to->vertices != NULL;
        }
        if (from->across) {
            to->across = copy_array(ctx, from->across, vertex_count(from), POINT_SIZE);
            has_memory &= to->across != NULL;
        }
    }
    for (size_t p = 0; p < patches && out->lattices; p++) {
        const qm_lattice *from = &r->lattices[p];
        qm_lattice *to = &out->lattices[p];
        bool is_allocated = qm_lattice_allocate(ctx, to);
        has_memory &= is_allocated;
        if (!is_allocated) continue;
        size_t count = qm_lattice_vertex_count(from);
        memcpy(to->vertices, from->vertices, count * POINT_SIZE);
        memcpy(to->in_hole, from->in_hole, count * sizeof *from->in_hole);
    }
    if (has_memory) return QM_OK;
    free_saved(ctx, r, out);
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a copy of the patches");
}

static void restore_state(qm_context *ctx, qm_reconstruction *r, const saved_state *saved)
{
    saved_state changed = {.chords = r->chords, .polylines = r->polylines, .lattices = r->lattices};
    r->chords = saved->chords;
    r->polylines = saved->polylines;
    r->lattices = saved->lattices;
    free_saved(ctx, r, &changed);
}

static qm_status take_step(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                           qm_reconstruction_record *out)
{
    for (size_t p = 0; p < r->layout.patch_count; p++)
        r->lattices[p].is_stale = false;
    bool can_double = qm_chords_can_double(r, max_quads);
    qm_status status = can_double ? qm_chords_double(ctx, r, out) : qm_chords_fill(ctx, r, max_quads, out);
    if (status == QM_OK) status = qm_polylines_set_vertices(ctx, r);
    if (status == QM_OK) status = qm_lattices_resample(ctx, r);
    bool is_any_stale = false;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        is_any_stale |= r->lattices[p].is_stale;
    /* The lattices are finer than the mesh of the first steps, which takes more of their vertices. */
    if (status != QM_OK || !is_any_stale) return status;
    qm_samples samples = {0};
    status = create_fine_samples(ctx, r, &samples);
    /* Between vertices at other places, a lattice has kinks that one round does not take out. */
    for (int round = 0; round < (can_double ? 1 : FILL_ROUNDS) && status == QM_OK; round++)
        status = refine_lattices(ctx, r, STEP_FAIR, &samples);
    qm_samples_reset(ctx, &samples);
    return status == QM_OK ? qm_noise_fit_lattices(ctx, r, false) : status;
}

qm_status qm_reconstruction_step(qm_context *ctx, qm_reconstruction *r, size_t max_quads,
                                 qm_reconstruction_record *out)
{
    QM_ASSERT(ctx && r && out);
    *out = (qm_reconstruction_record){0};
    saved_state saved;
    qm_status status = save_state(ctx, r, &saved);
    if (status != QM_OK) return status;
    status = take_step(ctx, r, max_quads, out);
    if (status == QM_OK) {
        /* Count the inner vertices of the patches that the step has split, and those of them in holes. */
        for (size_t p = 0; p < r->layout.patch_count; p++) {
            const qm_chord *across = qm_chord_of_patch(r, p, 0), *up = qm_chord_of_patch(r, p, 1);
            if (saved.chords[across - r->chords].edges == across->edges &&
                saved.chords[up - r->chords].edges == up->edges)
                continue;
            const qm_lattice *lattice = &r->lattices[p];
            uint32_t column_step = lattice->columns / across->edges, row_step = lattice->rows / up->edges;
            for (uint32_t j = 1; j < up->edges; j++) {
                for (uint32_t i = 1; i < across->edges; i++) {
                    out->moved_vertices++;
                    size_t index = qm_lattice_index(lattice, i * column_step, j * row_step);
                    out->holes_filled += lattice->in_hole[index];
                }
            }
        }
        free_saved(ctx, r, &saved);
    } else {
        restore_state(ctx, r, &saved);
    }
    out->quads = qm_chords_count_quads(r);
    out->longest_edge = qm_chords_longest_edge(r);
    return status;
}

/*
 * Results.
 */

qm_status qm_reconstruction_find_marks(qm_context *ctx, const qm_reconstruction *r, qm_quads_marks *out)
{
    QM_ASSERT(ctx && r && out);
    return qm_lattices_find_marks(ctx, r, false, out);
}

qm_status qm_reconstruction_mesh(qm_context *ctx, const qm_reconstruction *r, qm_mesh *out)
{
    QM_ASSERT(ctx && r && out);
    return qm_lattices_mesh(ctx, r, false, out);
}

qm_status qm_reconstruction_mesh_anew(qm_context *ctx, qm_reconstruction *r, const qm_quads_options *quads,
                                      qm_mesh *out)
{
    QM_ASSERT(ctx && r && quads && out);
    saved_state saved;
    *out = (qm_mesh){0};
    qm_status status = qm_maps_find(ctx, r, &r->maps);
    if (!r->maps) return status;
    status = save_state(ctx, r, &saved);
    if (status == QM_OK) {
        status = make_anew(ctx, r, quads, saved.polylines);
        if (status == QM_OK) status = qm_lattices_mesh(ctx, r, false, out);
        restore_state(ctx, r, &saved);
    }
    qm_tmesh_maps_destroy(ctx, r->maps);
    r->maps = NULL;
    return status;
}

size_t qm_reconstruction_patch_count(const qm_reconstruction *r)
{
    return r->layout.patch_count;
}

qm_reconstruction_patch qm_reconstruction_get_patch(const qm_reconstruction *r, size_t patch)
{
    QM_ASSERT(patch < r->layout.patch_count);
    qm_reconstruction_patch out = {.columns = qm_chord_of_patch(r, patch, 0)->edges,
                                   .rows = qm_chord_of_patch(r, patch, 1)->edges,
                                   .points = r->lattices[patch].points};
    for (size_t p = 0; p < patch; p++)
        out.first_face += (size_t)qm_chord_of_patch(r, p, 0)->edges * qm_chord_of_patch(r, p, 1)->edges;
    return out;
}

void qm_reconstruction_coverage(const qm_reconstruction *r, size_t *points, size_t *uncovered)
{
    *points = r->point_count;
    *uncovered = r->uncovered_count;
}

double qm_reconstruction_noise(const qm_reconstruction *r)
{
    double sigma = 0.0, turn;
    if (r->guide) qm_guide_points(r->guide, &sigma, &turn);
    return sigma;
}

double qm_reconstruction_cover_distance(const qm_reconstruction *r)
{
    return r->options.cover_share * r->surface.diagonal;
}
