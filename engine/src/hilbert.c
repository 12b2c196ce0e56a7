#include "hilbert.h"

static unsigned rotate_left(unsigned bits, unsigned by)
{
    by %= 3;
    return ((bits << by) | (bits >> (3 - by))) & 7;
}

static unsigned rotate_right(unsigned bits, unsigned by)
{
    return rotate_left(bits, 3 - by % 3);
}

static unsigned gray_code(unsigned i)
{
    return i ^ (i >> 1);
}

static unsigned gray_inverse(unsigned gray)
{
    return gray ^ (gray >> 1) ^ (gray >> 2);
}

static unsigned trailing_ones(unsigned i)
{
    unsigned count = 0;
    while (i >> count & 1)
        count++;
    return count;
}

/** One level: a state is 3 * entry + direction; returns the key of the octant and moves the state on. */
static unsigned step(unsigned octant, unsigned *state)
{
    unsigned entry = *state / 3, direction = *state % 3;
    unsigned key = gray_inverse(rotate_right(octant ^ entry, direction + 1));
    unsigned child_entry = key == 0 ? 0 : gray_code(2 * ((key - 1) / 2));
    unsigned child_direction = key == 0 ? 0 : trailing_ones(key % 2 ? key : key - 1) % 3;
    entry ^= rotate_left(child_entry, direction + 1);
    *state = 3 * entry + (direction + child_direction + 1) % 3;
    return key;
}

void qm_hilbert_table_init(qm_hilbert_table *table)
{
    uint16_t one_level[QM_HILBERT_STATES * 8];
    for (unsigned i = 0; i < QM_HILBERT_STATES * 8; i++) {
        unsigned state = i >> 3, key = step(i & 7, &state);
        one_level[i] = (uint16_t)(state << 3 | key);
    }
    for (unsigned i = 0; i < QM_HILBERT_STATES * 64; i++) {
        unsigned high = one_level[i >> 3], low = one_level[(high & ~7u) | (i & 7)];
        table->step[i] = (uint16_t)((low & ~7u) << 3 | (high & 7) << 3 | (low & 7));
    }
    for (unsigned i = 0; i < 64; i++) {
        table->spread[i] = 0;
        for (unsigned bit = 0; bit < 6; bit++)
            table->spread[i] |= (i >> bit & 1) << (3 * bit);
    }
}
