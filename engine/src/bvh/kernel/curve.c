/**
 * curve.c: positions of cells along a Hilbert curve, two vectors of cells at a time.
 *
 * Source: J. Skilling, Programming the Hilbert curve, AIP Conference Proceedings 707, 2004: from the highest
 * bit down the lower bits of the axes are exchanged or inverted, and the remainder is a Gray code.
 */
#include <string.h>

#include "kernels.h"

#if defined(__AVX512F__)
#define LANES 16
#else
#define LANES 8
#endif
enum { PARTS = 2, HALF_BITS = QM_HILBERT_BITS / 2 }; /* two parts: the steps of one depend on each other */

typedef uint32_t qm_vu __attribute__((vector_size(4 * LANES)));
typedef int32_t signs __attribute__((vector_size(4 * LANES)));
typedef uint64_t key_row __attribute__((vector_size(8 * LANES)));

typedef struct axes {
    qm_vu x[PARTS], y[PARTS], z[PARTS];
} axes;

/** All ones where the bit is set. */
static inline qm_vu bit_set(qm_vu a, int bit)
{
    return (qm_vu)((signs)(a << (31 - bit)) >> 31);
}

/** Where the bit of the axis is set, inverts the lower bits of the first axis, else exchanges those of the
 * two. */
static inline void undo_reflection(qm_vu *first, qm_vu *axis, int bit)
{
    qm_vu below = (qm_vu){0} + ((1u << bit) - 1), set = bit_set(*axis, bit);
    qm_vu exchanged = (*first ^ *axis) & below & ~set;
    *first ^= exchanged | (set & below);
    *axis ^= exchanged;
}

/** Changes the axes so that their bits, interleaved, are the position. */
static inline void axes_to_position(axes *a, int bits)
{
    for (int bit = bits - 1; bit > 0; bit--) {
        for (int part = 0; part < PARTS; part++) {
            a->x[part] ^= bit_set(a->x[part], bit) & ((1u << bit) - 1);
            undo_reflection(&a->x[part], &a->y[part], bit);
            undo_reflection(&a->x[part], &a->z[part], bit);
        }
    }
    for (int part = 0; part < PARTS; part++) {
        a->y[part] ^= a->x[part];
        a->z[part] ^= a->y[part];
        qm_vu odd = a->z[part]; /* each bit: the parity of all bits from it upwards */
        for (int shift = 1; shift < QM_HILBERT_BITS; shift *= 2)
            odd ^= odd >> shift;
        a->x[part] ^= odd >> 1;
        a->y[part] ^= odd >> 1;
        a->z[part] ^= odd >> 1;
    }
}

/** Six bits, two zeros after each. */
static inline qm_vu spread(qm_vu a)
{
    a = (a | a << 8) & 0x300f;
    a = (a | a << 4) & 0x30c3;
    return (a | a << 2) & 0x9249;
}

static inline qm_vu interleave(qm_vu x, qm_vu y, qm_vu z)
{
    return spread(x) << 2 | spread(y) << 1 | spread(z);
}

static inline qm_vu load(const uint32_t *from)
{
    qm_vu row;
    memcpy(&row, from, sizeof row);
    return row;
}

void QM_KERNEL(hilbert_keys)(const qm_hilbert_cells *cells, int count, int bits, uint64_t *keys)
{
    const qm_vu low_half = (qm_vu){0} + ((1u << HALF_BITS) - 1);
    for (int i = 0; i < count; i += PARTS * LANES) {
        axes a;
        for (int part = 0; part < PARTS; part++) {
            a.x[part] = load(&cells->axis[0][i + part * LANES]);
            a.y[part] = load(&cells->axis[1][i + part * LANES]);
            a.z[part] = load(&cells->axis[2][i + part * LANES]);
        }
        axes_to_position(&a, bits);
        for (int part = 0; part < PARTS; part++) {
            qm_vu high = interleave(a.x[part] >> HALF_BITS, a.y[part] >> HALF_BITS, a.z[part] >> HALF_BITS);
            qm_vu low = interleave(a.x[part] & low_half, a.y[part] & low_half, a.z[part] & low_half);
            key_row key = __builtin_convertvector(high, key_row) << (3 * HALF_BITS) |
                          __builtin_convertvector(low, key_row);
            memcpy(keys + i + part * LANES, &key, sizeof key);
        }
    }
}
