/**
 * json_read.h: members of JSON objects by name, for those who read what a daemon has written.
 */
#ifndef QM_JSON_READ_H
#define QM_JSON_READ_H

#include <stdbool.h>
#include <stddef.h>

typedef struct qm_json qm_json;

/** Parses one document; NULL when it is none. */
qm_json *qm_json_parse(const char *text);
void qm_json_free(qm_json *json);

/**
 * A member by a path of names with dots ("witness.from.face"). A number is a place in an array; without one
 * the first entry is meant. Numbers: NAN when absent; strings: NULL.
 */
double qm_json_get_number(const qm_json *json, const char *path);
const char *qm_json_get_string(const qm_json *json, const char *path);
bool qm_json_is_true(const qm_json *json, const char *path);
bool qm_json_has(const qm_json *json, const char *path);

#endif
