/**
 * handle_jobs.c: jobs as a resource, their streams of events, their results, and batches: lines of jobs in, lines of answers
 * out. The library cannot reply before the whole body has come, so the lines of a batch wait in a file.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "base/log.h"
#include "base/metrics.h"
#include "handlers.h"
#include "job/json_in.h"
#include "media.h"
#include "ops/heatmap_ply.h"
#include "ops/json_out.h"
#include "store/result_file.h"

#define MAX_WAIT_S 600.0
#define MS_PER_S 1e3
/* The largest number that clients with doubles read exactly. */
#define MAX_SEQ ((UINT64_C(1) << 53) - 1)

/** The framing that the client chose; false when it prefers one document. */
static bool wants_stream(const qm_request *request, qm_framing *framing)
{
    const char *media = qm_request_media(request);
    *framing = strcmp(media, QM_MEDIA_SSE) == 0 ? QM_FRAMING_SSE : QM_FRAMING_NDJSON;
    return *framing == QM_FRAMING_SSE || strcmp(media, QM_MEDIA_NDJSON) == 0;
}

/** Seconds of Prefer: wait=N, or 0. */
static double preferred_wait(const qm_request *request)
{
    const char *prefer = qm_request_header(request, "Prefer");
    const char *wait = prefer ? strcasestr(prefer, "wait=") : NULL;
    double seconds = wait ? strtod(wait + strlen("wait="), NULL) : 0.0;
    return seconds > 0.0 ? fmin(seconds, MAX_WAIT_S) : 0.0;
}

static void reply_job(qm_request *request, int status, qm_job *job, bool is_cached)
{
    qm_jobs *jobs = qm_request_app(request)->jobs;
    if (qm_request_wants_id(request))
        qm_reply_id(request, status, qm_job_id(job));
    else
        qm_reply_text(request, status, QM_MEDIA_JSON, qm_job_document(jobs, job, is_cached));
    qm_jobs_release(jobs, job);
}

static void reply_when_done(qm_request *request, qm_job *job, double wait_s, int status_before)
{
    qm_reply_header(request, "Preference-Applied", "wait=%.15g", wait_s);
    qm_reply_when_done(request, job, MS_PER_S * wait_s, status_before);
}

static bool check_type(qm_request *request)
{
    const char *type = qm_request_header(request, "Content-Type");
    /* curl -d sends the type of form data by default; the body is read as JSON. */
    if (!type || qm_media_is(type, "application/json") ||
        qm_media_is(type, "application/x-www-form-urlencoded"))
        return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
                                         "the Content-Type of a job must be application/json");
    qm_reply_problem(request, &problem);
    return false;
}

void qm_handle_job_create(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    const char *idempotency_key;
    if (!check_type(request) || !qm_handlers_read_idempotency_key(request, &idempotency_key)) return;
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_job_request job_request;
    qm_problem problem;
    if (!qm_json_read_job(body, size, &job_request, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_framing framing;
    bool streams = wants_stream(request, &framing);
    const char *caching = qm_request_header(request, "Cache-Control");
    char client[QM_CLIENT_SIZE];
    qm_request_client(request, client);
    qm_job_submission submission = {.request = &job_request,
                                    .body = body,
                                    .idempotency_key = idempotency_key,
                                    .client = client,
                                    .use_cache = !(caching && strcasestr(caching, "no-cache")),
                                    .owns_job = streams && !job_request.detach};
    bool is_cached;
    qm_job *job = qm_jobs_submit(app->jobs, &submission, &is_cached, &problem);
    qm_job_request_reset(&job_request);
    if (!job) {
        qm_reply_problem(request, &problem);
        return;
    }
    double wait = preferred_wait(request);
    qm_reply_header(request, "Location", "/v1/jobs/%s", qm_job_id(job));
    if (streams) {
        qm_reply_stream(request, 200, job, 0, framing, submission.owns_job);
    } else if (is_cached) {
        reply_job(request, 200, job, true);
    } else if (wait > 0.0) {
        reply_when_done(request, job, wait, 202);
    } else {
        reply_job(request, 202, job, false);
    }
}

/** Reads the filters of a list; *state is where that of the filter may be. False after a refusal. */
static bool read_filter(qm_request *request, qm_store_job_filter *out, qm_job_state *state)
{
    const char *type = qm_request_query(request, "type"), *mesh = qm_request_query(request, "mesh"),
               *reconstruction = qm_request_query(request, "reconstruction"),
               *name = qm_request_query(request, "state");
    qm_job_kind kind;
    qm_problem problem;
    *out = (qm_store_job_filter){type, mesh ? mesh : reconstruction, name ? state : NULL,
                                 qm_request_query(request, "label")};
    if (type && !qm_job_kind_find(type, &kind))
        problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`type` is not a kind of job");
    else if (name && !qm_job_state_find(name, state))
        problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                  "`state` must be queued, running, succeeded, failed or canceled");
    else if (mesh && reconstruction)
        problem =
            qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "no job has both a `mesh` and a `reconstruction`");
    else
        return true;
    qm_reply_problem(request, &problem);
    return false;
}

void qm_handle_job_list(qm_request *request)
{
    qm_store_page page;
    qm_store_job_filter filter;
    qm_job_state state;
    int64_t next;
    if (!qm_handlers_read_paging(request, &page) || !read_filter(request, &filter, &state)) return;
    qm_text out = {0};
    qm_text_add_string(&out, "{\"jobs\":[");
    if (!qm_jobs_list(qm_request_app(request)->jobs, page, &filter, &out, &next)) out.failed = true;
    qm_handlers_end_page(&out, next);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}

/** The job of the path with a reference, or NULL after a refusal. */
static qm_job *find_job(qm_request *request)
{
    qm_problem problem;
    qm_job *job = qm_jobs_find(qm_request_app(request)->jobs, qm_request_id(request), &problem);
    if (!job) qm_reply_problem(request, &problem);
    return job;
}

void qm_handle_job_get(qm_request *request)
{
    qm_job *job = find_job(request);
    if (!job) return;
    double wait = preferred_wait(request);
    if (wait > 0.0)
        reply_when_done(request, job, wait, 200);
    else
        reply_job(request, 200, job, false);
}

void qm_handle_job_patch(qm_request *request)
{
    size_t size;
    const char *body = qm_request_body(request, &size);
    char *labels;
    qm_problem problem;
    qm_job *job = find_job(request);
    if (!job) return;
    qm_jobs *jobs = qm_request_app(request)->jobs;
    bool is_changed =
        qm_json_read_labels(body, size, &labels, &problem) && qm_jobs_set_labels(jobs, job, labels, &problem);
    free(labels);
    if (is_changed) {
        reply_job(request, 200, job, false);
        return;
    }
    qm_jobs_release(jobs, job);
    qm_reply_problem(request, &problem);
}

void qm_handle_job_delete(qm_request *request)
{
    static const char *const choices[] = {"running", "ended", NULL};
    int choice;
    if (!qm_request_choice(request, "job", choices, &choice)) return;
    qm_job *job = find_job(request);
    if (!job) return;
    qm_jobs *jobs = qm_request_app(request)->jobs;
    if (choice == 1) {
        qm_problem fault;
        bool removed = qm_jobs_remove(jobs, job, &fault);
        qm_jobs_release(jobs, job);
        if (removed)
            qm_reply_empty(request, 204);
        else
            qm_reply_problem(request, &fault);
        return;
    }
    if (qm_jobs_cancel(jobs, job)) {
        reply_job(request, 202, job, false);
        return;
    }
    qm_jobs_release(jobs, job);
    qm_problem problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job has ended already");
    qm_reply_problem(request, &problem);
}

static bool read_seq(const char *text, uint64_t *seq)
{
    char *end;
    errno = 0;
    *seq = strtoull(text, &end, 10);
    return end != text && !*end && text[0] != '-' && errno == 0 && *seq <= MAX_SEQ;
}

/** Where to go on: ?after=, else Last-Event-ID, else from the first event. */
static bool read_after(qm_request *request, uint64_t *after)
{
    const char *query = qm_request_query(request, "after"),
               *header = qm_request_header(request, "Last-Event-ID");
    *after = 0;
    if ((!header || read_seq(header, after)) && (!query || read_seq(query, after))) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`after` must be the seq of an event");
    qm_reply_problem(request, &problem);
    return false;
}

void qm_handle_job_events(qm_request *request)
{
    uint64_t after;
    if (!read_after(request, &after)) return;
    qm_framing framing;
    wants_stream(request, &framing);
    qm_job *job = find_job(request);
    if (job) qm_reply_stream(request, 200, job, after, framing, false);
}

/* ---- results, whose long arrays are streamed from their files ---- */

/** Notes that the array of a job is not what was written: an equal request is then computed again. */
static qm_problem note_damage(qm_store *store, const char *id)
{
    qm_metrics_add(QM_METRICS_DAMAGES, 1);
    qm_log(QM_LOG_ERROR, "the stored array of job %s is damaged or missing", id);
    qm_store_forget_answer(store, id);
    return qm_problem_make(QM_PROBLEM_RECORD_DAMAGED,
                           "the stored array of job %s is damaged; the same request will be computed again",
                           id);
}

/** A reply with an array; in JSON it is the last member of the result object. */
typedef struct array_reply {
    qm_result_file *file;
    qm_store *store;
    char id[QM_ID_SIZE];
    const qm_job_array *array;
    qm_array_format rows;
    char *result;
    uint64_t count, done; /* numbers; of PLY those of both passes are done */
    size_t block;         /* numbers at a time: complete records, and complete blocks of the file */
    double numbers[];
} array_reply;

static void end_array(void *user)
{
    array_reply *s = user;
    qm_result_file_close(s->file);
    free(s->result);
    free(s);
}

/** Reads the block that begins at a number, and sets how many it has; false with a problem. */
static bool read_numbers(array_reply *s, uint64_t first, size_t *count, qm_problem *problem)
{
    *count = s->count - first < s->block ? (size_t)(s->count - first) : s->block;
    if (qm_result_file_read(s->file, first, s->numbers, *count) == QM_OK) return true;
    *problem = note_damage(s->store, s->id);
    return false;
}

static double find_error(const char *result)
{
    qm_json *json = qm_json_parse(result);
    double error = qm_json_get_number(json, "error");
    qm_json_free(json);
    return error;
}

/** A heat map as PLY: one pass over the triangles for their corners, and one for their faces. */
static qm_block next_ply_block(void *user, qm_text *out, qm_problem *problem)
{
    array_reply *s = user;
    bool is_second = s->done >= s->count;
    uint64_t first = is_second ? s->done - s->count : s->done;
    size_t count;
    if (!read_numbers(s, first, &count, problem)) return QM_BLOCK_FAILED;
    if (s->done == 0) qm_heatmap_ply_begin(out, s->count / QM_HEATMAP_COLUMNS, find_error(s->result));
    if (is_second)
        qm_heatmap_ply_add_faces(out, s->numbers, first / QM_HEATMAP_COLUMNS, count / QM_HEATMAP_COLUMNS);
    else
        qm_heatmap_ply_add_corners(out, s->numbers, count / QM_HEATMAP_COLUMNS);
    s->done += count;
    return s->done < 2 * s->count ? QM_BLOCK_MORE : QM_BLOCK_LAST;
}

static qm_block next_block(void *user, qm_text *out, qm_problem *problem)
{
    array_reply *s = user;
    size_t count;
    if (!read_numbers(s, s->done, &count, problem)) return QM_BLOCK_FAILED;
    if (s->done == 0 && s->rows == QM_ARRAY_CSV) qm_text_printf(out, "%s\n", s->array->header);
    if (s->done == 0 && s->rows == QM_ARRAY_JSON) {
        qm_text_add_string(out, "{");
        qm_json_add_members(out, s->result);
        qm_json_open(out, s->array->member, "[");
    }
    int columns = s->array->columns;
    qm_text_add_array(out, s->rows, columns, s->done / (size_t)columns, s->numbers, count);
    s->done += count;
    if (s->done < s->count) return QM_BLOCK_MORE;
    if (s->rows == QM_ARRAY_JSON) qm_text_add_string(out, "]}");
    return QM_BLOCK_LAST;
}

static bool is_ply(const qm_request *request)
{
    return strcmp(qm_request_media(request), QM_MEDIA_PLY) == 0;
}

static void reply_array(qm_request *request, const qm_job_array *array, qm_result_file *file, char *result)
{
    const size_t columns = (size_t)array->columns;
    const size_t block = QM_RESULT_BLOCK * (columns % 2 == 0 ? columns / 2 : columns);
    array_reply *s = malloc(sizeof *s + block * sizeof *s->numbers);
    if (!s) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply");
        qm_result_file_close(file);
        free(result);
        qm_reply_problem(request, &problem);
        return;
    }
    *s = (array_reply){.file = file,
                       .store = qm_request_app(request)->store,
                       .array = array,
                       .rows = qm_request_rows(request),
                       .result = result,
                       .count = qm_result_file_count(file),
                       .block = block};
    snprintf(s->id, sizeof s->id, "%s", qm_request_id(request));
    uint64_t size = s->rows == QM_ARRAY_BINARY ? s->count * sizeof(double) : QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_request_media(request), size,
                    (qm_block_source){is_ply(request) ? next_ply_block : next_block, end_array, s});
}

/** The array of a job's kind, which the document of an ended job names. */
static const qm_job_array *find_array(qm_jobs *jobs, qm_job *job)
{
    bool has_ended;
    char *text = qm_job_document_now(jobs, job, &has_ended);
    qm_json *document = text ? qm_json_parse(text) : NULL;
    const char *name = document ? qm_json_get_string(document, "type") : NULL;
    qm_job_kind kind;
    const qm_job_array *array = name && qm_job_kind_find(name, &kind) ? qm_job_array_of(kind) : NULL;
    qm_json_free(document);
    free(text);
    return array;
}

/** Reads ?format=, which goes before the Accept header. */
static bool read_result_format(qm_request *request)
{
    static const char *const names[] = {"json", "binary", "csv", "ply", NULL};
    static const char *const media[] = {QM_MEDIA_JSON, QM_MEDIA_BINARY, QM_MEDIA_CSV, QM_MEDIA_PLY};
    int format;
    if (!qm_request_choice(request, "format", names, &format)) return false;
    if (qm_request_query(request, "format")) qm_request_set_media(request, media[format]);
    return true;
}

void qm_handle_job_result(qm_request *request)
{
    if (!read_result_format(request)) return;
    qm_app *app = qm_request_app(request);
    const char *id = qm_request_id(request);
    qm_problem problem;
    qm_job *job = qm_jobs_find(app->jobs, id, &problem);
    if (!job) {
        qm_reply_problem(request, &problem);
        return;
    }
    char *result = qm_job_result_object(app->jobs, job);
    const qm_job_array *array = result ? find_array(app->jobs, job) : NULL;
    qm_jobs_release(app->jobs, job);
    if (!result) {
        problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job has no result");
        qm_reply_problem(request, &problem);
        return;
    }
    if (is_ply(request) && array != qm_job_array_of(QM_JOB_HEATMAP)) {
        free(result);
        problem = qm_problem_make(QM_PROBLEM_NOT_ACCEPTABLE, "of all results only heat maps come as PLY");
        qm_reply_problem(request, &problem);
        return;
    }
    qm_result_file *file = NULL;
    qm_status status = array ? qm_result_file_open(app->store, id, &file) : QM_E_EMPTY;
    if (file) {
        reply_array(request, array, file, result);
        return;
    }
    if (status != QM_E_EMPTY) {
        free(result);
        problem = status == QM_E_FORMAT
                      ? note_damage(app->store, id)
                      : qm_problem_make(status == QM_E_NO_MEMORY  ? QM_PROBLEM_OUT_OF_MEMORY
                                        : status == QM_E_CANCELED ? QM_PROBLEM_STORE_UNAVAILABLE
                                                                  : QM_PROBLEM_UNAVAILABLE,
                                        "the result of job %s cannot be read", id);
        qm_reply_problem(request, &problem);
        return;
    }
    if (qm_request_rows(request) == QM_ARRAY_JSON) {
        qm_reply_text(request, 200, QM_MEDIA_JSON, result);
        return;
    }
    free(result);
    problem = qm_problem_make(QM_PROBLEM_NOT_ACCEPTABLE,
                              "the result of this job is available as application/json only");
    qm_reply_problem(request, &problem);
}

/* ---- batches ---- */

void qm_handle_batch_create(qm_request *request)
{
    qm_problem problem;
    if (atomic_load(&qm_request_app(request)->draining)) {
        problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping and takes no new jobs");
        qm_reply_problem(request, &problem);
        return;
    }
    const char *type = qm_request_header(request, "Content-Type");
    /* curl sends the type of form data by default. */
    if (!type || qm_media_is(type, QM_MEDIA_NDJSON) || qm_media_is(type, QM_MEDIA_BINARY) ||
        qm_media_is(type, "application/x-www-form-urlencoded")) {
        qm_reply_batch(request, qm_request_take_upload(request));
        return;
    }
    problem = qm_problem_make(QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
                              "the Content-Type of a batch must be application/x-ndjson");
    qm_reply_problem(request, &problem);
}
