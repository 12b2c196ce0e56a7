/**
 * context.c: memory, messages and parallel loops of a call.
 */
#include "qm/context.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_RANGES 64 /* of blocks: workers beyond this number only steal */

static void *default_resize(void *user, void *block, size_t old_size, size_t new_size)
{
    (void)user;
    (void)old_size;
    if (new_size > 0) return realloc(block, new_size);
    free(block);
    return NULL;
}

const qm_allocator qm_allocator_default = {.resize = default_resize, .user = NULL};

qm_context qm_context_make(void)
{
    return (qm_context){.allocator = qm_allocator_default};
}

qm_status qm_context_fail(qm_context *ctx, qm_status status, const char *format, ...)
{
    QM_ASSERT(ctx && format && status != QM_OK);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(ctx->message, sizeof ctx->message, format, arguments);
    va_end(arguments);
    return status;
}

void qm_context_parallel(qm_context *ctx, int worker_count, void (*task)(void *data, int worker), void *data)
{
    if (worker_count > 1 && ctx->parallel) {
        ctx->parallel(ctx->parallel_user, worker_count, task, data);
        return;
    }
    for (int worker = 0; worker < worker_count; worker++)
        task(data, worker);
}

/** A worker's range of blocks, on a cache line of its own. Other workers steal from it when theirs are done.
 */
typedef struct block_range {
    _Alignas(64) atomic_size_t next;
    size_t end;
} block_range;

typedef struct block_loop {
    void (*task)(void *data, int worker, size_t block);
    void *data;
    int range_count;
    block_range range[MAX_RANGES];
} block_loop;

/** Works through the worker's own range first, then through the ranges of the workers after it. */
static void run_blocks(void *data, int worker)
{
    block_loop *loop = data;
    for (int i = 0; i < loop->range_count; i++) {
        block_range *range = &loop->range[(worker + i) % loop->range_count];
        for (size_t block; (block = atomic_fetch_add(&range->next, 1)) < range->end;)
            loop->task(loop->data, worker, block);
    }
}

void qm_context_parallel_for(qm_context *ctx, int worker_count, size_t block_count,
                             void (*task)(void *data, int worker, size_t block), void *data)
{
    QM_ASSERT(ctx && task && worker_count >= 1);
    if ((size_t)worker_count > block_count) worker_count = (int)block_count;
    block_loop loop;
    loop.task = task;
    loop.data = data;
    loop.range_count = worker_count < MAX_RANGES ? worker_count : MAX_RANGES;
    for (int i = 0; i < loop.range_count; i++) {
        atomic_init(&loop.range[i].next, block_count * (size_t)i / (size_t)loop.range_count);
        loop.range[i].end = block_count * ((size_t)i + 1) / (size_t)loop.range_count;
    }
    qm_context_parallel(ctx, worker_count, run_blocks, &loop);
}

void *qm_context_alloc(qm_context *ctx, size_t count, size_t width)
{
    return qm_context_resize(ctx, NULL, 0, count, width);
}

void *qm_context_resize(qm_context *ctx, void *block, size_t old_count, size_t new_count, size_t width)
{
    size_t size;
    if (new_count == 0 || !qm_array_size(new_count, width, &size)) return NULL;
    return ctx->allocator.resize(ctx->allocator.user, block, old_count * width, size);
}

void qm_context_free(qm_context *ctx, void *block, size_t count, size_t width)
{
    if (block) ctx->allocator.resize(ctx->allocator.user, block, count * width, 0);
}

/* The block lies in a larger one; the 8 bytes before it hold the address of the larger one. */
enum { ALIGNMENT = 64 };

void *qm_context_alloc_aligned(qm_context *ctx, size_t count, size_t width)
{
    size_t size;
    if (count == 0 || !qm_array_size(count, width, &size) || size > SIZE_MAX - 2 * ALIGNMENT) return NULL;
    char *outer = qm_context_alloc(ctx, size + 2 * ALIGNMENT, 1);
    if (!outer) return NULL;
    uintptr_t start = ((uintptr_t)outer + 2 * ALIGNMENT - 1) & ~(uintptr_t)(ALIGNMENT - 1);
    char *block = outer + (start - (uintptr_t)outer);
    memcpy(block - sizeof outer, &outer, sizeof outer);
    return block;
}

void qm_context_free_aligned(qm_context *ctx, void *block, size_t count, size_t width)
{
    if (!block) return;
    char *outer;
    memcpy(&outer, (char *)block - sizeof outer, sizeof outer);
    qm_context_free(ctx, outer, count * width + 2 * ALIGNMENT, 1);
}
