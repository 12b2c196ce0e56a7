/**
 * comparison.c: the figures of both directions from two deviations.
 *
 * All terms are 0 or more, so that roundings are relative: a result of k operations is within a factor of (1 + u)^k. It
 * is widened by more than that, ROUNDINGS u; where a term is 0, or both are equal, the result is exact and is not widened,
 * so that a surface compared with itself has a distance of 0 and an F-score of 1.
 */
#include "qm/comparison.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "bvh/bvh_tree.h"
#include "core/clock.h"
#include "core/rounding.h"

#define ROUNDINGS 16.0
#define HD_PERCENT 95.0

/* ---- intervals ---- */

/** A computed number that is not exact, from below: the last step is for numbers without relative precision. */
static double below(double x)
{
    return x > 0.0 ? fmin(nextafter(x * (1.0 - ROUNDINGS * QM_UNIT_ROUNDING), 0.0), DBL_MAX) : 0.0;
}

static double above(double x)
{
    return nextafter(x * (1.0 + ROUNDINGS * QM_UNIT_ROUNDING), INFINITY);
}

static qm_interval greater(qm_interval x, qm_interval y)
{
    return (qm_interval){fmax(x.lower, y.lower), fmax(x.upper, y.upper)};
}

static qm_interval sum(qm_interval x, qm_interval y)
{
    double lower = x.lower + y.lower, upper = x.upper + y.upper;
    return (qm_interval){x.lower == 0.0 || y.lower == 0.0 ? lower : below(lower),
                         x.upper == 0.0 || y.upper == 0.0 ? upper : above(upper)};
}

static qm_interval square(qm_interval x)
{
    return (qm_interval){below(x.lower * x.lower), x.upper == 0.0 ? 0.0 : above(x.upper * x.upper)};
}

/* ---- the spread of one direction ---- */

/**
 * The standard deviation of a distance with these averages, between least and max. With m the mean and R the rms it is
 * sqrt(R^2 - m^2); and at most sqrt((max - m) (m - least)) (Bhatia and Davis, 2000), which is narrow where the distance
 * hardly varies. Lengths are divided by a power of two, so that squares neither overflow nor vanish and max has no part in
 * their roundings: they are 2 at most, and the differences off by a few u of 4.
 */
static qm_interval find_spread(const qm_deviation *deviation)
{
    if (!(deviation->max.upper > 0.0)) return (qm_interval){0.0, 0.0};
    if (!isfinite(deviation->max.upper)) return (qm_interval){0.0, INFINITY};
    int exponent;
    frexp(deviation->max.upper, &exponent);
    double unit = ldexp(1.0, exponent - 1), max = deviation->max.upper / unit;
    double error = 4.0 * ROUNDINGS * QM_UNIT_ROUNDING;
    double mean[2] = {deviation->mean.lower / unit, fmin(max, deviation->mean.upper / unit)};
    double rms[2] = {deviation->rms.lower / unit, fmin(max, deviation->rms.upper / unit)};
    double least = deviation->least / unit;
    double low = rms[0] * rms[0] - mean[1] * mean[1] - error,
           high = rms[1] * rms[1] - mean[0] * mean[0] + error;
    /* A parabola in m, greatest in the middle. */
    double at = fmax(mean[0], fmin(mean[1], 0.5 * (max + least)));
    high = fmin(high, (max - at) * (at - least) + error);
    double spread = low > 0.0 ? below(sqrt(low) * unit) : 0.0;
    return (qm_interval){spread, fmax(spread, above(sqrt(fmax(0.0, high)) * unit))};
}

/* ---- averages over both surfaces ---- */

/** The weight of A in averages over both surfaces, from the measures of both. */
static qm_interval find_weight(const qm_deviation side[2])
{
    qm_interval a = side[0].size, b = side[1].size;
    bool is_area = side[0].measure == QM_OVER_AREA;
    if (is_area != (side[1].measure == QM_OVER_AREA)) return (qm_interval){0.5, 0.5};
    double unit = fmax(a.upper, b.upper);
    if (!(unit > 0.0 && isfinite(unit))) return (qm_interval){0.0, 1.0};
    a = (qm_interval){a.lower / unit, a.upper / unit};
    b = (qm_interval){b.lower / unit, b.upper / unit};
    double low = a.lower / (a.lower + b.upper), high = a.upper / (a.upper + b.lower);
    return (qm_interval){below(low), fmin(1.0, above(high))};
}

/** An average of two numbers, with this weight of the first; never beyond the two. */
static double mix(double weight, double x, double y)
{
    return fmax(fmin(x, y), fmin(fmax(x, y), weight * x + (1.0 - weight) * y));
}

static double mix_least(qm_interval weight, double x, double y)
{
    return x == y ? x : below(fmin(mix(weight.lower, x, y), mix(weight.upper, x, y)));
}

static double mix_most(qm_interval weight, double x, double y)
{
    return x == y ? x : fmin(fmax(x, y), above(fmax(mix(weight.lower, x, y), mix(weight.upper, x, y))));
}

static qm_interval mix_means(qm_interval weight, qm_interval x, qm_interval y)
{
    return (qm_interval){mix_least(weight, x.lower, y.lower), mix_most(weight, x.upper, y.upper)};
}

/** The root of the average of two squares, of numbers divided by the greater one. */
static qm_interval mix_squares(qm_interval weight, qm_interval x, qm_interval y)
{
    double unit[2] = {fmax(x.lower, y.lower), fmax(x.upper, y.upper)};
    double low = 0.0, high = unit[1];
    if (unit[0] > 0.0) {
        double a = x.lower / unit[0], b = y.lower / unit[0];
        low = x.lower == y.lower ? x.lower : below(sqrt(mix_least(weight, a * a, b * b)) * unit[0]);
    }
    if (unit[1] > 0.0 && isfinite(unit[1]) && x.upper != y.upper) {
        double a = x.upper / unit[1], b = y.upper / unit[1];
        high = fmin(unit[1], above(sqrt(above(mix_most(weight, a * a, b * b))) * unit[1]));
    }
    return (qm_interval){low, high};
}

/* ---- F-scores ---- */

/** The harmonic mean, which grows with both. */
static double harmonic(double x, double y)
{
    return x == y || x == 0.0 || y == 0.0 ? fmin(x, y) : 2.0 * x * y / (x + y);
}

static qm_f_score find_f_score(double limit, qm_interval precision, qm_interval recall)
{
    double low = harmonic(precision.lower, recall.lower), high = harmonic(precision.upper, recall.upper);
    bool is_low_exact = precision.lower == recall.lower, is_high_exact = precision.upper == recall.upper;
    return (qm_f_score){
        limit,
        precision,
        recall,
        {is_low_exact ? low : below(low), is_high_exact || high == 0.0 ? high : fmin(1.0, above(high))}};
}

/* ---- progress ---- */

/** Bounds of the symmetric Hausdorff distance from those of the directions. */
typedef struct progress_of_both {
    const qm_comparison_options *options;
    double start_ms;
    qm_interval side[2];                /* bounds so far */
    int now;                            /* the direction that is measured */
    qm_hausdorff_progress before, last; /* counts of the other one, and those of this one */
} progress_of_both;

static void tell_both(void *user, const qm_hausdorff_progress *progress)
{
    progress_of_both *both = user;
    qm_interval *side = &both->side[both->now];
    side->lower = fmax(side->lower, progress->lower);
    side->upper = fmin(side->upper, progress->upper);
    both->last = *progress;
    qm_interval distance = greater(both->side[0], both->side[1]);
    qm_hausdorff_progress told = *progress;
    told.lower = distance.lower;
    told.upper = distance.upper;
    told.elapsed_ms = qm_clock_ms() - both->start_ms;
    told.iterations += both->before.iterations;
    told.projections += both->before.projections;
    both->options->progress(both->options->progress_user, &told);
}

/** No two points of the meshes are farther apart than the farthest ones of their boxes, in which patches lie, too. */
static double find_farthest(const qm_bvh *a, const qm_bvh *b)
{
    qm_box box[2] = {qm_mesh_bounding_box(&a->mesh), qm_mesh_bounding_box(&b->mesh)};
    double way[3];
    for (int k = 0; k < 3; k++)
        way[k] = fmax(box[0].max[k] - box[1].min[k], box[1].max[k] - box[0].min[k]);
    double farthest = hypot(hypot(way[0], way[1]), way[2]);
    return farthest > 0.0 ? above(farthest) : 0.0;
}

/** Takes note of what is known of both directions before either is measured, and begins to report it in place of the options that the
 * deviations have. */
static void begin_progress(progress_of_both *both, const qm_bvh *a, const qm_bvh *b,
                           qm_deviation_options *each)
{
    const qm_interval first = {0.0, find_farthest(a, b)};
    both->side[0] = both->side[1] = first;
    if (!each->progress) return;
    each->progress = tell_both;
    each->progress_user = both;
}

/** Takes note of the end of a direction. */
static void end_direction(progress_of_both *both, const qm_deviation *found)
{
    qm_interval *side = &both->side[both->now];
    side->lower = fmax(side->lower, found->max.lower);
    side->upper = fmin(side->upper, found->max.upper);
    both->before = both->last;
    both->now = 1;
}

/* ---- the call ---- */

static void join(qm_comparison *out)
{
    const qm_deviation *a = &out->side[0], *b = &out->side[1];
    for (int i = 0; i < 2; i++)
        out->spread[i] = find_spread(&out->side[i]);
    out->hd95 = greater(a->percentile[a->percentile_count - 1], b->percentile[b->percentile_count - 1]);
    qm_interval weight = find_weight(out->side);
    out->mean = mix_means(weight, a->mean, b->mean);
    out->rms = mix_squares(weight, a->rms, b->rms);
    out->chamfer_l1 = sum(a->mean, b->mean);
    out->chamfer_l2 = sum(square(a->rms), square(b->rms));
    out->is_accurate = a->is_accurate && b->is_accurate;
    out->is_canceled = a->is_canceled || b->is_canceled;
}

/** Whether A can prove a sign, or with NORMAL has faces that point somewhere. A call that is canceled meanwhile does not know. */
static qm_status find_sign(qm_context *ctx, const qm_bvh *a, const qm_comparison_options *options,
                           const qm_solid *solid_a, qm_comparison *out)
{
    out->is_signed[0] = options->sign != QM_SIGN_NONE;
    if (options->sign == QM_SIGN_NORMAL) out->is_signed[1] = a->mesh.face_count > 0;
    if (options->sign == QM_SIGN_NONE || options->sign == QM_SIGN_NORMAL) return QM_OK;
    qm_status status = QM_OK;
    if (solid_a)
        out->solid_a = *solid_a;
    else
        status = qm_solid_check(ctx, a, options->quads, options->thread_count, &out->solid_a);
    out->knows_solid = status == QM_OK;
    out->is_signed[1] = out->knows_solid && out->solid_a.fault == QM_SOLID_PROVEN;
    return status == QM_E_CANCELED ? QM_OK : status;
}

/** Measures one side, without regions when it has no area; that of a surface with faces is known only after its pieces are bounded. */
static qm_status measure_side(qm_context *ctx, const qm_bvh *from, const qm_bvh *to,
                              qm_deviation_options options, qm_deviation *out)
{
    if (from->mesh.face_count == 0) options.region_limit = NAN;
    qm_status status = qm_deviation_measure(ctx, from, to, &options, out);
    if (status != QM_E_UNSUPPORTED || isnan(options.region_limit)) return status;
    options.region_limit = NAN;
    return qm_deviation_measure(ctx, from, to, &options, out);
}

/** Measures B from A. */
static qm_status measure_back(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, qm_deviation_options options,
                              qm_comparison *out)
{
    options.solid = out->is_signed[1] && out->knows_solid ? &out->solid_a : NULL;
    if (!out->is_signed[1]) {
        options.sign = QM_SIGN_NONE;
        options.band_count = 0;
    }
    return measure_side(ctx, b, a, options, &out->side[1]);
}

qm_status qm_comparison_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                                const qm_comparison_options *options, const qm_solid *solid_a,
                                qm_comparison *out)
{
    QM_ASSERT(ctx && a && b && options && out && options->bin_count == 0);
    *out = (qm_comparison){0};
    double start_ms = qm_clock_ms();
    progress_of_both both = {.options = options, .start_ms = start_ms};
    size_t count = options->percentile_count + 1;
    double *percent = qm_context_alloc(ctx, count, sizeof *percent);
    out->f_score = qm_context_alloc(ctx, options->limit_count, sizeof *out->f_score);
    if (out->f_score) out->limit_count = options->limit_count;
    qm_status status = QM_OK;
    if (!percent || (options->limit_count > 0 && !out->f_score))
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the comparison");
    if (status == QM_OK) {
        if (count > 1) memcpy(percent, options->percentile, (count - 1) * sizeof *percent);
        percent[count - 1] = HD_PERCENT;
        qm_deviation_options each = *options;
        each.percentile = percent;
        each.percentile_count = count;
        begin_progress(&both, a, b, &each);
        status = measure_side(ctx, a, b, each, &out->side[0]);
        if (status == QM_OK) end_direction(&both, &out->side[0]);
        if (status == QM_OK) status = find_sign(ctx, a, options, solid_a, out);
        if (status == QM_OK) status = measure_back(ctx, a, b, each, out);
    }
    if (status == QM_OK) {
        end_direction(&both, &out->side[1]);
        join(out);
        out->hausdorff = greater(both.side[0], both.side[1]);
    }
    for (size_t i = 0; status == QM_OK && i < out->limit_count; i++)
        out->f_score[i] = find_f_score(options->limit[i], out->side[0].share[i], out->side[1].share[i]);
    qm_context_free(ctx, percent, count, sizeof *percent);
    if (status != QM_OK) qm_comparison_reset(ctx, out);
    out->elapsed_ms = qm_clock_ms() - start_ms;
    return status;
}

void qm_comparison_reset(qm_context *ctx, qm_comparison *comparison)
{
    qm_context_free(ctx, comparison->f_score, comparison->limit_count, sizeof *comparison->f_score);
    qm_deviation_reset(ctx, &comparison->side[0]);
    qm_deviation_reset(ctx, &comparison->side[1]);
    *comparison = (qm_comparison){0};
}
