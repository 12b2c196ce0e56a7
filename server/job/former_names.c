/**
 * former_names.c: the former names of members, in place: none is shorter than the name of today.
 */
#include "former_names.h"

#include <stddef.h>
#include <string.h>

/** A text with its quotes and its colon is no part of a string, where a quote follows a backslash. */
static const struct {
    const char *former, *today;
} names[] = {{"\"tolerance\":", "\"gap\":"},
             {"\"tolerance_unit\":", "\"gap_unit\":"},
             {"\"threshold\":", "\"limit\":"},
             {"\"stopped_by\":\"threshold\"", "\"stopped_by\":\"limit\""}};
enum { NAMES = sizeof names / sizeof *names };

void qm_former_names_replace(char *json)
{
    char *to = json ? strchr(json, '"') : NULL, *next = to;
    for (const char *from = to; from; from = next) {
        size_t i = 0;
        while (i < NAMES && strncmp(from, names[i].former, strlen(names[i].former)) != 0)
            i++;
        if (i < NAMES) {
            memmove(to, names[i].today, strlen(names[i].today));
            to += strlen(names[i].today);
            from += strlen(names[i].former);
        } else {
            *to++ = *from++;
        }
        next = strchr(from, '"');
        size_t rest = next ? (size_t)(next - from) : strlen(from) + 1;
        memmove(to, from, rest);
        to += rest;
    }
}
