#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "base/json_read.h"
#include "paint.h"
#include "remote.h"

static const char usage[] =
    "usage: quadmesh deviation A B [options]\n"
    "\n"
    "How far the surface A lies from B: mean, rms, percentiles, histogram and maximum, as proven intervals.\n"
    "\n"
    "  --csv FILE       the distances at A's vertices\n"
    "  --ply FILE       A with a colour and the distance (as quality) at each vertex\n"
    "  --quads R        how quads are read: triangles (default) or bilinear\n"
    "  --accuracy X     width of the intervals of mean and rms at which to stop, as a share of them (default "
    "0.01)\n"
    "  --pieces N       parts that A's faces may be cut into besides themselves (default 1048576)\n"
    "  --tolerance X    width of the interval of the maximum, a share of the diagonal of A's box (default "
    "1e-6)\n"
    "  --absolute       the tolerance is in the unit of the meshes\n"
    "  --percentiles L  which percentiles, as numbers with commas between (default 1,5,25,50,75,90,95,99)\n"
    "  --bins N         bins of the histogram (default 50)\n"
    "  --threads N      threads (default: one for each processor; with --server what the daemon gives)\n"
    "  --json           the result object of the API on standard output\n"
    "  --progress       lines of progress on standard error also when that is no terminal\n"
    "  --server URL     ask a daemon instead of this process\n"
    "\n"
    "Exit status: 0 accurate, 1 bad input, 2 wrong usage, 3 the pieces ran out before, or interrupted.\n";

#define MAX_PIECES 1e7
#define MAX_BINS 1e4

/** Everything that was asked for. */
typedef struct question {
    const char *path_a, *path_b, *csv, *ply;
    const char *server; /* NULL: in this process */
    qm_job_request request;
    bool as_json, shows_progress;
} question;

/** Distances at A's vertices. */
typedef struct distance_list {
    double *values; /* on malloc */
    size_t count;
} distance_list;

/* ---- what is shown ---- */

static void print_interval(const qm_json *result, const char *name)
{
    char path[64], low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    snprintf(path, sizeof path, "%s.lower", name);
    double lower = qm_json_get_number(result, path);
    snprintf(path, sizeof path, "%s.upper", name);
    double upper = qm_json_get_number(result, path);
    printf("  %-8s %s to %s\n", name, cli_format_bound(lower, false, low),
           cli_format_bound(upper, true, high));
}

static void print_percentiles(const qm_json *result, size_t count)
{
    char path[64], low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE], name[32];
    for (size_t i = 0; i < count; i++) {
        snprintf(path, sizeof path, "percentiles.%zu.percent", i);
        snprintf(name, sizeof name, "%.6g %%", qm_json_get_number(result, path));
        snprintf(path, sizeof path, "percentiles.%zu.lower", i);
        double lower = qm_json_get_number(result, path);
        snprintf(path, sizeof path, "percentiles.%zu.upper", i);
        printf("  %-8s %s to %s\n", name, cli_format_bound(lower, false, low),
               cli_format_bound(qm_json_get_number(result, path), true, high));
    }
}

static void print_words(const question *asked, const qm_json *result)
{
    const char *over = qm_json_get_string(result, "over");
    printf("Deviation of A from B over its %s, quads as %s\n", over ? over : "",
           qm_json_get_string(result, "quads"));
    print_interval(result, "mean");
    print_interval(result, "rms");
    print_interval(result, "max");
    print_percentiles(result, asked->request.percentile_count);
    printf("  search   %.1f ms after %.1f + %.1f ms to prepare, %.0f pieces, %.0f projections\n",
           qm_json_get_number(result, "elapsed_ms"), qm_json_get_number(result, "prepare_ms.a"),
           qm_json_get_number(result, "prepare_ms.b"), qm_json_get_number(result, "pieces"),
           qm_json_get_number(result, "projections"));
    if (!qm_json_is_true(result, "accurate"))
        puts("  stopped  before the accuracy was reached; the intervals hold");
}

/** Prints a result object; returns the exit status that goes with it. */
static int show(const question *asked, const char *json)
{
    qm_json *result = qm_json_parse(json);
    if (asked->as_json)
        puts(json);
    else
        print_words(asked, result);
    bool is_accurate = qm_json_is_true(result, "accurate");
    qm_json_free(result);
    return is_accurate ? EXIT_OK : EXIT_NOT_CONVERGED;
}

/* ---- what is written ---- */

static bool write_csv(FILE *file, const distance_list *distances)
{
    char number[QM_NUMBER_SIZE];
    fputs("vertex,distance\n", file);
    for (size_t i = 0; i < distances->count; i++)
        fprintf(file, "%zu,%s\n", i, qm_text_number(distances->values[i], number));
    return !ferror(file);
}

/** Opens, writes and closes a file; false after words. */
static bool write_file(const char *path, const qm_mesh *mesh, const distance_list *distances, bool as_ply)
{
    FILE *file = fopen(path, "wb");
    bool good = file && (as_ply ? cli_paint(file, mesh, distances->values) : write_csv(file, distances));
    if (file) good &= fclose(file) == 0;
    if (!good) fprintf(stderr, "quadmesh: %s cannot be written\n", path);
    return good;
}

static bool write_files(const question *asked, const qm_mesh *mesh, const distance_list *distances)
{
    bool good = !asked->csv || write_file(asked->csv, mesh, distances, false);
    return good && (!asked->ply || write_file(asked->ply, mesh, distances, true));
}

static int finish(const question *asked, const char *json, const qm_mesh *mesh,
                  const distance_list *distances)
{
    bool written = write_files(asked, mesh, distances);
    int status = show(asked, json);
    return written ? status : EXIT_BAD_INPUT;
}

/* ---- in this process ---- */

static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    cli_bar_show(user, progress->lower, progress->upper, progress->elapsed_ms, (double)progress->iterations);
}

static cli_bar make_bar(const question *asked, double diagonal)
{
    const qm_job_request *request = &asked->request;
    bool is_absolute = request->tolerance_is_absolute || diagonal == 0.0;
    return cli_bar_make(request->tolerance * (is_absolute ? 1.0 : diagonal), asked->shows_progress);
}

static int measure_loaded(const question *asked, const qm_loaded_mesh *a, const qm_loaded_mesh *b)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    cli_bar bar = make_bar(asked, a->diagonal);
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
    distance_list distances = {result.deviation.vertex_distance, result.deviation.vertex_count};
    int exit_status = json ? finish(asked, json, &a->mesh, &distances) : EXIT_BAD_INPUT;
    free(json);
    qm_job_result_reset(&ctx, &result);
    return exit_status;
}

static int measure_here(const question *asked)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    const qm_job_request *request = &asked->request;
    const char *const paths[2] = {asked->path_a, asked->path_b};
    const qm_preparation preparations[2] = {cli_prepare(false, request->quads, request->threads),
                                            cli_prepare(true, request->quads, request->threads)};
    qm_loaded_mesh meshes[2];
    int status = EXIT_BAD_INPUT;
    if (cli_load_pair(&ctx, paths, asked->as_json, preparations, meshes)) {
        status = measure_loaded(asked, &meshes[0], &meshes[1]);
        cli_unload_pair(&ctx, meshes);
    }
    return status;
}

/* ---- by a daemon ---- */

/** The distances of the job that has run; false after words. */
static bool fetch_distances(const question *asked, cli_talk *talk, distance_list *out)
{
    char path[300];
    FILE *file = tmpfile();
    *out = (distance_list){0};
    if (!file) {
        perror("quadmesh: no temporary file");
        return false;
    }
    snprintf(path, sizeof path, "%s/result", cli_talk_job_path(talk));
    bool good = cli_talk_fetch(talk, path, NULL, 0, "application/octet-stream", asked->server, file);
    long size = good ? ftell(file) : 0;
    rewind(file);
    out->count = (size_t)size / sizeof(double);
    out->values = malloc((size_t)size + 1);
    good = good && out->values && fread(out->values, sizeof(double), out->count, file) == out->count;
    fclose(file);
    if (good) qm_rows_turn_bytes(out->values, out->count);
    return good;
}

/** Fetches and writes what is to be written beside the result. */
static int finish_there(const question *asked, cli_talk *talk, const char *json)
{
    distance_list distances = {0};
    if (!asked->csv && !asked->ply) return show(asked, json);
    qm_context ctx = qm_host_context();
    qm_loaded_mesh mesh = {0};
    qm_preparation for_positions = cli_prepare(false, asked->request.quads, 1);
    int status = EXIT_BAD_INPUT;
    if (fetch_distances(asked, talk, &distances) &&
        cli_load_mesh(&ctx, asked->path_a, asked->as_json, &for_positions, &mesh)) {
        if (mesh.mesh.vertex_count == distances.count)
            status = finish(asked, json, &mesh.mesh, &distances);
        else
            fprintf(stderr, "quadmesh: the daemon counts other vertices than %s has\n", asked->path_a);
        qm_loaded_mesh_reset(&ctx, &mesh);
    }
    free(distances.values);
    return status;
}

static int measure_there(const question *asked)
{
    cli_talk *talk = cli_talk_open(asked->server, asked->as_json);
    qm_job_request request = asked->request;
    double diagonal = 0.0;
    char *result = NULL;
    int status = EXIT_BAD_INPUT;
    if (talk && cli_talk_upload(talk, asked->path_a, request.a, &diagonal) &&
        cli_talk_upload(talk, asked->path_b, request.b, NULL))
        result = cli_talk_run_job(talk, &request, make_bar(asked, diagonal));
    if (result) status = finish_there(asked, talk, result);
    free(result);
    cli_talk_close(talk);
    return status;
}

/* ---- the command ---- */

static bool read_whole(const char *name, const char *text, double greatest, size_t *out)
{
    double number;
    if (!cli_read_number(name, text, 0.0, &number)) return false;
    *out = (size_t)fmin(number, greatest);
    if (number <= greatest && number == floor(number)) return true;
    fprintf(stderr, "quadmesh: --%s takes a whole number up to %.0f, got \"%s\"\n", name, greatest, text);
    return false;
}

static bool read_percentiles(const char *text, qm_job_request *request)
{
    request->percentile_count = 0;
    for (const char *at = text;; at++) {
        char *end;
        double number = strtod(at, &end);
        bool is_good = end != at && number > 0.0 && number <= 100.0 &&
                       request->percentile_count < QM_JOB_MAX_PERCENTILES && (*end == ',' || !*end);
        if (!is_good) break;
        request->percentiles[request->percentile_count++] = number;
        if (!*end) return true;
        at = end;
    }
    fprintf(stderr, "quadmesh: --percentiles takes up to %d numbers above 0, none above 100, got \"%s\"\n",
            QM_JOB_MAX_PERCENTILES, text);
    return false;
}

enum {
    CSV = 256,
    PLY,
    QUADS,
    ACCURACY,
    PIECES,
    TOLERANCE,
    ABSOLUTE,
    PERCENTILES,
    BINS,
    THREADS,
    JSON,
    PROGRESS,
    SERVER,
    HELP
};

static bool read_option(question *asked, int option)
{
    qm_job_request *request = &asked->request;
    switch (option) {
    case CSV:
        return asked->csv = optarg, true;
    case PLY:
        return asked->ply = optarg, true;
    case QUADS:
        return cli_read_quads(optarg, &request->quads);
    case ACCURACY:
        return cli_read_number("accuracy", optarg, 1e-300, &request->accuracy);
    case PIECES:
        return read_whole("pieces", optarg, MAX_PIECES, &request->pieces);
    case TOLERANCE:
        return cli_read_number("tolerance", optarg, 1e-300, &request->tolerance);
    case ABSOLUTE:
        return request->tolerance_is_absolute = true;
    case PERCENTILES:
        return read_percentiles(optarg, request);
    case BINS:
        return read_whole("bins", optarg, MAX_BINS, &request->bins);
    case THREADS:
        return cli_read_threads(optarg, &request->threads);
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

int cmd_deviation(int argc, char **argv)
{
    static const struct option options[] = {{"csv", required_argument, NULL, CSV},
                                            {"ply", required_argument, NULL, PLY},
                                            {"quads", required_argument, NULL, QUADS},
                                            {"accuracy", required_argument, NULL, ACCURACY},
                                            {"pieces", required_argument, NULL, PIECES},
                                            {"tolerance", required_argument, NULL, TOLERANCE},
                                            {"absolute", no_argument, NULL, ABSOLUTE},
                                            {"percentiles", required_argument, NULL, PERCENTILES},
                                            {"bins", required_argument, NULL, BINS},
                                            {"threads", required_argument, NULL, THREADS},
                                            {"json", no_argument, NULL, JSON},
                                            {"progress", no_argument, NULL, PROGRESS},
                                            {"server", required_argument, NULL, SERVER},
                                            {"help", no_argument, NULL, HELP},
                                            {0}};
    question asked = {.request = qm_job_request_default()};
    asked.request.kind = QM_JOB_DEVIATION;
    for (int option; (option = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (option == HELP) return fputs(usage, stdout), EXIT_OK;
        if (!read_option(&asked, option)) return fputs(usage, stderr), EXIT_USAGE;
    }
    if (argc - optind != 2) {
        fprintf(stderr, "quadmesh: deviation takes two files, got %d\n\n", argc - optind);
        return fputs(usage, stderr), EXIT_USAGE;
    }
    asked.path_a = argv[optind];
    asked.path_b = argv[optind + 1];
    if (!asked.server) asked.request.threads = cli_count_threads(asked.request.threads);
    int status = asked.server ? measure_there(&asked) : measure_here(&asked);
    return status == EXIT_BAD_INPUT && atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : status;
}
