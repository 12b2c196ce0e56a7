/**
 * layout_internal.h: additions to a layout's arrays that several files of this folder make.
 */
#ifndef QM_LAYOUT_INTERNAL_H
#define QM_LAYOUT_INTERNAL_H

#include "core/vec.h"
#include "qm/layout.h"

/** Appends a copy of an issue. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_layout_add_issue(qm_context *ctx, qm_layout_issues *issues, const qm_layout_issue *issue);

/** Appends a copy of a patch, unchecked. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_layout_append_patch(qm_context *ctx, qm_layout *layout, const qm_layout_patch *patch);

#endif
