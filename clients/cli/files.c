/**
 * files.c: reads and checks files, loads meshes, and reports problems with them.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/json.h"
#include "cli.h"
#include "format/encoder.h"

const char *cli_base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

bool cli_path_ends_in(const char *path, const char *end)
{
    size_t length = strlen(path), size = strlen(end);
    return length >= size && strcmp(path + length - size, end) == 0;
}

/** The line of a problem, or its offset; NAN where it has none. */
static double place_of(const qm_problem *problem, bool is_offset)
{
    if (problem->error_count == 0) return NAN;
    size_t place = is_offset ? problem->errors[0].offset : problem->errors[0].line;
    return place == QM_NO_LOCATION ? NAN : (double)place;
}

/** What stands between a path and what is wrong: the line, the offset, or nothing of the two. */
#define PLACE_SIZE 48
static const char *format_place(double line, double offset, char out[PLACE_SIZE])
{
    if (!isnan(line))
        snprintf(out, PLACE_SIZE, ":%.0f:", line);
    else if (!isnan(offset))
        snprintf(out, PLACE_SIZE, ": byte %.0f:", offset);
    else
        snprintf(out, PLACE_SIZE, ":");
    return out;
}

void cli_format_problem(char *out, size_t size, const char *path, const qm_problem *problem)
{
    char place[PLACE_SIZE];
    snprintf(out, size, "%s%s %s", path,
             format_place(place_of(problem, false), place_of(problem, true), place), problem->detail);
}

void cli_report(const char *path, const qm_problem *problem, bool as_json)
{
    if (as_json) {
        qm_text text = {0};
        qm_json_write_problem(&text, problem);
        char *document = qm_text_take(&text);
        puts(document ? document : "{}");
        free(document);
        return;
    }
    cli_print_problem(path, place_of(problem, false), place_of(problem, true), problem->detail);
}

void cli_report_status(const char *path, qm_status status, const qm_context *ctx, bool as_json)
{
    qm_problem problem = qm_problem_from_status(status, ctx->message);
    cli_report(path, &problem, as_json);
}

void cli_print_problem(const char *path, double line, double offset, const char *detail)
{
    char place[PLACE_SIZE];
    fprintf(stderr, "quadmesh: %s%s %s\n", path, format_place(line, offset, place), detail);
}

/** Reads to the end of the file, whose size is only expected: standard input may be a pipe. */
static uint8_t *read_all(FILE *file, size_t expected, size_t *size)
{
    size_t capacity = expected + 1;
    uint8_t *bytes = malloc(capacity);
    *size = 0;
    while (bytes) {
        *size += fread(bytes + *size, 1, capacity - *size, file);
        if (*size < capacity) break;
        uint8_t *larger = realloc(bytes, 2 * capacity);
        if (!larger) free(bytes);
        bytes = larger;
        capacity *= 2;
    }
    return bytes;
}

/** Reads a file; NULL with a problem if it cannot be read. */
static uint8_t *read_file(const char *path, size_t *size, qm_problem *problem)
{
    struct stat info;
    bool is_stdin = strcmp(path, "-") == 0;
    FILE *file = is_stdin ? stdin : fopen(path, "rb");
    uint8_t *bytes = NULL;
    errno = file ? 0 : errno;
    if (file && fstat(fileno(file), &info) == 0 && S_ISDIR(info.st_mode)) errno = EISDIR;
    /* A device may never end. */
    if (errno == 0 && !is_stdin && (S_ISCHR(info.st_mode) || S_ISBLK(info.st_mode))) errno = ENOTSUP;
    if (errno == 0) bytes = read_all(file, S_ISREG(info.st_mode) ? (size_t)info.st_size : 4096, size);
    if (!bytes || ferror(file)) {
        *problem =
            qm_problem_make(QM_PROBLEM_NOT_FOUND, "cannot be read: %s", strerror(errno ? errno : ENOMEM));
        free(bytes);
        bytes = NULL;
    }
    if (file && !is_stdin) fclose(file);
    return bytes;
}

/** Standard input, which comes once, and is asked for again by some commands: to align and then compare, or to hash. */
static struct {
    uint8_t *bytes;
    size_t size;
} input;

uint8_t *cli_try_file(const char *path, size_t *size, qm_problem *problem)
{
    if (strcmp(path, "-") != 0) return read_file(path, size, problem);
    if (!input.bytes) input.bytes = read_file(path, &input.size, problem);
    if (!input.bytes) return NULL;
    *size = input.size;
    uint8_t *copy = malloc(input.size + 1);
    if (copy)
        memcpy(copy, input.bytes, input.size);
    else
        *problem = qm_problem_make(QM_PROBLEM_NOT_FOUND, "cannot be read: %s", strerror(ENOMEM));
    return copy;
}

uint8_t *cli_read_file(const char *path, size_t *size, bool as_json)
{
    qm_problem problem;
    uint8_t *bytes = cli_try_file(path, size, &problem);
    if (!bytes) cli_report(path, &problem, as_json);
    return bytes;
}

bool cli_write_file(const char *path, const char *bytes, size_t size)
{
    bool is_stdout = strcmp(path, "-") == 0;
    FILE *file = is_stdout ? stdout : fopen(path, "wb");
    if (!file) return false;
    bool is_written = fwrite(bytes, 1, size, file) == size;
    return (is_stdout ? fflush(file) : fclose(file)) == 0 && is_written;
}

void cli_report_unwritable(const char *path, bool as_json)
{
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_UNAVAILABLE, "cannot be written: %s", strerror(errno ? errno : ENOMEM));
    cli_report(path, &problem, as_json);
}

bool cli_check_writable(const char *path, bool as_json)
{
    struct stat info;
    if (strcmp(path, "-") == 0) return true;
    bool is_folder = stat(path, &info) == 0 && S_ISDIR(info.st_mode);
    if (!is_folder && access(path, W_OK) == 0) return true;
    if (is_folder) errno = EISDIR;
    if (errno == ENOENT) {
        size_t size = (size_t)(cli_base_name(path) - path);
        char *folder = size > 0 ? strndup(path, size) : strdup(".");
        bool is_writable = folder && access(folder, W_OK | X_OK) == 0;
        free(folder);
        if (is_writable) return true;
    }
    cli_report_unwritable(path, as_json);
    return false;
}

/** Standard output while what else is printed goes to standard error; NULL: it is as it was. */
static FILE *document;

bool cli_check_one_document(const char *const *paths, int count, bool as_json)
{
    int on_stdout = as_json;
    for (int i = 0; i < count; i++)
        on_stdout += paths[i] && strcmp(paths[i], "-") == 0;
    if (on_stdout <= 1) return true;
    fputs("quadmesh: standard output holds one document: give a file for the others\n", stderr);
    return false;
}

int cli_settle_outputs(const char *const *paths, int count, bool as_json)
{
    bool has_file = false;
    if (!cli_check_one_document(paths, count, as_json)) return EXIT_USAGE;
    for (int i = 0; i < count; i++) {
        if (!paths[i]) continue;
        if (!cli_check_writable(paths[i], as_json)) return EXIT_BAD_INPUT;
        has_file |= strcmp(paths[i], "-") == 0;
    }
    if (!has_file) return EXIT_OK;
    int copy = dup(STDOUT_FILENO);
    document = copy >= 0 ? fdopen(copy, "wb") : NULL;
    if (document && dup2(STDERR_FILENO, STDOUT_FILENO) >= 0) return EXIT_OK;
    cli_report_unwritable("-", as_json);
    return EXIT_BAD_INPUT;
}

FILE *cli_open_output(const char *path, bool as_json)
{
    FILE *file = strcmp(path, "-") == 0 ? document : fopen(path, "wb");
    if (!file) cli_report_unwritable(path, as_json);
    return file;
}

bool cli_close_output(FILE *file, const char *path, bool as_json)
{
    bool is_written = !ferror(file);
    if (file == document) document = NULL;
    if (fclose(file) == 0 && is_written) return true;
    cli_report_unwritable(path, as_json);
    return false;
}

qm_format cli_format_of(const char *path)
{
    qm_format format = qm_format_from_path(path);
    return format == QM_FORMAT_UNKNOWN ? QM_FORMAT_PLY : format;
}

bool cli_check_uv(const char *path)
{
    qm_format format = cli_format_of(path);
    if (qm_encoder_holds_uv(format)) return true;
    fprintf(stderr, "quadmesh: --uv goes with obj, ply and glb, not with %s\n", qm_format_name(format));
    return false;
}

/** Lays the patches of a mesh out. */
static qm_status make_atlas(qm_context *ctx, const qm_mesh *mesh, const qm_mesh_facts *facts,
                            qm_uv_atlas *out)
{
    qm_patch_set patches;
    qm_mesh gridless = *mesh;
    if (!facts->manifold) gridless.grid_count = 0; /* as when it is read: grids do not show a third face */
    qm_status status = qm_patch_set_find(ctx, &gridless, &patches);
    if (status == QM_OK) status = qm_uv_atlas_make(ctx, mesh, &patches, out);
    qm_patch_set_reset(ctx, &patches);
    return status;
}

bool cli_write_mesh(qm_context *ctx, const char *path, const qm_mesh *mesh, bool has_uv, bool as_json)
{
    qm_mesh_facts facts;
    qm_encoder *encoder = NULL;
    qm_uv_atlas atlas = {0};
    qm_status status = qm_mesh_find_facts(ctx, mesh, &facts);
    if (status == QM_OK && has_uv) status = make_atlas(ctx, mesh, &facts, &atlas);
    if (status == QM_OK)
        status =
            qm_encoder_create(ctx, mesh, &facts, cli_format_of(path), 0, has_uv ? &atlas : NULL, &encoder);
    if (status != QM_OK) {
        qm_uv_atlas_reset(ctx, &atlas);
        cli_report_status(path, status, ctx, as_json);
        return false;
    }
    FILE *out = strcmp(path, "-") == 0 ? stdout : fopen(path, "wb");
    bool is_written = out != NULL, goes_on = is_written;
    while (goes_on) {
        qm_text block = {0};
        goes_on = qm_encoder_next(encoder, &block);
        is_written = is_written && !block.failed && fwrite(block.data, 1, block.size, out) == block.size;
        qm_text_reset(&block);
    }
    if (out && out != stdout && fclose(out) != 0) is_written = false;
    qm_encoder_destroy(encoder);
    qm_uv_atlas_reset(ctx, &atlas);
    if (is_written) return true;
    cli_report_unwritable(path, as_json);
    return false;
}

/* ---- poses ---- */

/** The number i of the transform of a document; NAN: there is none. */
static double transform_number(const qm_json *json, int i)
{
    char path[32];
    snprintf(path, sizeof path, qm_json_has(json, "transform") ? "transform.%d" : "%d", i);
    return qm_json_get_number(json, path);
}

void cli_get_transform(const qm_json *result, double transform[QM_TRANSFORM_SIZE])
{
    for (int i = 0; i < QM_TRANSFORM_SIZE; i++)
        transform[i] = transform_number(result, i);
}

static bool read_transform(const char *path, double transform[QM_TRANSFORM_SIZE], bool as_json)
{
    size_t size;
    uint8_t *bytes = cli_read_file(path, &size, as_json);
    if (!bytes) return false;
    char *text = strndup((const char *)bytes, size);
    free(bytes);
    qm_json *json = text ? qm_json_parse(text) : NULL;
    free(text);
    qm_context ctx = qm_context_make();
    qm_status status = QM_OK;
    bool has_all = json && isnan(transform_number(json, QM_TRANSFORM_SIZE));
    for (int i = 0; i < QM_TRANSFORM_SIZE && has_all; i++) {
        transform[i] = transform_number(json, i);
        has_all = !isnan(transform[i]);
    }
    if (!has_all)
        status = qm_context_fail(&ctx, QM_E_FORMAT,
                                 "it has no transform: 16 numbers, alone or as \"transform\" of an object");
    if (status == QM_OK) status = qm_transform_check(&ctx, transform);
    qm_json_free(json);
    if (status != QM_OK) cli_report_status(path, status, &ctx, as_json);
    return status == QM_OK;
}

bool cli_read_pose(const char *path, qm_job_pose *pose, bool as_json)
{
    if (!read_transform(path, pose->transform, as_json)) return false;
    pose->is_given = !qm_transform_is_identity(pose->transform);
    return true;
}

/* ---- meshes ---- */

qm_preparation cli_prepare(bool is_target, qm_quad_reading quads, int threads)
{
    qm_bvh_parts target = quads == QM_QUADS_BILINEAR ? QM_BVH_ALL : QM_BVH_TARGET;
    return (qm_preparation){.parts = is_target ? target : QM_BVH_SOURCE, .thread_count = threads};
}

static bool load_mesh(qm_context *ctx, const char *path, const qm_preparation *preparation,
                      qm_loaded_mesh *out, qm_problem *problem)
{
    size_t size;
    *out = (qm_loaded_mesh){0};
    uint8_t *bytes = cli_try_file(path, &size, problem);
    if (!bytes) return false;
    char *folder = strndup(path, (size_t)(cli_base_name(path) - path));
    const qm_codec_limits limits = {.max_vertices = QM_NO_INDEX - 1,
                                    .max_faces = QM_NO_INDEX - 1,
                                    .thread_count = preparation->thread_count,
                                    .folder = folder};
    qm_codec_report report;
    qm_status status = qm_mesh_read(ctx, qm_format_from_path(path), bytes, size, &limits, out, &report);
    free(bytes);
    free(folder);
    if (status == QM_OK) status = qm_mesh_make_ready(ctx, preparation, out, &report);
    if (status != QM_OK) *problem = qm_problem_from_codec(status, &report);
    return status == QM_OK;
}

bool cli_load_mesh(qm_context *ctx, const char *path, bool as_json, const qm_preparation *preparation,
                   qm_loaded_mesh *out)
{
    qm_problem problem;
    bool is_loaded = load_mesh(ctx, path, preparation, out, &problem);
    if (!is_loaded) cli_report(path, &problem, as_json);
    return is_loaded;
}

/** The task of loading two files. */
typedef struct load_pair {
    const qm_context *ctx;
    const char *const *path;
    qm_preparation preparation[2];
    qm_loaded_mesh *mesh;
    qm_problem problem[2];
    bool is_loaded[2];
} load_pair;

static void load_one(void *data, int worker)
{
    load_pair *pair = data;
    qm_context ctx = *pair->ctx; /* for a message of its own */
    pair->is_loaded[worker] = load_mesh(&ctx, pair->path[worker], &pair->preparation[worker],
                                        &pair->mesh[worker], &pair->problem[worker]);
}

/** Gives each of two files that are loaded at the same time threads in proportion to its size, one at least. */
static void share_threads(load_pair *pair)
{
    struct stat info;
    double size[2], threads = pair->preparation[0].thread_count;
    for (int i = 0; i < 2; i++)
        size[i] = stat(pair->path[i], &info) == 0 ? (double)info.st_size : 0.0;
    for (int i = 0; i < 2; i++) {
        int share = (int)(threads * size[i] / fmax(size[0] + size[1], 1.0) + 0.5);
        pair->preparation[i].thread_count = share > 1 ? share : 1;
    }
}

int cli_try_pair(qm_context *ctx, const char *const path[2], const qm_preparation preparation[2],
                 qm_loaded_mesh mesh[2], qm_problem *problem)
{
    load_pair pair = {
        .ctx = ctx, .path = path, .preparation = {preparation[0], preparation[1]}, .mesh = mesh};
    mesh[0] = mesh[1] = (qm_loaded_mesh){0};
    if (preparation[0].thread_count > 1) {
        share_threads(&pair);
        qm_context_parallel(ctx, 2, load_one, &pair);
    } else {
        load_one(&pair, 0);
        if (pair.is_loaded[0]) load_one(&pair, 1);
    }
    for (int i = 0; i < 2; i++) {
        if (pair.is_loaded[i]) continue;
        *problem = pair.problem[i];
        cli_unload_pair(ctx, mesh);
        return i;
    }
    return -1;
}

bool cli_load_pair(qm_context *ctx, const char *const path[2], bool as_json,
                   const qm_preparation preparation[2], qm_loaded_mesh mesh[2])
{
    qm_problem problem;
    int failed = cli_try_pair(ctx, path, preparation, mesh, &problem);
    if (failed >= 0) cli_report(path[failed], &problem, as_json);
    return failed < 0;
}

void cli_unload_pair(qm_context *ctx, qm_loaded_mesh mesh[2])
{
    qm_loaded_mesh_reset(ctx, &mesh[1]);
    qm_loaded_mesh_reset(ctx, &mesh[0]);
}
