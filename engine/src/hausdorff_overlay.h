/**
 * hausdorff_overlay.h: upper bounds for faces of the source from what lies straight over them. See the
 * argument in hausdorff_overlay.c.
 */
#ifndef QM_HAUSDORFF_OVERLAY_H
#define QM_HAUSDORFF_OVERLAY_H

#include "hausdorff_search.h"
#include "rounding.h"

#define QM_OVERLAY_SIDE 128.0 /* u s: margin of half planes, s the greatest coordinate by magnitude */
#define QM_OVERLAY_AREA 64.0  /* u s^2: margin of doubled areas */
#define QM_OVERLAY_GAP 512.0  /* u s (1 + s length / area): margin of vertical distances */

#define QM_OVERLAY_FACES QM_PACK_LANES

/** Triangles of the source, local to the target. */
typedef struct qm_overlay_source {
    int count;
    qm_vec corner[QM_OVERLAY_FACES][3];
} qm_overlay_source;

/** Sets all else of a face from its corners. Returns the margin of its vertical distances for each unit of
 * size, the greatest coordinate by magnitude; INFINITY where the face is too steep or too thin. */
double qm_overlay_set_face(qm_overlay_face *face, double size);

/** Fills the last group up with its first facet. */
void qm_overlay_fill_up(qm_overlay_facets *facets);

/** Bits of those triangles that are shown to be near enough by the facets of the packs straight over them.
 */
unsigned qm_worker_overlay(qm_worker *worker, const qm_side *side, const qm_overlay_source *source,
                           const qm_near_packs *near);

/** The same of one triangle. */
bool qm_worker_overlay_face(qm_worker *worker, const qm_side *side, const qm_piece *face,
                            const qm_near_packs *near);

#endif
