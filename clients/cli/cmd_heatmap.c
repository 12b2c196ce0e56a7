/**
 * cmd_heatmap.c: one mesh cut into triangles with its distance from another at their corners, as PLY or CSV.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "ops/heatmap_ply.h"
#include "options.h"

/** Files to write; NULL for none. */
typedef struct map_files {
    const char *ply, *csv;
} map_files;

/** Rows of QM_HEATMAP_COLUMNS numbers. */
typedef struct triangle_list {
    const double *row;
    size_t count;
    double error;
} triangle_list;

enum { ROWS = 4096 }; /* that are written at a time */

static void write_ply(FILE *file, const triangle_list *list)
{
    qm_text text = {0};
    qm_heatmap_ply_begin(&text, list->count, list->error);
    for (int pass = 0; pass < 2; pass++)
        for (size_t first = 0; first < list->count; first += ROWS) {
            const double *row = list->row + QM_HEATMAP_COLUMNS * first;
            size_t count = list->count - first < ROWS ? list->count - first : ROWS;
            if (pass == 0)
                qm_heatmap_ply_add_corners(&text, row, count);
            else
                qm_heatmap_ply_add_faces(&text, row, first, count);
            fwrite(text.data, 1, text.size, file);
            text.size = 0;
        }
    qm_text_reset(&text);
}

static void write_csv(FILE *file, const triangle_list *list)
{
    char number[QM_NUMBER_SIZE];
    fprintf(file, "%s\n", qm_job_array_of(QM_JOB_HEATMAP)->header);
    for (size_t i = 0; i < QM_HEATMAP_COLUMNS * list->count; i++)
        fprintf(file, "%s%s", qm_text_number(list->row[i], number),
                i % QM_HEATMAP_COLUMNS == QM_HEATMAP_COLUMNS - 1 ? "\n" : ",");
}

/** Opens, writes and closes a file, unless it has no name; false after a report. */
static bool write_file(const char *path, void (*write)(FILE *file, const triangle_list *list),
                       const triangle_list *list, bool as_json)
{
    FILE *file = path ? cli_open_output(path, as_json) : NULL;
    if (file) write(file, list);
    return !path || (file && cli_close_output(file, path, as_json));
}

static void print_text(const qm_json *result)
{
    char high[CLI_BOUND_SIZE];
    printf("%.0f triangles, distances within %s of what is interpolated, quads as %s\n",
           qm_json_get_number(result, "count"),
           cli_format_bound(qm_json_get_number(result, "error"), true, high),
           qm_json_get_string(result, "quads"));
    printf("  search   %.1f ms after %.1f + %.1f ms to prepare\n", qm_json_get_number(result, "elapsed_ms"),
           qm_json_get_number(result, "prepare_ms.a"), qm_json_get_number(result, "prepare_ms.b"));
    if (!qm_json_is_true(result, "accurate"))
        puts("  stopped  before the error was reached; that above holds");
}

static int finish(const void *user, const cli_job *job, const cli_job_output *output)
{
    const map_files *files = user;
    qm_json *result = qm_json_parse(output->json);
    triangle_list list = {.error = qm_json_get_number(result, "error")};
    double *fetched = NULL;
    size_t numbers = 0;
    bool is_read = true;
    if (output->result) {
        list.row = output->result->heatmap.row;
        list.count = output->result->heatmap.count;
    } else if (files->ply || files->csv) {
        is_read = cli_session_fetch_numbers(output->session, job->server, &fetched, &numbers);
        list.row = fetched;
        list.count = numbers / QM_HEATMAP_COLUMNS;
    }
    bool is_written = is_read && write_file(files->ply, write_ply, &list, job->as_json) &&
                      write_file(files->csv, write_csv, &list, job->as_json);
    free(fetched);
    if (job->as_json)
        puts(output->json);
    else
        print_text(result);
    bool is_accurate = qm_json_is_true(result, "accurate");
    qm_json_free(result);
    return !is_written ? EXIT_BAD_INPUT : is_accurate ? EXIT_OK : EXIT_NOT_CONVERGED;
}

static int run(int argc, char **argv)
{
    cli_job job = cli_job_make(QM_JOB_HEATMAP);
    qm_job_request *request = &job.request;
    map_files files = {NULL, NULL};
    const cli_option options[] = {
        {.name = "ply",
         .letter = 'o',
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &files.ply,
         .help = "the triangles, with the distance as quality"},
        {.name = "csv",
         .value = "FILE",
         .type = CLI_TEXT,
         .target = &files.csv,
         .help = "corners, distances, face and error of each triangle"},
        {.name = "error",
         .value = "X",
         .type = CLI_POSITIVE,
         .target = &request->error,
         .help = "triangles are cut until their errors are no greater, in the unit of the meshes\n(default: "
                 "a thousandth of the diagonal of A's box)"},
        {.name = "pieces",
         .value = "N",
         .type = CLI_SIZE,
         .max = QM_JOB_MAX_PIECES,
         .target = &request->pieces,
         .help = "max triangles that A's faces are cut into (default 1048576)"},
        CLI_OPTION_QUADS(&request->quads),
        CLI_OPTION_UNIT(request->notes),
        CLI_OPTION_THREADS(&request->threads),
        CLI_OPTION_TRANSFORM(&job.transform, "A"),
        CLI_OPTION_JSON(&job.as_json),
        CLI_OPTION_SERVER(&job.server)};
    int status;
    if (!cli_read_options(&cmd_heatmap, options, sizeof options / sizeof *options, argc, argv, job.path,
                          &status))
        return status;
    status = cli_settle_outputs((const char *const[]){files.ply, files.csv}, 2, job.as_json);
    if (status != EXIT_OK) return status;
    if (!job.server) request->threads = cli_count_threads(request->threads);
    return cli_run_job(&job, finish, &files);
}

const cli_command cmd_heatmap = {.name = "heatmap",
                                 .arguments = "A B [options]",
                                 .summary = "A in colours of its distance from B, right to a stated error",
                                 .takes = "two files",
                                 .path_count = 2,
                                 .description =
                                     "A cut into triangles with its distance from B at their corners: what "
                                     "is interpolated between them is\nright to the error that is told. For "
                                     "the distances at A's own vertices alone: deviation --ply.\n",
                                 .exit_status = "Exit status: 0 accurate, 2 bad input or wrong usage, 3 the "
                                                "triangles ran out before, or interrupted.",
                                 .run = run};
