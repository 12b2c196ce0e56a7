#include "failing_allocator.h"

#include <stdlib.h>

/** Stands before each block; as large as the strictest alignment, so that the block keeps it. */
typedef union header {
    size_t size;
    max_align_t align;
} header;

static void *resize(void *user, void *block, size_t old_size, size_t new_size)
{
    qm_failing_allocator *state = user;
    header *old = block ? (header *)block - 1 : NULL;
    size_t held = old ? old->size : 0;
    if (held != old_size) state->mismatched = true;
    if (new_size == 0) {
        state->live_blocks -= old != NULL;
        state->live_bytes -= held;
        free(old);
        return NULL;
    }
    if (state->calls++ >= state->fail_at) return NULL;
    header *moved = realloc(old, sizeof *moved + new_size);
    if (!moved) return NULL;
    moved->size = new_size;
    state->live_blocks += old == NULL;
    state->live_bytes += new_size - held;
    return moved + 1;
}

qm_allocator qm_failing_allocator_hook(qm_failing_allocator *state)
{
    return (qm_allocator){.resize = resize, .user = state};
}
