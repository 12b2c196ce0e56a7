/**
 * media.c: media types, and the choice among them by Accept.
 */
#include "media.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define BLANK " \t"

/** How closely a range names a type. */
typedef enum closeness { NOT_AT_ALL, ANYTHING, GROUP, EXACTLY } closeness;

static closeness compare(const char *range, size_t length, const char *type)
{
    size_t group = strcspn(type, "/") + 1;
    if (length == strlen(type) && strncasecmp(range, type, length) == 0) return EXACTLY;
    if (length == group + 1 && strncasecmp(range, type, group) == 0 && range[group] == '*') return GROUP;
    return length == 3 && strncmp(range, "*/*", 3) == 0 ? ANYTHING : NOT_AT_ALL;
}

/** The range or type at the start of an element: without blanks and parameters. */
static size_t trim(const char **text)
{
    *text += strspn(*text, BLANK);
    return strcspn(*text, ";," BLANK);
}

bool qm_media_is(const char *content_type, const char *type)
{
    size_t length = trim(&content_type);
    return compare(content_type, length, type) == EXACTLY;
}

/** The weight among the parameters that follow a range, up to the next element; 1 when there is none. */
static double find_weight(const char *parameters)
{
    while (*parameters == ';') {
        parameters += 1 + strspn(parameters + 1, BLANK);
        if (strncasecmp(parameters, "q=", 2) == 0) return strtod(parameters + 2, NULL);
        parameters += strcspn(parameters, ";,");
    }
    return 1.0;
}

/** What the header says of a type: the range that names it most closely counts. */
static closeness weigh(const char *accept, const char *type, double *weight)
{
    closeness best = NOT_AT_ALL;
    for (const char *element = accept; *element; element += *element == ',') {
        size_t length = trim(&element);
        closeness found = compare(element, length, type);
        element += length;
        element += strspn(element, BLANK);
        if (found > best) {
            best = found;
            *weight = find_weight(element);
        }
        element += strcspn(element, ",");
    }
    return best;
}

int qm_media_choose(const char *accept, const char *const *offers)
{
    if (!accept || !accept[strspn(accept, BLANK ",")]) return 0;
    int chosen = -1;
    closeness chosen_closeness = NOT_AT_ALL;
    double chosen_weight = 0.0;
    for (int i = 0; offers[i]; i++) {
        double weight = 0.0;
        closeness found = weigh(accept, offers[i], &weight);
        if (found == NOT_AT_ALL || !(weight > 0.0)) continue;
        if (weight > chosen_weight || (weight == chosen_weight && found > chosen_closeness)) {
            chosen = i;
            chosen_closeness = found;
            chosen_weight = weight;
        }
    }
    return chosen;
}
