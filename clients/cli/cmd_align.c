/**
 * cmd_align.c: the motion that brings one mesh onto another, as a document and as the moved mesh.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "base/json.h"
#include "options.h"

/** Files to write; NULL for none. */
typedef struct file_names {
    const char *mesh, *json;
} file_names;

static void print_text(FILE *file, const qm_json *result)
{
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    double m[QM_TRANSFORM_SIZE];
    cli_get_transform(result, m);
    fprintf(file, "Motion of A onto B, %s, quads as %s%s\n", qm_json_get_string(result, "fit"),
            qm_json_get_string(result, "quads"),
            qm_json_is_true(result, "mirrored") ? ", a mirror image" : "");
    for (int i = 0; i < 3; i++)
        fprintf(file, "  %-9s%22.17g %22.17g %22.17g %22.17g\n", i == 0 ? "transform" : "", m[i], m[4 + i],
                m[8 + i], m[12 + i]);
    fprintf(file, "  rms      %.9g", qm_json_get_number(result, "rms"));
    const double second = qm_json_get_number(result, "certainty.runner_up_rms");
    if (isfinite(second)) fprintf(file, ", %.9g where A lies second best", second);
    fprintf(file, "\n  distance %s to %s (Hausdorff, two_sided)\n",
            cli_format_bound(qm_json_get_number(result, "hausdorff.lower"), false, low),
            cli_format_bound(qm_json_get_number(result, "hausdorff.upper"), true, high));
    const double floor = qm_json_get_number(result, "floor");
    if (isfinite(floor))
        fprintf(file, "  floor    %s, which no rigid motion goes below\n",
                cli_format_bound(floor, false, low));
    fprintf(file, "  search   %.1f ms after %.1f + %.1f ms to prepare, %.0f steps\n",
            qm_json_get_number(result, "elapsed_ms"), qm_json_get_number(result, "prepare_ms.a"),
            qm_json_get_number(result, "prepare_ms.b"), qm_json_get_number(result, "iterations"));
}

/** Writes the moved mesh, which is read from its file again: it has been given to a daemon, or to a tree. */
static bool write_moved(const file_names *names, const cli_job *job, const qm_json *result)
{
    qm_context ctx = qm_host_context();
    qm_loaded_mesh mesh;
    double transform[QM_TRANSFORM_SIZE];
    cli_get_transform(result, transform);
    qm_preparation positions_only = cli_prepare(false, job->request.quads, 1);
    positions_only.has_no_tree = true;
    positions_only.transform = transform;
    if (!cli_load_mesh(&ctx, job->path[0], job->as_json, &positions_only, &mesh)) return false;
    bool is_written = cli_write_mesh(&ctx, names->mesh, &mesh.mesh, false, job->as_json);
    qm_loaded_mesh_reset(&ctx, &mesh);
    return is_written;
}

static bool write_json(const char *path, const char *json)
{
    FILE *file = fopen(path, "w");
    bool is_written = file && fprintf(file, "%s\n", json) > 0;
    if (file) is_written &= fclose(file) == 0;
    if (!is_written) cli_report_unwritable(path, false);
    return is_written;
}

static int finish(const void *user, const cli_job *job, const cli_job_output *output)
{
    const file_names *names = user;
    qm_json *result = qm_json_parse(output->json);
    bool is_written = !names->mesh || write_moved(names, job, result);
    if (job->as_json)
        puts(output->json);
    else {
        print_text(names->mesh && strcmp(names->mesh, "-") == 0 ? stderr : stdout, result);
        if (names->json) is_written = write_json(names->json, output->json) && is_written;
    }
    bool is_done = qm_json_is_true(result, "converged") && qm_json_is_true(result, "hausdorff.converged");
    qm_json_free(result);
    return !is_written ? EXIT_BAD_INPUT : is_done ? EXIT_OK : EXIT_NOT_CONVERGED;
}

/** Six numbers: a point of A and the one of B that it belongs to. */
static bool read_landmark(const char *text, void *target)
{
    qm_job_request *request = target;
    double number[6];
    int count = 0;
    const char *at = text;
    for (char *end = NULL; count < 6; at = end + 1) {
        number[count] = strtod(at, &end);
        if (end == at || !isfinite(number[count])) break;
        count++;
        if (*end != ',') {
            at = end;
            break;
        }
    }
    if (count == 6 && !*at && request->landmark_count < QM_JOB_MAX_LANDMARKS) {
        qm_align_landmark *landmark = &request->landmarks[request->landmark_count++];
        memcpy(landmark->a, number, sizeof landmark->a);
        memcpy(landmark->b, number + 3, sizeof landmark->b);
        request->align.start = QM_ALIGN_LANDMARKS;
        return true;
    }
    fprintf(
        stderr,
        "quadmesh: --landmark takes six numbers separated by commas, x,y,z of A and x,y,z of B, at most %d "
        "times, got \"%s\"\n",
        QM_JOB_MAX_LANDMARKS, text);
    return false;
}

static bool read_trim(const char *text, void *target)
{
    char *end;
    *(double *)target = strtod(text, &end);
    if (end != text && !*end && *(double *)target >= 0.0 && *(double *)target <= 0.9) return true;
    fprintf(stderr, "quadmesh: --trim takes a number from 0 to 0.9, got \"%s\"\n", text);
    return false;
}

/** A name without an extension, or "-", is PLY; false after a report of an extension that is no format's. */
static bool has_known_format(const char *path)
{
    if (!strchr(cli_base_name(path), '.') || qm_format_from_path(path) != QM_FORMAT_UNKNOWN) return true;
    fprintf(stderr, "quadmesh: %s: the extension names no format; there are" QM_FORMAT_NAMES "\n", path);
    return false;
}

static int run(int argc, char **argv)
{
    cli_job job = cli_job_make(QM_JOB_ALIGNMENT);
    qm_job_request *request = &job.request;
    file_names names = {NULL, NULL};
    const cli_option options[] = {
        {.name = "output",
         .letter = 'o',
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &names.mesh,
         .help = "the moved mesh A"},
        {.name = "json",
         .letter = 'j',
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &names.json,
         .help =
             "the result object of the API, which --transform of other commands reads; - is standard output"},
        {.name = "fit",
         .value = "F",
         .type = CLI_CHOICE,
         .choices = qm_align_fit_names,
         .target = &request->align.fit,
         .help = "least_squares (default), or min_max: the Hausdorff distance itself is made small"},
        {.name = "start",
         .value = "S",
         .type = CLI_CHOICE,
         .choices = qm_align_start_names,
         .target = &request->align.start,
         .help =
             "principal (default: 74 turns between the principal axes), centroids, identity or landmarks"},
        {.name = "landmark",
         .value = "L",
         .type = CLI_CUSTOM,
         .read = read_landmark,
         .may_repeat = true,
         .target = request,
         .help = "x,y,z,x,y,z: a point of A and the one of B that it belongs to; given three times or more"},
        {.name = "motion",
         .value = "M",
         .type = CLI_CHOICE,
         .choices = qm_align_motion_names,
         .target = &request->align.motion,
         .help = "rigid (default), rigid_scale or translation"},
        {.name = "direction",
         .value = "D",
         .type = CLI_CHOICE,
         .choices = qm_align_direction_names,
         .target = &request->align_direction,
         .help =
             "distances that count: auto (default: of A, so that A may be a part of B; both directions with\n"
             "a scale and for min_max), two_sided, a_to_b or b_to_a"},
        {.name = "trim",
         .value = "X",
         .type = CLI_CUSTOM,
         .read = read_trim,
         .target = &request->align.trim,
         .help = "share of points, the farthest ones, that do not count: 0 (default) to 0.9"},
        {.name = "max-distance",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &request->align.max_distance,
         .help = "points that are farther at the end do not count"},
        {.name = "mirror",
         .type = CLI_FLAG,
         .target = &request->align.may_mirror,
         .help = "takes a mirror image where it is nearer"},
        {.name = "samples",
         .value = "N",
         .type = CLI_SIZE,
         .min = QM_ALIGN_MIN_SAMPLES,
         .max = QM_ALIGN_MAX_SAMPLES,
         .target = &request->align.sample_count,
         .help = "points that are measured, evenly over the area (default 16384)"},
        CLI_OPTION_QUADS(&request->quads),
        CLI_OPTION_GAP(&request->tolerance, "width of the interval of the distance that is left, as a "
                                            "fraction of the diagonal of A's box\n(default 1e-6)"),
        CLI_OPTION_ABSOLUTE(&request->tolerance_is_absolute),
        CLI_OPTION_UNIT(request->notes),
        CLI_OPTION_THREADS(&request->threads),
        CLI_OPTION_PROGRESS(&job.shows_progress),
        CLI_OPTION_SERVER(&job.server)};
    int status;
    if (!cli_read_options(&cmd_align, options, sizeof options / sizeof *options, argc, argv, job.path,
                          &status))
        return status;
    job.as_json = names.json && strcmp(names.json, "-") == 0;
    if (!cli_check_one_document(&names.mesh, 1, job.as_json)) return EXIT_USAGE;
    if (names.mesh && !has_known_format(names.mesh)) return EXIT_BAD_INPUT;
    if ((names.mesh && !cli_check_writable(names.mesh, job.as_json)) ||
        (names.json && !cli_check_writable(names.json, job.as_json)))
        return EXIT_BAD_INPUT;
    if (!job.server) request->threads = cli_count_threads(request->threads);
    return cli_run_job(&job, finish, &names);
}

const cli_command cmd_align = {
    .name = "align",
    .arguments = "A B [options]",
    .summary = "the motion that brings A onto B, and the moved mesh",
    .takes = "two files",
    .path_count = 2,
    .description =
        "Brings A onto B. The motion is the best that was found, the distance that is left is proven, and so "
        "is\nthe floor below which no rigid motion gets. --transform of other commands reads what --json "
        "writes;\ncompare, check and report do both at once by --align.\n",
    .exit_status = "Exit status: 0 done, 2 bad input or wrong usage, 3 stopped before.",
    .run = run};
