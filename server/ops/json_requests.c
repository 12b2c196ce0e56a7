/**
 * json_requests.c: requests of jobs as JSON, a function for each kind.
 */
#include <math.h>

#include "job_names.h"
#include "json_out.h"

static void write_tolerance(qm_text *out, const qm_job_request *request)
{
    qm_json_add_number(out, "tolerance", request->tolerance);
    qm_json_add_string(out, "tolerance_unit", qm_tolerance_unit_names[request->tolerance_is_absolute]);
}

static void write_accelerator(qm_text *out, const qm_job_request *request)
{
    if (request->accelerator != QM_ACCELERATOR_AUTO)
        qm_json_add_string(out, "accelerator", qm_accelerator_names[request->accelerator]);
}

static void write_hausdorff_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_json_add_string(out, "direction", qm_direction_names[request->direction]);
    write_tolerance(out, request);
    if (!isnan(request->threshold)) qm_json_add_number(out, "threshold", request->threshold);
    if (request->deadline_ms > 0.0) qm_json_add_number(out, "deadline_ms", request->deadline_ms);
    if (request->memory_limit > 0) qm_json_add_count(out, "memory_limit", request->memory_limit);
    write_accelerator(out, request);
    if (request->bounds == QM_BOUNDS_MATCHING)
        qm_json_add_string(out, "bounds", qm_bounds_names[request->bounds]);
}

static void write_project_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    write_accelerator(out, request);
    if (is_brief) {
        qm_json_add_count(out, "point_count", request->point_count);
        return;
    }
    qm_json_open(out, "points", "[");
    for (size_t i = 0; i < request->point_count; i++)
        qm_json_add_array(out, request->points + 3 * i, 3);
    qm_text_add_string(out, "]");
}

static void write_deviation_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    write_tolerance(out, request);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_count(out, "pieces", request->pieces);
    qm_json_add_count(out, "bins", request->bins);
    qm_json_add_numbers(out, "percentiles", request->percentiles, (int)request->percentile_count);
}

static void write_distance_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    write_tolerance(out, request);
}

static void write_collision_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_json_add_string(out, "mode", qm_collide_mode_names[request->mode]);
    qm_json_add_count(out, "limit", request->list_limit);
    write_tolerance(out, request);
}

static void write_self_collision_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    write_collision_request(out, request, is_brief);
    if (request->incremental) qm_json_add_bool(out, "incremental", true);
}

static void write_reconstruction_step_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    const qm_refine_goal *goal = &request->goal;
    if (goal->steps > 0) qm_json_add_count(out, "steps", goal->steps);
    qm_json_open(out, "until", "{");
    if (request->hausdorff_relative > 0.0)
        qm_json_add_number(out, "hausdorff_relative", request->hausdorff_relative);
    if (goal->max_quads > 0) qm_json_add_count(out, "max_quads", goal->max_quads);
    if (goal->edge > 0.0) qm_json_add_number(out, "edge_length", goal->edge);
    qm_text_add_string(out, "}");
    qm_json_add_bool(out, "measure", goal->measures);
}

static void (*const writers[])(qm_text *out, const qm_job_request *request, bool is_brief) = {
#define XX(suffix, name, first, second) write_##name##_request,
    QM_JOB_MAP(XX)
#undef XX
};

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    const qm_job_type *type = qm_job_type_of(request->kind);
    qm_text_add_string(out, "{");
    qm_json_add_string(out, "type", type->name);
    qm_json_add_string(out, type->mesh_field[0], request->a);
    if (type->mesh_field[1]) qm_json_add_string(out, type->mesh_field[1], request->b);
    if (request->kind != QM_JOB_RECONSTRUCTION_STEP)
        qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    if (request->threads > 0) qm_json_add_count(out, "threads", (uint64_t)request->threads);
    writers[request->kind](out, request, is_brief);
    qm_text_add_string(out, "}");
}

void qm_json_write_request(qm_text *out, const qm_job_request *request)
{
    write_request(out, request, false);
}

void qm_json_write_request_briefly(qm_text *out, const qm_job_request *request)
{
    write_request(out, request, true);
}
