#include "random.h"

#include <math.h>

qm_random qm_random_make(uint64_t seed, uint64_t stream)
{
    qm_random random = {seed};
    random.state = qm_random_bits(&random) ^ (stream * UINT64_C(0xd1342543de82ef95));
    qm_random_bits(&random);
    return random;
}

uint64_t qm_random_bits(qm_random *random)
{
    uint64_t z = random->state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

size_t qm_random_below(qm_random *random, size_t limit)
{
    return (size_t)(qm_random_bits(random) % limit);
}

double qm_random_range(qm_random *random, double low, double high)
{
    return low + (high - low) * ((double)(qm_random_bits(random) >> 11) * 0x1p-53);
}

void qm_random_point(qm_random *random, double low, double high, double out[3])
{
    for (int k = 0; k < 3; ++k)
        out[k] = qm_random_range(random, low, high);
}

void qm_random_direction(qm_random *random, double out[3])
{
    double length = 0;
    while (length < 1e-3 || length > 1) {
        qm_random_point(random, -1, 1, out);
        length = sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
    }
    for (int k = 0; k < 3; ++k)
        out[k] /= length;
}
