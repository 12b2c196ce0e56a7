/**
 * self_pairs.h: a cache of the self-collisions of a mesh in memory: the pairs of the last search, and the vertices that
 * have moved since, for each reading of quads. It ends when the mesh is evicted from memory; the next search is then a
 * full one.
 *
 * Threads: all functions may be called from any thread.
 */
#ifndef QM_SELF_PAIRS_H
#define QM_SELF_PAIRS_H

#include "qm/collide.h"

typedef struct qm_self_pairs qm_self_pairs;

/** NULL if memory runs out. */
qm_self_pairs *qm_self_pairs_create(size_t vertex_count);
void qm_self_pairs_destroy(qm_self_pairs *cache);

/** Replaces the cache by a copy of another mesh's with the same vertices and faces; empty if memory runs out. */
void qm_self_pairs_inherit(qm_self_pairs *cache, qm_self_pairs *other);

/** Records moved vertices; NULL means all, which empties the cache. */
void qm_self_pairs_move(qm_self_pairs *cache, const uint32_t *vertices, size_t count);

/** Stores the pairs of the current positions; the cache is empty if memory runs out. */
void qm_self_pairs_keep(qm_self_pairs *cache, const qm_collide_options *options, const qm_face_pair *pairs,
                        size_t count);

/** Copies the entry for these options, for qm_self_pairs_release; false if there is none. */
bool qm_self_pairs_recall(qm_self_pairs *cache, const qm_collide_options *options, qm_collide_changes *out);
void qm_self_pairs_release(qm_collide_changes *changes);

#endif
