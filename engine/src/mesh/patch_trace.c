/**
 * patch_trace.c: motorcycles. Each step makes one edge a cut; at the vertex that it leads to the cut goes on
 * to the opposite edge when four quads lie round the vertex and none of their other edges is a cut. Where two
 * cuts come to a vertex in the same round, the one that is first in the list goes on, and the other ends at
 * it: so no vertex is ever left with a single cut or a corner of two.
 */
#include "patch_trace.h"

static bool push(qm_patch_trace *trace, qm_spoke step)
{
    if (trace->count == trace->capacity) {
        size_t capacity = 2 * trace->capacity + 256;
        qm_spoke *grown =
            qm_context_resize(trace->ctx, trace->steps, trace->capacity, capacity, sizeof *grown);
        if (!grown) return false;
        trace->steps = grown;
        trace->capacity = capacity;
    }
    trace->steps[trace->count++] = step;
    return true;
}

/** The faces round a vertex, from a spoke on: those to one side of it, and when they do not close the
 * others. */
typedef struct fan {
    uint32_t quads;
    bool closed;
    qm_spoke last; /* when open: the first side met that has no link, in the direction of the turn */
} fan;

/** Turns from the side of spoke through the faces on its own side. */
static fan fan_turn(const qm_patch_links *links, qm_spoke spoke)
{
    fan round = {.quads = 1};
    qm_spoke at = qm_spoke_turn(spoke);
    while (qm_links_has(links, at.at)) {
        at = qm_spoke_cross(links, at);
        if (at.at.face == spoke.at.face && at.at.side == spoke.at.side) {
            round.closed = true;
            return round;
        }
        at = qm_spoke_turn(at);
        round.quads++;
    }
    round.last = at;
    return round;
}

/** Lets a cut begin along every linked side round the vertex at a corner. False: out of memory. */
static bool start_all(qm_patch_trace *trace, qm_spoke spoke)
{
    const qm_patch_links *links = trace->links;
    fan round = fan_turn(links, spoke);
    if (!round.closed) round = fan_turn(links, spoke = round.last);
    for (uint32_t i = 0; i < round.quads; i++) {
        spoke = qm_spoke_turn(spoke);
        if (!qm_links_has(links, spoke.at)) break;
        if (!push(trace, qm_spoke_reverse(spoke))) return false;
        spoke = qm_spoke_cross(links, spoke);
    }
    return true;
}

/** Marks the corners of the fan at a spoke as seen, and tells whether cuts are to begin there. */
static bool visit_fan(const qm_patch_links *links, qm_spoke spoke, uint8_t *seen)
{
    fan round = fan_turn(links, spoke);
    if (!round.closed) round = fan_turn(links, spoke = round.last);
    for (uint32_t i = 0; i < round.quads; i++) {
        seen[spoke.at.face] |= (uint8_t)(1u << spoke.corner);
        spoke = qm_spoke_turn(spoke);
        if (i + 1 < round.quads) spoke = qm_spoke_cross(links, spoke);
    }
    return round.closed ? round.quads != 4 : round.quads > 2;
}

bool qm_patch_trace_start_irregular(qm_patch_trace *trace)
{
    const qm_patch_links *links = trace->links;
    uint8_t *seen = qm_context_alloc(trace->ctx, links->face_count, sizeof *seen);
    if (!seen && links->face_count > 0) return false;
    for (size_t f = 0; f < links->face_count; f++)
        seen[f] = 0;
    bool has_memory = true;
    for (uint32_t f = 0; f < links->face_count && has_memory; f++) {
        for (uint32_t c = 0; c < 4 && has_memory; c++) {
            qm_spoke spoke = {{f, c}, c};
            if (seen[f] >> c & 1) continue;
            if (visit_fan(links, spoke, seen)) has_memory = start_all(trace, spoke);
        }
    }
    qm_context_free(trace->ctx, seen, links->face_count, sizeof *seen);
    return has_memory;
}

/** Where a cut that came along step goes on; false when it ends at the vertex that step leads to. */
static bool find_next(const qm_patch_links *links, qm_spoke step, qm_spoke *next)
{
    qm_spoke at = step;
    for (int i = 0; i < 3; i++) {
        at = qm_spoke_turn(at);
        if (qm_links_is_cut(links, at.at)) return false;
        at = qm_spoke_cross(links, at);
        if (i == 1) *next = qm_spoke_reverse(at);
    }
    at = qm_spoke_turn(at);
    if (!qm_links_has(links, at.at)) return false;
    at = qm_spoke_cross(links, at);
    return at.at.face == step.at.face && at.at.side == step.at.side;
}

bool qm_patch_trace_start_through(qm_patch_trace *trace, qm_quad_side side)
{
    qm_spoke one = {side, side.side}, next;
    qm_links_set_cut(trace->links, side, true);
    if (find_next(trace->links, one, &next) && !push(trace, next)) return false;
    return !find_next(trace->links, qm_spoke_reverse(one), &next) || push(trace, next);
}

void qm_patch_trace_run(qm_patch_trace *trace)
{
    while (trace->count > 0) {
        size_t kept = 0;
        for (size_t i = 0; i < trace->count; i++) {
            qm_spoke step = trace->steps[i];
            if (qm_links_is_cut(trace->links, step.at)) continue;
            qm_links_set_cut(trace->links, step.at, true);
            if (find_next(trace->links, step, &step)) trace->steps[kept++] = step;
        }
        trace->count = kept;
    }
}

void qm_patch_trace_reset(qm_patch_trace *trace)
{
    qm_context_free(trace->ctx, trace->steps, trace->capacity, sizeof *trace->steps);
    trace->steps = NULL;
    trace->count = trace->capacity = 0;
}
