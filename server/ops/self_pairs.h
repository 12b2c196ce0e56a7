/**
 * self_pairs.h: what a mesh in memory knows of its own collisions: the pairs that were found last, and the
 * vertices that have moved since. One memory for each reading of quads. It is lost with the mesh's place in
 * memory; then all is looked at again.
 *
 * Threads: every call may come from any thread.
 */
#ifndef QM_SELF_PAIRS_H
#define QM_SELF_PAIRS_H

#include "qm/collide.h"

typedef struct qm_self_pairs qm_self_pairs;

/** NULL: out of memory. */
qm_self_pairs *qm_self_pairs_create(size_t vertex_count);
void qm_self_pairs_destroy(qm_self_pairs *memory);

/** Takes over all that another one knows of the same vertices and faces, as far as there is memory for it. */
void qm_self_pairs_inherit(qm_self_pairs *memory, qm_self_pairs *other);

/** Vertices have moved; NULL: all, and then nothing is known any more. */
void qm_self_pairs_move(qm_self_pairs *memory, const uint32_t *vertices, size_t count);

/** Keeps the pairs of the positions as they are now. Without memory for them nothing is known. */
void qm_self_pairs_keep(qm_self_pairs *memory, const qm_collide_options *options, const qm_face_pair *pairs,
                        size_t count);

/** Copies what is known for these options; false when nothing is. For qm_self_pairs_release. */
bool qm_self_pairs_recall(qm_self_pairs *memory, const qm_collide_options *options, qm_collide_changes *out);
void qm_self_pairs_release(qm_collide_changes *changes);

#endif
