#include "core/arena.h"

#include <stdalign.h>
#include <string.h>

#define CHUNK_SIZE ((size_t)1 << 16)
#define ALIGNMENT alignof(max_align_t)

struct qm_arena_chunk {
    qm_arena_chunk *next;
    size_t size;
    alignas(max_align_t) unsigned char bytes[];
};

/** A size rounded up by a quarter of it at most: blocks that grow a little from one rewind to the next, as often as may be, find the chunk of the
 * last one, instead of each leaving one behind. */
static size_t round_up(size_t size)
{
    size_t step = 1;
    while (step < size / 8)
        step *= 2;
    return size > SIZE_MAX - step ? size : (size + step - 1) / step * step;
}

/** Makes a chunk with at least size bytes the current one: the first such behind it, which changes place with those that it skips, so that these
 * serve later blocks, and equal calls after a rewind find each at once. */
static bool advance(qm_arena *arena, size_t size)
{
    qm_arena_chunk **place = arena->at ? &arena->at->next : &arena->first, **link = place;
    while (*link && (*link)->size < size)
        link = &(*link)->next;
    qm_arena_chunk *chunk = *link;
    if (chunk) {
        *link = chunk->next;
    } else {
        size_t bytes = size > CHUNK_SIZE ? round_up(size) : CHUNK_SIZE;
        if (bytes > SIZE_MAX - sizeof(qm_arena_chunk)) return false;
        chunk = qm_context_alloc(arena->ctx, sizeof *chunk + bytes, 1);
        if (!chunk) return false;
        *chunk = (qm_arena_chunk){.size = bytes};
    }
    chunk->next = *place;
    *place = chunk;
    arena->at = chunk;
    arena->used = 0;
    return true;
}

void *qm_arena_alloc(qm_arena *arena, size_t count, size_t width)
{
    size_t size;
    if (!qm_array_size(count, width, &size) || size > SIZE_MAX - ALIGNMENT) return NULL;
    size = (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    if (size == 0) size = ALIGNMENT;
    if ((!arena->at || arena->at->size - arena->used < size) && !advance(arena, size)) return NULL;
    void *block = arena->at->bytes + arena->used;
    arena->used += size;
    return block;
}

void *qm_arena_zeroed(qm_arena *arena, size_t count, size_t width)
{
    void *block = qm_arena_alloc(arena, count, width);
    if (block) memset(block, 0, count * width);
    return block;
}

void qm_arena_rewind(qm_arena *arena)
{
    arena->at = NULL;
    arena->used = 0;
}

void qm_arena_reset(qm_arena *arena)
{
    for (qm_arena_chunk *chunk = arena->first, *next; chunk; chunk = next) {
        next = chunk->next;
        qm_context_free(arena->ctx, chunk, sizeof *chunk + chunk->size, 1);
    }
    *arena = qm_arena_make(arena->ctx);
}
