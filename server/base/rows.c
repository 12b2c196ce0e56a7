#include "rows.h"

#include <endian.h>
#include <string.h>

#include "json_write.h"

void qm_rows_turn_bytes(double *numbers, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &numbers[i], sizeof bits);
        bits = le64toh(bits);
        memcpy(&numbers[i], &bits, sizeof bits);
    }
}

static void write_row(qm_text *out, bool is_csv, int columns, uint64_t row, const double *number)
{
    char text[QM_NUMBER_SIZE];
    if (!is_csv && row > 0) qm_text_add_string(out, ",");
    if (!is_csv && columns > 1) qm_text_add_string(out, "[");
    if (is_csv && columns == 1) qm_text_printf(out, "%llu,", (unsigned long long)row);
    for (int i = 0; i < columns; i++) {
        if (i > 0) qm_text_add_string(out, ",");
        qm_text_add_string(out, qm_text_number(number[i], text));
    }
    if (!is_csv && columns > 1) qm_text_add_string(out, "]");
    if (is_csv) qm_text_add_string(out, "\n");
}

void qm_rows_write(qm_text *out, qm_rows rows, int columns, uint64_t first, double *numbers, size_t count)
{
    if (rows == QM_ROWS_BINARY) {
        qm_rows_turn_bytes(numbers, count);
        qm_text_add(out, (const char *)numbers, count * sizeof *numbers);
        return;
    }
    for (size_t i = 0; i < count; i += (size_t)columns)
        write_row(out, rows == QM_ROWS_CSV, columns, first + i / (size_t)columns, numbers + i);
}
