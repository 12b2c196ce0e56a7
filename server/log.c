#include "log.h"

#include <stdarg.h>
#include <stdio.h>
#include <time.h>

static bool json;
static qm_log_level least_urgent = QM_LOG_INFO;

const char *qm_log_level_name(qm_log_level level)
{
    static const char *const names[QM_LOG_LEVEL_COUNT] = {"error", "warn", "info"};
    return names[level];
}

void qm_log_init(bool as_json, qm_log_level least)
{
    json = as_json;
    least_urgent = least;
}

/** Quotes and control characters would break the line. */
static void clean(char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text < 0x20 || *text == '"' || *text == '\\') *text = ' ';
}

void qm_log(qm_log_level level, const char *format, ...)
{
    if (level > least_urgent) return;
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
        fprintf(stderr, "{\"time\":\"%s\",\"level\":\"%s\",\"message\":\"%s\"}\n", stamp,
                qm_log_level_name(level), message);
    else
        fprintf(stderr, "%s %-5s %s\n", stamp, qm_log_level_name(level), message);
}
