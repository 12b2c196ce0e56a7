/**
 * cmd_check.c: whether meshes are within a limit of others, for pipelines: a line for each pair and an exit status.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "check.h"
#include "options.h"

typedef struct check_options {
    const char *path[2];
    qm_check_rule rule;
    cli_check_settings settings;
    const char *junit, *server, *transform;
    bool as_json, as_github;
} check_options;

static int exit_status(cli_outcome outcome)
{
    static const int status[] = {[CLI_WITHIN] = EXIT_OK,
                                 [CLI_UNDECIDED] = EXIT_NOT_CONVERGED,
                                 [CLI_BEYOND] = EXIT_NO,
                                 [CLI_TROUBLE] = EXIT_BAD_INPUT};
    return status[outcome];
}

/** Prints text without control characters: a name with the end of a line in it would be able to add lines of its own, which a
 * terminal or a pipeline may take for commands. */
static void print_plain(const char *text)
{
    for (; *text; text++)
        putchar((unsigned char)*text < 0x20 || *text == 0x7f ? '?' : *text);
}

/** Makes the folder of reports where it is missing; false after a report. */
static bool make_folder(const char *path)
{
    if (!path || cli_is_page(path) || mkdir(path, 0777) == 0 || errno == EEXIST) return true;
    cli_report_unwritable(path, false);
    return false;
}

/** Runs all checks of a list and reports them. */
static int run_list(const check_options *options, const qm_check_list *list)
{
    cli_verdict *verdicts = calloc(list->count, sizeof *verdicts);
    if (!verdicts) {
        cli_print_problem(options->path[0], NAN, NAN, "out of memory for the checks");
        return EXIT_BAD_INPUT;
    }
    /* Standard output holds one of the reports. */
    bool has_junit = options->junit && strcmp(options->junit, "-") == 0,
         is_quiet = options->as_json || has_junit;
    for (size_t i = 0; i < list->count; i++) {
        verdicts[i] = cli_run_check(&list->checks[i], i, &options->settings);
        if (is_quiet) continue;
        printf("%-9s  ", cli_outcome_names[verdicts[i].outcome]);
        print_plain(list->checks[i].name);
        fputs(": ", stdout);
        print_plain(verdicts[i].detail);
        putchar('\n');
        fflush(stdout);
    }
    size_t count[4];
    int status = exit_status(cli_count_outcomes(list, verdicts, count));
    if (list->count > 1 && !is_quiet)
        printf("%zu pairs: %zu within, %zu beyond, %zu undecided, %zu trouble\n", list->count,
               count[CLI_WITHIN], count[CLI_BEYOND], count[CLI_UNDECIDED], count[CLI_TROUBLE]);
    if (options->as_json && !has_junit) cli_print_checks(list, verdicts);
    if (options->as_github) cli_print_github(is_quiet ? stderr : stdout, list, verdicts);
    if (options->junit && !cli_write_junit(options->junit, list, verdicts)) {
        cli_report_unwritable(options->junit, false);
        status = EXIT_BAD_INPUT;
    }
    free(verdicts);
    return status;
}

static bool read_percent(const char *text, void *target)
{
    size_t count = 0;
    return cli_read_list("percent", text, 0.0, 100.0, 1, target, &count);
}

static int run(int argc, char **argv)
{
    check_options o = {.rule = qm_check_rule_default(), .settings = {.gap = 1e-9}};
    const cli_option options[] = {
        {.name = "limit",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &o.rule.limit,
         .help = "the permitted distance, in the unit of the meshes"},
        {.name = "limit-in",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &o.rule.limit_in,
         .help = "how far NEW may be inside of GOLDEN, which must be closed: material that is missing"},
        {.name = "limit-out",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &o.rule.limit_out,
         .help = "how far NEW may be outside of GOLDEN, which must be closed: material that is added"},
        {.name = "percent",
         .value = "P",
         .type = CLI_CUSTOM,
         .read = read_percent,
         .target = &o.rule.percent,
         .help = "how much of each surface must be within the limit, in percent of its area (default 100)"},
        {.name = "direction",
         .value = "D",
         .type = CLI_CHOICE,
         .choices = qm_direction_names,
         .target = &o.rule.direction,
         .help = "which distances count: a_to_b, of NEW from GOLDEN; b_to_a, of GOLDEN from NEW;\n"
                 "or two_sided (default)"},
        {.name = "collides",
         .value = "C",
         .type = CLI_CHOICE,
         .choices = qm_check_meeting_names,
         .target = &o.rule.collides,
         .help = "whether NEW and GOLDEN may meet: no, yes or any (default)"},
        {.name = "self-collides",
         .value = "C",
         .type = CLI_CHOICE,
         .choices = qm_check_meeting_names,
         .target = &o.rule.self_collides,
         .help = "whether NEW may meet itself: no, yes or any (default)"},
        {.name = "align",
         .type = CLI_FLAG,
         .target = &o.settings.aligns,
         .help = "moves NEW onto GOLDEN before, as align does without options; beyond at once where no\n"
                 "rigid motion can bring it within the limit"},
        CLI_OPTION_QUADS(&o.rule.quads),
        {.name = "gap",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &o.settings.gap,
         .help = "how near to the limit a distance may be left undecided, as a fraction of the diagonal\n"
                 "of NEW's box (default 1e-9)"},
        {.name = "junit",
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &o.junit,
         .help = "a report in JUnit's XML; - is standard output, instead of all else there"},
        {.name = "report",
         .value = "PATH",
         .type = CLI_TEXT,
         .target = &o.settings.pages,
         .help = "a report of each pair, as report writes it, into this folder; or of the one pair into\n"
                 "a file .html"},
        {.name = "github",
         .type = CLI_FLAG,
         .target = &o.as_github,
         .help = "::error commands for GitHub's workflows"},
        {.name = "json",
         .letter = 'j',
         .type = CLI_FLAG,
         .target = &o.as_json,
         .help = "one JSON object on standard output"},
        CLI_OPTION_TRANSFORM(&o.transform, "NEW"),
        CLI_OPTION_UNIT(o.rule.notes),
        {.name = "uncertainty",
         .value = "X[,Y]",
         .type = CLI_CUSTOM,
         .read = cli_read_uncertainty,
         .target = o.rule.notes,
         .help = "the true surfaces are within X of both files, or within X of NEW and Y of GOLDEN:\n"
                 "it is these that --limit is for, and near it the answer is undecided"},
        CLI_OPTION_THREADS(&o.settings.threads),
        CLI_OPTION_SERVER(&o.server)};
    int status;
    if (!cli_read_options(&cmd_check, options, sizeof options / sizeof *options, argc, argv, o.path, &status))
        return status;
    if (o.path[1] && !qm_check_rule_asks(&o.rule)) {
        fputs("quadmesh: check takes --limit, --limit-in, --limit-out, --collides or --self-collides\n",
              stderr);
        return EXIT_USAGE;
    }
    if (o.settings.aligns && o.transform) {
        fputs("quadmesh: --align and --transform both move NEW: give one of them\n", stderr);
        return EXIT_USAGE;
    }
    if (o.transform && !cli_read_pose(o.transform, &o.rule.pose, false)) return EXIT_BAD_INPUT;
    if (o.junit && !cli_check_writable(o.junit, false)) return EXIT_BAD_INPUT;
    if (!make_folder(o.settings.pages)) return EXIT_BAD_INPUT;
    if (!o.server) o.settings.threads = cli_count_threads(o.settings.threads);
    if (o.server && !(o.settings.session = cli_session_open(o.server, false))) return EXIT_BAD_INPUT;
    qm_check_list list = {0};
    status = cli_find_checks(o.path, &o.rule, &list) ? EXIT_OK : EXIT_BAD_INPUT;
    if (status == EXIT_OK && list.count > 1 && o.settings.pages && cli_is_page(o.settings.pages)) {
        fputs("quadmesh: --report takes a folder, as there are several pairs\n", stderr);
        status = EXIT_USAGE;
    }
    if (status == EXIT_OK) status = run_list(&o, &list);
    qm_check_list_reset(&list);
    cli_session_close(o.settings.session);
    return status;
}

const cli_command cmd_check = {
    .name = "check",
    .arguments = "NEW GOLDEN --limit X [options]",
    .summary = "are meshes within a limit? an exit status for pipelines",
    .takes = "two files, two folders, or a manifest",
    .path_count = 2,
    .optional_paths = 1,
    .description = "Whether NEW is within a limit of GOLDEN: two files; two folders, whose files are paired "
                   "by name;\nor one manifest in JSON: {\"limit\": 0.05, \"checks\": [{\"new\": \"a.stl\", "
                   "\"golden\": \"b.stl\"}]}.\nEach pair ends as soon as its answer is certain. Of several "
                   "limits all must hold. For all figures\nof a pair: compare.\n",
    .exit_status =
        "Exit status: 0 all within; 1 some beyond; 2 bad input, wrong usage, a GOLDEN that is not\n"
        "closed where it must be, or files without a counterpart; 3 undecided, or interrupted.",
    .run = run};
