#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli.h"

const char *cli_base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

void cli_complain(const char *path, const qm_problem *problem, bool as_json)
{
    if (as_json) {
        qm_text text = {0};
        qm_json_write_problem(&text, problem);
        char *document = qm_text_take(&text);
        puts(document ? document : "{}");
        free(document);
        return;
    }
    const qm_problem_error *error = problem->error_count > 0 ? &problem->errors[0] : NULL;
    cli_print_problem(path, error && error->line != QM_NO_PLACE ? (double)error->line : NAN,
                      error && error->offset != QM_NO_PLACE ? (double)error->offset : NAN, problem->detail);
}

void cli_print_problem(const char *path, double line, double offset, const char *detail)
{
    if (!isnan(line))
        fprintf(stderr, "quadmesh: %s:%.0f: %s\n", path, line, detail);
    else if (!isnan(offset))
        fprintf(stderr, "quadmesh: %s: byte %.0f: %s\n", path, offset, detail);
    else
        fprintf(stderr, "quadmesh: %s: %s\n", path, detail);
}

/** Standard input may be a pipe, so that the size is not asked for before reading. */
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

/** NULL, and the problem, for a file that cannot be read. */
static uint8_t *read_file(const char *path, size_t *size, qm_problem *problem)
{
    struct stat facts;
    bool is_stdin = strcmp(path, "-") == 0;
    FILE *file = is_stdin ? stdin : fopen(path, "rb");
    uint8_t *bytes = NULL;
    errno = file ? 0 : errno;
    if (file && fstat(fileno(file), &facts) == 0 && S_ISDIR(facts.st_mode)) errno = EISDIR;
    /* A device may never end. */
    if (errno == 0 && !is_stdin && (S_ISCHR(facts.st_mode) || S_ISBLK(facts.st_mode))) errno = ENOTSUP;
    if (errno == 0) bytes = read_all(file, S_ISREG(facts.st_mode) ? (size_t)facts.st_size : 4096, size);
    if (!bytes || ferror(file)) {
        *problem =
            qm_problem_make(QM_PROBLEM_NOT_FOUND, "cannot be read: %s", strerror(errno ? errno : ENOMEM));
        free(bytes);
        bytes = NULL;
    }
    if (file && !is_stdin) fclose(file);
    return bytes;
}

uint8_t *cli_read_file(const char *path, size_t *size, bool as_json)
{
    qm_problem problem;
    uint8_t *bytes = read_file(path, size, &problem);
    if (!bytes) cli_complain(path, &problem, as_json);
    return bytes;
}

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
    uint8_t *bytes = read_file(path, &size, problem);
    if (!bytes) return false;
    const qm_codec_limits limits = {.max_vertices = QM_NO_INDEX - 1,
                                    .max_faces = QM_NO_INDEX - 1,
                                    .thread_count = preparation->thread_count};
    qm_codec_report report;
    qm_status status = qm_mesh_read(ctx, qm_format_from_path(path), bytes, size, &limits, out, &report);
    free(bytes);
    if (status == QM_OK) status = qm_mesh_make_ready(ctx, preparation, out, &report);
    if (status != QM_OK) *problem = qm_problem_from_codec(status, &report);
    return status == QM_OK;
}

bool cli_load_mesh(qm_context *ctx, const char *path, bool as_json, const qm_preparation *preparation,
                   qm_loaded_mesh *out)
{
    qm_problem problem;
    bool good = load_mesh(ctx, path, preparation, out, &problem);
    if (!good) cli_complain(path, &problem, as_json);
    return good;
}

/** Two files that are loaded at the same time. */
typedef struct load_pair {
    const qm_context *ctx;
    const char *const *path;
    const qm_preparation *preparation;
    qm_loaded_mesh *mesh;
    qm_problem problem[2];
    bool good[2];
} load_pair;

static void load_one(void *data, int worker)
{
    load_pair *pair = data;
    qm_context ctx = *pair->ctx; /* with words of its own */
    pair->good[worker] = load_mesh(&ctx, pair->path[worker], &pair->preparation[worker], &pair->mesh[worker],
                                   &pair->problem[worker]);
}

bool cli_load_pair(qm_context *ctx, const char *const path[2], bool as_json,
                   const qm_preparation preparation[2], qm_loaded_mesh mesh[2])
{
    load_pair pair = {.ctx = ctx, .path = path, .preparation = preparation, .mesh = mesh};
    mesh[0] = mesh[1] = (qm_loaded_mesh){0};
    bool is_one_pipe = strcmp(path[0], "-") == 0 && strcmp(path[1], "-") == 0;
    if (preparation[0].thread_count > 1 && !is_one_pipe) {
        qm_context_parallel(ctx, 2, load_one, &pair);
    } else {
        load_one(&pair, 0);
        if (pair.good[0]) load_one(&pair, 1);
    }
    for (int i = 0; i < 2; i++) {
        if (pair.good[i]) continue;
        cli_complain(path[i], &pair.problem[i], as_json);
        cli_unload_pair(ctx, mesh);
        return false;
    }
    return true;
}

void cli_unload_pair(qm_context *ctx, qm_loaded_mesh mesh[2])
{
    qm_loaded_mesh_reset(ctx, &mesh[1]);
    qm_loaded_mesh_reset(ctx, &mesh[0]);
}
