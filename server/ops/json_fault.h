/**
 * json_fault.h: values of JSON trees, and words for what is wrong with them. For the files that read requests
 * only.
 */
#ifndef QM_JSON_FAULT_H
#define QM_JSON_FAULT_H

#include "problem.h"

struct cJSON;

/** Where in an array a value is at fault: the places of its entries from the outside in. */
typedef struct qm_json_fault {
    int depth;
    size_t index[2];
    bool no_memory; /* nothing is wrong but that */
} qm_json_fault;

/** A finite number. */
bool qm_json_read_number(const struct cJSON *value, double *out);

/** A whole number from least to greatest. */
bool qm_json_read_whole(const struct cJSON *value, double least, double greatest, double *out);

/** Rows of three finite numbers, malloc'ed unless there are none; false with the place. *rows is to be freed
 * in either case. */
bool qm_json_read_rows(const struct cJSON *value, double **rows, size_t *row_count, qm_json_fault *at);

/**
 * Adds what is wrong at a place in a member, or that memory ran out there. The problem as a whole takes code
 * and words from its first fault; one that is plainly invalid takes over from one of memory, as the request
 * would stay refused.
 */
void qm_json_complain_of(qm_problem *problem, const char *name, const qm_json_fault *at, const char *words);

/** The same of a member as a whole. */
void qm_json_complain(qm_problem *problem, const char *name, const char *words);

#endif
