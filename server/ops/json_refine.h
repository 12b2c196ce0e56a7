/**
 * json_refine.h: the steps of a reconstruction as JSON.
 */
#ifndef QM_JSON_REFINE_H
#define QM_JSON_REFINE_H

#include "base/json_write.h"
#include "refine.h"

/** Adds the members of a step's record; diagonal, of the source, makes the relative figures. */
void qm_json_add_step(qm_text *out, const qm_refine_record *record, double diagonal);

#endif
