/**
 * json_write.h: the parts that JSON documents are written of, straight into a text.
 *
 * The text remembers when memory ran out: there is no half document that passes for a whole one. A value that
 * follows another one in its object or array is preceded by a comma, and what was written last tells whether
 * it is the first. qm_text_add_string opens and closes what has no name, and closes what qm_json_open opened.
 */
#ifndef QM_JSON_WRITE_H
#define QM_JSON_WRITE_H

#include <stdint.h>

#include "text.h"

/** A comma, unless the next value is the first of its object or array or stands after its name. */
void qm_json_add_comma(qm_text *out);

/** A string, quoted and escaped; bytes that are not UTF-8 become U+FFFD. */
void qm_json_add_quoted(qm_text *out, const char *string);

/** The name of a member, with its colon. */
void qm_json_add_name(qm_text *out, const char *name);

/** Opens an object or array as a member of the one at hand. */
void qm_json_open(qm_text *out, const char *name, const char *bracket);

/** A whole member. A word is a value that is JSON already. */
void qm_json_add_string(qm_text *out, const char *name, const char *value);
void qm_json_add_word(qm_text *out, const char *name, const char *word);
void qm_json_add_bool(qm_text *out, const char *name, bool value);
void qm_json_add_number(qm_text *out, const char *name, double value);
void qm_json_add_count(qm_text *out, const char *name, uint64_t value);
void qm_json_add_numbers(qm_text *out, const char *name, const double *values, int count);

/** Numbers as an array without a name. */
void qm_json_add_array(qm_text *out, const double *values, int count);

#endif
