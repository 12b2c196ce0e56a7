#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "cli.h"
#include "remote.h"

/** Everything that was asked for. */
typedef struct question {
    const char *path_a, *path_b;
    const char *server; /* NULL: in this process */
    qm_job_request request;
    bool as_json, shows_progress;
} question;

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
    "  --memory N       bytes that the search's queue may take (default 1 GiB); it stops there with the "
    "bracket\n"
    "  --threads N      threads (default: one for each processor; with --server what the daemon gives)\n"
    "  --accelerator A  of nearest points: auto (default), boxes, tetra or grid\n"
    "  --bounds B       how upper bounds are found: cells (default) or matching\n"
    "  --json           the result object of the API on standard output\n"
    "  --progress       lines of progress on standard error also when that is no terminal\n"
    "  --server URL     ask a daemon instead of this process\n"
    "\n"
    "Exit status: 0 converged or verdict certain, 1 bad input, 2 wrong usage, 3 stopped before.\n";

static bool read_direction(const char *text, qm_direction *out)
{
    int place;
    bool known = cli_read_choice("direction", text, qm_direction_names, &place);
    if (known) *out = (qm_direction)place;
    return known;
}

static bool read_bounds(const char *text, qm_bounds *out)
{
    int place;
    bool known = cli_read_choice("bounds", text, qm_bounds_names, &place);
    if (known) *out = (qm_bounds)place;
    return known;
}

static bool read_memory(const char *text, size_t *out)
{
    double bytes;
    bool is_number = cli_read_number("memory", text, 65536.0, &bytes);
    if (is_number) *out = (size_t)fmin(bytes, 1099511627776.0);
    return is_number;
}

enum {
    DIRECTION = 256,
    QUADS,
    TOLERANCE,
    ABSOLUTE,
    THRESHOLD,
    DEADLINE,
    MEMORY,
    THREADS,
    ACCELERATOR,
    BOUNDS,
    JSON,
    PROGRESS,
    SERVER,
    HELP
};

static bool read_option(question *asked, int option)
{
    qm_job_request *request = &asked->request;
    switch (option) {
    case DIRECTION:
        return read_direction(optarg, &request->direction);
    case QUADS:
        return cli_read_quads(optarg, &request->quads);
    case TOLERANCE:
        return cli_read_number("tolerance", optarg, 1e-300, &request->tolerance);
    case ABSOLUTE:
        return request->tolerance_is_absolute = true;
    case THRESHOLD:
        return cli_read_number("threshold", optarg, 0.0, &request->threshold);
    case DEADLINE:
        return cli_read_number("deadline-ms", optarg, 1e-300, &request->deadline_ms);
    case MEMORY:
        return read_memory(optarg, &request->memory_limit);
    case THREADS:
        return cli_read_threads(optarg, &request->threads);
    case ACCELERATOR:
        return cli_read_accelerator(optarg, &request->accelerator);
    case BOUNDS:
        return read_bounds(optarg, &request->bounds);
    case JSON:
        return asked->as_json = true;
    case PROGRESS:
        return asked->shows_progress = true;
    case SERVER:
        return asked->server = optarg, true;
    default:
        return false;
    }
}

/* ---- in this process ---- */

static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    cli_bar_show(user, progress->lower, progress->upper, progress->elapsed_ms, (double)progress->iterations);
}

static int measure_loaded(const question *asked, const qm_loaded_mesh *a, const qm_loaded_mesh *b)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    bool is_absolute = asked->request.tolerance_is_absolute || a->diagonal == 0.0;
    cli_bar bar =
        cli_bar_make(asked->request.tolerance * (is_absolute ? 1.0 : a->diagonal), asked->shows_progress);
    qm_job_result result;
    qm_status status = qm_job_answer(&ctx, &asked->request, a, b, on_progress, &bar, &result);
    cli_bar_clear(&bar);
    if (status != QM_OK) {
        qm_problem problem = qm_problem_from_status(status, ctx.message);
        cli_complain(asked->path_a, &problem, asked->as_json);
        return EXIT_BAD_INPUT;
    }
    qm_text text = {0};
    qm_json_write_result(&text, &asked->request, &result);
    char *json = qm_text_take(&text);
    int exit_status = json ? cli_print_result(json, asked->as_json) : EXIT_BAD_INPUT;
    free(json);
    return exit_status;
}

static int measure_here(const question *asked)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    const qm_job_request *request = &asked->request;
    const char *const paths[2] = {asked->path_a, asked->path_b};
    const qm_preparation preparations[2] = {
        cli_prepare(request->direction != QM_A_TO_B, request->quads, request->threads),
        cli_prepare(request->direction != QM_B_TO_A, request->quads, request->threads)};
    qm_loaded_mesh meshes[2];
    int status = EXIT_BAD_INPUT;
    if (cli_load_pair(&ctx, paths, asked->as_json, preparations, meshes)) {
        status = measure_loaded(asked, &meshes[0], &meshes[1]);
        cli_unload_pair(&ctx, meshes);
    }
    /* An interrupt while a file was read is no fault of the file. */
    return status == EXIT_BAD_INPUT && atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : status;
}

/* ---- by a daemon ---- */

static int measure_there(const question *asked)
{
    cli_talk *talk = cli_talk_open(asked->server, asked->as_json);
    qm_job_request request = asked->request;
    double diagonal = 0.0;
    char *result = NULL;
    if (talk && cli_talk_upload(talk, asked->path_a, request.a, &diagonal) &&
        cli_talk_upload(talk, asked->path_b, request.b, NULL)) {
        double tolerance = request.tolerance * (request.tolerance_is_absolute ? 1.0 : diagonal);
        result = cli_talk_run_job(talk, &request, cli_bar_make(tolerance, asked->shows_progress));
    }
    cli_talk_close(talk);
    if (!result) return atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : EXIT_BAD_INPUT;
    int status = cli_print_result(result, asked->as_json);
    free(result);
    return status;
}

int cmd_hausdorff(int argc, char **argv)
{
    static const struct option options[] = {{"direction", required_argument, NULL, DIRECTION},
                                            {"quads", required_argument, NULL, QUADS},
                                            {"tolerance", required_argument, NULL, TOLERANCE},
                                            {"absolute", no_argument, NULL, ABSOLUTE},
                                            {"threshold", required_argument, NULL, THRESHOLD},
                                            {"deadline-ms", required_argument, NULL, DEADLINE},
                                            {"memory", required_argument, NULL, MEMORY},
                                            {"threads", required_argument, NULL, THREADS},
                                            {"accelerator", required_argument, NULL, ACCELERATOR},
                                            {"bounds", required_argument, NULL, BOUNDS},
                                            {"json", no_argument, NULL, JSON},
                                            {"progress", no_argument, NULL, PROGRESS},
                                            {"server", required_argument, NULL, SERVER},
                                            {"help", no_argument, NULL, HELP},
                                            {0}};
    question asked = {.request = qm_job_request_default()};
    for (int option; (option = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (option == HELP) return fputs(usage, stdout), EXIT_OK;
        if (!read_option(&asked, option)) return fputs(usage, stderr), EXIT_USAGE;
    }
    if (argc - optind != 2) {
        fprintf(stderr, "quadmesh: hausdorff takes two files, got %d\n\n", argc - optind);
        return fputs(usage, stderr), EXIT_USAGE;
    }
    asked.path_a = argv[optind];
    asked.path_b = argv[optind + 1];
    if (asked.server) return measure_there(&asked);
    asked.request.threads = cli_count_threads(asked.request.threads);
    return measure_here(&asked);
}
