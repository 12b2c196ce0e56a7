#include "bvh/bvh_tree.h"
#include "qm/source.h"
#include "surface_graph.h"

qm_status qm_source_estimate_normals(qm_context *ctx, const qm_source *source, double *normals)
{
    if (!source->is_cloud)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "normals are estimated for point sets only");
    const qm_mesh *cloud = &source->bvh->mesh;
    qm_surface_graph graph;
    qm_status status = qm_surface_graph_build(ctx, cloud->positions, cloud->vertex_count, NULL, &graph);
    if (status != QM_OK) return status;
    status = qm_surface_graph_orient(ctx, &graph);
    for (size_t i = 0; i < graph.count && status == QM_OK; i++)
        qm_vec_store(normals + 3 * i, graph.normal[i]);
    qm_surface_graph_reset(ctx, &graph);
    return status;
}
