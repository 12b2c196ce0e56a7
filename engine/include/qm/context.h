/**
 * context.h: what a call of the engine runs in. The host hands in memory, threads and a cancel flag, and
 * reads the message after a failed call. The engine keeps no global state and starts no thread of its own.
 */
#ifndef QM_CONTEXT_H
#define QM_CONTEXT_H

#include <stdatomic.h>

#include "qm/base.h"

#define QM_MESSAGE_SIZE 256

/**
 * Runs task(data, 0) ... task(data, worker_count - 1), at the same time where the host has threads to spare,
 * and returns when all have returned. Running them one after the other is allowed: no task waits for another.
 */
typedef void qm_parallel_fn(void *user, int worker_count, void (*task)(void *data, int worker), void *data);

/** One call at a time may use a context; calls that overlap need a context each. */
typedef struct qm_context {
    qm_allocator allocator;        /* thread-safe when parallel is given */
    qm_parallel_fn *parallel;      /* NULL: everything runs on the calling thread */
    void *parallel_user;           /* handed to parallel */
    const atomic_bool *cancel;     /* looked at now and then; NULL: never canceled */
    char message[QM_MESSAGE_SIZE]; /* words for the last failed call, with the place in the input; never paths
                                    */
} qm_context;

/** A context on malloc, one thread, no cancel flag. */
qm_context qm_context_make(void);

/** Writes the message and returns status, so that a check reads: return qm_context_fail(ctx, QM_E_...,
 * "..."). */
qm_status qm_context_fail(qm_context *ctx, qm_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/** Runs the tasks through ctx->parallel, or one after the other without it. */
void qm_context_parallel(qm_context *ctx, int worker_count, void (*task)(void *data, int worker), void *data);

/**
 * Runs task(data, worker, block) once for each block, shared out to up to worker_count workers. Each goes
 * through a run of blocks of its own, and then takes from those of others: a thread on a busy processor does
 * less, and one call after the other leaves most of the memory with the same processor.
 */
void qm_context_share(qm_context *ctx, int worker_count, size_t block_count,
                      void (*task)(void *data, int worker, size_t block), void *data);

/** True once the host has raised the cancel flag. */
static inline bool qm_context_canceled(const qm_context *ctx)
{
    return ctx->cancel && atomic_load_explicit(ctx->cancel, memory_order_relaxed);
}

/** Uninitialised array of count * width bytes; NULL when out of memory, when the size overflows or count is
 * 0. */
void *qm_context_alloc(qm_context *ctx, size_t count, size_t width);

/** Like realloc for arrays: NULL leaves the old block alive. */
void *qm_context_resize(qm_context *ctx, void *block, size_t old_count, size_t new_count, size_t width);

/** Frees what the two calls above gave; count and width as allocated. NULL is fine. */
void qm_context_free(qm_context *ctx, void *block, size_t count, size_t width);

/** The same two calls for blocks that start at a multiple of 64 bytes, as wide vectors like it. */
void *qm_context_alloc_aligned(qm_context *ctx, size_t count, size_t width);
void qm_context_free_aligned(qm_context *ctx, void *block, size_t count, size_t width);

#endif
