/**
 * json_check.h: what a JSON parser must not be shown, found in the plain text.
 */
#ifndef QM_JSON_CHECK_H
#define QM_JSON_CHECK_H

#include <stdbool.h>
#include <stddef.h>

#define QM_JSON_MAX_DEPTH 16

/**
 * True for UTF-8 that nests no deeper than QM_JSON_MAX_DEPTH (the parser recurses) and holds no escaped NUL
 * (the parser would cut the string off there); else the byte of the first fault and words for it.
 */
bool qm_json_check_text(const char *text, size_t size, size_t *place, const char **words);

#endif
