#include "qm/distance.h"

#include "bvh/kernel.h"
#include "bvh/surface.h"
#include "collide_faces.h"
#include "collide_search.h"
#include "core/clock.h"
#include "distance_queue.h"
#include "prim/bilinear_pair.h"
#include "prim/tri_distance.h"

#define CANCEL_STEP 256        /* pairs of nodes between looks at the cancel flag */
#define BOX_SLACK (1.0 - 1e-6) /* of distances of boxes, which are computed in floats */
#define FARTHEST_BOX 1e18      /* float squares end beyond it: nothing larger is claimed */

/**
 * More than rounding takes from or adds to a distance in the search's frame, where no coordinate exceeds 2:
 * 2048 u with u = 2^-53. That of two triangles is 2 QM_TRI_DISTANCE_ERROR, 512 u; that of two points of
 * patches is less; and each mesh's coordinates are off by 2 sqrt(3) u from being brought into the frame.
 */
#define ERROR (8.0 * QM_TRI_DISTANCE_ERROR)
#define LEAST_PATCH_ERROR 1e-13
#define FOOT_ERROR 1e-13 /* of the parameters of the points that are told, local */

/** The nearest faces so far; lengths are those of the search's frame. */
typedef struct search {
    qm_context *ctx;
    const qm_bvh *bvh[2];
    const qm_distance_options *options;
    qm_frame frame; /* both surfaces lie within [-2, 2] */
    double unit[2]; /* of each tree's own frame */
    qm_descent descent;
    qm_distance_queue queue;
    double tolerance;
    double best;   /* the distance of two points that have been found */
    double lowest; /* no pair of faces that was measured or left aside is nearer */
    uint32_t face[2];
    qm_vec point[2];
    uint64_t pairs;
} search;

/** True when a pair with this lower bound need not be looked at, which is then remembered. */
static bool leave_aside(search *s, double lower)
{
    if (lower < s->best - s->tolerance) return false;
    s->lowest = fmin(s->lowest, lower);
    return true;
}

/* ---- faces ---- */

/** A face in the search's frame with its box. */
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

static double box_distance(const qm_box *a, const qm_box *b)
{
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        double gap = fmax(fmax(a->min[k] - b->max[k], b->min[k] - a->max[k]), 0.0);
        sum += gap * gap;
    }
    return fmax(sqrt(sum) - ERROR, 0.0);
}

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
            qm_tri_gap gap = qm_tri_tri_distance(p, q);
            s->lowest = fmin(s->lowest, gap.distance);
            offer(s, a, b, gap.distance, qm_tri_at(p, gap.weight[0]), qm_tri_at(q, gap.weight[1]));
        }
    }
}

static void measure_patches(search *s, const near_face *a, const near_face *b)
{
    qm_bilinear_gap gap = qm_bilinear_pair_distance(&a->shape, &b->shape,
                                                    fmax(0.25 * s->tolerance, LEAST_PATCH_ERROR), s->best);
    s->lowest = fmin(s->lowest, gap.lower);
    offer(s, a, b, gap.upper, gap.point[0], gap.point[1]);
}

static void measure_packs(search *s, uint32_t pack_a, uint32_t pack_b)
{
    near_face a[QM_PACK_LANES], b[QM_PACK_LANES];
    int a_count = load_faces(s, 0, pack_a, a), b_count = load_faces(s, 1, pack_b, b);
    for (int i = 0; i < a_count; i++) {
        for (int k = 0; k < b_count; k++) {
            if (leave_aside(s, box_distance(&a[i].box, &b[k].box))) continue;
            s->pairs++;
            bool has_patch = a[i].shape.count + b[k].shape.count > 6;
            if (has_patch && s->options->quads == QM_QUADS_BILINEAR)
                measure_patches(s, &a[i], &b[k]);
            else
                measure_triangles(s, &a[i], &b[k]);
        }
    }
}

/* ---- nodes ---- */

/** Splits the node with more leaves; false when out of memory. */
static bool split_pair(search *s, const qm_waiting_pair *pair)
{
    bool splits_a = pair->a.level >= pair->b.level;
    const qm_node *split = splits_a ? &pair->a : &pair->b;
    float d2[QM_PACK_LANES];
    unsigned members = qm_kernel_get()->node_distances(&s->descent, &pair->a, &pair->b, splits_a, d2);
    for (; members; members &= members - 1) {
        int member = __builtin_ctz(members);
        double lower = fmin(sqrt((double)d2[member]), FARTHEST_BOX) * s->unit[splits_a ? 0 : 1] * BOX_SLACK;
        lower = fmax(lower, pair->lower);
        if (leave_aside(s, lower)) continue;
        qm_waiting_pair child = {.lower = lower, .a = pair->a, .b = pair->b};
        *(splits_a ? &child.a : &child.b) = qm_node_child(&s->bvh[splits_a ? 0 : 1]->boxes, split, member);
        if (!qm_distance_queue_push(s->ctx, &s->queue, &child)) return false;
    }
    return true;
}

static qm_status run(search *s)
{
    qm_waiting_pair pair = {.a = qm_node_root(s->descent.a), .b = qm_node_root(s->descent.b)};
    if (!qm_distance_queue_push(s->ctx, &s->queue, &pair)) return QM_E_NO_MEMORY;
    for (uint64_t step = 1; s->queue.count > 0; step++) {
        if (step % CANCEL_STEP == 0 && qm_context_canceled(s->ctx)) return QM_E_CANCELED;
        pair = qm_distance_queue_pop(&s->queue);
        if (leave_aside(s, pair.lower)) return QM_OK;
        if (pair.a.level == 0 && pair.b.level == 0)
            measure_packs(s, pair.a.index, pair.b.index);
        else if (!split_pair(s, &pair))
            return QM_E_NO_MEMORY;
    }
    return QM_OK;
}

/* ---- the answer ---- */

/** The frame of a, made so wide by a power of two that b fits in as well. */
static void set_frame(search *s)
{
    const qm_frame *a = &s->bvh[0]->frame, *b = &s->bvh[1]->frame;
    const qm_frame_change *change = &s->descent.change;
    double reach = 1.0;
    for (int k = 0; k < 3; k++)
        reach = fmax(reach, fabs(change->shift_ab[k]) + change->scale_ab);
    int exponent;
    frexp(reach, &exponent);
    s->frame = *a;
    s->frame.scale = ldexp(a->scale, 1 - exponent);
    s->frame.inverse_scale = ldexp(a->inverse_scale, exponent - 1);
    s->unit[0] = s->frame.scale * a->inverse_scale;
    s->unit[1] = s->frame.scale * b->inverse_scale;
}

static qm_surface_point find_point(const search *s, int side, uint32_t face, const double position[3])
{
    const qm_bvh *bvh = s->bvh[side];
    return qm_surface_face_foot(bvh, s->options->quads, face, qm_frame_local(&bvh->frame, position),
                                FOOT_ERROR);
}

static void tell(const search *s, qm_distance *out)
{
    double scale = s->frame.inverse_scale, position[2][3];
    out->upper = (s->best + ERROR) * scale;
    out->lower = fmax(fmin(s->lowest, s->best) - ERROR, 0.0) * scale;
    for (int side = 0; side < 2; side++)
        qm_vec_store(position[side], qm_frame_world(&s->frame, s->point[side]));
    out->from = find_point(s, 0, s->face[0], position[0]);
    out->to = find_point(s, 1, s->face[1], position[1]);
    out->is_converged = out->upper - out->lower <= s->options->tolerance;
}

/** Whether the surfaces meet as triangles, and where. */
static qm_status look_for_contact(const search *s, qm_distance *out, bool *meets)
{
    qm_collide_options options = qm_collide_options_default();
    options.mode = QM_COLLIDE_ANY;
    qm_collision found;
    qm_status status = qm_collide_meshes(s->ctx, s->bvh[0], s->bvh[1], &options, &found);
    if (status != QM_OK) return status;
    *meets = found.pair_count > 0;
    qm_faces faces = {.mesh = {&s->bvh[0]->mesh, &s->bvh[1]->mesh}};
    qm_contact contact;
    if (*meets && qm_faces_find_pair(&faces, &options, found.pairs[0], &contact)) {
        out->from = find_point(s, 0, faces.face[0], contact.point[0]);
        out->to = find_point(s, 1, faces.face[1], contact.point[0]);
        out->is_converged = true;
    }
    qm_collision_reset(s->ctx, &found);
    return QM_OK;
}

qm_status qm_distance_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                              const qm_distance_options *options, qm_distance *out)
{
    double start_ms = qm_clock_ms();
    *out = (qm_distance){0};
    if (!(options->tolerance > 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "tolerance must be > 0, got %g", options->tolerance);
    search s = {
        .ctx = ctx,
        .bvh = {a, b},
        .options = options,
        .descent = {.a = &a->boxes, .b = &b->boxes, .change = qm_frame_change_make(&a->frame, &b->frame)},
        .best = INFINITY,
        .lowest = INFINITY};
    bool meets = false, has_patches = options->quads == QM_QUADS_BILINEAR && (a->has_quads || b->has_quads);
    qm_status status = qm_collide_check_scale(ctx, a, b);
    if (status == QM_OK && !has_patches) status = look_for_contact(&s, out, &meets);
    if (status != QM_OK) return status;
    if (!meets) {
        set_frame(&s);
        s.tolerance = 0.5 * options->tolerance * s.frame.scale;
        status = run(&s);
        qm_distance_queue_reset(ctx, &s.queue);
        if (status != QM_OK)
            return qm_context_fail(ctx, status, "%s while measuring the distance", qm_status_text(status));
        tell(&s, out);
    }
    out->pairs = s.pairs;
    out->elapsed_ms = qm_clock_ms() - start_ms;
    return QM_OK;
}
