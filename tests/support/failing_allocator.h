/**
 * failing_allocator.h: an allocator that fails at a chosen call and counts what is alive, to walk through
 * every out-of-memory path. One thread at a time.
 */
#ifndef QM_FAILING_ALLOCATOR_H
#define QM_FAILING_ALLOCATOR_H

#include "qm/base.h"

typedef struct qm_failing_allocator {
    size_t fail_at; /* the call, counted from 0, that fails, and all after it; SIZE_MAX: none */
    size_t calls;   /* requests for memory so far: new blocks and resizes */
    size_t live_blocks, live_bytes;
    bool mismatched; /* some block was given back with another size than it has */
} qm_failing_allocator;

qm_allocator qm_failing_allocator_hook(qm_failing_allocator *state);

#endif
