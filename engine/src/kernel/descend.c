/**
 * descend.c: pairs of nodes of two box trees whose boxes meet, one box against eight at a time.
 */
#include "../collide_leaf.h"
#include "box.h"
#include "kernels.h"

#define LARGEST 1e37 /* coordinates beyond it are all alike: far outside */

static inline qm_vf load(const float *p)
{
    return *(const qm_vf *)(const void *)p;
}

/** Bits of the members of a group whose boxes meet a box. */
static inline unsigned group_meets(const qm_box_group *group, const float low[3], const float high[3])
{
    qm_vi apart = {0};
    for (int k = 0; k < 3; k++)
        apart |= (load(group->low[k]) > high[k]) | (load(group->high[k]) < low[k]);
    return ~qm_vi_bits(apart) & 0xff;
}

static inline unsigned member_bits(const qm_box_tree *tree, const qm_node *node)
{
    return (1u << qm_box_tree_member_count(tree, node->level, node->index)) - 1;
}

static inline bool is_marked(const qm_descent *d, const qm_node *node)
{
    return d->marked[node->level][node->index];
}

/** The box of a node in the frame of the other tree, widened by what rounding may do. Where boxes meet at
 * all, their margins cover the rounding of the shift. */
static inline void change_box(const qm_node *node, double scale, const double shift[3], float low[3],
                              float high[3])
{
    for (int k = 0; k < 3; k++) {
        low[k] = qm_float_below(qm_clamp((double)node->low[k] * scale + shift[k], -LARGEST, LARGEST));
        high[k] = qm_float_above(qm_clamp((double)node->high[k] * scale + shift[k], -LARGEST, LARGEST));
    }
}

static bool descend(const qm_descent *d, const qm_node *a, const qm_node *b);

static inline bool take_pair(const qm_descent *d, const qm_node *a, const qm_node *b)
{
    if (d->marked && !is_marked(d, a) && !is_marked(d, b)) return true;
    return descend(d, a, b);
}

/** All pairs of members of one node, each with itself too. */
static bool descend_self(const qm_descent *d, const qm_node *node)
{
    const qm_box_group *group = &d->a->groups[node->level][node->index];
    unsigned members = member_bits(d->a, node);
    for (int i = 0; members >> i; i++) {
        qm_node first = qm_node_child(d->a, node, i);
        unsigned meets = group_meets(group, first.low, first.high) & members & ~0u << i;
        for (meets |= 1u << i; meets; meets &= meets - 1) {
            qm_node second = qm_node_child(d->a, node, __builtin_ctz(meets));
            if (!take_pair(d, &first, &second)) return false;
        }
    }
    return true;
}

static bool descend(const qm_descent *d, const qm_node *a, const qm_node *b)
{
    if (a->level <= d->stop_level && b->level <= d->stop_level) return d->take(d->user, a, b);
    if (d->is_one && a->level == b->level && a->index == b->index) return descend_self(d, a);
    bool splits_a = a->level >= b->level;
    const qm_box_tree *tree = splits_a ? d->a : d->b;
    const qm_node *split = splits_a ? a : b, *whole = splits_a ? b : a;
    const qm_box_group *group = &tree->groups[split->level][split->index];
    unsigned meets;
    if (d->is_one) {
        meets = group_meets(group, whole->low, whole->high);
    } else {
        float low[3], high[3];
        change_box(whole, splits_a ? d->change.scale_ab : d->change.scale_ba,
                   splits_a ? d->change.shift_ab : d->change.shift_ba, low, high);
        meets = group_meets(group, low, high);
    }
    for (meets &= member_bits(tree, split); meets; meets &= meets - 1) {
        qm_node child = qm_node_child(tree, split, __builtin_ctz(meets));
        if (!take_pair(d, splits_a ? &child : a, splits_a ? b : &child)) return false;
    }
    return true;
}

bool QM_KERNEL(descend)(const qm_descent *d, const qm_node *a, const qm_node *b)
{
    return take_pair(d, a, b);
}

unsigned QM_KERNEL(node_distances)(const qm_descent *d, const qm_node *a, const qm_node *b, bool splits_a,
                                   float d2[QM_PACK_LANES])
{
    const qm_box_tree *tree = splits_a ? d->a : d->b;
    const qm_node *split = splits_a ? a : b, *whole = splits_a ? b : a;
    qm_box_query query;
    change_box(whole, splits_a ? d->change.scale_ab : d->change.scale_ba,
               splits_a ? d->change.shift_ab : d->change.shift_ba, query.low, query.high);
    _Alignas(32) float squares[QM_PACK_LANES];
    qm_box_group_within(&tree->groups[split->level][split->index], &query, 0.0f, squares);
    memcpy(d2, squares, sizeof squares);
    return member_bits(tree, split);
}
