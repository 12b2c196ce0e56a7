/**
 * remesh.c: quads, or quads, a layout and its steps; and the distance of what comes out.
 */
#include "remesh.h"

#include <math.h>

#include "qm/patch.h"
#include "qm/quad_layout.h"
#include "qm/quality.h"
#include "refine.h"
#include "settle.h"

#define GROWTH 1.5        /* of the number of quads from one mesh to the next */
#define FIRST_SHARE 0.5   /* of the growth that is expected to be needed, for the second mesh */
#define LAYOUT_QUADS 5000 /* of which a layout is made, or fewer where the limit is lower */
/* Layouts are divided into about LAYOUT_PATCHES, then MORE_PATCHES times as many, up to MOST_PATCHES and one for each QUADS_A_PATCH
 * quads. Their grids are filled until a mesh is no farther than FILLED_RATIO times one of LAYOUT_QUADS quads without a layout, and no
 * quad is poor. With a wanted distance meshes are made by steps until one is as near as that, or no farther than PLAIN_RATIO times. */
#define LAYOUT_PATCHES 250
#define MORE_PATCHES 2
#define MOST_PATCHES 2000
#define LAYOUTS 4 /* at most */
#define QUADS_A_PATCH 3
#define PARTS 4    /* of a quad that is divided */
#define FEWER 0.98 /* quads, besides the ratio, where there were too many */
#define USED                                                                                                 \
    0.9 /* of the limit at least: where rows of a layout run through most of its patches, one more is too many */
#define PLAIN_RATIO 2.0
#define FILLED_RATIO 1.6
#define WORTH_RATIO 3.0 /* of the distance, by which it may be greater for that */
/* Of the plain mesh's distance: if parts of the surface are farther from the filled mesh before it is settled, its layout's grids
 * miss tips, which settling does not bring back. */
#define FILLED_START 6.0
/* Of the quads: if more are poor before that, spreading leaves some of them poor or folded as a rule, and centring does more often not. */
#define FILLED_POOR 0.02
#define CENTRED_START                                                                                        \
    2.5 /* instead of FILLED_START, for such meshes while finer layouts are left: centring draws vertices off tips */

static qm_refine_goal goal_of(const qm_remesh_options *options)
{
    return (qm_refine_goal){.max_quads = options->quads.quads,
                            .hausdorff = options->distance,
                            .thread_count = options->quads.thread_count};
}

const char *const qm_remesh_work_names[] = {"quads", "layout", "steps", "measure", "surface", NULL};
const char *const qm_remesh_origin_names[] = {"layout", "division", "quads", NULL};

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
    return (qm_settle_goal){.quads = options->quads, .distance = options->distance};
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

/** A semi-regular mesh, and what is known of it besides its distance. Where curves of its layout cross, its vertices started where
 * their quads were, and may be folded for want of room. */
typedef struct trial {
    qm_remesh_result made;
    bool has_crossings;
    size_t folded; /* quads */
    bool is_poor;  /* a quad has a scaled Jacobian below QM_QUADS_POOR_SINE */
    bool is_quick; /* it was settled quickly */
    bool is_near;  /* as near as was wanted */
} trial;

/** Crossings count where a distance is wanted: then all meshes are made by steps along curves. Grids that are filled have none. */
static bool is_better(const trial *now, const trial *best, bool has_goal)
{
    if (best->made.mesh.face_count == 0) return true;
    if (now->folded != best->folded) return now->folded < best->folded;
    if (now->is_near != best->is_near) return now->is_near;
    if (has_goal && now->has_crossings != best->has_crossings) return best->has_crossings;
    if (now->is_near) return now->made.mesh.face_count < best->made.mesh.face_count;
    if (now->is_poor != best->is_poor)
        return best->is_poor ? now->made.upper <= WORTH_RATIO * best->made.upper
                             : WORTH_RATIO * now->made.upper < best->made.upper;
    return now->made.upper < best->made.upper;
}

/** Takes over a trial if it is the better one, and frees the other. */
static void keep_better(qm_context *ctx, trial *now, trial *best, bool has_goal)
{
    if (now->made.mesh.face_count > 0 && is_better(now, best, has_goal)) {
        trial worse = *best;
        *best = *now;
        *now = worse;
    }
    qm_mesh_reset(ctx, &now->made.mesh);
    *now = (trial){0};
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

static bool has_many_poor(const trial *t)
{
    return (double)qm_quads_count_poor(&t->made.mesh) > FILLED_POOR * (double)t->made.mesh.face_count;
}

/** Settles the mesh, measures it, and tells how good it is. */
static qm_status settle(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                        bool is_quick, trial *t)
{
    qm_settle_goal goal = settle_goal_of(options);
    goal.is_quick = is_quick;
    goal.centres = has_many_poor(t);
    qm_settled settled;
    begin(options, QM_REMESH_MEASURE, t->made.mesh.face_count, &t->made);
    qm_status status = qm_settle(ctx, surface, &goal, &t->made.mesh, &settled);
    if (status != QM_OK) return status;
    take_distance(&t->made, &settled.distance);
    t->folded = settled.quality.folded;
    t->is_poor = settled.quality.least_jacobian < QM_QUADS_POOR_SINE;
    t->is_quick = is_quick;
    t->is_near = options->distance > 0.0 && t->made.upper <= options->distance;
    return QM_OK;
}

/** How a mesh is made by a layout. */
typedef enum trial_way {
    FILL_QUICKLY, /* from its grids at once, settled once */
    FILL,
    TAKE_STEPS
} trial_way;

/** Makes the mesh from the grids at once; none if it misses parts of the surface. */
static qm_status fill_grids(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                            const qm_layout *layout, const double *grids, double plain_distance,
                            bool is_quick, trial *t)
{
    qm_reconstruction_options how = qm_reconstruction_options_default();
    const qm_settle_goal goal = settle_goal_of(options);
    qm_settle_distance start;
    how.thread_count = options->quads.thread_count;
    how.grids = grids;
    begin(options, QM_REMESH_STEPS, layout->patch_count, &t->made);
    qm_status status =
        qm_reconstruction_fill_grids(ctx, surface, layout, &how, options->quads.quads, &t->made.mesh);
    t->made.rounds = 1;
    if (status == QM_OK) status = qm_settle_measure(ctx, surface, &goal, &t->made.mesh, &start);
    double most = is_quick && has_many_poor(t) ? CENTRED_START : FILLED_START;
    if (status == QM_OK && start.from_surface.upper > most * plain_distance) {
        qm_mesh_reset(ctx, &t->made.mesh);
        return QM_OK;
    }
    return status == QM_OK ? settle(ctx, surface, options, is_quick, t) : status;
}

/** Makes the mesh by steps, from the curves or from the grids. */
static qm_status take_steps(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                            const qm_layout *layout, const double *grids, trial *t)
{
    qm_reconstruction_options how = qm_reconstruction_options_default();
    how.thread_count = options->quads.thread_count;
    how.grids = grids;
    qm_reconstruction *r;
    begin(options, QM_REMESH_STEPS, layout->patch_count, &t->made);
    qm_status status = qm_reconstruction_create(ctx, surface, layout, &how, &r);
    if (status != QM_OK) return status;
    const qm_refine_goal goal = goal_of(options);
    qm_refine_stop stop;
    step_counter counter = {options, &t->made};
    status = qm_refine(ctx, r, surface, &goal, count_step, &counter, &stop);
    if (status == QM_OK && stop == QM_REFINE_CANCELED)
        status = qm_context_fail(ctx, QM_E_CANCELED, "canceled");
    if (status == QM_OK) status = qm_reconstruction_mesh(ctx, r, &t->made.mesh);
    qm_reconstruction_destroy(ctx, r);
    return status == QM_OK ? settle(ctx, surface, options, false, t) : status;
}

/** The quads of which a layout is made. */
static qm_quads_options quads_of_layout(const qm_remesh_options *options)
{
    qm_quads_options quads = options->quads;
    if (quads.quads > LAYOUT_QUADS) quads.quads = LAYOUT_QUADS;
    quads.keeps_pairs = true;
    return quads;
}

/** These quads, as they are without a layout. */
typedef struct plain_quads {
    qm_mesh mesh;
    uint8_t *creases;               /* of each */
    double distance;                /* from the surface, at most */
    qm_quad_layout_lengths lengths; /* of the layouts that were made of them */
} plain_quads;

static void plain_quads_reset(qm_context *ctx, plain_quads *plain)
{
    qm_context_free(ctx, plain->creases, plain->mesh.face_count, 1);
    qm_quad_layout_lengths_reset(ctx, &plain->lengths);
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

/** A layout, its crossings and its grids. */
typedef struct drawn_layout {
    qm_layout layout;
    qm_layout_issues issues;
    double *grids;
} drawn_layout;

static void drawn_layout_reset(qm_context *ctx, drawn_layout *drawn)
{
    qm_quad_layout_free_grids(ctx, &drawn->layout, drawn->grids);
    qm_layout_reset(ctx, &drawn->layout);
    qm_layout_issues_reset(ctx, &drawn->issues);
    *drawn = (drawn_layout){0};
}

/** Draws a layout of about so many patches. */
static qm_status draw_layout(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                             plain_quads *plain, size_t patches, const trial *best, drawn_layout *out)
{
    const qm_quads_options quads = quads_of_layout(options);
    qm_quad_layout_options how = qm_quad_layout_options_default();
    how.patches = patches;
    how.creases = plain->creases;
    how.lengths = &plain->lengths;
    how.may_cross = !(options->distance > 0.0); /* grids do not need curves that do not, steps do */
    begin(options, QM_REMESH_LAYOUT, quads.quads, &best->made);
    return qm_quad_layout_make_of_surface(ctx, surface, &quads, &plain->mesh, &how, &out->layout,
                                          &out->issues, NULL, &out->grids);
}

/** Makes a mesh by a layout, from its grids at once or by steps, and keeps the better one. A layout of more patches than quads makes none. */
static qm_status try_layout(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                            const drawn_layout *drawn, const plain_quads *plain, trial_way way, trial *best)
{
    trial now = {.has_crossings = drawn->issues.count > 0, .made.patches = drawn->layout.patch_count};
    if (drawn->layout.patch_count > options->quads.quads) return QM_OK;
    qm_status status = way == TAKE_STEPS ? take_steps(ctx, surface, options, &drawn->layout,
                                                      now.has_crossings ? drawn->grids : NULL, &now)
                                         : fill_grids(ctx, surface, options, &drawn->layout, drawn->grids,
                                                      plain->distance, way == FILL_QUICKLY, &now);
    if (status == QM_OK) keep_better(ctx, &now, best, options->distance > 0.0);
    qm_mesh_reset(ctx, &now.made.mesh);
    return status;
}

/** Makes quads without a layout: of a quarter as many, each of which is divided into four, or of all. *out is the caller's, also after an error. */
static qm_status make_without_layout(qm_context *ctx, const qm_ref_surface *surface,
                                     const qm_quads_options *quads, qm_remesh_origin origin, qm_mesh *out)
{
    if (origin == QM_REMESH_FROM_QUADS) return qm_quads_make(ctx, surface->bvh, quads, out, NULL);
    qm_quads_options fewer = *quads;
    qm_mesh coarse;
    fewer.quads = quads->quads > PARTS ? quads->quads / PARTS : 1;
    qm_status status = qm_quads_make(ctx, surface->bvh, &fewer, &coarse, NULL);
    if (status == QM_OK) status = qm_quads_divide(ctx, &coarse, out);
    qm_mesh_reset(ctx, &coarse);
    return status;
}

/** Makes a mesh so, a second time where it has too many quads, and keeps the better one. is_near may be NULL. */
static qm_status try_quads(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                           size_t most, qm_remesh_origin origin, trial *best, bool *is_near)
{
    qm_quads_options quads = options->quads;
    qm_patch_set set = {0};
    trial now = {.made.origin = origin};
    qm_mesh *mesh = &now.made.mesh;
    qm_status status = QM_OK;
    quads.quads = most;
    while (status == QM_OK && now.made.rounds < 2 && (mesh->face_count == 0 || mesh->face_count > most)) {
        if (mesh->face_count > most)
            quads.quads = (size_t)fmax(1.0, FEWER * (double)most * (double)most / (double)mesh->face_count);
        qm_mesh_reset(ctx, mesh);
        begin(options, QM_REMESH_QUADS, quads.quads, &best->made);
        status = make_without_layout(ctx, surface, &quads, origin, mesh);
        now.made.rounds++;
    }
    if (status == QM_OK) status = qm_patch_set_find(ctx, mesh, &set);
    now.made.patches = set.patch_count;
    if (status == QM_OK) status = settle(ctx, surface, options, false, &now);
    if (is_near) *is_near = now.is_near;
    if (status == QM_OK) keep_better(ctx, &now, best, options->distance > 0.0);
    qm_patch_set_reset(ctx, &set);
    qm_mesh_reset(ctx, mesh);
    return status;
}

/** Makes more and more quads without a layout, until they are as near as was wanted, or at the limit. */
static qm_status search_quads(qm_context *ctx, const qm_ref_surface *surface,
                              const qm_remesh_options *options, trial *best)
{
    qm_status status = QM_OK;
    bool is_near = false, is_last = false;
    double most = (double)options->quads.quads, quads = fmin(QM_REMESH_FIRST_QUADS, most);
    for (; status == QM_OK && !is_near && !is_last; quads = fmin(GROWTH * quads, most)) {
        is_last = quads >= most;
        status = try_quads(ctx, surface, options, (size_t)quads, QM_REMESH_FROM_QUADS, best, &is_near);
    }
    return status;
}

/** True if a mesh without folds is as near as was wanted, or near enough. */
static bool is_usable(const trial *best, const plain_quads *plain)
{
    return best->made.mesh.face_count > 0 && !best->has_crossings && best->folded == 0 &&
           (best->is_near || best->made.upper <= PLAIN_RATIO * plain->distance);
}

/** True if a mesh without folds is no farther than so many times the plain one. */
static bool is_whole(const trial *best, const plain_quads *plain, double ratio)
{
    return best->made.mesh.face_count > 0 && best->folded == 0 && best->made.upper <= ratio * plain->distance;
}

/** True if it has no poor quads, either, and not many fewer than wanted. */
static bool is_good(const trial *best, const plain_quads *plain, double ratio, size_t wanted)
{
    return is_whole(best, plain, ratio) && !best->is_poor &&
           (double)best->made.mesh.face_count >= USED * (double)wanted;
}

/**
 * Tries layouts of more and more patches, whose grids are filled at once, until the mesh is about as near as one without a layout. Once patches
 * would have no more quads than that, quads of a coarser mesh that are divided into four take their place. Where both are poor, far from the
 * surface or few, the quads stay without a layout.
 * With a wanted distance, meshes are made by steps along the curves of layouts, which takes long, or of more and more quads without one where all
 * layouts leave folds or crossings.
 */
static qm_status make_semi_regular(qm_context *ctx, const qm_ref_surface *surface,
                                   const qm_remesh_options *options, qm_remesh_result *out)
{
    plain_quads plain = {0};
    qm_status status = make_plain(ctx, surface, options, &plain);
    size_t wanted = options->quads.quads, most = wanted / QUADS_A_PATCH;
    bool has_goal = options->distance > 0.0, is_made = false, is_last = false, is_divided = has_goal;
    trial best = {0};
    int count = 0;
    for (size_t patches = LAYOUT_PATCHES; status == QM_OK && !is_made && !is_last; patches *= MORE_PATCHES) {
        drawn_layout drawn = {0};
        status = draw_layout(ctx, surface, options, &plain, patches < most ? patches : most, &best, &drawn);
        if (status == QM_OK) count++;
        /* A layout that cannot have fewer patches is the same for all smaller numbers. */
        while (patches * MORE_PATCHES <= drawn.layout.patch_count)
            patches *= MORE_PATCHES;
        is_last = patches >= most || patches >= MOST_PATCHES || count == LAYOUTS;
        if (status == QM_OK)
            status = try_layout(ctx, surface, options, &drawn, &plain,
                                has_goal  ? TAKE_STEPS
                                : is_last ? FILL
                                          : FILL_QUICKLY,
                                &best);
        if (status == QM_E_LAYOUT) status = QM_OK;
        drawn_layout_reset(ctx, &drawn);
        is_made = has_goal ? is_usable(&best, &plain) : is_good(&best, &plain, FILLED_RATIO, wanted);
        if (status == QM_OK && !is_made && !is_divided &&
            (is_last || PARTS * MORE_PATCHES * patches >= wanted)) {
            status = try_quads(ctx, surface, options, wanted, QM_REMESH_FROM_DIVISION, &best, NULL);
            is_made = is_good(&best, &plain, FILLED_RATIO, wanted);
            is_divided = true;
        }
    }
    if (status == QM_OK && best.is_quick && best.is_poor)
        status = settle(ctx, surface, options, false, &best);
    bool is_unsound = best.made.mesh.face_count == 0 || best.folded > 0 || best.has_crossings;
    if (status == QM_OK && has_goal && is_unsound) status = search_quads(ctx, surface, options, &best);
    if (status == QM_OK && !has_goal && !is_good(&best, &plain, WORTH_RATIO, wanted))
        status = try_quads(ctx, surface, options, wanted, QM_REMESH_FROM_QUADS, &best, NULL);
    plain_quads_reset(ctx, &plain);
    *out = best.made;
    return status;
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
