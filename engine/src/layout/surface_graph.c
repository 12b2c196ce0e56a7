#include "surface_graph.h"

#include <string.h>

#include "core/heap.h"
#include "core/symmetric.h"

#define PLANE_POINTS 12 /* neighbours that a plane is laid through */
#define RISE 0.7        /* a link may rise by this share of its length above the plane of its start */

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the neighbours of points");
}

void qm_surface_graph_reset(qm_context *ctx, qm_surface_graph *graph)
{
    qm_context_free(ctx, graph->normal, graph->count, sizeof *graph->normal);
    qm_context_free(ctx, graph->link, graph->count, sizeof *graph->link);
    *graph = (qm_surface_graph){0};
}

/** Normal of the plane through the nearest neighbours: the direction in which they spread least. */
static qm_vec plane_normal(const qm_near_points *near)
{
    int count = near->count < PLANE_POINTS ? near->count : PLANE_POINTS;
    if (count < 3) return (qm_vec){0, 0, 0};
    qm_vec middle = {0, 0, 0}, axis[3];
    double m[6] = {0}, value[3];
    for (int i = 0; i < count; i++)
        middle = qm_vec_axpy(middle, 1.0 / count, near->position[i]);
    for (int i = 0; i < count; i++) {
        qm_vec d = qm_vec_sub(near->position[i], middle);
        m[0] += d.x * d.x;
        m[1] += d.x * d.y;
        m[2] += d.x * d.z;
        m[3] += d.y * d.y;
        m[4] += d.y * d.z;
        m[5] += d.z * d.z;
    }
    qm_symmetric_eigen(m, value, axis);
    return value[1] > 1e-9 * value[2] ? axis[0] : (qm_vec){0, 0, 0};
}

static bool runs_along(qm_vec normal, qm_vec from, qm_vec to)
{
    qm_vec d = qm_vec_sub(to, from);
    double rise = qm_vec_dot(normal, d);
    return rise * rise <= RISE * RISE * qm_vec_norm2(d);
}

static void set_links(qm_surface_graph *graph, size_t i, qm_vec at, const qm_near_points *near)
{
    int count = 0;
    for (int k = 0; k < near->count && count < QM_GRAPH_LINKS; k++)
        if (near->index[k] != i && runs_along(graph->normal[i], at, near->position[k]))
            graph->link[i][count++] = near->index[k];
    for (; count < QM_GRAPH_LINKS; count++)
        graph->link[i][count] = QM_NO_INDEX;
}

static qm_status find_links(qm_context *ctx, const qm_bvh *tree, const double *normal,
                            qm_surface_graph *graph)
{
    for (size_t i = 0; i < graph->count; i++) {
        if (i % 1024 == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "joining points canceled");
        qm_near_points near;
        qm_vec at = qm_frame_local(&tree->frame, graph->positions + 3 * i);
        qm_near_points_find(tree, at, QM_GRAPH_LINKS + 4, &near);
        graph->normal[i] = normal ? qm_vec_load(normal + 3 * i) : plane_normal(&near);
        set_links(graph, i, at, &near);
    }
    return QM_OK;
}

qm_status qm_surface_graph_build(qm_context *ctx, const double *positions, size_t count, const double *normal,
                                 qm_surface_graph *out)
{
    *out = (qm_surface_graph){.count = count, .positions = positions};
    out->normal = qm_context_alloc(ctx, count, sizeof *out->normal);
    out->link = qm_context_alloc(ctx, count, sizeof *out->link);
    qm_bvh *tree = NULL;
    /* The tree only reads the points. */
    const qm_mesh cloud = {.positions = (double *)(uintptr_t)positions, .vertex_count = count};
    qm_status status = out->normal && out->link ? QM_OK : no_memory(ctx);
    if (status == QM_OK) status = qm_bvh_build(ctx, &cloud, QM_BVH_TARGET, 1, &tree);
    if (status == QM_OK) status = find_links(ctx, tree, normal, out);
    qm_bvh_destroy(ctx, tree);
    if (status != QM_OK) qm_surface_graph_reset(ctx, out);
    return status;
}

/** Points whose side is settled, and links on from them. */
typedef struct orientation {
    qm_context *ctx;
    qm_surface_graph *graph;
    bool *is_settled;
    qm_heap heap;
} orientation;

static qm_status push_links(orientation *work, uint32_t from)
{
    for (int k = 0; k < QM_GRAPH_LINKS; k++) {
        uint32_t to = work->graph->link[from][k];
        if (to == QM_NO_INDEX) break;
        if (work->is_settled[to]) continue;
        double dot = qm_vec_dot(work->graph->normal[from], work->graph->normal[to]);
        qm_heap_item item = {.key = 1.0 - fabs(dot), .number = to, .origin = from};
        qm_status status = qm_heap_push(work->ctx, &work->heap, item);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/** Settles all that can be reached from a start. */
static qm_status settle_part(orientation *work, uint32_t start)
{
    qm_vec *normal = work->graph->normal;
    if (normal[start].z < 0.0) normal[start] = qm_vec_scale(-1.0, normal[start]);
    work->is_settled[start] = true;
    qm_status status = push_links(work, start);
    while (status == QM_OK && work->heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&work->heap);
        if (work->is_settled[item.number]) continue;
        work->is_settled[item.number] = true;
        if (qm_vec_dot(normal[item.origin], normal[item.number]) < 0.0)
            normal[item.number] = qm_vec_scale(-1.0, normal[item.number]);
        status = push_links(work, item.number);
    }
    return status;
}

/** The starts are taken from the highest point down, so that each part's own highest comes first. */
static qm_status settle_all(orientation *work, qm_heap *starts)
{
    for (size_t i = 0; i < work->graph->count; i++) {
        qm_heap_item item = {.key = -work->graph->positions[3 * i + 2], .number = (uint32_t)i};
        qm_status status = qm_heap_push(work->ctx, starts, item);
        if (status != QM_OK) return status;
    }
    while (starts->count > 0) {
        uint32_t start = qm_heap_pop(starts).number;
        qm_status status = work->is_settled[start] ? QM_OK : settle_part(work, start);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

qm_status qm_surface_graph_orient(qm_context *ctx, qm_surface_graph *graph)
{
    orientation work = {.ctx = ctx, .graph = graph};
    qm_heap starts = {0};
    work.is_settled = qm_context_alloc(ctx, graph->count, sizeof *work.is_settled);
    if (!work.is_settled) return no_memory(ctx);
    memset(work.is_settled, 0, graph->count * sizeof *work.is_settled);
    qm_status status = settle_all(&work, &starts);
    qm_heap_reset(ctx, &work.heap);
    qm_heap_reset(ctx, &starts);
    qm_context_free(ctx, work.is_settled, graph->count, sizeof *work.is_settled);
    return status;
}
