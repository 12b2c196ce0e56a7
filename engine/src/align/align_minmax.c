/**
 * align_minmax.c: lowers the Hausdorff distance itself.
 *
 * The Hausdorff distance is the largest of the distances of all points, and its witness is the point at which it is reached. A
 * model keeps all witnesses that were found, and the points of both meshes. A round lowers the largest distance of the model
 * by steps, then measures the moved mesh: when the new witness is no farther than the model knew, the round was the last one.
 * The best measured pose is kept.
 *
 * A step x lowers max_i (d_i + g_i . x) + |x|^2 / (2 t) over the pairs that are nearly farthest: the gradients g_i are the rows
 * of align_work.h. The dual is a quadratic program over weights of sum 1, x = -t sum w_i g_i, solved by moving weight
 * between two pairs at a time. t grows when a step does what it promised, and shrinks when it does not.
 *
 * Source: Kiwiel, Proximity control in bundle methods, 1990; Platt, Sequential minimal optimization, 1998 (pairs of weights).
 */
#include "align_work.h"

#include <stdlib.h>

#include "qm/deform.h"

#define MAX_ROUNDS 30
#define MAX_IDLE_ROUNDS 6 /* that do not lower the best distance */
#define MAX_STEPS 60      /* of a round */
#define MAX_ACTIVE 192
#define WINDOW 0.25 /* pairs count whose distance is within this share of the largest */
#define SWEEPS 600
#define GAP 1e-3 /* of the measured distance: the tolerance of its interval, and what ends the rounds */
#define LEAST_GAIN 1e-7 /* of a step, as a fraction of the distance */

/** The nearly farthest pairs, in the unknowns of the motion. */
typedef struct active_set {
    double distance[MAX_ACTIVE], row[MAX_ACTIVE][QM_ALIGN_UNKNOWNS];
    int count, unknowns;
    int index[QM_ALIGN_UNKNOWNS];
} active_set;

static double largest_distance(const qm_align_work *work)
{
    double most = 0.0;
    for (size_t i = 0; i < work->pair_count; i++)
        most = qm_max(most, work->pairs[i].distance);
    return most;
}

/** Takes the farthest pairs of the window; of too many every k-th is left out, but for those that are farthest. */
static void choose_active(const qm_align_work *work, double most, qm_vec center, active_set *out)
{
    out->count = 0;
    out->unknowns = qm_align_unknowns(work->options->motion, out->index);
    double window = WINDOW;
    size_t found = SIZE_MAX;
    while (found > MAX_ACTIVE && window > 1e-12) {
        found = 0;
        for (size_t i = 0; i < work->pair_count; i++)
            found += work->pairs[i].distance >= most * (1.0 - window);
        if (found > MAX_ACTIVE) window *= 0.5;
    }
    for (size_t i = 0; i < work->pair_count && out->count < MAX_ACTIVE; i++) {
        const qm_align_pair *pair = &work->pairs[i];
        if (pair->distance < most * (1.0 - window)) continue;
        double row[QM_ALIGN_UNKNOWNS];
        qm_align_row(pair, center, row);
        for (int k = 0; k < out->unknowns; k++)
            out->row[out->count][k] = row[out->index[k]];
        out->distance[out->count++] = pair->distance;
    }
}

/** The step that lowers the model, and the largest distance that it promises. */
static double solve(const active_set *set, double t, double x[QM_ALIGN_UNKNOWNS])
{
    double weight[MAX_ACTIVE] = {0}, value[MAX_ACTIVE];
    const int n = set->unknowns;
    weight[0] = 1.0;
    for (int k = 0; k < n; k++)
        x[k] = -t * set->row[0][k];
    double most = 0.0;
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        int high = 0, low = -1;
        for (int i = 0; i < set->count; i++) {
            value[i] = set->distance[i];
            for (int k = 0; k < n; k++)
                value[i] += set->row[i][k] * x[k];
            if (value[i] > value[high]) high = i;
            if (weight[i] > 0.0 && (low < 0 || value[i] < value[low])) low = i;
        }
        most = value[high];
        double curvature = 0.0;
        for (int k = 0; k < n; k++) {
            const double d = set->row[high][k] - set->row[low][k];
            curvature += d * d;
        }
        const double gain = value[high] - value[low];
        if (gain <= 1e-8 * fabs(set->distance[0]) || high == low) break;
        const double moved = curvature > 0.0 ? qm_min(gain / (t * curvature), weight[low]) : weight[low];
        weight[high] += moved;
        weight[low] = moved < weight[low] ? weight[low] - moved : 0.0;
        for (int k = 0; k < n; k++)
            x[k] -= t * moved * (set->row[high][k] - set->row[low][k]);
    }
    return most;
}

/** Lowers the largest distance of the points and the extra ones, by steps. */
static qm_status lower_model(qm_align_work *work, const qm_align_extra *extra, size_t extra_count,
                             qm_align_pose *pose)
{
    const size_t count = work->options->sample_count;
    active_set *set = qm_context_alloc(work->ctx, 1, sizeof *set);
    if (!set) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the alignment");
    qm_status status = qm_align_measure(work, pose, count, extra, extra_count);
    double most = status == QM_OK ? largest_distance(work) : 0.0, t = most;
    bool is_new = true;
    qm_vec center = {0, 0, 0};
    for (int i = 0; i < MAX_STEPS && status == QM_OK && most > work->noise; i++) {
        if (is_new) {
            center = pose->shift;
            choose_active(work, most, center, set);
        }
        double x[QM_ALIGN_UNKNOWNS], all[QM_ALIGN_UNKNOWNS] = {0};
        const double promised = most - solve(set, t, x);
        if (!(promised > LEAST_GAIN * most)) break;
        for (int k = 0; k < set->unknowns; k++)
            all[set->index[k]] = x[k];
        const qm_align_step step = qm_align_step_of(all);
        const qm_align_pose next = qm_align_pose_change(pose, center, &step);
        work->iterations++;
        status = qm_align_measure(work, &next, count, extra, extra_count);
        if (status != QM_OK) break;
        const double now = largest_distance(work), gain = most - now;
        is_new = gain > 0.1 * promised;
        if (is_new) {
            if (gain > 0.7 * promised) t *= 2.0;
            *pose = next;
            most = now;
        } else {
            t *= 0.3;
        }
    }
    qm_context_free(work->ctx, set, 1, sizeof *set);
    return status;
}

/* ---- the moved mesh ---- */

/** A copy of A that is moved, with a tree that follows. */
typedef struct moved_mesh {
    qm_mesh mesh; /* positions are its own; the other arrays are A's */
    qm_bvh *tree;
    qm_deformer *deformer;
} moved_mesh;

static void free_moved(qm_context *ctx, moved_mesh *moved)
{
    qm_deformer_destroy(ctx, moved->deformer);
    qm_bvh_destroy(ctx, moved->tree);
    qm_context_free(ctx, moved->mesh.positions, moved->mesh.vertex_count, 3 * sizeof *moved->mesh.positions);
}

/** Moves the copy, which is made the first time. */
static qm_status move(qm_align_work *work, const qm_align_pose *pose, moved_mesh *moved)
{
    const qm_mesh *a = qm_bvh_mesh(work->tree[0]);
    double m[QM_TRANSFORM_SIZE];
    qm_align_pose_transform(&work->frames, pose, m);
    const int threads = work->options->thread_count;
    const bool is_first = !moved->mesh.positions;
    if (is_first) {
        moved->mesh = *a;
        moved->mesh.normals = NULL;
        moved->mesh.positions = qm_context_alloc(work->ctx, a->vertex_count, 3 * sizeof *a->positions);
        if (!moved->mesh.positions)
            return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the moved mesh");
    }
    qm_status status = qm_transform_positions(work->ctx, m, a, moved->mesh.positions);
    if (status != QM_OK) return status;
    if (is_first) {
        status = qm_bvh_build(work->ctx, &moved->mesh, QM_BVH_ALL, threads, &moved->tree);
        return status == QM_OK ? qm_deformer_build(work->ctx, moved->tree, &moved->deformer) : status;
    }
    size_t updated;
    return qm_bvh_refit(work->ctx, moved->tree, moved->deformer, &moved->mesh, NULL, 0, threads, &updated);
}

/** The distance of the moved mesh, and its witness as a point of the model. */
static qm_status measure(qm_align_work *work, const qm_align_pose *pose, moved_mesh *moved, double expected,
                         qm_hausdorff_result *found, qm_align_extra *witness)
{
    qm_status status = move(work, pose, moved);
    if (status != QM_OK) return status;
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = work->options->direction;
    options.quads = work->options->quads;
    options.thread_count = 1; /* which witness is found first depends on the threads */
    options.tolerance = qm_max(GAP * expected, 16.0 * work->noise) * work->frames.unit;
    status = qm_hausdorff_measure(work->ctx, moved->tree, work->tree[1], &options, found);
    if (status != QM_OK || !found->has_witness) return status;
    if (found->stop == QM_STOP_CANCELED)
        return qm_context_fail(work->ctx, QM_E_CANCELED, "the alignment was canceled");
    witness->side = found->from_side == QM_HAUSDORFF_FROM_A ? 0 : 1;
    witness->point = qm_align_local(&work->frames, 1, found->from.position);
    if (witness->side == 0) {
        const qm_align_matrix m = qm_align_pose_matrix(pose);
        witness->point = qm_vec_scale(1.0 / pose->scale,
                                      qm_align_multiply_back(&m, qm_vec_sub(witness->point, pose->shift)));
    }
    return QM_OK;
}

qm_status qm_align_lower_maximum(qm_align_work *work, qm_align_pose *pose, qm_align_result *out)
{
    qm_align_extra witness[MAX_ROUNDS];
    size_t witness_count = 0;
    moved_mesh moved = {.tree = NULL};
    qm_align_pose best = *pose;
    double best_upper = INFINITY, known = 0.0;
    int idle = 0;
    out->is_converged = false;
    qm_status status = qm_align_measure(work, pose, work->options->sample_count, NULL, 0);
    if (status == QM_OK) known = largest_distance(work);
    while (status == QM_OK && out->rounds < MAX_ROUNDS && idle < MAX_IDLE_ROUNDS && !out->is_converged) {
        qm_hausdorff_result found;
        status = measure(work, pose, &moved, known, &found, &witness[witness_count]);
        if (status != QM_OK) break;
        out->rounds++;
        idle++;
        if (found.upper < best_upper * (1.0 - GAP)) idle = 0;
        if (found.upper < best_upper) {
            best_upper = found.upper;
            best = *pose;
        }
        const bool is_first = out->rounds == 1;
        out->is_converged =
            !found.has_witness || (!is_first && found.lower <= known * work->frames.unit * (1.0 + GAP));
        witness_count += found.has_witness;
        if (out->is_converged) break;
        status = lower_model(work, witness, witness_count, pose);
        if (status == QM_OK)
            status = qm_align_measure(work, pose, work->options->sample_count, witness, witness_count);
        if (status == QM_OK) known = largest_distance(work);
    }
    free_moved(work->ctx, &moved);
    *pose = best;
    return status;
}
