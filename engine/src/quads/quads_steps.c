/**
 * quads_steps.c: how many quads lie between the ends of each edge, in both directions of the grid.
 *
 * The step of a half-edge is a pair of integers in the frame of its face (quads_map.c). Steps are consistent if
 *
 *   - the steps of the three half-edges of a face sum up to 0,
 *   - that of a twin is the opposite, turned,
 *   - that of a feature is 0 across it.
 *
 * The surface is then laid out on the integer grid, face by face, and only vertices may be singular: round them the turns
 * do not sum up to 0. All vertices are corners of the grid, so no parity has to be kept.
 *
 * Steps are first read from the phases of the vertices. Where they do not sum up to 0 there is an excess, in a face and an
 * axis. A change of a step by 1 moves an excess of 1 to the face across the edge, where it may have another axis and sign.
 * So excesses are moved along shortest paths, until they meet their opposites or leave by a boundary. The nodes of the paths
 * are half-edges with axis and sign, since the sheet for an excess of +1 and that for -1 are joined where the turns round
 * a singular vertex change the sign. The number of excesses is even on a closed surface, whatever the turns are.
 *
 * Source: J. Huang, Y. Zhou, M. Niessner, J. R. Shewchuk, L. J. Guibas, QuadriFlow, 2018 (integers by flow, and |step| <= 1);
 * the search on the pairs of sheets is that for bidirected flows.
 */
#include "quads/quads_internal.h"

#include <stdlib.h>
#include <string.h>

#include "core/heap.h"

#define FOLD_COST 12.0  /* of a path: for each face that it turns upside down */
#define LONG_COST 2.0   /* for a step beyond 1 */
#define STRIP_COST 12.0 /* for a step between features side by side that is taken away */
#define STEP_COST 0.1   /* of any change: less would let paths wander */
#define MIN_COST 0.05
/* A path is applied if it costs no more than so much for the cheapest of both ends: those that are none of the cheapest save
 * rounds, and a round visits the whole mesh. */
#define NEAR_FACTOR 1.5
#define NEAR_COST 0.5
#define FIRST_REACH 2.0 /* of the paths, half of their cost: doubled where few are joined by it */
#define REACH_COST 1.0  /* beyond half of its cheapest path an excess is searched no further than this */
#define MOST_BENT 0.5   /* sides by which the way to a corner may differ from that in the plane */
#define FOLLOW_ROUNDS 3
#define REPAIR_ROUNDS 12

/** A node of the search, as the search with this stamp has left it. */
typedef struct path_node {
    double distance;
    uint32_t stamp, before, source;
} path_node;

/** An excess of 1, of a sign, from which paths grow. */
typedef struct path_source {
    uint32_t face;
    int axis, sign;
    double best; /* cost of its cheapest path to another; INFINITY: none yet */
    bool is_joined;
} path_source;

/** A path from one source to another, or out of a boundary. */
typedef struct path_meeting {
    double cost;
    uint32_t end[2];    /* nodes, that lie in one face; QM_NO_INDEX: the source itself, or a boundary */
    uint32_t source[2]; /* the second is QM_NO_INDEX at a boundary */
} path_meeting;

typedef struct steps_work {
    qm_context *ctx;
    qm_trimesh *m;
    const qm_quads_map *map;
    int32_t (*excess)[2]; /* of each face: sum of its steps */
    path_node *node;
    uint32_t stamp;
    uint32_t *arrival; /* of each face, axis and sign: the first node that came there in this search */
    path_source *source;
    size_t source_count, source_capacity;
    uint32_t growing; /* the source whose paths are being lengthened */
    path_meeting *meeting;
    size_t meeting_count, meeting_capacity;
    double reach; /* paths grow no longer in this search */
    bool is_cut;  /* one would have */
    qm_heap heap;
} steps_work;

static void turn(int32_t s[2], int quarters)
{
    int32_t x = s[0], y = s[1];
    switch (quarters & 3) {
    case 1:
        s[0] = -y, s[1] = x;
        break;
    case 2:
        s[0] = -x, s[1] = -y;
        break;
    case 3:
        s[0] = y, s[1] = -x;
        break;
    default:
        break;
    }
}

/*
 * First steps.
 */

/** Writes the step of a half-edge and of its twin. */
static void set_step(const steps_work *w, uint32_t h, const int32_t step[2])
{
    uint32_t t = w->m->twin[h];
    memcpy(w->m->step[h], step, sizeof w->m->step[h]);
    if (t == QM_NO_INDEX) return;
    int32_t back[2] = {-step[0], -step[1]};
    turn(back, w->map->turned[h]);
    memcpy(w->m->step[t], back, sizeof back);
}

/** A step is the real one, from the corner of the first vertex to that of the second, rounded. */
static void read_steps(const steps_work *w, const qm_quads_phases *phases)
{
    const qm_trimesh *m = w->m;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        if (m->twin[h] != QM_NO_INDEX && m->twin[h] < h) continue;
        uint32_t next = qm_trimesh_next(h);
        double from[2], to[2];
        memcpy(from, phases->phase[m->from[h]], sizeof from);
        memcpy(to, phases->phase[m->from[next]], sizeof to);
        qm_quads_turn_pair(from, -phases->turned[h]);
        qm_quads_turn_pair(to, -phases->turned[next]);
        int32_t step[2];
        for (int axis = 0; axis < 2; axis++) {
            double real = w->map->step[h][axis];
            /* strips have a row even where their ends' phases have none between them */
            step[axis] =
                (int32_t)rint(w->map->is_across[h] >> axis & 1 ? real : real + from[axis] - to[axis]);
        }
        if (m->is_feature[h]) step[1 - qm_quads_feature_axis(w->map, h)] = 0;
        set_step(w, h, step);
    }
}

/** The way in space from a vertex to the nearest corner of its grid, in the frame of the first face of its fan: what steps mean there is
 * fitted to the edges of the fan. Where these do not tell it is as in the plane. */
static void way_to_corner(const steps_work *w, const qm_quads_phases *phases, uint32_t vertex, double size,
                          double out[2])
{
    double cross[2][2] = {{0}}, square[2][2] = {{0}};
    const double *phase = phases->phase[vertex];
    uint32_t first = qm_trimesh_first(w->m, vertex), h = first;
    do {
        double edge[2] = {w->map->edge[h][0], w->map->edge[h][1]};
        double step[2] = {w->map->step[h][0], w->map->step[h][1]};
        qm_quads_turn_pair(edge, phases->turned[h]);
        qm_quads_turn_pair(step, phases->turned[h]);
        for (int i = 0; i < 2; i++)
            for (int k = 0; k < 2; k++) {
                cross[i][k] += w->map->unit * edge[i] * step[k];
                square[i][k] += step[i] * step[k];
            }
        h = qm_trimesh_around(w->m, h);
    } while (h != QM_NO_INDEX && h != first);
    double determinant = square[0][0] * square[1][1] - square[0][1] * square[1][0];
    double solved[2] = {square[1][1] * phase[0] - square[0][1] * phase[1],
                        square[0][0] * phase[1] - square[1][0] * phase[0]};
    for (int i = 0; i < 2; i++) {
        double way = (cross[i][0] * solved[0] + cross[i][1] * solved[1]) / determinant;
        bool is_near = fabs(way - size * phase[i]) <= MOST_BENT * size;
        out[i] = phase[i] == 0.0 ? 0.0 : is_near ? -way : -size * phase[i];
    }
}

/** Moves vertices to the nearest corners of their grids; those of features stay on them. */
static qm_status move_to_corners(const steps_work *w, const qm_vec *cross, const qm_quads_phases *phases,
                                 double size)
{
    const qm_trimesh *m = w->m;
    qm_vec *moved = qm_context_alloc(w->ctx, m->vertex_count, sizeof *moved);
    if (!moved) return QM_E_NO_MEMORY;
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        uint32_t f = qm_trimesh_first(m, v) / 3;
        qm_vec normal = qm_trimesh_normal(m, f);
        double area = qm_vec_norm(normal), way[2];
        moved[v] = m->position[v];
        if (!(area > 0.0)) continue;
        qm_vec other = qm_vec_cross(qm_vec_scale(1.0 / area, normal), cross[f]);
        way_to_corner(w, phases, v, size, way);
        moved[v] = qm_vec_axpy(qm_vec_axpy(moved[v], way[0], cross[f]), way[1], other);
    }
    memcpy(m->position, moved, m->vertex_count * sizeof *moved);
    qm_context_free(w->ctx, moved, m->vertex_count, sizeof *moved);
    return QM_OK;
}

/*
 * The flow.
 */

static int32_t area_of(const int32_t a[2], const int32_t b[2])
{
    return a[0] * b[1] - a[1] * b[0];
}

/** Twice the area of a face whose steps sum up to 0. */
static int32_t face_area(const steps_work *w, uint32_t face)
{
    return area_of(w->m->step[3 * face], w->m->step[3 * face + 1]);
}

/** Twice the area after steps of one axis of two half-edges change by +change and -change, or of the first alone where that
 * closes the face. */
static int32_t area_after(const steps_work *w, uint32_t up, uint32_t down, int axis, int change)
{
    int32_t a[2] = {w->m->step[up][0], w->m->step[up][1]};
    uint32_t next = qm_trimesh_next(up);
    int32_t b[2] = {w->m->step[next][0], w->m->step[next][1]};
    a[axis] += change;
    if (next == down) b[axis] -= change;
    return area_of(a, b);
}

static double change_cost(const steps_work *w, uint32_t h, int axis, int change)
{
    double target = w->map->step[h][axis];
    int32_t now = w->m->step[h][axis], then = now + change;
    double cost = STEP_COST + fabs(then - target) - fabs(now - target);
    int beyond = abs(then) - 1;
    if (beyond > 0) cost += LONG_COST * beyond;
    if (then == 0 && w->map->is_across[h] >> axis & 1) cost += STRIP_COST;
    return qm_max(cost, MIN_COST);
}

static bool may_change(const steps_work *w, uint32_t h, int axis)
{
    return !w->m->is_feature[h] || qm_quads_feature_axis(w->map, h) == axis;
}

/** A node: an excess of a sign that has come into the face of a half-edge across it. */
static uint32_t node_of(uint32_t h, int axis, int sign)
{
    return 4 * h + 2 * (uint32_t)axis + (sign > 0);
}

/** What a change of a step does to that of the twin. */
static void across(const steps_work *w, uint32_t h, int axis, int change, int *twin_axis, int *twin_change)
{
    int32_t s[2] = {0, 0};
    s[axis] = -change;
    turn(s, w->map->turned[h]);
    *twin_axis = s[0] == 0;
    *twin_change = s[*twin_axis];
}

static bool push(steps_work *w, uint32_t number, double distance, uint32_t before)
{
    path_node *node = &w->node[number];
    if (node->stamp == w->stamp && node->distance <= distance) return true;
    *node = (path_node){distance, w->stamp, before, w->growing};
    return qm_heap_push(w->ctx, &w->heap, (qm_heap_item){distance, number, 0}) == QM_OK;
}

/**
 * Lets an excess of a sign leave a face. entry is the half-edge by which it came, or QM_NO_INDEX at the start. Leaving by a
 * boundary is a node of that half-edge itself.
 */
static bool leave(steps_work *w, uint32_t face, int axis, int sign, uint32_t entry, double distance,
                  uint32_t before)
{
    const qm_trimesh *m = w->m;
    bool has_memory = true;
    int32_t area = face_area(w, face);
    for (uint32_t h = 3 * face; h < 3 * face + 3 && has_memory; h++) {
        if (h == entry || !may_change(w, h, axis)) continue;
        int change = -sign;
        double cost = distance + change_cost(w, h, axis, change);
        if (entry != QM_NO_INDEX) {
            int32_t then = area_after(w, entry, h, axis, sign);
            if (then < 0 && area >= 0) cost += FOLD_COST;
            if (then >= 0 && area < 0) cost = qm_max(cost - FOLD_COST, distance + MIN_COST);
        } else if (w->excess[face][0] == 0 && w->excess[face][1] == 0) {
            /* the only excess of the face: it is closed after this change */
            if (area_after(w, h, QM_NO_INDEX, axis, change) < 0) cost += FOLD_COST;
        }
        uint32_t t = m->twin[h];
        if (t == QM_NO_INDEX) {
            has_memory = push(w, 4 * h + 2 * (uint32_t)axis + (change > 0), cost, before);
            continue;
        }
        int twin_axis, twin_change;
        across(w, h, axis, change, &twin_axis, &twin_change);
        if (w->excess[t / 3][twin_axis] * twin_change <
            0) { /* it ends there: the face is closed, if this was all */
            int32_t rest = w->excess[t / 3][twin_axis] + twin_change;
            if (rest == 0 && w->excess[t / 3][1 - twin_axis] == 0 &&
                area_after(w, t, QM_NO_INDEX, twin_axis, twin_change) < 0)
                cost += FOLD_COST;
        }
        has_memory = push(w, node_of(t, twin_axis, twin_change), cost, before);
    }
    return has_memory;
}

/** Applies the changes of a path that ends at a node. */
static void apply(const steps_work *w, uint32_t node)
{
    while (node != QM_NO_INDEX) {
        uint32_t h = node / 4;
        int axis = node >> 1 & 1, change = node & 1 ? 1 : -1;
        int32_t step[2] = {w->m->step[h][0], w->m->step[h][1]};
        step[axis] += change;
        set_step(w, h, step);
        node = w->node[node].before;
    }
}

/** Moves an excess of 1 out of a face, to its nearest opposite. *is_done is false if there is none. */
static qm_status move_excess(steps_work *w, uint32_t face, int axis, bool *is_done)
{
    int sign = w->excess[face][axis] > 0 ? 1 : -1;
    *is_done = false;
    w->excess[face][axis] -= sign;
    w->stamp++;
    w->heap.count = 0;
    if (!leave(w, face, axis, sign, QM_NO_INDEX, 0.0, QM_NO_INDEX)) return QM_E_NO_MEMORY;
    size_t popped = 0;
    while (w->heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&w->heap);
        uint32_t node = item.number, h = node / 4;
        if (item.key > w->node[node].distance) continue;
        int at_axis = node >> 1 & 1, at_sign = node & 1 ? 1 : -1;
        bool is_boundary = w->m->twin[h] == QM_NO_INDEX;
        if (is_boundary || w->excess[h / 3][at_axis] * at_sign < 0) {
            if (!is_boundary) w->excess[h / 3][at_axis] += at_sign;
            apply(w, node);
            *is_done = true;
            return QM_OK;
        }
        if (!leave(w, h / 3, at_axis, at_sign, h, item.key, node)) return QM_E_NO_MEMORY;
        if (++popped % 4096 == 0 && qm_context_canceled(w->ctx)) return QM_E_CANCELED;
    }
    w->excess[face][axis] += sign;
    return QM_OK;
}

/*
 * Paths grow from all excesses at once, each into what is nearer to it than to the others. Where two meet whose excesses
 * cancel, there is a path between them; those that are among the cheapest of both their ends are applied, and the rest starts
 * anew.
 */

static bool add_meeting(steps_work *w, path_meeting met)
{
    if (w->meeting_count == w->meeting_capacity) {
        size_t capacity = 2 * w->meeting_capacity + 64;
        path_meeting *grown =
            qm_context_resize(w->ctx, w->meeting, w->meeting_capacity, capacity, sizeof *w->meeting);
        if (!grown) return false;
        w->meeting = grown, w->meeting_capacity = capacity;
    }
    for (int k = 0; k < 2; k++)
        if (met.source[k] != QM_NO_INDEX)
            w->source[met.source[k]].best = qm_min(w->source[met.source[k]].best, met.cost);
    w->meeting[w->meeting_count++] = met;
    return true;
}

static uint32_t *arrival_at(const steps_work *w, uint32_t face, int axis, int sign)
{
    return &w->arrival[4 * face + 2 * (uint32_t)axis + (sign > 0)];
}

#define AT_SOURCE 0x80000000u /* of an arrival: the number of a source, not of a node */

/** Notes that a node was reached, and whether the opposite was reached from another source. */
static bool arrive(steps_work *w, uint32_t face, int axis, int sign, uint32_t node, double distance)
{
    uint32_t *mine = arrival_at(w, face, axis, sign), other = *arrival_at(w, face, axis, -sign);
    if (*mine == QM_NO_INDEX) *mine = node;
    if (other == QM_NO_INDEX) return true;
    path_meeting met = {
        .cost = distance, .end = {node, QM_NO_INDEX}, .source = {w->growing, other & ~AT_SOURCE}};
    if (!(other & AT_SOURCE)) {
        met.cost += w->node[other].distance;
        met.end[1] = other;
        met.source[1] = w->node[other].source;
    }
    if (node & AT_SOURCE) met.end[0] = QM_NO_INDEX;
    return met.source[0] == met.source[1] || add_meeting(w, met);
}

static qm_status list_sources(steps_work *w)
{
    size_t count = 0;
    for (uint32_t f = 0; f < w->m->face_count; f++)
        count += (size_t)(w->excess[f][0] != 0) + (size_t)(w->excess[f][1] != 0);
    w->source_count = 0;
    if (count > w->source_capacity) {
        qm_context_free(w->ctx, w->source, w->source_capacity, sizeof *w->source);
        w->source_capacity = 0;
        w->source = qm_context_alloc(w->ctx, count, sizeof *w->source);
        if (!w->source) return QM_E_NO_MEMORY;
        w->source_capacity = count;
    }
    for (uint32_t f = 0; f < w->m->face_count; f++)
        for (int axis = 0; axis < 2; axis++)
            if (w->excess[f][axis] != 0)
                w->source[w->source_count++] =
                    (path_source){f, axis, w->excess[f][axis] > 0 ? 1 : -1, INFINITY, false};
    return QM_OK;
}

static qm_status grow_paths(steps_work *w)
{
    w->stamp++;
    w->heap.count = w->meeting_count = 0;
    w->is_cut = false;
    memset(w->arrival, 0xff, 4 * w->m->face_count * sizeof *w->arrival);
    for (uint32_t i = 0; i < w->source_count; i++) {
        const path_source *s = &w->source[i];
        w->growing = i;
        w->excess[s->face][s->axis] -= s->sign;
        bool has_memory = arrive(w, s->face, s->axis, s->sign, i | AT_SOURCE, 0.0) &&
                          leave(w, s->face, s->axis, s->sign, QM_NO_INDEX, 0.0, QM_NO_INDEX);
        w->excess[s->face][s->axis] += s->sign;
        if (!has_memory) return QM_E_NO_MEMORY;
    }
    for (size_t popped = 0; w->heap.count > 0; popped++) {
        if (popped % 4096 == 0 && qm_context_canceled(w->ctx)) return QM_E_CANCELED;
        qm_heap_item item = qm_heap_pop(&w->heap);
        uint32_t node = item.number, h = node / 4;
        if (item.key > w->node[node].distance) continue;
        w->growing = w->node[node].source;
        /* the other end of a cheaper path would have come half of the way */
        if (item.key > 0.5 * w->source[w->growing].best + REACH_COST) continue;
        if (item.key > w->reach) {
            w->is_cut = true;
            break;
        }
        int axis = node >> 1 & 1, sign = node & 1 ? 1 : -1;
        if (w->m->twin[h] == QM_NO_INDEX) {
            const path_meeting met = {item.key, {node, QM_NO_INDEX}, {w->growing, QM_NO_INDEX}};
            if (!add_meeting(w, met)) return QM_E_NO_MEMORY;
            continue;
        }
        if (!arrive(w, h / 3, axis, sign, node, item.key) || !leave(w, h / 3, axis, sign, h, item.key, node))
            return QM_E_NO_MEMORY;
    }
    return QM_OK;
}

static int compare_meetings(const void *a, const void *b)
{
    const path_meeting *x = a, *y = b;
    if (x->cost != y->cost) return x->cost < y->cost ? -1 : 1;
    if (x->source[0] != y->source[0]) return x->source[0] < y->source[0] ? -1 : 1;
    if (x->source[1] != y->source[1]) return x->source[1] < y->source[1] ? -1 : 1;
    if (x->end[0] != y->end[0]) return x->end[0] < y->end[0] ? -1 : 1;
    return (x->end[1] > y->end[1]) - (x->end[1] < y->end[1]);
}

/** Applies the paths that are among the cheapest of both ends; returns their number. */
static size_t join_sources(steps_work *w)
{
    size_t joined = 0;
    if (w->meeting_count > 0) qsort(w->meeting, w->meeting_count, sizeof *w->meeting, compare_meetings);
    for (size_t i = 0; i < w->meeting_count; i++) {
        const path_meeting *met = &w->meeting[i];
        bool is_near = true;
        for (int k = 0; k < 2; k++) {
            if (met->source[k] == QM_NO_INDEX) continue;
            const path_source *s = &w->source[met->source[k]];
            is_near = is_near && !s->is_joined && met->cost <= NEAR_FACTOR * s->best + NEAR_COST;
        }
        if (!is_near) continue;
        joined++;
        for (int k = 0; k < 2; k++) {
            if (met->source[k] == QM_NO_INDEX) continue;
            path_source *s = &w->source[met->source[k]];
            s->is_joined = true;
            w->excess[s->face][s->axis] -= s->sign;
            apply(w, met->end[k]);
        }
    }
    return joined;
}

/** Closes the faces. Nodes of boundaries are those of a half-edge without twin: nothing can come in by it, so they have no other
 * meaning. What the common growth does not join, such as an excess of 2 and its own image round a singular vertex, is
 * moved one by one. */
static qm_status close_faces(steps_work *w, qm_quads_record *record)
{
    const qm_trimesh *m = w->m;
    for (uint32_t f = 0; f < m->face_count; f++) {
        for (int axis = 0; axis < 2; axis++)
            w->excess[f][axis] = m->step[3 * f][axis] + m->step[3 * f + 1][axis] + m->step[3 * f + 2][axis];
        record->steps_inconsistent += w->excess[f][0] != 0 || w->excess[f][1] != 0;
    }
    size_t joined = 1;
    for (w->reach = FIRST_REACH; joined > 0 || w->is_cut;) {
        qm_status status = list_sources(w);
        if (status == QM_OK) status = grow_paths(w);
        if (status != QM_OK) return status;
        joined = join_sources(w);
        if (8 * joined < w->source_count) w->reach *= 2.0;
    }
    for (uint32_t f = 0; f < m->face_count; f++) {
        for (int axis = 0; axis < 2; axis++) {
            bool is_done = true;
            while (w->excess[f][axis] != 0 && is_done) {
                qm_status status = move_excess(w, f, axis, &is_done);
                if (status != QM_OK) return status;
            }
            record->steps_open += w->excess[f][axis] != 0;
        }
    }
    return QM_OK;
}

/*
 * Folds: a vertex is moved by 1 on the grid where that leaves fewer faces upside down.
 */

static double fan_energy(const steps_work *w, uint32_t first)
{
    const qm_trimesh *m = w->m;
    double sum = 0.0;
    uint32_t h = first;
    do {
        uint32_t back = qm_trimesh_prev(h);
        if (face_area(w, h / 3) < 0) sum += FOLD_COST;
        for (int axis = 0; axis < 2; axis++) {
            sum += fabs(m->step[h][axis] - (double)w->map->step[h][axis]);
            sum += fabs(m->step[back][axis] - (double)w->map->step[back][axis]);
            sum += LONG_COST * ((abs(m->step[h][axis]) > 1) + (abs(m->step[back][axis]) > 1));
        }
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return sum;
}

/** Moves a vertex by a pair in the frame of the face of first; false, and nothing is moved, if it is singular or a feature
 * holds it. */
static bool shift(const steps_work *w, uint32_t first, int32_t x, int32_t y)
{
    const qm_trimesh *m = w->m;
    int32_t move[2] = {x, y};
    uint32_t h = first;
    do { /* once round without a change */
        uint32_t back = qm_trimesh_prev(h);
        if (m->is_feature[h] && move[1 - qm_quads_feature_axis(w->map, h)] != 0) return false;
        if (m->is_feature[back] && move[1 - qm_quads_feature_axis(w->map, back)] != 0) return false;
        turn(move, w->map->turned[back]);
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    if (h == first && (move[0] != x || move[1] != y)) return false;
    move[0] = x, move[1] = y;
    h = first;
    do {
        uint32_t back = qm_trimesh_prev(h);
        for (int axis = 0; axis < 2; axis++) {
            m->step[h][axis] -= move[axis];
            m->step[back][axis] += move[axis];
        }
        turn(move, w->map->turned[back]);
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return true;
}

static bool unfold_vertex(const steps_work *w, uint32_t vertex)
{
    static const int8_t moves[8][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}, {1, 1}, {-1, 1}, {-1, -1}, {1, -1}};
    if (w->m->is_fixed[vertex]) return false;
    uint32_t first = qm_trimesh_first(w->m, vertex);
    double least = fan_energy(w, first) - 1e-9;
    int best = -1;
    for (int k = 0; k < 8; k++) {
        if (!shift(w, first, moves[k][0], moves[k][1])) continue;
        double energy = fan_energy(w, first);
        if (energy < least) least = energy, best = k;
        shift(w, first, -moves[k][0], -moves[k][1]);
    }
    return best >= 0 && shift(w, first, moves[best][0], moves[best][1]);
}

static void unfold(const steps_work *w)
{
    /* The flow has changed steps one by one: what lies between its paths follows here. */
    for (int round = 0; round < FOLLOW_ROUNDS; round++)
        for (uint32_t v = 0; v < w->m->vertex_count; v++)
            unfold_vertex(w, v);
    bool is_changing = true;
    for (int round = 0; round < REPAIR_ROUNDS && is_changing; round++) {
        is_changing = false;
        for (uint32_t f = 0; f < w->m->face_count; f++)
            for (uint32_t k = 0; k < 3 && face_area(w, f) < 0; k++)
                is_changing |= unfold_vertex(w, w->m->from[3 * f + k]);
    }
}

static void count_turns(const steps_work *w, qm_quads_record *record)
{
    for (uint32_t v = 0; v < w->m->vertex_count; v++) {
        uint32_t first = qm_trimesh_first(w->m, v), h = first;
        int sum = 0;
        do {
            sum += w->map->turned[qm_trimesh_prev(h)];
            h = qm_trimesh_around(w->m, h);
        } while (h != QM_NO_INDEX && h != first);
        record->crosses_turned += h != QM_NO_INDEX && (sum & 3) != 0;
    }
}

/** Sets the steps round a new vertex in the middle of h, on one side: first is that of h, rest that of its other half, both in
 * the frame of the face. */
static void set_halves(qm_trimesh *m, uint32_t h, const int32_t first[2], const int32_t rest[2])
{
    uint32_t inner = qm_trimesh_next(h), outer = m->twin[inner], second = qm_trimesh_next(outer);
    for (int axis = 0; axis < 2; axis++) {
        m->step[h][axis] = first[axis];
        m->step[second][axis] = rest[axis];
        m->step[inner][axis] = -first[axis] - m->step[qm_trimesh_prev(h)][axis];
        m->step[outer][axis] = -m->step[inner][axis];
    }
}

/** Inserts a vertex in the middle of the step of an edge. */
static qm_status split_step(qm_context *ctx, qm_trimesh *m, uint32_t h)
{
    uint32_t t = m->twin[h], vertex;
    int32_t first[2], rest[2];
    int quarters = 0;
    for (int axis = 0; axis < 2; axis++) {
        first[axis] = m->step[h][axis] / 2;
        rest[axis] = m->step[h][axis] - first[axis];
    }
    for (; t != QM_NO_INDEX && quarters < 3; quarters++) {
        int32_t back[2] = {-m->step[h][0], -m->step[h][1]};
        turn(back, quarters);
        if (back[0] == m->step[t][0] && back[1] == m->step[t][1]) break;
    }
    qm_vec middle = qm_vec_mix(m->position[m->from[h]], m->position[qm_trimesh_to(m, h)], 0.5);
    qm_status status = qm_trimesh_split(ctx, m, h, middle, &vertex);
    if (status != QM_OK) return status;
    set_halves(m, h, first, rest);
    if (t == QM_NO_INDEX) return QM_OK;
    for (int axis = 0; axis < 2; axis++)
        first[axis] = -first[axis], rest[axis] = -rest[axis];
    turn(first, quarters);
    turn(rest, quarters);
    set_halves(m, t, rest, first);
    return QM_OK;
}

/** The square of the length of a step; 0 if no component is beyond 1. */
static int32_t excess_length(const int32_t step[2])
{
    return abs(step[0]) > 1 || abs(step[1]) > 1 ? step[0] * step[0] + step[1] * step[1] : 0;
}

/**
 * Splits edges with a step beyond 1 in half: the mesh then has a vertex at each corner of the grid that it passes. Turns
 * are not kept. The longest come first: the new edge to the opposite corner is then shorter than the one that is split.
 */
static qm_status split_steps(qm_context *ctx, qm_trimesh *m)
{
    for (;;) {
        int32_t longest = 0;
        for (uint32_t h = 0; h < 3 * m->face_count; h++) {
            int32_t length = excess_length(m->step[h]);
            if (length > longest) longest = length;
        }
        if (longest == 0) return QM_OK;
        for (uint32_t h = 0; h < 3 * m->face_count; h++) {
            if (excess_length(m->step[h]) < longest) continue;
            qm_status status = split_step(ctx, m, h);
            if (status != QM_OK) return status;
        }
        if (qm_context_canceled(ctx)) return QM_E_CANCELED;
    }
}

static bool alloc_work(steps_work *w)
{
    size_t faces = w->m->face_count, nodes = 12 * faces;
    w->excess = qm_context_alloc(w->ctx, faces, sizeof *w->excess);
    w->node = qm_context_alloc(w->ctx, nodes, sizeof *w->node);
    w->arrival = qm_context_alloc(w->ctx, 4 * faces, sizeof *w->arrival);
    if (w->node) memset(w->node, 0, nodes * sizeof *w->node);
    return w->excess && w->node && w->arrival;
}

static void free_work(steps_work *w, size_t faces)
{
    size_t nodes = 12 * faces;
    qm_context_free(w->ctx, w->excess, faces, sizeof *w->excess);
    qm_context_free(w->ctx, w->node, nodes, sizeof *w->node);
    qm_context_free(w->ctx, w->arrival, 4 * faces, sizeof *w->arrival);
    qm_context_free(w->ctx, w->source, w->source_capacity, sizeof *w->source);
    qm_context_free(w->ctx, w->meeting, w->meeting_capacity, sizeof *w->meeting);
    qm_heap_reset(w->ctx, &w->heap);
}

/** The integers of a map whose phases are known. */
static qm_status choose_steps(qm_context *ctx, qm_trimesh *m, const qm_vec *cross, const qm_quads_map *map,
                              const qm_quads_phases *phases, double size, qm_quads_record *record)
{
    steps_work w = {.ctx = ctx, .m = m, .map = map};
    size_t faces = m->face_count;
    qm_status status = alloc_work(&w) ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        read_steps(&w, phases);
        count_turns(&w, record);
        status = close_faces(&w, record);
    }
    if (status == QM_OK) {
        unfold(&w);
        for (uint32_t f = 0; f < faces; f++)
            record->steps_folded += face_area(&w, f) < 0;
        status = move_to_corners(&w, cross, phases, size);
    }
    free_work(&w, faces);
    return status;
}

qm_status qm_quads_find_steps(qm_context *ctx, qm_trimesh *m, const qm_vec *cross, const qm_quads_map *map,
                              double size, qm_quads_record *record)
{
    size_t vertices = m->vertex_count, halves = 3 * m->face_count;
    const qm_quads_phases phases = {qm_context_alloc(ctx, vertices, sizeof *phases.phase),
                                    qm_context_alloc(ctx, halves, 1)};
    qm_status status =
        phases.phase && phases.turned ? qm_quads_find_phases(ctx, m, map, &phases) : QM_E_NO_MEMORY;
    if (status == QM_OK) status = choose_steps(ctx, m, cross, map, &phases, size, record);
    qm_context_free(ctx, phases.phase, vertices, sizeof *phases.phase);
    qm_context_free(ctx, phases.turned, halves, 1);
    return status == QM_OK ? split_steps(ctx, m) : status;
}
