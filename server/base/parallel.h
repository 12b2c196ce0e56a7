/**
 * parallel.h: the engine's hook for threads, on a team of threads that stays for the next call.
 */
#ifndef QM_PARALLEL_H
#define QM_PARALLEL_H

#include "qm/context.h"

/** A qm_parallel_fn; user is not looked at. Workers that get no thread run on the caller's. */
void qm_parallel_run(void *user, int worker_count, void (*task)(void *data, int worker), void *data);

/** How many threads can run at the same time on the processors that this process may use: 1 to 256. */
int qm_parallel_available(void);

#endif
