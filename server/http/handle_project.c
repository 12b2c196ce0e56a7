/**
 * handle_project.c: POST /v1/meshes/{id}/project, for more points than a job's JSON can hold.
 *
 * The library cannot reply before the whole body is received, so the points wait in a file, as uploads do. A
 * first pass rejects a body with a bad point and names its index; then each block of the reply reads,
 * projects and writes its own points.
 */
#include <endian.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "handlers.h"
#include "media.h"
#include "ops/job_kinds.h"
#include "ops/projections.h"

typedef enum number_type { F64, F32 } number_type;

typedef struct projection_task {
    qm_meshes *meshes;
    qm_mesh_ref *mesh;
    qm_job_pose pose; /* where the mesh lies */
    qm_accelerator accelerator;
    qm_locator locator;
    qm_blob_writer *upload;
    number_type type;
    qm_quad_reading quads;
    int threads;
    qm_array_format rows;
    uint64_t count, done; /* points */
} projection_task;

static size_t row_size(number_type type)
{
    return 3 * (type == F32 ? sizeof(float) : sizeof(double));
}

static void end_projecting(void *user)
{
    projection_task *p = user;
    qm_context ctx = qm_context_make();
    qm_locator_reset(&ctx, &p->locator);
    qm_blob_abort(p->upload);
    qm_meshes_release(p->meshes, p->mesh);
    free(p);
}

/* ---- points ---- */

static size_t block_count(const projection_task *p, uint64_t first)
{
    uint64_t rest = p->count - first;
    return rest < QM_PROJECTIONS_BLOCK ? (size_t)rest : QM_PROJECTIONS_BLOCK;
}

/** Reads points of the body; the array has room for three doubles each. */
static bool read_block(const projection_task *p, uint64_t first, double *points, qm_problem *problem)
{
    size_t width = row_size(p->type), count = block_count(p, first);
    if (qm_blob_read(p->upload, first * width, points, count * width) != QM_OK) {
        *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "the points cannot be read back");
        return false;
    }
    if (p->type == F32)
        qm_projections_widen(points, 3 * count);
    else
        qm_text_swap_bytes(points, 3 * count);
    return true;
}

static double *make_block(const projection_task *p, uint64_t first)
{
    return malloc((block_count(p, first) + 1) * 3 * sizeof(double));
}

/** False with a problem, and a pointer to the first coordinate that is not finite or out of range. */
static bool check_block(const projection_task *p, uint64_t first, const double *points, qm_problem *problem)
{
    size_t count = 3 * block_count(p, first), bad = qm_projections_find_invalid(points, count);
    if (bad == count) {
        qm_context ctx = qm_context_make();
        qm_status status =
            qm_project_check(&ctx, qm_mesh_ref_get(p->mesh)->bvh, points, (size_t)first, count / 3);
        if (status != QM_OK) *problem = qm_problem_from_status(status, ctx.message);
        return status == QM_OK;
    }
    *problem = qm_problem_make(QM_PROBLEM_NOT_FINITE, "point %llu has a coordinate that is not finite",
                               (unsigned long long)(first + bad / 3));
    qm_problem_add_offset(problem, (size_t)(3 * first + bad) * row_size(p->type) / 3,
                          "is not a finite number");
    return false;
}

static bool check_points(const projection_task *p, qm_problem *problem)
{
    double *points = make_block(p, 0);
    bool good = points;
    if (!points) *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the points");
    for (uint64_t first = 0; good && first < p->count; first += block_count(p, first))
        good = read_block(p, first, points, problem) && check_block(p, first, points, problem);
    free(points);
    return good;
}

/* ---- the reply ---- */

static bool project_block(projection_task *p, double *points, size_t count, qm_text *out, qm_problem *problem)
{
    const qm_loaded_mesh *mesh = qm_mesh_ref_get(p->mesh);
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    qm_projections feet;
    qm_status status =
        qm_projections_find(&ctx, mesh, &p->locator, p->quads, points, count, p->threads, &feet);
    if (status != QM_OK) {
        *problem = qm_problem_from_status(status, ctx.message);
        return false;
    }
    qm_projections_write(out, p->rows, &feet, mesh->diagonal, p->done == 0);
    qm_projections_reset(&ctx, &feet);
    return true;
}

static qm_block next_block(void *user, qm_text *out, qm_problem *problem)
{
    projection_task *p = user;
    size_t count = block_count(p, p->done);
    double *points = make_block(p, p->done);
    if (p->done == 0) qm_projections_write_begin(out, p->rows);
    bool good =
        points && read_block(p, p->done, points, problem) && project_block(p, points, count, out, problem);
    if (!points) *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the points");
    free(points);
    if (!good) return QM_BLOCK_FAILED;
    p->done += count;
    if (p->done < p->count) return QM_BLOCK_MORE;
    qm_projections_write_end(out, p->rows);
    return QM_BLOCK_LAST;
}

/* ---- the request ---- */

static bool check_type(qm_request *request)
{
    const char *type = qm_request_header(request, "Content-Type");
    /* curl sends the type of form data by default. */
    if (!type || qm_media_is(type, QM_MEDIA_BINARY) || qm_media_is(type, "application/x-www-form-urlencoded"))
        return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
                                         "the Content-Type of points must be application/octet-stream");
    qm_reply_problem(request, &problem);
    return false;
}

static bool read_threads(qm_request *request, int *out)
{
    const char *given = qm_request_query(request, "threads");
    char *end;
    long threads = given ? strtol(given, &end, 10) : (long)qm_request_app(request)->config->job_threads;
    *out = (int)threads;
    if (!given || (end != given && !*end && threads >= 1 && threads <= QM_JOB_MAX_THREADS)) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                         "`threads` must be an integer from 1 to %d", QM_JOB_MAX_THREADS);
    qm_reply_problem(request, &problem);
    return false;
}

/** Reads the transform that moves the mesh: 16 numbers, separated by commas; false after a problem was the reply. */
static bool read_pose(qm_request *request, qm_job_pose *out)
{
    const char *given = qm_request_query(request, "transform");
    if (!given) return true;
    int count = 0;
    char *end = NULL;
    for (const char *at = given; count < QM_TRANSFORM_SIZE; at = end + 1) {
        out->transform[count] = strtod(at, &end);
        if (end == at || !isfinite(out->transform[count])) break;
        count++;
        if (*end != ',') break;
    }
    qm_context ctx = qm_context_make();
    bool is_read = count == QM_TRANSFORM_SIZE && !*end;
    if (is_read && qm_transform_check(&ctx, out->transform) == QM_OK) {
        out->is_given = !qm_transform_is_identity(out->transform);
        return true;
    }
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                        "`transform` must be 16 finite numbers, the columns of a 4 x 4 matrix "
                        "that moves a mesh, separated by commas%s%.100s",
                        is_read ? ": " : "", is_read ? ctx.message : "");
    qm_reply_problem(request, &problem);
    return false;
}

static bool read_parameters(qm_request *request, projection_task *p)
{
    static const char *const types[] = {"f64", "f32", NULL}, *const orders[] = {"input", NULL};
    int type, reading, order, accelerator;
    if (!qm_request_choice(request, "dtype", types, &type) ||
        !qm_request_choice(request, "quads", qm_quads_names, &reading) ||
        !qm_request_choice(request, "order", orders, &order) ||
        !qm_request_choice(request, "accelerator", qm_accelerator_names, &accelerator) ||
        !read_threads(request, &p->threads) || !read_pose(request, &p->pose))
        return false;
    p->type = type == 1 ? F32 : F64;
    p->accelerator = (qm_accelerator)accelerator;
    p->quads = (qm_quad_reading)reading;
    p->rows = qm_request_rows(request);
    return true;
}

/** Takes the body and checks it; false with a problem. */
static bool take_points(qm_request *request, projection_task *p, qm_problem *problem)
{
    p->upload = qm_request_take_upload(request);
    uint64_t size = qm_blob_size(p->upload);
    p->count = size / row_size(p->type);
    if (size % row_size(p->type) == 0) return check_points(p, problem);
    *problem =
        qm_problem_make(QM_PROBLEM_MALFORMED_BODY, "the body has %llu bytes; it must be a multiple of %zu",
                        (unsigned long long)size, row_size(p->type));
    return false;
}

static bool build_locator(projection_task *p, qm_problem *problem)
{
    qm_context ctx = qm_context_make();
    const qm_loaded_mesh *mesh = qm_mesh_ref_get(p->mesh);
    qm_status status = qm_locator_build(&ctx, mesh->bvh, mesh->tetra, p->accelerator, &p->locator);
    if (status != QM_OK) *problem = qm_problem_from_status(status, ctx.message);
    return status == QM_OK;
}

void qm_handle_mesh_project(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    projection_task made = {.meshes = app->meshes};
    if (!check_type(request) || !read_parameters(request, &made)) return;
    qm_problem problem;
    projection_task *p = malloc(sizeof *p);
    if (!p) {
        problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the points");
        qm_reply_problem(request, &problem);
        return;
    }
    *p = made;
    qm_notes notes;
    const char *id = qm_request_id(request);
    p->mesh = p->pose.is_given ? qm_meshes_acquire_moved(app->meshes, id, p->pose.transform, &notes, &problem)
                               : qm_meshes_acquire(app->meshes, id, &problem);
    if (!p->mesh || !take_points(request, p, &problem) || !build_locator(p, &problem)) {
        end_projecting(p);
        qm_reply_problem(request, &problem);
        return;
    }
    uint64_t size = p->rows == QM_ARRAY_BINARY ? p->count * QM_PROJECTIONS_RECORD_SIZE : QM_SIZE_UNKNOWN;
    qm_reply_blocks(request, 200, qm_request_media(request), size,
                    (qm_block_source){next_block, end_projecting, p});
}
