#include "json_check.h"

#include <string.h>

#include "utf8.h"

/**
 * The place where nesting goes too deep, or size. Looked for before the parser sees the text, because it
 * recurses. Brackets inside strings do not count.
 */
static size_t find_too_deep(const char *text, size_t size)
{
    int depth = 0;
    bool in_string = false;
    for (size_t i = 0; i < size; i++) {
        char c = text[i];
        if (in_string) {
            if (c == '\\') i++;
            if (c == '"') in_string = false;
        } else if (c == '"') {
            in_string = true;
        } else if (c == '{' || c == '[') {
            if (++depth > QM_JSON_MAX_DEPTH) return i;
        } else if (c == '}' || c == ']') {
            depth--;
        }
    }
    return size;
}

/** The place of the first byte that is not UTF-8, or size. */
static size_t find_bad_utf8(const char *text, size_t size)
{
    for (size_t i = 0; i < size;) {
        size_t length = qm_utf8_length(text + i, size - i);
        if (length == 0) return i;
        i += length;
    }
    return size;
}

/** The place of an escaped NUL, where the parser would cut the string off, or size. */
static size_t find_escaped_nul(const char *text, size_t size)
{
    for (size_t i = 0; i + 1 < size; i++) {
        if (text[i] != '\\') continue;
        if (size - i >= 6 && memcmp(text + i, "\\u0000", 6) == 0) return i;
        i++;
    }
    return size;
}

bool qm_json_check_text(const char *text, size_t size, size_t *place, const char **words)
{
    if ((*place = find_bad_utf8(text, size)) < size)
        *words = "the body is not UTF-8";
    else if ((*place = find_too_deep(text, size)) < size)
        *words = "the JSON is nested too deep";
    else if ((*place = find_escaped_nul(text, size)) < size)
        *words = "a string holds a NUL character";
    else
        return true;
    return false;
}
