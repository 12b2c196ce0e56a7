/**
 * collide_search.h: the inside of a search for pairs of faces, shared by the questions that it answers.
 */
#ifndef QM_COLLIDE_SEARCH_H
#define QM_COLLIDE_SEARCH_H

#include "bvh/collide_leaf.h"
#include "collide_changes.h"
#include "collide_pairs.h"

typedef struct qm_collide_search {
    qm_context *ctx;
    const qm_bvh *bvh[2];
    qm_collide_kind kind; /* TWIN and SELF have the same tree twice */
    const qm_collide_options *options;
    const qm_change_marks *marks; /* of a pair one must have moved; NULL: everything is looked at */
} qm_collide_search;

/** QM_OK, or QM_E_ARGUMENT with words. */
qm_status qm_collide_check_options(qm_context *ctx, const qm_collide_options *options);

/** QM_OK, or QM_E_SCALE with words when coordinates are too large, or sizes too different, to compare. */
qm_status qm_collide_check_scale(qm_context *ctx, const qm_bvh *a, const qm_bvh *b);

/** Whether two meshes are the same, bit by bit. */
bool qm_collide_are_twins(const qm_mesh *a, const qm_mesh *b);

/** Finds the pairs and adds them to list, each once or more; with a mode other than all, at most one. */
qm_status qm_collide_run(const qm_collide_search *search, qm_pair_list *list, uint64_t *tests);

#endif
