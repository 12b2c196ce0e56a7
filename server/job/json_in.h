/**
 * json_in.h: reads job requests from JSON into checked structs.
 */
#ifndef QM_JSON_IN_H
#define QM_JSON_IN_H

#include "mesh/meshes.h"
#include "ops/job_kinds.h"
#include "ops/problem.h"

/**
 * Reads a job request. Unknown fields, wrong types and values out of range are errors with a pointer each.
 *
 * Returns true and fills *out, which is the caller's for qm_job_request_reset; or false and fills *problem
 * (400; 422 for values that are known but not available yet; 507).
 */
bool qm_json_read_job(const char *text, size_t size, qm_job_request *out, qm_problem *problem);

/**
 * Reads a line of a batch, a job request that may have a key: a string of up to QM_JSON_MAX_KEY bytes, or a
 * number. It is added to key as JSON, whether the rest is valid or not; null when there is none.
 */
#define QM_JSON_MAX_KEY 255
bool qm_json_read_batch_line(const char *text, size_t size, qm_text *key, qm_job_request *out,
                             qm_problem *problem);

/** Reads the body of a change of a job: its labels from now on, for free(); NULL is none. False with a problem (400, 507). */
bool qm_json_read_labels(const char *text, size_t size, char **out, qm_problem *problem);

#endif
