/**
 * json_parse.h: JSON text to the library's tree, with the difference between bad text and no memory. For the
 * files that know the library only.
 */
#ifndef QM_JSON_PARSE_H
#define QM_JSON_PARSE_H

#include <stdbool.h>
#include <stddef.h>

struct cJSON;

/** The tree of the value that the text begins with, for cJSON_Delete; NULL when there is none. *end is where
 * it ends, or where the fault lies; *no_memory tells that the text is not to blame. */
struct cJSON *qm_json_parse_tree(const char *text, size_t size, const char **end, bool *no_memory);

#endif
