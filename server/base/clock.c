/**
 * clock.c: times in RFC 3339.
 */
#include "clock.h"

#include <stdio.h>

void qm_clock_format(char out[QM_TIME_SIZE])
{
    qm_clock_format_past(0.0, out);
}

void qm_clock_format_past(double seconds, char out[QM_TIME_SIZE])
{
    struct timespec now;
    struct tm utc;
    clock_gettime(CLOCK_REALTIME, &now);
    now.tv_sec -= (time_t)seconds;
    gmtime_r(&now.tv_sec, &utc);
    size_t length = strftime(out, QM_TIME_SIZE, "%Y-%m-%dT%H:%M:%S", &utc);
    snprintf(out + length, QM_TIME_SIZE - length, ".%03dZ", (int)(now.tv_nsec / 1000000));
}
