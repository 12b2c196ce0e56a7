/**
 * collide_changes.h: which parts of a tree hold faces that have moved, for looking at those alone.
 */
#ifndef QM_COLLIDE_CHANGES_H
#define QM_COLLIDE_CHANGES_H

#include "bvh/collide_leaf.h"
#include "collide_pairs.h"

/** Marks of one deformation. All zero is an empty one. */
typedef struct qm_change_marks {
    uint8_t *vertex;                /* moved */
    uint8_t *face;                  /* of the input: one of its vertices has moved */
    uint8_t *level[QM_TREE_LEVELS]; /* of each node: [0][pack] has a bit for each lane that has moved */
} qm_change_marks;

/** Marks the faces of the moved vertices and the nodes above them. QM_OK; QM_E_INDEX (ctx->message names the
 * entry); QM_E_NO_MEMORY. qm_change_marks_reset frees in any case. */
qm_status qm_change_marks_set(qm_context *ctx, const qm_bvh *bvh, const qm_collide_changes *changes,
                              qm_change_marks *out);
void qm_change_marks_reset(qm_context *ctx, const qm_bvh *bvh, qm_change_marks *marks);

/** Adds the pairs of before whose faces have not moved. QM_OK; QM_E_INDEX; QM_E_NO_MEMORY. */
qm_status qm_change_marks_keep(qm_context *ctx, const qm_bvh *bvh, const qm_change_marks *marks,
                               const qm_collide_changes *changes, qm_pair_list *list);

#endif
