/**
 * collide_worker.h: one thread's part of a search for pairs of faces: what it holds, what it does with a pair
 * of packs, and how it keeps the pairs of faces that meet.
 */
#ifndef QM_COLLIDE_WORKER_H
#define QM_COLLIDE_WORKER_H

#include "bvh/kernel.h"
#include "collide_search.h"

#define QM_CACHED_LEAVES 64 /* of each mesh and worker: neighbours in the tree come up again soon */

typedef struct qm_collide_worker {
    const qm_collide_search *search;
    const qm_kernel *kernel;
    atomic_int *status;     /* of all workers: the first that isn't QM_OK ends the search */
    qm_leaf *cache[2];      /* QM_CACHED_LEAVES of each mesh */
    qm_lane_pairs *waiting; /* in TWO: pairs of triangles that are not decided yet */
    bool seeks_alike;       /* in TWO: whether to look for triangles with a common corner */
    size_t alike;           /* how many were found since pairs were decided last */
    qm_pair_list pairs;
    uint64_t least; /* mode first: the least pair so far */
    uint64_t tests, leaf_pairs;
    bool is_done;
} qm_collide_worker;

/** Two packs and which of their lanes have moved, where that counts: all of them otherwise. */
typedef struct qm_pack_pair {
    uint32_t pack[2];
    unsigned moved[2];
} qm_pack_pair;

/** Compares the faces of two packs as triangles, or with quads as patches, and keeps the pairs that meet;
 * false when the search may end. */
bool qm_collide_triangles(qm_collide_worker *w, const qm_pack_pair *packs);
bool qm_collide_patches(qm_collide_worker *w, const qm_pack_pair *packs);

/** Decides the pairs that wait; false when the search may end. */
bool qm_collide_decide(qm_collide_worker *w);

static inline void qm_collide_stop(atomic_int *search_status, qm_status status)
{
    int expected = QM_OK;
    atomic_compare_exchange_strong(search_status, &expected, (int)status);
}

/** Two faces in the numbering of the input as a pair; false when they are one, or not wanted. */
static inline bool qm_collide_wants(const qm_collide_worker *w, uint32_t a, uint32_t b, qm_face_pair *out)
{
    bool is_self = w->search->kind == QM_COLLIDE_SELF, turns = is_self && a > b;
    *out = (qm_face_pair){turns ? b : a, turns ? a : b};
    return !(is_self && a == b) && ((uint64_t)out->a << 32 | out->b) < w->least;
}

/** Keeps a pair as the mode asks for it; false when the search may end. */
static inline bool qm_collide_keep(qm_collide_worker *w, qm_face_pair pair)
{
    const qm_collide_options *options = w->search->options;
    if (options->mode == QM_COLLIDE_FIRST) {
        w->least = (uint64_t)pair.a << 32 | pair.b; /* it was wanted, so it is less */
        return true;
    }
    if (!qm_pair_list_add(w->search->ctx, &w->pairs, pair)) {
        qm_collide_stop(w->status, QM_E_NO_MEMORY);
        return false;
    }
    return options->mode == QM_COLLIDE_ALL;
}

#endif
