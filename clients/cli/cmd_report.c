/**
 * cmd_report.c: two meshes compared, as one file of HTML to hand on.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/host.h"
#include "base/json.h"
#include "options.h"

#define PLACES 5 /* worst places, unless told otherwise */

typedef struct report_options {
    qm_report_limits limits;
    double range; /* NAN: not given */
    const char *output;
    const char *command; /* the command line */
} report_options;

/* ---- the command line as text ---- */

/** Adds a word as a shell reads it back: in single quotes, unless it needs none. */
static void add_word(qm_text *out, const char *word)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=./,:@%";
    if (*word && strspn(word, plain) == strlen(word)) {
        qm_text_add_string(out, word);
        return;
    }
    qm_text_add_string(out, "'");
    for (; *word; word++) {
        if (*word == '\'')
            qm_text_add_string(out, "'\\''");
        else
            qm_text_add(out, word, 1);
    }
    qm_text_add_string(out, "'");
}

/** The command line, for free(); NULL when memory ran out. */
static char *join_command(int argc, char **argv)
{
    qm_text text = {0};
    qm_text_add_string(&text, "quadmesh");
    for (int i = 0; i < argc; i++) {
        qm_text_add_string(&text, " ");
        add_word(&text, argv[i]);
    }
    return qm_text_take(&text);
}

/* ---- the question ---- */

void cli_ask_for_report(qm_job_request *request)
{
    /* Percentiles close enough for a curve. */
    static const double ends[] = {1.0, 2.0, 98.0, 99.0};
    size_t count = 0;
    for (int i = 0; i < 2; i++)
        request->percentiles[count++] = ends[i];
    for (int percent = 5; percent <= 95; percent += 5)
        request->percentiles[count++] = percent;
    for (int i = 2; i < 4; i++)
        request->percentiles[count++] = ends[i];
    request->percentile_count = count;
    request->worst_count = PLACES;
}

/* ---- writing ---- */

const char *cli_hash_file(const char *path, char out[QM_HASH_SIZE])
{
    size_t size;
    uint8_t *bytes = cli_read_file(path, &size, false);
    if (!bytes) return NULL;
    uint8_t digest[QM_DIGEST_SIZE];
    qm_id_hash_bytes(bytes, size, digest);
    qm_id_hash_print(digest, out);
    free(bytes);
    return out;
}

/** Writes the report of a comparison that ran in this process; false after a report of what is wrong. */
static bool make_here(const report_options *options, const cli_job *job, const cli_job_output *output,
                      qm_text *out)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    char hash[2][QM_HASH_SIZE], now[QM_TIME_SIZE];
    qm_text request = {0};
    qm_json_write_request_briefly(&request, &job->request);
    qm_clock_format(now);
    qm_report report = {.result = output->json,
                        .request = request.data ? request.data : "",
                        .command = options->command,
                        .made = now,
                        .limits = options->limits,
                        .region_limit = job->request.threshold,
                        .range = options->range,
                        .thread_count = job->request.threads};
    const qm_job_pose *pose = job->request.pose;
    for (int side = 0; side < 2; side++)
        report.mesh[side] = (qm_report_mesh){.name = cli_base_name(job->path[side]),
                                             .hash = cli_hash_file(job->path[side], hash[side]),
                                             .notes = output->result->notes[side],
                                             .transform = pose[side].is_given ? pose[side].transform : NULL,
                                             .loaded = output->mesh[side]};
    qm_problem problem;
    bool is_made = !request.failed && qm_report_write(&ctx, &report, out, &problem);
    if (request.failed) problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the report");
    if (!is_made) cli_report(options->output, &problem, job->as_json);
    qm_text_reset(&request);
    return is_made;
}

static void print_limits(const char *word, const qm_report_limits *limits, const char *output)
{
    printf("%s", word);
    if (!isnan(limits->distance)) printf(", limit %.9g", limits->distance);
    if (!isnan(limits->inside)) printf(", limit %.9g inside", limits->inside);
    if (!isnan(limits->outside)) printf(", limit %.9g outside", limits->outside);
    printf(": %s\n", output);
}

static void print_verdict(const report_options *options, qm_report_verdict verdict)
{
    static const char *const words[] = {"no limit, no verdict", "within", "beyond", "undecided"};
    if (verdict == QM_REPORT_NO_LIMIT)
        printf("%s: %s\n", words[verdict], options->output);
    else
        print_limits(words[verdict], &options->limits, options->output);
}

static int finish(const void *user, const cli_job *job, const cli_job_output *output)
{
    const report_options *options = user;
    qm_text text = {0};
    bool is_made = output->session
                       ? cli_session_fetch_report(output->session, &options->limits, options->range, &text)
                       : make_here(options, job, output, &text);
    bool is_written = is_made && cli_write_file(options->output, text.data, text.size);
    if (is_made && !is_written) cli_report_unwritable(options->output, job->as_json);
    qm_text_reset(&text);
    if (!is_written) return EXIT_BAD_INPUT;
    qm_json *result = qm_json_parse(output->json);
    qm_report_verdict verdict = qm_report_judge(result, &options->limits);
    bool is_accurate = qm_json_is_true(result, "accurate");
    qm_json_free(result);
    if (job->as_json)
        puts(output->json);
    else if (strcmp(options->output, "-") != 0)
        print_verdict(options, verdict);
    return verdict == QM_REPORT_BEYOND                     ? EXIT_NO
           : verdict == QM_REPORT_UNDECIDED                ? EXIT_NOT_CONVERGED
           : verdict == QM_REPORT_NO_LIMIT && !is_accurate ? EXIT_NOT_CONVERGED
                                                           : EXIT_OK;
}

/* ---- the command ---- */

static int run(int argc, char **argv)
{
    cli_job job = cli_job_make(QM_JOB_COMPARISON);
    qm_job_request *request = &job.request;
    cli_ask_for_report(request);
    report_options o = {.limits = {NAN, NAN, NAN}, .range = NAN};
    /* The parser changes the order of the words. */
    char *command = join_command(argc, argv);
    o.command = command;
    const cli_option options[] = {
        {.name = "output",
         .letter = 'o',
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &o.output,
         .is_required = true,
         .help = "the report, \"-\" for standard output"},
        {.name = "limit",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &o.limits.distance,
         .help = "the permitted distance, in the unit of the meshes; without a limit there is no verdict"},
        {.name = "limit-in",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &o.limits.inside,
         .help = "how far A may be inside of B, which is proven closed"},
        {.name = "limit-out",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &o.limits.outside,
         .help = "and how far outside"},
        {.name = "range",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &o.range,
         .help = "the end of the colour scale (default: twice the limit, or the greatest distance)"},
        {.name = "regions",
         .type = CLI_FLAG,
         .target = &request->regions,
         .help = "the connected parts beyond the limit as well, with pictures"},
        CLI_OPTIONS_SIGN(request),
        {.name = "worst",
         .value = "K",
         .type = CLI_SIZE,
         .min = 1,
         .max = QM_JOB_MAX_PLACES,
         .target = &request->worst_count,
         .help = "the K worst places in each direction (default 5)"},
        {.name = "radius",
         .value = "R",
         .type = CLI_NUMBER,
         .target = &request->worst_radius,
         .help = "how far apart they are, in the unit of the meshes (default a twentieth of\n"
                 "the diagonal of A's box)"},
        CLI_OPTION_QUADS(&request->quads),
        CLI_OPTIONS_NOTES(request->notes),
        CLI_OPTION_TRANSFORM(&job.transform, "A"),
        CLI_OPTION_ALIGN(&job.aligns),
        CLI_OPTION_AVERAGES(request),
        CLI_OPTION_GAP(&request->tolerance,
                       "width of the intervals of the maxima, as a fraction of the diagonal "
                       "of A's box\n(default 1e-6)"),
        CLI_OPTION_ABSOLUTE(&request->tolerance_is_absolute),
        CLI_OPTION_THREADS(&request->threads),
        CLI_OPTION_JSON(&job.as_json),
        CLI_OPTION_PROGRESS(&job.shows_progress),
        CLI_OPTION_SERVER(&job.server)};
    int status;
    if (cli_read_options(&cmd_report, options, sizeof options / sizeof *options, argc, argv, job.path,
                         &status)) {
        if (request->regions && isnan(o.limits.distance)) {
            fputs("quadmesh: --regions takes --limit\n", stderr);
            free(command);
            return EXIT_USAGE;
        }
        if (!cli_check_one_document(&o.output, 1, job.as_json)) {
            free(command);
            return EXIT_USAGE;
        }
        cli_settle_sign(request);
        if (!cli_add_limit_bands(o.limits.inside, o.limits.outside, request)) {
            free(command);
            return EXIT_USAGE;
        }
        if (!job.server) request->threads = cli_count_threads(request->threads);
        if (request->regions) request->threshold = o.limits.distance;
        request->limit_count = (size_t)qm_report_scale_limits(o.limits.distance, o.range, request->limits);
        status = cli_check_writable(o.output, job.as_json) ? cli_run_job(&job, finish, &o) : EXIT_BAD_INPUT;
    }
    free(command);
    return status;
}

const cli_command cmd_report = {
    .name = "report",
    .arguments = "A B -o FILE [options]",
    .summary = "two meshes compared, as one page to hand on",
    .takes = "two files",
    .path_count = 2,
    .description = "One file of HTML that needs nothing beside itself: the verdict, pictures from six sides "
                   "in the\ncolours of distance, how distances spread, the worst places, and all figures as "
                   "proven intervals.\n",
    .exit_status =
        "Exit status: 0 within the limits, or none was given; 1 beyond one; 2 bad input or wrong usage;\n"
        "3 undecided, stopped before, or interrupted.",
    .run = run};
