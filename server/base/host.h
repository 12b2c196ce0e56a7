/**
 * host.h: what a program hands to the engine: a team of threads, and memory on large pages.
 */
#ifndef QM_HOST_H
#define QM_HOST_H

#include "qm/context.h"

/** A context whose parallel is qm_parallel_run and whose allocator is qm_large_pages. */
qm_context qm_host_context(void);

#endif
