/**
 * parallel.h: the engine's parallel hook on plain threads, one a worker, for tests.
 */
#ifndef QM_PARALLEL_H
#define QM_PARALLEL_H

#include "qm/context.h"

/** A qm_parallel_fn; user is not looked at. Up to 16 workers. */
void qm_parallel_run(void *user, int worker_count, void (*task)(void *data, int worker), void *data);

#endif
