/**
 * heap.h: a queue of numbered items, least key first; of equal keys the lower number first.
 */
#ifndef QM_HEAP_H
#define QM_HEAP_H

#include "qm/context.h"

typedef struct qm_heap_item {
    double key;
    uint32_t number;
    uint32_t origin; /* whatever the owner wants back */
} qm_heap_item;

typedef struct qm_heap {
    qm_heap_item *items;
    size_t count, capacity;
} qm_heap;

/** QM_OK or QM_E_NO_MEMORY. */
qm_status qm_heap_push(qm_context *ctx, qm_heap *heap, qm_heap_item item);

/** Takes the least item out; the heap is not empty. */
qm_heap_item qm_heap_pop(qm_heap *heap);

void qm_heap_reset(qm_context *ctx, qm_heap *heap);

#endif
