/**
 * hausdorff_queue.c: a priority queue as a 4-ary heap, and the pool of its pieces with a list of free slots.
 */
#include "hausdorff_queue.h"

void qm_queue_init(qm_queue *queue)
{
    *queue = (qm_queue){.free_head = QM_NO_INDEX};
}

void qm_queue_reset(qm_context *ctx, qm_queue *queue)
{
    qm_context_free(ctx, queue->heap, queue->capacity, sizeof *queue->heap);
    qm_context_free(ctx, queue->pool, queue->pool_capacity, sizeof *queue->pool);
    qm_queue_init(queue);
}

bool qm_queue_push(qm_context *ctx, qm_queue *queue, qm_entry entry, const qm_piece *piece)
{
    QM_ASSERT(ctx && queue);
    QM_ASSERT(queue->count <= queue->capacity);
    QM_ASSERT((entry.kind == QM_ENTRY_PIECE) == (piece != NULL));
    if (queue->count == queue->capacity) {
        size_t capacity = queue->capacity ? 2 * queue->capacity : 256;
        qm_entry *heap = qm_context_resize(ctx, queue->heap, queue->capacity, capacity, sizeof *heap);
        if (!heap) return false;
        queue->heap = heap;
        queue->capacity = capacity;
    }
    if (piece) {
        if (queue->free_head == QM_NO_INDEX) {
            size_t old = queue->pool_capacity, capacity = old ? 2 * old : 64;
            if (capacity >= QM_NO_INDEX) return false;
            qm_piece *pool = qm_context_resize(ctx, queue->pool, old, capacity, sizeof *pool);
            if (!pool) return false;
            for (size_t i = capacity; i-- > old;) {
                pool[i].next_free = queue->free_head;
                queue->free_head = (uint32_t)i;
            }
            queue->pool = pool;
            queue->pool_capacity = capacity;
        }
        QM_ASSERT(queue->free_head < queue->pool_capacity);
        entry.index = queue->free_head;
        queue->free_head = queue->pool[entry.index].next_free;
        queue->pool[entry.index] = *piece;
    }
    size_t at = queue->count++;
    for (size_t parent; at > 0 && queue->heap[parent = (at - 1) / 4].upper < entry.upper; at = parent)
        queue->heap[at] = queue->heap[parent];
    queue->heap[at] = entry;
    return true;
}

qm_entry qm_queue_pop(qm_queue *queue, qm_piece *piece)
{
    QM_ASSERT(queue && piece);
    QM_ASSERT(queue->count > 0);
    qm_entry top = queue->heap[0];
    qm_entry last = queue->heap[--queue->count];
    size_t at = 0;
    for (size_t first = 1; first < queue->count; first = 4 * at + 1) {
        size_t end = first + 4 < queue->count ? first + 4 : queue->count, child = first;
        for (size_t i = first + 1; i < end; i++)
            if (queue->heap[i].upper > queue->heap[child].upper) child = i;
        if (!(queue->heap[child].upper > last.upper)) break;
        queue->heap[at] = queue->heap[child];
        at = child;
    }
    queue->heap[at] = last;
    if (top.kind == QM_ENTRY_PIECE) {
        QM_ASSERT(top.index < queue->pool_capacity);
        *piece = queue->pool[top.index];
        queue->pool[top.index].next_free = queue->free_head;
        queue->free_head = top.index;
    }
    return top;
}
