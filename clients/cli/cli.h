/**
 * cli.h: what the commands of `quadmesh` share: exit statuses, input files, the interrupt, and how faults and
 * results are told.
 */
#ifndef QM_CLI_H
#define QM_CLI_H

#include "job_kinds.h"
#include "problem.h"

typedef enum qm_exit {
    QM_EXIT_OK = 0,
    QM_EXIT_INPUT = 1,        /* a file or an answer of the daemon is at fault; a problem document tells it */
    QM_EXIT_USAGE = 2,        /* the command line is at fault */
    QM_EXIT_NOT_CONVERGED = 3 /* the bracket is valid but wider than was asked for */
} qm_exit;

/** The commands; argv[0] is what messages begin with. */
qm_exit qm_cli_hausdorff(int argc, char **argv);
qm_exit qm_cli_info(int argc, char **argv);

/** Bytes of a whole file, malloc'ed. A path of "-" is standard input. */
typedef struct qm_cli_file {
    const char *path; /* as the user gave it */
    const char *name; /* after the last slash */
    uint8_t *bytes;
    size_t size;
} qm_cli_file;

/** False with a problem that names the path. On success free(out->bytes). */
bool qm_cli_read_file(const char *path, qm_cli_file *out, qm_problem *problem);

/** Decodes and prepares a file; the format goes by the end of its name, else by its bytes. False with a
 * problem that names the path. */
bool qm_cli_load(qm_context *ctx, const char *path, qm_loaded_mesh *out, qm_problem *problem);

/** Puts the path before a problem's words, so that a reader of two files knows which one is meant. */
void qm_cli_name_file(qm_problem *problem, const char *path);

/** Raised by the first SIGINT; the second one ends the program. */
const atomic_bool *qm_cli_catch_interrupt(void);

/** Writes the text and a line end to stdout; false when memory ran out or it cannot be written. */
bool qm_cli_print(qm_text *text);

/** Tells a problem: the document on stdout when as_json, else words on stderr. Returns QM_EXIT_INPUT. */
qm_exit qm_cli_fail(const qm_problem *problem, bool as_json);

#endif
