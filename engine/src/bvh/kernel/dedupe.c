/**
 * dedupe.c: which corners of a pack's lanes are one vertex. Every corner is compared with all others without
 * a branch: which of them coincide follows no pattern that a processor could predict.
 */
#include "box.h"
#include "kernels.h"

enum { CORNERS = 3 * QM_PACK_LANES };

/** Bits of the corners in the first rows that are a vertex. */
static inline unsigned equal_corners(const qm_vi *row, int rows, uint32_t vertex)
{
    qm_vi here = (qm_vi){0} + (int32_t)vertex;
    unsigned equal = 0;
    for (int r = 0; r < rows; r++)
        equal |= qm_vi_bits(row[r] == here) << (8 * r);
    return equal;
}

void QM_KERNEL(dedupe_corners)(qm_pack_lanes *lanes, const uint32_t vertex[3 * QM_PACK_LANES])
{
    qm_vi row[3];
    memcpy(row, vertex, sizeof row);
    uint8_t *index = lanes->corner[0];
    unsigned count = 0;
#pragma GCC unroll 24
    for (unsigned k = 0; k < 3 * QM_PACK_LANES; k++) {
        unsigned first = (unsigned)__builtin_ctz(equal_corners(row, 1 + (int)k / 8, vertex[k]));
        lanes->vertex[count] = vertex[k];
        index[k] = (uint8_t)count;
        index[k] = index[first];
        count += first == k;
    }
    QM_ASSERT(count >= 1 && count <= CORNERS);
    lanes->vertex_count = (uint8_t)count;
}
