/**
 * host.h: what a program gives the engine: threads, memory on large pages, and a budget of it.
 */
#ifndef QM_HOST_H
#define QM_HOST_H

#include <stdatomic.h>

#include "qm/context.h"

/** A context that runs on qm_host_parallel and allocates from qm_host_allocator. */
qm_context qm_host_context(void);

/** Most threads that a call uses. */
#define QM_HOST_MAX_THREADS 256

/**
 * A qm_parallel_fn on a team of threads that outlives the call; user is ignored. Workers that get no thread run on
 * the caller's.
 */
void qm_host_parallel(void *user, int worker_count, void (*task)(void *data, int worker), void *data);

/** The number of processors that this process may use: 1 to QM_HOST_MAX_THREADS. */
int qm_host_thread_count(void);

/**
 * Blocks below a megabyte come from malloc. Larger ones are mapped, on pages of 2 MiB where the system has them: such
 * a page is set up once and has one address translation instead of 512, which dominated the time to build a tree. The
 * last page of a block is a large one if at least half of it is used, so a block wastes at most a megabyte. Freed
 * blocks return to the system at once; a virtual machine that gives free memory back to its host then waits for
 * 2 MiB at a time when it reuses them after a pause. Any thread.
 */
extern const qm_allocator qm_host_allocator;

/**
 * For a process that runs one job: from now on malloc's heap lies on large pages, serves the blocks of up to 32 MiB
 * of qm_host_allocator as well, and keeps what is freed, so that later blocks reuse pages that are set up. Call it
 * before the first allocation and before other threads start.
 */
void qm_host_use_large_heap(void);

/**
 * For a process that stays: malloc maps large blocks one by one, so that each returns to the system when it is freed.
 * glibc raises the size from which it does so to that of the largest one that was freed; bodies and texts of a few MiB
 * would then stay in the heaps of all threads. Call it before other threads start.
 */
void qm_host_return_memory(void);

/* ---- budget ---- */

/** An allocator with a limit. An allocation beyond it first asks the owner to free memory, and fails like malloc if the
 * owner cannot. */
typedef struct qm_budget {
    size_t limit; /* bytes */
    atomic_size_t used;
    /* Frees something when as many bytes as are missing can be freed, perhaps by several calls; else false, and nothing is
     * freed. Any thread. */
    bool (*make_room)(void *user, size_t missing);
    void *user;
} qm_budget;

/** qm_host_allocator within the budget, for any thread; blocks are freed through the same allocator. */
qm_allocator qm_host_budget_allocator(qm_budget *budget);

/** The same without asking the owner to free memory: an allocation beyond the limit fails. */
qm_allocator qm_host_budget_spare_allocator(qm_budget *budget);

/** Asks the owner for as much memory as so many bytes need that are allocated next. False, and nothing is freed, when
 * they would not fit. */
bool qm_host_budget_make_room(qm_budget *budget, size_t size);

/** Reserves bytes for memory that comes from elsewhere; false if they cannot be made free. qm_host_budget_release gives
 * them back. */
bool qm_host_budget_reserve(qm_budget *budget, size_t size);
void qm_host_budget_release(qm_budget *budget, size_t size);

/** Half of the memory that this process may have: of the machine, or of its control groups (version 1 or 2). */
size_t qm_host_default_budget(void);

#endif
