/**
 * check_run.c: the answer to one check: at most four questions, each of which ends as soon as its answer is certain.
 *
 * A limit for all of both surfaces is a Hausdorff search with a threshold. One for a percentage of them compares the
 * surfaces at rising accuracy, until the shares within the limit are on one side of it: the last round costs most, and
 * the ones before it together about as much. Limits of one side take signed deviations in the same way.
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
    size_t place;
    bool is_moved;
    double transform[16]; /* of the new mesh, where it is moved */
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
    /* It is the golden mesh that must be closed. */
    conclude_problem(&run->verdict, run->check->path[status == QM_E_NOT_CLOSED], &problem);
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

/** The outcome of the greatest distances inside and outside against their limits. */
static cli_outcome judge_sides(const qm_check_rule *rule, const cli_verdict *verdict)
{
    const double limit[2] = {rule->limit_in, rule->limit_out};
    const qm_interval found[2] = {verdict->inside, verdict->outside};
    bool is_within = true;
    for (int i = 0; i < 2; i++) {
        if (isnan(limit[i])) continue;
        if (found[i].lower > limit[i]) return CLI_BEYOND;
        is_within &= found[i].upper <= limit[i];
    }
    return is_within ? CLI_WITHIN : CLI_UNDECIDED;
}

/** Adds a sentence for one side whose limit is given. */
static void conclude_side(cli_verdict *verdict, cli_outcome outcome, const char *side, qm_interval found,
                          double limit, const qm_deviation_side *part)
{
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    if (isnan(limit)) return;
    cli_format_bound(found.lower, false, low);
    cli_format_bound(found.upper, true, high);
    if (found.lower > limit && part->has_witness)
        conclude(verdict, outcome, "%s by %s or more, limit %.9g, at face %u of the new mesh", side, low,
                 limit, part->from.face);
    else if (found.upper <= limit)
        conclude(verdict, outcome, "%s by at most %s, limit %.9g", side, high, limit);
    else
        conclude(verdict, outcome, "%s by %s to %s, limit %.9g", side, low, high, limit);
}

/** How far the new mesh is inside and outside of the golden one. */
static void ask_sides(check_run *run)
{
    static const struct {
        double accuracy, gap;
    } rounds[] = {{0.3, 1e-3}, {0.1, 1e-5}, {0.01, 0.0}, {0.001, 0.0}};
    const qm_check_rule *rule = &run->check->rule;
    cli_verdict *verdict = &run->verdict;
    cli_outcome outcome = CLI_UNDECIDED;
    bool is_canceled = false;
    qm_deviation_side part[2];
    for (size_t i = 0; i < sizeof rounds / sizeof *rounds && outcome == CLI_UNDECIDED && !is_canceled; i++) {
        qm_job_request request = make_request(run, QM_JOB_DEVIATION);
        request.accuracy = rounds[i].accuracy;
        request.tolerance = fmax(request.tolerance, rounds[i].gap);
        request.percentile_count = request.bins = 0;
        request.sign = QM_SIGN_OUTSIDE;
        request.threshold = fmax(rule->limit_in, rule->limit_out); /* of one, where the other is NAN */
        qm_job_result result;
        if (!run_job(run, &request, true, &result)) return;
        part[0] = result.deviation.sides.behind;
        part[1] = result.deviation.sides.front;
        verdict->inside = part[0].max;
        verdict->outside = part[1].max;
        outcome = judge_sides(rule, verdict);
        is_canceled = result.is_canceled;
        qm_job_result_reset(&run->ctx, &result);
    }
    conclude_side(verdict, outcome, "inside", verdict->inside, rule->limit_in, &part[0]);
    conclude_side(verdict, outcome, "outside", verdict->outside, rule->limit_out, &part[1]);
    if (is_canceled && outcome == CLI_UNDECIDED) conclude(verdict, outcome, "interrupted");
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
    if (qm_check_rule_is_signed(rule) && verdict->outcome < CLI_BEYOND) ask_sides(run);
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
    memcpy(run->transform, result.alignment.transform, sizeof run->transform);
    run->is_moved = true;
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

/** Writes the report of the pair, unless there is none to write or the check was interrupted. */
static void write_page(check_run *run)
{
    const cli_checked_pair pair = {.check = run->check,
                                   .mesh = run->mesh,
                                   .transform = run->is_moved ? run->transform : NULL,
                                   .place = run->place};
    qm_problem problem;
    if (!run->settings->pages || atomic_load(&cli_interrupted)) return;
    if (!cli_write_check_page(&run->ctx, run->settings, &pair, &problem))
        conclude(&run->verdict, CLI_TROUBLE, "%s", problem.detail);
}

static void load_and_ask(check_run *run)
{
    const qm_check *check = run->check;
    qm_preparation preparation = cli_prepare(true, check->rule.quads, run->settings->threads);
    preparation.keeps_pairs =
        qm_check_rule_is_signed(&check->rule); /* what is known of the golden mesh as a solid */
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
    else if (!run->settings->aligns || align(run)) {
        ask_all(run);
        write_page(run);
    }
    cli_unload_pair(&run->ctx, run->mesh);
}

cli_verdict cli_run_check(const qm_check *check, size_t place, const cli_check_settings *settings)
{
    check_run run = {.check = check,
                     .place = place,
                     .settings = settings,
                     .ctx = qm_host_context(),
                     .verdict = {.outcome = CLI_WITHIN,
                                 .distance = {0.0, NAN},
                                 .inside = {0.0, NAN},
                                 .outside = {0.0, NAN},
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
