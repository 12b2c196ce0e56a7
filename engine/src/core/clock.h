/**
 * clock.h: the time since some moment in the past, which no change of the date moves.
 */
#ifndef QM_ENGINE_CLOCK_H
#define QM_ENGINE_CLOCK_H

#include <time.h>

/** Milliseconds. */
static inline double qm_clock_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

#endif
