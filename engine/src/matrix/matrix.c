/**
 * matrix.c: the distances of all pairs of a set: bounds by boxes and by the triangle inequality, and which pair is measured
 * next.
 *
 * Roundings: the measured bounds are taken as they are. A bound that is made of two of them is rounded outward unless it is
 * exact, by subtract_down and add_up; no other arithmetic touches a bound.
 */
#include "qm/matrix.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"

/* Pivots pay as long as they decide several times as many pairs as they measure: most of the others would be decided by a short
 * search with a threshold. One pivot alone tells only how far apart rings around it are, so two are tried. They need not be
 * measured to the tolerance, but to a share of the limit, or of the width of the set. */
#define MAX_PIVOTS 16
#define MIN_PIVOTS 2
#define PIVOT_GAIN 4
#define PAIRS_FOR_A_PIVOT 2 /* open pairs for each item, without which no pivot is tried */
#define SHARE_OF_LIMIT 0.125
#define SHARE_OF_WIDTH 0x1p-6
#define BOX_ROUNDING 0x1p-50 /* relative: qm_mesh_box_diagonal has four roundings on the way to its result */

/** What was done about a pair. */
enum { UNTOUCHED, MEASURED, FINAL };

/** A call. */
typedef struct run {
    qm_context *ctx;
    const qm_matrix_options *options;
    qm_matrix *out;
    double start_ms;
    double *uppers, *reach; /* room for count each */
} run;

/* ---- bounds ---- */

/** The difference of a finite number and another one, or the double below it. The error of a rounded difference is a double itself
 * (Knuth's two-sum), so its sign says whether the rounding was upward. Without a finite difference it is NaN: one that overflows
 * is above the largest double, and one with an infinite b is right as it is. */
static double subtract_down(double a, double b)
{
    double difference = a - b, part = difference - a;
    double error = (a - (difference - part)) - (b + part);
    if (difference == INFINITY) return DBL_MAX;
    return error < 0.0 ? nextafter(difference, -INFINITY) : difference;
}

/** The sum of two numbers of 0 or more, or the double above it. */
static double add_up(double a, double b)
{
    double sum = a + b, part = sum - a;
    double error = (a - (sum - part)) + (b - part);
    return error > 0.0 ? nextafter(sum, INFINITY) : sum;
}

/**
 * Lower: each side of the box of a has a point of a on it, and no point of b is beyond the same side of its own box: so the
 * distance of the sides is a bound, from a or from b, whichever is outside. Upper: no two points of the boxes are farther apart
 * than the far sides on every axis.
 */
void qm_matrix_bound_by_boxes(const qm_box *a, const qm_box *b, double *lower, double *upper)
{
    qm_box reach = {{0, 0, 0}, {0, 0, 0}};
    *lower = 0.0;
    for (int k = 0; k < 3; k++) {
        double low = fmax(subtract_down(a->min[k], b->min[k]), subtract_down(b->min[k], a->min[k]));
        double high = fmax(subtract_down(a->max[k], b->max[k]), subtract_down(b->max[k], a->max[k]));
        *lower = fmax(*lower, fmax(low, high));
        reach.max[k] = -fmin(subtract_down(b->min[k], a->max[k]), subtract_down(a->min[k], b->max[k]));
    }
    double length = qm_mesh_box_diagonal(&reach);
    *upper = length > 0.0 ? nextafter(length * (1.0 + BOX_ROUNDING), INFINITY) : 0.0;
}

/** Narrows the bounds of a pair. */
static void narrow(qm_matrix *m, size_t pair, double lower, double upper)
{
    m->lower[pair] = fmax(m->lower[pair], lower);
    m->upper[pair] = fmin(m->upper[pair], upper);
}

/** Bounds the distance of two items by their distances from a third one. */
static void narrow_over(qm_matrix *m, size_t a, size_t b, size_t over)
{
    size_t first = qm_matrix_pair(m->count, a, over), second = qm_matrix_pair(m->count, over, b);
    narrow(m, qm_matrix_pair(m->count, a, b),
           fmax(subtract_down(m->lower[first], m->upper[second]),
                subtract_down(m->lower[second], m->upper[first])),
           add_up(m->upper[first], m->upper[second]));
}

/** Bounds the pairs of a third item with the two of a pair that was measured. */
static void spread(qm_matrix *m, size_t a, size_t b)
{
    for (size_t i = 0; i < m->count; i++) {
        if (i == a || i == b) continue;
        narrow_over(m, a, i, b);
        narrow_over(m, b, i, a);
    }
}

static double width_of(const qm_matrix *m, size_t pair)
{
    return m->upper[pair] - m->lower[pair];
}

static void set_first_bounds(const qm_matrix_options *options, qm_matrix *m)
{
    for (size_t a = 0; a < m->count; a++)
        for (size_t b = a + 1; b < m->count; b++) {
            size_t pair = qm_matrix_pair(m->count, a, b);
            bool is_same = options->same && options->same[a] == options->same[b];
            m->state[pair] = UNTOUCHED;
            m->lower[pair] = 0.0;
            m->upper[pair] = is_same ? 0.0 : INFINITY;
            if (options->boxes && !is_same)
                qm_matrix_bound_by_boxes(&options->boxes[a], &options->boxes[b], &m->lower[pair],
                                         &m->upper[pair]);
        }
}

/* ---- what is open ---- */

static int compare(const void *a, const void *b)
{
    double first = *(const double *)a, second = *(const double *)b;
    return first < second ? -1 : first > second;
}

/** The largest distance that an item of the list of this one can have: the upper bound of rank `nearest`. */
static double find_reach(run *r, size_t item)
{
    const qm_matrix *m = r->out;
    size_t count = 0;
    for (size_t i = 0; i < m->count; i++)
        if (i != item) r->uppers[count++] = m->upper[qm_matrix_pair(m->count, item, i)];
    qsort(r->uppers, count, sizeof *r->uppers, compare);
    return r->uppers[r->options->nearest - 1];
}

/** True when a pair is not known as well as the options want: by its own, or for the list of an item with this reach. */
static bool is_open(const run *r, size_t pair, double reach)
{
    const qm_matrix *m = r->out;
    double lower = m->lower[pair], upper = m->upper[pair], limit = r->options->limit;
    if (r->options->want == QM_MATRIX_WITHIN) return lower <= limit && upper > limit;
    bool is_wide = width_of(m, pair) > r->options->tolerance;
    return is_wide && (r->options->want == QM_MATRIX_ALL || lower < reach);
}

/** Writes for each item the reach of its list, if it is to have one. */
static void find_reaches(run *r)
{
    for (size_t item = 0; item < r->out->count; item++)
        r->reach[item] = r->options->want == QM_MATRIX_NEAREST ? find_reach(r, item) : INFINITY;
}

/** Counts the pairs that are open, for one of their items or both, and those of the others that were not measured. */
static size_t count_open(run *r, size_t *bounded)
{
    const qm_matrix *m = r->out;
    size_t open = 0;
    *bounded = 0;
    find_reaches(r);
    for (size_t a = 0; a < m->count; a++)
        for (size_t b = a + 1; b < m->count; b++) {
            size_t pair = qm_matrix_pair(m->count, a, b);
            if (is_open(r, pair, fmax(r->reach[a], r->reach[b])))
                open++;
            else if (m->state[pair] == UNTOUCHED)
                (*bounded)++;
        }
    return open;
}

/* ---- measuring ---- */

/** What is left of the time, in milliseconds; 0 without a deadline. */
static double time_left(const run *r)
{
    double deadline = r->options->deadline_ms;
    return deadline > 0.0 ? fmax(deadline - (qm_clock_ms() - r->start_ms), 0x1p-10) : 0.0;
}

static bool is_stopped(run *r)
{
    double deadline = r->options->deadline_ms;
    if (r->out->stop != QM_MATRIX_DONE) return true;
    if (qm_context_canceled(r->ctx))
        r->out->stop = QM_MATRIX_CANCELED;
    else if (deadline > 0.0 && qm_clock_ms() - r->start_ms >= deadline)
        r->out->stop = QM_MATRIX_DEADLINE;
    return r->out->stop != QM_MATRIX_DONE;
}

/** Measures a pair. It is final when no further measurement would do better: it was measured to the tolerance, against the limit
 * if there is one, and neither a threshold of another kind nor a limit of time ended that. */
static qm_status measure(run *r, size_t a, size_t b, double tolerance, double threshold)
{
    qm_matrix *m = r->out;
    size_t pair = qm_matrix_pair(m->count, a, b);
    const qm_matrix_question question = {a < b ? a : b, a < b ? b : a, tolerance, threshold, time_left(r)};
    qm_matrix_answer answer;
    qm_status status = r->options->measure(r->options->user, &question, &answer);
    if (status != QM_OK) return status;
    m->searches++;
    if (m->state[pair] == UNTOUCHED) m->searched++;
    bool has_verdict = answer.upper <= threshold || answer.lower > threshold;
    bool lacks_limit = r->options->want == QM_MATRIX_WITHIN && isnan(threshold);
    bool goes_on = answer.is_stopped || tolerance > r->options->tolerance || has_verdict || lacks_limit;
    m->state[pair] = goes_on ? MEASURED : FINAL;
    narrow(m, pair, answer.lower, answer.upper);
    spread(m, a, b);
    if (answer.is_stopped && !is_stopped(r)) m->stop = QM_MATRIX_DEADLINE;
    if (r->options->progress) r->options->progress(r->options->user, m, question.a, question.b);
    return QM_OK;
}

/* ---- pivots ---- */

/** The item that is farthest from all pivots, of which `nearest` has the upper bounds. */
static size_t find_farthest(const double *nearest, size_t count)
{
    size_t farthest = 0;
    for (size_t i = 1; i < count; i++)
        if (nearest[i] > nearest[farthest]) farthest = i;
    return farthest;
}

/** How far the pairs of pivots are narrowed. */
static double pivot_tolerance(const run *r)
{
    const qm_matrix *m = r->out;
    double widest = 0.0;
    if (r->options->want == QM_MATRIX_ALL) return r->options->tolerance;
    if (r->options->want == QM_MATRIX_WITHIN)
        return fmax(r->options->tolerance, SHARE_OF_LIMIT * r->options->limit);
    for (size_t pair = 0; pair < m->pair_count; pair++)
        widest = fmax(widest, m->lower[pair]);
    return fmax(r->options->tolerance, SHARE_OF_WIDTH * widest);
}

/** Measures the pairs of a pivot that need it. */
static qm_status measure_pivot(run *r, size_t pivot, double *nearest)
{
    qm_matrix *m = r->out;
    double tolerance = pivot_tolerance(r);
    nearest[pivot] = 0.0;
    m->pivots++;
    for (size_t i = 0; i < m->count; i++) {
        if (i == pivot) continue;
        size_t pair = qm_matrix_pair(m->count, pivot, i);
        if (width_of(m, pair) > tolerance && m->state[pair] != FINAL) {
            if (is_stopped(r)) return QM_OK;
            qm_status status = measure(r, pivot, i, tolerance, NAN);
            if (status != QM_OK) return status;
        }
        nearest[i] = fmin(nearest[i], m->upper[pair]);
    }
    return QM_OK;
}

/** Measures pivots while they pay. `nearest` is room for count. */
static qm_status measure_pivots(run *r, double *nearest)
{
    qm_matrix *m = r->out;
    size_t open = count_open(r, &m->bounded);
    for (size_t i = 0; i < m->count; i++)
        nearest[i] = INFINITY;
    while (m->pivots < MAX_PIVOTS && open > PAIRS_FOR_A_PIVOT * m->count && !is_stopped(r)) {
        size_t pivot = find_farthest(nearest, m->count), before = m->searches;
        if (nearest[pivot] == 0.0) break; /* every item equals a pivot */
        qm_status status = measure_pivot(r, pivot, nearest);
        if (status != QM_OK) return status;
        size_t cost = m->searches - before, was_open = open;
        open = count_open(r, &m->bounded);
        if (m->pivots >= MIN_PIVOTS && was_open - open <= PIVOT_GAIN * cost) break;
    }
    return QM_OK;
}

/* ---- what is left after the pivots ---- */

/** Measures the pairs that are open, row by row, and every second row backward: so the items that were measured last are soon
 * measured again, which a host that keeps only some of them in memory has then. */
static qm_status measure_rows(run *r)
{
    qm_matrix *m = r->out;
    bool has_limit = r->options->want == QM_MATRIX_WITHIN;
    for (size_t a = 0; a < m->count; a++)
        for (size_t step = a + 1; step < m->count; step++) {
            size_t b = a % 2 == 0 ? step : m->count - (step - a), pair = qm_matrix_pair(m->count, a, b);
            if (m->state[pair] == FINAL || !is_open(r, pair, INFINITY)) continue;
            if (is_stopped(r)) return QM_OK;
            qm_status status = measure(r, a, b, r->options->tolerance, has_limit ? r->options->limit : NAN);
            if (status != QM_OK) return status;
        }
    return QM_OK;
}

/** The pair of an item with the least lower bound of those that are open and can be narrowed; false if there is none. *rank is the
 * number of other items whose lower bound is not larger. */
static bool find_next(const run *r, size_t item, double reach, size_t *other, size_t *rank)
{
    const qm_matrix *m = r->out;
    double least = INFINITY;
    *other = item;
    for (size_t i = 0; i < m->count; i++) {
        size_t pair = i == item ? 0 : qm_matrix_pair(m->count, item, i);
        if (i == item || m->state[pair] == FINAL || !is_open(r, pair, reach) || m->lower[pair] >= least)
            continue;
        least = m->lower[pair];
        *other = i;
    }
    *rank = 0;
    for (size_t i = 0; i < m->count; i++)
        if (i != item && i != *other && m->lower[qm_matrix_pair(m->count, item, i)] <= least) (*rank)++;
    return *other != item;
}

/** Measures until every item that may be in the list is known to the tolerance. One that is likely to be in it, because few have a
 * lower bound as small, is measured to the tolerance at once; another one until it is known to be out, and further only if it
 * is in. */
static qm_status measure_list(run *r, size_t item)
{
    qm_matrix *m = r->out;
    for (;;) {
        double reach = find_reach(r, item);
        size_t other, rank;
        if (!find_next(r, item, reach, &other, &rank) || is_stopped(r)) return QM_OK;
        bool may_be_out = rank >= r->options->nearest && isfinite(reach) &&
                          m->state[qm_matrix_pair(m->count, item, other)] == UNTOUCHED;
        qm_status status = measure(r, item, other, r->options->tolerance, may_be_out ? reach : NAN);
        if (status != QM_OK) return status;
    }
}

static qm_status measure_rest(run *r)
{
    if (r->options->want != QM_MATRIX_NEAREST) return measure_rows(r);
    qm_status status = QM_OK;
    for (size_t item = 0; item < r->out->count && status == QM_OK && !is_stopped(r); item++)
        status = measure_list(r, item);
    return status;
}

/* ---- lists ---- */

/** By upper bounds: then no item of a list is farther than the reach that measure_list kept others out by. */
static int compare_near(const void *first, const void *second)
{
    const qm_matrix_near *a = first, *b = second;
    if (a->upper != b->upper) return a->upper < b->upper ? -1 : 1;
    if (a->lower != b->lower) return a->lower < b->lower ? -1 : 1;
    return a->item < b->item ? -1 : 1;
}

/** The place of one item among the sorted others of a list. */
static qm_matrix_place find_place(const qm_matrix_near *sorted, size_t count, size_t at, double tolerance)
{
    qm_matrix_place place = QM_MATRIX_PROVEN;
    const qm_matrix_near *own = &sorted[at];
    for (size_t i = 0; i < count; i++) {
        const qm_matrix_near *other = &sorted[i];
        bool is_proven = i < at ? other->upper <= own->lower : i == at || other->lower >= own->upper;
        if (is_proven) continue;
        bool are_known = own->upper - own->lower <= tolerance && other->upper - other->lower <= tolerance;
        if (!are_known) return QM_MATRIX_OPEN;
        place = QM_MATRIX_TIED;
    }
    return place;
}

size_t qm_matrix_list_nearest(const qm_matrix *matrix, size_t item, size_t limit, double tolerance,
                              qm_matrix_near *out)
{
    size_t count = 0;
    for (size_t i = 0; i < matrix->count; i++) {
        if (i == item) continue;
        size_t pair = qm_matrix_pair(matrix->count, item, i);
        out[count++] =
            (qm_matrix_near){.item = i, .lower = matrix->lower[pair], .upper = matrix->upper[pair]};
    }
    qsort(out, count, sizeof *out, compare_near);
    size_t listed = limit < count ? limit : count;
    for (size_t i = 0; i < listed; i++)
        out[i].place = find_place(out, count, i, tolerance);
    return listed;
}

static size_t count_open_lists(const run *r, qm_matrix_near *room)
{
    size_t open = 0;
    for (size_t item = 0; item < r->out->count; item++) {
        size_t count = qm_matrix_list_nearest(r->out, item, r->options->nearest, r->options->tolerance, room);
        size_t i = 0;
        while (i < count && room[i].place != QM_MATRIX_OPEN)
            i++;
        if (i < count) open++;
    }
    return open;
}

/* ---- the call ---- */

static bool are_valid(const qm_matrix_options *options)
{
    bool has_number =
        options->want != QM_MATRIX_NEAREST || (options->nearest > 0 && options->nearest < options->count);
    bool has_limit = options->want != QM_MATRIX_WITHIN || options->limit >= 0.0;
    return options->measure && options->count >= 2 && options->tolerance > 0.0 && has_number && has_limit;
}

void qm_matrix_reset(qm_context *ctx, qm_matrix *matrix)
{
    qm_context_free(ctx, matrix->lower, matrix->pair_count, sizeof *matrix->lower);
    qm_context_free(ctx, matrix->upper, matrix->pair_count, sizeof *matrix->upper);
    qm_context_free(ctx, matrix->state, matrix->pair_count, sizeof *matrix->state);
    *matrix = (qm_matrix){0};
}

qm_status qm_matrix_measure(qm_context *ctx, const qm_matrix_options *options, qm_matrix *out)
{
    QM_ASSERT(ctx && options && out);
    *out = (qm_matrix){0};
    if (!are_valid(options))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the options of a matrix are not valid");
    size_t count = options->count, pair_count = count * (count - 1) / 2;
    *out = (qm_matrix){.count = count,
                       .pair_count = pair_count,
                       .lower = qm_context_alloc(ctx, pair_count, sizeof *out->lower),
                       .upper = qm_context_alloc(ctx, pair_count, sizeof *out->upper),
                       .state = qm_context_alloc(ctx, pair_count, sizeof *out->state)};
    qm_matrix_near *room = qm_context_alloc(ctx, count, sizeof *room);
    double *uppers = qm_context_alloc(ctx, count, sizeof *uppers),
           *reach = qm_context_alloc(ctx, count, sizeof *reach),
           *nearest = qm_context_alloc(ctx, count, sizeof *nearest);
    run r = {ctx, options, out, qm_clock_ms(), uppers, reach};
    qm_status status = QM_E_NO_MEMORY;
    if (out->lower && out->upper && out->state && room && uppers && reach && nearest) {
        set_first_bounds(options, out);
        status = measure_pivots(&r, nearest);
        if (status == QM_OK) status = measure_rest(&r);
        out->open = count_open(&r, &out->bounded);
        if (options->want == QM_MATRIX_NEAREST) out->open = count_open_lists(&r, room);
    }
    out->elapsed_ms = qm_clock_ms() - r.start_ms;
    qm_context_free(ctx, room, count, sizeof *room);
    qm_context_free(ctx, uppers, count, sizeof *uppers);
    qm_context_free(ctx, reach, count, sizeof *reach);
    qm_context_free(ctx, nearest, count, sizeof *nearest);
    if (status != QM_OK) qm_matrix_reset(ctx, out);
    return status;
}
