/**
 * knn_graph.c: neighbours by the points' own box tree; orientation along a minimum spanning tree (Prim).
 */
#include "knn_graph.h"

#include <string.h>

#include "core/heap.h"
#include "core/linear.h"

#define PLANE_POINTS 12 /* neighbours that a plane is fitted to */
#define MAX_SLOPE 0.7   /* rise of a link above the tangent plane of its start, as a fraction of its length */

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the neighbours of points");
}

void qm_knn_graph_reset(qm_context *ctx, qm_knn_graph *graph)
{
    qm_context_free(ctx, graph->normal, graph->count, sizeof *graph->normal);
    qm_context_free(ctx, graph->link, graph->count, sizeof *graph->link);
    *graph = (qm_knn_graph){0};
}

/** The normal of the least-squares plane of the nearest neighbours: the direction of their least variance. */
static qm_vec plane_normal(const qm_nearest_points *near)
{
    int count = near->count < PLANE_POINTS ? near->count : PLANE_POINTS;
    if (count < 3) return (qm_vec){0, 0, 0};
    qm_vec centroid = {0, 0, 0}, axis[3];
    double m[6] = {0}, value[3];
    for (int i = 0; i < count; i++)
        centroid = qm_vec_axpy(centroid, 1.0 / count, near->position[i]);
    for (int i = 0; i < count; i++)
        qm_linear_add_products(m, qm_vec_sub(near->position[i], centroid));
    qm_linear_eigen(m, value, axis);
    return value[1] > 1e-9 * value[2] ? axis[0] : (qm_vec){0, 0, 0};
}

/** Sets the normal of each point and its links, without those that leave its tangent plane too steeply. */
static qm_status find_links(qm_context *ctx, const qm_bvh *tree, const double *normal, qm_knn_graph *graph)
{
    for (size_t i = 0; i < graph->count; i++) {
        if (i % 1024 == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "search for neighbours canceled");
        qm_nearest_points near;
        qm_vec at = qm_frame_local(&tree->frame, graph->positions + 3 * i);
        qm_nearest_points_find(tree, at, QM_KNN_MAX_LINKS + 4, &near);
        graph->normal[i] = normal ? qm_vec_load(normal + 3 * i) : plane_normal(&near);
        int count = 0;
        for (int k = 0; k < near.count && count < QM_KNN_MAX_LINKS; k++) {
            qm_vec d = qm_vec_sub(near.position[k], at);
            double rise = qm_vec_dot(graph->normal[i], d);
            if (near.index[k] != i && rise * rise <= MAX_SLOPE * MAX_SLOPE * qm_vec_norm2(d))
                graph->link[i][count++] = near.index[k];
        }
        for (; count < QM_KNN_MAX_LINKS; count++)
            graph->link[i][count] = QM_NO_INDEX;
    }
    return QM_OK;
}

qm_status qm_knn_graph_build(qm_context *ctx, const double *positions, size_t count, const double *normal,
                             qm_knn_graph *out)
{
    QM_ASSERT(ctx && positions && out);
    *out = (qm_knn_graph){.count = count, .positions = positions};
    out->normal = qm_context_alloc(ctx, count, sizeof *out->normal);
    out->link = qm_context_alloc(ctx, count, sizeof *out->link);
    qm_bvh *tree = NULL;
    /* The tree does not write to the points. */
    const qm_mesh cloud = {.positions = (double *)(uintptr_t)positions, .vertex_count = count};
    qm_status status = out->normal && out->link ? QM_OK : no_memory(ctx);
    if (status == QM_OK) status = qm_bvh_build(ctx, &cloud, QM_BVH_TARGET, 1, &tree);
    if (status == QM_OK) status = find_links(ctx, tree, normal, out);
    qm_bvh_destroy(ctx, tree);
    if (status != QM_OK) qm_knn_graph_reset(ctx, out);
    return status;
}

/** A minimum spanning forest as it grows: the oriented points, and the links out of them. */
typedef struct orientation {
    qm_context *ctx;
    qm_knn_graph *graph;
    bool *is_oriented;
    qm_heap heap;
} orientation;

/** How much the normals of two points agree, from 1 to -1. On a surface of one curvature one is the image of the other in the plane
 * between the points, whatever angle they are at: so round the thin rim of an ear as on a plane. */
static double find_agreement(const qm_knn_graph *graph, uint32_t from, uint32_t to)
{
    qm_vec between = qm_vec_sub(qm_vec_load(graph->positions + 3 * (size_t)to),
                                qm_vec_load(graph->positions + 3 * (size_t)from)),
           image = graph->normal[from];
    double length = qm_vec_norm(between);
    if (length > 0.0) {
        qm_vec along = qm_vec_scale(1.0 / length, between);
        image = qm_vec_axpy(image, -2.0 * qm_vec_dot(image, along), along);
    }
    return qm_vec_dot(image, graph->normal[to]);
}

static qm_status push_links(orientation *work, uint32_t from)
{
    for (int k = 0; k < QM_KNN_MAX_LINKS; k++) {
        uint32_t to = work->graph->link[from][k];
        if (to == QM_NO_INDEX) break;
        QM_ASSERT(to < work->graph->count);
        if (work->is_oriented[to]) continue;
        double agreement = find_agreement(work->graph, from, to);
        qm_heap_item item = {.key = 1.0 - fabs(agreement), .number = to, .origin = from};
        qm_status status = qm_heap_push(work->ctx, &work->heap, item);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/** Orients the component of a start point. */
static qm_status orient_component(orientation *work, uint32_t start)
{
    qm_vec *normal = work->graph->normal;
    if (normal[start].z < 0.0) normal[start] = qm_vec_scale(-1.0, normal[start]);
    work->is_oriented[start] = true;
    qm_status status = push_links(work, start);
    while (status == QM_OK && work->heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&work->heap);
        if (work->is_oriented[item.number]) continue;
        work->is_oriented[item.number] = true;
        if (find_agreement(work->graph, item.origin, item.number) < 0.0)
            normal[item.number] = qm_vec_scale(-1.0, normal[item.number]);
        status = push_links(work, item.number);
    }
    return status;
}

/** Orients all components. Starts come by falling z, so that each component starts at its highest point. */
static qm_status orient_components(orientation *work, qm_heap *starts)
{
    for (size_t i = 0; i < work->graph->count; i++) {
        qm_heap_item item = {.key = -work->graph->positions[3 * i + 2], .number = (uint32_t)i};
        qm_status status = qm_heap_push(work->ctx, starts, item);
        if (status != QM_OK) return status;
    }
    while (starts->count > 0) {
        uint32_t start = qm_heap_pop(starts).number;
        qm_status status = work->is_oriented[start] ? QM_OK : orient_component(work, start);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

qm_status qm_knn_graph_orient(qm_context *ctx, qm_knn_graph *graph)
{
    QM_ASSERT(ctx && graph);
    orientation work = {.ctx = ctx, .graph = graph};
    qm_heap starts = {0};
    work.is_oriented = qm_context_alloc(ctx, graph->count, sizeof *work.is_oriented);
    if (!work.is_oriented) return no_memory(ctx);
    memset(work.is_oriented, 0, graph->count * sizeof *work.is_oriented);
    qm_status status = orient_components(&work, &starts);
    qm_heap_reset(ctx, &work.heap);
    qm_heap_reset(ctx, &starts);
    qm_context_free(ctx, work.is_oriented, graph->count, sizeof *work.is_oriented);
    return status;
}
