/**
 * id.h: ids of resources, and times in RFC 3339.
 */
#ifndef QM_ID_H
#define QM_ID_H

#define QM_ID_SIZE 40 /* with the terminating zero */
#define QM_TIME_SIZE 32

/** A new random id: a prefix, then 20 characters of a to z and digits. */
void qm_id_make(char prefix, char out[QM_ID_SIZE]);

/** The time now as RFC 3339 in UTC, to the millisecond. */
void qm_time_format(char out[QM_TIME_SIZE]);

/** The time a number of seconds ago. */
void qm_time_format_past(double seconds, char out[QM_TIME_SIZE]);

#endif
