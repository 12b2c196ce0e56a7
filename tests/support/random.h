/**
 * random.h: a small generator for tests: the same numbers on every machine for the same seed.
 *
 * Source: splitmix64, from Steele, Lea, Flood, Fast splittable pseudorandom number generators, 2014.
 */
#ifndef QM_RANDOM_H
#define QM_RANDOM_H

#include <stddef.h>
#include <stdint.h>

typedef struct qm_random {
    uint64_t state;
} qm_random;

/** A generator of its own for each pair of a seed and a stream (the number of the test case, say). */
qm_random qm_random_make(uint64_t seed, uint64_t stream);

/** 64 random bits. */
uint64_t qm_random_bits(qm_random *random);

/** An integer from 0 to limit - 1; limit is at least 1. */
size_t qm_random_below(qm_random *random, size_t limit);

/** A number from low (included) to high. */
double qm_random_range(qm_random *random, double low, double high);

/** A point of the box [low, high]^3. */
void qm_random_point(qm_random *random, double low, double high, double out[3]);

/** A vector of length 1, evenly over all directions. */
void qm_random_direction(qm_random *random, double out[3]);

#endif
