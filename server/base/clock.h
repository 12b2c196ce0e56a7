/**
 * clock.h: a monotonic clock, which changes of the date do not affect, and times of day in RFC 3339.
 */
#ifndef QM_CLOCK_H
#define QM_CLOCK_H

#include <time.h>

/** Milliseconds since an arbitrary moment. */
static inline double qm_clock_now_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

#define QM_TIME_SIZE 32

/** The time now as RFC 3339 in UTC, to the millisecond. */
void qm_clock_format(char out[QM_TIME_SIZE]);

/** The time a number of seconds ago. */
void qm_clock_format_past(double seconds, char out[QM_TIME_SIZE]);

/** The time in a number of seconds, by a clock that was set when the process began and that changes of the date since
 * then do not affect: for removals, which a clock that jumps ahead must not hasten. */
void qm_clock_format_steady(double seconds, char out[QM_TIME_SIZE]);

#endif
