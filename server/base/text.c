#include "text.h"

#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
    /* Printing drops zeros at the end, so that 15 digits, which every normal number has, are a fair start. */
    for (int digits = fabs(value) < DBL_MIN ? 1 : 15; digits <= 17; digits++) {
        snprintf(out, QM_NUMBER_SIZE, "%.*g", digits, value);
        if (strtod(out, NULL) == value) break;
    }
    /* The process may run in a locale with decimal commas; strtod above then reads them too. */
    const char *point = localeconv()->decimal_point;
    char *found = strcmp(point, ".") == 0 ? NULL : strstr(out, point);
    if (found) {
        memmove(found + 1, found + strlen(point), strlen(found + strlen(point)) + 1);
        *found = '.';
    }
    return out;
}
