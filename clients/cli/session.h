/**
 * session.h: a connection to a daemon, which uploads files, runs jobs, and reads streamed results. Failures are reported
 * as by cli_report.
 */
#ifndef QM_CLI_SESSION_H
#define QM_CLI_SESSION_H

#include <stdio.h>

#include "cli.h"

/** NULL after a report if libcurl cannot be loaded or memory runs out. */
cli_session *cli_session_open(const char *server, bool as_json);
void cli_session_close(cli_session *session);

/** Uploads a file; writes the id of its mesh, and the diagonal of its box unless that is NULL. */
bool cli_session_upload(cli_session *session, const char *path, char id[QM_ID_SIZE], double *diagonal);

/**
 * Runs a job to its end and returns the result object as the daemon wrote it, for the caller to free; NULL after a
 * report. bar shows intermediate bounds. An interrupt stops the job.
 */
char *cli_session_run_job(cli_session *session, const qm_job_request *request, cli_bar bar);

/** Posts bytes, or gets if they are NULL, and writes the response to a file as it arrives. Reports name subject. */
bool cli_session_fetch(cli_session *session, const char *path, const void *bytes, size_t size,
                       const char *media, const char *subject, FILE *out);

/** The path of the last job, "" if there is none. */
const char *cli_session_job_path(const cli_session *session);

#endif
