/**
 * collide_leaf.h: what the collision kernels work on: pairs of nodes of two box trees, and leaves, which are
 * packs of eight triangles made ready for comparing them with eight others at a time.
 *
 * A leaf keeps its corners in single precision relative to its own middle. That is accurate to a few parts in
 * ten million of the leaf's size wherever it lies; the filter knows its errors and leaves what it can't tell
 * to exact tests.
 */
#ifndef QM_COLLIDE_LEAF_H
#define QM_COLLIDE_LEAF_H

#include "bvh_tree.h"

#define QM_LEAF_NONE UINT32_MAX
#define QM_LEAF_ROUNDING 0x1p-23f /* of a coordinate in single precision, relative; twice what is */
#define QM_LEAF_UNDERFLOW 1e-36f  /* more than what products of coordinates lose to underflow */

/** Whose faces are compared. */
typedef enum qm_collide_kind {
    QM_COLLIDE_TWO,  /* those of two meshes */
    QM_COLLIDE_TWIN, /* those of a mesh and an equal one: of one tree, where pairs count both ways */
    QM_COLLIDE_SELF  /* those of one mesh, where neighbours may touch */
} qm_collide_kind;

/** Pairs of lanes of two leaves: of lane i with the other's lane j bit 8 i + j. */
typedef struct qm_near_lanes {
    uint64_t near;  /* may meet: all others don't */
    uint64_t alike; /* of those, ones that have a corner of the same mark; none in SELF */
    /* [lane][other lane], in TWO where they are alike: the corner of either, as 4 * its own + the other's */
    _Alignas(32) int32_t corners[QM_PACK_LANES][QM_PACK_LANES];
} qm_near_lanes;

#define QM_PAIRS_ENOUGH 64 /* pairs of lanes that are decided together */
#define QM_PAIRS_MOST (QM_PAIRS_ENOUGH + QM_PACK_LANES * QM_PACK_LANES)

/** Pairs of a lane of one leaf and one of another that wait to be decided, eight at a time. */
typedef struct qm_lane_pairs {
    _Alignas(
        32) float corner[2][3][QM_PAIRS_MOST][4]; /* [side][corner][pair], rows of vertex[] of its leaf */
    float shift[QM_PAIRS_MOST][4];   /* x, y, z of the second leaf's middle from the first one's; the error of
                                        every coordinate */
    uint32_t lane[2][QM_PAIRS_MOST]; /* [side][pair]: QM_PACK_LANES * its pack + the lane */
    unsigned count;
} qm_lane_pairs;

/** What single precision tells about eight pairs of lanes, a bit each: those in neither don't meet. */
typedef struct qm_pair_verdicts {
    unsigned meet, open; /* proven to meet; left to exact tests */
} qm_pair_verdicts;

typedef struct qm_leaf {
    _Alignas(32) float corner[3][3][QM_PACK_LANES]; /* [corner][axis][lane], from the middle */
    union {
        float vertex[3 * QM_PACK_LANES]
                    [4]; /* in TWO: x, y, z from the middle and the mark, as a float's bits */
        float plane[4][4][QM_PACK_LANES]; /* else: a normal and its product with a point of the plane: the
                                             triangle's own, then those through its edges, looking away from
                                             it */
    };
    float low[3][QM_PACK_LANES], high[3][QM_PACK_LANES];
    float size[QM_PACK_LANES];       /* the longest side of the lane's box and a little more */
    uint32_t mark[3][QM_PACK_LANES]; /* equal for corners that are one: the vertex within one mesh;
                                        between two, what its position is mixed to */
    qm_vec middle;                   /* in the frame of the search */
    float box_low[3], box_high[3];   /* of all lanes, from the middle */
    float reach;                     /* greatest coordinate of a corner by magnitude */
    float error; /* of every coordinate, middle included; INFINITY: out of the filter's range */
    uint32_t pack, lane_count;
    uint8_t place[QM_PACK_LANES][3]; /* of each lane's corners in vertex[] */
} qm_leaf;

/** A part of a tree: a pack (level 0) or a group, with its box in the tree's own frame. */
typedef struct qm_node {
    int level;
    uint32_t index;
    float low[3], high[3];
} qm_node;

/** b's frame as seen from a's and the other way round: x_a = scale_ab * x_b + shift_ab. */
typedef struct qm_frame_change {
    double scale_ab, scale_ba, shift_ab[3], shift_ba[3];
} qm_frame_change;

/** A walk over pairs of nodes whose boxes meet. */
typedef struct qm_descent {
    const qm_box_tree *a, *b;
    qm_frame_change change;
    bool is_one;            /* a is b: every pair once, each node with itself too */
    int stop_level;         /* pairs are handed out once both nodes are at this level or below it */
    uint8_t *const *marked; /* [level][index]: of a pair one must be marked; NULL: all are */
    bool (*take)(void *user, const qm_node *a, const qm_node *b); /* false ends the walk */
    void *user;
} qm_descent;

/** The root of a tree, whose box is everything. */
static inline qm_node qm_node_root(const qm_box_tree *tree)
{
    return (qm_node){.level = tree->level_count,
                     .low = {-INFINITY, -INFINITY, -INFINITY},
                     .high = {INFINITY, INFINITY, INFINITY}};
}

/** A member of a group, with its box. */
static inline qm_node qm_node_child(const qm_box_tree *tree, const qm_node *node, int member)
{
    const qm_box_node *group = &tree->groups[node->level][node->index];
    qm_node child = {.level = node->level - 1, .index = 8 * node->index + (uint32_t)member};
    for (int k = 0; k < 3; k++) {
        child.low[k] = group->low[k][member];
        child.high[k] = group->high[k][member];
    }
    return child;
}

/** How two frames lie to each other. */
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

#endif
