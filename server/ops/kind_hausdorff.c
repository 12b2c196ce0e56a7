/**
 * kind_hausdorff.c: the two-sided or one-sided Hausdorff distance.
 */
#include "job_kinds_internal.h"

#include <math.h>

const char *const qm_direction_names[] = {"two_sided", "a_to_b", "b_to_a", NULL};
const char *const qm_bounds_names[] = {"cover", "matching", "cells", NULL};

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = request->direction;
    options.quads = request->quads;
    options.tolerance = qm_job_tolerance(call);
    options.threshold = request->threshold;
    options.deadline_ms = request->deadline_ms;
    options.memory_limit = request->memory_limit;
    options.accelerator = request->accelerator;
    options.tetra[0] = call->a->tetra;
    options.tetra[1] = call->b->tetra;
    /* Any other value is the former name of the default. */
    options.bounds = request->bounds == QM_BOUNDS_MATCHING ? QM_BOUNDS_MATCHING : QM_BOUNDS_COVER;
    options.thread_count = call->threads;
    options.progress = call->progress;
    options.progress_user = call->progress_user;
    out->tolerance = options.tolerance;
    const qm_job_search *search = request->search;
    const qm_bvh *a = call->a->bvh, *b = call->b->bvh;
    qm_status status = search ? search->measure(search->user, call->ctx, a, b, &options, &out->hausdorff)
                              : qm_hausdorff_measure(call->ctx, a, b, &options, &out->hausdorff);
    if (status != QM_OK) return status;
    const qm_loaded_mesh *source = out->hausdorff.from_side == 0 ? call->a : call->b,
                         *target = source == call->a ? call->b : call->a;
    out->from_face = qm_mesh_input_face(&source->mesh, out->hausdorff.from.face);
    out->to_face = qm_mesh_input_face(&target->mesh, out->hausdorff.to.face);
    out->is_canceled = out->hausdorff.stop == QM_STOP_CANCELED;
    return QM_OK;
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_json_add_string(out, "direction", qm_direction_names[request->direction]);
    qm_job_add_gap(out, request);
    if (!isnan(request->threshold)) qm_json_add_number(out, "limit", request->threshold);
}

static void add_witness(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_hausdorff_result *h = &result->hausdorff;
    bool from_a = h->from_side == 0;
    qm_json_open(out, "witness", "{");
    qm_json_add_surface_point(out, "from", from_a ? "a" : "b", from_a ? request->a : request->b,
                              result->from_face, &h->from);
    qm_json_add_surface_point(out, "to", from_a ? "b" : "a", from_a ? request->b : request->a,
                              result->to_face, &h->to);
    qm_text_add_string(out, "}");
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    static const char *const stop_names[] = {"converged", "limit", "deadline", "canceled",
                                             "precision", "work",  "memory"};
    const qm_hausdorff_result *h = &result->hausdorff;
    qm_json_add_lower_upper(out, h->lower, h->upper, result->diagonal);
    qm_job_add_of_true(out, result, (qm_interval){h->lower, h->upper});
    if (h->has_witness) add_witness(out, request, result);
    qm_json_add_string(out, "direction", qm_direction_names[request->direction]);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "gap", result->tolerance);
    qm_json_add_count(out, "iterations", h->iterations);
    qm_json_add_count(out, "projections", h->projections);
    qm_json_add_count(out, "max_queue", h->max_queue);
    qm_json_add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", h->elapsed_ms);
    qm_json_add_bool(out, "converged", h->stop == QM_STOP_CONVERGED);
    qm_json_add_string(out, "stopped_by", stop_names[h->stop]);
    if (h->verdict == 0)
        qm_json_add_word(out, "verdict", "null");
    else
        qm_json_add_string(out, "verdict", h->verdict > 0 ? "above" : "below");
}

static const qm_job_field fields[] = {
    QM_JOB_FIELD_PAIR,
    QM_JOB_FIELD_QUADS,
    QM_JOB_FIELDS_GAP,
    QM_JOB_FIELD_ACCELERATOR,
    {"direction", QM_FIELD_CHOICE, QM_FIELD_AT(direction), .names = qm_direction_names},
    {"limit", QM_FIELD_LIMIT, QM_FIELD_AT(threshold)},
    {"threshold", QM_FIELD_LIMIT, QM_FIELD_AT(threshold)}, /* the name of the version before */
    {"memory_limit", QM_FIELD_COUNT, QM_FIELD_AT(memory_limit), .is_engine = true, .min = QM_JOB_MIN_MEMORY,
     .max = QM_JOB_MAX_MEMORY},
    {"bounds", QM_FIELD_CHOICE, QM_FIELD_AT(bounds), .is_engine = true, .names = qm_bounds_names,
     .name_count = QM_BOUNDS_MATCHING + 1, .expected = "must be \"cover\" or \"matching\""},
    {0}};

const qm_job_hooks qm_job_kind_hausdorff = {
    .type = {.name = "hausdorff", .mesh_field = {"a", "b"}, .is_pure = true, .is_anytime = true},
    .fields = fields,
    .run = run,
    .write_request = write_request,
    .write_result = write_result};
