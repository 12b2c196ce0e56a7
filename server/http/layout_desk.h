/**
 * layout_desk.h: a layout at work, between its row in the store and the reply: its curves, the surface under
 * it, and what to say of it. Every edit reads the layout as it is, changes a copy, finds the patches again
 * and stores the copy as the next revision; one that lost a race against another edit is a conflict.
 */
#ifndef QM_LAYOUT_DESK_H
#define QM_LAYOUT_DESK_H

#include "handlers.h"
#include "qm/layout_edit.h"

/** before is the layout as it was opened; closing gives everything back, after a failure too. */
typedef struct qm_desk {
    qm_app *app;
    qm_context ctx;
    qm_store_layout row;
    qm_layout before, layout;
    qm_layout_issues issues;
    qm_mesh_ref *mesh;
    qm_source source;
} qm_desk;

/** An empty desk, for a new layout. */
qm_desk qm_desk_make(qm_app *app);

/** Lays out what an edit of the request's layout needs. False with a problem. */
bool qm_desk_open(qm_request *request, qm_desk *desk, qm_problem *problem);

/** Takes the mesh that the row names. False with a problem. */
bool qm_desk_take_mesh(qm_desk *desk, qm_problem *problem);

/** The layout and what it lacks as JSON, for the caller to free whatever it returns: false without memory. */
bool qm_desk_write(const qm_desk *desk, char **layout, char **issues);

/** Stores the edited layout as the next revision and replies with it; more has members that the edit adds. */
void qm_desk_finish(qm_request *request, qm_desk *desk, const char *more);
void qm_desk_close(qm_desk *desk);

/** Makes the problem of a status of the engine; false. */
bool qm_desk_fail(const qm_desk *desk, qm_status status, qm_problem *problem);

/** The row of the layout that the path names. False with a problem. */
bool qm_find_layout(qm_request *request, qm_store_layout *out, qm_problem *problem);

/** Adds the members of a layout; without its curves when brief. */
void qm_write_layout(qm_text *out, const qm_store_layout *row, bool is_brief);

/** Replies with a layout and what an edit changed, which may be NULL. */
void qm_reply_layout(qm_request *request, int status, const qm_store_layout *row, const char *changed);

#endif
