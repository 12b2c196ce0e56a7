/**
 * codec_welder.h: a hash table of vertices by position, for formats in which every face has corners of its own.
 */
#ifndef QM_CODEC_WELDER_H
#define QM_CODEC_WELDER_H

#include "codec_builder.h"

/** A hash table of vertices by position, which merges equal ones (-0 equals 0). */
typedef struct qm_welder {
    qm_builder *builder;
    uint32_t *slots; /* open addressing, slot_count a power of two; QM_NO_INDEX is free */
    size_t slot_count;
    uint64_t seed; /* random for each file, so that no file can force collisions */
} qm_welder;

#define QM_WELDER_BATCH 48 /* max positions whose slots are prefetched together */

/** vertex_count is the expected number of vertices, which the size of the file confirms. After a failure there is
 * nothing to free. */
qm_status qm_welder_create(qm_builder *builder, size_t vertex_count, qm_welder *welder);

/** Finds or adds the vertices of count positions; after a failure *done counts those before it. */
qm_status qm_welder_find(qm_welder *welder, const double *positions, size_t count, uint32_t *vertices,
                         size_t *done);
void qm_welder_destroy(qm_welder *welder);

#endif
