/**
 * arrays.c: records of numbers as binary, CSV or JSON.
 */
#include "arrays.h"

#include <endian.h>
#include <string.h>

#include "json.h"
#include "qm/base.h"

void qm_array_swap_bytes(double *numbers, size_t count)
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

void qm_array_write(qm_text *out, qm_array_format format, int columns, uint64_t first, double *numbers,
                    size_t count)
{
    QM_ASSERT(columns >= 1 && count % (size_t)columns == 0);
    if (format == QM_ARRAY_BINARY) {
        qm_array_swap_bytes(numbers, count);
        qm_text_add(out, (const char *)numbers, count * sizeof *numbers);
        return;
    }
    for (size_t i = 0; i < count; i += (size_t)columns)
        write_record(out, format == QM_ARRAY_CSV, columns, first + i / (size_t)columns, numbers + i);
}
