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

uint8_t *cli_read_file(const char *path, size_t *size, bool as_json)
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
        qm_problem problem =
            qm_problem_make(QM_PROBLEM_NOT_FOUND, "cannot be read: %s", strerror(errno ? errno : ENOMEM));
        cli_complain(path, &problem, as_json);
        free(bytes);
        bytes = NULL;
    }
    if (file && !is_stdin) fclose(file);
    return bytes;
}

qm_preparation cli_prepare(bool is_target, qm_quad_reading quads, int threads)
{
    qm_bvh_parts target = quads == QM_QUADS_BILINEAR ? QM_BVH_ALL : QM_BVH_TARGET;
    return (qm_preparation){.parts = is_target ? target : QM_BVH_SOURCE, .thread_count = threads};
}

bool cli_load_mesh(qm_context *ctx, const char *path, bool as_json, const qm_preparation *preparation,
                   qm_loaded_mesh *out)
{
    size_t size;
    uint8_t *bytes = cli_read_file(path, &size, as_json);
    if (!bytes) return false;
    const qm_codec_limits limits = {.max_vertices = QM_NO_INDEX - 1, .max_faces = QM_NO_INDEX - 1};
    qm_codec_report report;
    qm_status status =
        qm_mesh_load(ctx, qm_format_from_path(path), bytes, size, &limits, preparation, out, &report);
    free(bytes);
    if (status == QM_OK) return true;
    qm_problem problem = qm_problem_from_codec(status, &report);
    cli_complain(path, &problem, as_json);
    return false;
}
