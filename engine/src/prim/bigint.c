#include "bigint.h"

#include <string.h>

#include "qm/base.h"

/** A double as fraction * 2^exponent, fraction an odd integer; value is finite and not 0. */
static uint64_t split(double value, int *exponent)
{
    uint64_t bits, fraction;
    memcpy(&bits, &value, sizeof bits);
    int biased = (int)(bits >> 52 & 0x7ff);
    fraction = bits & ((UINT64_C(1) << 52) - 1);
    if (biased > 0)
        fraction |= UINT64_C(1) << 52;
    else
        biased = 1;
    int zeros = __builtin_ctzll(fraction);
    *exponent = biased - 1075 + zeros;
    return fraction >> zeros;
}

int qm_bigint_span(const double *values, int count, int *low, int *high)
{
    int found = 0;
    for (int i = 0; i < count; i++) {
        if (values[i] == 0.0) continue;
        int exponent;
        uint64_t fraction = split(values[i], &exponent);
        int top = exponent + 63 - __builtin_clzll(fraction);
        if (!found || exponent < *low) *low = exponent;
        if (!found || top > *high) *high = top;
        found = 1;
    }
    return found;
}

int64_t qm_bigint_small(double value, int low)
{
    if (value == 0.0) return 0;
    int exponent;
    uint64_t fraction = split(value, &exponent);
    QM_ASSERT(exponent >= low && exponent - low < 64);
    int64_t size = (int64_t)(fraction << (exponent - low));
    return value < 0.0 ? -size : size;
}

static void trim(qm_bigint *out, int sign)
{
    while (out->count > 0 && out->limb[out->count - 1] == 0)
        out->count--;
    out->sign = out->count > 0 ? sign : 0;
}

void qm_bigint_set(qm_bigint *out, double value, int low)
{
    out->sign = out->count = 0;
    if (value == 0.0) return;
    int exponent;
    uint64_t fraction = split(value, &exponent);
    int shift = exponent - low, limbs = shift / 64, bits = shift % 64;
    QM_ASSERT(shift >= 0 && limbs + 2 <= QM_BIGINT_LIMBS);
    for (int i = 0; i < limbs; i++)
        out->limb[i] = 0;
    out->limb[limbs] = fraction << bits;
    out->limb[limbs + 1] = bits > 0 ? fraction >> (64 - bits) : 0;
    out->count = limbs + 2;
    trim(out, value < 0.0 ? -1 : 1);
}

static int compare_magnitudes(const qm_bigint *a, const qm_bigint *b)
{
    if (a->count != b->count) return a->count < b->count ? -1 : 1;
    for (int i = a->count - 1; i >= 0; i--)
        if (a->limb[i] != b->limb[i]) return a->limb[i] < b->limb[i] ? -1 : 1;
    return 0;
}

static void add_magnitudes(qm_bigint *out, const qm_bigint *larger, const qm_bigint *smaller, int sign)
{
    unsigned carry = 0;
    int count = larger->count, smaller_count = smaller->count;
    for (int i = 0; i < count; i++) {
        uint64_t sum;
        unsigned over = __builtin_add_overflow(larger->limb[i], (uint64_t)carry, &sum);
        over |= __builtin_add_overflow(sum, i < smaller_count ? smaller->limb[i] : 0, &sum);
        out->limb[i] = sum;
        carry = over;
    }
    out->count = count;
    QM_ASSERT(!carry || count < QM_BIGINT_LIMBS);
    if (carry) out->limb[out->count++] = 1;
    out->sign = sign;
}

static void subtract_magnitudes(qm_bigint *out, const qm_bigint *larger, const qm_bigint *smaller, int sign)
{
    unsigned borrow = 0;
    int count = larger->count, smaller_count = smaller->count;
    for (int i = 0; i < count; i++) {
        uint64_t difference;
        unsigned under = __builtin_sub_overflow(larger->limb[i], (uint64_t)borrow, &difference);
        under |= __builtin_sub_overflow(difference, i < smaller_count ? smaller->limb[i] : 0, &difference);
        out->limb[i] = difference;
        borrow = under;
    }
    QM_ASSERT(borrow == 0);
    out->count = count;
    trim(out, sign);
}

void qm_bigint_add(qm_bigint *out, const qm_bigint *a, const qm_bigint *b, int negate)
{
    int sign_a = a->sign, sign_b = negate ? -b->sign : b->sign;
    int order = compare_magnitudes(a, b);
    const qm_bigint *larger = order < 0 ? b : a, *smaller = order < 0 ? a : b;
    int sign = order < 0 ? sign_b : sign_a;
    if (sign_a * sign_b >= 0)
        add_magnitudes(out, larger, smaller, sign);
    else
        subtract_magnitudes(out, larger, smaller, sign);
}

void qm_bigint_multiply(qm_bigint *out, const qm_bigint *a, const qm_bigint *b)
{
    QM_ASSERT(out != a && out != b && a->count + b->count <= QM_BIGINT_LIMBS);
    out->count = a->count + b->count;
    for (int i = 0; i < out->count; i++)
        out->limb[i] = 0;
    for (int i = 0; i < a->count; i++) {
        uint64_t carry = 0;
        for (int k = 0; k < b->count; k++) {
            unsigned __int128 sum = (unsigned __int128)a->limb[i] * b->limb[k] + out->limb[i + k] + carry;
            out->limb[i + k] = (uint64_t)sum;
            carry = (uint64_t)(sum >> 64);
        }
        out->limb[i + b->count] = carry;
    }
    trim(out, a->sign * b->sign);
}
