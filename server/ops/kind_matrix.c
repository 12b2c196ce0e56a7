/**
 * kind_matrix.c: the Hausdorff distances of all pairs of a set of meshes.
 */
#include "job_kinds_internal.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "json_request.h"

enum { COLUMNS = 4 };

/* ---- running ---- */

static qm_status measure(void *user, const qm_matrix_question *question, qm_matrix_answer *out)
{
    const qm_job_call *call = user;
    const qm_job_set *set = call->request->set;
    const qm_loaded_mesh *a, *b;
    qm_status status = set->acquire(set->user, question->a, &a);
    if (status != QM_OK) return status;
    status = set->acquire(set->user, question->b, &b);
    if (status == QM_OK) {
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.quads = call->request->quads;
        options.tolerance = question->tolerance;
        options.threshold = question->threshold;
        options.deadline_ms = question->deadline_ms;
        options.memory_limit = call->request->memory_limit;
        options.tetra[0] = a->tetra;
        options.tetra[1] = b->tetra;
        options.thread_count = call->threads;
        qm_hausdorff_result found;
        status = qm_hausdorff_measure(call->ctx, a->bvh, b->bvh, &options, &found);
        *out = (qm_matrix_answer){
            .lower = found.lower,
            .upper = found.upper,
            .is_stopped = found.stop == QM_STOP_CANCELED || found.stop == QM_STOP_DEADLINE,
        };
        set->release(set->user, question->b);
    }
    set->release(set->user, question->a);
    if (status != QM_E_SCALE) return status;
    /* Of sizes so different, the boxes and other pairs tell all that is known. */
    *out = (qm_matrix_answer){.lower = 0.0, .upper = INFINITY};
    return QM_OK;
}

static void on_pair(void *user, const qm_matrix *matrix, size_t a, size_t b)
{
    const qm_job_set *set = ((const qm_job_call *)user)->request->set;
    if (set->progress) set->progress(set->user, matrix, a, b);
}

/** Reads the boxes of all meshes, and the largest of their diagonals. */
static qm_status read_boxes(const qm_job_call *call, qm_box *boxes, double *diagonal)
{
    const qm_job_set *set = call->request->set;
    *diagonal = 0.0;
    for (size_t i = 0; i < call->request->mesh_count; i++) {
        const qm_loaded_mesh *mesh;
        if (qm_context_canceled(call->ctx)) return QM_E_CANCELED;
        qm_status status = set->acquire(set->user, i, &mesh);
        if (status != QM_OK) return status;
        boxes[i] = mesh->box;
        *diagonal = fmax(*diagonal, mesh->diagonal);
        set->release(set->user, i);
    }
    return QM_OK;
}

/** The rows of the result: in the order of the pairs. */
static double *list_pairs(qm_context *ctx, const qm_matrix *matrix)
{
    double *rows = qm_context_alloc(ctx, matrix->pair_count, COLUMNS * sizeof *rows), *row = rows;
    for (size_t a = 0; rows && a < matrix->count; a++)
        for (size_t b = a + 1; b < matrix->count; b++, row += COLUMNS) {
            size_t pair = qm_matrix_pair(matrix->count, a, b);
            row[0] = (double)a;
            row[1] = (double)b;
            row[2] = matrix->lower[pair];
            row[3] = matrix->upper[pair];
        }
    return rows;
}

/** Keeps the uncertainties of the meshes, when one has any; false when out of memory. */
static bool copy_uncertainty(const qm_job_call *call, qm_job_result *out)
{
    const double *uncertainty = call->request->set->uncertainty;
    size_t count = call->request->mesh_count, i = 0;
    while (uncertainty && i < count && uncertainty[i] == 0.0)
        i++;
    if (!uncertainty || i == count) return true;
    out->matrix_uncertainty = qm_context_alloc(call->ctx, count, sizeof *out->matrix_uncertainty);
    if (out->matrix_uncertainty) memcpy(out->matrix_uncertainty, uncertainty, count * sizeof *uncertainty);
    return out->matrix_uncertainty;
}

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    size_t count = request->mesh_count;
    qm_box *boxes = qm_context_alloc(call->ctx, count, sizeof *boxes);
    if (!boxes)
        return qm_context_fail(call->ctx, QM_E_NO_MEMORY, "out of memory for the boxes of the meshes");
    qm_status status = read_boxes(call, boxes, &out->diagonal);
    if (status == QM_OK) {
        const qm_matrix_options options = {.count = count,
                                           .same = request->set->same,
                                           .boxes = boxes,
                                           .want = request->want,
                                           .nearest = request->nearest < count ? request->nearest : count - 1,
                                           .limit = request->within,
                                           .tolerance = qm_job_tolerance_of(request, out->diagonal),
                                           .deadline_ms = request->deadline_ms,
                                           .measure = measure,
                                           .progress = on_pair,
                                           .user = (void *)(uintptr_t)call};
        out->tolerance = options.tolerance;
        status = qm_matrix_measure(call->ctx, &options, &out->matrix);
    }
    qm_context_free(call->ctx, boxes, count, sizeof *boxes);
    if (status != QM_OK) return status;
    out->is_canceled = out->matrix.stop == QM_MATRIX_CANCELED;
    out->matrix_rows = list_pairs(call->ctx, &out->matrix);
    if (out->matrix_rows && copy_uncertainty(call, out)) return QM_OK;
    return qm_context_fail(call->ctx, QM_E_NO_MEMORY, "out of memory for the pairs");
}

static void reset(qm_context *ctx, qm_job_result *result)
{
    qm_context_free(ctx, result->matrix_rows, result->matrix.pair_count,
                    COLUMNS * sizeof *result->matrix_rows);
    result->matrix_rows = NULL;
    qm_context_free(ctx, result->matrix_uncertainty, result->matrix.count,
                    sizeof *result->matrix_uncertainty);
    result->matrix_uncertainty = NULL;
    qm_matrix_reset(ctx, &result->matrix);
}

static const double *find_pairs(const qm_job_result *result, size_t *count)
{
    *count = COLUMNS * result->matrix.pair_count;
    return result->matrix_rows;
}

/* ---- requests ---- */

static bool read_meshes(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    int count = cJSON_IsArray(value) ? cJSON_GetArraySize(value) : 0;
    if (count < 2 || count > QM_JOB_MAX_MESHES) return false;
    out->meshes = calloc((size_t)count, sizeof *out->meshes);
    if (!out->meshes) {
        at->no_memory = true;
        return false;
    }
    at->depth = at->member_depth = 1;
    for (const cJSON *id = value->child; id; id = id->next, at->index[0]++) {
        qm_job_member *member = &out->meshes[out->mesh_count];
        if (!qm_json_read_mesh(id, member->name, &member->pose, at)) return false;
        out->mesh_count++;
    }
    strcpy(out->a, out->meshes[0].name);
    return true;
}
_Static_assert(QM_JOB_MAX_MESHES == 1000, "the text of meshes names the limit");

/** "all", or an object of one member. */
static bool read_want(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    const char *word = cJSON_GetStringValue(value);
    if (word) return strcmp(word, "all") == 0;
    const cJSON *member = cJSON_IsObject(value) ? value->child : NULL;
    if (!member || member->next) return false;
    if (strcmp(member->string, "nearest") == 0) {
        out->want = QM_MATRIX_NEAREST;
        return qm_json_read_count(member, 1, QM_JOB_MAX_NEAREST, &out->nearest);
    }
    out->want = QM_MATRIX_WITHIN;
    return strcmp(member->string, "within") == 0 && qm_json_read_number(member, &out->within) &&
           out->within >= 0.0;
}
_Static_assert(QM_JOB_MAX_NEAREST == 100, "the text of want names the limit");

/** The one measure that there is. */
static bool read_measure(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)out, (void)at;
    const char *word = cJSON_GetStringValue(value);
    return word && strcmp(word, "hausdorff") == 0;
}

static void add_want(qm_text *out, const qm_job_request *request)
{
    if (request->want == QM_MATRIX_ALL) {
        qm_json_add_string(out, "want", "all");
        return;
    }
    qm_json_open(out, "want", "{");
    if (request->want == QM_MATRIX_NEAREST)
        qm_json_add_count(out, "nearest", request->nearest);
    else
        qm_json_add_number(out, "within", request->within);
    qm_text_add_string(out, "}");
}

static void add_meshes(qm_text *out, const qm_job_request *request)
{
    qm_json_open(out, "meshes", "[");
    for (size_t i = 0; i < request->mesh_count; i++) {
        qm_json_add_comma(out);
        qm_json_add_mesh(out, request->meshes[i].name, &request->meshes[i].pose);
    }
    qm_text_add_string(out, "]");
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    if (is_brief)
        qm_json_add_count(out, "mesh_count", request->mesh_count);
    else
        add_meshes(out, request);
    add_want(out, request);
    qm_job_add_gap(out, request);
}

/* ---- results ---- */

/** An interval of a distance of two of the meshes, for their true surfaces. */
static qm_interval widen(const qm_job_result *result, size_t a, size_t b, qm_interval interval)
{
    const double *uncertainty = result->matrix_uncertainty;
    return uncertainty ? qm_job_widen(interval, uncertainty[a], uncertainty[b]) : interval;
}

/** Adds it, unless these two are exact. */
static void add_of_true(qm_text *out, const qm_job_result *result, size_t a, size_t b, qm_interval interval)
{
    const double *uncertainty = result->matrix_uncertainty;
    if (uncertainty && (uncertainty[a] > 0.0 || uncertainty[b] > 0.0))
        qm_json_add_interval(out, "of_true", widen(result, a, b, interval), result->diagonal);
}

/** The lists of all meshes; a mesh is named by its index. */
static void add_lists(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    static const char *const places[] = {"proven", "tied", "open"};
    const qm_matrix *matrix = &result->matrix;
    qm_matrix_near *near = malloc(matrix->count * sizeof *near);
    if (!near) {
        out->failed = true;
        return;
    }
    qm_json_open(out, "nearest", "[");
    for (size_t item = 0; item < matrix->count; item++) {
        size_t count = qm_matrix_list_nearest(matrix, item, request->nearest, result->tolerance, near);
        qm_json_add_comma(out);
        qm_text_add_string(out, "[");
        for (size_t i = 0; i < count; i++) {
            qm_json_add_comma(out);
            qm_text_add_string(out, "{");
            qm_json_add_count(out, "mesh", near[i].item);
            qm_json_add_number(out, "lower", near[i].lower);
            qm_json_add_number(out, "upper", near[i].upper);
            add_of_true(out, result, item, near[i].item, (qm_interval){near[i].lower, near[i].upper});
            qm_json_add_string(out, "place", places[near[i].place]);
            qm_text_add_string(out, "}");
        }
        qm_text_add_string(out, "]");
    }
    qm_text_add_string(out, "]");
    free(near);
}

/** Adds how many pairs are within the limit and beyond it; of the meshes, or of their true surfaces. */
static void count_verdicts(qm_text *out, const qm_job_request *request, const qm_job_result *result,
                           bool is_of_true)
{
    const qm_matrix *matrix = &result->matrix;
    size_t within = 0, beyond = 0;
    for (size_t a = 0; a < matrix->count; a++)
        for (size_t b = a + 1; b < matrix->count; b++) {
            size_t pair = qm_matrix_pair(matrix->count, a, b);
            qm_interval interval = {matrix->lower[pair], matrix->upper[pair]};
            if (is_of_true) interval = widen(result, a, b, interval);
            within += interval.upper <= request->within;
            beyond += interval.lower > request->within;
        }
    qm_json_add_count(out, "within", within);
    qm_json_add_count(out, "beyond", beyond);
    qm_json_add_count(out, "undecided", matrix->pair_count - within - beyond);
}

static void add_verdicts(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    qm_json_open(out, "verdicts", "{");
    count_verdicts(out, request, result, false);
    if (result->matrix_uncertainty) {
        qm_json_open(out, "of_true", "{");
        count_verdicts(out, request, result, true);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "}");
}

/** The uncertainties, with which the interval of any pair becomes one of the true surfaces. */
static void add_uncertainties(qm_text *out, const qm_job_result *result)
{
    if (!result->matrix_uncertainty) return;
    qm_json_open(out, "uncertainties", "[");
    for (size_t i = 0; i < result->matrix.count; i++) {
        char number[QM_NUMBER_SIZE];
        qm_json_add_comma(out);
        qm_text_add_string(out, qm_text_number(result->matrix_uncertainty[i], number));
    }
    qm_text_add_string(out, "]");
}

static const char *name_stop(const qm_matrix *matrix)
{
    if (matrix->stop == QM_MATRIX_CANCELED) return "canceled";
    if (matrix->stop == QM_MATRIX_DEADLINE) return "deadline";
    return matrix->open == 0 ? "converged" : "precision";
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_matrix *matrix = &result->matrix;
    qm_json_add_string(out, "measure", "hausdorff");
    qm_json_add_count(out, "mesh_count", matrix->count);
    if (request->a[0]) add_meshes(out, request);
    qm_json_add_count(out, "pair_count", matrix->pair_count);
    qm_json_add_count(out, "searched_pairs", matrix->searched);
    qm_json_add_count(out, "bounded_pairs", matrix->bounded);
    qm_json_add_count(out, "searches", matrix->searches);
    qm_json_add_count(out, "pivots", matrix->pivots);
    add_want(out, request);
    if (request->want == QM_MATRIX_NEAREST) add_lists(out, request, result);
    if (request->want == QM_MATRIX_WITHIN) add_verdicts(out, request, result);
    add_uncertainties(out, result);
    qm_json_add_count(out, "open", matrix->open);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "gap", result->tolerance);
    qm_json_add_bool(out, "converged", matrix->open == 0);
    qm_json_add_string(out, "stopped_by", name_stop(matrix));
    qm_json_add_ms(out, "elapsed_ms", matrix->elapsed_ms);
}

static const qm_job_array pairs = {"pairs", "a,b,lower,upper", COLUMNS};

static const qm_job_field fields[] = {
    {"meshes", QM_FIELD_OTHER, .is_required = true, .read = read_meshes,
     .expected = "must be an array of 2 to 1000 meshes: ids, hashes of files after sha256:, or objects with "
                 "\"mesh\" and "
                 "\"transform\""},
    {"want", QM_FIELD_OTHER, .read = read_want,
     .expected =
         "must be \"all\", {\"nearest\": an integer from 1 to 100} or {\"within\": a number of 0 or more}"},
    {"measure", QM_FIELD_OTHER, .read = read_measure, .expected = "must be \"hausdorff\""},
    QM_JOB_FIELD_QUADS,
    QM_JOB_FIELDS_GAP,
    {0}};

const qm_job_hooks qm_job_kind_matrix = {.type = {.name = "matrix", .is_pure = true, .is_anytime = true},
                                         .fields = fields,
                                         .run = run,
                                         .write_request = write_request,
                                         .write_result = write_result,
                                         .array = &pairs,
                                         .find_array = find_pairs,
                                         .reset = reset};
