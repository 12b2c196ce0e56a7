/**
 * arena.h: memory for one call: blocks of any size, freed together.
 */
#ifndef QM_ARENA_H
#define QM_ARENA_H

#include "qm/context.h"

typedef struct qm_arena_chunk qm_arena_chunk;

typedef struct qm_arena {
    qm_context *ctx;
    qm_arena_chunk *first, *at;
    size_t used; /* bytes of at */
} qm_arena;

static inline qm_arena qm_arena_make(qm_context *ctx)
{
    return (qm_arena){.ctx = ctx};
}

/** An uninitialised array of count * width bytes, aligned for any type; NULL when out of memory. */
void *qm_arena_alloc(qm_arena *arena, size_t count, size_t width);

/** The same, all zero. */
void *qm_arena_zeroed(qm_arena *arena, size_t count, size_t width);

/** Ends the life of all blocks, and keeps the memory for the next ones. */
void qm_arena_rewind(qm_arena *arena);

/** Frees everything. */
void qm_arena_reset(qm_arena *arena);

#endif
