/**
 * log.h: one line a record, on stderr, as text or JSON. Any thread may log.
 */
#ifndef QM_LOG_H
#define QM_LOG_H

#include <stdbool.h>

void qm_log_init(bool as_json);

/** level is "info", "warn" or "error". */
void qm_log(const char *level, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
