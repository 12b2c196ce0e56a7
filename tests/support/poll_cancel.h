/**
 * poll_cancel.h: a context that counts its polls and is canceled at a chosen one, to walk through every place where a call may end.
 */
#ifndef QM_POLL_CANCEL_H
#define QM_POLL_CANCEL_H

#include <stdatomic.h>

#include "qm/context.h"

typedef struct qm_poll_cancel {
    size_t at;    /* the poll, counted from 0, that cancels; SIZE_MAX: none */
    size_t polls; /* so far */
    atomic_bool is_watched, is_canceled;
} qm_poll_cancel;

/** A context of such polls, from 0 on. */
qm_context qm_poll_cancel_context(qm_poll_cancel *state, size_t at);

#endif
