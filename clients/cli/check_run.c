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
    cli_checked_pair pair;
    cli_verdict verdict;
} check_run;

static const qm_check_rule *rule_of(const check_run *run)
{
    return &run->pair.check->rule;
}

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

/** Concludes what has gone wrong with the pair. After an interrupt that is no trouble. */
static void conclude_problem(check_run *run)
{
    if (atomic_load(&cli_interrupted))
        conclude(&run->verdict, CLI_UNDECIDED, "interrupted");
    else
        conclude(&run->verdict, CLI_TROUBLE, "%s",
                 run->pair.problem[0] ? run->pair.problem : "out of memory for the answer");
}

#define ALIGN_GAP 1e-3 /* of the distance that an alignment measures, of which only the motion is used */

/** The result of a job about the meshes, about the new one alone where is_pair is false; NULL after its problem. */
static qm_json *ask(check_run *run, qm_job_request *request, bool is_pair)
{
    char *text = cli_ask_checked(&run->pair, request, is_pair);
    qm_json *result = text ? qm_json_parse(text) : NULL;
    free(text);
    if (!result) conclude_problem(run);
    return result;
}

static qm_job_request make_request(const check_run *run, qm_job_kind kind)
{
    qm_job_request request = cli_checked_request(&run->pair, kind);
    request.tolerance = run->pair.settings->gap;
    return request;
}

static qm_interval find_interval(const qm_json *result, const char *path)
{
    char member[96];
    qm_interval found;
    snprintf(member, sizeof member, "%s.lower", path);
    found.lower = qm_json_get_number(result, member);
    snprintf(member, sizeof member, "%s.upper", path);
    found.upper = qm_json_get_number(result, member);
    return found;
}

static const char *interrupt_words(void)
{
    return atomic_load(&cli_interrupted) ? "; interrupted" : "";
}

/* ---- the true surfaces ---- */

/** A sum, rounded towards lesser or greater numbers: what the rounded sum lost is known exactly. */
static double add_outward(double a, double b, bool is_upper)
{
    double sum = a + b, part = sum - a, lost = (a - (sum - part)) + (b - part);
    if (is_upper) return lost > 0.0 ? nextafter(sum, INFINITY) : sum;
    return lost < 0.0 ? nextafter(sum, -INFINITY) : sum;
}

/** How far the distance of the true surfaces may be from that of the meshes. */
static double find_doubt(const check_run *run)
{
    return add_outward(run->pair.notes[0].uncertainty, run->pair.notes[1].uncertainty, true);
}

/* ---- the questions ---- */

/** What is known of the distance against a limit of the meshes: the search stops there. */
static qm_json *search(check_run *run, double limit, cli_outcome *outcome)
{
    qm_job_request request = make_request(run, QM_JOB_HAUSDORFF);
    request.direction = rule_of(run)->direction;
    request.threshold = limit;
    qm_json *result = ask(run, &request, true);
    if (!result) return NULL;
    const char *verdict = qm_json_get_string(result, "verdict");
    *outcome = !verdict ? CLI_UNDECIDED : strcmp(verdict, "below") == 0 ? CLI_WITHIN : CLI_BEYOND;
    run->verdict.distance.lower = fmax(run->verdict.distance.lower, qm_json_get_number(result, "lower"));
    run->verdict.distance.upper = fmin(run->verdict.distance.upper, qm_json_get_number(result, "upper"));
    return result;
}

/** The limit within which the meshes show that the true surfaces are within the rule's, and then the one beyond which they show
 * that these are beyond it. The search for the second goes on where the first has stopped to be of use. */
static qm_json *search_doubtful(check_run *run, double doubt, cli_outcome *outcome)
{
    const double limit = rule_of(run)->limit, inner = add_outward(limit, -doubt, false);
    qm_json *result = NULL;
    *outcome = CLI_BEYOND;
    if (inner >= 0.0 && !(result = search(run, inner, outcome))) return NULL;
    if (*outcome == CLI_BEYOND) {
        qm_json_free(result);
        result = search(run, add_outward(limit, doubt, true), outcome);
        if (result && *outcome == CLI_WITHIN) *outcome = CLI_UNDECIDED;
    }
    return result;
}

/** Whether all of the surfaces is within the limit. */
static void ask_limit(check_run *run)
{
    const double limit = rule_of(run)->limit, doubt = find_doubt(run);
    qm_interval *distance = &run->verdict.distance;
    cli_outcome outcome;
    *distance = (qm_interval){0.0, INFINITY};
    qm_json *result = doubt > 0.0 ? search_doubtful(run, doubt, &outcome) : search(run, limit, &outcome);
    if (!result) {
        distance->upper = NAN;
        return;
    }
    qm_interval told = *distance;
    if (doubt > 0.0) {
        told.lower = fmax(add_outward(distance->lower, -doubt, false), 0.0);
        told.upper = add_outward(distance->upper, doubt, true);
        run->verdict.of_true = told;
    }
    const char *between = doubt > 0.0 ? " between the true surfaces" : "";
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    cli_format_bound(told.lower, false, low);
    cli_format_bound(told.upper, true, high);
    if (outcome == CLI_BEYOND && qm_json_has(result, "witness")) {
        const char *from = qm_json_get_string(result, "witness.from.mesh");
        bool is_golden = from && strcmp(from, "b") == 0;
        conclude(&run->verdict, outcome, "distance%s %s or more, limit %.9g, at face %.0f of the %s mesh",
                 between, low, limit, qm_json_get_number(result, "witness.from.face"),
                 is_golden ? "golden" : "new");
    } else if (outcome == CLI_WITHIN) {
        conclude(&run->verdict, outcome, "distance%s at most %s, limit %.9g", between, high, limit);
    } else {
        conclude(&run->verdict, outcome, "distance%s %s to %s, limit %.9g%s", between, low, high, limit,
                 interrupt_words());
    }
    qm_json_free(result);
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
    static const char *const shares[2] = {"a_to_b.shares.0", "b_to_a.shares.0"};
    const qm_check_rule *rule = rule_of(run);
    cli_outcome outcome = CLI_UNDECIDED;
    for (size_t i = 0; i < sizeof accuracies / sizeof *accuracies && outcome == CLI_UNDECIDED; i++) {
        if (i > 0 && atomic_load(&cli_interrupted)) break;
        qm_job_request request = make_request(run, QM_JOB_COMPARISON);
        request.accuracy = accuracies[i];
        request.tolerance = fmax(request.tolerance, MAX_GAP);
        request.percentile_count = 0;
        request.limits[0] = rule->limit;
        request.limit_count = 1;
        qm_json *result = ask(run, &request, true);
        if (!result) return;
        for (int side = 0; side < 2; side++)
            run->verdict.share[side] = find_interval(result, shares[side]);
        static const char *const greatest[] = {[QM_TWO_SIDED] = "symmetric.hausdorff",
                                               [QM_A_TO_B] = "a_to_b.hausdorff",
                                               [QM_B_TO_A] = "b_to_a.hausdorff"};
        run->verdict.distance = find_interval(result, greatest[rule->direction]);
        outcome = judge_shares(rule, run->verdict.share);
        qm_json_free(result);
    }
    char end[2][2][CLI_BOUND_SIZE];
    for (int side = 0; side < 2; side++) {
        cli_format_percent(run->verdict.share[side].lower, false, end[side][0]);
        cli_format_percent(run->verdict.share[side].upper, true, end[side][1]);
    }
    conclude(&run->verdict, outcome,
             "within %.9g: %s to %s %% of the new mesh, %s to %s %% of the golden one; %.9g %% needed%s",
             rule->limit, end[0][0], end[0][1], end[1][0], end[1][1], rule->percent,
             outcome == CLI_UNDECIDED ? interrupt_words() : "");
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

/** Adds a sentence for one side whose limit is given; face: of the new mesh where it is farthest, or NAN. */
static void conclude_side(cli_verdict *verdict, cli_outcome outcome, const char *side, qm_interval found,
                          double limit, double face)
{
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    if (isnan(limit)) return;
    cli_format_bound(found.lower, false, low);
    cli_format_bound(found.upper, true, high);
    if (found.lower > limit && !isnan(face))
        conclude(verdict, outcome, "%s by %s or more, limit %.9g, at face %.0f of the new mesh", side, low,
                 limit, face);
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
    const qm_check_rule *rule = rule_of(run);
    cli_verdict *verdict = &run->verdict;
    cli_outcome outcome = CLI_UNDECIDED;
    double face[2] = {NAN, NAN};
    for (size_t i = 0; i < sizeof rounds / sizeof *rounds && outcome == CLI_UNDECIDED; i++) {
        if (i > 0 && atomic_load(&cli_interrupted)) break;
        qm_job_request request = make_request(run, QM_JOB_DEVIATION);
        request.accuracy = rounds[i].accuracy;
        request.tolerance = fmax(request.tolerance, rounds[i].gap);
        request.percentile_count = request.bins = 0;
        request.sign = QM_SIGN_OUTSIDE;
        request.threshold = fmax(rule->limit_in, rule->limit_out); /* of one, where the other is NAN */
        qm_json *result = ask(run, &request, true);
        if (!result) return;
        verdict->inside = find_interval(result, "signed.inside.max");
        verdict->outside = find_interval(result, "signed.outside.max");
        face[0] = qm_json_get_number(result, "signed.inside.witness.from.face");
        face[1] = qm_json_get_number(result, "signed.outside.witness.from.face");
        outcome = judge_sides(rule, verdict);
        qm_json_free(result);
    }
    conclude_side(verdict, outcome, "inside", verdict->inside, rule->limit_in, face[0]);
    conclude_side(verdict, outcome, "outside", verdict->outside, rule->limit_out, face[1]);
    if (outcome == CLI_UNDECIDED && atomic_load(&cli_interrupted)) conclude(verdict, outcome, "interrupted");
}

/** Whether the pair meets, or the new mesh itself. */
static void ask_meeting(check_run *run, bool is_self, qm_check_meeting wanted, int *answer)
{
    qm_job_request request = make_request(run, is_self ? QM_JOB_SELF_COLLISION : QM_JOB_COLLISION);
    request.mode = QM_COLLIDE_FIRST;
    request.list_limit = 1;
    qm_json *result = ask(run, &request, !is_self);
    if (!result) return;
    bool collides = qm_json_is_true(result, "collides");
    *answer = collides;
    cli_outcome outcome = collides == (wanted == QM_CHECK_MUST_MEET)   ? CLI_WITHIN
                          : atomic_load(&cli_interrupted) && !collides ? CLI_UNDECIDED
                                                                       : CLI_BEYOND;
    const char *subject = is_self ? "the new mesh" : "the meshes";
    if (collides)
        conclude(&run->verdict, outcome, "%s %s in faces %.0f and %.0f", subject,
                 is_self ? "meets itself" : "meet", qm_json_get_number(result, "pairs.0.faces.0"),
                 qm_json_get_number(result, "pairs.0.faces.1"));
    else
        conclude(&run->verdict, outcome, "%s not meet%s", is_self ? "the new mesh does" : "the meshes do",
                 is_self ? " itself" : "");
    qm_json_free(result);
}

static void ask_all(check_run *run)
{
    const qm_check_rule *rule = rule_of(run);
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
    const qm_check_rule *rule = rule_of(run);
    qm_job_request request = make_request(run, QM_JOB_ALIGNMENT);
    request.tolerance = ALIGN_GAP;
    qm_json *result = ask(run, &request, true);
    if (!result) return false;
    double transform[QM_TRANSFORM_SIZE];
    cli_get_transform(result, transform);
    const double floor = qm_json_get_number(result, "floor"), doubt = find_doubt(run);
    qm_json_free(result);
    if (rule->percent >= 100.0 && rule->direction == QM_TWO_SIDED &&
        floor > add_outward(rule->limit, doubt, true)) {
        char low[CLI_BOUND_SIZE];
        conclude(&run->verdict, CLI_BEYOND, "no rigid motion brings the meshes nearer than %s",
                 cli_format_bound(floor, false, low));
    }
    if (cli_move_checked(&run->pair, transform)) return true;
    conclude_problem(run);
    return false;
}

/** What a rule asks that cannot be answered; NULL: nothing. */
static const char *find_contradiction(const check_run *run)
{
    const qm_check_rule *rule = rule_of(run);
    bool is_doubtful = rule->notes[0].uncertainty > 0.0 || rule->notes[1].uncertainty > 0.0;
    if (run->pair.settings->aligns && rule->pose.is_given)
        return "a transform and an alignment both move the new mesh: give one of them";
    if (is_doubtful && (rule->percent < 100.0 || qm_check_rule_is_signed(rule)))
        return "an uncertainty goes with a limit for all of both surfaces, as shares and sides of true "
               "surfaces "
               "are not known";
    return NULL;
}

static void open_and_ask(check_run *run)
{
    const char *contradiction = find_contradiction(run);
    if (contradiction) {
        conclude(&run->verdict, CLI_TROUBLE, "%s", contradiction);
        return;
    }
    if (!cli_open_checked(&run->pair)) {
        conclude_problem(run);
    } else if (!run->pair.settings->aligns || align(run)) {
        ask_all(run);
        bool has_page = run->pair.settings->pages && !atomic_load(&cli_interrupted);
        if (has_page && !cli_write_check_page(&run->pair)) conclude_problem(run);
    }
    cli_close_checked(&run->pair);
}

cli_verdict cli_run_check(const qm_check *check, size_t place, const cli_check_settings *settings)
{
    check_run run = {.pair = {.check = check, .place = place, .settings = settings},
                     .verdict = {.outcome = CLI_WITHIN,
                                 .distance = {0.0, NAN},
                                 .of_true = {0.0, NAN},
                                 .inside = {0.0, NAN},
                                 .outside = {0.0, NAN},
                                 .share = {{0.0, NAN}, {0.0, NAN}},
                                 .collides = -1,
                                 .self_collides = -1}};
    double start_ms = qm_clock_now_ms();
    if (!check->path[1])
        conclude(&run.verdict, CLI_TROUBLE, "%s has no golden mesh of this name", check->path[0]);
    else if (!check->path[0])
        conclude(&run.verdict, CLI_TROUBLE, "%s has no new mesh of this name", check->path[1]);
    else if (atomic_load(&cli_interrupted))
        conclude(&run.verdict, CLI_UNDECIDED, "interrupted");
    else
        open_and_ask(&run);
    run.verdict.elapsed_ms = qm_clock_now_ms() - start_ms;
    return run.verdict;
}
