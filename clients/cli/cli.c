#include "cli.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_out.h"

#define FIRST_CAPACITY (1u << 16)

static atomic_bool interrupted;

static void on_interrupt(int number)
{
    (void)number;
    atomic_store(&interrupted, true);
}

const atomic_bool *qm_cli_catch_interrupt(void)
{
    struct sigaction action = {.sa_handler = on_interrupt, .sa_flags = (int)SA_RESETHAND};
    sigaction(SIGINT, &action, NULL);
    return &interrupted;
}

/** Reads to the end into a block that doubles, so that pipes work as files do. False: errno tells. */
static bool read_all(FILE *file, qm_cli_file *out)
{
    size_t capacity = 0;
    for (;;) {
        if (out->size == capacity) {
            capacity = capacity ? 2 * capacity : FIRST_CAPACITY;
            uint8_t *bytes = realloc(out->bytes, capacity);
            if (!bytes) return false;
            out->bytes = bytes;
        }
        size_t count = fread(out->bytes + out->size, 1, capacity - out->size, file);
        out->size += count;
        if (count == 0) return !ferror(file);
    }
}

bool qm_cli_read_file(const char *path, qm_cli_file *out, qm_problem *problem)
{
    const char *slash = strrchr(path, '/');
    bool is_stdin = strcmp(path, "-") == 0;
    *out = (qm_cli_file){.path = path, .name = slash ? slash + 1 : path};
    errno = 0;
    FILE *file = is_stdin ? stdin : fopen(path, "rb");
    bool is_read = file && read_all(file, out);
    if (!is_read) {
        qm_problem_code code = errno == ENOMEM ? QM_PROBLEM_OUT_OF_MEMORY : QM_PROBLEM_NOT_FOUND;
        *problem = qm_problem_make(code, "%s: %s", path, strerror(errno));
        free(out->bytes);
        out->bytes = NULL;
    }
    if (file && !is_stdin) fclose(file);
    return is_read;
}

void qm_cli_name_file(qm_problem *problem, const char *path)
{
    char detail[sizeof problem->detail];
    memcpy(detail, problem->detail, sizeof detail);
    int used = snprintf(problem->detail, sizeof problem->detail, "%s: ", path);
    if (used >= 0 && (size_t)used < sizeof problem->detail)
        snprintf(problem->detail + used, sizeof problem->detail - (size_t)used, "%s", detail);
}

bool qm_cli_load(qm_context *ctx, const char *path, qm_loaded_mesh *out, qm_problem *problem)
{
    static const qm_codec_limits limits = {.max_vertices = QM_NO_INDEX - 1, .max_faces = QM_NO_INDEX - 1};
    qm_cli_file file;
    if (!qm_cli_read_file(path, &file, problem)) return false;
    qm_codec_report report;
    qm_status status =
        qm_mesh_load(ctx, qm_format_from_path(path), file.bytes, file.size, &limits, out, &report);
    free(file.bytes);
    if (status == QM_OK) return true;
    *problem = qm_problem_from_codec(status, &report);
    qm_cli_name_file(problem, path);
    return false;
}

bool qm_cli_print(qm_text *text)
{
    qm_text_add_string(text, "\n");
    bool is_written = !text->failed && fwrite(text->data, 1, text->size, stdout) == text->size;
    qm_text_reset(text);
    return fflush(stdout) == 0 && is_written;
}

qm_exit qm_cli_fail(const qm_problem *problem, bool as_json)
{
    if (as_json) {
        qm_text text = {0};
        qm_json_write_problem(&text, problem);
        if (qm_cli_print(&text)) return QM_EXIT_INPUT;
    }
    fprintf(stderr, "quadmesh: %s", problem->detail);
    if (problem->error_count == 1 && problem->errors[0].line != QM_NO_PLACE)
        fprintf(stderr, " (line %zu)", problem->errors[0].line);
    if (problem->error_count == 1 && problem->errors[0].offset != QM_NO_PLACE)
        fprintf(stderr, " (byte %zu)", problem->errors[0].offset);
    fputc('\n', stderr);
    return QM_EXIT_INPUT;
}
