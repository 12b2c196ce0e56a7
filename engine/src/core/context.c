#include "qm/context.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define MAX_RUNS 64 /* of blocks that workers share: those beyond take from the others */

qm_context qm_context_make(void)
{
    return (qm_context){.allocator = qm_allocator_default};
}

qm_status qm_context_fail(qm_context *ctx, qm_status status, const char *format, ...)
{
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

/** A run of blocks, on a line of its own: a worker's own, until others are through with theirs. */
typedef struct block_run {
    _Alignas(64) atomic_size_t next;
    size_t end;
} block_run;

typedef struct shared_blocks {
    void (*task)(void *data, int worker, size_t block);
    void *data;
    int run_count;
    block_run run[MAX_RUNS];
} shared_blocks;

static void take_blocks(void *data, int worker)
{
    shared_blocks *blocks = data;
    for (int i = 0; i < blocks->run_count; i++) {
        block_run *run = &blocks->run[(worker + i) % blocks->run_count];
        for (size_t block; (block = atomic_fetch_add(&run->next, 1)) < run->end;)
            blocks->task(blocks->data, worker, block);
    }
}

void qm_context_share(qm_context *ctx, int worker_count, size_t block_count,
                      void (*task)(void *data, int worker, size_t block), void *data)
{
    if ((size_t)worker_count > block_count) worker_count = (int)block_count;
    shared_blocks blocks;
    blocks.task = task;
    blocks.data = data;
    blocks.run_count = worker_count < MAX_RUNS ? worker_count : MAX_RUNS;
    for (int i = 0; i < blocks.run_count; i++) {
        atomic_init(&blocks.run[i].next, block_count * (size_t)i / (size_t)blocks.run_count);
        blocks.run[i].end = block_count * ((size_t)i + 1) / (size_t)blocks.run_count;
    }
    qm_context_parallel(ctx, worker_count, take_blocks, &blocks);
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

/* The block lies in a larger one; the 8 bytes before it remember where the larger one starts. */
enum { ALIGNMENT = 64 };

void *qm_context_alloc_aligned(qm_context *ctx, size_t count, size_t width)
{
    size_t size;
    if (count == 0 || !qm_array_size(count, width, &size) || size > SIZE_MAX - 2 * ALIGNMENT) return NULL;
    char *whole = qm_context_alloc(ctx, size + 2 * ALIGNMENT, 1);
    if (!whole) return NULL;
    uintptr_t start = ((uintptr_t)whole + 2 * ALIGNMENT - 1) & ~(uintptr_t)(ALIGNMENT - 1);
    char *block = whole + (start - (uintptr_t)whole);
    memcpy(block - sizeof whole, &whole, sizeof whole);
    return block;
}

void qm_context_free_aligned(qm_context *ctx, void *block, size_t count, size_t width)
{
    if (!block) return;
    char *whole;
    memcpy(&whole, (char *)block - sizeof whole, sizeof whole);
    qm_context_free(ctx, whole, count * width + 2 * ALIGNMENT, 1);
}
