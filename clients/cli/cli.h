/**
 * cli.h: what the parts of the command line share.
 */
#ifndef QM_CLI_H
#define QM_CLI_H

#include <stdatomic.h>

#include "ops/job_names.h"
#include "ops/json_out.h"

enum { EXIT_OK = 0, EXIT_BAD_INPUT = 1, EXIT_USAGE = 2, EXIT_NOT_CONVERGED = 3, EXIT_COLLIDING = 4 };

/** Set by the first SIGINT: searches stop with the bounds they have. */
extern atomic_bool cli_interrupted;

int cmd_hausdorff(int argc, char **argv);
int cmd_deviation(int argc, char **argv);
int cmd_project(int argc, char **argv);
int cmd_collide(int argc, char **argv);
int cmd_self_collide(int argc, char **argv);
int cmd_distance(int argc, char **argv);
int cmd_info(int argc, char **argv);
int cmd_patches(int argc, char **argv);
int cmd_reconstruct(int argc, char **argv);

/** Reads a whole file. NULL after words on stderr, or a problem on stdout when as_json. Free with free(). */
uint8_t *cli_read_file(const char *path, size_t *size, bool as_json);

/** True for "-", and for a file that may be written or made; false after words. Asked before work that would
 * be in vain. */
bool cli_check_writable(const char *path, bool as_json);

/** Loads a mesh file for questions in this process. False after words or a problem as above. */
bool cli_load_mesh(qm_context *ctx, const char *path, bool as_json, const qm_preparation *preparation,
                   qm_loaded_mesh *out);

/** The same for two files, of which the words of the first bad one are told. With two threads or more they
 * are loaded at the same time. For cli_unload_pair after success. */
bool cli_load_pair(qm_context *ctx, const char *const path[2], bool as_json,
                   const qm_preparation preparation[2], qm_loaded_mesh mesh[2]);
void cli_unload_pair(qm_context *ctx, qm_loaded_mesh mesh[2]);

/** What a mesh is made ready for that is searched for nearest points, or else that only has its points
 * measured. */
qm_preparation cli_prepare(bool is_target, qm_quad_reading quads, int threads);

/** The threads that were asked for, or else one for each processor. */
int cli_count_threads(int asked);

/** Tells of a problem: words on stderr with the file's name, or the document on stdout. */
void cli_complain(const char *path, const qm_problem *problem, bool as_json);

/** The words of a problem on stderr; line and offset are NAN when there is none. */
void cli_print_problem(const char *path, double line, double offset, const char *detail);

/** The part of a path after the last slash. */
const char *cli_base_name(const char *path);

/**
 * How the bounds close in, on stderr: one line that is drawn over on a terminal; elsewhere a line for each
 * step when it was asked for, else nothing.
 */
typedef struct cli_bar {
    bool is_terminal, is_asked_for;
    double first_gap; /* of the first finite bracket; 0 before it */
    double tolerance;
} cli_bar;
cli_bar cli_bar_make(double tolerance, bool is_asked_for);
void cli_bar_show(cli_bar *bar, double lower, double upper, double elapsed_ms, double iterations);
void cli_bar_clear(const cli_bar *bar);

/** A bound in 9 digits, rounded down or up, so that the bracket printed holds the one computed. Returns
 * out. */
#define CLI_BOUND_SIZE 32
char *cli_format_bound(double bound, bool is_upper, char out[CLI_BOUND_SIZE]);

/** Options that several commands have: each reads its value, or says on stderr what it should be. */
bool cli_read_number(const char *name, const char *text, double least, double *out);
bool cli_read_choice(const char *name, const char *text, const char *const *choices, int *out);
bool cli_read_quads(const char *text, qm_quad_reading *out);
bool cli_read_threads(const char *text, int *out);
bool cli_read_accelerator(const char *text, qm_accelerator *out);

/** Prints the result object of a Hausdorff job (JSON text) as it is, or in words. Returns the exit status
 * that goes with it. */
int cli_print_result(const char *json, bool as_json);

#endif
