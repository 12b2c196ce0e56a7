/**
 * job_kinds.c: the table of kinds of job, the defaults of requests, and the call that executes any of them.
 */
#include "job_kinds_internal.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"

const char *const qm_priority_names[] = {"low", "normal", "high", NULL};
#define XX(suffix, name) #name,
const char *const qm_job_kind_names[] = {QM_JOB_MAP(XX) NULL};
#undef XX
const char *const qm_quads_names[] = {"triangles", "bilinear", NULL};
const char *const qm_accelerator_names[] = {"auto", "boxes", "tetra", "grid", NULL};
const char *const qm_job_box_names[] = {"auto", "boxes", NULL};
const char *const qm_gap_unit_names[] = {"relative", "absolute", NULL};

qm_job_request qm_job_request_default(void)
{
    return (qm_job_request){
        .kind = QM_JOB_HAUSDORFF,
        .priority = QM_PRIORITY_NORMAL,
        .direction = QM_TWO_SIDED,
        .quads = QM_QUADS_TRIANGLES,
        .tolerance = 1e-6,
        .threshold = NAN,
        .accuracy = 1e-2,
        .pieces = 1u << 20,
        .bins = 50,
        .percentiles = {1, 5, 25, 50, 75, 90, 95, 99},
        .percentile_count = 8,
        .worst_radius = NAN,
        .mode = QM_COLLIDE_ALL,
        .list_limit = 1000,
        .align = qm_align_options_default(),
        .within = NAN,
        .goal = {.measures = true},
        .remesh = {.quads = {.crease_angle = qm_quads_options_default().crease_angle}},
    };
}

void qm_job_request_reset(qm_job_request *request)
{
    free(request->points);
    request->points = NULL;
    request->point_count = 0;
    free(request->meshes);
    request->meshes = NULL;
    request->mesh_count = 0;
    free(request->labels);
    request->labels = NULL;
}

qm_job_request qm_job_request_take(qm_job_request *request)
{
    qm_job_request taken = *request;
    request->points = NULL;
    request->meshes = NULL;
    request->labels = NULL;
    request->point_count = request->mesh_count = 0;
    return taken;
}

const qm_job_hooks *qm_job_hooks_of(qm_job_kind kind)
{
    static const qm_job_hooks *const rows[] = {
#define XX(suffix, name) &qm_job_kind_##name,
        QM_JOB_MAP(XX)
#undef XX
    };
    QM_ASSERT(kind < QM_JOB_KIND_COUNT);
    return rows[kind];
}

const qm_job_type *qm_job_type_of(qm_job_kind kind)
{
    return &qm_job_hooks_of(kind)->type;
}

bool qm_job_kind_find(const char *name, qm_job_kind *out)
{
    for (int kind = 0; kind < QM_JOB_KIND_COUNT; kind++) {
        if (strcmp(qm_job_kind_names[kind], name) != 0) continue;
        *out = (qm_job_kind)kind;
        return true;
    }
    return false;
}

const qm_job_array *qm_job_array_of(qm_job_kind kind)
{
    return qm_job_hooks_of(kind)->array;
}

const qm_job_field *qm_job_find_field(const qm_job_field *fields, const char *name)
{
    for (; fields->name; fields++)
        if (strcmp(fields->name, name) == 0) return fields;
    return NULL;
}

double qm_job_tolerance_of(const qm_job_request *request, double diagonal)
{
    bool is_absolute = request->tolerance_is_absolute || diagonal == 0.0;
    double tolerance = is_absolute ? request->tolerance : request->tolerance * diagonal;
    return fmin(fmax(tolerance, DBL_TRUE_MIN), DBL_MAX); /* the product may be no number above 0 */
}

double qm_job_tolerance(const qm_job_call *call)
{
    return qm_job_tolerance_of(call->request, call->a->diagonal);
}

void qm_job_add_gap(qm_text *out, const qm_job_request *request)
{
    qm_json_add_number(out, "gap", request->tolerance);
    qm_json_add_string(out, "gap_unit", qm_gap_unit_names[request->tolerance_is_absolute]);
}

void qm_job_add_engine(qm_text *out, const qm_job_request *request)
{
    const qm_job_request defaults = qm_job_request_default();
    bool is_open = false;
    for (const qm_job_field *field = qm_job_hooks_of(request->kind)->fields; field->name; field++) {
        const void *value = (const char *)request + field->offset,
                   *usual = (const char *)&defaults + field->offset;
        bool is_count = field->type == QM_FIELD_COUNT;
        if (!field->is_engine || memcmp(value, usual, is_count ? sizeof(size_t) : sizeof(int)) == 0) continue;
        QM_ASSERT(is_count || field->type == QM_FIELD_CHOICE);
        if (!is_open) qm_json_open(out, "engine", "{");
        is_open = true;
        if (is_count)
            qm_json_add_count(out, field->name, *(const size_t *)value);
        else
            qm_json_add_string(out, field->name, field->names[*(const int *)value]);
    }
    if (is_open) qm_text_add_string(out, "}");
}

qm_interval qm_job_widen(qm_interval interval, double a, double b)
{
    double uncertainty = a > 0.0 && b > 0.0 ? nextafter(a + b, INFINITY) : a + b;
    if (!(uncertainty > 0.0)) return interval;
    double lower = nextafter(interval.lower - uncertainty, 0.0);
    return (qm_interval){interval.lower > uncertainty ? lower : 0.0,
                         nextafter(interval.upper + uncertainty, INFINITY)};
}

void qm_job_add_of_true(qm_text *out, const qm_job_result *result, qm_interval interval)
{
    double a = result->notes[0].uncertainty, b = result->notes[1].uncertainty;
    if (a > 0.0 || b > 0.0)
        qm_json_add_interval(out, "of_true", qm_job_widen(interval, a, b), result->diagonal);
}

static double prepare_ms(const qm_loaded_mesh *mesh)
{
    return mesh ? mesh->parse_ms + mesh->topology_ms + mesh->bvh_ms : 0.0;
}

bool qm_job_equal_poses(const qm_job_pose *a, const qm_job_pose *b)
{
    return a->is_given == b->is_given &&
           (!a->is_given || memcmp(a->transform, b->transform, sizeof a->transform) == 0);
}

bool qm_job_check_units(const qm_notes notes[2], qm_problem *problem)
{
    const char *a = notes[0].unit, *b = notes[1].unit;
    if (!a[0] || !b[0] || strcmp(a, b) == 0) return true;
    *problem = qm_problem_make(
        QM_PROBLEM_UNITS_DIFFER,
        "the first mesh is in %s, the second in %s: bring one to the unit of the other, or set "
        "the `unit` of the one that is wrong",
        a, b);
    return false;
}

/** A request that was not read from JSON is checked here. */
static qm_status check_request(qm_context *ctx, const qm_job_request *request)
{
    const qm_job_hooks *hooks = qm_job_hooks_of(request->kind);
    qm_problem problem = {.code = QM_PROBLEM_COUNT};
    if (hooks->check) hooks->check(request, &problem);
    return problem.error_count == 0 ? QM_OK : qm_context_fail(ctx, QM_E_ARGUMENT, "%s", problem.detail);
}

qm_status qm_job_execute(qm_context *ctx, const qm_job_request *request, const qm_loaded_mesh *a,
                         const qm_loaded_mesh *b, qm_hausdorff_progress_fn *progress, void *progress_user,
                         qm_job_result *out)
{
    *out = (qm_job_result){.kind = request->kind,
                           .diagonal = a ? a->diagonal : 0.0,
                           .other_diagonal = b ? b->diagonal : 0.0,
                           .notes = {request->notes[0], request->notes[1]},
                           .prepare_a_ms = prepare_ms(a),
                           .prepare_b_ms = prepare_ms(b)};
    if (a) qm_loaded_mesh_move_notes(a, &out->notes[0]);
    if (b) qm_loaded_mesh_move_notes(b, &out->notes[1]);
    QM_ASSERT(ctx && (a || request->set) && request->kind < QM_JOB_KIND_COUNT);
    const qm_job_call call = {
        ctx, request, a, b, progress, progress_user, request->threads > 0 ? request->threads : 1};
    double start_ms = qm_clock_now_ms();
    qm_status status = check_request(ctx, request);
    if (status == QM_OK) status = qm_job_hooks_of(request->kind)->run(&call, out);
    out->elapsed_ms = qm_clock_now_ms() - start_ms;
    if (status != QM_OK) qm_job_result_reset(ctx, out);
    return status;
}

const double *qm_job_result_array(const qm_job_result *result, size_t *count)
{
    const qm_job_hooks *hooks = qm_job_hooks_of(result->kind);
    return hooks->array ? hooks->find_array(result, count) : NULL;
}

const qm_mesh *qm_job_result_mesh(const qm_job_result *result, const qm_mesh_facts **facts)
{
    const qm_job_hooks *hooks = qm_job_hooks_of(result->kind);
    return hooks->find_mesh ? hooks->find_mesh(result, facts) : NULL;
}

void qm_job_result_reset(qm_context *ctx, qm_job_result *result)
{
    const qm_job_hooks *hooks = qm_job_hooks_of(result->kind);
    if (hooks->reset) hooks->reset(ctx, result);
}
