/**
 * fuzz_check.h: what the fuzz targets hold to: a condition that fails ends the run with its place.
 */
#ifndef QM_FUZZ_CHECK_H
#define QM_FUZZ_CHECK_H

#include <stdio.h>
#include <stdlib.h>

#include "qm/context.h"

#define CHECK(condition)                                                                                     \
    do {                                                                                                     \
        if (!(condition)) {                                                                                  \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                                  \
            abort();                                                                                         \
        }                                                                                                    \
    } while (0)

/** True for QM_OK. Any other status has a message. */
static inline bool qm_fuzz_succeeded(const qm_context *ctx, qm_status status)
{
    CHECK(status == QM_OK || ctx->message[0]);
    return status == QM_OK;
}

#endif
