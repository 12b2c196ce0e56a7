/**
 * handle_results.c: GET /v1/jobs/{id}/result: the result of a job with the long array that its document and
 * its events leave out, streamed from its file.
 */
#include <endian.h>
#include <stdlib.h>
#include <string.h>

#include "handlers.h"
#include "json_out.h"
#include "result_file.h"

#define BLOCK 16384 /* numbers */

/** What is sent: in JSON the result object first, its last brace cut off. */
typedef struct sending {
    qm_result_file *file;
    qm_rows rows;
    char *result;
    uint64_t count, done;
} sending;

static void end_sending(void *user)
{
    sending *s = user;
    qm_result_file_close(s->file);
    free(s->result);
    free(s);
}

static void write_begin(const sending *s, qm_text *out)
{
    if (s->rows == QM_ROWS_CSV) qm_text_add_string(out, "vertex,distance\n");
    if (s->rows != QM_ROWS_JSON) return;
    qm_text_add(out, s->result, strlen(s->result) - 1);
    qm_json_open(out, "vertex_distances", "[");
}

static void write_number(const sending *s, uint64_t place, double number, qm_text *out)
{
    char text[QM_JSON_NUMBER_SIZE];
    if (s->rows == QM_ROWS_BINARY)
        qm_text_add(out, (const char *)&number, sizeof number);
    else if (s->rows == QM_ROWS_CSV)
        qm_text_printf(out, "%llu,%s\n", (unsigned long long)place, qm_json_number(number, text));
    else
        qm_text_printf(out, "%s%s", place > 0 ? "," : "", qm_json_number(number, text));
}

static qm_block next_block(void *user, qm_text *out)
{
    sending *s = user;
    double numbers[BLOCK];
    size_t count = s->count - s->done < BLOCK ? (size_t)(s->count - s->done) : BLOCK;
    if (!qm_result_file_read(s->file, s->done, numbers, count)) return QM_BLOCK_FAILED;
    if (s->done == 0) write_begin(s, out);
    if (s->rows == QM_ROWS_BINARY) qm_feet_turn_bytes(numbers, count);
    for (size_t i = 0; i < count; i++)
        write_number(s, s->done + i, numbers[i], out);
    s->done += count;
    if (s->done < s->count) return QM_BLOCK_MORE;
    if (s->rows == QM_ROWS_JSON) qm_text_add_string(out, "]}");
    return QM_BLOCK_LAST;
}

/** The rows that the client asked for. */
static qm_rows chosen_rows(const qm_request *request)
{
    const char *media = qm_request_media(request);
    if (strcmp(media, QM_MEDIA_BINARY) == 0) return QM_ROWS_BINARY;
    return strcmp(media, QM_MEDIA_CSV) == 0 ? QM_ROWS_CSV : QM_ROWS_JSON;
}

/** Replies with a result that has no array: what there is of it is the object. */
static void reply_object(qm_request *request, char *result)
{
    if (chosen_rows(request) == QM_ROWS_JSON) {
        qm_reply_text(request, 200, QM_MEDIA_JSON, result);
        return;
    }
    free(result);
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_NOT_ACCEPTABLE, "the result of this job comes as application/json");
    qm_reply_problem(request, &problem);
}

static void reply_array(qm_request *request, qm_result_file *file, char *result)
{
    sending *s = malloc(sizeof *s);
    if (!s) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the reply");
        qm_result_file_close(file);
        free(result);
        qm_reply_problem(request, &problem);
        return;
    }
    *s = (sending){
        .file = file, .rows = chosen_rows(request), .result = result, .count = qm_result_file_count(file)};
    uint64_t size = s->rows == QM_ROWS_BINARY ? s->count * sizeof(double) : QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_request_media(request), size,
                    (qm_block_source){next_block, end_sending, s});
}

void qm_handle_job_result(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    const char *id = qm_request_id(request);
    qm_job *job = qm_jobs_find(app->jobs, id);
    qm_problem problem;
    if (!job) {
        problem = qm_problem_make(QM_PROBLEM_JOB_NOT_FOUND, "there is no job %s", id);
        qm_reply_problem(request, &problem);
        return;
    }
    char *result = qm_job_result_object(app->jobs, job);
    qm_jobs_release(app->jobs, job);
    if (!result) {
        problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job has no result, or none yet");
        qm_reply_problem(request, &problem);
        return;
    }
    qm_result_file *file = qm_result_file_open(app->store, id);
    if (file)
        reply_array(request, file, result);
    else
        reply_object(request, result);
}
