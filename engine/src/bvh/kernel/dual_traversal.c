/**
 * dual_traversal.c: visits the pairs of nodes of two box trees whose boxes meet, one box against eight at a
 * time.
 */
#include "box.h"
#include "bvh/node_pairs.h"
#include "four.h"
#include "kernels.h"

#define MAX_COORDINATE 1e37 /* coordinates are clamped to this: all beyond are far outside */

static inline qm_vf load(const float *p)
{
    return *(const qm_vf *)(const void *)p;
}

/** Bits of the children of a node whose boxes meet a box. */
static inline unsigned boxes_meet(const qm_box_node *boxes, const float low[3], const float high[3])
{
    qm_vi apart = {0};
    for (int k = 0; k < 3; k++)
        apart |= (load(boxes->low[k]) > high[k]) | (load(boxes->high[k]) < low[k]);
    return ~qm_vi_bits(apart) & 0xff;
}

static inline unsigned child_bits(const qm_box_tree *tree, const qm_node *node)
{
    return (1u << qm_box_tree_child_count(tree, node->level, node->index)) - 1;
}

static inline bool is_marked(const qm_dual_traversal *d, const qm_node *node)
{
    return d->marked[node->level][node->index];
}

/** The box of a node in the local space of the other tree, enlarged by the roundings. Where boxes meet at
 * all, their margins cover the rounding of the shift. */
static inline void change_box(const qm_node *node, double scale, const double shift[3], float low[3],
                              float high[3])
{
    for (int k = 0; k < 3; k++) {
        low[k] = qm_float_below(
            qm_clamp((double)node->low[k] * scale + shift[k], -MAX_COORDINATE, MAX_COORDINATE));
        high[k] = qm_float_above(
            qm_clamp((double)node->high[k] * scale + shift[k], -MAX_COORDINATE, MAX_COORDINATE));
    }
}

/** Changes one side of eight boxes along an axis as change_box does; outward is 1 for high sides, -1 for low
 * sides. */
static inline void change_side(const float row[8], double scale, double shift, float outward, float out[8])
{
    const qm_four max = (qm_four){0} + MAX_COORDINATE;
    for (int at = 0; at < 8; at += 4) {
        qm_four_floats from;
        memcpy(&from, row + at, sizeof from);
        qm_four to = __builtin_convertvector(from, qm_four) * scale + shift;
        qm_four_floats rounded = qm_four_round(qm_four_min(qm_four_max(to, -max), max));
        qm_four_floats widened =
            rounded + outward * (qm_four_max_magnitude((qm_four_floats){0}, rounded) * 0x1p-23f + 0x1p-126f);
        memcpy(out + at, &widened, sizeof widened);
    }
}

static inline void change_node(const qm_box_node *boxes, const qm_frame_change *change, qm_box_node *out)
{
    for (int k = 0; k < 3; k++) {
        change_side(boxes->low[k], change->scale_ab, change->shift_ab[k], -1.0f, out->low[k]);
        change_side(boxes->high[k], change->scale_ab, change->shift_ab[k], 1.0f, out->high[k]);
    }
}

static bool descend(const qm_dual_traversal *d, const qm_node *a, const qm_node *b);

/** Visits a pair unless neither node is marked. */
static inline bool visit_pair(const qm_dual_traversal *d, const qm_node *a, const qm_node *b)
{
    if (d->marked && !is_marked(d, a) && !is_marked(d, b)) return true;
    return descend(d, a, b);
}

/** Visits all pairs of children of one node, each with itself too. */
static bool descend_self(const qm_dual_traversal *d, const qm_node *node)
{
    const qm_box_node *boxes = &d->a->groups[node->level][node->index];
    unsigned children = child_bits(d->a, node);
    for (int i = 0; children >> i; i++) {
        qm_node first = qm_node_child(d->a, node, i);
        unsigned meets = boxes_meet(boxes, first.low, first.high) & children & ~0u << i;
        for (meets |= 1u << i; meets; meets &= meets - 1) {
            qm_node second = qm_node_child(d->a, node, __builtin_ctz(meets));
            if (!visit_pair(d, &first, &second)) return false;
        }
    }
    return true;
}

/** Bits of the pairs of children of two nodes whose boxes meet: bit 8 i + j for children i and j. */
static inline uint64_t all_boxes_meet(const qm_box_node *a, const qm_box_node *b)
{
    uint64_t meets = 0;
    for (int i = 0; i < 8; i++) {
        const float low[3] = {a->low[0][i], a->low[1][i], a->low[2][i]},
                    high[3] = {a->high[0][i], a->high[1][i], a->high[2][i]};
        meets |= (uint64_t)boxes_meet(b, low, high) << (8 * i);
    }
    return meets;
}

/** Visits all pairs of children of two nodes of one level that meet: splits both at once. */
static bool descend_both(const qm_dual_traversal *d, const qm_node *a, const qm_node *b)
{
    qm_box_node of_b;
    change_node(&d->b->groups[b->level][b->index], &d->change, &of_b);
    int children_a = qm_box_tree_child_count(d->a, a->level, a->index);
    uint64_t meets = all_boxes_meet(&d->a->groups[a->level][a->index], &of_b);
    meets &= ~UINT64_C(0) >> (64 - 8 * children_a) & UINT64_C(0x0101010101010101) * child_bits(d->b, b);
    for (; meets; meets &= meets - 1) {
        int pair = __builtin_ctzll(meets);
        qm_node first = qm_node_child(d->a, a, pair / 8), second = qm_node_child(d->b, b, pair % 8);
        if (!descend(d, &first, &second)) return false;
    }
    return true;
}

static bool descend(const qm_dual_traversal *d, const qm_node *a, const qm_node *b)
{
    if (a->level <= d->stop_level && b->level <= d->stop_level) return d->take(d->user, a, b);
    if (d->is_one && a->level == b->level && a->index == b->index) return descend_self(d, a);
    if (!d->is_one && !d->marked && a->level == b->level) return descend_both(d, a, b);
    bool splits_a = a->level >= b->level;
    const qm_box_tree *tree = splits_a ? d->a : d->b;
    const qm_node *split = splits_a ? a : b, *kept = splits_a ? b : a;
    const qm_box_node *boxes = &tree->groups[split->level][split->index];
    unsigned meets;
    if (d->is_one) {
        meets = boxes_meet(boxes, kept->low, kept->high);
    } else {
        float low[3], high[3];
        change_box(kept, splits_a ? d->change.scale_ab : d->change.scale_ba,
                   splits_a ? d->change.shift_ab : d->change.shift_ba, low, high);
        meets = boxes_meet(boxes, low, high);
    }
    for (meets &= child_bits(tree, split); meets; meets &= meets - 1) {
        qm_node child = qm_node_child(tree, split, __builtin_ctz(meets));
        if (!visit_pair(d, splits_a ? &child : a, splits_a ? b : &child)) return false;
    }
    return true;
}

bool QM_KERNEL(descend)(const qm_dual_traversal *d, const qm_node *a, const qm_node *b)
{
    QM_ASSERT(a->level <= d->a->level_count && b->level <= d->b->level_count && d->stop_level >= 0);
    return visit_pair(d, a, b);
}

unsigned QM_KERNEL(node_distances)(const qm_dual_traversal *d, const qm_node *a, const qm_node *b,
                                   bool splits_a, float d2[QM_PACK_LANES])
{
    const qm_box_tree *tree = splits_a ? d->a : d->b;
    const qm_node *split = splits_a ? a : b, *kept = splits_a ? b : a;
    qm_box_query query;
    change_box(kept, splits_a ? d->change.scale_ab : d->change.scale_ba,
               splits_a ? d->change.shift_ab : d->change.shift_ba, query.low, query.high);
    _Alignas(32) float squares[QM_PACK_LANES];
    qm_box_node_within(&tree->groups[split->level][split->index], &query, 0.0f, squares);
    memcpy(d2, squares, sizeof squares);
    return child_bits(tree, split);
}
