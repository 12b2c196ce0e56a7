/**
 * descend.c: pairs of nodes of two box trees whose boxes meet, one box against eight at a time.
 */
#include "box.h"
#include "bvh/collide_leaf.h"
#include "four.h"
#include "kernels.h"

#define LARGEST 1e37 /* coordinates beyond it are all alike: far outside */

static inline qm_vf load(const float *p)
{
    return *(const qm_vf *)(const void *)p;
}

/** Bits of the members of a group whose boxes meet a box. */
static inline unsigned group_meets(const qm_box_node *group, const float low[3], const float high[3])
{
    qm_vi apart = {0};
    for (int k = 0; k < 3; k++)
        apart |= (load(group->low[k]) > high[k]) | (load(group->high[k]) < low[k]);
    return ~qm_vi_bits(apart) & 0xff;
}

static inline unsigned member_bits(const qm_box_tree *tree, const qm_node *node)
{
    return (1u << qm_box_tree_child_count(tree, node->level, node->index)) - 1;
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

/** The same of one side of eight boxes along an axis; outward is 1 for their high sides, -1 for the low
 * ones. */
static inline void change_row(const float row[8], double scale, double shift, float outward, float out[8])
{
    const qm_four largest = (qm_four){0} + LARGEST;
    for (int at = 0; at < 8; at += 4) {
        qm_four_floats from;
        memcpy(&from, row + at, sizeof from);
        qm_four to = __builtin_convertvector(from, qm_four) * scale + shift;
        qm_four_floats rounded = qm_four_round(qm_four_min(qm_four_max(to, -largest), largest));
        qm_four_floats widened =
            rounded + outward * (qm_four_farther((qm_four_floats){0}, rounded) * 0x1p-23f + 0x1p-126f);
        memcpy(out + at, &widened, sizeof widened);
    }
}

static inline void change_group(const qm_box_node *group, const qm_frame_change *change, qm_box_node *out)
{
    for (int k = 0; k < 3; k++) {
        change_row(group->low[k], change->scale_ab, change->shift_ab[k], -1.0f, out->low[k]);
        change_row(group->high[k], change->scale_ab, change->shift_ab[k], 1.0f, out->high[k]);
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
    const qm_box_node *group = &d->a->groups[node->level][node->index];
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

/** Bits of the pairs of members of two groups whose boxes meet: of members i and j bit 8 i + j. */
static inline uint64_t groups_meet(const qm_box_node *a, const qm_box_node *b)
{
    uint64_t meets = 0;
    for (int i = 0; i < 8; i++) {
        const float low[3] = {a->low[0][i], a->low[1][i], a->low[2][i]},
                    high[3] = {a->high[0][i], a->high[1][i], a->high[2][i]};
        meets |= (uint64_t)group_meets(b, low, high) << (8 * i);
    }
    return meets;
}

/** All pairs of members of two nodes of one level that meet: both are split at once. */
static bool descend_both(const qm_descent *d, const qm_node *a, const qm_node *b)
{
    qm_box_node of_b;
    change_group(&d->b->groups[b->level][b->index], &d->change, &of_b);
    int members_a = qm_box_tree_child_count(d->a, a->level, a->index);
    uint64_t meets = groups_meet(&d->a->groups[a->level][a->index], &of_b);
    meets &= ~UINT64_C(0) >> (64 - 8 * members_a) & UINT64_C(0x0101010101010101) * member_bits(d->b, b);
    for (; meets; meets &= meets - 1) {
        int pair = __builtin_ctzll(meets);
        qm_node first = qm_node_child(d->a, a, pair / 8), second = qm_node_child(d->b, b, pair % 8);
        if (!descend(d, &first, &second)) return false;
    }
    return true;
}

static bool descend(const qm_descent *d, const qm_node *a, const qm_node *b)
{
    if (a->level <= d->stop_level && b->level <= d->stop_level) return d->take(d->user, a, b);
    if (d->is_one && a->level == b->level && a->index == b->index) return descend_self(d, a);
    if (!d->is_one && !d->marked && a->level == b->level) return descend_both(d, a, b);
    bool splits_a = a->level >= b->level;
    const qm_box_tree *tree = splits_a ? d->a : d->b;
    const qm_node *split = splits_a ? a : b, *whole = splits_a ? b : a;
    const qm_box_node *group = &tree->groups[split->level][split->index];
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
    qm_box_node_within(&tree->groups[split->level][split->index], &query, 0.0f, squares);
    memcpy(d2, squares, sizeof squares);
    return member_bits(tree, split);
}
