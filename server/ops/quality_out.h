/**
 * quality_out.h: the metrics of the faces of a mesh as JSON.
 */
#ifndef QM_QUALITY_OUT_H
#define QM_QUALITY_OUT_H

#include "base/text.h"
#include "qm/metric.h"

/** The members of what a metric is over a mesh; figures are null when no face has a value. */
void qm_quality_add_summary(qm_text *out, qm_metric metric, const qm_metric_summary *summary);

/** The summaries of all metrics as one object. Returns as qm_metric_summarize. */
qm_status qm_quality_write(qm_context *ctx, const qm_mesh *mesh, qm_text *out);

#endif
