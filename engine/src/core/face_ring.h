/**
 * face_ring.h: the corners of a face without repeated vertices, as adjacency needs them.
 */
#ifndef QM_FACE_RING_H
#define QM_FACE_RING_H

#include <string.h>

#include "qm/mesh.h"

static inline int qm_face_corners(const uint32_t face[4])
{
    return face[3] == QM_NO_INDEX ? 3 : 4;
}

static inline bool qm_face_repeats_vertex(const uint32_t face[4], int count)
{
    for (int i = 1; i < count; ++i)
        for (int j = 0; j < i; ++j)
            if (face[i] == face[j]) return true;
    return false;
}

/** Writes the corners that differ from the next one, and returns their count; 0 when the face has no area:
 * fewer than three corners remain, or a vertex still repeats. */
static inline int qm_face_ring(const uint32_t face[4], uint32_t ring[4])
{
    int count = qm_face_corners(face);
    if (!qm_face_repeats_vertex(face, count)) {
        memcpy(ring, face, 4 * sizeof *ring);
        return count;
    }
    int kept = 0;
    for (int i = 0; i < count; ++i)
        if (face[i] != face[(i + 1) % count]) ring[kept++] = face[i];
    return kept >= 3 && !qm_face_repeats_vertex(ring, kept) ? kept : 0;
}

#endif
