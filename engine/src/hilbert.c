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
    for (unsigned start = 0; start < QM_HILBERT_STATES; start++) {
        for (unsigned cell = 0; cell < 64; cell++) {
            unsigned state = start;
            unsigned x = cell >> 4, y = cell >> 2 & 3, z = cell & 3;
            unsigned high = step((x >> 1) << 2 | (y >> 1) << 1 | z >> 1, &state);
            unsigned low = step((x & 1) << 2 | (y & 1) << 1 | (z & 1), &state);
            table->key[start][cell] = (uint8_t)(high << 3 | low);
            table->next[start][cell] = (uint8_t)state;
        }
    }
}
