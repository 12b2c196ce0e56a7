/**
 * log.h: log records on stderr, one line each, as text or JSON. Any thread may log.
 */
#ifndef QM_LOG_H
#define QM_LOG_H

#include <stdbool.h>
#include <stddef.h>

/** From the most to the least urgent. */
typedef enum qm_log_level { QM_LOG_ERROR, QM_LOG_WARN, QM_LOG_INFO, QM_LOG_LEVEL_COUNT } qm_log_level;

/** "error", "warn" or "info". */
const char *qm_log_level_name(qm_log_level level);

/** Sets the format and the least urgent level that is logged. Call it before other threads start. */
void qm_log_init(bool as_json, qm_log_level level);

/** Logs a record. Quotes and control characters of the message become blanks. */
void qm_log(qm_log_level level, const char *format, ...) __attribute__((format(printf, 2, 3)));

/** A named value of a record, for programs to search by: a text, or a number if text is NULL. */
typedef struct qm_log_field {
    const char *name, *text;
    double number;
} qm_log_field;

/** Logs a record with fields; fields that do not fit into a line are dropped. */
void qm_log_fields(qm_log_level level, const char *message, const qm_log_field *fields, size_t count);

#endif
