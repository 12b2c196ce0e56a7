/**
 * clock.c: times in RFC 3339.
 */
#include "clock.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>

static double began_s, began_ms; /* time of day, and the monotonic clock then */

static void begin(void)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    began_s = (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
    began_ms = qm_clock_now_ms();
}

static void format(double time_s, char out[QM_TIME_SIZE])
{
    struct tm utc;
    time_t whole = (time_t)floor(time_s);
    gmtime_r(&whole, &utc);
    size_t length = strftime(out, QM_TIME_SIZE, "%Y-%m-%dT%H:%M:%S", &utc);
    snprintf(out + length, QM_TIME_SIZE - length, ".%03dZ", (int)(1e3 * (time_s - (double)whole)));
}

void qm_clock_format(char out[QM_TIME_SIZE])
{
    qm_clock_format_past(0.0, out);
}

void qm_clock_format_past(double seconds, char out[QM_TIME_SIZE])
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    format((double)now.tv_sec + 1e-9 * (double)now.tv_nsec - seconds, out);
}

void qm_clock_format_steady(double seconds, char out[QM_TIME_SIZE])
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, begin);
    format(began_s + 1e-3 * (qm_clock_now_ms() - began_ms) + seconds, out);
}
