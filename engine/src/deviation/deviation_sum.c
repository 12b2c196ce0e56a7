/**
 * deviation_sum.c: shares of the area within many distances in one pass over the pieces; and the
 * histogram, which is made of them.
 */
#include "deviation_sum.h"

#include <stdlib.h>

#include "core/rounding.h"

#define BORDER_ROUNDINGS 0x1p-50 /* relative: of a quotient and a product, whichever comes first */
/* Of a share of up to 256 cells: 512 terms of 2 in all, and as many steps of 1 in all and their 768 sums. */
#define CELL_ROUNDINGS 4096.0
#define CANCEL_STRIDE 0x400 /* pieces: each may have a part at every distance */

int qm_deviation_compare_numbers(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* ---- shares ---- */

/** How the share of a triangle grows in which a linear function is at most x: value are its values at the
 * corners in order, rise and fall the factors by which the squares of (x - value[0]) and (value[2] - x)
 * become shares. */
typedef struct ramp {
    double value[3], rise, fall;
} ramp;

static ramp make_ramp(const double v[3])
{
    double a = v[0], b = v[1], c = v[2], low = a < b ? a : b, high = a < b ? b : a;
    double min = low < c ? low : c, max = high > c ? high : c;
    double between = high < c ? high : low > c ? low : c;
    double width = max - min;
    return (ramp){{min, between, max},
                  between > min ? 1.0 / ((between - min) * width) : 0.0,
                  max > between ? 1.0 / ((max - between) * width) : 0.0};
}

static double share_within(const ramp *r, double x)
{
    if (x < r->value[1]) return (x - r->value[0]) * (x - r->value[0]) * r->rise;
    return 1.0 - (r->value[2] - x) * (r->value[2] - x) * r->fall;
}

/** The first index whose x is at least value. */
static size_t lower_bound(const double *x, size_t count, double value)
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

/** Areas within and beyond each x, by one of the two linear functions. steps hold the changes from one x to
 * the next: whole pieces, which are most of them, are added at two indices only. */
typedef struct share_sums {
    long double *within, *within_steps, *beyond, *beyond_steps;
} share_sums;

/**
 * The areas of a piece within and beyond, for a share within: whole and density are those of the part within,
 * then of the part beyond. One is the least that it may be, the other the greatest. A part has its share of
 * the density, and all that the other part leaves of the whole.
 */
static void find_areas(double share, const double whole[2], const double density[2], double area[2])
{
    double by_share = share * density[0], by_rest = whole[0] - (1.0 - share) * density[1];
    double beyond_by_share = (1.0 - share) * density[1], beyond_by_rest = whole[1] - share * density[0];
    bool is_least = whole[0] <= whole[1];
    area[0] = is_least ? qm_max(by_share, by_rest) : qm_min(by_share, by_rest);
    area[1] = is_least ? qm_min(beyond_by_share, beyond_by_rest) : qm_max(beyond_by_share, beyond_by_rest);
}

/** Adds the same share from one index to another. */
static void add_span(const share_sums *sums, size_t begin, size_t end, double share, const double area[2][2])
{
    QM_ASSERT(begin <= end);
    double part[2];
    find_areas(share, area[0], area[1], part);
    sums->within_steps[begin] += (long double)part[0];
    sums->within_steps[end] -= (long double)part[0];
    sums->beyond_steps[begin] += (long double)part[1];
    sums->beyond_steps[end] -= (long double)part[1];
}

/** How the share of a piece within x grows: by one of its functions on each side of it, and wrong by no more
 * than invalid at an x below top. */
typedef struct piece_growth {
    ramp side[2];
    int sides;
    double invalid, top;
} piece_growth;

static piece_growth make_growth(const double v[3], const double *flipped, double invalid, double excess)
{
    piece_growth growth = {.side[0] = make_ramp(v), .sides = 1, .invalid = invalid};
    growth.top = growth.side[0].value[2];
    if (flipped) {
        ramp other = make_ramp(flipped);
        /* A side on which nothing lies is left out. */
        if (!(growth.side[0].value[2] > 0.0)) growth.sides = 0;
        if (other.value[2] > 0.0) growth.side[growth.sides++] = other;
        if (growth.sides == 0) growth.sides = 1;
        growth.top = qm_max(growth.top, other.value[2]);
    }
    growth.top += excess;
    return growth;
}

static double share_at(const piece_growth *growth, double x)
{
    double share = 1.0;
    for (int k = 0; k < growth->sides; k++) {
        const ramp *r = &growth->side[k];
        if (x < r->value[2]) share -= x < r->value[0] ? 1.0 : 1.0 - share_within(r, x);
    }
    return share;
}

static double with_invalid(const piece_growth *growth, double share)
{
    return qm_min(1.0, qm_max(0.0, share + growth->invalid));
}

static void add_piece(const share_sums *sums, const piece_growth *growth, const double *x, size_t count,
                      const double area[2][2])
{
    const ramp *one = &growth->side[0], *two = &growth->side[growth->sides - 1];
    size_t begin = growth->sides > 1 ? 0 : lower_bound(x, count, one->value[0]);
    size_t end = begin + lower_bound(x + begin, count - begin, qm_max(one->value[2], two->value[2]));
    size_t top = end + lower_bound(x + end, count - end, growth->top);
    add_span(sums, 0, begin, with_invalid(growth, 0.0), area);
    for (size_t i = begin; i < end; i++) {
        double part[2];
        find_areas(with_invalid(growth, share_at(growth, x[i])), area[0], area[1], part);
        sums->within[i] += (long double)part[0];
        sums->beyond[i] += (long double)part[1];
    }
    add_span(sums, end, top, with_invalid(growth, 1.0), area);
    add_span(sums, top, count, 1.0, area);
}

/** The height at a corner of a cell, opened, as seen from one side; and the first x that is at least as far. */
typedef struct cell_corner {
    double height;
    size_t index;
    int run; /* see find_runs */
} cell_corner;

static void order(const cell_corner **a, const cell_corner **b)
{
    if ((*a)->height < (*b)->height) return;
    const cell_corner *first = *b;
    *b = *a;
    *a = first;
}

/** Adds a cell that has corners within some x and beyond others to the shares within each, as seen from one side:
 * part of it between its lowest and highest corner, all of it from there on. */
static void add_crossed(const cell_corner *low, const cell_corner *between, const cell_corner *high,
                        double part, const double *x, double *share, double *steps)
{
    order(&low, &between);
    order(&between, &high);
    order(&low, &between);
    steps[high->index] += part;
    const double heights[3] = {low->height, between->height, high->height};
    const ramp r = make_ramp(heights);
    double rise = part * r.rise, fall = part * r.fall;
    for (size_t i = low->index; i < between->index; i++)
        share[i] += (x[i] - r.value[0]) * (x[i] - r.value[0]) * rise;
    for (size_t i = between->index; i < high->index; i++)
        share[i] += part - (r.value[2] - x[i]) * (r.value[2] - x[i]) * fall;
}

/** Sets for each corner how many of those after it in its row lie between the same two x. */
static void find_runs(int cells, cell_corner *corner)
{
    for (int j = 0, first = 0; j <= cells; first += cells + 1 - j, j++) {
        int last = first + cells - j;
        corner[last].run = 0;
        for (int i = last - 1; i >= first; i--)
            corner[i].run = corner[i].index == corner[i + 1].index ? corner[i + 1].run + 1 : 0;
    }
}

/** How many cells from an even one of a row on, the corners of which follow from one of its row and one of the row
 * above, lie between the same two x. */
static int count_alike(const cell_corner *row, const cell_corner *above)
{
    if (row->index != above->index) return 0;
    int upright = row->run <= above->run ? row->run : above->run + 1; /* the even ones */
    return upright + (row->run <= above->run ? row->run : above->run);
}

/** Adds all cells as seen from one side: those between the same two x together, which most are. */
static void add_side(int cells, const cell_corner *corner, double part, const double *x, double *share,
                     double *steps)
{
    for (int j = 0; j < cells; j++)
        for (int i = 0, count; i < 2 * (cells - j) - 1; i += count) {
            int c[3];
            qm_quadratic_cell(cells, j, i, c);
            const cell_corner *one = &corner[c[0]], *two = &corner[c[1]], *three = &corner[c[2]];
            count = i % 2 ? one->index == two->index && one->index == three->index : count_alike(one, three);
            if (count > 0) {
                steps[one->index] += part * count;
            } else {
                add_crossed(one, two, three, part, x, share, steps);
                count = 1;
            }
        }
}

/** The first index whose x is at least a height: mostly that of the corner before. */
static size_t find_index(const double *x, size_t count, double height, size_t before)
{
    bool is_same = (before == count || x[before] >= height) && (before == 0 || x[before - 1] < height);
    return is_same ? before : lower_bound(x, count, height);
}

/** Adds the cells of a height, opened by above, and its opposite by below: a point is within x if both are. */
static void add_cells(int cells, const double at[QM_QUADRATIC_CORNERS], double above, double below,
                      const double *x, size_t count, double *share, double *steps)
{
    int corners = (cells + 1) * (cells + 2) / 2;
    double part = 1.0 / (double)(cells * cells), least = at[0], greatest = at[0];
    for (int i = 1; i < corners; i++) {
        least = qm_min(least, at[i]);
        greatest = qm_max(greatest, at[i]);
    }
    for (int k = 0; k < 2; k++) {
        if (!((k ? below - least : greatest + above) > 0.0)) {
            steps[0] += part * (cells * cells); /* nothing lies on this side */
            continue;
        }
        cell_corner corner[QM_QUADRATIC_CORNERS];
        size_t index = 0;
        for (int i = 0; i < corners; i++) {
            double height = k ? below - at[i] : at[i] + above;
            if (height > 0.0) index = find_index(x, count, height, index);
            corner[i] = (cell_corner){height, height > 0.0 ? index : 0, 0};
        }
        find_runs(cells, corner);
        add_side(cells, corner, part, x, share, steps);
    }
    steps[0] -= part * (cells * cells); /* two sides count each cell twice */
}

/** The range of the distances over a piece whose height bends: a quadratic lies between its Bezier points. */
static qm_interval bent_range(const qm_quadratic *bend)
{
    double low = bend->value[0], high = bend->value[0];
    for (int i = 1; i < 6; i++) {
        low = qm_min(low, bend->value[i]);
        high = qm_max(high, bend->value[i]);
    }
    low -= bend->below;
    high += bend->above;
    return (qm_interval){qm_max(0.0, qm_max(low, -high)), qm_max(high, -low)};
}

/** The heights at the corners of the cells of a piece, once they are needed. */
typedef struct cell_heights {
    bool is_set;
    double at[QM_QUADRATIC_CORNERS];
} cell_heights;

/** Adds a piece whose height bends, cell by cell where it lies within some x and beyond others; rows has room
 * for count + 1 shares and steps. */
static void add_bent(const share_sums *sums, const qm_deviation_bounds *piece, cell_heights *heights,
                     bool from_above, const double *x, size_t count, const double area[2][2], double *rows)
{
    const qm_quadratic *bend = &piece->bend;
    const piece_growth whole = {.invalid = from_above ? -piece->invalid_high : piece->invalid_low};
    qm_interval range = bent_range(bend);
    size_t begin = lower_bound(x, count, range.lower);
    size_t end = begin + lower_bound(x + begin, count - begin, range.upper);
    size_t top = end + lower_bound(x + end, count - end, range.upper + (from_above ? piece->excess : 0.0));
    add_span(sums, 0, begin, with_invalid(&whole, 0.0), area);
    add_span(sums, end, top, with_invalid(&whole, 1.0), area);
    add_span(sums, top, count, 1.0, area);
    if (begin == end) return;
    double *share = rows, *steps = rows + (end - begin + 1), sum = 0.0;
    for (size_t i = 0; i < 2 * (end - begin + 1); i++)
        rows[i] = 0.0;
    double open[2];
    qm_quadratic_cells_open(bend, open);
    if (!heights->is_set) qm_quadratic_values(bend, heights->at);
    heights->is_set = true;
    add_cells(bend->cells, heights->at, from_above ? open[1] : -open[0], from_above ? open[0] : -open[1],
              x + begin, end - begin, share, steps);
    for (size_t i = begin; i < end; i++) {
        double within[2];
        sum += steps[i - begin];
        find_areas(with_invalid(&whole, share[i - begin] + sum), area[0], area[1], within);
        sums->within[i] += (long double)within[0];
        sums->beyond[i] += (long double)within[1];
    }
}

static void prefix_sums(const share_sums *sums, size_t count)
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

qm_status qm_deviation_find_areas(qm_context *ctx, qm_deviation_piece_list pieces, const int8_t *group,
                                  int8_t wanted, const double *x, size_t count, long double *work,
                                  qm_deviation_areas *areas)
{
    share_sums low = make_sums(work, count), high = make_sums(work + 4 * (count + 1), count);
    for (size_t i = 0; i < pieces.count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "deviation canceled");
        if (group && group[i] != wanted) continue;
        const qm_deviation_bounds *piece = &pieces.bounds[i];
        const double area[2][2] = {{piece->area_low, piece->area_high},
                                   {piece->density_low, piece->density_high}};
        const double other[2][2] = {{piece->area_high, piece->area_low},
                                    {piece->density_high, piece->density_low}};
        if (piece->bend.cells > 1) {
            cell_heights heights;
            heights.is_set = false;
            add_bent(&low, piece, &heights, true, x, count, area, (double *)(work + 8 * (count + 1)));
            add_bent(&high, piece, &heights, false, x, count, other, (double *)(work + 8 * (count + 1)));
            continue;
        }
        double flipped_low[3], flipped_high[3];
        qm_deviation_bounds_flip(piece, flipped_low, flipped_high);
        piece_growth surely = make_growth(piece->high, piece->is_signed ? flipped_high : NULL,
                                          -piece->invalid_high, piece->excess);
        piece_growth possibly =
            make_growth(piece->low, piece->is_signed ? flipped_low : NULL, piece->invalid_low, 0.0);
        add_piece(&low, &surely, x, count, area);
        add_piece(&high, &possibly, x, count, other);
    }
    prefix_sums(&low, count);
    prefix_sums(&high, count);
    for (size_t i = 0; i < count; i++)
        areas[i] = (qm_deviation_areas){low.within[i], low.beyond[i], high.within[i], high.beyond[i]};
    return QM_OK;
}

/** The share within when so much area besides is within, and not beyond as counted. */
static double share_of(long double within, long double beyond, double more)
{
    within = fmaxl(0, within + (long double)more);
    beyond = fmaxl(0, beyond - (long double)more);
    return within + beyond > 0 ? (double)(within / (within + beyond)) : 0.0;
}

double qm_deviation_share_error(size_t piece_count)
{
    return qm_deviation_sum_error(piece_count) + CELL_ROUNDINGS * QM_UNIT_ROUNDING;
}

qm_interval qm_deviation_share(const qm_deviation_areas *areas, double leak, size_t piece_count)
{
    double error = qm_deviation_share_error(piece_count);
    return (qm_interval){fmax(0.0, share_of(areas->least_within, areas->most_beyond, -leak) - error),
                         fmin(1.0, share_of(areas->most_within, areas->least_beyond, leak) + error)};
}

qm_status qm_deviation_shares(qm_context *ctx, qm_deviation_piece_list pieces, const double *x, size_t count,
                              long double *work, qm_interval *share)
{
    qm_deviation_areas *areas = qm_context_alloc(ctx, count, sizeof *areas);
    if (!areas && count > 0) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the shares");
    qm_status status = qm_deviation_find_areas(ctx, pieces, NULL, 0, x, count, work, areas);
    for (size_t i = 0; status == QM_OK && i < count; i++)
        share[i] = qm_deviation_share(&areas[i], pieces.leak, pieces.count);
    qm_context_free(ctx, areas, count, sizeof *areas);
    return status;
}

/* ---- histogram ---- */

/** Share of the area with a distance below border i. Two samples stand for it, just below and just above. */
static qm_interval share_below(const qm_interval *share, size_t i, size_t count)
{
    if (i == 0) return (qm_interval){0.0, 0.0};
    if (i == count) return (qm_interval){1.0, 1.0};
    return (qm_interval){share[2 * i].lower, share[2 * i + 1].upper};
}

qm_status qm_deviation_histogram(qm_context *ctx, const qm_deviation_piece_list *pieces,
                                 const qm_deviation_survey *survey, double max, size_t count,
                                 qm_interval *out)
{
    if (count == 0) return QM_OK;
    size_t samples = 2 * count;
    double *x = qm_context_alloc(ctx, samples, sizeof *x);
    qm_interval *share = qm_context_alloc(ctx, samples, sizeof *share);
    long double *work = qm_context_alloc(ctx, QM_SHARE_ROWS * (samples + 1), sizeof *work);
    qm_status status = QM_E_NO_MEMORY;
    if (x && share && work) {
        for (size_t i = 0; i < count; i++) {
            double border = max * (double)i / (double)count;
            x[2 * i + 1] = border * (1.0 + BORDER_ROUNDINGS);
            x[2 * i] = border * (1.0 - BORDER_ROUNDINGS);
        }
        status = pieces ? qm_deviation_shares(ctx, *pieces, x, samples, work, share) : QM_OK;
        for (size_t i = 0; (!pieces || status != QM_OK) && i < samples; i++)
            share[i] = qm_deviation_survey_share(survey, x[i]);
        for (size_t i = 0; i < count; i++) {
            qm_interval from = share_below(share, i, count), to = share_below(share, i + 1, count);
            out[i] = (qm_interval){fmax(0.0, to.lower - from.upper), fmin(1.0, to.upper - from.lower)};
        }
    }
    qm_context_free(ctx, x, samples, sizeof *x);
    qm_context_free(ctx, share, samples, sizeof *share);
    qm_context_free(ctx, work, QM_SHARE_ROWS * (samples + 1), sizeof *work);
    return status == QM_E_NO_MEMORY ? qm_context_fail(ctx, status, "out of memory for the histogram")
                                    : status;
}
