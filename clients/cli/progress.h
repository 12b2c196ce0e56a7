/**
 * progress.h: the bounds on their way together, on stderr: a bar on a terminal, else a line a second.
 */
#ifndef QM_PROGRESS_H
#define QM_PROGRESS_H

#include <stdbool.h>

#include "qm/hausdorff.h"

typedef struct qm_progress_view {
    double tolerance; /* absolute: where the bar is full */
    double diagonal;  /* of A's box, for the relative gap */
    double first_gap; /* where the bar is empty; 0 while no upper bound is known */
    double shown_ms;  /* when the last line was written */
    bool is_terminal, has_bar;
} qm_progress_view;

qm_progress_view qm_progress_view_make(double tolerance, double diagonal);

/** Shows new bounds, at most so often that a person can follow. */
void qm_progress_view_show(qm_progress_view *view, const qm_hausdorff_progress *progress);

/** Takes the bar off the terminal. */
void qm_progress_view_end(qm_progress_view *view);

#endif
