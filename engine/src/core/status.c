/**
 * status.c: the codes and texts of statuses, and the end of a failed assertion.
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

void qm_core_abort(const char *condition, const char *file, int line)
{
    fprintf(stderr, "%s:%d: assertion failed: %s\n", file, line, condition);
    abort();
}
