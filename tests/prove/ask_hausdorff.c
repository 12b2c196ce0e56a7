/*
 * The Hausdorff distance: one reference for a case, a reading and a direction, and several calls that all
 * have to agree with it: every tolerance, bound, accelerator, threshold and limit of work.
 */
#include "ask.h"
#include "base/host.h"
#include "qm/hausdorff.h"
#include "wide_farthest.h"

#include <string.h>

enum { CALLS = 8, CELLS_OF_TRIANGLES = 3000, CELLS_OF_PATCHES = 600 };

#define REFERENCE_EPS 0x1p-54L /* of the frame */
#define OPEN_WIDTH 1e-13       /* of the frame: references wider than this are counted */

/** The best bounds that the progress of a call reported. */
typedef struct watch {
    double lower, upper;
} watch;

static void look(void *user, const qm_hausdorff_progress *now)
{
    watch *seen = user;
    seen->lower = fmax(seen->lower, now->lower);
    seen->upper = fmin(seen->upper, now->upper);
}

/** An interval, in the frame, that holds the distance. */
typedef struct interval {
    qm_wide lower, upper;
} interval;

static bool has_patches(const qm_wide_surface *surface)
{
    for (size_t f = 0; f < surface->count; f++)
        if (surface->facets[f].corner_count == 4) return true;
    return false;
}

static interval reference(const qm_wide_surface *a, const qm_wide_surface *b)
{
    size_t limit = has_patches(a) || has_patches(b) ? CELLS_OF_PATCHES : CELLS_OF_TRIANGLES;
    qm_wide_maximum m = qm_wide_farthest(a, b, REFERENCE_EPS, limit);
    return (interval){m.lower, m.upper};
}

static interval greater(interval a, interval b)
{
    return (interval){qm_wide_greatest(a.lower, b.lower), qm_wide_greatest(a.upper, b.upper)};
}

static void draw_limits(qm_trial *trial, qm_hausdorff_options *options)
{
    qm_random *random = &trial->random;
    bool by_patches = options->quads == QM_QUADS_BILINEAR;
    options->work_limit = by_patches || options->bounds == QM_BOUNDS_MATCHING ? 100 : 2000;
    if (!trial->kind->is_slow && qm_random_below(random, 4) == 0) options->work_limit *= 8;
    if (qm_random_below(random, 3) == 0) options->work_limit = 1 + qm_random_below(random, 100);
}

/** A threshold near the distance: within a few roundings, within the margin, or anywhere. */
static double draw_threshold(qm_trial *trial, interval distance)
{
    qm_random *random = &trial->random;
    double near = (double)((random->state & 1 ? distance.lower : distance.upper) / trial->frame.scale);
    double by[] = {0, near * 0x1p-52, trial->size * 1e-14, trial->size * qm_random_power(random, -15, -1)};
    double threshold = near + (qm_random_below(random, 2) ? -1 : 1) * by[qm_random_below(random, 4)];
    return fmax(0, threshold);
}

static qm_hausdorff_options draw_options(qm_trial *trial, qm_quad_reading quads, qm_direction direction,
                                         interval distance)
{
    qm_random *random = &trial->random;
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = direction;
    options.quads = quads;
    double coarsest = trial->kind->coarsest < 0 ? trial->kind->coarsest : -3;
    options.tolerance = trial->size * qm_random_power(random, -13.5, coarsest);
    options.bounds = qm_random_below(random, 4) ? QM_BOUNDS_COVER : QM_BOUNDS_MATCHING;
    bool is_cloud = trial->pair.a.face_count == 0 || trial->pair.b.face_count == 0;
    options.accelerator = (qm_accelerator)qm_random_below(random, QM_ACCELERATOR_COUNT);
    if (is_cloud && options.accelerator == QM_ACCELERATOR_TETRA) options.accelerator = QM_ACCELERATOR_GRID;
    if (qm_random_below(random, 16) == 0) options.thread_count = 2;
    if (qm_random_below(random, 2)) options.threshold = draw_threshold(trial, distance);
    draw_limits(trial, &options);
    return options;
}

static void print_call(const qm_hausdorff_options *o, char text[512])
{
    snprintf(text, 512,
             "direction %d quads %d tolerance %.17g threshold %.17g work_limit %llu threads %d accelerator "
             "%d bounds %d",
             (int)o->direction, (int)o->quads, o->tolerance, o->threshold, (unsigned long long)o->work_limit,
             o->thread_count, (int)o->accelerator, (int)o->bounds);
}

static void compare(qm_trial *trial, const qm_hausdorff_options *options, const qm_hausdorff_result *r,
                    const watch *seen, interval distance)
{
    char call[512];
    print_call(options, call);
    double unit = (double)(1 / trial->frame.scale);
    qm_wide lower = fmax(r->lower, seen->lower) * trial->frame.scale;
    qm_wide upper = fmin(r->upper, seen->upper) * trial->frame.scale;
    double true_lower = (double)distance.lower * unit, true_upper = (double)distance.upper * unit;
    if (!(lower <= distance.upper))
        qm_trial_fail(trial, "lower %.17g, true at most %.17g, by %.3g sizes: %s", (double)lower * unit,
                      true_upper, (double)(lower - distance.upper), call);
    if (!(upper >= distance.lower))
        qm_trial_fail(trial, "upper %.17g, true at least %.17g, by %.3g sizes: %s", (double)upper * unit,
                      true_lower, (double)(distance.lower - upper), call);
    if (!(r->lower <= r->upper) || (r->stop == QM_STOP_CONVERGED && r->upper - r->lower > options->tolerance))
        qm_trial_fail(trial, "[%.17g, %.17g], stop %d: %s", r->lower, r->upper, (int)r->stop, call);
    qm_wide threshold = options->threshold * trial->frame.scale;
    if ((r->verdict > 0 && distance.upper <= threshold) || (r->verdict < 0 && distance.lower > threshold))
        qm_trial_fail(trial, "verdict %d, true in [%.17g, %.17g]: %s", r->verdict, true_lower, true_upper,
                      call);
    trial->tally->tries++;
    trial->tally->open += distance.upper - distance.lower > OPEN_WIDTH;
}

static void call(qm_trial *trial, const qm_hausdorff_options *drawn, interval distance)
{
    qm_hausdorff_options options = *drawn;
    qm_hausdorff_result result;
    watch seen = {0, INFINITY};
    options.progress = look;
    options.progress_user = &seen;
    trial->ctx.parallel = options.thread_count > 1 ? qm_host_parallel : NULL;
    qm_status status = qm_hausdorff_measure(&trial->ctx, trial->tree[0], trial->tree[1], &options, &result);
    if (status == QM_OK)
        compare(trial, &options, &result, &seen, distance);
    else if (status == QM_E_SCALE)
        trial->tally->refused++;
    else
        qm_trial_fail(trial, "%s: %s", qm_status_code(status), trial->ctx.message);
}

void qm_ask_hausdorff(qm_trial *trial)
{
    qm_quad_reading quads =
        trial->kind->only_patches ? QM_QUADS_BILINEAR : (qm_quad_reading)qm_random_below(&trial->random, 2);
    qm_direction direction =
        trial->kind->only_from_a ? QM_A_TO_B : (qm_direction)qm_random_below(&trial->random, 3);
    qm_wide_surface a = qm_wide_surface_make(&trial->frame, &trial->pair.a, quads);
    qm_wide_surface b = qm_wide_surface_make(&trial->frame, &trial->pair.b, quads);
    interval distance = {0, 0};
    if (direction != QM_B_TO_A) distance = greater(distance, reference(&a, &b));
    if (direction != QM_A_TO_B) distance = greater(distance, reference(&b, &a));
    qm_wide_surface_free(&a);
    qm_wide_surface_free(&b);
    for (int i = 0; i < CALLS; i++) {
        qm_hausdorff_options options = draw_options(trial, quads, direction, distance);
        call(trial, &options, distance);
    }
}
