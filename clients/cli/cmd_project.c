/**
 * cmd_project.c: the nearest points of a mesh for each of many points.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "options.h"

typedef enum point_format { FORMAT_BY_NAME, FORMAT_TEXT, FORMAT_F64 } point_format;

typedef struct project_options {
    const char *mesh, *points, *output;
    const char *server;    /* NULL: in this process */
    const char *transform; /* a file; NULL: the mesh stays where it is */
    qm_job_pose pose;
    point_format input;
    bool as_csv, as_binary, as_json;
    qm_array_format format; /* of the output */
    qm_quad_reading quads;
    qm_accelerator accelerator;
    int threads;
} project_options;

/* ---- points ---- */

typedef struct point_list {
    double *positions; /* x y z of each point; malloc'ed */
    size_t count;
} point_list;

static bool read_text(const project_options *options, const uint8_t *bytes, size_t size, point_list *out)
{
    const qm_codec_limits limits = {.max_vertices = QM_NO_INDEX - 1, .max_faces = QM_NO_INDEX - 1};
    qm_context ctx = qm_context_make();
    ctx.cancel = &cli_interrupted;
    qm_mesh points;
    qm_codec_report report;
    qm_status status = qm_codec_decode(&ctx, QM_FORMAT_XYZ, bytes, size, &limits, &points, &report);
    *out = (point_list){0};
    if (status == QM_E_EMPTY) return true;
    if (status == QM_OK) {
        *out = (point_list){points.positions, points.vertex_count};
        return true;
    }
    qm_problem problem = qm_problem_from_codec(status, &report);
    cli_report(options->points, &problem, options->as_json);
    return false;
}

/** False after a report; in any case the positions are the caller's to free. */
static bool read_points(const project_options *options, point_list *out)
{
    size_t size;
    uint8_t *bytes = cli_read_file(options->points, &size, options->as_json);
    *out = (point_list){0};
    if (!bytes) return false;
    bool is_binary = options->input == FORMAT_F64 ||
                     (options->input == FORMAT_BY_NAME && (cli_path_ends_in(options->points, ".f64") ||
                                                           cli_path_ends_in(options->points, ".bin")));
    if (is_binary) {
        *out = (point_list){(double *)(void *)bytes, size / (3 * sizeof(double))};
        if (size % (3 * sizeof(double)) != 0) {
            qm_problem problem =
                qm_problem_make(QM_PROBLEM_MALFORMED_FILE,
                                "has %zu bytes, which is not a multiple of the 24 of a point", size);
            cli_report(options->points, &problem, options->as_json);
            return false;
        }
        qm_text_swap_bytes(out->positions, 3 * out->count);
        size_t invalid = qm_projections_find_invalid(out->positions, 3 * out->count);
        if (invalid == 3 * out->count) return true;
        qm_problem problem = qm_problem_make(QM_PROBLEM_NOT_FINITE,
                                             "point %zu has a coordinate that is not finite", invalid / 3);
        qm_problem_add_offset(&problem, invalid * sizeof(double), "is not a finite number");
        cli_report(options->points, &problem, options->as_json);
        return false;
    }
    bool is_read = read_text(options, bytes, size, out);
    free(bytes);
    return is_read;
}

/* ---- in this process ---- */

/** A mesh and its locator. */
typedef struct target {
    qm_loaded_mesh mesh;
    qm_locator locator;
} target;

static bool write_projections(const project_options *options, qm_context *ctx, const target *surface,
                              const point_list *points, FILE *out)
{
    qm_text text = {0};
    qm_status status = QM_OK;
    qm_projections_write_begin(&text, options->format);
    for (size_t first = 0; status == QM_OK && first < points->count; first += QM_PROJECTIONS_BLOCK) {
        size_t left = points->count - first,
               count = left < QM_PROJECTIONS_BLOCK ? left : QM_PROJECTIONS_BLOCK;
        qm_projections projections;
        status = qm_projections_find(ctx, &surface->mesh, &surface->locator, options->quads,
                                     points->positions + 3 * first, count, options->threads, &projections);
        if (status != QM_OK) break;
        qm_projections_write(&text, options->format, &projections, surface->mesh.diagonal, first == 0);
        qm_projections_reset(ctx, &projections);
        if (text.failed) status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the records");
        if (status == QM_OK) fwrite(text.data, 1, text.size, out);
        text.size = 0;
    }
    if (status != QM_OK) cli_report_status(options->mesh, status, ctx, options->as_json);
    qm_projections_write_end(&text, options->format);
    if (status == QM_OK && text.size > 0) fwrite(text.data, 1, text.size, out);
    qm_text_reset(&text);
    return status == QM_OK;
}

static bool project_here(const project_options *options, const point_list *points, FILE *out)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    qm_preparation preparation = cli_prepare(true, options->quads, options->threads);
    if (options->pose.is_given) preparation.transform = options->pose.transform;
    target surface;
    if (!cli_load_mesh(&ctx, options->mesh, options->as_json, &preparation, &surface.mesh)) return false;
    qm_status status = qm_locator_build(&ctx, surface.mesh.bvh, NULL, options->accelerator, &surface.locator);
    if (status != QM_OK) cli_report_status(options->mesh, status, &ctx, options->as_json);
    bool is_done = status == QM_OK && write_projections(options, &ctx, &surface, points, out);
    qm_locator_reset(&ctx, &surface.locator);
    qm_loaded_mesh_reset(&ctx, &surface.mesh);
    return is_done;
}

/* ---- on a daemon ---- */

static bool project_on_server(const project_options *options, point_list *points, FILE *out)
{
    static const char *const media[] = {"application/octet-stream", "text/csv", "application/json"};
    cli_session *session = cli_session_open(options->server, options->as_json);
    char id[QM_ID_SIZE], path[160 + QM_TRANSFORM_SIZE * QM_NUMBER_SIZE], threads[24] = "";
    if (options->threads > 0) snprintf(threads, sizeof threads, "&threads=%d", options->threads);
    bool is_done = session && cli_session_upload(session, options->mesh, &(qm_notes){0}, id, NULL);
    if (is_done) {
        int used =
            snprintf(path, sizeof path, "/v1/meshes/%s/project?quads=%s&accelerator=%s%s", id,
                     qm_quads_names[options->quads], qm_accelerator_names[options->accelerator], threads);
        for (int i = 0; i < QM_TRANSFORM_SIZE && options->pose.is_given; i++) {
            char number[QM_NUMBER_SIZE];
            used += snprintf(path + used, sizeof path - (size_t)used, "%s%s", i == 0 ? "&transform=" : ",",
                             qm_text_number(options->pose.transform[i], number));
        }
        qm_text_swap_bytes(points->positions, 3 * points->count);
        is_done = cli_session_fetch(session, path, points->count > 0 ? (const void *)points->positions : "",
                                    points->count * 3 * sizeof(double), media[options->format],
                                    options->points, out);
    }
    cli_session_close(session);
    return is_done;
}

/* ---- the command ---- */

static int fail_to_write(const project_options *options)
{
    cli_report_unwritable(options->output, options->as_json);
    return EXIT_BAD_INPUT;
}

static int project(const project_options *options)
{
    point_list points;
    bool is_stdout = strcmp(options->output, "-") == 0;
    bool is_done = read_points(options, &points);
    FILE *out = !is_done ? NULL : is_stdout ? stdout : fopen(options->output, "wb");
    int status = EXIT_BAD_INPUT;
    if (is_done && !out) {
        status = fail_to_write(options);
    } else if (is_done) {
        is_done =
            options->server ? project_on_server(options, &points, out) : project_here(options, &points, out);
        bool is_written = !ferror(out);
        if (!is_stdout) is_written &= fclose(out) == 0;
        if (is_done && is_written) status = EXIT_OK;
        if (is_done && !is_written) status = fail_to_write(options);
        /* Leave no incomplete file. */
        if (status != EXIT_OK && !is_stdout) remove(options->output);
    }
    free(points.positions);
    return status == EXIT_BAD_INPUT && atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : status;
}

static int run(int argc, char **argv)
{
    static const char *const input_names[] = {
        [FORMAT_BY_NAME] = "auto", [FORMAT_TEXT] = "text", [FORMAT_F64] = "f64", NULL};
    project_options o = {0};
    const cli_option options[] = {
        {.name = "output",
         .letter = 'o',
         .value = "OUT",
         .type = CLI_TEXT,
         .is_required = true,
         .target = &o.output,
         .help = "the records, one for each point in the order of POINTS; - is standard output"},
        {.name = "format",
         .value = "F",
         .type = CLI_CHOICE,
         .choices = input_names,
         .target = &o.input,
         .help = "of POINTS: text (x y z on a line), f64 (little-endian float64), or auto (default):\n"
                 "f64 for names that end in .f64 or .bin, else text"},
        {.name = "csv",
         .type = CLI_FLAG,
         .target = &o.as_csv,
         .help = "distance, x, y, z, face, u, v as text: the default for names that end in .csv, and -"},
        {.name = "binary",
         .type = CLI_FLAG,
         .target = &o.as_binary,
         .help = "the same as little-endian float64: the default for other names"},
        {.name = "json",
         .letter = 'j',
         .type = CLI_FLAG,
         .target = &o.as_json,
         .help = "one document: the default for names that end in .json; errors are documents, too"},
        CLI_OPTION_QUADS(&o.quads),
        CLI_OPTION_THREADS(&o.threads),
        CLI_OPTION_ACCELERATOR(&o.accelerator),
        CLI_OPTION_TRANSFORM(&o.transform, "MESH"),
        CLI_OPTION_SERVER(&o.server)};
    const char *paths[2];
    int status;
    if (!cli_read_options(&cmd_project, options, sizeof options / sizeof *options, argc, argv, paths,
                          &status))
        return status;
    o.mesh = paths[0];
    o.points = paths[1];
    if (o.as_json)
        o.format = QM_ARRAY_JSON;
    else if (o.as_csv)
        o.format = QM_ARRAY_CSV;
    else if (o.as_binary)
        o.format = QM_ARRAY_BINARY;
    else
        o.format = cli_path_ends_in(o.output, ".json")                                ? QM_ARRAY_JSON
                   : cli_path_ends_in(o.output, ".csv") || strcmp(o.output, "-") == 0 ? QM_ARRAY_CSV
                                                                                      : QM_ARRAY_BINARY;
    if (o.transform && !cli_read_pose(o.transform, &o.pose, o.as_json)) return EXIT_BAD_INPUT;
    if (!cli_check_writable(o.output, o.as_json)) return EXIT_BAD_INPUT;
    if (!o.server) o.threads = cli_count_threads(o.threads);
    return project(&o);
}

const cli_command cmd_project = {.name = "project",
                                 .arguments = "MESH POINTS -o OUT [options]",
                                 .summary = "the nearest point of a mesh for each of many points",
                                 .takes = "a mesh and a file of points",
                                 .path_count = 2,
                                 .description = "For each point the nearest one of a mesh: distance, place, "
                                                "face. For the distances of a whole\nmesh: deviation.\n",
                                 .exit_status =
                                     "Exit status: 0 done, 2 bad input or wrong usage, 3 interrupted.",
                                 .run = run};
