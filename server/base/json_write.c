/**
 * json_write.c: members and values of JSON documents, appended to a text.
 */
#include "json.h"

#include <math.h>
#include <string.h>

#include "qm/base.h"

void qm_json_add_comma(qm_text *out)
{
    QM_ASSERT(out->failed || out->size == 0 || out->data);
    if (out->size > 0 && !strchr("{[:,", out->data[out->size - 1])) qm_text_add_string(out, ",");
}

void qm_json_add_quoted(qm_text *out, const char *string)
{
    qm_text_add_string(out, "\"");
    for (size_t left = strlen(string); left > 0;) {
        size_t length = qm_text_utf8_length(string, left);
        if (length == 0)
            qm_text_add_string(out, "\xef\xbf\xbd");
        else if (*string == '"' || *string == '\\')
            qm_text_printf(out, "\\%c", *string);
        else if ((unsigned char)*string < 0x20)
            qm_text_printf(out, "\\u%04x", (unsigned)*string);
        else
            qm_text_add(out, string, length);
        string += length > 0 ? length : 1;
        left -= length > 0 ? length : 1;
    }
    qm_text_add_string(out, "\"");
}

void qm_json_add_name(qm_text *out, const char *name)
{
    qm_json_add_comma(out);
    qm_json_add_quoted(out, name);
    qm_text_add_string(out, ":");
}

void qm_json_open(qm_text *out, const char *name, const char *bracket)
{
    QM_ASSERT(bracket[0] == '{' || bracket[0] == '[');
    qm_json_add_name(out, name);
    qm_text_add_string(out, bracket);
}

void qm_json_add_string(qm_text *out, const char *name, const char *value)
{
    qm_json_add_name(out, name);
    qm_json_add_quoted(out, value);
}

void qm_json_add_word(qm_text *out, const char *name, const char *word)
{
    qm_json_add_name(out, name);
    qm_text_add_string(out, word);
}

void qm_json_add_bool(qm_text *out, const char *name, bool value)
{
    qm_json_add_word(out, name, value ? "true" : "false");
}

void qm_json_add_number(qm_text *out, const char *name, double value)
{
    char text[QM_NUMBER_SIZE];
    qm_json_add_word(out, name, qm_text_number(value, text));
}

void qm_json_add_ms(qm_text *out, const char *name, double ms)
{
    qm_json_add_number(out, name, rint(1e3 * ms) / 1e3);
}

void qm_json_add_count(qm_text *out, const char *name, uint64_t value)
{
    qm_json_add_name(out, name);
    qm_text_printf(out, "%llu", (unsigned long long)value);
}

void qm_json_add_array(qm_text *out, const double *values, int count)
{
    char text[QM_NUMBER_SIZE];
    qm_json_add_comma(out);
    qm_text_add_string(out, "[");
    for (int i = 0; i < count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, qm_text_number(values[i], text));
    }
    qm_text_add_string(out, "]");
}

void qm_json_add_numbers(qm_text *out, const char *name, const double *values, int count)
{
    qm_json_add_name(out, name);
    qm_json_add_array(out, values, count);
}

void qm_json_add_members(qm_text *out, const char *object)
{
    size_t size = strlen(object);
    QM_ASSERT(size >= 2 && object[0] == '{' && object[size - 1] == '}');
    if (size > 2) qm_json_add_comma(out);
    qm_text_add(out, object + 1, size - 2);
}
