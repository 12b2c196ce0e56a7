/**
 * patch_trace.c: the motorcycle graph (source in qm/patch.h). Each step marks one edge as a cut; at the
 * vertex that it leads to, the cut continues to the opposite edge when four quads surround the vertex and
 * none of their other edges is a cut. Where two cuts reach a vertex in the same round, the first in the list
 * continues, and the other ends there: so no vertex is ever left with a single cut or with two that meet at a
 * corner.
 */
#include "patch_work.h"

static bool push(qm_patch_trace *trace, qm_patch_dart step)
{
    if (trace->count == trace->capacity) {
        size_t capacity = 2 * trace->capacity + 256;
        qm_patch_dart *grown =
            qm_context_resize(trace->ctx, trace->steps, trace->capacity, capacity, sizeof *grown);
        if (!grown) return false;
        trace->steps = grown;
        trace->capacity = capacity;
    }
    trace->steps[trace->count++] = step;
    return true;
}

/** The faces around a vertex, from a dart on in one direction. */
typedef struct fan {
    uint32_t quads;
    bool closed;
    qm_patch_dart last; /* when open: the first side without a link in the direction of rotation */
} fan;

/** Circles around the vertex of a dart, through its own face first. */
static fan fan_circle(const qm_patch_links *links, qm_patch_dart dart)
{
    fan round = {.quads = 1};
    qm_patch_dart at = qm_patch_dart_rotate(dart);
    while (qm_patch_links_has(links, at.at)) {
        at = qm_patch_dart_cross(links, at);
        if (at.at.face == dart.at.face && at.at.side == dart.at.side) {
            round.closed = true;
            return round;
        }
        at = qm_patch_dart_rotate(at);
        round.quads++;
    }
    round.last = at;
    return round;
}

/** Starts a cut along every linked side at the vertex of a dart. False: out of memory. */
static bool start_all(qm_patch_trace *trace, qm_patch_dart dart)
{
    const qm_patch_links *links = trace->links;
    fan round = fan_circle(links, dart);
    if (!round.closed) round = fan_circle(links, dart = round.last);
    for (uint32_t i = 0; i < round.quads; i++) {
        dart = qm_patch_dart_rotate(dart);
        if (!qm_patch_links_has(links, dart.at)) break;
        if (!push(trace, qm_patch_dart_reverse(dart))) return false;
        dart = qm_patch_dart_cross(links, dart);
    }
    return true;
}

/** Marks the corners of the fan at a dart as seen; true when its vertex is irregular. */
static bool visit_fan(const qm_patch_links *links, qm_patch_dart dart, uint8_t *seen)
{
    fan round = fan_circle(links, dart);
    if (!round.closed) round = fan_circle(links, dart = round.last);
    for (uint32_t i = 0; i < round.quads; i++) {
        seen[dart.at.face] |= (uint8_t)(1u << dart.corner);
        dart = qm_patch_dart_rotate(dart);
        if (i + 1 < round.quads) dart = qm_patch_dart_cross(links, dart);
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
            qm_patch_dart dart = {{f, c}, c};
            if (seen[f] >> c & 1) continue;
            if (visit_fan(links, dart, seen)) has_memory = start_all(trace, dart);
        }
    }
    qm_context_free(trace->ctx, seen, links->face_count, sizeof *seen);
    return has_memory;
}

/** Finds the step that continues a cut after step; false when the cut ends at the vertex that step leads to.
 */
static bool find_next(const qm_patch_links *links, qm_patch_dart step, qm_patch_dart *next)
{
    qm_patch_dart at = step;
    for (int i = 0; i < 3; i++) {
        at = qm_patch_dart_rotate(at);
        if (qm_patch_links_is_cut(links, at.at)) return false;
        at = qm_patch_dart_cross(links, at);
        if (i == 1) *next = qm_patch_dart_reverse(at);
    }
    at = qm_patch_dart_rotate(at);
    if (!qm_patch_links_has(links, at.at)) return false;
    at = qm_patch_dart_cross(links, at);
    return at.at.face == step.at.face && at.at.side == step.at.side;
}

bool qm_patch_trace_start_through(qm_patch_trace *trace, qm_patch_side side)
{
    qm_patch_dart one = {side, side.side}, next;
    qm_patch_links_set_cut(trace->links, side, true);
    if (find_next(trace->links, one, &next) && !push(trace, next)) return false;
    return !find_next(trace->links, qm_patch_dart_reverse(one), &next) || push(trace, next);
}

void qm_patch_trace_run(qm_patch_trace *trace)
{
    while (trace->count > 0) {
        size_t kept = 0;
        for (size_t i = 0; i < trace->count; i++) {
            qm_patch_dart step = trace->steps[i];
            if (qm_patch_links_is_cut(trace->links, step.at)) continue;
            qm_patch_links_set_cut(trace->links, step.at, true);
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
