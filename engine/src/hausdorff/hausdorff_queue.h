/**
 * hausdorff_queue.h: the priority queue of a worker: parts of the source, largest upper bound first.
 *
 * A node of the source's hierarchy fits in an entry; a piece has corners and is stored in a pool beside the
 * heap.
 */
#ifndef QM_HAUSDORFF_QUEUE_H
#define QM_HAUSDORFF_QUEUE_H

#include "bvh/kernel.h"

/** A piece of one face of the source: a triangle, or a rectangle in the parameters of a bilinear patch. */
typedef struct qm_piece {
    /* In local space: three for a triangle; (s0,t0) (s1,t0) (s1,t1) (s0,t1) for a rectangle. */
    qm_vec corner[4];
    union {
        struct {
            double low[2], high[2]; /* by covers: the rectangle in the parameters of the patch */
        };
        double distance[4]; /* by matching: upper bounds of the corners' distances, local */
    };
    uint32_t foot[4];    /* by matching: QM_PACK_LANES * pack + lane of the facet under each corner */
    double slack;        /* the triangle is within this distance of the source's surface; mostly 0 */
    uint32_t face, pack; /* of the source */
    uint16_t cuts;       /* between the face and a triangle of it, see rounding.h */
    uint8_t corner_count, depth;
    uint32_t next_free; /* list of free slots in the pool */
} qm_piece;

typedef enum qm_entry_kind { QM_ENTRY_NODE, QM_ENTRY_PIECE } qm_entry_kind;

typedef struct qm_entry {
    double upper;   /* no point of it is farther from the target; world units */
    uint32_t index; /* of a node or pack in its level; slot in the pool for a piece */
    uint32_t hint;  /* a pack of the target near it */
    uint8_t kind, side, level;
} qm_entry;

typedef struct qm_queue {
    qm_entry *heap;
    size_t count, capacity;
    qm_piece *pool;
    size_t pool_capacity;
    uint32_t free_head; /* list of free slots; QM_NO_INDEX ends it */
} qm_queue;

void qm_queue_init(qm_queue *queue);
void qm_queue_reset(qm_context *ctx, qm_queue *queue);

/** Adds an entry; with piece != NULL copies it into the pool. False when out of memory: nothing is then
 * changed. */
bool qm_queue_push(qm_context *ctx, qm_queue *queue, qm_entry entry, const qm_piece *piece);

/** Bytes allocated. */
static inline size_t qm_queue_bytes(const qm_queue *queue)
{
    return queue->capacity * sizeof *queue->heap + queue->pool_capacity * sizeof *queue->pool;
}

/** True when the next push has to allocate. */
static inline bool qm_queue_is_full(const qm_queue *queue)
{
    return queue->count == queue->capacity || queue->free_head == QM_NO_INDEX;
}

/** Takes the topmost entry, and its piece when it is one. The queue is not empty. */
qm_entry qm_queue_pop(qm_queue *queue, qm_piece *piece);

#endif
