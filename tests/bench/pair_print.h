/**
 * pair_print.h: pairs of faces that meet, as every program of the benchmark prints them: their number, and a sum
 * over them, so that run.py sees whether two programs have found the same ones.
 */
#ifndef QM_BENCH_PAIR_PRINT_H
#define QM_BENCH_PAIR_PRINT_H

#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/** A pair as one number; of one mesh the lower face comes first. */
static inline uint64_t qm_bench_pair(uint32_t a, uint32_t b)
{
    return (uint64_t)a << 32 | b;
}

static inline int qm_bench_compare_pairs(const void *x, const void *y)
{
    const uint64_t a = *(const uint64_t *)x, b = *(const uint64_t *)y;
    return (a > b) - (a < b);
}

/** A number that looks like no other's: the finisher of splitmix64. */
static inline uint64_t qm_bench_mix(uint64_t x)
{
    x = (x ^ x >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ x >> 27) * UINT64_C(0x94d049bb133111eb);
    return x ^ x >> 31;
}

/** Sorts the pairs, drops what comes twice and prints the members "pairs" and "sum", which is over what each
 * is mixed to. */
static inline void qm_bench_print_pairs(uint64_t *pairs, size_t count)
{
    uint64_t sum = 0;
    size_t different = 0;
    if (count > 0) qsort(pairs, count, sizeof *pairs, qm_bench_compare_pairs);
    for (size_t i = 0; i < count; i++) {
        if (i > 0 && pairs[i] == pairs[i - 1]) continue;
        different++;
        sum += qm_bench_mix(pairs[i]);
    }
    printf("\"pairs\": %zu, \"sum\": \"%016" PRIx64 "\"", different, sum);
}

#endif
