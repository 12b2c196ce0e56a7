#include "qm/context.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

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
