/**
 * text.c: growing strings, and the shortest decimals of doubles.
 */
#include "text.h"

#include <endian.h>
#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "qm/base.h"

void qm_text_reset(qm_text *text)
{
    free(text->data);
    *text = (qm_text){0};
}

static bool reserve(qm_text *text, size_t more)
{
    if (text->failed) return false;
    size_t needed = text->size + more + 1;
    if (needed <= text->capacity) return true;
    size_t capacity = text->capacity ? text->capacity : 128;
    while (capacity < needed)
        capacity *= 2;
    char *data = realloc(text->data, capacity);
    if (!data) {
        text->failed = true;
        return false;
    }
    text->data = data;
    text->capacity = capacity;
    return true;
}

void qm_text_add(qm_text *text, const char *bytes, size_t size)
{
    if (!reserve(text, size)) return;
    if (size > 0) memcpy(text->data + text->size, bytes, size);
    text->size += size;
    QM_ASSERT(text->size < text->capacity);
    text->data[text->size] = '\0';
}

void qm_text_add_string(qm_text *text, const char *string)
{
    qm_text_add(text, string, strlen(string));
}

void qm_text_printf(qm_text *text, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(NULL, 0, format, arguments);
    va_end(arguments);
    if (length < 0 || !reserve(text, (size_t)length)) return;
    va_start(arguments, format);
    vsnprintf(text->data + text->size, (size_t)length + 1, format, arguments);
    va_end(arguments);
    text->size += (size_t)length;
}

char *qm_text_take(qm_text *text)
{
    char *data = text->data;
    if (text->failed) {
        free(data);
        data = NULL;
    } else if (!data) {
        data = calloc(1, 1);
    }
    *text = (qm_text){0};
    return data;
}

char *qm_text_number(double value, char out[QM_NUMBER_SIZE])
{
    if (!isfinite(value)) return strcpy(out, "null");
    /* %g drops trailing zeros, so start at the 15 digits that every normal double preserves. */
    for (int digits = fabs(value) < DBL_MIN ? 1 : 15; digits <= 17; digits++) {
        snprintf(out, QM_NUMBER_SIZE, "%.*g", digits, value);
        if (strtod(out, NULL) == value) break;
    }
    /* The locale may have a decimal comma, which strtod above then reads too. */
    QM_ASSERT(strlen(out) < QM_NUMBER_SIZE);
    const char *point = localeconv()->decimal_point;
    char *found = strcmp(point, ".") == 0 ? NULL : strstr(out, point);
    if (found) {
        memmove(found + 1, found + strlen(point), strlen(found + strlen(point)) + 1);
        *found = '.';
    }
    return out;
}

size_t qm_text_utf8_length(const char *text, size_t size)
{
    const unsigned char *bytes = (const unsigned char *)text;
    unsigned char first = bytes[0];
    if (first < 0x80) return 1;
    size_t length = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
    if (first < 0xc2 || first > 0xf4 || length > size) return 0;
    unsigned char low = first == 0xe0 ? 0xa0 : first == 0xf0 ? 0x90 : 0x80;
    unsigned char high = first == 0xed ? 0x9f : first == 0xf4 ? 0x8f : 0xbf;
    if (bytes[1] < low || bytes[1] > high) return 0;
    for (size_t i = 2; i < length; i++)
        if ((bytes[i] & 0xc0) != 0x80) return 0;
    return length;
}

/* ---- long arrays ---- */

void qm_text_swap_bytes(double *numbers, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &numbers[i], sizeof bits);
        bits = le64toh(bits);
        memcpy(&numbers[i], &bits, sizeof bits);
    }
}

static void write_record(qm_text *out, bool is_csv, int columns, uint64_t index, const double *number)
{
    char text[QM_NUMBER_SIZE];
    if (!is_csv && index > 0) qm_text_add_string(out, ",");
    if (!is_csv && columns > 1) qm_text_add_string(out, "[");
    if (is_csv && columns == 1) qm_text_printf(out, "%llu,", (unsigned long long)index);
    for (int i = 0; i < columns; i++) {
        if (i > 0) qm_text_add_string(out, ",");
        qm_text_add_string(out, qm_text_number(number[i], text));
    }
    if (!is_csv && columns > 1) qm_text_add_string(out, "]");
    if (is_csv) qm_text_add_string(out, "\n");
}

void qm_text_add_array(qm_text *out, qm_array_format format, int columns, uint64_t first, double *numbers,
                       size_t count)
{
    QM_ASSERT(columns >= 1 && count % (size_t)columns == 0);
    if (format == QM_ARRAY_BINARY) {
        qm_text_swap_bytes(numbers, count);
        qm_text_add(out, (const char *)numbers, count * sizeof *numbers);
        return;
    }
    for (size_t i = 0; i < count; i += (size_t)columns)
        write_record(out, format == QM_ARRAY_CSV, columns, first + i / (size_t)columns, numbers + i);
}
