/**
 * faces.c: passes over the corners of all faces of a mesh, two faces at a time.
 */
#include <string.h>

#include "kernels.h"

typedef uint32_t corners __attribute__((vector_size(32)));

enum { CORNERS = 4, TOGETHER = 2 };

static inline corners load(const uint32_t *face)
{
    corners here;
    memcpy(&here, face, sizeof here);
    return here;
}

static inline bool any(corners mask)
{
    uint64_t parts[4];
    memcpy(parts, &mask, sizeof parts);
    return (parts[0] | parts[1] | parts[2] | parts[3]) != 0;
}

/** The last face of an odd number, twice. */
static inline corners load_last(const uint32_t *faces, size_t count)
{
    uint32_t twice[TOGETHER * CORNERS];
    for (int i = 0; i < TOGETHER; i++)
        memcpy(twice + CORNERS * i, faces + CORNERS * (count - 1), CORNERS * sizeof *twice);
    return load(twice);
}

/** QM_NO_INDEX is the max index: adding 1 to it gives 0. */
bool QM_KERNEL(faces_below)(const uint32_t *faces, size_t count, uint32_t vertex_count)
{
    if (vertex_count == 0) return count == 0;
    const corners step = {0, 0, 0, 1, 0, 0, 0, 1}, max = step + (vertex_count - 1);
    corners beyond = {0};
    for (size_t i = 0; i + TOGETHER <= count; i += TOGETHER)
        beyond |= (corners)(load(faces + CORNERS * i) + step > max);
    if (count % TOGETHER != 0) beyond |= (corners)(load_last(faces, count) + step > max);
    return !any(beyond);
}

bool QM_KERNEL(faces_contain)(const uint32_t *faces, size_t count, const uint32_t vertex[QM_BOX_SIDES])
{
    corners found[QM_BOX_SIDES] = {0};
    for (size_t i = 0; i + TOGETHER <= count; i += TOGETHER) {
        corners here = load(faces + CORNERS * i);
        for (int k = 0; k < QM_BOX_SIDES; k++)
            found[k] |= (corners)(here == vertex[k]);
    }
    if (count % TOGETHER != 0)
        for (int k = 0; k < QM_BOX_SIDES; k++)
            found[k] |= (corners)(load_last(faces, count) == vertex[k]);
    bool all = true;
    for (int k = 0; k < QM_BOX_SIDES; k++)
        all &= any(found[k]);
    return all;
}
