/**
 * base.c: status codes and their texts, the default allocator, the end of a failed assertion.
 */
#include "qm/base.h"

#include <stdio.h>
#include <stdlib.h>

static const char *const status_codes[] = {
#define XX(suffix, code, text) code,
    QM_STATUS_MAP(XX)
#undef XX
};

static const char *const status_texts[] = {
#define XX(suffix, code, text) text,
    QM_STATUS_MAP(XX)
#undef XX
};

const char *qm_status_code(qm_status status)
{
    return (unsigned)status < QM_STATUS_COUNT ? status_codes[status] : "unknown";
}

const char *qm_status_text(qm_status status)
{
    return (unsigned)status < QM_STATUS_COUNT ? status_texts[status] : "unknown status";
}

static void *default_resize(void *user, void *block, size_t old_size, size_t new_size)
{
    (void)user;
    (void)old_size;
    if (new_size > 0) return realloc(block, new_size);
    free(block);
    return NULL;
}

const qm_allocator qm_allocator_default = {.resize = default_resize, .user = NULL};

void qm_assert_failed(const char *condition, const char *file, int line)
{
    fprintf(stderr, "%s:%d: assertion failed: %s\n", file, line, condition);
    abort();
}
