/**
 * sort.c: a few numbers in order, without a branch that could be mispredicted: the place of each is how many
 * are less. Its last bits say where a number came from, so that no two are equal.
 */
#include <string.h>

#include "kernels.h"

#define ORIGIN_BITS 5
#define MOST_VECTORS (QM_SORT_FEW / QM_WIDTH)
_Static_assert(QM_SORT_FEW == 1 << ORIGIN_BITS, "the last bits hold any origin");

/** For a number of vectors that the compiler knows, so that all stay in registers. */
__attribute__((always_inline)) static inline void sort_vectors(uint64_t *numbers, int count, int vectors)
{
    int64_t key[QM_SORT_FEW], place[QM_SORT_FEW];
    for (int i = 0; i < vectors * QM_WIDTH; i++)
        key[i] = i < count ? (int64_t)(numbers[i] << ORIGIN_BITS) + i : INT64_MAX;
    qm_vl wide_key[MOST_VECTORS], wide_place[MOST_VECTORS];
    for (int v = 0; v < vectors; v++) {
        memcpy(&wide_key[v], key + v * QM_WIDTH, sizeof wide_key[v]);
        wide_place[v] = (qm_vl){0};
    }
    for (int i = 0; i < count; i++)
        for (int v = 0; v < vectors; v++)
            wide_place[v] -= wide_key[v] > key[i];
    memcpy(place, wide_place, (size_t)vectors * sizeof *wide_place);
    for (int i = 0; i < count; i++)
        numbers[place[i]] = (uint64_t)key[i] >> ORIGIN_BITS;
}

void QM_KERNEL(sort_few)(uint64_t *numbers, int count)
{
    if (count <= QM_SORT_FEW / 8)
        sort_vectors(numbers, count, MOST_VECTORS / 8 > 0 ? MOST_VECTORS / 8 : 1);
    else if (count <= QM_SORT_FEW / 4)
        sort_vectors(numbers, count, MOST_VECTORS / 4);
    else if (count <= QM_SORT_FEW / 2)
        sort_vectors(numbers, count, MOST_VECTORS / 2);
    else
        sort_vectors(numbers, count, MOST_VECTORS);
}
