#include "heap.h"

static bool comes_before(const qm_heap_item *a, const qm_heap_item *b)
{
    return a->key < b->key || (a->key == b->key && a->number < b->number);
}

qm_status qm_heap_push(qm_context *ctx, qm_heap *heap, qm_heap_item item)
{
    QM_ASSERT(heap->count <= heap->capacity);
    if (heap->count == heap->capacity) {
        size_t capacity = heap->capacity ? 2 * heap->capacity : 1024;
        qm_heap_item *items =
            qm_context_resize(ctx, heap->items, heap->capacity, capacity, sizeof *heap->items);
        if (!items) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a priority queue");
        heap->items = items;
        heap->capacity = capacity;
    }
    size_t index = heap->count++;
    for (; index > 0 && comes_before(&item, &heap->items[(index - 1) / 2]); index = (index - 1) / 2)
        heap->items[index] = heap->items[(index - 1) / 2];
    heap->items[index] = item;
    return QM_OK;
}

qm_heap_item qm_heap_pop(qm_heap *heap)
{
    QM_ASSERT(heap->count > 0);
    qm_heap_item first = heap->items[0], last = heap->items[--heap->count];
    size_t index = 0, count = heap->count;
    for (;;) {
        size_t child = 2 * index + 1;
        if (child >= count) break;
        if (child + 1 < count && comes_before(&heap->items[child + 1], &heap->items[child])) child++;
        if (!comes_before(&heap->items[child], &last)) break;
        heap->items[index] = heap->items[child];
        index = child;
    }
    heap->items[index] = last;
    return first;
}

void qm_heap_reset(qm_context *ctx, qm_heap *heap)
{
    qm_context_free(ctx, heap->items, heap->capacity, sizeof *heap->items);
    *heap = (qm_heap){0};
}
