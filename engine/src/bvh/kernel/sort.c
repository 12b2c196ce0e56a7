/**
 * sort.c: sorts a few numbers without a branch that could be mispredicted: the rank of each is the count of
 * smaller ones. Its last bits are the index a number had, so that no two are equal.
 */
#include <string.h>

#include "kernels.h"
#include "simd.h"

#define ORIGIN_BITS 5
#define MAX_VECTORS (QM_SORT_SMALL_MAX / QM_WIDTH)
_Static_assert(QM_SORT_SMALL_MAX == 1 << ORIGIN_BITS, "the last bits hold any origin");

/** Sorts; vectors is a constant at each call, so that all vectors stay in registers. */
__attribute__((always_inline)) static inline void sort_vectors(uint64_t *numbers, int count, int vectors)
{
    int64_t key[QM_SORT_SMALL_MAX], rank[QM_SORT_SMALL_MAX];
    for (int i = 0; i < vectors * QM_WIDTH; i++)
        key[i] = i < count ? (int64_t)(numbers[i] << ORIGIN_BITS) + i : INT64_MAX;
    qm_vl wide_key[MAX_VECTORS], wide_rank[MAX_VECTORS];
    for (int v = 0; v < vectors; v++) {
        memcpy(&wide_key[v], key + v * QM_WIDTH, sizeof wide_key[v]);
        wide_rank[v] = (qm_vl){0};
    }
    for (int i = 0; i < count; i++)
        for (int v = 0; v < vectors; v++)
            wide_rank[v] -= wide_key[v] > key[i];
    memcpy(rank, wide_rank, (size_t)vectors * sizeof *wide_rank);
    for (int i = 0; i < count; i++)
        numbers[rank[i]] = (uint64_t)key[i] >> ORIGIN_BITS;
}

void QM_KERNEL(sort_small)(uint64_t *numbers, int count)
{
    QM_ASSERT(count >= 0 && count <= QM_SORT_SMALL_MAX);
    if (count <= QM_SORT_SMALL_MAX / 8)
        sort_vectors(numbers, count, MAX_VECTORS / 8 > 0 ? MAX_VECTORS / 8 : 1);
    else if (count <= QM_SORT_SMALL_MAX / 4)
        sort_vectors(numbers, count, MAX_VECTORS / 4);
    else if (count <= QM_SORT_SMALL_MAX / 2)
        sort_vectors(numbers, count, MAX_VECTORS / 2);
    else
        sort_vectors(numbers, count, MAX_VECTORS);
}
