/**
 * json_job_fields.h: the members that a job request may have, as a table. For json_in.c only.
 */
#ifndef QM_JSON_JOB_FIELDS_H
#define QM_JSON_JOB_FIELDS_H

#include "ops/job_kinds.h"
#include "ops/json_fault.h"

/** One field of a job: reads the value, or says what it should be and where in it the fault lies. */
typedef struct qm_json_field {
    const char *name;
    unsigned kinds, required; /* a bit for each kind that has it, and that must have it */
    bool (*read)(const struct cJSON *value, qm_job_request *out);
    bool (*read_list)(const struct cJSON *value, qm_job_request *out,
                      qm_json_fault *at); /* for arrays, in place of read */
    const char *expected;
} qm_json_field;

#define QM_JSON_FIELD_COUNT 28
extern const qm_json_field qm_json_job_fields[QM_JSON_FIELD_COUNT];

/** The field that a kind of job, given as its bit, has under this name, or NULL. */
const qm_json_field *qm_json_find_field(const char *name, unsigned kind);

#endif
