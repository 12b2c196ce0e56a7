/**
 * layout_work.h: what the files of the layout share.
 */
#ifndef QM_LAYOUT_WORK_H
#define QM_LAYOUT_WORK_H

#include "core/vec.h"
#include "qm/layout.h"

/** QM_OK or QM_E_NO_MEMORY. */
qm_status qm_layout_add_issue(qm_context *ctx, qm_layout_issues *issues, const qm_layout_issue *issue);

/** Adds a patch as it is. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_layout_append_patch(qm_context *ctx, qm_layout *layout, const qm_layout_patch *patch);

#endif
