#include "json_write.h"

#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "utf8.h"

void qm_json_add_comma(qm_text *out)
{
    if (out->size > 0 && !strchr("{[:,", out->data[out->size - 1])) qm_text_add_string(out, ",");
}

void qm_json_add_quoted(qm_text *out, const char *string)
{
    qm_text_add_string(out, "\"");
    for (size_t rest = strlen(string); rest > 0;) {
        size_t length = qm_utf8_length(string, rest);
        if (length == 0)
            qm_text_add_string(out, "\xef\xbf\xbd");
        else if (*string == '"' || *string == '\\')
            qm_text_printf(out, "\\%c", *string);
        else if ((unsigned char)*string < 0x20)
            qm_text_printf(out, "\\u%04x", (unsigned)*string);
        else
            qm_text_add(out, string, length);
        string += length > 0 ? length : 1;
        rest -= length > 0 ? length : 1;
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
