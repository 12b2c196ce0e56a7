#include "heap.h"

static bool comes_before(const qm_heap_item *a, const qm_heap_item *b)
{
    return a->key < b->key || (a->key == b->key && a->number < b->number);
}

qm_status qm_heap_push(qm_context *ctx, qm_heap *heap, qm_heap_item item)
{
    if (heap->count == heap->capacity) {
        size_t capacity = heap->capacity ? 2 * heap->capacity : 1024;
        qm_heap_item *items =
            qm_context_resize(ctx, heap->items, heap->capacity, capacity, sizeof *heap->items);
        if (!items) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a queue");
        heap->items = items;
        heap->capacity = capacity;
    }
    size_t place = heap->count++;
    for (; place > 0 && comes_before(&item, &heap->items[(place - 1) / 2]); place = (place - 1) / 2)
        heap->items[place] = heap->items[(place - 1) / 2];
    heap->items[place] = item;
    return QM_OK;
}

qm_heap_item qm_heap_pop(qm_heap *heap)
{
    qm_heap_item least = heap->items[0], last = heap->items[--heap->count];
    size_t place = 0, count = heap->count;
    for (;;) {
        size_t child = 2 * place + 1;
        if (child >= count) break;
        if (child + 1 < count && comes_before(&heap->items[child + 1], &heap->items[child])) child++;
        if (!comes_before(&heap->items[child], &last)) break;
        heap->items[place] = heap->items[child];
        place = child;
    }
    heap->items[place] = last;
    return least;
}

void qm_heap_reset(qm_context *ctx, qm_heap *heap)
{
    qm_context_free(ctx, heap->items, heap->capacity, sizeof *heap->items);
    *heap = (qm_heap){0};
}
