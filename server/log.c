#include "log.h"

#include <stdarg.h>
#include <stdio.h>
#include <time.h>

static bool json;

void qm_log_init(bool as_json)
{
    json = as_json;
}

/** Quotes and control characters would break the line. */
static void clean(char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text < 0x20 || *text == '"' || *text == '\\') *text = ' ';
}

void qm_log(const char *level, const char *format, ...)
{
    char message[512], stamp[40];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    clean(message);
    struct timespec now;
    struct tm utc;
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    size_t length = strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%S", &utc);
    snprintf(stamp + length, sizeof stamp - length, ".%03dZ", (int)(now.tv_nsec / 1000000));
    if (json)
        fprintf(stderr, "{\"time\":\"%s\",\"level\":\"%s\",\"message\":\"%s\"}\n", stamp, level, message);
    else
        fprintf(stderr, "%s %-5s %s\n", stamp, level, message);
}
