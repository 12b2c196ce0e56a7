/**
 * leaf_boxes.h: two packs prepared for pair tests, side by side: their offset, the error of coordinates, and
 * the lanes whose boxes meet.
 */
#ifndef QM_KERNEL_LEAF_BOXES_H
#define QM_KERNEL_LEAF_BOXES_H

#include "bvh/node_pairs.h"
#include "wide.h"

/** q relative to p's center. */
typedef struct leaf_boxes {
    const qm_collide_leaf *p, *q;
    float shift[3], error; /* error bounds that of every coordinate of both */
    wide low, high;        /* the boxes of q's lanes, enlarged by the errors of both */
} leaf_boxes;

/** a + shift + margin along each axis */
static inline wide leaf_shift(wide a, const float shift[3], float margin)
{
    return (wide){a.x + (shift[0] + margin), a.y + (shift[1] + margin), a.z + (shift[2] + margin)};
}

static inline void leaf_boxes_set(leaf_boxes *b, const qm_collide_leaf *p, const qm_collide_leaf *q)
{
    b->p = p;
    b->q = q;
    b->shift[0] = (float)(q->center.x - p->center.x);
    b->shift[1] = (float)(q->center.y - p->center.y);
    b->shift[2] = (float)(q->center.z - p->center.z);
    float far = fabsf(b->shift[0]) + fabsf(b->shift[1]) + fabsf(b->shift[2]);
    b->error = p->error + q->error + 2.0f * QM_LEAF_ROUNDING * (far + q->reach + p->reach);
    b->low = leaf_shift(wide_load(q->low), b->shift, -2.0f * b->error);
    b->high = leaf_shift(wide_load(q->high), b->shift, 2.0f * b->error);
}

/** Bits of p's lanes whose boxes meet that of q. */
static inline unsigned leaf_boxes_lanes(const leaf_boxes *b)
{
    const qm_collide_leaf *p = b->p, *q = b->q;
    qm_vi apart = {0};
    float margin = 2.0f * b->error;
    for (int k = 0; k < 3; k++) {
        float low = q->box_low[k] + b->shift[k] - margin, high = q->box_high[k] + b->shift[k] + margin;
        apart |= (wide_load_row(p->low[k]) > high) | (wide_load_row(p->high[k]) < low);
    }
    return ~qm_vi_bits(apart) & ((1u << p->lane_count) - 1);
}

/** Bits of q's lanes whose boxes meet that of p's lane i. */
static inline unsigned leaf_boxes_near(const leaf_boxes *b, int i)
{
    const qm_collide_leaf *p = b->p;
    qm_vi apart = (b->low.x > p->high[0][i]) | (b->high.x < p->low[0][i]);
    apart |= (b->low.y > p->high[1][i]) | (b->high.y < p->low[1][i]);
    apart |= (b->low.z > p->high[2][i]) | (b->high.z < p->low[2][i]);
    return ~qm_vi_bits(apart) & ((1u << b->q->lane_count) - 1);
}

#endif
