/**
 * distance_queue.h: pairs of nodes that wait to be looked at, the nearest first and of equally near ones the
 * lowest in the trees, so that something is measured soon.
 */
#ifndef QM_DISTANCE_QUEUE_H
#define QM_DISTANCE_QUEUE_H

#include "bvh/collide_leaf.h"

typedef struct qm_waiting_pair {
    double lower; /* no point of a is nearer to b */
    qm_node a, b;
} qm_waiting_pair;

/** All zero is an empty one. */
typedef struct qm_distance_queue {
    qm_waiting_pair *heap;
    size_t count, capacity;
} qm_distance_queue;

/** Adds a pair; false when out of memory. */
bool qm_distance_queue_push(qm_context *ctx, qm_distance_queue *queue, const qm_waiting_pair *pair);

/** Takes the first pair. The queue is not empty. */
qm_waiting_pair qm_distance_queue_pop(qm_distance_queue *queue);

void qm_distance_queue_reset(qm_context *ctx, qm_distance_queue *queue);

#endif
