/**
 * cmd_hausdorff.c: bounds of the Hausdorff distance between two meshes.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/json.h"
#include "options.h"

static int finish(const void *user, const cli_job *job, const cli_job_output *output)
{
    (void)user;
    qm_json *result = qm_json_parse(output->json);
    const char *verdict = qm_json_get_string(result, "verdict");
    if (job->as_json)
        puts(output->json);
    else {
        double lower = qm_json_get_number(result, "lower"), upper = qm_json_get_number(result, "upper");
        printf("Hausdorff distance, %s, quads as %s\n", qm_json_get_string(result, "direction"),
               qm_json_get_string(result, "quads"));
        printf("  lower    %.17g\n  upper    %.17g\n", lower, upper);
        char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
        double relative = qm_json_get_number(result, "upper_relative");
        if (isfinite(relative))
            printf("  relative %s to %s of the diagonal of A\n",
                   cli_format_bound(qm_json_get_number(result, "lower_relative"), false, low),
                   cli_format_bound(relative, true, high));
        cli_print_notes(result, "");
        if (qm_json_has(result, "witness"))
            printf("  farthest on face %.0f of %s, nearest to it face %.0f of %s\n",
                   qm_json_get_number(result, "witness.from.face"),
                   qm_json_get_string(result, "witness.from.mesh"),
                   qm_json_get_number(result, "witness.to.face"),
                   qm_json_get_string(result, "witness.to.mesh"));
        if (verdict)
            printf("  verdict  %s the limit\n", strcmp(verdict, "above") == 0 ? "beyond" : "within");
        else if (!isnan(job->request.threshold))
            puts("  verdict  undecided");
        printf("  search   %.1f ms after %.1f + %.1f ms to prepare, %.0f iterations, %.0f projections\n",
               qm_json_get_number(result, "elapsed_ms"), qm_json_get_number(result, "prepare_ms.a"),
               qm_json_get_number(result, "prepare_ms.b"), qm_json_get_number(result, "iterations"),
               qm_json_get_number(result, "projections"));
        if (!qm_json_is_true(result, "converged"))
            printf("  stopped  by %s; the bounds hold\n", qm_json_get_string(result, "stopped_by"));
    }
    bool is_beyond = verdict && strcmp(verdict, "above") == 0;
    bool is_answered = isnan(job->request.threshold) ? qm_json_is_true(result, "converged") : verdict != NULL;
    qm_json_free(result);
    return is_beyond ? EXIT_NO : is_answered ? EXIT_OK : EXIT_NOT_CONVERGED;
}

static int run(int argc, char **argv)
{
    cli_job job = cli_job_make(QM_JOB_HAUSDORFF);
    qm_job_request *request = &job.request;
    const cli_option options[] = {
        {.name = "direction",
         .value = "D",
         .type = CLI_CHOICE,
         .choices = qm_direction_names,
         .target = &request->direction,
         .help = "a_to_b, b_to_a or two_sided (default)"},
        CLI_OPTION_QUADS(&request->quads),
        CLI_OPTION_GAP(&request->tolerance, "width of the interval at which to stop, as a fraction of the "
                                            "diagonal of A's box (default 1e-6)"),
        CLI_OPTION_ABSOLUTE(&request->tolerance_is_absolute),
        {.name = "limit",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &request->threshold,
         .help = "the permitted distance, in the unit of the meshes: stop as soon as it is certain\n"
                 "whether the distance is within it"},
        {.name = "threshold",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &request->threshold,
         .help = "the former name of --limit"},
        {.name = "deadline-ms",
         .value = "N",
         .type = CLI_POSITIVE,
         .target = &request->deadline_ms,
         .help = "stop after this time with the interval reached"},
        {.name = "memory",
         .value = "N",
         .type = CLI_SIZE,
         .min = QM_JOB_MIN_MEMORY,
         .max = QM_JOB_MAX_MEMORY,
         .target = &request->memory_limit,
         .help = "max bytes of the search's queue (default 1 GiB); it stops there with the interval reached"},
        CLI_OPTIONS_NOTES(request->notes),
        CLI_OPTION_THREADS(&request->threads),
        CLI_OPTION_ACCELERATOR(&request->accelerator),
        {.name = "bounds",
         .value = "B",
         .type = CLI_CHOICE,
         .choices = qm_bounds_names,
         .target = &request->bounds,
         .help = "how upper bounds are computed: cover (default) or matching"},
        CLI_OPTION_TRANSFORM(&job.transform, "A"),
        CLI_OPTION_JSON(&job.as_json),
        CLI_OPTION_PROGRESS(&job.shows_progress),
        CLI_OPTION_SERVER(&job.server)};
    int status;
    if (!cli_read_options(&cmd_hausdorff, options, sizeof options / sizeof *options, argc, argv, job.path,
                          &status))
        return status;
    if (!job.server) request->threads = cli_count_threads(request->threads);
    return cli_run_job(&job, finish, NULL);
}

const cli_command cmd_hausdorff = {
    .name = "hausdorff",
    .arguments = "A B [options]",
    .summary = "the greatest distance, of both meshes or one of them",
    .takes = "two files",
    .path_count = 2,
    .description =
        "The greatest distance (Hausdorff): of all points of A from B, and of B from A, the farthest. "
        "For\nthe least distance (clearance): distance. For averages: deviation or compare.\n",
    .exit_status =
        "Exit status: 0 converged, or within the limit; 1 beyond the limit; 2 bad input or wrong usage;\n"
        "3 stopped before, or undecided.",
    .run = run};
