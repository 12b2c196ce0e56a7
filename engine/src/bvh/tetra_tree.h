/**
 * tetra_tree.h: the representation of a hierarchy of offset tetrahedra, shared by its builder and the
 * kernels.
 *
 * The nodes of one patch lie in preorder: the first half follows its parent, a link leads to the second. A
 * traversal finds the rows and columns that a node spans on the way down, always by the same cuts
 * (qm_tetra_part_cut).
 *
 *     nodes    { r, right: 4 } { r, leaf } { r, leaf } ...
 *     packs    ... | 12 13 | 13 17 18 | ...                 of the leaves, each pack once a leaf
 */
#ifndef QM_TETRA_TREE_H
#define QM_TETRA_TREE_H

#include "bvh_tree.h"
#include "qm/tetra.h"

#define QM_TETRA_COUNT_BITS 4 /* of a leaf's link: how many packs, below where they begin */

/** Radii are local lengths. */
typedef struct qm_tetra_node {
    float radius;
    uint32_t link; /* of a node: its second half; of a leaf: first pack << QM_TETRA_COUNT_BITS | packs */
} qm_tetra_node;

typedef struct qm_tetra_patch {
    uint32_t rows, columns;
    uint32_t node;   /* the root */
    size_t vertices; /* where the (rows + 1) x (columns + 1) vertices begin */
} qm_tetra_patch;

struct qm_tetra {
    const qm_bvh *bvh;
    qm_patch_set set; /* the arrays are borrowed */
    size_t patch_count, node_count, vertex_count, pack_count, pack_capacity;
    qm_frame frame;          /* of the tree when the radii were found */
    qm_tetra_patch *patches; /* in the order of the boxes above them: along the space-filling curve */
    uint32_t *set_patch;     /* patch_count: index of each patch in the set */
    qm_tetra_node *nodes;
    uint32_t *vertices;
    uint32_t *packs;
    uint32_t *face_slot;  /* by face: its index in the set's faces */
    uint32_t *face_patch; /* by face: the index of its patch in patches */
    qm_box_tree boxes;    /* over the patches */
};

/** A part of a patch: rows x columns of quads from quad (row, column) on, and its node. */
typedef struct qm_tetra_part {
    uint32_t row, column, rows, columns, node;
} qm_tetra_part;

static inline qm_tetra_part qm_tetra_part_root(const qm_tetra_patch *patch)
{
    return (qm_tetra_part){0, 0, patch->rows, patch->columns, patch->node};
}

static inline bool qm_tetra_part_is_leaf(const qm_tetra_part *part)
{
    return (uint64_t)part->rows * part->columns <= QM_TETRA_LEAF;
}

/** Cuts a part across its longer side. The caller sets the node of the second half, here that of the
 * first. */
static inline void qm_tetra_part_cut(const qm_tetra_part *part, qm_tetra_part half[2])
{
    QM_ASSERT(!qm_tetra_part_is_leaf(part));
    half[0] = half[1] = *part;
    half[0].node = half[1].node = part->node + 1;
    if (part->rows > part->columns) {
        half[0].rows = part->rows / 2;
        half[1].row += half[0].rows;
        half[1].rows -= half[0].rows;
    } else {
        half[0].columns = part->columns / 2;
        half[1].column += half[0].columns;
        half[1].columns -= half[0].columns;
    }
}

/** Vertices of the mesh at the corners of a part, in cyclic order. */
static inline void qm_tetra_part_corners(const qm_tetra *tetra, const qm_tetra_patch *patch,
                                         const qm_tetra_part *part, uint32_t corner[4])
{
    size_t width = (size_t)patch->columns + 1;
    const uint32_t *first = tetra->vertices + patch->vertices + part->row * width + part->column;
    const uint32_t *last = first + part->rows * width;
    corner[0] = first[0];
    corner[1] = first[part->columns];
    corner[2] = last[part->columns];
    corner[3] = last[0];
}

static inline qm_vec qm_tetra_vertex(const qm_tetra *tetra, uint32_t vertex)
{
    return qm_bvh_vertex(tetra->bvh, vertex);
}

#endif
