/**
 * tmesh_lengths.c: integer lengths of arcs that give a layout of few faces.
 *
 * Opposite sides of a patch have equal sums, and each arc lies on one or two sides: so lengths are a flow in a
 * bidirected graph, whose nodes are the two axes of each patch and whose edges are the arcs. A change that
 * keeps all sums equal is a closed walk, or one from boundary to boundary: it changes an arc by one, then, where the
 * patch on the other side has become uneven, an arc of the opposite side in the same sense, or one of the same side in
 * the other, and so on. Cheapest walks are found by Dijkstra's algorithm on pairs of a slot and a sense, which
 * are the double cover of that graph.
 *
 * All lengths are 0 at first: everything is one point. As long as there is a fault (tmesh_classes.c), the cheapest
 * walk that lengthens one of its arcs is taken; to lengthen an axis of a patch costs as many faces as the other axis has
 * steps. Then come trials: a walk that shortens an arc, repaired as before, is kept when fewer faces
 * remain. The lengths of the quads themselves are the last resort: they are a layout unless two quads share
 * two opposite corners or the like.
 *
 * Source: Campen, Bommes, Kobbelt, Quantized global parametrization, 2015; Lyon, Campen, Kobbelt, Quad layouts via
 *         constrained T-mesh quantization, 2021; Heistermann, Warnett, Bommes, Min-deviation-flow in bi-directed graphs for
 *         T-mesh quantization, 2023.
 */
#include <math.h>
#include <string.h>

#include "core/heap.h"
#include "tmesh/tmesh.h"

/* Costs in faces. A pass that lengthens an axis costs 1 beside the faces that it makes, one that shortens it and a turn to
 * the same side cost little: so that of equal walks the shorter is taken. */
#define SHORTEN_COST 0.05
#define TURN_COST 0.05
/* Trials: costs are multiplied by up to 1 + NOISE; HEAT is the mean gain, in faces, that is given up at the start. STARTS
 * constructions are tried, with a share of 1 / START_SHARE of all trials each, and the best goes on. SIDE_WORTH is what
 * a step of a side is worth in faces: it leads out of states where many changes make no difference. */
#define NOISE 10
#define HEAT 1
#define STARTS 6
#define START_SHARE 12
#define FEWEST_TRIALS 24
#define SIDE_WORTH 0.3
#define MOST_RINGS 3 /* of classes round a fault, in which arcs are lengthened too */
/* One of so many faulty classes is spread at a time. */
#define SPREAD_PART 6
#define SPREAD_EFFORT 200
/* Faults that are looked at together, and the part of them that is mended then: a walk often mends several. */
#define FAULTS_AT_ONCE 64
#define MENDED_PART 16
#define STALLED_REPAIRS 200 /* rounds without fewer faults, after which arcs would grow without end */
/* Trials times arcs: a limit of time for meshes with thousands of irregular vertices. */
#define MOST_WORK 2000000

typedef struct lengths_finder {
    qm_context *ctx;
    const qm_tmesh_quads *quads;
    const qm_tmesh *tmesh;
    uint32_t *length;
    bool *is_held; /* by arc: it must keep a length; NULL: none must */
    uint32_t *saved, *best, *first;
    uint32_t *steps; /* 2 a patch: of its axes */
    qm_arena lasting, scratch;
    /* Walks: by state, 2 * slot + 1 when the arc is lengthened. */
    double *cost;
    uint32_t *before; /* state */
    uint32_t *round;  /* of the search that reached it */
    uint32_t searches;
    qm_heap heap;
    uint32_t *walk, *best_walk; /* states whose arcs change, from the last to the first */
    size_t walk_count, best_count;
    double scale; /* edges of the quads in a side of a patch, about */
    uint32_t random;
    uint32_t seed;     /* of the noise in costs; 0: none */
    bool has_boundary; /* an arc has one patch */
    bool no_memory;
} lengths_finder;

static uint32_t next_random(lengths_finder *finder)
{
    finder->random = finder->random * 1664525u + 1013904223u;
    return finder->random >> 8;
}

static void measure_steps(lengths_finder *finder)
{
    for (size_t p = 0; p < finder->tmesh->patch_count; p++)
        for (int axis = 0; axis < 2; axis++)
            finder->steps[2 * p + (size_t)axis] =
                qm_tmesh_side_length(finder->tmesh, finder->length, p, axis);
}

static size_t count_faces(lengths_finder *finder)
{
    measure_steps(finder);
    size_t faces = 0;
    for (size_t p = 0; p < finder->tmesh->patch_count; p++)
        faces += (size_t)finder->steps[2 * p] * finder->steps[2 * p + 1];
    return faces;
}

/* ---- cheapest walks ---- */

static void reach(lengths_finder *finder, uint32_t state, double cost, uint32_t before, double limit)
{
    if (cost >= limit || (finder->round[state] == finder->searches && finder->cost[state] <= cost)) return;
    finder->round[state] = finder->searches;
    finder->cost[state] = cost;
    finder->before[state] = before;
    if (qm_heap_push(finder->ctx, &finder->heap, (qm_heap_item){cost, state, 0}) != QM_OK)
        finder->no_memory = true;
}

/** A number from 0 to 1 for an axis of a patch, another for each seed. */
static double noise_of(uint32_t seed, uint32_t axis)
{
    uint32_t key = seed ^ axis * 2654435761u;
    key = (key ^ key >> 15) * 0x2c1b3c6du;
    key = (key ^ key >> 12) * 0x297a2d39u;
    return (double)((key ^ key >> 15) >> 8) / 16777216.0;
}

static double pass_cost(const lengths_finder *finder, const qm_tmesh_slot *slot, bool lengthen)
{
    if (!lengthen) return SHORTEN_COST;
    uint32_t axis = 2 * slot->patch + (slot->side & 1);
    double cost = 1 + finder->steps[axis ^ 1];
    return finder->seed ? cost * (1 + NOISE * noise_of(finder->seed, axis)) : cost;
}

/** What it costs to lengthen an arc that is short in the quads. */
static double short_cost(const lengths_finder *finder, uint32_t arc)
{
    return finder->scale * (finder->length[arc] + 1) / finder->tmesh->arcs[arc].length;
}

/** What a walk may do. */
typedef struct walk_rules {
    bool may_close;    /* end at its first arc, or else at boundaries alone */
    bool starts_short; /* the arc is shortened, and others may be; or else none is */
} walk_rules;

/**
 * Finds the cheapest walk from a slot whose arc is changed: its states, the last first, into finder->walk from
 * walk_count on. Returns its cost, or INFINITY when there is none below the limit. The arc of the first state
 * is not among them when the walk starts from the second slot.
 */
static double find_walk(lengths_finder *finder, uint32_t slot, walk_rules rules, double limit)
{
    const qm_tmesh *tmesh = finder->tmesh;
    uint32_t sense = rules.starts_short ? 0 : 1, first = 2 * slot + sense;
    finder->searches++;
    finder->heap.count = 0;
    finder->round[first] = finder->searches;
    finder->cost[first] = 0;
    finder->before[first] = first;
    if (qm_heap_push(finder->ctx, &finder->heap, (qm_heap_item){0, first, 0}) != QM_OK)
        finder->no_memory = true;
    while (finder->heap.count > 0 && !finder->no_memory) {
        qm_heap_item item = qm_heap_pop(&finder->heap);
        uint32_t state = item.number, at = state >> 1;
        if (item.key > finder->cost[state]) continue;
        bool lengthen = state & 1;
        const qm_tmesh_slot *from = &tmesh->slots[at];
        const qm_tmesh_patch *patch = &tmesh->patches[from->patch];
        for (int turn = 0; turn < 2; turn++) {
            int side = (from->side + (turn ? 0 : 2)) & 3;
            bool next_lengthen = lengthen != (turn == 1);
            double side_cost = item.key + (turn ? TURN_COST : pass_cost(finder, from, lengthen));
            for (uint32_t t = patch->first[side]; t < patch->first[side + 1]; t++) {
                uint32_t arc = tmesh->slots[t].arc, mate = qm_tmesh_mate(tmesh, t);
                /* A patch that meets itself in this arc may only close the walk. */
                bool closes = rules.may_close && at == slot && !turn && t != at;
                if ((arc == tmesh->slots[at].arc || (mate == QM_NO_INDEX && arc == tmesh->slots[slot].arc)) &&
                    !closes)
                    continue;
                if (!next_lengthen && (finder->length[arc] == 0 || !rules.starts_short)) continue;
                double cost = side_cost + (next_lengthen ? short_cost(finder, arc) : 0);
                uint32_t reached = mate == QM_NO_INDEX ? QM_NO_INDEX : 2 * mate + next_lengthen;
                bool ends = mate == QM_NO_INDEX ? !rules.may_close : rules.may_close && reached == first;
                if (ends && cost < limit) { /* perhaps not the cheapest end, but it is near */
                    if (mate == QM_NO_INDEX) finder->walk[finder->walk_count++] = 2 * t + next_lengthen;
                    for (uint32_t s = state;; s = finder->before[s]) {
                        finder->walk[finder->walk_count++] = s;
                        if (s == finder->before[s]) break;
                    }
                    return cost;
                }
                if (mate != QM_NO_INDEX && arc != tmesh->slots[slot].arc)
                    reach(finder, reached, cost, state, limit);
            }
        }
    }
    return INFINITY;
}

/** Finds the cheapest walk that changes an arc: closed, or from boundary to boundary. */
static double find_change(lengths_finder *finder, uint32_t arc, walk_rules rules, double limit)
{
    const uint32_t *slot = finder->tmesh->arcs[arc].slot;
    finder->walk_count = 0;
    double closed = INFINITY;
    if (slot[1] != QM_NO_INDEX) {
        rules.may_close = true;
        closed = find_walk(finder, slot[0], rules, limit);
        if (closed < limit) limit = closed;
    }
    if (!finder->has_boundary) return closed;
    size_t closed_count = finder->walk_count;
    rules.may_close = false;
    double open = find_walk(finder, slot[0], rules, limit);
    if (open < limit && slot[1] != QM_NO_INDEX) {
        double other = find_walk(finder, slot[1], rules, limit - open);
        open += other;
        finder->walk_count--; /* the arc itself is in the first part */
    }
    if (open < limit) {
        memmove(finder->walk, finder->walk + closed_count,
                (finder->walk_count - closed_count) * sizeof *finder->walk);
        finder->walk_count -= closed_count;
        return open;
    }
    finder->walk_count = closed_count;
    return closed;
}

/** The length that an arc must keep. */
static uint32_t least_of(const lengths_finder *finder, uint32_t arc)
{
    return finder->is_held && finder->is_held[arc];
}

/** Changes the lengths of a walk's arcs. False, and nothing has changed, when one would be too short. */
static bool take_walk(lengths_finder *finder, const uint32_t *walk, size_t count)
{
    bool is_possible = true;
    size_t done = 0;
    for (; done < count && is_possible; done++) {
        uint32_t *length = &finder->length[finder->tmesh->slots[walk[done] >> 1].arc];
        is_possible = walk[done] & 1 || *length > least_of(finder, finder->tmesh->slots[walk[done] >> 1].arc);
        if (is_possible) *length += walk[done] & 1 ? 1 : UINT32_MAX;
    }
    if (is_possible) return true;
    for (done--; done-- > 0;)
        finder->length[finder->tmesh->slots[walk[done] >> 1].arc] += walk[done] & 1 ? UINT32_MAX : 1;
    return false;
}

/** Lengthens one of some arcs, by the cheapest walk that shortens none; false when there is none. */
static bool lengthen_one(lengths_finder *finder, const uint32_t *arcs, size_t count)
{
    measure_steps(finder);
    double best = INFINITY;
    finder->best_count = 0;
    for (size_t i = 0; i < count; i++) {
        double cost = find_change(finder, arcs[i], (walk_rules){0}, best);
        if (cost >= best) continue;
        best = cost;
        finder->best_count = finder->walk_count;
        memcpy(finder->best_walk, finder->walk, finder->walk_count * sizeof *finder->walk);
    }
    return best < INFINITY && take_walk(finder, finder->best_walk, finder->best_count);
}

/* ---- construction and trials ---- */

static size_t limit_effort(const lengths_finder *finder, size_t effort)
{
    size_t most = MOST_WORK / (finder->tmesh->arc_count + 1);
    return effort < most ? effort : most;
}

/** What lengths are worth: fewer faces first, then shorter sides, and few long arcs without length, which distort. */
static double worth(const lengths_finder *finder, const qm_tmesh_classes *classes)
{
    double loss = 0;
    for (size_t a = 0; a < finder->tmesh->arc_count; a++)
        if (finder->length[a] == 0) {
            double share = finder->tmesh->arcs[a].length / finder->scale;
            loss += share * share;
        }
    return (double)classes->face_count + SIDE_WORTH * (double)classes->side_sum + loss;
}

/**
 * Lengthens arcs until there is no fault, the layout is worth more than the limit, or faults stay.
 *
 * Returns QM_OK with *found, or an error.
 */
static qm_status repair(lengths_finder *finder, double limit, size_t rounds, bool *found, double *value)
{
    *found = false;
    size_t least = SIZE_MAX;
    int stalled = 0;
    for (size_t round = 0; round < rounds && stalled < STALLED_REPAIRS; round++) {
        if (qm_context_canceled(finder->ctx)) return qm_context_fail(finder->ctx, QM_E_CANCELED, "canceled");
        qm_tmesh_classes classes;
        qm_arena_rewind(&finder->scratch);
        qm_status status =
            qm_tmesh_classes_find(&finder->scratch, finder->quads, finder->tmesh, finder->length,
                                  FAULTS_AT_ONCE + finder->tmesh->arc_count / 16, &classes);
        if (status != QM_OK) return status;
        *value = worth(finder, &classes);
        if (*value >= limit) return QM_OK;
        if (classes.fault_count == 0) {
            *found = true;
            return QM_OK;
        }
        stalled = classes.fault_count < least ? 0 : stalled + 1;
        if (stalled == 0) least = classes.fault_count;
        size_t mended = 1 + classes.fault_count / MENDED_PART;
        for (size_t i = 0; i < mended; i++) {
            size_t fault = i * classes.fault_count / mended;
            const uint32_t *first = classes.fault_first + fault;
            if (!lengthen_one(finder, classes.fault_arcs + first[0], first[1] - first[0]))
                return finder->no_memory ? QM_E_NO_MEMORY : QM_OK;
        }
    }
    return QM_OK;
}

static void save(const lengths_finder *finder, uint32_t *copy)
{
    memcpy(copy, finder->length, finder->tmesh->arc_count * sizeof *copy);
}

static void restore(lengths_finder *finder, const uint32_t *copy)
{
    memcpy(finder->length, copy, finder->tmesh->arc_count * sizeof *copy);
}

/** Shortens an arc with the cheapest walk; false when there is none. */
static bool shorten(lengths_finder *finder, uint32_t arc)
{
    if (finder->length[arc] == 0) return false;
    measure_steps(finder);
    double cost = find_change(finder, arc, (walk_rules){.starts_short = true}, INFINITY);
    return cost < INFINITY && take_walk(finder, finder->walk, finder->walk_count);
}

/**
 * Shortens arcs at random and repairs. What comes of it is kept when it is worth less, and at first also when it is worth
 * a little more (annealing); the best remains.
 */
static qm_status try_shorter(lengths_finder *finder, size_t effort, double *value)
{
    uint32_t arcs = (uint32_t)finder->tmesh->arc_count;
    double best = *value;
    save(finder, finder->saved);
    save(finder, finder->best);
    for (size_t trial = 0; trial < effort; trial++) {
        double share = 1 - (double)trial / (double)effort;
        double limit = *value - HEAT * share * share * log((next_random(finder) + 1.0) / 16777217.0);
        bool is_changed = false;
        finder->seed = 1 + next_random(finder);
        for (uint32_t i = 0, count = 1 + next_random(finder) % 3; i < count; i++)
            is_changed |= shorten(finder, next_random(finder) % arcs);
        if (finder->no_memory) return QM_E_NO_MEMORY;
        if (!is_changed) continue;
        bool found;
        double trial_value = INFINITY;
        qm_status status = repair(finder, limit, 48, &found, &trial_value);
        if (status != QM_OK) return status;
        if (!found) {
            restore(finder, finder->saved);
            continue;
        }
        *value = trial_value;
        save(finder, finder->saved);
        if (*value < best) {
            best = *value;
            save(finder, finder->best);
        }
    }
    restore(finder, finder->best);
    *value = best;
    return QM_OK;
}

/** Divides the longest arcs until there are nearly as many faces as wanted. */
static qm_status divide_long(lengths_finder *finder, size_t wanted)
{
    const qm_tmesh *tmesh = finder->tmesh;
    for (;;) {
        save(finder, finder->saved);
        uint32_t longest = 0;
        double length = 0;
        for (uint32_t a = 0; a < tmesh->arc_count; a++) {
            double share = (double)tmesh->arcs[a].length / (finder->length[a] + 1.0);
            if (share > length) longest = a, length = share;
        }
        bool found = false;
        double value;
        qm_status status = QM_OK;
        if (lengthen_one(finder, &longest, 1)) status = repair(finder, INFINITY, 24, &found, &value);
        if (status != QM_OK) return status;
        if (!found || count_faces(finder) > wanted) break;
    }
    restore(finder, finder->saved);
    return QM_OK;
}

static bool allocate(lengths_finder *finder)
{
    size_t arcs = finder->tmesh->arc_count, states = 2 * finder->tmesh->slot_count;
    for (size_t a = 0; a < arcs; a++)
        finder->has_boundary |= finder->tmesh->arcs[a].slot[1] == QM_NO_INDEX;
    finder->saved = qm_arena_alloc(&finder->lasting, arcs, sizeof *finder->saved);
    finder->best = qm_arena_alloc(&finder->lasting, arcs, sizeof *finder->best);
    finder->first = qm_arena_alloc(&finder->lasting, arcs, sizeof *finder->first);
    finder->steps = qm_arena_alloc(&finder->lasting, 2 * finder->tmesh->patch_count, sizeof *finder->steps);
    finder->cost = qm_arena_alloc(&finder->lasting, states, sizeof *finder->cost);
    finder->before = qm_arena_alloc(&finder->lasting, states, sizeof *finder->before);
    finder->round = qm_arena_zeroed(&finder->lasting, states, sizeof *finder->round);
    finder->walk = qm_arena_alloc(&finder->lasting, 4 * states + 4, sizeof *finder->walk);
    finder->best_walk = qm_arena_alloc(&finder->lasting, 4 * states + 4, sizeof *finder->best_walk);
    return finder->saved && finder->best && finder->first && finder->steps && finder->cost &&
           finder->before && finder->round && finder->walk && finder->best_walk;
}

/** Finds lengths from nothing, or else from those of the quads. */
static qm_status construct(lengths_finder *finder, double *value)
{
    const qm_tmesh *tmesh = finder->tmesh;
    size_t rounds = 8 * tmesh->arc_count + 64;
    memset(finder->length, 0, tmesh->arc_count * sizeof *finder->length);
    bool found = false;
    qm_status status = repair(finder, INFINITY, rounds, &found, value);
    if (status != QM_OK || found) return status;
    for (size_t a = 0; a < tmesh->arc_count; a++)
        finder->length[a] = tmesh->arcs[a].length;
    status = repair(finder, INFINITY, rounds, &found, value);
    if (status != QM_OK || found) return status;
    return qm_context_fail(finder->ctx, QM_E_LAYOUT, "the quads bound no layout: some have equal corners");
}

/** Finds lengths of few faces. */
static qm_status find(lengths_finder *finder, size_t effort)
{
    double best = INFINITY, value = INFINITY;
    qm_status status = QM_OK;
    effort = limit_effort(finder, effort);
    for (int start = 0; start < (effort >= FEWEST_TRIALS ? STARTS : 1) && status == QM_OK; start++) {
        finder->seed = start > 0 ? 1 + next_random(finder) : 0;
        status = construct(finder, &value);
        if (status == QM_E_LAYOUT && best < INFINITY) {
            status = QM_OK;
            continue;
        }
        if (status == QM_OK) status = try_shorter(finder, effort / START_SHARE, &value);
        if (status != QM_OK || value >= best) continue;
        best = value;
        save(finder, finder->first);
    }
    if (status != QM_OK) return status;
    restore(finder, finder->first);
    status = try_shorter(finder, effort - effort / START_SHARE * STARTS, &best);
    finder->seed = 0;
    return status;
}

static lengths_finder finder_make(qm_context *ctx, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                  uint32_t *length)
{
    return (lengths_finder){
        .ctx = ctx,
        .quads = quads,
        .tmesh = tmesh,
        .length = length,
        .lasting = qm_arena_make(ctx),
        .scratch = qm_arena_make(ctx),
        .scale = sqrt((double)quads->mesh.face_count / (3.0 * (double)quads->required_count + 1)),
        .random = 1};
}

static qm_status finder_end(lengths_finder *finder, qm_status status)
{
    qm_arena_reset(&finder->lasting);
    qm_arena_reset(&finder->scratch);
    qm_heap_reset(finder->ctx, &finder->heap);
    if (status == QM_E_NO_MEMORY)
        return qm_context_fail(finder->ctx, status, "out of memory for the lengths of arcs");
    return status;
}

qm_status qm_tmesh_find_lengths(qm_context *ctx, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                size_t effort, uint32_t *length)
{
    lengths_finder finder = finder_make(ctx, quads, tmesh, length);
    return finder_end(&finder, allocate(&finder) ? find(&finder, effort) : QM_E_NO_MEMORY);
}

qm_status qm_tmesh_divide_lengths(qm_context *ctx, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                  size_t wanted, uint32_t *length)
{
    lengths_finder finder = finder_make(ctx, quads, tmesh, length);
    return finder_end(&finder, allocate(&finder) ? divide_long(&finder, wanted) : QM_E_NO_MEMORY);
}

/** Lengthens a part of the arcs without length: of each class with this fault the longest, of these the longest. */
static bool lengthen_worst(lengths_finder *finder, const qm_tmesh_classes *classes,
                           const uint8_t *class_fault, uint8_t fault, uint32_t *longest)
{
    const qm_tmesh *tmesh = finder->tmesh;
    size_t count = 0, done = 0;
    memset(longest, 0xff, classes->point_count * sizeof *longest);
    for (uint32_t a = 0; a < tmesh->arc_count; a++) {
        uint32_t root = classes->point_class[tmesh->arcs[a].from];
        if (finder->length[a] > 0 || class_fault[root] != fault) continue;
        if (longest[root] == QM_NO_INDEX || tmesh->arcs[a].length > tmesh->arcs[longest[root]].length)
            longest[root] = a;
    }
    for (size_t i = 0; i < classes->point_count; i++)
        count += longest[i] != QM_NO_INDEX;
    for (size_t part = 0; part < 1 + count / SPREAD_PART; part++) {
        uint32_t worst = QM_NO_INDEX;
        for (size_t i = 0; i < classes->point_count; i++)
            if (longest[i] != QM_NO_INDEX && finder->length[longest[i]] == 0 &&
                (worst == QM_NO_INDEX || tmesh->arcs[longest[i]].length > tmesh->arcs[worst].length))
                worst = longest[i];
        if (worst == QM_NO_INDEX || !lengthen_one(finder, &worst, 1)) break;
        finder->is_held[worst] = true;
        done++;
    }
    return done > 0;
}

/** Marks the classes that arcs connect with marked ones. */
static void widen_faults(const lengths_finder *finder, const qm_tmesh_classes *classes, uint8_t *class_fault)
{
    const uint8_t is_next = 255;
    for (uint32_t a = 0; a < finder->tmesh->arc_count; a++) {
        uint8_t *end[2] = {&class_fault[classes->point_class[finder->tmesh->arcs[a].from]],
                           &class_fault[classes->point_class[finder->tmesh->arcs[a].to]]};
        for (int i = 0; i < 2; i++)
            if (!*end[i] && *end[1 - i] && *end[1 - i] != is_next) *end[i] = is_next;
    }
    for (size_t i = 0; i < classes->point_count; i++)
        class_fault[i] = class_fault[i] > 0;
}

/** Lengthens arcs where the drawing has faults; where all of these have a length, round them. */
static bool lengthen_some(lengths_finder *finder, const qm_tmesh_classes *classes, uint8_t *class_fault,
                          uint32_t *longest)
{
    if (lengthen_worst(finder, classes, class_fault, 2, longest)) return true;
    for (int ring = 0; ring <= MOST_RINGS; ring++) {
        if (lengthen_worst(finder, classes, class_fault, 1, longest)) return true;
        widen_faults(finder, classes, class_fault);
    }
    return false;
}

static qm_status spread(lengths_finder *finder, const qm_tmesh_classes *classes, uint8_t *class_fault,
                        bool *changed)
{
    uint32_t *longest = qm_arena_alloc(&finder->lasting, classes->point_count, sizeof *longest);
    if (!allocate(finder) || !longest) return QM_E_NO_MEMORY;
    save(finder, finder->saved);
    double value = INFINITY;
    qm_status status = QM_OK;
    if (lengthen_some(finder, classes, class_fault, longest))
        status = repair(finder, INFINITY, 64, changed, &value);
    if (status == QM_OK && *changed) return try_shorter(finder, limit_effort(finder, SPREAD_EFFORT), &value);
    restore(finder, finder->saved);
    return status;
}

qm_status qm_tmesh_spread_lengths(qm_context *ctx, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                                  const qm_tmesh_classes *classes, uint8_t *class_fault, bool *is_held,
                                  uint32_t *length, bool *changed)
{
    *changed = false;
    lengths_finder finder = finder_make(ctx, quads, tmesh, length);
    finder.is_held = is_held;
    return finder_end(&finder, spread(&finder, classes, class_fault, changed));
}
