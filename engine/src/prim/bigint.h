/**
 * bigint.h: signed integers of many bits, as exact determinants of doubles need them. They live on the stack;
 * operations touch only the limbs in use.
 */
#ifndef QM_BIGINT_H
#define QM_BIGINT_H

#include <stdint.h>

/** Limbs of the product of six differences of doubles up to 2^300: 6 * 1376 bits and a few more. */
#define QM_BIGINT_LIMBS 132

typedef struct qm_bigint {
    int sign;  /* 1, 0 or -1 */
    int count; /* limbs in use; the topmost is not zero */
    uint64_t limb[QM_BIGINT_LIMBS];
} qm_bigint;

/** Finds the exponents of the lowest and highest bits that are set in any of count finite doubles; false when
 * all are 0. */
int qm_bigint_span(const double *values, int count, int *low, int *high);

/** value / 2^low, which must be an integer of at most 63 bits. */
int64_t qm_bigint_small(double value, int low);

/** Sets out to value / 2^low, which must be an integer. */
void qm_bigint_set(qm_bigint *out, double value, int low);

/** The sum, or with negate the difference a - b; out may be a or b. */
void qm_bigint_add(qm_bigint *out, const qm_bigint *a, const qm_bigint *b, int negate);

/** The product; out is neither a nor b. */
void qm_bigint_multiply(qm_bigint *out, const qm_bigint *a, const qm_bigint *b);

#endif
