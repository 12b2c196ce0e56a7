/**
 * deviation_percentiles.c: percentiles as the points where a lower and an upper bound of the share within a
 * distance reach a number. Where these points are is estimated from the heights at a few points of each
 * piece, then proved and narrowed by regula falsi and bisection.
 */
#include "deviation_sum.h"

#include <float.h>
#include <stdlib.h>

#define SAMPLES 4        /* of each end of a percentile in the first round, which has the most */
#define NEAR_PART 0x1p-5 /* of a range: how near the samples are to the predicted end */
#define MAX_ROUNDS 24
#define CANCEL_STRIDE 0x1000 /* pieces */
#define END_SHARE 0x1p-6     /* of a percentile's own interval: its ends are found no closer */

/* Estimates. */
#define LEVEL_BITS 8              /* of the mantissa, in a level */
#define LEVELS (32 << LEVEL_BITS) /* 32 powers of two below the greatest distance */
#define CELLS 4                   /* along an edge of a piece, in whose place the edges of its cells count: */
#define POINTS (3 * CELLS * (CELLS + 1) / 2)
/* How far from an estimate the first samples are: of the estimated width, which it is good for where pieces are
 * many; and at least of the range of the survey. */
#define FIRST_NEAR 0x1p-4
#define FIRST_FAR 0x1p-1
#define FIRST_LEAST 0x1p-12

/* ---- estimates ---- */

/** Which bound of the share within a distance: the one by the greatest that distances may be, and by the least. */
enum { SURELY, POSSIBLY };

/** Estimates of the area by level of the distance, after each bound of it. */
typedef struct distribution {
    double *area[2];
    double total, greatest;
    qm_levels levels;
} distribution;

/** Adds an area at one distance. */
static void add_area(const distribution *d, int bound, double x, double area)
{
    d->area[bound][qm_levels_find(&d->levels, x)] += area;
}

/** The bounds of the distance at a point with these weights; open is that of the cells of a piece whose height bends. */
static qm_interval distance_at(const qm_deviation_bounds *piece, const double open[2], const double weight[3])
{
    double low = 0.0, high = 0.0;
    bool is_bent = piece->bend.cells > 1;
    if (is_bent) {
        double height = qm_quadratic_at(piece->bend.value, weight);
        low = height - open[0];
        high = height + open[1];
    } else {
        for (int k = 0; k < 3; k++) {
            low += weight[k] * piece->low[k];
            high += weight[k] * piece->high[k];
        }
    }
    if (!is_bent && !piece->is_signed) return (qm_interval){low, high};
    return (qm_interval){qm_max(low, -high), qm_max(high, -low)};
}

/** Adds an area in parts at some distances, less of it to those before the middle by a share, and more to the others. */
static void add_shifted(const distribution *d, int bound, double area, double middle, double shift,
                        const double *at, const double *part)
{
    double before = 0.0;
    for (int i = 0; i < POINTS; i++)
        before += at[i] < middle ? part[i] : 0.0;
    if (!(before < 1.0)) shift = 0.0;
    double less = area * (1.0 - shift), more = area * (1.0 + shift * (before / (1.0 - before)));
    for (int i = 0; i < POINTS; i++)
        add_area(d, bound, at[i], part[i] * (at[i] < middle ? less : more));
}

/**
 * Adds the area of a piece at the middles of the edges of its cells: in equal parts their distribution has the mean and the
 * variance of a linear function. Where the density is uncertain, the half of the piece that favors a bound has the
 * greatest one, the other half the least.
 */
static void add_heights(const distribution *d, const qm_deviation_bounds *piece, double area)
{
    double open[2] = {0.0, 0.0}, sum = piece->density_high + piece->density_low;
    if (piece->bend.cells > 1) qm_quadratic_cells_open(&piece->bend, open);
    const double middle[3] = {1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0};
    qm_interval half = distance_at(piece, open, middle);
    double shift = sum > 0.0 ? (piece->density_high - piece->density_low) / sum : 0.0;
    double low[POINTS], high[POINTS], part[POINTS];
    const int n = 2 * CELLS;
    int count = 0;
    for (int j = 0; j <= n; j++)
        for (int i = j % 2 == 0; i + j <= n; i += 1 + (j % 2 == 0), count++) {
            const double weight[3] = {(double)(n - i - j) / n, (double)i / n, (double)j / n};
            qm_interval at = distance_at(piece, open, weight);
            low[count] = at.lower;
            high[count] = at.upper;
            part[count] = (i == 0 || j == 0 || i + j == n ? 1.0 : 2.0) / (3.0 * CELLS * CELLS);
        }
    QM_ASSERT(count == POINTS);
    add_shifted(d, SURELY, area, half.upper, shift, high, part);
    add_shifted(d, POSSIBLY, area, half.lower, -shift, low, part);
}

/** The shares where a bound fails count as beyond up to the greatest distance of the piece, or as within from 0 on. */
static void add_invalid(const distribution *d, const qm_deviation_bounds *piece, double area)
{
    add_area(d, SURELY, piece->least, -area * piece->invalid_high);
    add_area(d, SURELY, piece->most, area * piece->invalid_high);
    add_area(d, POSSIBLY, 0.0, area * piece->invalid_low);
    add_area(d, POSSIBLY, piece->most, -area * piece->invalid_low);
}

/** False when the call is canceled. */
static bool add_pieces(qm_context *ctx, distribution *d, qm_deviation_piece_list pieces)
{
    for (size_t i = 0; i < pieces.count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(ctx)) return false;
        const qm_deviation_bounds *piece = &pieces.bounds[i];
        double area = 0.5 * (piece->area_low + piece->area_high);
        add_heights(d, piece, area);
        add_invalid(d, piece, area);
        d->total += area;
    }
    return true;
}

/** The distance within which a share of the area is, about. */
static double estimate(const distribution *d, int bound, double share)
{
    double sum = 0.0, wanted = share * d->total;
    size_t level = 0;
    while (level + 1 < LEVELS && sum + d->area[bound][level] < wanted)
        sum += d->area[bound][level++];
    double area = d->area[bound][level], begin = qm_levels_begin(&d->levels, level),
           end = fmin(qm_levels_begin(&d->levels, level + 1), d->greatest);
    return begin + (end - begin) * (area > 0.0 ? qm_clamp((wanted - sum) / area, 0.0, 1.0) : 0.5);
}

/* ---- the search ---- */

/** The point where an increasing function first reaches a share, between two points where it is known. */
typedef struct crossing {
    qm_interval x, share;
} crossing;

/** Where the ends of a percentile's interval are: where the greatest share that is possible first reaches it,
 * and where the least one does. */
typedef struct percentile_search {
    double share;
    crossing lower, upper;
} percentile_search;

/**
 * Places to look at next: one on each side of where the straight line through both ends reaches the share,
 * and the middle of the range in case that the function is far from straight. None when the remainder of
 * the range hardly adds to the width of the interval.
 */
static size_t add_samples(double *x, size_t count, const crossing *at, double share, double width)
{
    double range = at->x.upper - at->x.lower, rise = at->share.upper - at->share.lower;
    if (!(range > END_SHARE * width)) return count;
    double part = rise > 0.0 ? qm_clamp((share - at->share.lower) / rise, NEAR_PART, 1.0 - NEAR_PART) : 0.5;
    const double parts[] = {part - 0.5 * NEAR_PART, 0.5, part + 0.5 * NEAR_PART};
    for (int i = 0; i < 3; i++)
        x[count++] = at->x.lower + range * parts[i];
    return count;
}

static void narrow(crossing *at, double share, double x, double here)
{
    if (here < share && x > at->x.lower) {
        at->x.lower = x;
        at->share.lower = here;
    } else if (!(here < share) && x < at->x.upper) {
        at->x.upper = x;
        at->share.upper = here;
    }
}

/** Adds the first places to look at, near the estimated ends of a percentile. */
static void add_first_samples(double *x, const distribution *d, const percentile_search *p)
{
    const double end[2] = {estimate(d, POSSIBLY, p->share), estimate(d, SURELY, p->share)};
    double width = qm_max(0.0, end[1] - end[0]), least = FIRST_LEAST * (p->lower.x.upper - p->lower.x.lower);
    for (int k = 0; k < 2; k++) {
        double near = qm_max(FIRST_NEAR * width, least), far = qm_max(FIRST_FAR * width, 8.0 * least);
        const double places[SAMPLES] = {end[k] - far, end[k] - near, end[k] + near, end[k] + far};
        for (int i = 0; i < SAMPLES; i++)
            *x++ = qm_clamp(places[i], p->lower.x.lower, p->lower.x.upper);
    }
}

/** x has room for 2 SAMPLES of each percentile. */
static qm_status find_first_samples(qm_context *ctx, qm_deviation_piece_list pieces,
                                    const percentile_search *search, size_t count, double max, double *x)
{
    double *area = qm_context_alloc(ctx, 2 * LEVELS, sizeof *area);
    if (!area) return QM_E_NO_MEMORY;
    for (size_t i = 0; i < 2 * LEVELS; i++)
        area[i] = 0.0;
    distribution d = {.area = {area, area + LEVELS},
                      .greatest = max,
                      .levels = qm_levels_make(fmax(max, DBL_MIN), LEVEL_BITS, LEVELS)};
    bool is_whole = add_pieces(ctx, &d, pieces);
    for (size_t i = 0; i < count && is_whole; i++)
        add_first_samples(x + 2 * SAMPLES * i, &d, &search[i]);
    qm_context_free(ctx, area, 2 * LEVELS, sizeof *area);
    return is_whole ? QM_OK : qm_context_fail(ctx, QM_E_CANCELED, "deviation canceled");
}

/** What is found until the call is canceled holds. */
static qm_status find_percentiles(qm_context *ctx, qm_deviation_piece_list pieces, percentile_search *search,
                                  size_t count, double max, double *x, qm_interval *share, long double *work)
{
    size_t used = 2 * SAMPLES * count;
    qm_status found = find_first_samples(ctx, pieces, search, count, max, x);
    if (found != QM_OK) return found;
    for (int round = 0; round < MAX_ROUNDS && used > 0; round++) {
        qsort(x, used, sizeof *x, qm_deviation_compare_numbers);
        qm_status status = qm_deviation_shares(ctx, pieces, x, used, work, share);
        if (status != QM_OK) return status;
        for (size_t i = 0; i < count; i++)
            for (size_t k = 0; k < used; k++) {
                narrow(&search[i].lower, search[i].share, x[k], share[k].upper);
                narrow(&search[i].upper, search[i].share, x[k], share[k].lower);
            }
        used = 0;
        for (size_t i = 0; i < count; i++) {
            percentile_search *p = &search[i];
            double width = fmax(0.0, p->upper.x.lower - p->lower.x.upper);
            used = add_samples(x, used, &p->lower, p->share, width);
            used = add_samples(x, used, &p->upper, p->share, width);
        }
    }
    return QM_OK;
}

qm_status qm_deviation_percentiles(qm_context *ctx, const qm_deviation_piece_list *pieces,
                                   const qm_deviation_survey *survey, double max, const double *percent,
                                   size_t count, qm_interval *out)
{
    if (count == 0) return QM_OK;
    size_t samples = 2 * SAMPLES * count;
    percentile_search *search = qm_context_alloc(ctx, count, sizeof *search);
    double *x = qm_context_alloc(ctx, samples, sizeof *x);
    qm_interval *share = qm_context_alloc(ctx, samples, sizeof *share);
    long double *work = qm_context_alloc(ctx, QM_SHARE_ROWS * (samples + 1), sizeof *work);
    qm_status status = QM_E_NO_MEMORY;
    if (search && x && share && work) {
        for (size_t i = 0; i < count; i++) {
            double part = percent[i] / 100.0;
            const crossing start = {qm_deviation_survey_percentile(survey, part, max), {0.0, 1.0}};
            search[i] = (percentile_search){part, start, start};
        }
        status = pieces ? find_percentiles(ctx, *pieces, search, count, max, x, share, work) : QM_OK;
        for (size_t i = 0; i < count; i++)
            out[i] = (qm_interval){search[i].lower.x.lower, search[i].upper.x.upper};
    }
    qm_context_free(ctx, search, count, sizeof *search);
    qm_context_free(ctx, x, samples, sizeof *x);
    qm_context_free(ctx, share, samples, sizeof *share);
    qm_context_free(ctx, work, QM_SHARE_ROWS * (samples + 1), sizeof *work);
    return status == QM_E_NO_MEMORY ? qm_context_fail(ctx, status, "out of memory for the percentiles")
                                    : status;
}
