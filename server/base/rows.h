/**
 * rows.h: rows of numbers as they are sent: binary, CSV or JSON.
 */
#ifndef QM_ROWS_H
#define QM_ROWS_H

#include <stdint.h>

#include "text.h"

typedef enum qm_rows {
    QM_ROWS_BINARY, /* little-endian doubles */
    QM_ROWS_CSV,    /* the same as text, after a line with the names of the columns */
    QM_ROWS_JSON    /* an array in one document */
} qm_rows;

/**
 * Adds count numbers, which are whole rows of so many columns; first is the place of the first row in all
 * that is sent. A single column is numbered in CSV and bare in JSON, where several are an array a row. The
 * numbers are changed.
 */
void qm_rows_write(qm_text *out, qm_rows rows, int columns, uint64_t first, double *numbers, size_t count);

/** Doubles of this machine to little-endian ones, or back, in place: the same turn of bytes, or none. */
void qm_rows_turn_bytes(double *numbers, size_t count);

#endif
