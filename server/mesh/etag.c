/**
 * etag.c: lists of entity tags.
 */
#include "etag.h"

#include <stdio.h>

#include <string.h>

#define BLANK " \t,"

bool qm_etag_is_listed(const char *list, const char *etag, bool weak)
{
    if (!list) return false;
    size_t length = strlen(etag);
    for (list += strspn(list, BLANK); *list; list += strspn(list, BLANK)) {
        if (*list == '*') return true;
        bool is_weak = strncmp(list, "W/", 2) == 0;
        if (is_weak) list += 2;
        if (*list != '"') return false;
        const char *end = strchr(list + 1, '"');
        if (!end) return false;
        end++;
        bool is_same = (size_t)(end - list) == length && strncmp(list, etag, length) == 0;
        if (is_same && (weak || !is_weak)) return true;
        list = end;
    }
    return false;
}

void qm_etag_write_mesh(const char *hash, uint64_t revision, const char *suffix, char out[QM_ETAG_SIZE])
{
    snprintf(out, QM_ETAG_SIZE, "\"%s-%llu%s\"", hash, (unsigned long long)revision, suffix);
}
