#include "deviation_sum.h"

#include <stdlib.h>

#define SUM_ERROR 1e-12 /* relative: long doubles, and fewer than 2^32 pieces */
#define SECTIONS 8      /* parts that an interval of a percentile is cut in at a time */
#define MAX_ROUNDS 16
#define END_SHARE 0x1p-10 /* of a percentile's own interval: its ends are found no closer */

static qm_interval opened(long double low, long double high)
{
    return (qm_interval){(double)low * (1.0 - SUM_ERROR), (double)high * (1.0 + SUM_ERROR)};
}

qm_piece_totals qm_piece_sum(qm_piece_list pieces)
{
    long double area[2] = {0, 0}, mean[2] = {0, 0}, square[2] = {0, 0};
    for (size_t i = 0; i < pieces.count; i++) {
        const qm_piece_bounds *piece = &pieces.bounds[i];
        area[0] += (long double)piece->area_low;
        area[1] += (long double)piece->area_high;
        mean[0] += (long double)piece->mean_low;
        mean[1] += (long double)piece->mean_high;
        square[0] += (long double)piece->square_low;
        square[1] += (long double)piece->square_high;
    }
    qm_piece_totals totals = {.area = opened(area[0], area[1])};
    if (!(totals.area.lower > 0.0)) return totals;
    totals.mean = opened(mean[0] / (long double)totals.area.upper, mean[1] / (long double)totals.area.lower);
    qm_interval squares =
        opened(square[0] / (long double)totals.area.upper, square[1] / (long double)totals.area.lower);
    totals.rms = opened((long double)sqrt(squares.lower), (long double)sqrt(squares.upper));
    return totals;
}

/* ---- shares ---- */

/** The three values in order, and the share of a triangle in which the linear function is at most x. */
static void sort3(const double v[3], double out[3])
{
    double a = v[0], b = v[1], c = v[2], low = fmin(a, b), high = fmax(a, b);
    out[0] = fmin(low, c);
    out[1] = fmax(low, fmin(high, c));
    out[2] = fmax(high, c);
}

static double share_within(const double v[3], double x)
{
    if (x < v[0]) return 0.0;
    if (x >= v[2]) return 1.0;
    if (x < v[1]) return (x - v[0]) / (v[1] - v[0]) * ((x - v[0]) / (v[2] - v[0]));
    return 1.0 - (v[2] - x) / (v[2] - v[1]) * ((v[2] - x) / (v[2] - v[0]));
}

/** The first place whose x is at least value. */
static size_t find_place(const double *x, size_t count, double value)
{
    size_t low = 0;
    while (count > 0) {
        size_t half = count / 2;
        if (x[low + half] < value) {
            low += half + 1;
            count -= half + 1;
        } else {
            count = half;
        }
    }
    return low;
}

/** Areas within and beyond each x, by one of the two linear functions. steps hold what changes from one x to
 * the next: whole pieces, which are most of them, are added in two places only. */
typedef struct share_sums {
    long double *within, *within_steps, *beyond, *beyond_steps;
} share_sums;

/** whole and density are the areas of the part within, then of the part beyond. */
static void add_piece(const share_sums *sums, const double v[3], const double *x, size_t count,
                      const double whole[2], const double density[2])
{
    size_t begin = find_place(x, count, v[0]), end = find_place(x, count, v[2]);
    sums->beyond_steps[0] += (long double)whole[1];
    sums->beyond_steps[begin] -= (long double)whole[1];
    sums->within_steps[end] += (long double)whole[0];
    for (size_t i = begin; i < end; i++) {
        double share = share_within(v, x[i]);
        sums->within[i] += (long double)fmin(whole[0], share * density[0]);
        sums->beyond[i] += (long double)fmin(whole[1], (1.0 - share) * density[1]);
    }
}

static void add_up(const share_sums *sums, size_t count)
{
    long double within = 0, beyond = 0;
    for (size_t i = 0; i < count; i++) {
        within += sums->within_steps[i];
        beyond += sums->beyond_steps[i];
        sums->within[i] += within;
        sums->beyond[i] += beyond;
    }
}

static share_sums make_sums(long double *work, size_t count)
{
    for (size_t i = 0; i < 4 * (count + 1); i++)
        work[i] = 0;
    return (share_sums){work, work + (count + 1), work + 2 * (count + 1), work + 3 * (count + 1)};
}

static double share_of(const share_sums *sums, size_t i)
{
    long double within = fmaxl(0, sums->within[i]), beyond = fmaxl(0, sums->beyond[i]);
    return within + beyond > 0 ? (double)(within / (within + beyond)) : 0.0;
}

void qm_piece_shares(qm_piece_list pieces, const double *x, size_t count, long double *work,
                     qm_interval *share)
{
    share_sums low = make_sums(work, count), high = make_sums(work + 4 * (count + 1), count);
    for (size_t i = 0; i < pieces.count; i++) {
        const qm_piece_bounds *piece = &pieces.bounds[i];
        double v[3];
        sort3(piece->high, v);
        add_piece(&low, v, x, count, (const double[2]){piece->area_low, piece->area_high},
                  (const double[2]){piece->density_low, piece->density_high});
        sort3(piece->low, v);
        add_piece(&high, v, x, count, (const double[2]){piece->area_high, piece->area_low},
                  (const double[2]){piece->density_high, piece->density_low});
    }
    add_up(&low, count);
    add_up(&high, count);
    for (size_t i = 0; i < count; i++)
        share[i] = (qm_interval){fmax(0.0, share_of(&low, i) - SUM_ERROR),
                                 fmin(1.0, share_of(&high, i) + SUM_ERROR)};
}

/* ---- percentiles ---- */

/** What is known of a percentile: the least and greatest place of each end of its interval. */
typedef struct percentile_search {
    double share;
    qm_interval lower,
        upper; /* of out->lower, where F_high first reaches the share; of out->upper likewise */
} percentile_search;

static int compare_numbers(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static size_t add_sections(double *x, size_t count, qm_interval range)
{
    for (int i = 1; i < SECTIONS; i++)
        x[count++] = range.lower + (range.upper - range.lower) * i / SECTIONS;
    return count;
}

static void narrow(percentile_search *p, const double *x, const qm_interval *share, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (share[i].upper < p->share)
            p->lower.lower = fmax(p->lower.lower, x[i]);
        else
            p->lower.upper = fmin(p->lower.upper, x[i]);
        if (share[i].lower >= p->share)
            p->upper.upper = fmin(p->upper.upper, x[i]);
        else
            p->upper.lower = fmax(p->upper.lower, x[i]);
    }
}

/** An end is found when what is left of its range hardly adds to the width of the interval. */
static size_t add_open_end(double *x, size_t count, qm_interval range, double width)
{
    return range.upper - range.lower > END_SHARE * width ? add_sections(x, count, range) : count;
}

static void find_percentiles(qm_piece_list pieces, percentile_search *search, size_t count, double *x,
                             qm_interval *share, long double *work)
{
    for (int round = 0; round < MAX_ROUNDS; round++) {
        size_t used = 0;
        for (size_t i = 0; i < count; i++) {
            double width = fmax(0.0, search[i].upper.lower - search[i].lower.upper);
            used = add_open_end(x, used, search[i].lower, width);
            used = add_open_end(x, used, search[i].upper, width);
        }
        if (used == 0) return;
        qsort(x, used, sizeof *x, compare_numbers);
        qm_piece_shares(pieces, x, used, work, share);
        for (size_t i = 0; i < count; i++)
            narrow(&search[i], x, share, used);
    }
}

qm_status qm_piece_percentiles(qm_context *ctx, qm_piece_list pieces, double greatest, const double *percent,
                               size_t count, qm_interval *out)
{
    if (count == 0) return QM_OK;
    size_t places = 2 * (SECTIONS - 1) * count;
    percentile_search *search = qm_context_alloc(ctx, count, sizeof *search);
    double *x = qm_context_alloc(ctx, places, sizeof *x);
    qm_interval *share = qm_context_alloc(ctx, places, sizeof *share);
    long double *work = qm_context_alloc(ctx, 8 * (places + 1), sizeof *work);
    bool has_memory = search && x && share && work;
    if (has_memory) {
        for (size_t i = 0; i < count; i++)
            search[i] = (percentile_search){percent[i] / 100.0, {0.0, greatest}, {0.0, greatest}};
        find_percentiles(pieces, search, count, x, share, work);
        for (size_t i = 0; i < count; i++)
            out[i] = (qm_interval){search[i].lower.lower, search[i].upper.upper};
    }
    qm_context_free(ctx, search, count, sizeof *search);
    qm_context_free(ctx, x, places, sizeof *x);
    qm_context_free(ctx, share, places, sizeof *share);
    qm_context_free(ctx, work, 8 * (places + 1), sizeof *work);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the percentiles");
}

/* ---- histogram ---- */

/** Share of the area with a distance below border i. Two places stand for it, just below it and at it. */
static qm_interval share_below(const qm_interval *share, size_t i, size_t count)
{
    if (i == 0) return (qm_interval){0.0, 0.0};
    if (i == count) return (qm_interval){1.0, 1.0};
    return (qm_interval){share[2 * i].lower, share[2 * i + 1].upper};
}

qm_status qm_piece_histogram(qm_context *ctx, qm_piece_list pieces, double greatest, size_t count,
                             qm_interval *out)
{
    if (count == 0) return QM_OK;
    size_t places = 2 * count;
    double *x = qm_context_alloc(ctx, places, sizeof *x);
    qm_interval *share = qm_context_alloc(ctx, places, sizeof *share);
    long double *work = qm_context_alloc(ctx, 8 * (places + 1), sizeof *work);
    bool has_memory = x && share && work;
    if (has_memory) {
        for (size_t i = 0; i < count; i++) {
            x[2 * i + 1] = greatest * (double)i / (double)count;
            x[2 * i] = nextafter(x[2 * i + 1], -INFINITY);
        }
        qm_piece_shares(pieces, x, places, work, share);
        for (size_t i = 0; i < count; i++) {
            qm_interval from = share_below(share, i, count), to = share_below(share, i + 1, count);
            out[i] = (qm_interval){fmax(0.0, to.lower - from.upper), fmin(1.0, to.upper - from.lower)};
        }
    }
    qm_context_free(ctx, x, places, sizeof *x);
    qm_context_free(ctx, share, places, sizeof *share);
    qm_context_free(ctx, work, 8 * (places + 1), sizeof *work);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the histogram");
}
