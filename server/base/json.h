/**
 * json.h: JSON text, written and read. Requests are read in ops/json_request.h, which adds error reports.
 *
 * Writing appends to a text (text.h), which records a failed allocation: an incomplete document is never taken for a
 * complete one. A value that follows another one in its object or array is preceded by a comma; the last character
 * written shows whether it is the first one. qm_text_add_string writes the brackets of unnamed values, and closes what
 * qm_json_open opened.
 */
#ifndef QM_JSON_H
#define QM_JSON_H

#include <stdint.h>

#include "text.h"

struct cJSON;
struct qm_budget;

/* ---- writing ---- */

/** A comma, unless the next value is the first of its object or array or follows its name. */
void qm_json_add_comma(qm_text *out);

/** A string, quoted and escaped; bytes that are not UTF-8 become U+FFFD. */
void qm_json_add_quoted(qm_text *out, const char *string);

/** The name of a member, with its colon. */
void qm_json_add_name(qm_text *out, const char *name);

/** Opens an object or array as a member of the current object. */
void qm_json_open(qm_text *out, const char *name, const char *bracket);

/** A complete member. A word is a value that is already JSON; times in milliseconds get three decimals. */
void qm_json_add_string(qm_text *out, const char *name, const char *value);
void qm_json_add_word(qm_text *out, const char *name, const char *word);
void qm_json_add_bool(qm_text *out, const char *name, bool value);
void qm_json_add_number(qm_text *out, const char *name, double value);
void qm_json_add_ms(qm_text *out, const char *name, double ms);
void qm_json_add_count(qm_text *out, const char *name, uint64_t value);
void qm_json_add_numbers(qm_text *out, const char *name, const double *values, int count);

/** The members of an object that this program has written as text, to continue it with others. */
void qm_json_add_members(qm_text *out, const char *object);

/** Numbers as an array without a name. */
void qm_json_add_array(qm_text *out, const double *values, int count);

/* ---- reading ---- */

#define QM_JSON_MAX_DEPTH 16

/**
 * True for UTF-8 that nests no deeper than QM_JSON_MAX_DEPTH (the parser recurses) and contains no escaped NUL (the
 * parser would truncate the string there); else the offset of the first fault and a message.
 */
bool qm_json_check_text(const char *text, size_t size, size_t *offset, const char **message);

/**
 * Sets the budget of all trees of this process: they may use a share of it, which they reserve, and a tree that does
 * not fit is a failed allocation. A tree can be forty times as large as its text. NULL, as at the start: no limit. Call
 * it while there is no tree.
 */
void qm_json_set_budget(struct qm_budget *budget);

/** Bytes that all trees use now, for tests. */
size_t qm_json_measure(void);

/**
 * Parses the value at the start of the text, for cJSON_Delete; NULL on failure. *end is the first byte after the
 * value, or the fault; *no_memory is set when memory ran out and the text may be valid.
 */
struct cJSON *qm_json_parse_tree(const char *text, size_t size, const char **end, bool *no_memory);

/** A parsed document, for code that reads what a daemon has written. */
typedef struct qm_json qm_json;

/** Parses one document; NULL if it is invalid. */
qm_json *qm_json_parse(const char *text);
void qm_json_free(qm_json *json);

/**
 * Returns a member by a path of names with dots ("witness.from.face"). A number is an index into an array; a name
 * applied to an array means its first entry. Absent numbers are NAN, absent strings NULL.
 */
double qm_json_get_number(const qm_json *json, const char *path);
const char *qm_json_get_string(const qm_json *json, const char *path);
bool qm_json_is_true(const qm_json *json, const char *path);
bool qm_json_has(const qm_json *json, const char *path);

#endif
