#include "job_kinds.h"

#include <math.h>

qm_job_request qm_job_request_default(void)
{
    return (qm_job_request){
        .kind = QM_JOB_HAUSDORFF,
        .direction = QM_TWO_SIDED,
        .quads = QM_QUADS_TRIANGLES,
        .tolerance = 1e-6,
        .threshold = NAN,
    };
}

qm_status qm_job_run_hausdorff(qm_context *ctx, const qm_job_request *request, const qm_loaded_mesh *a,
                               const qm_loaded_mesh *b, qm_hausdorff_progress_fn *progress,
                               void *progress_user, qm_job_result *out)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    bool is_absolute = request->tolerance_is_absolute || a->diagonal == 0.0;
    options.direction = request->direction;
    options.quads = request->quads;
    options.tolerance = is_absolute ? request->tolerance : request->tolerance * a->diagonal;
    options.threshold = request->threshold;
    options.deadline_ms = request->deadline_ms;
    options.thread_count = request->threads > 0 ? request->threads : 1;
    options.progress = progress;
    options.progress_user = progress_user;
    *out = (qm_job_result){.diagonal = a->diagonal,
                           .tolerance = options.tolerance,
                           .prepare_a_ms = a->parse_ms + a->topology_ms + a->bvh_ms,
                           .prepare_b_ms = b->parse_ms + b->topology_ms + b->bvh_ms};
    qm_status status = qm_hausdorff_measure(ctx, a->bvh, b->bvh, &options, &out->hausdorff);
    if (status != QM_OK) return status;
    const qm_loaded_mesh *source = out->hausdorff.from_side == 0 ? a : b, *target = source == a ? b : a;
    out->from_face = qm_mesh_input_face(&source->mesh, out->hausdorff.from.face);
    out->to_face = qm_mesh_input_face(&target->mesh, out->hausdorff.to.face);
    return QM_OK;
}
