/**
 * share.c: which corners of a pack's lanes are the same vertex. Every corner is compared with all, without a
 * branch: where they meet again follows no pattern that a processor could predict.
 */
#include "box.h"
#include "kernels.h"

enum { CORNERS = 3 * QM_PACK_LANES };

/** Bits of those of the first rows whose corner is the same vertex. */
static inline unsigned same_corners(const qm_vi *row, int rows, uint32_t vertex)
{
    qm_vi here = (qm_vi){0} + (int32_t)vertex;
    unsigned same = 0;
    for (int r = 0; r < rows; r++)
        same |= qm_vi_bits(row[r] == here) << (8 * r);
    return same;
}

void QM_KERNEL(share_corners)(qm_pack_lanes *lanes, const uint32_t vertex[3 * QM_PACK_LANES])
{
    qm_vi row[3];
    memcpy(row, vertex, sizeof row);
    uint8_t *place = lanes->corner[0];
    unsigned count = 0;
#pragma GCC unroll 24
    for (unsigned k = 0; k < 3 * QM_PACK_LANES; k++) {
        unsigned first = (unsigned)__builtin_ctz(same_corners(row, 1 + (int)k / 8, vertex[k]));
        lanes->vertex[count] = vertex[k];
        place[k] = (uint8_t)count;
        place[k] = place[first];
        count += first == k;
    }
    lanes->vertex_count = (uint8_t)count;
}
