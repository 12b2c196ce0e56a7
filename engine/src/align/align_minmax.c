/**
 * align_minmax.c: lowers the Hausdorff distance itself.
 *
 * The Hausdorff distance is the largest of the distances of all points, and its witness is the point at which it is reached. A
 * model keeps all witnesses that were found, and the points of both meshes. A round lowers the largest distance of the model
 * by steps, then measures the moved mesh: when the new witness is no farther than the model knew, the round was the last one.
 * The best measured pose is kept.
 *
 * A step x lowers max_i (d_i + g_i . x) + |x|^2 / (2 t) over the pairs that are nearly farthest: the gradients g_i are the rows
 * of align_work.h. The dual is a quadratic program over weights of sum 1, x = -t sum w_i g_i, whose few pairs with weight are
 * found exactly. t grows when a step does what it promised, and shrinks when it does not.
 *
 * Source: Kiwiel, Proximity control in bundle methods, 1990.
 */
#include "align_work.h"

#include <stdlib.h>

#include "qm/deform.h"

#define MAX_ROUNDS 120
#define MAX_IDLE_ROUNDS 12 /* that do not lower the best distance */
#define MAX_STEPS 200      /* of a round */
#define MAX_ACTIVE 192
#define WINDOW 0.25 /* pairs count whose distance is within this share of the largest */
#define MAX_CORRAL 24
#define MAX_JOINS 200
#define JOIN_GAIN 1e-11 /* of the distance: a pair that would be farther by less need not join */
#define RIDGE 1e-13     /* of the largest product of two gradients */
#define GAP 1e-6   /* of the measured distance: the tolerance of its interval, and what ends the rounds */
#define CLOSE 1e-3 /* a search that ended otherwise has converged if the model knew the distance so closely */
#define KEPT                                                                                                 \
    0.25 /* points count whose distance is within this share of the largest, until poses have moved as far */
#define LEAST_GAIN 1e-9 /* of a step, as a fraction of the distance */

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

/** The pairs of the active set that have weight, at most as many as there are unknowns and one, as a rule. */
typedef struct corral {
    int pair[MAX_CORRAL];
    double weight[MAX_CORRAL];
    int count;
} corral;

/**
 * The weights of sum 1 that make t / 2 |sum w g|^2 - sum w d least over the pairs of the corral, of any sign, by elimination of
 * the equations t G G' w + level = d. The ridge makes them regular where gradients depend on each other: weight then goes along
 * what they have in common until one of them has none, and leaves. False when there are no finite ones.
 */
static bool balance(const active_set *set, double t, double ridge, const corral *c, double out[MAX_CORRAL])
{
    double a[MAX_CORRAL + 1][MAX_CORRAL + 2];
    const int n = c->count + 1;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            double sum = i == c->count || j == c->count ? (i != j) : 0.0;
            if (i < c->count && j < c->count) {
                for (int k = 0; k < set->unknowns; k++)
                    sum += t * set->row[c->pair[i]][k] * set->row[c->pair[j]][k];
                sum += i == j ? ridge : 0.0;
            }
            a[i][j] = sum;
        }
        a[i][n] = i < c->count ? set->distance[c->pair[i]] : 1.0;
    }
    for (int i = 0; i < n; i++) {
        int pivot = i;
        for (int j = i + 1; j < n; j++)
            if (fabs(a[j][i]) > fabs(a[pivot][i])) pivot = j;
        if (a[pivot][i] == 0.0) return false;
        for (int k = i; k <= n; k++) {
            const double swap = a[i][k];
            a[i][k] = a[pivot][k];
            a[pivot][k] = swap;
        }
        for (int j = i + 1; j < n; j++) {
            const double factor = a[j][i] / a[i][i];
            for (int k = i; k <= n; k++)
                a[j][k] -= factor * a[i][k];
        }
    }
    bool is_finite = true;
    for (int i = n - 1; i >= 0; i--) {
        double sum = a[i][n];
        for (int j = i + 1; j < n; j++)
            sum -= a[i][j] * a[j][n];
        a[i][n] = sum / a[i][i];
        is_finite = is_finite && isfinite(a[i][n]);
        if (i < c->count) out[i] = a[i][n];
    }
    return is_finite;
}

/** Moves the weights of a corral to the balanced ones; pairs whose weight ends on the way leave it. False: they stay as they are. */
static bool settle(const active_set *set, double t, double ridge, corral *c)
{
    double goal[MAX_CORRAL];
    for (;;) {
        if (!balance(set, t, ridge, c, goal)) return false;
        double part = 1.0;
        int leaving = -1;
        for (int i = 0; i < c->count; i++) {
            if (goal[i] > 0.0) continue;
            const double ends = c->weight[i] / (c->weight[i] - goal[i]);
            if (leaving < 0 || ends < part) {
                part = qm_min(ends, 1.0);
                leaving = i;
            }
        }
        for (int i = 0; i < c->count; i++)
            c->weight[i] += part * (goal[i] - c->weight[i]);
        if (leaving < 0) return true;
        c->count--;
        c->pair[leaving] = c->pair[c->count];
        c->weight[leaving] = c->weight[c->count];
        if (c->count == 0) return false;
    }
}

/**
 * The step that lowers the model, and the largest distance that it promises. Pairs join the corral one by one, the one that
 * would be farthest after the step first, until none would be farther than those in it (Wolfe, Finding the nearest point in a
 * polytope, 1976).
 */
static double solve(const active_set *set, double t, double x[QM_ALIGN_UNKNOWNS])
{
    double length = 0.0, most = 0.0;
    for (int i = 0; i < set->count; i++) {
        double sum = 0.0;
        for (int k = 0; k < set->unknowns; k++)
            sum += set->row[i][k] * set->row[i][k];
        length = qm_max(length, sum);
    }
    const double ridge = RIDGE * t * length;
    corral c = {.weight = {1.0}, .count = 1};
    for (int i = 1; i < set->count; i++)
        if (set->distance[i] > set->distance[c.pair[0]]) c.pair[0] = i;
    for (int join = 0; join < MAX_JOINS; join++) {
        for (int k = 0; k < set->unknowns; k++) {
            x[k] = 0.0;
            for (int i = 0; i < c.count; i++)
                x[k] -= t * c.weight[i] * set->row[c.pair[i]][k];
        }
        int high = 0;
        double level = -INFINITY, highest = -INFINITY;
        for (int i = 0; i < set->count; i++) {
            double value = set->distance[i];
            for (int k = 0; k < set->unknowns; k++)
                value += set->row[i][k] * x[k];
            for (int j = 0; j < c.count; j++)
                if (c.pair[j] == i) level = qm_max(level, value);
            if (value > highest) {
                highest = value;
                high = i;
            }
        }
        most = highest;
        if (highest <= level + JOIN_GAIN * fabs(set->distance[0]) || c.count == MAX_CORRAL) break;
        c.pair[c.count] = high;
        c.weight[c.count++] = 0.0;
        if (!settle(set, t, ridge, &c)) break;
    }
    return most;
}

/** The points that may become farthest, witnesses among them, and how far poses may move until others may. */
typedef struct near_farthest {
    qm_align_extra *point;
    size_t count, capacity;
    qm_align_pose pose; /* at which they were chosen */
    double below;       /* no other point was farther there */
} near_farthest;

/** How far two poses move a point of A apart, at most: the greatest of the corners of A's box, as the difference is affine. */
static double distance_of_poses(const qm_align_work *work, const qm_align_pose *p, const qm_align_pose *q)
{
    const qm_box box = qm_mesh_bounding_box(qm_bvh_mesh(work->tree[0]));
    const qm_align_matrix m = qm_align_pose_matrix(p), n = qm_align_pose_matrix(q);
    double most = 0.0;
    for (int corner = 0; corner < 8; corner++) {
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = corner >> k & 1 ? box.max[k] : box.min[k];
        const qm_vec x = qm_align_local(&work->frames, 0, at);
        const qm_vec a = qm_vec_axpy(p->shift, p->scale, qm_align_multiply(&m, x));
        const qm_vec b = qm_vec_axpy(q->shift, q->scale, qm_align_multiply(&n, x));
        most = qm_max(most, qm_vec_norm(qm_vec_sub(a, b)));
    }
    return most;
}

/** Measures all points under a pose, and keeps those that are near to the farthest. */
static qm_status choose_near(qm_align_work *work, const qm_align_pose *pose, const qm_align_extra *witness,
                             size_t witness_count, near_farthest *out)
{
    qm_status status = qm_align_measure(work, pose, work->options->sample_count, witness, witness_count);
    if (status != QM_OK) return status;
    const double most = largest_distance(work);
    out->pose = *pose;
    out->below = (1.0 - KEPT) * most;
    out->count = 0;
    for (size_t i = 0; i < work->pair_count; i++) {
        const qm_align_pair *pair = &work->pairs[i];
        const bool is_witness = i + witness_count >= work->pair_count;
        if (!is_witness && pair->distance < out->below) continue;
        out->point[out->count++] =
            (qm_align_extra){.side = pair->side, .point = pair->side == 0 ? pair->x : pair->y};
    }
    return QM_OK;
}

/** Whether a point that is left out may be farther under a pose than the largest distance of those that are kept. */
static bool is_outdated(const qm_align_work *work, const near_farthest *near, const qm_align_pose *pose,
                        double most)
{
    return near->below + distance_of_poses(work, &near->pose, pose) >= most;
}

/** Lowers the largest distance of the points and the witnesses, by steps. */
static qm_status lower_model(qm_align_work *work, const qm_align_extra *witness, size_t witness_count,
                             near_farthest *near, qm_align_pose *pose)
{
    active_set *set = qm_context_alloc(work->ctx, 1, sizeof *set);
    if (!set) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the alignment");
    qm_status status = choose_near(work, pose, witness, witness_count, near);
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
        status = qm_align_measure(work, &next, 0, near->point, near->count);
        if (status == QM_OK && is_outdated(work, near, &next, largest_distance(work)))
            status = choose_near(work, &next, witness, witness_count, near);
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
    near_farthest near = {.capacity = work->pair_capacity};
    near.point = qm_context_alloc(work->ctx, near.capacity, sizeof *near.point);
    if (!near.point) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the alignment");
    qm_align_pose best = *pose;
    double best_upper = INFINITY, known = 0.0;
    int idle = 0;
    bool is_closed = false;
    qm_status status = qm_align_measure(work, pose, work->options->sample_count, NULL, 0);
    if (status == QM_OK) known = largest_distance(work);
    while (status == QM_OK && out->rounds < MAX_ROUNDS && idle < MAX_IDLE_ROUNDS && !is_closed) {
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
        is_closed =
            !found.has_witness || (!is_first && found.lower <= known * work->frames.unit * (1.0 + GAP));
        witness_count += found.has_witness;
        if (is_closed) break;
        status = lower_model(work, witness, witness_count, &near, pose);
        if (status == QM_OK)
            status = qm_align_measure(work, pose, work->options->sample_count, witness, witness_count);
        if (status == QM_OK) known = largest_distance(work);
    }
    out->is_converged = is_closed || best_upper <= known * work->frames.unit * (1.0 + CLOSE);
    free_moved(work->ctx, &moved);
    qm_context_free(work->ctx, near.point, near.capacity, sizeof *near.point);
    *pose = best;
    return status;
}
