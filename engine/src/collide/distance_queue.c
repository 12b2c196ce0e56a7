#include "distance_queue.h"

#define FIRST_CAPACITY 256

static bool comes_before(const qm_waiting_pair *x, const qm_waiting_pair *y)
{
    if (x->lower != y->lower) return x->lower < y->lower;
    return x->a.level + x->b.level < y->a.level + y->b.level;
}

bool qm_distance_queue_push(qm_context *ctx, qm_distance_queue *queue, const qm_waiting_pair *pair)
{
    if (queue->count == queue->capacity) {
        size_t capacity = queue->capacity > 0 ? 2 * queue->capacity : FIRST_CAPACITY;
        qm_waiting_pair *grown =
            qm_context_resize(ctx, queue->heap, queue->capacity, capacity, sizeof *grown);
        if (!grown) return false;
        queue->heap = grown;
        queue->capacity = capacity;
    }
    size_t at = queue->count++;
    for (size_t parent; at > 0 && comes_before(pair, &queue->heap[parent = (at - 1) / 2]); at = parent)
        queue->heap[at] = queue->heap[parent];
    queue->heap[at] = *pair;
    return true;
}

qm_waiting_pair qm_distance_queue_pop(qm_distance_queue *queue)
{
    qm_waiting_pair top = queue->heap[0], last = queue->heap[--queue->count];
    size_t at = 0;
    for (size_t child; (child = 2 * at + 1) < queue->count; at = child) {
        if (child + 1 < queue->count && comes_before(&queue->heap[child + 1], &queue->heap[child])) child++;
        if (!comes_before(&queue->heap[child], &last)) break;
        queue->heap[at] = queue->heap[child];
    }
    queue->heap[at] = last;
    return top;
}

void qm_distance_queue_reset(qm_context *ctx, qm_distance_queue *queue)
{
    qm_context_free(ctx, queue->heap, queue->capacity, sizeof *queue->heap);
    *queue = (qm_distance_queue){0};
}
