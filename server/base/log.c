/**
 * log.c: formats a record into one line of bounded size, and writes it with one call.
 */
#include "log.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "qm/base.h"
#include "text.h"

#define LINE_SIZE 2048
#define TEXT_SIZE 512

static bool is_json;
static qm_log_level max_level = QM_LOG_INFO;

const char *qm_log_level_name(qm_log_level level)
{
    static const char *const names[QM_LOG_LEVEL_COUNT] = {"error", "warn", "info"};
    return names[level];
}

void qm_log_init(bool as_json, qm_log_level level)
{
    QM_ASSERT(level < QM_LOG_LEVEL_COUNT);
    is_json = as_json;
    max_level = level;
}

/** A line of bounded size; text that does not fit is cut off. */
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
    const size_t capacity = LINE_SIZE - out->size - 1;
    if (length > 0) out->size += (size_t)length < capacity ? (size_t)length : capacity;
    QM_ASSERT(out->size < LINE_SIZE);
}

/** Copies a text; quotes, backslashes and control characters become blanks, invalid UTF-8 becomes "?". */
static const char *sanitize(const char *text, char out[TEXT_SIZE])
{
    size_t size = 0, left = strlen(text);
    while (left > 0) {
        size_t length = qm_text_utf8_length(text, left);
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
        left -= length;
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
    if (is_json)
        add(out, "{\"time\":\"%s.%03dZ\",\"level\":\"%s\"", stamp, ms, qm_log_level_name(level));
    else
        add(out, "%s.%03dZ %-5s", stamp, ms, qm_log_level_name(level));
}

static void add_field(line *out, const qm_log_field *field)
{
    char text[TEXT_SIZE];
    if (is_json && field->text)
        add(out, ",\"%s\":\"%s\"", field->name, sanitize(field->text, text));
    else if (is_json)
        add(out, ",\"%s\":%.15g", field->name, field->number);
    else if (field->text)
        add(out, strchr(field->text, ' ') ? " %s=\"%s\"" : " %s=%s", field->name,
            sanitize(field->text, text));
    else
        add(out, " %s=%.15g", field->name, field->number);
}

void qm_log_fields(qm_log_level level, const char *message, const qm_log_field *fields, size_t count)
{
    if (level > max_level) return;
    line out = {.size = 0};
    char text[TEXT_SIZE];
    add_stamp(&out, level);
    add(&out, is_json ? ",\"message\":\"%s\"" : " %s", sanitize(message, text));
    /* A field that does not fit together with the end of the line is dropped. */
    for (size_t i = 0; i < count; i++) {
        size_t before = out.size;
        add_field(&out, &fields[i]);
        if (out.size + sizeof "}\n" >= LINE_SIZE) out.size = before;
    }
    out.text[out.size] = '\0';
    add(&out, is_json ? "}\n" : "\n");
    fwrite(out.text, 1, out.size, stderr);
}

void qm_log(qm_log_level level, const char *format, ...)
{
    if (level > max_level) return;
    char message[TEXT_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    qm_log_fields(level, message, NULL, 0);
}
