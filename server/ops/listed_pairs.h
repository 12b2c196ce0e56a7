/**
 * listed_pairs.h: the colliding pairs of one mesh or two: the first ones with their contacts, for the result object, and
 * all of them as an array of numbers.
 */
#ifndef QM_LISTED_PAIRS_H
#define QM_LISTED_PAIRS_H

#include "mesh_load.h"
#include "qm/collide.h"

typedef struct qm_listed_pairs {
    qm_collision found;
    qm_contact *contacts; /* of the first listed_count pairs */
    size_t listed_count;
    bool is_incremental; /* only faces that had moved were searched */
    double *faces;       /* two faces of each pair; not NULL, even without pairs */
} qm_listed_pairs;

/**
 * Finds the pairs of a and b, or of a with itself if b is NULL. If incremental is set and the mesh knows its earlier
 * pairs, the latter searches only near vertices that have moved since. Returns the status of the engine's call; *out is
 * for qm_listed_pairs_reset in the same context.
 */
qm_status qm_listed_pairs_find(qm_context *ctx, const qm_loaded_mesh *a, const qm_loaded_mesh *b,
                               const qm_collide_options *options, bool incremental, size_t list_limit,
                               qm_listed_pairs *out);

void qm_listed_pairs_reset(qm_context *ctx, qm_listed_pairs *pairs);

#endif
