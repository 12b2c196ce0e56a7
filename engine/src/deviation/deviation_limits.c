/**
 * deviation_limits.c: areas of groups of pieces within ascending borders, and what they say of limits and bands: a limit asks for
 * one border of the group of all pieces, a band for both of its ends in each side's group.
 *
 * A limit becomes a local length by a power of two, which is exact unless the length is below the least normal number; it
 * is then off by 2^-1074 at most. Functions of pieces are widened by eta, of which 2 u S are to spare (deviation_piece.h),
 * and S is never as small as that.
 */
#include "deviation_limits.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define BORDER (1.0 - 0x1p-50) /* just below a positive border */
#define BORDERS 4              /* of a band: both ends, and just below each */

/** The areas of each group within the borders, ascending. */
typedef struct border_areas {
    double *border;
    size_t count;
    int group_count;
    qm_deviation_areas *within[QM_PIECE_SIDES];
} border_areas;

static const qm_deviation_areas nothing = {0, 0, 0, 0};

static void borders_reset(qm_context *ctx, border_areas *areas)
{
    for (int k = 0; k < areas->group_count; k++)
        qm_context_free(ctx, areas->within[k], areas->count, sizeof *areas->within[k]);
    qm_context_free(ctx, areas->border, areas->count, sizeof *areas->border);
}

/** Room for so many borders; QM_OK or QM_E_NO_MEMORY. In each case for borders_reset. */
static qm_status borders_init(qm_context *ctx, border_areas *areas, size_t count, int group_count)
{
    *areas = (border_areas){.count = count, .group_count = group_count};
    areas->border = qm_context_alloc(ctx, count, sizeof *areas->border);
    bool has_memory = areas->border;
    for (int k = 0; k < group_count; k++) {
        areas->within[k] = qm_context_alloc(ctx, count, sizeof *areas->within[k]);
        has_memory = has_memory && areas->within[k];
    }
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the shares");
}

/** Sorts the borders, and finds the areas of the pieces of each side, or of all as one group where side is NULL. */
static qm_status borders_measure(qm_context *ctx, qm_deviation_piece_list pieces, const int8_t *side,
                                 border_areas *areas)
{
    size_t rows = QM_SHARE_ROWS * (areas->count + 1);
    long double *work = qm_context_alloc(ctx, rows, sizeof *work);
    if (!work) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the shares");
    qsort(areas->border, areas->count, sizeof *areas->border, qm_deviation_compare_numbers);
    qm_status status = QM_OK;
    for (int k = 0; status == QM_OK && k < areas->group_count; k++)
        status = qm_deviation_find_areas(ctx, pieces, side, (int8_t)(k + QM_PIECE_BEHIND), areas->border,
                                         areas->count, work, areas->within[k]);
    qm_context_free(ctx, work, rows, sizeof *work);
    return status;
}

/** The areas of a group within a number that is one of the borders. */
static qm_deviation_areas areas_within(const border_areas *areas, int group, double x)
{
    const double *at = bsearch(&x, areas->border, areas->count, sizeof x, qm_deviation_compare_numbers);
    QM_ASSERT(at);
    return areas->within[group][at - areas->border];
}

/* ---- limits ---- */

/** The share within a local length by the survey, which counts distances below one. */
static qm_interval survey_share(const qm_deviation_survey *survey, double length)
{
    return (qm_interval){qm_deviation_survey_share(survey, length).lower,
                         qm_deviation_survey_share(survey, nextafter(length, INFINITY)).upper};
}

qm_status qm_deviation_limit_shares(qm_context *ctx, const qm_deviation_piece_list *pieces,
                                    const qm_deviation_survey *survey, double scale, const double *limit,
                                    qm_deviation *out)
{
    size_t count = out->limit_count;
    if (count == 0) return QM_OK;
    border_areas areas;
    qm_status status = borders_init(ctx, &areas, count, 1);
    for (size_t i = 0; status == QM_OK && i < count; i++)
        areas.border[i] = limit[i] * scale;
    if (status == QM_OK && pieces) status = borders_measure(ctx, *pieces, NULL, &areas);
    bool has_areas = pieces && status == QM_OK;
    for (size_t i = 0; status != QM_E_NO_MEMORY && i < count; i++) {
        double length = limit[i] * scale;
        if (limit[i] >= out->max.upper) {
            out->share[i] = (qm_interval){1.0, 1.0};
        } else if (limit[i] < out->least) {
            out->share[i] = (qm_interval){0.0, 0.0};
        } else if (has_areas) {
            const qm_deviation_areas within = areas_within(&areas, 0, length);
            out->share[i] = qm_deviation_share(&within, pieces->leak, pieces->count);
        } else {
            out->share[i] = survey_share(survey, length);
        }
    }
    borders_reset(ctx, &areas);
    return status;
}

/* ---- bands ---- */

/** The sides' groups, and the areas of each within the borders. */
typedef struct band_work {
    const qm_deviation_groups *groups;
    border_areas areas;
} band_work;

/** The areas of a side within a distance; below 0 nothing is, and all is beyond. */
static qm_deviation_areas side_within(const band_work *work, int side, double x)
{
    const long double *all = work->groups->area[side - QM_PIECE_BEHIND];
    if (!(x < 0.0)) return areas_within(&work->areas, side - QM_PIECE_BEHIND, x);
    return (qm_deviation_areas){.most_beyond = all[1], .least_beyond = all[0]};
}

/** The areas of a side with a distance from one number, included, to another. */
static qm_deviation_areas side_between(const band_work *work, int side, double from, double to)
{
    qm_deviation_areas out = side_within(work, side, to);
    if (!(from > 0.0) || to < 0.0) return out;
    qm_deviation_areas below = side_within(work, side, from * BORDER),
                       most_below = side_within(work, side, from);
    out.least_within = fmaxl(0, out.least_within - most_below.most_within);
    out.most_beyond += most_below.most_within;
    out.most_within = fmaxl(0, out.most_within - below.least_within);
    out.least_beyond += below.least_within;
    return out;
}

static void add_areas(qm_deviation_areas *sum, qm_deviation_areas least, qm_deviation_areas most)
{
    sum->least_within += least.least_within;
    sum->most_beyond += least.most_beyond;
    sum->most_within += most.most_within;
    sum->least_beyond += most.least_beyond;
}

/** The areas in a band. An open piece is surely in it where it is on either side, and possibly where it is on one. */
static qm_deviation_areas band_areas(const band_work *work, qm_interval band)
{
    qm_deviation_areas sum = nothing;
    qm_deviation_areas front = side_between(work, QM_PIECE_FRONT, band.lower, band.upper);
    qm_deviation_areas behind = side_between(work, QM_PIECE_BEHIND, -band.upper, -band.lower);
    add_areas(&sum, front, front);
    add_areas(&sum, behind, behind);
    bool has_zero = band.lower <= 0.0 && band.upper >= 0.0;
    double least = has_zero ? fmin(-band.lower, band.upper) : -1.0;
    double from = has_zero ? 0.0 : fmax(band.lower, -band.upper), to = fmax(-band.lower, band.upper);
    add_areas(&sum, side_within(work, QM_PIECE_OPEN, least), side_between(work, QM_PIECE_OPEN, from, to));
    return sum;
}

qm_status qm_deviation_band_shares(qm_context *ctx, qm_deviation_piece_list pieces,
                                   const qm_deviation_groups *groups, const qm_interval *band, size_t count,
                                   qm_interval *share)
{
    band_work work = {.groups = groups};
    qm_status status = borders_init(ctx, &work.areas, BORDERS * count, QM_PIECE_SIDES);
    for (size_t i = 0; status == QM_OK && i < count; i++) {
        const double low = fabs(band[i].lower), high = fabs(band[i].upper);
        const double borders[BORDERS] = {low, low * BORDER, high, high * BORDER};
        memcpy(work.areas.border + BORDERS * i, borders, sizeof borders);
    }
    if (status == QM_OK) status = borders_measure(ctx, pieces, groups->side, &work.areas);
    for (size_t i = 0; status == QM_OK && i < count; i++) {
        const qm_deviation_areas in_band = band_areas(&work, band[i]);
        share[i] = qm_deviation_share(&in_band, pieces.leak, pieces.count);
    }
    borders_reset(ctx, &work.areas);
    return status;
}
