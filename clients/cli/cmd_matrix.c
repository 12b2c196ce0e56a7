/**
 * cmd_matrix.c: the Hausdorff distances of all pairs of files, as a table, lists, CSV or JSON.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "base/json.h"
#include "options.h"

#define COLUMNS 4   /* of a row: two places, lower and upper bound */
#define MAX_TABLE 6 /* files that a table of 80 columns has room for */
#define NAME_WIDTH 16
#define ROUNDED 1e-3 /* relative width of an interval that four digits stand for */

/** The files of a call, and what is done with the answer. */
typedef struct file_set {
    const char **path, **name; /* the name is the last part of the path where that differs from all others */
    size_t count;
    const char *output; /* CSV, or NULL */
} file_set;

/* ---- rows ---- */

/** The pairs of an answer. */
typedef struct pair_rows {
    const double *values;
    size_t count;
} pair_rows;

static const double *find_row(const pair_rows *rows, size_t files, size_t a, size_t b)
{
    return rows->values + COLUMNS * qm_matrix_pair(files, a, b);
}

/* ---- text ---- */

/** An interval in at most 11 characters: four digits, or its ends with two. */
static void format_cell(const double *row, char out[32])
{
    if (row[3] - row[2] <= ROUNDED * row[3])
        snprintf(out, 32, "%.4g", row[3]);
    else
        snprintf(out, 32, "%.1g..%.1g", row[2], row[3]);
}

static void print_table(const file_set *files, const pair_rows *rows)
{
    char cell[32];
    printf("%*s", NAME_WIDTH, "");
    for (size_t b = 1; b < files->count; b++)
        printf(" %11.11s", files->name[b]);
    for (size_t a = 0; a + 1 < files->count; a++) {
        printf("\n%-*.*s", NAME_WIDTH, NAME_WIDTH, files->name[a]);
        for (size_t b = 1; b < files->count; b++) {
            if (b > a) format_cell(find_row(rows, files->count, a, b), cell);
            printf(" %11s", b > a ? cell : "");
        }
    }
    puts("\n(rounded; --json and -o FILE have both bounds of each distance)");
}

static void print_pair(const file_set *files, size_t a, size_t b, const double *row)
{
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    printf("  %s  %s  %s to %s\n", files->name[a], files->name[b], cli_format_bound(row[2], false, low),
           cli_format_bound(row[3], true, high));
}

static void print_lists(const file_set *files, const qm_json *result)
{
    char path[64], low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    for (size_t item = 0; item < files->count; item++) {
        printf("%s\n", files->name[item]);
        for (size_t i = 0;; i++) {
            snprintf(path, sizeof path, "nearest.%zu.%zu.mesh", item, i);
            double other = qm_json_get_number(result, path);
            if (isnan(other)) break;
            snprintf(path, sizeof path, "nearest.%zu.%zu.lower", item, i);
            double lower = qm_json_get_number(result, path);
            snprintf(path, sizeof path, "nearest.%zu.%zu.upper", item, i);
            double upper = qm_json_get_number(result, path);
            snprintf(path, sizeof path, "nearest.%zu.%zu.place", item, i);
            const char *place = qm_json_get_string(result, path);
            bool is_proven = place && strcmp(place, "proven") == 0;
            printf("  %s  %s to %s%s%s\n", files->name[(size_t)other], cli_format_bound(lower, false, low),
                   cli_format_bound(upper, true, high), is_proven ? "" : "  ", is_proven ? "" : place);
        }
    }
}

/** The pairs within the limit, then those without a verdict. */
static void print_verdicts(const file_set *files, const pair_rows *rows, double limit)
{
    for (int pass = 0; pass < 2; pass++) {
        bool has_title = false;
        for (size_t i = 0; i < rows->count; i++) {
            const double *row = rows->values + COLUMNS * i;
            bool is_within = row[3] <= limit, is_undecided = !is_within && row[2] <= limit;
            if (!(pass == 0 ? is_within : is_undecided)) continue;
            if (!has_title) puts(pass == 0 ? "within" : "undecided");
            has_title = true;
            print_pair(files, (size_t)row[0], (size_t)row[1], row);
        }
    }
}

/** The nearest and the farthest pair of a set that is too large for a table. */
static void print_extremes(const file_set *files, const pair_rows *rows)
{
    const double *nearest = rows->values, *farthest = rows->values;
    for (size_t i = 1; i < rows->count; i++) {
        const double *row = rows->values + COLUMNS * i;
        if (row[3] < nearest[3]) nearest = row;
        if (row[2] > farthest[2]) farthest = row;
    }
    puts("nearest pair");
    print_pair(files, (size_t)nearest[0], (size_t)nearest[1], nearest);
    puts("farthest pair");
    print_pair(files, (size_t)farthest[0], (size_t)farthest[1], farthest);
    puts("(-o FILE has all pairs)");
}

static void print_text(const file_set *files, const cli_job *job, const qm_json *result,
                       const pair_rows *rows)
{
    const qm_job_request *request = &job->request;
    printf("Hausdorff distances of %zu files, quads as %s\n", files->count,
           qm_json_get_string(result, "quads"));
    if (request->want == QM_MATRIX_NEAREST)
        print_lists(files, result);
    else if (request->want == QM_MATRIX_WITHIN)
        print_verdicts(files, rows, request->within);
    else if (files->count <= MAX_TABLE)
        print_table(files, rows);
    else
        print_extremes(files, rows);
    const double pair_count = qm_json_get_number(result, "pair_count");
    printf("%.0f pair%s: %.0f searched, %.0f known by bounds alone, %.1f ms\n", pair_count,
           pair_count == 1.0 ? "" : "s", qm_json_get_number(result, "searched_pairs"),
           qm_json_get_number(result, "bounded_pairs"), qm_json_get_number(result, "elapsed_ms"));
    if (request->want == QM_MATRIX_WITHIN)
        printf("%.0f within %g, %.0f beyond, %.0f undecided\n", qm_json_get_number(result, "verdicts.within"),
               request->within, qm_json_get_number(result, "verdicts.beyond"),
               qm_json_get_number(result, "verdicts.undecided"));
    if (!qm_json_is_true(result, "converged"))
        printf("stopped by %s before all of it was known; the bounds hold\n",
               qm_json_get_string(result, "stopped_by"));
}

/* ---- files ---- */

/** A name as a field of CSV (RFC 4180). */
static void write_field(FILE *file, const char *name)
{
    if (!strpbrk(name, ",\"\r\n")) {
        fputs(name, file);
        return;
    }
    fputc('"', file);
    for (; *name; name++)
        fprintf(file, *name == '"' ? "\"\"" : "%c", *name);
    fputc('"', file);
}

/** False after a report. */
static bool write_csv(const file_set *files, const pair_rows *rows, bool as_json)
{
    char number[QM_NUMBER_SIZE];
    bool is_stdout = strcmp(files->output, "-") == 0;
    FILE *file = is_stdout ? stdout : fopen(files->output, "wb");
    if (file) fputs("a,b,lower,upper\n", file);
    for (size_t i = 0; file && i < rows->count; i++) {
        const double *row = rows->values + COLUMNS * i;
        write_field(file, files->name[(size_t)row[0]]);
        fputc(',', file);
        write_field(file, files->name[(size_t)row[1]]);
        fprintf(file, ",%s", qm_text_number(row[2], number));
        fprintf(file, ",%s\n", qm_text_number(row[3], number));
    }
    bool is_written = file && !ferror(file);
    if (file && !is_stdout) is_written &= fclose(file) == 0;
    if (!is_written) cli_report_unwritable(files->output, as_json);
    return is_written;
}

/** The result with the names of the files, and with all pairs. */
static bool print_json(const file_set *files, const char *result, const pair_rows *rows)
{
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_add_members(&out, result);
    qm_json_open(&out, "files", "[");
    for (size_t i = 0; i < files->count; i++) {
        qm_json_add_comma(&out);
        qm_json_add_quoted(&out, files->path[i]);
    }
    qm_text_add_string(&out, "]");
    qm_json_open(&out, "pairs", "[");
    for (size_t i = 0; i < rows->count; i++)
        qm_json_add_array(&out, rows->values + COLUMNS * i, COLUMNS);
    qm_text_add_string(&out, "]}");
    char *text = qm_text_take(&out);
    if (text) puts(text);
    free(text);
    return text;
}

static int finish(const file_set *files, const cli_job *job, const char *json, const pair_rows *rows)
{
    qm_json *result = qm_json_parse(json);
    bool is_written = !files->output || write_csv(files, rows, job->as_json);
    /* Standard output holds either the pairs or the result. */
    bool has_stdout = files->output && strcmp(files->output, "-") == 0;
    if (job->as_json && !has_stdout)
        is_written &= print_json(files, json, rows);
    else if (is_written && !has_stdout)
        print_text(files, job, result, rows);
    bool is_whole = qm_json_is_true(result, "converged");
    qm_json_free(result);
    return !is_written ? EXIT_BAD_INPUT : is_whole ? EXIT_OK : EXIT_NOT_CONVERGED;
}

/* ---- in this process ---- */

/** A file that may be in memory. */
typedef struct loaded_file {
    qm_loaded_mesh mesh;
    bool is_loaded;
    int holds;
    size_t used; /* when it was last wanted */
} loaded_file;

/** The files of a job in this process. */
typedef struct loaded_set {
    qm_context *ctx;
    const cli_job *job;
    const file_set *files;
    loaded_file *file;
    size_t uses, bytes, limit;
    bool is_reported; /* a file cannot be read */
    bool shows;
} loaded_set;

/** Drops the files that were not wanted for the longest time, until the rest keeps to the limit. */
static void drop_files(loaded_set *set)
{
    while (set->bytes > set->limit) {
        loaded_file *oldest = NULL;
        for (size_t i = 0; i < set->files->count; i++) {
            loaded_file *file = &set->file[i];
            if (file->is_loaded && file->holds == 0 && (!oldest || file->used < oldest->used)) oldest = file;
        }
        if (!oldest) return;
        set->bytes -= qm_loaded_mesh_memory_size(&oldest->mesh);
        qm_loaded_mesh_reset(set->ctx, &oldest->mesh);
        oldest->is_loaded = false;
    }
}

static qm_status acquire(void *user, size_t index, const qm_loaded_mesh **out)
{
    loaded_set *set = user;
    loaded_file *file = &set->file[index];
    const qm_job_request *request = &set->job->request;
    file->used = ++set->uses;
    if (!file->is_loaded) {
        const qm_preparation preparation = cli_prepare(true, request->quads, request->threads);
        drop_files(set);
        file->is_loaded =
            cli_load_mesh(set->ctx, set->files->path[index], set->job->as_json, &preparation, &file->mesh);
        set->is_reported = !file->is_loaded;
        if (!file->is_loaded) return QM_E_EMPTY;
        set->bytes += qm_loaded_mesh_memory_size(&file->mesh);
    }
    file->holds++;
    *out = &file->mesh;
    return QM_OK;
}

static void release(void *user, size_t index)
{
    loaded_set *set = user;
    set->file[index].holds--;
}

static void on_pair(void *user, const qm_matrix *matrix, size_t a, size_t b)
{
    const loaded_set *set = user;
    (void)a, (void)b;
    cli_bar bar = cli_bar_make(0.0, set->job->shows_progress);
    if (bar.is_terminal || bar.is_forced)
        fprintf(stderr, "%s%zu of %zu pairs searched%s", bar.is_terminal ? "\r" : "", matrix->searched,
                matrix->pair_count, bar.is_terminal ? "\033[K" : "\n");
}

static int run_here(const cli_job *job, const file_set *files)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    loaded_set set = {.ctx = &ctx,
                      .job = job,
                      .files = files,
                      .file = calloc(files->count, sizeof *set.file),
                      .limit = qm_host_default_budget()};
    const qm_job_set shared = {acquire, release, on_pair, NULL, NULL, &set};
    qm_job_request request = job->request;
    request.set = &shared;
    request.mesh_count = files->count;
    qm_job_result result;
    int exit_status = EXIT_BAD_INPUT;
    qm_status status = set.file ? qm_job_execute(&ctx, &request, NULL, NULL, NULL, NULL, &result)
                                : qm_context_fail(&ctx, QM_E_NO_MEMORY, "out of memory");
    cli_bar bar = cli_bar_make(0.0, false);
    cli_bar_clear(&bar);
    if (status == QM_OK) {
        qm_text text = {0};
        qm_json_write_result(&text, &request, &result);
        char *json = qm_text_take(&text);
        const pair_rows rows = {result.matrix_rows, result.matrix.pair_count};
        if (json) exit_status = finish(files, job, json, &rows);
        free(json);
        qm_job_result_reset(&ctx, &result);
    } else if (!set.is_reported) {
        cli_report_status(files->path[0], status, &ctx, job->as_json);
    }
    for (size_t i = 0; set.file && i < files->count; i++)
        if (set.file[i].is_loaded) qm_loaded_mesh_reset(&ctx, &set.file[i].mesh);
    free(set.file);
    return exit_status;
}

/* ---- on a daemon ---- */

/** Fetches the rows of the job that a session has run; for free(). NULL after a report. */
static double *fetch_rows(const cli_job *job, cli_session *session, size_t count)
{
    char path[300];
    FILE *file = tmpfile();
    double *rows = malloc(count * COLUMNS * sizeof *rows);
    snprintf(path, sizeof path, "%s/result", cli_session_job_path(session));
    bool is_read = file && rows &&
                   cli_session_fetch(session, path, NULL, 0, "application/octet-stream", job->server, file);
    if (is_read) {
        rewind(file);
        is_read = fread(rows, COLUMNS * sizeof *rows, count, file) == count;
        if (!is_read) cli_print_problem(job->server, NAN, NAN, "the pairs of the result are not complete");
    }
    if (file) fclose(file);
    if (is_read) {
        qm_text_swap_bytes(rows, COLUMNS * count);
        return rows;
    }
    free(rows);
    return NULL;
}

static int run_there(const cli_job *job, const file_set *files)
{
    cli_session *session = cli_session_open(job->server, job->as_json);
    qm_job_request request = job->request;
    request.meshes = calloc(files->count, sizeof *request.meshes);
    bool is_ready = session && request.meshes;
    for (; is_ready && request.mesh_count < files->count; request.mesh_count++)
        is_ready = cli_session_upload(session, files->path[request.mesh_count], &(qm_notes){0},
                                      request.meshes[request.mesh_count].name, NULL);
    char *json = is_ready ? cli_session_run_job(session, &request, cli_bar_make(0.0, false)) : NULL;
    size_t count = files->count * (files->count - 1) / 2;
    double *values = json ? fetch_rows(job, session, count) : NULL;
    const pair_rows rows = {values, count};
    int status = values ? finish(files, job, json, &rows) : EXIT_BAD_INPUT;
    free(values);
    free(json);
    qm_job_request_reset(&request);
    cli_session_close(session);
    return status;
}

/* ---- the command ---- */

/** Names the files: by their last parts if no two are equal. */
static void name_files(file_set *files)
{
    bool are_distinct = true;
    for (size_t a = 0; a < files->count; a++) {
        files->name[a] = cli_base_name(files->path[a]);
        for (size_t b = 0; b < a; b++)
            if (strcmp(files->name[a], files->name[b]) == 0) are_distinct = false;
    }
    for (size_t a = 0; a < files->count && !are_distinct; a++)
        files->name[a] = files->path[a];
}

static int run_on_files(cli_job *job, file_set *files)
{
    name_files(files);
    if (files->output && !cli_check_writable(files->output, job->as_json)) return EXIT_BAD_INPUT;
    if (!job->server) job->request.threads = cli_count_threads(job->request.threads);
    int status = job->server ? run_there(job, files) : run_here(job, files);
    return status == EXIT_BAD_INPUT && atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : status;
}

static int run(int argc, char **argv)
{
    cli_job job = cli_job_make(QM_JOB_MATRIX);
    qm_job_request *request = &job.request;
    file_set files = {0};
    const cli_option options[] = {{.name = "output",
                                   .letter = 'o',
                                   .value = "FILE",
                                   .type = CLI_TEXT,
                                   .target = &files.output,
                                   .help = "all pairs as CSV: a,b,lower,upper (- is standard output)"},
                                  {.name = "nearest",
                                   .value = "K",
                                   .type = CLI_SIZE,
                                   .min = 1,
                                   .max = QM_JOB_MAX_NEAREST,
                                   .target = &request->nearest,
                                   .help = "only the K nearest others of each file, in proven order"},
                                  {.name = "within",
                                   .value = "T",
                                   .type = CLI_NUMBER,
                                   .target = &request->within,
                                   .help = "only whether each distance is at most T"},
                                  {.name = "limit",
                                   .value = "T",
                                   .type = CLI_NUMBER,
                                   .target = &request->within,
                                   .help = "another name of --within"},
                                  CLI_OPTION_QUADS(&request->quads),
                                  CLI_OPTION_GAP(&request->tolerance,
                                                 "width of the interval of a distance, as a fraction of the "
                                                 "largest diagonal of the boxes (default 1e-6)"),
                                  CLI_OPTION_ABSOLUTE(&request->tolerance_is_absolute),
                                  CLI_OPTION_THREADS(&request->threads),
                                  CLI_OPTION_JSON(&job.as_json),
                                  CLI_OPTION_PROGRESS(&job.shows_progress),
                                  CLI_OPTION_SERVER(&job.server)};
    const char **paths = calloc(2 * (size_t)argc, sizeof *paths);
    int status = EXIT_BAD_INPUT;
    if (paths && cli_read_options(&cmd_matrix, options, sizeof options / sizeof *options, argc, argv, paths,
                                  &status)) {
        files.path = paths;
        files.name = paths + argc;
        while (paths[files.count])
            files.count++;
        bool is_limited = !isnan(request->within);
        if (request->nearest > 0) request->want = QM_MATRIX_NEAREST;
        if (is_limited) request->want = QM_MATRIX_WITHIN;
        if (request->nearest > 0 && is_limited) {
            fputs("quadmesh: --nearest and --within ask for different things: give one of them\n", stderr);
            status = EXIT_USAGE;
        } else {
            status = run_on_files(&job, &files);
        }
    }
    free(paths);
    return status;
}

const cli_command cmd_matrix = {
    .name = "matrix",
    .arguments = "FILE FILE ... [options]",
    .summary = "the Hausdorff distances of all pairs of many files",
    .takes = "two to 1000 files",
    .path_count = 2,
    .most_paths = QM_JOB_MAX_MESHES,
    .description = "The Hausdorff distances of all pairs of files, as proven intervals. Pairs are searched "
                   "only as far\nas bounds by boxes and by other pairs leave open what is asked.\n",
    .exit_status =
        "Exit status: 0 done, 2 bad input or wrong usage, 3 stopped before all of it was known, or\n"
        "undecided.",
    .run = run};
