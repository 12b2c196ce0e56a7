/**
 * check_ask.c: a pair of meshes and the jobs that are asked about it: loaded in this process, or on a daemon. Both answer with
 * the result object of the API, so that one reader serves both.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "check.h"

/** Keeps what is wrong with the file of a side. */
static void keep_problem(cli_checked_pair *pair, int side, const qm_problem *problem)
{
    cli_format_problem(pair->problem, CLI_DETAIL_SIZE, pair->check->path[side], problem);
}

/** The side that the message of a job blames. */
static int blamed_side(const char *message)
{
    return strncmp(message, "mesh B", 6) == 0;
}

/* ---- in this process ---- */

static bool load_here(cli_checked_pair *pair)
{
    const qm_check_rule *rule = &pair->check->rule;
    qm_preparation preparation[2];
    for (int side = 0; side < 2; side++) {
        preparation[side] = cli_prepare(true, rule->quads, pair->settings->threads);
        /* What is known of the golden mesh as a solid. */
        preparation[side].keeps_pairs = qm_check_rule_is_signed(rule);
    }
    if (pair->pose.is_given) preparation[0].transform = pair->pose.transform;
    qm_problem problem;
    int failed =
        cli_try_pair(&pair->ctx, (const char *const *)pair->check->path, preparation, pair->mesh, &problem);
    if (failed >= 0) {
        keep_problem(pair, failed, &problem);
        return false;
    }
    pair->is_loaded = true;
    qm_notes notes[2] = {pair->notes[0], pair->notes[1]};
    for (int side = 0; side < 2; side++)
        if (!notes[side].unit[0]) memcpy(notes[side].unit, pair->mesh[side].unit, sizeof notes[side].unit);
    memcpy(pair->notes, notes, sizeof notes);
    if (qm_job_check_units(notes, &problem)) return true;
    keep_problem(pair, 1, &problem);
    return false;
}

static char *ask_here(cli_checked_pair *pair, const qm_job_request *request, bool is_pair)
{
    qm_job_result result;
    qm_status status = qm_job_execute(&pair->ctx, request, &pair->mesh[0], is_pair ? &pair->mesh[1] : NULL,
                                      NULL, NULL, &result);
    qm_text text = {0};
    if (status == QM_OK) {
        qm_json_write_result(&text, request, &result);
        qm_job_result_reset(&pair->ctx, &result);
    } else {
        qm_problem problem = qm_problem_from_status(status, pair->ctx.message);
        keep_problem(pair, blamed_side(pair->ctx.message), &problem);
    }
    return status == QM_OK ? qm_text_take(&text) : NULL;
}

static bool move_here(cli_checked_pair *pair, const double transform[QM_TRANSFORM_SIZE])
{
    qm_loaded_mesh *mesh = &pair->mesh[0];
    qm_context *ctx = &pair->ctx;
    size_t updated;
    double *positions = qm_context_alloc(ctx, mesh->mesh.vertex_count, 3 * sizeof *positions);
    qm_status status = positions ? qm_transform_positions(ctx, transform, &mesh->mesh, positions)
                                 : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the moved mesh");
    if (status == QM_OK)
        status = qm_loaded_mesh_deform(ctx, mesh, positions, NULL, 0, pair->settings->threads, &updated);
    else
        qm_context_free(ctx, positions, mesh->mesh.vertex_count, 3 * sizeof *positions);
    if (status == QM_OK) return true;
    qm_problem problem = qm_problem_from_status(status, ctx->message);
    keep_problem(pair, 0, &problem);
    return false;
}

/* ---- on a daemon ---- */

static bool load_there(cli_checked_pair *pair)
{
    for (int side = 0; side < 2; side++) {
        if (cli_session_upload(pair->settings->session, pair->check->path[side], &pair->notes[side],
                               pair->id[side], NULL))
            continue;
        keep_problem(pair, side, &pair->told);
        return false;
    }
    return true;
}

static char *ask_there(cli_checked_pair *pair, qm_job_request *request, bool is_pair)
{
    snprintf(request->a, sizeof request->a, "%s", pair->id[0]);
    if (is_pair) snprintf(request->b, sizeof request->b, "%s", pair->id[1]);
    char *result = cli_session_run_job(pair->settings->session, request, (cli_bar){0});
    if (!result) keep_problem(pair, blamed_side(pair->told.detail), &pair->told);
    return result;
}

/* ---- what a check asks ---- */

bool cli_open_checked(cli_checked_pair *pair)
{
    const qm_check_rule *rule = &pair->check->rule;
    pair->ctx = qm_host_context();
    pair->ctx.cancel = &cli_interrupted;
    pair->pose = rule->pose;
    memcpy(pair->notes, rule->notes, sizeof pair->notes);
    if (!pair->settings->session) return load_here(pair);
    cli_session_keep_problems(pair->settings->session, &pair->told);
    return load_there(pair);
}

void cli_close_checked(cli_checked_pair *pair)
{
    if (pair->settings->session) cli_session_keep_problems(pair->settings->session, NULL);
    if (pair->is_loaded) cli_unload_pair(&pair->ctx, pair->mesh);
    pair->is_loaded = false;
}

qm_job_request cli_checked_request(const cli_checked_pair *pair, qm_job_kind kind)
{
    qm_job_request request = qm_job_request_default();
    request.kind = kind;
    request.threads = pair->settings->threads;
    request.quads = pair->check->rule.quads;
    request.pose[0] = pair->pose;
    memcpy(request.notes, pair->notes, sizeof request.notes);
    return request;
}

char *cli_ask_checked(cli_checked_pair *pair, qm_job_request *request, bool is_pair)
{
    pair->problem[0] = '\0';
    return pair->settings->session ? ask_there(pair, request, is_pair) : ask_here(pair, request, is_pair);
}

bool cli_move_checked(cli_checked_pair *pair, const double transform[QM_TRANSFORM_SIZE])
{
    if (qm_transform_is_identity(transform)) return true;
    pair->pose.is_given = true;
    memcpy(pair->pose.transform, transform, sizeof pair->pose.transform);
    return pair->settings->session ? true : move_here(pair, transform);
}
