#include "log.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "utf8.h"

#define LINE_SIZE 2048
#define TEXT_SIZE 512

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

/** A line that never grows beyond its room. */
typedef struct line {
    char text[LINE_SIZE];
    size_t size;
} line;

static void add(line *out, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void add(line *out, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(out->text + out->size, LINE_SIZE - out->size, format, arguments);
    va_end(arguments);
    size_t room = LINE_SIZE - out->size - 1;
    if (length > 0) out->size += (size_t)length < room ? (size_t)length : room;
}

/** Copies a text without what would break the line or its quotes; bytes that are no UTF-8 become "?". */
static const char *clean(const char *text, char out[TEXT_SIZE])
{
    size_t size = 0, rest = strlen(text);
    while (rest > 0) {
        size_t length = qm_utf8_length(text, rest);
        if (size + (length ? length : 1) >= TEXT_SIZE) break;
        bool breaks = (unsigned char)*text < 0x20 || *text == '"' || *text == '\\' || *text == 0x7f;
        if (length == 0)
            out[size] = '?';
        else if (breaks)
            out[size] = ' ';
        else
            memcpy(out + size, text, length);
        length = length ? length : 1;
        size += length;
        text += length;
        rest -= length;
    }
    out[size] = '\0';
    return out;
}

static void add_stamp(line *out, qm_log_level level)
{
    char stamp[40];
    struct timespec now;
    struct tm utc;
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%S", &utc);
    int ms = (int)(now.tv_nsec / 1000000);
    if (json)
        add(out, "{\"time\":\"%s.%03dZ\",\"level\":\"%s\"", stamp, ms, qm_log_level_name(level));
    else
        add(out, "%s.%03dZ %-5s", stamp, ms, qm_log_level_name(level));
}

static void add_field(line *out, const qm_log_field *field)
{
    char text[TEXT_SIZE];
    if (json && field->text)
        add(out, ",\"%s\":\"%s\"", field->name, clean(field->text, text));
    else if (json)
        add(out, ",\"%s\":%.15g", field->name, field->number);
    else if (field->text)
        add(out, strchr(field->text, ' ') ? " %s=\"%s\"" : " %s=%s", field->name, clean(field->text, text));
    else
        add(out, " %s=%.15g", field->name, field->number);
}

void qm_log_fields(qm_log_level level, const char *message, const qm_log_field *fields, size_t count)
{
    if (level > least_urgent) return;
    line out = {.size = 0};
    char text[TEXT_SIZE];
    add_stamp(&out, level);
    add(&out, json ? ",\"message\":\"%s\"" : " %s", clean(message, text));
    /* A field that does not fit as a whole, with the end of the line, is left out. */
    for (size_t i = 0; i < count; i++) {
        size_t before = out.size;
        add_field(&out, &fields[i]);
        if (out.size + sizeof "}\n" >= LINE_SIZE) out.size = before;
    }
    out.text[out.size] = '\0';
    add(&out, json ? "}\n" : "\n");
    fwrite(out.text, 1, out.size, stderr);
}

void qm_log(qm_log_level level, const char *format, ...)
{
    if (level > least_urgent) return;
    char message[TEXT_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    qm_log_fields(level, message, NULL, 0);
}
