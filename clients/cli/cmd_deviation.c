/**
 * cmd_deviation.c: mean, rms, percentiles, histogram and maximum of the distance from one mesh to another, and the
 * distances at vertices as CSV or as a coloured PLY file.
 */
#include <endian.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "base/json.h"
#include "options.h"

/** Files to write; NULL for none. */
typedef struct file_names {
    const char *csv, *ply;
} file_names;

/** Distances at A's vertices. */
typedef struct distance_list {
    double *values;
    size_t count;
} distance_list;

/* ---- text ---- */

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

static void print_range(const char *name, double lower, double upper)
{
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    printf("  %-8s %s to %s\n", name, cli_format_bound(lower, false, low),
           cli_format_bound(upper, true, high));
}

static void print_side(const qm_json *result, const char *side)
{
    char path[64], name[32];
    static const char *const figures[] = {"max", "size"};
    for (int i = 0; i < 2; i++) {
        snprintf(path, sizeof path, "signed.%s.%s.lower", side, figures[i]);
        double lower = qm_json_get_number(result, path);
        snprintf(path, sizeof path, "signed.%s.%s.upper", side, figures[i]);
        snprintf(name, sizeof name, "%s", i == 0 ? side : "  size");
        print_range(name, lower, qm_json_get_number(result, path));
    }
}

static void print_signed(const qm_json *result)
{
    const char *sign = qm_json_get_string(result, "signed.sign");
    printf("signed, positive %s%s\n", strcmp(sign, "normal") == 0 ? "where the normals of B point to" : sign,
           qm_json_is_true(result, "signed.proven") ? "" : "; the sides are not proven");
    print_range("mean", qm_json_get_number(result, "signed.mean.lower"),
                qm_json_get_number(result, "signed.mean.upper"));
    print_side(result, "outside");
    print_side(result, "inside");
    char path[64];
    for (size_t i = 0;; i++) {
        snprintf(path, sizeof path, "signed.bands.%zu.lower", i);
        if (!qm_json_has(result, path)) return;
        double share[2] = {qm_json_get_number(result, path), 0.0}, ends[2];
        snprintf(path, sizeof path, "signed.bands.%zu.upper", i);
        share[1] = qm_json_get_number(result, path);
        snprintf(path, sizeof path, "signed.bands.%zu.from", i);
        ends[0] = qm_json_get_number(result, path);
        snprintf(path, sizeof path, "signed.bands.%zu.to", i);
        ends[1] = qm_json_get_number(result, path);
        printf("  from %.6g to %.6g: %.4f %% to %.4f %%\n", isnan(ends[0]) ? -INFINITY : ends[0],
               isnan(ends[1]) ? INFINITY : ends[1], floor(1e6 * share[0]) / 1e4, ceil(1e6 * share[1]) / 1e4);
    }
}

enum { PRINTED_REGIONS = 10 };

static void print_limit(const qm_json *result)
{
    const char *verdict = qm_json_get_string(result, "verdict");
    if (verdict) printf("verdict  %s the limit\n", verdict);
    if (!qm_json_has(result, "region_count")) return;
    double count = qm_json_get_number(result, "region_count");
    printf("%.0f region%s of A %s or may be beyond it\n", count, count == 1.0 ? "" : "s",
           count == 1.0 ? "is" : "are");
    for (int i = 0; i < PRINTED_REGIONS && i < (int)count; i++) {
        static const char *const names[] = {"max.lower",  "max.upper",  "area.lower", "area.upper",
                                            "centroid.0", "centroid.1", "centroid.2", "face_count"};
        double figure[sizeof names / sizeof *names];
        char path[64], low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
        for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
            snprintf(path, sizeof path, "regions.%d.%s", i, names[k]);
            figure[k] = qm_json_get_number(result, path);
        }
        snprintf(path, sizeof path, "regions.%d.surely", i);
        printf("  %-8s up to %s to %s", qm_json_is_true(result, path) ? "surely" : "maybe",
               cli_format_bound(figure[0], false, low), cli_format_bound(figure[1], true, high));
        printf(", area %s to %s", cli_format_bound(figure[2], false, low),
               cli_format_bound(figure[3], true, high));
        printf(", round %.6g %.6g %.6g, %.0f face%s\n", figure[4], figure[5], figure[6], figure[7],
               figure[7] == 1.0 ? "" : "s");
    }
}

static void print_text(const cli_job *job, const qm_json *result)
{
    const char *over = qm_json_get_string(result, "over");
    printf("Deviation of A from B over its %s, quads as %s\n", over ? over : "",
           qm_json_get_string(result, "quads"));
    print_interval(result, "mean");
    print_interval(result, "rms");
    print_interval(result, "max");
    cli_print_notes(result, "max.");
    char path[64], low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE], name[32];
    for (size_t i = 0; i < job->request.percentile_count; i++) {
        snprintf(path, sizeof path, "percentiles.%zu.percent", i);
        snprintf(name, sizeof name, "%.6g %%", qm_json_get_number(result, path));
        snprintf(path, sizeof path, "percentiles.%zu.lower", i);
        double lower = qm_json_get_number(result, path);
        snprintf(path, sizeof path, "percentiles.%zu.upper", i);
        printf("  %-8s %s to %s\n", name, cli_format_bound(lower, false, low),
               cli_format_bound(qm_json_get_number(result, path), true, high));
    }
    if (qm_json_has(result, "signed")) print_signed(result);
    print_limit(result);
    printf("  search   %.1f ms after %.1f + %.1f ms to prepare, %.0f pieces, %.0f projections\n",
           qm_json_get_number(result, "elapsed_ms"), qm_json_get_number(result, "prepare_ms.a"),
           qm_json_get_number(result, "prepare_ms.b"), qm_json_get_number(result, "pieces"),
           qm_json_get_number(result, "projections"));
    if (!qm_json_is_true(result, "accurate"))
        puts("  stopped  before the accuracy was reached; the intervals hold");
}

/* ---- files ---- */

static void write_csv(FILE *file, const distance_list *distances)
{
    char number[QM_NUMBER_SIZE];
    fputs("vertex,distance\n", file);
    for (size_t i = 0; i < distances->count; i++)
        fprintf(file, "%zu,%s\n", i, qm_text_number(distances->values[i], number));
}

/* Lightness increases evenly, so that the order is visible in grey; the hues are safe for colour-blind readers. */
static const double stops[][3] = {{38, 22, 92},   {48, 62, 142},  {40, 100, 152}, {32, 134, 146},
                                  {52, 164, 122}, {112, 190, 84}, {184, 210, 62}, {246, 226, 62}};
enum { STOPS = sizeof stops / sizeof stops[0] };

static void write_double(FILE *file, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits = htole64(bits);
    fwrite(&bits, sizeof bits, 1, file);
}

/** Binary PLY: positions in double, a colour from dark blue (0) through green to yellow (the maximum), and the distance
 * as the property "quality". Quads stay quads. */
static void write_ply(FILE *file, const qm_mesh *mesh, const double *value)
{
    double max = 0.0;
    for (size_t i = 0; i < mesh->vertex_count; i++)
        max = fmax(max, value[i]);
    fprintf(
        file,
        "ply\nformat binary_little_endian 1.0\nelement vertex %zu\nproperty double x\nproperty double y\n"
        "property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "property double quality\nelement face %zu\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh->vertex_count, mesh->face_count);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        uint8_t colour[3];
        for (int k = 0; k < 3; k++)
            write_double(file, mesh->positions[3 * i + (size_t)k]);
        double fraction = max > 0.0 ? value[i] / max : 0.0;
        QM_ASSERT(fraction >= 0.0 && fraction <= 1.0);
        double position = fraction * (STOPS - 1);
        int below = position >= STOPS - 1 ? STOPS - 2 : (int)position;
        double weight = position - below;
        for (int k = 0; k < 3; k++)
            colour[k] = (uint8_t)lround(stops[below][k] + weight * (stops[below + 1][k] - stops[below][k]));
        fwrite(colour, 1, sizeof colour, file);
        write_double(file, value[i]);
    }
    for (size_t i = 0; i < mesh->face_count; i++) {
        const uint32_t *face = mesh->faces + 4 * i;
        uint8_t count = face[3] == QM_NO_INDEX ? 3 : 4;
        fwrite(&count, 1, 1, file);
        for (int corner = 0; corner < count; corner++) {
            uint32_t vertex = htole32(face[corner]);
            fwrite(&vertex, sizeof vertex, 1, file);
        }
    }
}

/** Opens, writes and closes a file, unless it has no name; false after a report. */
static bool write_file(const char *path, const qm_mesh *mesh, const distance_list *distances, bool as_ply,
                       bool as_json)
{
    if (!path) return true;
    FILE *file = cli_open_output(path, as_json);
    if (!file) return false;
    if (as_ply)
        write_ply(file, mesh, distances->values);
    else
        write_csv(file, distances);
    return cli_close_output(file, path, as_json);
}

static bool write_files(const cli_job *job, const file_names *names, const qm_mesh *mesh,
                        const distance_list *distances)
{
    return write_file(names->csv, mesh, distances, false, job->as_json) &&
           write_file(names->ply, mesh, distances, true, job->as_json);
}

/** Writes the files of a job that ran on a daemon. Positions are read from the input file again, and moved as there. */
static bool write_fetched(const file_names *names, const cli_job *job, cli_session *session)
{
    distance_list distances;
    qm_context ctx = qm_host_context();
    qm_loaded_mesh mesh;
    qm_preparation positions_only = cli_prepare(false, job->request.quads, 1);
    if (job->request.pose[0].is_given) positions_only.transform = job->request.pose[0].transform;
    bool is_written = false;
    if (cli_session_fetch_numbers(session, job->server, &distances.values, &distances.count) &&
        cli_load_mesh(&ctx, job->path[0], job->as_json, &positions_only, &mesh)) {
        if (mesh.mesh.vertex_count == distances.count)
            is_written = write_files(job, names, &mesh.mesh, &distances);
        else
            fprintf(stderr, "quadmesh: the daemon counts other vertices than %s has\n", job->path[0]);
        qm_loaded_mesh_reset(&ctx, &mesh);
    }
    free(distances.values);
    return is_written;
}

/* ---- the command ---- */

/** Whether the greatest distance is within the limit. */
static int limit_status(const qm_json *result)
{
    const char *verdict = qm_json_get_string(result, "verdict");
    return !verdict ? EXIT_NOT_CONVERGED : strcmp(verdict, "below") == 0 ? EXIT_OK : EXIT_NO;
}

static int finish(const void *user, const cli_job *job, const cli_job_output *output)
{
    const file_names *names = user;
    bool is_written = true;
    if (output->result) {
        const qm_deviation *deviation = &output->result->deviation;
        const distance_list distances = {deviation->vertex_distance, deviation->vertex_count};
        is_written = write_files(job, names, &output->mesh[0]->mesh, &distances);
    } else if (names->csv || names->ply) {
        is_written = write_fetched(names, job, output->session);
    }
    qm_json *result = qm_json_parse(output->json);
    if (job->as_json)
        puts(output->json);
    else
        print_text(job, result);
    bool is_accurate = qm_json_is_true(result, "accurate");
    int status =
        isnan(job->request.threshold) ? (is_accurate ? EXIT_OK : EXIT_NOT_CONVERGED) : limit_status(result);
    qm_json_free(result);
    return is_written ? status : EXIT_BAD_INPUT;
}

static int run(int argc, char **argv)
{
    cli_job job = cli_job_make(QM_JOB_DEVIATION);
    qm_job_request *request = &job.request;
    file_names names = {NULL, NULL};
    const cli_option options[] = {
        {.name = "csv",
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &names.csv,
         .help = "the distances at A's vertices"},
        {.name = "ply",
         .letter = 'o',
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &names.ply,
         .help = "A with a colour and the distance (as quality) at each vertex"},
        CLI_OPTION_QUADS(&request->quads),
        CLI_OPTION_AVERAGES(request),
        CLI_OPTION_GAP(&request->tolerance,
                       "width of the interval of the maximum, as a fraction of the diagonal "
                       "of A's box (default 1e-6)"),
        CLI_OPTION_ABSOLUTE(&request->tolerance_is_absolute),
        CLI_OPTION_PERCENTILES(request, "1,5,25,50,75,90,95,99"),
        {.name = "bins",
         .value = "N",
         .type = CLI_SIZE,
         .max = QM_JOB_MAX_BINS,
         .target = &request->bins,
         .help = "bins of the histogram (default 50)"},
        {.name = "limit",
         .value = "X",
         .type = CLI_NUMBER,
         .target = &request->threshold,
         .help = "say whether the greatest distance is above X, in the unit of the meshes"},
        {.name = "regions",
         .type = CLI_FLAG,
         .target = &request->regions,
         .help = "and which connected parts of A are, or may be, beyond it"},
        CLI_OPTIONS_SIGN(request),
        CLI_OPTIONS_NOTES(request->notes),
        CLI_OPTION_THREADS(&request->threads),
        CLI_OPTION_TRANSFORM(&job.transform, "A"),
        CLI_OPTION_JSON(&job.as_json),
        CLI_OPTION_PROGRESS(&job.shows_progress),
        CLI_OPTION_SERVER(&job.server)};
    int status;
    if (!cli_read_options(&cmd_deviation, options, sizeof options / sizeof *options, argc, argv, job.path,
                          &status))
        return status;
    cli_settle_sign(request);
    status = cli_settle_outputs((const char *const[]){names.csv, names.ply}, 2, job.as_json);
    if (status != EXIT_OK) return status;
    if (!job.server) request->threads = cli_count_threads(request->threads);
    return cli_run_job(&job, finish, &names);
}

const cli_command cmd_deviation = {
    .name = "deviation",
    .arguments = "A B [options]",
    .summary = "averages of the distance of A from B, one way",
    .takes = "two files",
    .path_count = 2,
    .description = "How far the surface A is from B on the whole, one way: mean, rms, percentiles, histogram "
                   "and\nmaximum, as proven intervals; distances at A's vertices as a table or in colours. "
                   "For both ways:\ncompare. For colours that are right between vertices, too: heatmap.\n",
    .exit_status = "Exit status: 0 accurate, or within the limit, 1 beyond it, 2 bad input or wrong usage, 3 "
                   "the pieces ran out before, no "
                   "verdict, or interrupted.",
    .run = run};
