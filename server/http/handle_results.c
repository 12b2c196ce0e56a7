/**
 * handle_results.c: GET /v1/jobs/{id}/result: the result of a job with the long array that its document and
 * its events leave out, streamed from its file.
 */
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "handlers.h"
#include "ops/json_out.h"
#include "store/result_file.h"

#define BLOCK 16384 /* numbers: whole rows */

/** A reply with an array; in JSON it is the last member of the result object. */
typedef struct array_reply {
    qm_result_file *file;
    const qm_job_array *array;
    qm_array_format rows;
    char *result;
    uint64_t count, done; /* numbers */
} array_reply;

static void end_array(void *user)
{
    array_reply *s = user;
    qm_result_file_close(s->file);
    free(s->result);
    free(s);
}

static void write_begin(const array_reply *s, qm_text *out)
{
    if (s->rows == QM_ARRAY_CSV) qm_text_printf(out, "%s\n", s->array->header);
    if (s->rows != QM_ARRAY_JSON) return;
    qm_text_add_string(out, "{");
    qm_json_add_members(out, s->result);
    qm_json_open(out, s->array->member, "[");
}

static qm_block next_block(void *user, qm_text *out, qm_problem *problem)
{
    array_reply *s = user;
    double numbers[BLOCK];
    size_t count = s->count - s->done < BLOCK ? (size_t)(s->count - s->done) : BLOCK;
    if (!qm_result_file_read(s->file, s->done, numbers, count)) {
        *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "the result cannot be read back");
        return QM_BLOCK_FAILED;
    }
    if (s->done == 0) write_begin(s, out);
    int columns = s->array->columns;
    qm_array_write(out, s->rows, columns, s->done / (size_t)columns, numbers, count);
    s->done += count;
    if (s->done < s->count) return QM_BLOCK_MORE;
    if (s->rows == QM_ARRAY_JSON) qm_text_add_string(out, "]}");
    return QM_BLOCK_LAST;
}

/** Replies with a result that has no array. */
static void reply_object(qm_request *request, char *result)
{
    if (qm_request_rows(request) == QM_ARRAY_JSON) {
        qm_reply_text(request, 200, QM_MEDIA_JSON, result);
        return;
    }
    free(result);
    qm_problem problem = qm_problem_make(QM_PROBLEM_NOT_ACCEPTABLE,
                                         "the result of this job is available as application/json only");
    qm_reply_problem(request, &problem);
}

static void reply_array(qm_request *request, const qm_job_array *array, qm_result_file *file, char *result)
{
    array_reply *s = malloc(sizeof *s);
    if (!s) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply");
        qm_result_file_close(file);
        free(result);
        qm_reply_problem(request, &problem);
        return;
    }
    *s = (array_reply){.file = file,
                       .array = array,
                       .rows = qm_request_rows(request),
                       .result = result,
                       .count = qm_result_file_count(file)};
    uint64_t size = s->rows == QM_ARRAY_BINARY ? s->count * sizeof(double) : QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_request_media(request), size,
                    (qm_block_source){next_block, end_array, s});
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

void qm_handle_job_result(qm_request *request)
{
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
    qm_result_file *file = array ? qm_result_file_open(app->store, id) : NULL;
    if (file)
        reply_array(request, array, file, result);
    else
        reply_object(request, result);
}
