/**
 * json_layout.h: layouts and their edits as JSON.
 */
#ifndef QM_JSON_LAYOUT_H
#define QM_JSON_LAYOUT_H

#include "base/id.h"
#include "base/text.h"
#include "problem.h"
#include "qm/layout.h"
#include "qm/pick.h"
#include "qm/reconstruct.h"

/**
 * Reads {nodes, curves, patches}, each of which may be absent: patches name curves by id; without them
 * *has_patches is false and none is there. mesh is where the id of a member "mesh" goes, which is then
 * required; NULL where a file of a layout alone is read. Curves keep their ids.
 *
 * Returns true, and *out is the caller's for qm_layout_reset with ctx; or false with a problem (400 that
 * points to the fault, 422 for a layout that cannot be, 507).
 */
bool qm_json_read_layout(qm_context *ctx, const char *text, size_t size, char mesh[QM_ID_SIZE],
                         qm_layout *out, bool *has_patches, qm_problem *problem);

/** Adds the members nodes, curves and patches. */
void qm_json_add_layout(qm_text *out, const qm_layout *layout);

/** Adds the member issues: what keeps the layout from being whole, each with words. */
void qm_json_add_layout_issues(qm_text *out, const qm_layout_issues *issues);

/** The edits that have a body. */
typedef enum qm_layout_edit_kind {
    QM_EDIT_STROKE,
    QM_EDIT_SPLIT,
    QM_EDIT_SNAP,
    QM_EDIT_REDRAW,
    QM_EDIT_MERGE
} qm_layout_edit_kind;

/** What an edit asks for; the fields of other kinds are zero. */
typedef struct qm_layout_edit {
    double *points; /* rows of x y in the window, or of x y z. On malloc */
    size_t point_count;
    bool in_window; /* stroke always, redraw perhaps: camera and pick tell how to pick */
    qm_camera camera;
    qm_pick_options pick;
    double radius;          /* stroke, snap: how far ends snap; 0 where it was not given */
    double point[3];        /* split, snap */
    int end;                /* snap: 0 from, 1 to */
    uint32_t first, second; /* merge */
} qm_layout_edit;

/** False with a problem (400, 507); else *out is the caller's, for qm_layout_edit_reset. */
bool qm_json_read_layout_edit(const char *text, size_t size, qm_layout_edit_kind kind, qm_layout_edit *out,
                              qm_problem *problem);
void qm_layout_edit_reset(qm_layout_edit *edit);

/** What POST /v1/reconstructions asks for. */
typedef struct qm_json_reconstruction {
    char layout[QM_ID_SIZE];
    char source[QM_ID_SIZE]; /* "" when it is the layout's own mesh */
    qm_reconstruction_options options;
} qm_json_reconstruction;

/** False with a problem (400). */
bool qm_json_read_reconstruction(const char *text, size_t size, qm_json_reconstruction *out,
                                 qm_problem *problem);

/** Reads {layout} alone, as PUT /v1/reconstructions/{id}/layout has it. */
bool qm_json_read_layout_choice(const char *text, size_t size, qm_json_reconstruction *out,
                                qm_problem *problem);

#endif
