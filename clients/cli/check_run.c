/**
 * check_run.c: the answer to one check: at most three questions, each of which ends as soon as its answer is certain.
 *
 * A limit for all of both surfaces is a Hausdorff search with a threshold. One for a percentage of them compares the
 * surfaces at rising accuracy, until the shares within the limit are on one side of it: the last round costs most, and
 * the ones before it together about as much.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/host.h"
#include "check.h"

const char *const cli_outcome_names[] = {"within", "undecided", "beyond", "trouble"};

#define MAX_GAP 1e-4 /* of the diagonal: the maximum decides nothing here, and is searched no closer */

/** One check while it runs. */
typedef struct check_run {
    const qm_check *check;
    const cli_check_settings *settings;
    qm_context ctx;
    qm_loaded_mesh mesh[2];
    cli_verdict verdict;
} check_run;

/** Adds a sentence to the detail; the worst outcome of all questions is that of the check. */
static void conclude(cli_verdict *verdict, cli_outcome outcome, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
static void conclude(cli_verdict *verdict, cli_outcome outcome, const char *format, ...)
{
    size_t used = strlen(verdict->detail);
    if (outcome > verdict->outcome) verdict->outcome = outcome;
    if (used > 0) used += (size_t)snprintf(verdict->detail + used, CLI_DETAIL_SIZE - used, "; ");
    if (used >= CLI_DETAIL_SIZE) return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(verdict->detail + used, CLI_DETAIL_SIZE - used, format, arguments);
    va_end(arguments);
}

static void conclude_problem(cli_verdict *verdict, const char *path, const qm_problem *problem)
{
    const qm_problem_error *error = problem->error_count > 0 ? &problem->errors[0] : NULL;
    if (error && error->line != QM_NO_LOCATION)
        conclude(verdict, CLI_TROUBLE, "%s:%zu: %s", path, error->line, problem->detail);
    else if (error && error->offset != QM_NO_LOCATION)
        conclude(verdict, CLI_TROUBLE, "%s: byte %zu: %s", path, error->offset, problem->detail);
    else
        conclude(verdict, CLI_TROUBLE, "%s: %s", path, problem->detail);
}

#define ALIGN_GAP 1e-3 /* of the distance that an alignment measures, of which only the motion is used */

/** Runs a job on the meshes, on the first one alone where is_pair is false; false after its problem. */
static bool run_job(check_run *run, const qm_job_request *request, bool is_pair, qm_job_result *out)
{
    qm_status status =
        qm_job_execute(&run->ctx, request, &run->mesh[0], is_pair ? &run->mesh[1] : NULL, NULL, NULL, out);
    if (status == QM_OK) return true;
    if (status == QM_E_CANCELED) {
        conclude(&run->verdict, CLI_UNDECIDED, "interrupted");
        return false;
    }
    qm_problem problem = qm_problem_from_status(status, run->ctx.message);
    conclude_problem(&run->verdict, run->check->path[0], &problem);
    return false;
}

static qm_job_request make_request(const check_run *run, qm_job_kind kind)
{
    qm_job_request request = qm_job_request_default();
    request.kind = kind;
    request.threads = run->settings->threads;
    request.quads = run->check->rule.quads;
    request.tolerance = run->settings->gap;
    return request;
}

/* ---- the questions ---- */

/** Whether all of the surfaces is within the limit. */
static void ask_limit(check_run *run)
{
    const qm_check_rule *rule = &run->check->rule;
    qm_job_request request = make_request(run, QM_JOB_HAUSDORFF);
    request.direction = rule->direction;
    request.threshold = rule->limit;
    qm_job_result result;
    if (!run_job(run, &request, true, &result)) return;
    const qm_hausdorff_result *found = &result.hausdorff;
    run->verdict.distance = (qm_interval){found->lower, found->upper};
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    cli_format_bound(found->lower, false, low);
    cli_format_bound(found->upper, true, high);
    cli_outcome outcome = found->verdict == QM_VERDICT_BELOW   ? CLI_WITHIN
                          : found->verdict == QM_VERDICT_ABOVE ? CLI_BEYOND
                                                               : CLI_UNDECIDED;
    if (outcome == CLI_BEYOND && found->has_witness)
        conclude(&run->verdict, outcome, "distance %s or more, limit %.9g, at face %u of the %s mesh", low,
                 rule->limit, result.from_face, found->from_side == QM_HAUSDORFF_FROM_A ? "new" : "golden");
    else if (outcome == CLI_WITHIN)
        conclude(&run->verdict, outcome, "distance at most %s, limit %.9g", high, rule->limit);
    else
        conclude(&run->verdict, outcome, "distance %s to %s, limit %.9g%s", low, high, rule->limit,
                 result.is_canceled ? "; interrupted" : "");
    qm_job_result_reset(&run->ctx, &result);
}

/** The outcome of shares against a percentage. */
static cli_outcome judge_shares(const qm_check_rule *rule, const qm_interval share[2])
{
    const double needed = rule->percent / 100.0;
    bool is_within = true;
    for (int side = 0; side < 2; side++) {
        if (rule->direction == (side == 0 ? QM_B_TO_A : QM_A_TO_B)) continue;
        if (share[side].upper < needed) return CLI_BEYOND;
        is_within &= share[side].lower >= needed;
    }
    return is_within ? CLI_WITHIN : CLI_UNDECIDED;
}

/** Whether a percentage of each surface is within the limit. */
static void ask_percent(check_run *run)
{
    static const double accuracies[] = {0.3, 0.1, 0.03, 0.01, 0.003, 0.001};
    const qm_check_rule *rule = &run->check->rule;
    cli_outcome outcome = CLI_UNDECIDED;
    bool is_canceled = false;
    for (size_t i = 0; i < sizeof accuracies / sizeof *accuracies && outcome == CLI_UNDECIDED && !is_canceled;
         i++) {
        qm_job_request request = make_request(run, QM_JOB_COMPARISON);
        request.accuracy = accuracies[i];
        request.tolerance = fmax(request.tolerance, MAX_GAP);
        request.percentile_count = 0;
        request.limits[0] = rule->limit;
        request.limit_count = 1;
        qm_job_result result;
        if (!run_job(run, &request, true, &result)) return;
        for (int side = 0; side < 2; side++)
            run->verdict.share[side] = result.comparison.side[side].share[0];
        run->verdict.distance = result.comparison.hausdorff;
        if (rule->direction != QM_TWO_SIDED)
            run->verdict.distance = result.comparison.side[rule->direction == QM_B_TO_A].max;
        outcome = judge_shares(rule, run->verdict.share);
        is_canceled = result.is_canceled;
        qm_job_result_reset(&run->ctx, &result);
    }
    char end[2][2][CLI_BOUND_SIZE];
    for (int side = 0; side < 2; side++) {
        cli_format_percent(run->verdict.share[side].lower, false, end[side][0]);
        cli_format_percent(run->verdict.share[side].upper, true, end[side][1]);
    }
    conclude(&run->verdict, outcome,
             "within %.9g: %s to %s %% of the new mesh, %s to %s %% of the golden one; %.9g %% needed%s",
             rule->limit, end[0][0], end[0][1], end[1][0], end[1][1], rule->percent,
             is_canceled ? "; interrupted" : "");
}

/** Whether the pair meets, or the new mesh itself. */
static void ask_meeting(check_run *run, bool is_self, qm_check_meeting wanted, int *answer)
{
    qm_job_request request = make_request(run, is_self ? QM_JOB_SELF_COLLISION : QM_JOB_COLLISION);
    request.mode = QM_COLLIDE_FIRST;
    request.list_limit = 1;
    qm_job_result result;
    if (!run_job(run, &request, !is_self, &result)) return;
    const qm_collision *found = &result.pairs.found;
    bool collides = found->pair_count > 0;
    *answer = collides;
    cli_outcome outcome = collides == (wanted == QM_CHECK_MUST_MEET) ? CLI_WITHIN
                          : result.is_canceled && !collides          ? CLI_UNDECIDED
                                                                     : CLI_BEYOND;
    const char *subject = is_self ? "the new mesh" : "the meshes";
    if (collides)
        conclude(&run->verdict, outcome, "%s %s in faces %u and %u", subject,
                 is_self ? "meets itself" : "meet", found->pairs[0].a, found->pairs[0].b);
    else
        conclude(&run->verdict, outcome, "%s not meet%s", is_self ? "the new mesh does" : "the meshes do",
                 is_self ? " itself" : "");
    qm_job_result_reset(&run->ctx, &result);
}

static void ask_all(check_run *run)
{
    const qm_check_rule *rule = &run->check->rule;
    cli_verdict *verdict = &run->verdict;
    if (!isnan(rule->limit)) {
        if (rule->percent < 100.0)
            ask_percent(run);
        else
            ask_limit(run);
    }
    if (rule->collides != QM_CHECK_MAY_MEET && verdict->outcome < CLI_BEYOND)
        ask_meeting(run, false, rule->collides, &verdict->collides);
    if (rule->self_collides != QM_CHECK_MAY_MEET && verdict->outcome < CLI_BEYOND)
        ask_meeting(run, true, rule->self_collides, &verdict->self_collides);
}

/* ---- one check ---- */

/** Moves the new mesh onto the golden one; false after a problem. */
static bool align(check_run *run)
{
    qm_job_request request = make_request(run, QM_JOB_ALIGNMENT);
    request.tolerance = ALIGN_GAP;
    qm_job_result result;
    if (!run_job(run, &request, true, &result)) return false;
    qm_loaded_mesh *mesh = &run->mesh[0];
    qm_context *ctx = &run->ctx;
    size_t updated;
    double *positions = qm_context_alloc(ctx, mesh->mesh.vertex_count, 3 * sizeof *positions);
    qm_status status = positions
                           ? qm_transform_positions(ctx, result.alignment.transform, &mesh->mesh, positions)
                           : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the moved mesh");
    if (status == QM_OK)
        status = qm_loaded_mesh_deform(ctx, mesh, positions, NULL, 0, run->settings->threads, &updated);
    else
        qm_context_free(ctx, positions, mesh->mesh.vertex_count, 3 * sizeof *positions);
    const double floor = result.alignment.floor, limit = run->check->rule.limit;
    qm_job_result_reset(ctx, &result);
    if (status == QM_OK && run->check->rule.percent >= 100.0 && run->check->rule.direction == QM_TWO_SIDED &&
        floor > limit) {
        char low[CLI_BOUND_SIZE];
        conclude(&run->verdict, CLI_BEYOND, "no rigid motion brings the meshes nearer than %s",
                 cli_format_bound(floor, false, low));
    }
    if (status == QM_OK) return true;
    qm_problem problem = qm_problem_from_status(status, ctx->message);
    conclude_problem(&run->verdict, run->check->path[0], &problem);
    return false;
}

static void load_and_ask(check_run *run)
{
    const qm_check *check = run->check;
    qm_preparation preparation = cli_prepare(true, check->rule.quads, run->settings->threads);
    qm_problem problem;
    int failed = cli_try_pair(&run->ctx, (const char *const *)check->path,
                              (const qm_preparation[2]){preparation, preparation}, run->mesh, &problem);
    if (failed >= 0) {
        conclude_problem(&run->verdict, check->path[failed], &problem);
        return;
    }
    qm_notes notes[2] = {0};
    qm_problem units;
    for (int side = 0; side < 2; side++)
        memcpy(notes[side].unit, run->mesh[side].unit, sizeof notes[side].unit);
    if (!qm_job_check_units(notes, &units))
        conclude_problem(&run->verdict, run->check->path[1], &units);
    else if (!run->settings->aligns || align(run))
        ask_all(run);
    cli_unload_pair(&run->ctx, run->mesh);
}

cli_verdict cli_run_check(const qm_check *check, const cli_check_settings *settings)
{
    check_run run = {.check = check,
                     .settings = settings,
                     .ctx = qm_host_context(),
                     .verdict = {.outcome = CLI_WITHIN,
                                 .distance = {0.0, NAN},
                                 .share = {{0.0, NAN}, {0.0, NAN}},
                                 .collides = -1,
                                 .self_collides = -1}};
    run.ctx.cancel = &cli_interrupted;
    double start_ms = qm_clock_now_ms();
    if (!check->path[1])
        conclude(&run.verdict, CLI_TROUBLE, "%s has no golden mesh of this name", check->path[0]);
    else if (!check->path[0])
        conclude(&run.verdict, CLI_TROUBLE, "%s has no new mesh of this name", check->path[1]);
    else if (atomic_load(&cli_interrupted))
        conclude(&run.verdict, CLI_UNDECIDED, "interrupted");
    else
        load_and_ask(&run);
    run.verdict.elapsed_ms = qm_clock_now_ms() - start_ms;
    return run.verdict;
}
