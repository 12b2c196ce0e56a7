#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "parallel.h"

#define MAX_THREADS 256

static const char usage[] =
    "usage: quadmesh hausdorff A B [options]\n"
    "\n"
    "  --direction D    a_to_b, b_to_a or two_sided (default)\n"
    "  --quads R        how quads are read: triangles (default) or bilinear\n"
    "  --tolerance X    width of the bracket at which to stop, a share of the diagonal of A's box (default "
    "1e-6)\n"
    "  --absolute       the tolerance is in the unit of the meshes\n"
    "  --threshold X    stop as soon as it is certain whether the distance is above X\n"
    "  --deadline-ms N  stop after this time with the bracket so far\n"
    "  --threads N      threads of the search (default 1)\n"
    "  --json           the result object of the API on standard output\n"
    "  --progress       lines of progress on standard error also when that is no terminal\n"
    "  --server URL     ask a daemon instead of this process\n"
    "\n"
    "Exit status: 0 converged or verdict certain, 1 bad input, 2 wrong usage, 3 stopped before.\n";

static bool read_number(const char *name, const char *text, double least, double *out)
{
    char *end;
    *out = strtod(text, &end);
    if (end != text && !*end && isfinite(*out) && *out >= least) return true;
    fprintf(stderr, "quadmesh: --%s takes a number%s, got \"%s\"\n", name,
            least > 0.0 ? " above 0" : " of 0 or more", text);
    return false;
}

static bool read_direction(const char *text, qm_direction *out)
{
    if (strcmp(text, "a_to_b") == 0) return *out = QM_A_TO_B, true;
    if (strcmp(text, "b_to_a") == 0) return *out = QM_B_TO_A, true;
    if (strcmp(text, "two_sided") == 0) return *out = QM_TWO_SIDED, true;
    fprintf(stderr, "quadmesh: --direction takes a_to_b, b_to_a or two_sided, got \"%s\"\n", text);
    return false;
}

static bool read_quads(const char *text, qm_quad_reading *out)
{
    if (strcmp(text, "triangles") == 0) return *out = QM_QUADS_TRIANGLES, true;
    if (strcmp(text, "bilinear") == 0) return *out = QM_QUADS_BILINEAR, true;
    fprintf(stderr, "quadmesh: --quads takes triangles or bilinear, got \"%s\"\n", text);
    return false;
}

static bool read_threads(const char *text, int *out)
{
    double number;
    if (!read_number("threads", text, 1.0, &number)) return false;
    *out = (int)fmin(number, MAX_THREADS + 1);
    if (*out <= MAX_THREADS && *out == number) return true;
    fprintf(stderr, "quadmesh: --threads takes a whole number from 1 to %d, got \"%s\"\n", MAX_THREADS, text);
    return false;
}

enum {
    DIRECTION = 256,
    QUADS,
    TOLERANCE,
    ABSOLUTE,
    THRESHOLD,
    DEADLINE,
    THREADS,
    JSON,
    PROGRESS,
    SERVER,
    HELP
};

static bool read_option(cli_question *question, int option)
{
    qm_job_request *request = &question->request;
    switch (option) {
    case DIRECTION:
        return read_direction(optarg, &request->direction);
    case QUADS:
        return read_quads(optarg, &request->quads);
    case TOLERANCE:
        return read_number("tolerance", optarg, 1e-300, &request->tolerance);
    case ABSOLUTE:
        return request->tolerance_is_absolute = true;
    case THRESHOLD:
        return read_number("threshold", optarg, 0.0, &request->threshold);
    case DEADLINE:
        return read_number("deadline-ms", optarg, 1e-300, &request->deadline_ms);
    case THREADS:
        return read_threads(optarg, &request->threads);
    case JSON:
        return question->as_json = true;
    case PROGRESS:
        return question->shows_progress = true;
    case SERVER:
        return question->server = optarg, true;
    default:
        return false;
    }
}

int cmd_hausdorff(int argc, char **argv)
{
    static const struct option options[] = {{"direction", required_argument, NULL, DIRECTION},
                                            {"quads", required_argument, NULL, QUADS},
                                            {"tolerance", required_argument, NULL, TOLERANCE},
                                            {"absolute", no_argument, NULL, ABSOLUTE},
                                            {"threshold", required_argument, NULL, THRESHOLD},
                                            {"deadline-ms", required_argument, NULL, DEADLINE},
                                            {"threads", required_argument, NULL, THREADS},
                                            {"json", no_argument, NULL, JSON},
                                            {"progress", no_argument, NULL, PROGRESS},
                                            {"server", required_argument, NULL, SERVER},
                                            {"help", no_argument, NULL, HELP},
                                            {0}};
    cli_question question = {.request = qm_job_request_default()};
    for (int option; (option = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (option == HELP) return fputs(usage, stdout), EXIT_OK;
        if (!read_option(&question, option)) return fputs(usage, stderr), EXIT_USAGE;
    }
    if (argc - optind != 2) {
        fprintf(stderr, "quadmesh: hausdorff takes two files, got %d\n\n", argc - optind);
        return fputs(usage, stderr), EXIT_USAGE;
    }
    question.path_a = argv[optind];
    question.path_b = argv[optind + 1];
    return question.server ? cli_measure_there(&question) : cli_measure_here(&question);
}

/* ---- in this process ---- */

static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    cli_bar_show(user, progress->lower, progress->upper, progress->elapsed_ms, (double)progress->iterations);
}

static int measure_loaded(const cli_question *question, const qm_loaded_mesh *a, const qm_loaded_mesh *b)
{
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_parallel_run;
    ctx.cancel = &cli_interrupted;
    bool is_absolute = question->request.tolerance_is_absolute || a->diagonal == 0.0;
    cli_bar bar = cli_bar_make(question->request.tolerance * (is_absolute ? 1.0 : a->diagonal),
                               question->shows_progress);
    qm_job_result result;
    qm_status status = qm_job_answer(&ctx, &question->request, a, b, on_progress, &bar, &result);
    cli_bar_clear(&bar);
    if (status != QM_OK) {
        qm_problem problem = qm_problem_from_status(status, ctx.message);
        cli_complain(question->path_a, &problem, question->as_json);
        return EXIT_BAD_INPUT;
    }
    qm_text text = {0};
    qm_json_write_result(&text, &question->request, &result);
    char *json = qm_text_take(&text);
    int exit_status = json ? cli_print_result(json, question->as_json) : EXIT_BAD_INPUT;
    free(json);
    return exit_status;
}

int cli_measure_here(const cli_question *question)
{
    qm_context ctx = qm_context_make();
    ctx.cancel = &cli_interrupted;
    qm_loaded_mesh a, b;
    int status = EXIT_BAD_INPUT;
    if (cli_load_mesh(&ctx, question->path_a, question->as_json, &a)) {
        if (cli_load_mesh(&ctx, question->path_b, question->as_json, &b)) {
            status = measure_loaded(question, &a, &b);
            qm_loaded_mesh_reset(&ctx, &b);
        }
        qm_loaded_mesh_reset(&ctx, &a);
    }
    /* An interrupt while a file was read is no fault of the file. */
    return status == EXIT_BAD_INPUT && atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : status;
}
