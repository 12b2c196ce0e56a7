/**
 * text.h: a string that grows. A failed allocation is remembered and asked for once, at the end.
 */
#ifndef QM_TEXT_H
#define QM_TEXT_H

#include <stdbool.h>
#include <stddef.h>

typedef struct qm_text {
    char *data; /* size bytes and a terminating 0; NULL while nothing was added */
    size_t size, capacity;
    bool failed; /* memory ran out: data is incomplete */
} qm_text;

void qm_text_reset(qm_text *text);
void qm_text_add(qm_text *text, const char *bytes, size_t size);
void qm_text_add_string(qm_text *text, const char *string);
void qm_text_printf(qm_text *text, const char *format, ...) __attribute__((format(printf, 2, 3)));

/** Hands the string over to the caller, who frees it; NULL when it had failed. The text is empty
 * afterwards. */
char *qm_text_take(qm_text *text);

/** The number with the fewest digits that read back to the same double, in any locale; "null" for what is not
 * finite. The buffer is enough for any double. Returns out. */
#define QM_NUMBER_SIZE 40
char *qm_text_number(double value, char out[QM_NUMBER_SIZE]);

#endif
