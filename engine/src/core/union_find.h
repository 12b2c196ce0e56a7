/**
 * union_find.h: classes of numbers that are put together pair by pair. Each number has a parent, at first itself; the one that is
 * its own parent is the root of its class.
 *
 * Source: R. Tarjan, J. van Leeuwen, Worst-case analysis of set union algorithms, 1984 (path halving).
 */
#ifndef QM_UNION_FIND_H
#define QM_UNION_FIND_H

#include <stdbool.h>
#include <stdint.h>

/** The root of the class of i. */
static inline uint32_t qm_union_find_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

/** Puts two classes together; the lower root remains one. True when they were two. */
static inline bool qm_union_find_join(uint32_t *parent, uint32_t i, uint32_t j)
{
    i = qm_union_find_root(parent, i);
    j = qm_union_find_root(parent, j);
    if (i == j) return false;
    parent[i > j ? i : j] = i < j ? i : j;
    return true;
}

#endif
