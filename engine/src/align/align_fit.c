/**
 * align_fit.c: least squares: the pose near a first one that makes the mean square of the distances least.
 *
 * Gauss-Newton on the distances themselves: the gradient of a distance is the unit vector from the foot, or the normal
 * where a point lies on the surface, which is point to plane. Without a normal (point sets, faces without area) the square
 * of the distance has the three equations of point to point. Damping (Levenberg) guards steps that would not lower the mean, and
 * keeps a motion that changes no distance, as the turn of a cylinder, at rest.
 */
#include "align_work.h"

#include <stdlib.h>

#include "core/linear.h"

#define MIN_DAMPING 1e-9 /* above the pivots that qm_linear_solve takes for roundings */
#define MAX_DAMPING 1e6
#define MIN_STEP 1e-13 /* in the unit of the frames, about the diagonal */
#define BEHIND 1e-3    /* of the difference of two means */
#define MIN_GAIN 1e-10 /* a shorter step that does not lower the mean is lost in the mean's roundings */

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/** The distances up to which pairs count, and which share of them does. */
typedef struct cut {
    double distance; /* farther pairs do not count */
    double excess;   /* what such a pair adds to the sum of squares */
} cut;

/** The cut of the pairs at hand. Trimmed pairs add nothing: their number is fixed; pairs beyond the greatest distance add its
 * square, so that a step that leaves points behind does not look better. */
static cut find_cut(qm_align_work *work, bool is_last)
{
    const qm_align_options *options = work->options;
    cut c = {INFINITY, 0.0};
    if (options->trim > 0.0) {
        for (size_t i = 0; i < work->pair_count; i++)
            work->numbers[i] = work->pairs[i].distance;
        qsort(work->numbers, work->pair_count, sizeof *work->numbers, compare);
        const size_t kept = (size_t)ceil((1.0 - options->trim) * (double)work->pair_count);
        c.distance = work->numbers[kept > 0 ? kept - 1 : 0];
    }
    const double most = options->max_distance / work->frames.unit;
    if (is_last && most < c.distance) c = (cut){most, most * most};
    return c;
}

/** The mean that steps lower, and the root mean square of the pairs that count. */
static double mean_square(const qm_align_work *work, const cut *c, double *rms)
{
    double sum = 0.0, excess = 0.0;
    size_t kept = 0;
    for (size_t i = 0; i < work->pair_count; i++) {
        const double d = work->pairs[i].distance;
        if (d <= c->distance) {
            sum += d * d;
            kept++;
        } else {
            excess += c->excess;
        }
    }
    *rms = kept > 0 ? sqrt(sum / (double)kept) : INFINITY;
    return (sum + excess) / (double)work->pair_count;
}

/** The three equations of point to point. */
static void add_point(qm_least_squares *sums, const qm_align_pair *pair, qm_vec center, const int *index)
{
    qm_align_pair along = *pair;
    const qm_vec difference = qm_vec_sub(pair->moved, pair->y);
    const double right[3] = {difference.x, difference.y, difference.z};
    for (int k = 0; k < 3; k++) {
        double row[QM_ALIGN_UNKNOWNS], chosen[QM_ALIGN_UNKNOWNS];
        along.direction = (qm_vec){k == 0, k == 1, k == 2};
        qm_align_row(&along, center, row);
        for (int i = 0; i < sums->count; i++)
            chosen[i] = row[index[i]];
        qm_linear_add(sums, chosen, -right[k], 1.0);
    }
}

/** The normal equations of the pairs that count. */
static qm_least_squares make_equations(const qm_align_work *work, const cut *c, qm_vec center)
{
    int index[QM_ALIGN_UNKNOWNS];
    qm_least_squares sums = {.count = qm_align_unknowns(work->options->motion, index)};
    const bool is_set[2] = {qm_bvh_mesh(work->tree[0])->face_count == 0,
                            qm_bvh_mesh(work->tree[1])->face_count == 0};
    for (size_t i = 0; i < work->pair_count; i++) {
        const qm_align_pair *pair = &work->pairs[i];
        if (pair->distance > c->distance) continue;
        if (is_set[1 - pair->side] || qm_vec_norm2(pair->direction) == 0.0) {
            add_point(&sums, pair, center, index);
            continue;
        }
        double row[QM_ALIGN_UNKNOWNS], chosen[QM_ALIGN_UNKNOWNS];
        qm_align_row(pair, center, row);
        for (int k = 0; k < sums.count; k++)
            chosen[k] = row[index[k]];
        qm_linear_add(&sums, chosen, -pair->offset, 1.0);
    }
    return sums;
}

/** Solves with a damping; false when there is no finite solution. */
static bool solve(const qm_align_work *work, const qm_least_squares *sums, double damping, qm_align_step *out)
{
    int index[QM_ALIGN_UNKNOWNS];
    qm_align_unknowns(work->options->motion, index);
    qm_least_squares damped = *sums;
    double largest = 0.0, x[QM_ALIGN_UNKNOWNS], all[QM_ALIGN_UNKNOWNS] = {0};
    for (int i = 0; i < sums->count; i++)
        largest = qm_max(largest, sums->matrix[i][i]);
    for (int i = 0; i < sums->count; i++)
        damped.matrix[i][i] += damping * largest;
    if (!qm_linear_solve(&damped, x)) return false;
    bool is_finite = true;
    for (int i = 0; i < sums->count; i++) {
        all[index[i]] = x[i];
        is_finite = is_finite && isfinite(x[i]);
    }
    *out = qm_align_step_of(all);
    return is_finite;
}

static qm_vec center_of_pairs(const qm_align_work *work)
{
    qm_vec sum = {0, 0, 0};
    for (size_t i = 0; i < work->pair_count; i++)
        sum = qm_vec_add(sum, work->pairs[i].moved);
    return qm_vec_scale(1.0 / (double)work->pair_count, sum);
}

/** A turn of more than a radian, or a scale of more than e, is cut to that: the equations know nothing so far away. */
static void shorten(qm_align_step *step)
{
    const double most = qm_max(qm_vec_norm(step->turn), fabs(step->scale));
    if (most <= 1.0) return;
    step->turn = qm_vec_scale(1.0 / most, step->turn);
    step->shift = qm_vec_scale(1.0 / most, step->shift);
    step->scale /= most;
}

/** Whether a pose stays behind its rival: the last step, a whole one, has taken a small share of what is between them. Steps
 * become shorter by about a constant factor, so that hundreds of them would be needed. */
static bool stays_behind(double before, double mean, double rival)
{
    const double between = mean - rival * rival;
    return rival > 0.0 && between > 0.0 && before - mean < BEHIND * between;
}

qm_status qm_align_improve(qm_align_work *work, const qm_align_pose *start, const qm_align_effort *effort,
                           qm_align_found *out)
{
    const size_t count = effort->count;
    const int max_steps = effort->max_steps;
    const bool is_last = effort->is_last;
    *out = (qm_align_found){.pose = *start};
    qm_status status = qm_align_measure(work, start, count, NULL, 0);
    if (status != QM_OK) return status;
    cut c = find_cut(work, is_last);
    double mean = mean_square(work, &c, &out->rms), damping = MIN_DAMPING;
    bool is_behind = false;
    for (int i = 0; i < max_steps && !out->is_converged && !is_behind; i++) {
        const qm_vec center = center_of_pairs(work);
        const qm_least_squares sums = make_equations(work, &c, center);
        bool is_lower = false, is_moved = false;
        while (!is_lower && !out->is_converged) {
            qm_align_step step;
            if (!solve(work, &sums, damping, &step)) {
                out->is_converged = true; /* no pair counts, or none says where to go */
                break;
            }
            shorten(&step);
            const double length = qm_vec_norm(step.turn) + qm_vec_norm(step.shift) + fabs(step.scale);
            if (length < MIN_STEP) {
                out->is_converged = true;
                break;
            }
            const qm_align_pose next = qm_align_pose_change(&out->pose, center, &step);
            work->iterations++;
            is_moved = true;
            status = qm_align_measure(work, &next, count, NULL, 0);
            if (status != QM_OK) return status;
            const cut next_cut = find_cut(work, is_last);
            double rms, next_mean = mean_square(work, &next_cut, &rms);
            is_lower = next_mean < mean;
            if (is_lower) {
                is_behind = damping <= MIN_DAMPING && stays_behind(mean, next_mean, effort->rival);
                out->pose = next;
                out->rms = rms;
                mean = next_mean;
                c = next_cut;
                damping = qm_max(0.1 * damping, MIN_DAMPING);
            } else {
                damping *= 10.0;
                out->is_converged = damping > MAX_DAMPING || length < MIN_GAIN;
            }
        }
        if (!is_lower && is_moved) { /* the pairs are those of a pose that was not taken */
            status = qm_align_measure(work, &out->pose, count, NULL, 0);
            if (status != QM_OK) return status;
        }
    }
    return QM_OK;
}
