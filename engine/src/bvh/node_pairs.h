/**
 * node_pairs.h: what the kernels that compare two trees work on: pairs of nodes, which a dual traversal
 * visits; pairs of packs, each prepared for comparing it with eight other triangles at a time
 * (qm_collide_leaf); and pairs of their lanes.
 */
#ifndef QM_NODE_PAIRS_H
#define QM_NODE_PAIRS_H

#include "bvh_tree.h"

/* ---- pairs of nodes ---- */

/** A node of a tree (level 1 and up) or one of its leaves (a pack, level 0), with its box in the tree's local
 * space. */
typedef struct qm_node {
    int level;
    uint32_t index;
    float low[3], high[3];
} qm_node;

/** The map between the local spaces of two trees: x_a = scale_ab * x_b + shift_ab, and back. */
typedef struct qm_frame_change {
    double scale_ab, scale_ba, shift_ab[3], shift_ba[3];
} qm_frame_change;

/** A dual traversal: visits the pairs of nodes of two trees whose boxes meet. */
typedef struct qm_dual_traversal {
    const qm_box_tree *a, *b;
    qm_frame_change change;
    bool is_one;            /* a is b: every pair once, each node with itself too */
    int stop_level;         /* a pair goes to take once both nodes are at this level or below it */
    uint8_t *const *marked; /* [level][index]: one node of a pair must be marked; NULL: all are */
    bool (*take)(void *user, const qm_node *a, const qm_node *b); /* false ends the traversal */
    void *user;
} qm_dual_traversal;

/** The root of a tree, with a box that holds everything. */
static inline qm_node qm_node_root(const qm_box_tree *tree)
{
    return (qm_node){.level = tree->level_count,
                     .low = {-INFINITY, -INFINITY, -INFINITY},
                     .high = {INFINITY, INFINITY, INFINITY}};
}

/** A child of a node, with its box. */
static inline qm_node qm_node_child(const qm_box_tree *tree, const qm_node *node, int i)
{
    QM_ASSERT(node->level >= 1 && i >= 0 && i < qm_box_tree_child_count(tree, node->level, node->index));
    const qm_box_node *boxes = &tree->groups[node->level][node->index];
    qm_node child = {.level = node->level - 1, .index = 8 * node->index + (uint32_t)i};
    for (int k = 0; k < 3; k++) {
        child.low[k] = boxes->low[k][i];
        child.high[k] = boxes->high[k][i];
    }
    return child;
}

static inline qm_frame_change qm_frame_change_make(const qm_frame *a, const qm_frame *b)
{
    qm_vec ab = qm_vec_sub(b->origin, a->origin);
    return (qm_frame_change){
        .scale_ab = a->scale * b->inverse_scale,
        .scale_ba = b->scale * a->inverse_scale,
        .shift_ab = {ab.x * a->scale, ab.y * a->scale, ab.z * a->scale},
        .shift_ba = {-ab.x * b->scale, -ab.y * b->scale, -ab.z * b->scale},
    };
}

/* ---- pairs of packs ---- */

#define QM_LEAF_NONE UINT32_MAX
#define QM_LEAF_ROUNDING 0x1p-23f /* of a coordinate in single precision, relative; twice the true one */
#define QM_LEAF_UNDERFLOW 1e-36f  /* more than products of coordinates lose to underflow */

/** Whose faces are compared. */
typedef enum qm_collide_kind {
    QM_COLLIDE_TWO,  /* those of two meshes */
    QM_COLLIDE_COPY, /* those of a mesh and an identical copy: of one tree, where pairs count both ways */
    QM_COLLIDE_SELF  /* those of one mesh, where neighbors may touch */
} qm_collide_kind;

/**
 * A pack prepared for pair tests. It keeps its corners in single precision relative to its own center. That
 * is accurate to a few parts in ten million of its size wherever it lies; the filter knows its errors and
 * leaves to exact tests what it cannot decide.
 */
typedef struct qm_collide_leaf {
    _Alignas(32) float corner[3][3][QM_PACK_LANES]; /* [corner][axis][lane], from the center */
    union {
        /* In TWO: x, y, z from the center and the mark, as the bits of a float. */
        float vertex[3 * QM_PACK_LANES][4];
        /* Else: a normal and its product with a point of the plane: the plane of the triangle, then the
         * planes through its edges, facing outward. */
        float plane[4][4][QM_PACK_LANES];
    };
    float low[3][QM_PACK_LANES], high[3][QM_PACK_LANES];
    float size[QM_PACK_LANES]; /* the longest side of the lane's box and a little more */
    /* Equal for corners that coincide: within one mesh the vertex, between two a hash of the position. */
    uint32_t mark[3][QM_PACK_LANES];
    qm_vec center;                 /* in the local space of the search */
    float box_low[3], box_high[3]; /* of all lanes, from the center */
    float reach;                   /* max coordinate of a corner by magnitude */
    float error; /* of every coordinate, center included; INFINITY: out of the filter's range */
    uint32_t pack, lane_count;
    uint8_t corner_vertex[QM_PACK_LANES][3]; /* index in vertex[] of each lane's corners */
} qm_collide_leaf;

/* ---- pairs of lanes ---- */

/** Pairs of lanes of two packs: bit 8 i + j is the pair of lane i with the other's lane j. */
typedef struct qm_near_lanes {
    uint64_t near;  /* may meet: all others do not */
    uint64_t alike; /* of those, pairs with a corner of equal mark; none in SELF */
    /* [lane][other lane], in TWO where alike: the corner of either, as 4 * its own + the other's. */
    _Alignas(32) int32_t corners[QM_PACK_LANES][QM_PACK_LANES];
} qm_near_lanes;

#define QM_PAIRS_BATCH 64 /* pairs of lanes that are decided together */
#define QM_PAIRS_CAPACITY (QM_PAIRS_BATCH + QM_PACK_LANES * QM_PACK_LANES)

/** Pairs of lanes of two packs that are not decided yet; the kernel decides eight at a time. */
typedef struct qm_lane_pairs {
    /* [of the first or second pack][corner][pair]: entries of vertex[] of the prepared pack. */
    _Alignas(32) float corner[2][3][QM_PAIRS_CAPACITY][4];
    float shift[QM_PAIRS_CAPACITY][4]; /* x, y, z from the first center to the second; the coordinate error */
    uint32_t lane[2][QM_PAIRS_CAPACITY]; /* [first or second]: QM_PACK_LANES * its pack + the lane */
    unsigned count;
} qm_lane_pairs;

/** Single-precision verdicts on eight pairs of lanes, a bit each: pairs in neither set do not meet. */
typedef struct qm_pair_verdicts {
    unsigned meet, open; /* proven to meet; left to exact tests */
} qm_pair_verdicts;

#endif
