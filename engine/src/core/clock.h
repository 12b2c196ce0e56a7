/**
 * clock.h: a monotonic clock, which changes of the date do not move.
 */
#ifndef QM_ENGINE_CLOCK_H
#define QM_ENGINE_CLOCK_H

#include <time.h>

/** Milliseconds since an unspecified moment. */
static inline double qm_clock_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

#endif
