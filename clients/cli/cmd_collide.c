/**
 * cmd_collide.c: collide, self-collide and distance: where surfaces meet, or how far apart they are. The commands share
 * most options.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "options.h"

#define MAX_PRINTED 10 /* pairs that are printed as text */

/* ---- output ---- */

static void print_distance(const qm_json *result)
{
    double lower = qm_json_get_number(result, "lower"), upper = qm_json_get_number(result, "upper");
    printf("Least distance, quads as %s\n", qm_json_get_string(result, "quads"));
    printf("  lower    %.17g\n  upper    %.17g\n", lower, upper);
    cli_print_notes(result, "");
    printf("  between  face %.0f of a and face %.0f of b\n", qm_json_get_number(result, "witness.from.face"),
           qm_json_get_number(result, "witness.to.face"));
    if (qm_json_is_true(result, "collides")) puts("  the surfaces meet");
    const char *verdict = qm_json_get_string(result, "verdict");
    if (verdict) printf("  verdict  %s the limit\n", verdict);
    printf("  search   %.1f ms, %.0f pairs of faces\n", qm_json_get_number(result, "elapsed_ms"),
           qm_json_get_number(result, "face_pairs"));
    if (!qm_json_is_true(result, "converged") && !verdict)
        puts("  stopped  before the gap was reached; the bounds hold");
}

/** Writes the pairs; false after a report. */
static bool write_csv(const char *path, const cli_job *job, const qm_collision *found)
{
    FILE *file = cli_open_output(path, job->as_json);
    if (!file) return false;
    fprintf(file, "%s\n", qm_job_array_of(job->request.kind)->header);
    for (size_t i = 0; i < found->pair_count; i++)
        fprintf(file, "%u,%u\n", found->pairs[i].a, found->pairs[i].b);
    return cli_close_output(file, path, job->as_json);
}

/** Writes the pairs as the daemon has them; false after a report. */
static bool fetch_csv(const char *path, const cli_job *job, cli_session *session)
{
    char result_path[300];
    FILE *file = cli_open_output(path, job->as_json);
    if (!file) return false;
    snprintf(result_path, sizeof result_path, "%s/result", cli_session_job_path(session));
    bool is_fetched = cli_session_fetch(session, result_path, NULL, 0, "text/csv", job->server, file);
    bool is_written = cli_close_output(file, path, job->as_json);
    /* Leave no incomplete file. */
    if (!(is_fetched && is_written) && strcmp(path, "-") != 0) remove(path);
    return is_fetched && is_written;
}

/** With a limit, whether the distance is above it; else whether it was found. */
static int distance_status(const cli_job *job, const qm_json *result)
{
    const char *verdict = qm_json_get_string(result, "verdict");
    if (verdict) return strcmp(verdict, "above") == 0 ? EXIT_OK : EXIT_NO;
    bool is_done = isnan(job->request.threshold) && qm_json_is_true(result, "converged");
    return is_done ? EXIT_OK : EXIT_NOT_CONVERGED;
}

static void print_depth(const qm_json *result, const char *name, const char *words)
{
    char path[64], low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    snprintf(path, sizeof path, "penetration.%s.lower", name);
    if (!qm_json_has(result, path)) return;
    double lower = qm_json_get_number(result, path);
    snprintf(path, sizeof path, "penetration.%s.upper", name);
    printf("  %s %s to %s deep\n", words, cli_format_bound(lower, false, low),
           cli_format_bound(qm_json_get_number(result, path), true, high));
}

/** user is the path of the CSV file, or NULL. */
static int finish(const void *user, const cli_job *job, const cli_job_output *output)
{
    const char *csv = user;
    if (csv && output->session && !fetch_csv(csv, job, output->session)) return EXIT_BAD_INPUT;
    if (csv && output->result && !write_csv(csv, job, &output->result->pairs.found)) return EXIT_BAD_INPUT;
    qm_json *result = qm_json_parse(output->json);
    bool is_distance = job->request.kind == QM_JOB_DISTANCE;
    int status = is_distance ? distance_status(job, result)
                             : (qm_json_is_true(result, "collides") ? EXIT_NO : EXIT_OK);
    if (job->as_json)
        puts(output->json);
    else if (is_distance)
        print_distance(result);
    else {
        double count = qm_json_get_number(result, "count");
        printf("%.0f pair%s of faces meet%s, quads as %s\n", count, count == 1.0 ? "" : "s",
               count == 1.0 ? "s" : "", qm_json_get_string(result, "quads"));
        char path[64];
        for (size_t i = 0; i < MAX_PRINTED; i++) {
            snprintf(path, sizeof path, "pairs.%zu.faces.0", i);
            double a = qm_json_get_number(result, path);
            snprintf(path, sizeof path, "pairs.%zu.faces.1", i);
            if (isnan(a)) break;
            printf("  %.0f and %.0f: ", a, qm_json_get_number(result, path));
            snprintf(path, sizeof path, "pairs.%zu.contact", i);
            printf("%s at", qm_json_get_string(result, path));
            for (int side = 0; side < 2; side++) {
                snprintf(path, sizeof path, "pairs.%zu.points.%d", i, side);
                if (!qm_json_has(result, path)) break;
                if (side == 1) fputs(" to", stdout);
                for (int k = 0; k < 3; k++) {
                    snprintf(path, sizeof path, "pairs.%zu.points.%d.%d", i, side, k);
                    printf(" %.9g", qm_json_get_number(result, path));
                }
            }
            puts("");
        }
        const char *relation = qm_json_get_string(result, "relation");
        if (relation) printf("  solids   %s\n", relation);
        print_depth(result, "a_in_b", "A in B  ");
        print_depth(result, "b_in_a", "B in A  ");
        printf("  search   %.1f ms, %.0f exact tests\n", qm_json_get_number(result, "elapsed_ms"),
               qm_json_get_number(result, "tests"));
    }
    qm_json_free(result);
    return status;
}

/* ---- the commands ---- */

static int run(const cli_command *command, qm_job_kind kind, int argc, char **argv)
{
    cli_job job = cli_job_make(kind);
    qm_job_request *request = &job.request;
    const char *csv = NULL;
    /* The first two are for two meshes, the next four for pairs. */
    const cli_option options[] = {
        {.name = "solid",
         .type = CLI_FLAG,
         .target = &request->solid,
         .help =
             "tell whether the solids are apart, meet, or one is inside of the other; both must be closed"},
        {.name = "penetration",
         .type = CLI_FLAG,
         .target = &request->penetration,
         .help = "and how deep each is in the other"},
        {.name = "csv",
         .letter = 'o',
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &csv,
         .help = "all pairs as records face_a,face_b"},
        {.name = "mode",
         .value = "M",
         .type = CLI_CHOICE,
         .choices = qm_collide_mode_names,
         .target = &request->mode,
         .help = "all pairs (default), the first one, or any"},
        {.name = "list",
         .value = "N",
         .type = CLI_SIZE,
         .max = QM_JOB_MAX_LISTED,
         .target = &request->list_limit,
         .help =
             "pairs listed with their contact in the result object (default 1000; 10 are printed as text)"},
        {.name = "limit",
         .value = "N",
         .type = CLI_SIZE,
         .max = QM_JOB_MAX_LISTED,
         .target = &request->list_limit,
         .help = "the former name of --list"},
        CLI_OPTION_GAP(&request->tolerance,
                       kind == QM_JOB_DISTANCE
                           ? "width of the interval at which to stop, as a fraction of the "
                             "diagonal of A's box (default 1e-6)"
                           : "of bilinear quads, a fraction of the diagonal of the first box "
                             "(default 1e-6):\nnearer pairs may be reported too"),
        CLI_OPTION_ABSOLUTE(&request->tolerance_is_absolute),
        CLI_OPTION_QUADS(&request->quads),
        CLI_OPTION_THREADS(&request->threads),
        CLI_OPTION_JSON(&job.as_json),
        CLI_OPTION_SERVER(&job.server),
        CLI_OPTION_TRANSFORM(&job.transform, "the first mesh"),
        /* The notes are of two meshes, */
        CLI_OPTIONS_NOTES(request->notes),
        {.name = "limit", /* and of distances */
         .value = "X",
         .type = CLI_NUMBER,
         .target = &request->threshold,
         .help = "stop once it is certain whether the distance is above X, in the unit of the meshes"}};
    bool is_distance = kind == QM_JOB_DISTANCE;
    size_t skipped = is_distance ? 6 : kind == QM_JOB_COLLISION ? 0 : 2;
    size_t left_out = is_distance ? 0 : kind == QM_JOB_SELF_COLLISION ? 3 : 1;
    size_t count = sizeof options / sizeof *options - skipped - left_out;
    int status;
    if (!cli_read_options(command, options + skipped, count, argc, argv, job.path, &status)) return status;
    status = cli_settle_outputs(&csv, 1, job.as_json);
    if (status != EXIT_OK) return status;
    if (!job.server) request->threads = cli_count_threads(request->threads);
    return cli_run_job(&job, finish, csv);
}

static int run_collide(int argc, char **argv)
{
    return run(&cmd_collide, QM_JOB_COLLISION, argc, argv);
}

static int run_self_collide(int argc, char **argv)
{
    return run(&cmd_self_collide, QM_JOB_SELF_COLLISION, argc, argv);
}

static int run_distance(int argc, char **argv)
{
    return run(&cmd_distance, QM_JOB_DISTANCE, argc, argv);
}

#define EXIT_STATUS_OF_PAIRS "Exit status: 0 clear, 1 colliding, 2 bad input or wrong usage, 3 interrupted."

const cli_command cmd_collide = {.name = "collide",
                                 .arguments = "A B [options]",
                                 .summary = "do two meshes meet, and in which faces?",
                                 .takes = "two files",
                                 .path_count = 2,
                                 .description =
                                     "Which faces of A and B meet, touching included. For how far apart they "
                                     "are: distance. For whether a\nmesh meets itself: self-collide.\n",
                                 .exit_status = EXIT_STATUS_OF_PAIRS,
                                 .run = run_collide};

const cli_command cmd_self_collide = {
    .name = "self-collide",
    .arguments = "MESH [options]",
    .summary = "does a mesh meet itself, and in which faces?",
    .takes = "one file",
    .path_count = 1,
    .description = "Which faces of a mesh meet except in the corners and edges that they share.\n",
    .exit_status = EXIT_STATUS_OF_PAIRS,
    .run = run_self_collide};

const cli_command cmd_distance = {
    .name = "distance",
    .arguments = "A B [options]",
    .summary = "the least distance: clearance",
    .takes = "two files",
    .path_count = 2,
    .description = "The least distance between two surfaces: their clearance, 0 where they meet. For the "
                   "greatest:\nhausdorff. For which faces meet: collide.\n",
    .exit_status = "Exit status: 0 done, or above the limit, 1 not above it, 2 bad input "
                   "or wrong usage, 3 interrupted, or neither the gap was reached nor a verdict.",
    .run = run_distance};
