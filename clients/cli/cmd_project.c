#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "remote.h"

static const char usage[] =
    "usage: quadmesh project MESH POINTS -o OUT [options]\n"
    "\n"
    "  -o, --output OUT  where the rows go, one for each point in the order of POINTS; - is standard output\n"
    "  --format F        what POINTS is: text (x y z on a line, the default) or f64 (little-endian float64,\n"
    "                    the default for names that end in .f64 or .bin)\n"
    "  --csv             distance, x, y, z, face, u, v as numbers: the default for names that end in .csv, "
    "and -\n"
    "  --binary          the same as little-endian float64: the default for other names\n"
    "  --json            one document, the default for names that end in .json; faults are documents too\n"
    "  --quads R         how quads are read: triangles (default) or bilinear\n"
    "  --threads N       threads (default: one for each processor; with --server what the daemon gives)\n"
    "  --accelerator A   of nearest points: auto (default), boxes, tetra or grid\n"
    "  --server URL      ask a daemon instead of this process\n"
    "\n"
    "Exit status: 0 done, 1 bad input, 2 wrong usage, 3 interrupted.\n";

typedef enum point_format { FORMAT_BY_NAME, FORMAT_TEXT, FORMAT_F64 } point_format;

/** Everything that was asked for. */
typedef struct question {
    const char *mesh, *points, *output;
    const char *server; /* NULL: in this process */
    point_format format;
    bool has_rows;
    qm_rows rows;
    bool as_json;
    qm_quad_reading quads;
    qm_accelerator accelerator;
    int threads;
} question;

static bool ends_in(const char *path, const char *end)
{
    size_t length = strlen(path), size = strlen(end);
    return length >= size && strcmp(path + length - size, end) == 0;
}

/* ---- points ---- */

typedef struct point_list {
    double *rows; /* on malloc */
    size_t count;
} point_list;

static bool read_binary(const question *asked, uint8_t *bytes, size_t size, point_list *out)
{
    *out = (point_list){(double *)(void *)bytes, size / (3 * sizeof(double))};
    if (size % (3 * sizeof(double)) != 0) {
        qm_problem problem = qm_problem_make(
            QM_PROBLEM_MALFORMED_FILE, "has %zu bytes, which is no multiple of the 24 of a point", size);
        cli_complain(asked->points, &problem, asked->as_json);
        return false;
    }
    qm_rows_turn_bytes(out->rows, 3 * out->count);
    size_t bad = qm_projections_find_bad(out->rows, 3 * out->count);
    if (bad == 3 * out->count) return true;
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_NOT_FINITE, "point %zu has a coordinate that is not finite", bad / 3);
    qm_problem_add_offset(&problem, bad * sizeof(double), "is not a finite number");
    cli_complain(asked->points, &problem, asked->as_json);
    return false;
}

static bool read_text(const question *asked, const uint8_t *bytes, size_t size, point_list *out)
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
    cli_complain(asked->points, &problem, asked->as_json);
    return false;
}

/** False after words or a problem; the rows are the caller's all the same. */
static bool read_points(const question *asked, point_list *out)
{
    size_t size;
    uint8_t *bytes = cli_read_file(asked->points, &size, asked->as_json);
    *out = (point_list){0};
    if (!bytes) return false;
    bool is_binary =
        asked->format == FORMAT_F64 || (asked->format == FORMAT_BY_NAME &&
                                        (ends_in(asked->points, ".f64") || ends_in(asked->points, ".bin")));
    if (is_binary) return read_binary(asked, bytes, size, out);
    bool good = read_text(asked, bytes, size, out);
    free(bytes);
    return good;
}

/* ---- in this process ---- */

static void complain(const question *asked, qm_status status, const char *message)
{
    qm_problem problem = qm_problem_from_status(status, message);
    cli_complain(asked->mesh, &problem, asked->as_json);
}

/** A mesh and what it is searched with. */
typedef struct target {
    qm_loaded_mesh mesh;
    qm_locator locator;
} target;

static bool write_block(const question *asked, qm_context *ctx, const target *on, const point_list *points,
                        size_t first, qm_text *text, FILE *out)
{
    size_t rest = points->count - first, count = rest < QM_PROJECTIONS_BLOCK ? rest : QM_PROJECTIONS_BLOCK;
    qm_projections feet;
    qm_status status = qm_projections_find(ctx, &on->mesh, &on->locator, asked->quads,
                                           points->rows + 3 * first, count, asked->threads, &feet);
    if (status == QM_OK) {
        qm_projections_write(text, asked->rows, &feet, on->mesh.diagonal, first == 0);
        qm_projections_reset(ctx, &feet);
        if (text->failed) status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the rows");
    }
    if (status != QM_OK) {
        complain(asked, status, ctx->message);
        return false;
    }
    fwrite(text->data, 1, text->size, out);
    text->size = 0;
    return true;
}

static bool write_rows(const question *asked, qm_context *ctx, const target *on, const point_list *points,
                       FILE *out)
{
    qm_text text = {0};
    bool good = true;
    qm_projections_write_begin(&text, asked->rows);
    for (size_t first = 0; good && first < points->count; first += QM_PROJECTIONS_BLOCK)
        good = write_block(asked, ctx, on, points, first, &text, out);
    qm_projections_write_end(&text, asked->rows);
    if (good && text.size > 0) fwrite(text.data, 1, text.size, out);
    qm_text_reset(&text);
    return good;
}

static bool project_here(const question *asked, const point_list *points, FILE *out)
{
    qm_context ctx = qm_host_context();
    ctx.cancel = &cli_interrupted;
    qm_preparation preparation = cli_prepare(true, asked->quads, asked->threads);
    target on;
    if (!cli_load_mesh(&ctx, asked->mesh, asked->as_json, &preparation, &on.mesh)) return false;
    qm_status status = qm_locator_build(&ctx, on.mesh.bvh, NULL, asked->accelerator, &on.locator);
    if (status != QM_OK) complain(asked, status, ctx.message);
    bool good = status == QM_OK && write_rows(asked, &ctx, &on, points, out);
    qm_locator_reset(&ctx, &on.locator);
    qm_loaded_mesh_reset(&ctx, &on.mesh);
    return good;
}

/* ---- by a daemon ---- */

static bool project_there(const question *asked, point_list *points, FILE *out)
{
    static const char *const media[] = {"application/octet-stream", "text/csv", "application/json"};
    cli_talk *talk = cli_talk_open(asked->server, asked->as_json);
    char id[QM_ID_SIZE], path[160], threads[24] = "";
    if (asked->threads > 0) snprintf(threads, sizeof threads, "&threads=%d", asked->threads);
    bool good = talk && cli_talk_upload(talk, asked->mesh, id, NULL);
    if (good) {
        snprintf(path, sizeof path, "/v1/meshes/%s/project?quads=%s&accelerator=%s%s", id,
                 qm_quads_names[asked->quads], qm_accelerator_names[asked->accelerator], threads);
        qm_rows_turn_bytes(points->rows, 3 * points->count);
        good = cli_talk_fetch(talk, path, points->count > 0 ? (const void *)points->rows : "",
                              points->count * 3 * sizeof(double), media[asked->rows], asked->points, out);
    }
    cli_talk_close(talk);
    return good;
}

/* ---- the command ---- */

static int fail_to_write(const question *asked)
{
    fprintf(stderr, "quadmesh: %s cannot be written\n", asked->output);
    return EXIT_BAD_INPUT;
}

static int project(const question *asked)
{
    point_list points;
    bool is_stdout = strcmp(asked->output, "-") == 0;
    bool good = read_points(asked, &points);
    FILE *out = !good ? NULL : is_stdout ? stdout : fopen(asked->output, "wb");
    int status = EXIT_BAD_INPUT;
    if (good && !out) {
        status = fail_to_write(asked);
    } else if (good) {
        good = asked->server ? project_there(asked, &points, out) : project_here(asked, &points, out);
        bool written = !ferror(out);
        if (!is_stdout) written &= fclose(out) == 0;
        if (good && written) status = EXIT_OK;
        if (good && !written) status = fail_to_write(asked);
        /* Half an answer is not to be taken for one. */
        if (status != EXIT_OK && !is_stdout) remove(asked->output);
    }
    free(points.rows);
    return status == EXIT_BAD_INPUT && atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : status;
}

static bool read_format(const char *text, point_format *out)
{
    if (strcmp(text, "text") == 0) return *out = FORMAT_TEXT, true;
    if (strcmp(text, "f64") == 0) return *out = FORMAT_F64, true;
    fprintf(stderr, "quadmesh: --format takes text or f64, got \"%s\"\n", text);
    return false;
}

static bool set_rows(question *asked, qm_rows rows)
{
    asked->rows = rows;
    return asked->has_rows = true;
}

enum { FORMAT = 256, CSV, BINARY, JSON, QUADS, ACCELERATOR, THREADS, SERVER, HELP };

static bool read_option(question *asked, int option)
{
    switch (option) {
    case 'o':
        return asked->output = optarg, true;
    case FORMAT:
        return read_format(optarg, &asked->format);
    case CSV:
        return set_rows(asked, QM_ROWS_CSV);
    case BINARY:
        return set_rows(asked, QM_ROWS_BINARY);
    case JSON:
        return asked->as_json = set_rows(asked, QM_ROWS_JSON);
    case QUADS:
        return cli_read_quads(optarg, &asked->quads);
    case ACCELERATOR:
        return cli_read_accelerator(optarg, &asked->accelerator);
    case THREADS:
        return cli_read_threads(optarg, &asked->threads);
    case SERVER:
        return asked->server = optarg, true;
    default:
        return false;
    }
}

int cmd_project(int argc, char **argv)
{
    static const struct option options[] = {{"output", required_argument, NULL, 'o'},
                                            {"format", required_argument, NULL, FORMAT},
                                            {"csv", no_argument, NULL, CSV},
                                            {"binary", no_argument, NULL, BINARY},
                                            {"json", no_argument, NULL, JSON},
                                            {"quads", required_argument, NULL, QUADS},
                                            {"accelerator", required_argument, NULL, ACCELERATOR},
                                            {"threads", required_argument, NULL, THREADS},
                                            {"server", required_argument, NULL, SERVER},
                                            {"help", no_argument, NULL, HELP},
                                            {0}};
    question asked = {0};
    for (int option; (option = getopt_long(argc, argv, "o:", options, NULL)) != -1;) {
        if (option == HELP) return fputs(usage, stdout), EXIT_OK;
        if (!read_option(&asked, option)) return fputs(usage, stderr), EXIT_USAGE;
    }
    if (argc - optind != 2 || !asked.output) {
        fprintf(stderr, "quadmesh: project takes a mesh, a file of points and -o OUT\n\n");
        return fputs(usage, stderr), EXIT_USAGE;
    }
    asked.mesh = argv[optind];
    asked.points = argv[optind + 1];
    if (!asked.has_rows)
        asked.rows = ends_in(asked.output, ".json")                                    ? QM_ROWS_JSON
                     : ends_in(asked.output, ".csv") || strcmp(asked.output, "-") == 0 ? QM_ROWS_CSV
                                                                                       : QM_ROWS_BINARY;
    if (!asked.server) asked.threads = cli_count_threads(asked.threads);
    return project(&asked);
}
