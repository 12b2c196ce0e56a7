/**
 * remote.h: a conversation with a daemon: files are uploaded, questions asked, answers read as they come.
 * Whatever goes wrong is told at once: words on stderr, or a problem document on stdout when asked for JSON.
 */
#ifndef QM_REMOTE_H
#define QM_REMOTE_H

#include <stdio.h>

#include "cli.h"

typedef struct cli_talk cli_talk;

/** NULL, with words, when memory runs out. */
cli_talk *cli_talk_open(const char *server, bool as_json);
void cli_talk_close(cli_talk *talk);

/** Uploads a file, writes its id, and the diagonal of its box unless that is NULL. */
bool cli_talk_upload(cli_talk *talk, const char *path, char id[QM_ID_SIZE], double *diagonal);

/**
 * Runs a job to its end and returns the result object as the daemon wrote it, for the caller to free; NULL
 * when there is none. bar shows the bounds on the way. An interrupt stops the job.
 */
char *cli_talk_run_job(cli_talk *talk, const qm_job_request *request, cli_bar bar);

/** Posts bytes, or gets when they are NULL, and writes the answer to a file as it comes. path_told names what
 * is at fault in words. */
bool cli_talk_fetch(cli_talk *talk, const char *path, const void *bytes, size_t size, const char *media,
                    const char *path_told, FILE *out);

/** The path of the job that ran last, "" when none did. */
const char *cli_talk_job_path(const cli_talk *talk);

#endif
