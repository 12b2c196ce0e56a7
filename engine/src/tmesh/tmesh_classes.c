/**
 * tmesh_classes.c: what falls together when arcs have lengths of 0, and whether a layout remains.
 */
#include <string.h>

#include "core/union_find.h"
#include "core/vec.h"
#include "tmesh/tmesh.h"

/** Two points that fall together: the ends of an arc without length, or points across a patch without width. */
typedef struct point_link {
    uint32_t point[2];
    uint32_t slot_first, slot_end; /* of the sides without length: one of these arcs separates them */
    uint32_t arc;                  /* or this one */
} point_link;

typedef struct classes_maker {
    qm_arena *arena;
    const qm_tmesh_quads *quads;
    const qm_tmesh *tmesh;
    const uint32_t *length;
    qm_tmesh_classes *out;
    point_link *links;
    size_t link_count;
    uint32_t *label;  /* by point of a feature: union-find along features */
    bool *on_feature; /* by point */
    int32_t *euler;   /* by lowest point of a class: of its preimage */
    int32_t *segment_euler;
    uint32_t *segment_patch; /* by lowest segment: a patch without width in the class */
    size_t fault_limit, fault_capacity, fault_used;
    uint32_t *fault_of; /* by arc: the last fault that it is in, from 1 on; 0: none */
    /* for paths */
    uint32_t *adjacent_first, *adjacent, *reached_by, *queue;
} classes_maker;

/* ---- points and segments ---- */

static bool number_points(classes_maker *maker)
{
    const qm_tmesh *tmesh = maker->tmesh;
    qm_tmesh_classes *out = maker->out;
    out->first_point = qm_arena_alloc(maker->arena, tmesh->arc_count, sizeof *out->first_point);
    out->first_segment = qm_arena_alloc(maker->arena, tmesh->arc_count, sizeof *out->first_segment);
    if (!out->first_point || !out->first_segment) return false;
    size_t points = tmesh->node_count, segments = 0;
    for (size_t a = 0; a < tmesh->arc_count; a++) {
        out->first_point[a] = (uint32_t)points;
        out->first_segment[a] = (uint32_t)segments;
        segments += maker->length[a];
        points += maker->length[a] > 0 ? maker->length[a] - 1 : 0;
    }
    out->point_count = points;
    out->segment_count = segments;
    out->point_class = qm_arena_alloc(maker->arena, points, sizeof *out->point_class);
    out->segment_class = qm_arena_alloc(maker->arena, segments, sizeof *out->segment_class);
    maker->label = qm_arena_alloc(maker->arena, points, sizeof *maker->label);
    maker->on_feature = qm_arena_zeroed(maker->arena, points, sizeof *maker->on_feature);
    if (!out->point_class || !out->segment_class || !maker->label || !maker->on_feature) return false;
    for (size_t i = 0; i < points; i++)
        out->point_class[i] = maker->label[i] = (uint32_t)i;
    for (size_t i = 0; i < segments; i++)
        out->segment_class[i] = (uint32_t)i;
    for (size_t n = 0; n < tmesh->node_count; n++)
        maker->on_feature[n] = maker->quads->is_on_feature[tmesh->node_vertex[n]];
    for (size_t a = 0; a < tmesh->arc_count; a++)
        for (uint32_t i = 1; i < maker->length[a] && tmesh->arcs[a].is_feature; i++)
            maker->on_feature[out->first_point[a] + i - 1] = true;
    return true;
}

/** The point of an arc at a step from its start. */
static uint32_t arc_point(const classes_maker *maker, uint32_t arc, uint32_t step)
{
    const qm_tmesh_arc *at = &maker->tmesh->arcs[arc];
    if (step == 0) return at->from;
    return step == maker->length[arc] ? at->to : maker->out->first_point[arc] + step - 1;
}

static bool list_sides(classes_maker *maker)
{
    const qm_tmesh *tmesh = maker->tmesh;
    qm_tmesh_classes *out = maker->out;
    out->first_side = qm_arena_alloc(maker->arena, 4 * tmesh->patch_count + 1, sizeof *out->first_side);
    if (!out->first_side) return false;
    size_t total = 0;
    for (size_t p = 0; p < tmesh->patch_count; p++)
        for (int side = 0; side < 4; side++) {
            out->first_side[4 * p + (size_t)side] = (uint32_t)total;
            total += qm_tmesh_side_length(tmesh, maker->length, p, side) + 1;
        }
    out->first_side[4 * tmesh->patch_count] = (uint32_t)total;
    out->side_point = qm_arena_alloc(maker->arena, total, sizeof *out->side_point);
    out->side_segment = qm_arena_alloc(maker->arena, total, sizeof *out->side_segment);
    if (!out->side_point || !out->side_segment) return false;
    for (size_t p = 0; p < tmesh->patch_count; p++)
        for (int side = 0; side < 4; side++) {
            const uint32_t *first = tmesh->patches[p].first;
            size_t at = out->first_side[4 * p + (size_t)side];
            for (uint32_t s = first[side]; s < first[side + 1]; s++) {
                const qm_tmesh_slot *slot = &tmesh->slots[s];
                uint32_t steps = maker->length[slot->arc];
                if (s == first[side])
                    out->side_point[at] = arc_point(maker, slot->arc, slot->forward ? 0 : steps);
                for (uint32_t i = 1; i <= steps; i++) {
                    uint32_t step = slot->forward ? i : steps - i,
                             segment = slot->forward ? i - 1 : steps - i;
                    out->side_segment[at] = (out->first_segment[slot->arc] + segment) << 1 | !slot->forward;
                    out->side_point[++at] = arc_point(maker, slot->arc, step);
                }
            }
            out->side_segment[at] = QM_NO_INDEX;
        }
    return true;
}

/* ---- classes ---- */

static void link_points(classes_maker *maker, uint32_t a, uint32_t b, uint32_t arc, uint32_t slot_first,
                        uint32_t slot_end)
{
    maker->links[maker->link_count++] = (point_link){{a, b}, slot_first, slot_end, arc};
    qm_union_find_join(maker->out->point_class, a, b);
}

static bool link_all(classes_maker *maker)
{
    const qm_tmesh *tmesh = maker->tmesh;
    qm_tmesh_classes *out = maker->out;
    size_t capacity = tmesh->arc_count + out->first_side[4 * tmesh->patch_count];
    maker->links = qm_arena_alloc(maker->arena, capacity, sizeof *maker->links);
    if (!maker->links) return false;
    for (uint32_t a = 0; a < tmesh->arc_count; a++) {
        if (maker->length[a] > 0) continue;
        const qm_tmesh_arc *arc = &tmesh->arcs[a];
        link_points(maker, arc->from, arc->to, a, 0, 0);
        if (arc->is_feature) qm_union_find_join(maker->label, arc->from, arc->to);
    }
    for (size_t p = 0; p < tmesh->patch_count; p++)
        for (int axis = 0; axis < 2; axis++) {
            uint32_t width = qm_tmesh_side_steps(out, p, axis),
                     height = qm_tmesh_side_steps(out, p, axis + 1);
            QM_ASSERT(width == qm_tmesh_side_steps(out, p, axis + 2));
            const uint32_t *first = tmesh->patches[p].first;
            for (uint32_t i = 0; i < height && width == 0; i++) {
                int one = axis + 1, other = (axis + 3) & 3;
                if (i > 0)
                    link_points(maker, qm_tmesh_side_point(out, p, one, i),
                                qm_tmesh_side_point(out, p, other, height - i), QM_NO_INDEX, first[axis],
                                first[axis + 1]);
                qm_union_find_join(out->segment_class, qm_tmesh_side_segment(out, p, one, i) >> 1,
                                   qm_tmesh_side_segment(out, p, other, height - 1 - i) >> 1);
            }
        }
    for (size_t i = 0; i < out->point_count; i++)
        out->point_class[i] = qm_union_find_root(out->point_class, (uint32_t)i);
    for (size_t i = 0; i < out->segment_count; i++)
        out->segment_class[i] = qm_union_find_root(out->segment_class, (uint32_t)i);
    return true;
}

static bool count_euler(classes_maker *maker)
{
    const qm_tmesh *tmesh = maker->tmesh;
    qm_tmesh_classes *out = maker->out;
    maker->euler = qm_arena_zeroed(maker->arena, out->point_count, sizeof *maker->euler);
    maker->segment_euler = qm_arena_zeroed(maker->arena, out->segment_count, sizeof *maker->segment_euler);
    maker->segment_patch = qm_arena_alloc(maker->arena, out->segment_count, sizeof *maker->segment_patch);
    if (!maker->euler || !maker->segment_euler || !maker->segment_patch) return false;
    for (size_t i = 0; i < out->point_count; i++)
        maker->euler[out->point_class[i]]++;
    for (size_t i = 0; i < maker->link_count; i++)
        maker->euler[out->point_class[maker->links[i].point[0]]]--;
    for (size_t i = 0; i < out->segment_count; i++)
        maker->segment_euler[out->segment_class[i]]++;
    out->face_count = out->side_sum = 0;
    for (size_t p = 0; p < tmesh->patch_count; p++) {
        uint32_t width = qm_tmesh_side_steps(out, p, 0), height = qm_tmesh_side_steps(out, p, 1);
        out->face_count += (size_t)width * height;
        out->side_sum += (size_t)width + height;
        if (width == 0 && height == 0) maker->euler[out->point_class[qm_tmesh_side_point(out, p, 0, 0)]]++;
        int side = width == 0 ? 1 : 0;
        for (uint32_t i = 0; i < width + height && (width == 0 || height == 0); i++) {
            uint32_t root = out->segment_class[qm_tmesh_side_segment(out, p, side, i) >> 1];
            maker->segment_euler[root]--;
            maker->segment_patch[root] = (uint32_t)p;
        }
    }
    return true;
}

/* ---- faults ---- */

static bool add_fault_arc(classes_maker *maker, uint32_t arc)
{
    qm_tmesh_classes *out = maker->out;
    if (maker->fault_of[arc] == out->fault_count + 1) return true;
    maker->fault_of[arc] = (uint32_t)out->fault_count + 1;
    if (maker->fault_used == maker->fault_capacity) {
        size_t capacity = 2 * maker->fault_capacity + 64;
        uint32_t *grown = qm_arena_alloc(maker->arena, capacity, sizeof *grown);
        if (!grown) return false;
        if (maker->fault_used) memcpy(grown, out->fault_arcs, maker->fault_used * sizeof *grown);
        out->fault_arcs = grown;
        maker->fault_capacity = capacity;
    }
    out->fault_arcs[maker->fault_used++] = arc;
    return true;
}

static bool add_link_arcs(classes_maker *maker, const point_link *link)
{
    if (link->arc != QM_NO_INDEX) return add_fault_arc(maker, link->arc);
    for (uint32_t s = link->slot_first; s < link->slot_end; s++)
        if (!add_fault_arc(maker, maker->tmesh->slots[s].arc)) return false;
    return true;
}

static bool add_side_arcs(classes_maker *maker, size_t patch, int side)
{
    const uint32_t *first = maker->tmesh->patches[patch].first;
    point_link link = {{0, 0}, first[side], first[side + 1], QM_NO_INDEX};
    return add_link_arcs(maker, &link);
}

static void end_fault(classes_maker *maker)
{
    qm_tmesh_classes *out = maker->out;
    QM_ASSERT(maker->fault_used > out->fault_first[out->fault_count]);
    out->fault_first[++out->fault_count] = (uint32_t)maker->fault_used;
}

static bool prepare_paths(classes_maker *maker)
{
    size_t points = maker->out->point_count;
    if (maker->adjacent_first) return true;
    maker->adjacent_first = qm_arena_zeroed(maker->arena, points + 1, sizeof *maker->adjacent_first);
    maker->adjacent = qm_arena_alloc(maker->arena, 2 * maker->link_count, sizeof *maker->adjacent);
    maker->reached_by = qm_arena_alloc(maker->arena, points, sizeof *maker->reached_by);
    maker->queue = qm_arena_alloc(maker->arena, points, sizeof *maker->queue);
    if (!maker->adjacent_first || !maker->adjacent || !maker->reached_by || !maker->queue) return false;
    memset(maker->reached_by, 0xff, points * sizeof *maker->reached_by);
    for (size_t i = 0; i < maker->link_count; i++)
        for (int end = 0; end < 2; end++)
            maker->adjacent_first[maker->links[i].point[end]]++;
    uint32_t sum = 0;
    for (size_t i = 0; i <= points; i++)
        sum = maker->adjacent_first[i] += sum;
    for (size_t i = maker->link_count; i-- > 0;)
        for (int end = 0; end < 2; end++)
            maker->adjacent[--maker->adjacent_first[maker->links[i].point[end]]] = (uint32_t)i;
    return true;
}

/** Adds a fault: the arcs on a shortest path of links between two points of a class. */
static bool add_path_fault(classes_maker *maker, uint32_t from, uint32_t to)
{
    if (!prepare_paths(maker)) return false;
    size_t head = 0, tail = 0;
    maker->queue[tail++] = from;
    maker->reached_by[from] = (uint32_t)maker->link_count; /* by no link */
    while (head < tail && maker->reached_by[to] == QM_NO_INDEX) {
        uint32_t at = maker->queue[head++];
        for (uint32_t i = maker->adjacent_first[at]; i < maker->adjacent_first[at + 1]; i++) {
            const point_link *link = &maker->links[maker->adjacent[i]];
            uint32_t next = link->point[0] == at ? link->point[1] : link->point[0];
            if (maker->reached_by[next] != QM_NO_INDEX) continue;
            maker->reached_by[next] = maker->adjacent[i];
            maker->queue[tail++] = next;
        }
    }
    bool has_memory = true;
    for (uint32_t at = to; has_memory && at != from;) {
        const point_link *link = &maker->links[maker->reached_by[at]];
        has_memory = add_link_arcs(maker, link);
        at = link->point[0] == at ? link->point[1] : link->point[0];
    }
    for (size_t i = 0; i < tail; i++)
        maker->reached_by[maker->queue[i]] = QM_NO_INDEX;
    return has_memory;
}

static bool is_full(const classes_maker *maker)
{
    return maker->out->fault_count >= maker->fault_limit;
}

/**
 * Finds classes in which two nodes meet that a layout needs, two features, or a feature and an irregular vertex beside it: a
 * quad would have a straight angle on the feature there.
 */
static bool find_meetings(classes_maker *maker)
{
    qm_tmesh_classes *out = maker->out;
    const qm_tmesh *tmesh = maker->tmesh;
    uint32_t *required = qm_arena_alloc(maker->arena, out->point_count, sizeof *required);
    uint32_t *feature = qm_arena_alloc(maker->arena, out->point_count, sizeof *feature);
    if (!required || !feature) return false;
    memset(required, 0xff, out->point_count * sizeof *required);
    memset(feature, 0xff, out->point_count * sizeof *feature);
    for (uint32_t i = 0; i < out->point_count && !is_full(maker); i++) {
        uint32_t root = out->point_class[i], met = QM_NO_INDEX;
        if (i < tmesh->node_count && maker->quads->is_required[tmesh->node_vertex[i]]) {
            met = required[root];
            if (met == QM_NO_INDEX) required[root] = i;
            if (met == QM_NO_INDEX && !maker->on_feature[i]) met = feature[root];
        }
        if (met == QM_NO_INDEX && maker->on_feature[i]) {
            if (required[root] != QM_NO_INDEX && !maker->on_feature[required[root]])
                met = required[root];
            else if (feature[root] == QM_NO_INDEX)
                feature[root] = i;
            else if (qm_union_find_root(maker->label, feature[root]) != qm_union_find_root(maker->label, i))
                met = feature[root];
        }
        if (met == QM_NO_INDEX) continue;
        if (!add_path_fault(maker, met, i)) return false;
        end_fault(maker);
    }
    return true;
}

static bool find_rings(classes_maker *maker)
{
    qm_tmesh_classes *out = maker->out;
    for (uint32_t i = 0; i < out->point_count && !is_full(maker); i++) {
        if (out->point_class[i] != i || maker->euler[i] == 1) continue;
        for (size_t l = 0; l < maker->link_count; l++)
            if (out->point_class[maker->links[l].point[0]] == i && !add_link_arcs(maker, &maker->links[l]))
                return false;
        end_fault(maker);
    }
    uint32_t *feature = qm_arena_zeroed(maker->arena, out->segment_count, sizeof *feature);
    if (!feature) return false;
    for (size_t a = 0; a < maker->tmesh->arc_count; a++)
        for (uint32_t i = 0; i < maker->length[a] && maker->tmesh->arcs[a].is_feature; i++)
            feature[out->segment_class[out->first_segment[a] + i]]++;
    for (uint32_t i = 0; i < out->segment_count && !is_full(maker); i++) {
        if (out->segment_class[i] != i || (maker->segment_euler[i] == 1 && feature[i] < 2)) continue;
        size_t patch = maker->segment_patch[i];
        if (!add_side_arcs(maker, patch, qm_tmesh_side_steps(out, patch, 0) == 0 ? 0 : 1)) return false;
        end_fault(maker);
    }
    return true;
}

/** The point at a column and row of a patch; QM_NO_INDEX for an inner one. */
static uint32_t patch_point(const qm_tmesh_classes *classes, size_t p, uint32_t column, uint32_t row,
                            uint32_t width, uint32_t height)
{
    if (row == 0) return qm_tmesh_side_point(classes, p, 0, column);
    if (column == width) return qm_tmesh_side_point(classes, p, 1, row);
    if (row == height) return qm_tmesh_side_point(classes, p, 2, width - column);
    return column == 0 ? qm_tmesh_side_point(classes, p, 3, height - row) : QM_NO_INDEX;
}

/** Finds two of four corners in one class. */
static bool find_equal(const qm_tmesh_classes *classes, const uint32_t corner[4], int *one, int *other)
{
    for (*one = 1; *one < 4; ++*one)
        for (*other = 0; *other < *one; ++*other)
            if (corner[*one] != QM_NO_INDEX && corner[*other] != QM_NO_INDEX &&
                classes->point_class[corner[*one]] == classes->point_class[corner[*other]])
                return true;
    return false;
}

static bool find_degenerate_faces(classes_maker *maker)
{
    qm_tmesh_classes *out = maker->out;
    for (size_t p = 0; p < maker->tmesh->patch_count; p++) {
        uint32_t width = qm_tmesh_side_steps(out, p, 0), height = qm_tmesh_side_steps(out, p, 1);
        for (uint32_t row = 0; row < height; row++)
            for (uint32_t column = 0; column < width && !is_full(maker); column++) {
                uint32_t corner[4];
                for (uint32_t c = 0; c < 4; c++)
                    corner[c] =
                        patch_point(out, p, column + (c == 1 || c == 2), row + (c > 1), width, height);
                int one, other;
                if (!find_equal(out, corner, &one, &other)) continue;
                if (!add_path_fault(maker, corner[one], corner[other]) || !add_side_arcs(maker, p, 0) ||
                    !add_side_arcs(maker, p, 1))
                    return false;
                end_fault(maker);
            }
    }
    return true;
}

qm_status qm_tmesh_classes_find(qm_arena *arena, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                const uint32_t *length, size_t fault_limit, qm_tmesh_classes *out)
{
    *out = (qm_tmesh_classes){0};
    classes_maker maker = {.arena = arena,
                           .quads = quads,
                           .tmesh = tmesh,
                           .length = length,
                           .out = out,
                           .fault_limit = fault_limit};
    out->fault_first = qm_arena_zeroed(arena, fault_limit + 2, sizeof *out->fault_first);
    maker.fault_of = qm_arena_zeroed(arena, tmesh->arc_count, sizeof *maker.fault_of);
    bool has_memory = out->fault_first && maker.fault_of && number_points(&maker) && list_sides(&maker) &&
                      link_all(&maker) && count_euler(&maker) && find_meetings(&maker) &&
                      find_rings(&maker) && find_degenerate_faces(&maker);
    if (has_memory) return QM_OK;
    return qm_context_fail(arena->ctx, QM_E_NO_MEMORY, "out of memory for a layout of %zu arcs",
                           tmesh->arc_count);
}
