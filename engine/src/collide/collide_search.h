/**
 * collide_search.h: the search for pairs of faces that meet, as the files of this folder share it.
 *
 *   collide.c            the calls; after a deformation, which faces have moved and which pairs are kept
 *   collide_search.c     the traversal of both trees at once, split into tasks for the workers
 *   collide_packs.c      two packs: filters in single precision, eight triangles at a time, then exact tests
 *   collide_faces.c      two faces: exact or, for bilinear quads, to within the tolerance; and where they
 * meet   collide_pairs.c      lists of pairs, and how they are sorted
 *   collide_overlap.c    the faces of two meshes that can meet at all, found by a grid before there are trees
 *   distance.c           the minimal distance of two surfaces
 *
 * Words (engine/COLLISION.md has the whole):
 *   facet            a triangle, or half of a quad, in one lane of a pack
 *   pack             a leaf of the bounding volume hierarchy: up to eight facets
 *   leaf             a pack prepared for the filter: single precision, relative to its own centre (qm_collide_leaf)
 *   identical copy   a mesh with the same arrays, bit by bit: one tree serves for both (QM_COLLIDE_COPY)
 *   alike            two facets with a corner of the same mark: the same vertex, or the same position
 *   open             left to the exact test by the filter
 *   input face       a face in the numbering of the file, which qm_mesh_input_face gives
 */
#ifndef QM_COLLIDE_SEARCH_H
#define QM_COLLIDE_SEARCH_H

#include "bvh/kernel.h"
#include "collide_pairs.h"

/** Which faces a deformation has moved, and which nodes of the tree hold any. All zero is empty. */
typedef struct qm_motion_marks {
    uint8_t *vertex;                /* of each vertex: whether it has moved */
    uint8_t *face;                  /* of each input face: whether one of its vertices has */
    uint8_t *level[QM_TREE_LEVELS]; /* of each node: [0][pack] has a bit for each lane that has moved */
} qm_motion_marks;

/** The request: one of the calls of collide.h. */
typedef struct qm_collide_search {
    qm_context *ctx;
    const qm_bvh *bvh[2];
    qm_collide_kind kind; /* COPY and SELF have the same tree twice */
    const qm_collide_options *options;
    const qm_motion_marks *marks; /* one face of a pair must have moved; NULL: all pairs are tested */
} qm_collide_search;

#define QM_CACHED_LEAVES 64 /* of each mesh and worker: neighbours in the tree come up again soon */

/** One thread's share of a search. */
typedef struct qm_collide_worker {
    const qm_collide_search *search;
    const qm_kernel *kernel;
    atomic_int *status;        /* of all workers: the first that isn't QM_OK ends the search */
    qm_collide_leaf *cache[2]; /* QM_CACHED_LEAVES of each mesh */
    qm_lane_pairs *waiting;    /* in TWO: pairs of facets that are not decided yet */
    bool seeks_alike;          /* in TWO: whether the filter looks for facets with a common corner */
    size_t alike;              /* how many it has found since pairs were decided last */
    qm_pair_list pairs;
    uint64_t first_pair; /* in mode FIRST: the first pair so far, a in the upper half */
    uint64_t tests, leaf_pairs;
    bool is_done;
} qm_collide_worker;

/** Two packs and which of their lanes have moved: all of them in a search without marks. */
typedef struct qm_pack_pair {
    uint32_t pack[2];
    unsigned moved[2];
} qm_pack_pair;

/** QM_OK, or QM_E_ARGUMENT with a message. */
qm_status qm_collide_check_options(qm_context *ctx, const qm_collide_options *options);

/** QM_OK, or QM_E_SCALE with a message when coordinates are too large, or sizes too different, to compare. */
qm_status qm_collide_check_scale(qm_context *ctx, const qm_bvh *a, const qm_bvh *b);

/** Whether two meshes are identical copies. */
bool qm_collide_are_identical(const qm_mesh *a, const qm_mesh *b);

/** Finds the pairs and adds them to the list, each at least once; in modes FIRST and ANY, at most one pair.
 * QM_OK; QM_E_TOO_LARGE; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_collide_run(const qm_collide_search *search, qm_pair_list *list, uint64_t *tests);

/** Tests the facets of two packs, all as triangles, and records the pairs that meet; false when the search
 * may end. */
bool qm_collide_triangles(qm_collide_worker *w, const qm_pack_pair *packs);

/** Tests the faces of two packs, quads as bilinear patches; false when the search may end. */
bool qm_collide_patches(qm_collide_worker *w, const qm_pack_pair *packs);

/** Decides the waiting pairs; false when the search may end. */
bool qm_collide_decide(qm_collide_worker *w);

/** Sets the status of all workers, unless one has failed before. */
static inline void qm_collide_stop(atomic_int *search_status, qm_status status)
{
    int expected = QM_OK;
    atomic_compare_exchange_strong(search_status, &expected, (int)status);
}

#endif
