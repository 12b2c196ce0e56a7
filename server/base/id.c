/**
 * id.c: random ids, and RFC 3339 times.
 */
#include "id.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/random.h>
#include <time.h>

void qm_id_make(char prefix, char out[QM_ID_SIZE])
{
    static const char alphabet[] = "abcdefghijklmnopqrstuvwxyz234567";
    uint8_t random[20];
    if (getrandom(random, sizeof random, 0) != (ssize_t)sizeof random) abort();
    out[0] = prefix;
    out[1] = '_';
    for (size_t i = 0; i < sizeof random; i++)
        out[2 + i] = alphabet[random[i] % 32];
    out[2 + sizeof random] = '\0';
}

void qm_time_format(char out[QM_TIME_SIZE])
{
    qm_time_format_past(0.0, out);
}

void qm_time_format_past(double seconds, char out[QM_TIME_SIZE])
{
    struct timespec now;
    struct tm utc;
    clock_gettime(CLOCK_REALTIME, &now);
    now.tv_sec -= (time_t)seconds;
    gmtime_r(&now.tv_sec, &utc);
    size_t length = strftime(out, QM_TIME_SIZE, "%Y-%m-%dT%H:%M:%S", &utc);
    snprintf(out + length, QM_TIME_SIZE - length, ".%03dZ", (int)(now.tv_nsec / 1000000));
}
