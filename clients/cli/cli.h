/**
 * cli.h: what the commands share: files, problems, progress, and jobs in this process or on a daemon.
 */
#ifndef QM_CLI_H
#define QM_CLI_H

#include <stdatomic.h>
#include <stdio.h>

#include "base/json.h"
#include "ops/json_out.h"
#include "report/report.h"

/** As those of diff, grep and cmp: NO is the other answer, beyond a limit or colliding; 2 is trouble of any kind. */
enum { EXIT_OK = 0, EXIT_NO = 1, EXIT_BAD_INPUT = 2, EXIT_USAGE = 2, EXIT_NOT_CONVERGED = 3 };

/** Set by the first SIGINT: searches stop with the bounds reached so far. */
extern atomic_bool cli_interrupted;

/* ---- problems ---- */

/** Reports a problem with a file: a line on stderr, or the problem document on stdout. */
void cli_report(const char *path, const qm_problem *problem, bool as_json);

/** Reports the status of a failed call of the engine, with the context's message. */
void cli_report_status(const char *path, qm_status status, const qm_context *ctx, bool as_json);

/** The same line as text: the path, the place in the file where it is known, and what is wrong. */
void cli_format_problem(char *out, size_t size, const char *path, const qm_problem *problem);

/** Prints a problem as a line on stderr; line and offset are NAN if unknown. */
void cli_print_problem(const char *path, double line, double offset, const char *detail);

/* ---- files (files.c) ---- */

/** The part of a path after the last slash. */
const char *cli_base_name(const char *path);
bool cli_path_ends_in(const char *path, const char *end);

/** Reads a whole file, for free(). "-" is standard input. NULL after a report. */
uint8_t *cli_read_file(const char *path, size_t *size, bool as_json);

/** The same with a problem instead of a report. */
uint8_t *cli_try_file(const char *path, size_t *size, qm_problem *problem);

/** True for "-", and for a file that can be written or created; false after a report. Called before long work whose
 * output would be lost. */
bool cli_check_writable(const char *path, bool as_json);

/** Whether at most one of the result object of --json and these files, of which NULL is none, goes to standard output; false after
 * a message. */
bool cli_check_one_document(const char *const *paths, int count, bool as_json);

/**
 * Sees before long work that files can be written, of which NULL is none. "-" is standard output, which holds one document: that
 * file, or the result object of --json; whatever else a command prints goes to standard error then. EXIT_OK, or a status
 * after a report.
 */
int cli_settle_outputs(const char *const *paths, int count, bool as_json);

/** Opens a file that was settled. NULL after a report. */
FILE *cli_open_output(const char *path, bool as_json);

/** Closes it; false after a report when something could not be written. */
bool cli_close_output(FILE *file, const char *path, bool as_json);

/** Writes a whole file, "-" for standard output; false with errno. */
bool cli_write_file(const char *path, const char *bytes, size_t size);

/** Reports that a file cannot be written, with errno as the reason. */
void cli_report_unwritable(const char *path, bool as_json);

/** The preparation of a mesh: as a target, on which nearest points are searched, or as a source of points only. */
qm_preparation cli_prepare(bool is_target, qm_quad_reading quads, int threads);

/** Loads a mesh file; false after a report. */
bool cli_load_mesh(qm_context *ctx, const char *path, bool as_json, const qm_preparation *preparation,
                   qm_loaded_mesh *out);

/** Loads two mesh files, for cli_unload_pair. Returns -1, or the index of the first invalid one, with its problem. */
int cli_try_pair(qm_context *ctx, const char *const path[2], const qm_preparation preparation[2],
                 qm_loaded_mesh mesh[2], qm_problem *problem);

/** Loads two mesh files, at the same time if there are two threads or more, for cli_unload_pair. False after a report of
 * the first invalid one. */
bool cli_load_pair(qm_context *ctx, const char *const path[2], bool as_json,
                   const qm_preparation preparation[2], qm_loaded_mesh mesh[2]);
void cli_unload_pair(qm_context *ctx, qm_loaded_mesh mesh[2]);

/** The format of the name's end; PLY without one. */
qm_format cli_format_of(const char *path);

/** Writes a mesh in the format of its name, with the texture coordinates of its patches or without; "-" is standard output. False
 * after a report. */
bool cli_write_mesh(qm_context *ctx, const char *path, const qm_mesh *mesh, bool has_uv, bool as_json);

/** Whether the format of a name holds texture coordinates; false after a message. */
bool cli_check_uv(const char *path);

/** Reads a pose from a JSON file: an object with "transform", as align writes, or the 16 numbers alone. It is not given where these
 * move nothing. False after a report. */
bool cli_read_pose(const char *path, qm_job_pose *pose, bool as_json);

/** The transform in the result of an alignment. */
void cli_get_transform(const qm_json *result, double transform[QM_TRANSFORM_SIZE]);

/* ---- progress (jobs.c) ---- */

/** A bound in so many digits, or in 9, rounded outward, so that the printed interval contains the computed one. Returns
 * out. */
#define CLI_BOUND_SIZE 32
char *cli_format_digits(double bound, bool is_upper, int digits, char out[CLI_BOUND_SIZE]);
char *cli_format_bound(double bound, bool is_upper, char out[CLI_BOUND_SIZE]);

/** A bound of a share in percent, in 6 digits, rounded outward. Returns out. */
char *cli_format_percent(double share, bool is_upper, char out[CLI_BOUND_SIZE]);

/** A progress bar on stderr: on a terminal one line that is redrawn; elsewhere, if is_forced, a line for each step. */
typedef struct cli_bar {
    bool is_terminal, is_forced;
    double first_gap; /* of the first finite interval; 0 before it */
    double tolerance;
} cli_bar;
cli_bar cli_bar_make(double tolerance, bool is_forced);
void cli_bar_show(cli_bar *bar, double lower, double upper, double elapsed_ms, double iterations);
/** Shows in its place what a remeshing does, of how many quads, and the distance of the last mesh, 0 before it is known. */
void cli_bar_tell(const cli_bar *bar, const char *work, double quads, double upper);
void cli_bar_clear(const cli_bar *bar);

/* ---- jobs (jobs.c) ---- */

typedef struct cli_session cli_session;

/** A job and how to run it. */
typedef struct cli_job {
    const char *path[2];   /* the second is NULL for a kind of one mesh */
    const char *server;    /* NULL: in this process */
    bool aligns;           /* the first is moved onto the second before, as `quadmesh align` does */
    const char *transform; /* a file with the transform of the first; NULL: it stays where it is */
    qm_job_request request;
    bool as_json, shows_progress;
} cli_job;

cli_job cli_job_make(qm_job_kind kind);

/** Adds the bands between and beyond signed limits, of which NAN is none, with a sign if there is none yet; false when there is no
 * room for them, after a report. */
bool cli_add_limit_bands(double limit_in, double limit_out, qm_job_request *request);

/** The outcome of a job. In this process the meshes (the second one is NULL for a kind of one) and the result are set; with
 * a daemon the session. */
typedef struct cli_job_output {
    const char *json; /* the result object */
    const qm_loaded_mesh *mesh[2];
    const qm_job_result *result;
    cli_session *session;
} cli_job_output;

/** Prints and writes the outcome of a job; returns the exit status. */
typedef int cli_finish_fn(const void *user, const cli_job *job, const cli_job_output *output);

/** Loads the meshes, runs the job, and calls finish with its outcome. Returns the exit status. */
int cli_run_job(const cli_job *job, cli_finish_fn *finish, const void *user);

/** Prints what a result says of the true surfaces, of the figure with this prefix ("" or "max."), and its warnings. */
void cli_print_notes(const qm_json *result, const char *prefix);

/* ---- reports (cmd_report.c) ---- */

/** Sets what a report shows of a comparison: its percentiles, and how many of the worst places. */
void cli_ask_for_report(qm_job_request *request);

/** The hash of a file; NULL where it cannot be read. */
const char *cli_hash_file(const char *path, char out[QM_HASH_SIZE]);

/* ---- sessions (session.c) ----
 *
 * A connection to a daemon, which uploads files, runs jobs, and reads streamed results. Failures are reported as by
 * cli_report.
 */

/** NULL after a report if libcurl cannot be loaded or memory runs out. */
cli_session *cli_session_open(const char *server, bool as_json);
void cli_session_close(cli_session *session);

/** From now on problems are not reported but kept here; NULL: they are reported again. */
void cli_session_keep_problems(cli_session *session, qm_problem *out);

/** Uploads a file with notes, of which unset ones are the file's; writes the id of its mesh, and the diagonal of its box
 * unless that is NULL. */
bool cli_session_upload(cli_session *session, const char *path, const qm_notes *notes, char id[QM_ID_SIZE],
                        double *diagonal);

/**
 * Runs a job to its end and returns the result object as the daemon wrote it, for the caller to free; NULL after a
 * report. bar shows intermediate bounds. An interrupt stops the job.
 */
char *cli_session_run_job(cli_session *session, const qm_job_request *request, cli_bar bar);

/** Posts bytes, or gets if they are NULL, and writes the response to a file as it arrives. Reports name subject. */
bool cli_session_fetch(cli_session *session, const char *path, const void *bytes, size_t size,
                       const char *media, const char *subject, FILE *out);

/** Fetches the array of the result of the last job, for free; false after a report that names server, and *numbers may be NULL. */
bool cli_session_fetch_numbers(cli_session *session, const char *server, double **numbers, size_t *count);

/** Appends the report of the last job, a comparison, to out; limits and a range that are NAN are not given. False after a report of
 * what is wrong. */
bool cli_session_fetch_report(cli_session *session, const qm_report_limits *limits, double range,
                              qm_text *out);

/** The path of the last job, "" if there is none. */
const char *cli_session_job_path(const cli_session *session);

/* ---- pictures (picture.c) ---- */

/** Draws the mesh shaded, with its edges, from the side that shows most of it. False with errno if the file cannot be
 * written or memory runs out. */
bool cli_write_picture(const char *path, const qm_mesh *mesh);

#endif
