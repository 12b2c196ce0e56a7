/**
 * remesh.c: quads, or quads, a layout and its grids; and the distance of the mesh that is made.
 */
#include "remesh.h"

#include <math.h>

#include "qm/patch.h"
#include "qm/quad_layout.h"
#include "qm/quality.h"
#include "qm/reconstruct.h"
#include "settle.h"

#define GROWTH 1.5               /* of the number of quads from one mesh to the next */
#define FIRST_SHARE 0.5          /* of the growth that is expected to be needed, for the second mesh */
#define MOST_GROWTH 4.0          /* of that of semi-regular ones */
#define FOLDED_GROWTH 4.0        /* of it, after one that is near enough, but has folded quads */
#define FIRST_SEMI_REGULAR 500.0 /* quads, that a search for a distance starts with */
#define NEARER 0.67              /* times the distance of a plain mesh: semi-regular ones are seldom nearer */
#define LAYOUT_QUADS 5000        /* of which a layout is made, or fewer where the limit is lower */
#define LAYOUT_PATCHES 250       /* about, of a layout */
#define MORE_PATCHES 500         /* of a second one, where nothing else gave a good mesh */
#define QUADS_A_PATCH 3          /* at least: fewer patches where fewer quads are wanted */
#define PARTS 4                  /* of a quad that is divided */
#define FEWER 0.98               /* quads, besides the ratio, where there were too many */
/* Of the limit at least: where rows of a layout run through most of its patches, one more is too many. */
#define USED 0.9
/* A mesh is compared with one of LAYOUT_QUADS quads without a layout. It is good up to GOOD_RATIO times the distance of that, and may be
 * WORTH_RATIO times as far as another one if its quads are better. */
#define GOOD_RATIO 1.6
#define WORTH_RATIO 3.0
/* Of the mean difference of angles from 90 degrees: more is uneven, unless it is less than EVEN_ANGLE degrees. */
#define EVEN_RATIO 1.3
#define EVEN_ANGLE 5.0
/* A mesh from grids that starts farther away, or less even, than so many times the plain one is not settled: that takes off a third of the
 * distance and a fifth of the difference as a rule. */
#define START_RATIO 2.5
#define START_EVEN_RATIO 1.6

const char *const qm_remesh_work_names[] = {"quads", "layout", "fill", "measure", "surface", NULL};
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

/** A semi-regular mesh, and what is known of it besides its distance. */
typedef struct trial {
    qm_remesh_result made;
    size_t folded;  /* quads */
    bool is_poor;   /* a quad has a scaled Jacobian below QM_QUADS_POOR_SINE */
    double angle;   /* the mean difference of angles from 90 degrees */
    bool is_uneven; /* that is much more than in the plain mesh, and it is not near */
    bool is_near;   /* as near as was wanted */
} trial;

/** Whether a mesh is better than the best so far where their quads are not equally good: its own are the better ones, or those of the best. */
static bool is_worth(const trial *now, const trial *best, bool are_own_better)
{
    return are_own_better ? now->made.upper <= WORTH_RATIO * best->made.upper
                          : WORTH_RATIO * now->made.upper < best->made.upper;
}

/** Which of two meshes of one wanted number is better. */
static bool is_better(const trial *now, const trial *best)
{
    if (now->folded != best->folded) return now->folded < best->folded;
    if (now->is_near != best->is_near) return now->is_near;
    if (now->is_poor != best->is_poor) return is_worth(now, best, best->is_poor);
    if (now->is_uneven != best->is_uneven) return is_worth(now, best, best->is_uneven);
    double unevenness = now->is_uneven ? now->angle / best->angle : 1.0;
    return unevenness * now->made.upper < best->made.upper;
}

/** Which of two meshes of different numbers is better: where neither is near enough, the nearer one. */
static bool is_better_for_goal(const trial *now, const trial *best)
{
    if (now->is_near != best->is_near) return now->is_near;
    if (!now->is_near) return now->made.upper < best->made.upper;
    if (now->folded != best->folded) return now->folded < best->folded;
    return now->made.mesh.face_count < best->made.mesh.face_count;
}

/** Takes over a trial if it is the better one, and frees the other. */
static void keep_better(qm_context *ctx, trial *now, trial *best,
                        bool (*is_now_better)(const trial *, const trial *))
{
    bool is_first = best->made.mesh.face_count == 0;
    if (now->made.mesh.face_count > 0 && (is_first || is_now_better(now, best))) {
        trial worse = *best;
        *best = *now;
        *now = worse;
    }
    qm_mesh_reset(ctx, &now->made.mesh);
    *now = (trial){0};
}

/** These quads, as they are without a layout. */
typedef struct plain_quads {
    qm_mesh mesh;
    size_t wanted;                  /* quads */
    uint8_t *creases;               /* of each */
    double distance;                /* from the surface, at most */
    double angle;                   /* mean difference from 90 degrees */
    qm_quad_layout_lengths lengths; /* of the layouts that were made of them */
} plain_quads;

static void plain_quads_reset(qm_context *ctx, plain_quads *plain)
{
    qm_context_free(ctx, plain->creases, plain->mesh.face_count, 1);
    qm_quad_layout_lengths_reset(ctx, &plain->lengths);
    qm_mesh_reset(ctx, &plain->mesh);
    *plain = (plain_quads){0};
}

/** The search for a semi-regular mesh. */
typedef struct semi_regular {
    qm_context *ctx;
    const qm_ref_surface *surface;
    qm_remesh_options options; /* with the number of quads that are wanted at this moment */
    plain_quads plain;
    trial best;    /* of that number */
    trial nearest; /* of the numbers before */
    size_t rounds; /* meshes that were made */
    bool is_last;  /* no greater number is tried */
} semi_regular;

/** Tells that a stage begins, and the distance of the best mesh so far. */
static void tell(const semi_regular *s, qm_remesh_work work, size_t quads)
{
    begin(&s->options, work, quads, s->best.made.mesh.face_count > 0 ? &s->best.made : &s->nearest.made);
}

/** The quads of which a layout is made. */
static qm_quads_options quads_of_layout(const qm_remesh_options *options)
{
    qm_quads_options quads = options->quads;
    if (quads.quads > LAYOUT_QUADS) quads.quads = LAYOUT_QUADS;
    quads.keeps_pairs = true;
    return quads;
}

/** Makes them, if they are not there; s->plain is the caller's, also after an error. */
static qm_status make_plain(semi_regular *s)
{
    const qm_quads_options quads = quads_of_layout(&s->options);
    const qm_settle_goal goal = {.quads = quads};
    qm_settle_distance distance = {0};
    qm_quality quality;
    plain_quads *plain = &s->plain;
    if (plain->wanted == quads.quads) return QM_OK;
    plain_quads_reset(s->ctx, plain);
    tell(s, QM_REMESH_QUADS, quads.quads);
    qm_status status =
        qm_quads_make_with_creases(s->ctx, s->surface->bvh, &quads, &plain->mesh, &plain->creases, NULL);
    if (status != QM_OK) return status;
    tell(s, QM_REMESH_MEASURE, plain->mesh.face_count);
    status = qm_settle_measure(s->ctx, s->surface, &goal, &plain->mesh, &distance);
    plain->distance = qm_settle_two_sided(&distance).upper;
    qm_quality_measure(&plain->mesh, &quality);
    plain->angle = quality.mean_angle;
    plain->wanted = quads.quads;
    return status;
}

/** True if angles differ from 90 degrees by much more than those of the plain mesh. */
static bool is_uneven(const semi_regular *s, double angle, double ratio)
{
    return angle > fmax(EVEN_ANGLE, ratio * s->plain.angle);
}

/** Settles the mesh, measures it, and tells how good it is. */
static qm_status settle(const semi_regular *s, bool is_quick, trial *t)
{
    qm_settle_goal goal = settle_goal_of(&s->options);
    goal.is_quick = is_quick;
    qm_settled settled;
    tell(s, QM_REMESH_MEASURE, t->made.mesh.face_count);
    qm_status status = qm_settle(s->ctx, s->surface, &goal, &t->made.mesh, &settled);
    if (status != QM_OK) return status;
    take_distance(&t->made, &settled.distance);
    t->folded = settled.quality.folded;
    t->is_poor = settled.quality.least_jacobian < QM_QUADS_POOR_SINE;
    t->angle = settled.quality.mean_angle;
    t->is_near = s->options.distance > 0.0 && t->made.upper <= s->options.distance;
    t->is_uneven = !t->is_near && is_uneven(s, t->angle, EVEN_RATIO);
    return QM_OK;
}

/** True if a mesh from grids is too far or too uneven to become a good one. *status is that of measuring. */
static bool starts_badly(const semi_regular *s, const qm_mesh *mesh, qm_status *status)
{
    const qm_settle_goal goal = settle_goal_of(&s->options);
    qm_settle_distance start;
    qm_quality quality;
    *status = qm_settle_measure(s->ctx, s->surface, &goal, mesh, &start);
    qm_quality_measure(mesh, &quality);
    return *status == QM_OK && (qm_settle_two_sided(&start).upper > START_RATIO * s->plain.distance ||
                                is_uneven(s, quality.mean_angle, START_EVEN_RATIO));
}

/** Makes the mesh from the grids of a layout. Quickly, coarse quads are settled first, and without a wanted distance there is
 * no mesh if it starts badly. */
static qm_status fill_grids(semi_regular *s, const qm_layout *layout, const double *grids, bool is_quick,
                            trial *t)
{
    qm_reconstruction_options how = qm_reconstruction_options_default();
    how.thread_count = s->options.quads.thread_count;
    how.grids = grids;
    how.settles_coarse = is_quick; /* a coarse quad may cut across what the grids lie on */
    tell(s, QM_REMESH_FILL, layout->patch_count);
    qm_status status =
        qm_reconstruction_fill_grids(s->ctx, s->surface, layout, &how, &s->options.quads, &t->made.mesh);
    s->rounds++;
    /* With a wanted distance any mesh that ends near enough is good. */
    const bool can_refuse = is_quick && !(s->options.distance > 0.0);
    if (status == QM_OK && can_refuse && starts_badly(s, &t->made.mesh, &status)) {
        qm_mesh_reset(s->ctx, &t->made.mesh);
        return QM_OK;
    }
    return status == QM_OK ? settle(s, is_quick, t) : status;
}

/** A layout and its grids. */
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

/** Draws a layout of about so many patches, but none of more than quads. Its curves may cross: only its grids are used. */
static qm_status draw_layout(semi_regular *s, size_t patches, drawn_layout *out)
{
    const qm_quads_options quads = quads_of_layout(&s->options);
    const size_t most = s->options.quads.quads / QUADS_A_PATCH;
    qm_quad_layout_options how = qm_quad_layout_options_default();
    how.patches = patches < most ? patches : most;
    how.creases = s->plain.creases;
    how.lengths = &s->plain.lengths;
    how.may_cross = true;
    how.most_patches = s->options.quads.quads;
    tell(s, QM_REMESH_LAYOUT, quads.quads);
    return qm_quad_layout_make_of_surface(s->ctx, s->surface, &quads, &s->plain.mesh, &how, &out->layout,
                                          &out->issues, NULL, &out->grids);
}

/** Makes a mesh by a layout of about so many patches, if there is one, and keeps the better mesh. */
static qm_status try_layout(semi_regular *s, size_t patches, bool is_quick)
{
    drawn_layout drawn = {0};
    trial now = {0};
    qm_status status = draw_layout(s, patches, &drawn);
    now.made.patches = drawn.layout.patch_count;
    if (status == QM_OK) status = fill_grids(s, &drawn.layout, drawn.grids, is_quick, &now);
    if (status == QM_OK) keep_better(s->ctx, &now, &s->best, is_better);
    qm_mesh_reset(s->ctx, &now.made.mesh);
    drawn_layout_reset(s->ctx, &drawn);
    return status == QM_E_LAYOUT ? QM_OK : status;
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

/** Makes a mesh so, a second time where it has too many quads, and keeps the better one. */
static qm_status try_quads(semi_regular *s, qm_remesh_origin origin)
{
    qm_quads_options quads = s->options.quads;
    qm_patch_set set = {0};
    trial now = {.made.origin = origin};
    qm_mesh *mesh = &now.made.mesh;
    qm_status status = QM_OK;
    const size_t most = quads.quads;
    for (int k = 0; status == QM_OK && k < 2 && (k == 0 || mesh->face_count > most); k++) {
        if (k > 0)
            quads.quads = (size_t)fmax(1.0, FEWER * (double)most * (double)most / (double)mesh->face_count);
        qm_mesh_reset(s->ctx, mesh);
        tell(s, QM_REMESH_QUADS, quads.quads);
        status = make_without_layout(s->ctx, s->surface, &quads, origin, mesh);
        s->rounds++;
    }
    if (status == QM_OK) status = qm_patch_set_find(s->ctx, mesh, &set);
    now.made.patches = set.patch_count;
    if (status == QM_OK) status = settle(s, false, &now);
    if (status == QM_OK) keep_better(s->ctx, &now, &s->best, is_better);
    qm_patch_set_reset(s->ctx, &set);
    qm_mesh_reset(s->ctx, mesh);
    return status;
}

/** True if a mesh has no bad quads, and is as near as was wanted. Without a wanted distance: no farther than so many times the plain one, and with
 * not many fewer quads than wanted. */
static bool is_good(const semi_regular *s, double ratio)
{
    const trial *best = &s->best;
    if (best->made.mesh.face_count == 0 || best->folded > 0 || best->is_poor) return false;
    if (s->options.distance > 0.0) return best->is_near;
    return best->made.upper <= ratio * s->plain.distance &&
           (double)best->made.mesh.face_count >= USED * (double)s->options.quads.quads;
}

/**
 * How much of the plain mesh's distance is left in one of the wanted number of quads, where tips decide it: these are cut off by a part of a side.
 * Coarse quads that are divided may have lost more of them.
 */
static double tips_left(const semi_regular *s)
{
    return sqrt((double)s->plain.wanted / (double)s->options.quads.quads);
}

/**
 * Makes a mesh by a layout, and takes it if it is about as near and as even as one without. Else quads of a coarser mesh are divided into four.
 * Where these are poor, far from the surface, uneven or few, the quads stay without a layout. With a wanted distance the first mesh that is as near
 * as that is taken.
 */
static qm_status make_number(semi_regular *s)
{
    qm_status status = try_layout(s, LAYOUT_PATCHES, true);
    bool is_made = is_good(s, GOOD_RATIO) && !s->best.is_uneven;
    if (status == QM_OK && !is_made) {
        status = try_quads(s, QM_REMESH_FROM_DIVISION);
        is_made = is_good(s, GOOD_RATIO * tips_left(s)) && !s->best.is_uneven;
    }
    if (status == QM_OK && !is_made) status = try_quads(s, QM_REMESH_FROM_QUADS);
    bool is_last = s->is_last || !(s->options.distance > 0.0);
    if (status == QM_OK && is_last && !is_good(s, WORTH_RATIO)) status = try_layout(s, MORE_PATCHES, false);
    return status;
}

/** How far a mesh of the wanted number will be at least, about: no nearer than the plain one has it, and that falls no faster than the number grows. */
static double least_distance(const semi_regular *s)
{
    return NEARER * s->plain.distance * (double)s->plain.wanted / (double)s->options.quads.quads;
}

/** Makes meshes of more and more quads, until one is as near as was wanted, or at the limit; where that one has folded quads, up to FOLDED_GROWTH times as many. */
static qm_status search_number(semi_regular *s)
{
    const double goal = s->options.distance, limit = (double)s->options.quads.quads;
    double quads = fmin(FIRST_SEMI_REGULAR, limit), most = limit;
    qm_status status = QM_OK;
    while (status == QM_OK && !s->is_last) {
        s->options.quads.quads = (size_t)quads;
        s->is_last = quads >= most;
        status = make_plain(s);
        double distance = least_distance(s);
        if (status == QM_OK && (s->is_last || distance <= goal)) {
            status = make_number(s);
            distance = s->best.made.upper;
            if (s->best.is_near && s->best.folded == 0) s->is_last = true;
            if (s->best.is_near && most == limit) most = fmin(limit, FOLDED_GROWTH * quads);
            if (status == QM_OK) keep_better(s->ctx, &s->best, &s->nearest, is_better_for_goal);
        }
        quads = fmin(most, quads * fmin(fmax(GROWTH, distance / goal), MOST_GROWTH));
    }
    qm_mesh_reset(s->ctx, &s->best.made.mesh);
    s->best = s->nearest;
    return status;
}

static qm_status make_semi_regular(qm_context *ctx, const qm_ref_surface *surface,
                                   const qm_remesh_options *options, qm_remesh_result *out)
{
    semi_regular s = {.ctx = ctx, .surface = surface, .options = *options};
    qm_status status = QM_OK;
    if (options->distance > 0.0) {
        status = search_number(&s);
    } else {
        status = make_plain(&s);
        if (status == QM_OK) status = make_number(&s);
    }
    plain_quads_reset(ctx, &s.plain);
    *out = s.best.made;
    out->rounds = s.rounds;
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
