#include "qm/quad_layout.h"

#include <math.h>
#include <string.h>

#include "layout/layout_creases.h"
#include "tmesh/tmesh.h"
#include "tmesh/tmesh_route.h"

#define ROUNDS 32      /* drawings without crossings */
#define CROSSED 6      /* drawings with crossings: after that curves are laid */
#define ROUGH 2        /* drawings where curves may cross */
#define PATIENCE 6     /* drawings that are no better than the best */
#define UNCROSSED 2    /* of these with crossings */
#define HOPELESS 32    /* crossings that two trials leave, or folds of a rough drawing: there is no other */
#define MOST_PATCHES 5 /* for each required vertex, where fewer do */
#define FOLDS_A_CROSSING 64 /* crossings count more than folds: a reconstruction refuses them */

/* Of the quads that are wanted, those of each trial to make a layout of a surface without crossings: a few quads more or
 * less move the irregular vertices. */
static const double trial_shares[] = {1.0, 1.2, 0.8, 1.5};

enum { GRID_SIZE = 3 * QM_LAYOUT_GRID_POINTS * sizeof(double) };

qm_quad_layout_options qm_quad_layout_options_default(void)
{
    return (qm_quad_layout_options){.effort = 4000};
}

static qm_status check(qm_context *ctx, const qm_mesh *mesh, const qm_quad_layout_options *options)
{
    if (!(options->crease_angle >= 0 && options->crease_angle <= 180))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the crease angle must be from 0 to 180 degrees");
    if (mesh->face_count == 0) return qm_context_fail(ctx, QM_E_EMPTY, "a point set has no quads");
    size_t triangles = 0;
    for (size_t f = 0; f < mesh->face_count; f++)
        triangles += mesh->faces[4 * f + 3] == QM_NO_INDEX;
    if (2 * triangles > mesh->face_count)
        return qm_context_fail(ctx, QM_E_ARGUMENT,
                               "a layout needs a mesh of quads; %zu of %zu faces are triangles", triangles,
                               mesh->face_count);
    return QM_OK;
}

typedef struct layout_work {
    qm_context *ctx;
    qm_arena lasting, scratch;
    qm_patch_set set;
    qm_tmesh_quads quads;
    qm_tmesh tmesh;
    qm_tmesh_source source;
    qm_tmesh_triangles triangles;
    uint32_t *length;
    bool *is_held;
} layout_work;

static void free_marks(qm_context *ctx, qm_drawing *drawing)
{
    qm_context_free(ctx, drawing->is_fixed, drawing->layout.node_count, sizeof *drawing->is_fixed);
    qm_context_free(ctx, drawing->is_line, drawing->layout.curve_count, sizeof *drawing->is_line);
    qm_tmesh_guides *guides = &drawing->guides;
    qm_context_free(ctx, guides->points, guides->first ? guides->first[guides->count] : 0,
                    sizeof *guides->points);
    qm_context_free(ctx, guides->first, guides->count + 1, sizeof *guides->first);
    drawing->is_fixed = drawing->is_line = NULL;
    *guides = (qm_tmesh_guides){0};
}

static void free_drawing(qm_context *ctx, qm_drawing *drawing)
{
    free_marks(ctx, drawing);
    qm_layout_reset(ctx, &drawing->layout);
    qm_layout_issues_reset(ctx, &drawing->issues);
    qm_context_free(ctx, drawing->grids, drawing->grid_count, GRID_SIZE);
    *drawing = (qm_drawing){0};
}

static void swap(qm_drawing *a, qm_drawing *b)
{
    qm_drawing spare = *a;
    *a = *b;
    *b = spare;
}

/** The drawn curves themselves as guides, in the scratch arena. False when out of memory. */
static bool guides_of_curves(layout_work *work, const qm_layout *layout, qm_tmesh_guides *out)
{
    size_t total = 0;
    for (size_t c = 0; c < layout->curve_count; c++)
        total += layout->curves[c].point_count;
    *out = (qm_tmesh_guides){.count = layout->curve_count};
    out->first = qm_arena_alloc(&work->scratch, layout->curve_count + 1, sizeof *out->first);
    out->points = qm_arena_alloc(&work->scratch, total, sizeof *out->points);
    if (!out->first || !out->points) return false;
    total = 0;
    for (size_t c = 0; c < layout->curve_count; c++) {
        out->first[c] = total;
        for (size_t i = 0; i < layout->curves[c].point_count; i++)
            out->points[total++] = qm_vec_load(layout->curves[c].points + 3 * i);
    }
    out->first[layout->curve_count] = total;
    return true;
}

/** Lays the curves of a drawing anew along guides, such that they cannot cross (tmesh_route.h), and keeps what comes of it if fewer do. */
static qm_status route_along(layout_work *work, const qm_ref_surface *surface, const qm_tmesh_guides *guides,
                             qm_drawing *drawing)
{
    qm_layout routed = {0};
    qm_layout_issues issues = {0};
    bool is_made;
    double *grids = qm_arena_alloc(&work->scratch, drawing->grid_count, GRID_SIZE);
    if (!grids) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the paths of curves");
    memcpy(grids, drawing->grids, drawing->grid_count * GRID_SIZE);
    qm_status status = qm_tmesh_route(&work->scratch, &work->triangles, &drawing->layout, drawing->is_fixed,
                                      drawing->is_line, guides, grids, &routed, &is_made);
    for (size_t c = 0; c < routed.curve_count; c++)
        routed.curves[c].mark = drawing->layout.curves[c].mark;
    if (status == QM_OK && is_made) status = qm_layout_find_crossings(work->ctx, &routed, surface, &issues);
    if (status == QM_OK && is_made && issues.count < drawing->issues.count) {
        qm_layout spare = drawing->layout;
        qm_layout_issues spare_issues = drawing->issues;
        drawing->layout = routed;
        drawing->issues = issues;
        memcpy(drawing->grids, grids, drawing->grid_count * GRID_SIZE);
        routed = spare;
        issues = spare_issues;
    }
    qm_layout_reset(work->ctx, &routed);
    qm_layout_issues_reset(work->ctx, &issues);
    return status;
}

/** Lays the curves of a drawing that cross along what they come from in the quads, and if they cross then, along what was drawn. */
static qm_status route(layout_work *work, const qm_ref_surface *surface, qm_drawing *drawing)
{
    qm_tmesh_guides drawn;
    qm_arena_rewind(&work->scratch);
    if (!guides_of_curves(work, &drawing->layout, &drawn))
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the paths of curves");
    qm_status status = route_along(work, surface, &drawing->guides, drawing);
    return status == QM_OK && drawing->issues.count > 0 ? route_along(work, surface, &drawn, drawing)
                                                        : status;
}

/** Draws the layout once, with the lengths as they are. *drawing is the caller's, also after an error. */
static qm_status draw_once(layout_work *work, const qm_ref_surface *surface,
                           const qm_quad_layout_options *options, qm_tmesh_classes *classes,
                           qm_drawing *drawing, qm_tmesh_faults *faults)
{
    const size_t most = options->most_patches;
    *drawing = (qm_drawing){0};
    *faults = (qm_tmesh_faults){0};
    qm_arena_rewind(&work->scratch);
    qm_status status =
        qm_tmesh_classes_find(&work->scratch, &work->quads, &work->tmesh, work->length, 1, classes);
    if (status != QM_OK) return status;
    if (most > 0 && classes->face_count > most)
        return qm_context_fail(work->ctx, QM_E_LAYOUT, "the layout has %zu patches, the limit is %zu",
                               classes->face_count, most);
    return qm_tmesh_draw_curves(&work->scratch, &work->quads, &work->set, &work->tmesh, work->length, classes,
                                surface, &work->source, options->may_cross, &work->triangles, drawing,
                                faults);
}

/** Draws a layout whose grids alone are used, once more with other lengths where cells stay folded; keeps the drawing with the fewest. */
static qm_status draw_rough(layout_work *work, const qm_ref_surface *surface,
                            const qm_quad_layout_options *options, qm_drawing *out)
{
    size_t least = SIZE_MAX;
    bool changed = true;
    qm_status status = QM_OK;
    for (int round = 0; status == QM_OK && round < ROUGH && changed && least > 0; round++) {
        qm_tmesh_classes classes;
        qm_tmesh_faults faults;
        qm_drawing drawing;
        status = draw_once(work, surface, options, &classes, &drawing, &faults);
        if (status == QM_OK && !faults.is_refused && faults.folds < least) {
            swap(out, &drawing);
            least = faults.folds;
        }
        free_drawing(work->ctx, &drawing);
        changed = false;
        if (status == QM_OK && !faults.is_refused && faults.folds > 0 && faults.folds <= HOPELESS)
            status = qm_tmesh_spread_lengths(work->ctx, &work->quads, &work->tmesh, &classes,
                                             faults.class_fault, work->is_held, work->length, &changed);
    }
    if (status == QM_E_LAYOUT && least < SIZE_MAX) return QM_OK;
    if (status != QM_OK || least < SIZE_MAX) return status;
    return qm_context_fail(work->ctx, QM_E_LAYOUT, "the layout is folded in too many places");
}

/** Draws the layout, and spreads the lengths where that fails, as long as it helps; keeps the drawing with the fewest faults. */
static qm_status draw(layout_work *work, const qm_ref_surface *surface, const qm_quad_layout_options *options,
                      qm_drawing *out)
{
    size_t least = SIZE_MAX, crossings = SIZE_MAX;
    int idle = 0;
    for (int round = 0; least > 0 && round < (crossings > 0 ? CROSSED : ROUNDS) &&
                        idle < (crossings > 0 ? UNCROSSED : PATIENCE);
         round++) {
        qm_tmesh_classes classes;
        qm_tmesh_faults faults;
        qm_drawing drawing;
        qm_status status = draw_once(work, surface, options, &classes, &drawing, &faults);
        size_t count = status == QM_OK ? faults.folds + FOLDS_A_CROSSING * faults.crossings : SIZE_MAX;
        /* More patches are worth less crossings, but not less folds when they are many. */
        bool is_good = crossings == 0 && classes.face_count > MOST_PATCHES * work->quads.required_count;
        bool is_better = count < least && !(is_good && faults.crossings == 0), changed = false;
        idle = is_better ? 0 : idle + 1;
        if (is_better) {
            swap(out, &drawing);
            least = count;
            crossings = faults.crossings;
        }
        free_drawing(work->ctx, &drawing);
        if (status == QM_OK && least > 0)
            status = qm_tmesh_spread_lengths(work->ctx, &work->quads, &work->tmesh, &classes,
                                             faults.class_fault, work->is_held, work->length, &changed);
        if (status == QM_E_LAYOUT && least < SIZE_MAX) return QM_OK;
        if (status != QM_OK) return status;
        if (!changed || is_good) break;
    }
    return QM_OK;
}

/** Puts sharp curves onto the creases; the corners of grids follow the nodes. */
static qm_status settle_curves(qm_context *ctx, const qm_ref_surface *surface, qm_drawing *drawing)
{
    static const size_t corner[4] = {0, QM_LAYOUT_GRID, QM_LAYOUT_GRID_POINTS - 1,
                                     QM_LAYOUT_GRID_POINTS - 1 - QM_LAYOUT_GRID};
    const qm_layout *layout = &drawing->layout;
    qm_status status = qm_creases_settle_curves(ctx, &drawing->layout, surface, &drawing->issues);
    for (size_t p = 0; p < layout->patch_count && status == QM_OK; p++)
        for (int k = 0; k < 4; k++)
            memcpy(drawing->grids + 3 * (QM_LAYOUT_GRID_POINTS * p + corner[k]),
                   layout->nodes + 3 * (size_t)qm_layout_corner(layout, &layout->patches[p], k),
                   3 * sizeof(double));
    return status;
}

/** Finds the lengths of arcs, or goes on with those of a layout of fewer patches. */
static qm_status find_lengths(layout_work *work, const qm_quad_layout_options *options)
{
    qm_quad_layout_lengths *shared = options->lengths;
    size_t count = work->tmesh.arc_count;
    qm_status status = QM_OK;
    if (shared && shared->length) {
        if (shared->count != count)
            return qm_context_fail(work->ctx, QM_E_ARGUMENT, "the lengths are those of other quads");
        memcpy(work->length, shared->length, count * sizeof *work->length);
    } else {
        status = qm_tmesh_find_lengths(work->ctx, &work->quads, &work->tmesh, options->effort, work->length);
    }
    if (status == QM_OK && options->patches > 0)
        status =
            qm_tmesh_divide_lengths(work->ctx, &work->quads, &work->tmesh, options->patches, work->length);
    if (status != QM_OK || !shared) return status;
    if (!shared->length) {
        shared->length = qm_context_alloc(work->ctx, count, sizeof *shared->length);
        if (!shared->length)
            return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the lengths of arcs");
        shared->count = count;
    }
    memcpy(shared->length, work->length, count * sizeof *work->length);
    return QM_OK;
}

void qm_quad_layout_lengths_reset(qm_context *ctx, qm_quad_layout_lengths *lengths)
{
    qm_context_free(ctx, lengths->length, lengths->count, sizeof *lengths->length);
    *lengths = (qm_quad_layout_lengths){0};
}

static qm_status make(layout_work *work, const qm_mesh *mesh, const qm_ref_surface *surface,
                      const qm_quad_layout_options *options, qm_drawing *out)
{
    qm_status status = qm_tmesh_quads_make(&work->lasting, mesh, options, &work->quads);
    if (status == QM_OK)
        status = qm_patch_set_trace(work->ctx, &work->quads.mesh, work->quads.creases, &work->set);
    if (status == QM_OK) status = qm_tmesh_make(&work->lasting, &work->quads, &work->set, &work->tmesh);
    if (status != QM_OK) return status;
    work->length = qm_arena_alloc(&work->lasting, work->tmesh.arc_count, sizeof *work->length);
    work->is_held = qm_arena_zeroed(&work->lasting, work->tmesh.arc_count, sizeof *work->is_held);
    if (!work->length || !work->is_held)
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the lengths of arcs");
    status = find_lengths(work, options);
    if (status == QM_OK)
        status = qm_tmesh_source_of_quads(&work->lasting, &work->quads, &work->set, &work->tmesh, surface,
                                          &work->source);
    if (status == QM_OK) status = (options->may_cross ? draw_rough : draw)(work, surface, options, out);
    if (status == QM_OK && out->issues.count > 0 && !surface->is_cloud && !options->may_cross)
        status = route(work, surface, out);
    return status == QM_OK ? settle_curves(work->ctx, surface, out) : status;
}

/** As qm_quad_layout_make; *out is the caller's, also after an error. */
static qm_status make_drawing(qm_context *ctx, const qm_mesh *quads, const qm_ref_surface *surface,
                              const qm_quad_layout_options *options, qm_drawing *out,
                              qm_quad_layout_facts *facts)
{
    *out = (qm_drawing){0};
    qm_status status = check(ctx, quads, options);
    if (status != QM_OK) return status;
    layout_work work = {.ctx = ctx, .lasting = qm_arena_make(ctx), .scratch = qm_arena_make(ctx)};
    status = make(&work, quads, surface, options, out);
    if (status == QM_OK && facts)
        *facts = (qm_quad_layout_facts){work.quads.mesh.face_count, work.quads.required_count,
                                        work.tmesh.patch_count, out->layout.patch_count};
    qm_patch_set_reset(ctx, &work.set);
    qm_tmesh_triangles_reset(&work.triangles);
    qm_arena_reset(&work.lasting);
    qm_arena_reset(&work.scratch);
    return status;
}

/** Hands a drawing over, after an error an empty one. */
static void hand_over(qm_context *ctx, qm_status status, qm_drawing *drawing, qm_layout *out,
                      qm_layout_issues *issues, double **grids)
{
    if (status != QM_OK) free_drawing(ctx, drawing);
    free_marks(ctx, drawing);
    *out = drawing->layout;
    *issues = drawing->issues;
    if (grids)
        *grids = drawing->grids;
    else
        qm_context_free(ctx, drawing->grids, drawing->grid_count, GRID_SIZE);
}

void qm_quad_layout_free_grids(qm_context *ctx, const qm_layout *layout, double *grids)
{
    qm_context_free(ctx, grids, layout->patch_count, GRID_SIZE);
}

qm_status qm_quad_layout_make(qm_context *ctx, const qm_mesh *quads, const qm_ref_surface *surface,
                              const qm_quad_layout_options *options, qm_layout *out, qm_layout_issues *issues,
                              qm_quad_layout_facts *facts)
{
    QM_ASSERT(ctx && quads && surface && options && out && issues);
    qm_drawing drawing;
    qm_status status = make_drawing(ctx, quads, surface, options, &drawing, facts);
    hand_over(ctx, status, &drawing, out, issues, NULL);
    return status;
}

/** One trial: quads of the surface, and their layout. */
static qm_status make_once(qm_context *ctx, const qm_ref_surface *surface, const qm_quads_options *quads,
                           const qm_quad_layout_options *options, qm_drawing *out,
                           qm_quad_layout_facts *facts)
{
    qm_mesh mesh;
    uint8_t *creases;
    qm_status status = qm_quads_make_with_creases(ctx, surface->bvh, quads, &mesh, &creases, NULL);
    if (status != QM_OK) return status;
    qm_quad_layout_options own = *options;
    own.creases = creases;
    status = make_drawing(ctx, &mesh, surface, &own, out, facts);
    qm_context_free(ctx, creases, mesh.face_count, 1);
    qm_mesh_reset(ctx, &mesh);
    return status;
}

qm_status qm_quad_layout_make_of_surface(qm_context *ctx, const qm_ref_surface *surface,
                                         const qm_quads_options *quads, const qm_mesh *made,
                                         const qm_quad_layout_options *options, qm_layout *out,
                                         qm_layout_issues *issues, qm_quad_layout_facts *facts,
                                         double **grids)
{
    QM_ASSERT(ctx && surface && quads && options && out && issues);
    qm_drawing best = {0};
    qm_status status = QM_OK;
    qm_quad_layout_options merging = *options;
    merging.merges_doublets = true;
    options = &merging;
    for (size_t i = 0; i < sizeof trial_shares / sizeof *trial_shares && status == QM_OK; i++) {
        qm_drawing drawing = {0};
        qm_quad_layout_facts own_facts;
        qm_quads_options own = *quads;
        own.quads = (size_t)fmax(1.0, trial_shares[i] * (double)quads->quads);
        own.keeps_pairs = true;
        if (i > 0 || !made) merging.lengths = NULL;
        status = i == 0 && made ? make_drawing(ctx, made, surface, options, &drawing, &own_facts)
                                : make_once(ctx, surface, &own, options, &drawing, &own_facts);
        if (status == QM_OK && (i == 0 || drawing.issues.count < best.issues.count)) {
            swap(&best, &drawing);
            if (facts) *facts = own_facts;
        }
        free_drawing(ctx, &drawing);
        if (best.issues.count == 0 || options->may_cross || (i > 0 && best.issues.count > HOPELESS)) break;
    }
    hand_over(ctx, status, &best, out, issues, grids);
    return status;
}
