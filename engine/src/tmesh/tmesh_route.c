/**
 * tmesh_route.c: the order in which curves are laid.
 */
#include "tmesh/tmesh_route.h"

#include <stdlib.h>

#include "core/union_find.h"
#include "tmesh/tmesh_router.h"

typedef struct rank {
    double length;
    uint32_t curve;
} rank;

static int compare_ranks(const void *a, const void *b)
{
    const rank *one = a, *other = b;
    if (one->length != other->length) return one->length < other->length ? -1 : 1;
    return one->curve < other->curve ? -1 : one->curve > other->curve;
}

/** Joins the ends of a curve, or its faces. True if they were apart. */
static bool join(uint32_t *parent, uint32_t a, uint32_t b)
{
    if (qm_union_find_root(parent, a) == qm_union_find_root(parent, b)) return false;
    qm_union_find_join(parent, a, b);
    return true;
}

bool qm_router_route_all(qm_router *r, bool may_follow_edges)
{
    const qm_layout *layout = r->layout;
    size_t curves = layout->curve_count;
    rank *order = qm_arena_alloc(r->arena, curves, sizeof *order);
    uint8_t *turn = qm_arena_zeroed(r->arena, curves, 1); /* when it is laid */
    uint32_t *node = qm_arena_alloc(r->arena, layout->node_count, sizeof *node);
    uint32_t *face = qm_arena_alloc(r->arena, layout->patch_count, sizeof *face);
    r->is_laid = qm_arena_zeroed(r->arena, curves, sizeof *r->is_laid);
    if (!order || !turn || !node || !face || !r->is_laid) return false;
    for (uint32_t i = 0; i < layout->node_count; i++)
        node[i] = i;
    for (uint32_t i = 0; i < layout->patch_count; i++)
        face[i] = i;
    for (uint32_t c = 0; c < curves; c++)
        order[c] = (rank){qm_router_curve_guide(r, c).length, c};
    qsort(order, curves, sizeof *order, compare_ranks);
    enum { LAID, BOUNDARY, TREE, HANDLE, LAST };
    for (size_t i = 0; i < curves; i++) {
        uint32_t c = order[i].curve;
        turn[c] = HANDLE;
        if (qm_router_is_boundary(r, c)) {
            turn[c] = BOUNDARY;
        } else {
            const qm_route_guide g = qm_router_curve_guide(r, c);
            if (may_follow_edges) qm_router_route_line(r, c, &g);
            if (!r->is_laid[c]) continue;
            turn[c] = LAID;
        }
        join(node, layout->curves[c].from, layout->curves[c].to);
    }
    for (size_t i = 0; i < curves; i++) {
        const qm_curve *curve = &layout->curves[order[i].curve];
        if (turn[order[i].curve] == HANDLE && join(node, curve->from, curve->to)) turn[order[i].curve] = TREE;
    }
    for (size_t i = curves; i-- > 0;) {
        uint32_t c = order[i].curve;
        if (turn[c] == HANDLE && join(face, r->left[2 * c], r->left[2 * c + 1])) turn[c] = LAST;
    }
    for (int phase = BOUNDARY; phase <= LAST; phase++)
        for (size_t i = 0; i < curves && !r->is_lost; i++) {
            uint32_t c = order[i].curve;
            if (turn[c] != phase) continue;
            if (qm_context_canceled(r->ctx)) return true;
            qm_route_guide g = qm_router_curve_guide(r, c);
            bool has_memory = phase == BOUNDARY ? qm_router_route_boundary(r, c)
                              : phase == HANDLE ? qm_router_route_handle(r, c, &g)
                                                : qm_router_route_curve(r, c, &g);
            if (!has_memory) return false;
        }
    return true;
}

qm_status qm_tmesh_route(qm_arena *arena, const qm_tmesh_triangles *triangles, const qm_layout *layout,
                         const bool *is_fixed, const bool *is_line, const qm_tmesh_guides *guides,
                         double *grids, qm_layout *out, bool *is_made)
{
    qm_router r = {
        .arena = arena, .ctx = arena->ctx, .triangles = triangles, .layout = layout, .guides = guides};
    bool is_ordered = false;
    *is_made = false;
    bool has_memory = qm_router_order_darts(&r, grids, &is_ordered);
    if (has_memory && is_ordered) {
        has_memory = qm_router_prepare(&r) && (r.is_lost || qm_router_route_all(&r, false)) &&
                     (r.is_lost || qm_router_straighten(&r, is_fixed, is_line));
        bool is_canceled = qm_context_canceled(r.ctx);
        qm_status status =
            has_memory && !r.is_lost && !is_canceled ? qm_router_write_layout(&r, grids, out) : QM_OK;
        *is_made = has_memory && status == QM_OK && !r.is_lost && !is_canceled;
        has_memory = has_memory && status == QM_OK;
    }
    qm_trimesh_reset(r.ctx, &r.m);
    qm_heap_reset(r.ctx, &r.heap);
    if (!*is_made) qm_layout_reset(r.ctx, out);
    if (!has_memory) return qm_context_fail(r.ctx, QM_E_NO_MEMORY, "out of memory for the paths of curves");
    return qm_context_canceled(r.ctx) ? qm_context_fail(r.ctx, QM_E_CANCELED, "canceled") : QM_OK;
}
