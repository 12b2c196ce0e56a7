/**
 * layout_image.h: the mirror image of an edit of a layout, so that both sides of a plane of symmetry are edited at once.
 */
#ifndef QM_LAYOUT_IMAGE_H
#define QM_LAYOUT_IMAGE_H

#include "layout_session.h"
#include "ops/json_layout.h"

/** What the second name in the path of an edit is. */
typedef enum qm_edit_subject { QM_OF_LAYOUT, QM_OF_CURVE, QM_OF_NODE } qm_edit_subject;

#define QM_IMAGE_SHARE 0.02 /* of the diagonal: how far a curve may be from the image of another one */

/** An edit of the other side. */
typedef struct qm_layout_image {
    qm_layout_edit edit; /* with arrays of its own, for qm_layout_edit_reset */
    uint32_t subject;
    bool is_found; /* what the edit is about has an image */
    bool is_own;   /* which is itself */
} qm_layout_image;

/** Reads `mirror` of the query, if it is there, into the plane of an edit. False after a reply. */
bool qm_layout_image_read_plane(qm_request *request, qm_layout_edit *out);

/**
 * Finds the image of an edit by places in space, before it is made. Of an edit of its own image the places are moved such that it stays
 * that.
 *
 * Returns: false with a problem; *out is the caller's, for qm_layout_edit_reset of its edit, in either case.
 */
bool qm_layout_image_find(const qm_layout_session *s, qm_layout_edit *edit, qm_layout_edit_kind kind,
                          qm_edit_subject of, uint32_t subject, qm_layout_image *out, qm_problem *problem);

/** Once the edit itself is made: true if the image of what it was about is as it was, and is not edited yet. Nodes have their present
 * numbers then. */
bool qm_layout_image_is_left(const qm_layout_session *s, qm_layout_edit_kind kind, qm_edit_subject of,
                             qm_layout_image *image);

#endif
