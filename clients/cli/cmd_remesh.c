/**
 * cmd_remesh.c: a quad mesh of a surface, and how far it is from it.
 */
#include <stdio.h>
#include <string.h>

#include "base/host.h"
#include "base/json.h"
#include "options.h"

/** The file to write. */
typedef struct mesh_file {
    const char *path;
    bool has_uv;
} mesh_file;

/** False if a distance was wanted, and not reached. */
static bool is_near(const qm_json *result)
{
    return !qm_json_has(result, "reached") || qm_json_is_true(result, "reached");
}

/** What was found of points, and how far the quads are from the surface of these. */
static void print_points(FILE *file, const qm_json *result)
{
    char bound[CLI_BOUND_SIZE];
    fprintf(file,
            "of %.0f points, %.0f outliers, noise %.2g %% of the diagonal, normals %s, %.0f holes filled, "
            "%.0f borders; ",
            qm_json_get_number(result, "points.used"), qm_json_get_number(result, "points.outliers"),
            100.0 * qm_json_get_number(result, "points.noise_relative"),
            qm_json_get_string(result, "points.normals"), qm_json_get_number(result, "points.holes_filled"),
            qm_json_get_number(result, "points.borders"));
    double thin = qm_json_get_number(result, "points.thin_share");
    if (thin > 0.001)
        fprintf(file, "%.1f %% of them on parts too thin for their density, which may be lost; ",
                100.0 * thin);
    fprintf(file, "distance from the surface of the points at most %s of the diagonal\n",
            cli_format_bound(qm_json_get_number(result, "points.hausdorff.upper_relative"), true, bound));
}

static void print_text(FILE *file, const qm_json *result)
{
    char bound[CLI_BOUND_SIZE], patches[60] = "";
    const char *from = qm_json_has(result, "patches_from") ? qm_json_get_string(result, "patches_from") : "";
    if (qm_json_has(result, "patches"))
        snprintf(patches, sizeof patches, " in %.0f patches%s", qm_json_get_number(result, "patches"),
                 strcmp(from, "division") == 0 ? " of divided quads"
                 : strcmp(from, "quads") == 0  ? " without a layout"
                                               : "");
    fprintf(
        file,
        "%.0f quads%s, %.0f irregular vertices, %.0f components, %.0f folded, least scaled Jacobian %.3g, "
        "distance at most %s of the diagonal%s, in %.1f ms\n",
        qm_json_get_number(result, "quads"), patches, qm_json_get_number(result, "irregular_vertices"),
        qm_json_get_number(result, "components"), qm_json_get_number(result, "folded"),
        qm_json_get_number(result, "least_scaled_jacobian"),
        cli_format_bound(qm_json_get_number(result, "hausdorff.upper_relative"), true, bound),
        is_near(result) ? "" : ", which is more than was wanted", qm_json_get_number(result, "elapsed_ms"));
    if (qm_json_has(result, "points")) print_points(file, result);
}

/** Fetches the mesh that a job on a daemon has made; false after a report. */
static bool fetch_mesh(cli_session *session, const char *server, const mesh_file *made, const char *id,
                       bool as_json)
{
    char target[128];
    const char *path = made->path;
    snprintf(target, sizeof target, "/v1/meshes/%s/content?format=%s%s", id,
             qm_format_name(cli_format_of(path)), made->has_uv ? "&uv=patches" : "");
    FILE *file = strcmp(path, "-") == 0 ? stdout : fopen(path, "wb");
    bool is_fetched = file && cli_session_fetch(session, target, NULL, 0, "*/*", server, file);
    bool is_written = file && !ferror(file) && (file == stdout || fclose(file) == 0);
    if (!is_written) cli_report_unwritable(path, as_json);
    return is_fetched && is_written;
}

static int finish(const void *user, const cli_job *job, const cli_job_output *output)
{
    const mesh_file *made = user;
    qm_context ctx = qm_host_context();
    qm_json *result = qm_json_parse(output->json);
    const char *id = qm_json_get_string(result, "mesh");
    bool is_written =
        output->result
            ? cli_write_mesh(&ctx, made->path, &output->result->remesh.mesh, made->has_uv, job->as_json)
            : fetch_mesh(output->session, job->server, made, id ? id : "", job->as_json);
    if (is_written && job->as_json) puts(output->json);
    /* Standard output holds either the mesh or what is said of it. */
    if (is_written && !job->as_json) print_text(strcmp(made->path, "-") == 0 ? stderr : stdout, result);
    bool met = is_near(result);
    qm_json_free(result);
    return !is_written ? EXIT_BAD_INPUT : met ? EXIT_OK : EXIT_NOT_CONVERGED;
}

static int run(int argc, char **argv)
{
    cli_job job = cli_job_make(QM_JOB_REMESH);
    qm_job_request *request = &job.request;
    mesh_file made = {NULL, false};
    const cli_option options[] = {
        {.name = "output",
         .letter = 'o',
         .value = "OUT",
         .type = CLI_TEXT,
         .is_required = true,
         .target = &made.path,
         .help = "the mesh, in the format of its name, else PLY; - is standard output"},
        {.name = "quads",
         .value = "N",
         .type = CLI_SIZE,
         .min = 1,
         .max = 1e7,
         .target = &request->remesh.quads.quads,
         .help = "about so many quads (default 5000); with --distance the first of the numbers that are "
                 "tried, with\n"
                 "--semi-regular the limit"},
        {.name = "distance",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &request->distance_relative,
         .help = "until the distance to the surface is at most X, as a fraction of the surface's diagonal"},
        {.name = "semi-regular",
         .type = CLI_FLAG,
         .target = &request->remesh.is_semi_regular,
         .help = "patches of rows and columns, by an automatic layout where one gives good quads (see layout "
                 "--auto)"},
        {.name = "crease-angle",
         .value = "DEG",
         .type = CLI_NUMBER,
         .target = &request->remesh.quads.crease_angle,
         .help = "edges whose faces differ by more are creases, and stay edges (default 40); 0: none"},
        CLI_OPTION_UV(&made.has_uv),
        CLI_OPTION_THREADS(&request->threads),
        CLI_OPTION_JSON(&job.as_json),
        CLI_OPTION_PROGRESS(&job.shows_progress),
        CLI_OPTION_SERVER(&job.server)};
    int status;
    if (!cli_read_options(&cmd_remesh, options, sizeof options / sizeof *options, argc, argv, job.path,
                          &status))
        return status;
    if (!cli_check_one_document(&made.path, 1, job.as_json)) return EXIT_USAGE;
    if (made.has_uv && !cli_check_uv(made.path)) return EXIT_USAGE;
    if (!cli_check_writable(made.path, job.as_json)) return EXIT_BAD_INPUT;
    if (!job.server) request->threads = cli_count_threads(request->threads);
    return cli_run_job(&job, finish, &made);
}

const cli_command cmd_remesh = {
    .name = "remesh",
    .arguments = "SURFACE -o OUT [options]",
    .summary = "a quad mesh of a surface",
    .takes = "one surface",
    .path_count = 1,
    .description =
        "Makes a mesh of quads of about equal size. Boundaries and creases become edges of it, and its "
        "distance\nto the surface is measured, with a proven bound.\n"
        "Parts that are thinner than a quad, with round rims, may lose their shape: more quads keep them.\n"
        "Of a point set a surface of triangles is made first, without its noise and outliers; small holes "
        "are filled.\n",
    .exit_status =
        "Exit status: 0 done, 2 bad input or wrong usage, 3 the distance was not reached, or interrupted.",
    .run = run};
