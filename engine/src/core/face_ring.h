/**
 * face_ring.h: the corners of a face, with and without repeated vertices, and the fans of polygons.
 */
#ifndef QM_FACE_RING_H
#define QM_FACE_RING_H

#include <string.h>

#include "qm/mesh.h"

static inline int qm_face_corners(const uint32_t face[4])
{
    return face[3] == QM_NO_INDEX ? 3 : 4;
}

/** True when the face is part of a polygon: a neighbour in the list has its index in the input. */
static inline bool qm_face_is_fan_part(const qm_mesh *mesh, size_t face)
{
    const uint32_t *origin = mesh->face_origin;
    if (!origin) return false;
    return (face > 0 && origin[face - 1] == origin[face]) ||
           (face + 1 < mesh->face_count && origin[face + 1] == origin[face]);
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
