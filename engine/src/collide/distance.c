/**
 * distance.c: the minimal distance of two surfaces, by branch and bound over pairs of nodes.
 *
 * Where the surfaces meet as triangles, which the collision search decides exactly, it is 0. Otherwise a
 * priority queue holds pairs of nodes with a lower bound of their distance, the nearest first. A pair of
 * packs is measured face by face; any other is split. A pair whose lower bound is not below the best distance
 * less the tolerance is discarded, and the smallest bound of those that were discarded bounds the result from
 * below.
 */
#include "qm/distance.h"

#include "bvh/kernel.h"
#include "bvh/surface.h"
#include "collide_faces.h"
#include "collide_search.h"
#include "core/clock.h"
#include "prim/bilinear_pair.h"
#include "prim/triangle.h"

#define CANCEL_STEP 256        /* pairs of nodes between checks of the cancel flag */
#define BOX_SLACK (1.0 - 1e-6) /* of distances of boxes, which are computed in single precision */
#define MAX_BOX_DISTANCE 1e18  /* its square is near the largest float: no lower bound is larger */
#define FIRST_CAPACITY 256     /* of the queue */

/**
 * Bounds the rounding error of a distance in the local space of the search, where no coordinate exceeds 2:
 * 2048 u with u = 2^-53. The distance of two triangles is off by 2 QM_TRIANGLE_GAP_ERROR, 512 u; that of two
 * points of patches by less; and each mesh's coordinates by 2 sqrt(3) u from the change to local space.
 */
#define ERROR (8.0 * QM_TRIANGLE_GAP_ERROR)
#define MIN_PATCH_ERROR 1e-13
#define FOOT_ERROR 1e-13 /* local: of the points of the result, as parameters of their faces */

/** Two nodes that wait to be split or measured. */
typedef struct node_pair {
    double lower; /* no point of a is nearer to b */
    qm_node a, b;
} node_pair;

/** A priority queue, a binary heap: the nearest pair first, and of equally near ones the one with the lower
 * levels, so that faces are measured soon. All zero is an empty queue. */
typedef struct node_queue {
    node_pair *heap;
    size_t count, capacity;
} node_queue;

/** The nearest faces so far. Lengths are in the local space of the search. */
typedef struct search {
    qm_context *ctx;
    const qm_bvh *bvh[2];
    const qm_distance_options *options;
    qm_frame frame; /* both surfaces lie within [-2, 2] */
    double unit[2]; /* of each tree's own frame */
    qm_dual_traversal descent;
    node_queue queue;
    double tolerance, limit;
    double best;   /* an upper bound: the distance of two points */
    double lowest; /* a lower bound for all pairs that were measured or discarded */
    uint32_t face[2];
    qm_vec point[2];
    uint64_t pairs;
} search;

/* ---- the queue ---- */

static bool comes_before(const node_pair *x, const node_pair *y)
{
    if (x->lower != y->lower) return x->lower < y->lower;
    return x->a.level + x->b.level < y->a.level + y->b.level;
}

/** Adds a pair; false when out of memory. */
static bool push(qm_context *ctx, node_queue *queue, const node_pair *pair)
{
    if (queue->count == queue->capacity) {
        size_t capacity = queue->capacity > 0 ? 2 * queue->capacity : FIRST_CAPACITY;
        node_pair *grown = qm_context_resize(ctx, queue->heap, queue->capacity, capacity, sizeof *grown);
        if (!grown) return false;
        queue->heap = grown;
        queue->capacity = capacity;
    }
    QM_ASSERT(queue->count < queue->capacity && pair->lower >= 0.0);
    size_t at = queue->count++;
    for (size_t parent; at > 0 && comes_before(pair, &queue->heap[parent = (at - 1) / 2]); at = parent)
        queue->heap[at] = queue->heap[parent];
    queue->heap[at] = *pair;
    return true;
}

/** Takes the first pair. */
static node_pair pop(node_queue *queue)
{
    QM_ASSERT(queue->count > 0);
    node_pair top = queue->heap[0], last = queue->heap[--queue->count];
    size_t at = 0;
    for (size_t child; (child = 2 * at + 1) < queue->count; at = child) {
        if (child + 1 < queue->count && comes_before(&queue->heap[child + 1], &queue->heap[child])) child++;
        if (!comes_before(&queue->heap[child], &last)) break;
        queue->heap[at] = queue->heap[child];
    }
    queue->heap[at] = last;
    return top;
}

/* ---- faces ---- */

/** Discards a pair that cannot improve the result by more than the tolerance: remembers its lower bound and
 * returns true. */
static bool discard(search *s, double lower)
{
    if (lower < s->best - s->tolerance) return false;
    s->lowest = fmin(s->lowest, lower);
    return true;
}

/** A face in local space with its box. */
typedef struct near_face {
    uint32_t face;
    qm_face_shape shape;
    qm_box box;
} near_face;

static int load_faces(const search *s, int side, uint32_t pack, near_face out[QM_PACK_LANES])
{
    const qm_mesh *mesh = &s->bvh[side]->mesh;
    const qm_pack_lanes *lanes = &s->bvh[side]->lanes[pack];
    int count = 0;
    for (uint32_t lane = 0; lane < lanes->lane_count; lane++) {
        if (qm_lane_is_second(lanes, lane)) continue;
        near_face *f = &out[count++];
        f->face = lanes->face[lane];
        const uint32_t *index = mesh->face_count > 0 ? mesh->faces + 4 * (size_t)f->face : NULL;
        f->shape.count = index && index[3] != QM_NO_INDEX ? 4 : 3;
        for (int i = 0; i < f->shape.count; i++) {
            size_t vertex = index ? index[i] : f->face;
            f->shape.corner[i] = qm_frame_local(&s->frame, mesh->positions + 3 * vertex);
        }
        f->box = qm_vec_box(f->shape.corner, f->shape.count);
    }
    return count;
}

/** A lower bound of the distance of two faces. */
static double box_distance(const qm_box *a, const qm_box *b)
{
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        double gap = fmax(fmax(a->min[k] - b->max[k], b->min[k] - a->max[k]), 0.0);
        sum += gap * gap;
    }
    return fmax(sqrt(sum) - ERROR, 0.0);
}

/** Keeps two points if they are the nearest so far. */
static void offer(search *s, const near_face *a, const near_face *b, double distance, qm_vec p, qm_vec q)
{
    if (!(distance < s->best)) return;
    s->best = distance;
    s->face[0] = a->face;
    s->face[1] = b->face;
    s->point[0] = p;
    s->point[1] = q;
}

static void measure_triangles(search *s, const near_face *a, const near_face *b)
{
    for (int i = 0; i < a->shape.count - 2; i++) {
        for (int k = 0; k < b->shape.count - 2; k++) {
            const qm_vec *c = a->shape.corner, *d = b->shape.corner;
            const qm_vec p[3] = {c[0], c[i + 1], c[i + 2]}, q[3] = {d[0], d[k + 1], d[k + 2]};
            qm_triangle_gap gap = qm_triangle_find_gap(p, q);
            s->lowest = fmin(s->lowest, gap.distance);
            offer(s, a, b, gap.distance, qm_triangle_at(p, gap.weight[0]), qm_triangle_at(q, gap.weight[1]));
        }
    }
}

static void measure_packs(search *s, uint32_t pack_a, uint32_t pack_b)
{
    near_face a[QM_PACK_LANES], b[QM_PACK_LANES];
    int a_count = load_faces(s, 0, pack_a, a), b_count = load_faces(s, 1, pack_b, b);
    for (int i = 0; i < a_count; i++) {
        for (int k = 0; k < b_count; k++) {
            if (discard(s, box_distance(&a[i].box, &b[k].box))) continue;
            s->pairs++;
            bool has_quad = a[i].shape.count + b[k].shape.count > 6;
            if (!has_quad || s->options->quads != QM_QUADS_BILINEAR) {
                measure_triangles(s, &a[i], &b[k]);
                continue;
            }
            double error = fmax(0.25 * s->tolerance, MIN_PATCH_ERROR);
            qm_bilinear_gap gap = qm_bilinear_pair_distance(&a[i].shape, &b[k].shape, error, s->best);
            s->lowest = fmin(s->lowest, gap.lower);
            offer(s, &a[i], &b[k], gap.upper, gap.point[0], gap.point[1]);
        }
    }
}

/* ---- nodes ---- */

/** True when it is certain on which side of the limit the distance is, with no waiting pair nearer than this, and there are points
 * to tell. Without a limit (NAN) it never is. */
static bool is_decided(const search *s, double lower)
{
    if (!(s->best < INFINITY)) return false;
    return s->best + ERROR <= s->limit || fmin(fmin(s->lowest, s->best), lower) - ERROR > s->limit;
}

/** Measures pairs of packs, nearest first, and replaces each other pair by those of one of its nodes, that of
 * the higher level, split into its children. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
static qm_status run(search *s)
{
    node_pair pair = {.a = qm_node_root(s->descent.a), .b = qm_node_root(s->descent.b)};
    if (!push(s->ctx, &s->queue, &pair)) return QM_E_NO_MEMORY;
    for (uint64_t step = 1; s->queue.count > 0; step++) {
        if (step % CANCEL_STEP == 0 && qm_context_canceled(s->ctx)) return QM_E_CANCELED;
        pair = pop(&s->queue);
        if (discard(s, pair.lower)) return QM_OK;
        if (is_decided(s, pair.lower)) {
            s->lowest = fmin(s->lowest, pair.lower);
            return QM_OK;
        }
        if (pair.a.level == 0 && pair.b.level == 0) {
            measure_packs(s, pair.a.index, pair.b.index);
            continue;
        }
        bool splits_a = pair.a.level >= pair.b.level;
        const qm_box_tree *tree = &s->bvh[splits_a ? 0 : 1]->boxes;
        const qm_node *split = splits_a ? &pair.a : &pair.b;
        float d2[QM_PACK_LANES];
        unsigned children = qm_kernel_get()->node_distances(&s->descent, &pair.a, &pair.b, splits_a, d2);
        for (; children; children &= children - 1) {
            int index = __builtin_ctz(children);
            double distance = fmin(sqrt((double)d2[index]), MAX_BOX_DISTANCE);
            double lower = fmax(distance * s->unit[splits_a ? 0 : 1] * BOX_SLACK, pair.lower);
            if (discard(s, lower)) continue;
            node_pair child = {.lower = lower, .a = pair.a, .b = pair.b};
            *(splits_a ? &child.a : &child.b) = qm_node_child(tree, split, index);
            if (!push(s->ctx, &s->queue, &child)) return QM_E_NO_MEMORY;
        }
    }
    return QM_OK;
}

/* ---- the result ---- */

static qm_surface_point find_point(const search *s, int side, uint32_t face, const double position[3])
{
    const qm_bvh *bvh = s->bvh[side];
    return qm_surface_face_foot(bvh, s->options->quads, face, qm_frame_local(&bvh->frame, position),
                                FOOT_ERROR);
}

/** Finds out whether the surfaces meet as triangles, and where. */
static qm_status find_contact(const search *s, qm_distance *out, bool *meets)
{
    qm_collide_options options = qm_collide_options_default();
    options.mode = QM_COLLIDE_ANY;
    qm_collision found;
    qm_status status = qm_collide_meshes(s->ctx, s->bvh[0], s->bvh[1], &options, &found);
    if (status != QM_OK) return status;
    *meets = found.pair_count > 0;
    qm_collide_faces faces = {.mesh = {&s->bvh[0]->mesh, &s->bvh[1]->mesh}};
    qm_contact contact;
    if (*meets && qm_collide_faces_find_contact(&faces, &options, found.pairs[0], &contact)) {
        out->from = find_point(s, 0, faces.face[0], contact.point[0]);
        out->to = find_point(s, 1, faces.face[1], contact.point[0]);
        out->is_converged = true;
    }
    qm_collide_reset(s->ctx, &found);
    return QM_OK;
}

qm_status qm_distance_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                              const qm_distance_options *options, qm_distance *out)
{
    QM_ASSERT(ctx && a && b && options && out);
    double start_ms = qm_clock_ms();
    *out = (qm_distance){0};
    if (!(options->tolerance > 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "tolerance must be > 0, got %g", options->tolerance);
    if (options->limit < 0.0)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "limit must be >= 0, got %g", options->limit);
    search s = {
        .ctx = ctx,
        .bvh = {a, b},
        .options = options,
        .descent = {.a = &a->boxes, .b = &b->boxes, .change = qm_frame_change_make(&a->frame, &b->frame)},
        .best = INFINITY,
        .lowest = INFINITY};
    bool meets = false, has_patches = options->quads == QM_QUADS_BILINEAR && (a->has_quads || b->has_quads);
    qm_status status = qm_collide_check_scale(ctx, a, b);
    if (status == QM_OK && !has_patches) status = find_contact(&s, out, &meets);
    if (status != QM_OK) return status;
    if (!meets) {
        /* The local space of the search: that of a, widened by a power of two so that b fits in as well. */
        const qm_frame *first = &s.bvh[0]->frame, *second = &s.bvh[1]->frame;
        const qm_frame_change *change = &s.descent.change;
        double extent = 1.0;
        for (int k = 0; k < 3; k++)
            extent = fmax(extent, fabs(change->shift_ab[k]) + change->scale_ab);
        int exponent;
        frexp(extent, &exponent);
        s.frame = *first;
        s.frame.scale = ldexp(first->scale, 1 - exponent);
        s.frame.inverse_scale = ldexp(first->inverse_scale, exponent - 1);
        s.unit[0] = s.frame.scale * first->inverse_scale;
        s.unit[1] = s.frame.scale * second->inverse_scale;
        s.tolerance = 0.5 * options->tolerance * s.frame.scale;
        s.limit = options->limit * s.frame.scale;
        status = run(&s);
        qm_context_free(ctx, s.queue.heap, s.queue.capacity, sizeof *s.queue.heap);
        if (status != QM_OK)
            return qm_context_fail(ctx, status, "%s while measuring the distance", qm_status_text(status));
        double scale = s.frame.inverse_scale, position[2][3];
        out->upper = (s.best + ERROR) * scale;
        out->lower = fmax(fmin(s.lowest, s.best) - ERROR, 0.0) * scale;
        for (int side = 0; side < 2; side++)
            qm_vec_store(position[side], qm_frame_world(&s.frame, s.point[side]));
        QM_ASSERT(!(out->lower > out->upper));
        out->from = find_point(&s, 0, s.face[0], position[0]);
        out->to = find_point(&s, 1, s.face[1], position[1]);
        out->is_converged = out->upper - out->lower <= s.options->tolerance;
    }
    if (out->upper <= options->limit)
        out->verdict = QM_VERDICT_BELOW;
    else if (out->lower > options->limit)
        out->verdict = QM_VERDICT_ABOVE;
    out->pairs = s.pairs;
    out->elapsed_ms = qm_clock_ms() - start_ms;
    return QM_OK;
}
