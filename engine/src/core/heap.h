/**
 * heap.h: a priority queue (binary min-heap) of numbered items by their keys; of equal keys the lower number
 * comes first.
 */
#ifndef QM_HEAP_H
#define QM_HEAP_H

#include "qm/context.h"

typedef struct qm_heap_item {
    double key;
    uint32_t number;
    uint32_t origin; /* the caller's own data; it does not affect the order */
} qm_heap_item;

/** All zero is an empty heap. */
typedef struct qm_heap {
    qm_heap_item *items;
    size_t count, capacity;
} qm_heap;

/** Returns QM_OK or QM_E_NO_MEMORY. The key is not NaN. */
qm_status qm_heap_push(qm_context *ctx, qm_heap *heap, qm_heap_item item);

/** Removes and returns the first item; the heap is not empty. */
qm_heap_item qm_heap_pop(qm_heap *heap);

void qm_heap_reset(qm_context *ctx, qm_heap *heap);

#endif
