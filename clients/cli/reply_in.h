/**
 * reply_in.h: what the command line reads of the daemon's JSON, as the structs that the daemon wrote it from.
 * With json_out.h of the server this goes round: a result that was read writes the same text again.
 */
#ifndef QM_REPLY_IN_H
#define QM_REPLY_IN_H

#include "job_kinds.h"
#include "problem.h"

typedef enum qm_event_kind {
    QM_EVENT_BOUNDS,
    QM_EVENT_RESULT,
    QM_EVENT_ERROR,
    QM_EVENT_OTHER, /* heartbeat and whatever later versions add */
    QM_EVENT_BROKEN /* not an event at all */
} qm_event_kind;

typedef struct qm_event {
    qm_event_kind kind;
    qm_hausdorff_progress progress; /* of BOUNDS */
    qm_job_result result;           /* of RESULT; diagonal is not part of it */
    qm_problem problem;             /* of ERROR */
} qm_event;

/** Reads one line of a stream of events, without its line end. */
void qm_reply_read_event(const char *line, qm_event *out);

/** The id and the diagonal of a mesh resource; false when it is none. */
bool qm_reply_read_mesh(const char *text, char id[QM_ID_SIZE], double *diagonal);

/** A problem document; false when the text is none. Codes that this version does not know become INTERNAL. */
bool qm_reply_read_problem(const char *text, qm_problem *out);

#endif
