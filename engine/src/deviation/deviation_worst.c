/**
 * deviation_worst.c: one branch and bound after the other over the pieces that the rounds have left, which lie in a
 * heap by the greatest distance that each may have. A piece that lies within the radius of a place is dropped for
 * good. Of the first one of the heap four points are measured, and it is halved, until no piece can bring much more than
 * the farthest point that was found.
 *
 * Let c be the crack (deviation_piece.h) and r the radius. A point of A is within c of a piece, so that a piece is
 * dropped when all of it is within r - c of a place, and what is left bounds the rest but for c. A measured point is
 * outside of the ball by eta, which is more than the 42 u S that it may be beside the face.
 */
#include "deviation_worst.h"

#include <math.h>

#include "core/heap.h"
#include "core/rounding.h"

#define WORK 4096            /* halvings for one place */
#define CLOSE_ROUNDINGS 16.0 /* eta: a gain below which a search ends */
#define CANCEL_STRIDE 0x400

typedef struct worst_search {
    qm_refinement *work;
    const qm_deviation_options *options;
    double radius, crack; /* local */
    qm_deviation_place *place;
    qm_vec *centre; /* of the places, local */
    size_t count;
    qm_heap heap;             /* keys are the negated greatest distances */
    qm_deviation_piece *half; /* of pieces; their numbers follow those of the pieces */
    size_t half_count, half_capacity;
    qm_heap_item *stuck; /* popped pieces that cannot be halved, for the next place */
    size_t stuck_count, stuck_capacity;
    qm_deviation_workspace workspace;
} worst_search;

/** A measured point. */
typedef struct far_point {
    double least, greatest; /* of its distance, local; -1: none */
    qm_vec at;
    uint32_t face;
    double uv[2];
} far_point;

static qm_status grow(qm_context *ctx, void **array, size_t count, size_t *capacity, size_t width)
{
    if (count < *capacity) return QM_OK;
    size_t more = 2 * *capacity + 64;
    void *larger = qm_context_resize(ctx, *array, *capacity, more, width);
    if (!larger) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the worst places");
    *array = larger;
    *capacity = more;
    return QM_OK;
}

/** The distance of a point from the nearest place. */
static double apart(const worst_search *search, qm_vec p)
{
    double least = INFINITY;
    for (size_t i = 0; i < search->count; i++)
        least = fmin(least, qm_vec_distance(p, search->centre[i]));
    return least;
}

/** True when a piece lies within the radius of one place. */
static bool is_near_place(const worst_search *search, const qm_deviation_shape *shape)
{
    double room = search->radius - search->crack - shape->slack - search->work->setup.eta;
    for (size_t i = 0; i < search->count; i++) {
        double reach = 0.0;
        for (int k = 0; k < 3; k++)
            reach = fmax(reach, qm_vec_distance(shape->corner[k], search->centre[i]));
        if (reach <= room) return true;
    }
    return false;
}

/** Measures the corners of a piece and its middle; keeps the farthest point. */
static void measure_points(worst_search *search, const qm_deviation_piece *piece,
                           const qm_deviation_face *face, double slack, far_point *best)
{
    const qm_deviation_setup *setup = &search->work->setup;
    for (int k = 0; k < 4; k++) {
        double u = k < 3 ? piece->u[k] : (piece->u[0] + piece->u[1] + piece->u[2]) / 3.0;
        double v = k < 3 ? piece->v[k] : (piece->v[0] + piece->v[1] + piece->v[2]) / 3.0;
        qm_vec p = qm_deviation_face_at(face, u, v);
        if (!(apart(search, p) > search->radius + setup->eta)) continue;
        double certain, distance = qm_deviation_search(setup, &search->workspace, p, &certain);
        /* The slack of a patch's piece is for points between its corners; this one is on the patch. */
        double off = setup->eta + (piece->is_flat ? slack : 0.0);
        if (!(certain - off > best->least)) continue;
        *best = (far_point){certain - off, distance + off, p, piece->face, {0.0, 0.0}};
        qm_deviation_piece_parameters(setup, piece, u, v, best->uv);
    }
}

static qm_status push(worst_search *search, size_t number, double most)
{
    QM_ASSERT(number < UINT32_MAX);
    return qm_heap_push(search->work->ctx, &search->heap, (qm_heap_item){-most, (uint32_t)number, 0});
}

static qm_status push_halves(worst_search *search, const qm_deviation_piece *piece,
                             const qm_deviation_shape *shape, double most)
{
    qm_deviation_piece part[2];
    double leak = 0.0;
    qm_deviation_piece_halve(shape, piece, part, &leak);
    for (int i = 0; i < 2; i++) {
        qm_deviation_bounds bounds;
        qm_deviation_piece_bound(&search->work->setup, &part[i], &search->workspace, &bounds);
        qm_status status = grow(search->work->ctx, (void **)&search->half, search->half_count,
                                &search->half_capacity, sizeof *search->half);
        if (status != QM_OK) return status;
        search->half[search->half_count] = part[i];
        status = push(search, search->work->count + search->half_count++, fmin(most, bounds.most));
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/** Visits the first piece of the heap. */
static qm_status visit(worst_search *search, qm_heap_item item, far_point *best)
{
    qm_refinement *work = search->work;
    bool is_half = item.number >= work->count;
    const qm_deviation_piece piece =
        is_half ? search->half[item.number - work->count] : work->piece[item.number];
    qm_deviation_face face = qm_deviation_face_load(&work->setup, &piece);
    qm_deviation_shape shape = qm_deviation_shape_make(&work->setup, &face, &piece);
    if (is_near_place(search, &shape)) return QM_OK;
    measure_points(search, &piece, &face, shape.slack, best);
    if (piece.depth < QM_DEVIATION_DEPTH) return push_halves(search, &piece, &shape, -item.key);
    qm_status status = grow(work->ctx, (void **)&search->stuck, search->stuck_count, &search->stuck_capacity,
                            sizeof *search->stuck);
    if (status == QM_OK) search->stuck[search->stuck_count++] = item;
    return status;
}

/** Adds a place. */
static void add_place(worst_search *search, const far_point *point, double upper)
{
    const qm_frame *frame = &search->work->setup.target->frame;
    qm_deviation_place *place = &search->place[search->count];
    *place = (qm_deviation_place){.lower = fmax(0.0, point->least) * frame->inverse_scale,
                                  .upper = upper * frame->inverse_scale,
                                  .from = {.face = point->face, .uv = {point->uv[0], point->uv[1]}}};
    qm_vec_store(place->from.position, qm_frame_world(frame, point->at));
    search->centre[search->count++] = point->at;
}

/** Searches the next place; *is_found is false when nothing is left that is apart from B. */
static qm_status find_place(worst_search *search, bool *is_found)
{
    const qm_deviation_setup *setup = &search->work->setup;
    far_point best = {.least = -1.0};
    qm_status status = QM_OK;
    double rest = 0.0;
    for (size_t steps = 0; status == QM_OK && search->heap.count > 0; steps++) {
        if (qm_context_canceled(search->work->ctx))
            return qm_context_fail(search->work->ctx, QM_E_CANCELED, "deviation canceled");
        qm_heap_item item = qm_heap_pop(&search->heap);
        double close = CLOSE_ROUNDINGS * setup->eta + search->options->accuracy * fmax(0.0, best.least);
        if (steps == WORK || (best.least > 0.0 && -item.key <= best.least + close)) {
            rest = -item.key;
            status = push(search, item.number, -item.key);
            break;
        }
        status = visit(search, item, &best);
    }
    for (size_t i = 0; status == QM_OK && i < search->stuck_count; i++) {
        rest = fmax(rest, -search->stuck[i].key);
        status = push(search, search->stuck[i].number, -search->stuck[i].key);
    }
    search->stuck_count = 0;
    *is_found = status == QM_OK && best.least > 0.0;
    if (*is_found) add_place(search, &best, fmax(rest, best.greatest) + search->crack);
    return status;
}

/** The places on pieces after the first one. */
static qm_status find_on_pieces(worst_search *search)
{
    qm_refinement *work = search->work;
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < work->count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx))
            return qm_context_fail(work->ctx, QM_E_CANCELED, "deviation canceled");
        status = push(search, i, work->bounds[i].most);
    }
    for (bool is_found = true; status == QM_OK && is_found && search->count < search->options->worst_count;)
        status = find_place(search, &is_found);
    return status;
}

/** The places on vertices after the first one; max: no point of the source is farther. */
static qm_status find_on_points(worst_search *search, const uint8_t *is_used, const qm_deviation *out)
{
    const qm_deviation_setup *setup = &search->work->setup;
    const qm_mesh *mesh = &setup->source->mesh;
    while (search->count < search->options->worst_count) {
        far_point best = {.least = -1.0};
        double rest = 0.0; /* of points that are apart from the places or not, by rounding */
        for (size_t i = 0; i < mesh->vertex_count; i++) {
            if (i % CANCEL_STRIDE == 0 && qm_context_canceled(search->work->ctx))
                return qm_context_fail(search->work->ctx, QM_E_CANCELED, "deviation canceled");
            double distance = out->vertex_distance[i] * setup->target->frame.scale;
            if (!is_used[i] || !(distance > best.greatest)) continue;
            qm_vec p = qm_frame_local(&setup->target->frame, mesh->positions + 3 * i);
            double gap = apart(search, p) - search->radius;
            if (gap > -setup->eta) rest = fmax(rest, distance + setup->eta);
            if (!(gap > setup->eta)) continue;
            qm_deviation_bounds bounds = qm_deviation_point_bound(setup, mesh->positions + 3 * i, distance);
            best = (far_point){bounds.low[0], bounds.high[0], p, (uint32_t)i, {0.0, 0.0}};
        }
        if (!(best.least > 0.0)) return QM_OK;
        /* The vertices of a surface without area are not all of it. */
        double all = out->max.upper * setup->target->frame.scale;
        add_place(search, &best, out->measure == QM_OVER_POINTS ? fmax(best.greatest, rest) : all);
    }
    return QM_OK;
}

/** Finds the nearest points of B to the places after the first one, and copies all places to the result. */
static qm_status set_places(worst_search *search, qm_deviation *out)
{
    qm_context *ctx = search->work->ctx;
    size_t count = search->count;
    double *at = qm_context_alloc(ctx, 6 * count, sizeof *at),
           *uv = qm_context_alloc(ctx, 2 * count, sizeof *uv);
    uint32_t *face = qm_context_alloc(ctx, count, sizeof *face);
    out->worst = qm_context_alloc(ctx, count, sizeof *out->worst);
    qm_status status = at && uv && face && out->worst
                           ? QM_OK
                           : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the worst places");
    for (size_t i = 0; status == QM_OK && i < 3 * count; i++)
        at[i] = search->place[i / 3].from.position[i % 3];
    qm_projection foot = {.position = at + 3 * count, .face = face, .uv = uv};
    if (status == QM_OK)
        status = qm_project_points(ctx, search->work->setup.target, search->options->quads, at, count,
                                   search->options->thread_count, &foot);
    if (status == QM_OK) {
        out->worst_count = count;
        for (size_t i = 0; i < count; i++) {
            qm_deviation_place *place = &out->worst[i];
            *place = search->place[i];
            if (i == 0) continue;
            const double *p = foot.position + 3 * i;
            place->to = (qm_surface_point){
                .face = face[i], .uv = {uv[2 * i], uv[2 * i + 1]}, .position = {p[0], p[1], p[2]}};
        }
    } else {
        qm_context_free(ctx, out->worst, count, sizeof *out->worst);
        out->worst = NULL;
    }
    qm_context_free(ctx, at, 6 * count, sizeof *at);
    qm_context_free(ctx, uv, 2 * count, sizeof *uv);
    qm_context_free(ctx, face, count, sizeof *face);
    return status;
}

qm_status qm_deviation_find_worst(qm_refinement *work, const qm_deviation_options *options,
                                  const uint8_t *is_used, const qm_hausdorff_result *found, qm_deviation *out)
{
    QM_ASSERT(found->has_witness && options->worst_count > 0);
    qm_context *ctx = work->ctx;
    const qm_frame *frame = &work->setup.target->frame;
    worst_search search = {.work = work,
                           .options = options,
                           .radius = options->worst_radius * frame->scale,
                           .crack = QM_CRACK_ROUNDINGS * QM_UNIT_ROUNDING * work->setup.extent,
                           .count = 1};
    search.workspace.hint = 0;
    search.workspace.searches = 0;
    search.place = qm_context_alloc(ctx, options->worst_count, sizeof *search.place);
    search.centre = qm_context_alloc(ctx, options->worst_count, sizeof *search.centre);
    qm_status status = search.place && search.centre
                           ? QM_OK
                           : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the worst places");
    if (status == QM_OK) {
        search.place[0] = (qm_deviation_place){found->lower, out->max.upper, found->from, found->to};
        search.centre[0] = qm_frame_local(frame, found->from.position);
        if (options->worst_count > 1 && out->max.upper > 0.0)
            status = is_used ? find_on_points(&search, is_used, out) : find_on_pieces(&search);
    }
    if (status == QM_OK) status = set_places(&search, out);
    out->projections += search.workspace.searches;
    qm_heap_reset(ctx, &search.heap);
    qm_context_free(ctx, search.half, search.half_capacity, sizeof *search.half);
    qm_context_free(ctx, search.stuck, search.stuck_capacity, sizeof *search.stuck);
    qm_context_free(ctx, search.place, options->worst_count, sizeof *search.place);
    qm_context_free(ctx, search.centre, options->worst_count, sizeof *search.centre);
    return status;
}
