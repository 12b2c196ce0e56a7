/**
 * collide_pairs.h: the pairs of a collision made ready to be told: the first ones with the place where they
 * meet, all of them as numbers.
 */
#ifndef QM_COLLIDE_PAIRS_TOLD_H
#define QM_COLLIDE_PAIRS_TOLD_H

#include "mesh_load.h"
#include "qm/collide.h"

typedef struct qm_told_pairs {
    qm_collision found;
    qm_contact *contacts; /* of the first listed_count pairs */
    size_t listed_count;
    bool is_incremental; /* only what had moved was looked at */
    double *rows;        /* two faces for each pair; not NULL, even when there are none */
} qm_told_pairs;

/** Finds the pairs of a and b, or of a with itself when b is NULL; that one only where something has moved,
 * when incremental is set and the mesh knows enough. Returns what the engine's call does; the
 * outcome is for qm_told_pairs_reset in the same context. */
qm_status qm_told_pairs_find(qm_context *ctx, const qm_loaded_mesh *a, const qm_loaded_mesh *b,
                             const qm_collide_options *options, bool incremental, size_t list_limit,
                             qm_told_pairs *out);

void qm_told_pairs_reset(qm_context *ctx, qm_told_pairs *told);

#endif
