/**
 * json_request.h: reads the JSON of requests: the object of a body, its values, and reports of invalid ones. Only files
 * that read requests include it.
 *
 * Two ways to report: qm_json_report collects the faults of all members in one problem; qm_json_reject is for readers
 * that end at the first one.
 */
#ifndef QM_JSON_REQUEST_H
#define QM_JSON_REQUEST_H

#include "base/id.h"
#include "problem.h"
#include "qm/transform.h"

struct cJSON;

/** Parses the body of a request. Returns its object, for cJSON_Delete; or NULL with a problem (400), which calls it by
 * `noun` ("a job"). */
struct cJSON *qm_json_parse_object(const char *text, size_t size, const char *noun, qm_problem *problem);

/* ---- values: false for a value of another form ---- */

/** A finite number. */
bool qm_json_read_number(const struct cJSON *value, double *out);

/** Reads the noise of a surface: "automatic", which becomes QM_NOISE_AUTOMATIC, or a number from 0 to 0.1. False if it is none. */
bool qm_json_read_noise(const struct cJSON *value, double *out);

/** Finds the noise among the members of a reconstruction's document; 0 for those that are older than it, which were made so. False
 * when there is no memory to read them. */
bool qm_json_find_noise(const char *members, double *out);

/** An integer from min to max. */
bool qm_json_read_integer(const struct cJSON *value, double min, double max, double *out);

/** The same as a size. */
bool qm_json_read_count(const struct cJSON *value, double min, double max, size_t *out);

/** The index of a string in a NULL-ended list, or -1. */
int qm_json_find_name(const struct cJSON *value, const char *const *names);

/** An integer that may be an index or an id: 0 to 2^31 - 1. */
bool qm_json_read_index(const struct cJSON *value, uint32_t *out);

/** An array of exactly count finite numbers. */
bool qm_json_read_numbers(const struct cJSON *value, int count, double *out);

/* ---- reports ---- */

/** Where in a member a value is invalid: array indices, outermost first, and among them a member of what is there. */
typedef struct qm_json_location {
    const char *member; /* NULL: none */
    int member_depth;   /* indices before it */
    char detail[128];   /* what is wrong there; "": what the reader of the member says */
    int depth;
    size_t index[2];
    bool no_memory; /* the value may be valid, but memory ran out */
} qm_json_location;

/**
 * Reads an array of points, each of three finite numbers. *points must be NULL and *count 0; *points is malloc'ed
 * unless the array is empty, and is the caller's to free on failure, too. Returns false with the location of the fault.
 */
bool qm_json_read_points(const struct cJSON *value, double **points, size_t *count, qm_json_location *at);

/**
 * Adds a fault at a location in a member, or that memory ran out there. The problem as a whole takes its code and
 * message from its first fault; an invalid value overrides a failed allocation, because the request would be rejected
 * with more memory, too.
 */
void qm_json_report_at(qm_problem *problem, const char *name, const qm_json_location *at,
                       const char *message);

/** Adds a fault of a member as a whole. */
void qm_json_report(qm_problem *problem, const char *name, const char *message);

/** Reads a transform (qm/transform.h): 16 numbers, column by column, that move a mesh. False with the location of the fault. */
bool qm_json_read_transform(const struct cJSON *value, double out[QM_TRANSFORM_SIZE], qm_json_location *at);

/** Sets *problem to one fault and returns false; the pointer is a printf format with up to two indices. */
bool qm_json_reject(qm_problem *problem, const char *message, const char *format, size_t i, size_t k);

/* ---- members: false with a problem ---- */

/** Whether a member of the object before this one has its name: which of the two is meant? */
bool qm_json_is_repeated(const struct cJSON *object, const struct cJSON *member);

/** Rejects members that are not in the list, which NULL ends. */
bool qm_json_check_members(const struct cJSON *object, const char *const *known, qm_problem *problem);

/** Reads the array of at least min_count records of width finite numbers in the member called name; malloc'ed. */
bool qm_json_read_table(const struct cJSON *value, int width, size_t min_count, const char *name,
                        double **out, size_t *count, qm_problem *problem);

/** Reads the id of a layout or mesh in the member called name. */
bool qm_json_read_id(const struct cJSON *object, const char *name, char out[QM_ID_SIZE], qm_problem *problem);

/** Reads `deadline_ms` of a request, a number above 0; *out is 0 where it is absent. False with a problem. */
bool qm_json_read_deadline(const struct cJSON *object, double *out, qm_problem *problem);

#endif
