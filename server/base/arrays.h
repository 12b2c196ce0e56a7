/**
 * arrays.h: the formats in which long arrays of numbers are sent: binary, CSV or JSON.
 */
#ifndef QM_ARRAYS_H
#define QM_ARRAYS_H

#include <stdint.h>

#include "text.h"

typedef enum qm_array_format {
    QM_ARRAY_BINARY, /* little-endian doubles */
    QM_ARRAY_CSV,    /* text, after a line with the names of the columns */
    QM_ARRAY_JSON    /* an array in one document */
} qm_array_format;

/**
 * Appends count numbers, complete records of `columns` numbers each; first is the index of the first record in the
 * whole array. In CSV a single column is preceded by the record's index; in JSON it is written bare, and several
 * columns as one array per record. Overwrites numbers.
 */
void qm_array_write(qm_text *out, qm_array_format format, int columns, uint64_t first, double *numbers,
                    size_t count);

/** Converts doubles between the machine's byte order and little-endian, in place: both ways are the same. */
void qm_array_swap_bytes(double *numbers, size_t count);

#endif
