/**
 * patch_trace.h: cuts that run straight over the edges of a quad mesh.
 */
#ifndef QM_PATCH_TRACE_H
#define QM_PATCH_TRACE_H

#include "patch_links.h"

/** Cuts on their way; each entry is the next step of one: a side and the corner that it leads to. */
typedef struct qm_patch_trace {
    qm_context *ctx;
    qm_patch_links *links;
    qm_spoke *steps;
    size_t count, capacity;
} qm_patch_trace;

/** Makes a side that has a link a cut, which goes on at both its ends. False: out of memory. */
bool qm_patch_trace_start_through(qm_patch_trace *trace, qm_quad_side side);

/** Lets cuts begin at every irregular vertex. False: out of memory. */
bool qm_patch_trace_start_irregular(qm_patch_trace *trace);

/** Advances all cuts, one side each in turn, until the last has ended. */
void qm_patch_trace_run(qm_patch_trace *trace);

void qm_patch_trace_reset(qm_patch_trace *trace);

#endif
