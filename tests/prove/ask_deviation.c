/*
 * The deviation of a from b: the maximum against the certified one, distances of vertices against certified
 * ones, and mean, root mean square, percentiles and histogram of triangles against sums over cells with
 * certified bounds. With patches, mean, root mean square and percentiles against means over random points:
 * each distance is certified, and the error of the means is known from how far independent ones differ.
 */
#include "ask.h"
#include "qm/deviation.h"
#include "wide_farthest.h"

#include <stdlib.h>
#include <string.h>

enum { DRAWS = 16, STRATA = 6 }; /* of each facet: means, and cells along each side of one of them */
enum { MAX_LEVEL = 4, CELLS_OF_MAXIMUM = 600, PIECES = 4096, BINS = 4, PERCENTILES = 3 };

/** A part of a triangle of a: between which the distance lies, and its mean and that of its square. */
typedef struct part {
    qm_wide area, low, high;
    qm_wide mean[2], square[2];
} part;

typedef struct parts {
    part *at;
    size_t count;
    qm_wide area;
    qm_wide_distance *distance; /* of the centroid of the current part, to each facet of b */
    const qm_wide_surface *b;
} parts;

static void *allocate(size_t count, size_t width)
{
    void *rows = malloc(count * width);
    if (!rows) abort();
    return rows;
}

/**
 * Bounds from distances to single facets, which are convex: the mean over a triangle is at most that of its
 * corners, and at least the value in the middle. The latter holds of the nearest facet alone, so all others
 * must be farther everywhere; elsewhere the distance is at least that of the middle less the radius.
 */
static part measure(parts *all, const qm_wide_vec c[3], qm_wide area)
{
    qm_wide_vec middle = qm_wide_scale((qm_wide)1 / 3, qm_wide_add(c[0], qm_wide_add(c[1], c[2])));
    qm_wide radius = 0, lower = INFINITY, upper = INFINITY, second = INFINITY;
    size_t nearest = 0;
    for (int i = 0; i < 3; i++)
        radius = qm_wide_greatest(radius, qm_wide_length(qm_wide_sub(c[i], middle)));
    for (size_t f = 0; f < all->b->count; f++) {
        all->distance[f] = qm_wide_facet_distance(&all->b->facets[f], middle, 0, INFINITY);
        lower = qm_wide_least(lower, all->distance[f].lower);
        if (all->distance[f].upper >= upper) continue;
        upper = all->distance[f].upper;
        nearest = f;
    }
    part out = {.area = area, .low = qm_wide_greatest(0, lower - radius), .high = upper + radius};
    out.mean[1] = out.high;
    out.square[1] = out.high * out.high;
    for (size_t f = 0; f < all->b->count; f++) {
        if (f != nearest) second = qm_wide_least(second, all->distance[f].lower);
        if (all->distance[f].lower > upper + 2 * radius) continue;
        qm_wide sum = 0, squares = 0, greatest = 0;
        for (int i = 0; i < 3; i++) {
            qm_wide d = qm_wide_facet_distance(&all->b->facets[f], c[i], 0, INFINITY).upper;
            sum += d / 3;
            squares += d * d / 3;
            greatest = qm_wide_greatest(greatest, d);
        }
        out.mean[1] = qm_wide_least(out.mean[1], sum);
        out.square[1] = qm_wide_least(out.square[1], squares);
        out.high = qm_wide_least(out.high, greatest);
    }
    out.mean[0] = second >= upper + 2 * radius ? lower : out.low;
    out.square[0] = out.mean[0] * out.mean[0];
    return out;
}

static void cut(parts *all, const qm_wide_vec c[3], qm_wide area, int level)
{
    if (level == 0) {
        all->at[all->count++] = measure(all, c, area);
        return;
    }
    const qm_wide half = (qm_wide)0.5;
    const qm_wide_vec m[3] = {qm_wide_lerp(c[0], c[1], half), qm_wide_lerp(c[1], c[2], half),
                              qm_wide_lerp(c[2], c[0], half)};
    cut(all, (const qm_wide_vec[]){c[0], m[0], m[2]}, area / 4, level - 1);
    cut(all, (const qm_wide_vec[]){m[0], c[1], m[1]}, area / 4, level - 1);
    cut(all, (const qm_wide_vec[]){m[2], m[1], c[2]}, area / 4, level - 1);
    cut(all, m, area / 4, level - 1);
}

static parts make_parts(const qm_wide_surface *a, const qm_wide_surface *b)
{
    int level = a->count * b->count > 8 ? MAX_LEVEL - 1 : MAX_LEVEL;
    parts all = {.at = allocate(a->count << (2 * level), sizeof *all.at),
                 .distance = allocate(b->count, sizeof *all.distance),
                 .b = b};
    for (size_t f = 0; f < a->count; f++) {
        const qm_wide_vec *c = a->facets[f].corner;
        if (a->facets[f].corner_count != 3) continue;
        qm_wide area = qm_wide_length(qm_wide_cross(qm_wide_sub(c[1], c[0]), qm_wide_sub(c[2], c[0]))) / 2;
        all.area += area;
        cut(&all, c, area, level);
    }
    return all;
}

/** Fails unless both intervals, the engine's and the reference's, have a number in common. */
static void check_overlap(qm_trial *trial, const char *name, qm_interval reported, double lower, double upper)
{
    trial->tally->tries++;
    if (!(reported.lower <= upper && reported.upper >= lower && reported.lower <= reported.upper))
        qm_trial_fail(trial, "%s [%.17g, %.17g], true in [%.17g, %.17g]", name, reported.lower,
                      reported.upper, lower, upper);
}

/** The least and greatest share of the area whose distance is from low to high, in the frame. */
static void find_share(const parts *all, qm_wide low, qm_wide high, double share[2])
{
    qm_wide least = 0, greatest = 0;
    for (size_t i = 0; i < all->count; i++) {
        const part *p = &all->at[i];
        if (p->low >= low && p->high < high) least += p->area;
        if (p->high >= low && p->low <= high) greatest += p->area;
    }
    share[0] = (double)(least / all->area);
    share[1] = (double)(greatest / all->area);
}

/** The reference's own roundings are 2^-100 or so; shares that end in a double round by 2^-53. */
#define SHARE_ROUNDING 0x1p-50

static void check_averages(qm_trial *trial, const parts *all, const qm_deviation *reported)
{
    qm_wide mean[2] = {0, 0}, square[2] = {0, 0};
    for (size_t i = 0; i < all->count; i++)
        for (int k = 0; k < 2; k++) {
            mean[k] += all->at[i].area / all->area * all->at[i].mean[k];
            square[k] += all->at[i].area / all->area * all->at[i].square[k];
        }
    qm_wide scale = trial->frame.scale, round = 0x1p-98;
    check_overlap(trial, "mean", reported->mean, (double)((mean[0] - round) / scale),
                  (double)((mean[1] + round) / scale));
    check_overlap(trial, "rms", reported->rms, (double)((qm_wide_sqrt(square[0]) - round) / scale),
                  (double)((qm_wide_sqrt(square[1]) + round) / scale));
    double area = (double)(all->area / scale / scale);
    check_overlap(trial, "area", reported->size, area * (1 - 0x1p-52), area * (1 + 0x1p-52));
}

static void check_percentile(qm_trial *trial, const parts *all, double percent, qm_interval reported)
{
    double share[2], wanted = percent / 100;
    trial->tally->tries++;
    find_share(all, 0, reported.upper * trial->frame.scale, share);
    if (share[1] < wanted - SHARE_ROUNDING)
        qm_trial_fail(trial, "percentile %.17g at most %.17g, where the share is at most %.17g", percent,
                      reported.upper, share[1]);
    find_share(all, 0, reported.lower * trial->frame.scale, share);
    if (reported.lower > 0 && share[0] >= wanted + SHARE_ROUNDING)
        qm_trial_fail(trial, "percentile %.17g at least %.17g, where the share is at least %.17g", percent,
                      reported.lower, share[0]);
}

static void check_bins(qm_trial *trial, const parts *all, const qm_deviation *reported)
{
    for (size_t i = 0; i < reported->bin_count; i++) {
        double share[2];
        qm_wide width = reported->bin_width * trial->frame.scale;
        find_share(all, (qm_wide)i * width, (qm_wide)(i + 1) * width, share);
        check_overlap(trial, "share of a bin", reported->bin[i], share[0] - SHARE_ROUNDING,
                      share[1] + SHARE_ROUNDING);
    }
}

static void check_vertices(qm_trial *trial, const qm_wide_surface *b, const qm_deviation *reported)
{
    for (size_t v = 0; v < reported->vertex_count; v++) {
        qm_wide_vec p = qm_wide_local(&trial->frame, trial->pair.a.positions + 3 * v);
        qm_wide_distance d = qm_wide_surface_distance(b, p, 0x1p-60L);
        double lower = (double)(d.lower / trial->frame.scale), upper = (double)(d.upper / trial->frame.scale);
        double error = 1e-13 * trial->size;
        qm_interval at = {reported->vertex_distance[v] - error, reported->vertex_distance[v] + error};
        check_overlap(trial, "vertex", at, lower, upper);
    }
}

/* ---- means over random points ---- */

/** Of the mean: how wide the bounds of the distance of a point may be. The means themselves are off by far more,
 * and 113 bits take long to tell more digits. */
#define POINT_ERROR 0x1p-12
/** Of these many independent means the mean is off by more than so many standard errors about once in
 * 10^9. */
#define STANDARD_ERRORS 16.0
/** Share of the area that all points miss about once in 10^7: the standard error of what they hit knows nothing
 * of a peak there. */
#define UNSEEN_SHARE (16.0 / (DRAWS * STRATA * STRATA))

/** The area that a patch or a triangle has there for an area of its parameters. */
static qm_wide density_at(const qm_wide_facet *facet, qm_wide u, qm_wide v)
{
    const qm_wide_vec *c = facet->corner;
    if (facet->corner_count == 3)
        return qm_wide_length(qm_wide_cross(qm_wide_sub(c[1], c[0]), qm_wide_sub(c[2], c[0])));
    qm_wide_vec along_u = qm_wide_lerp(qm_wide_sub(c[1], c[0]), qm_wide_sub(c[2], c[3]), v);
    qm_wide_vec along_v = qm_wide_lerp(qm_wide_sub(c[3], c[0]), qm_wide_sub(c[2], c[1]), u);
    return qm_wide_length(qm_wide_cross(along_u, along_v));
}

/** A random point of a cell; those of a triangle are the cells of a square, folded over. */
static void draw_point(qm_random *random, const qm_wide_facet *facet, size_t cell, qm_wide uv[2])
{
    uv[0] = ((qm_wide)(cell % STRATA) + (qm_wide)qm_random_range(random, 0, 1)) / STRATA;
    uv[1] = ((qm_wide)(cell / STRATA) + (qm_wide)qm_random_range(random, 0, 1)) / STRATA;
    if (facet->corner_count == 3 && uv[0] + uv[1] > 1) {
        uv[0] = 1 - uv[0];
        uv[1] = 1 - uv[1];
    }
}

typedef struct point_sample {
    qm_wide low, high;
    double weight;
} point_sample;

static point_sample sample(qm_random *random, const qm_wide_facet *facet, size_t cell,
                           const qm_wide_surface *b, qm_wide eps)
{
    qm_wide uv[2];
    draw_point(random, facet, cell, uv);
    qm_wide_distance d = qm_wide_surface_distance(b, qm_wide_facet_at(facet, uv[0], uv[1]), eps);
    qm_wide share = facet->corner_count == 3 ? (qm_wide)0.5 : (qm_wide)1;
    return (point_sample){d.lower, d.upper,
                          (double)(share * density_at(facet, uv[0], uv[1]) / (STRATA * STRATA))};
}

/** Mean of independent numbers, and by what it may be off. */
static double mean_of(const double x[DRAWS], double *error)
{
    double mean = 0, square = 0;
    for (int i = 0; i < DRAWS; i++)
        mean += x[i] / DRAWS;
    for (int i = 0; i < DRAWS; i++)
        square += (x[i] - mean) * (x[i] - mean);
    *error = STANDARD_ERRORS * sqrt(square / (DRAWS * (DRAWS - 1.0)));
    return mean;
}

/** An interval of lengths, or of lengths to a power, in the frame, where no square is too large or too
 * small. */
static qm_interval in_frame(qm_interval world, qm_wide scale)
{
    return (qm_interval){(double)(world.lower * scale), (double)(world.upper * scale)};
}

/** Draws; all sums are of what a point is off by from the middle of the engine's interval, so that their
 * ratio to the area is as good as they are. */
static void check_draws(qm_trial *trial, const qm_wide_surface *a, const qm_wide_surface *b,
                        const qm_deviation_options *options, const qm_deviation *reported)
{
    double off[2][DRAWS] = {{0}}, area[DRAWS] = {0}, within[2][PERCENTILES][DRAWS] = {{{0}}}, error,
           farthest = 0, open = 0;
    qm_wide scale = trial->frame.scale;
    qm_interval mean_reported = in_frame(reported->mean, scale),
                rms_reported = in_frame(reported->rms, scale);
    double mean = 0.5 * (mean_reported.lower + mean_reported.upper);
    double square = 0.5 * (rms_reported.lower * rms_reported.lower + rms_reported.upper * rms_reported.upper);
    qm_wide eps = qm_wide_greatest(0x1p-54L, POINT_ERROR * mean);
    for (int draw = 0; draw < DRAWS; draw++) {
        for (size_t i = 0; i < a->count * STRATA * STRATA; i++) {
            point_sample at =
                sample(&trial->random, &a->facets[i / (STRATA * STRATA)], i % (STRATA * STRATA), b, eps);
            double d = (double)((at.low + at.high) / 2);
            area[draw] += at.weight;
            farthest = fmax(farthest, d);
            open = fmax(open, (double)((at.high - at.low) / 2));
            off[0][draw] += at.weight * (d - mean);
            off[1][draw] += at.weight * (d * d - square);
            for (size_t k = 0; k < reported->percentile_count; k++) {
                within[0][k][draw] += at.high < reported->percentile[k].lower * scale ? at.weight : 0;
                within[1][k][draw] += at.low <= reported->percentile[k].upper * scale ? at.weight : 0;
            }
        }
    }
    double total = mean_of(area, &error), rounding = 0x1p-46 + open * (1 + 0x1p-46);
    check_overlap(trial, "area", in_frame(reported->size, scale * scale), (total - error) * (1 - 0x1p-40),
                  (total + error) * (1 + 0x1p-40));
    const qm_interval half[2] = {
        {mean_reported.lower - mean, mean_reported.upper - mean},
        {rms_reported.lower * rms_reported.lower - square, rms_reported.upper * rms_reported.upper - square}};
    double max = fmax(farthest, in_frame(reported->max, scale).upper);
    const double unseen[2] = {max - farthest, max * max - farthest * farthest};
    for (int k = 0; k < 2; k++) {
        double at = mean_of(off[k], &error) / total, wide = error / total + UNSEEN_SHARE * unseen[k];
        double round = k ? rounding * (2 * max + rounding) : rounding;
        check_overlap(trial, k ? "mean square, less its middle," : "mean, less its middle,", half[k],
                      at - wide - round, at + wide + round);
    }
    for (size_t k = 0; k < reported->percentile_count; k++) {
        double wanted = options->percentile[k] / 100;
        double below = mean_of(within[0][k], &error) / total, low_error = error / total + UNSEEN_SHARE;
        double up_to = mean_of(within[1][k], &error) / total, high_error = error / total + UNSEEN_SHARE;
        trial->tally->tries++;
        if (below - low_error > wanted || up_to + high_error < wanted)
            qm_trial_fail(trial,
                          "percentile %.17g [%.17g, %.17g], of points %.17g are below and %.17g up to it",
                          options->percentile[k], reported->percentile[k].lower,
                          reported->percentile[k].upper, below, up_to);
    }
}

/** True where all of it are triangles, some of them with an area that is worth a mean. */
static bool has_mean(const qm_wide_surface *a)
{
    for (size_t f = 0; f < a->count; f++)
        if (a->facets[f].corner_count != 3) return false;
    return true;
}

static void check(qm_trial *trial, const qm_deviation_options *options, const qm_deviation *reported)
{
    qm_wide_surface a = qm_wide_surface_make(&trial->frame, &trial->pair.a, options->quads);
    qm_wide_surface b = qm_wide_surface_make(&trial->frame, &trial->pair.b, options->quads);
    qm_wide_maximum max = qm_wide_farthest(&a, &b, 0x1p-54L, CELLS_OF_MAXIMUM);
    qm_wide scale = trial->frame.scale;
    check_overlap(trial, "max", reported->max, (double)(max.lower / scale), (double)(max.upper / scale));
    check_vertices(trial, &b, reported);
    if (has_mean(&a) && has_mean(&b)) {
        parts all = make_parts(&a, &b);
        if (reported->measure == QM_OVER_AREA && all.area > 1e-12) {
            check_averages(trial, &all, reported);
            for (size_t i = 0; i < reported->percentile_count; i++)
                check_percentile(trial, &all, options->percentile[i], reported->percentile[i]);
            check_bins(trial, &all, reported);
        }
        free(all.at);
        free(all.distance);
    } else if (reported->measure == QM_OVER_AREA && reported->mean.upper < INFINITY &&
               a.count * b.count <= 9) {
        check_draws(trial, &a, &b, options, reported);
    }
    qm_wide_surface_free(&a);
    qm_wide_surface_free(&b);
}

void qm_ask_deviation(qm_trial *trial)
{
    qm_random *random = &trial->random;
    double percentile[PERCENTILES] = {50, 100, qm_random_range(random, 0.1, 100)};
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = trial->kind->only_patches    ? QM_QUADS_BILINEAR
                    : qm_random_below(random, 4) ? QM_QUADS_TRIANGLES
                                                 : QM_QUADS_BILINEAR;
    options.accuracy = qm_random_power(random, -4, -0.5);
    options.tolerance = trial->size * qm_random_power(random, -10, -2);
    options.piece_limit = PIECES;
    options.percentile = percentile;
    options.percentile_count = PERCENTILES;
    options.bin_count = BINS;
    qm_deviation reported;
    qm_status status = qm_deviation_measure(&trial->ctx, trial->tree[0], trial->tree[1], &options, &reported);
    if (status == QM_E_SCALE) {
        trial->tally->refused++;
    } else if (status != QM_OK) {
        qm_trial_fail(trial, "%s: %s", qm_status_code(status), trial->ctx.message);
    } else {
        check(trial, &options, &reported);
        qm_deviation_reset(&trial->ctx, &reported);
    }
}
