/**
 * remesh.c: quads, or quads, a layout and its steps; and the distance of what comes out.
 */
#include "remesh.h"

#include <math.h>

#include "qm/quad_layout.h"
#include "qm/quality.h"
#include "refine.h"
#include "settle.h"

#define GROWTH 1.5        /* of the number of quads from one mesh to the next */
#define FIRST_SHARE 0.5   /* of the growth that is expected to be needed, for the second mesh */
#define LAYOUT_QUADS 5000 /* of which a layout is made, or fewer where the limit is lower */
/* Layouts are divided into about LAYOUT_PATCHES, then MORE_PATCHES times as many, up to MOST_PATCHES and one for each
 * QUADS_A_PATCH quads, until the mesh is no farther than PLAIN_RATIO times one of LAYOUT_QUADS quads without a layout. */
#define LAYOUT_PATCHES 250
#define MORE_PATCHES 2
#define MOST_PATCHES 1000
#define QUADS_A_PATCH 6
#define PLAIN_RATIO 2.0

static qm_refine_goal goal_of(const qm_remesh_options *options)
{
    return (qm_refine_goal){.max_quads = options->quads.quads,
                            .hausdorff = options->distance,
                            .thread_count = options->quads.thread_count};
}

const char *const qm_remesh_work_names[] = {"quads", "layout", "steps", "measure", "surface", NULL};

/** How many quads options mean that name no number. */
static size_t usual_quads(const qm_remesh_options *options)
{
    if (options->quads.quads > 0) return options->quads.quads;
    if (!(options->distance > 0.0)) return qm_quads_options_default().quads;
    return options->is_semi_regular ? QM_REMESH_MOST_QUADS : QM_REMESH_FIRST_QUADS;
}

/** Tells that a stage begins. */
static void begin(const qm_remesh_options *options, qm_remesh_work work, size_t quads,
                  const qm_remesh_result *last)
{
    const qm_remesh_stage stage = {work, quads, last->lower, last->upper};
    if (options->on_stage) options->on_stage(options->user, &stage);
}

static qm_settle_goal settle_goal_of(const qm_remesh_options *options)
{
    return (qm_settle_goal){options->quads, options->distance};
}

static void take_distance(qm_remesh_result *out, const qm_settle_distance *distance)
{
    qm_interval both = qm_settle_two_sided(distance);
    out->from_surface = distance->from_surface;
    out->from_quads = distance->from_quads;
    out->lower = both.lower;
    out->upper = both.upper;
}

static qm_status measure(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                         qm_remesh_result *out)
{
    const qm_settle_goal goal = settle_goal_of(options);
    qm_settle_distance distance;
    begin(options, QM_REMESH_MEASURE, out->mesh.face_count, out);
    qm_status status = qm_settle_measure(ctx, surface, &goal, &out->mesh, &distance);
    if (status == QM_OK) take_distance(out, &distance);
    return status;
}

/** The number of quads of a mesh of the search; greater than QM_REMESH_MOST_QUADS: there is none. */
static double quads_of(double first, int growths)
{
    return first * pow(GROWTH, growths);
}

/**
 * How many times the number of quads grows after the first mesh, whose distance falls about as the number grows. Only here meshes
 * of the search are left out, and the more the smaller the wanted distance is: so where one is met, a greater one is met by that
 * mesh or before it, and a smaller distance never ends with fewer quads.
 */
static int first_growths(const qm_remesh_options *options, double distance)
{
    double needed = FIRST_SHARE * distance / options->distance, first = (double)options->quads.quads;
    int growths = 1;
    while (pow(GROWTH, growths + 1) <= needed && quads_of(first, growths + 1) <= QM_REMESH_MOST_QUADS)
        growths++;
    return growths;
}

static qm_status make_quads(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                            qm_remesh_result *out)
{
    qm_quads_options quads = options->quads;
    int growths = 0;
    for (;;) {
        qm_mesh_reset(ctx, &out->mesh);
        begin(options, QM_REMESH_QUADS, quads.quads, out);
        qm_status status = qm_quads_make(ctx, surface->bvh, &quads, &out->mesh, NULL);
        if (status == QM_OK) status = measure(ctx, surface, options, out);
        if (status != QM_OK) return status;
        out->rounds++;
        if (!(options->distance > 0.0) || out->upper <= options->distance) return QM_OK;
        growths = growths == 0 ? first_growths(options, out->upper) : growths + 1;
        double next = quads_of((double)options->quads.quads, growths);
        if (next > QM_REMESH_MOST_QUADS) return QM_OK;
        quads.quads = (size_t)next;
    }
}

/** Counts the steps, and tells of each. */
typedef struct step_counter {
    const qm_remesh_options *options;
    qm_remesh_result *out;
} step_counter;

static void count_step(void *user, const qm_refine_record *record)
{
    step_counter *counter = user;
    qm_remesh_result *out = counter->out;
    out->rounds++;
    if (record->is_measured) out->lower = record->lower, out->upper = record->upper;
    begin(counter->options, QM_REMESH_STEPS, record->step.quads, out);
}

static qm_status take_steps(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                            const qm_layout *layout, const double *grids, qm_remesh_result *out)
{
    qm_reconstruction_options how = qm_reconstruction_options_default();
    how.thread_count = options->quads.thread_count;
    how.grids = grids;
    qm_reconstruction *r;
    begin(options, QM_REMESH_STEPS, layout->patch_count, out);
    qm_status status = qm_reconstruction_create(ctx, surface, layout, &how, &r);
    if (status != QM_OK) return status;
    const qm_refine_goal goal = goal_of(options);
    qm_refine_stop stop;
    step_counter counter = {options, out};
    status = qm_refine(ctx, r, surface, &goal, count_step, &counter, &stop);
    if (status == QM_OK && stop == QM_REFINE_CANCELED)
        status = qm_context_fail(ctx, QM_E_CANCELED, "canceled");
    if (status == QM_OK) status = qm_reconstruction_mesh(ctx, r, &out->mesh);
    qm_reconstruction_destroy(ctx, r);
    if (status != QM_OK) return status;
    begin(options, QM_REMESH_MEASURE, out->mesh.face_count, out);
    const qm_settle_goal settle_goal = settle_goal_of(options);
    qm_settled settled;
    status = qm_settle(ctx, surface, &settle_goal, &out->mesh, &settled);
    if (status == QM_OK) take_distance(out, &settled.distance);
    return status;
}

/** The quads of which a layout is made. */
static qm_quads_options quads_of_layout(const qm_remesh_options *options)
{
    qm_quads_options quads = options->quads;
    if (quads.quads > LAYOUT_QUADS) quads.quads = LAYOUT_QUADS;
    return quads;
}

/** These quads, as they are without a layout. */
typedef struct plain_quads {
    qm_mesh mesh;
    uint8_t *creases; /* of each */
    double distance;  /* from the surface, at most */
} plain_quads;

static void plain_quads_reset(qm_context *ctx, plain_quads *plain)
{
    qm_context_free(ctx, plain->creases, plain->mesh.face_count, 1);
    qm_mesh_reset(ctx, &plain->mesh);
}

/** Makes them; *out is the caller's, also after an error. */
static qm_status make_plain(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                            plain_quads *out)
{
    const qm_quads_options quads = quads_of_layout(options);
    const qm_settle_goal goal = {.quads = quads};
    const qm_remesh_result none = {0};
    qm_settle_distance distance = {0};
    begin(options, QM_REMESH_QUADS, quads.quads, &none);
    qm_status status = qm_quads_make_with_creases(ctx, surface->bvh, &quads, &out->mesh, &out->creases, NULL);
    if (status != QM_OK) return status;
    begin(options, QM_REMESH_MEASURE, out->mesh.face_count, &none);
    status = qm_settle_measure(ctx, surface, &goal, &out->mesh, &distance);
    out->distance = qm_settle_two_sided(&distance).upper;
    return status;
}

/** Makes the mesh by a layout of about so many patches. */
static qm_status make_by_patches(qm_context *ctx, const qm_ref_surface *surface,
                                 const qm_remesh_options *options, const plain_quads *plain, size_t patches,
                                 qm_remesh_result *out, bool *has_crossings)
{
    const qm_quads_options quads = quads_of_layout(options);
    qm_quad_layout_options how = qm_quad_layout_options_default();
    how.patches = patches;
    how.creases = plain->creases;
    qm_layout layout;
    qm_layout_issues issues;
    begin(options, QM_REMESH_LAYOUT, quads.quads, out);
    double *grids;
    qm_status status = qm_quad_layout_make_of_surface(ctx, surface, &quads, &plain->mesh, &how, &layout,
                                                      &issues, NULL, &grids);
    if (status != QM_OK) return status;
    out->patches = layout.patch_count;
    /* Lattices that are found from the curves come out a little better, but curves that cross give none. */
    *has_crossings = issues.count > 0;
    status = take_steps(ctx, surface, options, &layout, *has_crossings ? grids : NULL, out);
    qm_quad_layout_free_grids(ctx, &layout, grids);
    qm_layout_reset(ctx, &layout);
    qm_layout_issues_reset(ctx, &issues);
    return status;
}

/** What is known of a mesh besides its distance. Where curves of its layout cross, its vertices started where their quads
 * were, and may be folded for want of room. */
typedef struct trial_state {
    bool has_crossings, is_folded;
    bool is_near; /* as near as was wanted */
} trial_state;

static bool is_better(const trial_state *now, const qm_remesh_result *made, const trial_state *best,
                      const qm_remesh_result *best_made)
{
    if (now->is_folded != best->is_folded) return best->is_folded;
    if (now->is_near != best->is_near) return now->is_near;
    if (now->has_crossings != best->has_crossings) return best->has_crossings;
    if (now->is_near) return made->mesh.face_count < best_made->mesh.face_count;
    return made->upper < best_made->upper;
}

/** Tries more and more patches until the mesh is about as near as one without a layout: large patches may miss an ear. */
static qm_status make_semi_regular(qm_context *ctx, const qm_ref_surface *surface,
                                   const qm_remesh_options *options, qm_remesh_result *out)
{
    plain_quads plain = {0};
    qm_status status = make_plain(ctx, surface, options, &plain), last = status;
    size_t most = options->quads.quads / QUADS_A_PATCH;
    trial_state best = {0};
    for (size_t patches = LAYOUT_PATCHES; status == QM_OK; patches *= MORE_PATCHES) {
        qm_remesh_result now = {0};
        trial_state state = {0};
        bool is_last = patches >= most || patches >= MOST_PATCHES;
        last = make_by_patches(ctx, surface, options, &plain, patches < most ? patches : most, &now,
                               &state.has_crossings);
        if (last != QM_OK && last != QM_E_LAYOUT) status = last;
        qm_quality quality = {0};
        if (last == QM_OK) qm_quality_measure(&now.mesh, &quality);
        state.is_folded = quality.folded > 0;
        state.is_near = last == QM_OK && options->distance > 0.0 && now.upper <= options->distance;
        if (last == QM_OK && (out->mesh.face_count == 0 || is_better(&state, &now, &best, out))) {
            best = state;
            qm_remesh_result worse = *out;
            *out = now;
            now = worse;
        }
        qm_mesh_reset(ctx, &now.mesh);
        bool is_good = out->mesh.face_count > 0 && !best.has_crossings && !best.is_folded;
        if (is_last || (is_good && (best.is_near || out->upper <= PLAIN_RATIO * plain.distance))) break;
    }
    plain_quads_reset(ctx, &plain);
    return out->mesh.face_count > 0 || status != QM_OK ? status : last;
}

qm_status qm_remesh(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                    qm_remesh_result *out)
{
    *out = (qm_remesh_result){0};
    qm_remesh_options complete = *options;
    complete.quads.quads = usual_quads(options);
    qm_status status = complete.is_semi_regular ? make_semi_regular(ctx, surface, &complete, out)
                                                : make_quads(ctx, surface, &complete, out);
    if (status != QM_OK) qm_mesh_reset(ctx, &out->mesh);
    return status;
}
