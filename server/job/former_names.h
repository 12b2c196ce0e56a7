/**
 * former_names.h: the names that the version before gave to members of jobs. What it has stored is shown with those of today.
 */
#ifndef QM_FORMER_NAMES_H
#define QM_FORMER_NAMES_H

/** Puts today's names in the place of former ones, in JSON as it is stored: members of a job, its result or an event. NULL is left
 * alone. */
void qm_former_names_replace(char *json);

#endif
