/**
 * jobs.c: runs a job in this process, or on a daemon, and shows its progress.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/host.h"
#include "base/json.h"
#include "cli.h"

/* ---- progress ---- */

#define BAR_WIDTH 24

cli_bar cli_bar_make(double tolerance, bool is_forced)
{
    return (cli_bar){
        .is_terminal = isatty(STDERR_FILENO) == 1, .is_forced = is_forced, .tolerance = tolerance};
}

char *cli_format_digits(double bound, bool is_upper, int digits, char out[CLI_BOUND_SIZE])
{
    snprintf(out, CLI_BOUND_SIZE, "%.*g", digits, bound);
    double printed = strtod(out, NULL);
    if (!isfinite(bound) || (is_upper ? printed >= bound : printed <= bound)) return out;
    /* One unit of the last digit outward. Near a power of ten log10 may round to the next digit, which widens the
     * interval and is safe. */
    double unit = pow(10.0, floor(log10(fabs(bound))) - (digits - 1));
    snprintf(out, CLI_BOUND_SIZE, "%.*g", digits, is_upper ? printed + unit : printed - unit);
    return out;
}

char *cli_format_bound(double bound, bool is_upper, char out[CLI_BOUND_SIZE])
{
    return cli_format_digits(bound, is_upper, 9, out);
}

char *cli_format_percent(double share, bool is_upper, char out[CLI_BOUND_SIZE])
{
    double percent = 100.0 * share, rest = fma(100.0, share, -percent); /* what the product lost */
    if (is_upper ? rest > 0.0 : rest < 0.0) percent = nextafter(percent, is_upper ? INFINITY : 0.0);
    return cli_format_digits(percent, is_upper, 6, out);
}

void cli_bar_show(cli_bar *bar, double lower, double upper, double elapsed_ms, double iterations)
{
    if (!(bar->is_terminal || bar->is_forced) || !isfinite(upper)) return;
    QM_ASSERT(lower <= upper);
    double gap = upper - lower;
    if (bar->first_gap == 0.0) bar->first_gap = gap;
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    /* The completed fraction of the way from the first gap to the tolerance, on a log scale. */
    const bool is_open = gap > bar->tolerance && bar->first_gap > bar->tolerance;
    const double fraction = is_open ? log(bar->first_gap / gap) / log(bar->first_gap / bar->tolerance) : 1.0;
    int filled = (int)(fraction * BAR_WIDTH);
    char drawn[BAR_WIDTH + 1];
    for (int i = 0; i < BAR_WIDTH; i++)
        drawn[i] = i < filled ? '#' : '.';
    drawn[BAR_WIDTH] = '\0';
    fprintf(stderr, "%s[%s] %s .. %s  gap %.1e  %.0f/s%s", bar->is_terminal ? "\r" : "", drawn,
            cli_format_bound(lower, false, low), cli_format_bound(upper, true, high), gap,
            elapsed_ms > 0.0 ? 1e3 * iterations / elapsed_ms : 0.0, bar->is_terminal ? "\033[K" : "\n");
}

void cli_bar_tell(const cli_bar *bar, const char *work, double quads, double upper)
{
    char high[CLI_BOUND_SIZE], distance[CLI_BOUND_SIZE + 24] = "";
    if (!(bar->is_terminal || bar->is_forced)) return;
    if (upper > 0.0)
        snprintf(distance, sizeof distance, ", distance %s at most", cli_format_digits(upper, true, 4, high));
    fprintf(stderr, "%s%s: %.0f quads%s%s", bar->is_terminal ? "\r" : "", work, quads, distance,
            bar->is_terminal ? "\033[K" : "\n");
}

void cli_bar_clear(const cli_bar *bar)
{
    if (bar->is_terminal) fputs("\r\033[K", stderr);
}

/* ---- jobs ---- */

cli_job cli_job_make(qm_job_kind kind)
{
    cli_job job = {.request = qm_job_request_default()};
    job.request.kind = kind;
    return job;
}

enum { LIMIT_BANDS = 3 };

bool cli_add_limit_bands(double limit_in, double limit_out, qm_job_request *request)
{
    if (isnan(limit_in) && isnan(limit_out)) return true;
    double in = isnan(limit_in) ? INFINITY : limit_in, out = isnan(limit_out) ? INFINITY : limit_out;
    if (request->sign == QM_SIGN_NONE) request->sign = QM_SIGN_OUTSIDE;
    if (request->band_count + LIMIT_BANDS > QM_JOB_MAX_BANDS) {
        fprintf(stderr, "quadmesh: --bands takes up to %d ranges beside the limits\n",
                QM_JOB_MAX_BANDS - LIMIT_BANDS);
        return false;
    }
    /* Bands are of distances with the sign. */
    bool is_turned = request->sign == QM_SIGN_INSIDE;
    const double from = is_turned ? -out : -in, to = is_turned ? in : out;
    if (isfinite(from)) request->bands[request->band_count++] = (qm_interval){-INFINITY, from};
    request->bands[request->band_count++] = (qm_interval){from, to};
    if (isfinite(to)) request->bands[request->band_count++] = (qm_interval){to, INFINITY};
    return true;
}

static cli_bar make_bar(const cli_job *job, double diagonal)
{
    bool is_absolute = job->request.tolerance_is_absolute || diagonal == 0.0;
    return cli_bar_make(job->request.tolerance * (is_absolute ? 1.0 : diagonal), job->shows_progress);
}

void cli_print_notes(const qm_json *result, const char *prefix)
{
    char path[48], low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    snprintf(path, sizeof path, "%sof_true.lower", prefix);
    double lower = qm_json_get_number(result, path);
    snprintf(path, sizeof path, "%sof_true.upper", prefix);
    if (qm_json_has(result, path))
        printf("  true     %s to %s between the true surfaces\n", cli_format_bound(lower, false, low),
               cli_format_bound(qm_json_get_number(result, path), true, high));
    const char *warning = qm_json_get_string(result, "warnings.0");
    if (warning) printf("  warning  %s\n", warning);
}

/* ---- in this process ---- */

static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    cli_bar_show(user, progress->lower, progress->upper, progress->elapsed_ms, (double)progress->iterations);
}

static void on_stage(void *user, const qm_remesh_stage *stage)
{
    cli_bar_tell(user, qm_remesh_work_names[stage->work], (double)stage->quads, stage->upper);
}

static int run_loaded(const cli_job *job, const qm_loaded_mesh *a, const qm_loaded_mesh *b,
                      cli_finish_fn *finish, const void *user)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    cli_bar bar = make_bar(job, a->diagonal);
    qm_job_result result;
    qm_job_request request = job->request;
    request.remesh.on_stage = on_stage;
    request.remesh.user = &bar;
    qm_problem problem;
    if (!request.notes[0].unit[0]) memcpy(request.notes[0].unit, a->unit, sizeof a->unit);
    if (b && !request.notes[1].unit[0]) memcpy(request.notes[1].unit, b->unit, sizeof b->unit);
    if (b && !qm_job_check_units(request.notes, &problem)) {
        cli_report(job->path[1], &problem, job->as_json);
        return EXIT_BAD_INPUT;
    }
    qm_status status = qm_job_execute(&ctx, &request, a, b, on_progress, &bar, &result);
    cli_bar_clear(&bar);
    if (status != QM_OK) {
        /* A fault of one of two meshes names it. */
        bool is_second = b && strncmp(ctx.message, "mesh B", 6) == 0;
        cli_report_status(job->path[is_second ? 1 : 0], status, &ctx, job->as_json);
        return EXIT_BAD_INPUT;
    }
    qm_text text = {0};
    qm_json_write_result(&text, &job->request, &result);
    char *json = qm_text_take(&text);
    const cli_job_output output = {.json = json, .mesh = {a, b}, .result = &result};
    int exit_status = json ? finish(user, job, &output) : EXIT_BAD_INPUT;
    free(json);
    qm_job_result_reset(&ctx, &result);
    return exit_status;
}

static int run_here(const cli_job *job, cli_finish_fn *finish, const void *user)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    qm_preparation preparation[2];
    for (int side = 0; side < 2; side++) {
        /* Only the kinds that search for nearest points need targets. */
        const qm_job_request *request = &job->request;
        const bool is_target =
            request->kind == QM_JOB_COMPARISON || request->kind == QM_JOB_ALIGNMENT ||
                    request->kind == QM_JOB_REMESH
                ? true
            : request->kind == QM_JOB_HAUSDORFF
                ? request->direction != (side == 0 ? QM_A_TO_B : QM_B_TO_A)
                : (request->kind == QM_JOB_DEVIATION || request->kind == QM_JOB_HEATMAP) && side == 1;
        preparation[side] = cli_prepare(is_target, request->quads, request->threads);
        preparation[side].has_no_tree = job->request.kind == QM_JOB_COLLISION;
        if (request->pose[side].is_given) preparation[side].transform = request->pose[side].transform;
    }
    qm_loaded_mesh mesh[2] = {{.revision = 0}};
    bool is_pair = job->path[1] != NULL;
    bool is_loaded = is_pair ? cli_load_pair(&ctx, job->path, job->as_json, preparation, mesh)
                             : cli_load_mesh(&ctx, job->path[0], job->as_json, &preparation[0], &mesh[0]);
    if (!is_loaded) return EXIT_BAD_INPUT;
    int status = run_loaded(job, &mesh[0], is_pair ? &mesh[1] : NULL, finish, user);
    cli_unload_pair(&ctx, mesh);
    return status;
}

/* ---- in this process, or on a daemon ---- */

static int run_anywhere(const cli_job *job, cli_finish_fn *finish, const void *user)
{
    if (!job->server) return run_here(job, finish, user);
    int status = EXIT_BAD_INPUT;
    cli_session *session = cli_session_open(job->server, job->as_json);
    qm_job_request request = job->request;
    double diagonal = 0.0;
    bool is_ready =
        session && cli_session_upload(session, job->path[0], &request.notes[0], request.a, &diagonal) &&
        (!job->path[1] || cli_session_upload(session, job->path[1], &request.notes[1], request.b, NULL));
    char *json = is_ready ? cli_session_run_job(session, &request, make_bar(job, diagonal)) : NULL;
    const cli_job_output output = {.json = json, .session = session};
    if (json) status = finish(user, job, &output);
    free(json);
    cli_session_close(session);
    return status;
}

/** Keeps the transform of an alignment as the pose of another job. */
static int keep_pose(const void *user, const cli_job *job, const cli_job_output *output)
{
    (void)job;
    qm_job_pose *const *pose = user;
    qm_json *result = qm_json_parse(output->json);
    cli_get_transform(result, (*pose)->transform);
    (*pose)->is_given = !qm_transform_is_identity((*pose)->transform);
    qm_json_free(result);
    return EXIT_OK;
}

/** Finds the pose in which the first mesh lies on the second. */
static int find_pose(const cli_job *job, qm_job_pose *pose)
{
    cli_job alignment = cli_job_make(QM_JOB_ALIGNMENT);
    alignment.path[0] = job->path[0];
    alignment.path[1] = job->path[1];
    alignment.server = job->server;
    alignment.as_json = job->as_json;
    alignment.request.quads = job->request.quads;
    alignment.request.threads = job->request.threads;
    memcpy(alignment.request.notes, job->request.notes, sizeof alignment.request.notes);
    return run_anywhere(&alignment, keep_pose, &pose);
}

int cli_run_job(const cli_job *job, cli_finish_fn *finish, const void *user)
{
    cli_job moved = *job;
    qm_job_pose *pose = &moved.request.pose[0];
    int status = EXIT_OK;
    if (job->aligns)
        status = find_pose(job, pose);
    else if (job->transform && !cli_read_pose(job->transform, pose, job->as_json))
        status = EXIT_BAD_INPUT;
    if (status == EXIT_OK) status = run_anywhere(&moved, finish, user);
    /* After an interrupt an input that could not be read is not to blame. */
    return status == EXIT_BAD_INPUT && atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : status;
}
