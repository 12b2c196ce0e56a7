/**
 * context.h: the environment of a call. The host provides memory, threads and flags, and reads the
 * message after a failed call. The engine keeps no global state and starts no thread of its own.
 */
#ifndef QM_CONTEXT_H
#define QM_CONTEXT_H

#include <stdatomic.h>

#include "qm/base.h"

#define QM_MESSAGE_SIZE 256

/**
 * Runs task(data, 0) ... task(data, worker_count - 1), concurrently where the host has idle threads, and
 * returns when all have returned. Running them in sequence is allowed: no task waits for another.
 */
typedef void qm_parallel_fn(void *user, int worker_count, void (*task)(void *data, int worker), void *data);

/** One call at a time may use a context; calls that overlap need a context each. */
typedef struct qm_context {
    qm_allocator allocator;    /* thread-safe when parallel is given */
    qm_parallel_fn *parallel;  /* NULL: everything runs on the calling thread */
    void *parallel_user;       /* first argument of parallel */
    const atomic_bool *cancel; /* polled; NULL: never canceled */
    const atomic_bool *pause;  /* polled; NULL: never paused */
    void (*wait)(
        void *user); /* called by each thread of the call that finds pause raised; the call goes on when it
                                      returns. The engine holds no lock meanwhile, and nothing that another call waits for. */
    void *wait_user; /* argument of wait */
    char message[QM_MESSAGE_SIZE]; /* of the last failed call, with the location in the input; never paths */
} qm_context;

/** A context on malloc, one thread, no cancel flag. */
qm_context qm_context_make(void);

/** Writes the message and returns status, for: return qm_context_fail(ctx, QM_E_..., "..."). */
qm_status qm_context_fail(qm_context *ctx, qm_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/** Runs the tasks through ctx->parallel, or in sequence without it. */
void qm_context_parallel(qm_context *ctx, int worker_count, void (*task)(void *data, int worker), void *data);

/**
 * Parallel for with work stealing: runs task(data, worker, block) once for each block, on up to worker_count
 * workers. Each worker starts on a contiguous range, so that successive loops keep memory in the same caches,
 * then steals blocks from the others, so that a thread on a busy processor does less.
 */
void qm_context_parallel_for(qm_context *ctx, int worker_count, size_t block_count,
                             void (*task)(void *data, int worker, size_t block), void *data);

/** True once the host has raised the cancel flag. Waits first while the host wants the call to pause. */
static inline bool qm_context_canceled(const qm_context *ctx)
{
    if (ctx->pause && atomic_load_explicit(ctx->pause, memory_order_relaxed)) ctx->wait(ctx->wait_user);
    return ctx->cancel && atomic_load_explicit(ctx->cancel, memory_order_relaxed);
}

/** Allocates an uninitialised array of count * width bytes; NULL when out of memory, when the size overflows
 * or count is 0. */
void *qm_context_alloc(qm_context *ctx, size_t count, size_t width);

/** Like realloc for arrays: NULL leaves the old block alive. */
void *qm_context_resize(qm_context *ctx, void *block, size_t old_count, size_t new_count, size_t width);

/** Frees a block of the two calls above; count and width as allocated. NULL is allowed. */
void qm_context_free(qm_context *ctx, void *block, size_t count, size_t width);

/** Blocks that start at a multiple of 64 bytes: cache lines, and the widest vectors. */
void *qm_context_alloc_aligned(qm_context *ctx, size_t count, size_t width);
void qm_context_free_aligned(qm_context *ctx, void *block, size_t count, size_t width);

#endif
