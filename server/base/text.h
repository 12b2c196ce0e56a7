/**
 * text.h: a growing string of numbers and other text, or of numbers as bytes. A failed allocation is recorded, so that callers check once, at the end.
 */
#ifndef QM_TEXT_H
#define QM_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct qm_text {
    char *data; /* size bytes and a terminating 0; NULL until something is added */
    size_t size, capacity;
    bool failed; /* an allocation failed: data is incomplete */
} qm_text;

void qm_text_reset(qm_text *text);
void qm_text_add(qm_text *text, const char *bytes, size_t size);
void qm_text_add_string(qm_text *text, const char *string);
void qm_text_printf(qm_text *text, const char *format, ...) __attribute__((format(printf, 2, 3)));

/** Returns the string for the caller to free; NULL if an allocation failed. The text is empty afterwards. */
char *qm_text_take(qm_text *text);

/** Prints the shortest decimal that reads back to the same double, in any locale; "null" if it is not finite. Returns
 * out. */
#define QM_NUMBER_SIZE 40
char *qm_text_number(double value, char out[QM_NUMBER_SIZE]);

/**
 * Length of the UTF-8 sequence at text, of which size >= 1 bytes are readable; 0 if it is invalid: overlong forms,
 * surrogates and code points above U+10FFFF are.
 */
size_t qm_text_utf8_length(const char *text, size_t size);

/* ---- long arrays ---- */

/** How long arrays of numbers are sent. */
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
void qm_text_add_array(qm_text *out, qm_array_format format, int columns, uint64_t first, double *numbers,
                       size_t count);

/** Converts doubles between the machine's byte order and little-endian, in place: both ways are the same. */
void qm_text_swap_bytes(double *numbers, size_t count);

#endif
