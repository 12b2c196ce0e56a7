/**
 * json_value.h: values of the requests that are about layouts. The first fault is the problem, and ends the
 * reading: everything here returns false with one.
 */
#ifndef QM_JSON_VALUE_H
#define QM_JSON_VALUE_H

#include "json_fault.h"
#include "json_layout.h"

/** Sets an invalid field; the pointer is a printf format with up to two numbers. */
bool qm_json_refuse(qm_problem *problem, const char *words, const char *format, size_t i, size_t k);

bool qm_json_lack_memory(qm_problem *problem);

/** Refuses members that are not in the list, which NULL ends. */
bool qm_json_check_names(const struct cJSON *object, const char *const *known, qm_problem *problem);

/** A whole number of 0 or more that an id may be, and exactly so many numbers; they leave the words to the
 * caller. */
bool qm_json_read_index(const struct cJSON *value, uint32_t *out);
bool qm_json_read_numbers(const struct cJSON *value, int count, double *out);

/** Rows of so many numbers in the member of a name, at least so many; malloc'ed. */
bool qm_json_read_table(const struct cJSON *value, int width, size_t least, const char *name, double **out,
                        size_t *count, qm_problem *problem);

/** The id of a layout or mesh in the member of a name. */
bool qm_json_read_id(const struct cJSON *object, const char *name, char out[QM_ID_SIZE], qm_problem *problem);

#endif
